"""Calibration by touch: what a scene states of probe, sensor and arm, measured on a reference sphere.

A scene reads the file of a calibration; the kernels of the solver are imported only by who uses it.
"""

from typing import TYPE_CHECKING

from lwrprobe.calibration.calibration_file import (
    Calibration,
    Quantity,
    previous_path,
    read_calibration,
    write_calibration,
)
from lwrprobe.calibration.drift import Drift, drifts
from lwrprobe.lazy import imported_on_use

if TYPE_CHECKING:
    from lwrprobe.calibration.parameters import Parameters
    from lwrprobe.calibration.priors import Priors
    from lwrprobe.calibration.quantities import force_to_torque, tool_shift_rows
    from lwrprobe.calibration.solution import CalibrationRefused, Solution, solve
    from lwrprobe.calibration.touches import Touch, Touches

__all__ = [
    "Calibration",
    "CalibrationRefused",
    "Drift",
    "Parameters",
    "Priors",
    "Quantity",
    "Solution",
    "Touch",
    "Touches",
    "drifts",
    "force_to_torque",
    "previous_path",
    "read_calibration",
    "solve",
    "tool_shift_rows",
    "write_calibration",
]

_MODULES = {
    "CalibrationRefused": "solution",
    "Parameters": "parameters",
    "Priors": "priors",
    "Solution": "solution",
    "Touch": "touches",
    "Touches": "touches",
    "force_to_torque": "quantities",
    "solve": "solution",
    "tool_shift_rows": "quantities",
}

__getattr__ = imported_on_use(__name__, _MODULES)
