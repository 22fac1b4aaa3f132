"""A solid with exact geometry: what the simulator touches and what the evaluator measures against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError, SceneError, TriangleMesh
from lwrprobe.scene import program
from lwrprobe.scene.contour import contour
from lwrprobe.scene.csg import Composite, Flattener, Node, step_rows, tree_rows
from lwrprobe.scene.edges import Chain, Tracer, corners
from lwrprobe.scene.mesh_body import MeshBody, load_body, pack_bodies
from lwrprobe.scene.sample import scatter
from lwrprobe.scene.shape import Mesh, RandomObject, Shape
from lwrprobe.scene.solid_kernels import contains_batch, nearest_batch, sphere_contacts
from lwrprobe.scene.surface_kernels import surface_values


@dataclass(slots=True, frozen=True)
class Nearest:
    """The nearest boundary point of each of n points.

    Attributes
    ----------
    distance : (n,) m, negative inside
    points : (n, 3) m, on the boundary
    normals : (n, 3) unit, out of the solid; at an edge, along the line to the point
    parts : (n,) index of the object
    """

    distance: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    parts: np.ndarray


@dataclass(slots=True, frozen=True)
class Touch:
    """Contacts of a sphere: points (k, 3) and normals (k, 3), index of the object (k,), depth (k,) m."""

    points: np.ndarray
    normals: np.ndarray
    parts: np.ndarray
    depths: np.ndarray


class Solid:
    """The union of all objects of a scene, in the world frame.

    `numbers` and `indices` are what the kernels in `solid_kernels` take. An empty solid is one that nothing touches.
    """

    def __init__(
        self, numbers: np.ndarray, indices: np.ndarray, parts: int, flat: Flattener, bodies: Sequence[MeshBody]
    ) -> None:
        self.numbers = numbers
        self.indices = indices
        self.parts = parts
        """Number of objects."""
        self._flat = flat
        self._bodies = bodies

    @classmethod
    def from_shapes(cls, shapes: Sequence[Shape]) -> Solid:
        """Build from the objects of a scene; raises SceneError for one that has no end or a mesh that is not closed."""
        flat = Flattener()
        nodes: list[Node] = []
        bodies: list[MeshBody] = []
        for part, shape in enumerate(shapes):
            rest, meshes = _split(shape, part, np.eye(4))
            bodies += meshes
            if rest is not None:
                node = flat.node(rest, part, np.eye(4))
                _refuse_endless(node, f"object[{part}]")
                nodes.append(node)
        solid = cls(*_compile(flat, nodes, bodies), len(shapes), flat, bodies)
        solid._tighten()
        return solid

    @property
    def empty(self) -> bool:
        """Nothing there."""
        return self.indices[program.SURFACES] == 0 and self.indices[program.MESHES] == 0

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (3,) m of a box that holds the solid; infinite and inverted when it is empty."""
        row = self.indices[program.BOUNDS + 1]
        return self.numbers[row : row + 3].copy(), self.numbers[row + 3 : row + 6].copy()

    def _tighten(self) -> None:
        """Shrink the box to the solid: what is nearest to a point 10 km away reaches furthest, to 1 um."""
        if self.empty:
            return
        lower, upper = self.bounds()
        middle = 0.5 * (lower + upper)
        reach = self.nearest(np.concatenate([middle - 1e4 * np.eye(3), middle + 1e4 * np.eye(3)])).points
        row = self.indices[program.BOUNDS + 1]
        self.numbers[row : row + 3] = np.maximum(lower, np.diag(reach[:3]) - 1e-6)
        self.numbers[row + 3 : row + 6] = np.minimum(upper, np.diag(reach[3:]) + 1e-6)

    def nearest(self, points: np.ndarray) -> Nearest:
        """Exact nearest boundary points of points (n, 3) m; raises InputError for an empty solid or a bad array."""
        points = _as_points(points)
        if self.empty:
            raise InputError("solid", "empty", "a scene with at least one object")
        n = len(points)
        out = Nearest(np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty(n, dtype=np.int64))
        nearest_batch(self.numbers, self.indices, points, out.distance, out.points, out.normals, out.parts)
        return out

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """(n,) m of points (n, 3), negative inside, infinite where nothing is."""
        return np.full(len(_as_points(points)), np.inf) if self.empty else self.nearest(points).distance

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(n,) bool of points (n, 3)."""
        points = _as_points(points)
        inside = np.empty(len(points), dtype=np.int64)
        contains_batch(self.numbers, self.indices, points, inside)
        return inside.astype(bool)

    def sample_surface(self, n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """n points (n, 3) m spread evenly over the surface, and outward normals (n, 3); raises InputError when empty.

        The underside on the table is part of the surface.
        """
        if self.empty:
            raise InputError("solid", "empty", "a scene with at least one object")
        rng = np.random.default_rng(seed)
        density = 1.05 * n / self.area(seed)
        while True:
            points, normals = self._scatter(density, rng)
            if len(points) >= n:
                chosen = np.sort(rng.choice(len(points), n, replace=False))
                return points[chosen], normals[chosen]
            density *= 1.1 * n / max(len(points), 1)

    def area(self, seed: int = 0) -> float:
        """m^2 of the whole surface, by counting points spread over it; good to about 1 %."""
        return len(self._scatter(2e5, np.random.default_rng(seed))[0]) / 2e5

    def _scatter(self, density: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        return scatter(self._flat.surfaces, self._flat.groups, self._bodies, self.numbers, self.indices, density, rng)

    def mesh(self, tolerance: float = 1e-4) -> TriangleMesh:
        """The surface as a closed mesh with sharp edges, for pictures and for other programs; empty for nothing.

        Vertices lie on the exact surface; the triangles keep within about `tolerance` m of it down to a radius of
        curvature of 20 mm, and more than that in proportion below. An edge sharper than 30 degrees may be blunted by a
        part of a cell.
        """
        if not 1e-6 <= tolerance <= 1e-2:
            raise InputError("tolerance", tolerance, "a length from 1e-6 to 1e-2 m")
        if self.empty:
            return TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
        if self.indices[program.SURFACES] == 0 and len(self._bodies) == 1:
            return TriangleMesh(self._bodies[0].vertices.copy(), self._bodies[0].faces.copy())
        level = [s for s in self._flat.surfaces if s.kind == program.PLANE and np.abs(s.u).max() > 1.0 - 1e-12]
        levels = [np.array([s.a[axis] for s in level if abs(s.u[axis]) > 0.5]) for axis in range(3)]
        return contour(self.numbers, self.indices, levels, float(np.sqrt(8.0 * 0.005 * tolerance)))

    def touch(self, centre: np.ndarray, radius: float, max_contacts: int = 16) -> Touch:
        """All contacts of a sphere at `centre` (3,) m: the distinct local minima of the distance below `radius`."""
        centre = _as_points(np.atleast_2d(centre))[0]
        points, normals = np.empty((2, max_contacts, 3))
        parts = np.empty(max_contacts, dtype=np.int64)
        count, _ = sphere_contacts(self.numbers, self.indices, centre, float(radius), points, normals, parts)
        points, normals, parts = points[:count], normals[:count], parts[:count]
        return Touch(points, normals, parts, radius - np.einsum("ij,ij->i", centre - points, normals))


def _as_points(points: np.ndarray) -> np.ndarray:
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError("points", points.shape, "an (n, 3) array of points in metres")
    if not np.isfinite(points).all():
        raise InputError("points", "NaN or infinite values", "finite coordinates in metres")
    return points


def _split(shape: Shape, part: int, frame: np.ndarray) -> tuple[Shape | None, list[MeshBody]]:
    """A shape without the meshes that its unions hold, and those meshes."""
    if isinstance(shape, Mesh | RandomObject):
        return None, [load_body(shape, part, frame @ shape.at.matrix())]
    if shape.shape != "union":
        return shape, []
    rest, bodies = [], []
    for child in shape.children:
        kept, meshes = _split(child, part, frame @ shape.at.matrix())
        rest += [kept] if kept is not None else []
        bodies += meshes
    return (shape.model_copy(update={"children": tuple(rest)}) if rest else None), bodies


def _refuse_endless(node: Node, name: str) -> None:
    lower, upper = node.lower, node.upper
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        raise SceneError(name, "a shape without end", "a bounded shape; intersect a half_space with a box")
    if (lower >= upper).any():
        raise SceneError(name, "children that do not meet", "an intersection that holds something")


def _compile(flat: Flattener, nodes: list[Node], bodies: list[MeshBody]) -> tuple[np.ndarray, np.ndarray]:
    boxes = [(n.lower, n.upper) for n in nodes] + [body.bounds() for body in bodies]
    lower = np.min([b[0] for b in boxes], axis=0) if boxes else np.full(3, np.inf)
    upper = np.max([b[1] for b in boxes], axis=0) if boxes else np.full(3, -np.inf)
    sections: program.Sections = {program.BOUNDS: (1, np.array([lower, upper]), [])}
    chains: list[Chain] = []
    if nodes:
        root = Composite(program.UNION, nodes) if len(nodes) > 1 else nodes[0]
        sections |= _surface_sections(flat, root)
        numbers, indices = program.pack(sections)
        tracer = Tracer(flat.surfaces, flat.groups, lower, upper, numbers, indices)
        chains = tracer.chains()
        sections |= _edge_sections(chains)
        sections |= _corner_sections(corners(chains), numbers, indices)
    return pack_bodies(*program.pack(sections), bodies)


def _surface_sections(flat: Flattener, root: Node) -> program.Sections:
    balls = np.concatenate([s.balls for s in flat.surfaces])
    tree, steps = tree_rows(root), step_rows(root)
    count = len(flat.surfaces)
    # Balls follow the surfaces at once, so that their places are known here.
    ends = program.SURFACE_NUMBERS * count + np.cumsum([0] + [s.balls.size for s in flat.surfaces])
    groups = [(group.first, group.last) for group in flat.groups for _ in range(group.first, group.last)]
    rows = [
        [*s.a, *s.u, s.r, s.l, s.kind, s.part, ends[k], ends[k + 1], *groups[k]] for k, s in enumerate(flat.surfaces)
    ]
    return {
        program.SURFACES: (count, np.concatenate([np.ravel(rows), balls.ravel()]), []),
        program.TREE: (len(tree), [], tree),
        program.STEPS: (len(steps), [], steps),
    }


def _edge_sections(chains: list[Chain]) -> program.Sections:
    chains = [piece for chain in chains for piece in chain.pieces()]
    ends = np.cumsum([0] + [len(chain.rows) for chain in chains])
    rows = np.concatenate([chain.rows for chain in chains]) if chains else np.empty((0, program.EDGE_NUMBERS))
    table = [
        [ends[n], ends[n + 1], *chain.surfaces, *map(int, chain.signs), int(chain.convex), chain.kind]
        for n, chain in enumerate(chains)
    ]
    return {
        program.CHAINS: (len(chains), np.array([chain.ball for chain in chains]), np.array(table, dtype=np.int64)),
        program.EDGES: (len(rows), rows, []),
    }


def _corner_sections(points: np.ndarray, numbers: np.ndarray, indices: np.ndarray) -> program.Sections:
    surfaces = indices[program.SURFACES]
    values = np.empty((surfaces, len(points)))
    for k in range(surfaces):
        surface_values(numbers, k, points, values[k])
    meeting = [np.flatnonzero(np.abs(values[:, n]) < 1e-7) for n in range(len(points))]
    ends = np.cumsum([0] + [len(m) for m in meeting])
    rows = np.column_stack([ends[:-1], ends[1:]])
    return {
        program.VERTICES: (len(points), points, rows),
        program.INCIDENCE: (ends[-1], [], np.concatenate([np.empty(0, np.int64), *meeting])),
    }
