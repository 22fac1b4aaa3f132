"""The true shape for the judge of `bench shapes`: a mesh, and distances by trimesh and scipy alone.

Nothing here comes from what the simulator and the evaluation compute with, so that a fault there is not its own judge.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import LinkShape, TriangleMesh

_SAMPLES = 300_000
_CANDIDATES = 6  # samples whose triangles are looked at for the nearest point
_COARSE = 15  # only every so many of the samples say whether something fits
_SLACK = 2e-4  # m: between them the surface is that much nearer at most, seen from one sphere radius
_FAR = 0.012  # m: nothing is nearer, seen from a point of a link
_ROUNDS = 10  # of the alignment
_STRAY = 0.005  # m: points farther off have no say in it
_TOLD = 1e-4  # share of the best seen motion below which one is not told by the points
_JUDGED = 6000  # points of a mesh that is measured


class TrueMesh:
    """A closed mesh to measure against."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        import trimesh
        from scipy.spatial import cKDTree

        self._mesh = trimesh.Trimesh(vertices, faces, process=False)
        self._samples, self._face = trimesh.sample.sample_surface(self._mesh, _SAMPLES, seed=1)
        self._tree = cKDTree(self._samples)
        self._coarse = cKDTree(self._samples[::_COARSE])
        self._normals = self._mesh.face_normals[self._face[::_COARSE]]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(n,) m from points (n, 3) to the surface, without sign."""
        import trimesh

        _, near = self._tree.query(points, k=_CANDIDATES)
        # In millimetres: trimesh takes products of lengths below 1e-13 for zero.
        triangles, places = 1e3 * self._mesh.triangles[self._face[near.ravel()]], 1e3 * points
        feet = trimesh.triangles.closest_point(triangles, np.repeat(places, _CANDIDATES, axis=0))
        return 1e-3 * np.linalg.norm(feet.reshape(-1, _CANDIDATES, 3) - places[:, None], axis=2).min(axis=1)

    def aligned_with(self, points: np.ndarray) -> TrueMesh:
        """The same shape where surface points (n, 3) have it: moved until they lie on its faces in least squares."""
        from scipy.spatial.transform import Rotation

        turn, shift = Rotation.identity(), np.zeros(3)  # of the points, onto this mesh
        for _ in range(_ROUNDS):
            places = turn.apply(points) + shift
            _, near = self._tree.query(places)
            normals = self._mesh.face_normals[self._face[near]]
            off = np.einsum("ij,ij->i", places - self._mesh.triangles[self._face[near], 0], normals)
            close = np.abs(off) < _STRAY
            middle = places[close].mean(axis=0)
            slopes = np.column_stack([np.cross(places[close] - middle, normals[close]), normals[close]])
            # What no point tells, as the turn about a rotor's axis, stays as it is.
            step = np.linalg.lstsq(slopes, -off[close], rcond=_TOLD)[0]
            small = Rotation.from_rotvec(step[:3])
            turn, shift = small * turn, small.apply(shift - middle) + middle + step[3:]
        vertices = turn.inv().apply(np.asarray(self._mesh.vertices) - shift)
        return TrueMesh(vertices, np.asarray(self._mesh.faces))

    def surface(self, count: int, lowest: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Samples (n, 3) whose touching sphere has its centre at or above `lowest` m, and their normals (n, 3)."""
        rows = np.random.default_rng(2).choice(_SAMPLES, count, replace=False)
        points, normals = self._samples[rows], self._mesh.face_normals[self._face[rows]]
        high = points[:, 2] + radius * normals[:, 2] >= lowest
        return points[high], normals[high]

    def fits(self, centres: np.ndarray, radius: float, offsets: np.ndarray, keep: np.ndarray) -> np.ndarray:
        """(n,) bool: where a sphere fits at centres (n, 3), and points at `offsets` (k, 3) from it keep `keep` (k,)."""
        free = self._outside(centres) >= radius - _SLACK
        for offset, distance in zip(offsets, keep):
            rows = np.flatnonzero(free)
            free[rows] = self._outside(centres[rows] + offset) >= distance
        return free

    def _outside(self, points: np.ndarray) -> np.ndarray:
        """(n,) m from points (n, 3) to the surface, negative on the inner side of the nearest sample's face.

        As coarse as the samples; infinite where none is within 12 mm, which a point of a link is at times and all of
        them never are while the link is in the object.
        """
        gap, near = self._coarse.query(points, distance_upper_bound=_FAR)
        close = np.isfinite(gap)
        side = points[close] - self._coarse.data[near[close]]
        gap[close] *= np.where(np.einsum("ij,ij->i", side, self._normals[near[close]]) < 0.0, -1.0, 1.0)
        return gap


def link_points(link: LinkShape) -> np.ndarray:
    """(k, 3) m points on a link's surface, in the tip's frame: rings of a cylinder, the edges of a box."""
    length = link.size[1] if link.kind == "cylinder" else link.size[2]
    heights = np.linspace(-0.5, 0.5, 2 + int(length / link.size[0])) * length
    if link.kind == "cylinder":
        angle = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
        ring = link.size[0] * np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        ring = 0.5 * np.array([[x * link.size[0], y * link.size[1]] for x in (-1, 1) for y in (-1, 0, 1)])
    points = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in heights])
    return points @ link.pose[:3, :3].T + link.pose[:3, 3]


def mesh_errors(
    mesh: TriangleMesh, true: TrueMesh, points: np.ndarray, above: float, judged: np.ndarray | None = None
) -> tuple[float, float] | None:
    """m, mean of both ways between mesh and surface points (n, 3), above a height, and the largest; None where one of
    both has nothing there.

    With `judged`, (n,) bool, only of these points, and of the mesh where one of them is the nearest of all points.
    """
    from scipy.spatial import cKDTree

    other = TrueMesh(mesh.vertices, mesh.faces)
    mine = other.surface(_JUDGED, above, 0.0)[0]
    if judged is not None and len(mine):
        mine = mine[judged[cKDTree(points).query(mine)[1]]]
        points = points[judged]
    there = true.distance(mine) if len(mine) else mine
    back = other.distance(points[points[:, 2] > above])
    if not len(there) or not len(back):
        return None
    return float(0.5 * (there.mean() + back.mean())), float(max(there.max(), back.max()))


def edges_of_two(mesh: TriangleMesh) -> bool:
    """Whether every edge has exactly two faces, that run along it in opposite directions."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    _, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    _, directed = np.unique(edges, axis=0, return_counts=True)
    return bool(len(edges) and (uses == 2).all() and (directed == 1).all())
