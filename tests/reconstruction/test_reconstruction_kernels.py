"""Each kernel beside its naive twin."""

import naive_reconstruction as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from lwrprobe.contracts import InputError
from lwrprobe.reconstruction.clusters import cluster, supported
from lwrprobe.reconstruction.contour import contour
from lwrprobe.reconstruction.distance_kernels import (
    Mesh,
    corner_lists,
    crowding,
    foot_around,
    foot_on_triangle,
    scatter,
)
from lwrprobe.reconstruction.evidence import gather
from lwrprobe.reconstruction.evidence_kernels import weighted_median
from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.hermite_kernels import assemble, deviations, factorise, fit, value_at

seeds = st.integers(0, 10**6)


def test_covariance_is_that_of_finite_differences():
    points = np.random.default_rng(1).normal(size=(4, 3))
    upper = np.zeros((16, 16))
    assemble(points, np.zeros(4), np.zeros(4), 1.7, 2.0, upper)
    full = np.triu(upper) + np.triu(upper, 1).T
    assert np.abs(full - naive.covariance(points, 1.7, 2.0, 1e-3)).max() < 1e-3


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 24))
def test_factor_gives_the_matrix_back(seed, n):
    root = np.random.default_rng(seed).normal(size=(n, n + 2))
    matrix = root @ root.T + 0.1 * np.eye(n)
    factor = np.triu(matrix)
    assert factorise(factor)
    upper = np.triu(factor)
    assert np.abs(upper.T @ upper - matrix).max() < 1e-10 * np.abs(matrix).max()


def test_a_matrix_that_is_not_positive_definite_is_refused():
    assert not factorise(np.array([[1.0, 2.0], [0.0, 1.0]]))
    assert not factorise(np.array([[np.nan, 0.0], [0.0, 1.0]]))


def test_process_is_that_of_dense_linear_algebra():
    rng = np.random.default_rng(2)
    points, normals = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    noise, places = np.full(6, 0.01), rng.normal(size=(5, 3))
    upper, factor, weights, sd = np.zeros((24, 24)), np.zeros((24, 24)), np.empty(24), np.empty(5)
    assemble(points, noise, noise, 2.0, 1.5, upper)
    full = np.triu(upper) + np.triu(upper, 1).T
    assert fit(points, normals, noise, noise, 2.0, 1.5, factor, weights)
    target = np.concatenate([np.zeros(6), normals.T.ravel()])
    assert np.allclose(weights, np.linalg.solve(full, target), rtol=1e-8, atol=1e-10)
    near = np.tile([*range(6), 6, 6], (5, 1))
    assert deviations(points, noise, noise, near, 2.0, 1.5, places, sd)
    both = np.vstack([points, places])
    joint = np.zeros((44, 44))
    assemble(both, np.zeros(11), np.zeros(11), 2.0, 1.5, joint)
    joint = np.triu(joint) + np.triu(joint, 1).T
    data = np.concatenate([np.arange(6) + 11 * m for m in range(4)])
    for p in range(5):
        column = joint[data, 6 + p]
        assert value_at(points, weights, 2.0, 1.5, *places[p]) == pytest.approx(column @ weights, abs=1e-9)
        assert sd[p] == pytest.approx(np.sqrt(1.5 - column @ np.linalg.solve(full, column)), abs=1e-7)


def test_field_of_a_ball():
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    data = HermiteData(0.03 * normals, normals, np.full(400, 1e-5), np.full(400, 1e-2))
    field = HermiteField(data, 0.02)
    grid = Grid.around(np.full(3, -0.036), np.full(3, 0.036), 0.003)
    nodes = grid.nodes()
    radius = np.linalg.norm(nodes, axis=-1)
    near = np.abs(radius - 0.03) < 0.003
    assert np.abs(field.values(grid, near)[near] - (radius[near] - 0.03)).max() < 3e-4
    far = field.deviations(np.array([[0.03, 0.0, 0.0], [0.06, 0.0, 0.0]]))
    assert far[0] < 2e-4 < 1e-3 < far[1]


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(seeds)
def test_foot_on_a_triangle(seed):
    a, b, c, p = np.random.default_rng(seed).normal(size=(4, 3))
    foot = np.array(foot_on_triangle(a, b, c, p))
    assert np.linalg.norm(foot - p) <= naive.triangle_distance(a, b, c, p) + 1e-12
    assert np.linalg.norm(foot - p) >= naive.triangle_distance(a, b, c, p) - 0.05
    assert naive.triangle_distance(a, b, c, foot) < 0.05


