"""Where a reference sphere is touched: orientations of the probe, and normals for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, repeat
from math import cos, pi, sin

import numpy as np

from lwrprobe_strategies.planning.lines import UP

Lean = tuple[float, float, float]
"""Orientation of the probe against that of the start: tilt, direction of the tilt, turn about the stick [rad]."""
LEANS = (1.45, 0.8, 1.45, 0.0)
"""rad between the normals that are touched and the stick, in turn: across it, between, and along it. Across it the
approach is fast: those show where the sphere is, and the slow one along the stick begins near it."""
WORTH = (1.0, 0.3, 1.0, 0.5)
"""How many of each of these are made where the time does not suffice: those across the stick are quick and tell of
offset, length and torque; along it an approach takes several times as long.
"""
LOWEST = 0.08
"""Sine of the elevation of the lowest normal: below it the table is near."""
GOLDEN = 2.4
"""rad, by which one normal is turned about the stick against the last."""


@dataclass(slots=True, frozen=True)
class SphereTouch:
    """One touch: orientation of the tip (3, 3) and normal (3,), out of the sphere, both in the world.

    `speed_share` is that of the approach speed which the arm allows there.
    """

    rotation: np.ndarray
    normal: np.ndarray
    speed_share: float = 1.0


def sphere_touches(
    upright: np.ndarray, leans: Sequence[Lean], per_orientation: int, speed_shares: Sequence[float] = ()
) -> list[SphereTouch]:
    """All touches, ordered by orientation; `upright` (3, 3) is the orientation of the start.

    `speed_shares` has one share of the approach speed for each of `leans`, none = all of it.
    """
    touches: list[SphereTouch] = []
    for index, (lean, share) in enumerate(zip(leans, speed_shares or repeat(1.0))):
        rotation = leaned(upright, *lean)
        back = -rotation[:, 2]
        side = np.cross(back, rotation[:, 0])
        for k in range(per_orientation):
            normal = _normal(back, side, LEANS[k % len(LEANS)], GOLDEN * (index * per_orientation + k))
            if normal is not None:
                touches.append(SphereTouch(rotation, normal, share))
    return touches


def leaned(upright: np.ndarray, tilt: float, side: float, spin: float) -> np.ndarray:
    """(3, 3) turned about the stick by `spin`, then leaned by `tilt` about a horizontal axis at the angle `side`."""
    axis = np.array([cos(side), sin(side), 0.0])
    return rotation_about(axis, tilt) @ upright @ rotation_about(UP, spin)


def _normal(back: np.ndarray, side: np.ndarray, lean: float, phi: float) -> np.ndarray | None:
    """A normal that leans from `back` to some side and points upwards; None where there is none."""
    for attempt in range(8):
        aside = rotation_about(back, phi + attempt * pi / 4.0) @ side
        normal = cos(lean) * back + sin(lean) * aside
        if normal[2] > LOWEST:
            return normal
    return None


def path_around(
    begin: np.ndarray, end: np.ndarray, begin_rotation: np.ndarray, end_rotation: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Normals (3,) and orientations (3, 3) of a way round a sphere, in steps of at most a radian.

    Over the top where the ends lie opposite to each other.
    """
    angle = float(np.arccos(np.clip(begin @ end, -1.0, 1.0)))
    corners = [begin, UP, end] if angle > 1.8 else [begin, end]
    axis, turn = _turn(begin_rotation, end_rotation)
    steps: list[np.ndarray] = []
    for a, b in pairwise(corners):
        between = float(np.arccos(np.clip(a @ b, -1.0, 1.0)))
        count = max(1, int(np.ceil(between)))
        steps += [_slerp(a, b, between, (k + 1) / count) for k in range(count)]
    count = len(steps)
    return [
        (step, rotation_about(axis, turn * (k + 1) / count) @ begin_rotation) if k + 1 < count else (end, end_rotation)
        for k, step in enumerate(steps)
    ]


def _slerp(a: np.ndarray, b: np.ndarray, angle: float, share: float) -> np.ndarray:
    if angle < 1e-6:
        return b
    return (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by an angle about a unit axis (Rodrigues)."""
    x, y, z = axis.tolist()
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + sin(angle) * skew + (1.0 - cos(angle)) * skew @ skew


def angle_between(begin: np.ndarray, end: np.ndarray) -> float:
    """rad, of the rotation from one orientation (3, 3) to another."""
    return float(np.arccos(np.clip(0.5 * (np.trace(end @ begin.T) - 1.0), -1.0, 1.0)))


def _turn(begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, float]:
    """Axis (3,) and angle of the rotation from one orientation to the other."""
    turn, angle = end @ begin.T, angle_between(begin, end)
    if angle < 1e-6:
        return np.array([0.0, 0.0, 1.0]), 0.0
    values, vectors = np.linalg.eigh(0.5 * (turn + turn.T))
    axis = vectors[:, int(np.argmax(values))]
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return (axis if skew @ axis >= 0.0 else -axis), angle
