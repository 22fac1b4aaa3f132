"""From the uncertainty that a scene states to the error budget of a run's contacts, cause by cause."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, sqrt

import numpy as np

from lwrprobe.calibration.model import derivatives_by_table
from lwrprobe.contact import TorqueAgreement
from lwrprobe.contracts import Contact
from lwrprobe.contracts.contact import NORMAL_AT_HALF_CONFIDENCE
from lwrprobe.exploration.recording.corrections import Corrections
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.exploration.recording.force_error import matrix_errors, shifts_by_force
from lwrprobe.exploration.recording.gear_waves import GearWaves
from lwrprobe.exploration.recording.give import Give, softer
from lwrprobe.exploration.recording.neighbour_normals import NeighbourTurn
from lwrprobe.exploration.recording.path_normals import REACHES, PathTurn
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.exploration.stages.sensor_errors import friction_turn, lag, zero_errors, zero_torque
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene

ALONG = 0.1
"""Share of the turn of the wrench axis by the sensor's zero that reaches the normal along the path, which the motion
shows as well. Seen in simulated worlds of the profile `lab`."""
SINGULAR = 1e-6
"""Added to the square of the arm's Jacobian, for a posture in which the arm cannot move along the path."""
FLOOR = 2e-5
"""m, of what no other cause counts: time between samples, roundness, the stick's own dynamics."""
SWING = 2.0
"""Times the tilt of the waves, the tilt of a chord by the sensor's hysteresis at most: the force law answers late to a
reading that lags. Seen in simulated worlds of the profile `datasheet`."""
UNCORRECTED = Corrections()


def recorded_budget(
    scene: Scene,
    pipeline: Pipeline,
    recorder: Recorder,
    corrections: Corrections = UNCORRECTED,
) -> ErrorBudget | None:
    """The budget of a run's contacts after `corrections`.

    None without contacts, and where some come from an earlier part of the run.
    """
    states = recorder.arm_states()
    return None if states is None else error_budget(scene, pipeline, recorder.contacts, *states, corrections)


def error_budget(
    scene: Scene,
    pipeline: Pipeline,
    contacts: list[Contact],
    joints: np.ndarray,
    velocities: np.ndarray,
    corrections: Corrections = UNCORRECTED,
) -> ErrorBudget:
    """The budget of contacts, at least one, after `corrections`.

    With their joint values (n, joints) rad and velocities (n, 3) m/s.
    """
    points = np.array([contact.point for contact in contacts])
    normals = np.array([contact.normal for contact in contacts])
    forces = np.array([contact.force for contact in contacts])
    confidence = np.clip([contact.confidence_score for contact in contacts], 0.01, 0.9999)
    rotations = pipeline.robot.fk_batch(joints)[:, :3, :3]
    paths = velocities / np.maximum(np.linalg.norm(velocities, axis=1, keepdims=True), 1e-9)
    gears = _of_gears(scene, pipeline.robot, joints, normals, paths, corrections.waves)
    beside = corrections.neighbours or NeighbourTurn(*np.zeros((2, len(points))))
    left = 1.0 - beside.share
    # Only where the waves lead the sphere up and down does the force go from one side of the loop to the other.
    lagging = np.minimum(SWING * gears.before, _of_lag(scene, pipeline, normals, rotations, corrections.give))
    travel = _Along(gears.before, np.hypot(gears.after, lagging), corrections.path)
    normal = _of_normal(scene, pipeline, normals, forces, paths, confidence, travel, beside)
    shared = _of_probe(scene, normals, rotations)
    shared |= _of_give(scene, pipeline, normals, forces, rotations, corrections.give)
    since = pipeline.force.zero.age(np.array([contact.time for contact in contacts]))
    shared |= _of_force(scene, pipeline, normals, forces, rotations, paths, since, left)
    shared |= _of_arm(scene, pipeline.robot, joints, velocities)
    friction = (friction_turn(scene) if corrections.side is None else corrections.side.error) * left
    shared["friction direction"] = scene.probe.radius * (friction[:, None] * np.cross(normals, paths))[:, None]
    rest = np.broadcast_to(FLOOR**2 * np.eye(3), normal.shape)
    return ErrorBudget.of(points, normals, {"normal": normal, "gears": gears.places, "rest": rest}, shared)


def _misfit(torque: TorqueAgreement | None) -> float:
    """Ratio by which the sensor's errors are larger than stated, as far as the run has shown."""
    return torque.surprise if torque is not None else 1.0


