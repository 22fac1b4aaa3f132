"""Simple shapes fitted to the contacts: plane, box, cylinder, sphere, and whether the contacts warrant them.

A shape fits when its distance at each sphere centre is the sphere's radius, edges included. What no contact
determines, such as an end that lies between two lines, is bounded by what was touched and what was free, and its
uncertainty says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from lwrprobe.contracts import TouchRecord
from lwrprobe.reconstruction.touches import Touches, line_pitch, prepare

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

_SHARE = 0.97  # of the contacts that a warranted shape explains
_TURNED = np.cos(np.radians(15.0))  # normals that differ by more do not agree
_MAX_SAMPLES = 1000  # contacts used in a fit
_FLOOR = 2e-5  # m, no dimension is claimed to be known better
_LOSS_SCALE = 2.0  # standard deviations of a contact from which on it counts less

Kind = Literal["plane", "box", "cylinder", "sphere"]
Description = tuple[dict[str, float], np.ndarray, np.ndarray]
"""Dimensions m by name, position (3,) m and axis (3,)."""
Distance = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Signed distance (n,) m of points (n, 3) for a parameter vector."""
Shifts = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""For points and normals (n, 3) the shifts (n, k) m along the normals by one standard deviation of each of k numbers
that all contacts share: as they are, and after alignment."""


@dataclass(slots=True)
class Fit:
    """One shape held against the contacts.

    Attributes
    ----------
    kind : plane, box, cylinder or sphere
    dimensions : m, by name (`length`, `width`, `height`, `radius`); none for a plane
    uncertainty : m, one standard deviation of each dimension; with `shifts` what all contacts share included
    uncertainty_aligned : m, the same after the rigid motion that aligns the contacts with their true places
    position : (3,) m, centre of the shape (of a box or upright cylinder: of its base)
    axis : (3,) unit, along the length of a box, the cylinder's axis, the plane's normal; z for a sphere
    rms : m, of the contacts against the shape
    share : of the contacts that it explains in distance and normal
    warranted : the contacts support this shape and no free space contradicts it
    why_not : the reason, empty when it is warranted
    """

    kind: Kind
    dimensions: dict[str, float]
    uncertainty: dict[str, float]
    position: np.ndarray
    axis: np.ndarray
    rms: float
    share: float
    warranted: bool
    why_not: str = ""
    uncertainty_aligned: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        sizes = " x ".join(
            f"{name} {1e3 * value:.2f} ± {1e3 * self.uncertainty[name]:.2f} mm"
            for name, value in self.dimensions.items()
        )
        return f"{self.kind} {sizes}".strip() if self.warranted else f"no {self.kind}: {self.why_not}"


@dataclass(slots=True)
class _Candidate:
    kind: Kind
    start: np.ndarray
    distance: Distance
    describe: Callable[[np.ndarray], Description]
    prior: list[tuple[np.ndarray, float, float]] = field(default_factory=list)
    """Weak knowledge: (gradient over the parameters, value, standard deviation)."""


def fit(record: TouchRecord, shifts: Shifts | None = None) -> list[Fit]:
    """All shapes held against the contacts, the warranted ones first, then by the share explained.

    `shifts` says what all contacts have in common; None counts their scatter alone. Deterministic. Raises InputError
    for contacts that span no solid.
    """
    touches = prepare(record, 0.002)
    pitch = record.pitch or line_pitch(touches.centres, record.resolution)
    chosen = np.unique(np.linspace(0, len(touches.points) - 1, _MAX_SAMPLES).astype(int))
    centres, normals = touches.centres[chosen], touches.normals[chosen]
    points = centres - touches.radius * normals
    shared = shifts(points, normals) if shifts is not None else (np.empty((len(points), 0)),) * 2
    fits = [_solve(c, centres, normals, touches, shared) for c in _candidates(centres, normals, touches, pitch)]
    best: dict[Kind, Fit] = {}
    for found in fits:  # of several cylinders the better one
        if found.kind not in best or found.share > best[found.kind].share:
            best[found.kind] = found
    return sorted(best.values(), key=lambda f: (not f.warranted, -f.share))


def _candidates(centres: np.ndarray, normals: np.ndarray, touches: Touches, pitch: float) -> list[_Candidate]:
    level = normals - np.outer(normals[:, 2], [0.0, 0.0, 1.0])
    bearing = np.linalg.eigh(level.T @ level)[1][:, 2]
    bearing = np.array([bearing[0], bearing[1], 0.0]) / max(np.hypot(bearing[0], bearing[1]), 1e-12)
    return [
        _plane(centres, normals, touches.radius),
        _box(centres, normals, touches, pitch),
        _upright(centres, normals, touches),
        _lying(centres, normals, touches, bearing, pitch),
        _lying(centres, normals, touches, np.array([-bearing[1], bearing[0], 0.0]), pitch),
        _sphere(centres, normals, touches.radius),
    ]


def _solve(
    candidate: _Candidate,
    centres: np.ndarray,
    normals: np.ndarray,
    touches: Touches,
    shared: tuple[np.ndarray, np.ndarray],
) -> Fit:
    from scipy.optimize import least_squares

    spread = float(np.hypot(touches.noise, 0.5 * touches.normal_noise * touches.radius))

    def residuals(parameters: np.ndarray) -> np.ndarray:
        contact = (candidate.distance(parameters, centres) - touches.radius) / spread
        known = [(gradient @ parameters - value) / sd for gradient, value, sd in candidate.prior]
        return np.concatenate([contact, known])

    found = least_squares(residuals, candidate.start, loss="soft_l1", f_scale=_LOSS_SCALE, x_scale="jac", max_nfev=200)
    miss = candidate.distance(found.x, centres) - touches.radius
    turned = np.einsum("ij,ij->i", _gradient(candidate.distance, found.x, centres), normals)
    tolerance = max(5.0 * spread, 5e-4)
    share = float(np.mean((np.abs(miss) < tolerance) & (turned > _TURNED)))
    dimensions, position, axis = candidate.describe(found.x)
    why_not = _objection(candidate, found.x, dimensions, share, touches, tolerance)
    rms = float(np.sqrt(np.mean(miss**2)))
    deviations, aligned = (_deviations(candidate, found, dimensions, part / spread) for part in shared)
    return Fit(
        candidate.kind, dimensions, deviations, position, axis, rms, share, not why_not, why_not, aligned
    )  # fmt: skip


def _objection(
    candidate: _Candidate,
    parameters: np.ndarray,
    dimensions: dict[str, float],
    share: float,
    touches: Touches,
    tolerance: float,
) -> str:
    if any(not value > 0.0 for value in dimensions.values()):
        return "a dimension is not positive"
    if share < _SHARE:
        return f"it explains {100 * share:.0f} % of the contacts, {100 * _SHARE:.0f} % are needed"
    if len(touches.visited):
        inside = candidate.distance(parameters, touches.visited) < touches.radius - 3.0 * tolerance
        if np.mean(inside) > 0.002:
            return f"the sphere passed freely through {100 * np.mean(inside):.1f} % of its path inside it"
    return ""


def _gradient(distance: Distance, parameters: np.ndarray, points: np.ndarray) -> np.ndarray:
    step = 1e-6
    sides = [
        distance(parameters, points + step * unit) - distance(parameters, points - step * unit) for unit in np.eye(3)
    ]
    gradient = np.stack(sides, axis=1)
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def _deviations(
    candidate: _Candidate, found: OptimizeResult, dimensions: dict[str, float], shared: np.ndarray
) -> dict[str, float]:
    """One standard deviation of each dimension, from the normal equations and the scatter that was found.

    `shared` (n, k): change of the contacts' residuals by one standard deviation of each of k numbers.
    """
    contacts = len(found.fun) - len(candidate.prior)
    scatter = max(1.0, float(np.median(np.abs(found.fun[:contacts]))) / 0.6745)
    normal = found.jac.T @ found.jac
    covariance = np.linalg.pinv(normal, rcond=1e-12)
    # The solver has scaled its Jacobian by the root of the loss' second derivative; a change of residuals likewise.
    weight = (1.0 + (found.fun[:contacts] / _LOSS_SCALE) ** 2) ** -0.75
    moved = covariance @ found.jac[:contacts].T @ (weight[:, None] * shared)
    out = {}
    for name in dimensions:
        step = 1e-7
        slope = np.array([
            (candidate.describe(found.x + step * unit)[0][name] - candidate.describe(found.x - step * unit)[0][name])
            for unit in np.eye(len(found.x))
        ]) / (2.0 * step)  # fmt: skip
        own = scatter * np.sqrt(max(float(slope @ covariance @ slope), 0.0))
        out[name] = float(np.sqrt(own**2 + _FLOOR**2 + ((slope @ moved) ** 2).sum()))
    return out


def _plane(centres: np.ndarray, normals: np.ndarray, radius: float) -> _Candidate:
    facing = np.median(normals, axis=0)
    facing /= max(np.linalg.norm(facing), 1e-12)

    def unit(p: np.ndarray) -> np.ndarray:
        return p[:3] / max(np.linalg.norm(p[:3]), 1e-12)

    start = np.append(facing, np.median(centres @ facing) - radius)
    return _Candidate(
        "plane",
        start,
        lambda p, x: x @ unit(p) - p[3],
        lambda p: ({}, p[3] * unit(p), unit(p)),
        [(np.append(facing, 0.0), 1.0, 1e-3)],  # the length of the normal's parameters is of no matter
    )


def _box_distance(offset: np.ndarray, half: np.ndarray) -> np.ndarray:
    over = np.abs(offset) - half
    return np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)


def _base(touches: Touches) -> float:
    return touches.table if touches.table is not None else float(touches.points[:, 2].min())


def _box(centres: np.ndarray, normals: np.ndarray, touches: Touches, pitch: float) -> _Candidate:
    """Parameters: ends -u, +u, -v, +v and the top [m], then the bearing of u [rad]."""
    steep = np.abs(normals[:, 2]) < 0.3
    bearing = np.arctan2(normals[steep, 1], normals[steep, 0])
    # four faces a quarter turn apart: the mean of four times the bearing
    turn = np.angle(np.mean(np.exp(4j * bearing))) / 4.0 if steep.any() else 0.0
    base = _base(touches)

    def frame(p: np.ndarray) -> np.ndarray:
        c, s = np.cos(p[5]), np.sin(p[5])
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def distance(p: np.ndarray, x: np.ndarray) -> np.ndarray:
        middle = 0.5 * np.array([p[0] + p[1], p[2] + p[3], base + p[4]])
        half = 0.5 * np.array([p[1] - p[0], p[3] - p[2], p[4] - base])
        return _box_distance(x @ frame(p).T - middle, half)

    def describe(p: np.ndarray) -> Description:
        sizes = {"length": p[1] - p[0], "width": p[3] - p[2], "height": p[4] - base}
        middle = frame(p).T @ np.array([0.5 * (p[0] + p[1]), 0.5 * (p[2] + p[3]), base])
        return sizes, middle, frame(p)[0]

    axes = frame(np.append(np.zeros(5), turn))
    ends, prior = [], []
    for i in range(4):
        sign = 1.0 if i % 2 else -1.0
        middle, sd = _end(sign * axes[i // 2], touches, pitch)
        ends.append(sign * (middle - 1.7 * sd))  # from the inner bound: further out the distance has no slope
        prior.append((sign * np.eye(6)[i], middle, sd))
    top = float((centres[:, 2] - touches.radius * normals[:, 2]).max())
    return _Candidate("box", np.array([*ends, top, turn]), distance, describe, prior)


def _end(direction: np.ndarray, touches: Touches, pitch: float) -> tuple[float, float]:
    """Where the object ends along `direction`: middle and standard deviation of what contacts and free path allow."""
    last = float(np.percentile(touches.points @ direction, 99.5))
    aside = np.array([-direction[1], direction[0], 0.0])
    lower, upper = np.percentile(touches.points @ aside, [5.0, 95.0])
    sideways = touches.visited @ aside
    free = touches.visited @ direction - touches.radius
    free = free[(free > last + 1e-4) & (sideways > lower) & (sideways < upper)]  # what passed in front of that end
    beyond = float(free.min()) if len(free) else last + max(pitch - touches.radius, 0.0)
    gap = float(np.clip(beyond - last, 1e-3, pitch))
    return last + 0.5 * gap, gap / np.sqrt(12.0)


def _meeting(centres: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The point nearest to all lines along the normals through the centres, in any dimension; robust to a few."""
    weight, point = np.ones(len(centres)), centres.mean(axis=0)
    across = np.eye(centres.shape[1]) - normals[:, :, None] * normals[:, None, :]
    for _ in range(10):
        matrix = np.einsum("i,ijk->jk", weight, across)
        right = np.einsum("i,ijk,ik->j", weight, across, centres)
        point = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
        miss = np.linalg.norm(np.einsum("ijk,ik->ij", across, centres - point), axis=1)
        weight = 1.0 / np.maximum(miss, 1e-3)
    return point


