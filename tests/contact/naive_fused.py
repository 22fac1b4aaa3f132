"""Textbook forms of the kernels of `fused_kernels`: the same formulas with matrices, named fields and numpy's algebra.

A function that changes the memory does so in the `Memory` that it is given; everything else is returned.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from naive_contact import cross_matrix, unit

from lwrprobe.contact import fused_kernels as fk
from lwrprobe.contact import kernels as k

GATE = 13.8  # 0.1 % quantile of chi-squared with two degrees of freedom
GIVEN = {
    "force": (k.I_FORCE, (3,)), "torque": (k.I_TORQUE, (3,)), "centre": (k.I_CENTRE, (3,)),
    "velocity": (k.I_VELOCITY, (3,)), "rotation": (k.I_ROTATION, (3, 3)), "status": (k.I_STATUS, ()),
    "time": (k.I_TIME, ()), "zeroing": (k.I_ZEROING, ()),
}  # fmt: skip
PARAMS = {
    "radius": (k.P_RADIUS, ()), "distance": (k.P_DISTANCE, ()), "compliance": (k.P_COMPLIANCE, (3,)),
    "force_noise": (k.P_FORCE_NOISE, ()), "torque_noise": (k.P_TORQUE_NOISE, ()), "near_zero": (k.P_NEAR_ZERO, ()),
    "max_sine": (k.P_MAX_SINE, ()), "trusted_error": (k.P_TRUSTED_ERROR, ()), "lever_error": (k.P_LEVER_ERROR, ()),
    "indentation": (k.P_INDENTATION, ()), "zero_across": (k.P_ZERO_ACROSS, ()), "zero_along": (k.P_ZERO_ALONG, ()),
    "speed_noise": (fk.P_SPEED_NOISE, ()), "slip_angle": (fk.P_SLIP_ANGLE, ()), "min_speed": (fk.P_MIN_SPEED, ()),
    "hidden_compliance": (fk.P_HIDDEN_COMPLIANCE, ()), "memory": (fk.P_MEMORY, ()),
    "wall_clearance": (fk.P_WALL_CLEARANCE, ()), "zero_time": (fk.P_ZERO_TIME, ()),
    "lag": (fk.P_LAG, ()),
}  # fmt: skip
MEMORY = {
    "begun": (fk.S_BEGUN, ()), "time": (fk.S_TIME, ()), "force": (fk.S_FORCE, ()), "centre": (fk.S_CENTRE, (3,)),
    "normal": (fk.S_NORMAL, (3,)), "info": (fk.S_INFO, (3, 3)), "friction": (fk.S_FRICTION, ()),
    "friction_var": (fk.S_FRICTION_VAR, ()), "rotation": (fk.S_ROTATION, (3, 3)), "mismatch": (fk.S_MISMATCH, (3,)),
    "ambiguous": (fk.S_AMBIGUOUS, ()), "anchor": (fk.S_ANCHOR, (3,)), "wall": (fk.S_WALL, (3,)),
    "path": (fk.S_PATH, ()), "streak": (fk.S_STREAK, ()), "turn": (fk.S_TURN, (3,)), "before": (fk.S_BEFORE, (3,)),
    "offset": (fk.S_OFFSET, (3,)), "offset_cov": (fk.S_OFFSET_COV, (3, 3)), "offset_time": (fk.S_OFFSET_TIME, ()),
    "zeroing": (fk.S_ZEROING, ()), "velocity": (fk.S_VELOCITY, (3,)), "speed_var": (fk.S_SPEED_VAR, ()),
    "turn_way": (fk.S_TURN_PATH, ()), "ring_time": (fk.S_RING_TIME, ()), "head": (fk.S_HEAD, ()),
    "otherwise": (fk.S_OTHERWISE, ()),
    "slip": (fk.S_SLIP, (3,)), "axis": (fk.S_AXIS, ()),
    "load": (fk.S_LOAD, (2,)), "lag": (fk.S_LAG, (2,)), "lag_learnt": (fk.S_LAG_LEARNT, (2,)),
    "ring": (fk.S_RING, (fk.RING, fk.ROW)),
}  # fmt: skip


def unpack(row, layout):
    """A kernel's array as named numbers, vectors and matrices."""
    parts = {}
    for name, (at, shape) in layout.items():
        parts[name] = row[at : at + int(np.prod(shape))].reshape(shape).copy() if shape else float(row[at])
    return SimpleNamespace(**parts)


