"""How far the probe is to lean, so that the body behind the stick stays clear."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lwrprobe.contracts import LinkShape, Task
from lwrprobe_strategies.planning.lines import UP, Z
from lwrprobe_strategies.planning.paths import tip_pose

STEP = float(np.radians(2.5))
"""rad between two angles that are tried."""
SHELTERED = 0.0015
"""m, beyond the clearance, that the body is kept behind the sphere."""
SPARE = 0.02
"""m further out, where a leaning probe has to be in reach as well: no contour ends at a stretched elbow."""
LEVEL = 0.2
"""Horizontal share of a vector, below which it has no horizontal direction."""


class LeanPlanner:
    """Finds orientations of a leaning probe.

    Parameters
    ----------
    task : the probe, and what the arm can reach
    upright : (3, 3), the orientation to lean from
    max_angle : rad
    """

    def __init__(self, task: Task, upright: np.ndarray, max_angle: float) -> None:
        self._task, self._upright, self._max_angle = task, upright, max_angle

    def lean(
        self, towards: np.ndarray, turn: list[np.ndarray], reach: list[np.ndarray], min_angle: float = 0.0
    ) -> np.ndarray | None:
        """(3, 3), leaning towards a horizontal direction (3,), as little as possible: the stick is stiff along it.

        It leans so far that the body behind the stick stays behind the sphere, and at least `min_angle` rad. It can
        turn to it at the places `turn` without coming near anything, and the arm reaches there and at the places
        `reach`. None where there is no such orientation.
        """
        if not towards.any():
            return None
        for angle in np.append(np.arange(max(min_angle, STEP), self._max_angle, STEP), self._max_angle):
            rotation = turned(UP, towards, angle) @ self._upright
            if angle < self._max_angle and self._foremost(rotation, -towards) > -SHELTERED:
                continue
            places = [tip_pose(place, rotation) for place in turn]
            further = [tip_pose(place + SPARE * towards, rotation) for place in reach]
            if self._task.clear(places) and self._task.reachable([*places, *further]):
                return rotation
        return None

    def orientations(self, towards: np.ndarray) -> Iterator[np.ndarray]:
        """(3, 3) each, leaning towards a horizontal unit vector (3,) more and more."""
        for angle in np.arange(STEP, self._max_angle + 1e-9, STEP):
            yield turned(UP, towards, angle) @ self._upright

    def angle(self, rotation: np.ndarray) -> float:
        """rad between the stick held by `rotation` (3, 3) and the upright one."""
        return float(np.arccos(np.clip(rotation[:, Z] @ self._upright[:, Z], -1.0, 1.0)))

    def _foremost(self, rotation: np.ndarray, direction: np.ndarray) -> float:
        """m, how far the body behind the stick is ahead of the sphere along a direction, negative behind it."""
        body = [extent(link, rotation, direction) for link in self._task.probe.links if link.name != "stick"]
        return max(body, default=-np.inf) - self._task.probe.radius + self._task.clearance_threshold


def extent(link: LinkShape, rotation: np.ndarray, direction: np.ndarray) -> float:
    """m, how far a link of the probe, held by `rotation` (3, 3), reaches along a unit direction (3,) from the tip."""
    along = direction @ rotation @ link.pose[:3, :3]
    centre = float(direction @ rotation @ link.pose[:3, 3])
    if link.kind == "box":
        return centre + 0.5 * float(np.abs(along) @ np.array(link.size))
    across = float(np.hypot(along[0], along[1]))
    return centre + link.size[0] * across + 0.5 * link.size[1] * abs(float(along[Z]))


def horizontal(vector: np.ndarray) -> np.ndarray:
    """(3,) unit, the horizontal direction of a vector (3,); zero where it is almost vertical."""
    flat = vector - vector[Z] * UP
    size = float(np.sqrt(flat @ flat))
    return flat / size if size > LEVEL * float(np.sqrt(vector @ vector)) and size > 0.0 else np.zeros(3)


def turned(from_axis: np.ndarray, to_axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] that takes `from_axis` towards `to_axis`, both unit and perpendicular."""
    turn = np.outer(to_axis, from_axis) - np.outer(from_axis, to_axis)
    return np.eye(3) + np.sin(angle) * turn + (1.0 - np.cos(angle)) * (turn @ turn)
