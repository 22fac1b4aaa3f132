"""The joint-space generator's kernels: each joint is an axis with limits of its own."""

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.trajectory.profile_kernels import (
    BENT_UNTIL,
    DURATION,
    FAST_UNTIL,
    LAST,
    MAX_JERK,
    MAX_RATE,
    MAX_SECOND,
    POSITION,
    RATE,
    ROW,
    SECOND,
    TARGET,
    TO_POSITION,
    TO_VELOCITY,
    TOO_FAST,
    axis_need,
    common_units,
    evaluate_row,
    extent,
    hand_over,
    load,
    ramp_row,
    release_row,
    settle,
)

# rows of the state and of the bounds
Q, QD, QDD, ORIGIN = range(4)
LOWER, UPPER, SPEED, ACCEL, JERK = range(5)

REFUSED, OUTSIDE, INSIDE = 0, 1, 2

EDGE = 1e-9
"""rad or m: plans may pass a position limit by this, which rounding needs."""


@kernel
def accept_joints(q, bounds, out):
    """Copy joint positions into out (n,); False where one is no number or outside its limits."""
    for i in range(out.size):
        if not bounds[LOWER, i] <= q[i] <= bounds[UPPER, i]:
            return False
    for i in range(out.size):
        out[i] = q[i]
    return True


@kernel
def prepare_goal(state, goal, bounds, factor, request, facts, handed):
    """A request for all joints to their goal; returns the number of joints that have to move."""
    for i in range(goal.size):
        request[TARGET, i] = goal[i] - state[Q, i]
    return prepare_axes(state, bounds, TO_POSITION, factor, request, facts, handed)


@kernel
def prepare_stop(state, bounds, request, facts, handed):
    """A request for all joints to come to rest; returns the number of joints that still move."""
    for i in range(state.shape[1]):
        request[TARGET, i] = -state[QD, i]
    return prepare_axes(state, bounds, TO_VELOCITY, 1.0, request, facts, handed)


@kernel
def prepare_axes(state, bounds, kind, factor, request, facts, handed):
    facts[TOO_FAST], facts[BENT_UNTIL] = 0.0, 0.0
    moving = 0
    for i in range(state.shape[1]):
        speed, accel, jerk = bounds[SPEED, i] * factor, bounds[ACCEL, i], bounds[JERK, i]
        state[ORIGIN, i] = state[Q, i]
        request[RATE, i], request[SECOND, i] = state[QD, i], state[QDD, i]
        request[MAX_RATE, i], request[MAX_SECOND, i], request[MAX_JERK, i] = speed, accel, jerk
        if settle(request, i, i + 1, kind, speed, accel):
            moving += 1
            if axis_need(request, i, jerk) > speed * (1.0 + 1e-9):
                facts[TOO_FAST] = 1.0
    common_units(request)
    hand_over(request, facts, handed)
    return moving


@kernel
def aim_inside(plan, bounds, state, margin, goal):
    """Where the stop in `plan` ends, moved into the position limits by `margin` times each joint's jerk distance."""
    for i in range(goal.size):
        inner = margin * bounds[ACCEL, i] ** 3 / bounds[JERK, i] ** 2
        inner = min(inner, 0.5 * (bounds[UPPER, i] - bounds[LOWER, i]))
        end = state[ORIGIN, i] + plan[i * ROW + POSITION + LAST]
        goal[i] = min(max(end, bounds[LOWER, i] + inner), bounds[UPPER, i] - inner)


@kernel
def load_inside(plan, request, facts, pieces, state, bounds):
    """`load`, then whether the plan keeps to the position limits: REFUSED, OUTSIDE or INSIDE."""
    if not load(plan, request, facts, pieces):
        return REFUSED
    for i in range(state.shape[1]):
        low, high = extent(plan, i * ROW)
        start = state[ORIGIN, i]
        # a start beyond a limit may stay there, and lead back
        if start + low < min(bounds[LOWER, i], start) - EDGE or start + high > max(bounds[UPPER, i], start) + EDGE:
            return OUTSIDE
    return INSIDE


@kernel
def brake_joints(state, bounds, plan, facts):
    """Closed-form leg of a stop, no planner needed: take the accelerations away, and called again, come to rest."""
    facts[DURATION] = facts[BENT_UNTIL] = facts[FAST_UNTIL] = 0.0
    bent = False
    for i in range(state.shape[1]):
        state[ORIGIN, i] = state[Q, i]
        bent |= state[QDD, i] != 0.0
    for i in range(state.shape[1]):
        if bent:
            release_row(plan, i * ROW, state[QD, i], state[QDD, i], bounds[JERK, i])
        else:
            ramp_row(plan, i * ROW, state[QD, i], bounds[ACCEL, i], bounds[JERK, i])
        facts[DURATION] = max(facts[DURATION], plan[i * ROW + LAST])


@kernel
def advance_joints(plan, time, state):
    """Evaluate the plan at `time` into the state."""
    for i in range(state.shape[1]):
        p, v, a = evaluate_row(plan, i * ROW, time)
        state[Q, i] = state[ORIGIN, i] + p
        state[QD, i] = v
        state[QDD, i] = a
