"""The certificate: the largest ball that can still hide where the probe could get to.

Three sets, all inside the area widened by the sphere's radius:

- Swept: what the sphere, the stick or the body behind it has passed through.
- Within reach: what a ball as wide as `opening` can cover when it comes from above, contains no contact, and keeps its
  centre in the area, which is widened sideways and upwards by as much as the ball's radius is larger than the sphere's.
  A contact is a point of the object, so the ball stays out of the object wherever contacts lie closer than `opening`.
- Out of reach: the rest. The inside of the touched object is there.

The certificate is the diameter of the largest ball within reach that meets nothing of what was swept: with all of it in
one ball as wide as the opening, or wider than that itself. A grid says about where that is, and branch and bound from
its cells on how large (`hidden_ball_kernels`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from lwrprobe.contracts import Area, InputError, LinkShape
from lwrprobe.mapping import certificate_kernels as kernels
from lwrprobe.mapping.distance_kernels import distances
from lwrprobe.mapping.hidden_ball_kernels import largest_hidden

MAX_VOXELS = 500_000
"""Of the grid: two distance transforms of it take some tenths of a second."""
FINEST = 0.0005
"""m"""
BAND = 0.006
"""m, up to which distances from what the sphere swept are exact; beyond it they are bounded from above."""
LINK_BAND = 0.004
"""m, the same for the links, which are large and seldom the nearest."""
FINE, SHARE = 0.00003, 0.03
"""m, and share of the largest hidden ball's radius, by which that may be taken for larger than it is, about."""
THINNED = 0.0005
"""m, of cells of which one contact each counts: between two of them a covering ball sinks in by micrometres."""
HALF_DIAGONAL = 0.5 * np.sqrt(3.0)
_KINDS = {"cylinder": kernels.CYLINDER, "box": kernels.BOX, "capsule": kernels.CAPSULE}


@dataclass(slots=True, frozen=True, eq=False)
class Hiding:
    """What can still hide, at one moment.

    Attributes
    ----------
    diameter : m, no larger ball hides within reach
    place : (3,) m, about where a ball of that size fits
    unknown : m^3 within reach and not swept
    out_of_reach : m^3 not swept and not within reach, the inside of the object among it
    points : (n, 3) m, grid points of what is unknown and within reach
    sizes : (n,) m, diameter of the largest hidden ball about each of them
    """

    diameter: float
    place: np.ndarray
    unknown: float
    out_of_reach: float
    points: np.ndarray
    sizes: np.ndarray


