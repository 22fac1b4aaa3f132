"""The Cartesian generator's kernels: from state and aim to a request for the planner, and from a plan to a pose.

Position and orientation are two groups of three axes. Each group is planned in a frame of its own whose first axis
lies along the path that is left, so that a straight move uses one axis and may use the limits in full. Where the
motion does not point along that way, the group's limits (on norms) are shared out among the axes as a box inside
the ball: sum of squares of the axis limits = square of the limit.
"""

from math import inf, sqrt

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.trajectory.profile_kernels import (
    BENT_UNTIL,
    DURATION,
    FAST_UNTIL,
    LAST,
    MAX_JERK,
    MAX_RATE,
    MAX_SECOND,
    MOVES,
    NEAR,
    RATE,
    ROW,
    SECOND,
    SLACK,
    STAYS,
    TARGET,
    TO_POSITION,
    TO_VELOCITY,
    TOO_FAST,
    axis_need,
    common_units,
    evaluate_row,
    hand_over,
    hold_row,
    load,
    load_changes,
    ramp_row,
    release_row,
    settle,
)
from lwrprobe.trajectory.rotation_kernels import (
    angular_motion,
    orthonormalise,
    rotate_from,
    rotation_between,
)

# state: pose (4, 4), then velocity and acceleration of the position group, of the turning group, then scratch
STATE_MOTION = 16
STATE_SCRATCH = STATE_MOTION + 12
STATE_SIZE = STATE_SCRATCH + 9

# aim: goal pose (4, 4), velocity to track, then the limits of both groups (speed, acceleration, jerk)
AIM_VELOCITY, AIM_LIMITS = 16, 19
AIM_SIZE = AIM_LIMITS + 6

# plan: six rows, the frames of both groups, origin, reference rotation, jerk limit of each axis
PLAN_FRAMES = 6 * ROW
PLAN_ORIGIN = PLAN_FRAMES + 18
PLAN_REFERENCE = PLAN_ORIGIN + 3
PLAN_JERKS = PLAN_REFERENCE + 9
PLAN_SIZE = PLAN_JERKS + 6

# modes, and what a request can be
TO_GOAL, VELOCITY, VELOCITY_AND_TURN = 0, 1, 2
SETTLED, STRAIGHT, BENT, UNFIT = 0, 1, 2, 3

SHARES = (0.1, 0.2, 0.35, 0.5, 0.7071, 0.85, 0.95)
"""Shares of the limits offered to the axes across the path, smallest first."""
TURN_RESERVE = 0.8
"""Share of the turning limits used while the turning axis changes: the rest is a margin for omitted terms."""
FARTHEST = 1e6
"""m, largest coordinate of a goal."""


@kernel
def prepare(state, aim, mode, plan, request, facts, handed):
    """Write frames into `plan`, state, target and limits in them into `request`, that in the planner's units into
    `handed`; returns the overall kind.
    """
    anchor(state, plan)
    facts[TOO_FAST] = 0.0
    worst = SETTLED
    for group in range(0, 6, 3):
        to_goal = mode == TO_GOAL or (mode == VELOCITY_AND_TURN and group == 3)
        worst = max(worst, fit(state, aim, to_goal, group, plan, request, facts))
    if worst == STRAIGHT:
        keep_in_phase(request)
    common_units(request)
    hand_over(request, facts, handed)
    return worst


@kernel
def keep_in_phase(request):
    """Give both groups of a straight move limits in the ratio of their paths, if their motions are in it too.

    Then one profile serves both; with limits of their own the planner may find none and only end them together.
    """
    distance, turn = request[TARGET, 0], request[TARGET, 3]
    if request[MOVES, 0] != TO_POSITION or request[MOVES, 3] != TO_POSITION or distance == 0.0 or turn == 0.0:
        return
    for line in (RATE, SECOND):
        along, about = request[line, 0] * turn, request[line, 3] * distance
        if abs(along - about) > 1e-9 * max(abs(along), abs(about)):
            return
    for line in (MAX_RATE, MAX_SECOND, MAX_JERK):
        least = min(request[line, 0] / abs(distance), request[line, 3] / abs(turn))
        request[line, 0], request[line, 3] = least * abs(distance), least * abs(turn)


