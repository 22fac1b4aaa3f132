"""Where the body behind the stick may go: it feels nothing, so it goes only where nothing can be.

Nothing is above the tallest that the area may hold. Nothing is on the area's border and beyond it, unless it was
touched there: then the area is cut through an object. Where the upright stick stood nothing is above the sphere.
Between two lines, no farther apart than the spacing, the object is taken to be no taller than on either of them, half a
spacing to both sides. Where the body itself has been it may come back. All else counts as full up to the tallest.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import LinkShape, Task
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.paths import body

CELL = 0.001
"""m, edge of the squares in the plan view for which a height is kept."""
GRAIN = 0.003
"""m between two points of a link's surface that are looked at."""
STEP, TURN = 0.002, 0.05
"""m and rad between two poses of a motion that are looked at."""
BELOW = 0.8
"""Of the sphere's radius, as far below its centre nothing is in the squares around, where it touches nothing."""
WORSE = 0.001
"""m by which the body may be deeper than it may go: a surface is left with a motion that is not quite level."""
WIDER = 2
"""Squares to all sides of where the body was, in which it may be again."""
STILL = 1e-5
"""m of depth that is no change."""
ALIKE = 1e-3
"""Largest difference between two rotation matrices that count as one: a fifth of a millimetre at the body's far end."""
LOW = -1.0
"""m, height at which the body would be below all that may be there."""
WIDE = 0.001
"""m by which the distance of two neighbouring lines may exceed the spacing."""


