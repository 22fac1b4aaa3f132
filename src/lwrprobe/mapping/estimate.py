"""An estimate of the surface on which the sphere's centre moves in contact, and of how wrong it is.

The estimate is coarse and quick. It serves to plan strokes and to decide when to stop; the mesh is made otherwise.

- A grid point takes its side, inside or outside, from the tangent plane of the nearest contact. It is outside where a
  place that the sphere passed without a contact is clearly nearer. Nothing is taken to stand at the area's sides.
  There are no closed cavities, and no pieces without a contact.
- Faces between points of different sides are the surface.
- The expected error of a face is (s + s0) (d / D)^2 + g max(d - D, 0) with d its distance to the nearest contact, at
  most D in the first term, and s the surprise about it. A difference in height counts less above one on a wall. Where
  the nearest contact is on another surface, d leads to the nearest one that faces as the face does.
- Surprise is how far new contacts were from where the contacts before them predicted the surface, by a local Gaussian
  process on values and gradients. It is brought to the distance D as the expected error grows: the sum of the errors
  of the contacts around, over the sum of their (d / D)^2, so that what was predicted from close by counts little.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from lwrprobe.contracts import Area, InputError
from lwrprobe.mapping.nearest_places import NearestPlaces

REACH = 0.015
"""m, D unless something else is wanted: beyond it a curve of a man-made object is not foreseen."""
P95 = 3.0
"""95th percentile of the expected error that is small enough, in wanted means: a half-normal error has 2.5, sharp edges
have more."""
FINEST = 0.003
"""m between grid points at least: strokes are planned in steps that are not smaller."""
MAX_POINTS = 60_000
"""Of the grid: one pass over it for the contacts of a stroke takes some ten milliseconds."""
APART = 0.002
"""m between two contacts that are kept."""
FREE_APART = 0.003
"""m between two places without a contact that are kept."""
FREE_FARTHER = 1.5
"""Times the distance to a place without a contact, up to which the nearest contact says more: the surface is where the
contact is, but only somewhere beyond that place. From 1 to 2, it leaves the fewest grid points on the wrong side."""
SMOOTH = 0.0005
"""m, s0: expected error at the distance D of a surface that has not surprised."""
FIRST = 0.003
"""m, surprise at the distance D before anything was measured."""
OLDER = 0.7
"""Weight of a surprise with each stroke that has come after it: what is known now predicts better than it did then."""
NOISE = 0.0001
"""m of a prediction's error that is no surprise: contacts themselves are that wrong."""
UNKNOWN = 0.25
"""Growth of the expected error with the distance beyond D, in m/m: nothing is known there but by extrapolation."""
EXTRUDED = 0.6
"""Weight of a difference in height above a contact of an upright wall: walls mostly go straight up. Below such a
contact it is 1: under the lowest one a wall is only extrapolated."""
WALL = 0.17
"""Share of the normal along z, up to which a wall is upright (10 degrees)."""
LEVEL = 0.97
"""Share of the normal along z, from which on a surface is level (14 degrees)."""
ROUNDED = 1.5
"""Weight of a distance from a contact that is on neither: most are on rounded edges, which do not go on far."""
FOOT = 4.0
"""Reaches, within which a wall is the one under the edge of a level surface."""
TOUCHED = 2.0
"""Cells from a grid point inside to a contact, up to which the contact is one on this piece of the object."""
ASIDE = 0.35
"""Share of the nearest contact's normal across a face, below which that contact is on another surface."""
UNTOUCHED, NONE_ALIKE = 0.8, 4.0
"""Reaches, as far as such a face is from what tells of it at least, and where no contact faces as it does."""
COARSE = 0.012
"""m, edge of the cells in which surprise is averaged; it is smoothed over neighbouring cells."""
NEAREST = 0.006
"""m: a contact that is nearer than this to an earlier one says nothing of how well the surface was predicted."""
DATA, LENGTH = 16, 0.02
"""Contacts in a local prediction, and the length [m] of its Gaussian kernel."""
DATA_APART = 0.004
"""m between the contacts of a prediction: it should see more than one stroke."""
QUERIES = 40
"""Predictions of a stroke at most: they are evenly spread over its contacts."""


