"""Below the lowest contacts on a wall, where nobody was."""

from dataclasses import replace

import numpy as np
import pytest
from partly_touched import upper_part

from lwrprobe.bench.sampled_lines import RADIUS, sample_lines
from lwrprobe.contracts import TouchRecord
from lwrprobe.evaluation import mesh_error
from lwrprobe.reconstruction.clusters import cluster
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.lower_sides import find_lower_sides, moved_to_field
from lwrprobe.reconstruction.touches import prepare
from lwrprobe.scene.shape import Box, Cylinder, Sphere
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

PITCH, DEPTH = 0.01, 0.045


def tall(turned_deg=0.0):
    at = Pose(xyz=(0.0, 0.0, 0.04), rpy_deg=(0.0, 0.0, turned_deg))
    return Solid.from_shapes([Box(shape="box", size=(0.06, 0.04, 0.08), at=at)])


def found(record):
    touches = prepare(record, 0.002)
    clusters = cluster(touches.centres, touches.normals, touches.confidence, 0.0033)
    walls, common = find_lower_sides(touches, clusters, PITCH)
    assert len(common) == len(walls.points)
    return walls, common


def test_a_wall_goes_straight_down_from_where_it_was_touched_last():
    solid = tall(35.0)
    record = upper_part(sample_lines(solid, PITCH, 0.25), DEPTH)
    result = ContactSurface(ContactSurface.Config(pitch=PITCH)).reconstruct(record)
    error = mesh_error(result.mesh, solid, 0.006, samples=4000)
    assert error.watertight
    assert error.mean < 3e-4
    low = (result.mesh.vertices[:, 2] < 0.03) & (result.mesh.vertices[:, 2] > 0.008)
    assert result.unreachable[low].mean() > 0.9, "nobody was there"


def test_the_places_lie_below_the_contacts_with_a_deviation_that_grows():
    solid = tall()
    walls, common = found(upper_part(sample_lines(solid, PITCH, 0.25), DEPTH))
    assert walls.points[:, 2].min() < 0.012
    assert walls.points[:, 2].max() < DEPTH + 0.001
    assert np.abs(solid.signed_distance(walls.points) - RADIUS).max() < 5e-4
    order = np.argsort(walls.points[:, 2])
    assert common[order[0]] > 3.0 * common[order[-1]]
    assert walls.value_sd.max() < 0.3 * common.max(), "what is wrong of a wall is so everywhere"


def test_a_side_that_bends_is_moved_and_turned_to_where_contacts_beside_it_have_it():
    """The more, the less certain it is beside them; an upright wall stays."""
    angles = np.deg2rad(np.arange(0.0, 360.0, 10.0))
    rings = [
        np.column_stack([np.cos(up) * np.cos(angles), np.cos(up) * np.sin(angles), np.full(len(angles), np.sin(up))])
        for up in np.deg2rad([0.0, 10.0, 20.0])
    ]
    normals = np.vstack(rings)
    sd = np.full(len(normals), 3e-5)
    touched = HermiteField(HermiteData(0.04 * normals, normals, sd, np.full(len(normals), 0.03)), 0.02)
    down = np.deg2rad([-5.0, -10.0, -20.0])
    facing = np.column_stack([np.cos(down), np.zeros(3), np.sin(down)])
    off = 2e-3 * facing
    sure, unsure = np.full(3, 1e-5), np.array([0.5e-3, 1e-3, 3e-3])

    def beside(value_sd, common):
        lower = HermiteData(0.04 * facing + off, facing, value_sd, np.full(3, 0.1))
        moved = moved_to_field(lower, common, touched)
        assert (np.einsum("ij,ij->i", moved.normals, facing) > 0.97).all()
        return np.einsum("ij,ij->i", moved.points, facing) - 0.04

    left = beside(unsure, np.zeros(3))
    assert (np.diff(left) > 0.0).all()
    assert 0.0 < left[0] < 0.7e-3
    assert left[2] < 1.9e-3
    assert np.allclose(beside(sure, np.zeros(3)), 2e-3, atol=5e-5)
    assert np.allclose(beside(unsure, np.full(3, 1e-3)), 2e-3, atol=1e-12)
    tilted = facing @ np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    for value_sd, least in ((sure, 0.799), (unsure, 0.95)):
        lower = HermiteData(0.04 * facing, tilted, value_sd, np.full(3, 0.1))
        turned = moved_to_field(lower, np.zeros(3), touched).normals
        alike = np.einsum("ij,ij->i", turned, facing)
        assert least < alike.min()
        assert alike.max() < (0.81 if value_sd is sure else 1.0 + 1e-9)
        assert np.allclose(np.linalg.norm(turned, axis=1), 1.0)


