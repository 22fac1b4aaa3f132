"""From the solved unknowns to the quantities that a scene is corrected by."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lwrprobe.calibration.calibration_file import FORCE_ROWS, Quantity
from lwrprobe.calibration.model import cross_matrices, derivatives_by_table
from lwrprobe.calibration.parameters import Parameters
from lwrprobe.calibration.priors import Priors
from lwrprobe.calibration.solution import Solution
from lwrprobe.calibration.touches import Touches
from lwrprobe.contact import Payload
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.kinematics import Robot

DELAY_SIGMA = 3e-4
"""s, of the arm's delay: a third of a cycle of 1 ms."""
CLOCK_MODEL = 5e-4
"""s, of the clocks' offset: what the models of play, hysteresis and yielding surface leave of the difference between
the rise and the fall of a touch. Seen in worlds drawn from the profile `datasheet`."""
_STEP = 1e-6


def quantities(
    solution: Solution,
    touches: Touches,
    load: Payload,
    robot: Robot,
    probe: Probe,
    priors: Priors,
    q: Vector,
    around: np.ndarray,
) -> dict[str, Quantity]:
    """All quantities of `Calibration`.

    `q` (n,) are joints at the sphere, for the arm's stiffness there; `around` (m, n) joints over the area, for what is
    left of the errors of the kinematic table and of the gears.
    """
    s = solution
    table_left, dh_prior = table_share(s, robot, around), s.parameters.sigma[s.parameters.slices["dh"]]
    waves_left = waves_share(s, robot, around, priors.gear_waves)
    shift = tool_shift(s, robot, q)
    prior_shift = np.array([priors.sphere_off_axis, priors.sphere_off_axis, priors.probe_length])
    stick = 1.0 / (probe.compliance[1:] * np.exp(s.value("stick")))
    joint = 1.0 / (priors.joint_compliance * np.exp(s.value("arm")))
    offsets = slice(3 * robot.n, 4 * robot.n)
    clock, clock_sigma = float(s.value("clock")[0]), np.hypot(s.sigma("clock"), CLOCK_MODEL)
    ratio, ratio_sigma, ratio_prior = _force_to_torque(s, probe)
    mass_seen = load.mass_sigma < 0.5 * 0.1 * probe.mass
    return {
        "tool_shift": _quantity("m", shift[0], shift[1], shift[1] < 0.5 * prior_shift),
        "sphere_radius": _taken(s, "radius", "m"),
        "stick_stiffness": _quantity("N/m", stick, stick * s.sigma("stick"), s.visible("stick")),
        "joint_stiffness": _quantity("N m/rad", joint, joint * s.sigma("arm"), s.visible("arm")),
        "arm_stiffness": _arm_stiffness(s, robot, priors, q),
        "sensor_matrix": _quantity(
            "1, 1/m and m", np.eye(6) + s.value("sensor").reshape(6, 6), s.sigma("sensor"), s.visible("sensor")
        ),
        "force_to_torque": _quantity("m", ratio, ratio_sigma, ratio_sigma < 0.5 * ratio_prior),
        "clock_offset": _quantity("s", [clock], clock_sigma, s.visible("clock")),
        "arm_delay": _quantity("s", [touches.following], [DELAY_SIGMA], [True]),
        "sensor_latency": _quantity("s", [touches.latency + clock], clock_sigma, s.visible("clock")),
        "table": _taken(s, "table", "m and 1"),
        "payload": _quantity(
            "kg and m", [load.mass, *load.com], [load.mass_sigma, *load.com_sigma], [mass_seen] * 4
        ),
        "kinematic_table": _quantity(
            "m and rad", s.value("dh"), table_left * dh_prior, np.full(4 * robot.n, table_left < 0.5)
        ),
        "tool": _taken(s, "tool", "m"),
        "gear_waves": _quantity(
            "rad", s.value("ripple"), np.full(2 * robot.n, waves_left * priors.gear_ripple), s.visible("ripple")
        ),
        "joint_hysteresis": _quantity(
            "rad",
            priors.joint_hysteresis * np.maximum(s.value("play"), 0.0),
            priors.joint_hysteresis * s.sigma("play"),
            s.visible("play"),
        ),
        "joint_offset": _quantity(
            "rad", s.value("dh")[offsets], s.sigma("dh")[offsets], s.visible("dh")[offsets]
        ),
        "surface_compliance": _quantity(
            "m/N", s.value("surface")[:1], s.sigma("surface")[:1], s.visible("surface")[:1]
        ),
    }  # fmt: skip