@dataclass(slots=True, frozen=True, eq=False)
class Faces:
    """The estimated surface of the sphere's centres.

    Attributes
    ----------
    centres : (n, 3) m
    axes : (n,) world axis across which each face lies
    areas : (n,) m^2, as much of the surface as it stands for
    distances : (n,) m, to the nearest contact
    roughness : (n,) m, s + s0
    normals : (n, 3) unit, of the nearest contact
    reach : m, D
    """

    centres: np.ndarray
    axes: np.ndarray
    areas: np.ndarray
    distances: np.ndarray
    roughness: np.ndarray
    normals: np.ndarray
    reach: float

    def error(self, weights: np.ndarray | None = None) -> tuple[float, float]:
        """m, mean and 95th percentile of the expected error over the surface; infinite without a surface.

        With `weights` (n,), that of each face counts so much.
        """
        if not len(self.areas):
            return np.inf, np.inf
        expected = self.expected() if weights is None else weights * self.expected()
        order = np.argsort(expected)
        share = np.cumsum(self.areas[order]) / self.areas.sum()
        p95 = expected[order][min(int(np.searchsorted(share, 0.95)), len(order) - 1)]
        return float(np.average(expected, weights=self.areas)), float(p95)

    def above(self, height: float) -> Faces:
        """Those whose centres are at this height [m] or higher."""
        return self.only(self.centres[:, 2] >= height)

    def only(self, wanted: np.ndarray) -> Faces:
        """Those marked in `wanted` (n,) bool."""
        return Faces(
            self.centres[wanted],
            self.axes[wanted],
            self.areas[wanted],
            self.distances[wanted],
            self.roughness[wanted],
            self.normals[wanted],
            self.reach,
        )

    def removed(self, worth: np.ndarray, near: np.ndarray, distances: np.ndarray) -> np.ndarray:
        """What the faces `near` (n, bool) are worth less by contacts at these distances from them.

        `worth` (n,) is that of all faces now; a worth goes down as the expected error does.
        """
        before, least = self.expected()[near], np.minimum(self.distances[near], distances)
        share = np.minimum(least, self.reach) / self.reach
        left = np.divide(self.roughness[near] * share * share, before, out=np.ones_like(before), where=before > 0.0)
        return worth[near] * np.maximum(1.0 - left, 0.0)

    def expected(self, distances: np.ndarray | None = None) -> np.ndarray:
        """(n,) m, expected error; with other distances to the nearest contact where these are given."""
        distances = self.distances if distances is None else distances
        near = np.minimum(distances, self.reach) / self.reach
        return self.roughness * near * near + UNKNOWN * np.maximum(distances - self.reach, 0.0)


