"""A mesh against the true solid, both ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError, TriangleMesh
from lwrprobe.evaluation.point_error import NormalError, normal_error, rows
from lwrprobe.evaluation.reach import Reach
from lwrprobe.scene.mesh_distance import MeshDistance
from lwrprobe.scene.solid import Solid

_SAMPLES = 20_000
_ROUNDS = 200
"""In which samples are drawn until enough of them lie above a height."""
_CELLS = 80  # along the longest edge, for volumes


@dataclass(slots=True, frozen=True)
class MeshError:
    """How far a mesh is from the truth.

    Attributes
    ----------
    mean, rms, p95 : m, over both ways: mesh to surface and surface to mesh
    hausdorff : m, the largest of all
    mesh_to_surface, surface_to_mesh : m, mean of each way
    normals : angle between the mesh's faces and the true surface nearest to them
    watertight : each edge joins two faces that are wound alike
    volume_error : (mesh - truth) / truth above the given height, None for a mesh that is not watertight
    overlap : intersection over union above the given height, None likewise
    """

    mean: float
    rms: float
    p95: float
    hausdorff: float
    mesh_to_surface: float
    surface_to_mesh: float
    normals: NormalError
    watertight: bool
    volume_error: float | None
    overlap: float | None

    def as_dict(self) -> dict[str, object]:
        """Millimetres, degrees and shares."""
        lengths = ("mean", "rms", "p95", "hausdorff", "mesh_to_surface", "surface_to_mesh")
        return {
            **{name: round(1e3 * getattr(self, name), 5) for name in lengths},
            "normals_deg": self.normals.as_dict(),
            "watertight": self.watertight,
            "volume_error": None if self.volume_error is None else round(self.volume_error, 5),
            "iou": None if self.overlap is None else round(self.overlap, 5),
        }


def mesh_error(mesh: TriangleMesh, solid: Solid, above: float, samples: int = _SAMPLES, seed: int = 0) -> MeshError:
    """Compare the parts of mesh and true surface above the height `above` m.

    Raises InputError for a mesh without faces, for an empty solid, and where either has less than about 1/200 of its
    surface above the height.
    """
    points, normals = sample_mesh(mesh, above, samples, seed)
    true_points, to_mesh = _true_samples(solid, above, samples, seed), MeshDistance(mesh)
    near = solid.nearest(points)
    there, back = np.abs(near.distance), to_mesh.distance(true_points)
    both = np.concatenate([there, back])
    corners = mesh.vertices[np.unique(mesh.faces)]
    corners = corners[corners[:, 2] > above]
    furthest = max(both.max(), np.abs(solid.signed_distance(corners)).max(initial=0.0))
    watertight = is_watertight(mesh)
    volume, overlap = _volumes(mesh, to_mesh, solid, above, seed) if watertight else (None, None)
    return MeshError(
        mean=float(0.5 * (there.mean() + back.mean())),
        rms=float(np.sqrt(0.5 * (np.mean(there**2) + np.mean(back**2)))),
        p95=float(np.percentile(both, 95.0)),
        hausdorff=float(furthest),
        mesh_to_surface=float(there.mean()),
        surface_to_mesh=float(back.mean()),
        normals=normal_error(normals, near.normals),
        watertight=watertight,
        volume_error=volume,
        overlap=overlap,
    )


def reachable_error(mesh: TriangleMesh, solid: Solid, found: Reach, above: float) -> dict[str, float]:
    """`mean` and `p95` in mm over both ways as in `mesh_error`, of what the sphere reaches; empty without any of it.

    `found` comes from `reach` with its default seed. A point of the mesh counts where the sample of the whole true
    surface nearest to it is one that the sphere reaches.
    """
    from scipy.spatial import cKDTree

    within = found.points[found.points[:, 2] > above]
    points, _ = sample_mesh(mesh, above, _SAMPLES)
    if not len(within):
        return {}
    whole, _ = solid.sample_surface(round(found.whole_area / found.each), 0)
    points = points[cKDTree(within).query(points)[0] <= cKDTree(whole).query(points)[0]]
    there, back = np.abs(solid.signed_distance(points)), MeshDistance(mesh).distance(within)
    ways = [way for way in (there, back) if len(way)]
    mean, p95 = np.mean([way.mean() for way in ways]), np.percentile(np.concatenate(ways), 95.0)
    return {"mean": round(1e3 * float(mean), 5), "p95": round(1e3 * float(p95), 5)}


def mean_error(mesh: TriangleMesh, solid: Solid, above: float, samples: int = _SAMPLES, seed: int = 0) -> float:
    """m, the mean of `mesh_error` alone, with its errors."""
    points, _ = sample_mesh(mesh, above, samples, seed)
    back = MeshDistance(mesh).distance(_true_samples(solid, above, samples, seed))
    return float(0.5 * (np.abs(solid.signed_distance(points)).mean() + back.mean()))


def deviation(mesh: TriangleMesh, solid: Solid) -> np.ndarray:
    """(n,) m signed distance of each vertex from the true surface, positive outside of the true solid."""
    return solid.signed_distance(rows("mesh.vertices", mesh.vertices))


def face_deviation(mesh: TriangleMesh, solid: Solid) -> np.ndarray:
    """(m,) m signed distance of each face's middle from the true surface, positive outside of the true solid."""
    return solid.signed_distance(rows("mesh.vertices", mesh.vertices)[mesh.faces].mean(axis=1))


