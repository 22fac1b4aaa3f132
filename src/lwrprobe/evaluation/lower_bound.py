"""What no exploration can beat: the path and the time that a surface takes at a given line pitch."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area, InputError
from lwrprobe.evaluation.reach import reach
from lwrprobe.scene.solid import Solid


def lower_bound_path(solid: Solid, radius: float, lowest: float, pitch: float, area: Area | None = None) -> float:
    """m of contact: a line leaves a stripe of one pitch behind, so the path is at least reachable area over pitch."""
    if not pitch > 0.0:
        raise InputError("pitch", pitch, "a positive length in metres")
    return reach(solid, radius, lowest, area).area / pitch


def lower_bound_time(
    solid: Solid,
    radius: float,
    lowest: float,
    pitch: float,
    contour_speed: float,
    area: Area | None = None,
    free_speed: float | None = None,
    acceleration: float | None = None,
) -> float:
    """s that an exploration takes at least: the contact path at `contour_speed` m/s.

    With `area`, the stripes that pass the object by are added, at `free_speed` m/s, and with `acceleration` m/s^2 the
    stop and start at both ends of every line, 2 v/a a line.
    """
    for name, value in (("contour_speed", contour_speed), ("free_speed", free_speed), ("acceleration", acceleration)):
        if value is not None and not value > 0.0:
            raise InputError(name, value, "a positive number")
    if not pitch > 0.0:
        raise InputError("pitch", pitch, "a positive length in metres")
    found = reach(solid, radius, lowest, area)
    seconds = found.area / pitch / contour_speed
    if area is None:
        return seconds
    size = area.upper - area.lower
    speed = free_speed or contour_speed
    seconds += max(size[0] * size[1] - found.footprint, 0.0) / pitch / speed
    if acceleration is not None:
        lines = int(np.ceil(size[0] / pitch)) + 1
        seconds += lines * 2.0 * speed / acceleration
    return float(seconds)
