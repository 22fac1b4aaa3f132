"""Kernels of the contact estimators: wrench in the sensor frame, contact in the world frame.

u is the unit vector from the sphere's centre to the contact point, n = -u the surface normal (out of the object),
f the force on the sphere, m = (t - c x f) / r the torque about the centre over the radius; a contact gives m = u x f.
"""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.compiled import kernel

# input of one estimate
I_FORCE = 0
I_TORQUE = 3
I_CENTRE = 6  # of the sphere, world
I_VELOCITY = 9  # of the sphere, world
I_ROTATION = 12  # 9, sensor frame in the world, row by row
I_STATUS = 21
I_TIME = 22
I_ZEROING = 23  # how often the sensor's zero has been moved
INPUT = 24

# params
P_RADIUS = 0
P_DISTANCE = 1
P_COMPLIANCE = 2  # 3
P_FORCE_NOISE = 5
P_TORQUE_NOISE = 6
P_NEAR_ZERO = 7  # N
P_MAX_SINE = 8  # sine of the largest friction angle
P_TRUSTED_ERROR = 9  # rad, expected error of the normal at which the confidence is 1/2
P_LEVER_ERROR = 10  # m, how well the sphere's centre is known in the sensor frame
P_INDENTATION = 11  # m/N, of the object under the sphere
P_ZERO_ACROSS = 12  # N², variance of m through the drift of the sensor's zero, across the stick
P_ZERO_ALONG = 13  # N², along it
P_OWN = 14  # an estimator's own settings begin here

# output
O_POINT = 0
O_NORMAL = 3
O_FORCE = 6
O_CONFIDENCE = 9
O_SIGMA = 10  # rad, expected root mean square error of the normal
OUTPUT = 11

# reasons, in the order of `estimator.REASONS`
GOOD = 0
NEAR_ZERO = 1
SATURATED_AXIS = 2
AXIS_MISSES = 3
STALE = 4
INVALID_WRENCH = 5
UNCONFIRMED_JUMP = 6
IMPRECISE = 7
AMBIGUOUS = 8

AGAINST = 2.0
"""Times the error of a normal that is trusted half, which one against its force has at least: it enters no map."""

# SampleStatus, as plain numbers
_SATURATED = 1
_STALE = 2 | 8
_INVALID = 16 | 64
_UNCONFIRMED = 1 << 16


@kernel
def screen(given, params):
    """Reject a sample by its status flags, by numbers that are not finite, or by a force near zero."""
    status = int(given[I_STATUS])
    if status & _INVALID:
        return INVALID_WRENCH
    for i in range(I_STATUS):
        if not math.isfinite(given[i]):
            return INVALID_WRENCH
    if status & _STALE:
        return STALE
    if status & _SATURATED:
        return SATURATED_AXIS
    if status & _UNCONFIRMED:
        return UNCONFIRMED_JUMP
    if magnitude(given, I_FORCE) < params[P_NEAR_ZERO]:
        return NEAR_ZERO
    return GOOD


@kernel
def magnitude(v, at):
    """Length of the three numbers from `at` on."""
    return math.sqrt(v[at] * v[at] + v[at + 1] * v[at + 1] + v[at + 2] * v[at + 2])


@kernel
def centre_torque(given, params, m):
    """m = (t - c x f) / r, with the sphere's centre c where the bent stick has it."""
    fx, fy, fz = given[0], given[1], given[2]
    cx = params[P_COMPLIANCE] * fx
    cy = params[P_COMPLIANCE + 1] * fy
    cz = params[P_DISTANCE] + params[P_COMPLIANCE + 2] * fz
    r = params[P_RADIUS]
    m[0] = (given[3] - (cy * fz - cz * fy)) / r
    m[1] = (given[4] - (cz * fx - cx * fz)) / r
    m[2] = (given[5] - (cx * fy - cy * fx)) / r