def pack(parts, layout, size):
    """The array of `unpack`."""
    row = np.zeros(size)
    for name, (at, shape) in layout.items():
        row[at : at + int(np.prod(shape))] = np.ravel(getattr(parts, name))
    return row


# --- geometry


def tangent_basis(n):
    """(3, 2), two orthonormal directions across n."""
    return np.linalg.svd(n.reshape(1, 3))[2][1:].T


def projected(info, n):
    p = np.eye(3) - np.outer(n, n)
    return p @ info @ p


def inverse(s):
    return np.linalg.inv(s + (1e-18 + 1e-12 * np.trace(s)) * np.eye(3))


def tangent_spread(info, n):
    basis = tangent_basis(n)
    plane = basis.T @ info @ basis
    det = np.linalg.det(plane)
    return np.sqrt(max(np.trace(plane), 0.0) / det) if det > 0.0 else np.pi


def adjugate(a):
    return np.array([np.cross(a[1], a[2]), np.cross(a[2], a[0]), np.cross(a[0], a[1])]).T


def smallest_direction(total, normal):
    """Three steps of inverse iteration from `normal`."""
    adj = adjugate(total / np.trace(total))
    x = normal
    for _ in range(3):
        if not np.linalg.norm(adj @ x) > 0.0:
            return normal
        x = unit(adj @ x)
    return x if x @ normal >= 0.0 else -x


def eigen_direction(total, normal):
    """What the inverse iteration tends to."""
    x = np.linalg.eigh(total)[1][:, 0]
    return x if x @ normal >= 0.0 else -x


def spread(info, n, variance):
    """(J⁻¹ + q)⁻¹ in the tangent plane."""
    basis = tangent_basis(n)
    plane = basis.T @ info @ basis
    return basis @ plane @ np.linalg.inv(np.eye(2) + variance * plane) @ basis.T


def chi_squared(d, info, gain, v, variance):
    """d' (C + q v v')⁻¹ d as a least squares problem: the smallest |d - a v|² in the metric of C⁻¹, plus a² / q."""
    j = gain * info
    a = variance * (v @ j @ d) / (1.0 + variance * (v @ j @ v))
    return (d - a * v) @ j @ (d - a * v) + (a * a / variance if variance > 0.0 else 0.0)


# --- the wrench axis


def screen(g, p):
    status = int(g.status)
    numbers = np.concatenate([g.force, g.torque, g.centre, g.velocity, g.rotation.ravel()])
    if status & (16 | 64) or not np.isfinite(numbers).all():
        return k.INVALID_WRENCH
    for flags, reason in ((2 | 8, k.STALE), (1, k.SATURATED_AXIS), (1 << 16, k.UNCONFIRMED_JUMP)):
        if status & flags:
            return reason
    return k.NEAR_ZERO if np.linalg.norm(g.force) < p.near_zero else k.GOOD


def lever(g, p):
    return np.array([0.0, 0.0, p.distance]) + p.compliance * g.force


def torque_covariance(g, u, p):
    arm, f = cross_matrix(lever(g, p) + p.radius * u), cross_matrix(g.force)
    noise = p.torque_noise**2 * np.eye(3) + p.force_noise**2 * arm @ arm.T + p.lever_error**2 * f @ f.T
    return noise / p.radius**2


def consistent_torque(g, cov, m):
    along = cov @ g.force if g.force @ cov @ g.force > 0.0 else g.force
    return m - along * (m @ g.force) / (along @ g.force)


def check_axis(g, p, m, cov):
    f, m = g.force, consistent_torque(g, cov, m)
    size, force = np.linalg.norm(m), np.linalg.norm(f)
    sigma = np.sqrt(max(unit(m) @ cov @ unit(m), 0.0) if size > 0.0 else np.trace(cov) / 3.0) / force
    return m, k.AXIS_MISSES if size / force > p.max_sine + 3.0 * sigma else k.GOOD