class SurfaceEstimate:
    """Collects contacts and free places, and estimates the surface and its error.

    Parameters
    ----------
    area : of the sphere's centre
    reach : m, D, as far as a contact says something of the surface beside it

    Raises
    ------
    InputError : for a reach that is not positive
    """

    def __init__(self, area: Area, reach: float) -> None:
        if not (np.isfinite(reach) and reach > 0.0):
            raise InputError("reach", reach, "a positive length in metres")
        self._area, self._reach = area, reach
        extent = area.upper - area.lower
        self.edge = edge = max(FINEST, float(np.cbrt(np.prod(extent) / MAX_POINTS)))
        """m between neighbouring grid points."""
        shape = tuple(np.maximum(np.ceil(extent / edge), 2).astype(np.int64))
        self._origin = 0.5 * (area.lower + area.upper - edge * (np.array(shape) - 1))
        self._touched, self._weighted, self._touched_walls, self._free = (
            NearestPlaces(self._origin, edge, shape) for _ in range(4)
        )
        self._to_sides = _to_sides(area, [low + edge * np.arange(n) for low, n in zip(self._origin, shape)])
        self._walls = np.empty(0, np.int64)  # numbers of the contacts on upright walls
        self._centres, self._normals = np.empty((0, 3)), np.empty((0, 3))
        self._surprise = np.empty((0, 2))  # see `_surprise_of`
        self._within: np.ndarray | None = None  # see `_inside`; None when not computed yet
        self._stroke = 0  # number of the first contact of the present stroke
        self._stroke_ended = False
        self._new: list[np.ndarray] = []
        self._new_normals: list[np.ndarray] = []
        self._new_free: list[np.ndarray] = []

    def __len__(self) -> int:
        """Contacts that are kept."""
        return len(self._centres) + len(self._new)

    def touch(self, centre: np.ndarray, normal: np.ndarray) -> None:
        """The sphere, with its centre at a place (3,), touches a surface with this unit normal (3,)."""
        if not self._new or np.abs(centre - self._new[-1]).max() >= APART:
            self._new.append(np.array(centre))
            self._new_normals.append(np.array(normal))

    def passed(self, centre: np.ndarray) -> None:
        """The sphere is at a place (3,) and touches nothing."""
        if not self._new_free or np.abs(centre - self._new_free[-1]).max() >= FREE_APART:
            self._new_free.append(np.array(centre))

    def update(self, stroke_ended: bool = True) -> None:
        """Take in what was noted since the last update; with it the stroke has ended, unless told otherwise.

        A stroke predicts nothing of itself.
        """
        if self._new or self._new_free:
            self._within = None
        if self._new_free:
            self._free.add(np.array(self._new_free))
            self._new_free.clear()
        if not self._new:
            self._stroke_ended |= stroke_ended
            return
        if self._stroke_ended:
            self._stroke = len(self._centres)
            self._surprise *= OLDER
        self._stroke_ended = stroke_ended
        places, normals = np.array(self._new), np.array(self._new_normals)
        surprise = self._surprise_of(places)
        weights, walls = _weights(normals), np.flatnonzero(np.abs(normals[:, 2]) < WALL)
        self._touched.add(places)
        self._weighted.add(places, weights)
        self._touched_walls.add(places[walls], weights[walls])
        self._walls = np.concatenate([self._walls, walls + len(self._centres)])
        self._centres = np.concatenate([self._centres, places])
        self._normals = np.concatenate([self._normals, normals])
        self._surprise = np.concatenate([self._surprise, surprise])
        self._new.clear()
        self._new_normals.clear()

    def faces(self) -> Faces:
        """The estimated surface as of the last update; without faces while nothing has been touched."""
        if not len(self._centres):
            empty = np.empty((0, 3))
            return Faces(empty, np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty(0), empty, self._reach)
        inside = self._inside()
        found = []
        for axis in range(3):
            # Beyond the area's sides and top is outside; the object goes on below its bottom.
            width = [(1, 1) if a == axis else (0, 0) for a in range(3)]
            padded = np.pad(inside, width)
            if axis == 2:
                padded[:, :, 0] = padded[:, :, 1]
            low = np.delete(padded, -1, axis)
            high = np.delete(padded, 0, axis)
            where = np.argwhere(low != high)
            within = where.copy()
            within[:, axis] -= low[tuple(where.T)]
            offset = np.zeros(3)
            offset[axis] = -0.5
            outwards = np.where(low[tuple(where.T)], 1.0, -1.0)
            found.append((self._origin + self.edge * (where + offset), within, np.full(len(where), axis), outwards))
        centres, within, axes, outwards = (np.concatenate(part) for part in zip(*found))
        points = tuple(within.T)
        normals = self._normals[self._weighted.owner[points]]
        distances = np.maximum(np.sqrt(self._weighted.square[points]) - 0.5 * self.edge, 0.0)
        across = np.abs(normals[np.arange(len(axes)), axes])
        # A slope has faces on each of its steps. Farther away, such a face is one of a surface that was not touched.
        untouched = (across < ASIDE) & (distances > 2.0 * self.edge)
        across = np.where(untouched, 1.0, np.maximum(across, 0.2))
        alike = self._to_alike(centres[untouched], axes[untouched], outwards[untouched])
        distances[untouched] = np.maximum(distances[untouched], alike)
        roughness = SMOOTH + self._roughness(centres)
        return Faces(centres, axes, across * self.edge**2, distances, roughness, normals, self._reach)

    def _to_alike(self, centres: np.ndarray, axes: np.ndarray, outwards: np.ndarray) -> np.ndarray:
        """(n,) m, from untouched faces to the nearest contact on a surface that faces alike.

        The faces at `centres` (n, 3) look along `axes` (n,), by the sign of `outwards` (n,).
        """
        distances = np.full(len(centres), NONE_ALIKE * self._reach)
        for axis, sign in product(range(3), (-1.0, 1.0)):
            faces = (axes == axis) & (outwards == sign)
            alike = sign * self._normals[:, axis] > ASIDE
            if faces.any() and alike.any():
                distances[faces] = cKDTree(self._centres[alike]).query(centres[faces])[0]
        return np.maximum(distances, UNTOUCHED * self._reach)

    def tallest_beside(self, places: np.ndarray, half: np.ndarray) -> np.ndarray:
        """(n,) m, highest place of the sphere's centre inside the estimated object near places (n, 3); -inf for none.

        Near is up to `half` (2,) m along x and along y.
        """
        heights = self._heights()
        size = 2 * np.ceil(half / self.edge).astype(np.int64) + 1
        tallest = ndimage.maximum_filter(heights, tuple(size.tolist()), mode="constant", cval=-np.inf)
        cells = np.rint((places[:, :2] - self._origin[:2]) / self.edge).astype(np.int64)
        cells = np.clip(cells, 0, np.array(tallest.shape) - 1)
        return np.asarray(tallest[tuple(cells.T)])

    def footprint(self, height: float) -> np.ndarray:
        """(nx, ny) bool: where the estimated object keeps the sphere from a height, m, in squares over the area."""
        return self._heights() >= height - self.edge

    def _heights(self) -> np.ndarray:
        """(nx, ny) m, highest grid point inside the estimated object in each column; -inf where none is."""
        inside = self._inside()
        last = inside.shape[2] - 1 - np.argmax(inside[:, :, ::-1], axis=2)
        return np.where(inside.any(axis=2), self._origin[2] + self.edge * last, -np.inf)

    def _inside(self) -> np.ndarray:
        """(nx, ny, nz) bool of the grid points, as of the last update."""
        if self._within is None:
            self._within = self._connected(self._found_inside())
        return self._within

    def _connected(self, inside: np.ndarray) -> np.ndarray:
        """(nx, ny, nz) bool, `inside` without cavities, and without pieces on which no contact is.

        The sphere comes from the sides or from above; what it cannot come to is no surface of its centres. The tangent
        planes of contacts all around meet deep in the object, and far from all contacts in the air.
        """
        cells, count = ndimage.label(~inside)
        open_air = np.zeros(count + 1, dtype=bool)
        for border in (cells[0], cells[-1], cells[:, 0], cells[:, -1], cells[:, :, -1]):
            open_air[border] = True
        open_air[0] = False
        pieces, count = ndimage.label(~open_air[cells])
        nearest = ndimage.minimum(self._touched.square, pieces, np.arange(count + 1))
        touched = nearest <= (TOUCHED * self.edge) ** 2
        touched[0] = False
        return np.asarray(touched[pieces])

    def _found_inside(self) -> np.ndarray:
        owner, nearest = self._touched.owner, self._touched.square
        inside = (self._height(owner) < 0.0) & (nearest <= FREE_FARTHER**2 * self._free.square)
        inside &= self._weighted.square <= self._to_sides**2
        if not len(self._walls):
            return inside
        # A level surface ends at the wall under its edge; a wall that goes up from it bounds something else.
        wall = self._walls[self._touched_walls.owner]
        under = self._centres[wall, 2] < self._centres[owner, 2]
        under &= (self._normals[owner, 2] > LEVEL) & (self._touched_walls.square < (FOOT * self._reach) ** 2)
        return inside & ~(under & (self._height(wall) > 0.0))

    def _height(self, owner: np.ndarray) -> np.ndarray:
        """(nx, ny, nz) m, of the grid points over the tangent plane of a contact of each, by their numbers."""
        along = [low + self.edge * np.arange(n) for low, n in zip(self._origin, owner.shape)]
        centres, normals = self._centres, self._normals
        return sum(
            normals[owner, axis] * (np.expand_dims(x, tuple({0, 1, 2} - {axis})) - centres[owner, axis])
            for axis, x in enumerate(along)
        )

    def _surprise_of(self, places: np.ndarray) -> np.ndarray:
        """(n, 2), the error of the prediction of new places (n, 3) in m, and (d / D)^2, by which it is divided."""
        found = np.zeros((len(places), 2))
        if self._stroke < 2:
            return found
        chosen = np.unique(np.linspace(0, len(places) - 1, min(QUERIES, len(places))).astype(np.int64))
        thinned = _thinned(self._centres[: self._stroke])
        kept, normals = self._centres[thinned], self._normals[thinned]
        tree = cKDTree(kept)
        distance, near = tree.query(places[chosen], k=min(DATA, len(kept)))
        distance, near = distance.reshape(len(chosen), -1), near.reshape(len(chosen), -1)
        telling = (distance[:, 0] > NEAREST) & (distance[:, 0] < 2.0 * self._reach)
        if not telling.any():
            return found
        rows, near = chosen[telling], near[telling]
        off = np.maximum(np.abs(predicted_height(places[rows], kept[near], normals[near], LENGTH)) - NOISE, 0.0)
        share = (np.minimum(distance[telling, 0], self._reach) / self._reach) ** 2
        found[rows, 0], found[rows, 1] = np.minimum(off, self._reach * share), share
        return found

    def _roughness(self, points: np.ndarray) -> np.ndarray:
        """(n,) m, surprise about places (n, 3), from the contacts around each of them."""
        extent = self._area.upper - self._area.lower
        shape = tuple(np.ceil(extent / COARSE).astype(np.int64) + 1)
        measured = self._surprise[:, 1] > 0.0
        surprise, weight = self._surprise[measured].T
        sums, weights = np.zeros(shape), np.zeros(shape)
        cells = tuple(self._cells(self._centres[measured], shape).T)
        np.add.at(sums, cells, surprise)
        np.add.at(weights, cells, weight)
        sums, weights = (ndimage.uniform_filter(values, 3, mode="constant") * 27.0 for values in (sums, weights))
        mean = (surprise.sum() + FIRST) / (weight.sum() + 1.0)
        smooth = (sums + mean) / (weights + 1.0)  # one contact's worth of the average over all
        return smooth[tuple(self._cells(points, shape).T)]

    def _cells(self, points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        cells = np.floor((points - self._area.lower) / COARSE).astype(np.int64)
        return np.clip(cells, 0, np.array(shape) - 1)


def _to_sides(area: Area, along: list[np.ndarray]) -> np.ndarray:
    """(nx, ny, 1) m, from grid points at the places `along` each axis to the nearest of the area's four sides."""
    x, y = (np.minimum(along[axis] - area.lower[axis], area.upper[axis] - along[axis]) for axis in range(2))
    return np.maximum(np.minimum(x[:, None, None], y[None, :, None]), 0.0)


def predicted_height(queries: np.ndarray, centres: np.ndarray, normals: np.ndarray, length: float) -> np.ndarray:
    """m, height of places over the surface that contacts around each of them predict.

    The mean of a Gaussian process with a squared-exponential kernel, given values and gradients at the contacts, about
    the tangent plane of the first of them.

    Parameters
    ----------
    queries : (q, 3) m
    centres, normals : (q, k, 3) m and unit, the contacts for each query, the nearest first
    length : m, of the kernel
    """
    count = centres.shape[1]
    plane = normals[:, :1]
    values = -np.einsum("qkc,qkc->qk", centres - centres[:, :1], np.broadcast_to(plane, normals.shape)) / length
    slopes = normals - plane
    data = np.concatenate([values, slopes.reshape(len(queries), -1)], axis=1)
    x = centres / length
    step = x[:, :, None] - x[:, None]
    near = np.exp(-0.5 * (step * step).sum(-1))
    whole = np.empty((len(queries), 4 * count, 4 * count))
    whole[:, :count, :count] = near
    cross = (near[..., None] * step).reshape(len(queries), count, 3 * count)
    whole[:, :count, count:] = cross
    whole[:, count:, :count] = cross.transpose(0, 2, 1)
    second = near[..., None, None] * (np.eye(3) - step[..., :, None] * step[..., None, :])
    whole[:, count:, count:] = second.transpose(0, 1, 3, 2, 4).reshape(len(queries), 3 * count, 3 * count)
    whole += np.diag(np.concatenate([np.full(count, 1e-5), np.full(3 * count, 1e-3)]))
    away = queries[:, None] / length - x
    near = np.exp(-0.5 * (away * away).sum(-1))
    row = np.concatenate([near, (near[..., None] * away).reshape(len(queries), -1)], axis=1)
    solved = np.linalg.solve(whole, data[..., None])[..., 0]
    height = np.einsum("qc,qc->q", queries - centres[:, 0], normals[:, 0])
    return height + length * np.einsum("qi,qi->q", row, solved)


def _weights(normals: np.ndarray) -> np.ndarray:
    """(n, 3) weights of squared differences in x and y, upwards, and downwards, from contacts with normals (n, 3).

    Above a wall stands what was touched higher up, or the top: in between it is interpolated. Below its lowest contact
    a wall is only extrapolated; where a lower one was touched, the place between is near that one.
    """
    wall, level = np.abs(normals[:, 2]) < WALL, normals[:, 2] > LEVEL
    across = np.where(wall | level, 1.0, ROUNDED**2)
    return np.stack([across, np.where(wall, EXTRUDED**2, across), across], axis=1)


def _thinned(points: np.ndarray) -> np.ndarray:
    """Indices of points (n, 3) of which no two share a cube with edges of `DATA_APART`."""
    cells = np.floor(points / DATA_APART).astype(np.int64)
    return np.unique(cells, axis=0, return_index=True)[1]
