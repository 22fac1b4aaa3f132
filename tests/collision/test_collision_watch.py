"""What the watch leaves out is never what it was asked for."""

from __future__ import annotations

import numpy as np
import pytest
from naive_collision import at

from lwrprobe.collision import NO_FRAMES, ClearanceQuery, ClearanceWatch, LinkGroup
from lwrprobe.contracts import InputError, LinkShape
from lwrprobe.mapping import VoxelMap

EXACT = 3e-7


STICK = LinkShape("stick", "cylinder", (0.002, 0.040), at(z=-0.025))
HOLDER = LinkShape("holder", "capsule", (0.0125, 0.04), at(z=-0.08))
FINGER = LinkShape("finger", "box", (0.012, 0.02, 0.07), at(y=0.02, z=-0.12))
FOREARM = LinkShape("forearm", "capsule", (0.03, 0.2), at(), "1")
GROUPS = [LinkGroup([HOLDER, FINGER], 0.003), LinkGroup([STICK], 0.0001)]


def wandering(rng, steps):
    """Tip poses of a walk that turns, rests, jumps and comes near."""
    pose = at(0.06, 0.0, 0.05)
    for i in range(steps):
        if i % 97 == 0:
            pose = at(*rng.uniform(-0.08, 0.08, 3), turn=rng.uniform(-2, 2, 3))
        elif i % 7:
            pose = pose @ at(*rng.normal(0.0, 3e-4, 3), turn=rng.normal(0.0, 3e-3, 3))
        yield np.ascontiguousarray(pose)


def check(found, exact, keeps):
    """`exact` (n,) distances of the groups, `keeps` theirs to keep."""
    reserves = np.array(exact) - keeps
    least = int(np.argmin(reserves))
    if (reserves < 0.0).any():
        assert found.threatens
        assert found.distance - found.required == pytest.approx(reserves[least], abs=EXACT)
    else:
        assert not found.threatens
        true = exact[list(keeps).index(found.required)]
        assert true / 3.0 - EXACT <= found.distance <= true + EXACT
        assert found.distance - found.required <= reserves[least] + EXACT


def test_every_threat_and_the_smallest_distance_are_those_of_measuring_each_time():
    rng = np.random.default_rng(4)
    voxels = VoxelMap(0.002)
    watch = ClearanceWatch(GROUPS, voxels)
    queries = [ClearanceQuery(group.links, voxels) for group in GROUPS]
    keeps = [group.keep for group in GROUPS]
    smallest, threats, bounds = np.inf, 0, 0
    for i, pose in enumerate(wandering(rng, 2000)):
        if i % 40 == 0 and i < 1000:
            voxels.insert_point(rng.uniform(-0.05, 0.05, 3))
        exact = [query.nearest(pose).distance for query in queries]
        found = watch.nearest(pose)
        check(found, exact, keeps)
        smallest = min(smallest, *exact)
        threats += found.threatens
        bounds += found.distance < min(exact) - EXACT
    assert watch.smallest == pytest.approx(smallest, abs=EXACT)
    assert threats > 20
    assert bounds > 600  # else nothing was left out, and this test says nothing


def test_links_on_arm_frames_are_followed_by_their_own_motion():
    rng = np.random.default_rng(5)
    voxels = VoxelMap(0.002)
    voxels.insert(rng.uniform(-0.02, 0.02, (200, 3)))
    groups = [LinkGroup([FOREARM, HOLDER], 0.003), LinkGroup([STICK], 0.0001)]
    watch = ClearanceWatch(groups, voxels)
    queries = [ClearanceQuery(group.links, voxels) for group in groups]
    tip, bounds = at(x=0.5), 0
    for turn in np.linspace(0.0, 2.0, 400):
        frames = np.stack([np.eye(4), at(0.12 - 0.04 * turn, 0.0, 0.1, turn=(0.0, turn, 0.0))])
        exact = [query.nearest(tip, frames).distance for query in queries]
        found = watch.nearest(tip, frames)
        check(found, exact, [group.keep for group in groups])
        bounds += found.distance < min(exact) - EXACT
    assert found.link == "forearm"
    assert bounds > 100


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-6, 1e-4, 1e-3, 0.05])
def test_along_a_wall_that_is_nearly_parallel(tilt):
    """Where many voxels are as near as each other."""
    side, height = np.arange(-0.01, 0.01, 0.002), np.arange(-0.06, 0.0, 0.002)
    voxels = VoxelMap(0.002)
    voxels.insert(np.array([[-0.001, y + 0.001, z + 0.001] for y in side for z in height]))
    watch = ClearanceWatch([LinkGroup([STICK], 0.01)], voxels)
    for y in np.linspace(-0.005, 0.005, 30):
        pose = at(0.0026, y, 0.0, turn=(0.0, tilt, 0.0))
        found = watch.nearest(pose)
        far_end = 0.0026 - 0.045 * np.sin(tilt) - 0.002 * np.cos(tilt)
        assert found.distance == pytest.approx(max(far_end, 0.0), abs=EXACT)


def test_nothing_touched_yet_and_no_such_carrier():
    found = ClearanceWatch(GROUPS, VoxelMap()).nearest(np.eye(4), NO_FRAMES)
    assert found.distance == np.inf
    assert found.link == ""
    assert not found.threatens
    with pytest.raises(InputError, match="carrier"):
        ClearanceWatch([LinkGroup([LinkShape("a", "box", (1.0, 1.0, 1.0), np.eye(4), "wrist")], 0.1)], VoxelMap())
