"""Clearance of the probe's links: the stick keeps another distance than the body behind it.

While the sphere touches a wall the stick is only (sphere radius - stick radius) away from it, by design, and its
touch is felt by the sensor. The body is neither near by design nor felt. So the two are asked separately and the
more urgent answer counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.collision import ClearanceQuery, ClearanceWatch
from lwrprobe.contracts import Clearance, LinkShape
from lwrprobe.mapping import VoxelMap

STICK = "stick"
PLAY = 0.001
"""m"""


class ClearanceStage:
    """Nearest link-to-map pair each strategy step, the one with the least reserve of distance."""

    def __init__(self, links: Sequence[LinkShape], voxels: VoxelMap, body: float, stick: float) -> None:
        behind = [link for link in links if link.name != STICK]
        sticks = [link for link in links if link.name == STICK]
        groups = [(group, keep) for group, keep in ((behind, body), (sticks, stick)) if group]
        self._queries = [(ClearanceQuery(group, voxels), keep) for group, keep in groups]
        self._watch = ClearanceWatch(groups, voxels)

    @property
    def smallest(self) -> float:
        """m, the smallest distance so far."""
        return self._watch.smallest

    def clear(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether the links keep their distance all the way from one tip pose (4, 4) to another.

        A link that is too near already may stay that near, with 1 mm for the contact's own play.
        """
        for query, keep in self._queries:
            allowed = min(keep, query.nearest(begin).distance) - PLAY
            if query.ahead(begin, end, enough=keep).distance < allowed:
                return False
        return True

    def nearest(self, pose: np.ndarray) -> Clearance:
        """The most urgent pair at a tip pose (4, 4); `required` says how far that link has to keep."""
        return self._watch.nearest(pose)
