"""Calibration by touch: what a scene states of probe, sensor and arm, measured on a reference sphere."""

from lwrprobe.calibration.calibration_file import Calibration, Quantity, read_calibration, write_calibration
from lwrprobe.calibration.free_readings import Load, identify_load
from lwrprobe.calibration.parameters import Parameters
from lwrprobe.calibration.priors import Priors
from lwrprobe.calibration.quantities import force_to_torque, quantities, tool_shift_rows
from lwrprobe.calibration.solution import CalibrationRefused, Solution, solve
from lwrprobe.calibration.touches import FreeReading, Touch, Touches

__all__ = [
    "Calibration",
    "CalibrationRefused",
    "FreeReading",
    "Load",
    "Parameters",
    "Priors",
    "Quantity",
    "Solution",
    "Touch",
    "Touches",
    "force_to_torque",
    "identify_load",
    "quantities",
    "read_calibration",
    "solve",
    "tool_shift_rows",
    "write_calibration",
]
