"""Kernel of the fused estimator.

Each source of information about the normal n is a quadratic form n' J n, which is zero along the normal of that
source. The fused normal minimises their sum. With f the force on the sphere, v the slip of the contact
point, f^ and v^ their directions, phi = atan(mu):

- wrench axis: J = [f]x' C⁻¹ [f]x, about the point where the line of action enters the sphere. Always used.
- motion: n is perpendicular to the centre's velocity while the sphere slides.
- friction plane: while sliding, friction opposes the slip: n lies in the plane of f and v.
- friction angle: while sliding, n is phi away from f, on the side v points to; at rest, within phi of f.
- memory: the last normal, with a variance that grows with path and time.
"""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.contact.kernels import (
    AMBIGUOUS,
    GOOD,
    I_CENTRE,
    I_FORCE,
    I_ROTATION,
    I_TIME,
    I_VELOCITY,
    I_ZEROING,
    O_CONFIDENCE,
    O_FORCE,
    O_SIGMA,
    P_FORCE_NOISE,
    P_LEVER_ERROR,
    P_MAX_SINE,
    P_OWN,
    P_RADIUS,
    P_ZERO_ACROSS,
    P_ZERO_ALONG,
    axis_information,
    check_axis,
    confidence_of,
    consistent_torque,
    cross,
    deliver_world,
    invert,
    magnitude,
    meet_sphere,
    prepare,
    project,
    refuse,
    rotate,
    screen,
    tangent_spread,
    torque_covariance,
)

# own params
P_SPEED_NOISE = P_OWN  # m/s
P_SLIP_ANGLE = P_OWN + 1  # rad, how far friction may point off the slip
P_MIN_SPEED = P_OWN + 2  # m/s, below it sliding is not assumed
P_HIDDEN_COMPLIANCE = P_OWN + 3  # m/N, compliance that velocities do not contain
P_MEMORY = P_OWN + 4  # s without contact after which the memory is reset
P_WALL_CLEARANCE = P_OWN + 5  # m by which a wall must be left to count as left
P_ZERO_TIME = P_OWN + 6  # s, time constant with which the zero wanders
P_LAG = P_OWN + 7  # N, width of the force's hysteresis
PARAMS = P_OWN + 8

# state
S_BEGUN = 0
S_TIME = 1
S_FORCE = 2  # N, last magnitude
S_CENTRE = 3  # 3
S_NORMAL = 6  # 3
S_INFO = 9  # 9
S_FRICTION = 18
S_FRICTION_VAR = 19
S_ROTATION = 20  # 9
S_MISMATCH = 29  # 3, running mean of (sliding - axis)
S_AMBIGUOUS = 32
S_ANCHOR = 33  # 3, centre where the normal jumped
S_WALL = 36  # 3, normal before the jump
S_PATH = 39  # m, since the surface was begun
S_STREAK = 40  # samples in a row that slid
S_TURN = 41  # 3, 1/m, change of the normal per metre of path
S_BEFORE = 44  # 3, the normal S_TURN_PATH ago
S_OFFSET = 47  # 3, N, sensor frame: effect of the zero drift on m
S_OFFSET_COV = 50  # 9
S_OFFSET_TIME = 59
S_ZEROING = 60
S_VELOCITY = 61  # 3, m/s, the last one
S_SPEED_VAR = 64  # m²/s², noise variance of each velocity axis
S_TURN_PATH = 65
S_RING_TIME = 66
S_HEAD = 67
S_OTHERWISE = 68  # m, path at which the normal was last another one than before the jump
S_LOAD = 69  # 2, N, the last force across the stick, sensor frame
S_LAG = 71  # 2, N, by which the reading stands off the middle of its hysteresis
S_LAG_LEARNT = 73  # 2, the same where the offset was learnt
S_SLIP = 75  # 3, direction of the last sample that slid
S_AXIS = 78  # 1/rad², what of the remembered information came from wrench axes
S_RING = 79  # RING rows: path, normal (3), sigma
RING = 16
ROW = 5
STATE = S_RING + RING * ROW

RESTS, SLIPS, SLIDES = 0, 1, 2  # how the sphere moves along the surface

