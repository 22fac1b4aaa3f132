"""The default reconstructor: what the sphere's centre could not pass, shrunk by the sphere's radius.

Where the sphere touches, its centre lies at exactly its radius from the object, and the contact normal is the
gradient of that distance. The surface of the centres is smooth wherever the object is convex, edges included, so
interpolation between sparse lines works there (and not on the object itself). Shrinking it by the radius gives the
object back, with its sharp edges, up to what the sphere cannot reach.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from lwrprobe.contracts import RECONSTRUCTOR_CONTRACT, InputError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.reconstruction.choice import better_method, lines_apart
from lwrprobe.reconstruction.clusters import Clusters, cluster, outvoted, supported, thinnest_wall, wedged
from lwrprobe.reconstruction.contour import contour
from lwrprobe.reconstruction.convex_hull import ConvexHull
from lwrprobe.reconstruction.convexity import tangent_bound
from lwrprobe.reconstruction.distance_kernels import (
    Mesh,
    Nodes,
    corner_lists,
    crowding,
    erode,
    eroded_crossings,
    feet_of,
)
from lwrprobe.reconstruction.evidence import LEANING, Evidence, Walls, WallSettings, find_walls, gather
from lwrprobe.reconstruction.grid import Grid, affordable
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.hermite_rbf import HermiteRbf
from lwrprobe.reconstruction.inner_edges import CROWDED, meet
from lwrprobe.reconstruction.lower_sides import find_lower_sides, moved_to_field
from lwrprobe.reconstruction.prisms import find_prisms
from lwrprobe.reconstruction.rulings import find_rulings, fine_clusters, upright_walls
from lwrprobe.reconstruction.settling import predicted_better, settled
from lwrprobe.reconstruction.touches import Touches, line_pitch, prepare, regular_lines
from lwrprobe.reconstruction.undersides import find_undersides

_FROM_BELOW, _LEANS = -0.25, -0.14  # z of the normals of a contact from below, and of those that bear it out
_NOISE_FLOOR = 3e-5  # m, below which averaging contacts does not help
_LEAST = 5e-5  # m, of the options that are lengths: finer grids do not fit into memory
_WITNESSES = 10  # contacts on a part of the body that floats, from which on it is one
_GUESS = 0.3  # m of mean error a metre that the mesh goes on beyond what was touched and half a line distance
_AS_LEANING = 0.002  # m: so near to a place where the stick leaned it is taken to lean, which errs to the safe side
_CROWDED = 0.3  # feet this close together, as a share: the sphere rests in an inner edge
_BAND = 0.5  # of the pitch: how far beside the tangent planes the surface may run
_NEAR = 0.9  # of the pitch: how far from data the field is taken
_NEAR_OVERHANG = 2.5  # the same under data that lean down and beside lower sides, where nothing else is known
_STEEPER = 4.0  # times the difference of values over a part of a cell, as what they count over all of it at most
_HEIGHT = 0.7  # of the planes over the body's smooth parts: its triangles then err to neither side
_WALLS_APART = 3.0  # radii at most between guessed walls, and to contacts, where these lie in no regular lines
_CLOSER = 0.65  # of the stated pitch: lines that are closer together than that count as what they are
_NO_NORMAL = 3.0  # rad, standard deviation of a normal that says nothing
_EVERY = 4  # vertices of the centres' surface share one deviation: it varies over a line pitch, not over a cell

Progress = Callable[[str, float], None]
"""Called with the stage and its share done, 0..1; may raise to interrupt."""


class ContactSurface:
    """Closed surface from contacts with normals, the sphere's radius, its free path and the table.

    The field of the centres is a blend of local Gaussian processes on values and gradients (see `HermiteField`);
    where no contact is near, walls are put between touched and free space (see `evidence`). `unreachable` of the
    result is a mask (n,) over the mesh's vertices: parts that no sphere of this size can touch, or that lie under
    its lowest height. They close the mesh and are not claimed as surface.

    Where held-out contacts show that the object is smooth, the mesh is moved onto the field on the object itself
    (`smooth` in the report, see `settling`). Where all that was touched is convex, nothing is beyond its tangent planes
    (`convex` in the report, see `convexity`).

    Where the contacts lie off this surface and `convex_hull` or `hermite_rbf` predicts held-out contacts better, the
    result is that method's: its report names it, and says why under `instead_of_contact_surface`.
    """

    @dataclass(slots=True, frozen=True)
    class Config:
        """Options.

        Attributes
        ----------
        pitch : m, distance between the scan's lines; None takes the record's, or less where the contacts lie closer, or
            estimates it from the contacts
        step : m, edge of the grid's cells; None takes 0.4 radii. Less where a wall is thinner, more where the object is
            so large that the grid would have more than 3 000 000 nodes
        compare : take another method's mesh where contacts lie off this one's and it predicts held-out contacts better
        """

        pitch: float | None = None
        step: float | None = None
        compare: bool = True

        def __post_init__(self) -> None:
            for name in ("pitch", "step"):
                value = getattr(self, name)
                if value is not None and not (np.isfinite(value) and value >= _LEAST):
                    raise InputError(name, value, f"a length of at least {_LEAST:g} m, or None")

    contract: ClassVar[int] = RECONSTRUCTOR_CONTRACT

    def __init__(self, config: Config | None = None, progress: Progress | None = None) -> None:
        self.config = config or self.Config()
        self.progress = progress

    def reconstruct(self, record: TouchRecord) -> Reconstruction:
        """Raises InputError for contacts that span no solid or have no normals."""
        begin = time.perf_counter()
        found = self._own(record)
        if self.config.pitch is None and record.pitch is not None:
            apart = lines_apart(found.mesh, record.points)
            if apart < _CLOSER * found.report["pitch"]:
                record = replace(record, pitch=apart)
                found = self._own(record)
        if not self.config.compare:
            return found
        pitch = found.report["pitch"]
        others = {
            "convex_hull": ConvexHull().reconstruct,
            "hermite_rbf": HermiteRbf(HermiteRbf.Config(pitch=pitch)).reconstruct,
        }
        better = better_method(record, found, self._own, others, pitch)
        if better is None:
            return found
        seconds = time.perf_counter() - begin
        without = found.report["without"]  # what the data lacks decided which methods could be compared
        better.surface.report |= {"seconds": seconds, "without": without, "instead_of_contact_surface": better.why}
        return better.surface

    def _own(self, record: TouchRecord) -> Reconstruction:
        work = _Work(self.config, self.progress or (lambda stage, share: None))
        touches = work.run("prepare", lambda: prepare(record, 0.5 * (self.config.step or 0.004)))
        pitch = self.config.pitch or record.pitch or line_pitch(touches.centres, record.resolution)
        pitch = max(pitch, touches.radius)
        given = len(touches.points)
        touches = _without_lone_undersides(touches)
        lines = not len(touches.visited) or regular_lines(touches.centres, pitch)
        clusters = work.run("cluster", lambda: work.cluster(touches, pitch / 3.0 if lines else 0.0))
        touches, clusters = _consistent(touches, clusters, pitch)
        grid = work.grid(touches, clusters, pitch)
        # Strokes that go where they teach most may end on the arc of the sphere's radius around an edge: a few radii
        # farther a wide field still goes on in that bend, into space that the sphere passed.
        apart = pitch if lines else min(pitch, _WALLS_APART * touches.radius)
        settings = WallSettings(pitch, touches.radius, touches.lowest, touches.noise, apart)
        touched = HermiteField(_hermite_data(clusters, touches), 2.0 * pitch)
        below = work.run("undersides", lambda: find_undersides(touches, clusters, touched, pitch))
        fine = None if lines else fine_clusters(touches)
        upright = None if fine is None else upright_walls(fine, touches.radius)
        lower, common = work.run("lower sides", lambda: find_lower_sides(touches, clusters, apart, upright))
        lower = moved_to_field(lower, common, touched)
        evidence = work.run("evidence", lambda: _evidence(grid, touches, clusters, below, lower, pitch))
        inferred, known = below + lower, touched.data
        if fine is not None:
            known += work.run("rulings", lambda: find_rulings(touches, fine))
            known += work.run("prisms", lambda: find_prisms(touches, fine))
        known += inferred
        contacts = np.vstack([touches.centres, below.points, lower.points])
        walls = work.run("walls", lambda: find_walls(evidence, HermiteField(known, 2.0 * pitch), contacts, settings))
        process = HermiteField(known + walls.data, 2.0 * pitch)
        outer = work.run("field", lambda: _outer_field(evidence, process, lower, touches, pitch))
        bound = work.run("convexity", lambda: tangent_bound(touches, clusters, pitch, grid, outer))
        if bound is not None:
            np.maximum(outer, bound, out=outer)
        hull = work.run("contour", lambda: contour(outer, grid))
        body = work.run("shrink", lambda: _Shrunk(hull, outer, grid, touches))
        work.run("inner edges", lambda: body.sharpen(clusters, pitch))
        smooth = lines and work.run("smooth", lambda: predicted_better(touches, pitch))
        if smooth:
            body.mesh = work.run("settle", lambda: settled(body.mesh, process, touches, pitch, body.floor))
        common = np.concatenate([np.zeros(len(below.points)), common, walls.deviation])
        mesh, unreachable = work.run(
            "uncertainty", lambda: _judge(body, hull, process, inferred, common, touches, apart)
        )
        report = work.report(given, touches, pitch, grid, clusters, walls, unreachable) | {
            "smooth": smooth,
            "convex": bound is not None,
        }
        return Reconstruction(mesh, report, unreachable)


@dataclass(slots=True)
class _Work:
    """Stages with their times, for the report and the progress callback."""

    config: ContactSurface.Config
    progress: Progress
    begin: float = field(default_factory=time.perf_counter)
    stages: dict[str, float] = field(default_factory=dict)

    def run(self, stage: str, call: Callable[[], Any]) -> Any:
        self.progress(stage, 0.0)
        begin = time.perf_counter()
        result = call()
        self.stages[stage] = time.perf_counter() - begin
        self.progress(stage, 1.0)
        return result

    def cluster(self, touches: Touches, size: float) -> Clusters:
        size = max(size, 0.6 * touches.radius)
        return cluster(
            touches.centres, touches.normals, touches.confidence, size, lambda share: self.progress("cluster", share)
        )

    def grid(self, touches: Touches, clusters: Clusters, pitch: float) -> Grid:
        feet = clusters.points - touches.radius * clusters.normals
        # A node within each wall, as far as walls are thicker than what is known of them.
        thin = max(thinnest_wall(clusters, feet, 0.5 * pitch), 2.0 * touches.noise)
        step = min(self.config.step or 0.4 * touches.radius, thin)
        lower, upper = clusters.points.min(axis=0) - 1.1 * pitch, clusters.points.max(axis=0) + 1.1 * pitch
        if touches.table is not None:
            lower[2] = touches.table - touches.radius
        step = affordable(lower, upper, step)
        lower, upper = lower - 3.0 * step, upper + 3.0 * step
        if touches.table is not None:  # the table's plane half way between two layers of nodes
            lower[2] = touches.table - (np.ceil((touches.table - lower[2]) / step) + 0.5) * step
        return Grid.around(lower, upper, step)

    def report(
        self,
        given: int,
        touches: Touches,
        pitch: float,
        grid: Grid,
        clusters: Clusters,
        walls: Walls,
        unreachable: np.ndarray,
    ) -> dict[str, Any]:
        return {
            "method": "contact_surface",
            "seconds": time.perf_counter() - self.begin,
            "watertight": True,
            "without": touches.without,
            "contacts": len(touches.points),
            "left_out": given - len(touches.points),
            "points_used": len(clusters.points),
            "walls_inferred": len(walls),
            "pitch": pitch,
            "step": grid.step,
            "unreachable_share": float(np.mean(unreachable)),
            "stages": self.stages,
        }


def _without_lone_undersides(touches: Touches) -> Touches:
    """Without contacts from below that no neighbour shares: the stick touched, or the normal is wrong."""
    height = touches.normals[:, 2]
    down, alike = height < _FROM_BELOW, height < _LEANS
    good = ~down | supported(down, alike, touches.points, touches.normals, touches.confidence, touches.radius)
    return _chosen(touches, good)


def _chosen(touches: Touches, rows: np.ndarray) -> Touches:
    return replace(
        touches, points=touches.points[rows], normals=touches.normals[rows], confidence=touches.confidence[rows]
    )


def _consistent(touches: Touches, clusters: Clusters, pitch: float) -> tuple[Touches, Clusters]:
    """Without contacts whose normals contradict all that was touched around them: one would open a hole."""
    feet = clusters.points - touches.radius * clusters.normals
    good = ~outvoted(clusters, feet, 1.1 * pitch)
    if good.all():
        return touches, clusters
    kept = good[clusters.label]
    number = np.cumsum(good) - 1
    return (
        _chosen(touches, kept),
        Clusters(clusters.points[good], clusters.normals[good], clusters.weight[good], number[clusters.label[kept]]),
    )


def _evidence(
    grid: Grid, touches: Touches, clusters: Clusters, below: HermiteData, lower: HermiteData, pitch: float
) -> Evidence:
    touching = np.vstack([touches.centres, lower.points[lower.normals[:, 2] > LEANING]])
    visited = np.vstack([touching, touches.visited, _ring(touches, pitch, grid.step)])
    stood = _stood(visited, touches.leaning)
    stood[len(touches.centres) : len(touching)] = False  # no stick has been where a side is carried on
    inferred = below + lower
    points = np.vstack([touches.points, inferred.points - touches.radius * inferred.normals])
    normals = np.vstack([clusters.normals[clusters.label], inferred.normals])  # a single one is too noisy to lean by
    return gather(grid, points, normals, visited, stood, len(touching), touches.radius)


def _stood(visited: np.ndarray, leaning: np.ndarray) -> np.ndarray:
    """(k,) bool: at which places (k, 3) the stick was upright, by those (l, 3) at which it was `leaning`."""
    from scipy.spatial import cKDTree

    if not len(leaning):
        return np.ones(len(visited), dtype=bool)
    return np.asarray(cKDTree(leaning).query(visited)[0] > _AS_LEANING)


def _ring(touches: Touches, pitch: float, step: float) -> np.ndarray:
    """Where nobody has been: the centre is taken to pass freely one pitch around and above the outermost contacts."""
    lower, upper = touches.centres.min(axis=0) - pitch, touches.centres.max(axis=0) + pitch
    x, y = (np.arange(lower[m], upper[m] + step, step) for m in (0, 1))
    roof = np.stack(np.meshgrid(x, y, [upper[2]], indexing="ij"), axis=-1).reshape(-1, 3)
    z = touches.lowest if touches.table is not None else lower[2]
    sides = [np.column_stack([x, np.full(len(x), edge), np.full(len(x), z)]) for edge in (lower[1], upper[1])]
    sides += [np.column_stack([np.full(len(y), edge), y, np.full(len(y), z)]) for edge in (lower[0], upper[0])]
    return np.vstack([roof, *sides])


def _hermite_data(clusters: Clusters, touches: Touches) -> HermiteData:
    share = 1.0 / np.sqrt(clusters.weight)
    normal_sd = touches.normal_noise * np.hypot(share, 0.3)
    normal_sd[wedged(clusters, 2.0 * touches.radius)] = _NO_NORMAL
    return HermiteData(clusters.points, clusters.normals, np.hypot(touches.noise * share, _NOISE_FLOOR), normal_sd)


def _outer_field(
    evidence: Evidence, process: HermiteField, lower: HermiteData, touches: Touches, pitch: float
) -> np.ndarray:
    """Signed field of the centres' surface: the process near data, the evidence's bound elsewhere."""
    grid = evidence.grid
    data = process.data
    nearest = grid.nearest(data.points, _NEAR_OVERHANG * pitch)
    near = (grid.nearest(data.points, _NEAR * pitch) >= 0) | (data.normals[nearest, 2] < LEANING) & (nearest >= 0)
    near |= (nearest >= 0) & (grid.nearest(lower.points, _NEAR_OVERHANG * pitch) >= 0)
    source, values = nearest[near], evidence.bound.copy()
    # Away from the surface only the sign counts. The nearest tangent plane has it, unless it is that of a slot's other
    # side: for that one what is solid here is free.
    offset = grid.origin + grid.step * np.argwhere(near) - data.points[source]
    values[near] = np.einsum("ij,ij->i", offset, data.normals[source])
    near &= (np.abs(values) < max(_BAND * pitch, 2.0 * grid.step)) | (values * evidence.bound < 0.0)
    first = int(np.ceil((touches.lowest - grid.origin[2]) / grid.step)) if touches.table is not None else 0
    overhung = grid.nearest(data.points[data.normals[:, 2] < LEANING], _NEAR * pitch) >= 0
    near[:, :, :first] &= overhung[:, :, :first]
    found = process.values(grid, near)
    values = np.where(np.isfinite(found), found, values)
    if first > 0:
        beneath = _below(process, near, values, first, grid, touches.lowest)
        values[:, :, :first] = np.where(overhung[:, :, :first], values[:, :, :first], beneath)
    for axis in range(3):
        edge: list[slice | int] = [slice(None)] * 3
        for end in (0, -1):
            edge[axis] = end
            values[tuple(edge)] = np.maximum(values[tuple(edge)], grid.step)
    _fill_hollows(values, grid, touches.visited, first)
    return values


def _fill_hollows(values: np.ndarray, grid: Grid, visited: np.ndarray, first: int) -> None:
    """Hollows that no way leads into above the `first` layer come from contradictory data, not from an object.

    `visited` (k, 3) m are places where the sphere was.
    """
    from scipy.ndimage import label

    upper = values[:, :, first:]
    parts, count = label(upper >= 0.0)
    open_ = np.zeros(count + 1, dtype=bool)
    for side in (parts[0], parts[-1], parts[:, 0], parts[:, -1], parts[:, :, -1]):
        open_[side] = True
    at = np.round((visited - grid.origin) / grid.step).astype(int) - [0, 0, first]
    inside = ((at >= 0) & (at < upper.shape)).all(axis=1)
    open_[parts[tuple(at[inside].T)]] = True
    hollow = ~open_[parts] & (parts > 0)
    upper[hollow] = -np.maximum(upper[hollow], grid.step)
    values[hollow[:, :, 0], 1:first] = -grid.step


def _below(
    process: HermiteField, near: np.ndarray, values: np.ndarray, first: int, grid: Grid, lowest: float
) -> np.ndarray:
    """Values (nx, ny, first) m below the `first` layer of nodes that is not lower than the sphere's `lowest` height.

    Walls go straight down to the table and through it, from that height: what lies only a little higher may be below
    the first layer. There the values lead through it at its height.
    """
    over = values[:, :, first : first + 1]
    found = process.values(
        Grid(np.array([*grid.origin[:2], lowest]), grid.step, over.shape), near[:, :, first : first + 1]
    )
    down = np.where(np.isfinite(found), found, over)
    below = np.repeat(down, first, axis=2)
    steeper = min(grid.step / max(grid.origin[2] + grid.step * first - lowest, 1e-9), _STEEPER)
    below[:, :, -1:] = np.where(down * over < 0.0, over + steeper * (down - over), down)
    return below


class _Shrunk:
    """The surface one sphere radius inside the centres' surface, cut by the table."""

    def __init__(self, hull: TriangleMesh, outer: np.ndarray, grid: Grid, touches: Touches) -> None:
        from scipy.spatial import cKDTree

        self.grid, self.radius = grid, touches.radius
        self.floor = -np.inf if touches.table is None else touches.table
        starts, members = np.zeros(len(hull.vertices) + 1, dtype=np.int64), np.empty(hull.faces.size, dtype=np.int64)
        corner_lists(hull.faces, starts, members)
        self.hull = Mesh(hull.vertices, hull.faces, starts, members)
        nearest = grid.nearest(hull.vertices, touches.radius + 2.0 * grid.step)
        self.nodes = Nodes(nearest, grid.origin, grid.step)
        self.values = np.empty(grid.shape)
        erode(self.hull, self.nodes, self.radius, grid.step, outer, self.values)
        if touches.table is not None:
            heights = grid.origin[2] + grid.step * np.arange(grid.shape[2])
            np.maximum(self.values, touches.table - heights, out=self.values)
        self._drop_untouched(touches)
        self.mesh = contour(self.values, grid, self._crossings, _HEIGHT)

        _, self.nearest = cKDTree(hull.vertices).query(self.mesh.vertices)
        self.feet, self.crowd = np.empty_like(self.mesh.vertices), np.full(len(self.mesh.vertices), np.inf)
        feet_of(self.mesh.vertices, self.hull, self.nearest, self.feet)
        crowding(self.mesh.vertices, self.mesh.faces, self.feet, self.crowd)

    def sharpen(self, clusters: Clusters, pitch: float) -> None:
        """Let the faces beside inner edges go on until they meet, down to the table."""
        vertices, arcs = self.mesh.vertices.copy(), (self.crowd < CROWDED) & (self.mesh.vertices[:, 2] > self.floor)
        vertices[arcs] = meet(vertices[arcs], self.feet[arcs], clusters, self.radius, pitch)
        np.maximum(vertices[:, 2], self.floor, out=vertices[:, 2], where=arcs)
        self.mesh = TriangleMesh(vertices, self.mesh.faces)

    def _drop_untouched(self, touches: Touches) -> None:
        """Islands that no contact lies on come from contradictory data, not from an object.

        What stands on a table reaches down to the lowest places that were touched: a part that floats above those with
        few contacts on it comes from wrong ones.
        """
        from scipy.ndimage import label

        parts, count = label(self.values < 0.0)
        if count <= 1:
            return
        nearest = self.grid.nearest(touches.points, 1.8 * self.grid.step)
        near = nearest >= 0
        witnesses = np.bincount(np.unique([parts[near], nearest[near]], axis=1)[0], minlength=count + 1)
        touched = witnesses > 0
        if touches.table is not None:
            heights = self.grid.origin[2] + self.grid.step * np.arange(self.grid.shape[2])
            low = parts[..., heights <= touches.lowest + self.grid.step]
            stands = np.bincount(low.ravel(), minlength=count + 1) > 0
            touched &= stands | (witnesses >= _WITNESSES)
        self.values[~touched[parts] & (parts > 0)] = self.grid.step

    def _crossings(self, edges: np.ndarray, positions: np.ndarray, normals: np.ndarray) -> None:
        eroded_crossings(self.hull, self.nodes, self.radius, self.floor, self.values, edges, positions, normals)


