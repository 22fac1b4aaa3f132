"""Force control: one law, and the controller that follows a surface with it. Strategies may import this package."""

from lwrprobe.control.contour_control import RETURN, ContourControl
from lwrprobe.control.force_law import (
    ForceLaw,
    Refusal,
    approach_speed,
    choose_force_law,
    contour_speed,
    damping_without_overshoot,
    normal_velocity,
    peak_force,
    run_on,
)

__all__ = [
    "RETURN",
    "ContourControl",
    "ForceLaw",
    "Refusal",
    "approach_speed",
    "choose_force_law",
    "contour_speed",
    "damping_without_overshoot",
    "normal_velocity",
    "peak_force",
    "run_on",
]
