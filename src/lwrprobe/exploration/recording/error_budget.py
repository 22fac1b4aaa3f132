"""How far each contact may be off: what `[uncertainty]`, noise and the touches themselves leave open.

Each cause is a set of vectors, the shift of a contact by one standard deviation of one number. The sum of their outer
products is the covariance. Systematic causes are common to all contacts of a run; random ones differ from contact to
contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians, sqrt
from pathlib import Path

import numpy as np

from lwrprobe.contact import TorqueAgreement
from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.exploration.stages.sensor_errors import FRICTION
from lwrprobe.scene import Scene

BAND = 7.815
"""Squared radius of the 95 % region of three normal numbers in standard deviations."""
SAMPLED = 300
"""Contacts for which the arm's part is computed; it varies slowly between them."""
NORMAL_AT_TRUST = 0.1
"""rad, error of a normal at which the estimators' trust is one half (`Settings.trusted_error`)."""
FLOOR = 2e-5
"""m, of what no other cause counts: time between samples, roundness, the stick's own dynamics."""
RANDOM = ("noise", "zero", "gears", "rest")
"""Causes that differ from contact to contact."""
COLUMNS = "time,sigma_random_mm,sigma_mm,xx_mm2,xy_mm2,xz_mm2,yy_mm2,yz_mm2,zz_mm2"


@dataclass(slots=True, frozen=True)
class ErrorBudget:
    """Covariances of the contacts of a run.

    Attributes
    ----------
    random, systematic : (n, 3, 3) m^2, world frame
    normals : (n, 3)
    causes : mm along the normal by name, root mean square over the contacts
    """

    random: np.ndarray
    systematic: np.ndarray
    normals: np.ndarray
    causes: dict[str, float]

    @property
    def along_normal(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) m, standard deviation along the normal: the random part, and all."""
        one = _along(self.normals, self.random)
        return np.sqrt(one), np.sqrt(one + _along(self.normals, self.systematic))

    def claims_within_95(self, errors: np.ndarray, which: np.ndarray) -> float | None:
        """Share of errors (k, 3) m of the contacts marked in (n,) bool inside the 95 % region; None without any."""
        if not which.any():
            return None
        whole = (self.random + self.systematic)[which]
        square = np.einsum("ni,ni->n", errors, np.linalg.solve(whole, errors[:, :, None])[:, :, 0])
        return round(float((square <= BAND).mean()), 4)

    def write(self, path: Path, times: Sequence[float]) -> None:
        """One row a contact: its time [s], standard deviations along the normal, covariance of all parts."""
        random, whole = self.along_normal
        covariance = 1e6 * (self.random + self.systematic)
        columns = [times, 1e3 * random, 1e3 * whole, *(covariance[:, i, j] for i in range(3) for j in range(i, 3))]
        np.savetxt(path, np.column_stack(columns), ["%.6f"] + ["%.6g"] * 8, ",", header=COLUMNS, comments="")

    def report(self) -> dict[str, object]:
        """For the summary: lengths in mm along the normal, one standard deviation."""
        random, whole = self.along_normal
        return {
            "causes_mm": {name: round(value, 4) for name, value in self.causes.items()},
            "random_mm": round(1e3 * float(np.sqrt((random**2).mean())), 4),
            "whole_mm": round(1e3 * float(np.sqrt((whole**2).mean())), 4),
            "shape_mm": round(float(np.sqrt(sum(v**2 for name, v in self.causes.items() if name != "base"))), 4),
        }


def recorded_budget(scene: Scene, pipeline: Pipeline, recorder: Recorder) -> ErrorBudget | None:
    """The budget of a run's contacts; None without contacts, and where some come from an earlier part of the run."""
    states = [state for state in recorder.states if state is not None]
    if not states or len(states) < len(recorder.contacts):
        return None
    joints, velocities = np.array([q for q, _ in states]), np.array([velocity for _, velocity in states])
    return error_budget(scene, pipeline, recorder.contacts, joints, velocities)


def error_budget(
    scene: Scene, pipeline: Pipeline, contacts: list[Contact], joints: np.ndarray, velocities: np.ndarray
) -> ErrorBudget:
    """The budget of contacts, at least one, with their joint values (n, joints) and velocities (n, 3) m/s."""
    normals = np.array([contact.normal for contact in contacts])
    forces = np.array([contact.force for contact in contacts])
    trust = np.clip([contact.trust for contact in contacts], 0.01, 0.9999)
    rotations = pipeline.robot.fk_batch(joints)[:, :3, :3]
    parts = _of_probe(scene, pipeline, normals, forces, rotations)
    parts |= _of_arm(scene, pipeline, joints, velocities)
    parts |= _of_normal(scene, pipeline, normals, velocities, trust, scene.probe.radius)
    parts["rest"] = FLOOR * np.eye(3) + np.zeros((len(contacts), 3, 3))
    covariance = {name: np.einsum("nki,nkj->nij", rows, rows) for name, rows in parts.items()}
    misfit = _misfit(pipeline.torque)
    covariance["normal"] = covariance["normal"] * misfit**2
    causes = {name: 1e3 * sqrt(float(_along(normals, each).mean())) for name, each in covariance.items()}
    nothing = np.zeros((len(contacts), 3, 3))
    random = sum((each for name, each in covariance.items() if name in RANDOM), nothing)
    systematic = sum((each for name, each in covariance.items() if name not in RANDOM), nothing)
    return ErrorBudget(random, systematic, normals, causes)