def _of_probe(scene: Scene, normals: np.ndarray, rotations: np.ndarray) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause in the shape of the probe."""
    table = scene.uncertainty
    aside = 1e-3 * table.sigma("sphere_off_axis_mm")
    radius = {"sphere radius": 1e-3 * table.sigma("sphere_radius_mm") * normals[:, None]}
    if scene.arm.correction.errors:  # they contain where the sphere's centre is
        return radius
    return radius | {
        "probe length": 1e-3 * table.sigma("probe_length_mm") * rotations[:, None, :, 2],
        "sphere off axis": aside * np.stack([rotations[:, :, 0], rotations[:, :, 1]], axis=1),
    }


def _of_give(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, forces: np.ndarray, rotations: np.ndarray, give: Give | None
) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause in what gives way."""
    if give is not None:
        shifts = give.shifts(give.errors)
        return {"stick": shifts[:, :1], "arm and object": shifts[:, 1:]}
    table = scene.uncertainty
    own = np.einsum("nji,nj->ni", rotations, forces)
    stick = pipeline.probe.compliance * float(scene.contact.deflection)
    bend = np.einsum("nij,nj->ni", rotations, stick * own)
    push = np.einsum("ni,ni->n", normals, forces)
    slip = forces - push[:, None] * normals
    gives = pipeline.force.stiffness.sigma(
        1e-6 * table.sigma("object_compliance_um_n"), 0.01 * table.sigma("arm_stiffness_percent")
    )
    return {
        "stick": softer(0.01 * table.sigma("stick_stiffness_percent")) * bend[:, None],
        # The arm gives way along the surface as well, which nothing corrects here.
        "arm and object": np.stack([gives * push[:, None] * normals, slip / scene.contact.stiffness], axis=1),
    }


def _of_force(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, forces: np.ndarray, rotations: np.ndarray,
    paths: np.ndarray, since: np.ndarray, left: np.ndarray,
) -> dict[str, np.ndarray]:  # fmt: skip
    """(n, k, 3) m of the errors of the force: its matrix, and its drift in the time (n,) s `since` the last zero.

    Of the turn of the normal by either the share `left` (n,) counts.
    """
    table, probe = scene.uncertainty, pipeline.probe
    own, out = (np.einsum("nji,nj->ni", rotations, vectors) for vectors in (forces, normals))
    # Torque and force that disagree by more than stated come from the same matrix.
    matrix = _misfit(pipeline.torque) * matrix_errors(table, probe, own, out)
    drift = 1e-3 / 60.0 * table.sigma("drift_mn_per_min") * since[:, None, None] * np.eye(3)
    where = (rotations, forces, normals, paths, left)
    return {
        "force": shifts_by_force(probe, matrix, *where),
        "drift": shifts_by_force(probe, drift, *where),
    }


def _of_arm(scene: Scene, robot: Robot, joints: np.ndarray, velocities: np.ndarray) -> dict[str, np.ndarray]:
    """(n, k, 3) m of each cause in the arm and in time."""
    table, poses = scene.uncertainty, robot.fk_batch(joints)
    lengths, angles = ("dh_a_mm", "dh_d_mm"), ("dh_twist_deg", "dh_offset_deg")
    a, d = (1e-3 * table.sigma(name) for name in lengths)
    alpha, theta = (radians(table.sigma(name)) for name in angles)
    by_table = derivatives_by_table(robot, joints, poses).transpose(0, 2, 1)
    single = np.repeat([a, alpha, d, theta], robot.n)[:, None] * by_table
    left = scene.arm.correction.error_rows(robot.n)
    # The rows of the tool are the tip's axes in the world.
    together = np.concatenate([by_table, poses[:, :3, :3].transpose(0, 2, 1)], axis=1)
    axes = robot.base[:3, :3].T
    turned = radians(table.sigma("base_turn_deg")) * np.cross(axes, (poses[:, :3, 3] - robot.base[:3, 3])[:, None])
    shifted = np.broadcast_to(1e-3 * table.sigma("base_shift_mm") * np.eye(3), turned.shape)
    return {
        "kinematics": left @ together if len(left) else single,
        "base": np.concatenate([shifted, turned], axis=1),
        "clock": 1e-3 * table.sigma("clock_skew_ms") * velocities[:, None],
    }


@dataclass(slots=True, frozen=True)
class _Along:
    """What is known of n paths against the surface.

    Attributes
    ----------
    during, chords : (n,) rad, standard deviation of the direction of travel at an instant and of the chord after a run
    turned : normals turned to the chords, None without that correction
    """

    during: np.ndarray
    chords: np.ndarray
    turned: PathTurn | None


