"""Damped least squares with an active set for the joint limits (Levenberg 1944, Chan and Lawrence 1988).

Lengths are divided by the chain's own length and prismatic joints counted in it: the same damping serves an arm of a
nanometre and one of a kilometre. Targets are poses row by row, (16,). `work` are SCRATCH rows, so that solving
allocates nothing.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import LENGTH, LOWER, UNIT, UPPER, axes_to_jacobian, tip_and_axes, tip_frame

# columns of the settings row
POSITION_TOL, ROTATION_TOL, MAX_JUMP, DAMPING, ITERATIONS, RESTARTS, ROTATION_WEIGHT = range(7)

# rows of the scratch block
JAC, NORMAL, ERROR, RHS, STEP, TRIAL, FREE, LOW, HIGH, PUSH, TARGET, SAVED, RESTING, LEFT, WEIGHT = 0, 6, *range(12, 25)
SCRATCH = 25
# entries of the ERROR row behind the six scaled components
OFF_POSITION, OFF_ROTATION = 6, 7

# keeps the factorisation real at an exact singularity
MIN_DAMPING, PROJECTION_DAMPING = 1e-15, 1e-12
# half a squared error below which a step's factor is used twice
CHORD = 0.02
# 1 + trace of the rotation left to go, below which its skew part says too little
NEAR_HALF_TURN = 1e-9
# a descent ends after PATIENCE steps in a row that leave more than IDLE of the error
IDLE, PATIENCE = 0.9999, 8


@kernel
def tip_error(f, target, shrink, weight, e):
    """Scaled error twist from tip frame f to target into e[:6], squares of metres and radians behind it; returns half
    its square.

    The turn is measured by its chord, 2 sin(angle / 2) along the axis: as good as the angle for what follows, without
    an arc tangent, and growing up to half a turn.
    """
    p0, p1, p2 = target[3] - f[9], target[7] - f[10], target[11] - f[11]
    v0 = v1 = v2 = 0.0
    trace = 1.0
    for k in range(3):
        x0, x1, x2 = f[3 * k], f[3 * k + 1], f[3 * k + 2]
        t0, t1, t2 = target[k], target[4 + k], target[8 + k]
        v0 += x1 * t2 - x2 * t1
        v1 += x2 * t0 - x0 * t2
        v2 += x0 * t1 - x1 * t0
        trace += x0 * t0 + x1 * t1 + x2 * t2
    if trace > NEAR_HALF_TURN:
        stretch = 1.0 / math.sqrt(trace)
        v0, v1, v2 = stretch * v0, stretch * v1, stretch * v2
    else:
        v0, v1, v2 = _half_turn(f, target)
    e[0], e[1], e[2] = shrink * p0, shrink * p1, shrink * p2
    e[3], e[4], e[5] = weight * v0, weight * v1, weight * v2
    e[OFF_POSITION], e[OFF_ROTATION] = p0 * p0 + p1 * p1 + p2 * p2, v0 * v0 + v1 * v1 + v2 * v2
    return 0.5 * (shrink * shrink * e[OFF_POSITION] + weight * weight * e[OFF_ROTATION])


@kernel
def _half_turn(f, target):
    """The rotation vector of a turn by pi, where the skew part of the rotation says nothing."""
    best, axis = -2.0, 0
    for k in range(3):
        along = target[4 * k] * f[k] + target[4 * k + 1] * f[3 + k] + target[4 * k + 2] * f[6 + k]
        if along > best:
            best, axis = along, k
    v0 = target[0] * f[axis] + target[1] * f[3 + axis] + target[2] * f[6 + axis]
    v1 = target[4] * f[axis] + target[5] * f[3 + axis] + target[6] * f[6 + axis]
    v2 = target[8] * f[axis] + target[9] * f[3 + axis] + target[10] * f[6 + axis]
    v0, v1, v2 = v0 + (axis == 0), v1 + (axis == 1), v2 + (axis == 2)
    scale = 2.0 / math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    return scale * v0, scale * v1, scale * v2


@kernel
def _aim(chain, settings, target, q, work):
    """Tip frame at q and half its squared scaled error, which goes into work; JAC is half done."""
    f = tip_and_axes(chain, q, work[JAC : JAC + 6])
    return f, tip_error(f, target, 1.0 / chain[0, LENGTH], settings[ROTATION_WEIGHT], work[ERROR])


@kernel
def look(chain, settings, target, q, work):
    """Scaled Jacobian and error at q into work; returns half the squared error."""
    f, error = _aim(chain, settings, target, q, work)
    axes_to_jacobian(chain, f, 1.0 / chain[0, LENGTH], settings[ROTATION_WEIGHT], work[JAC : JAC + 6])
    return error


@kernel
def gram(jac, n, free, m):
    """J diag(free) J' into the lower half of m (6, 6), one joint after another."""
    for r in range(6):
        for c in range(r + 1):
            m[r, c] = 0.0
    for i in range(n):
        for r in range(6):
            x = jac[r, i] * free[i]
            for c in range(r + 1):
                m[r, c] += x * jac[c, i]