def test_between_lines_that_went_lower_a_side_is_not_carried_on():
    record = upper_part(sample_lines(tall(), PITCH, 0.25), 0.02)
    short = (np.abs(record.points[:, 0]) < 0.004) & (record.points[:, 2] < 0.05)
    record = replace(record, points=record.points[~short], normals=record.normals[~short])
    walls, _ = found(record)
    under = np.abs(walls.points[:, 0]) < 0.004
    assert not (under & (walls.points[:, 2] > 0.022)).any()
    for x in (-0.01, 0.01):
        assert (np.abs(walls.points[:, 0] - x) < 0.004).any(), "below the others it goes on"


@pytest.mark.parametrize(("off_foot", "stands"), [(0.012, True), (0.018, False)])
def test_a_wall_that_ends_just_above_a_floor_nearby_stands_on_it(off_foot, stands):
    """Neither the wall's foot nor the floor within a line distance of it was touched."""
    floor = Box(shape="box", size=(0.16, 0.16, 0.03), at=Pose(xyz=(0.0, 0.0, 0.015)))
    tower = Box(shape="box", size=(0.06, 0.04, 0.08), at=Pose(xyz=(0.0, 0.0, 0.04)))
    record = sample_lines(Solid.from_shapes([floor, tower]), PITCH, 0.25)
    x, y, z = record.points.T
    beside = np.maximum(np.abs(x) - 0.03, np.abs(y) - 0.02) < PITCH
    kept = ~beside | (z > 0.03 + off_foot)
    walls, _ = found(replace(record, points=record.points[kept], normals=record.normals[kept]))
    below = walls.points[np.maximum(np.abs(walls.points[:, 0]) - 0.03, np.abs(walls.points[:, 1]) - 0.02) < PITCH]
    assert (below[:, 2] < 0.03).any() != stands


def test_nothing_goes_down_through_a_floor():
    floor = Box(shape="box", size=(0.16, 0.16, 0.03), at=Pose(xyz=(0.0, 0.0, 0.015)))
    tower = Box(shape="box", size=(0.06, 0.04, 0.08), at=Pose(xyz=(0.0, 0.0, 0.04)))
    walls, _ = found(sample_lines(Solid.from_shapes([floor, tower]), PITCH, 0.25))
    assert not (np.abs(walls.points[:, :2]).max(axis=1) < 0.06).any()


def test_nothing_goes_down_where_the_sphere_passed():
    record = upper_part(sample_lines(tall(), PITCH, 0.25), DEPTH)
    below = found(record)[0].points[:, 2].min()
    x = np.linspace(-0.05, 0.05, 101)

    def lowest_where_passed(off):
        passes = [np.column_stack([x, np.full(101, y), np.full(101, 0.02)]) for y in (-off, off)]
        walls, _ = found(replace(record, free_path=np.vstack([record.free_path, *passes])))
        beside = np.abs(walls.points[:, 1]) > 0.024
        assert beside.any()
        return walls.points[beside, 2].min()

    assert below < 0.012
    assert lowest_where_passed(0.024) > 0.02
    assert lowest_where_passed(0.028) == pytest.approx(below), "beside the wall"