@kernel
def torque_covariance(given, u, params, cov):
    """Covariance (3, 3) of t - p x f over r², p = c + r u: (sT² 1 + sF² (|p|² 1 - p p') + sp² (|f|² 1 - f f')) / r²."""
    p0 = params[P_COMPLIANCE] * given[0] + params[P_RADIUS] * u[0]
    p1 = params[P_COMPLIANCE + 1] * given[1] + params[P_RADIUS] * u[1]
    p2 = params[P_DISTANCE] + params[P_COMPLIANCE + 2] * given[2] + params[P_RADIUS] * u[2]
    rr = params[P_RADIUS] ** 2
    vf = params[P_FORCE_NOISE] ** 2 / rr
    vt = params[P_TORQUE_NOISE] ** 2 / rr
    vp = params[P_LEVER_ERROR] ** 2 / rr
    f0, f1, f2 = given[0], given[1], given[2]
    cov[0, 0] = vt + vf * (p1 * p1 + p2 * p2) + vp * (f1 * f1 + f2 * f2)
    cov[1, 1] = vt + vf * (p0 * p0 + p2 * p2) + vp * (f0 * f0 + f2 * f2)
    cov[2, 2] = vt + vf * (p0 * p0 + p1 * p1) + vp * (f0 * f0 + f1 * f1)
    cov[0, 1] = cov[1, 0] = -vf * p0 * p1 - vp * f0 * f1
    cov[0, 2] = cov[2, 0] = -vf * p0 * p2 - vp * f0 * f2
    cov[1, 2] = cov[2, 1] = -vf * p1 * p2 - vp * f1 * f2


@kernel
def consistent_torque(given, cov, m):
    """The torque nearest to m, in the metric of its covariance, that is perpendicular to the force."""
    s0 = cov[0, 0] * given[0] + cov[0, 1] * given[1] + cov[0, 2] * given[2]
    s1 = cov[1, 0] * given[0] + cov[1, 1] * given[1] + cov[1, 2] * given[2]
    s2 = cov[2, 0] * given[0] + cov[2, 1] * given[1] + cov[2, 2] * given[2]
    whole = s0 * given[0] + s1 * given[1] + s2 * given[2]
    if whole <= 0.0:  # a sensor without noise
        s0, s1, s2 = given[0], given[1], given[2]
        whole = s0 * s0 + s1 * s1 + s2 * s2
    share = (m[0] * given[0] + m[1] * given[1] + m[2] * given[2]) / whole
    m[0] -= s0 * share
    m[1] -= s1 * share
    m[2] -= s2 * share


@kernel
def axis_sine(given, cov, m):
    """Sine of the angle between force and normal that m asks for, and its standard deviation."""
    f = magnitude(given, I_FORCE)
    size = magnitude(m, 0)
    if size == 0.0:
        return 0.0, math.sqrt((cov[0, 0] + cov[1, 1] + cov[2, 2]) / 3.0) / f
    spread = 0.0
    for i in range(3):
        for j in range(3):
            spread += m[i] * cov[i, j] * m[j]
    return size / f, math.sqrt(max(spread, 0.0)) / (size * f)


@kernel
def meet_sphere(given, m, limit, u):
    """Where the line of action enters the sphere: u = f x m / f² - f/|f| cos, with |m|/|f| = sin held under `limit`."""
    f0, f1, f2 = given[0], given[1], given[2]
    ff = f0 * f0 + f1 * f1 + f2 * f2
    f = math.sqrt(ff)
    sine = magnitude(m, 0) / f
    shrink = limit / sine if sine > limit else 1.0
    sine = min(sine, limit)
    cosine = math.sqrt(1.0 - sine * sine)
    u[0] = (f1 * m[2] - f2 * m[1]) * shrink / ff - f0 / f * cosine
    u[1] = (f2 * m[0] - f0 * m[2]) * shrink / ff - f1 / f * cosine
    u[2] = (f0 * m[1] - f1 * m[0]) * shrink / ff - f2 / f * cosine


@kernel
def axis_information(given, u, cov, info):
    """Information (3, 3) about u from m = u x f: P [f]x' C⁻¹ [f]x P, C the covariance of m, P = 1 - u u'."""
    inv = invert(cov)
    f0, f1, f2 = given[0], given[1], given[2]
    # rows of [f]x times the inverse, then times [f]x again
    a0, a1, a2 = inv[1] * f2 - inv[2] * f1, inv[3] * f2 - inv[4] * f1, inv[4] * f2 - inv[5] * f1
    b0, b1, b2 = inv[2] * f0 - inv[0] * f2, inv[4] * f0 - inv[1] * f2, inv[5] * f0 - inv[2] * f2
    c0, c1 = inv[0] * f1 - inv[1] * f0, inv[1] * f1 - inv[3] * f0
    info[0, 0] = a1 * f2 - a2 * f1
    info[0, 1] = info[1, 0] = a2 * f0 - a0 * f2
    info[0, 2] = info[2, 0] = a0 * f1 - a1 * f0
    info[1, 1] = b2 * f0 - b0 * f2
    info[1, 2] = info[2, 1] = b0 * f1 - b1 * f0
    info[2, 2] = c0 * f1 - c1 * f0
    project(info, u)


