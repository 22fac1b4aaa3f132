"""The upright probe: what of it stands above the stick, how low that may come, and what it keeps clear of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.lines import Line, Z

NEARER = 0.0005
"""m that the nearest of the contacts of one wall differ in distance."""
RISE = 0.0021
"""m by which something may reach further than what was touched of it: an edge of the cubes in the map, which the
clearance looks at, and the error of a contact."""

DEEP = 0.001
"""m within the sphere, from which on a touched place stands in its path: less is the error of a contact."""

Clear = Callable[[np.ndarray, np.ndarray], bool]
"""Whether the straight path may be taken from one place (3,) to another, or from one tip pose (4, 4) to another."""


def body(task: Task) -> list[tuple[np.ndarray, float]]:
    """What stands above the stick of an upright probe: how far it reaches along x and y, and how high its bottom is."""
    body = []
    for link in task.probe.links:
        if link.name == "stick":
            continue
        box = link.kind == "box"
        half = np.array(link.size[:2]) / 2.0 if box else np.full(2, link.size[0])
        length = link.size[2] if box else link.size[1]
        body.append((half + np.abs(link.pose[:2, 3]), -float(link.pose[2, 3]) - length / 2.0))
    return body


def tallest_possible(task: Task) -> float:
    """m, above which nothing of the object is.

    The area's top bounds the sphere's centre, so nothing that can be crossed is higher than that less the radius.
    """
    return min(float(task.area.upper[Z]) - task.probe.radius, task.tallest)


def line_height(task: Task) -> float:
    """m, lowest height of the sphere's centre at which the body above the stick clears whatever the area may hold."""
    tallest = tallest_possible(task)
    lowest = max((tallest - bottom for _, bottom in body(task)), default=-np.inf) + task.clearance_threshold
    return float(min(max(lowest, task.area.lower[Z]), task.area.upper[Z]))


def lowest_beside(line: Line, points: np.ndarray, task: Task) -> float:
    """m, lowest height of the sphere's centre at which the upright body clears what was touched, (n, 3) `points`,
    wherever on the line it is.
    """
    low, high = sorted((line.begin, line.end))
    lowest = float(task.area.lower[Z])
    for half, bottom in body(task):
        along, aside = half[line.axis] + task.clearance_threshold, half[line.aside] + task.clearance_threshold
        near = (points[:, line.axis] > low - along) & (points[:, line.axis] < high + along)
        near &= np.abs(points[:, line.aside] - line.place) < aside
        tallest = float(points[near, Z].max(initial=-np.inf))
        lowest = max(lowest, tallest + RISE + task.clearance_threshold - bottom)
    return min(lowest, float(task.area.upper[Z]))


def clear_of(points: np.ndarray, task: Task) -> Clear:
    """Whether the upright probe keeps its distance from the points (n, 3), or comes no nearer than at its ends.

    The sphere may touch what was touched, but not go through it.
    """
    sphere = task.probe.radius - DEEP
    parts = [(float(half.max()), bottom - task.clearance_threshold) for half, bottom in body(task)]
    parts = [(wide + task.clearance_threshold, low) for wide, low in [*parts, (task.probe.stick_radius, RISE)]]

    def clear(begin: np.ndarray, end: np.ndarray) -> bool:
        step, there = (end - begin)[:2], points[:, :2] - begin[:2]
        share = np.clip(there @ step / max(float(step @ step), 1e-12), 0.0, 1.0)
        within = _apart(points, begin, end) < sphere
        if (within & (np.linalg.norm(points - begin, axis=1) > sphere)).any():
            return False
        height = points[:, Z] - min(begin[Z], end[Z])
        near = np.hypot(*(there - share[:, None] * step).T)
        ends = np.minimum(np.hypot(*there.T), np.hypot(*(there - step).T))
        for wide, low in parts:
            beside = height > low
            if beside.any() and near[beside].min() < min(wide, float(ends[beside].min()) - NEARER):
                return False
        return True

    return clear


def _apart(points: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,) m from points (n, 3) to the straight path from one place (3,) to another."""
    step, there = end - begin, points - begin
    share = np.clip(there @ step / max(float(step @ step), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(there - share[:, None] * step, axis=1))