def meet_sphere(g, p, m):
    force = np.linalg.norm(g.force)
    sine = np.linalg.norm(m) / force
    if sine > p.max_sine:
        m, sine = m * p.max_sine / sine, p.max_sine
    return np.cross(g.force, m) / force**2 - unit(g.force) * np.sqrt(1.0 - sine**2)


def axis_information(g, u, cov):
    f = cross_matrix(g.force)
    return projected(f.T @ inverse(cov) @ f, u)


def to_world(g, u, info):
    return -g.rotation @ u, g.rotation @ info @ g.rotation.T


# --- the drift of the sensor's zero


def first_offset_cov(p):
    return np.diag([p.zero_across, p.zero_across, p.zero_along])


def age_offset(g, p, s):
    if s.offset_cov[0, 0] <= 0.0 or s.zeroing != g.zeroing:
        s.offset, s.offset_cov, s.zeroing = np.zeros(3), first_offset_cov(p), g.zeroing
        s.lag, s.lag_learnt = np.zeros(2), np.zeros(2)
    else:
        loosen_offset(p, s, np.clip((g.time - s.offset_time) / p.zero_time, 0.0, 1.0))
        turn_load(g, p, s)
    s.load, s.offset_time = g.force[:2], g.time


def turn_load(g, p, s):
    """A play operator of width `lag`; the covariance is at least the first one's share that it has turned by."""
    if p.lag == 0.0:
        return
    s.lag = np.clip(s.lag + g.force[:2] - s.load, -0.5 * p.lag, 0.5 * p.lag)
    least = min(np.sum(((s.lag - s.lag_learnt) / p.lag) ** 2), 1.0)
    known = np.trace(s.offset_cov[:2, :2]) / np.trace(first_offset_cov(p)[:2, :2])
    if least > known:
        loosen_offset(p, s, (least - known) / (1.0 - known))


def loosen_offset(p, s, share):
    s.offset_cov = (1.0 - share) * s.offset_cov + share * first_offset_cov(p)


def add_offset(s, raw, cov):
    whole = cov + s.offset_cov
    return raw - s.offset, whole, np.trace(s.offset_cov) / (np.trace(whole) + 1e-300)


def common_share(p, total, common):
    return min(1.0, common + 0.5 * np.trace(total) * (p.lever_error / p.radius) ** 2)


def shared_error(axis, sigma, known, common):
    """N samples of variance axis², of which the share `common` is one and the same number, weigh `known` sigma²."""
    count = max(known * axis**2, 1.0)
    together = common + (1.0 - common) / count
    return min(known * sigma**2, 1.0) * axis * np.sqrt(together - 1.0 / count)


def doubt_memory(s, axis, common):
    error = shared_error(axis, tangent_spread(s.info, s.normal), s.axis, common)
    spread_memory(s, 0.5 * error**2)


def spread_memory(s, variance):
    """The part of the information that came from axes falls as the mean square error grows."""
    before = tangent_spread(s.info, s.normal) ** 2
    s.info = spread(s.info, s.normal, variance)
    if s.info.any():
        s.axis *= before / tangent_spread(s.info, s.normal) ** 2


def learn_offset(g, p, s, raw, cov, force):
    """Kalman filter of a constant: measurement raw - u x f, covariance S, gain P S⁻¹."""
    speed = np.linalg.norm(g.velocity)
    if s.streak < 4.0 or speed < p.min_speed:
        return
    n, _, _ = sliding_normal(force, g.velocity)
    measured = raw - contact_torque(g, n)
    if not wanders_so_far(p, s, cov, measured):
        return
    innovation = measured - s.offset
    precision = inverse_with(cov, s.speed_var * (np.linalg.norm(g.force) / speed) ** 2)
    gain = s.offset_cov @ precision
    offset = s.offset + gain @ innovation
    if innovation @ precision @ innovation > 16.3:
        return
    s.offset = offset
    before, s.offset_cov = s.offset_cov, s.offset_cov - gain @ s.offset_cov
    fresh = 1.0 - np.trace(s.offset_cov[:2, :2]) / max(np.trace(before[:2, :2]), 1e-300)
    s.lag_learnt = s.lag_learnt + fresh * (s.lag - s.lag_learnt)