def is_watertight(mesh: TriangleMesh) -> bool:
    """Whether each edge joins exactly two faces, in opposite directions.

    Vertices at the same place are one, and triangles that have only two corners then do not count.
    """
    if not len(mesh.faces):
        return False
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    forth, times = np.unique(edges, axis=0, return_counts=True)
    back = np.unique(edges[:, ::-1], axis=0)
    return bool((times == 1).all() and np.array_equal(forth, back))


def sample_mesh(mesh: TriangleMesh, above: float, samples: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Even points (n, 3) above a height, and the normals (n, 3) of their faces.

    Raises InputError for a mesh without faces, or with less than about 1/200 of its surface above the height.
    """
    vertices = rows("mesh.vertices", mesh.vertices)
    if not len(mesh.faces):
        raise InputError("mesh", "no faces", "a mesh with at least one face")
    a, b, c = (vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normals, axis=1)
    if not area.sum() > 0.0 or vertices[:, 2].max() <= above:
        raise InputError("mesh", "nothing above", f"a mesh that reaches above the height {above:g} m")
    rng = np.random.default_rng(seed)

    def draw(_: int) -> tuple[np.ndarray, np.ndarray]:
        face = rng.choice(len(area), samples, p=area / area.sum())
        u, v = np.sqrt(rng.random(samples))[:, None], rng.random(samples)[:, None]
        return (1.0 - u) * a[face] + u * (1.0 - v) * b[face] + u * v * c[face], normals[face]

    points, facing = _drawn_above(draw, above, samples, "mesh")
    return points[:samples], facing[:samples]


def _true_samples(solid: Solid, above: float, samples: int, seed: int) -> np.ndarray:
    """At least `samples` even points of the true surface above a height."""
    if solid.empty or solid.bounds()[1][2] <= above:
        raise InputError("solid", "nothing above", f"an object that reaches above the height {above:g} m")
    return _drawn_above(lambda k: solid.sample_surface(samples, seed + k), above, samples, "solid")[0]


def _drawn_above(
    draw: Callable[[int], tuple[np.ndarray, np.ndarray]], above: float, samples: int, what: str
) -> tuple[np.ndarray, np.ndarray]:
    """At least `samples` of the points (n, 3) above a height that come in rounds, and their normals (n, 3).

    All of the last round count: a solid's points come surface by surface. Raises InputError where hardly any lie there.
    """
    kept_points, kept_normals, kept = [], [], 0
    for k in range(_ROUNDS):
        points, normals = draw(k)
        high = points[:, 2] > above
        kept_points.append(points[high])
        kept_normals.append(normals[high])
        kept += int(high.sum())
        if kept >= samples:
            return np.concatenate(kept_points), np.concatenate(kept_normals)
    raise InputError(what, "next to nothing above", f"one that reaches well above the height {above:g} m")


def _volumes(mesh: TriangleMesh, to_mesh: MeshDistance, solid: Solid, above: float, seed: int) -> tuple[float, float]:
    """Relative volume error and intersection over union above a height, from one jittered grid over both."""
    lower = np.minimum(solid.bounds()[0], mesh.vertices.min(axis=0))
    upper = np.maximum(solid.bounds()[1], mesh.vertices.max(axis=0))
    lower[2] = max(lower[2], above)
    count = np.maximum(np.ceil((upper - lower) / ((upper - lower).max() / _CELLS)).astype(int), 1)
    rng = np.random.default_rng(seed)
    columns = np.stack(np.meshgrid(np.arange(count[0]), np.arange(count[1]), indexing="ij"), axis=-1).reshape(-1, 2)
    columns = lower[:2] + (columns + rng.random(columns.shape)) / count[:2] * (upper - lower)[:2]
    heights = lower[2] + (np.arange(count[2]) + rng.random((len(columns), count[2]))) / count[2] * (upper - lower)[2]
    points = np.column_stack([np.repeat(columns, count[2], axis=0), heights.ravel()])
    true, made = solid.contains(points), to_mesh.contains(columns, heights).ravel()
    either, both = int(np.count_nonzero(true | made)), int(np.count_nonzero(true & made))
    volume = int(np.count_nonzero(made)) / max(int(np.count_nonzero(true)), 1) - 1.0
    return volume, both / max(either, 1)
