"""Clearance of the probe's links: the stick keeps another distance than the body behind it.

While the sphere touches a wall the stick is only (sphere radius - stick radius) away from it, by design, and its
touch is measured by the sensor. The body is neither near by design nor measured. So the two are checked separately and
the more urgent result counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lwrprobe.collision import ClearanceQuery, ClearanceWatch, LinkGroup
from lwrprobe.contracts import Clearance, LinkShape
from lwrprobe.mapping import VoxelMap

STICK = "stick"
PLAY = 0.001
"""m"""


class ClearanceStage:
    """Nearest link-to-map pair each strategy step, the one with the least reserve of distance.

    Parameters
    ----------
    links : of the probe
    surface : what was touched, in fine cubes: both are near to it, the stick beside the sphere, the body over a top
    body, stick : m, what the links behind the stick keep, and what the stick keeps
    """

    def __init__(self, links: Sequence[LinkShape], surface: VoxelMap, body: float, stick: float) -> None:
        behind = [link for link in links if link.name != STICK]
        sticks = [link for link in links if link.name == STICK]
        groups = [(group, keep) for group, keep in ((behind, body), (sticks, stick)) if group]
        self._watch = ClearanceWatch([LinkGroup(group, keep) for group, keep in groups], surface)
        self._queries = [(ClearanceQuery(group, surface), keep) for group, keep in groups]

    @property
    def smallest(self) -> float:
        """m, the smallest distance so far."""
        return self._watch.smallest

    def nearest(self, pose: np.ndarray, q: np.ndarray) -> Clearance:
        """The most urgent pair at a tip pose (4, 4), held by joints q (n,); `required` says how far that link keeps."""
        return self._watch.nearest(pose)

    def threatens(self, pose: np.ndarray) -> bool:
        """Whether a link is nearer than it may be at a tip pose (4, 4), wherever the tip is now."""
        return any(query.nearest(pose).distance < keep for query, keep in self._queries)

    def clear(self, path: Sequence[np.ndarray], q: np.ndarray) -> bool:
        """Whether the links keep their distance straight along tip poses (4, 4), the first of them held by q (n,).

        A link that is too near already may stay that near, with 1 mm for the contact's own play.
        """
        for begin, end in pairwise(path):
            for query, keep in self._queries:
                allowed = min(keep, query.nearest(begin).distance) - PLAY
                if query.ahead(begin, end, enough=keep).distance < allowed:
                    return False
        return True

    def objection(self, begin: np.ndarray, end: np.ndarray, q: np.ndarray) -> str:
        """Why the arm must not go straight to a tip pose (4, 4) from where it stands; nothing is known of the arm."""
        return ""
