"""Inverse kinematics: joint values for a pose of the tip."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import InputError, as_pose
from lwrprobe.kinematics import dls_kernels as dls
from lwrprobe.kinematics import ik_kernels as kernels
from lwrprobe.kinematics import preference_kernels
from lwrprobe.kinematics import srs_kernels as srs
from lwrprobe.kinematics.chain_kernels import UNIT
from lwrprobe.kinematics.preference import Preference
from lwrprobe.kinematics.robot import Array, Robot
from lwrprobe.kinematics.spherical import spherical_shape

if TYPE_CHECKING:
    from spatialmath import SE3


class IKStatus(IntEnum):
    """How a search for joint values ended; 0 is success.

    UNREACHABLE: beyond the arm's reach; LIMITED: held back by joint limits; BUDGET: stopped at the iteration limit;
    JUMP: only with a larger joint jump than allowed; INVALID: no rigid motion, or no number.
    """

    CONVERGED = kernels.CONVERGED
    UNREACHABLE = kernels.UNREACHABLE
    LIMITED = kernels.LIMITED
    BUDGET = kernels.BUDGET
    JUMP = kernels.JUMP
    INVALID = kernels.INVALID


@dataclass(frozen=True, slots=True)
class IKResult:
    """Joint values and what they are worth, by forward kinematics.

    Attributes
    ----------
    status : see `IKStatus`
    q : (n,) the solution, else the joint values of the nearest pose found
    tip : (4, 4) of the tip at q
    position_error, rotation_error : m and rad between `tip` and the requested pose
    short_by : m that the tip falls short of it, 0 when converged
    iterations : steps of damped least squares; 0 where the closed form alone was enough
    branch : signs of elbow, shoulder and wrist bend (joints 4, 2, 6) of a spherical-roll-spherical arm, else None
    """

    status: IKStatus
    q: Array
    tip: Array
    position_error: float
    rotation_error: float
    short_by: float
    iterations: int
    branch: tuple[int, int, int] | None

    @property
    def pose(self) -> SE3:
        """`tip` as an SE3, whose package takes a second to load: a run does without."""
        from spatialmath import SE3

        return SE3(self.tip, check=False)

    @property
    def converged(self) -> bool:
        """True when q is a solution within tolerance and limits."""
        return self.status == IKStatus.CONVERGED


@dataclass(frozen=True, slots=True)
class Branch:
    """One way in which a spherical-roll-spherical arm holds a pose.

    Attributes
    ----------
    signs : +1 or -1 for the bends of elbow, shoulder and wrist (joints 4, 2 and 6)
    arcs : (k, 2) rad, the arm angles from .. to that the joint limits leave; from == to where it is a single point
    """

    signs: tuple[int, int, int]
    arcs: Array


class IKSolver:
    """Joint values for poses of one robot's tip; one solver a thread.

    Damped least squares with an active set of joint limits; arms with spherical shoulder and wrist, recognised from
    their DH table, also have a closed form for cold starts, as a fallback, and to detect poses out of reach.

    Parameters
    ----------
    robot : the arm with its tool
    tolerance : m, of the tip's position
    rotation_tolerance : rad
    max_jump : rad (lengths of the arm, for prismatic joints) that `track` may move a joint in one call
    preference : what a redundant arm's freedom is used for while tracking
    damping : weight of the squared error in the damping
    iterations : steps of one descent
    restarts : descents from other places, for arms without a closed form
    """

    def __init__(
        self,
        robot: Robot,
        *,
        tolerance: float = 1e-6,
        rotation_tolerance: float = 1e-6,
        max_jump: float = 0.5,
        preference: Preference | None = None,
        damping: float = 0.1,
        iterations: int = 50,
        restarts: int = 100,
    ) -> None:
        self.robot = robot
        self.preference = preference or Preference()
        self._table = np.zeros((robot.n + kernels.ROWS, max(kernels.WIDTH, robot.n)))
        self._table[: robot.n + 2, : robot.chain.shape[1]] = robot.chain
        settings = self._table[robot.n + kernels.SETTINGS]
        settings[dls.POSITION_TOL] = _positive("tolerance", tolerance)
        settings[dls.ROTATION_TOL] = _positive("rotation_tolerance", rotation_tolerance)
        settings[dls.MAX_JUMP] = _positive("max_jump", max_jump)
        settings[dls.DAMPING] = _positive("damping", damping)
        settings[dls.ITERATIONS] = _positive("iterations", iterations)
        settings[dls.RESTARTS] = _positive("restarts", restarts)
        settings[dls.ROTATION_WEIGHT] = 1.0
        self._prefer(self._table, self.preference)
        self._table[robot.n + kernels.SPREAD, : robot.n] = _spread(robot.n)
        shape = spherical_shape(robot)
        if shape is not None:
            settings[kernels.SPHERICAL] = 1.0
            self._table[robot.n + kernels.SHAPE : robot.n + kernels.SHAPE + 3, :16] = shape
        # cold starts keep no distance from their seed and have no cycle to spread a preference over
        self._cold = self._table.copy()
        self._cold[robot.n + kernels.SETTINGS, dls.MAX_JUMP] = kernels.FOREVER
        self._cold[robot.n + kernels.SETTINGS, preference_kernels.NULL_SPACE_STEP] = 0.0

    @property
    def closed_form(self) -> bool:
        """True for an arm with spherical shoulder and wrist, whose solutions are all known."""
        return bool(self._table[self.robot.n + kernels.SETTINGS, kernels.SPHERICAL])

    @property
    def table(self) -> Array:
        """What `ik_kernels.track` takes first, for kernels that call it; one solver's own, its scratch included."""
        return self._table

    def track(self, pose: Array, q_seed: Array, q_out: Array) -> int:
        """Follow a moving pose (4, 4) from the last joint values q_seed (n,) into q_out (n,); an `IKStatus` value.

        The fast path of the control loop: float64 arrays in C order, unchecked; raises nothing, allocates nothing,
        and never moves a joint by more than `max_jump`. Unless it returns CONVERGED, q_out is the best found nearby.
        """
        return kernels.track(self._table, pose, q_seed, q_out)

    def track_all(self, poses: Array, q_seed: Array, q_out: Array) -> int:
        """`track` through poses (m, 4, 4), each from the joint values of the one before, into q_out (m, n).

        Returns how many were solved before one was not, or all.
        """
        return kernels.track_all(self._table, poses, q_seed, q_out)

    def reach(self, pose: Array, q_seed: Array, q_out: Array) -> int:
        """Any joint values (n,) for a pose (4, 4), rather near q_seed, into q_out; an `IKStatus` value.

        The fast path of a cold start, unchecked like `track`. Unless it returns CONVERGED, q_out leads to the nearest
        pose found, with the orientation kept.
        """
        return kernels.reach(self._cold, pose, q_seed, q_out)

    def solve(self, pose: SE3 | Array, q0: Array | None = None, posture: Array | None = None) -> IKResult:
        """Joint values for a pose, checked and certified.

        With q0 (n,) the solution is sought downhill from there; with a posture (n,) it is moved along the null space
        as near to the posture as the tip and the joint limits allow. Without a solution, the result holds the nearest
        pose with the wanted orientation and how far it falls short.

        Raises InputError naming `pose`, `q0` or `posture` for what is no rigid motion or no (n,) finite numbers.
        """
        target = _exactly_rotated(as_pose(pose))
        posture = None if posture is None else self.robot.joint_values(posture, "posture")
        q = np.empty(self.robot.n)
        status = -1
        if q0 is not None:
            status = kernels.track(self._cold, target, self.robot.joint_values(q0, "q0"), q)
        if status != IKStatus.CONVERGED:
            seed = posture if q0 is None else self.robot.joint_values(q0, "q0")
            status = self.reach(target, self.robot.middle if seed is None else seed, q)
        if posture is not None and status == IKStatus.CONVERGED:
            self._prefer(self._cold, Preference(posture, near_posture=1.0, off_limits=0.0, null_space_step=0.0))
            kernels.settle(self._cold, target, q)
        return self._result(IKStatus(status), target, q)

    def branches(self, pose: SE3 | Array) -> tuple[Branch, ...]:
        """All solutions of a spherical-roll-spherical arm, branch by branch: which arm angles the joint limits leave.

        Up to eight branches, each a choice of how elbow, shoulder and wrist bend, with its arcs of arm angles; none
        where the pose is out of reach. Raises InputError for an arm without the closed form, and for what is no pose.
        """
        self._needs_closed_form()
        target = _exactly_rotated(as_pose(pose))
        choices = itertools.product((1, -1), (1, -1), (1, -1))
        found = (self._branch(target, signs) for signs in choices)
        return tuple(branch for branch in found if len(branch.arcs))

    def on_branch(self, pose: SE3 | Array, signs: tuple[int, int, int], arm_angle: float) -> Array | None:
        """Joint values (n,) of one branch (see `Branch.signs`) at an arm angle [rad]; None beyond the joint limits."""
        self._needs_closed_form()
        q = np.empty(self.robot.n)
        target = _exactly_rotated(as_pose(pose))
        side, shoulder, wrist = self._sides(signs)
        found = kernels.on_branch(self._cold, target, side, shoulder, wrist, arm_angle, self.robot.middle, q)
        return q if found else None

    def _branch(self, target: Array, signs: tuple[int, int, int]) -> Branch:
        arcs = np.empty((srs.ARCS, 2))
        count = max(kernels.arcs_of(self._cold, target, self.robot.n, *self._sides(signs), arcs), 0)
        return Branch(signs, _closed_round(arcs[:count]))

    def _sides(self, signs: tuple[int, int, int]) -> tuple[int, float, float]:
        elbow, shoulder, wrist = signs
        twist = self._table[self.robot.n + kernels.SHAPE + 2, srs.SIGN + 3]
        return (0 if elbow * twist > 0 else 1), float(shoulder), float(wrist)

    def _needs_closed_form(self) -> None:
        if not self.closed_form:
            raise InputError("robot", self.robot.name, "an arm with spherical shoulder, elbow and spherical wrist")

    def _result(self, status: IKStatus, target: Array, q: Array) -> IKResult:
        tip = np.empty((4, 4))
        self.robot.fk_into(q, tip)
        position_error = float(np.linalg.norm(tip[:3, 3] - target[:3, 3]))
        rotation_error = float(np.linalg.norm(tip[:3, :3] - target[:3, :3]) / np.sqrt(2.0))
        return IKResult(
            status=status,
            q=q,
            tip=tip,
            position_error=position_error,
            rotation_error=rotation_error,
            short_by=0.0 if status == IKStatus.CONVERGED else position_error,
            iterations=int(self._cold[self.robot.n + kernels.SETTINGS, kernels.STEPS]),
            branch=self._signs(q) if self.closed_form else None,
        )

    def _signs(self, q: Array) -> tuple[int, int, int]:
        bends = np.sin(q + self.robot.theta)
        elbow, shoulder, wrist = (-1 if bends[i] < 0.0 else 1 for i in (3, 1, 5))
        return elbow, shoulder, wrist

    def _prefer(self, table: Array, wanted: Preference) -> None:
        n = self.robot.n
        if wanted.off_singularity > 0.0 and n < 7:
            raise InputError("preference.off_singularity", wanted.off_singularity, "0 for an arm that is not redundant")
        settings = table[n + kernels.SETTINGS]
        settings[preference_kernels.NEAR_POSTURE] = wanted.near_posture
        settings[preference_kernels.OFF_LIMITS] = wanted.off_limits
        settings[preference_kernels.OFF_SINGULARITY] = wanted.off_singularity
        settings[preference_kernels.NULL_SPACE_STEP] = wanted.null_space_step
        posture = self.robot.middle if wanted.posture is None else wanted.posture
        places = table[n + kernels.PLACES : n + kernels.SHAPE, :n]
        places[preference_kernels.POSTURE] = self.robot.joint_values(posture, "preference.posture")
        # never so near that the zones of both limits meet
        near = np.minimum(wanted.zone * self.robot.chain[1:-1, UNIT], 0.25 * (self.robot.upper - self.robot.lower))
        places[preference_kernels.EASE_LOW] = self.robot.lower + near
        places[preference_kernels.EASE_HIGH] = self.robot.upper - near


def _spread(n: int) -> Array:
    """Increments of the additive recurrence in n dimensions: powers of the root of x^(n+1) = x + 1."""
    root = 1.5
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (n + 1))
    return root ** -np.arange(1.0, n + 1.0)


def _closed_round(arcs: Array) -> Array:
    """Arcs of the whole circle, where the last runs on into the first."""
    arcs = arcs.copy()
    if len(arcs) > 1 and np.isclose(arcs[-1, 1] - arcs[0, 0], 2.0 * np.pi, rtol=0.0, atol=1e-12):
        arcs[-1, 1] = arcs[0, 1] + 2.0 * np.pi
        arcs = arcs[1:]
    return arcs


def _exactly_rotated(pose: Array) -> Array:
    """The pose with the rotation nearest to what was given, which is orthonormal to rounding only."""
    out = pose.copy()
    left, _, right = np.linalg.svd(pose[:3, :3])
    out[:3, :3] = left @ right
    return out


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(name, value, "a positive number")
    return float(value)