@kernel
def factorise(m):
    """m (6, 6), of which the lower half counts, into L D L' in place: L below the diagonal, the inverse of D on it, and
    D L' above it. Without square roots, each of which would have to wait for the one before."""
    for j in range(6):
        for i in range(j, 6):
            s = m[i, j]
            for k in range(j):
                s -= m[i, k] * m[k, j]
            if i == j:
                m[j, j] = 1.0 / max(s, 1e-300)
            else:
                m[j, i] = s
                m[i, j] = s * m[j, j]


@kernel
def substitute(m, y):
    """Solve in place for y (6,) with the factor of `factorise`."""
    for i in range(1, 6):
        for k in range(i):
            y[i] -= m[i, k] * y[k]
    for i in range(6):
        y[i] *= m[i, i]
    for j in range(1, 6):
        i = 5 - j
        for k in range(i + 1, 6):
            y[i] -= m[k, i] * y[k]


@kernel
def damped_step(n, q, damping, work):
    """The step of least damped error that keeps q within LOW..HIGH, into STEP.

    A joint that would leave its range goes to its end and stays out of the solution, which the others then share;
    clamping the step instead would bend it and flips joints.
    """
    jac, m = work[JAC : JAC + 6], work[NORMAL : NORMAL + 6]
    e, left, y, step = work[ERROR], work[LEFT], work[RHS], work[STEP]
    weight, free, low, high = work[WEIGHT], work[FREE], work[LOW], work[HIGH]
    for i in range(n):
        free[i] = weight[i]
    for r in range(6):
        left[r] = e[r]
    for _ in range(n + 1):
        gram(jac, n, free, m)
        for r in range(6):
            m[r, r] += damping
            y[r] = left[r]
        factorise(m)
        substitute(m, y)
        worst, over = -1, 0.0
        for i in range(n):
            if free[i] > 0.0:
                step[i] = free[i] * _along(jac, i, y)
                to = q[i] + step[i]
                beyond = max(low[i] - to, to - high[i])
                if beyond > over:
                    worst, over = i, beyond
        if worst < 0:
            return
        free[worst] = 0.0
        step[worst] = (low[worst] if step[worst] < 0.0 else high[worst]) - q[worst]
        for r in range(6):
            left[r] -= jac[r, worst] * step[worst]


@kernel
def _along(jac, i, y):
    """Component of y (6,) along the i-th column."""
    return (
        jac[0, i] * y[0] + jac[1, i] * y[1] + jac[2, i] * y[2] + jac[3, i] * y[3] + jac[4, i] * y[4] + jac[5, i] * y[5]
    )


