"""Jerk-limited motion of the tip: position and orientation together, re-planned at any tick."""

from __future__ import annotations

from dataclasses import astuple
from math import hypot, inf, isfinite

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts import InputError, as_pose
from lwrprobe.trajectory import cartesian_kernels as k
from lwrprobe.trajectory.limits import CartesianLimits, as_cycle
from lwrprobe.trajectory.planner import ALONE, SAME_TIME, TOGETHER, TRIES, Planner
from lwrprobe.trajectory.profile_kernels import (
    BRAKES,
    FACTS,
    LINES,
    natural_units,
)
from lwrprobe.trajectory.status import TrajectoryStatus as Status

REFRESH = 10
"""Cycles between the plans of a bent move, at least."""

_NO_VELOCITY = (0.0, 0.0, 0.0)


class CartesianTrajectory:
    """Online generator of the tip's pose.

    From rest to a goal the tip moves on the straight line while the orientation turns about one axis (slerp), both
    phase-synchronised. When the goal changes in motion, the part of the motion across the new path dies out as fast
    as its share of the limits allows, then the rest is straight; a motion that does not fit the new path at all (a
    sharp turn at full speed) is slowed first. All limits hold on Euclidean norms at every instant. Nothing in `step`
    raises; where the planner fails the tip stops, jerk-limited.

    Parameters
    ----------
    cycle : s, 1e-4 .. 0.02
    limits : of the tip

    Attributes
    ----------
    pose : (4, 4) world frame, now
    velocity, acceleration : (3,) m/s, m/s^2
    angular_velocity, angular_acceleration : (3,) rad/s, rad/s^2, world frame
    arrived : the last goal is reached and the tip rests, pose equal to the goal
    status : `TrajectoryStatus`
    failures : plans that the planner refused so far

    The arrays are the generator's own and change with every step.
    """

    def __init__(self, cycle: float, limits: CartesianLimits) -> None:
        if not isinstance(limits, CartesianLimits):
            raise InputError("limits", limits, "CartesianLimits")
        self.cycle = as_cycle(cycle)
        self.limits = limits
        self._planners = _planners()
        self._state, self._scout = np.zeros((2, k.STATE_SIZE))
        self._aim, self._halt, self._given = np.zeros((3, k.AIM_SIZE))
        self._aim[k.AIM_LIMITS :] = self._halt[k.AIM_LIMITS :] = astuple(limits)
        self._raw = np.zeros((4, 4))
        self._asked = (limits.speed, limits.turn_rate)
        self._time = 0.0
        self._plan, self._spare = np.zeros((2, k.PLAN_SIZE))
        self._request, self._facts = np.zeros((LINES, 6)), np.zeros(FACTS)
        self._handed, self._nothing = np.zeros((7, 6)), np.zeros(0)
        self.pose = self._state[:16].reshape(4, 4)
        motion = self._state[k.STATE_MOTION : k.STATE_SCRATCH].reshape(4, 3)
        self.velocity, self.acceleration, self.angular_velocity, self.angular_acceleration = motion
        self.failures = 0
        self.status: int = Status.RESTING
        self._event = 0.0
        self._asked_for: tuple[object, ...] | None = None
        self._use_kernels()
        self.reset(np.eye(4))

    def reset(self, pose: object) -> None:
        """Rest at a pose (4, 4) or SE3, now; raises InputError."""
        self._accept(pose)
        self._aim[:16] = self._given[:16]
        self._factor = 1.0
        self._asked_for = None
        self._asked = (self.limits.speed, self.limits.turn_rate)
        self._rest(at_goal=True)

    def set_goal(self, pose: object, speed: float, turn_rate: float | None = None) -> int:
        """Go to a pose and rest there; speed [m/s] and turn_rate [rad/s] are bounds, None = the limit.

        Returns the status. Raises InputError for a pose that is no rigid motion, or a bound that is not positive.
        """
        self._accept(pose)
        turn_rate = self.limits.turn_rate if turn_rate is None else turn_rate
        if not (0.0 < speed < inf and 0.0 < turn_rate < inf):
            raise InputError("speed, turn_rate", (speed, turn_rate), "positive finite numbers")
        if not self._is_new(k.TO_GOAL, speed, turn_rate):
            return self.status
        self._aim[:16] = self._given[:16]
        self._asked = (min(speed, self.limits.speed), min(turn_rate, self.limits.turn_rate))
        self._mode, self._hold, self._stops = k.TO_GOAL, inf, False
        return self._begin()

    def set_velocity(self, velocity: object, hold_seconds: float, pose: object | None = None) -> int:
        """Keep the tip at a velocity (3,) m/s; stop by itself `hold_seconds` after the last call.

        `pose` gives an orientation to hold or turn to meanwhile, None comes to rest in orientation. A velocity
        above the limit is shortened to it. Returns the status; raises InputError.
        """
        velocity = np.asarray(velocity, dtype=np.float64)
        numbers = velocity.tolist()
        if velocity.shape != (3,) or not isfinite(sum(numbers)):
            raise InputError("velocity", numbers, "three finite numbers")
        if not hold_seconds > 0.0:
            raise InputError("hold_seconds", hold_seconds, "a positive number")
        if pose is not None:
            self._accept(pose)
        mode = k.VELOCITY if pose is None else k.VELOCITY_AND_TURN
        if not self._is_new(mode, *numbers):
            self._hold = self._time + hold_seconds
            self._event = min(self._event, self._hold)
            return self.status
        if pose is not None:
            self._aim[:16] = self._given[:16]
        size = hypot(*numbers)
        if size > self.limits.speed:
            share = self.limits.speed / size
            numbers = [share * number for number in numbers]
        self._wanted = numbers
        self._asked = (min(size, self.limits.speed) or self.limits.speed, self.limits.turn_rate)
        self._mode, self._hold, self._stops = mode, hold_seconds, mode == k.VELOCITY and size == 0.0
        return self._begin()

    def stop(self) -> int:
        """Come to rest as fast as the limits allow; returns the status."""
        if self._resting:
            return self.status
        self._give_up()
        return self._begin()

    def scale(self, factor: float) -> int:
        """Bring the speeds of this and later motions to `factor` (0 .. 1] of the requested ones, inside the limits."""
        if not 0.0 < factor <= 1.0:
            raise InputError("factor", factor, "a number above 0, up to 1")
        if factor == self._factor:
            return self.status
        self._factor = factor
        return self.status if self._resting else self._begin()

    @property
    def factor(self) -> float:
        """Factor by which the requested speeds are scaled."""
        return self._factor

    @property
    def asked(self) -> tuple[float, float]:
        """Requested speed [m/s] and turning rate [rad/s], not above the limits, before scaling."""
        return self._asked

    @property
    def resting(self) -> bool:
        """Nothing moves."""
        return self._resting

    @property
    def stopping_time(self) -> float:
        """s, longest duration of a stop from the requested speeds, in position or orientation."""
        limits = self.limits
        return max(
            float(k.ramp_time(self._asked[0], limits.acceleration, limits.jerk)),
            float(k.ramp_time(self._asked[1], limits.turn_acceleration, limits.turn_jerk)),
        )

    def preview(self, seconds: float, poses: np.ndarray, speed_ratio: np.ndarray) -> None:
        """Write the poses (m, 4, 4) of the present plan at m even steps from now to `seconds` ahead.

        `speed_ratio` (m,) receives the ratio of speed or turning rate to the requested one, the larger of both. Where
        the plan is still to be replaced (after a bend or a brake), the present one is extrapolated.
        """
        k.preview(self._plan, self._time, seconds, self._asked[0], self._asked[1], self._scout, poses, speed_ratio)

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
        time = self._time
        if elapsed is None:
            time += self.cycle
        elif 0.0 <= elapsed < inf:
            time += elapsed
        self._advance(self._plan, time, self._state)
        return self.come_to(time)

    @property
    def plan_state(self) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Plan, state, time on the plan, and time of the next event, as `cartesian_kernels.advance` takes them.

        A caller that evaluates the plan in its own kernel reports the new time to `come_to`.
        """
        return self._plan, self._state, self._time, self._event

    def come_to(self, time: float) -> int:
        """The state has been brought to `time` on the plan, and no further than to what is due; returns the status."""
        self._time = time
        return self.status if time < self._event else self._act()

    def _is_new(self, mode: int, *numbers: float) -> bool:
        """Whether this aim, with the pose in `_given` where the mode has one, differs from the last one asked for."""
        asked_for = (mode, *numbers, b"" if mode == k.VELOCITY else self._given[:16].tobytes())
        new = asked_for != self._asked_for
        self._asked_for = asked_for
        return new

    def _begin(self) -> int:
        """A new aim: bring speeds and factor into it and plan."""
        aim, factor = self._aim, self._factor
        if self._mode == k.TO_GOAL:
            aim[k.AIM_LIMITS] = self._asked[0] * factor
        else:
            aim[k.AIM_LIMITS] = self.limits.speed
            for axis, wanted in enumerate(self._wanted, k.AIM_VELOCITY):
                aim[axis] = wanted * factor
        aim[k.AIM_LIMITS + 3] = self._asked[1] * factor
        self._tries = 0
        self.arrived = self._resting = False
        self._replan()
        return self.status

    def _act(self) -> int:
        """What happens besides going on: the end of the plan, of a velocity command, of a bend, or another try."""
        if self._time >= self._hold:
            self._give_up()
            return self._begin()
        if self._braking or self._time < self._duration:
            self._replan()
        elif self._mode == k.TO_GOAL or self._stops:
            self._rest(at_goal=self._mode == k.TO_GOAL)
        else:
            self._event = self._hold
        return self.status

    def _replan(self) -> None:
        kind = self._solve(self._aim, self._mode)
        if kind == k.SETTLED and self._mode == k.TO_GOAL:
            self._rest(at_goal=True)
        elif kind != k.UNFIT:
            self._adopt(braking=False)
        elif not self._braking or self._time >= self._duration:
            self._brake()

    def _brake(self) -> None:
        """Slow down: by the planner where it can, in closed form where it cannot."""
        if self._solve(self._halt, k.VELOCITY) == k.UNFIT:
            k.brake(self._state, self._halt, self._plan, self._spare, self._facts)
        self._adopt(braking=True)

    def _solve(self, aim: np.ndarray, mode: int) -> int:
        """A plan into the spare array; returns its kind, UNFIT where the motion does not fit or the planner fails."""
        request, facts = self._request, self._facts
        kind = self._prepare(self._state, aim, mode, self._spare, request, facts, self._handed)
        if kind == k.UNFIT:
            return kind
        if kind == k.SETTLED:
            k.load_tip(self._spare, request, facts, self._nothing)
            return kind
        if mode != k.TO_GOAL and self._change_tip(self._spare, request, facts):
            return kind
        together, alone = self._planners[mode][kind]
        if self._ask(together):
            return kind
        natural_units(request)
        k.hand_over(request, facts, self._handed)
        if self._ask(alone):
            return kind
        self.failures += 1
        self._tries += 1
        if self._tries == TRIES:
            self._give_up()
        return k.UNFIT

    def _ask(self, planner: Planner) -> bool:
        solved = planner.solve(self._handed, self._facts[BRAKES] != 0.0)
        return solved and k.load_tip(self._spare, self._request, self._facts, planner.pieces)

    def _adopt(self, braking: bool) -> None:
        """Follow the spare plan from now on."""
        self._plan, self._spare = self._spare, self._plan
        self._hold -= self._time
        self._time = 0.0
        self._braking = braking
        too_fast, _, self._duration, bend, fast = self._facts.tolist()
        event = min(self._hold, self._duration)
        if bend > 0.0:  # what is left of the bend leaves ever more of the limits to the path along
            event = min(event, max(0.25 * bend, min(bend, REFRESH * self.cycle)))
        if fast > 0.0:
            event = min(event, fast)
        self._event = 0.0 if braking else event
        self.status = self._describe(too_fast != 0.0)

    def _describe(self, too_fast: bool) -> int:
        if self._tries >= TRIES:
            return Status.RESCUED
        if self._stops:
            return Status.STOPPING
        if too_fast:
            return Status.TOO_FAST
        if self._braking:
            return Status.YIELDING
        return Status.MOVING if self._mode == k.TO_GOAL else Status.TRACKING_VELOCITY

    def _give_up(self) -> None:
        """The aim is to stop."""
        self._asked_for = None
        self._wanted = _NO_VELOCITY
        self._mode, self._hold, self._stops = k.VELOCITY, inf, True
        self._aim[k.AIM_VELOCITY :] = self._halt[k.AIM_VELOCITY :]

    def _rest(self, at_goal: bool) -> None:
        k.rest_at(self._state, self._aim, at_goal)
        rescued = not at_goal and self._tries >= TRIES
        self.status = Status.RESCUED if rescued else Status.RESTING
        self._resting, self._braking, self.arrived = True, False, at_goal
        self._time = self._duration = self._event = 0.0
        self._mode, self._hold, self._stops, self._wanted = k.TO_GOAL, inf, False, _NO_VELOCITY
        self._tries = 0

    def _use_kernels(self) -> None:
        """Call every kernel once, so that none is compiled or fetched from the cache while the arm moves."""
        request, facts, handed = self._request, self._facts, self._handed
        self._accept(np.eye(4))
        self._prepare = entry(k.prepare, self._state, self._halt, k.VELOCITY, self._spare, request, facts, handed)
        self._prepare(self._state, self._halt, k.VELOCITY, self._spare, request, facts, handed)
        natural_units(request)
        k.hand_over(request, facts, handed)
        k.load_tip(self._spare, request, facts, self._nothing)
        self._change_tip = entry(k.change_tip, self._spare, request, facts)
        self._change_tip(self._spare, request, facts)
        k.brake(self._state, self._halt, self._plan, self._spare, facts)
        self._advance = entry(k.advance, self._spare, 0.0, self._scout)
        self._advance(self._spare, 0.0, self._scout)
        self.preview(self.stopping_time, np.empty((2, 4, 4)), np.empty(2))

    def _accept(self, pose: object) -> None:
        """Validated pose into `_given`; the fast check first, the exact words only when it fails."""
        raw = self._raw  # one array for all: another memory layout would mean another compilation
        if isinstance(pose, np.ndarray) and pose.shape == (4, 4) and pose.dtype == np.float64:
            raw[:] = pose
            if k.accept_pose(raw, self._given):
                return
        raw[:] = as_pose(pose)
        if not k.accept_pose(raw, self._given):
            raise InputError("pose", raw.tolist(), f"coordinates up to {k.FARTHEST:g} m")


def _planners() -> list[list[tuple[Planner, Planner]]]:
    """The planner to ask by mode and kind of request, and the one to ask when it fails.

    Straight moves are phase-synchronised, bent ones end in time. Ruckig cannot always do that for moves of a few
    micrometres or less; then each axis ends when it does.
    """
    alone = Planner([ALONE] * 6, [False] * 6)
    straight = (Planner([TOGETHER] * 6, [False] * 6), alone)
    bent = (Planner([SAME_TIME, ALONE, ALONE] * 2, [False] * 6), alone)
    velocity = (Planner([ALONE] * 6, [True] * 6),) * 2
    velocity_and_turn = (Planner([ALONE] * 6, [True] * 3 + [False] * 3),) * 2
    return [[straight, straight, bent], [velocity] * 3, [velocity_and_turn] * 3]
