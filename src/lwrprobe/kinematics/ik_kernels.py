"""From a pose to joint values: tracking, cold starts, settling in the null space, and the nearest pose in reach.

A solver's `table` is the chain's (see chain_kernels) followed by a row of settings, a row of increments for the
restarts, the places of preference_kernels, the shape of a spherical-roll-spherical arm (see srs_kernels), and scratch.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics import dls_kernels as dls
from lwrprobe.kinematics import srs_kernels as srs
from lwrprobe.kinematics.chain_kernels import LOWER, UNIT, UPPER
from lwrprobe.kinematics.dls_kernels import bound, damped_step, descend, look, move, project
from lwrprobe.kinematics.preference_kernels import (
    NULL_SPACE_STEP,
    OFF_SINGULARITY,
    POSTURE,
    ease,
    potential,
    steepness,
    wish,
)

CONVERGED, UNREACHABLE, LIMITED, BUDGET, JUMP, INVALID = range(6)

# rows behind the chain's n + 2
SETTINGS, SPREAD, PLACES, SHAPE, SCRATCH = 2, 3, 4, 7, 10
ROWS = SCRATCH + dls.SCRATCH + srs.SCRATCH
# enough for the halves and the cuts of srs_kernels
WIDTH = 32
# columns of the settings row, behind those of dls_kernels and preference_kernels
SPHERICAL, STEPS = 11, 12
FOREVER = 1e300
# of the way to what is preferred, what one call of `track` goes: several cycles, so that no joint stops at once there
NEARER = 0.25
# rad: what is left of a wish that calls for no measurement, and how far along it is measured how fast it falls
QUIET, PROBED = 1e-6, 1e-5
# the largest and the smallest joint step of `settle`
STRIDE, MIN_STRIDE = 0.3, 1e-6
# places from which `_nearest` is sought, and how a radian weighs there against the arm's length, squared in the end
NEAREST_STARTS, HEAVY = 12, 100.0


@kernel(inline="always")
def parts(table, n):
    """Chain, settings, scratch for descents, shape, scratch for the closed form."""
    rest = n + SCRATCH
    shape = table[n + SHAPE : n + SHAPE + 3]
    return table[: n + 2], table[n + SETTINGS], table[rest : rest + dls.SCRATCH], shape, table[rest + dls.SCRATCH :]


@kernel(inline="always")
def places_of(table, n):
    return table[n + PLACES : n + SHAPE]


@kernel
def _take_target(pose, seed, target):
    """The pose row by row into target; False for what is no rotation to 1e-6, or no number."""
    for i in range(4):
        for j in range(4):
            target[4 * i + j] = pose[i, j]
    skew = 0.0
    for j in range(3):
        for k in range(j + 1):
            dot = pose[0, j] * pose[0, k] + pose[1, j] * pose[1, k] + pose[2, j] * pose[2, k]
            skew = max(skew, abs(dot - (1.0 if j == k else 0.0)))
    x = pose[1, 0] * pose[2, 1] - pose[2, 0] * pose[1, 1]
    y = pose[2, 0] * pose[0, 1] - pose[0, 0] * pose[2, 1]
    z = pose[0, 0] * pose[1, 1] - pose[1, 0] * pose[0, 1]
    handed = x * pose[0, 2] + y * pose[1, 2] + z * pose[2, 2]
    place = pose[0, 3] + pose[1, 3] + pose[2, 3]
    for i in range(seed.shape[0]):
        place += seed[i]
    # a NaN or an infinity makes each of these comparisons false
    return skew <= 1e-6 and handed > 0.0 and math.isfinite(place)


@kernel
def _clip(seed, work, q):
    """The seed within LOW..HIGH into q."""
    low, high = work[dls.LOW], work[dls.HIGH]
    for i in range(seed.shape[0]):
        q[i] = min(max(seed[i], low[i]), high[i])


@kernel
def _copy(source, to, n):
    for i in range(n):
        to[i] = source[i]


@kernel
def _into_reach(chain, settings, shape, work, arm_work):
    """Moves TARGET to where the elbow can take the wrist; the status of what was asked for."""
    target = work[dls.TARGET]
    shift = srs.lay_wrist(chain, shape, target, arm_work)
    if abs(shift) <= settings[dls.POSITION_TOL]:
        return CONVERGED
    wanted = arm_work[srs.CIRCLE, srs.DISTANCE] - shift
    srs.move_along_axis(shape, arm_work, shift, target)
    upper, fore = shape[2, srs.UPPER_ARM], shape[2, srs.FOREARM]
    return LIMITED if abs(upper - fore) <= wanted <= upper + fore else UNREACHABLE


@kernel
def _drift(chain, settings, places, target, way, q, work):
    """One step of q, in place, towards target, and by at most NULL_SPACE_STEP towards what is preferred;
    False, and no step, when nothing is.

    `way` is the share of the way there that it goes at once. Past it, it would swing about it from cycle to cycle.
    """
    n = chain.shape[0] - 2
    if settings[OFF_SINGULARITY] > 0.0:
        look(chain, settings, target, q, work)
    if wish(settings, places, q, work) < 1e-9:
        return False
    error = look(chain, settings, target, q, work)
    largest = project(n, work)
    damped_step(n, q, settings[dls.DAMPING] * error + dls.MIN_DAMPING, work)
    push, step = work[dls.PUSH], work[dls.STEP]
    steep = max(steepness(chain, settings, places, q, work), 1.0)
    if largest > QUIET:
        steep = max(steep, _bends(chain, settings, places, target, q, largest, work))
    share = way / steep
    if share * largest > settings[NULL_SPACE_STEP]:
        share = settings[NULL_SPACE_STEP] / largest
    for i in range(n):
        step[i] += share * push[i]
    move(n, q, work, q)
    return True


@kernel
def _bends(chain, settings, places, target, q, largest, work):
    """As `steepness`, measured a little farther along PUSH: the null space itself bends, sharply where two axes are
    nearly in line. PUSH and STEP are kept; what else belongs to q is lost."""
    push, kept, beyond = work[dls.PUSH], work[dls.SAVED], work[dls.TRIAL]
    n = chain.shape[0] - 2
    for i in range(n):
        kept[i] = push[i]
        beyond[i] = q[i] + PROBED / largest * push[i]
    look(chain, settings, target, beyond, work)
    wish(settings, places, beyond, work)
    project(n, work)
    left = whole = 0.0
    for i in range(n):
        left += push[i] * kept[i]
        whole += kept[i] * kept[i]
        push[i] = kept[i]
    return (1.0 - left / whole) * largest / PROBED


@kernel
def track(table, pose, seed, out):
    """The configuration near `seed` that puts the tip at `pose` (4, 4), into out; returns a status.

    Where there is none within reach, limits and jump, out is the best found within limits and jump.
    """
    n = seed.shape[0]
    chain, settings, work, shape, arm_work = parts(table, n)
    target = work[dls.TARGET]
    if not _take_target(pose, seed, target):
        _copy(seed, out, n)
        return INVALID
    jump = settings[dls.MAX_JUMP]
    bound(chain, seed, jump, work)
    _clip(seed, work, out)
    spherical = settings[SPHERICAL] != 0.0
    wanted = CONVERGED
    if spherical and srs.beyond(shape, target, settings[dls.POSITION_TOL]):
        wanted = _into_reach(chain, settings, shape, work, arm_work)
    preferring = settings[NULL_SPACE_STEP] > 0.0
    if preferring:
        ease(chain, places_of(table, n), out, work)
        _drift(chain, settings, places_of(table, n), target, NEARER, out, work)
    arrived, steps = descend(chain, settings, target, out, work)
    if preferring and not arrived:
        bound(chain, seed, jump, work)
        _clip(seed, work, out)
        arrived, steps = descend(chain, settings, target, out, work)
    settings[STEPS] = steps
    if arrived:
        return wanted
    if not spherical:
        return _why_stuck(chain, out, work)
    if wanted == CONVERGED:
        srs.lay_wrist(chain, shape, target, arm_work)
    return _rescue(chain, settings, seed, jump, out, wanted, work, shape, arm_work)


@kernel
def track_all(table, poses, seed, out):
    """`track` through poses (m, 4, 4) into out (m, n), each from the one before; how many were solved before one was
    not."""
    for k in range(poses.shape[0]):
        if track(table, poses[k], seed if k == 0 else out[k - 1], out[k]) != CONVERGED:
            return k
    return poses.shape[0]


@kernel
def _rescue(chain, settings, seed, jump, out, wanted, work, shape, arm_work):
    """The closed form's word where a descent got stuck: a configuration near the seed, or why there is none."""
    found = work[dls.SAVED]
    srs.lay_halves(shape, arm_work)
    psi = srs.seed_angle(chain, shape, seed, arm_work)
    far = srs.best_at(chain, shape, math.cos(psi), math.sin(psi), seed, 0.0, srs.NONE, arm_work, found)
    far = srs.on_arcs(chain, shape, seed, far, arm_work, found)
    if far == srs.NONE:
        return LIMITED if wanted == CONVERGED else wanted
    if far > jump:
        return JUMP
    _copy(found, out, seed.shape[0])
    arrived, steps = descend(chain, settings, work[dls.TARGET], out, work)
    settings[STEPS] += steps
    return wanted if arrived else BUDGET


