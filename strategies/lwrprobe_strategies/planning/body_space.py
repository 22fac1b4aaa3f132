"""Where the body behind the stick may go: it senses no contact, so it goes only where nothing can be.

Where all of the probe is known to fit, sphere and stick may go faster than where they may touch something.

Nothing is above the tallest that the area may hold. Nothing is on the area's border and beyond it, unless it was
touched there: then the area is cut through an object. Where the upright stick stood nothing is above the sphere. What
the sphere swept is free, and so is a square of the plan view above it if the sphere came up there to what is known to
be free: on the way up a steep side, right beside that. Under what overhangs it did not. Between two lines, no farther
apart than the spacing, the object is taken to be no taller than on either of them, half the distance to both sides; and
where it was touched, than by what a sphere that passes on both may leave between. Where the body itself has been it may
come back. All else counts as full up to the tallest.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import LinkShape, Task
from lwrprobe.mapping import BodyOverHeights, PlanView, SweptColumns
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.upright_body import body, tallest_possible

CELL = 0.001
"""m, edge of the squares in the plan view for which a height is kept."""
GRAIN = 0.003
"""m between two points of a link's surface that are looked at."""
STEP = 0.001
"""m between two places of a line that are looked at."""
SUNK = 0.2
"""Of the sphere's radius, by which something may be above its underside: contacts and the probe's place err."""
WORSE = 0.001
"""m by which the body may be deeper than it may go: a surface is left with a motion that is not quite level."""
WIDER = 2
"""Squares to all sides of where the body was, in which it may be again."""
STILL = 1e-5
"""m of depth that is no change."""
LOW = -1.0
"""m, height at which the body would be below all that may be there."""
EDGE = 0.0005
"""m beyond the distance that the body has to keep from what was touched, to which lines keep it: the map has cubes,
and the heights have squares."""
WIDE = 0.001
"""m by which the distance of two neighbouring lines may exceed the spacing."""