_RUN = 0.15  # weight of a new sample in the running mismatch
_GATE = 13.8  # chi-squared, 2 degrees of freedom, 0.1 %
_OFFSET_GATE = 16.3  # chi-squared, 3 degrees of freedom, 0.1 %
_REST_DRIFT = 0.019  # rad per square root of a second by which the memory fades at rest
_JUMP_MARGIN = 0.26  # rad beyond what rolling and noise explain
_SAME = 0.1  # rad within which a normal is that of the first wall
_SAME_PATH = 1e-3  # m over which it must be, to show that there was no second wall
_FRICTION_STEP = 0.05  # change of mu over a centimetre
_VELOCITY_WEIGHT = 0.1  # weight of a new sample in the running noise of the velocity
_TURN_MEMORY = 6e-4  # m of path over which the rate of turn is averaged
_TURN_SHARE = 0.2  # largest weight of one measurement of it
_TURN_PATH = 1e-4  # m, shortest path over which a turn of the normal is measured
_TURN_ERRORS = 4.0  # the same in errors of the normal times the sphere's radius
_RING_TIME = 0.006  # s at least between two rows of the ring
_STREAK = 8.0  # samples of sliding before friction is estimated: the running mismatch needs them
_FRICTION_STREAK = 4.0  # the same before a known friction tells the normal's angle to the force
_OFFSET_STREAK = 4.0  # the same before the sensor's zero is
_REFUTED_GROWTH = 0.02  # relative growth of that variance with each sample that contradicts sliding
_SAME_SLIP = 0.87  # cosine between the slips of two samples in a row: a sphere that turns back sticks first
_MIN_TRAVEL = 0.3  # smallest ratio of travel to speed times period while sliding
_TRANSIENT = 12.0  # 1/s, relative change of force beyond which nothing slides steadily
_DEVELOPING = 0.1  # share of mu, one standard deviation, by which the friction of a slip with a changing force is off
_MIN_SINE = 0.4  # least sine between force and slip for sliding
_AMBIGUOUS_CONFIDENCE = 0.3
_SHARED_CONFIDENCE = 0.4  # to which an error that all axes share lowers the confidence, and no farther


@kernel
def fused(given, params, state, out):
    """Estimate the contact of one sample and update the state; returns the reason."""
    reason = screen(given, params)
    if reason != GOOD:
        return refuse(given, reason, params, out)
    u, m, raw, normal, slip = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    cov, info, total = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    age_offset(given, params, state)
    prepare(given, params, u, raw, cov)
    add_offset(state, raw, m, cov)
    reason = check_axis(given, params, m, cov)
    if reason != GOOD:
        return refuse(given, reason, params, out)
    meet_sphere(given, m, params[P_MAX_SINE], u)
    torque_covariance(given, u, params, cov)
    common = add_offset(state, raw, m, cov)
    axis_information(given, u, cov, info)
    to_world(given, u, info, normal, total)
    axis = tangent_spread(total, normal)
    common = common_share(params, total, common)
    rotate(given, given, out, O_FORCE)
    travel = advance(given, params, state)
    watch_velocity(given, params, state)
    consistent_torque(given, cov, m)
    motion = add_sliding(given, params, state, m, cov, normal, total, out, slip, travel, common)
    sliding = motion == SLIDES
    if sliding:
        learn_offset(given, params, state, raw, cov, out)
        doubt_memory(state, axis, common)
    add_memory(state, normal, total)
    state[S_AXIS] += 1.0 / (axis * axis)
    smallest_direction(total, normal)
    remember(given, params, state, normal, total, travel)
    # The friction angle is the same for many samples: remembered, its error would be averaged as if it were noise.
    mu, mu_var = state[S_FRICTION], state[S_FRICTION_VAR]
    if sliding:
        learn_friction(params, state, normal, total, slip, out)
    # The stick bends before the sphere slips: a slip that has just begun need not take all of the friction yet.
    slid = motion == SLIPS or (sliding and state[S_STREAK] >= _FRICTION_STREAK)
    mu_var += (_DEVELOPING * mu) ** 2 if motion == SLIPS else 0.0
    add_friction(given, params, mu, mu_var, slid, slip, total, out)
    smallest_direction(total, normal)
    own = tangent_spread(total, normal)
    sigma = math.hypot(own, shared_error(axis, own, state[S_AXIS], common))
    reason = deliver_world(given, normal, sigma, params, out)
    # Imprecise for what all have in common, it is one of the sphere all the same.
    if out[O_SIGMA] <= sigma:  # else the normal was not even outwards
        out[O_CONFIDENCE] = max(out[O_CONFIDENCE], min(confidence_of(own, params), _SHARED_CONFIDENCE))
    if ambiguous(given, params, state, normal, sigma):
        out[O_CONFIDENCE] = _AMBIGUOUS_CONFIDENCE
        return AMBIGUOUS
    return reason


@kernel
def age_offset(given, params, state):
    """Increase the offset's variance with time up to its initial value; reset it when the zero was moved."""
    across, along = params[P_ZERO_ACROSS], params[P_ZERO_ALONG]
    at = S_OFFSET_COV
    if state[at] <= 0.0 or state[S_ZEROING] != given[I_ZEROING]:
        for i in range(9):
            state[at + i] = 0.0
        for i in range(3):
            state[S_OFFSET + i] = 0.0
        state[at], state[at + 4], state[at + 8] = across, across, along
        state[S_ZEROING] = given[I_ZEROING]
        for i in range(2):
            state[S_LAG + i] = state[S_LAG_LEARNT + i] = 0.0
    else:
        share = min(max(given[I_TIME] - state[S_OFFSET_TIME], 0.0) / params[P_ZERO_TIME], 1.0)
        loosen_offset(params, state, share)
        turn_load(given, params, state)
    for i in range(2):
        state[S_LOAD + i] = given[I_FORCE + i]
    state[S_OFFSET_TIME] = given[I_TIME]