def _flat(normals: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A base (2, 3) across an axis, which normals lie across it, and those normals' directions (m, 2)."""
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    u /= np.linalg.norm(u)
    base = np.stack([u, np.cross(axis, u)])
    across = np.abs(normals @ axis) < 0.3
    flat = normals[across] @ base.T
    return base, across, flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)


def _upright(centres: np.ndarray, normals: np.ndarray, touches: Touches) -> _Candidate:
    """Parameters: x, y, radius, top."""
    base, floor = _flat(normals, np.array([0.0, 0.0, 1.0])), _base(touches)
    middle, reach = _round(centres, base, touches.radius)
    middle = middle @ base[0]
    top = float(touches.points[:, 2].max())

    def distance(p: np.ndarray, x: np.ndarray) -> np.ndarray:
        side = np.hypot(x[:, 0] - p[0], x[:, 1] - p[1])
        return _box_distance(
            np.column_stack([side, x[:, 2] - 0.5 * (floor + p[3])]), np.array([p[2], 0.5 * (p[3] - floor)])
        )

    def describe(p: np.ndarray) -> Description:
        return {"radius": p[2], "height": p[3] - floor}, np.array([p[0], p[1], floor]), np.array([0.0, 0.0, 1.0])

    return _Candidate("cylinder", np.array([middle[0], middle[1], reach, top]), distance, describe)


