"""Set points for the next cycles in one call: plan, inverse kinematics and the last look at each of them."""

from lwrprobe.compiled import view_kernel as kernel
from lwrprobe.exploration.guard_kernels import GOOD, POSITION, check, rein
from lwrprobe.kinematics.ik_kernels import CONVERGED, track
from lwrprobe.trajectory.cartesian_kernels import STATE_MOTION, advance

RESTING, STEPPING, STEPPED = range(3)
"""How the plan goes on: it does not; with every row; with every row but the first, which has been stepped already."""

ALL, DUE, BLOCKED, REFUSED = range(4)
"""How it ended: with the last row; something is due on the plan in the next row, whose step is made; the last row is
the nearest to a pose out of reach; the next row must not be sent."""

TIME, EVENT, CYCLE, STATUS, CUT, VERDICT, NOTES = range(7)
"""`notes`: the time on the plan and that of what is due next, in s; the cycle; of the last row the status of its
inverse kinematics; how many steps were cut down to the joints' speeds; of the row that must not be sent the guard's
verdict."""


@kernel
def lay(plan, state, notes, going, table, q, step, measured, chain, limits, guard, peaks, rows, velocities):
    """Set points into `rows` (m, n), from the joints q (n,) on, and the tip's velocities into `velocities` (m, 3).

    `plan` and `state` are those of `cartesian_kernels`, `table` is the one of `ik_kernels`; `step` (n,) is what a joint
    may move in a cycle. `measured` (n,) and what follows it goes to `guard_kernels.check`: where the joints are is
    known for the first row alone. Returns the number of rows laid and how it ended.
    """
    n = q.shape[0]
    pose = state[:16].reshape(4, 4)
    for k in range(rows.shape[0]):
        if going == STEPPING or (going == STEPPED and k > 0):
            notes[TIME] += notes[CYCLE]
            advance(plan, notes[TIME], state)
            if notes[TIME] >= notes[EVENT]:
                return k, DUE
        before = q if k == 0 else rows[k - 1]
        status = track(table, pose, before, rows[k])
        notes[STATUS] = status
        if rein(before, rows[k], step) > 1.0:
            notes[CUT] += 1.0
        verdict = check(rows[k], measured if k == 0 else guard[POSITION, :n], notes[CYCLE], chain, limits, guard, peaks)
        if verdict != GOOD:
            notes[VERDICT] = verdict
            return k, REFUSED
        for i in range(3):
            velocities[k, i] = state[STATE_MOTION + i]
        if status != CONVERGED:
            return k + 1, BLOCKED
    return rows.shape[0], ALL