def arm_errors(solution: Solution) -> tuple[tuple[float, ...], ...]:
    """(k, 4 n + 3) m and rad: independent errors of kinematic table and tool, one standard deviation each.

    They are the covariance of both. What a sphere at one place does not show, as where all of the arm's errors together
    put the sphere in the base frame, is as large in them as before; ratios and differences that it shows are small.
    """
    at = solution.parameters.slices
    return _independent(solution, np.r_[at["dh"], at["tool"]])


def force_errors(solution: Solution) -> tuple[tuple[float, ...], ...]:
    """(k, 18) 1 and 1/m: the same of the force's three rows of the sensor's matrix.

    Touches of a sphere from all sides show where a force points to better than a degree. Torque and force agree far
    better than single entries of the matrix are known: no standard deviations of gain and crosstalk say both.
    """
    begin = solution.parameters.slices["sensor"].start
    return _independent(solution, np.arange(begin, begin + FORCE_ROWS))


def _independent(solution: Solution, which: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """(k, k): the covariance of some unknowns (k,) as independent errors of one standard deviation each."""
    sigma = solution.parameters.sigma[which]
    # In the prior's standard deviations lengths and angles are of one size.
    size, axes = np.linalg.eigh(solution.covariance[np.ix_(which, which)] / np.outer(sigma, sigma))
    rows = (axes * np.sqrt(np.maximum(size, 0.0))).T * sigma
    return tuple(tuple(float(v) for v in row) for row in rows)


def tool_shift(solution: Solution, robot: Robot, q: Vector) -> tuple[Vector, Vector]:
    """(3,) m and standard deviations: the sphere's centre against where the scene has it, tip frame axes."""
    rows = tool_shift_rows(solution.parameters, robot, q)
    return rows @ solution.x, np.sqrt(np.einsum("ij,jk,ik->i", rows, solution.covariance, rows))


def tool_shift_rows(parameters: Parameters, robot: Robot, q: Vector) -> np.ndarray:
    """(3, m): the tool's shift by the vector of unknowns, at joints q (n,), on which it does not depend.

    The errors of the last joint's own table shift the tip like an error of the tool, and no touch can tell the two
    apart: both are contained. A sphere at one place shows ratios of lengths alone. The length is therefore
    given in the arm's own scale: as if the sum of the arm's lengths, each counted by its size, were as stated.
    """
    n, at = robot.n, parameters.slices
    pose = robot.fk_batch(np.asarray(q)[None])
    by_table = derivatives_by_table(robot, np.asarray(q)[None], pose)[0]
    begin = at["dh"].start
    rows = np.zeros((3, len(parameters)))
    rows[:, at["tool"]] = np.eye(3)
    for block in range(4):
        column = block * n + n - 1
        rows[:, begin + column] = pose[0, :3, :3].T @ by_table[:, column]
    size = max(float(robot.a[:-1] @ robot.a[:-1] + robot.d[:-1] @ robot.d[:-1]), 1e-12)
    for block, lengths in ((0, robot.a), (2, robot.d)):
        rows[2, begin + block * n : begin + block * n + n - 1] -= robot.tool[2, 3] * lengths[:-1] / size
    return rows


def table_share(solution: Solution, robot: Robot, joints: np.ndarray) -> float:
    """Share of the tip's error over joints (m, n) by the kinematic table that is left: after a rigid alignment, since
    no touch shows where the base stands."""
    at, poses = solution.parameters.slices, robot.fk_batch(joints)
    by_table = derivatives_by_table(robot, joints, poses)
    arms = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)
    rigid = np.concatenate([np.broadcast_to(np.eye(3), (len(joints), 3, 3)), cross_matrices(arms)], axis=2)
    rigid = np.linalg.qr(rigid.reshape(-1, 6))[0]

    def size(rows: np.ndarray, covariance: np.ndarray) -> float:
        rows = rows.reshape(rigid.shape[0], -1)
        rows = rows - rigid @ (rigid.T @ rows)
        return float(np.sqrt(np.einsum("ij,jk,ik->", rows, covariance, rows)))

    both = np.r_[at["dh"], at["tool"]]
    left = size(np.concatenate([by_table, poses[:, :3, :3]], axis=2), solution.covariance[np.ix_(both, both)])
    before = size(by_table, np.diag(solution.parameters.sigma[at["dh"]] ** 2))
    return min(left / before, 1.0)


