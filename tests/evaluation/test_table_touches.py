"""Contacts of a table that is not where it was said to be, among those of the object on it."""

import json

import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe.evaluation.table_touches import TablePlane, find_table

AREA = Area(np.array([-0.08, -0.06, 0.006]), np.array([0.08, 0.06, 0.06]))
RADIUS = 0.005
LEVEL = TablePlane(np.array([0.0, 0.0, 1.0]), 0.0)


def plane(tilt_deg, height, xs, ys, noise=5e-5, seed=1):
    """Contacts on a plane that leans about x, with its normals half a degree off."""
    random = np.random.default_rng(seed)
    x, y = (v.ravel() for v in np.meshgrid(xs, ys))
    angle = np.radians(tilt_deg)
    normal = np.array([0.0, -np.sin(angle), np.cos(angle)])
    points = np.column_stack([x, y, height + np.tan(angle) * y]) + noise * random.normal(size=(len(x), 3))
    normals = normal + 0.008 * random.normal(size=(len(x), 3))
    return points, normals / np.linalg.norm(normals, axis=1)[:, None], normal


@pytest.mark.parametrize("tilt", [0.0, 2.0, -5.0])
@pytest.mark.parametrize("lines", [[0.0], np.linspace(-0.08, 0.08, 9)])
def test_a_table_that_leans_is_found_and_its_contacts_alone(tilt, lines):
    table, up, normal = plane(tilt, 0.003, lines, np.linspace(0.03, 0.06, 61))
    top, over, _ = plane(tilt, 0.05, lines, np.linspace(-0.025, 0.025, 101))
    points, normals = np.concatenate([table, top]), np.concatenate([up, over])
    found = find_table(points, normals, AREA, RADIUS, LEVEL)
    assert found is not None
    assert np.degrees(np.arccos(found.normal @ normal)) < 0.4
    touched = found.touched(points, normals)
    assert touched[: len(table)].mean() > 0.99
    assert not touched[len(table) :].any()
    stored = json.loads(json.dumps(found.as_dict(int(touched.sum()))))
    np.testing.assert_array_equal(TablePlane.of(stored).touched(points, normals), touched)


def test_contacts_in_the_tables_plane_are_its_also_where_their_normals_are_off_and_those_of_a_foot_are_not():
    """A touch begins with the normal of the friction. A few such contacts left had made islands beside the object."""
    points, normals, _ = plane(0.0, 0.003, np.linspace(-0.08, 0.08, 9), np.linspace(-0.06, 0.06, 61))
    found = find_table(points, normals, AREA, RADIUS, LEVEL)
    assert found is not None
    foot = ((24.0, 0.0036, False), (60.0, 0.0052, False))
    for angle, height, table in ((6.0, 0.003, True), (20.0, 0.0032, True), *foot):
        turned = np.array([[np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))]])
        assert found.touched(np.array([[0.02, 0.03, height]]), turned).item() == table


@pytest.mark.parametrize("tilt", [15.0, 25.0])
def test_a_table_that_is_stated_to_lean_is_found_where_it_is(tilt):
    points, normals, normal = plane(tilt, 0.003, np.linspace(-0.08, 0.08, 9), np.linspace(-0.06, 0.06, 61))
    found = find_table(points, normals, AREA, RADIUS, TablePlane(normal, 0.0))
    assert found is not None
    assert found.touched(points, normals).mean() > 0.99
    assert find_table(points, normals, AREA, RADIUS, LEVEL) is None, "far from a level one"


def test_a_low_flat_object_is_no_table():
    points, normals, _ = plane(0.0, 0.004, np.linspace(-0.02, 0.02, 5), np.linspace(-0.02, 0.02, 41))
    assert find_table(points, normals, AREA, RADIUS, LEVEL) is None


def test_a_plate_that_goes_on_beyond_the_area_is_no_table():
    """Its upper side, 8 mm above the table, had been left out of the mesh as the table's."""
    points, normals, _ = plane(0.0, 0.008, np.linspace(-0.03, 0.08, 12), np.linspace(-0.04, 0.04, 81))
    assert find_table(points, normals, AREA, RADIUS, LEVEL) is None
    assert find_table(points, normals, AREA, RADIUS, TablePlane(LEVEL.normal, 0.006)) is not None


def test_a_few_contacts_or_a_plane_high_up_are_no_table():
    points, normals, _ = plane(0.0, 0.05, [0.0], np.linspace(-0.06, 0.06, 121))
    assert find_table(points, normals, AREA, RADIUS, LEVEL) is None
    assert find_table(points[:5], normals[:5], AREA, RADIUS, TablePlane(LEVEL.normal, 0.05)) is None
    assert find_table(np.empty((0, 3)), np.empty((0, 3)), AREA, RADIUS, LEVEL) is None