def mushroom(record, stem=0.02):
    """A disc from 40 to 60 mm above the table on a stem, touched as low as its own edge; what its mesh is off, and how
    far out it reaches below."""
    disc = Cylinder(shape="cylinder", radius=0.04, length=0.02, at=Pose(xyz=(0.0, 0.0, 0.05)))
    foot = Cylinder(shape="cylinder", radius=stem, length=0.045, at=Pose(xyz=(0.0, 0.0, 0.0225)))
    solid = Solid.from_shapes([disc, foot])
    given = upper_part(sample_lines(solid, PITCH, 0.25), 0.042)
    result = ContactSurface(ContactSurface.Config(pitch=PITCH, compare=False)).reconstruct(record(given))
    low = result.mesh.vertices[(result.mesh.vertices[:, 2] < 0.03) & (result.mesh.vertices[:, 2] > 0.001)]
    return mesh_error(result.mesh, solid, 0.006, samples=4000).mean, np.hypot(low[:, 0], low[:, 1])


def test_where_the_sphere_passed_under_all_walls_a_foot_stands_in_the_middle():
    turn = np.deg2rad(np.arange(0.0, 360.0, 1.0))
    under = np.column_stack([0.042 * np.cos(turn), 0.042 * np.sin(turn), np.full(len(turn), 0.032)])
    straight, outside = mushroom(lambda given: given)
    assert np.median(outside) > 0.035, "nothing shows that the walls end"
    cut, foot = mushroom(lambda given: replace(given, free_path=np.vstack([given.free_path, under])))
    assert len(foot) > 0, "it stands on the table"
    assert np.median(foot) < 0.03
    assert cut < 0.6 * straight


def test_where_some_walls_go_down_those_that_end_tell_of_no_foot():
    turn = np.deg2rad(np.arange(0.0, 180.0, 1.0))
    under = np.column_stack([0.042 * np.cos(turn), 0.042 * np.sin(turn), np.full(len(turn), 0.032)])
    _, foot = mushroom(lambda given: replace(given, free_path=np.vstack([given.free_path, under])))
    assert np.quantile(foot, 0.9) > 0.035


def test_a_side_that_recedes_goes_on_inwards_and_not_straight_down():
    ball = Solid.from_shapes([Sphere(shape="sphere", radius=0.04, at=Pose(xyz=(0.0, 0.0, 0.042)))])
    walls, _ = found(upper_part(sample_lines(ball, PITCH, 0.25), 0.03))
    low = walls.points[walls.points[:, 2] < 0.02]
    assert len(low) > 10
    straight = low.copy()
    straight[:, :2] *= (0.04 + RADIUS) / np.linalg.norm(low[:, :2], axis=1, keepdims=True)
    off, straight_off = (np.abs(ball.signed_distance(rows) - RADIUS).mean() for rows in (low, straight))
    assert off < 0.3 * straight_off
    assert (walls.normals[walls.points[:, 2] < 0.02, 2] < -0.3).all()


def test_a_wrong_normal_at_the_lower_end_of_a_wall_leaves_no_part_of_it_without_places():
    """Such an end had stood for 30 mm of a wall and was refused: the mesh was off by 7 mm there."""
    solid = tall()
    record = upper_part(sample_lines(solid, PITCH, 0.25), DEPTH)
    x = np.arange(-0.025, 0.0251, 0.0005)
    level = np.column_stack([x, np.full(len(x), 0.02), np.full(len(x), DEPTH)])  # along the wall at its lower end
    lowest, facing = slice(40, 60), [0.0, np.cos(0.6), -np.sin(0.6)]
    level[lowest, 2] -= 1e-4
    record = replace(
        record,
        points=np.vstack([record.points, level, level[lowest] + np.array([0.0, 0.0, 0.0012])]),
        normals=np.vstack([record.normals, np.tile([0.0, 1.0, 0.0], (len(x), 1)), np.tile(facing, (20, 1))]),
        confidence=None,
    )
    places = found(record)[0].points
    on_wall = places[(np.abs(places[:, 1] - 0.02 - RADIUS) < 1e-3) & (places[:, 2] < 0.03), 0]
    assert on_wall.min() < -0.02
    assert on_wall.max() > 0.02
    assert np.diff(np.sort(on_wall)).max() < 1.5 * PITCH


