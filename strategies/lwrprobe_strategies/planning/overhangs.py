"""Where a motion sideways may meet something with the stick before the sphere meets it.

That takes an overhang: something that reaches further out above the sphere than beside it. It may be anywhere near
what was touched above the sphere's height, as soon as a touch has shown that the object overhangs up there; and near
what was touched up there, as long as no touch ahead at the sphere's height has shown a surface that faces the motion.
It is not where the upright stick itself has stood, and not beyond a line through all of the area along which it stood:
what reaches there would have been met on that line.
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np

from lwrprobe.contracts import Area, Confidence, Contact, Doubt, Probe
from lwrprobe.contracts.contact import NORMAL_AT_HALF_CONFIDENCE
from lwrprobe.mapping import PlanView
from lwrprobe.mapping.plan_view import Window
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.growing_table import GrowingTable

CELL = 0.001
"""m, edge of the squares in the plan view for which heights are kept."""
LEANS = -0.15
"""Share of the normal along z, below which a touch is one of an overhang (9 degrees)."""
LEANS_OUT = -0.03
"""As `LEANS`, below which a touch of a side that goes up is no evidence of a plain wall: 40 mm above the sphere such a
side stands out by 1 mm, and the stick is met before the sphere soon after (2 degrees)."""
MIN_LEANING = 4
"""Touches in a row that lean so, from which on it is no noise."""
ERRORS = 2.0
"""Expected errors of its normal, that a touch must lean by more than a plain wall does: at a foot the errors of a few
touches in a row are one and the same."""
TWICE = 2
"""Contacts of the stick in a row, from which on it is one: one alone decides where its force is clear."""
AHEAD = 0.003
"""m by which a place ahead is checked: the stick's radius, and the braking distance."""
FACING = 0.5
"""Share of a normal against a sideways motion, from which on the sphere meets that surface before the stick does; and
along another normal, from which on both surfaces face alike."""
ASKEW = 0.2
"""The same, down to which a surface that faces otherwise may be one that stands out over what is climbed."""
HIGHER = 0.002
"""m above the sphere, from which on where it touched near shows how a surface goes on: over an edge, say."""
FURTHER_OUT = 0.0005
"""m off the surface that is climbed, beyond which the sphere was further out up there: something stands out there."""
FAR = 2.0
"""Times the distance within which an unknown part of the object may be met: how far overhangs are evidence for it."""


