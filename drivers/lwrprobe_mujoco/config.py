"""The options of the MuJoCo world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lwrprobe_sim.config import SimConfig


@dataclass(frozen=True)
class MujocoConfig(SimConfig):
    """Table `[drivers.mujoco]`, `--set drivers.mujoco.timestep=1e-4`: the options of `[drivers.sim]` and these.

    Options of `sim` that describe its own contact model or its gears (`substeps`, `shear`, `slow_sliding`,
    `static_friction`, `stick_relaxation`, `tip_mass`, `foot_friction`, `inertia`, `joint_hysteresis`, `gear_ripple`,
    `friction_turn`) do nothing here. The run's summary lists those that `[truth]` asks for under `left_out`.

    Attributes
    ----------
    timestep : s, of the integration where something is within reach of a contact; a whole number makes a cycle
    free_timestep : s, the same elsewhere
    arm_mass : kg, spread over the arm's links in proportion to their volume; 16 is the LWR 4+'s (KUKA data sheet)
    joint_damping : damping ratio of the joints' springs, which the controller damps
    feedforward : share of the arm's inertial torque that the controller knows and feeds forward, 0 to 1
    stick_damping : damping ratio of the bending stick; printed resin
    impedance : MuJoCo's constraint impedance d, 0.1 to 0.9. The stiffness of a contact at rest does not depend on it.
        With a larger one a contact follows the constraint's own dynamics, and a light stick chatters
    friction_stiffening : MuJoCo's `impratio`; with a small value a held contact creeps
    mesh_tolerance : m, error of curved surfaces that MuJoCo has no shape for
    """

    timestep: float = 1e-4
    free_timestep: float = 2.5e-4
    arm_mass: float = 16.0
    joint_damping: float = 0.7
    feedforward: float = 0.9
    stick_damping: float = 0.05
    impedance: float = 0.5
    friction_stiffening: float = 100.0
    mesh_tolerance: float = 2e-5

    TABLE: ClassVar[str] = "mujoco"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("timestep", "free_timestep"):
            step = getattr(self, name)
            steps = self.cycle / step if step > 0.0 else 0.0
            whole = round(steps) >= 1 and abs(steps - round(steps)) < 1e-6
            self._check(name, whole, f"a whole part of the cycle, {self.cycle:g} s")
        self._check("arm_mass", self.arm_mass > 0.0, "more than 0 kg")
        self._check("joint_damping", self.joint_damping >= 0.0, "not negative")
        self._check("stick_damping", self.stick_damping >= 0.0, "not negative")
        self._check("feedforward", 0.0 <= self.feedforward <= 1.0, "a share, 0 to 1")
        self._check("impedance", 0.1 <= self.impedance <= 0.9, "0.1 to 0.9")
        self._check("friction_stiffening", self.friction_stiffening >= 1.0, "at least 1")
        self._check("mesh_tolerance", 1e-6 <= self.mesh_tolerance <= 1e-3, "1e-6 to 1e-3 m")
