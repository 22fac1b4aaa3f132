"""Clearance of the whole arm: its own links against the map, the table and the robot itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np

from lwrprobe.collision import ClearanceWatch, LinkGroup
from lwrprobe.contracts import Clearance, InputError, LinkShape, Probe
from lwrprobe.exploration.stages.clearance import PLAY, STICK
from lwrprobe.kinematics import IKSolver, IKStatus, Robot, straight_line
from lwrprobe.mapping import VoxelMap

NEAREST_MEETING = 3
"""Bodies fewer places apart than this, from the base outwards, cannot meet or belong together."""
STEP, TURN = 0.02, 0.1
"""m and rad of the tip, between which the joints are taken to go evenly."""


class ArmClearanceStage:
    """The nearest pair like `ClearanceStage`, among more links and with more that they may meet.

    Where a motion leads can be foreseen, so one that would bring the arm to the table or to itself is refused before it
    begins. What is too near already may stay that near, with 1 mm of play.

    Parameters
    ----------
    probe : with its links
    robot : with its own
    solver : of the tip's poses, as the run uses it
    voxels : what was touched
    body, stick : m, what the stick keeps, and what is kept by and between all other links
    table : (4,) the table's plane: unit normal and its distance from the world's origin; None = no table

    Raises
    ------
    InputError : for a robot whose links are not known
    """

    def __init__(
        self,
        probe: Probe,
        robot: Robot,
        solver: IKSolver,
        voxels: VoxelMap,
        body: float,
        stick: float,
        table: np.ndarray | None,
    ) -> None:
        if not robot.links:
            raise InputError("clearance.links", "arm", f"'probe': the links of {robot.name} are not known")
        self._robot, self._solver = robot, solver
        behind = [link for link in probe.links if link.name != STICK]
        sticks = [link for link in probe.links if link.name == STICK]
        swinging = [*behind, *robot.swinging_links]
        pairs = list(_meeting(robot.links, probe.links))
        own = [LinkGroup([*robot.links, *probe.links], body, pairs=pairs)]
        own += [LinkGroup(swinging, body, table=table)] if table is not None else []
        touched = [LinkGroup(group, keep) for group, keep in ((swinging, body), (sticks, stick)) if group]
        self._now = ClearanceWatch([*touched, *own], voxels)
        # Looking ahead jumps to and fro, which a watch of its own remembers.
        self._ahead, self._own_ahead = ClearanceWatch([*touched, *own], voxels), ClearanceWatch(own, voxels)
        self._tip, self._frames = np.empty((4, 4)), np.empty((robot.n + 1, 4, 4))
        self._agreed: np.ndarray | None = None

    @property
    def smallest(self) -> float:
        """m, the smallest distance so far."""
        return self._now.smallest

    def nearest(self, pose: np.ndarray, q: np.ndarray) -> Clearance:
        """The most urgent pair at a tip pose (4, 4), held by joints q (n,)."""
        self._robot.link_frames_into(q, self._frames)
        return self._now.nearest(pose, self._frames)

    def clear(self, path: Sequence[np.ndarray], q: np.ndarray) -> bool:
        """Whether all links keep their distance straight along tip poses (4, 4), the first of them held by q (n,).

        A path that the arm cannot follow is not clear.
        """
        qs = [q]
        for begin, end in pairwise(path):
            if not self._follow(begin, end, qs):
                return False
        return self._threat(qs, self._ahead) is None

    def objection(self, begin: np.ndarray, end: np.ndarray, q: np.ndarray) -> str:
        """Why the arm, at q (n,), must not go straight from a tip pose (4, 4) to another: the table, or itself.

        Empty where it may, as far as it can follow. A path that was accepted is not checked again meanwhile.
        """
        if self._agreed is not None and np.array_equal(self._agreed, end):
            return ""
        qs = [q]
        self._follow(begin, end, qs)
        return self._verdict(qs, end)

    def objection_to_swing(self, q: np.ndarray, q_end: np.ndarray) -> str:
        """The same for an even motion of the joints from q (n,) to q_end (n,)."""
        return self._verdict([q, q_end], None)

    def _verdict(self, qs: Sequence[np.ndarray], end: np.ndarray | None) -> str:
        threat = self._threat(qs, self._own_ahead)
        self._agreed = end.copy() if threat is None and end is not None else None
        if threat is None:
            return ""
        return f"{threat.link} would come within {1e3 * threat.distance:.1f} mm of the {threat.against}"

    def _follow(self, begin: np.ndarray, end: np.ndarray, qs: list[np.ndarray]) -> bool:
        """Add to the joints those on a straight path of the tip; whether it can be followed to its end."""
        shift, turn = np.abs(end - begin)[:3, 3].max(), np.abs(end - begin)[:3, :3].max()
        for pose in [end] if shift < STEP and turn < TURN else straight_line(begin, end, STEP, TURN)[1:]:
            q = np.empty(self._robot.n)
            if self._solver.track(np.ascontiguousarray(pose), qs[-1], q) != IKStatus.CONVERGED:
                return False
            qs.append(q)
        return True

    def _threat(self, qs: Sequence[np.ndarray], watch: ClearanceWatch) -> Clearance | None:
        """The pair that comes too near while the joints go evenly from place to place; None where all keep away.

        From each place on goes as far as the distance there allows at least (conservative advancement).
        """
        near = self._at(qs[0], watch)
        allowed = min(near.distance - near.required, 0.0) - PLAY
        for begin, end in pairwise(qs):
            # Two links may move towards each other, each by its joints' turns times its reach.
            length, gone = 2.0 * self._robot.length * float(np.abs(end - begin).sum()), 0.0
            while gone < length:
                gone += max(near.distance - near.required, PLAY)
                near = self._at(begin + min(gone / length, 1.0) * (end - begin), watch)
                if near.distance - near.required < allowed:
                    return near
        return None

    def _at(self, q: np.ndarray, watch: ClearanceWatch) -> Clearance:
        self._robot.fk_into(q, self._tip)
        self._robot.link_frames_into(q, self._frames)
        return watch.nearest(self._tip, self._frames)


def _meeting(arm: Sequence[LinkShape], probe: Sequence[LinkShape]) -> Iterator[tuple[int, int]]:
    """Numbers of the links of arm and probe, in that order, that may meet: the probe is one rigid body, the last."""
    place = [*range(len(arm)), *[len(arm)] * len(probe)]
    for one, other in combinations(range(len(place)), 2):
        if place[other] - place[one] >= NEAREST_MEETING:
            yield other, one