def wanders_so_far(p, s, cov, offset):
    return offset @ inverse(cov - s.offset_cov + first_offset_cov(p)) @ offset <= 16.3


def contact_torque(g, n):
    return np.cross(-g.rotation.T @ n, g.force)


def inverse_with(cov, variance):
    return inverse(cov + variance * np.eye(3))


# --- what moves on from sample to sample


def advance(g, p, s):
    if s.begun == 0.0:
        return 0.0
    dt, travel = g.time - s.time, np.linalg.norm(g.centre - s.centre)
    if not 0.0 < dt <= p.memory or travel > p.radius:
        s.begun = 0.0
        return 0.0
    predict(s, travel)
    spread_memory(s, (0.5 * travel / p.radius) ** 2 + 0.019**2 * dt)
    s.path += travel
    s.friction_var += (0.05 * travel / 0.01) ** 2
    return travel


def predict(s, travel):
    s.normal = unit(s.normal + s.turn * travel)
    s.info = projected(s.info, s.normal)


def watch_velocity(g, p, s):
    change = np.sum((g.velocity - s.velocity) ** 2)
    s.velocity = g.velocity
    if s.begun != 0.0:
        s.speed_var = max(p.speed_noise**2, 0.9 * s.speed_var + 0.1 * change / 6.0)
    else:
        s.speed_var = p.speed_noise**2


def learn_turn(s, normal, sigma, travel, radius):
    s.turn_way += travel
    if s.turn_way < max(1e-4, 4.0 * sigma * radius):
        return
    share = min(0.2, 1.0 - np.exp(-s.turn_way / 6e-4))
    s.turn = (1.0 - share) * s.turn + share * (normal - s.before) / s.turn_way
    s.turn = s.turn / max(1.0, np.linalg.norm(s.turn) * radius)
    s.before, s.turn_way = normal, 0.0


# --- sliding and friction


def sliding_normal(force, velocity):
    """(normal, friction along the motion, length before scaling): the part of the force across the velocity."""
    v = unit(velocity)
    across = force - (force @ v) * v
    size = np.linalg.norm(across)
    return across / max(size, 1e-300), force @ v, size


def slip_velocity(g, s, normal, p):
    """(unit slip direction, slip speed): v + w x (-r n)."""
    w, dt = np.zeros(3), g.time - s.time
    if s.begun != 0.0 and dt > 0.0:
        turn = g.rotation @ s.rotation.T
        skew = 0.5 * (turn - turn.T) / dt
        w = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    slip = g.velocity + np.cross(w, -p.radius * normal)
    speed = np.linalg.norm(slip)
    return (slip / speed if speed > 0.0 else slip), speed


def sliding_agrees(g, p, s, m, cov, normal, total, force, speed, noise, common):
    if speed < p.min_speed:
        return True
    n, along, size = sliding_normal(force, g.velocity)
    aim = (noise / speed) ** 2 + p.slip_angle**2
    if size <= 0.0 or along > 3.0 * (p.force_noise + size * np.sqrt(aim)):
        return False
    v, d = unit(g.velocity), n - normal
    s.mismatch = 0.85 * s.mismatch + 0.15 * d
    excess = m - contact_torque(g, n)
    if excess @ inverse_with(cov, aim * (g.force @ g.force)) @ excess > GATE:
        return False
    # an exponential mean of weight a has a / (2 - a) of the variance of one independent sample
    gain = 1.0 / (common + (1.0 - common) * 0.15 / (2.0 - 0.15))
    return chi_squared(s.mismatch, total, gain, v, aim) < GATE


