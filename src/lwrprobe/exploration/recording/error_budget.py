"""How far each contact may be off: what `[uncertainty]`, noise and the touches themselves leave open.

A number that is the same for all contacts of a run, such as the probe's length, moves each of them by a vector: that
is a shared cause. The other causes differ from contact to contact. Two questions have two answers: how far a contact
may be from its true place, and how far it may be from it after the rigid motion that aligns all contacts with the true
ones. That motion takes away what shared causes move all contacts by together, the robot's base first of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi, radians, sqrt
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from lwrprobe.calibration.model import derivatives_by_table
from lwrprobe.contact import TorqueAgreement
from lwrprobe.contracts import Contact, LwrprobeError, Reconstruction, TouchRecord
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.exploration.stages.sensor_errors import FRICTION, wave_slope, zero_torque
from lwrprobe.kinematics import Robot
from lwrprobe.reconstruction.fits import fit
from lwrprobe.scene import Scene

BAND = 7.815
"""Squared radius of the 95 % region of three normal numbers in standard deviations."""
ALONG, ASIDE = 0.35, 0.15
"""Share of the turn of the wrench axis by the sensor's zero that reaches the normal, along the path and aside of it:
there motion and friction show the normal as well. Seen in simulated worlds of the profile `lab`."""
MEAN = sqrt(2.0 / pi)
"""Mean size of a normal number of standard deviation 1."""
SINGULAR = 1e-6
"""Added to the square of the arm's Jacobian, for a posture in which the arm cannot move along the path."""
NORMAL_AT_TRUST = 0.1
"""rad, error of a normal at which the estimators' trust is one half (`Settings.trusted_error`)."""
FLOOR = 2e-5
"""m, of what no other cause counts: time between samples, roundness, the stick's own dynamics."""
COLUMNS = "time,sigma_random_mm,sigma_mm,xx_mm2,xy_mm2,xz_mm2,yy_mm2,yz_mm2,zz_mm2,sigma_aligned_mm"