def waves_share(solution: Solution, robot: Robot, joints: np.ndarray, waves: float) -> float:
    """Share of the tip's error over joints (m, n) by the gears' waves that is left; all of it where `waves` is 0."""
    if waves == 0.0:
        return 1.0
    at, linear = solution.parameters.slices["ripple"], robot.jacobian_batch(joints)[:, :3]
    angle = waves * joints[:, None]
    rows = np.concatenate([linear * np.sin(angle), linear * np.cos(angle)], axis=2)
    left = np.einsum("kij,jl,kil->", rows, solution.covariance[at, at], rows)
    return min(float(np.sqrt(left / np.sum(rows**2 * solution.parameters.sigma[at] ** 2))), 1.0)


def _arm_stiffness(s: Solution, robot: Robot, priors: Priors, q: Vector) -> Quantity:
    jacobian = robot.jacobian(np.asarray(q))[:3]
    each = jacobian**2 * (priors.joint_compliance * np.exp(s.value("arm")))
    total = each.sum(axis=1)
    part = s.covariance[s.parameters.slices["arm"], s.parameters.slices["arm"]]
    relative = np.sqrt(np.einsum("ij,jk,ik->i", each, part, each)) / total
    before = np.linalg.norm(each, axis=1) * priors.joint_stiffness / total
    return _quantity("N/m", 1.0 / total, relative / total, relative < 0.5 * before)


def force_to_torque(matrix: np.ndarray, probe: Probe) -> np.ndarray:
    """(3, 3) m: torque that a sensor reads for a unit force that it reads, the force acting at the sphere's centre."""
    turn = cross_matrices(np.array([[0.0, 0.0, probe.sensor_distance]]))[0]
    return (matrix[3:, :3] + matrix[3:, 3:] @ turn) @ np.linalg.inv(matrix[:3, :3] + matrix[:3, 3:] @ turn)


def _force_to_torque(s: Solution, probe: Probe) -> tuple[Vector, Vector, Vector]:
    base = np.eye(6) + s.value("sensor").reshape(6, 6)
    middle = force_to_torque(base, probe).ravel()
    columns = []
    for k in range(36):
        moved = base.ravel().copy()
        moved[k] += _STEP
        columns.append((force_to_torque(moved.reshape(6, 6), probe).ravel() - middle) / _STEP)
    gradient, at = np.column_stack(columns), s.parameters.slices["sensor"]
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", gradient, s.covariance[at, at], gradient))
    return middle, sigma, np.sqrt((gradient**2) @ s.parameters.sigma[at] ** 2)


def _taken(s: Solution, name: str, unit: str) -> Quantity:
    return _quantity(unit, s.value(name), s.sigma(name), s.visible(name))


def _quantity(unit: str, values: ArrayLike, sigma: ArrayLike, visible: ArrayLike) -> Quantity:
    return Quantity(
        unit,
        tuple(float(v) for v in np.ravel(values)),
        tuple(float(v) for v in np.ravel(sigma)),
        tuple(bool(v) for v in np.ravel(visible)),
    )