def test_foot_on_a_flat_triangle_is_finite():
    a, b = np.zeros(3), np.array([1.0, 0.0, 0.0])
    assert np.isfinite(foot_on_triangle(a, b, b, np.array([0.3, 1.0, 0.0]))).all()
    assert np.isfinite(foot_on_triangle(a, a, a, np.array([0.3, 1.0, 0.0]))).all()


def test_scattering_finds_the_nearest_vertex():
    rng = np.random.default_rng(4)
    vertices = rng.random((60, 3))
    grid = Grid.around(np.zeros(3), np.ones(3), 0.1)
    square, nearest = np.full(grid.shape, 0.09), np.full(grid.shape, -1, dtype=np.int64)
    scatter(vertices, grid.origin, grid.step, 0.3, square, nearest)
    distance = np.linalg.norm(grid.nodes()[..., None, :] - vertices, axis=-1)
    within = distance.min(axis=-1) < 0.3 - 1e-9
    assert np.array_equal(nearest[within], distance[within].argmin(axis=-1))


def test_faces_around_a_vertex():
    faces = np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4]])
    starts, members = np.zeros(6, dtype=np.int64), np.empty(9, dtype=np.int64)
    corner_lists(faces, starts, members)
    around = [sorted(members[starts[v] : starts[v + 1]].tolist()) for v in range(5)]
    assert around == [[0, 1], [0], [0, 1, 2], [1, 2], [2]]
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 2, 0]], dtype=np.float64)
    foot = np.empty(3)
    mesh = Mesh(vertices, faces, starts, members)
    assert foot_around(mesh, 2, np.array([0.5, 0.6, 1.0]), foot) == pytest.approx(1.0)
    assert foot == pytest.approx([0.5, 0.6, 0.0])


@settings(max_examples=100, deadline=None)
@given(seeds, st.floats(0.05, 0.95))
def test_any_field_becomes_a_closed_manifold(seed, share):
    rng = np.random.default_rng(seed)
    grid = Grid(np.zeros(3), 1.0, (9, 8, 10))
    values = np.full(grid.shape, 1.0)
    values[2:-2, 2:-2, 2:-2] = rng.random((5, 4, 6)) - share
    if not (values < 0.0).any():
        with pytest.raises(InputError):
            contour(values, grid)
        return
    mesh = contour(values, grid)
    assert naive.closed(mesh.faces)
    assert naive.volume(mesh) > 0.0
    nearest = cKDTree(mesh.vertices).query(mesh.vertices, k=[2])[0]
    assert nearest.min() > 1e-5, "apart in a file that holds their places alone, and for who merges what is near"


def test_a_box_keeps_its_sharp_edges():
    grid = Grid(np.full(3, -1.03), 0.1, (21, 21, 21))
    half = np.array([0.62, 0.44, 0.53])

    def exact(edges, positions, normals):
        """Crossings lie on the face across the edge's axis."""
        for e, (i, j, k, axis) in enumerate(edges):
            positions[e] = i, j, k
            place = grid.origin + grid.step * positions[e]
            side = np.sign(place[axis])
            positions[e, axis] = (side * half[axis] - grid.origin[axis]) / grid.step
            normals[e] = side * np.eye(3)[axis]

    mesh = contour((np.abs(grid.nodes()) - half).max(axis=-1), grid, exact)
    assert np.abs(np.abs(mesh.vertices).max(axis=0) - half).max() < 1e-9
    assert naive.volume(mesh) == pytest.approx(8 * np.prod(half), rel=1e-9)


def test_a_smooth_ball_by_interpolation_alone():
    grid = Grid(np.full(3, -1.03), 0.1, (21, 21, 21))
    mesh = contour(np.linalg.norm(grid.nodes(), axis=-1) - 0.8, grid)
    sag = 0.1**2 / (8 * 0.8)  # of a cell's edge against the ball, in each of the two directions along it
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.8).max() < 2.5 * sag