@kernel
def turn_load(given, params, state):
    """Follow the sensor's hysteresis; where a load that turns back moves it, the offset is not the one that was learnt.

    A reading lags behind a load that rises and stays above one that falls, at most by half the hysteresis' width. By
    the square of what that has changed by since, over the width, the offset is as uncertain as it was at first.
    """
    width = params[P_LAG]
    if width <= 0.0:
        return
    turned = 0.0
    for i in range(2):
        lag = state[S_LAG + i] + given[I_FORCE + i] - state[S_LOAD + i]
        state[S_LAG + i] = lag = min(max(lag, -0.5 * width), 0.5 * width)
        turned += ((lag - state[S_LAG_LEARNT + i]) / width) ** 2
    least = min(turned, 1.0)
    known = 0.5 * (state[S_OFFSET_COV] + state[S_OFFSET_COV + 4]) / params[P_ZERO_ACROSS]
    if least > known:
        loosen_offset(params, state, (least - known) / (1.0 - known))


@kernel
def loosen_offset(params, state, share):
    """Move the offset's covariance towards the first one by a share."""
    for i in range(9):
        state[S_OFFSET_COV + i] *= 1.0 - share
    state[S_OFFSET_COV] += share * params[P_ZERO_ACROSS]
    state[S_OFFSET_COV + 4] += share * params[P_ZERO_ACROSS]
    state[S_OFFSET_COV + 8] += share * params[P_ZERO_ALONG]


@kernel
def add_offset(state, raw, m, cov):
    """m = raw - offset, cov += its covariance; returns the offset's share of the whole variance."""
    added = 0.0
    for i in range(3):
        m[i] = raw[i] - state[S_OFFSET + i]
        added += state[S_OFFSET_COV + 4 * i]
        for j in range(3):
            cov[i, j] += state[S_OFFSET_COV + 3 * i + j]
    return added / (cov[0, 0] + cov[1, 1] + cov[2, 2] + 1e-300)


@kernel
def common_share(params, total, common):
    """Share of the axis' variance that is the same in all samples: the zero's, which is `common`, and the lever's."""
    mean = 0.5 * (total[0, 0] + total[1, 1] + total[2, 2])
    return min(1.0, common + mean * (params[P_LEVER_ERROR] / params[P_RADIUS]) ** 2)


@kernel
def shared_error(axis, sigma, known, common):
    """rad, what the common errors of all axes add to an error `sigma` that took those of each sample for its own.

    `axis` [rad] is the error of one sample's axis, `known` [1/rad²] the sum of what all of them told. Of N samples with
    a common share c the mean is off by axis² (c + (1 - c) / N), and not by axis² / N.
    """
    many = known * axis * axis
    if many <= 1.0:
        return 0.0
    return min(known * sigma * sigma, 1.0) * axis * math.sqrt(common * (1.0 - 1.0 / many))


@kernel
def doubt_memory(state, axis, common):
    """Make the memory as uncertain as the common errors of its axes make it, before it meets what has none of them."""
    sigma = tangent_spread(state[S_INFO : S_INFO + 9].reshape((3, 3)), state[S_NORMAL : S_NORMAL + 3])
    spread(state, 0.5 * shared_error(axis, sigma, state[S_AXIS], common) ** 2)


