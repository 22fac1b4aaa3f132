"""The edges and corners of a solid, found once when it is made.

Each pair of surfaces that can meet gives a line, a circle or a general curve. Where another surface crosses it the
curve is cut. Membership tests around the middle of each piece decide whether it is a convex edge of the solid, a
concave one, or none. Free ends of edges are the corners.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lwrprobe.scene import program
from lwrprobe.scene.csg import Group, Surface
from lwrprobe.scene.edge_kernels import curve_tangent, edge_sectors, follow_curve, onto_curve
from lwrprobe.scene.surface_kernels import on_patch, surface_values

_REACH, _SKIN = 1e-6, 1e-8  # m, where membership is asked around an edge
_SHORTEST = 1e-7  # m, stretches below it are rounding
_STEP = 0.0005  # m, between points of a general curve
_TOGETHER = 16  # pieces of a general curve behind one ball
_SAME = 1e-7  # m, corners closer than this are one
_LEDGE = 2e-6  # m, by which faces may stand out that are meant to be flush: places are often rounded to a micrometre


@dataclass(slots=True)
class Chain:
    """One edge, or the consecutive pieces of one general curve."""

    kind: int
    surfaces: tuple[int, int]
    signs: tuple[float, float]
    convex: bool
    rows: np.ndarray
    ends: list[np.ndarray]
    """Free ends; none for a closed curve."""
    middle: np.ndarray
    ball: np.ndarray
    """Centre (3) and radius of a ball that holds it."""

    def pieces(self) -> list[Chain]:
        """The chain cut into short ones, so that a ball around each tells most of them apart from what is near."""
        if len(self.rows) <= _TOGETHER:
            return [self]
        cut = [self.rows[n : n + _TOGETHER] for n in range(0, len(self.rows), _TOGETHER)]
        return [replace(self, rows=rows, ends=[], ball=_ball_of_pieces(rows)) for rows in cut]


@dataclass(slots=True)
class Curve:
    """A curve over a parameter: `point(t)` (n, 3) at t (n,), where `breaks` are parameters at which it is cut."""

    kind: int
    point: Callable[[np.ndarray], np.ndarray]
    samples: np.ndarray
    closed: bool
    rows: Callable[[float, float], np.ndarray]


class Tracer:
    """Finds the edges of the solid whose surfaces and steps are packed in `numbers`, `indices`."""

    def __init__(
        self, surfaces: list[Surface], groups: list[Group], lower: np.ndarray, upper: np.ndarray,
        numbers: np.ndarray, indices: np.ndarray,
    ) -> None:  # fmt: skip
        self.surfaces, self.groups = surfaces, groups
        self.lower, self.upper = lower, upper
        self.numbers, self.indices = numbers, indices

    def chains(self) -> list[Chain]:
        """All edges, each once."""
        found: dict[tuple, Chain] = {}
        for g, first in enumerate(self.groups):
            for second in self.groups[g:]:
                box = self._common(first, second)
                if box is None:
                    continue
                for i, j in _pairs(first, second):
                    for curve in self._curves(i, j, box):
                        for chain in self._stretches(curve, i, j, box):
                            found.setdefault(_signature(chain), chain)
        return list(found.values())

    def _common(self, first: Group, second: Group) -> np.ndarray | None:
        margin = 1e-6
        lower = np.max([first.lower, second.lower, self.lower], axis=0) - margin
        upper = np.min([first.upper, second.upper, self.upper], axis=0) + margin
        return np.array([lower, upper]) if (lower < upper).all() else None

    def _curves(self, i: int, j: int, box: np.ndarray) -> list[Curve]:
        a, b = sorted((self.surfaces[i], self.surfaces[j]), key=lambda s: s.kind)
        kinds = a.kind, b.kind
        if kinds == (program.PLANE, program.PLANE):
            return _plane_plane(a, b, box)
        if kinds == (program.PLANE, program.CYLINDER):
            slope = abs(a.u @ b.u)
            if slope > 1.0 - 1e-12:
                height = (a.a - b.a) @ b.u
                return [_circle(b.a + height * b.u, b.u, b.r)]
            if slope < 1e-12:
                return _plane_along_cylinder(a, b, box)
        if kinds == (program.CYLINDER, program.CYLINDER) and np.linalg.norm(np.cross(a.u, b.u)) < 1e-12:
            return _cylinders_side_by_side(a, b, box)
        if kinds == (program.PLANE, program.SPHERE):
            height = (a.a - b.a) @ a.u
            return _small_circle(b.a, a.u, height, b.r)
        if kinds == (program.SPHERE, program.SPHERE):
            return _sphere_sphere(a, b)
        return self._general(i, j, box)

    def _general(self, i: int, j: int, box: np.ndarray) -> list[Curve]:
        """Curves of any two surfaces: followed in both directions from wherever a net on one crosses the other."""
        if self.surfaces[i].kind > self.surfaces[j].kind:
            i, j = j, i
        seeds = self._seeds(i, j, box)
        curves = []
        while len(seeds):
            points, closed = self._follow(i, j, seeds[0], box)
            if len(points) > 2:
                curves.append(self._polyline(i, j, points, closed))
            gap = np.linalg.norm(seeds[:, None, :] - points[None, :, :], axis=2).min(axis=1)
            gap[0] = 0.0
            seeds = seeds[gap > _STEP]
        return curves

    def _follow(self, i: int, j: int, seed: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, bool]:
        buffer = np.empty((20_000, 3))
        count, closed = follow_curve(self.numbers, i, j, seed, _STEP, box, buffer)
        forth = buffer[:count].copy()
        if closed:
            return forth, True
        count, _ = follow_curve(self.numbers, i, j, seed, -_STEP, box, buffer)
        return np.concatenate([buffer[1:count][::-1], forth]), False

    def _seeds(self, i: int, j: int, box: np.ndarray) -> np.ndarray:
        net = _net(self.surfaces[i], box)
        flat = np.empty(len(net.reshape(-1, 3)))
        surface_values(self.numbers, j, net.reshape(-1, 3), flat)
        values = flat.reshape(net.shape[:2])
        seeds = []
        for axis in (0, 1):
            a, b = np.roll(values, -1, axis), values
            p, q = np.roll(net, -1, axis), net
            cross = (a <= 0.0) != (b <= 0.0)
            last: list[slice | int] = [slice(None), slice(None)]
            last[axis] = -1
            cross[tuple(last)] = False
            share = (b[cross] / (b[cross] - a[cross]))[:, None]
            seeds.append((1.0 - share) * q[cross] + share * p[cross])
        exact = []
        for seed in np.concatenate(seeds):
            *point, good = onto_curve(self.numbers, i, j, *seed)
            if good and (point >= box[0]).all() and (point <= box[1]).all():
                exact.append(point)
        return np.array(exact).reshape(-1, 3)

    def _polyline(self, i: int, j: int, points: np.ndarray, closed: bool) -> Curve:
        if closed:
            points = np.concatenate([points, points[:1]])

        def point(t: np.ndarray) -> np.ndarray:
            t = np.clip(np.atleast_1d(t), 0.0, len(points) - 1.0)
            k = np.minimum(t.astype(int), len(points) - 2)
            share = (t - k)[:, None]
            chord = (1.0 - share) * points[k] + share * points[k + 1]
            return np.array([onto_curve(self.numbers, i, j, *p)[:3] for p in chord])

        def rows(begin: float, end: float) -> np.ndarray:
            inner = np.arange(np.floor(begin) + 1, np.ceil(end))
            inner = inner[(inner > begin + 1e-3) & (inner < end - 1e-3)]
            p = point(np.concatenate([[begin], inner, [end]]))
            t = np.array([curve_tangent(self.numbers, i, j, *q) for q in p])
            chords = np.diff(p, axis=0)
            along = np.sign(np.einsum("ij,ij->i", t[:-1], chords))[:, None]
            along_end = np.sign(np.einsum("ij,ij->i", t[1:], chords))[:, None]
            return np.hstack([p[:-1], p[1:], along * t[:-1], along_end * t[1:]])

        return Curve(program.CURVE, point, np.arange(len(points), dtype=np.float64), closed, rows)

    def _stretches(self, curve: Curve, i: int, j: int, box: np.ndarray) -> list[Chain]:
        cuts, seam_is_cut = self._cuts(curve, i, j, box)
        if curve.closed and len(cuts) > 2 and not seam_is_cut:
            # The seam is no corner: begin at a true cut and run round once.
            period = curve.samples[-1] - curve.samples[0]
            cuts = np.concatenate([cuts[1:-1], cuts[1:2] + period])
        marks: list[tuple[float, float, tuple]] = []
        for begin, end in pairwise(cuts):
            # A stretch not much longer than a ledge is one, beyond the end of an edge.
            long = np.linalg.norm(self._at(curve, end) - self._at(curve, begin)) > 10.0 * _LEDGE
            kinds = self._judge(self._at(curve, 0.5 * (begin + end)), i, j, _LEDGE if long else _SAME)
            for kind in kinds:
                joined = next((m for m in marks if m[1] == begin and m[2] == kind), None)
                if joined:
                    marks.remove(joined)
                    begin = joined[0]
                marks.append((begin, end, kind))
        return [chain for begin, end, kind in marks for chain in self._chain(curve, i, j, begin, end, kind)]

    def _at(self, curve: Curve, t: float) -> np.ndarray:
        period = curve.samples[-1] - curve.samples[0]
        if curve.closed and t > curve.samples[-1]:
            t -= period
        return curve.point(np.array([t]))[0]

    def _cuts(self, curve: Curve, i: int, j: int, box: np.ndarray) -> tuple[np.ndarray, bool]:
        """Parameters at which any other surface crosses the curve, with both ends; whether one crosses at the ends."""
        samples = curve.samples
        points = curve.point(samples)
        cuts: list[float] = []
        values = np.empty(len(samples))
        spacing = np.linalg.norm(np.diff(points[:2], axis=0)) / (samples[1] - samples[0])
        seam_is_cut = False
        for group in self.groups:
            if (group.lower > box[1]).any() or (group.upper < box[0]).any():
                continue
            for k in range(group.first, group.last):
                if k in (i, j):
                    continue
                surface_values(self.numbers, k, points, values)
                inside = values <= 0.0
                crossed = np.flatnonzero(inside[:-1] != inside[1:])
                new = [self._crossing(curve, k, *samples[n : n + 2], *values[n : n + 2]) for n in crossed]
                own = [t for t in new if spacing * min(t - samples[0], samples[-1] - t) > _SHORTEST]
                # A closed curve goes in as often as out: at the seam rounding decides whether a sign changes.
                seam_is_cut |= len(own) < len(new) or len(own) % 2 == 1
                cuts += own
        sorted_cuts = np.sort([samples[0], *cuts, samples[-1]])
        keep = np.concatenate([[True], np.diff(sorted_cuts) * spacing > _SHORTEST])
        keep[-1] = True
        return sorted_cuts[keep], seam_is_cut

    def _crossing(self, curve: Curve, k: int, low: float, high: float, at_low: float, at_high: float) -> float:
        """Where surface k's value passes zero, by the false position with halved weights (Illinois)."""
        value = np.empty(1)
        for _ in range(60):
            middle = (low * at_high - high * at_low) / (at_high - at_low)
            surface_values(self.numbers, k, curve.point(np.array([middle])), value)
            if abs(value[0]) < 1e-14 or not low < middle < high:
                return middle
            if (value[0] <= 0.0) == (at_high <= 0.0):
                high, at_high, at_low = middle, value[0], 0.5 * at_low
            else:
                low, at_low, at_high = middle, value[0], 0.5 * at_high
        return 0.5 * (low + high)

    def _judge(self, point: np.ndarray, i: int, j: int, slack: float) -> list[tuple]:
        x, y, z = point
        if not all(on_patch(self.numbers, k, x, y, z, slack) for k in (i, j)):
            return []
        out = np.empty((4, 3))
        count = edge_sectors(self.numbers, self.indices, i, j, point, _REACH, _SKIN, out)
        return [(row[0], row[1], bool(row[2])) for row in out[:count]]

    def _chain(self, curve: Curve, i: int, j: int, begin: float, end: float, kind: tuple) -> list[Chain]:
        period = curve.samples[-1] - curve.samples[0]
        whole = curve.closed and end - begin > period * (1.0 - 1e-9)
        stretches = [(begin, end)]
        if curve.kind == program.CURVE and end > curve.samples[-1] + 1e-9:
            stretches = [(begin, curve.samples[-1]), (curve.samples[0], end - period)]
        rows = np.concatenate([curve.rows(b, e) for b, e in stretches])
        ends = [] if whole else [self._at(curve, begin), self._at(curve, end)]
        track = np.array(
            [self._at(curve, t) for t in np.linspace(begin, end, 9 if curve.kind != program.CURVE else 65)]
        )
        return [
            Chain(curve.kind, (i, j), kind[:2], kind[2], rows, ends, track[len(track) // 2], _ball(curve, rows, track))
        ]


def corners(chains: list[Chain]) -> np.ndarray:
    """(n, 3) free ends of all edges, each once."""
    unique: list[np.ndarray] = []
    for end in (end for chain in chains for end in chain.ends):
        if not unique or np.linalg.norm(np.array(unique) - end, axis=1).min() > _SAME:
            unique.append(end)
    return np.array(unique).reshape(-1, 3)


def _pairs(first: Group, second: Group) -> list[tuple[int, int]]:
    if first is second:
        return [(i, j) for i in range(first.first, first.last) for j in range(i + 1, first.last)]
    return [(i, j) for i in range(first.first, first.last) for j in range(second.first, second.last)]


def _signature(chain: Chain) -> tuple:
    """Equal for the same edge found through different but coincident surfaces."""
    ends = sorted(tuple(np.round(end, 7).tolist()) for end in chain.ends)
    return (chain.kind, chain.convex, *ends, *np.round(chain.ball, 7).tolist(), *np.round(chain.middle, 7).tolist())


def _ball(curve: Curve, rows: np.ndarray, track: np.ndarray) -> np.ndarray:
    if curve.kind == program.ARC:
        return np.array([*rows[0, :3], rows[0, 9] * (1.0 + 1e-9)])
    return _ball_of_pieces(rows) if curve.kind == program.CURVE else _ball_around(track, 1e-9)


def _ball_of_pieces(rows: np.ndarray) -> np.ndarray:
    return _ball_around(np.concatenate([rows[:, :3], rows[:, 3:6]]), _STEP)


def _ball_around(points: np.ndarray, margin: float) -> np.ndarray:
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.array([*centre, np.linalg.norm(points - centre, axis=1).max() + margin])


def _plane_plane(a: Surface, b: Surface, box: np.ndarray) -> list[Curve]:
    direction = np.cross(a.u, b.u)
    square = direction @ direction
    if square < 1e-10:
        return []
    alpha, beta = a.a @ a.u, b.a @ b.u
    origin = (alpha * np.cross(b.u, direction) + beta * np.cross(direction, a.u)) / square
    return _line(origin, direction / np.sqrt(square), box)


def _plane_along_cylinder(plane: Surface, cylinder: Surface, box: np.ndarray) -> list[Curve]:
    distance = (plane.a - cylinder.a) @ plane.u
    half = cylinder.r**2 - distance**2
    if half <= (1e-5 * cylinder.r) ** 2:  # touching without crossing makes no edge
        return []
    foot = cylinder.a + distance * plane.u
    across = np.cross(cylinder.u, plane.u)
    across *= np.sqrt(half) / np.linalg.norm(across)
    return [line for sign in (-1.0, 1.0) for line in _line(foot + sign * across, cylinder.u, box)]


def _cylinders_side_by_side(a: Surface, b: Surface, box: np.ndarray) -> list[Curve]:
    apart = (b.a - a.a) - ((b.a - a.a) @ a.u) * a.u
    distance = np.linalg.norm(apart)
    if distance < 1e-9:
        return []
    along = (distance**2 + a.r**2 - b.r**2) / (2.0 * distance)
    if a.r**2 - along**2 <= (1e-5 * a.r) ** 2:
        return []
    plane = Surface(program.PLANE, a.part, a.a + along * apart / distance, apart / distance)
    return _plane_along_cylinder(plane, a, box)


def _line(origin: np.ndarray, direction: np.ndarray, box: np.ndarray) -> list[Curve]:
    """The part of a line inside a box."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (box - origin) / direction
    flat = np.abs(direction) < 1e-15
    if ((origin[flat] < box[0, flat]) | (origin[flat] > box[1, flat])).any():
        return []
    begin, end = t[:, ~flat].min(axis=0).max(), t[:, ~flat].max(axis=0).min()
    if end - begin <= _SHORTEST:
        return []
    start = origin + begin * direction
    length = end - begin

    def point(s: np.ndarray) -> np.ndarray:
        return start + np.asarray(s)[:, None] * direction

    def rows(b: float, e: float) -> np.ndarray:
        return np.array([[*(start + b * direction), *direction, e - b, 0, 0, 0, 0, 0]])

    count = int(np.clip(length / 2e-4, 8, 4000))
    return [Curve(program.LINE, point, np.linspace(0.0, length, count), False, rows)]


def _circle(centre: np.ndarray, axis: np.ndarray, radius: float) -> Curve:
    e1 = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)

    def point(angle: np.ndarray) -> np.ndarray:
        angle = np.asarray(angle)[:, None]
        return centre + radius * (np.cos(angle) * e1 + np.sin(angle) * e2)

    def rows(b: float, e: float) -> np.ndarray:
        start, on = np.cos(b) * e1 + np.sin(b) * e2, np.cos(b) * e2 - np.sin(b) * e1
        return np.array([[*centre, *start, *on, radius, e - b, 0]])

    return Curve(program.ARC, point, np.linspace(0.0, 2.0 * np.pi, 721), True, rows)


def _small_circle(centre: np.ndarray, axis: np.ndarray, height: float, radius: float) -> list[Curve]:
    square = radius**2 - height**2
    if square <= (1e-5 * radius) ** 2:
        return []
    return [_circle(centre + height * axis, axis, np.sqrt(square))]


def _sphere_sphere(a: Surface, b: Surface) -> list[Curve]:
    apart = b.a - a.a
    distance = float(np.linalg.norm(apart))
    if distance < 1e-9:
        return []
    height = (distance**2 + a.r**2 - b.r**2) / (2.0 * distance)
    return _small_circle(a.a, apart / distance, height, a.r)


def _net(surface: Surface, box: np.ndarray) -> np.ndarray:
    """(m, n, 3) points about 1 mm apart on the part of a surface that lies in a box."""
    corner = np.array([[box[x, 0], box[y, 1], box[z, 2]] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    axis = surface.u if surface.u.any() else np.array([0.0, 0.0, 1.0])
    e1 = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    local = (corner - surface.a) @ np.array([e1, e2, axis]).T
    low, high = local.min(axis=0), local.max(axis=0)
    if surface.kind == program.PLANE:
        u, v = np.meshgrid(_spread(low[0], high[0]), _spread(low[1], high[1]), indexing="ij")
        return surface.a + u[..., None] * e1 + v[..., None] * e2
    turns = np.linspace(0.0, 2.0 * np.pi, int(np.clip(2000.0 * np.pi * surface.r, 64, 800)))
    if surface.kind == program.CYLINDER:
        turn, height = np.meshgrid(turns, _spread(low[2], high[2]), indexing="ij")
        across = surface.r * np.ones_like(turn)
    else:  # sphere and capsule: from pole to pole, across the axis's length in between
        tilt = np.linspace(0.0, np.pi, len(turns) // 2)
        along = _spread(0.0, surface.l) if surface.l else np.zeros(1)
        lower = int(np.count_nonzero(tilt >= np.pi / 2))
        ends = np.concatenate([np.zeros(lower), along, np.full(len(tilt) - lower, surface.l)])
        lean = np.concatenate(
            [tilt[tilt >= np.pi / 2][::-1], np.full(len(along), np.pi / 2), tilt[tilt < np.pi / 2][::-1]]
        )
        turn, height = np.meshgrid(turns, ends + surface.r * np.cos(lean), indexing="ij")
        across = np.broadcast_to(surface.r * np.sin(lean), turn.shape)
    ring = np.cos(turn)[..., None] * e1 + np.sin(turn)[..., None] * e2
    return surface.a + across[..., None] * ring + height[..., None] * axis


def _spread(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, int(np.clip((high - low) / 1e-3, 8, 600)))