def _of_lag(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, rotations: np.ndarray, give: Give | None
) -> np.ndarray:
    """(n,) rad, by which the sensor's hysteresis tilts the chords of a path at most.

    Where the force goes up and down the reading lags behind it, and the centre is corrected for what stick, arm and
    object give way under the reading. A chord goes at most from one side of the loop to the other.
    """
    own = np.einsum("nji,nj->ni", rotations, normals)
    stick = own**2 @ (pipeline.probe.compliance * float(scene.contact.deflection))
    gives = stick + 1.0 / scene.contact.stiffness + (give.object if give is not None else 0.0)
    return lag(scene, pipeline.probe) * gives / (2.0 * REACHES[0])


@dataclass(slots=True, frozen=True)
class _Gears:
    """What play and waves of the gears leave open of n contacts.

    Attributes
    ----------
    places : (n, 3, 3) m^2, covariance of the place
    before, after : (n,) rad, by which the waves tilt the path against the surface, before and after their correction
    """

    places: np.ndarray
    before: np.ndarray
    after: np.ndarray


def _of_gears(
    scene: Scene, robot: Robot, joints: np.ndarray, normals: np.ndarray, paths: np.ndarray, waves: GearWaves | None
) -> _Gears:
    """Of the gears, along n paths, after the correction by `waves`."""
    table, jacobians = scene.uncertainty, robot.jacobian_batch(joints)
    linear = jacobians[:, :3]
    stated = radians(table.sigma("gear_ripple_deg")) / sqrt(2.0)
    rest = np.full(robot.n, stated) if waves is None else waves.error
    moved = linear * np.hypot(0.5 * radians(table.sigma("joint_hysteresis_deg")), rest)
    # A wave makes each joint faster or slower by a share of its own speed; the probe does not turn.
    square = jacobians @ jacobians.transpose(0, 2, 1) + SINGULAR * np.eye(6)
    motion = np.concatenate([paths, np.zeros_like(paths)], axis=1)
    speeds = np.einsum("nij,ni->nj", jacobians, np.linalg.solve(square, motion[:, :, None])[:, :, 0])
    tilts = scene.arm.gear_waves * np.einsum("ni,nij->nj", normals, linear) * speeds
    before, after = (np.linalg.norm(tilts * size, axis=1) for size in (stated, rest))
    return _Gears(moved @ moved.transpose(0, 2, 1), before, after)


def _of_normal(
    scene: Scene, pipeline: Pipeline, normals: np.ndarray, forces: np.ndarray, paths: np.ndarray,
    confidence: np.ndarray, travel: _Along, beside: NeighbourTurn,
) -> np.ndarray:  # fmt: skip
    """What turns the normal, and moves the point around the sphere with it: covariance (n, 3, 3) m^2.

    The estimators' own error is one of noise. What wanders within seconds is the same in neighbouring samples,
    which they take for noise and average, so that it comes on top: along the path the direction of travel and a share
    of what the zero of all axes does to the torque, aside of it what is left where force and torque are weighed by
    their zeros' errors.
    """
    radius, size = scene.probe.radius, np.maximum(np.linalg.norm(forces, axis=1), 1e-3)
    noise = _misfit(pipeline.torque) * NORMAL_AT_HALF_CONFIDENCE * np.sqrt(0.5 * (1.0 / confidence - 1.0))
    axis = zero_torque(scene, pipeline.probe) / (radius * size)
    plane = sqrt(2.0) * zero_errors(scene, pipeline.probe)[0] / size
    aside, along = np.cross(normals, paths), np.hypot(np.hypot(travel.during, ALONG * axis), noise)
    along = along if travel.turned is None else travel.turned.left(along, travel.chords)
    # What is left beside other lines contains the share of the contact's own error, as large as the run has shown it.
    both = plane * axis / np.maximum(np.hypot(plane, axis), 1e-12)
    across = np.where(beside.share > 0.0, beside.error**2, noise**2 + both**2)
    covariance = noise[:, None, None] ** 2 * (np.eye(3) - normals[:, :, None] * normals[:, None, :])
    # Path and neighbours have corrected the noise as well.
    for variance, motions in ((along**2 - noise**2, np.cross(aside, normals)), (across - noise**2, aside)):
        covariance += variance[:, None, None] * motions[:, :, None] * motions[:, None, :]
    return radius**2 * covariance
