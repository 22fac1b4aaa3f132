"""What the probe has shown to be free, kept for its sphere and for its stick, each with its own width.

Where an upright stick stands nothing is within the stick's radius. The sphere is wider: between the two radii something
may begin above it. A place is open for the sphere where the sphere itself came down to it.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe.mapping import path_corners
from lwrprobe_strategies.planning.growing_table import GrowingTable

SPACING = 0.001
"""m between two places that are kept."""
UPRIGHT = 0.9995
"""Share of the stick along z, downwards, from which on it fills a vertical column (1.8 degrees)."""
TURNED = 0.998
"""Cosine between two directions of the stick, up to which the second one is kept (3.6 degrees)."""
SIDE = 0.0026
"""m sideways from where the sphere has been, within which it fits: half of its radius. What stands in the strip that is
left is met by the sphere's flank, across the stick, where the probe gives way. An arm with a mass strikes it."""
COLUMN = 0.0005
"""m sideways from where the sphere came down, within which it goes up again and meets nothing with its flank either: as
far as a return path leads that ends in going up as fast as the probe can."""
STEEP = 0.5
"""Share of a normal along z, up to which a surface counts as a wall."""
NO_OVERHANG, AROUND_TOP = 0.0, 0.008
"""The same, from which on a surface does not overhang; and m sideways from a top, within which nothing was touched
higher up, and beyond which the surface was followed down."""
LOWER = 1e-4
"""m by which a path may lead lower than where the sphere has been: a surface below presses along the stick, where the
probe is stiff, and 0.1 mm makes 2 N. Sideways it gives way."""
GAP = 0.004
"""m in height between two places of the sphere, up to which nothing fits in between (the waist of two spheres)."""
LIFT = 0.001
"""m off a surface, at which a path along it is driven back."""
CHORD, TURN = 0.0003, 0.05
"""m, and change of the stick's direction, by which a path that is driven back may cut its corners."""
NEAREST = 0.1
"""Share of `CHORD` by which it may do so where it leads along a surface and not off it: 0.03 mm press with 0.6 N."""
BROKEN = 0.01
"""m between two places in a row, above which it is not known how the probe came from one to the other."""
SHORT = 0.15
"""m along the axes, as far as the return path may be the quicker one."""
FAR_COLUMN = 0.4
"""The same where it saves a slow way up."""
AGAIN = 2.0 * LIFT
"""m between two places along an axis, at which the same is touched."""
AROUND = 5.0 * LIFT
"""m along an axis, within which faces of one inner edge lie."""
WEDGED = 0.010
"""m from where the sphere is between two surfaces, from which on the path is as far off them as elsewhere."""
IN_FRONT, OFF = -0.1 * LIFT, 0.7 * LIFT
"""m in front of a face: from where on another place is on its free side, and how far off it a path leads there."""
FARTHEST_BACK = 600
"""Places, as far as a path is driven back."""
OFF_TOUCH = 0.003
"""m sideways from where the sphere touched something, within which a place is beside that touch."""
BORDER = 0.001
"""m, within which a place is one on the border."""
CUT = 0.015
"""m from what was touched, within which more of an object may stand on a border through which it goes."""
OFF_SURFACE, STICK = slice(3, 6), slice(6, 9)
CAME_DOWN, STOOD, JUST_THERE, ON_BORDER = 9, 10, 11, 12
"""Columns of the table of places, after the place itself: the place off the surface that was touched there, or the same
place again; the stick's direction; and 0 or 1, whether the sphere came down near it, the stick was upright, the sphere
came down just there, and it is on the area's border."""
COLUMNS = 13

Pose = tuple[np.ndarray, np.ndarray]
"""Place (3,) m of the sphere's centre, and orientation (3, 3) of the tip."""
Vector = tuple[float, float, float]


