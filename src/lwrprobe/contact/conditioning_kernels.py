"""Kernel of the wrench conditioner: one reading in, one wrench and its status out."""

from __future__ import annotations

import math

from lwrprobe.compiled import allocation_free_kernel as kernel

# params
P_RANGE = 0  # 6, readings at or beyond it are saturated
P_HUGE = 6  # 6, readings beyond it are invalid
P_BIAS = 12  # 6
P_MASS = 18  # 1, of the payload
P_MOMENT = 19  # 3, mass times centre of mass
P_JUMP = 22  # force, torque: a step beyond it has to be confirmed
P_SMOOTH = 24  # 1, weight of a new sample in the low pass, 1 = no filter
P_FROZEN = 25  # 1, equal readings in a row that mean a frozen stream, 0 = never
P_GRAVITY = 26
PARAMS = 27

# state
S_GOOD = 0  # 6, last confirmed wrench, unfiltered
S_SUSPECT = 6  # 6, last unconfirmed wrench
S_OUT = 12  # 6, last output wrench (the filter's state)
S_RAW = 18  # 6, last raw reading
S_TIME = 24
STATE = 25

# counts
C_SAMPLES = 0
C_INVALID = 1
C_SATURATED = 2
C_LOST = 3
C_LATE = 4
C_FROZEN = 5
C_SPIKES = 6
C_REORDERED = 7
C_BAD_RUN = 8  # invalid readings in a row
C_EQUAL_RUN = 9  # equal readings in a row
C_SEQUENCE = 10
C_RECEIVED = 11  # 0 before the first sample with a time
C_BEGUN = 12  # 0 before the first good sample
C_IS_SUSPECT = 13
COUNTS = 14

# SampleStatus, as plain numbers
SATURATED = 1
LATE = 2
LOST_BEFORE = 4
FROZEN = 8
INVALID = 16
UNCONFIRMED = 1 << 16

SEQUENCE_WRAP = 1 << 32


@kernel
def condition(raw, rotation, stamp, params, state, counts, out):
    """One reading through all stages.

    raw : (6,) force and torque, sensor frame; rotation : (3, 3) of the sensor in the world; stamp : (3,) time,
    sequence, status as the driver gave them; out : (9,) force, torque (sensor frame), force (world frame).
    Returns the status.
    """
    counts[C_SAMPLES] += 1
    status = int(stamp[2])
    if status & LATE:
        counts[C_LATE] += 1
    status |= _value_status(raw, status, params, counts)
    status |= _order_status(stamp, state, counts)
    if status & (FROZEN | LATE | INVALID) == 0:
        status |= _equal_run(raw, params, state, counts)
    if status & (FROZEN | LATE | INVALID) == 0:
        status |= _take(raw, rotation, params, state, counts, out)
    else:
        for i in range(6):
            out[i] = state[S_OUT + i]
    for i in range(3):
        out[6 + i] = rotation[i, 0] * out[0] + rotation[i, 1] * out[1] + rotation[i, 2] * out[2]
    return status


@kernel
def _value_status(raw, status, params, counts):
    """INVALID for a NaN, an infinity, or a value that a sensor of this range cannot report."""
    good = status & INVALID == 0
    for i in range(6):
        good = good and abs(raw[i]) <= params[P_HUGE + i]  # false for NaN
    if good:
        counts[C_BAD_RUN] = 0
        return 0
    counts[C_INVALID] += 1
    counts[C_BAD_RUN] += 1
    return INVALID


@kernel
def _order_status(stamp, state, counts):
    """FROZEN, LATE or LOST_BEFORE from sequence and time; stores both when they have increased."""
    if not math.isfinite(stamp[0]):
        return INVALID
    status = 0
    if counts[C_RECEIVED]:
        step = int(stamp[1]) - counts[C_SEQUENCE]
        if step < -(SEQUENCE_WRAP // 2):
            step += SEQUENCE_WRAP
        if step == 0 or stamp[0] == state[S_TIME]:
            counts[C_FROZEN] += 1
            return FROZEN
        if step < 0 or stamp[0] < state[S_TIME]:
            counts[C_REORDERED] += 1
            return LATE
        if step > 1:
            counts[C_LOST] += step - 1
            status = LOST_BEFORE
    counts[C_RECEIVED] = 1
    counts[C_SEQUENCE] = int(stamp[1])
    state[S_TIME] = stamp[0]
    return status


@kernel
def _equal_run(raw, params, state, counts):
    """FROZEN when all six values have been equal for longer than the sensor's noise allows."""
    for i in range(6):
        if raw[i] != state[S_RAW + i]:
            counts[C_EQUAL_RUN] = 0
            return 0
    counts[C_EQUAL_RUN] += 1
    if params[P_FROZEN] > 0.0 and counts[C_EQUAL_RUN] >= params[P_FROZEN]:
        counts[C_FROZEN] += 1
        return FROZEN
    return 0


@kernel
def _take(raw, rotation, params, state, counts, out):
    """Remove bias and payload, check range and jumps, filter."""
    status = 0
    for i in range(6):
        state[S_RAW + i] = raw[i]
        if abs(raw[i]) >= params[P_RANGE + i]:
            status |= SATURATED
    if status:
        counts[C_SATURATED] += 1
    weight(rotation, params[P_MASS], params[P_MOMENT : P_MOMENT + 3], params[P_GRAVITY], out)
    for i in range(6):
        out[i] = raw[i] - params[P_BIAS + i] - out[i]
    if _is_spike(out, params, state, counts):
        return status | UNCONFIRMED
    share = params[P_SMOOTH] if counts[C_BEGUN] else 1.0
    for i in range(6):
        state[S_GOOD + i] = out[i]
        out[i] = state[S_OUT + i] + share * (out[i] - state[S_OUT + i])
        state[S_OUT + i] = out[i]
    counts[C_BEGUN] = 1
    return status


@kernel
def _is_spike(wrench, params, state, counts):
    """Two of three: a jump counts once the next reading has jumped to the same side as well."""
    if counts[C_BEGUN] == 0:
        return False
    confirmed = False
    jumped = False
    for k in range(2):
        step, onward = 0.0, 0.0
        for i in range(3 * k, 3 * k + 3):
            d = wrench[i] - state[S_GOOD + i]
            step += d * d
            onward += d * (state[S_SUSPECT + i] - state[S_GOOD + i])
        if step > params[P_JUMP + k] ** 2:
            jumped = True
            confirmed = confirmed or (counts[C_IS_SUSPECT] != 0 and onward > 0.0)
    spike = jumped and not confirmed
    if counts[C_IS_SUSPECT] and not confirmed:
        counts[C_SPIKES] += 1  # the next reading did not confirm the jump
    counts[C_IS_SUSPECT] = 1 if spike else 0
    if spike:
        for i in range(6):
            state[S_SUSPECT + i] = wrench[i]
    return spike


@kernel
def weight(rotation, mass, moment, gravity, out):
    """Wrench of the payload's weight in the sensor frame into out[0:6]; the world's z points up."""
    x, y, z = -gravity * rotation[2, 0], -gravity * rotation[2, 1], -gravity * rotation[2, 2]
    out[0], out[1], out[2] = mass * x, mass * y, mass * z
    out[3] = moment[1] * z - moment[2] * y
    out[4] = moment[2] * x - moment[0] * z
    out[5] = moment[0] * y - moment[1] * x
