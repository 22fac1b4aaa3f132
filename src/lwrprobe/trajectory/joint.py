"""Jerk-limited motion in joint space: the mode in which the tip's path bows."""

from __future__ import annotations

from math import inf

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.trajectory import joint_kernels as k
from lwrprobe.trajectory.limits import as_cycle
from lwrprobe.trajectory.planner import ALONE, TOGETHER, TRIES, Planner
from lwrprobe.trajectory.profile_kernels import (
    BRAKES,
    FACTS,
    LINES,
    MOVES,
    ROW,
    natural_units,
)
from lwrprobe.trajectory.status import TrajectoryStatus as Status


class JointTrajectory:
    """Online generator of joint positions.

    From rest all joints start and end together, on a straight line in joint space; from motion they end together.
    Speed, acceleration and jerk limits hold for each joint at every instant, position limits too: a plan that
    would swing past one is replaced by one that does not, at the cost of ending at different times.

    Parameters
    ----------
    cycle : s, 1e-4 .. 0.02
    lower, upper : (n,) rad (m for prismatic joints)
    speed, acceleration, jerk : (n,) rad/s, rad/s^2, rad/s^3

    Attributes
    ----------
    q, qd, qdd : (n,) now; the generator's own arrays, which change with every step
    arrived : the last goal is reached and the joints rest, q equal to the goal
    status : `TrajectoryStatus`
    failures : plans that the planner refused so far
    """

    def __init__(
        self, cycle: float, lower: object, upper: object, speed: object, acceleration: object, jerk: object
    ) -> None:
        self.cycle = as_cycle(cycle)
        self._bounds = _bounds(lower=lower, upper=upper, speed=speed, acceleration=acceleration, jerk=jerk)
        n = self._bounds.shape[1]
        self._together, self._alone = (Planner([sync] * n, [False] * n) for sync in (TOGETHER, ALONE))
        self._stopper = Planner([ALONE] * n, [True] * n)
        self._state = np.zeros((4, n))
        self.q, self.qd, self.qdd = self._state[: k.ORIGIN]
        self._goal, self._refuge, self._raw = np.zeros((3, n))
        self._plan, self._spare = np.zeros((2, n * ROW))
        self._request, self._facts = np.zeros((LINES, n)), np.zeros(FACTS)
        self._handed = np.zeros((7, n))
        self._factor, self.failures = 1.0, 0
        self._use_kernels()
        self.reset(np.clip(np.zeros(n), *self._bounds[:2]))

    def reset(self, q: object, qd: object | None = None) -> None:
        """Be at q (n,), now, at rest or, from velocity qd (n,), coming to rest; raises InputError."""
        velocity = np.zeros(self.q.size) if qd is None else _vector("qd", qd, self.q.size)
        self._accept(q)
        self._factor = 1.0
        self._rest(at_goal=True)
        if velocity.any():
            self.qd[:] = velocity
            self._stops = True
            self._begin()

    def set_goal(self, q: object, factor: float | None = None) -> int:
        """Go to q (n,) and rest there, with `factor` at the speeds that `scale` would give; returns the status.

        Raises InputError for what is outside the limits.
        """
        self._accept(q)
        self._factor = self._factor if factor is None else _share(factor)
        self._stops = False
        return self._begin()

    def stop(self) -> int:
        """Come to rest as fast as the limits allow; returns the status."""
        if self._resting:
            return self.status
        self._stops = True
        return self._begin()

    def scale(self, factor: float) -> int:
        """Bring the speeds of this and later motions to `factor` (0 .. 1] of the limits."""
        if _share(factor) == self._factor:
            return self.status
        self._factor = factor
        return self.status if self._resting else self._begin()

    @property
    def remaining(self) -> float:
        """s from now to the end of the present plan, 0 at rest."""
        return max(self._duration - self._time, 0.0)

    def step(self, elapsed: float | None = None) -> int:
        """Advance by one cycle, or by `elapsed` s (where the clock is irregular); returns the status.

        No time passes for an `elapsed` that is negative or no number.
        """
        if self._resting:
            return self.status
        if elapsed is None:
            self._time += self.cycle
        elif 0.0 <= elapsed < inf:
            self._time += elapsed
        k.advance_joints(self._plan, self._time, self._state)
        return self.status if self._time < self._event else self._act()

    @property
    def resting(self) -> bool:
        """Nothing moves."""
        return self._resting

    def _begin(self) -> int:
        self._tries = 0
        self.arrived = self._resting = False
        self._replan()
        return self.status

    def _act(self) -> int:
        if self._braking or self._time < self._duration:
            self._replan()
        else:
            self._rest(at_goal=not self._stops)
        return self.status

    def _replan(self) -> None:
        if self._stops:
            moving = k.prepare_stop(self._state, self._bounds, self._request, self._facts, self._handed)
        else:
            moving = k.prepare_goal(
                self._state, self._goal, self._bounds, self._factor, self._request, self._facts, self._handed
            )
        if moving == 0:
            self._rest(at_goal=not self._stops)
        elif self._halt() if self._stops else self._go():
            self._adopt(braking=False)
        elif not self._braking or self._time >= self._duration:
            self._brake()

    def _go(self) -> bool:
        """A plan of the prepared request that keeps to the position limits, into the spare array."""
        return self._solve(self._together) == k.INSIDE or self._settle(self._alone) == k.INSIDE

    def _halt(self) -> bool:
        """A stop inside the position limits: the shortest one, else one that swings back from the limit."""
        found, margin = self._settle(self._stopper), 0.0
        while found == k.OUTSIDE and margin < 1e3:
            k.aim_inside(self._spare, self._bounds, self._state, margin, self._refuge)
            k.prepare_goal(self._state, self._refuge, self._bounds, 1.0, self._request, self._facts, self._handed)
            found, margin = self._settle(self._alone), max(1.0, 2.0 * margin)
        return found == k.INSIDE

    def _solve(self, planner: Planner) -> int:
        facts = self._facts
        if not planner.solve(self._handed, facts[BRAKES] != 0.0):
            return k.REFUSED
        return k.load_inside(self._spare, self._request, facts, planner.pieces, self._state, self._bounds)

    def _settle(self, planner: Planner) -> int:
        """A plan in which each joint ends when it does, in units of its own."""
        natural_units(self._request)
        k.hand_over(self._request, self._facts, self._handed)
        found = self._solve(planner)
        if found == k.REFUSED:
            self.failures += 1
            self._tries += 1
            self._stops |= self._tries >= TRIES
        return found

    def _brake(self) -> None:
        """Slow down until the aim can be planned: by the planner where it can, in closed form where it cannot."""
        k.prepare_stop(self._state, self._bounds, self._request, self._facts, self._handed)
        if not self._halt():
            k.brake_joints(self._state, self._bounds, self._spare, self._facts)
        self._adopt(braking=True)

    def _adopt(self, braking: bool) -> None:
        """Follow the spare plan from now on."""
        self._plan, self._spare = self._spare, self._plan
        self._time = 0.0
        self._braking = braking
        too_fast, _, self._duration, _, fast = self._facts.tolist()
        self._event = 0.0 if braking else (fast if 0.0 < fast < self._duration else self._duration)
        self.status = self._describe(too_fast != 0.0)

    def _describe(self, too_fast: bool) -> int:
        if self._tries >= TRIES:
            return Status.RESCUED
        if self._stops:
            return Status.STOPPING
        if too_fast:
            return Status.TOO_FAST
        return Status.YIELDING if self._braking else Status.MOVING

    def _rest(self, at_goal: bool) -> None:
        if at_goal:
            self.q[:] = self._goal
        self.qd[:] = self.qdd[:] = 0.0
        rescued = not at_goal and self._tries >= TRIES
        self.status = Status.RESCUED if rescued else Status.RESTING
        self._resting, self._braking, self._stops, self.arrived = True, False, False, at_goal
        self._time = self._duration = self._event = 0.0
        self._tries = 0

    def _use_kernels(self) -> None:
        """Call every kernel once, so that none is compiled or fetched from the cache while the arm moves."""
        state, bounds, request, facts, handed = self._state, self._bounds, self._request, self._facts, self._handed
        k.prepare_goal(state, self._goal, bounds, 1.0, request, facts, handed)
        k.prepare_stop(state, bounds, request, facts, handed)
        natural_units(request)
        k.hand_over(request, facts, handed)
        request[MOVES] = 0.0
        k.load_inside(self._spare, request, facts, self._together.pieces, state, bounds)
        k.aim_inside(self._spare, bounds, state, 0.0, self._refuge)
        k.brake_joints(state, bounds, self._spare, facts)
        k.advance_joints(self._spare, 0.0, state)

    def _accept(self, q: object) -> None:
        """Validated joint positions into `_goal`; the fast check first, the exact words only when it fails."""
        raw = self._raw  # one array for all: another memory layout would mean another compilation
        if isinstance(q, np.ndarray) and q.shape == raw.shape and q.dtype == np.float64:
            raw[:] = q
        else:
            raw[:] = _vector("q", q, raw.size)
        if not k.accept_joints(raw, self._bounds, self._goal):
            _vector("q", raw, raw.size)
            raise InputError("q", raw.tolist(), f"from {self._bounds[0].tolist()} to {self._bounds[1].tolist()}")


def _share(factor: float) -> float:
    if not 0.0 < factor <= 1.0:
        raise InputError("factor", factor, "a number above 0, up to 1")
    return factor


def _vector(field: str, value: object, n: int | None = None) -> np.ndarray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim != 1 or array.size == 0 or (n is not None and array.size != n) or not np.isfinite(array).all():
        raise InputError(field, value, f"{n or 'one or more'} finite numbers")
    return array


def _bounds(**given: object) -> np.ndarray:
    rows = {name: _vector(name, value) for name, value in given.items()}
    n = rows["lower"].size
    for name, row in rows.items():
        _vector(name, row, n)
        if name in ("speed", "acceleration", "jerk") and not ((row >= 1e-9) & (row <= 1e9)).all():
            raise InputError(name, row.tolist(), "numbers from 1e-9 to 1e9")
    if not (rows["lower"] <= rows["upper"]).all():
        raise InputError("lower, upper", (rows["lower"].tolist(), rows["upper"].tolist()), "lower <= upper")
    return np.array(list(rows.values()))
