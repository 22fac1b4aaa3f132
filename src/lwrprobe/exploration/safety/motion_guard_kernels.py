"""Every set point against every limit, one call a cycle.

`state` holds the last set point, its velocity, its acceleration and the tip; `limits` the bounds, one column a joint
and then the row of the tip; `peaks` the largest share of each bound that was used so far.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import tip_frame

LOWER, UPPER, SPEED, ACCELERATION, JERK, TIP = range(6)
"""Rows of `limits`; the last one holds the columns below."""

TIP_SPEED, TABLE, FLOOR, LOW, HIGH, FOLLOWING = 0, 1, 4, 5, 8, 11
"""Columns of the row TIP: m/s; the table's unit normal; m, least height of the centre over the table's plane; corners;
rad between set point and joint."""

POSITION, VELOCITY, RATE, MOVED, SHARE = range(5)
"""Rows of `state`: set point, velocity, acceleration, tip (3 columns) and how many set points there were, and
beside the verdict (2 columns) the value that broke a limit and the limit."""

GOOD, NOT_FINITE, RANGE, TOO_FAST, TOO_SUDDEN, TOO_JERKY, TIP_FAST, IN_TABLE, OUTSIDE, AWAY = range(10)

SETTLED = 10.0
"""Set points after which the arm is expected to follow."""

_SLACK = 1.0 + 1e-9


@kernel
def clamp(q, wanted, step):
    """Largest share of a step (n,) that a joint takes from q to `wanted`; reduced to one in place if larger."""
    used = 0.0
    for i in range(len(q)):
        used = max(used, abs(wanted[i] - q[i]) / step[i])
    if used > 1.0:
        for i in range(len(q)):
            wanted[i] = q[i] + (wanted[i] - q[i]) / used
    return used


@kernel
def check(q, measured, cycle, chain, limits, state, peaks):
    """Verdict on the set point q (n,) and on where the joints are: GOOD, or 16 * joint + what is wrong.

    A good set point is remembered.
    """
    n = len(q)
    for i in range(n):
        if not math.isfinite(q[i]):
            state[SHARE, 0], state[SHARE, 1] = q[i], 0.0
            return 16 * i + NOT_FINITE
    count = state[MOVED, 3]
    if count >= SETTLED:
        for i in range(n):
            away = abs(measured[i] - state[POSITION, i])
            if not away <= limits[TIP, FOLLOWING]:
                state[SHARE, 0], state[SHARE, 1] = away, limits[TIP, FOLLOWING]
                return 16 * i + AWAY
    for i in range(n):
        verdict = _joint(q[i], i, cycle, count, limits, state, peaks)
        if verdict != GOOD:
            return 16 * i + verdict
    f = tip_frame(chain, q)
    verdict = _tip(f[9], f[10], f[11], cycle, count, limits[TIP], state, peaks)
    if verdict != GOOD:
        return verdict
    for i in range(n):
        velocity = (q[i] - state[POSITION, i]) / cycle if count > 0.0 else 0.0
        state[RATE, i] = (velocity - state[VELOCITY, i]) / cycle if count > 0.0 else 0.0
        state[VELOCITY, i] = velocity
        state[POSITION, i] = q[i]
    state[MOVED, 0], state[MOVED, 1], state[MOVED, 2] = f[9], f[10], f[11]
    state[MOVED, 3] = count + 1.0
    return GOOD


@kernel
def _joint(q, i, cycle, count, limits, state, peaks):
    low, high = limits[LOWER, i], limits[UPPER, i]
    if q < low - 1e-9 or q > high + 1e-9:
        state[SHARE, 0], state[SHARE, 1] = q, low if q < low else high
        return RANGE
    if count == 0.0:
        return GOOD
    velocity = (q - state[POSITION, i]) / cycle
    if _beyond(velocity, limits[SPEED, i], SPEED, state, peaks):
        return TOO_FAST
    acceleration = (velocity - state[VELOCITY, i]) / cycle
    if _beyond(acceleration, limits[ACCELERATION, i], ACCELERATION, state, peaks):
        return TOO_SUDDEN
    if _beyond((acceleration - state[RATE, i]) / cycle, limits[JERK, i], JERK, state, peaks):
        return TOO_JERKY
    return GOOD


@kernel
def _tip(x, y, z, cycle, count, limits, state, peaks):
    if count > 0.0:
        dx, dy, dz = x - state[MOVED, 0], y - state[MOVED, 1], z - state[MOVED, 2]
        speed = math.sqrt(dx * dx + dy * dy + dz * dz) / cycle
        if _beyond(speed, limits[TIP_SPEED], TIP, state, peaks):
            return TIP_FAST
    height = limits[TABLE] * x + limits[TABLE + 1] * y + limits[TABLE + 2] * z
    # A tip that is already too low may move up.
    if height < limits[FLOOR] and (count == 0.0 or height < _height(state, limits)):
        state[SHARE, 0], state[SHARE, 1] = height, limits[FLOOR]
        return IN_TABLE
    for axis, value in ((0, x), (1, y), (2, z)):
        low, high = limits[LOW + axis], limits[HIGH + axis]
        if value < low and (count == 0.0 or value < state[MOVED, axis]):
            state[SHARE, 0], state[SHARE, 1] = value, low
            return 16 * axis + OUTSIDE
        if value > high and (count == 0.0 or value > state[MOVED, axis]):
            state[SHARE, 0], state[SHARE, 1] = value, high
            return 16 * axis + OUTSIDE
    return GOOD


@kernel
def _height(state, limits):
    return limits[TABLE] * state[MOVED, 0] + limits[TABLE + 1] * state[MOVED, 1] + limits[TABLE + 2] * state[MOVED, 2]


@kernel
def _beyond(value, limit, kind, state, peaks):
    share = abs(value) / limit
    if not share <= _SLACK:
        state[SHARE, 0], state[SHARE, 1] = value, limit
        return True
    peaks[kind] = max(peaks[kind], share)
    return False