def test_rows_below_a_wall_are_no_farther_apart_than_its_lines():
    """Lines that end at heights a few millimetres apart, and contacts along the wall at its lower end beside some."""
    pitch = 0.015
    lines = {-0.047: 0.055, -0.032: 0.0599, -0.02: 0.055, 0.0: 0.0583, 0.013: 0.0582, 0.026: 0.055, 0.042: 0.0578}
    rows = [[x, 0.0, z] for x, end in lines.items() for z in np.arange(end, 0.1, 0.0025)]
    rows += [[x, 0.0, 0.0551] for x in (-0.03, -0.025, 0.015, 0.02, 0.047, 0.0515)]
    front = np.array(rows)
    back, facing = front - [0.0, 0.05, 0.0], np.tile([0.0, 1.0, 0.0], (len(front), 1))
    record = TouchRecord(np.vstack([front, back]), np.vstack([facing, -facing]), pitch=pitch, probe_radius=RADIUS)
    record = replace(record, table=0.0, lowest=0.01)
    touches = prepare(record, 0.002)
    clusters = cluster(touches.centres, touches.normals, touches.confidence, 0.0033)
    places = find_lower_sides(touches, clusters, pitch)[0].points
    rows = np.unique(np.round(places[places[:, 1] > 0.0, 0], 4))
    assert rows[0] < -0.04
    assert rows[-1] > 0.04
    assert np.diff(rows).max() < 1.4 * pitch


def below_outline(points, normals, walls):
    """Places below contacts of strokes that lie in no regular lines; with one on the top: they have to span a solid."""
    points, normals = np.vstack([points, [0.0, 0.0, 0.09]]), np.vstack([normals, [0.0, 0.0, 1.0]])
    record = TouchRecord(points, normals, pitch=0.015, probe_radius=RADIUS, table=0.0, lowest=0.008)
    touches = prepare(record, 0.002)
    clusters = cluster(touches.centres, touches.normals, touches.confidence, 0.0033)
    return find_lower_sides(touches, clusters, 0.015, walls)[0]


def outline(half, height, lean=0.0):
    """Contacts along two walls at x = +-half, at one height, whose normals have this share along z."""
    ys = np.arange(-0.04, 0.0401, 0.001)
    normal = np.array([np.sqrt(1.0 - lean**2), 0.0, lean])
    points = np.array([(side * half, y, height) for side in (1.0, -1.0) for y in ys])
    return points, np.vstack([np.tile(normal * [side, 1.0, 1.0], (len(ys), 1)) for side in (1.0, -1.0)])


NO_WALLS = np.empty((0, 3)), np.empty((0, 3))


def test_an_outline_goes_straight_down_all_along_a_wall_that_a_stroke_has_climbed():
    points, normals = outline(0.03, 0.05)
    climbed = np.array([(0.03, 0.03, z) for z in np.arange(0.05, 0.08, 0.001)])
    points, normals = np.vstack([points, climbed]), np.vstack([normals, np.tile([1.0, 0.0, 0.0], (len(climbed), 1))])
    assert not len(below_outline(points[:-30], normals[:-30], NO_WALLS).points), "an outline shows no bend"
    found = below_outline(points, normals, NO_WALLS)
    assert np.allclose(found.points[:, 0], 0.03 + RADIUS, atol=1e-4), "nothing is known of the opposite wall"
    assert found.points[:, 1].min() < -0.035
    assert found.points[:, 2].min() < 0.013


def test_an_outline_goes_straight_down_along_a_wall_that_is_known_to_be_upright():
    place, normal = np.array([[-0.03 - RADIUS, 0.02, 0.07]]), np.array([[-1.0, 0.0, 0.0]])
    found = below_outline(*outline(0.03, 0.05), (place, normal))
    assert np.allclose(found.points[:, 0], -0.03 - RADIUS, atol=1e-4)
    assert found.points[:, 1].min() < -0.035
    moved = below_outline(*outline(0.03, 0.05), (place - [0.002, 0.0, 0.0], normal))
    assert not len(moved.points), "2 mm off, another wall"
    assert not len(below_outline(*outline(0.03, 0.05, lean=0.1), (place, normal)).points), "a side that leans"