class BodySpace:
    """Heights in the plan view, above which the body may be.

    Parameters
    ----------
    task : the area, how tall the object may be, the probe's links
    spacing : m, between two lines
    """

    def __init__(self, task: Task, spacing: float) -> None:
        low, high = task.area.lower[:2], task.area.upper[:2]
        shape = tuple(np.ceil((high - low) / CELL).astype(int) + 1)
        self._low, self._last = low.copy(), np.array(shape) - 1
        self._stood = np.full(shape, np.inf)
        self._top = min(float(task.area.upper[Z]) - task.probe.radius, task.tallest)
        self._task, self._spacing = task, spacing
        self._below = BELOW * task.probe.radius
        behind = [link for link in task.probe.links if link.name != "stick"]
        self._points: np.ndarray = np.concatenate([_surface(link) for link in behind] or [np.empty((0, 3))])
        self._column: tuple[int, int, float] = (-1, -1, np.inf)
        self._changed = True
        self._met, self._border = np.zeros(shape, dtype=bool), np.ones(shape, dtype=bool)
        self._border[1:-1, 1:-1] = False
        self._swept, self._last_swept = np.full(shape, np.inf), np.zeros((4, 4))
        self._height = np.where(self._border, -np.inf, self._top)
        self._rotation, self._turned, self._lowest = np.zeros((3, 3)), self._points, 0.0
        self._extents = (0.0, 0.0, 0.0, 0.0)  # m: left, right, front and back of the tip's origin

    @property
    def needed(self) -> bool:
        """Whether the body of an upright probe can come down to what the area may hold at all."""
        bottom = min((bottom for _, bottom in body(self._task)), default=np.inf)
        return float(self._task.area.lower[Z]) + bottom < self._top

    def note(self, pose: np.ndarray, touches: bool) -> None:
        """The tip is at a pose (4, 4), and touches something or nothing; called with every sample."""
        self._sweep(pose)
        if -pose.item(2, 2) <= UPRIGHT:
            return
        x, y, z = pose[:3, 3].tolist()
        z -= 0.0 if touches else self._below
        i, j = round((x - self._low.item(0)) / CELL), round((y - self._low.item(1)) / CELL)
        if (i, j) == self._column[:2] and z >= self._column[2]:
            return
        self._column, self._changed = (i, j, z), True
        near = slice(max(i - 1, 0), max(i + 2, 0)), slice(max(j - 1, 0), max(j + 2, 0))
        np.minimum(self._stood[near], z, out=self._stood[near])
        self._met[near] |= touches

    def survey(self) -> None:
        """Take what was noted since the last call into account."""
        if not self._changed:
            return
        self._changed = False
        stood = self._stood.copy()
        stood[self._border & ~self._met] = -np.inf
        known = stood < self._top
        between = np.minimum(_between(stood, known, self._spacing), _between(stood.T, known.T, self._spacing).T)
        swept = minimum_filter(self._swept, 2 * WIDER + 1) + WORSE
        self._height = np.minimum(np.minimum(np.where(known, stood, between), swept), self._top)

    def _sweep(self, pose: np.ndarray) -> None:
        """The body is there itself, so nothing else is: it may come back."""
        points = self._at(pose[:3, :3])
        if pose.item(2, 3) + self._lowest >= self._top or np.abs(pose - self._last_swept)[:3].max() < GRAIN / 3.0:
            return
        self._last_swept, self._changed = pose.copy(), True
        i, j, z, inside = self._cells_of(points, pose)
        np.minimum.at(self._swept, (i[inside], j[inside]), z[inside])

    def _cells_of(self, points: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Squares (n,) and (n,) of the points, the nearest ones outside; heights (n,) m, and which are inside (n,)."""
        cells = np.round((points[:, :2] + (pose[:2, 3] - self._low)) / CELL).astype(np.int64)
        inside: np.ndarray = np.logical_and.reduce((cells > 0) & (cells < self._last), axis=1)
        i, j = np.clip(cells, 0, self._last).T
        return i, j, points[:, Z] + pose[2, 3], inside

    def depth(self, poses: np.ndarray) -> np.ndarray:
        """(n,) m, how far the body is at tip poses (n, 4, 4) in what is not known to be free; negative above it."""
        depths = np.full(len(poses), -np.inf)
        for k, pose in enumerate(poses):
            points = self._at(pose[:3, :3])
            if pose[2, 3] + self._lowest >= self._top:
                continue
            i, j, z, _ = self._cells_of(points, pose)
            depths[k] = (self._height[i, j] - z).max()
        return depths

    def allows(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether the body may go straight between two tip poses (4, 4), deeper nowhere than at the beginning."""
        if _alike(begin, end) and self._above_all_between(begin, end):
            return True
        depths = self.depth(_straight(begin, end))
        return bool(depths.max() <= max(float(depths[0]) + STILL, WORSE))

    def knows(self, pose: np.ndarray) -> bool:
        """Whether all of the body is where it may be, at a tip pose (4, 4)."""
        return bool(self.depth(pose[None])[0] <= WORSE)

    def _above_all_between(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether the body's lowest point is above all that may be within a rectangle around both ends of a motion.

        Most motions are, and this costs a tenth of the body's depth on the path.
        """
        self._at(begin[:3, :3])
        lowest = min(begin.item(2, 3), end.item(2, 3)) + self._lowest
        if lowest >= self._top:
            return True
        (ax, ay), (bx, by) = begin[:2, 3].tolist(), end[:2, 3].tolist()
        x, y = self._low.tolist()
        left, right, front, back = self._extents
        i, j = int((min(ax, bx) + left - x) / CELL), int((min(ay, by) + front - y) / CELL)
        k, m = int((max(ax, bx) + right - x) / CELL) + 2, int((max(ay, by) + back - y) / CELL) + 2
        last_i, last_j = self._last.tolist()
        near = self._height[min(max(i, 0), last_i) : max(k, 1), min(max(j, 0), last_j) : max(m, 1)]
        return float(near.max()) <= lowest

    def lowest(self, line: Line, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (n,) m on a line's axis, and the least heights (n,) m of the sphere's centre with which the body may
        come from the line's beginning to each, with the tip held by `rotation` (3, 3).
        """
        count = max(int(np.ceil(abs(line.end - line.begin) / STEP)), 1) + 1
        poses, places = np.tile(np.eye(4), (count, 1, 1)), np.linspace(line.begin, line.end, count)
        poses[:, :3, :3] = rotation
        poses[:, line.aside, 3], poses[:, line.axis, 3], poses[:, Z, 3] = line.place, places, LOW
        return places, np.maximum.accumulate(self.depth(poses) + LOW)

    def _at(self, rotation: np.ndarray) -> np.ndarray:
        """(k, 3) m, the body's points from the tip's origin on, in the world's axes."""
        if np.abs(rotation - self._rotation).max() > ALIKE:
            self._rotation, self._turned = rotation.copy(), self._points @ rotation.T
            self._lowest = float(self._turned[:, Z].min(initial=np.inf))
            low = self._turned[:, :2].min(axis=0, initial=np.inf)
            high = self._turned[:, :2].max(axis=0, initial=-np.inf)
            self._extents = low.item(0), high.item(0), low.item(1), high.item(1)
        return self._turned


def _between(stood: np.ndarray, known: np.ndarray, spacing: float) -> np.ndarray:
    """Heights between two known columns along the first axis, no farther apart than the spacing; inf elsewhere."""
    half, farthest = round(0.5 * spacing / CELL), round((spacing + WIDE) / CELL)
    tall = maximum_filter1d(np.where(np.isinf(stood), -np.inf, stood), 2 * half + 1, axis=1, mode="nearest")
    place = np.arange(len(stood))[:, None]
    last = np.maximum.accumulate(np.where(known, place, -10 * len(stood)), axis=0)
    following = np.minimum.accumulate(np.where(known, place, 10 * len(stood))[::-1], axis=0)[::-1]
    near = following - last <= farthest
    column = np.arange(stood.shape[1])[None, :]
    ends = [tall[np.clip(index, 0, len(stood) - 1), column] for index in (last, following)]
    return np.where(near, np.maximum(*ends), np.inf)


def _alike(begin: np.ndarray, end: np.ndarray) -> bool:
    """Whether the tip is held alike in two poses (4, 4)."""
    return float(np.abs(end[:3, :3] - begin[:3, :3]).max()) <= ALIKE


def _straight(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n, 4, 4) tip poses from one to another, both included: the place goes evenly, the orientation about one axis."""
    motion = end[:3, 3] - begin[:3, 3]
    turn = np.zeros(3)
    if not _alike(begin, end):
        turn = Rotation.from_matrix(end[:3, :3] @ begin[:3, :3].T).as_rotvec()
    count = max(int(np.ceil(np.sqrt(motion @ motion) / STEP)), int(np.ceil(np.sqrt(turn @ turn) / TURN)), 1) + 1
    share = np.linspace(0.0, 1.0, count)
    poses = np.tile(begin, (count, 1, 1))
    poses[:, :3, 3] += share[:, None] * motion
    if turn.any():
        poses[:, :3, :3] = Rotation.from_rotvec(share[:, None] * turn).as_matrix() @ begin[:3, :3]
    return poses


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
