"""What a redundant arm does with the freedom that the tip leaves it."""

from __future__ import annotations

from dataclasses import dataclass

from lwrprobe.contracts import InputError
from lwrprobe.kinematics.robot import Array


@dataclass(frozen=True)
class Preference:
    """Weights of what the null space is used for; the tip's accuracy never pays for it.

    Attributes
    ----------
    posture : (n,) joint values to stay near, the middle of the ranges by default
    near_posture : weight of staying near it
    off_limits : weight of leaving joint limits that are nearer than `zone`
    off_singularity : weight of growing manipulability (Yoshikawa 1985)
    zone : rad (lengths of the arm, for prismatic joints) from a joint limit within which the preference acts
    null_space_step : rad that one call of `track` moves a joint for it at most; 0 switches the preference off
    """

    posture: Array | None = None
    near_posture: float = 0.0
    off_limits: float = 1.0
    off_singularity: float = 0.0
    zone: float = 0.2
    null_space_step: float = 5e-4

    def __post_init__(self) -> None:
        for name in ("near_posture", "off_limits", "off_singularity", "zone", "null_space_step"):
            value = getattr(self, name)
            if not 0.0 <= value < float("inf"):
                raise InputError(f"preference.{name}", value, "a number from 0 up")
