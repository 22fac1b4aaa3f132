"""Prisms: what few strokes tell of an object with one cross-section, and what shows that it is none."""

import numpy as np
import pytest

from lwrprobe.contracts import TouchRecord
from lwrprobe.reconstruction import contact_surface
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.hermite_field import HermiteData
from lwrprobe.reconstruction.prisms import find_prisms
from lwrprobe.reconstruction.rulings import fine_clusters
from lwrprobe.reconstruction.touches import prepare

RADIUS = 0.005
HALF = np.array([0.03, 0.02])
"""m, half the sides of the boxes that are touched."""
AWAY = ((0.2, 0.2, 0.2), (0.2, 0.2, 0.21))
"""A path that shows nothing."""


def record(*contacts, path=AWAY):
    points, normals = (np.vstack(rows) for rows in zip(*contacts))
    return TouchRecord(points, normals=normals, free_path=np.asarray(path, float), probe_radius=RADIUS, table=0.0)


def prisms(*contacts, path=AWAY):
    touches = prepare(record(*contacts, path=path), 0.001)
    return find_prisms(touches, fine_clusters(touches))


def outline(height, half=HALF):
    """Contacts around an upright box, with the sphere rolling over its edges."""
    sides, turns = [], np.linspace(0.0, np.pi / 2, 20)
    for turn in range(4):
        c, s = np.round([np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)])
        a, b = half if turn % 2 == 0 else half[::-1]
        along = np.arange(-b, b, 0.001)
        rows = [(a, y, 1.0, 0.0) for y in along] + [(a, b, np.cos(t), np.sin(t)) for t in turns]
        sides += [(c * x - s * y, s * x + c * y, c * n - s * m, s * n + c * m) for x, y, n, m in rows]
    flat = np.array(sides)
    return (
        np.column_stack([flat[:, :2], np.full(len(flat), height)]),
        np.column_stack([flat[:, 2:], np.zeros(len(flat))]),
    )


def line(begin, end, normal):
    """Contacts every millimetre on a straight line."""
    begin, end = np.asarray(begin, float), np.asarray(end, float)
    share = np.linspace(0.0, 1.0, int(1e3 * np.linalg.norm(end - begin)) + 1)[:, None]
    return begin + share * (end - begin), np.tile(np.asarray(normal, float), (len(share), 1))


def over_the_top(height=0.05):
    return line((-0.03, 0.0, height), (0.03, 0.0, height), (0.0, 0.0, 1.0))


def down_one_side(low=0.008, high=0.045):
    return line((0.03, 0.0, high), (0.03, 0.0, low), (1.0, 0.0, 0.0))


FEW = outline(0.044), over_the_top(), down_one_side()


def beside_box(places):
    """m, distance of places from the sides of the box."""
    return np.linalg.norm(np.maximum(np.abs(places[:, :2]) - HALF, 0.0), axis=1)


