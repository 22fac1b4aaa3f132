"""The hull is closed, convex and outward, at any scale, and degenerate input gets one typed error."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.contracts.plugins import load
from lwrprobe.reconstruction.convex_hull import ConvexHull, convex_hull


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def is_closed(mesh):
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {tuple(edge) for edge in edges.tolist()}
    return len(forward) == len(edges) and all((b, a) in forward for a, b in forward)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e6])
def test_a_box_keeps_its_volume_at_any_scale(scale):
    corners = np.array(np.meshgrid([0, 2], [0, 3], [1, 5])).reshape(3, -1).T * scale
    mesh = convex_hull(np.vstack([corners, corners.mean(axis=0)]))
    assert volume(mesh) == pytest.approx(24 * scale**3, rel=1e-9)
    assert len(mesh.vertices) == 8
    assert is_closed(mesh)


@settings(max_examples=40, deadline=None)
@given(st.integers(4, 200), st.integers(0, 10**6))
def test_all_points_lie_inside_the_hull(count, seed):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    mesh = convex_hull(points)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.max(points @ normals.T - np.einsum("ij,ij->i", a, normals)) < 1e-9
    assert is_closed(mesh)


def test_a_cospherical_grid_is_closed():
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(0, np.pi, 19))
    points = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    mesh = convex_hull(points)
    assert is_closed(mesh)
    assert 0.97 < volume(mesh) / (4 / 3 * np.pi) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.zeros((0, 3)), "0 distinct"),
        (np.zeros((1, 3)), "1 distinct"),
        (np.eye(3)[:2], "2 distinct"),
        (np.eye(3), "3 distinct"),
        (np.ones((500, 3)), "1 distinct"),
        (np.outer(np.arange(50.0), [1, 2, 3]), "one line"),
        (np.c_[np.random.default_rng(1).random((50, 2)), np.full(50, 0.05)], "one plane"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.nan]]), "points[3]"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.inf]]), "points[3]"),
    ],
)
def test_degenerate_input_gets_one_typed_error(points, says):
    with pytest.raises(InputError) as caught:
        ConvexHull(ConvexHull.Config()).reconstruct(TouchRecord(points))
    assert says in str(caught.value)


@pytest.mark.slow
def test_a_million_points():
    points = np.random.default_rng(2).normal(size=(1_000_000, 3))
    assert is_closed(convex_hull(points))


def test_it_is_found_by_its_entry_point_and_reports():
    method = load("reconstructor", "convex_hull")
    result = method(method.Config()).reconstruct(TouchRecord(np.random.default_rng(3).random((30, 3))))
    assert {"method", "seconds", "watertight", "without"} <= result.report.keys()
