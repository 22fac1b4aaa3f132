"""How the tip leaves what it touches, before the path to the next line begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Doubt
from lwrprobe_strategies.planning.free_space import LIFT
from lwrprobe_strategies.planning.lines import UP, Line, Z
from lwrprobe_strategies.planning.paths import OFF, THERE, SpeedLimit, Waypoint, tip_pose
from lwrprobe_strategies.planning.retraction import goes_up, off_surface, out_from_under, return_path
from lwrprobe_strategies.skills import guarded_move, transit
from lwrprobe_strategies.tip import Tip

FALLBACKS = 3
"""Other paths off a place that are tried, one after the other, where the planned one has not moved the tip."""
IN_VAIN, WITHIN = 10, 0.02
"""Lines in a row that no path has reached, while the tip stays within so many metres: it does not get out of there."""
SOME_WAY = 0.03
"""m back on the probe's path, where all of it is too long."""
AWAY = 1.5
"""Retractions from where a line began, from which on the tip has left that place."""


class RetractionPlanner:
    """Plans the path off what is touched: off the surface, or back on the probe's own path.

    Parameters
    ----------
    tip : what the skills share
    upright : (3, 3), the orientation of the upright tip
    distance : m, by which the probe retracts

    Attributes
    ----------
    line : the present one; None before the first
    back : m, that the next path leads back on the probe's own one; inf where what is touched decides
    in_vain : lines in a row, up to the last one, that no path has reached from about where the tip is
    """

    def __init__(self, tip: Tip, upright: np.ndarray, distance: float) -> None:
        self._tip, self._upright, self._distance = tip, upright, distance
        self.line: Line | None = None
        self.back, self._stays = np.inf, 0
        self.in_vain, self._since = 0, tip.here

    def go_back(self) -> None:
        """The next path leads back on the probe's own one: the stick has met something."""
        self.back = self._distance

    def line_begins(self) -> None:
        """A line begins, with the path to it."""
        tip = self._tip
        self._begin, self._known = tip.here, (len(tip.memory.trail()), len(tip.free))

    def line_driven(self) -> None:
        """The line has been driven or was given up, and the tip is where it ended."""
        tip = self._tip
        reached = tip.trace.ended is not transit
        if reached or np.abs(tip.here - self._since).max() > WITHIN:
            self.in_vain, self._since = 0, tip.here
        self.in_vain += not reached

    def line_ends(self) -> None:
        """The tip is where the path to the next line begins."""
        self._stays = self._stays + 1 if self._stayed() else 0

    @property
    def stays(self) -> bool:
        """The last line has left the tip where it was."""
        return self._stays > 0

    @property
    def exhausted(self) -> bool:
        """All fallbacks have left the tip where it was."""
        return self._stays > FALLBACKS

    @property
    def caught(self) -> bool:
        """So many lines in a row were not reached that the tip does not get out of where it is."""
        return self.in_vain >= IN_VAIN

    @property
    def free(self) -> bool:
        """Nothing presses on the tip: what keeps it where it is, is that the next line is out of the arm's reach."""
        seen = self._tip.seen
        return seen.contact is None and float(np.linalg.norm(seen.force)) <= self._tip.task.force_threshold

    def line_dropped(self) -> None:
        """The line is not begun again; the next one may be within reach."""
        self._stays = self.in_vain = 0

    def back_out(self) -> list[Waypoint]:
        """Back on the probe's own path, right along what it touched, to where the path up is free or for some way."""
        free = self._tip.free
        return self._raised(return_path(free, wedged=True) or return_path(free, SOME_WAY, wedged=True))

    def slid_out(self, begin: np.ndarray) -> None:
        """The tip has tried to slide out of a place (3,): the next line begins where it is now, if that is off it."""
        if np.abs(self._tip.here - begin).max() > self._distance:
            self._stays = 0

    def _stayed(self) -> bool:
        """Whether the tip is about where it was when the line began, and in between no farther than a retraction leads.

        In a narrow place the path to a line may touch one side and the other in turn.

        The path to a line may end where it began, because the line begins in the object: that one does lead away.
        """
        tip, (trail, free) = self._tip, self._known
        been = np.vstack([tip.here, tip.memory.trail()[trail:, :3]])
        moved = np.abs(been - self._begin).max()
        near = OFF if tip.trace.ended is transit else THERE
        return bool(moved < near) and tip.free.farthest(self._begin, free) < AWAY * self._distance

    def path(self) -> list[Waypoint]:
        """Off the surface that is touched; from under something, or leaning, back on the probe's path.

        Waypoints that the arm cannot reach from here, and those to which the body may not go, are left out. What leads
        off a wall may lead beyond the range of a joint, and what leads off something above leads down; what leads along
        it, as the probe came, does neither.
        """
        if self._tip.body is not None:
            self._tip.body.survey()
        path = self._fallback() if self.stays else self._off_or_back()
        for k, waypoint in enumerate(path):
            if self._leads_to(waypoint) or (self._tip.body is not None and self._leads_to(self._level(waypoint))):
                return self._raised(path[k:])
        return path

    def _raised(self, path: list[Waypoint]) -> list[Waypoint]:
        """The path, level where the body may come no lower: off a side that leans out it leads down by a little."""
        body, begin = self._tip.body, self._tip.seen.pose
        if body is None:
            return path
        raised = []
        for waypoint in path:
            lower = self._pose_at(waypoint)
            raised.append(waypoint if body.allows(begin, lower) else self._level(waypoint))
            begin = self._pose_at(raised[-1])
        return raised

    def _pose_at(self, waypoint: Waypoint) -> np.ndarray:
        """(4, 4), of the tip at a waypoint."""
        held = self._tip.seen.pose[:3, :3] if waypoint.rotation is None else waypoint.rotation
        return tip_pose(waypoint.place, held)

    def _level(self, waypoint: Waypoint) -> Waypoint:
        """As high as the tip is, or nearly: as far as places off a surface are beside the path on which it came."""
        x, y, z = waypoint.place.tolist()
        return replace(waypoint, place=np.array([x, y, max(z, min(float(self._tip.here[Z]), z + LIFT))]))

    def _off_or_back(self) -> list[Waypoint]:
        """The planned path: off the surface where the tip may go up from there, else back."""
        tip = self._tip
        normal = tip.normal()
        tip.leave()
        back, self.back = self.back, np.inf
        if np.isfinite(back) or not goes_up(tip.seen, normal, self._upright):
            return self._back(back) or out_from_under(tip.seen, normal, tip.task.probe.radius)
        if tip.trace.ended is guarded_move and not tip.leaving:
            return self._back() if self.line is not None and self.line.fallback is not None else []
        return off_surface(tip.seen, normal, self._distance, tip.column_is_free)

    def _fallback(self) -> list[Waypoint]:
        """Off a place that the planned path did not leave: along the force, else back, else up.

        The force is what presses, whatever normal is taken from it.
        """
        tip = self._tip
        tip.leave()
        self.back = np.inf
        force = tip.seen.force
        size = float(np.linalg.norm(force))
        if self._stays == 1 and size > tip.task.force_threshold:
            return [Waypoint(tip.here + self._distance * force / size, SpeedLimit.GUARDED)]
        if self._stays <= 2 and (back := self._back(self._distance)):
            return back
        return [Waypoint(tip.here + self._distance * UP, SpeedLimit.GUARDED)]

    def _back(self, distance: float = np.inf) -> list[Waypoint]:
        """Back on the probe's path, with care off what is touched where its normal is not reliable."""
        tip = self._tip
        contact = tip.seen.contact
        path = return_path(tip.free, distance, contact is not None and contact.reason is Doubt.AMBIGUOUS)
        if path and tip.leaving and not tip.reliable:
            path[0] = replace(path[0], speed_limit=SpeedLimit.GUARDED)
        return path

    def _leads_to(self, waypoint: Waypoint) -> bool:
        """Whether the probe may go straight to a waypoint."""
        seen, body = self._tip.seen, self._tip.body
        pose = self._pose_at(waypoint)
        if body is not None and not body.allows(seen.pose, pose):
            return False
        return not seen.blocked or self._tip.task.reachable([pose])