class Overhangs:
    """Heights in the plan view: of what was touched, of what overhangs, and down to where the stick has stood.

    Parameters
    ----------
    area, probe : as in the task
    beside : m sideways from what was touched, within which more of the object may be
    clear_force : N, above which one contact of the stick is certain
    tallest : m, above which nothing is known to be; what is touched higher up counts as well

    Attributes
    ----------
    found : some touch has shown that the object overhangs
    """

    def __init__(
        self, area: Area, probe: Probe, beside: float, clear_force: float = np.inf, tallest: float = np.inf
    ) -> None:
        low = area.lower[:2] - beside
        shape = tuple(np.ceil((area.upper[:2] + beside - low) / CELL).astype(int) + 1)
        self._low_x, self._low_y = low.tolist()
        self._last_i, self._last_j = shape[0] - 1, shape[1] - 1
        self._touched, self._overhang = PlanView(shape, -np.inf), PlanView(shape, -np.inf)
        self._stood, self._lowest = PlanView(shape, np.inf), PlanView(shape, np.inf)
        self._leans_out = PlanView(shape, np.inf)  # the normals there are those of the lowest touches, as well
        self._centres = GrowingTable(5)  # m, of the sphere where it touched, and x and y of the normal there
        self._normal = np.zeros((*shape, 2))
        self._clear_force = clear_force
        self._probe, self._tallest = probe, min(float(area.upper[2]) - probe.radius, tallest)
        self._cells = round(beside / CELL)
        self._far = round(FAR * self._cells)
        self._highest = -np.inf  # m, of all that was touched
        self._leaning, self._out, self._above, self.found = 0, 0, 0, False
        self._last_stood = (-1, -1), np.inf  # square and height
        # m, see `_near`, by square and direction of a motion; void when something else is known
        self._ahead_of: dict[tuple[int, int, float, float], tuple[float, float]] = {}
        self._beside: tuple[int, int, float] = -1, -1, -np.inf  # square, and the tallest near it
        corners = self._cell(*area.lower[:2].tolist()), self._cell(*area.upper[:2].tolist())
        self._area, self._off_border = (
            tuple(slice(low + off, high + 1 - off) for low, high in zip(*corners)) for off in (0, 1)
        )
        self._in_reach, self._surveyed = np.ones(shape, dtype=bool), np.inf  # of what was touched; m, how low

    def raise_top(self, top: float) -> None:
        """The area reaches up to `top` m from now on."""
        self._tallest = top - self._probe.radius

    def note(self, pose: np.ndarray, contact: Contact | None) -> None:
        """The tip is at a pose (4, 4) and touches something or nothing; called with every sample."""
        if contact is None or contact.confidence is Confidence.RELIABLE:  # nothing touches the stick
            self._stand(pose)
        if contact is None:
            return
        px, py, pz = contact.point.tolist()
        if contact.confidence is Confidence.RELIABLE:
            k, m = self._cell(px, py)
            up = contact.normal.item(2)
            self._centre(*pose[:3, 3].tolist(), *contact.normal[:2].tolist())
            if pz > self._touched.heights.item(k, m):
                self._raise(k, m, pz)
            if up < LEANS:
                self._leaning += up + ERRORS * _error(contact.confidence_score) < LEANS_OUT
                if self._leaning >= MIN_LEANING:
                    self._add(k, m, pz)
            else:
                self._leaning = 0
                if pz < self._lowest.heights.item(k, m) and up > LEANS:
                    self._lowest.heights[k, m], self._normal[k, m] = pz, contact.normal[:2]
                    self._ahead_of.clear()
                self._out = self._out + 1 if LEANS < up < LEANS_OUT else 0
                if self._out >= MIN_LEANING and pz < self._leans_out.heights.item(k, m):
                    self._leans_out.heights[k, m] = pz
                    self._ahead_of.clear()
        if contact.reason is Doubt.AXIS_MISSES and pz > pose.item(2, 3) + self._probe.radius:
            self._above += 1
            clear = float(contact.force @ contact.force) > self._clear_force**2
            if clear or self._above >= TWICE:
                self._add(*self._cell(pose.item(0, 3), pose.item(1, 3)), pz)
        else:
            self._above = 0

    def _stand(self, pose: np.ndarray) -> None:
        """The tip is at a pose (4, 4), and nothing touches the stick."""
        (*_, x), (*_, y), (_, _, down, z), _ = pose.tolist()
        i, j = self._cell(x, y)
        column, height = self._last_stood
        if -down > UPRIGHT and not (z >= height and column == (i, j)):
            self._last_stood = (i, j), z
            self._stood.lower(i, j, 1, z)

    def _centre(self, x: float, y: float, z: float, nx: float, ny: float) -> None:
        """The sphere touches a surface at a place, with a normal."""
        last = self._centres.last
        if last is None or max(abs(x - last[0]), abs(y - last[1]), abs(z - last[2])) >= CELL:
            self._centres.add((x, y, z, nx, ny))

    def stick_met(self, place: np.ndarray, above: float = 0.0) -> None:
        """Something touches the stick or is near it, while the sphere is at a place (3,).

        It is `above` m over the sphere's centre; at a height that is not known where that is no more than its radius.
        """
        reach, radius = self.reach(place), self._probe.radius
        height = min(above + radius, reach) if above > radius else reach
        self._add(*self._cell(place.item(0), place.item(1)), height + place.item(2))

    def _add(self, i: int, j: int, height: float) -> None:
        self.found = True
        self._overhang.heights[i, j] = max(self._overhang.heights.item(i, j), height)
        self._raise(i, j, max(self._touched.heights.item(i, j), height))

    def _raise(self, i: int, j: int, height: float) -> None:
        """Something was touched in a square, as high as nothing before."""
        self._touched.heights[i, j], self._highest = height, max(self._highest, height)
        self._ahead_of.clear()
        if not self._in_reach.item(i, j):
            self._in_reach[...] = True
        k, m, tallest = self._beside
        if abs(i - k) <= self._cells and abs(j - m) <= self._cells:
            self._beside = k, m, max(tallest, height)

    def survey(self, height: float) -> None:
        """Take into account where the stick has stood as low as `height` m: what that parts from all that was touched.

        The area's border parts as well, unless something was touched there: then the object may go around it.
        """
        from scipy.ndimage import label

        self._in_reach[...], self._surveyed = True, height
        touched = self._touched.heights > -np.inf
        if np.count_nonzero(touched) > np.count_nonzero(touched[self._off_border]):
            return
        parts, _ = label(self._stood.heights[self._area] >= height + CELL)
        self._in_reach[self._area] = (parts > 0) & np.isin(parts, parts[touched[self._area]])

    def cut_off(self, place: np.ndarray, along: np.ndarray) -> bool:
        """Whether nothing that was touched reaches to a place (3,), and ahead of it, as of the last survey."""
        here, ahead = self._cell(place.item(0), place.item(1)), self._ahead(place, along)
        return place.item(2) > self._surveyed - CELL and not (self._in_reach.item(here) or self._in_reach.item(ahead))

    def reach(self, place: np.ndarray, along: np.ndarray | None = None) -> float:
        """m above the sphere's centre, at a place (3,), up to which something may meet the stick.

        For a motion along a unit vector (3,) that is no higher than from where the stick has stood just ahead.
        """
        tallest = max(self._tallest, self._highest)
        if along is not None:
            tallest = min(tallest, self._stood.heights.item(self._ahead(place, along)))
        return min(max(tallest - place.item(2), 0.0), self._probe.sensor_distance)

    def beside(self, place: np.ndarray) -> bool:
        """Whether one may be somewhere near a place (3,): something taller was touched there, or one was found."""
        x, y, z = place.tolist()
        return self.found or self._tallest_beside(*self._cell(x, y)) > z + self._probe.radius

    def ahead(self, place: np.ndarray, along: np.ndarray) -> bool:
        """Whether the upright stick may meet one, for a sphere that goes from a place (3,) along a unit vector (3,)."""
        if not self.found:
            return False
        z, (i, j) = place.item(2), self._ahead(place, along)
        if self._overhang.tallest(_window(i, j, self._far)) <= z:
            return False
        return not self._free(z, i, j) and self._tallest_beside(i, j) > z + self._probe.radius

    def possible(self, place: np.ndarray, along: np.ndarray) -> bool:
        """Whether one may be ahead of a motion although no touch has shown any.

        Something taller is near, ahead or abreast, and ahead no surface that faces the motion was touched beside the
        sphere, from its top down: on a side that leans, a touch farther off or higher up shows another part.
        """
        z, radius = place.item(2), self._probe.radius
        if self._highest <= z + radius:
            return False
        (x, y, _), (i, j) = along.tolist(), self._ahead(place, along)
        if self._free(z, i, j) or self._tallest_beside(i, j) <= z + radius:
            return False
        known = self._ahead_of.get((i, j, x, y))
        tallest, facing = self._near(i, j, x, y) if known is None else known
        return tallest > z + radius and not facing < z + radius

    def anywhere(self, place: np.ndarray, along: np.ndarray) -> bool:
        """Whether one may be ahead of a motion because the object overhangs elsewhere, and is as tall somewhere."""
        z = place.item(2)
        return self.found and self._highest > z + self._probe.radius and not self._free(z, *self._ahead(place, along))

    def beneath(self, place: np.ndarray, along: np.ndarray) -> float:
        """m above the sphere's centre, up to which one may be ahead of a level contour although no touch has shown any.

        For a sphere that goes from a place (3,) along a unit vector (3,): as tall as what was touched near. 0 where
        that is no taller than the sphere, and where the stick has stood.
        """
        z, (i, j) = place.item(2), self._ahead(place, along)
        tallest = self._tallest_beside(i, j)
        if tallest <= z + self._probe.radius or self._free(z, i, j):
            return 0.0
        return min(tallest - z, self.reach(place, along))

    def above(self, place: np.ndarray, normal: np.ndarray) -> bool:
        """Whether the sphere may meet one when it goes up a surface with a normal (3,), from a place (3,).

        It may where something overhangs near, higher up; where the sphere has touched nothing near from as high, since
        what is above is not known then, or, on an object that overhangs somewhere, a top alone: nobody knows how far
        that reaches; and where on a surface that faces alike it was further out there than this one is, by no more than
        the sphere's radius: the stick shows that nothing above stands out further here. A surface that faces somewhat
        alike stands out if it does so where it is touched, and if it goes on as it does there.
        """
        x, y, z = place.tolist()
        if self.found and self._overhang.tallest(_window(*self._cell(x, y), self._cells)) > z:
            return True
        centres = self._centres.rows()
        aside = np.abs(centres[:, :2] - place[:2]).max(axis=1, initial=0.0)
        higher = centres[(aside <= self._cells * CELL) & (centres[:, 2] > z + HIGHER)]
        if not len(higher):
            return True
        facing = higher[:, 3:] @ normal[:2]
        askew = higher[(facing > ASKEW) & (facing <= FACING)]
        outward = askew[:, 3:] / np.maximum(np.hypot(*askew[:, 3:].T), 1e-9)[:, None]
        edges = outward @ normal[:2] > FACING  # of a surface that faces alike: its normals lead up there
        outward = np.where(edges[:, None], 0.5 * (outward + normal[:2]), askew[:, 3:])
        out = ((askew[:, :2] - place[:2]) * outward).sum(axis=1)
        if ((out > FURTHER_OUT) & (out < self._probe.radius)).any():
            return True
        alike = higher[facing > FACING]
        if not len(alike):
            return self.found and not len(askew)
        lowest = alike[alike[:, 2] < alike[:, 2].min() + HIGHER]
        apart = lowest[:, :2] - place[:2]
        nearest = int(np.argmin((apart * apart).sum(axis=1)))
        chord = 0.5 * (lowest[nearest, 3:] + normal[:2])
        return FURTHER_OUT < float(apart[nearest] @ chord) < self._probe.radius

    def _ahead(self, place: np.ndarray, along: np.ndarray) -> tuple[int, int]:
        return self._cell(place.item(0) + AHEAD * along.item(0), place.item(1) + AHEAD * along.item(1))

    def _free(self, z: float, i: int, j: int) -> bool:
        """Whether the stick has stood in a square, as low as a height [m]."""
        return self._stood.heights.item(i, j) < z + CELL

    def _tallest_beside(self, i: int, j: int) -> float:
        """m, the tallest that was touched near a square, to all sides."""
        if self._beside[:2] != (i, j):
            self._beside = i, j, self._touched.tallest(_window(i, j, self._cells))
        return self._beside[2]

    def _near(self, i: int, j: int, x: float, y: float) -> tuple[float, float]:
        """m, the tallest that was touched near a square, ahead of a motion or abreast, and the lowest touch of a
        surface ahead that faces the motion.
        """
        side = max(hypot(x, y), 1e-9)
        near, far = (
            (*_span(i, x / side, ahead, self._cells), *_span(j, y / side, ahead, self._cells))
            for ahead in (self._cells, self._far)
        )
        tallest = self._touched.tallest(near)
        facing = self._lowest.lowest_facing(self._normal, far, (x, y), FACING)
        if self._leans_out.lowest_facing(self._normal, far, (x, y), FACING) < np.inf:
            facing = np.inf
        self._ahead_of[i, j, x, y] = tallest, facing
        return tallest, facing

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        """Indices of the square of a place; the nearest one where it is outside."""
        i, j = int((x - self._low_x) / CELL), int((y - self._low_y) / CELL)
        if 0 <= i <= self._last_i and 0 <= j <= self._last_j:
            return i, j
        return min(max(i, 0), self._last_i), min(max(j, 0), self._last_j)


def _error(score: float) -> float:
    """rad, expected of a normal with a confidence score above 0."""
    return NORMAL_AT_HALF_CONFIDENCE * sqrt(max(1.0 / score - 1.0, 0.0))


def _window(i: int, j: int, cells: int) -> Window:
    """So many squares to all sides of a square."""
    return max(i - cells, 0), i + cells + 1, max(j - cells, 0), j + cells + 1


def _span(i: int, share: float, ahead: int, abreast: int) -> tuple[int, int]:
    """Along one axis: so many squares ahead of a motion that has this share along it, and so many to both sides."""
    beside = round((1.0 - abs(share)) * abreast)
    return max(i - beside + round(min(share, 0.0) * ahead), 0), i + beside + round(max(share, 0.0) * ahead) + 1