class FreeSpace:
    """Where the probe has been, in the order in which it was there.

    Parameters
    ----------
    area : the sphere's centre is above all that may be there at the area's top, and no lower
    side : m sideways from where the sphere has been, within which it fits as fast as the probe can
    body : m above the sphere's centre, from which on a body that is wider than the sphere stands on the stick: where
        an upright probe is, the sphere fits from that height on
    """

    def __init__(self, area: Area, side: float = SIDE, body: float = np.inf) -> None:
        self._area, self._side, self._body = area, side, body
        self._came_down = CAME_DOWN if side > COLUMN else JUST_THERE
        self._top = float(area.upper[2])
        self._places = GrowingTable(COLUMNS)
        self._turns: list[np.ndarray] = []
        self._off = np.full(3, np.inf), np.zeros(3)  # the last place with a reliable normal, and that
        self._barred: set[int] = set()  # indices of places on no path back: who comes there may touch something
        self._column: tuple[float, ...] | None = None  # where it came down, and the stick's direction meanwhile
        self._descent = 0  # index of the first place of that

    def raise_top(self, top: float) -> None:
        """All that may be there reaches higher, up to `top` m: where the sphere came down something may be above."""
        self._top, self._column = top, None
        rows, self._places = self._places.rows().copy(), GrowingTable(COLUMNS)
        rows[:, [CAME_DOWN, JUST_THERE]] = 0.0
        for row in rows.tolist():
            self._places.add(tuple(row))

    def confine(self, area: Area, body: float = np.inf) -> None:
        """Go on in another area, as high as the one before; on its border nothing stands.

        `body` as in the constructor.
        """
        self._area, self._body = area, body
        rows, self._places = self._places.rows().copy(), GrowingTable(COLUMNS)
        for row in rows.tolist():
            self._places.add((*row[:ON_BORDER], float(self._on_border(row[0], row[1]))))

    def note(self, pose: np.ndarray, normal: np.ndarray | None, reliable: bool = True) -> None:
        """The tip is at a pose (4, 4) and touches a surface with this normal (3,), or None.

        A normal that is not reliable is that of the force, and leads off what is touched as well; but that of a light
        touch may lead into it, where a reliable one leads off just beside.
        """
        if normal is not None:
            here = pose[:3, 3]
            if reliable:
                self._off = here.copy(), normal
            elif np.abs(here - self._off[0]).max() < AGAIN and normal @ self._off[1] < 0.0:
                normal = self._off[1]
        (_, _, ax, x), (_, _, ay, y), (_, _, az, z), _ = pose.tolist()
        last = self._places.last
        if last is not None:
            near = abs(x - last[0]) < SPACING and abs(y - last[1]) < SPACING and abs(z - last[2]) < SPACING
            near = near and ax * last[6] + ay * last[7] + az * last[8] > TURNED
            touched = last[OFF_SURFACE] != last[:3]
            if near and normal is not None and touched and reliable and self._leads_into(last, normal):
                self._leave_out(pose[:3, 3], normal)
            elif near and (normal is None or touched):
                return
            elif near:
                self._barred.add(len(self._places) - 1)
            elif normal is None and touched:  # a contact that was lost may be no more than a light one
                self._barred.add(len(self._places))
        nx, ny, nz = (0.0, 0.0, 0.0) if normal is None else (LIFT * normal).tolist()
        column = self._column = self._column_at((x, y, z), (ax, ay, az))
        back = column is not None and max(abs(x - column[0]), abs(y - column[1])) < COLUMN
        known = float(column is not None), float(-az > UPRIGHT), float(back), float(self._on_border(x, y))
        self._places.add((x, y, z, x + nx, y + ny, z + nz, ax, ay, az, *known))
        self._turns.append(pose[:3, :3].copy())

    @staticmethod
    def _leads_into(row: tuple[float, ...], normal: np.ndarray) -> bool:
        """Whether the place off the surface, of a row (13,) of the table, lies in a surface with a normal (3,)."""
        x, y, z, off_x, off_y, off_z = row[:6]
        nx, ny, nz = normal.tolist()
        return bool((off_x - x) * nx + (off_y - y) * ny + (off_z - z) * nz < 0.0)

    def _leave_out(self, here: np.ndarray, normal: np.ndarray) -> None:
        """The last places near `here` (3,) that would lead into a surface with a normal (3,) are on no path back."""
        rows = self._places.rows()
        for k in range(len(rows) - 1, -1, -1):
            if np.abs(rows[k, :3] - here).max() >= AGAIN or (rows[k, OFF_SURFACE] - rows[k, :3]) @ normal >= 0.0:
                break
            self._barred.add(k)

    def _column_at(self, place: Vector, stick: Vector) -> tuple[float, ...] | None:
        """Where the sphere came down, x and y, and the stick's direction meanwhile; None once it has left that column.

        `place` m and `stick`, the direction, are those of the tip now.
        """
        (x, y, z), (ax, ay, az) = place, stick
        if z >= self._top - SPACING:  # a little lower where the arm lags behind
            self._descent = len(self._places)
            return x, y, ax, ay, az
        if self._column is None:
            return None
        cx, cy, bx, by, bz = self._column
        within = ax * bx + ay * by + az * bz > TURNED and max(abs(x - cx), abs(y - cy)) < SIDE
        under = within and bool(_in_the_way(self._places.rows()[self._descent :], x, y).any())
        return self._column if within and not under else None

    def __len__(self) -> int:
        return len(self._places)

    def highest_touch(self) -> float:
        """m, the largest height of the sphere's centre at which it touched something; -inf before that."""
        rows = self._places.rows()
        return float(rows[_touching(rows), 2].max(initial=-np.inf))

    def farthest(self, place: np.ndarray, known: int) -> float:
        """m, how far from a place (3,) the probe has been since it had been at `known` places."""
        return float(np.linalg.norm(self._places.rows()[known:, :3] - place, axis=1).max(initial=0.0))

    def clear_down_to(self, x: float, y: float) -> float:
        """m, the lowest height at (x, y) from which the sphere fits straight up to above all that may be there."""
        rows = self._places.rows()
        beside = np.maximum(np.abs(rows[:, 0] - x), np.abs(rows[:, 1] - y)) < self._side
        met = beside & _in_the_way(rows, x, y)
        beside &= rows[:, 2] > _reaches_up_to(rows[met], x, y).max(initial=-np.inf)
        near, above = rows[beside], self._open(rows, beside, self._came_down)
        level = min(self._top, float(rows[above, 2].min(initial=np.inf)))
        for z in np.sort(near[near[:, 2] < level, 2])[::-1].tolist():
            if level - z > GAP:
                break
            level = z
        return level

    def clear_from(self, place: np.ndarray) -> float:
        """m, the lowest height from which the sphere fits straight up, for an upright probe that is at a place (3,)."""
        level = self.clear_down_to(place.item(0), place.item(1))
        return min(level, place.item(2) + self._body)

    def stood_down_to(self, place: np.ndarray, beside: float = COLUMN) -> float:
        """m, the lowest height at which the upright probe has been over a place (3,), or no more than `beside` m from
        that; inf where it has not.
        """
        rows = self._places.rows()
        over = (np.abs(rows[:, :2] - place[:2]).max(axis=1, initial=0.0) <= beside) & (rows[:, STOOD] > 0.0)
        return float(rows[over, 2].min(initial=np.inf))

    def open_places(self, axis: int, place: float) -> np.ndarray:
        """(n, 3) m, places from which the probe may go straight up, within `BORDER` of a place [m] on one axis.

        It came down there, or it is on the area's border where nothing was touched: nothing stands there.
        """
        rows = self._places.rows()
        return rows[self._open(rows, np.abs(rows[:, axis] - place) < BORDER, self._came_down), :3]

    def open_around(self, place: np.ndarray, reach: float) -> np.ndarray:
        """(n, 3) m, places as in `open_places`, within `reach` m along x and y of a place (3,).

        Those beside a touch are left out: who comes down there again, and goes on level, would touch again.
        """
        from scipy.spatial import cKDTree

        rows = self._places.rows()
        near = np.abs(rows[:, :2] - place[:2]).max(axis=1, initial=0.0) < reach
        found, touched = rows[self._open(rows, near, self._came_down), :3], rows[near & _touching(rows), :2]
        if not (len(found) and len(touched)):
            return found
        return found[cKDTree(touched).query(found[:, :2])[0] > OFF_TOUCH]

    @property
    def upright(self) -> bool:
        """Whether the probe is held upright now."""
        last = self._places.last
        return last is None or last[STOOD] > 0.0

    def swept(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether the upright probe has been all along a straight level line between two places (3,), free of contact.

        It has been as low: a lower path may lead into what it passed above. A surface that was touched from where the
        line ends, or on it, blocks the path.
        """
        motion = end - begin
        length = float(np.sqrt(motion @ motion))
        if length < SPACING:
            return True
        rows = self._places.rows()
        # Few are as high: the others are not looked at.
        level = np.abs(rows[:, 2] - begin[2]) < SPACING + (1.0 + GAP / length) * abs(motion[2])
        rows = rows[level & (rows[:, STOOD] > 0.0)]
        touching = _touching(rows)
        rows = rows[:, :3] - begin
        along = rows @ (motion / length)
        beside = rows - along[:, None] * (motion / length)
        near = (np.abs(beside).max(axis=1) < SPACING) & (along > -GAP) & (along < length + GAP)
        if (near & touching & (along > SPACING)).any():
            return False
        places = np.sort(along[near & (beside[:, 2] < LOWER)])
        steps = np.diff(np.concatenate([[-SPACING], places, [length + SPACING]]))
        return bool(len(places) and steps.max() <= GAP)

    def return_path(self, distance: float = np.inf, wedged: bool = False) -> list[Pose] | None:
        """Back on the probe's path: for `distance` m, to where it came down, or to a top that it passed over; None
        where that is too far.

        Along a surface it leads a little off it, and a detour on it is left out. The probe fits in all of it, as fast
        as it likes. From a top the upright probe may go up in the column of its stick. Where the sphere is `wedged`
        between two surfaces, what leads off one of them leads into the other: near there the path leaves them by as
        much more as it is farther from there.
        """
        rows, all_back = self._places.rows(), not np.isfinite(distance)
        if len(rows) < 2:
            return None
        whole = np.ones(len(rows), dtype=bool)
        open_places = self._off_touches(self._open(rows, whole, JUST_THERE)) if all_back else [0]
        if not open_places:
            return None
        end, k, left = open_places[-1], len(rows) - 1, distance
        end += self._top_passed(rows[end:]) if all_back else 0
        places = [k]
        while k > end and left > 0.0:
            if len(places) == FARTHEST_BACK:
                if all_back:
                    return None
                break
            before = self._first_at(k, end)
            k = before if before < k else k - 1
            left -= float(np.abs(rows[k, OFF_SURFACE] - rows[places[-1], OFF_SURFACE]).max())
            places.append(k)
        return self._along(places, wedged)

    def _top_passed(self, rows: np.ndarray) -> int:
        """Index of the last of the rows (n, 13) at which the upright probe was on top of what it followed; else 0.

        It does not overhang there, nothing was touched higher around, and the probe has followed it down since then.
        """
        before, touching = len(self._places) - len(rows), np.flatnonzero(_touching(rows))
        places, rise = rows[touching, :3], (rows[touching, OFF_SURFACE] - rows[touching, :3])[:, 2]
        good = (rise >= NO_OVERHANG * LIFT) & (rows[touching, STOOD] > 0.0)
        for k in np.flatnonzero(good)[::-1].tolist():
            away = np.abs(places[:, :2] - places[k, :2]).max(axis=1) > AROUND_TOP
            followed_down = places[k:, 2][away[k:]].min(initial=np.inf) <= places[k, 2] - GAP
            highest = places[~away, 2].max() <= places[k, 2] + GAP
            if followed_down and highest and before + int(touching[k]) not in self._barred:
                return int(touching[k])
        return 0

    def _first_at(self, k: int, end: int) -> int:
        """Index from `end` on of the first place where the probe was held as at place `k`, and was as good as there."""
        rows = self._places.rows()[end : k + 1]
        near = np.abs(rows[:, OFF_SURFACE] - rows[-1, OFF_SURFACE]).max(axis=1) < SPACING
        near &= rows[:, STICK] @ rows[-1, STICK] > TURNED
        return end + int(np.argmax(near))

    def back_to(self, place: np.ndarray, reach: float) -> list[Pose] | None:
        """Back on the upright probe's path, to the latest place as high as `place` (3,) within `reach` m of it.

        None where the probe leans or has leaned, where that is too far back, and where a piece of the path is unknown.
        Inner edges are cut: off one of its faces the sphere would still touch the other.
        """
        rows = self._places.rows()[-FARTHEST_BACK:]
        near = np.abs(rows[:, 2] - place[2]) < BORDER
        near &= np.hypot(rows[:, 0] - place[0], rows[:, 1] - place[1]) < reach
        return self._back_to_one_of(near, SHORT)

    def back_to_column(self) -> list[Pose] | None:
        """Back on the upright probe's path, to the latest place from which it may go straight up as fast as it can.

        None where `back_to` has no path.
        """
        rows = self._places.rows()[-FARTHEST_BACK:]
        return self._back_to_one_of(self._open(rows, np.ones(len(rows), dtype=bool), JUST_THERE), FAR_COLUMN)

    def _back_to_one_of(self, wanted: np.ndarray, farthest: float) -> list[Pose] | None:
        """Back to the latest of the `wanted` (n,) of the last n places, `farthest` m at most; None as in `back_to`."""
        rows, found = self._places.rows()[-FARTHEST_BACK:], self._off_touches(wanted)
        if not found:
            return None
        path = rows[found[-1] :]
        steps = np.abs(np.diff(path[:, :3], axis=0))
        if not path[:, STOOD].all() or steps.max(initial=0.0) > BROKEN or steps.sum() > farthest:
            return None
        kept = _around_inner_edges(path)
        if kept is None:
            return None
        first = len(self._places) - len(rows) + found[-1]
        return self._along((first + kept[::-1]).tolist())

    def _off_touches(self, wanted: np.ndarray) -> list[int]:
        """Which of the `wanted` (n,) of the last n places are not next to a touch."""
        before = len(self._places) - len(wanted)
        return [k for k in np.flatnonzero(wanted).tolist() if before + k not in self._barred]

    @staticmethod
    def _open(rows: np.ndarray, wanted: np.ndarray, came_down: int) -> np.ndarray:
        """(n,) of the `wanted` (n,) rows, from which nothing is above: by a column of the table, or on the border.

        Where something was touched on the border the area is cut through an object: that may overhang there, too, near
        what was touched of it.
        """
        on_border, touching = rows[:, ON_BORDER] > 0.0, _touching(rows)
        border = wanted & on_border
        if border.any() and (on_border & touching).any():
            from scipy.spatial import cKDTree

            places = np.flatnonzero(border)
            apart, _ = cKDTree(rows[touching, :2]).query(rows[places, :2], p=np.inf)
            border[places[apart < CUT]] = False
        return border | (wanted & (rows[:, came_down] > 0.0))

    def _along(self, places: list[int], wedged: bool = False) -> list[Pose] | None:
        """The places with these indices, in this order; those that lie straight between others are left out.

        None where a light touch is next to all of them. `wedged` as in `return_path`.
        """
        rows = self._places.rows()
        places = [k for k in places if k not in self._barred]
        if not places:
            return None
        at, off = rows[places, :3], _no_lower(rows, places)
        if wedged:
            share = np.minimum(np.linalg.norm(at - at[0], axis=1) / WEDGED, 1.0)
            off = at + share[:, None] * (off - at)
        share_off = np.einsum("ij,ij->i", off - at, rows[places, OFF_SURFACE] - at) / LIFT**2
        chord = CHORD * np.where(_touching(rows[places]), np.clip(share_off, NEAREST, 1.0), 1.0)
        kept = path_corners(off, rows[places, STICK], chord, TURN)
        return [(off[i].copy(), self._turns[places[i]]) for i in kept]

    def _on_border(self, x: float, y: float) -> bool:
        """Whether a place is on the area's border, or beyond it."""
        low, high = self._area.lower, self._area.upper
        return min(x - low[0], high[0] - x, y - low[1], high[1] - y) < BORDER


def _no_lower(rows: np.ndarray, places: list[int]) -> np.ndarray:
    """(k, 3) m: the places off the surface of k rows, `LOWER` at most below where the sphere has been within `SIDE`.

    Off a surface that faces down there may be a floor below. Such a place lies farther to the side instead, by `SIDE`
    at most.
    """
    from scipy.spatial import cKDTree

    off = rows[places, OFF_SURFACE].copy()
    down = np.flatnonzero(off[:, 2] < rows[places, 2] - LOWER)
    if not len(down):
        return off
    flat = off[down, :2]
    low, high = flat.min(axis=0) - SIDE, flat.max(axis=0) + SIDE
    been = rows[((rows[:, :2] > low) & (rows[:, :2] < high)).all(axis=1), :3]
    for k, beside in zip(down.tolist(), cKDTree(been[:, :2]).query_ball_point(flat, SIDE, p=np.inf)):
        at = rows[places[k], :3]
        lowest = float(been[beside, 2].min(initial=at[2])) - LOWER
        if off[k, 2] < lowest:
            normal = (off[k] - at) / LIFT
            level = float(np.hypot(normal[0], normal[1]))
            aside = min((LIFT - normal[2] * (lowest - at[2])) / max(level, 1e-9), SIDE)
            off[k] = *(at[:2] + aside * normal[:2] / max(level, 1e-9)), lowest
    return off


def _around_inner_edges(rows: np.ndarray) -> np.ndarray | None:
    """(k,) indices of the rows (n, 13) of a path whose places off the surface are off all faces touched near them.

    In an inner edge each of two faces lies in front of the other one, and off one of them the sphere still touches the
    other; around an outer edge they lie behind. The edge is cut between a place on each side that is off all of what
    was touched in between; None where there is none.
    """
    from scipy.spatial import cKDTree

    at, off = rows[:, :3], rows[:, OFF_SURFACE]
    touching = np.flatnonzero(_touching(rows))
    faces, normals = at[touching], (off[touching] - at[touching]) / LIFT
    clear = np.ones(len(rows), dtype=bool)
    if len(touching):
        pairs = cKDTree(faces).query_pairs(AROUND, p=np.inf, output_type="ndarray")
        one, other = np.vstack([pairs, pairs[:, ::-1]]).T
        apart = faces[one] - faces[other]
        ahead = np.einsum("ij,ij->i", apart, normals[other])
        hollow = (ahead > IN_FRONT) & (-np.einsum("ij,ij->i", apart, normals[one]) > IN_FRONT)
        height = ahead + LIFT * np.einsum("ij,ij->i", normals[one], normals[other])
        clear[touching[one[hollow & (height < OFF)]]] = False
        clear[-1] = True  # there is the tip
    kept = np.flatnonzero(clear)
    for cut_at in np.flatnonzero(np.diff(kept) > 1).tolist():
        before, after = kept[cut_at], kept[cut_at + 1]
        cut = (touching > before) & (touching < after)
        for end in off[[before, after]]:
            if np.einsum("ij,ij->i", end - faces[cut], normals[cut]).min() < 0.5 * OFF:
                return None
    return kept


def _touching(rows: np.ndarray) -> np.ndarray:
    """(n,) bool: something was touched at the place of a row (n, 13) of the table."""
    touching: np.ndarray = (rows[:, OFF_SURFACE] != rows[:, :3]).any(axis=1)
    return touching


def _reaches_up_to(rows: np.ndarray, x: float, y: float) -> np.ndarray:
    """(n,) m, height of the sphere's centre at (x, y) on the plane that was touched at each of the rows (n, 13).

    On a steep one it is that of the touch itself: there the sphere is met on its flank.
    """
    at, out = rows[:, :3], (rows[:, OFF_SURFACE] - rows[:, :3]) / LIFT
    along = out[:, 0] * (x - at[:, 0]) + out[:, 1] * (y - at[:, 1])
    return at[:, 2] - np.where(out[:, 2] > STEEP, along / np.maximum(out[:, 2], STEEP), 0.0)


def _in_the_way(rows: np.ndarray, x: float, y: float) -> np.ndarray:
    """(n,) bool: at the place of a row (n, 13) of the table something was touched, into which the sphere would get at
    (x, y), as high.
    """
    at, off = rows[:, :3], rows[:, OFF_SURFACE]
    outwards = (off[:, 0] - at[:, 0]) * (x - at[:, 0]) + (off[:, 1] - at[:, 1]) * (y - at[:, 1])
    return outwards < -LIFT * COLUMN