def add_sliding(g, p, s, m, cov, normal, total, force, travel, common):
    """(how the sphere moves along the surface, total, slip)."""
    speed, dt = np.linalg.norm(g.velocity), g.time - s.time
    slip, slip_speed = slip_velocity(g, s, normal, p)
    if s.begun == 0.0 or slip_speed < p.min_speed or travel < 0.3 * speed * dt:
        s.streak = 0.0
        return fk.RESTS, total, slip
    size = np.linalg.norm(g.force)
    change = abs(size - s.force)
    across = np.cross(force / size, slip)
    sine = np.linalg.norm(across)
    if change > 12.0 * size * dt + 4.0 * p.force_noise:
        return fk.SLIPS if sine >= 0.4 and slip @ s.slip > 0.87 else fk.RESTS, total, slip
    noise = np.hypot(np.sqrt(s.speed_var), change / max(dt, 1e-6) * p.hidden_compliance)
    if sine < 0.4 or not sliding_agrees(g, p, s, m, cov, normal, total, force, speed, noise, common):
        loosen_offset(p, s, 0.02)
        if s.streak > 0.0:
            s.axis = 0.0
            s.info = np.zeros((3, 3))
        s.streak = 0.0
        return fk.RESTS, total, slip
    s.streak = s.streak + 1.0 if slip @ s.slip > 0.87 else 1.0
    s.slip = slip.copy()
    if speed >= p.min_speed:
        v = unit(g.velocity)
        total = total + np.outer(v, v) / ((noise / speed) ** 2 + p.slip_angle**2)
    aim = (noise / slip_speed) ** 2 + p.slip_angle**2
    variance = (p.force_noise / size) ** 2 + max(0.0, 1.0 - sine**2) * aim
    return fk.SLIDES, total + np.outer(unit(across), unit(across)) / (variance + 1e-12), slip


def add_friction(g, p, mu, mu_var, sliding, slip, total, force):
    f, noise = force / np.linalg.norm(g.force), (p.force_noise / np.linalg.norm(g.force)) ** 2
    if not sliding:
        phi = np.arctan(mu + np.sqrt(mu_var))
        return total + (np.eye(3) - np.outer(f, f)) / (noise + phi**2)
    # the direction that is perpendicular to the normal if the friction angle is phi
    direction = -np.sin(np.arctan(mu)) * f + np.cos(np.arctan(mu)) * unit(slip - (f @ slip) * f)
    return total + np.outer(direction, direction) / (noise + mu_var / (1.0 + mu**2) ** 2 + 1e-12)


def learn_friction(p, s, normal, total, slip, force):
    push, off = force @ normal, slip @ normal
    if push <= 0.0 or s.streak < 8.0:
        return
    seen = (-force @ slip + off * push) / (np.sqrt(max(1.0 - off**2, 1e-6)) * push)
    sigma = tangent_spread(total, normal)
    variance = (p.force_noise / push) ** 2 + (sigma * (1.0 + seen**2)) ** 2 + 1e-10
    gain = s.friction_var / (s.friction_var + variance)
    s.friction, s.friction_var = max(0.0, s.friction + gain * (seen - s.friction)), (1.0 - gain) * s.friction_var


# --- the memory of the surface


def add_memory(s, normal, total):
    if s.begun == 0.0:
        s.axis = 0.0
        return total
    d = smallest_direction(total, normal) - s.normal
    own, kept = d @ total @ d, d @ s.info @ d
    weight = (GATE * (own + kept) / (own * kept)) ** 2 if own * kept > GATE * (own + kept) else 1.0
    s.axis *= weight
    return total + weight * s.info


def remember(g, p, s, normal, total, travel):
    """The information that is left: about turns of the normal."""
    s.info = projected(total, normal)
    if s.begun != 0.0:
        learn_turn(s, normal, tangent_spread(s.info, normal), travel, p.radius)
    s.normal, s.centre, s.rotation = normal, g.centre, g.rotation
    s.time, s.force = g.time, np.linalg.norm(g.force)
    if s.begun == 0.0:
        s.path = s.head = s.ambiguous = s.turn_way = 0.0
        s.mismatch, s.turn, s.before = np.zeros(3), np.zeros(3), normal
        s.begun = 1.0
    return s.info


