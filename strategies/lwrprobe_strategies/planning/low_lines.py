"""Lines below those of the grid, where these met nothing near a lower tread, or were given up.

Over a tall object the grid is driven so high that the body behind the stick clears whatever may be there. Once it is
known what is there, the probe may go lower beside it.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.contact_memory import NORMAL_Z, POINT, POINT_X, POINT_Y, POINT_Z
from lwrprobe_strategies.planning.lines import ON_LINE, Line, X, Y, Z
from lwrprobe_strategies.planning.upright_body import RISE, body

CELL = 0.002
"""m along a line, for which one height is kept."""
LOWER = 0.005
"""m that are gained at least: the radius of the sphere, down to which a pass shows that nothing is there."""
NEIGHBOURS = 2.5
"""Line spacings from what was touched, within which more of the object is looked for."""
UPWARDS = 0.7
"""Share of the normal along z, from which on a touch is one of a tread, which may go on lower beside the object."""
STEP = 0.005
"""m by which the body may make a line higher than at the border."""


def low_lines(contacts: np.ndarray, trail: np.ndarray, places: np.ndarray, pitch: float, task: Task) -> list[Line]:
    """Lines along y at `places` (n,) m, from the border as far in as the probe can pass lower than it has.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    pitch : m, between two lines
    task : the area, and the probe's body
    """
    if not len(contacts):
        return []
    low, high = float(task.area.lower[Y]), float(task.area.upper[Y])
    ys = np.linspace(low, high, max(round((high - low) / CELL), 1) + 1)
    step = float(ys[1] - ys[0])
    lines: list[Line] = []
    for x in np.sort(places).tolist():
        beside = contacts[np.abs(contacts[:, POINT_X] - x) < NEIGHBOURS * pitch]
        lowest = _lowest(contacts[:, POINT], x, ys, task)
        own = np.abs(trail[:, X] - x) < ON_LINE
        passed = _least(trail[own, Y], trail[own, Z], ys)
        mine = np.abs(contacts[:, X] - x) < ON_LINE
        touched = np.isfinite(_least(contacts[mine, Y], contacts[mine, Z], ys))
        near = np.isfinite(_least(beside[:, POINT_Y], beside[:, POINT_Z], ys, NEIGHBOURS * pitch))
        upwards = beside[beside[:, NORMAL_Z] > UPWARDS]
        tread = _least(upwards[:, POINT_Y], upwards[:, POINT_Z], ys, NEIGHBOURS * pitch)
        promising = (tread < passed - LOWER) | ~np.isfinite(passed)
        wanted = (passed > lowest + LOWER) & ~touched & near & promising
        nearer = ys - low <= high - ys
        # From the nearer border: nothing stands above the probe there.
        for side, sign, half in ((low, 1, nearer), (high, -1, ~nearer)):
            wants, needs, above = (values[::sign] for values in (wanted & half, lowest, passed))
            last = _farthest(wants, needs, above)
            if last is None or np.count_nonzero(wants[: last + 1]) * step < pitch:
                continue
            height = float(needs[: last + 1].max())
            lines.append(Line(Y, x, side, side + sign * last * step, height, low=True))
    return lines


def _lowest(points: np.ndarray, x: float, ys: np.ndarray, task: Task) -> np.ndarray:
    """(n,) m, lowest height of an upright probe at x and `ys` (n,) m at which its body clears the points (m, 3)."""
    lowest = np.full(len(ys), float(task.area.lower[Z]))
    for half, bottom in body(task):
        near = points[np.abs(points[:, X] - x) < half[X] + task.clearance_threshold + ON_LINE]
        tallest = -_least(near[:, Y], -near[:, Z], ys, half[Y] + task.clearance_threshold)
        lowest = np.maximum(lowest, tallest + RISE + task.clearance_threshold - bottom)
    return np.minimum(lowest, float(task.area.upper[Z]))


def _least(places: np.ndarray, heights: np.ndarray, ys: np.ndarray, reach: float = 0.0) -> np.ndarray:
    """(n,) least of the heights (m,) whose places (m,) are within a reach [m] of `ys` (n,), evenly spaced; else inf."""
    step = float(ys[1] - ys[0]) if len(ys) > 1 else CELL
    least = np.full(len(ys), np.inf)
    cell = np.clip(np.round((places - ys[0]) / step).astype(int), 0, len(ys) - 1)
    np.minimum.at(least, cell, heights)
    width = int(np.ceil(reach / step))
    padded = np.pad(least, width, constant_values=np.inf)
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).min(axis=1)


def _farthest(wanted: np.ndarray, lowest: np.ndarray, passed: np.ndarray) -> int | None:
    """Index of the last wanted place that a level pass from the first place reaches lower than what was passed."""
    height = np.maximum.accumulate(lowest)
    gained = wanted & (height < passed - LOWER)
    # What was touched, or passed as low already, ends a pass from outside only where the body would have to rise.
    far = np.flatnonzero(gained & (height <= lowest[0] + STEP))
    return int(far[-1]) if len(far) else None
