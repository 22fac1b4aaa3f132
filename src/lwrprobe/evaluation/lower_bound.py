"""What no exploration can beat: the path and the time that a surface takes at a given line pitch."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area, InputError
from lwrprobe.evaluation.reach import Reach

STEEP = float(np.sqrt(0.5))
"""Share of the normal along z, below which a face is a wall."""


def lower_bound_path(found: Reach, pitch: float) -> float:
    """m of contact: a line leaves a stripe of one pitch behind, so the path is at least reachable area over pitch."""
    if not pitch > 0.0:
        raise InputError("pitch", pitch, "a positive length in metres")
    return found.area / pitch


def lower_bound_time(
    found: Reach,
    pitch: float,
    contour_speed: float,
    area: Area | None = None,
    free_speed: float | None = None,
    acceleration: float | None = None,
    descent_speed: float | None = None,
) -> float:
    """s that an exploration of what is within reach takes at least: the contact path at `contour_speed` m/s.

    With `area`, the stripes that pass the object by are added, at `free_speed` m/s, and with `acceleration` m/s^2 the
    stop and start at both ends of every line, 2 v/a a line. With `descent_speed`, m/s, half of what is steeper than
    45 degrees is counted at that speed: a line over an object leads down one of two walls, stick first towards a foot
    that was not touched before, and the force limit gives the speed for that.
    """
    for name, value in (
        ("contour_speed", contour_speed),
        ("free_speed", free_speed),
        ("acceleration", acceleration),
        ("descent_speed", descent_speed),
    ):
        if value is not None and not value > 0.0:
            raise InputError(name, value, "a positive number")
    seconds = lower_bound_path(found, pitch) / contour_speed
    if descent_speed is not None and len(found.normals):
        steep = float((np.abs(found.normals[:, 2]) < STEEP).mean()) * found.area
        seconds += 0.5 * steep / pitch * (1.0 / min(descent_speed, contour_speed) - 1.0 / contour_speed)
    if area is None:
        return seconds
    size = area.upper - area.lower
    speed = free_speed or contour_speed
    seconds += max(size[0] * size[1] - found.footprint, 0.0) / pitch / speed
    if acceleration is not None:
        lines = int(np.ceil(size[0] / pitch)) + 1
        seconds += lines * 2.0 * speed / acceleration
    return float(seconds)