@kernel
def anchor(state, plan):
    """The plan starts here: origin and reference rotation from the present pose."""
    reference = reference_of(plan)
    for i in range(3):
        plan[PLAN_ORIGIN + i] = state[4 * i + 3]
        for k in range(3):
            reference[i, k] = state[4 * i + k]
    orthonormalise(reference)


@kernel(inline="always")
def reference_of(plan):
    return plan[PLAN_REFERENCE : PLAN_REFERENCE + 9].reshape(3, 3)


@kernel(inline="always")
def frame_of(plan, group):
    at = PLAN_FRAMES + 3 * group
    return plan[at : at + 9].reshape(3, 3)


@kernel
def fit(state, aim, to_goal, group, plan, request, facts):
    """One group to its goal, or to a velocity: frame, state in it and axis limits; returns the kind."""
    at = AIM_LIMITS + group
    speed, accel, jerk = aim[at], aim[at + 1], aim[at + 2]
    motion = state[STATE_SCRATCH : STATE_SCRATCH + 9].reshape(3, 3)
    remaining_motion(state, aim, to_goal, group, plan, motion)
    frame = frame_of(plan, group)
    align(motion, to_goal, speed, accel, frame)
    for line in range(3):
        for i in range(3):
            along = frame[0, i] * motion[line, 0] + frame[1, i] * motion[line, 1] + frame[2, i] * motion[line, 2]
            request[line, group + i] = along
    moving = settle(request, group, group + 3, TO_POSITION if to_goal else TO_VELOCITY, speed, accel)
    for i in range(group, group + 3):
        request[MAX_RATE, i] = speed if to_goal else 1e3 * speed
        request[MAX_SECOND, i], request[MAX_JERK, i] = accel, jerk
    if moving == 0:
        return SETTLED
    if reach(request, group, jerk) > speed * (1.0 + 1e-9):
        facts[TOO_FAST] = 1.0
    kind = STRAIGHT
    if moving > 1 or request[MOVES, group] == STAYS:
        if group == 3:
            speed, accel, jerk = turn_reserve(speed, accel, jerk, to_goal)
        kind = bend(request, group, to_goal, speed, accel, jerk)
    return kind


@kernel
def remaining_motion(state, aim, to_goal, group, plan, motion):
    """Rows of `motion`: what is left (path or change of velocity), velocity, acceleration."""
    at = STATE_MOTION + 2 * group
    for i in range(3):
        motion[1, i], motion[2, i] = state[at + i], state[at + 3 + i]
    if group == 0:
        for i in range(3):
            motion[0, i] = aim[4 * i + 3] - state[4 * i + 3] if to_goal else aim[AIM_VELOCITY + i] - motion[1, i]
    elif to_goal:
        rotation_between(reference_of(plan), aim[0:16].reshape(4, 4), motion[0])
    else:
        for i in range(3):
            motion[0, i] = -motion[1, i]


@kernel
def align(motion, to_goal, speed, accel, frame):
    """Frame with its first axis along the first row of `motion` that is something, the second towards the next.

    On the path to a velocity the present one does not matter.
    """
    first = second = False
    for line in range(3):
        if line == 1 and not to_goal:
            continue
        small = SLACK * (accel if line == 2 else speed)
        if line == 0 and to_goal:
            small = NEAR
        if not first:
            first = unit(motion, line, small, frame)
        elif not second:
            second = unit_across(motion, line, small, frame)
    if not first:
        frame[0, 0], frame[1, 0], frame[2, 0] = 1.0, 0.0, 0.0
    if not second:
        any_across(frame)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        frame[i, 2] = frame[j, 0] * frame[k, 1] - frame[k, 0] * frame[j, 1]


@kernel
def unit(motion, line, small, frame):
    n = sqrt(motion[line, 0] ** 2 + motion[line, 1] ** 2 + motion[line, 2] ** 2)
    if n <= small:
        return False
    for i in range(3):
        frame[i, 0] = motion[line, i] / n
    return True


