import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe.exploration.recording.bridged import bridged
from lwrprobe.exploration.recording.open_border import open_borders

RADIUS = 0.005


def fan(rim, begin, end, x, count=25):
    """Contacts while the sphere pivots about a rim along x, the normal turning from one angle to another from +z."""
    angles = np.radians(np.linspace(begin, end, count))
    normals = np.column_stack([np.zeros(count), np.sin(angles), np.cos(angles)])
    return np.tile([x, *rim], (count, 1)), normals


def flat(start, end, normal, x, count=25):
    share = np.linspace(0.0, 1.0, count)[:, None]
    points = np.column_stack([np.full(count, x), np.array(start) + share * (np.array(end) - np.array(start))])
    return points, np.tile([0.0, *normal], (count, 1))


def joined(*pieces):
    points, normals = (np.concatenate(part) for part in zip(*pieces))
    return points, normals, 0.008 * np.arange(len(points))


def over_slot(x):
    """Along y over a slot of 8 mm in a top at z = 0."""
    angle = np.degrees(np.arcsin(0.004 / RADIUS))
    return (
        flat((-0.02, 0.0), (-0.004, 0.0), (0.0, 1.0), x), fan((-0.004, 0.0), 0.0, angle, x),
        fan((0.004, 0.0), -angle, 0.0, x), flat((0.004, 0.0), (0.02, 0.0), (0.0, 1.0), x),
    )  # fmt: skip


def test_a_slot_is_one_gap_of_its_width_over_all_lines():
    zones = bridged(*joined(*over_slot(0.0), *over_slot(0.01), *over_slot(0.02)), RADIUS, 0.010)
    assert [zone.kind for zone in zones] == ["gap"]
    assert zones[0].width == pytest.approx(0.008, abs=1e-9)
    assert zones[0].leaps == 3
    assert (zones[0].upper - zones[0].lower) == pytest.approx([0.02, 0.0, 0.0], abs=1e-9)


def test_two_slots_apart_are_two_zones():
    assert len(bridged(*joined(*over_slot(0.0), *over_slot(0.05)), RADIUS, 0.010)) == 2


def test_a_groove_between_walls_is_an_inner_edge():
    s = np.sqrt(0.5)
    into = flat((-0.02, 0.02), (-0.00354, 0.00354), (s, s), 0.0)
    out = flat((0.00354, 0.00354), (0.02, 0.02), (-s, s), 0.0)
    zones = bridged(*joined(into, out), RADIUS, 0.010)
    assert [zone.kind for zone in zones] == ["inner edge"]
    assert zones[0].width == pytest.approx(0.00708, abs=1e-5)


def test_an_outer_edge_is_none_even_where_the_contact_leaps_over_it():
    side = flat((-0.005, -0.03), (-0.005, 0.0), (-1.0, 0.0), 0.0)
    top = flat((0.001, 0.005), (0.03, 0.005), (0.0, 1.0), 0.0)
    assert bridged(*joined(side, top), RADIUS, 0.010) == []


def test_a_hollow_that_the_sphere_can_follow_is_none():
    angles = np.radians(np.linspace(-60.0, 60.0, 30))
    normals = np.column_stack([np.zeros(30), -np.sin(angles), np.cos(angles)])
    assert bridged(*joined((-0.024 * normals, normals)), RADIUS, 0.010) == []


def test_nothing_is_bridged_without_contacts():
    assert bridged(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), RADIUS, 0.010) == []


AREA = Area(np.array([-0.02, -0.02, 0.005]), np.array([0.02, 0.02, 0.06]))


def test_a_top_that_runs_out_of_the_area_is_open_there():
    points = np.column_stack([np.zeros(500), np.linspace(-0.01, 0.02, 500), np.full(500, 0.03)])
    sides = open_borders(points, np.tile([0.0, 0.0, 1.0], (500, 1)), RADIUS, AREA)
    assert [side.side for side in sides] == ["+y"]
    assert sides[0].lower[1] >= 0.0195 - 1e-9


def test_a_face_that_looks_out_of_the_area_closes_it():
    points = np.column_stack([np.zeros(50), np.full(50, 0.015), np.linspace(0.01, 0.04, 50)])
    assert open_borders(points, np.tile([0.0, 1.0, 0.0], (50, 1)), RADIUS, AREA) == []


def test_a_top_that_runs_on_where_no_line_goes_is_open_on_that_side():
    points = np.column_stack([np.full(50, 0.016), np.linspace(-0.01, 0.01, 50), np.full(50, 0.03)])
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    assert [side.side for side in open_borders(points, up, RADIUS, AREA)] == ["+x"]
    end = np.array([[0.0105, 0.0, 0.02]])
    closed = np.concatenate([points, end]), np.concatenate([up, [[1.0, 0.0, 0.0]]])
    assert open_borders(*closed, RADIUS, AREA) == [], "its end was touched"
    assert open_borders(points - [0.002, 0.0, 0.0], up, RADIUS, AREA) == []
