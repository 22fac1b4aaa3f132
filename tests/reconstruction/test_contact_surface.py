"""The default method's promises: closed, true to the object, honest about what it does not know."""

from dataclasses import replace
from pathlib import Path

import naive_reconstruction as naive
import numpy as np
import pytest
from partly_touched import upper_part
from scipy.spatial import cKDTree

from lwrprobe.bench.sampled_lines import NOISE, NORMAL_NOISE, sample_lines, voxelised
from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.evaluation import mesh_error, reach
from lwrprobe.reconstruction import contact_surface, rulings
from lwrprobe.reconstruction.clusters import Clusters, cluster, supported, wedged
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.convex_hull import convex_hull
from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.touches import line_pitch, prepare, regular_lines
from lwrprobe.reconstruction.undersides import _broad, _parallel, find_undersides
from lwrprobe.scene import load_scene
from lwrprobe.scene.mesh_distance import MeshDistance
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

pytestmark = pytest.mark.slow

ABOVE = 0.006


@pytest.fixture(scope="module")
def scenes():
    solids, records = {}, {}

    def get(name, pitch=0.01, phase=0.25):
        if name not in solids:
            solids[name] = load_scene(name).solid()
        if (name, pitch, phase) not in records:
            records[name, pitch, phase] = sample_lines(solids[name], pitch, phase)
        return solids[name], records[name, pitch, phase]

    return get


def surface(record, **options):
    return ContactSurface(ContactSurface.Config(**options)).reconstruct(record)


def error(mesh, solid):
    return mesh_error(mesh, solid, ABOVE, samples=4000)


def away(record, result):
    """(n,) m, of the vertices from what was touched."""
    return cKDTree(record.points).query(result.mesh.vertices)[0]


def recorded(name, pitch=0.025):
    """Some contacts and free places of a run in the ideal world, seed 1.

    `bridge`, `combination`: every eighth of the first 120 s and 200 s of `active`. `receding`: of `grid_version` on
    `random:revolution:8704` every sixth contact below 25 mm, every 36th of the others, and every fourth free place.
    `comb`: every 16th contact of `active` on a comb of boxes, and every second free place. `rods`: every 16th contact
    and every eighth free place of `grid_version` on `random:thin:11607` in the lab world.
    """
    file = np.load(Path(__file__).parent / "recorded" / f"{name}.npz")
    contacts, free = file["contacts"].astype(float), file["free_path"].astype(float)
    return TouchRecord(
        contacts[:, :3],
        normals=contacts[:, 3:],
        free_path=free,
        probe_radius=0.005,
        table=0.0,
        lowest=0.006,
        pitch=pitch,
    )


@pytest.mark.parametrize("name", ["bridge", "combination"])
def test_walls_between_strokes_keep_a_wide_field_out_of_what_the_sphere_passed(name, monkeypatch):
    solid, record = load_scene(name).solid(), recorded(name)
    whole = error(surface(record).mesh, solid)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0)
    monkeypatch.setattr(rulings, "_up_to_tops", lambda *given: nothing)
    close = error(surface(record).mesh, solid)
    assert whole.mean < 0.7 * close.mean, "walls go straight up to the tops behind them"
    monkeypatch.setattr(contact_surface, "_WALLS_APART", np.inf)
    assert close.mean < 0.75 * error(surface(record).mesh, solid).mean


def test_walls_are_as_far_apart_as_stated_between_regular_lines_or_where_no_path_is_known(scenes, monkeypatch):
    lines, unknown = scenes("bridge", 0.02)[1], replace(recorded("bridge"), free_path=None)
    found = [surface(record).mesh.vertices for record in (lines, unknown)]
    monkeypatch.setattr(contact_surface, "_WALLS_APART", np.inf)
    for record, vertices in zip((lines, unknown), found):
        assert np.array_equal(surface(record).mesh.vertices, vertices)


def test_regular_lines_are_told_from_strokes(scenes):
    centres = prepare(scenes("bridge", 0.02)[1], 0.002).centres
    assert regular_lines(centres, 0.02)
    assert not regular_lines(centres, 0.03)
    for name in ("bridge", "combination"):
        assert not regular_lines(prepare(recorded(name), 0.002).centres, 0.025)


@pytest.mark.parametrize(
    ("name", "mean", "worst"),
    [
        ("block", 0.3, 3.0),
        ("cylinder_vertical", 0.3, 2.5),
        ("bridge", 0.35, 2.6),
        ("polystyrene_2", 0.3, 2.5),
        ("jaw_chuck", 0.7, 6.0),
    ],
)
def test_ten_millimetre_lines(scenes, name, mean, worst):
    solid, record = scenes(name)
    result = surface(record)
    found = error(result.mesh, solid)
    assert naive.closed(result.mesh.faces)
    assert found.watertight
    assert found.mean < 1e-3 * mean
    assert found.hausdorff < 1e-3 * worst


