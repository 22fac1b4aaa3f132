"""A sensor whose readings are corrected by a calibration."""

from __future__ import annotations

import numpy as np

from lwrprobe.calibration import Calibration
from lwrprobe.contracts import Sensor, WrenchSample


class CalibratedSensor:
    """Gives the wrench for the reading, and its time on the arm's clock; see `lwrprobe.contracts.Sensor`.

    Parameters
    ----------
    sensor : as its driver makes it
    calibration : matrix, clock offset and latency
    """

    def __init__(self, sensor: Sensor, calibration: Calibration) -> None:
        self._sensor = sensor
        self.rate = sensor.rate
        self._matrix = np.linalg.inv(calibration.values("sensor_matrix").reshape(6, 6))
        self._offset = float(calibration.values("clock_offset")[0])
        self.latency = max(float(calibration.values("sensor_latency")[0]), 0.0)

    def open(self) -> None:
        """As the sensor's own."""
        self._sensor.open()

    def read(self) -> list[WrenchSample]:
        """The sensor's samples, corrected."""
        return [self._corrected(sample) for sample in self._sensor.read()]

    def close(self) -> None:
        """As the sensor's own."""
        self._sensor.close()

    def _corrected(self, sample: WrenchSample) -> WrenchSample:
        wrench = self._matrix @ np.concatenate([sample.force, sample.torque])
        return WrenchSample(sample.time - self._offset, wrench[:3], wrench[3:], sample.sequence, sample.status)
