"""The ATI Wireless F/T as a driver plug-in: role sensor."""

from __future__ import annotations

from typing import ClassVar

from lwrprobe.contracts import DRIVER_CONTRACT, DriverContext, DriverError, HealthCheck
from lwrprobe.scene import Scene
from lwrprobe_ati.config import AtiConfig
from lwrprobe_ati.emulated_truth import EmulatedTruth
from lwrprobe_ati.health_checks import sensor_health
from lwrprobe_ati.sensor import AtiSensor


class AtiDriver:
    """ATI Wireless F/T force/torque sensor: role sensor."""

    Config: ClassVar[type] = AtiConfig
    contract: ClassVar[int] = DRIVER_CONTRACT
    roles: ClassVar[frozenset[str]] = frozenset({"sensor"})

    def __init__(self, context: DriverContext[Scene | None]) -> None:
        self._sensor = AtiSensor((context.config or AtiConfig()).at_rate_of(context.scene))

    def arm(self) -> None:
        raise DriverError("the driver 'ati' fills the role sensor alone; choose another one for the arm")

    def sensor(self) -> AtiSensor:
        return self._sensor

    def ground_truth(self) -> EmulatedTruth | None:
        """None for a real device; that of an emulated rig once the sensor is closed."""
        return EmulatedTruth.of(self._sensor.config, self._sensor.ahead)

    @property
    def left_out(self) -> tuple[()]:
        """A real device leaves nothing out."""
        return ()

    def health_checks(self, seconds: float) -> list[HealthCheck]:
        """Rate, losses, latency, noise, drift, battery and calibration, measured for some seconds."""
        return sensor_health(self._sensor, seconds)

    def counters(self) -> dict[str, int]:
        """What was counted on the connection."""
        return self._sensor.counters()