@kernel
def _why_stuck(chain, q, work):
    """What held a descent that did not arrive: a joint limit, the bound on jumps, or the chain's reach."""
    low, high = work[dls.LOW], work[dls.HIGH]
    status = UNREACHABLE
    for i in range(chain.shape[0] - 2):
        row = chain[i + 1]
        slack = 1e-9 * row[UNIT]
        if q[i] <= row[LOWER] + slack or q[i] >= row[UPPER] - slack:
            return LIMITED
        if q[i] <= low[i] + slack or q[i] >= high[i] - slack:
            status = JUMP
    return status


@kernel
def reach(table, pose, seed, out):
    """A configuration for `pose` (4, 4), from anywhere, into out; returns a status.

    Where there is none, out puts the tip at the nearest pose found, with the orientation kept as far as it goes.
    """
    n = seed.shape[0]
    chain, settings, work, shape, arm_work = parts(table, n)
    target = work[dls.TARGET]
    if not _take_target(pose, seed, target):
        _copy(seed, out, n)
        return INVALID
    bound(chain, seed, FOREVER, work)
    settings[STEPS] = 0.0
    _clip(seed, work, out)
    wanted, restarts, spherical = CONVERGED, int(settings[dls.RESTARTS]), settings[SPHERICAL] != 0.0
    if spherical:
        wanted = _into_reach(chain, settings, shape, work, arm_work)
        srs.lay_halves(shape, arm_work)
        if not srs.any_configuration(chain, shape, seed, arm_work, out):
            restarts = 0
    if _search(chain, settings, table[n + SPREAD], restarts, out, work):
        return wanted
    _take_target(pose, seed, target)
    settled = _nearest(chain, settings, table[n + SPREAD], out, work)
    if wanted != CONVERGED:
        return wanted
    if spherical:
        return LIMITED
    return _why_stuck(chain, out, work) if settled else BUDGET