class Certificate:
    """Collects what a probe sweeps and touches, and says what can still hide.

    Nothing that is added ever makes the certificate larger. It is never smaller than the truth: what distances from the
    middle of a cell may miss in the rest of it is added.

    Parameters
    ----------
    area : of the sphere's centre; the probe comes from above it
    radius : m, of the sphere
    links : of the probe, in the tip frame
    opening : m, a narrower opening between contacts counts as closed; at least the sphere's diameter
    tolerance : m by which places of the probe and contacts may be wrong
    max_voxels : grid points at most; the grid is as fine as that allows, 0.5 mm at the finest

    Raises
    ------
    InputError : for numbers that are not finite or out of range
    """

    def __init__(
        self,
        area: Area,
        radius: float,
        links: tuple[LinkShape, ...] = (),
        *,
        opening: float,
        tolerance: float = 0.0,
        max_voxels: int = MAX_VOXELS,
    ) -> None:
        if not (np.isfinite(radius) and radius > 0.0):
            raise InputError("radius", radius, "a positive length in metres")
        if not (np.isfinite(opening) and opening >= 2.0 * radius):
            raise InputError("opening", opening, f"metres, at least the sphere's diameter, {2.0 * radius:g}")
        if not 0.0 <= tolerance < radius:
            raise InputError("tolerance", tolerance, f"metres, at least 0 and less than the radius, {radius:g}")
        if max_voxels < 1000:
            raise InputError("max_voxels", max_voxels, "at least 1000")
        self._area, self._radius, self._links = area, radius, links
        self._cover, self._tolerance = 0.5 * opening, tolerance
        extent = area.upper - area.lower + 2.0 * max(radius, self._cover - radius)
        edge = max(FINEST, float(np.cbrt(np.prod(extent) / max_voxels)))
        while np.prod(np.ceil(extent / edge)) > max_voxels:
            edge *= 1.01
        self.edge = edge
        """m between neighbouring grid points."""
        shape = tuple(np.ceil(extent / edge).astype(np.int64))
        self._origin = 0.5 * (area.lower + area.upper - edge * (np.array(shape) - 1))
        self._gap, self._owners = np.full(shape, BAND), np.full(shape, -1, np.int32)
        self._begins, self._ends, self._contacts = Rows((3,)), Rows((3,)), Rows((3,))
        self._placed = Rows((len(links), 4, 4))
        self._thinned: set[tuple[int, ...]] = set()
        self._least = np.inf
        self._near2 = np.full(shape, (self._cover + 2.0 * edge) ** 2)
        self._depth = radius - self._outside_area()

    def sweep(self, centres: np.ndarray, joined: np.ndarray | None = None, poses: np.ndarray | None = None) -> None:
        """Add what the probe has swept.

        Parameters
        ----------
        centres : (n, 3) m, of the sphere, straight from each to the next
        joined : (n,) bool, False where the sphere did not come straight from the row before; None = all did
        poses : (k, 4, 4) of the tip, at which the links were; None = the links are left out
        """
        centres = _rows(centres, "centres", (3,))
        joined = np.ones(len(centres), bool) if joined is None else np.asarray(joined, bool)
        if joined.shape != (len(centres),):
            raise InputError("joined", joined.shape, f"one value a centre, {(len(centres),)}")
        begins = np.where(np.append(False, joined[1:])[:, None], np.roll(centres, 1, axis=0), centres)
        grid, kinds = (self._gap, self._owners), len(self._links) + 1
        radius = self._radius - self._tolerance
        first = self._begins.append(begins)
        self._ends.append(centres)
        kernels.lower_to_path(*grid, first, kinds, self._origin, self.edge, begins, centres, radius, BAND)
        if poses is None:
            return
        poses = _rows(poses, "poses", (4, 4))
        own = np.array([link.pose for link in self._links]).reshape(-1, 4, 4)
        placed = poses[:, None] @ own
        first = self._placed.append(placed)
        for which, link in enumerate(self._links):
            kernels.lower_to_link(
                *grid, first, kinds, which + 1, self._origin, self.edge, np.ascontiguousarray(placed[:, which]),
                _KINDS[link.kind], _extent(link), self._tolerance, LINK_BAND,
            )  # fmt: skip

    def touch(self, points: np.ndarray) -> None:
        """Add contacts (n, 3) m."""
        points = _rows(points, "points", (3,))
        kernels.lower_to_points(self._near2, self._origin, self.edge, points, self._cover + self.edge)
        for point, cell in zip(points, map(tuple, np.floor(points / THINNED).astype(np.int64).tolist())):
            if cell not in self._thinned:
                self._thinned.add(cell)
                self._contacts.append(point[None])

    def hiding(self) -> Hiding:
        """What can still hide now."""
        slack = HALF_DIAGONAL * self.edge
        gap = _distance(~self._centres(slack), self.edge)
        within = gap <= self._cover + slack
        # At a grid point each of the three is a bound from above of a function that changes by at most 1 m/m.
        room = np.minimum(_distance(within, self.edge), self._depth)
        size = np.minimum(self._free(), room)
        radius, place = self._largest(size, gap, slack)
        self._least = min(self._least, 2.0 * radius)
        unswept = (self._gap > self._tolerance) & (self._depth > 0.0)
        unknown = within & unswept
        points = self._origin + self.edge * np.argwhere(unknown)
        return Hiding(
            diameter=self._least,
            place=place,
            unknown=float(unknown.sum()) * self.edge**3,
            out_of_reach=float((~within & unswept).sum()) * self.edge**3,
            points=points,
            sizes=np.minimum(2.0 * size[unknown], self._least),
        )

    def _largest(self, size: np.ndarray, gap: np.ndarray, slack: float) -> tuple[float, np.ndarray]:
        """m, radius of a ball such that no larger one hides, and its place (3,) m.

        `size` are m about the grid points, `gap` m from each to those about which a covering ball's middle may lie.
        """
        cells = np.argwhere(size > -slack)
        bounds = size[size > -slack] + slack
        order = np.argsort(-bounds, kind="stable")
        contacts = self._contacts.values()
        contacts = np.ascontiguousarray(contacts[np.argsort(contacts[:, 0], kind="stable")])
        found = largest_hidden(
            cells[order], bounds[order], size, gap, self._owners, self._origin, self.edge, self._begins.values(),
            self._ends.values(), self._radius - self._tolerance,
            self._placed.values(),
            np.array([_KINDS[link.kind] for link in self._links], np.int64),
            np.array([_extent(link) for link in self._links]).reshape(-1, 3), self._tolerance, contacts,
            self._area.lower, self._area.upper, self._radius, *self._between(), self._cover,
            self._cover - self._tolerance, FINE, SHARE,
        )  # fmt: skip
        return float(found[0]), found[1:4]

    def _free(self) -> np.ndarray:
        """m at each grid point, from above: radius of the largest ball about it that meets nothing swept."""
        far = self._gap >= BAND
        return np.where(far, BAND + _distance(far, self.edge), self._gap) if far.any() else self._gap

    def _centres(self, slack: float) -> np.ndarray:
        """Grid points about which the middle of a covering ball may lie that comes from above."""
        fits = self._near2 >= max(self._cover - slack - self._tolerance, 0.0) ** 2
        for along, low, high in zip(self._along(), *self._between()):
            allowed = (along >= low - 0.5 * self.edge) & (along <= high + 0.5 * self.edge)
            fits &= allowed
        parts, _ = ndimage.label(fits)
        above = np.unique(parts[:, :, np.flatnonzero(allowed)[-1]])
        return np.isin(parts, above[above > 0])

    def _between(self) -> tuple[np.ndarray, np.ndarray]:
        """(3,) m, corners between which the middle of a covering ball lies."""
        beside = self._cover - self._radius
        # Under the lowest contacts it would get into the object.
        return self._area.lower - (beside, beside, 0.0), self._area.upper + beside

    def _outside_area(self) -> np.ndarray:
        """m from each grid point to the area, negative inside it."""
        beyond = [
            np.maximum(x - high, low - x) for x, low, high in zip(self._along(), self._area.lower, self._area.upper)
        ]
        outside = np.sqrt(sum(np.maximum(b, 0.0) ** 2 for b in beyond))
        inside = np.maximum(np.maximum(beyond[0], beyond[1]), beyond[2])
        return np.where(inside > 0.0, outside, inside)

    def _along(self) -> list[np.ndarray]:
        """m, coordinates of the grid points along x, y and z, shaped so that they broadcast."""
        steps = np.ogrid[tuple(slice(0, count) for count in self._gap.shape)]
        return [low + self.edge * step for low, step in zip(self._origin, steps)]