def ambiguous(g, p, s, normal, sigma):
    if s.ambiguous != 0.0:
        if normal @ s.wall < np.cos(0.1):
            s.otherwise = s.path
        if abs((g.centre - s.anchor) @ s.wall) > p.wall_clearance or s.path - s.otherwise > 1e-3:
            s.ambiguous = s.head = 0.0
    else:
        find_jump(g, p, s, normal, sigma)
    if s.head == 0.0 or not 0.0 <= g.time - s.ring_time < 0.006:
        s.ring_time = g.time
        s.ring[int(s.head) % fk.RING] = [s.path, *normal, sigma]
        s.head += 1
    return s.ambiguous != 0.0


def find_jump(g, p, s, normal, sigma):
    for path, *before, error in s.ring[: int(min(s.head, fk.RING))]:
        turned = np.arccos(np.clip(normal @ before, -1.0, 1.0))
        if turned > (s.path - path) / p.radius + 3.0 * np.hypot(sigma, error) + 0.26:
            s.ambiguous, s.anchor, s.wall, s.otherwise = 1.0, g.centre, np.array(before), s.path
            return


# --- one sample


def refuse(g, p, reason):
    force = g.rotation @ g.force
    if not np.isfinite(np.linalg.norm(force)):
        force = np.zeros(3)
    normal = unit(force) if force.any() else force
    point = g.centre - p.radius * normal if np.isfinite(g.centre).all() else np.zeros(3)
    return reason, np.concatenate([point, normal, force, [0.0, np.pi]])


def deliver(g, p, normal, sigma, force):
    point = g.centre - (p.radius - p.indentation * max(normal @ force, 0.0)) * normal
    confidence = 1.0 / (1.0 + (sigma / p.trusted_error) ** 2)
    return k.IMPRECISE if confidence < 0.5 else k.GOOD, np.concatenate([point, normal, force, [confidence, sigma]])


def fused(g, p, s):
    """(reason, output row)."""
    reason = screen(g, p)
    if reason != k.GOOD:
        return refuse(g, p, reason)
    age_offset(g, p, s)
    raw = (g.torque - np.cross(lever(g, p), g.force)) / p.radius
    m, cov, _ = add_offset(s, raw, torque_covariance(g, -unit(g.force), p))
    m, reason = check_axis(g, p, m, cov)
    if reason != k.GOOD:
        return refuse(g, p, reason)
    u = meet_sphere(g, p, m)
    m, cov, common = add_offset(s, raw, torque_covariance(g, u, p))
    normal, total = to_world(g, u, axis_information(g, u, cov))
    axis, common = tangent_spread(total, normal), common_share(p, total, common)
    force = g.rotation @ g.force
    travel = advance(g, p, s)
    watch_velocity(g, p, s)
    m = consistent_torque(g, cov, m)
    motion, total, slip = add_sliding(g, p, s, m, cov, normal, total, force, travel, common)
    sliding = motion == fk.SLIDES
    if sliding:
        learn_offset(g, p, s, raw, cov, force)
        doubt_memory(s, axis, common)
    total = add_memory(s, normal, total)
    s.axis += 1.0 / axis**2
    normal = smallest_direction(total, normal)
    total = remember(g, p, s, normal, total, travel)
    mu, mu_var = s.friction, s.friction_var
    if sliding:
        learn_friction(p, s, normal, total, slip, force)
    if motion == fk.SLIPS:
        total = add_friction(g, p, mu, mu_var + 0.01 * mu**2, True, slip, total, force)
    else:
        total = add_friction(g, p, mu, mu_var, sliding and s.streak >= 4.0, slip, total, force)
    normal = smallest_direction(total, normal)
    own = tangent_spread(total, normal)
    sigma = np.hypot(own, shared_error(axis, own, s.axis, common))
    reason, row = deliver(g, p, normal, sigma, force)
    if row[k.O_SIGMA] <= sigma:
        row[k.O_CONFIDENCE] = max(row[k.O_CONFIDENCE], min(1.0 / (1.0 + (own / p.trusted_error) ** 2), 0.4))
    if ambiguous(g, p, s, normal, sigma):
        reason, row[k.O_CONFIDENCE] = k.AMBIGUOUS, 0.3
    return reason, row