def test_crowding_of_feet():
    """A concave arc of radius 6 seen from the arc of radius 1 one sphere radius inside it."""
    angle = np.linspace(0.0, 1.0, 9)
    arc = np.column_stack([np.cos(angle), np.sin(angle)])
    strip = np.vstack([np.column_stack([6 * arc, np.full(9, z)]) for z in (0.0, 20.0)])
    feet = np.vstack([np.column_stack([arc, np.full(9, z)]) for z in (0.0, 20.0)])
    faces = np.array([[i, i + 1, i + 9] for i in range(8)])
    ratio = np.full(18, np.inf)
    crowding(strip, faces, feet, ratio)
    assert ratio[:9] == pytest.approx(1 / 6)


def test_a_field_that_leaves_the_grid_is_refused():
    grid = Grid(np.zeros(3), 1.0, (5, 5, 5))
    with pytest.raises(InputError, match="leaves the grid"):
        contour(np.full(grid.shape, -1.0), grid)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_clusters_hold_every_point_near_and_facing_alike(seed):
    rng = np.random.default_rng(seed)
    points, normals = rng.random((150, 3)), rng.normal(size=(150, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    confidence = rng.uniform(0.1, 1.0, 150)
    groups = cluster(points, normals, confidence, 0.3)
    assert np.bincount(groups.label, confidence) == pytest.approx(groups.weight)
    assert (np.linalg.norm(groups.points[groups.label] - points, axis=1) < 0.6).all()
    assert (np.einsum("ij,ij->i", groups.normals[groups.label], normals) > 0.2).all()


@pytest.mark.parametrize("seed", range(3))
def test_support_is_counted_as_by_hand(seed):
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(400, 3)), rng.normal(size=(400, 3))
    normals[:, 2] -= 2.0
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    alike, weight = rng.random(400) < 0.4, rng.uniform(0.1, 1.0, 400)
    claims = alike & (rng.random(400) < 0.7)
    found = supported(claims, alike, points, normals, weight, 0.8)
    assert 0 < found.sum() < claims.sum()
    assert (found == naive.supported(claims, alike, points, normals, weight, 0.8)).all()


def test_no_contacts_support_none():
    none = np.empty((0, 3)), np.empty((0, 3)), np.empty(0)
    assert not len(supported(np.empty(0, bool), np.empty(0, bool), *none, 0.8))


def test_a_merged_arc_stays_on_its_circle():
    angle = np.linspace(0.0, 0.6, 7)
    normals = np.column_stack([np.cos(angle), np.zeros(7), np.sin(angle)])
    groups = cluster(5.0 * normals, normals, np.ones(7), 10.0)
    assert len(groups.points) == 1
    assert np.linalg.norm(groups.points[0]) == pytest.approx(5.0, abs=0.01)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.floats(-10, 10), st.floats(0.01, 5)), min_size=1, max_size=30))
def test_weighted_median(pairs):
    values, weights = np.array(pairs).T
    found = weighted_median(np.ascontiguousarray(values), np.ascontiguousarray(weights))
    assert weights[values <= found].sum() >= 0.5 * weights.sum() - 1e-9
    assert weights[values >= found].sum() >= 0.5 * weights.sum() - 1e-9


def test_space_above_the_sphere_is_free_where_the_stick_was_upright_alone():
    """Under an overhang, between two lines over it, a leaning stick had cut through the object up to its top."""
    grid = Grid.around(np.array([-0.02, -0.02, 0.0]), np.array([0.02, 0.02, 0.08]), 0.002)
    tops = np.array([[x, 0.0, 0.06] for x in (-0.006, 0.006)])
    up, visited = np.tile([0.0, 0.0, 1.0], (2, 1)), np.vstack([tops, [0.0, 0.0, 0.02]])
    visited[:2, 2] += 0.005
    over = tuple(np.rint((np.array([0.0, 0.0, 0.05]) - grid.origin) / grid.step).astype(int))
    bounds = [gather(grid, tops, up, visited, np.array([True, True, stood]), 2, 0.005).bound for stood in (True, False)]
    upright, leaning = (float(bound[over]) for bound in bounds)
    assert upright > 0.0
    assert leaning < -0.004
