"""What arm and sensor send, kept raw: for procedures that evaluate it afterwards."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Arm, ArmState, Sensor, SteppedArm, WrenchSample
from lwrprobe.contracts.samples import Vector
from lwrprobe.exploration.loop.devices import Devices


class DeviceLog:
    """Set points and states of an arm, and the samples of a sensor with their arrival on the arm's clock.

    Attributes
    ----------
    samples : (arrival s, sample), in order of arrival
    """

    def __init__(self) -> None:
        self.samples: list[tuple[float, WrenchSample]] = []
        self._times: list[Vector] = []
        self._joints: list[np.ndarray] = []
        self._sent: list[np.ndarray] = []
        self.now = 0.0

    @classmethod
    def on(cls, devices: Devices) -> DeviceLog:
        """Put the log between the devices and whoever uses them from now on."""
        log = cls()
        if isinstance(devices.arm, SteppedArm):
            devices.arm = LoggedSteppedArm(devices.arm, log)
        else:
            devices.arm = LoggedArm(devices.arm, log)
        devices.sensor = LoggedSensor(devices.sensor, log)
        return log

    def note(self, times: Vector, joints: np.ndarray, sent: np.ndarray) -> None:
        """States (m,) s and (m, n) rad, each with the set point (m, n) rad that was sent last before it."""
        self._times.append(times.copy())
        self._joints.append(joints.copy())
        self._sent.append(sent.copy())
        self.now = float(times[-1])

    def states(self) -> tuple[Vector, np.ndarray, np.ndarray]:
        """All times (m,) s, measured joints (m, n) rad and set points (m, n) rad."""
        return np.concatenate(self._times), np.concatenate(self._joints), np.concatenate(self._sent)


class LoggedArm:
    """An arm whose states and set points are kept; see `lwrprobe.contracts.Arm`."""

    def __init__(self, arm: Arm, log: DeviceLog) -> None:
        self._arm, self._log, self.cycle = arm, log, arm.cycle
        self._last: Vector | None = None

    def open(self) -> None:
        """As the arm's own."""
        self._arm.open()

    def read(self) -> ArmState:
        """As the arm's own."""
        state = self._arm.read()
        sent = state.q if self._last is None else self._last
        self._log.note(np.array([state.time]), state.q[None], sent[None])
        return state

    def command(self, q: Vector) -> None:
        """As the arm's own."""
        self._arm.command(q)
        self._last = q.copy()

    def stop(self) -> None:
        """As the arm's own."""
        self._arm.stop()
        self._last = None

    def close(self) -> None:
        """As the arm's own."""
        self._arm.close()


class LoggedSteppedArm(LoggedArm):
    """The same for an arm whose time passes only while it is asked (`lwrprobe.contracts.SteppedArm`)."""

    _arm: SteppedArm

    def cycles_until_sample(self, limit: int) -> int:
        """As the arm's own."""
        return self._arm.cycles_until_sample(limit)

    def step_many(self, set_points: Vector, times: Vector, joints: Vector, following: float) -> tuple[int, int]:
        """As the arm's own."""
        done, status = self._arm.step_many(set_points, times, joints, following)
        if done:
            self._log.note(times[:done], joints[:done], set_points[:done])
            self._last = set_points[done - 1].copy()
        return done, status


class LoggedSensor:
    """A sensor whose samples are kept; see `lwrprobe.contracts.Sensor`."""

    def __init__(self, sensor: Sensor, log: DeviceLog) -> None:
        self._sensor, self._log = sensor, log
        self.rate, self.latency = sensor.rate, sensor.latency

    def open(self) -> None:
        """As the sensor's own."""
        self._sensor.open()

    def read(self) -> list[WrenchSample]:
        """As the sensor's own."""
        samples = self._sensor.read()
        self._log.samples += [(self._log.now, sample) for sample in samples]
        return samples

    def close(self) -> None:
        """As the sensor's own."""
        self._sensor.close()