@kernel
def learn_offset(given, params, state, raw, cov, out):
    """Kalman step on the offset: while sliding, the normal is known without torque, which predicts m.

    What no wander of the zero explains is the torque of another contact, such as one of the stick.
    """
    speed = magnitude(given, I_VELOCITY)
    if state[S_STREAK] < _OFFSET_STREAK or speed < params[P_MIN_SPEED]:
        return
    n = np.empty(3)
    sliding_normal(given, out, speed, n)
    e0, e1, e2 = contact_torque(given, n)
    if not wanders_so_far(params, state, cov, (raw[0] - e0, raw[1] - e1, raw[2] - e2)):
        return
    seen = (raw[0] - e0 - state[S_OFFSET], raw[1] - e1 - state[S_OFFSET + 1], raw[2] - e2 - state[S_OFFSET + 2])
    # cov is the whole covariance of m, the offset's included; what the speed's error does to the normal comes on top
    inv = inverse_with(cov, state[S_SPEED_VAR] * (magnitude(given, I_FORCE) / speed) ** 2)
    w0 = inv[0] * seen[0] + inv[1] * seen[1] + inv[2] * seen[2]
    w1 = inv[1] * seen[0] + inv[3] * seen[1] + inv[4] * seen[2]
    w2 = inv[2] * seen[0] + inv[4] * seen[1] + inv[5] * seen[2]
    if w0 * seen[0] + w1 * seen[1] + w2 * seen[2] > _OFFSET_GATE:
        return
    p = state[S_OFFSET_COV : S_OFFSET_COV + 9].reshape((3, 3))
    for i in range(3):
        state[S_OFFSET + i] += p[i, 0] * w0 + p[i, 1] * w1 + p[i, 2] * w2
    before = p.copy()
    for j in range(3):
        b0, b1, b2 = before[0, j], before[1, j], before[2, j]
        w0 = inv[0] * b0 + inv[1] * b1 + inv[2] * b2
        w1 = inv[1] * b0 + inv[3] * b1 + inv[4] * b2
        w2 = inv[2] * b0 + inv[4] * b1 + inv[5] * b2
        for i in range(3):
            p[i, j] -= before[i, 0] * w0 + before[i, 1] * w1 + before[i, 2] * w2
    fresh = 1.0 - (p[0, 0] + p[1, 1]) / max(before[0, 0] + before[1, 1], 1e-300)
    for i in range(2):
        state[S_LAG_LEARNT + i] += fresh * (state[S_LAG + i] - state[S_LAG_LEARNT + i])


@kernel
def wanders_so_far(params, state, cov, offset):
    """Whether the zero may be off by an offset of one sample's torque, whatever was learnt of it before."""
    whole = cov - state[S_OFFSET_COV : S_OFFSET_COV + 9].reshape((3, 3))
    whole[0, 0] += params[P_ZERO_ACROSS]
    whole[1, 1] += params[P_ZERO_ACROSS]
    whole[2, 2] += params[P_ZERO_ALONG]
    return squared_errors(offset, invert(whole)) <= _OFFSET_GATE


@kernel
def contact_torque(given, n):
    """The torque m = u x f, sensor frame, of a contact with the normal n = -u, world frame."""
    u0, u1, u2 = 0.0, 0.0, 0.0
    for i in range(3):
        u0 -= given[I_ROTATION + 3 * i] * n[i]
        u1 -= given[I_ROTATION + 3 * i + 1] * n[i]
        u2 -= given[I_ROTATION + 3 * i + 2] * n[i]
    return cross(u0, u1, u2, given[0], given[1], given[2])


@kernel
def inverse_with(cov, variance):
    """Inverse of a covariance and a variance of all axes on top, as the six numbers of `invert`."""
    whole = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            whole[i, j] = cov[i, j] + (variance if i == j else 0.0)
    return invert(whole)


@kernel
def squared_errors(d, inv):
    """d' C⁻¹ d, with the six numbers of `invert`."""
    return (
        inv[0] * d[0] * d[0]
        + inv[3] * d[1] * d[1]
        + inv[5] * d[2] * d[2]
        + 2.0 * (inv[1] * d[0] * d[1] + inv[2] * d[0] * d[2] + inv[4] * d[1] * d[2])
    )


@kernel
def sliding_normal(given, out, speed, n):
    """n along f - (f.v^) v^, the normal of a sliding contact; returns f.v^ and the length before scaling."""
    along = 0.0
    for i in range(3):
        along += out[O_FORCE + i] * given[I_VELOCITY + i] / speed
    for i in range(3):
        n[i] = out[O_FORCE + i] - along * given[I_VELOCITY + i] / speed
    size = magnitude(n, 0)
    for i in range(3):
        n[i] /= max(size, 1e-300)
    return along, size


@kernel
def to_world(given, u, info, normal, total):
    """normal = -R u, total = R info R'."""
    half = np.empty((3, 3))
    r = I_ROTATION
    for i in range(3):
        normal[i] = -(given[r + 3 * i] * u[0] + given[r + 3 * i + 1] * u[1] + given[r + 3 * i + 2] * u[2])
        for j in range(3):
            half[i, j] = 0.0
            for k in range(3):
                half[i, j] += given[r + 3 * i + k] * info[k, j]
    for i in range(3):
        for j in range(3):
            total[i, j] = 0.0
            for k in range(3):
                total[i, j] += half[i, k] * given[r + 3 * j + k]


@kernel
def add_square(total, a0, a1, a2, weight):
    """total += weight a a'."""
    total[0, 0] += weight * a0 * a0
    total[1, 1] += weight * a1 * a1
    total[2, 2] += weight * a2 * a2
    total[0, 1] += weight * a0 * a1
    total[0, 2] += weight * a0 * a2
    total[1, 2] += weight * a1 * a2
    total[1, 0] = total[0, 1]
    total[2, 0] = total[0, 2]
    total[2, 1] = total[1, 2]