@kernel
def restart(chain, spread, k, q):
    """The k-th start: an additive recurrence that fills the joint ranges evenly (Roberts 2018)."""
    for i in range(chain.shape[0] - 2):
        row = chain[i + 1]
        low = row[LOWER] if math.isfinite(row[LOWER]) else -math.pi * row[UNIT]
        high = row[UPPER] if math.isfinite(row[UPPER]) else math.pi * row[UNIT]
        share = 0.5 + k * spread[i]
        q[i] = low + (share - math.floor(share)) * (high - low)


@kernel
def _search(chain, settings, spread, restarts, q, work):
    """Descents from q, in place, and from restarts; False, with the best of them in q, where all are in vain."""
    n = chain.shape[0] - 2
    target, best = work[dls.TARGET], work[dls.SAVED]
    least = FOREVER
    for k in range(restarts + 1):
        if k > 0:
            restart(chain, spread, k, q)
        arrived, steps = descend(chain, settings, target, q, work)
        settings[STEPS] += steps
        if arrived:
            return True
        error = look(chain, settings, target, q, work)
        if error < least:
            least = error
            _copy(q, best, n)
    _copy(best, q, n)
    return False


@kernel
def _nearest(chain, settings, spread, q, work):
    """From q, in place, or from elsewhere, to the least distance from TARGET, its orientation weighing far more;
    whether the last descent came to rest.

    The best of several starts is taken further. The heavier last pass leaves an error of orientation below any
    tolerance and moves the tip but in second order.
    """
    n = chain.shape[0] - 2
    target, best = work[dls.TARGET], work[dls.SAVED]
    settings[dls.ROTATION_WEIGHT] = HEAVY
    least, steps = FOREVER, 0
    for k in range(NEAREST_STARTS):
        if k > 0:
            restart(chain, spread, k, q)
        _, steps = descend(chain, settings, target, q, work)
        settings[STEPS] += steps
        error = look(chain, settings, target, q, work)
        if error < least:
            least = error
            _copy(q, best, n)
    _copy(best, q, n)
    usual = settings[dls.ITERATIONS]
    settings[dls.ITERATIONS] = 4 * usual
    for _ in range(2):
        _, steps = descend(chain, settings, target, q, work)
        settings[STEPS] += steps
        settings[dls.ROTATION_WEIGHT] *= HEAVY
    settled = steps < settings[dls.ITERATIONS]
    settings[dls.ROTATION_WEIGHT] = 1.0
    settings[dls.ITERATIONS] = usual
    return settled


