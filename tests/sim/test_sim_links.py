"""The ground truth counts every link that begins to overlap the object, and no other."""

import numpy as np
import pytest
from gantry_rig import Rig, kernels

from lwrprobe_sim import link_kernels as links
from lwrprobe_sim import scenery_kernels as scenery


def collisions(rig):
    return int(rig.world.counts[kernels.WATCH_COUNTS + links.COLLISIONS])


def sample_link(link, rng, count):
    """Points spread over a link's body, in its carrier's frame."""
    if link.kind == "box":
        local = rng.uniform(-0.5, 0.5, (count, 3)) * link.size
    else:
        angle, radius = rng.uniform(0, 2 * np.pi, count), link.size[0] * np.sqrt(rng.uniform(0, 1, count))
        local = np.c_[radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-0.5, 0.5, count) * link.size[1]]
    return local @ link.pose[:3, :3].T + link.pose[:3, 3]


@pytest.mark.parametrize("scene", ["block", "bridge", "cylinder_horizontal", "inner_corner", "polystyrene_1"])
@pytest.mark.parametrize("tilt", [0.0, 0.6])
@pytest.mark.slow
def test_the_bound_is_a_bound_and_an_overlap_an_overlap(scene, tilt):
    rig = Rig((0.0, 0.0, 0.3), scene=scene, tilt=tilt)
    world, rng = rig.world, np.random.default_rng(2)
    s = world.state[kernels.WATCH : kernels.SET]
    v, around = world.state[kernels.SCENERY : kernels.BODY], world.counts[kernels.SCENERY_COUNTS :]
    watched = [link for link in world.probe.links if link.name != "stick"]
    hits = 0
    for _ in range(30):
        world.place(np.array([*rng.uniform(-0.06, 0.06, 2), rng.uniform(-0.05, 0.05)]))
        tip = world.tip()
        frame = tuple(tip[:3, :].T.ravel())
        for k, link in enumerate(watched):
            row = s[links.LINKS + k * links.LINK : links.LINKS + (k + 1) * links.LINK]
            pose = links.pose_of(row, s[links.FRAMES : links.LINKS].reshape(17, 4, 4), frame)
            bound = links.clearance(s, row, v, around, world.numbers, world.indices, pose)
            points = sample_link(link, rng, 800) @ tip[:3, :3].T + tip[:3, 3]
            distance = min(rig.solid.signed_distance(points).min(), points[:, 2].min())
            assert bound <= max(distance, 0.0) + 2 * links.FINEST
            if bound > 0.0:
                assert distance > -2 * links.FINEST
            else:
                hits += 1
    assert hits > 0


def test_a_holder_that_comes_down_on_the_rim_counts_once():
    rig = Rig((0.0, -0.035, 0.06), ["table.present=false"])
    rig.line((0.0, -0.035, 0.06), (0.0, -0.035, -0.014), 1.0)
    assert collisions(rig) == 0
    rig.line((0.0, -0.035, -0.014), (0.0, -0.035, -0.016), 0.1)
    assert collisions(rig) == 1
    rig.line((0.0, -0.035, -0.016), (0.0, -0.035, 0.0), 0.1)
    rig.line((0.0, -0.035, 0.0), (0.0, -0.035, -0.016), 0.1)
    assert collisions(rig) == 2


def test_a_fast_pass_is_seen_too():
    rig = Rig((0.0, -0.2, 0.0), ["table.present=false", "motion.free_speed=1.0"])
    rig.line((0.0, -0.2, -0.03), (0.0, 0.2, -0.03), 0.4)
    assert collisions(rig) >= 2


def test_far_from_everything_it_is_looked_at_rarely():
    rig = Rig((0.0, 0.0, 0.4))
    rig.line((0.0, 0.0, 0.4), (0.1, 0.0, 0.4), 1.0)
    assert rig.world.counts[kernels.WATCH_COUNTS + links.LOOKS] < 5


@pytest.mark.slow
def test_a_distance_bound_never_exceeds_the_distance():
    for scene in ("block", "bridge", "combination", "polystyrene_2", "jaw_chuck"):
        rig = Rig((0.0, 0.0, 0.4), scene=scene)
        v, around = rig.world.state[kernels.SCENERY : kernels.BODY], rig.world.counts[kernels.SCENERY_COUNTS :]
        points = np.random.default_rng(4).uniform((-0.1, -0.1, 0.0), (0.1, 0.1, 0.15), (500, 3))
        exact = np.minimum(rig.solid.signed_distance(points), points[:, 2])
        for point, distance in zip(points, exact):
            bound = scenery.distance_bound(v, around, rig.world.numbers, rig.world.indices, *point)
            assert bound <= max(distance, 0.0) + 1e-9
            assert (bound < 0.0) == (distance < 0.0) or abs(distance) < 1e-9
            found = scenery.distance(v, around, rig.world.numbers, rig.world.indices, *point)
            assert found == pytest.approx(distance, abs=1e-9)
