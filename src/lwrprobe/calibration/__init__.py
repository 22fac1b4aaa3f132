"""Calibration by touch: what a scene states of probe, sensor and arm, measured on a reference sphere."""

from lwrprobe.calibration.parameters import Parameters
from lwrprobe.calibration.priors import Priors
from lwrprobe.calibration.solution import CalibrationRefused, Solution, solve
from lwrprobe.calibration.touches import FreeReading, Touch, Touches

__all__ = ["CalibrationRefused", "FreeReading", "Parameters", "Priors", "Solution", "Touch", "Touches", "solve"]