def turned(contacts, angle):
    """The contacts, turned about y."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    middle = np.array([0.0, 0.0, 0.05])
    return (contacts[0] - middle) @ turn.T + middle, contacts[1] @ turn.T


def test_an_outline_and_one_line_down_tell_all_sides_of_an_upright_box():
    found = prisms(*FEW)
    low = found.points[:, 2] < 0.03
    assert np.count_nonzero(low) > 40
    assert np.allclose(beside_box(found.points[low]), RADIUS, atol=1e-4)
    for normal in ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        assert np.any(low & (found.normals @ normal > 0.999))
    assert found.points[:, 2].min() > 0.008, "what is below the lowest contact is not told"


def test_far_from_the_contact_a_place_is_less_certain():
    found = prisms(*FEW)
    side = found.normals @ (-1.0, 0.0, 0.0) > 0.999
    depth = 0.044 - found.points[side, 2]
    assert np.corrcoef(depth, found.value_sd[side])[0, 1] > 0.99


def test_a_cylinder_that_lies():
    angles = np.linspace(0.0, np.pi, 90)
    normals = np.column_stack([np.cos(angles), np.zeros(len(angles)), np.sin(angles)])
    middle = np.array([0.0, 0.0, 0.03])
    arc = (middle + 0.025 * normals, normals)
    top = line((0.0, -0.04, 0.055), (0.0, 0.04, 0.055), (0.0, 0.0, 1.0))
    found = prisms(arc, top)
    assert len(found.points) > 50
    assert np.allclose(np.linalg.norm((found.points - middle)[:, [0, 2]], axis=1), 0.025 + RADIUS, atol=3e-4)
    assert np.abs(found.points[:, 1]).max() > 0.03


def test_a_step_is_no_prism():
    ledge = line((-0.045, 0.0, 0.05), (-0.03, 0.0, 0.05), (0.0, 0.0, 1.0))
    more = line((0.03, -0.03, 0.05), (0.03, 0.03, 0.05), (0.0, 0.0, 1.0))
    upper = outline(0.09), over_the_top(0.1)
    lower = outline(0.03, HALF + 0.015)
    assert not len(prisms(*upper, lower, ledge, more).points)


@pytest.mark.parametrize("lean", [0.1, 0.3])
def test_a_cone_is_no_prism(lean):
    angles = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
    normals = (around + np.array([0.0, 0.0, lean])) / np.hypot(1.0, lean)
    upper, lower = ((0.03 + (0.044 - z) * lean) * around + [0.0, 0.0, z] for z in (0.044, 0.01))
    assert not len(prisms((upper, normals), (lower, normals), over_the_top()).points)


def test_a_ball_is_no_prism():
    angles = np.linspace(0.1, np.pi / 2, 60)
    normals = np.array(
        [(np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)) for a in angles for b in np.arange(0, 6.28, 0.7)]
    )
    assert not len(prisms((0.04 * normals + [0.0, 0.0, 0.05], normals)).points)


def test_one_plane_has_no_axis():
    top = [line((-0.04, y, 0.05), (0.04, y, 0.05), (0.0, 0.0, 1.0)) for y in (-0.02, 0.02)]
    assert not len(prisms(*top, line((0.1, 0.1, 0.0), (0.1, 0.1, 0.001), (1.0, 0.0, 0.0))).points)


@pytest.mark.parametrize("degrees", [10.0, 30.0])
def test_an_axis_that_neither_stands_nor_lies_is_not_believed(degrees):
    tilted = [turned(contacts, np.radians(degrees)) for contacts in FEW]
    found = prisms(*tilted)
    level = np.abs(found.normals[:, 1]) < 0.01  # the axis along y stays level
    assert level.all()


def test_where_the_sphere_passed_below_a_side_there_is_none():
    """A hole in one side takes the places there away; a side that is not there at all shows that it is no prism."""
    hole = [(0.0, -0.06, 0.02), (0.0, -0.019, 0.02)]
    without = prisms(*FEW).points
    points = prisms(*FEW, path=hole).points
    assert 0 < len(without) - len(points) < 5
    apart = np.linalg.norm(points - [0.0, -0.025, 0.02], axis=1)
    assert apart.min() > np.linalg.norm(without - [0.0, -0.025, 0.02], axis=1).min()
    inside = [(x, -0.02, z) for z in (0.012, 0.02, 0.028) for x in (-0.028, 0.028)]
    found = prisms(*FEW, path=[(0.03, -0.06, 0.012), *inside])
    assert not np.any(found.normals @ (0.0, -1.0, 0.0) > 0.999)


def test_the_mesh_of_a_box_that_few_strokes_touched(monkeypatch):
    with_prisms = ContactSurface().reconstruct(record(*FEW)).mesh
    empty = HermiteData(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0))
    monkeypatch.setattr(contact_surface, "find_prisms", lambda touches, fine: empty)
    without = ContactSurface().reconstruct(record(*FEW)).mesh

    def off(mesh):
        sides = mesh.vertices[(mesh.vertices[:, 2] > 0.01) & (mesh.vertices[:, 2] < 0.04)]
        return float(np.abs(np.max(np.abs(sides[:, :2]) - HALF, axis=1)).mean())

    assert off(with_prisms) < 2e-4
    assert off(without) > 3.0 * off(with_prisms)