def _judge(
    body: _Shrunk,
    hull: TriangleMesh,
    process: HermiteField,
    inferred: HermiteData,
    common: np.ndarray,
    touches: Touches,
    between: float,
) -> tuple[TriangleMesh, np.ndarray]:
    """Expected error of each vertex, and which vertices no sphere of this size could have touched.

    `common` (m,) m is the deviation of the last m places of the process that they have in common with their neighbours:
    those that are `inferred`, and the walls. Touches are taken to lie up to `between` m apart.
    """
    from scipy.spatial import cKDTree

    vertices, foot = body.mesh.vertices, body.nearest
    sample = hull.vertices[::_EVERY]
    deviation = process.deviations(sample)[cKDTree(sample).query(hull.vertices)[1]]
    touched = len(process.data.points) - len(common)
    common = np.concatenate([np.zeros(touched), common])
    apart, source = cKDTree(process.data.points).query(hull.vertices)
    deviation = np.hypot(deviation, common[source])[foot]
    # A concave arc of radius R has its feet closer together by (R - r) / R: in an inner edge they coincide.
    fillet = body.crowd < _CROWDED
    low = np.zeros(len(vertices), dtype=bool) if touches.table is None else vertices[:, 2] < touches.lowest - 1e-9
    guessed = np.zeros(len(process.data.points), dtype=bool)
    guessed[touched : touched + len(inferred.points)] = True
    # Between two lines no place is farther than half a pitch from one; under data that lean down the surface is led on.
    led_on = (process.data.normals[source, 2] < LEANING) & (apart > 0.25 * process.reach)
    unreachable = fillet | low | (guessed[source] | led_on)[foot]
    # In an inner edge of 90 degrees the real surface lies up to (sqrt 2 - 1) radii behind the sphere's arc.
    hidden = np.where(unreachable, 0.4 * touches.radius, 0.0)
    # Places that are inferred agree with each other, so that the process is too sure of what lies between them. Only
    # walls are bounded from both sides, by what is solid and what is free; lower than anything that was touched, it is
    # a guess that something is solid.
    contacts = process.data.points[:touched]
    away, below = cKDTree(contacts).query(hull.vertices)[0], contacts[:, 2].min() - hull.vertices[:, 2]
    bounded = source >= touched + len(inferred.points)
    guess = _GUESS * np.maximum(np.where(bounded, below, away) - 0.5 * between, 0.0)[foot]
    error = np.hypot(np.sqrt(2.0 / np.pi) * np.hypot(deviation, hidden), guess)
    return TriangleMesh(vertices, body.mesh.faces, error), unreachable