class BodySpace:
    """Heights in the plan view, above which the body may be.

    Parameters
    ----------
    task : the area, how tall the object may be, the probe's links
    spacing : m, between two lines

    Attributes
    ----------
    upright : (3, 3), the orientation of an upright tip
    under : m, by which the sphere of an upright probe comes in under what its stick passes
    """

    def __init__(self, task: Task, spacing: float) -> None:
        low, high = task.area.lower[:2], task.area.upper[:2]
        shape = tuple(np.ceil((high - low) / CELL).astype(int) + 1)
        self._low_x, self._low_y = low.tolist()
        self._stood = PlanView(shape, np.inf)
        self._top = tallest_possible(task)
        self._task, self._spacing, self.upright = task, spacing, task.orientation
        self._radius = task.probe.radius
        self._swept = SweptColumns(shape, _cap(self._radius) - SUNK * self._radius)
        gaps = 0.5 * CELL * np.arange(round((spacing + WIDE) / CELL) + 1)
        self._hidden = self._radius - np.sqrt(np.maximum(self._radius**2 - gaps**2, 0.0))
        self.under = task.probe.radius - task.probe.stick_radius
        behind = [link for link in task.probe.links if link.name != "stick"]
        points = np.concatenate([_surface(link) for link in behind] or [np.empty((0, 3))])
        self._column, self._height = (-1, -1, False), np.inf
        self._changed = True
        # Where the sphere's centre was when it touched something, and how high the points are that were touched.
        self._met, self._touched = np.zeros(shape, dtype=bool), np.full(shape, -np.inf)
        self._border = np.ones(shape, dtype=bool)
        self._border[1:-1, 1:-1] = False
        heights = np.where(self._border, -np.inf, self._top)
        self._body = BodyOverHeights(points, low, CELL, heights, self._top)
        self._clear = BodyOverHeights(points, low, CELL, heights, self._top)  # with what the body keeps from touches
        self._keep = _cap(task.clearance_threshold + EDGE)
        front = [_ball((1.0 - SUNK) * self._radius)]
        front += [_surface(link) for link in task.probe.links if link.name == "stick"]
        self._front = BodyOverHeights(np.concatenate(front), low, CELL, heights, self._top)

    @staticmethod
    def needed(task: Task) -> bool:
        """Whether the body of an upright probe can come down to what the area may hold at all."""
        bottom = min((bottom for _, bottom in body(task)), default=np.inf)
        return float(task.area.lower[Z]) + bottom < tallest_possible(task)

    def raise_top(self, task: Task) -> None:
        """The object may be taller than was known: as tall as a task says."""
        self._task, self._top, self._changed = task, tallest_possible(task), True
        self._body.raise_top(self._top)
        self._clear.raise_top(self._top)
        self._front.raise_top(self._top)
        self.survey()

    def note(self, pose: np.ndarray, point: np.ndarray | None) -> None:
        """The tip is at a pose (4, 4), and touches something at a `point` (3,) m or nothing; for every sample."""
        self._changed |= self._body.note(pose)
        x, y, z = pose[:3, 3].tolist()
        i, j = round((x - self._low_x) / CELL), round((y - self._low_y) / CELL)
        upright = -pose.item(2, 2) > UPRIGHT
        if point is not None:
            self._touch(*point.tolist())
            if upright:
                met = self._met[max(i - 1, 0) : max(i + 2, 0), max(j - 1, 0) : max(j + 2, 0)]
                self._changed |= not met.all()
                met[...] = True
        if (i, j, upright) == self._column and abs(z - self._height) < CELL:
            return
        self._column, self._height, self._changed = (i, j, upright), z, True
        self._swept.note(i, j, z)
        if upright:
            self._stood.lower(i, j, 1, z)

    def _touch(self, x: float, y: float, z: float) -> None:
        """A point was touched; it counts where it is the highest one in its square."""
        i, j = round((x - self._low_x) / CELL), round((y - self._low_y) / CELL)
        if 0 <= i < self._touched.shape[0] and 0 <= j < self._touched.shape[1] and z > self._touched[i, j]:
            self._touched[i, j], self._changed = z, True

    def survey(self) -> None:
        """Take what was noted since the last call into account."""
        if not self._changed:
            return
        self._changed = False
        stood = PlanView(self._met.shape, np.inf)
        under_stick = np.minimum(self._stood.heights - (1.0 - SUNK) * self._radius, self._top)
        heights = self._swept.free_from(under_stick)
        stood.heights[:] = np.where(self._border & ~self._met, -np.inf, heights)
        heights = np.minimum(stood.bridged(stood.heights < self._top, self._met, self._hidden), self._top)
        self._body.lower(heights, WIDER, WORSE)
        self._body.heights = heights
        self._clear.heights = np.maximum(heights, self._kept(self._touched))
        self._front.heights = self._clear.heights

    @property
    def unknown(self) -> np.ndarray:
        """(n, m) bool, squares of which nothing is known, as of the last survey."""
        full: np.ndarray = self._body.heights >= self._top
        return full

    def squares(self, places: np.ndarray) -> np.ndarray:
        """(k, 2), the squares in which places (k, 2) m lie, along x and along y; those beside the area lie outside."""
        return np.round((places - [self._low_x, self._low_y]) / CELL).astype(int)

    def places(self, rows: np.ndarray, columns: np.ndarray | int) -> np.ndarray:
        """(n, 2) m, of the squares in `rows` (n,) along x and `columns` (n,) along y."""
        squares = np.column_stack(np.broadcast_arrays(rows, columns))
        return np.asarray(np.array([self._low_x, self._low_y]) + CELL * squares)

    def _kept(self, touched: np.ndarray) -> np.ndarray:
        """(n, m) m, up to which the body keeps its distance from what was `touched` (n, m) m; -inf beside that."""
        from scipy.ndimage import grey_dilation

        kept: np.ndarray = grey_dilation(
            touched, footprint=self._keep > 0.0, structure=self._keep, mode="constant", cval=-np.inf
        )
        return kept

    def depth(self, poses: np.ndarray) -> np.ndarray:
        """(n,) m, how far the body is at tip poses (n, 4, 4) in what is not known to be free; negative above it."""
        return self._body.depth(poses)

    def clears(self, begin: np.ndarray, turned: np.ndarray, shift: np.ndarray) -> bool:
        """Whether it is plain that the body may go by `shift` (3,) m, from a tip pose to the orientation of another.

        It is for most motions, and costs a fraction of looking all along the path. False decides nothing.
        """
        return self._body.clears(begin, turned, shift)

    def allows(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether the body may go straight between two tip poses (4, 4), deeper nowhere than at the beginning."""
        if self.clears(begin, end, end[:3, 3] - begin[:3, 3]):
            return True
        depths = self._body.depth_on_path(begin, end)
        return bool(depths.max() <= max(float(depths[0]), WORSE) + STILL)

    def keeps_clear(self, pose: np.ndarray) -> bool:
        """Whether the body keeps its distance from what was touched, as of the last survey, at a tip pose (4, 4)."""
        return bool(self._clear.depth(pose[None])[0] <= 0.0)

    def knows(self, pose: np.ndarray) -> bool:
        """Whether all of the body is where it may be, at a tip pose (4, 4)."""
        return bool(self.depth(pose[None])[0] <= WORSE + STILL)

    def lowest(self, line: Line, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `lowest_at`, where the body has to come to each place from the line's beginning."""
        places, needed = self.lowest_at(line, rotation)
        return places, np.maximum.accumulate(needed)

    def lowest_at(self, line: Line, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (n,) m on a line's axis, and the least heights (n,) m of the sphere's centre at which the body may be
        at each, with the tip held by `rotation` (3, 3), up to a square beside the line. It keeps its distance there.
        """
        return _needed(self._clear, line, rotation)

    def fits(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether all of the probe is known to fit, straight from one tip pose (4, 4) to another.

        Sphere and stick keep the body's distance from what was touched. As of the last survey.
        """
        return bool(self._front.depth_on_path(begin, end).max() <= WORSE + STILL) and self.allows(begin, end)

    def fits_to(self, line: Line) -> float:
        """m on a line's axis, up to which `fits` holds from the line's beginning on; nothing fits where that is the
        beginning.
        """
        rotation = self.upright if line.rotation is None else line.rotation
        (places, front), (_, body) = _needed(self._front, line, rotation), _needed(self._clear, line, rotation)
        short = np.maximum(front, body) > line.height + WORSE + STILL
        return float(places[max(int(np.argmax(short)) - 1, 0)] if short.any() else line.end)


def _needed(part: BodyOverHeights, line: Line, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `BodySpace.lowest_at`, for a part of the probe."""
    count = max(int(np.ceil(abs(line.end - line.begin) / STEP)), 1) + 1
    poses, places = np.tile(np.eye(4), (3, count, 1, 1)), np.linspace(line.begin, line.end, count)
    poses[..., :3, :3], poses[..., line.axis, 3], poses[..., Z, 3] = rotation, places, LOW
    poses[..., line.aside, 3] = line.place + CELL * np.array([[-1.0], [0.0], [1.0]])
    return places, part.depth(poses.reshape(-1, 4, 4)).reshape(3, count).max(axis=0) + LOW


def _ball(radius: float) -> np.ndarray:
    """(k, 3) m, points on a ball around the tip."""
    count = int(np.ceil(np.pi * radius / GRAIN)) + 1
    rings = np.linspace(0.0, np.pi, count)
    turn = np.linspace(0.0, 2.0 * np.pi, 2 * count, endpoint=False)
    flat, height = radius * np.sin(rings), radius * np.cos(rings)
    return np.stack(
        [np.outer(flat, np.cos(turn)), np.outer(flat, np.sin(turn)), np.tile(height[:, None], 2 * count)], axis=-1
    ).reshape(-1, 3)


def _cap(radius: float) -> np.ndarray:
    """(2 k + 1, 2 k + 1) m, how far above its middle a ball reaches in the squares around; 0 beside it."""
    ticks = CELL * np.arange(-int(radius / CELL), int(radius / CELL) + 1)
    return np.sqrt(np.maximum(radius**2 - ticks[:, None] ** 2 - ticks**2, 0.0))


def _surface(link: LinkShape) -> np.ndarray:
    """(k, 3) m, points on the surface of a link of the probe, in the tip's frame."""
    if link.kind == "box":
        ticks = [np.linspace(-0.5, 0.5, int(np.ceil(edge / GRAIN)) + 1) * edge for edge in link.size]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
        points = grid[(np.abs(np.abs(grid) - 0.5 * np.array(link.size)) < 1e-9).any(axis=1)]
    else:
        radius, length = link.size[0], link.size[1] + (2.0 * link.size[0] if link.kind == "capsule" else 0.0)
        heights = np.linspace(-0.5, 0.5, int(np.ceil(length / GRAIN)) + 1) * length
        turn = np.linspace(0.0, 2.0 * np.pi, int(np.ceil(2.0 * np.pi * radius / GRAIN)), endpoint=False)
        ring = np.column_stack([np.cos(turn), np.sin(turn)])
        discs = [(radius * ring, z) for z in heights]
        discs += [(share * radius * ring, z) for z in heights[[0, -1]] for share in (0.0, 0.5)]
        points = np.concatenate([np.column_stack([disc, np.full(len(disc), z)]) for disc, z in discs])
    return points @ link.pose[:3, :3].T + link.pose[:3, 3]
