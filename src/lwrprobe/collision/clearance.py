"""Distance between the robot's links and the map, the table, known meshes and each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from lwrprobe.collision import clearance_kernels as kernels
from lwrprobe.collision import shape_kernels
from lwrprobe.collision.link_rows import NO_FRAMES, link_rows
from lwrprobe.collision.sweep import MotionStep, smallest_along
from lwrprobe.compiled import entry
from lwrprobe.contracts import Clearance, InputError, LinkShape, UnknownNameError, as_pose
from lwrprobe.mapping import VoxelMap


class ClearanceQuery:
    """Nearest pair between link shapes and the occupied voxels of a map, which may grow between the calls.

    Each voxel is a solid cube. The answer is exact to 0.2 um; 0 means that a link and a voxel share a point.

    Parameters
    ----------
    links : shapes of the robot; those carried by an arm's link frame need `link_frames` in every call
    voxels : read at every call, never copied
    obstacles : known triangle meshes (`TriangleMesh`, world frame) that the links must not touch either; they go
        through python-fcl, which is loaded only when there is one
    table : the table's plane (4,), its unit normal and how far [m] it lies along that from the world's origin; None
        where there is none

    Raises
    ------
    InputError : for a link kind or carrier that is not known, for a pose that is no rigid motion, for missing frames,
        for a table that is no plane
    """

    def __init__(
        self,
        links: Sequence[LinkShape],
        voxels: VoxelMap,
        obstacles: Sequence[Any] = (),
        table: np.ndarray | None = None,
    ) -> None:
        self.links = tuple(links)
        self.voxels = voxels
        self._table = None if table is None else _plane(table)
        self._rows = link_rows(links)
        self._frames_needed = int(self._rows[:, shape_kernels.CARRIER].max(initial=0.0))
        self._names = [link.name for link in links]
        self._call = _entry()
        self._obstacles = _obstacles(self.links, obstacles) if obstacles else None

    def nearest(self, tip_pose: Any, link_frames: Any = None) -> Clearance:
        """Nearest pair at a tip pose (SE3 or (4, 4)) and link frames (m, 4, 4) in the world; `inf` without a voxel."""
        return self._nearest(*self._poses(tip_pose, link_frames))

    def nearest_into(self, tip: np.ndarray, frames: np.ndarray, answer: np.ndarray) -> None:
        """The voxels' part of `nearest` for loops: nothing is checked, and an array of another type ends the process.

        `tip` (4, 4) and `frames` (m, 4, 4; `NO_FRAMES` where no link needs one) contiguous float64. `answer` (8,):
        distance, point on the robot (3), point on the map (3), number of the link (-1 without any voxel).
        """
        self._call(self.voxels.occupied_words, self._rows, tip, frames, answer)

    def nearest_batch(self, tip_poses: np.ndarray, link_frames: np.ndarray | None = None) -> np.ndarray:
        """Answers (n, 8) as in `nearest_into` for tip poses (n, 4, 4) and link frames (n, m, 4, 4): voxels alone."""
        tips = _stack(tip_poses, "tip_poses", (4, 4))
        if link_frames is None:
            frames = np.empty((len(tips), 0, 4, 4))
        else:
            frames = _stack(link_frames, "link_frames", (-1, 4, 4))
        if len(frames) != len(tips):
            raise InputError("link_frames", frames.shape, f"one set of frames a pose, {len(tips)}")
        self._require(frames.shape[1])
        answers = np.empty((len(tips), kernels.ANSWER))
        kernels.nearest_batch(self.voxels.occupied_words, self._rows, tips, frames, answers)
        return answers

    def ahead(
        self,
        pose_a: Any,
        pose_b: Any,
        frames_a: Any = None,
        frames_b: Any = None,
        tolerance: float = 1e-4,
        enough: float = np.inf,
    ) -> Clearance:
        """Smallest clearance on the path from one pose to another: never too large, hardly too small.

        The tip's origin goes straight, the orientation turns about one axis; link frames likewise, each by itself. The
        distance is a lower bound, short by at most `tolerance` [m] or 1/2000 of the longest path of a link's point.
        With `enough` [m] the search ends as soon as no part of the path can come nearer than that. The witness points
        belong to the worst place that was evaluated.
        """
        step = self._step(pose_a, pose_b, frames_a, frames_b)
        answer = np.empty(kernels.ANSWER)

        def distance_at(fraction: float) -> float:
            if self._obstacles is not None:
                return self._nearest(*step.at(fraction)).distance
            self.nearest_into(*step.at(fraction), answer)
            return float(answer[kernels.DISTANCE])

        distance, where = smallest_along(distance_at, step.travel, *_limits(tolerance, enough))
        found = self._nearest(*step.at(where))
        found.distance = distance
        return found

    def table_ahead(
        self, pose_a: Any, pose_b: Any, frames_a: Any = None, frames_b: Any = None, tolerance: float = 1e-4
    ) -> tuple[float, str]:
        """Smallest distance [m] of a link from the table along a step, as in `ahead`, and the link's name.

        0 where a link touches the table or is below it.
        """
        step = self._step(pose_a, pose_b, frames_a, frames_b)
        limits = _limits(tolerance, np.inf)
        distance, where = smallest_along(lambda t: self._above_table(*step.at(t))[0], step.travel, *limits)
        return distance, self._above_table(*step.at(where))[1]

    def self_clearance(
        self, pairs: Sequence[tuple[str, str]], tip_pose: Any, link_frames: Any = None
    ) -> tuple[float, tuple[str, str] | None]:
        """Smallest distance [m] between the given pairs of links (by name), 0 in collision, and which pair it is."""
        numbers, answer = self._numbers(pairs), np.empty(kernels.ANSWER)
        kernels.nearest_among(self._placed(*self._poses(tip_pose, link_frames)), numbers, answer)
        which = int(answer[kernels.WHO])
        return float(answer[kernels.DISTANCE]), pairs[which] if which >= 0 else None

    def _nearest(self, tip: np.ndarray, frames: np.ndarray) -> Clearance:
        answer = np.empty(kernels.ANSWER)
        self.nearest_into(tip, frames, answer)
        who = int(answer[kernels.WHO])
        found = Clearance(float(answer[0]), answer[1:4], answer[4:7], self._names[who] if who >= 0 else "")
        if self._obstacles is not None and found.distance > 0.0:
            return self._obstacles.nearest(self._placed(tip, frames), found)
        return found

    def _above_table(self, tip: np.ndarray, frames: np.ndarray) -> tuple[float, str]:
        if self._table is None or not self.links:
            return np.inf, ""
        answer = np.empty(kernels.ANSWER)
        kernels.nearest_to_plane(self._placed(tip, frames), self._table, answer)
        return float(answer[kernels.DISTANCE]), self._names[int(answer[kernels.WHO])]

    def _step(self, pose_a: Any, pose_b: Any, frames_a: Any, frames_b: Any) -> MotionStep:
        first, last = (
            np.concatenate([tip[None], frames])
            for tip, frames in (self._poses(pose_a, frames_a, "pose_a"), self._poses(pose_b, frames_b, "pose_b"))
        )
        if first.shape != last.shape:
            raise InputError("frames_b", last.shape, f"as many as frames_a, {len(first) - 1}")
        return MotionStep(self._rows, first, last)

    def _numbers(self, pairs: Sequence[tuple[str, str]]) -> np.ndarray:
        for name in (name for pair in pairs for name in pair):
            if name not in self._names:
                raise UnknownNameError("link", name, self._names)
        numbers = [self._names.index(name) for pair in pairs for name in pair]
        return np.array(numbers, np.int64).reshape(-1, 2)

    def _placed(self, tip: np.ndarray, frames: np.ndarray) -> np.ndarray:
        placed = np.empty(self._rows.shape)
        shape_kernels.place(self._rows, tip, frames, placed)
        return placed

    def _poses(self, tip_pose: Any, link_frames: Any, field: str = "tip_pose") -> tuple[np.ndarray, np.ndarray]:
        tip = _pose(tip_pose, field)
        frames = NO_FRAMES if link_frames is None else _stack(link_frames, "link_frames", (4, 4))
        self._require(len(frames))
        return tip, frames

    def _require(self, frames: int) -> None:
        if frames < self._frames_needed:
            raise InputError("link_frames", f"{frames} frames", f"at least {self._frames_needed}, one a link frame")


@cache
def _entry() -> Callable:
    words, rows, answer = np.empty(0, np.int64), np.empty((0, 0)), np.empty(0)
    return entry(kernels.nearest, words, rows, np.eye(4), NO_FRAMES, answer)


def _plane(value: Any) -> np.ndarray:
    plane = np.ascontiguousarray(value, np.float64)
    if plane.shape != (4,) or not np.isfinite(plane).all() or abs(np.linalg.norm(plane[:3]) - 1.0) > 1e-9:
        raise InputError("table", value, "(4,): a unit normal and a finite distance from the origin")
    return plane


def _pose(value: Any, field: str) -> np.ndarray:
    """Contiguous (4, 4); what is one already is checked in compiled code, the rest by the contract's own rules."""
    plain = type(value) is np.ndarray and value.dtype.char == "d" and value.shape == (4, 4)
    if plain and value.flags.c_contiguous and shape_kernels.is_rigid(value):
        return value
    return np.ascontiguousarray(as_pose(value, field))


def _limits(tolerance: float, enough: float) -> tuple[float, float]:
    if not tolerance >= 1e-6:
        raise InputError("tolerance", tolerance, "metres, at least 1e-6")
    if not enough >= 0.0:
        raise InputError("enough", enough, "metres, at least 0")
    return float(tolerance), float(enough)


def _stack(poses: Any, field: str, shape: tuple[int, ...]) -> np.ndarray:
    """(n, *shape) contiguous poses; -1 in `shape` stands for any number."""
    value = np.ascontiguousarray(poses, np.float64)
    fits = value.ndim == len(shape) + 1 and all(want in (-1, have) for want, have in zip(shape, value.shape[1:]))
    if not fits or not np.isfinite(value).all():
        raise InputError(field, value.shape, f"finite poses of the shape (n, {', '.join(map(str, shape))})")
    return value


def _obstacles(links: tuple[LinkShape, ...], meshes: Sequence[Any]) -> Any:
    from lwrprobe.collision.mesh_obstacles import MeshObstacles

    return MeshObstacles(links, meshes)