@kernel
def project(info, n):
    """info <- P info P with P = 1 - n n': the information about rotations of n."""
    t0 = info[0, 0] * n[0] + info[0, 1] * n[1] + info[0, 2] * n[2]
    t1 = info[1, 0] * n[0] + info[1, 1] * n[1] + info[1, 2] * n[2]
    t2 = info[2, 0] * n[0] + info[2, 1] * n[1] + info[2, 2] * n[2]
    half = 0.5 * (t0 * n[0] + t1 * n[1] + t2 * n[2])
    t0, t1, t2 = t0 - half * n[0], t1 - half * n[1], t2 - half * n[2]
    info[0, 0] -= 2.0 * t0 * n[0]
    info[1, 1] -= 2.0 * t1 * n[1]
    info[2, 2] -= 2.0 * t2 * n[2]
    info[0, 1] -= t0 * n[1] + n[0] * t1
    info[0, 2] -= t0 * n[2] + n[0] * t2
    info[1, 2] -= t1 * n[2] + n[1] * t2
    info[1, 0], info[2, 0], info[2, 1] = info[0, 1], info[0, 2], info[1, 2]


@kernel
def cross(a0, a1, a2, b0, b1, b2):
    """a x b."""
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@kernel
def invert(s):
    """Inverse of a symmetric (3, 3) as its six numbers 00 01 02 11 12 22; a vanishing one gives a huge inverse."""
    floor = 1e-18 + 1e-12 * (s[0, 0] + s[1, 1] + s[2, 2])
    a, b, c, d, e, f = s[0, 0] + floor, s[0, 1], s[0, 2], s[1, 1] + floor, s[1, 2], s[2, 2] + floor
    c0, c1, c2 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * c0 + b * c1 + c * c2
    return c0 / det, c1 / det, c2 / det, (a * f - c * c) / det, (b * c - a * e) / det, (a * d - b * b) / det


@kernel
def tangent_spread(info, u):
    """Root mean square error of u from its information in the tangent plane: sqrt(trace of the 2 x 2 inverse)."""
    # With J of rank 2 on the plane, trace of the inverse = trace / determinant there; with P = 1 - u u':
    # trace = tr(PJ), determinant = u' adj(J) u.
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += ((1.0 if i == j else 0.0) - u[i] * u[j]) * info[i, j]
    a, b, c, d, e, f = info[0, 0], info[0, 1], info[0, 2], info[1, 1], info[1, 2], info[2, 2]
    det = (
        u[0] * u[0] * (d * f - e * e)
        + u[1] * u[1] * (a * f - c * c)
        + u[2] * u[2] * (a * d - b * b)
        + 2.0 * u[0] * u[1] * (c * e - b * f)
        + 2.0 * u[0] * u[2] * (b * e - c * d)
        + 2.0 * u[1] * u[2] * (b * c - a * e)
    )
    return math.sqrt(max(trace, 0.0) / det) if det > 0.0 else math.pi


@kernel
def rotate(given, v, out, at):
    """World components of a sensor-frame vector."""
    r = I_ROTATION
    for i in range(3):
        out[at + i] = given[r + 3 * i] * v[0] + given[r + 3 * i + 1] * v[1] + given[r + 3 * i + 2] * v[2]


@kernel
def deliver(given, u, sigma, params, out):
    """Fill the output from u in the sensor frame; see `deliver_world`."""
    rotate(given, given, out, O_FORCE)
    rotate(given, u, out, O_NORMAL)
    for i in range(3):
        out[O_NORMAL + i] = -out[O_NORMAL + i]
    return deliver_world(given, out[O_NORMAL : O_NORMAL + 3], sigma, params, out)


@kernel
def confidence_of(sigma, params):
    """1 for an exact normal, one half for an error of the trusted size, rad."""
    ratio = sigma / params[P_TRUSTED_ERROR]
    return 1.0 / (1.0 + ratio * ratio)


