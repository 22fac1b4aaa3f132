"""Lines in under what stands out over a side, with a leaning probe.

An upright stick comes no nearer to a side than what stands out above it. A probe that leans away from the side has the
sphere in front: it passes below, as far as the stick keeps clear of what was touched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import LinkShape, Task
from lwrprobe_strategies.planning.contact_memory import POINT
from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.low_sides import OVERLAP, SideOrientations, touched_sides, within_reach

STEP = 0.002
"""m between two places on a line that are looked at, and between the contacts that count."""
DEEPER = 0.003
"""m farther in, for which the probe leans more."""
STICK = 0.0015
"""m that the stick keeps from what was touched: it bends."""
LEANING = float(np.cos(np.radians(2.0)))
"""Share of the stick along the vertical, below which it leans."""
ONWARD = 0.010
"""m farther in than that the line ends: a side that leads up lets the sphere in farther."""
BESIDE = 2.5
"""Line spacings across a line, within which what was touched may meet the probe."""


def leaning_lines(
    contacts: np.ndarray,
    axis: int,
    places: np.ndarray,
    pitch: float,
    task: Task,
    orientations: SideOrientations,
    reachable: Callable[[Line], bool],
) -> list[Line]:
    """From the border in under each side that was touched on a line, where it was not over more than a pitch in height.

    Parameters
    ----------
    contacts : (m, 10) as in `ContactMemory.contacts`
    axis : along which the lines lead
    places : (n,) m, of the lines on the other horizontal axis
    pitch : m, between two lines
    task : the area, the probe, and what it keeps from what was touched
    orientations : how the probe may be held
    reachable : whether the arm can drive a line
    """
    lines = []
    for side in touched_sides(contacts, axis, places, task.area):
        above = side.facing[np.argsort(side.facing[:, Z])]
        heights = np.append(task.area.lower[Z], above[:, Z])
        widest = int(np.argmax(np.diff(heights)))
        height, low, middle = float(heights[widest]), above[widest], float(side.on_line[:, axis].mean())
        if not side.outer or low[Z] - height <= pitch:
            continue
        around = _thinned(contacts[np.abs(contacts[:, 1 - axis] - side.place) < BESIDE * pitch, POINT])
        ceiling = float(low[Z]) + OVERLAP
        whole = Line(axis, side.place, side.begin, middle, height, low=True, ceiling=ceiling, expected=height)
        inmost, best = float(low[axis]) - side.sign * task.probe.radius, None  # less would not be worth a line
        for rotation in orientations(side.sign * np.eye(3)[axis]):
            end = _inmost(whole, rotation, around, task) if -rotation[Z, Z] < LEANING else side.begin
            if side.sign * (inmost - end) > 0.0:
                inmost, best = end - side.sign * DEEPER, replace(whole, end=end, rotation=rotation)
        best = within_reach(best, reachable) if best is not None else None
        if best is not None:
            end = best.end + best.sign * ONWARD
            lines.append(replace(best, end=min(end, middle) if best.sign > 0.0 else max(end, middle)))
    return lines


def _inmost(line: Line, rotation: np.ndarray, points: np.ndarray, task: Task) -> float:
    """m on the line's axis, as far as the probe held by `rotation` (3, 3) keeps clear of points (n, 3)."""
    along = np.arange(0.0, abs(line.end - line.begin), STEP)
    centres = np.array([line.at(line.begin + line.sign * gone) for gone in along.tolist()]).reshape(-1, 3)
    near = np.zeros(len(along), np.bool_)
    for link in task.probe.links:
        keep = STICK if link.name == "stick" else task.clearance_threshold
        near |= _distances(link, rotation, centres, points) < keep
    last = int(np.argmax(near)) if near.any() else len(along)
    return line.begin + line.sign * STEP * max(last - 1, 0)


def _distances(link: LinkShape, rotation: np.ndarray, centres: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(m,) m, from a link to the nearest of points (n, 3), with the sphere at each of centres (m, 3).

    The link counts as the capsule around it.
    """
    middle, axis = rotation @ link.pose[:3, 3], rotation @ link.pose[:3, Z]
    radius = link.size[0] if link.kind != "box" else 0.5 * float(np.hypot(link.size[0], link.size[1]))
    half = 0.5 * link.size[-1]
    offset = points - (centres + middle)[:, None]
    gone = np.clip(offset @ axis, -half, half)
    apart = np.linalg.norm(offset - gone[..., None] * axis, axis=2)
    return np.asarray(apart.min(axis=1, initial=np.inf) - radius)


def _thinned(points: np.ndarray) -> np.ndarray:
    """One of the points (n, 3) m in each cell."""
    return points[np.unique(np.round(points / STEP).astype(np.int64), axis=0, return_index=True)[1]]