@kernel
def unit_across(motion, line, small, frame):
    """Second axis along the part of a row across the first; projected twice, since once leaves cancelled digits."""
    for i in range(3):
        frame[i, 1] = motion[line, i]
    n = 0.0
    for _ in range(2):
        along = frame[0, 0] * frame[0, 1] + frame[1, 0] * frame[1, 1] + frame[2, 0] * frame[2, 1]
        n = 0.0
        for i in range(3):
            frame[i, 1] -= along * frame[i, 0]
            n += frame[i, 1] * frame[i, 1]
        n = sqrt(n)
        if n <= small:
            return False
    for i in range(3):
        frame[i, 1] /= n
    return True


@kernel
def any_across(frame):
    """Any second axis across the first, found from the world axis that is least along it."""
    a, b, c = abs(frame[0, 0]), abs(frame[1, 0]), abs(frame[2, 0])
    k = 0 if a <= b and a <= c else (1 if b <= c else 2)
    i, j = (k + 1) % 3, (k + 2) % 3
    n = sqrt(frame[i, 0] ** 2 + frame[j, 0] ** 2)
    frame[k, 1], frame[i, 1], frame[j, 1] = 0.0, -frame[j, 0] / n, frame[i, 0] / n


@kernel
def turn_reserve(speed, accel, jerk, to_goal):
    """Turning limits for the rotation vector while its axis changes.

    Against it omega' has up to about |omega|^2 more, and omega'' up to |omega| |omega'| + |omega|^3.
    """
    if to_goal:
        speed = min(speed, min(sqrt(0.2 * accel), min(0.1 * jerk / accel, (0.1 * jerk) ** (1.0 / 3.0))))
    return speed, TURN_RESERVE * accel, TURN_RESERVE * jerk


@kernel
def bend(request, group, to_goal, speed, accel, jerk):
    """Share the limits out among the axes of a motion that is not along the path; UNFIT where no share serves.

    On the path to a goal the share with the least estimated time is taken, to a velocity the smallest that fits.
    """
    best, least = 0.0, inf
    for share in SHARES:
        if not share_box(request, group, share, accel, jerk):
            continue
        if not to_goal:
            if corners_fit(request, group, speed):
                return BENT
        elif share_out(request, group, speed):
            time = time_needed(request, group)
            if time < least:
                best, least = share, time
    if best == 0.0:
        return UNFIT
    share_box(request, group, best, accel, jerk)
    share_out(request, group, speed)
    return BENT


@kernel
def time_needed(request, group):
    """Estimate [s] of a bent move: the path along, or the longest path out and back across.

    The latter counts half again: a straight rest of the path is worth some time.
    """
    longest = across = 0.0
    for i in range(group, group + 3):
        if request[MOVES, i] != STAYS:
            accel, jerk = request[MAX_SECOND, i], request[MAX_JERK, i]
            speed = axis_need(request, i, jerk)
            stop = ramp_time(speed, accel, jerk)
            distance = abs(request[TARGET, i] - 0.5 * stop * request[RATE, i])
            back = 2.0 * ramp_time(min(request[MAX_RATE, i], sqrt(distance * accel)), accel, jerk)
            time = stop + max(back, distance / request[MAX_RATE, i])
            longest = max(longest, time)
            if i > group:
                across = max(across, time)
    return longest + 0.5 * across


@kernel
def ramp_time(speed, accel, jerk):
    """Duration [s] of a change of velocity from no acceleration to none."""
    return speed / accel + accel / jerk if speed * jerk > accel * accel else 2.0 * sqrt(speed / jerk)


@kernel
def reach(request, group, jerk):
    """|velocity| once the acceleration has been taken away, or now if that is more."""
    now = after = size = 0.0
    for i in range(group, group + 3):
        size += request[SECOND, i] * request[SECOND, i]
    size = sqrt(size)
    for i in range(group, group + 3):
        v = request[RATE, i]
        w = v + request[SECOND, i] * size / (2.0 * jerk)
        now += v * v
        after += w * w
    return sqrt(max(now, after))