@kernel
def project(n, work):
    """Takes from PUSH what the tip would feel to first order; returns the largest component left."""
    jac, m = work[JAC : JAC + 6], work[NORMAL : NORMAL + 6]
    y, weight, push = work[RHS], work[WEIGHT], work[PUSH]
    gram(jac, n, weight, m)
    for r in range(6):
        m[r, r] += PROJECTION_DAMPING
        y[r] = 0.0
        for i in range(n):
            y[r] += jac[r, i] * push[i]
    factorise(m)
    substitute(m, y)
    largest = 0.0
    for i in range(n):
        push[i] -= weight[i] * _along(jac, i, y)
        largest = max(largest, abs(push[i]))
    return largest


@kernel
def move(n, q, work, to):
    """q and STEP into `to`, with no rounding beyond LOW..HIGH."""
    step, low, high = work[STEP], work[LOW], work[HIGH]
    for i in range(n):
        to[i] = min(max(q[i] + step[i], low[i]), high[i])


@kernel
def _close_enough(settings, work):
    e, position, rotation = work[ERROR], settings[POSITION_TOL], settings[ROTATION_TOL]
    return e[OFF_POSITION] <= position * position and e[OFF_ROTATION] <= rotation * rotation


@kernel
def _chord_step(n, work):
    """The step for a new error with Jacobian, factor and free joints of the last damped step, into STEP."""
    jac, e, y = work[JAC : JAC + 6], work[ERROR], work[RHS]
    step, free = work[STEP], work[FREE]
    for r in range(6):
        y[r] = e[r]
    substitute(work[NORMAL : NORMAL + 6], y)
    for i in range(n):
        step[i] = free[i] * _along(jac, i, y)


@kernel
def descend(chain, settings, target, q, work):
    """From q (n,), in place, towards target within LOW..HIGH; whether it arrived, and how many steps it tried.

    The damping follows the error (Chan), so the last steps are Newton's; a step that does not help raises it. Near the
    target the same factor serves a second step (Shamanskii 1967): third order for little more than the price of one.
    """
    n = chain.shape[0] - 2
    trial = work[TRIAL]
    shrink, weight, iterations = 1.0 / chain[0, LENGTH], settings[ROTATION_WEIGHT], int(settings[ITERATIONS])
    f, error = _aim(chain, settings, target, q, work)
    factor, idle = 1.0, 0
    for k in range(iterations):
        if _close_enough(settings, work):
            return True, k
        axes_to_jacobian(chain, f, shrink, weight, work[JAC : JAC + 6])
        damped_step(n, q, settings[DAMPING] * factor * error + MIN_DAMPING, work)
        move(n, q, work, trial)
        if error < CHORD:
            tip_error(tip_frame(chain, trial), target, shrink, weight, work[ERROR])
            if _close_enough(settings, work):
                for i in range(n):
                    q[i] = trial[i]
                return True, k + 1
            _chord_step(n, work)
            move(n, trial, work, trial)
        f, fresh = _aim(chain, settings, target, trial, work)
        if fresh < error:
            idle = idle + 1 if fresh > IDLE * error else 0
            for i in range(n):
                q[i] = trial[i]
            error = fresh
            factor = max(0.2 * factor, 1.0)
        else:
            factor *= 8.0
            idle += 1
            f, error = _aim(chain, settings, target, q, work)
        if idle == PATIENCE:
            return False, k + 1
    return _close_enough(settings, work), iterations


@kernel
def bound(chain, seed, jump, work):
    """LOW..HIGH: the joint limits, and no further from the seed than `jump`; WEIGHT: prismatic joints count in lengths
    of the arm."""
    low, high, weight = work[LOW], work[HIGH], work[WEIGHT]
    for i in range(chain.shape[0] - 2):
        row = chain[i + 1]
        unit = row[UNIT]
        at = min(max(seed[i], row[LOWER]), row[UPPER])
        low[i] = max(row[LOWER], at - jump * unit)
        high[i] = min(row[UPPER], at + jump * unit)
        weight[i] = unit * unit