@kernel
def settle(table, pose, q):
    """From a solution q, in place, along the null space to where the preference is content; the tip stays at pose."""
    n = q.shape[0]
    chain, settings, work, _, _ = parts(table, n)
    target, trial, places = work[dls.TARGET], work[dls.RESTING, :n], places_of(table, n)
    _take_target(pose, q, target)
    bound(chain, q, FOREVER, work)
    look(chain, settings, target, q, work)
    value = potential(settings, places, q, work)
    usual, settings[NULL_SPACE_STEP] = settings[NULL_SPACE_STEP], STRIDE
    left = int(settings[dls.ITERATIONS])
    while left > 0 and settings[NULL_SPACE_STEP] > MIN_STRIDE:
        left -= 1
        _copy(q, trial, n)
        if not _drift(chain, settings, places, target, 1.0, trial, work):
            break
        arrived, _ = descend(chain, settings, target, trial, work)
        look(chain, settings, target, trial, work)
        fresh = potential(settings, places, trial, work)
        if arrived and fresh < value:
            settings[NULL_SPACE_STEP] = min(2.0 * settings[NULL_SPACE_STEP], STRIDE) if value - fresh > 1e-12 else 0.0
            value = fresh
            _copy(trial, q, n)
        else:
            settings[NULL_SPACE_STEP] *= 0.25
    settings[NULL_SPACE_STEP] = usual


@kernel
def arcs_of(table, pose, n, side, flip_shoulder, flip_wrist, arcs):
    """The feasible arm angles of one branch (see srs_kernels.branch_arcs), -1 where the elbow cannot reach."""
    chain, settings, work, shape, arm_work = parts(table, n)
    middle = table[n + PLACES + POSTURE]
    _take_target(pose, middle[:n], work[dls.TARGET])
    if _into_reach(chain, settings, shape, work, arm_work) != CONVERGED:
        return -1
    srs.lay_halves(shape, arm_work)
    return srs.branch_arcs(chain, shape, side, flip_shoulder, flip_wrist, middle, arm_work, arcs)


@kernel
def on_branch(table, pose, side, flip_shoulder, flip_wrist, psi, seed, out):
    """One branch at one arm angle into out, its joints turned to be nearest to the seed; False where limits forbid."""
    chain, settings, work, shape, arm_work = parts(table, seed.shape[0])
    _take_target(pose, seed, work[dls.TARGET])
    if _into_reach(chain, settings, shape, work, arm_work) != CONVERGED:
        return False
    srs.lay_halves(shape, arm_work)
    c, s = math.cos(psi), math.sin(psi)
    slack = srs.POINT_SLACK
    return srs.branch_at(chain, shape, side, flip_shoulder, flip_wrist, c, s, seed, slack, arm_work, out) < srs.NONE
