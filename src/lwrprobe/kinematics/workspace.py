"""Where an arm's tip can be: reachable and dexterous workspace, and whether an area can be worked in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import InputError, as_pose
from lwrprobe.kinematics.path import rotations, straight_line, why
from lwrprobe.kinematics.robot import Array, Robot
from lwrprobe.kinematics.solver import IKSolver, IKStatus

if TYPE_CHECKING:
    from spatialmath import SO3


@dataclass(frozen=True, slots=True)
class Workspace:
    """Tips of evenly spread joint values: q (m, n), tips (m, 4, 4), manipulability (m,)."""

    q: Array
    tips: Array
    manipulability: Array


@dataclass(frozen=True, slots=True)
class Reachability:
    """Which positions an arm can take with one orientation.

    Attributes
    ----------
    mask : (m,) bool
    status : (m,) int, `IKStatus`: UNREACHABLE and LIMITED can never be taken, JUMP not on the straight path from the
        start posture
    short_by : (m,) m that the tip falls short, 0 where reachable
    limit_margin : (m,) to the nearest joint limit where reachable [rad; m for prismatic joints], else 0
    q : (m, n) joint values, the nearest found where not reachable
    worst : index of the position that falls shortest or, where all are reachable, that is nearest to a joint limit
    reason : why the worst one is not reachable, empty where all are
    """

    mask: Array
    status: Array
    short_by: Array
    limit_margin: Array
    q: Array
    worst: int
    reason: str

    @property
    def all(self) -> bool:
        """True where every position is reachable."""
        return bool(self.mask.all())


def sample_workspace(robot: Robot, count: int, seed: int = 0) -> Workspace:
    """Tips of `count` joint values drawn evenly within the limits (a joint without limits: one turn)."""
    qs = np.random.default_rng(seed).uniform(*robot.span, (count, robot.n))
    return Workspace(qs, robot.fk_batch(qs), robot.manipulability_batch(qs))


def dexterity(robot: Robot, positions: Array, directions: int = 32, rolls: int = 4) -> Array:
    """(m,) share of orientations that the tip can take at each of positions (m, 3); 1 = the dexterous workspace.

    `directions` of the tool axis, evenly on the sphere, times `rolls` about it.
    """
    positions = _positions(positions)
    solver = IKSolver(robot)
    turns = _orientations(directions, rolls)
    q, pose, seed = np.empty(robot.n), np.eye(4), robot.middle
    share = np.zeros(len(positions))
    for k, position in enumerate(positions):
        pose[:3, 3] = position
        for turn in turns:
            pose[:3, :3] = turn
            share[k] += solver.reach(pose, seed, q) == IKStatus.CONVERGED
    return share / len(turns)


def reachable(
    robot: Robot, positions: Array, rotation: SO3 | Array, q0: Array | None = None, *, step: float = 0.01
) -> Reachability:
    """Whether the tip can stand at each of positions (m, 3) with one rotation (3, 3), before anything moves.

    With start values q0 (n,), also whether it gets there: the tip first turns to the rotation where it stands and then
    goes straight to the position, in steps of `step` m, without a jump of posture. Raises InputError naming
    `positions`, `rotation` or `q0`.
    """
    positions = _positions(positions)
    solver = IKSolver(robot)
    turned = np.eye(4)
    turned[:3, :3] = getattr(rotation, "A", rotation)
    turned = as_pose(turned, "rotation")
    start = None if q0 is None else _turned_start(solver, turned, robot.joint_values(q0, "q0"))
    m = len(positions)
    status, short_by, margin = np.zeros(m, int), np.zeros(m), np.zeros(m)
    qs, tip, seed = np.empty((m, robot.n)), np.empty((4, 4)), robot.middle
    for k, position in enumerate(positions):
        goal = turned.copy()
        goal[:3, 3] = position
        status[k] = solver.reach(goal, seed if start is None else start[1], qs[k])
        if status[k] == IKStatus.CONVERGED and start is not None:
            status[k] = _walk(solver, start, goal, step, qs[k])
        if status[k] == IKStatus.CONVERGED:
            margin[k] = robot.limit_margin(qs[k])
        else:
            robot.fk_into(qs[k], tip)
            short_by[k] = np.linalg.norm(tip[:3, 3] - position)
    mask = status == IKStatus.CONVERGED
    worst = int(np.argmin(margin) if mask.all() else np.argmax(np.where(mask, -1.0, short_by)))
    goal = turned.copy()
    goal[:3, 3] = positions[worst]
    from_q = seed if start is None else start[1]
    reason = "" if mask.all() else why(robot, IKStatus(status[worst]), goal, from_q, qs[worst])
    return Reachability(mask, status, short_by, margin, qs, worst, reason)


def _turned_start(solver: IKSolver, turned: Array, q0: Array) -> tuple[Array, Array]:
    """Pose and joint values of the start posture, turned on the spot to the wanted rotation."""
    here = np.empty((4, 4))
    solver.robot.fk_into(q0, here)
    goal = turned.copy()
    goal[:3, 3] = here[:3, 3]
    q = np.empty_like(q0)
    if _walk(solver, (here, q0), goal, 1.0, q) != IKStatus.CONVERGED:
        raise InputError("q0", q0.tolist(), "a posture whose tip can turn to `rotation` where it stands")
    return goal, q


def _walk(solver: IKSolver, start: tuple[Array, Array], goal: Array, step: float, q: Array) -> int:
    """Track the straight line from a start (pose, joint values) to the goal; the last joint values into q."""
    seed = start[1].copy()
    for pose in straight_line(start[0], goal, step, 0.05):
        status = solver.track(pose, seed, q)
        if status != IKStatus.CONVERGED:
            return status
        seed[:] = q
    return status


def _positions(positions: Array) -> Array:
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3 or len(positions) == 0:
        raise InputError("positions", positions.shape, "an (m, 3) array of at least one position")
    if not np.isfinite(positions).all():
        raise InputError("positions", positions[~np.isfinite(positions).all(axis=1)][0].tolist(), "finite numbers only")
    return positions


def _orientations(directions: int, rolls: int) -> Array:
    """(directions * rolls, 3, 3): z axes on a golden spiral (Vogel 1979), each rolled evenly."""
    k = np.arange(directions) + 0.5
    z = 1.0 - 2.0 * k / directions
    around = np.pi * (1.0 + np.sqrt(5.0)) * k
    tilt = np.arccos(z)
    roll = rotations(np.array([0.0, 0.0, 1.0]), 2.0 * np.pi * np.arange(rolls) / rolls)
    about = rotations(np.array([0.0, 0.0, 1.0]), around)
    over = rotations(np.array([0.0, 1.0, 0.0]), tilt)
    return np.ascontiguousarray((about @ over)[:, None] @ roll).reshape(-1, 3, 3)
