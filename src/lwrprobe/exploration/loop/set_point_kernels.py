"""Set points for the next cycles in one call: plan, inverse kinematics and the final check of each of them."""

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.exploration.safety.motion_guard_kernels import GOOD, POSITION, check, clamp
from lwrprobe.kinematics.ik_kernels import CONVERGED, track
from lwrprobe.trajectory.cartesian_kernels import STATE_MOTION, advance

RESTING, STEPPING, STEPPED = range(3)
"""How the plan advances: not at all; with every row; with every row but the first, which was advanced already."""

ALL, DUE, BLOCKED, REFUSED = range(4)
"""How it ended: with the last row; before the next row, for which an event of the plan is due; with a row that is the
nearest to a pose out of reach; before a row that the guard refuses."""


@kernel
def generate(
    plan, state, time, event, cycle, going, table, q, step, measured,
    chain, limits, guard, peaks, rows, velocities, first, last,
):  # fmt: skip
    """Write set points into the rows `first` to `last` of `rows` (m, n), starting from the joints q (n,).

    The tip's velocities go into `velocities` (m, 3).

    `plan`, `state` and `time` [s] are those of `cartesian_kernels`; the next event of the plan is at `event` [s].
    `table` is the one of `ik_kernels`; `step` (n,) is the largest motion of each joint in a cycle [s]. `measured` (n,)
    and the arguments after it are those of `motion_guard_kernels.check`: measured joints exist for the first row alone.

    Returns the row after the last one written and how it ended; the time on the plan; the number of steps that were
    reduced to the joints' speeds; the status of the last row's inverse kinematics, or the guard's verdict.
    """
    n = q.shape[0]
    pose = state[:16].reshape(4, 4)
    cut = 0
    for k in range(first, last):
        if going == STEPPING or (going == STEPPED and k > first):
            time += cycle
            advance(plan, time, state)
            if time >= event:
                return k, DUE, time, cut, CONVERGED
        before = q if k == first else rows[k - 1]
        status = track(table, pose, before, rows[k])
        if clamp(before, rows[k], step) > 1.0:
            cut += 1
        verdict = check(rows[k], measured if k == first else guard[POSITION, :n], cycle, chain, limits, guard, peaks)
        if verdict != GOOD:
            return k, REFUSED, time, cut, verdict
        for i in range(3):
            velocities[k, i] = state[STATE_MOTION + i]
        if status != CONVERGED:
            return k + 1, BLOCKED, time, cut, status
    return last, ALL, time, cut, CONVERGED
