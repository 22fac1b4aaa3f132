"""Set points for the next cycles in one call: plan, inverse kinematics and the last look at each of them."""

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.exploration.safety.motion_guard_kernels import GOOD, POSITION, check, clamp
from lwrprobe.kinematics.ik_kernels import CONVERGED, track
from lwrprobe.trajectory.cartesian_kernels import STATE_MOTION, advance

RESTING, STEPPING, STEPPED = range(3)
"""How the plan goes on: it does not; with every row; with every row but the first, which has been stepped already."""

ALL, DUE, BLOCKED, REFUSED = range(4)
"""How it ended: with the last row; something is due on the plan in the next row, whose step is made; the last row is
the nearest to a pose out of reach; the next row must not be sent."""


@kernel
def generate(
    plan, state, time, event, cycle, going, table, q, step, measured,
    chain, limits, guard, peaks, rows, velocities, first, last,
):  # fmt: skip
    """Set points into `rows` (m, n) from row `first` up to `last`, from the joints q (n,) on; the tip's velocities into
    `velocities` (m, 3).

    `plan`, `state` and `time` [s] are those of `cartesian_kernels`, something is due at `event`; `table` is the one of
    `ik_kernels`; `step` (n,) is what a joint may move in a cycle [s]. `measured` (n,) and what follows it goes to
    `guard_kernels.check`: where the joints are is known for the first row alone.

    Returns the row behind the last one laid and how it ended; the time on the plan then; how many steps were cut down
    to the joints' speeds; the status of the last row's inverse kinematics, or the guard's verdict where it refused.
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