@pytest.mark.parametrize("name", ["block", "cylinder_vertical", "cylinder_horizontal", "stacked_blocks"])
def test_never_worse_than_the_hull_on_a_convex_object(scenes, name):
    solid, record = scenes(name)
    assert error(surface(record).mesh, solid).mean < error(convex_hull(record.points), solid).mean


@pytest.mark.parametrize("name", ["bridge", "jaw_chuck"])
def test_contacts_that_are_closer_than_stated_count_as_what_they_are(scenes, name):
    """Strokes cross and come closer with time. A field that is as wide as the stated distance cuts the edges."""
    solid, record = scenes(name)
    more = reach(solid, record.probe_radius, record.lowest, samples=800)
    points, normals = np.vstack([record.points, more.points]), np.vstack([record.normals, more.normals])
    dense = replace(record, points=points, normals=normals, free_path=None, pitch=0.025)
    found = surface(dense)
    assert found.report["pitch"] < 0.011
    assert error(found.mesh, solid).mean < 0.7 * error(surface(dense, pitch=0.025).mesh, solid).mean


def test_lines_with_gaps_between_them_are_as_far_apart_as_stated(scenes):
    """No line crosses the ends: what lies there is farther from a contact than half of the distance between lines."""
    _, record = scenes("bridge")
    assert surface(replace(record, pitch=0.025)).report["pitch"] == 0.025


def test_fifteen_millimetre_lines_and_voxels(scenes):
    solid, record = scenes("cylinder_vertical", 0.015)
    assert error(surface(record).mesh, solid).mean < 9e-4
    solid, record = scenes("polystyrene_2")
    assert error(surface(voxelised(record)).mesh, solid).mean < 4.5e-4


def test_an_edge_that_the_last_line_rolled_over_ends_the_object_there(scenes):
    """At this phase a line runs 2.5 mm beyond one end: its leaning normals tell where the edge is."""
    _, record = scenes("block")
    assert (record.points + record.probe_radius * record.normals)[:, 0].max() > 0.052
    mesh = surface(record).mesh
    middle = (mesh.vertices[:, 0] > 0.0) & (mesh.vertices[:, 2] > 0.015) & (mesh.vertices[:, 2] < 0.035)
    assert mesh.vertices[middle, 0].max() == pytest.approx(0.05, abs=1e-3)


def test_expected_errors_are_neither_boast_nor_fright(scenes):
    """Over evenly shifted lines, so that no end is lucky."""
    actual, expected = [], []
    for phase in (0.125, 0.375, 0.625, 0.875):
        solid, record = scenes("block", phase=phase)
        result = surface(record)
        known = ~result.unreachable & (result.mesh.vertices[:, 2] > ABOVE)
        actual.append(np.abs(solid.signed_distance(result.mesh.vertices[known])))
        expected.append(result.mesh.vertex_error[known])
    actual, expected = np.concatenate(actual), np.concatenate(expected)
    assert 0.5 < actual.mean() / expected.mean() < 1.5
    order = np.argsort(expected)
    fifth = len(order) // 5
    assert actual[order[-fifth:]].mean() > 5.0 * actual[order[:fifth]].mean()


@pytest.mark.parametrize(("nearest", "farthest"), [(0.005, 0.0075), (0.0075, 0.01), (0.01, 0.02), (0.02, 0.04)])
def test_expected_errors_beyond_what_was_touched_grow_with_the_distance_from_it(scenes, nearest, farthest):
    """On an object that is narrower below: what was touched, its top, says nothing of that."""
    solid, record = scenes("random:revolution:9844", 0.01)
    result = surface(record, pitch=0.01)
    distance = away(record, result)
    there = (distance > nearest) & (distance < farthest) & (result.mesh.vertices[:, 2] > ABOVE)
    actual = np.abs(solid.signed_distance(result.mesh.vertices[there])).mean()
    assert 0.4 < actual / result.mesh.vertex_error[there].mean() < 2.5


def test_walls_below_all_that_was_touched_are_less_certain_the_lower_they_are(scenes):
    """They are led on straight, down to the table; what stands there may be narrower."""
    _, record = scenes("block", 0.01)
    high, free = record.points[:, 2] > 0.04, record.free_path[record.free_path[:, 2] > 0.04]
    above = replace(record, points=record.points[high], normals=record.normals[high], free_path=free)
    result = surface(replace(above, confidence=None, times=None), pitch=0.01)
    x, y, z = result.mesh.vertices.T
    wall = (np.abs(np.abs(y) - 0.025) < 0.002) & (np.abs(x) < 0.04)
    low, middle = wall & (z > 0.008) & (z < 0.012), wall & (z > 0.032) & (z < 0.036)
    assert low.sum() > 20
    assert middle.sum() > 20
    assert result.mesh.vertex_error[low].min() > 0.3 * (0.028 - 0.005)
    assert result.mesh.vertex_error[middle].mean() < 0.002