def _lying(centres: np.ndarray, normals: np.ndarray, touches: Touches, axis: np.ndarray, pitch: float) -> _Candidate:
    """Parameters: offset across the axis, height of the axis, radius, both ends along it, bearing of the axis."""
    across, middle, reach = _round_level(centres, normals, axis, touches.radius)
    turn = float(np.arctan2(axis[1], axis[0]))
    ends = [_end(-axis, touches, pitch), _end(axis, touches, pitch)]

    def frame(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        along = np.array([np.cos(p[5]), np.sin(p[5]), 0.0])
        return along, np.array([-along[1], along[0], 0.0])

    def distance(p: np.ndarray, x: np.ndarray) -> np.ndarray:
        along, aside = frame(p)
        side = np.hypot(x @ aside - p[0], x[:, 2] - p[1])
        return _box_distance(
            np.column_stack([side, x @ along - 0.5 * (p[3] + p[4])]), np.array([p[2], 0.5 * (p[4] - p[3])])
        )

    def describe(p: np.ndarray) -> Description:
        along, aside = frame(p)
        centre = 0.5 * (p[3] + p[4]) * along + p[0] * aside + np.array([0.0, 0.0, p[1]])
        return {"radius": p[2], "length": p[4] - p[3]}, centre, along

    inner = [end - 1.7 * sd for end, sd in ends]
    start = np.array([across, middle, reach, -inner[0], inner[1], turn])
    prior = [(-np.eye(6)[3], *ends[0]), (np.eye(6)[4], *ends[1])]
    return _Candidate("cylinder", start, distance, describe, prior)


def _round(centres: np.ndarray, flat: tuple, radius: float) -> tuple[np.ndarray, float]:
    base, across, directions = flat
    if np.count_nonzero(across) < 3:
        return (centres @ base.T).mean(axis=0), 0.5 * float(np.ptp(centres @ base.T, axis=0).max())
    points = centres[across] @ base.T
    middle = _meeting(points, directions)
    return middle, max(float(np.median(np.linalg.norm(points - middle, axis=1))) - radius, 1e-4)


def _round_level(
    centres: np.ndarray, normals: np.ndarray, axis: np.ndarray, radius: float
) -> tuple[float, float, float]:
    aside = np.array([-axis[1], axis[0], 0.0])
    flat = np.stack([aside, [0.0, 0.0, 1.0]])
    across = np.abs(normals @ axis) < 0.3
    directions = normals[across] @ flat.T
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
    middle, reach = _round(centres, (flat, across, directions), radius)
    return float(middle[0]), float(middle[1]), reach


def _sphere(centres: np.ndarray, normals: np.ndarray, radius: float) -> _Candidate:
    middle = _meeting(centres, normals)
    reach = max(float(np.median(np.linalg.norm(centres - middle, axis=1))) - radius, 1e-4)
    return _Candidate(
        "sphere",
        np.append(middle, reach),
        lambda p, x: np.linalg.norm(x - p[:3], axis=1) - p[3],
        lambda p: ({"radius": p[3]}, p[:3].copy(), np.array([0.0, 0.0, 1.0])),
    )
