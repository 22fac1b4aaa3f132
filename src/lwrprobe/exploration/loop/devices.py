"""The devices of a run: arm and sensor behind their driver plug-ins, opened together and always closed."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from lwrprobe.contracts import (
    Arm,
    DelayedArm,
    Driver,
    DriverContext,
    GroundTruth,
    InputError,
    LeftOut,
    MassiveArm,
    Sensor,
    SteppedArm,
)
from lwrprobe.contracts.options import configure
from lwrprobe.contracts.plugins import load
from lwrprobe.exploration.loop.calibrated_sensor import CalibratedSensor
from lwrprobe.scene import Scene
from lwrprobe.scene.calibrated_scene import calibration_of


@dataclass(slots=True)
class Devices:
    """Arm and sensor.

    Attributes
    ----------
    arm, sensor : closed until the `with` block is entered
    drivers : by name, the one or two that were made
    """

    arm: Arm
    sensor: Sensor
    drivers: dict[str, Driver[Scene]]

    @classmethod
    def assemble(cls, scene: Scene, seed: int, realtime: bool, start_q: np.ndarray | None = None) -> Devices:
        """Make the drivers that the scene names; one that fills both roles is made once.

        `start_q` (n,) rad is where a simulated arm stands at first. Raises UnknownNameError, PluginError, and
        InputError for a driver that lacks the role, for a bad option, or for one simulated and one real device.
        """
        drivers: dict[str, Driver[Scene]] = {}
        for role, name in (("arm", scene.arm.driver), ("sensor", scene.sensor.driver)):
            plugin = load("driver", name)
            if role not in plugin.roles:
                raise InputError(f"{role}.driver", name, f"a driver with the role {role}")
            if name not in drivers:
                config = configure(plugin.Config, scene.drivers.get(name, {}), f"drivers.{name}")
                drivers[name] = plugin(DriverContext(config, scene, seed, realtime, start_q))
        for name, driver in drivers.items():
            # The samples of a sensor must be on the arm's clock, and that of a simulator is known to itself alone.
            if len(drivers) > 1 and "arm" in driver.roles and isinstance(driver.arm(), SteppedArm):
                both = (scene.arm.driver, scene.sensor.driver)
                allowed = f"{name!r} for both: it is simulated and has a clock of its own, which no other device shares"
                raise InputError("arm.driver, sensor.driver", both, allowed)
        arm, sensor = drivers[scene.arm.driver], drivers[scene.sensor.driver]
        calibration, face = calibration_of(scene), sensor.sensor()
        if calibration is not None:
            face = CalibratedSensor(face, calibration)
        return cls(arm.arm(), face, drivers)

    def __enter__(self) -> Devices:
        try:
            self.arm.open()
            self.sensor.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def arm_delay(self) -> float:
        """s beyond the next cycle by which the arm follows a set point later; 0 for an arm that states none."""
        return delay_of(self.arm)

    @property
    def arm_mass(self) -> float:
        """kg, of the arm's moving links; 0 for an arm that states none. An open arm may know it better."""
        return float(self.arm.mass) if isinstance(self.arm, MassiveArm) else 0.0

    @property
    def ground_truth(self) -> GroundTruth[Scene] | None:
        """That of the driver which knows it, asked for after the run; None on real devices."""
        return next((truth for driver in self.drivers.values() if (truth := driver.ground_truth()) is not None), None)

    @property
    def left_out(self) -> list[LeftOut]:
        """What the drivers do without."""
        return [item for driver in self.drivers.values() for item in driver.left_out]

    def counters(self) -> dict[str, dict[str, Any]]:
        """What each driver has counted on its connection; a driver that counts nothing is left out."""
        found = {name: dict(driver.counters()) for name, driver in self.drivers.items()}
        return {name: counts for name, counts in found.items() if counts}

    def close(self) -> None:
        """Release both devices, the sensor also when closing the arm fails."""
        try:
            self.arm.close()
        finally:
            self.sensor.close()


def delay_of(arm: Arm) -> float:
    """s that an arm states as a `DelayedArm`, or 0."""
    return float(arm.delay) if isinstance(arm, DelayedArm) else 0.0