@kernel
def advance(given, params, state):
    """Predict the memory over the path since the last sample, and return the length of that path [m].

    Resets the memory after too long a time or too large a step.
    """
    if state[S_BEGUN] == 0.0:
        return 0.0
    dt = given[I_TIME] - state[S_TIME]
    square = 0.0
    for i in range(3):
        square += (given[I_CENTRE + i] - state[S_CENTRE + i]) ** 2
    travel = math.sqrt(square)
    if not 0.0 < dt <= params[P_MEMORY] or travel > params[P_RADIUS]:
        state[S_BEGUN] = 0.0
        return 0.0
    predict(state, travel)
    # An offset surface turns at most 1 / r per metre; half of it as one standard deviation.
    spread(state, (0.5 * travel / params[P_RADIUS]) ** 2 + _REST_DRIFT**2 * dt)
    state[S_PATH] += travel
    state[S_FRICTION_VAR] += (_FRICTION_STEP * travel / 0.01) ** 2
    return travel


@kernel
def watch_velocity(given, params, state):
    """Running variance of the velocity's change from sample to sample: its noise, and accelerations with it."""
    square = 0.0
    for i in range(3):
        square += (given[I_VELOCITY + i] - state[S_VELOCITY + i]) ** 2
        state[S_VELOCITY + i] = given[I_VELOCITY + i]
    floor = params[P_SPEED_NOISE] ** 2
    if state[S_BEGUN] == 0.0:
        state[S_SPEED_VAR] = floor
    else:
        state[S_SPEED_VAR] = max(floor, state[S_SPEED_VAR] + _VELOCITY_WEIGHT * (square / 6.0 - state[S_SPEED_VAR]))


@kernel
def predict(state, travel):
    """Extrapolate the remembered normal with its recent rate of turn."""
    normal, info = state[S_NORMAL : S_NORMAL + 3], state[S_INFO : S_INFO + 9].reshape((3, 3))
    for i in range(3):
        normal[i] += state[S_TURN + i] * travel
    size = magnitude(normal, 0)
    for i in range(3):
        normal[i] /= size
    project(info, normal)


@kernel
def learn_turn(state, normal, sigma, travel, radius):
    """Running mean of the rate of turn, measured over a path on which it exceeds the error; at most 1 / radius."""
    state[S_TURN_PATH] += travel
    if state[S_TURN_PATH] < max(_TURN_PATH, _TURN_ERRORS * sigma * radius):
        return
    share = min(_TURN_SHARE, 1.0 - math.exp(-state[S_TURN_PATH] / _TURN_MEMORY))
    size = 0.0
    for i in range(3):
        seen = (normal[i] - state[S_BEFORE + i]) / state[S_TURN_PATH]
        state[S_TURN + i] += share * (seen - state[S_TURN + i])
        size += state[S_TURN + i] ** 2
        state[S_BEFORE + i] = normal[i]
    state[S_TURN_PATH] = 0.0
    size = math.sqrt(size) * radius
    if size > 1.0:
        for i in range(3):
            state[S_TURN + i] /= size


@kernel
def spread(state, variance):
    """Add a variance in the tangent plane of the remembered normal: J <- (J⁻¹ + q)⁻¹ on that plane.

    What of it came from axes falls with the mean square error.
    """
    n0, n1, n2 = state[S_NORMAL], state[S_NORMAL + 1], state[S_NORMAL + 2]
    if abs(n0) < 0.6:
        a0, a1, a2 = cross(1.0, 0.0, 0.0, n0, n1, n2)
    else:
        a0, a1, a2 = cross(0.0, 1.0, 0.0, n0, n1, n2)
    size = math.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
    a0, a1, a2 = a0 / size, a1 / size, a2 / size
    b0, b1, b2 = cross(n0, n1, n2, a0, a1, a2)
    aa, ab, bb = 0.0, 0.0, 0.0
    a, b = (a0, a1, a2), (b0, b1, b2)
    for i in range(3):
        for j in range(3):
            s = state[S_INFO + 3 * i + j]
            aa += a[i] * s * a[j]
            ab += a[i] * s * b[j]
            bb += b[i] * s * b[j]
    # (J⁻¹ + q)⁻¹ = (J + q det) / (1 + q trace + q² det) for 2 x 2
    det = aa * bb - ab * ab
    scale = 1.0 / (1.0 + variance * (aa + bb) + variance * variance * det)
    if aa + bb > 0.0:
        state[S_AXIS] *= (aa + bb) / (aa + bb + 2.0 * variance * det)
    aa, ab, bb = (aa + variance * det) * scale, ab * scale, (bb + variance * det) * scale
    for i in range(3):
        for j in range(3):
            state[S_INFO + 3 * i + j] = aa * a[i] * a[j] + ab * (a[i] * b[j] + b[i] * a[j]) + bb * b[i] * b[j]