@dataclass(slots=True, frozen=True)
class ErrorBudget:
    """Errors of the contacts of a run, one standard deviation each.

    Attributes
    ----------
    points, normals : (n, 3) m and unit, world frame
    random : (n, 3, 3) m^2, covariance of what differs from contact to contact
    shared : (n, k, 3) m, shift of each contact by one standard deviation of each of k numbers common to all contacts
    aligned : (n, k, 3) m, the same less the rigid motion that makes each shift smallest in least squares
    causes, causes_aligned : mm along the normal by name, root mean square over the contacts
    """

    points: np.ndarray
    normals: np.ndarray
    random: np.ndarray
    shared: np.ndarray
    aligned: np.ndarray
    causes: dict[str, float]
    causes_aligned: dict[str, float]

    @classmethod
    def of(
        cls, points: np.ndarray, normals: np.ndarray, random: dict[str, np.ndarray], shared: dict[str, np.ndarray]
    ) -> ErrorBudget:
        """From causes by name: `random` (n, 3, 3) m^2 each, `shared` (n, any, 3) m each."""
        rows = np.concatenate([np.empty((len(points), 0, 3)), *shared.values()], axis=1)
        left = without_rigid_motion(points, rows)
        squares = {name: _along(normals, covariance) for name, covariance in random.items()}
        aligned, begin = dict(squares), 0
        for name, part in shared.items():
            mine = slice(begin, begin + part.shape[1])
            begin = mine.stop
            squares[name] = _squares_along(normals, part)
            aligned[name] = _squares_along(normals, left[:, mine])
        nothing = np.zeros((len(points), 3, 3))
        return cls(
            points, normals, sum(random.values(), nothing), rows, left,
            *({name: 1e3 * sqrt(float(v.mean())) for name, v in each.items()} for each in (squares, aligned)),
        )  # fmt: skip

    def covariance(self, aligned: bool = False) -> np.ndarray:
        """(n, 3, 3) m^2 of all causes, as they are or after alignment."""
        rows = self.aligned if aligned else self.shared
        return self.random + rows.transpose(0, 2, 1) @ rows

    def along_normal(self, aligned: bool = False) -> np.ndarray:
        """(n,) m, standard deviation along the normal of all causes."""
        rows = self.aligned if aligned else self.shared
        return np.sqrt(_along(self.normals, self.random) + _squares_along(self.normals, rows))

    def near(self, places: np.ndarray, aligned: bool = False) -> np.ndarray:
        """(m,) m, standard deviation along the normal of the contact nearest to each of (m, 3) m."""
        return self.along_normal(aligned)[self._nearest(places)]

    def shifts(self, places: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m, k) m along normals (m, 3) of places (m, 3) m: the shared causes, as they are and after alignment."""
        at = self._nearest(places)
        along, left = (np.einsum("nki,ni->nk", rows[at], normals) for rows in (self.shared, self.aligned))
        return along, left

    def _nearest(self, places: np.ndarray) -> np.ndarray:
        return np.asarray(cKDTree(self.points).query(places)[1])

    def claims_within_95(self, errors: np.ndarray, which: np.ndarray, aligned: bool = False) -> float | None:
        """Share of errors (k, 3) m of the contacts marked in (n,) bool inside the 95 % region; None without any.

        With `aligned` the errors are those left after the alignment.
        """
        if not which.any():
            return None
        whole = self.covariance(aligned)[which]
        square = np.einsum("ni,ni->n", errors, np.linalg.solve(whole, errors[:, :, None])[:, :, 0])
        return round(float((square <= BAND).mean()), 4)

    def write(self, path: Path, times: Sequence[float]) -> None:
        """One row a contact: its time [s], standard deviations along the normal, covariance of all causes."""
        random = np.sqrt(_along(self.normals, self.random))
        covariance = 1e6 * self.covariance()
        columns = [times, 1e3 * random, 1e3 * self.along_normal()]
        columns += [covariance[:, i, j] for i in range(3) for j in range(i, 3)]
        columns += [1e3 * self.along_normal(aligned=True)]
        np.savetxt(path, np.column_stack(columns), ["%.6f"] + ["%.6g"] * 9, ",", header=COLUMNS, comments="")

    def report(self) -> dict[str, object]:
        """For the summary: lengths in mm along the normal, one standard deviation."""

        def mean(values: np.ndarray) -> float:
            return round(1e3 * sqrt(float((values**2).mean())), 4)

        return {
            "causes_mm": {name: round(value, 4) for name, value in self.causes.items()},
            "causes_aligned_mm": {name: round(value, 4) for name, value in self.causes_aligned.items()},
            "random_mm": mean(np.sqrt(_along(self.normals, self.random))),
            "whole_mm": mean(self.along_normal()),
            "shape_mm": mean(self.along_normal(aligned=True)),
        }


def expect_mesh_errors(budget: ErrorBudget, surface: Reconstruction) -> dict[str, float]:
    """Add the errors of the contacts to the expected errors of a mesh's vertices; mean and p95 [mm] for the summary.

    What the reconstructor expects is the noise of the contacts and what lies between them. The nearest contact adds
    the rest. Vertices that no sphere could have touched are left out of mean and p95.
    """
    mesh = surface.mesh
    own = mesh.vertex_error if mesh.vertex_error is not None else np.zeros(len(mesh.vertices))
    absolute, aligned = (np.hypot(own, MEAN * budget.near(mesh.vertices, kind)) for kind in (False, True))
    mesh.vertex_error, mesh.vertex_error_aligned = absolute, aligned
    touched = np.ones(len(own), dtype=bool) if surface.unreachable is None else np.logical_not(surface.unreachable)
    found = {}
    for prefix, errors in (("", absolute), ("aligned_", aligned)):
        mine = 1e3 * (errors[touched] if touched.any() else errors)
        found[f"{prefix}mean"] = round(float(mine.mean()), 4)
        found[f"{prefix}p95"] = round(float(np.percentile(mine, 95.0)), 4)
    return found


def fitted_shapes(budget: ErrorBudget, record: TouchRecord, table_height: float) -> list[dict[str, object]]:
    """Simple shapes with dimensions and their standard deviations [mm], for the summary; none where none fits.

    Heights count from the table, whose own height is uncertain by `table_height` m.
    """
    try:
        fits = fit(record, budget.shifts)
    except LwrprobeError:
        return []
    rows: list[dict[str, object]] = []
    for found in fits:
        sigma = dict(found.uncertainty)
        if "height" in sigma:
            sigma["height"] = hypot(sigma["height"], table_height)
        sizes = (found.dimensions, sigma, found.uncertainty_aligned)
        names = ("size_mm", "sigma_mm", "sigma_aligned_mm")
        row = {key: {name: round(1e3 * v, 4) for name, v in part.items()} for key, part in zip(names, sizes)}
        about = {"shape": found.kind, "warranted": found.warranted, "why_not": found.why_not}
        rows.append({**about, "share": round(found.share, 4), "rms_mm": round(1e3 * found.rms, 4), **row})
    return rows


def without_rigid_motion(points: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """(n, k, 3) m: each of k fields of shifts of points (n, 3) m less the small rigid motion nearest to it.

    Points on a line, or fewer than three, leave directions open; those shift nothing.
    """
    away = points - points.mean(axis=0)
    motions = np.zeros((len(points), 6, 3))
    motions[:, :3] = np.eye(3)
    motions[:, 3:] = np.cross(np.eye(3), away[:, None]) / max(float(np.abs(away).max()), 1e-9)
    share = np.linalg.pinv(np.einsum("nai,nbi->ab", motions, motions), rcond=1e-9, hermitian=True)
    found = share @ np.einsum("nai,nki->ak", motions, shifts)
    return shifts - np.einsum("nai,ak->nki", motions, found)


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
    points = np.array([contact.point for contact in contacts])
    normals = np.array([contact.normal for contact in contacts])
    forces = np.array([contact.force for contact in contacts])
    trust = np.clip([contact.trust for contact in contacts], 0.01, 0.9999)
    rotations = pipeline.robot.fk_batch(joints)[:, :3, :3]
    paths = velocities / np.maximum(np.linalg.norm(velocities, axis=1, keepdims=True), 1e-9)
    gears, turning = _of_gears(scene, pipeline.robot, joints, paths)
    turned, friction = _of_normal(scene, pipeline, normals, forces, paths, trust, turning)
    shared = _of_probe(scene, pipeline, normals, forces, rotations)
    shared |= _of_arm(scene, pipeline.robot, joints, velocities) | {"friction direction": friction}
    rest = np.broadcast_to(FLOOR**2 * np.eye(3), turned.shape)
    return ErrorBudget.of(points, normals, {"normal": turned, "gears": gears, "rest": rest}, shared)


def _along(normals: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(n,) m^2, variance along the normal; rounding must not make it negative."""
    return np.maximum(np.einsum("ni,nij,nj->n", normals, covariance, normals), 0.0)


