"""Arms whose time passes only while they are asked: many set points, with their answers, in one call."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import SteppedArm
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.set_points import MAX_ROWS


class SimulatedTime:
    """Carries out the set points between two wrench samples in one call.

    Nothing new is measured in between, so no stage would act in those cycles. The loop asks how many they are; for
    every other arm there is no `SimulatedTime`, and the loop goes cycle by cycle.

    Parameters
    ----------
    arm : of the same driver as the sensor
    n : number of joints
    """

    def __init__(self, arm: SteppedArm, n: int) -> None:
        self._arm = arm
        self._times, self._joints = np.zeros(MAX_ROWS), np.zeros((MAX_ROWS, n))

    @classmethod
    def of(cls, devices: Devices, n: int) -> SimulatedTime | None:
        """That of an arm that offers it, None for one that does not."""
        return cls(devices.arm, n) if isinstance(devices.arm, SteppedArm) else None

    def cycles(self, limit: int) -> int:
        """How many cycles, 1 to `limit`, may be generated at once: no sample comes before the last of them."""
        return 1 if limit <= 1 else 1 + self._arm.cycles_until_sample(limit - 1)

    def step(self, set_points: np.ndarray, following: float) -> tuple[np.ndarray, np.ndarray, int]:
        """Carry out set points (m, n) rad; ends early where the arm leaves one by more than `following` rad.

        Returns the arm's times (k,) s and joints (k, n) rad after each that was carried out, k <= m, and the status
        after the last one. Raises what the arm's `command` and `read` raise.
        """
        count = len(set_points)
        done, status = self._arm.step_many(set_points, self._times[:count], self._joints[:count], following)
        return self._times[:done], self._joints[:done], status