@kernel
def share_box(request, group, share, accel, jerk):
    """Share acceleration and jerk out; False where the present acceleration does not fit."""
    along = sqrt(1.0 - share * share)
    both = request[MOVES, group + 1] != STAYS and request[MOVES, group + 2] != STAYS
    across = share / sqrt(2.0) if both else share
    for i in range(group, group + 3):
        part = along if i == group else across
        request[MAX_SECOND, i], request[MAX_JERK, i] = part * accel, part * jerk
        if abs(request[SECOND, i]) > part * accel:
            return False
    return True


@kernel
def share_out(request, group, speed):
    """Speed limits of a group on its path to a goal; False where the present motion does not fit into them."""
    left = speed * speed
    for i in range(group + 1, group + 3):
        if request[MOVES, i] != STAYS:
            need = axis_need(request, i, request[MAX_JERK, i]) * (1.0 + 1e-9)
            request[MAX_RATE, i] = max(need, 0.3 * speed)
            left -= request[MAX_RATE, i] * request[MAX_RATE, i]
    if left < 0.25 * speed * speed:
        return False
    request[MAX_RATE, group] = sqrt(left)
    return axis_need(request, group, request[MAX_JERK, group]) <= request[MAX_RATE, group]


@kernel
def corners_fit(request, group, speed):
    """Whether all corners of the velocities a group can pass on its path to a velocity are inside the ball."""
    corner = now = 0.0
    for i in range(group, group + 3):
        w = max(axis_need(request, i, request[MAX_JERK, i]), abs(request[TARGET, i]))
        corner += w * w
        now += request[RATE, i] * request[RATE, i]
    return corner <= max(speed * speed, now) * (1.0 + 1e-9)


@kernel
def load_tip(plan, request, facts, pieces):
    """`load`, and what the Cartesian generator keeps besides: axis jerks, and until when the motion is bent."""
    return load(plan, request, facts, pieces) and _keep_besides(plan, request, facts)


@kernel
def change_tip(plan, request, facts):
    """`load_changes`, and what the Cartesian generator keeps besides: no planner is needed to reach a velocity."""
    return load_changes(plan, request, facts) and _keep_besides(plan, request, facts)


@kernel
def _keep_besides(plan, request, facts):
    facts[BENT_UNTIL] = 0.0
    for i in range(6):
        plan[PLAN_JERKS + i] = request[MAX_JERK, i] if request[MOVES, i] != STAYS else 0.0
        if i % 3 != 0 and request[MOVES, i] == TO_POSITION:
            facts[BENT_UNTIL] = max(facts[BENT_UNTIL], plan[i * ROW + LAST])
    return True


@kernel
def brake(state, aim, old, plan, facts):
    """Closed-form leg of a stop from any motion, no planner needed: the last resort, and the first leg of a turn.

    While there is acceleration, each axis of the `old` plan takes its own away (its box holds that); then one ramp
    straight to rest. Called again when a leg has ended.
    """
    anchor(state, plan)
    facts[DURATION] = facts[BENT_UNTIL] = facts[FAST_UNTIL] = 0.0
    for group in range(0, 6, 3):
        accel, jerk = aim[AIM_LIMITS + group + 1], aim[AIM_LIMITS + group + 2]
        at = STATE_MOTION + 2 * group
        v, a = state[at : at + 3], state[at + 3 : at + 6]
        if a[0] == 0.0 and a[1] == 0.0 and a[2] == 0.0:
            ramp_to_rest(v, accel, jerk, plan, group)
        else:
            release(v, a, jerk, old, plan, group)
        for i in range(group, group + 3):
            facts[DURATION] = max(facts[DURATION], plan[i * ROW + LAST])


@kernel
def ramp_to_rest(v, accel, jerk, plan, group):
    """One straight ramp down along the velocity."""
    frame = frame_of(plan, group)
    speed = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    for i in range(3):
        frame[i, 0] = v[i] / speed if speed > 0.0 else (1.0 if i == 0 else 0.0)
        hold_row(plan, (group + i) * ROW, 0.0)
        plan[PLAN_JERKS + group + i] = 0.0
    plan[PLAN_JERKS + group] = jerk
    ramp_row(plan, group * ROW, speed, accel, jerk)


