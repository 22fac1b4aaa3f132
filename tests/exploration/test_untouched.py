"""Places of a mesh without contacts: found, measured, and given a reason."""

import numpy as np
import pytest

from lwrprobe.contracts import Area, TriangleMesh
from lwrprobe.evaluation.summary import area_by_reason
from lwrprobe.exploration.recording.untouched import (
    FACES_DOWN,
    MEETS,
    NOT_FOLLOWED,
    OUTSIDE,
    SMALLEST,
    UNKNOWN,
    untouched,
)

RADIUS, PITCH = 0.005, 0.010
AREA = Area(np.array([-0.06, -0.06, 0.006]), np.array([0.06, 0.06, 0.09]))
HALF, LOW, HIGH = 0.02, 0.01, 0.06


def block():
    """A box from LOW to HIGH that hangs in the air, as a mesh."""
    x, y, z = (np.array(v) for v in ([-HALF, HALF], [-HALF, HALF], [LOW, HIGH]))
    corners = np.array([[a, b, c] for c in z for b in y for a in x])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return TriangleMesh(corners, np.array([t for q in quads for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]))


def contacts(*sides):
    """Contacts 3 mm apart on sides of the block: (axis, sign)."""
    points, normals = [], []
    for axis, sign in sides:
        for u in np.arange(-HALF, HALF + 1e-9, 0.003):
            for v in np.arange(LOW, HIGH + 1e-9, 0.003) if axis < 2 else np.arange(-HALF, HALF + 1e-9, 0.003):
                point = [sign * HALF, u, v] if axis == 0 else [u, sign * HALF, v]
                points.append(point if axis < 2 else [u, v, HIGH if sign > 0 else LOW])
                normals.append(sign * np.eye(3)[axis])
    return np.array(points), np.array(normals)


SIDES = [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)]


def found(*sides, area=AREA):
    return untouched(block(), *contacts(*sides), PITCH, RADIUS, area)


def test_nothing_is_left_where_all_sides_were_touched():
    assert found(*SIDES) == []


@pytest.mark.parametrize("without", [0, 3, 4])
def test_a_side_without_contacts_is_one_place_with_its_area(without):
    (place,) = found(*(side for k, side in enumerate(SIDES) if k != without))
    whole = 4.0 * HALF * HALF if without == 4 else 2.0 * HALF * (HIGH - LOW)
    assert place.area == pytest.approx(whole, rel=0.1)
    assert place.reason == NOT_FOLLOWED
    row = place.as_dict()
    assert row["area_mm2"] == pytest.approx(1e6 * place.area, abs=0.06)
    assert len(row["place"]) == 2


@pytest.mark.parametrize("reason", [MEETS, UNKNOWN])
def test_what_hinders_the_probe_at_a_place_is_the_reason(reason):
    sides = [side for side in SIDES if side != (1, -1)]

    def hindrance(centre, facing):
        assert facing == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
        assert centre[1] == pytest.approx(-HALF - RADIUS)
        return reason

    (place,) = untouched(block(), *contacts(*sides), PITCH, RADIUS, AREA, hindrance)
    assert place.reason == reason


def test_a_place_with_two_reasons_is_told_with_the_area_of_each():
    sides = [side for side in SIDES if side != (1, -1)]
    low = 0.025

    def hindrance(centre, facing):
        return UNKNOWN if centre[2] < low else NOT_FOLLOWED

    found = [place.as_dict() for place in untouched(block(), *contacts(*sides), PITCH, RADIUS, AREA, hindrance)]
    areas = dict(area_by_reason(found))
    assert areas[UNKNOWN] == pytest.approx(2e6 * HALF * (low - LOW), rel=0.15)
    assert areas[NOT_FOLLOWED] == pytest.approx(2e6 * HALF * (HIGH - low), rel=0.15)
    assert list(areas) == [NOT_FOLLOWED, UNKNOWN], "largest first"


def test_what_faces_down_and_what_lies_outside_the_area_is_said():
    (below,) = found(*SIDES[:5])
    assert below.reason == OUTSIDE, "the sphere would have to go below the area"
    deep = Area(np.array([-0.06, -0.06, 0.001]), AREA.upper)
    (under,) = found(*SIDES[:5], area=deep)
    assert under.reason == FACES_DOWN


def test_the_largest_place_comes_first_and_what_is_tiny_is_left_out():
    places = found(*SIDES[2:])
    assert [place.area for place in places] == sorted((place.area for place in places), reverse=True)
    assert all(place.area >= SMALLEST for place in places)
    assert len(places) == 2


def test_a_mesh_below_all_that_can_be_touched_has_no_such_places():
    high = Area(np.array([-0.06, -0.06, 0.08]), AREA.upper)
    assert untouched(block(), np.empty((0, 3)), np.empty((0, 3)), PITCH, RADIUS, high) == []