@kernel
def add_sliding(given, params, state, m, cov, normal, total, out, slip, travel, common):
    """Motion and friction plane, if the wrench axis does not contradict them; `slip` gets the unit slip direction.

    Returns SLIDES, else SLIPS where the sphere goes on along its last slip while the force changes, else RESTS.
    """
    speed = magnitude(given, I_VELOCITY)
    slip_speed = slip_velocity(given, state, normal, params, slip)
    dt = given[I_TIME] - state[S_TIME]
    if state[S_BEGUN] == 0.0 or slip_speed < params[P_MIN_SPEED] or travel < _MIN_TRAVEL * speed * dt:
        state[S_STREAK] = 0.0
        return RESTS
    f0, f1, f2 = out[O_FORCE], out[O_FORCE + 1], out[O_FORCE + 2]
    force = magnitude(given, I_FORCE)
    w0, w1, w2 = cross(f0 / force, f1 / force, f2 / force, slip[0], slip[1], slip[2])
    oblique = math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    same = slip[0] * state[S_SLIP] + slip[1] * state[S_SLIP + 1] + slip[2] * state[S_SLIP + 2]
    if abs(force - state[S_FORCE]) > _TRANSIENT * force * dt + 4.0 * params[P_FORCE_NOISE]:
        # The tip moves into the surface or off it: its path is not along it, but friction opposes the slip.
        return SLIPS if oblique >= _MIN_SINE and same > _SAME_SLIP else RESTS
    drift = abs(force - state[S_FORCE]) / max(dt, 1e-6) * params[P_HIDDEN_COMPLIANCE]
    noise = math.sqrt(state[S_SPEED_VAR] + drift * drift)
    if oblique < _MIN_SINE or not sliding_agrees(
        given, params, state, m, cov, normal, total, out, speed, noise, common
    ):
        loosen_offset(params, state, _REFUTED_GROWTH)
        if state[S_STREAK] > 0.0:
            forget_normal(state)
        state[S_STREAK] = 0.0
        return RESTS
    state[S_STREAK] = state[S_STREAK] + 1.0 if same > _SAME_SLIP else 1.0
    for i in range(3):
        state[S_SLIP + i] = slip[i]
    if speed >= params[P_MIN_SPEED]:
        angle = (noise / speed) ** 2 + params[P_SLIP_ANGLE] ** 2
        v = I_VELOCITY
        add_square(total, given[v] / speed, given[v + 1] / speed, given[v + 2] / speed, 1.0 / angle)
    lean = math.sqrt(max(0.0, 1.0 - oblique * oblique))
    aim = (noise / slip_speed) ** 2 + params[P_SLIP_ANGLE] ** 2
    variance = (params[P_FORCE_NOISE] / force) ** 2 + lean * lean * aim
    add_square(total, w0 / oblique, w1 / oblique, w2 / oblique, 1.0 / (variance + 1e-12))
    return SLIDES


@kernel
def forget_normal(state):
    """Clear the remembered information: it assumed sliding, which is now refuted."""
    state[S_AXIS] = 0.0
    for i in range(9):
        state[S_INFO + i] = 0.0


@kernel
def slip_velocity(given, state, normal, params, slip):
    """Unit direction of the contact point's velocity v + w x (-r n) into `slip`; returns its speed [m/s]."""
    w0, w1, w2 = 0.0, 0.0, 0.0
    dt = given[I_TIME] - state[S_TIME]
    if state[S_BEGUN] != 0.0 and dt > 0.0:
        # (R2 R1' - its transpose) / 2 is the cross matrix of the turn, for the small turns between two samples
        turn = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                turn[i, j] = 0.0
                for k in range(3):
                    turn[i, j] += given[I_ROTATION + 3 * i + k] * state[S_ROTATION + 3 * j + k]
        w0 = 0.5 * (turn[2, 1] - turn[1, 2]) / dt
        w1 = 0.5 * (turn[0, 2] - turn[2, 0]) / dt
        w2 = 0.5 * (turn[1, 0] - turn[0, 1]) / dt
    r = params[P_RADIUS]
    c0, c1, c2 = cross(w0, w1, w2, -r * normal[0], -r * normal[1], -r * normal[2])
    slip[0], slip[1], slip[2] = given[I_VELOCITY] + c0, given[I_VELOCITY + 1] + c1, given[I_VELOCITY + 2] + c2
    speed = magnitude(slip, 0)
    if speed > 0.0:
        for i in range(3):
            slip[i] /= speed
    return speed


