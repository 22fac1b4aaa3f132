"""Force control: one law, and the controller that follows a surface with it. Strategies may import this package."""

from lwrprobe.control.contour_control import ContourControl
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
