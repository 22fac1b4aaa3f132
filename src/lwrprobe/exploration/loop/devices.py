"""The devices of a run: arm and sensor behind their driver plug-ins, opened together and always closed."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from lwrprobe.contracts import DRIVER_CONTRACT, Arm, Driver, DriverContext, GroundTruth, InputError, Sensor, SteppedArm
from lwrprobe.contracts.plugins import load
from lwrprobe.options import configure


@dataclass(slots=True)
class Devices:
    """Arm, sensor and, in simulation, the judge that knows the truth.

    `stepped` is the arm where it takes several set points in one call and speaks of the same driver's sensor.
    """

    arm: Arm
    sensor: Sensor
    judge: GroundTruth | None
    drivers: dict[str, Driver]
    stepped: SteppedArm | None = None

    @classmethod
    def assemble(cls, scene: Any, seed: int, realtime: bool, start_q: np.ndarray | None = None) -> Devices:
        """Make the drivers that the scene names; one that fills both roles is made once.

        `start_q` is where a simulated arm stands at first; a driver without such an option is not told.

        Raises UnknownNameError, PluginError, and InputError for a driver that lacks the role or for a bad option.
        """
        drivers: dict[str, Driver] = {}
        for role, name in (("arm", scene.arm.driver), ("sensor", scene.sensor.driver)):
            plugin = load("driver", name, DRIVER_CONTRACT)
            if role not in plugin.roles:
                raise InputError(f"{role}.driver", name, f"a driver with the role {role}")
            if name not in drivers:
                table = dict(scene.drivers.get(name, {}))
                if start_q is not None and "start_q" in getattr(plugin.Config, "__dataclass_fields__", {}):
                    table.setdefault("start_q", [float(v) for v in start_q])
                config = configure(plugin.Config, table, f"drivers.{name}")
                drivers[name] = plugin(DriverContext(config, scene, seed, realtime))
        arm, sensor = drivers[scene.arm.driver], drivers[scene.sensor.driver]
        face = arm.arm()
        stepped = face if arm is sensor and isinstance(face, SteppedArm) else None
        return cls(face, sensor.sensor(), arm.judge(), drivers, stepped)

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

    def account(self) -> dict[str, dict[str, Any]]:
        """What each driver has counted about its line: losses, lateness; nothing where it counts nothing."""
        return {name: driver.account() for name, driver in self.drivers.items() if hasattr(driver, "account")}

    def close(self) -> None:
        """Release both devices, the sensor also when the arm's way out fails."""
        try:
            self.arm.close()
        finally:
            self.sensor.close()