def test_what_the_sphere_cannot_reach_is_marked(scenes):
    """A floor at z = 20 mm meets a wall at y = 20 mm: the sphere rests in the edge and cannot reach its bottom."""
    solid, record = scenes("inner_corner")
    result = surface(record)
    x, y, z = 1e3 * result.mesh.vertices.T
    assert result.unreachable.shape == x.shape
    assert result.unreachable[result.mesh.vertices[:, 2] < record.lowest - 1e-6].all()
    beside = (x > -30) & (x < 10)
    edge = beside & (np.abs(y - 18.5) < 1.2) & (np.abs(z - 21.5) < 1.2)
    floor = beside & (y > -30) & (y < 10) & (np.abs(z - 20) < 1)
    assert result.unreachable[edge].mean() > 0.8
    assert result.unreachable[floor].mean() < 0.02
    deviation = np.abs(solid.signed_distance(result.mesh.vertices))
    high = z > 8.0
    assert deviation[high & result.unreachable].mean() > 3.0 * deviation[high & ~result.unreachable].mean()


@pytest.mark.parametrize("name", ["block", "cylinder_vertical", "bridge"])
def test_nothing_is_marked_where_the_sphere_reaches_all(scenes, name):
    _, record = scenes(name)
    result = surface(record)
    assert result.unreachable[result.mesh.vertices[:, 2] > 0.008].mean() < 0.01


def test_the_same_record_gives_the_same_mesh(scenes):
    _, record = scenes("bridge")
    first, second = surface(record).mesh, surface(record).mesh
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)


def test_it_says_what_it_had_to_do_without(scenes):
    solid, record = scenes("polystyrene_2")
    bare = TouchRecord(record.points, normals=record.normals)
    result = surface(bare)
    assert set(result.report["without"]) == {"confidence", "free path", "probe radius", "table"}
    assert error(result.mesh, solid).mean < 1e-3
    result = surface(TouchRecord(record.points))
    assert "normals" in result.report["without"]
    assert naive.closed(result.mesh.faces)
    assert error(result.mesh, solid).mean < error(convex_hull(record.points), solid).mean


@pytest.mark.parametrize("pitch", [0.005, 0.01, 0.015])
@pytest.mark.parametrize("name", ["block", "polystyrene_1"])
def test_the_pitch_of_the_lines_is_found(scenes, name, pitch):
    _, record = scenes(name, pitch)
    centres = record.points + record.probe_radius * record.normals
    assert line_pitch(centres) == pytest.approx(pitch, rel=0.05)


def test_heaps_that_a_shape_makes_are_no_lines(scenes):
    _, record = scenes("jaw_chuck", 0.01, 0.375)
    assert line_pitch(record.points + record.probe_radius * record.normals) == pytest.approx(0.01, rel=0.05)


def test_low_confidence_counts_little(scenes):
    solid, record = scenes("polystyrene_2")
    rng = np.random.default_rng(7)
    wrong = rng.random(len(record.points)) < 0.1
    points = record.points + np.where(wrong[:, None], 2e-3 * record.normals, 0.0)
    trusted = surface(replace(record, points=points, confidence=np.where(wrong, 0.01, 1.0)))
    naively = surface(replace(record, points=points))
    assert error(trusted.mesh, solid).mean < 0.7 * error(naively.mesh, solid).mean


def line_of(count):
    return np.column_stack([np.zeros(count), np.linspace(0, 0.1, count), np.full(count, 0.05)])


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.eye(3)[:2] * 0.1,
        np.eye(3) * 0.1,
        line_of(40),
        np.ones((100, 3)),
        np.column_stack([np.random.default_rng(1).random((60, 2)) * 0.1, np.full(60, 0.05)]),
        np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, np.nan]]),
    ],
)
@pytest.mark.parametrize("normals", [True, False])
def test_degenerate_contacts_get_one_typed_error(points, normals):
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1)) if normals else None
    with pytest.raises(InputError):
        surface(TouchRecord(points, normals=up, probe_radius=0.005, table=0.0))


def test_normals_without_length_and_contacts_without_confidence_are_left_out(scenes):
    _, record = scenes("polystyrene_2")
    normals, confidence = record.normals.copy(), np.ones(len(record.points))
    normals[:5], normals[5:10], confidence[10:15] = 0.0, np.nan, 0.0
    result = surface(replace(record, normals=normals, confidence=confidence))
    assert result.report["contacts"] == len(record.points) - 15
    with pytest.raises(InputError, match="at least 4"):
        surface(replace(record, normals=np.zeros_like(normals)))


@pytest.mark.parametrize("options", [{"pitch": -1.0}, {"step": 0.0}, {"pitch": np.nan}])
def test_bad_options_are_refused(options):
    with pytest.raises(InputError):
        ContactSurface.Config(**options)


def test_it_can_be_interrupted(scenes):
    _, record = scenes("polystyrene_2")
    stages = []

    def stop(stage, share):
        stages.append(stage)
        if stage == "field":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ContactSurface(progress=stop).reconstruct(record)
    assert stages[0] == "prepare"