@kernel
def sliding_agrees(given, params, state, m, cov, normal, total, out, speed, noise, common):
    """Whether the normal that sliding would have agrees with the wrench axis, now and in the running mean.

    Of one sample the torques are compared: the axis of a force on the stick, beside the sphere, has no normal there.
    `m`, perpendicular to the force, and `cov` are the torque and its whole covariance, `common` is the share of that
    variance that is the same in all samples.
    """
    if speed < params[P_MIN_SPEED]:
        return True
    v, guess = np.empty(3), np.empty(3)
    along, size = sliding_normal(given, out, speed, guess)
    aim = (noise / speed) ** 2 + params[P_SLIP_ANGLE] ** 2
    # friction opposes the slip
    if size <= 0.0 or along > 3.0 * (params[P_FORCE_NOISE] + size * math.sqrt(aim)):
        return False
    expected = contact_torque(given, guess)
    seen = (m[0] - expected[0], m[1] - expected[1], m[2] - expected[2])
    for i in range(3):
        v[i] = given[I_VELOCITY + i] / speed
        guess[i] -= normal[i]
        state[S_MISMATCH + i] += _RUN * (guess[i] - state[S_MISMATCH + i])
    if squared_errors(seen, inverse_with(cov, aim * magnitude(given, I_FORCE) ** 2)) > _GATE:
        return False
    # the running mean averages the sensor's noise, not what all samples have in common
    gain = 1.0 / (common + (1.0 - common) * _RUN / (2.0 - _RUN))
    return chi_squared(state[S_MISMATCH : S_MISMATCH + 3], total, gain, v, aim) < _GATE


@kernel
def chi_squared(d, info, gain, v, variance):
    """d' (C + variance v v')⁻¹ d with C⁻¹ = gain info, by Sherman and Morrison."""
    dd, dv, vv = 0.0, 0.0, 0.0
    for i in range(3):
        for j in range(3):
            s = gain * info[i, j]
            dd += d[i] * s * d[j]
            dv += d[i] * s * v[j]
            vv += v[i] * s * v[j]
    return dd - dv * dv * variance / (1.0 + variance * vv)


@kernel
def add_friction(given, params, mu, mu_var, sliding, slip, total, out):
    """Friction angle: known while sliding, an upper bound at rest."""
    force = magnitude(given, I_FORCE)
    f0, f1, f2 = out[O_FORCE] / force, out[O_FORCE + 1] / force, out[O_FORCE + 2] / force
    noise = (params[P_FORCE_NOISE] / force) ** 2
    if not sliding:
        phi = math.atan(mu + math.sqrt(mu_var))
        weight = 1.0 / (noise + phi * phi)
        total[0, 0] += weight
        total[1, 1] += weight
        total[2, 2] += weight
        add_square(total, f0, f1, f2, -weight)
        return
    along = f0 * slip[0] + f1 * slip[1] + f2 * slip[2]
    e0, e1, e2 = slip[0] - along * f0, slip[1] - along * f1, slip[2] - along * f2
    size = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    phi = math.atan(mu)
    s, c = -math.sin(phi), math.cos(phi) / size
    weight = 1.0 / (noise + mu_var / (1.0 + mu * mu) ** 2 + 1e-12)
    add_square(total, s * f0 + c * e0, s * f1 + c * e1, s * f2 + c * e2, weight)


@kernel
def add_memory(state, normal, total):
    """Add the remembered normal, with less weight where this sample contradicts it (an edge, or an outlier)."""
    if state[S_BEGUN] == 0.0:
        state[S_AXIS] = 0.0
        return
    mean = np.empty(3)
    for i in range(3):
        mean[i] = normal[i]
    smallest_direction(total, mean)
    # chi-squared of the difference under the sum of both spreads, taken along the difference
    own, kept = 0.0, 0.0
    for i in range(3):
        for j in range(3):
            d = (mean[i] - state[S_NORMAL + i]) * (mean[j] - state[S_NORMAL + j])
            own += d * total[i, j]
            kept += d * state[S_INFO + 3 * i + j]
    weight = 1.0
    if own * kept > _GATE * (own + kept):
        weight = (_GATE * (own + kept) / (own * kept)) ** 2
    state[S_AXIS] *= weight
    for i in range(3):
        for j in range(3):
            total[i, j] += weight * state[S_INFO + 3 * i + j]


@kernel
def smallest_direction(total, normal):
    """Eigenvector of the smallest eigenvalue, on the side of `normal`, into it: inverse iteration by the adjugate."""
    a, b, c, d, e, f = total[0, 0], total[0, 1], total[0, 2], total[1, 1], total[1, 2], total[2, 2]
    scale = a + d + f
    a, b, c, d, e, f = a / scale, b / scale, c / scale, d / scale, e / scale, f / scale
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    x, y, z = normal[0], normal[1], normal[2]
    for _ in range(3):
        p, q, s = c00 * x + c01 * y + c02 * z, c01 * x + c11 * y + c12 * z, c02 * x + c12 * y + c22 * z
        size = math.sqrt(p * p + q * q + s * s)
        if not size > 0.0:
            return
        x, y, z = p / size, q / size, s / size
    side = 1.0 if x * normal[0] + y * normal[1] + z * normal[2] >= 0.0 else -1.0
    normal[0], normal[1], normal[2] = side * x, side * y, side * z


