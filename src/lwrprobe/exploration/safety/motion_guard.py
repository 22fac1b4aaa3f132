"""The last look at a set point before it goes to the arm, and at the arm's answer."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts import ArmState, ArmStatus, SafetyStop
from lwrprobe.contracts.samples import Vector
from lwrprobe.exploration.safety import motion_guard_kernels as k
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene
from lwrprobe.scene.safety import SafetyTable

_LAME = int(ArmStatus.NOT_COMMANDING | ArmStatus.POWER_OFF | ArmStatus.FAULT)


def table_plane(scene: Scene) -> np.ndarray | None:
    """(4,) for `MotionGuard`: the table's unit normal and the least height over it, None without a table."""
    plane = scene.table.plane()
    if plane is not None:
        plane[3] += scene.probe.radius - scene.safety.table_penetration
    return plane


class MotionStop(SafetyStop):
    """A set point broke a limit, or the arm does not follow: nothing further may be sent, the arm brakes by itself."""


class MotionGuard:
    """Holds each set point against the joints' ranges, speeds, accelerations and jerks, and the tip's speed and area.

    Parameters
    ----------
    robot : with its base and tool
    cycle : s between set points
    safety : the scene's table of that name
    plane : (4,) of the table: unit normal and the least height of the sphere's centre along it [m]; None = no table

    Attributes
    ----------
    measured : (n,) where the joints were last
    sent : (n,) the last set point that passed
    step : (n,) that a joint may move in one cycle
    following : rad (m for prismatic joints) that a joint may be away from its set point
    arrays : limits, state and peaks, as `motion_guard_kernels.check` takes them
    """

    def __init__(self, robot: Robot, cycle: float, safety: SafetyTable, plane: np.ndarray | None) -> None:
        n = max(robot.n, k.FOLLOWING + 1)
        limits = np.zeros((6, n))
        limits[k.LOWER, : robot.n], limits[k.UPPER, : robot.n] = robot.lower, robot.upper
        limits[k.SPEED, : robot.n] = robot.speed
        limits[k.ACCELERATION], limits[k.JERK] = safety.joint_acceleration, safety.joint_jerk
        limits[k.TIP, k.TIP_SPEED] = safety.tip_speed
        limits[k.TIP, k.TABLE : k.FLOOR + 1] = (0.0, 0.0, 0.0, -np.inf) if plane is None else plane
        limits[k.TIP, k.FOLLOWING] = safety.following
        limits[k.TIP, k.LOW : k.HIGH], limits[k.TIP, k.HIGH : k.FOLLOWING] = -np.inf, np.inf
        self._limits, self._state, self._peaks = limits, np.zeros((5, n)), np.zeros(6)
        self._silence = float(safety.arm_silence)
        self.following = float(safety.following)
        self.measured = np.zeros(robot.n)
        self.sent = self._state[k.POSITION, : robot.n]
        self.arrays = limits, self._state, self._peaks
        self._last_time: float | None = None
        self.step = robot.speed * cycle
        self._clamp = entry(k.clamp, self.measured, self.measured, self.step)
        self._rest = (float(cycle), robot.chain, *self.arrays)
        self._check = entry(k.check, self.measured, self.measured, *self._rest)

    def confine(self, lower: Vector, upper: Vector) -> None:
        """From now on the tip keeps to a box (m, world frame); one that is outside may come back."""
        self._limits[k.TIP, k.LOW : k.HIGH] = lower
        self._limits[k.TIP, k.HIGH : k.FOLLOWING] = upper

    def forget(self) -> None:
        """The arm has stopped by itself: the next set point is the first one."""
        self._state[:] = 0.0
        self._last_time = None

    def clamp(self, q: Vector, wanted: Vector) -> bool:
        """Cut a step from q (n,) to `wanted` (n,) down, in place, to what the joints' speeds allow; True where cut."""
        return self._clamp(q, wanted, self.step) > 1.0

    def check(self, q: Vector) -> None:
        """Raises MotionStop for a set point (n,) that must not be sent; otherwise it is remembered as sent."""
        verdict = self.verdict(q, self.measured)
        if verdict:
            raise self.refusal(verdict)

    def verdict(self, q: Vector, measured: Vector) -> int:
        """That of `motion_guard_kernels.check` on a set point (n,), with the joints measured at (n,): 0, or why not."""
        return self._check(q, measured, *self._rest)

    def refusal(self, verdict: int) -> MotionStop:
        """The last verdict in words."""
        return MotionStop(self._sentence(verdict % 16, verdict // 16))

    def watch(self, state: ArmState) -> None:
        """Where the arm is now; raises MotionStop when it reports that it does not follow, or was silent for too long.

        Whether it is where it was sent is seen with the next set point.
        """
        self.measured[:] = state.q
        self._received(state.time, state.status)

    def watch_rows(
        self, set_points: np.ndarray, times: Vector, joints: np.ndarray, status: int, ended_early: bool
    ) -> None:
        """`watch`, and whether the arm was where it was sent, for set points (m, n) that were followed in one call.

        The arm's times (m,) and joints (m, n) after each, and its status after the last, which alone may be bad or
        away from its set point, and only where the call ended early.
        """
        self.measured[:] = joints[-1]
        last = float(times[-1])
        if self._last_time is None or last - self._last_time > self._silence:
            for time in times[:-1].tolist():
                self._received(time, 0)
            self._received(last, status)
        elif status:
            self._received(last, status)
        self._last_time = last
        if ended_early:
            away = np.abs(self.measured - set_points[-1])
            joint = int(away.argmax())
            if not away[joint] <= self.following:
                self._state[k.SHARE, :2] = away[joint], self.following
                raise self.refusal(16 * joint + k.AWAY)

    @property
    def settled(self) -> bool:
        """So many set points were sent that the arm is expected to follow."""
        return bool(self._state[k.MOVED, 3] >= k.SETTLED)

    def _received(self, time: float, status: int) -> None:
        if status & _LAME:
            raise MotionStop(f"the arm no longer follows: {ArmStatus(status & _LAME).name}")
        last, self._last_time = self._last_time, time
        if last is not None and time - last > self._silence:
            gap, allowed = time - last, self._silence
            raise MotionStop(f"no state of the arm for {gap:.3f} s (allowed {allowed:.3f} s)")

    @property
    def peaks(self) -> dict[str, float]:
        """{name: largest share of that limit used so far}."""
        names = ("joint_speed", "joint_acceleration", "joint_jerk", "tip_speed")
        return {name: round(float(self._peaks[row]), 4) for name, row in zip(names, range(k.SPEED, k.TIP + 1))}

    def _sentence(self, what: int, index: int) -> str:
        value, limit = self._state[k.SHARE, :2]
        joint, axis = f"joint {index + 1}", "xyz"[index % 3]
        if what == k.AWAY:
            return f"{joint} is {value:.3f} rad away from its set point (allowed {limit:.3f} rad)"
        words = {
            k.NOT_FINITE: f"the set point of {joint} is {value}",
            k.RANGE: f"{joint} would go to {value:.4f} rad, beyond its limit {limit:.4f} rad",
            k.TOO_FAST: f"{joint} would move at {value:.3f} rad/s (allowed {limit:.3f})",
            k.TOO_SUDDEN: f"{joint} would accelerate with {value:.1f} rad/s^2 (allowed {limit:.1f})",
            k.TOO_JERKY: f"{joint} would jerk with {value:.0f} rad/s^3 (allowed {limit:.0f})",
            k.TIP_FAST: f"the tip would move at {value:.3f} m/s (allowed {limit:.3f})",
            k.IN_TABLE: f"the sphere's centre would be {1e3 * value:.1f} mm over the table (least {1e3 * limit:.1f})",
            k.OUTSIDE: f"the tip would leave its area: {axis} at {value:.4f} m, limit {limit:.4f} m",
        }
        return f"the set point was not sent: {words[what]}"