def test_a_million_contacts():
    rng = np.random.default_rng(8)
    normals = rng.normal(size=(1_000_000, 3))
    normals[:, 2] = np.abs(normals[:, 2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 0.04 * normals + 1e-4 * rng.normal(size=normals.shape)
    result = surface(TouchRecord(points, normals=normals, probe_radius=0.005, table=0.0))
    assert naive.closed(result.mesh.faces)
    radius = np.linalg.norm(result.mesh.vertices[result.mesh.vertices[:, 2] > 0.006], axis=1)
    assert np.abs(radius - 0.04).mean() < 2e-4


def test_it_ends_a_pitch_beyond_the_contacts_where_nobody_has_been(scenes):
    """The free path of one side alone: the other sides must not run away."""
    _, record = scenes("block")
    one_side = record.free_path[record.free_path[:, 0] < -0.05]
    assert 0 < len(one_side) < len(record.free_path)
    mesh = surface(replace(record, free_path=one_side)).mesh
    assert (mesh.vertices.max(axis=0) < record.points.max(axis=0) + 0.0101).all()
    assert (mesh.vertices.min(axis=0)[:2] > record.points.min(axis=0)[:2] - 0.0101).all()


def test_a_known_pitch_is_taken(scenes):
    _, record = scenes("block")
    assert surface(replace(record, pitch=0.012)).report["pitch"] == 0.012
    with pytest.raises(InputError, match="pitch"):
        replace(record, pitch=0.0)


def test_normals_that_were_turned_over_are_outvoted(scenes):
    solid, record = scenes("bridge")
    turned = np.random.default_rng(5).random(len(record.points)) < 0.05
    result = surface(replace(record, normals=np.where(turned[:, None], -record.normals, record.normals)))
    assert result.report["left_out"] >= 0.9 * turned.sum()
    assert surface(record).report["left_out"] == 0
    assert error(result.mesh, solid).mean < 0.2 * error(convex_hull(record.points), solid).mean


def test_noisy_normals_do_not_hollow_out_a_block(scenes):
    """Some of the walls' normals lean down by chance, on both sides: there is no underside between them."""
    solid, record = scenes("block")
    points, true = np.repeat(record.points, 8, axis=0), np.repeat(record.normals, 8, axis=0)  # as dense as a run's
    normals = true + 0.1 * np.random.default_rng(3).normal(size=true.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert (normals[np.abs(true[:, 2]) < 0.2, 2] < -0.14).sum() > 200
    found = error(surface(replace(record, points=points, normals=normals)).mesh, solid)
    assert abs(found.volume_error) < 0.01
    assert found.mean < 3e-4


@pytest.mark.parametrize("lean", [-0.6, -0.95])
def test_two_false_contacts_from_below_change_nothing(lean):
    """A touch of the stick taken for one of the sphere looks down in the middle of a wall or of the top."""
    solid = Solid.from_shapes(
        [Box(shape="box", size=(0.06, 0.05, 0.05), at=Pose(xyz=(0.0, 0.0, 0.025), rpy_deg=(0.0, 0.0, 25.0)))]
    )
    record = sample_lines(solid, 0.01)
    plain = error(surface(record).mesh, solid)
    for rows in (np.abs(record.normals[:, 2]) < 0.1, record.normals[:, 2] > 0.9):
        rows = np.flatnonzero(rows & (record.points[:, 2] > 0.015))
        chosen = np.random.default_rng(1).choice(rows, 2, replace=False)
        side = record.normals[chosen] * (1.0, 1.0, 0.0) + (0.01, 0.0, 0.0)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        normals = record.normals.copy()
        normals[chosen] = np.sqrt(1.0 - lean**2) * side + (0.0, 0.0, lean)
        found = error(surface(replace(record, normals=normals)).mesh, solid)
        assert found.mean < 1.05 * plain.mean
        assert found.hausdorff < 1.2 * plain.hausdorff


def test_a_claim_needs_neighbours_that_share_it():
    """Two that agree convince, one does not; nor do three among twenty that face alike and say otherwise."""
    side = np.array([1.0, 0.0, 0.0])

    def kept(claiming, others):
        claims = np.arange(claiming + others) < claiming
        points, normals = (
            np.linspace(0.0, 1e-3, len(claims))[:, None] * [0.0, 1.0, 0.0],
            np.tile(side, (len(claims), 1)),
        )
        return supported(claims, claims, points, normals, np.ones(len(claims)), 2e-3).tolist()

    assert kept(2, 0) == [True] * 2
    assert kept(1, 0) == [False]
    assert kept(3, 9) == [True] * 3 + [False] * 9
    assert not any(kept(3, 20))
    yes = np.ones(3, bool)
    assert not supported(yes, yes, 0.01 * np.eye(3), np.tile(side, (3, 1)), np.ones(3), 2e-3).any()  # too far apart
    assert not supported(yes, yes, np.zeros((3, 3)), np.eye(3), np.ones(3), 2e-3).any()  # facing apart
    doubted = supported(yes, yes, np.zeros((3, 3)), np.tile(side, (3, 1)), np.full(3, 0.4), 2e-3)
    assert not doubted.any()


def test_both_sides_of_a_thin_plate_stay(scenes):
    _, record = scenes("thin_plate")
    assert surface(record, step=0.002).report["left_out"] <= 0.01 * len(record.points)


def test_a_wall_thinner_than_the_usual_cell_is_not_lost():
    plate = Solid.from_shapes([Box(shape="box", size=(0.02, 0.0006, 0.014), at=Pose(xyz=(0.0, 0.0, 0.007)))])
    result = surface(sample_lines(plate, 0.005, 0.25), pitch=0.005)
    found = mesh_error(result.mesh, plate, ABOVE, samples=2000)
    assert found.watertight
    assert found.mean < 2e-4
    assert abs(found.volume_error) < 0.2
    assert 4e-4 < result.report["step"] < 7e-4


def test_an_underside_between_two_rims_is_not_a_straight_wall(scenes):
    """Below its axis a lying cylinder is touched at the rims of its end faces only."""
    solid, record = scenes("cylinder_horizontal", 0.01, 0.375)
    result = surface(record)
    found = error(result.mesh, solid)
    assert found.mean < 3.3e-4
    assert found.hausdorff < 4e-3
    low = (result.mesh.vertices[:, 2] < 0.012) & (result.mesh.vertices[:, 2] > ABOVE)
    between = low & (np.abs(result.mesh.vertices[:, 1]) < 0.015)
    assert np.mean(result.unreachable[between]) > 0.7, "nobody was there"


def test_ends_that_match_by_chance_say_nothing_of_what_lies_between():
    """Edges of one ruled face are joined by parallel chords, those of a polyhedron by chords in all directions."""

    def level(degrees):
        angle = np.deg2rad(degrees)
        return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])

    rng = np.random.default_rng(1)
    ruled = rng.uniform(20.0, 28.0, 40)
    assert _parallel(level(ruled)).all()
    assert _parallel(level(np.concatenate([ruled, ruled + 180.0]))).all(), "there and back is one direction"
    few = np.array([80.0, 120.0, 150.0])
    assert _parallel(level(np.concatenate([ruled, few]))).tolist() == [True] * 40 + [False] * 3
    assert not _parallel(level(np.concatenate([ruled, ruled[:20] + 60.0]))).any()
    assert not _parallel(level(rng.uniform(0.0, 180.0, 60))).any()
    assert not len(_parallel(np.empty((0, 3))))


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_chords_that_all_lie_in_one_place_match_by_chance(turn):
    """Seven within 0.7 mm had hollowed out a polyhedron: 0.64 mm of mesh error, 0.13 without them."""
    random = np.random.default_rng(4)
    along, aside = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    for wide, broad in ((0.0007, False), (0.02, True)):
        ends = np.linspace(-0.5 * wide, 0.5 * wide, 7)[:, None] * aside - random.uniform(0.02, 0.03, 7)[:, None] * along
        others = ends + random.uniform(0.04, 0.06, 7)[:, None] * along
        assert _broad(ends, others, 0.005) == broad
    assert not _broad(np.empty((0, 3)), np.empty((0, 3)), 0.005)


@pytest.mark.parametrize(("kind", "seeds", "most"), [("organic", (3, 4, 5), 3.3e-4), ("hull", (1, 2, 5), 3.5e-4)])
def test_a_hole_in_a_side_that_recedes_is_closed_as_the_contacts_around_it_say(kind, seeds, most):
    """The column below a contact counts as solid: guesses between that and free space stood out by some millimetres.

    Sides that went on as seen along one line, with the normals that this gave, were off by 0.38 and 0.47 mm.
    """
    off = []
    for seed in seeds:
        record = sample_lines(load_scene(f"random:{kind}:{seed}").solid(), 0.01, 0.25)
        leaning = np.flatnonzero((record.normals[:, 2] < -0.08) & (record.normals[:, 2] > -0.3))
        middle = record.points[leaning[len(leaning) // 2]]
        hole = np.linalg.norm(record.points - middle, axis=1) < 0.010
        part = replace(record, points=record.points[~hole], normals=record.normals[~hole])
        assert hole.sum() > 5
        off.append(MeshDistance(surface(part, compare=False).mesh).distance(record.points[hole]).mean())
    assert np.mean(off) < most


def field_of(touches, clusters):
    """Of the centres that the contacts alone tell."""
    sd = np.full(len(clusters.points), touches.noise)
    return HermiteField(
        HermiteData(clusters.points, clusters.normals, sd, np.full(len(sd), touches.normal_noise)), 0.02
    )


def test_nothing_is_inferred_within_a_convex_solid():
    """Chords between the lower edges of a polyhedron that leans lie inside it: they had hollowed out its mesh."""
    solid = load_scene("random:hull:900").solid()
    record = sample_lines(solid, 0.01, 0.25)
    assert (record.normals[:, 2] < -0.15).sum() > 10
    touches = prepare(record, 0.002)
    clusters = cluster(touches.centres, touches.normals, touches.confidence, 0.0033)
    below = find_undersides(touches, clusters, field_of(touches, clusters), 0.01)
    places = below.points - touches.radius * below.normals
    assert not (solid.signed_distance(places) < -2e-3).any()


def test_undersides_are_inferred_between_edges_and_nowhere_else(scenes):
    def inferred(name):
        solid, record = scenes(name, 0.01, 0.375)
        touches = prepare(record, 0.002)
        clusters = cluster(touches.centres, touches.normals, touches.confidence, 0.0033)
        below = find_undersides(touches, clusters, field_of(touches, clusters), 0.01)
        return solid, below.points - touches.radius * below.normals, below.normals, below.value_sd

    solid, places, normals, deviation = inferred("cylinder_horizontal")
    assert len(places) > 10
    assert np.abs(solid.signed_distance(places)).max() < 1.5e-3
    assert (np.abs(solid.signed_distance(places)) < 3.0 * deviation).mean() > 0.95
    assert np.einsum("ij,ij->i", solid.nearest(places).normals, normals).min() > 0.95
    solid, places, normals, _ = inferred("overhang")
    under_the_top = np.abs(places[:, :2]).max(axis=1) > 0.016  # beside the post, which nobody can touch
    assert np.abs(places[under_the_top, 2] - 0.03).max() < 1.5e-3
    assert np.median(normals[:, 2]) < -0.98
    for name in ("block", "polystyrene_1", "jaw_chuck"):
        assert len(inferred(name)[1]) == 0


def test_a_side_that_recedes_all_around_goes_on_inwards():
    """Level chords between its opposite edges had left a body that hung in the air over two small lumps."""
    record = recorded("receding", pitch=0.01)
    assert (record.normals[:, 2] < -0.25).sum() > 100, "its lower edge was touched from below"
    outwards = np.array([[np.cos(angle), np.sin(angle)] for angle in np.arange(0.0, 6.0, 0.5)])
    inside = np.array([[*(0.02 * side), z] for side in outwards for z in (0.004, 0.008, 0.012)])
    assert (load_scene("random:revolution:8704").solid().signed_distance(inside) < 0.0).all()
    assert MeshDistance(surface(record, compare=False).mesh).contains(inside[:, :2], inside[:, 2:]).all()


def test_what_was_touched_at_its_top_alone_stands_on_the_table(scenes):
    """Sides that lean in below the rim met above the table, and the planes of the rim cut off all below."""
    solid, record = scenes("random:revolution:9844", 0.01)
    assert record.points[:, 2].min() > 0.07
    mesh = surface(record, pitch=0.01).mesh
    assert mesh.vertices[:, 2].min() < 0.001
    stem = np.array([[0.0, 0.0, z] for z in np.arange(0.005, 0.085, 0.01)])
    assert MeshDistance(mesh).contains(stem[:, :2], stem[:, 2:]).all()
    assert error(mesh, solid).mean < 5e-3


@pytest.mark.parametrize("name", ["polystyrene_1", "cylinder_horizontal", "random:bumps:2"])
def test_denser_lines_make_it_no_worse(scenes, name):
    errors = []
    for pitch in (0.02, 0.01, 0.005):
        solid, record = scenes(name, pitch)
        errors.append(error(surface(record, pitch=pitch).mesh, solid).mean)
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize("name", ["block", "random:bumps:2"])
def test_three_times_the_noise_costs_no_more_than_three_times_the_error(scenes, name):
    solid, record = scenes(name)
    random = np.random.default_rng(3)
    more = np.sqrt(3.0**2 - 1.0)  # on top of the record's own
    normals = record.normals + more * NORMAL_NOISE * random.normal(size=record.normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    noisy = replace(record, points=record.points + more * NOISE * random.normal(size=normals.shape), normals=normals)
    errors = [error(surface(given, pitch=0.01).mesh, solid).mean for given in (record, noisy)]
    assert errors[1] <= 3.0 * errors[0]


def test_a_smooth_overhang_goes_on_inwards(scenes):
    """What a stick keeps the sphere from, under the widest place: an upright wall is farther off."""
    solid, record = scenes("random:organic:15")
    mesh = surface(record, pitch=0.01).mesh
    points, normals = solid.sample_surface(6000, 1)
    gap = cKDTree(record.points).query(points)[0]
    under = (normals[:, 2] < -0.3) & (gap > 0.006) & (gap < 0.012) & (points[:, 2] > ABOVE)
    assert under.sum() > 100
    assert MeshDistance(mesh).distance(points[under]).mean() < 1.9e-3


@pytest.mark.parametrize(("thickness", "off"), [(0.0012, 2e-3), (0.0021, 6e-4)])
def test_a_plate_over_which_the_sphere_hardly_rises_is_whole(thickness, off):
    """Its middle at the sphere's lowest height touches nothing, a fraction of a cell higher it lies on the plate."""
    x, y = np.meshgrid(np.arange(-0.025, 0.0251, 0.01), np.linspace(-0.02, 0.02, 81), indexing="ij")
    per_line = 1e-4 * np.random.default_rng(0).normal(size=len(x))
    points = np.stack([x, y, np.broadcast_to(thickness + per_line[:, None], x.shape)], axis=-1).reshape(-1, 3)
    free = np.array([
        [a, b, ABOVE]
        for a in np.arange(-0.065, 0.066, 0.01)
        for b in np.linspace(-0.05, 0.05, 101)
        if abs(a) > 0.0301 or abs(b) > 0.0251
    ])  # fmt: skip
    record = TouchRecord(
        points, normals=np.tile([0.0, 0.0, 1.0], (len(points), 1)), probe_radius=0.005, table=0.0, lowest=ABOVE,
        pitch=0.01, free_path=free,
    )  # fmt: skip
    mesh = surface(record, compare=False).mesh
    assert MeshDistance(mesh).distance(points).mean() < off


@pytest.mark.parametrize("rim", [0.0015, 0.0025])
def test_an_underside_ends_at_the_wall_that_was_touched_below_it(rim):
    """A lid on a box: between the lid's edges there is no hollow that leads through the box."""
    box = Box(shape="box", size=(0.05, 0.04, 0.02), at=Pose(xyz=(0.0, 0.0, 0.01)))
    size = (0.05 + 2.0 * rim, 0.04 + 2.0 * rim, 0.012)
    solid = Solid.from_shapes([box, Box(shape="box", size=size, at=Pose(xyz=(0.0, 0.0, 0.026)))])
    record = sample_lines(solid, 0.01, 0.25)
    assert (record.normals[:, 2] < -0.15).sum() > 10, "the lid's edges were touched from below"
    touches = prepare(record, 0.002)
    clusters = cluster(touches.centres, touches.normals, touches.confidence, 0.0033)
    below = find_undersides(touches, clusters, field_of(touches, clusters), 0.01)
    places = below.points - touches.radius * below.normals
    assert not (solid.signed_distance(places) < -2e-3).any()
    mesh = surface(record, pitch=0.01).mesh
    middle = np.array([[x, y, 0.014] for x in (-0.015, 0.0, 0.015) for y in (-0.01, 0.0, 0.01)])
    assert MeshDistance(mesh).contains(middle[:, :2], middle[:, 2:]).all()


def test_a_hollow_that_no_way_leads_into_is_solid():
    """Contradictory data had left one of 30 mm in a pillar. An open recess stays, and one where the sphere was."""
    grid = Grid(np.zeros(3), 1.0, (20, 12, 10))
    values = np.ones(grid.shape)
    values[2:18, 2:10, 1:8] = -1.0
    closed, entered = (slice(4, 6), slice(4, 6), slice(1, 5)), (slice(8, 10), slice(4, 6), slice(3, 5))
    recess = slice(13, 15), slice(4, 6), slice(4, 8)
    for hollow in (closed, entered, recess):
        values[hollow] = 0.5
    before = values.copy()
    contact_surface._fill_hollows(values, grid, np.array([[8.2, 4.9, 3.4]]), 2)
    assert (values[closed] < 0.0).all()
    values[closed] = before[closed]
    np.testing.assert_array_equal(values, before)


def test_one_wrong_contact_in_swept_air_leaves_no_solid_there(scenes):
    """One contact 25 mm above a block had left a ball floating there, and the mesh was called closed."""
    solid, record = scenes("block")
    along = np.arange(-0.06, 0.0601, 0.001)
    flown = [
        np.vstack([np.column_stack([np.full(len(along), x), along, np.full(len(along), 0.07)]), [[np.nan] * 3]])
        for x in np.arange(-0.08, 0.081, 0.01)
    ]
    wrong = {"points": [[0.0, 0.0, 0.08]], "normals": [[0.0, 0.0, 1.0]], "confidence": [1.0], "times": [1e4]}
    more = {
        name: np.concatenate([getattr(record, name), value])
        for name, value in wrong.items()
        if getattr(record, name) is not None
    }
    found = surface(replace(record, free_path=np.vstack([record.free_path, *flown]), **more))
    assert found.mesh.vertices[:, 2].max() < 0.052
    assert error(found.mesh, solid).mean < 1e-4


@pytest.fixture
def given_as_free(monkeypatch):
    """Of each call of `gather`: the places of the sphere, where the stick stood upright, and how many are contacts."""
    seen, gather = [], contact_surface.gather

    def watched(grid, points, normals, visited, stood, touching, radius):
        seen.append((visited, stood, touching))
        return gather(grid, points, normals, visited, stood, touching, radius)

    monkeypatch.setattr(contact_surface, "gather", watched)
    return seen


@pytest.mark.parametrize("leans", [False, True])
def test_the_places_where_the_stick_leaned_are_those_above_which_nothing_is_free(scenes, given_as_free, leans):
    _, record = scenes("block")
    leaning = record.free_path[500:700]
    surface(replace(record, leaning=leaning if leans else None), compare=False)
    [(visited, stood, _)] = given_as_free
    apart = np.array([np.linalg.norm(leaning - place, axis=1).min() for place in visited])
    assert stood.any()
    assert not leans or not stood[apart < 0.001].any()
    assert stood[apart > 0.005].all()
    assert leans or stood.all()


def test_nothing_counts_as_free_above_where_a_side_is_carried_on(scenes, given_as_free):
    """No stick has been there: below a side that was touched with a leaning stick the object is above."""
    _, record = scenes("block")
    surface(upper_part(record, 0.035), compare=False)
    [(visited, stood, touching)] = given_as_free
    places, stood = visited[:touching], stood[:touching]
    below = places[:, 2] < 0.03
    assert below.any()
    assert not stood[below].any()
    assert stood[~below].mean() > 0.9


def test_the_other_side_of_a_slot_makes_no_hole_in_a_thin_wall():
    """From across the slot a wall's inside lies before a face: it was taken to be free, and the mesh 0.46 mm off."""
    fins = [
        Box(shape="box", size=(0.004, 0.024, 0.032), at=Pose(xyz=(x, 0.0, 0.024)))
        for x in (-0.043, -0.026, -0.009, 0.008, 0.025, 0.043)
    ]
    solid = Solid.from_shapes([Box(shape="box", size=(0.09, 0.024, 0.01), at=Pose(xyz=(0.0, 0.0, 0.005))), *fins])
    assert error(surface(recorded("comb"), compare=False).mesh, solid).mean < 3e-4


def test_a_rod_beside_which_the_sphere_was_wedged_is_whole():
    """What faced it, from across the sphere, took all in front for free: the mesh ended 15 mm below the rod's top."""
    record = replace(recorded("rods", 0.01), lowest=0.0085)
    top = record.points[:, 2].max()
    assert surface(record, compare=False).mesh.vertices[:, 2].max() == pytest.approx(top, abs=5e-4)


def test_a_sphere_is_wedged_where_it_lies_on_the_plane_of_what_faces_it():
    """In a groove of 60 degrees the lowest place lies on both its planes; in one of 90 degrees they face no more."""

    def groove(half_angle):
        out = np.array([np.cos(half_angle), 0.0, np.sin(half_angle)])
        up = np.array([-out[2], 0.0, out[0]])
        left = [k * 0.002 * up for k in range(5)]
        places, normals = [*left, *(place * [-1.0, 1.0, 1.0] for place in left[1:])], [out] * 5 + [out * [-1, 1, 1]] * 4
        count = len(places)
        return wedged(Clusters(np.array(places), np.array(normals), np.ones(count), np.arange(count)), 0.01).tolist()

    assert groove(np.radians(30.0)) == [True] + [False] * 8
    assert groove(np.radians(45.0)) == [False] * 9


@pytest.mark.parametrize(("gap", "between"), [(0.0008, True), (0.0015, False)])
def test_a_normal_says_nothing_beyond_a_gap_into_which_the_sphere_just_fits(gap, between):
    """A rod before a thin wall: what its normal said of the space behind the gap made a hole in the wall."""
    wall, rod = np.array([0.0, 1.0, 0.0]), np.array([-0.69, -0.72, 0.0]) / np.hypot(0.69, 0.72)
    places = np.array([[0.0, 0.0, 0.0], [0.005, gap, 0.0]])
    found = wedged(Clusters(places, np.array([wall, rod]), np.ones(2), np.arange(2)), 0.01)
    assert found.tolist() == [False, between]


def test_a_path_right_over_a_plate_makes_no_hole_in_it():
    """Between two lines the sphere had come down beside a rod, and passed 0.08 mm above the plate."""
    xs, ys = np.arange(-0.03, 0.0301, 0.01), np.arange(-0.03, 0.0301, 0.0005)
    lines = np.array([(x, y, 0.0048) for x in xs for y in ys if abs(x - 0.01) > 1e-6 or abs(y) > 0.007])
    sides = [np.column_stack([np.full(len(ys), sign * 0.0335), ys, np.full(len(ys), 0.004)]) for sign in (-1.0, 1.0)]
    points, normals = np.vstack([lines, *sides]), np.zeros((len(lines) + 2 * len(ys), 3))
    normals[: len(lines), 2], normals[len(lines) :, 0] = 1.0, np.repeat([-1.0, 1.0], len(ys))
    over = np.array([(0.01, y, 0.0118) for y in np.arange(-0.007, 0.0071, 0.0005)])
    beside = np.array([(x, 0.003, 0.00988) for x in np.arange(0.003, 0.0101, 0.0005)])
    free = np.vstack([over, [[0.01, 0.003, 0.0118]], beside[::-1]])
    record = TouchRecord(
        points, normals=normals, free_path=free, free_gap=0.003, probe_radius=0.005, table=0.0, lowest=0.0084,
        pitch=0.01,
    )  # fmt: skip
    mesh = surface(record, compare=False).mesh
    near = np.hypot(mesh.vertices[:, 0] - 0.01, mesh.vertices[:, 1]) < 0.012
    assert mesh.vertices[near & (mesh.vertices[:, 2] > 1e-4), 2] == pytest.approx(0.0048, abs=3e-4)