def _squares_along(normals: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(n,) m^2, the same of shifts (n, k, 3)."""
    return (np.einsum("nki,ni->nk", rows, normals) ** 2).sum(axis=1)


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


def _of_arm(scene: Scene, robot: Robot, joints: np.ndarray, velocities: np.ndarray) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause in the arm and in time."""
    table, poses = scene.uncertainty, robot.fk_batch(joints)
    lengths, angles = ("dh_a_mm", "dh_d_mm"), ("dh_twist_deg", "dh_offset_deg")
    a, d = (1e-3 * table.sigma(name) for name in lengths)
    alpha, theta = (radians(table.sigma(name)) for name in angles)
    by_table = derivatives_by_table(robot, joints, poses).transpose(0, 2, 1)
    axes = robot.base[:3, :3].T
    turned = radians(table.sigma("base_turn_deg")) * np.cross(axes, (poses[:, :3, 3] - robot.base[:3, 3])[:, None])
    shifted = np.broadcast_to(1e-3 * table.sigma("base_shift_mm") * np.eye(3), turned.shape)
    return {
        "kinematics": np.repeat([a, alpha, d, theta], robot.n)[:, None] * by_table,
        "base": np.concatenate([shifted, turned], axis=1),
        "clock": 1e-3 * table.sigma("clock_skew_ms") * velocities[:, None],
    }


def _of_gears(scene: Scene, robot: Robot, joints: np.ndarray, paths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (n, 3, 3) m^2 of the place by play and waves of the gears, and the angle (n,) rad by which the waves
    turn the direction of travel (n, 3)."""
    table, jacobians = scene.uncertainty, robot.jacobian_batch(joints)
    linear = jacobians[:, :3]
    play = radians(hypot(0.5 * table.sigma("joint_hysteresis_deg"), table.sigma("gear_ripple_deg") / sqrt(2.0)))
    # A wave makes each joint faster or slower by a share of its own speed; the probe does not turn.
    square = jacobians @ jacobians.transpose(0, 2, 1) + SINGULAR * np.eye(6)
    motion = np.concatenate([paths, np.zeros_like(paths)], axis=1)
    speeds = np.einsum("nij,ni->nj", jacobians, np.linalg.solve(square, motion[:, :, None])[:, :, 0])
    shares = linear * speeds[:, None]
    along = np.einsum("nij,ni->nj", shares, paths)
    across = np.maximum((shares**2).sum(axis=(1, 2)) - (along**2).sum(axis=1), 0.0)
    # Of the two directions across the path one lies in the surface; half of the square turns the normal.
    return play**2 * linear @ linear.transpose(0, 2, 1), wave_slope(scene) * np.sqrt(0.5 * 0.5 * across)


def _of_normal(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, forces: np.ndarray, paths: np.ndarray, trust: np.ndarray,
    turning: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """What turns the normal, and moves the point around the sphere with it.

    Covariance (n, 3, 3) m^2, and the shift (n, 1, 3) m by one standard deviation of the angle between friction and
    slip. The estimators' own error is one of noise. What wanders within seconds is the same in neighbouring samples,
    which they take for noise and average, so that it comes on top: along the path the direction of travel, aside of
    it the zero of the force, and in both a share of what the zero of all axes does to the torque.
    """
    radius, size = scene.probe.radius, np.maximum(np.linalg.norm(forces, axis=1), 1e-3)
    noise = _misfit(pipeline.torque) * NORMAL_AT_TRUST * np.sqrt(0.5 * (1.0 / trust - 1.0))
    axis = zero_torque(scene, pipeline.probe) / (radius * size)
    plane = sqrt(2.0) * 1e-3 * scene.uncertainty.sigma("zero_force_mn") / size
    aside = np.cross(normals, paths)
    covariance = noise[:, None, None] ** 2 * (np.eye(3) - normals[:, :, None] * normals[:, None, :])
    for sigma, way in ((np.hypot(turning, ALONG * axis), paths), (np.hypot(plane, ASIDE * axis), aside)):
        covariance += sigma[:, None, None] ** 2 * way[:, :, None] * way[:, None, :]
    turned = FRICTION * radians(scene.uncertainty.sigma("friction_direction_deg"))
    return radius**2 * covariance, radius * turned * aside[:, None]