@kernel
def release(v, a, jerk, old, plan, group):
    """Each axis of the old frame takes its acceleration away with its own jerk; then the velocity stays.

    An axis that did not move has no jerk of its own; what acceleration it shows (a changing turning axis leaves
    some, rounding a trace) goes with a tenth of the limit, which the turning reserve covers.
    """
    axes, frame = frame_of(old, group), frame_of(plan, group)
    for i in range(3):
        for k in range(3):
            frame[k, i] = axes[k, i]
    for i in range(3):
        own = old[PLAN_JERKS + group + i]
        if own == 0.0:
            own = 0.1 * jerk
        speed = frame[0, i] * v[0] + frame[1, i] * v[1] + frame[2, i] * v[2]
        size = frame[0, i] * a[0] + frame[1, i] * a[1] + frame[2, i] * a[2]
        plan[PLAN_JERKS + group + i] = own
        release_row(plan, (group + i) * ROW, speed, size, own)


@kernel
def advance(plan, time, state):
    """Evaluate the plan at `time` into the state."""
    x = state[STATE_SCRATCH : STATE_SCRATCH + 9].reshape(3, 3)
    pose = state[0:16].reshape(4, 4)
    for group in range(0, 6, 3):
        expand(plan, group, time, x)
        if group == 0:
            for i in range(3):
                pose[i, 3] = plan[PLAN_ORIGIN + i] + x[0, i]
                state[STATE_MOTION + i] = x[1, i]
                state[STATE_MOTION + 3 + i] = x[2, i]
    rotate_from(x[0], reference_of(plan), pose)
    angular_motion(x, state[STATE_MOTION + 6 : STATE_MOTION + 12])


@kernel
def preview(plan, time, seconds, speed, turn_rate, scout, poses, usage):
    """Evaluate the plan at even steps ahead: poses (m, 4, 4), and speed over `speed` or rate over `turn_rate`."""
    m = usage.size
    for n in range(m):
        advance(plan, time + seconds * n / (m - 1), scout)
        for i in range(3):
            for k in range(4):
                poses[n, i, k] = scout[4 * i + k]
            poses[n, 3, i] = 0.0
        poses[n, 3, 3] = 1.0
        v, w = 0.0, 0.0
        for i in range(STATE_MOTION, STATE_MOTION + 3):
            v += scout[i] * scout[i]
            w += scout[i + 6] * scout[i + 6]
        usage[n] = max(sqrt(v) / speed, sqrt(w) / turn_rate)


@kernel
def expand(plan, group, time, x):
    """Position, velocity, acceleration (the rows of x) of a group, turned out of its frame."""
    frame = frame_of(plan, group)
    for i in range(3):
        x[0, i] = x[1, i] = x[2, i] = 0.0
    for k in range(3):
        p, v, a = evaluate_row(plan, (group + k) * ROW, time)
        for i in range(3):
            x[0, i] += frame[i, k] * p
            x[1, i] += frame[i, k] * v
            x[2, i] += frame[i, k] * a


@kernel
def rest_at(state, aim, at_goal):
    """Come to rest exactly: all derivatives zero, and the pose that of the goal where it was reached."""
    if at_goal:
        for i in range(16):
            state[i] = aim[i]
    for i in range(STATE_MOTION, STATE_SIZE):
        state[i] = 0.0


@kernel
def accept_pose(pose, out):
    """Copy a pose, its rotation orthonormalised, into out (16,); False where it is no rigid motion."""
    for i in range(3):
        for k in range(i, 3):
            dot = pose[0, i] * pose[0, k] + pose[1, i] * pose[1, k] + pose[2, i] * pose[2, k]
            if not abs(dot - (1.0 if i == k else 0.0)) <= 1e-6:
                return False
        if not (abs(pose[i, 3]) <= FARTHEST and abs(pose[3, i]) <= 1e-9):
            return False
    det = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        det += pose[0, i] * (pose[1, j] * pose[2, k] - pose[1, k] * pose[2, j])
    if det < 0.0 or not abs(pose[3, 3] - 1.0) <= 1e-9:
        return False
    goal = out[0:16].reshape(4, 4)
    for i in range(3):
        for k in range(4):
            goal[i, k] = pose[i, k]
        goal[3, i] = 0.0
    goal[3, 3] = 1.0
    for _ in range(2):
        orthonormalise(goal)
    return True