@kernel
def remember(given, params, state, normal, total, travel):
    """Keep normal, information and place for the next sample."""
    project(total, normal)
    for i in range(3):
        for j in range(3):
            state[S_INFO + 3 * i + j] = total[i, j]
    if state[S_BEGUN] != 0.0:
        learn_turn(state, normal, tangent_spread(total, normal), travel, params[P_RADIUS])
    for i in range(3):
        state[S_NORMAL + i] = normal[i]
        state[S_CENTRE + i] = given[I_CENTRE + i]
    for i in range(9):
        state[S_ROTATION + i] = given[I_ROTATION + i]
    state[S_TIME] = given[I_TIME]
    state[S_FORCE] = magnitude(given, I_FORCE)
    if state[S_BEGUN] == 0.0:
        state[S_PATH] = 0.0
        state[S_HEAD] = 0.0
        state[S_AMBIGUOUS] = 0.0
        state[S_TURN_PATH] = 0.0
        for i in range(3):
            state[S_MISMATCH + i] = 0.0
            state[S_TURN + i] = 0.0
            state[S_BEFORE + i] = normal[i]
        state[S_BEGUN] = 1.0


@kernel
def learn_friction(params, state, normal, total, slip, out):
    """Scalar Kalman step on mu from the part of the force along the slip over the part along the normal."""
    push, drag, off = 0.0, 0.0, 0.0
    for i in range(3):
        push += out[O_FORCE + i] * normal[i]
        drag -= out[O_FORCE + i] * slip[i]
        off += slip[i] * normal[i]
    flat = math.sqrt(max(1.0 - off * off, 1e-6))
    if push <= 0.0 or state[S_STREAK] < _STREAK:
        return
    seen = (drag + off * push) / (flat * push)
    sigma = tangent_spread(total, normal)
    variance = (params[P_FORCE_NOISE] / push) ** 2 + sigma * sigma * (1.0 + seen * seen) ** 2 + 1e-10
    gain = state[S_FRICTION_VAR] / (state[S_FRICTION_VAR] + variance)
    state[S_FRICTION] = max(0.0, state[S_FRICTION] + gain * (seen - state[S_FRICTION]))
    state[S_FRICTION_VAR] *= 1.0 - gain


@kernel
def ambiguous(given, params, state, normal, sigma):
    """Whether the normal has turned more since a recent sample than a single contact of a sphere allows.

    A single contact's normal turns at most 1 / r per metre of the centre's path at a convex edge. A second wall makes
    it jump; it stays ambiguous until the centre has left the first wall's plane, or goes on along that wall with its
    normal: strong friction makes the normal jump where the sphere sticks and slips.
    """
    if state[S_AMBIGUOUS] != 0.0:
        left, cosine = 0.0, 0.0
        for i in range(3):
            left += (given[I_CENTRE + i] - state[S_ANCHOR + i]) * state[S_WALL + i]
            cosine += normal[i] * state[S_WALL + i]
        if cosine < math.cos(_SAME):
            state[S_OTHERWISE] = state[S_PATH]
        if abs(left) > params[P_WALL_CLEARANCE] or state[S_PATH] - state[S_OTHERWISE] > _SAME_PATH:
            state[S_AMBIGUOUS] = 0.0
            state[S_HEAD] = 0.0
    else:
        find_jump(given, params, state, normal, sigma)
    if 0.0 <= given[I_TIME] - state[S_RING_TIME] < _RING_TIME and state[S_HEAD] > 0.0:
        return state[S_AMBIGUOUS] != 0.0
    state[S_RING_TIME] = given[I_TIME]
    head = int(state[S_HEAD])
    row = S_RING + ROW * (head % RING)
    state[row] = state[S_PATH]
    for i in range(3):
        state[row + 1 + i] = normal[i]
    state[row + 4] = sigma
    state[S_HEAD] = head + 1
    return state[S_AMBIGUOUS] != 0.0


@kernel
def find_jump(given, params, state, normal, sigma):
    """Compare the normal with the last ones; after a jump, store the place and the earlier normal."""
    kept = min(int(state[S_HEAD]), RING)
    for k in range(kept):
        row = S_RING + ROW * k
        cosine = 0.0
        for i in range(3):
            cosine += normal[i] * state[row + 1 + i]
        turned = math.acos(min(1.0, max(-1.0, cosine)))
        rolled = (state[S_PATH] - state[row]) / params[P_RADIUS]
        noise = 3.0 * math.sqrt(sigma * sigma + state[row + 4] ** 2)
        if turned > rolled + noise + _JUMP_MARGIN:
            state[S_AMBIGUOUS] = 1.0
            state[S_OTHERWISE] = state[S_PATH]
            for i in range(3):
                state[S_ANCHOR + i] = given[I_CENTRE + i]
                state[S_WALL + i] = state[row + 1 + i]
            return