def _along(normals: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(n,) m^2, variance along the normal; rounding must not make it negative."""
    return np.maximum(np.einsum("ni,nij,nj->n", normals, covariance, normals), 0.0)


def _misfit(torque: TorqueAgreement | None) -> float:
    """Ratio by which the sensor's errors are larger than stated, as far as the run has shown."""
    return torque.surprise if torque is not None else 1.0


def _of_probe(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, forces: np.ndarray, rotations: np.ndarray
) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause in the probe and in what gives way."""
    table, probe = scene.uncertainty, pipeline.probe
    own = np.einsum("nji,nj->ni", rotations, forces)
    bend = np.einsum("nij,nj->ni", rotations, probe.compliance * own) if scene.contact.deflection else 0.0 * forces
    aside = 1e-3 * table.sigma("sphere_off_axis_mm")
    push = np.einsum("ni,ni->n", normals, forces)
    slip = forces - push[:, None] * normals
    stated = 1.0 / scene.contact.stiffness
    gives = pipeline.force.compliance_sigma(
        1e-6 * table.sigma("object_compliance_um_n"), 0.01 * table.sigma("arm_stiffness_percent")
    )
    return {
        "probe length": 1e-3 * table.sigma("probe_length_mm") * rotations[:, None, :, 2],
        "sphere off axis": aside * np.stack([rotations[:, :, 0], rotations[:, :, 1]], axis=1),
        "sphere radius": 1e-3 * table.sigma("sphere_radius_mm") * normals[:, None],
        "stick": 0.01 * table.sigma("stick_stiffness_percent") * bend[:, None],
        "force": 0.01
        * np.hypot(table.sigma("sensor_gain_percent"), table.sigma("sensor_crosstalk_percent"))
        * np.linalg.norm(bend, axis=1)[:, None, None]
        * np.eye(3),
        # The arm gives way along the surface as well, which nothing corrects.
        "arm and object": np.stack([gives * push[:, None] * normals, stated * slip], axis=1),
    }


def _of_arm(scene: Scene, pipeline: Pipeline, joints: np.ndarray, velocities: np.ndarray) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause in the arm and in time."""
    table, robot, n = scene.uncertainty, pipeline.robot, len(joints)
    at = np.unique(np.linspace(0, n - 1, min(n, SAMPLED)).astype(int))
    rows = np.clip(np.searchsorted(at, np.arange(n)), 0, len(at) - 1)
    kinematic, base, gears = [], [], []
    shift, turned = 1e-3 * table.sigma("base_shift_mm"), radians(table.sigma("base_turn_deg"))
    play = np.hypot(0.5 * table.sigma("joint_hysteresis_deg"), table.sigma("gear_ripple_deg") / sqrt(2.0))
    for k in at:
        frames = robot.link_frames(joints[k])
        tip = robot.fk_batch(joints[k : k + 1])[0, :3, 3]
        before, after = frames[:-1], frames[1:]
        about_z = np.cross(before[:, :3, 2], tip - before[:, :3, 3])
        about_x = np.cross(after[:, :3, 0], tip - after[:, :3, 3])
        kinematic.append(
            np.concatenate(
                [
                    radians(table.sigma("dh_offset_deg")) * about_z,
                    radians(table.sigma("dh_twist_deg")) * about_x,
                    1e-3 * table.sigma("dh_a_mm") * after[:, :3, 0],
                    1e-3 * table.sigma("dh_d_mm") * before[:, :3, 2],
                ]
            )
        )
        axes = frames[0][:3, :3].T
        base.append(np.concatenate([shift * np.eye(3), turned * np.cross(axes, tip - frames[0][:3, 3])]))
        gears.append(radians(play) * about_z)
    return {
        "kinematics": np.array(kinematic)[rows],
        "base": np.array(base)[rows],
        "gears": np.array(gears)[rows],
        "clock": 1e-3 * table.sigma("clock_skew_ms") * velocities[:, None],
    }


def _of_normal(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, velocities: np.ndarray, trust: np.ndarray, radius: float
) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause that turns the normal, and moves the point around the sphere with it."""
    speed = np.linalg.norm(velocities, axis=1, keepdims=True)
    path = velocities / np.maximum(speed, 1e-9)
    aside = np.cross(normals, path)
    turned = FRICTION * radians(scene.uncertainty.sigma("friction_direction_deg"))
    sigma = NORMAL_AT_TRUST * np.sqrt(1.0 / trust - 1.0) / sqrt(2.0)
    # Across the normal, in both directions; along it the error of an angle is of second order.
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    zero = 1e-3 * scene.uncertainty.sigma("zero_force_mn") * float(pipeline.probe.compliance.max())
    return {
        "friction direction": radius * turned * aside[:, None],
        "normal": 0.5 * radius * sigma[:, None, None] * across,
        "noise": radius * sigma[:, None, None] * across,
        "zero": zero * np.eye(3) + np.zeros((len(normals), 3, 3)),
    }