class Rows:
    """Rows of one shape in a growing array."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._held, self._count = np.empty((1024, *shape)), 0

    def append(self, rows: np.ndarray) -> int:
        """Number of the first of the rows."""
        first, self._count = self._count, self._count + len(rows)
        if self._count > len(self._held):
            more = np.empty((max(len(self._held), len(rows)), *self._held.shape[1:]))
            self._held = np.concatenate([self._held, more])
        self._held[first : self._count] = rows
        return first

    def values(self) -> np.ndarray:
        """All rows."""
        return self._held[: self._count]


def _extent(link: LinkShape) -> np.ndarray:
    """(3,) m, the numbers of a link's size, then zeros."""
    return np.append(link.size, np.zeros(3 - len(link.size)))


def _distance(marked: np.ndarray, edge: float) -> np.ndarray:
    """m from each grid point to the nearest one that is not marked; infinite where all are marked."""
    found = np.empty(marked.shape)
    distances(np.ascontiguousarray(marked), edge, found)
    return found


def _rows(values: np.ndarray, field: str, shape: tuple[int, ...]) -> np.ndarray:
    """Contiguous float64 rows of a shape, all finite."""
    try:
        rows = np.ascontiguousarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(field, values, f"numbers of shape (n, {', '.join(map(str, shape))})") from None
    if rows.shape[1:] != shape:
        raise InputError(field, rows.shape, f"an array of shape (n, {', '.join(map(str, shape))})")
    if not np.isfinite(rows).all():
        raise InputError(field, "numbers that are not finite", "finite numbers")
    return rows