@kernel
def deliver_world(given, normal, sigma, params, out):
    """Fill point, normal and confidence; the force is set already. Returns IMPRECISE for a large sigma, else GOOD.

    The undeformed surface is nearer to the centre than the radius, by indentation times force. A surface only pushes:
    where the force is so small that the normal came out against it, its own direction is the better guess.
    """
    push, size = 0.0, magnitude(out, O_FORCE)
    for i in range(3):
        push += normal[i] * out[O_FORCE + i]
    against = push < 0.0
    if against:
        push, sigma = size, max(sigma, AGAINST * params[P_TRUSTED_ERROR])
    reach = params[P_RADIUS] - params[P_INDENTATION] * push
    for i in range(3):
        along = out[O_FORCE + i] / size if against else normal[i]
        out[O_NORMAL + i] = along
        out[O_POINT + i] = given[I_CENTRE + i] - reach * along
    out[O_SIGMA] = sigma
    out[O_CONFIDENCE] = confidence = confidence_of(sigma, params)
    return IMPRECISE if confidence < 0.5 else GOOD


@kernel
def refuse(given, reason, params, out):
    """Output of a sample without a contact point: the normal along the force if there is one, confidence 0.

    The point is the one of the sphere in that direction, or the origin where the centre is not finite.
    """
    rotate(given, given, out, O_FORCE)
    size = magnitude(out, O_FORCE)
    if not math.isfinite(size):
        size = 0.0
        for i in range(3):
            out[O_FORCE + i] = 0.0
    placed = math.isfinite(magnitude(given, I_CENTRE))
    for i in range(3):
        out[O_NORMAL + i] = out[O_FORCE + i] / size if size > 0.0 else 0.0
        out[O_POINT + i] = given[I_CENTRE + i] - params[P_RADIUS] * out[O_NORMAL + i] if placed else 0.0
    out[O_CONFIDENCE] = 0.0
    out[O_SIGMA] = math.pi
    return reason


@kernel
def prepare(given, params, u, m, cov):
    """u against the force, the torque m about the centre, and its covariance there without the drift of the zero."""
    f = magnitude(given, I_FORCE)
    for i in range(3):
        u[i] = -given[i] / f
    centre_torque(given, params, m)
    torque_covariance(given, u, params, cov)


@kernel
def add_zero_variance(params, cov):
    """Add the drift of the sensor's zero to the covariance of m."""
    cov[0, 0] += params[P_ZERO_ACROSS]
    cov[1, 1] += params[P_ZERO_ACROSS]
    cov[2, 2] += params[P_ZERO_ALONG]


@kernel
def check_axis(given, params, m, cov):
    """Make m consistent with the force; AXIS_MISSES if no contact on the sphere explains it."""
    consistent_torque(given, cov, m)
    sine, spread = axis_sine(given, cov, m)
    return AXIS_MISSES if sine > params[P_MAX_SINE] + 3.0 * spread else GOOD


@kernel
def force_direction(given, params, out):
    """The normal is the direction of the force: no friction assumed."""
    reason = screen(given, params)
    if reason != GOOD:
        return refuse(given, reason, params, out)
    u, m, cov = np.empty(3), np.empty(3), np.empty((3, 3))
    prepare(given, params, u, m, cov)
    add_zero_variance(params, cov)
    reason = check_axis(given, params, m, cov)
    if reason != GOOD:
        return refuse(given, reason, params, out)
    sigma = math.sqrt(2.0) * params[P_FORCE_NOISE] / magnitude(given, I_FORCE)
    return deliver(given, u, sigma, params, out)


@kernel
def wrench_axis(given, params, out):
    """The contact is where the line of action of the wrench enters the sphere."""
    reason = screen(given, params)
    if reason != GOOD:
        return refuse(given, reason, params, out)
    u, m, cov, info = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    prepare(given, params, u, m, cov)
    add_zero_variance(params, cov)
    reason = check_axis(given, params, m, cov)
    if reason != GOOD:
        return refuse(given, reason, params, out)
    meet_sphere(given, m, params[P_MAX_SINE], u)
    torque_covariance(given, u, params, cov)
    add_zero_variance(params, cov)
    axis_information(given, u, cov, info)
    return deliver(given, u, tangent_spread(info, u), params, out)
