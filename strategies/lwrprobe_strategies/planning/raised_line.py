"""A line that goes on higher up, above what the stick has met."""

from __future__ import annotations

from dataclasses import replace

from lwrprobe.contracts import Observation, Task
from lwrprobe_strategies.planning.lines import Line, Z

RAISE = 0.0025
"""m by which a line is raised at least where the stick has been touched: half of the sphere's radius."""
BELOW = 0.5
"""Radii below an edge that the stick has met, where the sphere's centre is to meet it: at the sphere's top, where the
stick begins, nobody could tell which of the two is touched."""


def above_what_was_met(line: Line, seen: Observation, task: Task, back: float, touched: float) -> Line | None:
    """The rest of a line from `back` m before here on; None where it would leave the area.

    A line that was raised before goes higher than that: its own way down to a foot may lead in under the same again.
    Where it has led down by itself, it did so from what it `touched` up to that height [m], and would again.
    """
    here = seen.pose[:3, 3]
    height = float(here[Z]) + max(RAISE, height_met(seen) - BELOW * task.probe.radius)
    if line.raised:
        led_down = float(here[Z]) < line.height
        height = max(height, (max(line.height, touched) if led_down else line.height) + RAISE)
    if height > task.area.upper[Z]:
        return None
    begin = float(here[line.axis]) - line.sign * back
    return replace(line, begin=begin, height=height, on_surface=False)


def height_met(seen: Observation) -> float:
    """m above the sphere's centre, of what touches the stick or has come near it."""
    here = seen.pose[:3, 3]
    if seen.contact is not None:
        return float(seen.contact.point[Z] - here[Z])
    near = seen.clearance
    if near is None or not near.threatens or near.link != "stick":
        return 0.0
    return float(near.on_map[Z] - here[Z])
