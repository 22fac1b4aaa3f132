"""Set points for the next cycles in one call: plan, inverse kinematics and the final check of each of them."""

from typing import NamedTuple

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.exploration.safety.motion_guard_kernels import GOOD, POSITION, check, clamp
from lwrprobe.kinematics.ik_kernels import CONVERGED, track
from lwrprobe.trajectory.cartesian_kernels import STATE_MOTION, advance

RESTING, STEPPING, STEPPED = range(3)
"""How the plan advances: not at all; with every row; with every row but the first, which was advanced already."""

ALL, DUE, BLOCKED, REFUSED = range(4)
"""How it ended: with the last row; before the next row, for which an event of the plan is due; with a row that is the
nearest to a pose out of reach; before a row that the guard refuses."""


class Motion(NamedTuple):
    """The trajectory of the tip, as in `cartesian_kernels`; times in s."""

    plan: np.ndarray
    state: np.ndarray
    time: float
    event: float  # time of the plan's next event
    cycle: float


class Guard(NamedTuple):
    """What `motion_guard_kernels.check` takes."""

    chain: np.ndarray
    limits: np.ndarray
    state: np.ndarray
    peaks: np.ndarray


class Rows(NamedTuple):
    """What `generate` fills."""

    joints: np.ndarray  # (m, n) rad
    velocities: np.ndarray  # (m, 3) m/s, of the tip


@kernel
def generate(motion, going, table, q, step, measured, guard, rows, first, last):
    """Write set points into the rows `first` to `last`, starting from the joints q (n,).

    `table` is the one of `ik_kernels`; `step` (n,) is the largest motion of each joint in a cycle [rad]. `measured`
    (n,) are the measured joints; they exist for the first row alone.

    Returns the row after the last one written and how it ended; the time on the plan; the number of steps that were
    reduced to the joints' speeds; the status of the last row's inverse kinematics, or the guard's verdict.
    """
    plan, state, time, event, cycle = motion
    joints = rows.joints
    n = q.shape[0]
    pose = state[:16].reshape(4, 4)
    cut = 0
    for k in range(first, last):
        if going == STEPPING or (going == STEPPED and k > first):
            time += cycle
            advance(plan, time, state)
            if time >= event:
                return k, DUE, time, cut, CONVERGED
        before = q if k == first else joints[k - 1]
        status = track(table, pose, before, joints[k])
        if clamp(before, joints[k], step) > 1.0:
            cut += 1
        at = measured if k == first else guard.state[POSITION, :n]
        verdict = check(joints[k], at, cycle, guard.chain, guard.limits, guard.state, guard.peaks)
        if verdict != GOOD:
            return k, REFUSED, time, cut, verdict
        for i in range(3):
            rows.velocities[k, i] = state[STATE_MOTION + i]
        if status != CONVERGED:
            return k + 1, BLOCKED, time, cut, status
    return last, ALL, time, cut, CONVERGED
