"""The contact step: several elastic contacts with Coulomb friction behind one common compliance.

Stick, joints and inertia behind the sphere appear in one time step as an affine law: the sphere's centre goes to
`free + G f`, with f the sum of the contact forces and G a symmetric 3x3 compliance, which may be zero (rigid) in any
direction. Each contact is a spring and a damper along its normal, pressing only, and along its tangent a spring that
slips at the friction limit. All forces are taken at the end of the step (backward Euler), so that no stiffness and no
damping can make the step unstable and no energy is created.

A contact is one row of a (n, WIDTH) array, columns as named below.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel

CENTRE = 0  # 3, of the round body that touches, at its reference place [m]
NORMAL = 3  # 3, out of the surface
GAP = 6  # surface to surface at the reference place of the centre, < 0 inside [m]
STIFFNESS = 7  # N/m
DAMPING = 8  # N s/m
STATIC = 9  # friction coefficient that holds
SLIDING = 10  # friction coefficient while slipping, <= STATIC
SHEAR = 11  # tangential stiffness [N/m]
BRISTLE = 12  # 3, elastic tangential displacement if the centre stays at the reference place [m]
PENETRATION = 15  # at the start of the step, >= 0 [m]
LEVER = 16  # share of the sphere's displacement that this contact takes part in (1 on the sphere)
BODY = 17  # which object is touched
FORCE = 18  # 3, out: on the probe [N]
PRESS = 21  # out: normal part of the force [N]
SLIP = 22  # speed of slip [m/s]; in: of the last step, out: of this one
LIMIT = 23  # friction coefficient in force in this step
FIXED_LIMIT = 24  # friction limit that is held fixed while the normal force is computed [N]; < 0: LIMIT * PRESS
RADIUS = 25  # of the round body that touches [m]
FRICTION_SINE = 26  # sine of the angle about the normal between friction and the opposite of the slip
WIDTH = 27

_TOLERANCE = 1e-9  # relative to the free displacement
_ROUNDING = 1e-13  # m, residual that only rounding is left in
_ITERATIONS = 60  # of Newton's method
_FIXED_POINT_ITERATIONS = 20  # of the friction limits


@kernel
def contact_force(c, i, x0, x1, x2, step):
    """Force of contact row `i` with the centre displaced by x; fills FORCE and PRESS; returns True while slipping."""
    a = c[i, LEVER]
    n0, n1, n2 = c[i, NORMAL], c[i, NORMAL + 1], c[i, NORMAL + 2]
    along = n0 * x0 + n1 * x1 + n2 * x2
    depth = -(c[i, GAP] + a * along)
    press = 0.0
    if depth > 0.0:
        rate = c[i, DAMPING] / step
        press = max(0.0, (c[i, STIFFNESS] + rate) * depth - rate * c[i, PENETRATION])
    c[i, PRESS] = press
    c[i, FORCE] = press * n0
    c[i, FORCE + 1] = press * n1
    c[i, FORCE + 2] = press * n2
    limit = c[i, LIMIT] * press if c[i, FIXED_LIMIT] < 0.0 else c[i, FIXED_LIMIT]
    if limit <= 0.0 or press <= 0.0:
        return True
    s0 = c[i, BRISTLE] + a * (x0 - along * n0)
    s1 = c[i, BRISTLE + 1] + a * (x1 - along * n1)
    s2 = c[i, BRISTLE + 2] + a * (x2 - along * n2)
    stretch = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    slipping = c[i, SHEAR] * stretch > limit
    grip = limit / stretch if slipping else c[i, SHEAR]
    if c[i, FRICTION_SINE] != 0.0:
        s0, s1, s2 = turned(n0, n1, n2, s0, s1, s2, c[i, FRICTION_SINE])
    c[i, FORCE] -= grip * s0
    c[i, FORCE + 1] -= grip * s1
    c[i, FORCE + 2] -= grip * s2
    return slipping


@kernel
def turned(n0, n1, n2, s0, s1, s2, sine):
    """The tangential vector s turned about the unit normal n by the angle with that sine (at most a quarter turn)."""
    cosine = math.sqrt(1.0 - sine * sine)
    return (
        cosine * s0 + sine * (n1 * s2 - n2 * s1),
        cosine * s1 + sine * (n2 * s0 - n0 * s2),
        cosine * s2 + sine * (n0 * s1 - n1 * s0),
    )


@kernel
def add_tangent_stiffness(c, i, x0, x1, x2, step, out):
    """Add minus the derivative of contact `i`'s force by the centre's displacement, times its lever, to `out` (3, 3).

    The derivative of the branch (open, sticking, slipping) that holds at x: Newton's method on a piecewise smooth law.
    """
    slipping = contact_force(c, i, x0, x1, x2, step)
    press = c[i, PRESS]
    if press <= 0.0:
        return
    a2 = c[i, LEVER] * c[i, LEVER]
    n0, n1, n2 = c[i, NORMAL], c[i, NORMAL + 1], c[i, NORMAL + 2]
    k = a2 * (c[i, STIFFNESS] + c[i, DAMPING] / step)
    mu = c[i, LIMIT] if c[i, FIXED_LIMIT] < 0.0 else 0.0
    limit = mu * press if c[i, FIXED_LIMIT] < 0.0 else c[i, FIXED_LIMIT]
    grip = 0.0
    t0 = t1 = t2 = 0.0
    if limit > 0.0:
        grip = a2 * c[i, SHEAR]
        if slipping:
            a = c[i, LEVER]
            along = n0 * x0 + n1 * x1 + n2 * x2
            t0 = c[i, BRISTLE] + a * (x0 - along * n0)
            t1 = c[i, BRISTLE + 1] + a * (x1 - along * n1)
            t2 = c[i, BRISTLE + 2] + a * (x2 - along * n2)
            stretch = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
            grip = a2 * limit / stretch
            t0 /= stretch
            t1 /= stretch
            t2 /= stretch
    # along the slip direction the force does not grow with the slip, but with the normal force: -mu k t n^T
    p0, p1, p2 = k * n0 - mu * k * t0, k * n1 - mu * k * t1, k * n2 - mu * k * t2
    out[0, 0] += p0 * n0 + grip * (1.0 - n0 * n0 - t0 * t0)
    out[0, 1] += p0 * n1 - grip * (n0 * n1 + t0 * t1)
    out[0, 2] += p0 * n2 - grip * (n0 * n2 + t0 * t2)
    out[1, 0] += p1 * n0 - grip * (n1 * n0 + t1 * t0)
    out[1, 1] += p1 * n1 + grip * (1.0 - n1 * n1 - t1 * t1)
    out[1, 2] += p1 * n2 - grip * (n1 * n2 + t1 * t2)
    out[2, 0] += p2 * n0 - grip * (n2 * n0 + t2 * t0)
    out[2, 1] += p2 * n1 - grip * (n2 * n1 + t2 * t1)
    out[2, 2] += p2 * n2 + grip * (1.0 - n2 * n2 - t2 * t2)


@kernel
def residual(c, count, free, compliance, x0, x1, x2, step, out):
    """x - free - G f(x) into `out`; returns its length."""
    f0 = f1 = f2 = 0.0
    for i in range(count):
        contact_force(c, i, x0, x1, x2, step)
        a = c[i, LEVER]
        f0 += a * c[i, FORCE]
        f1 += a * c[i, FORCE + 1]
        f2 += a * c[i, FORCE + 2]
    g = compliance
    out[0] = x0 - free[0] - (g[0, 0] * f0 + g[0, 1] * f1 + g[0, 2] * f2)
    out[1] = x1 - free[1] - (g[1, 0] * f0 + g[1, 1] * f1 + g[1, 2] * f2)
    out[2] = x2 - free[2] - (g[2, 0] * f0 + g[2, 1] * f1 + g[2, 2] * f2)
    return math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])


@kernel
def balance(c, count, free, compliance, step, x, scratch):
    """Displacement x of the centre at which spring, friction and carrier are in balance; forces in the rows of `c`.

    `free` (3,) is where the centre would go without contact, relative to the reference place that the gaps belong to.
    Semi-smooth Newton with a halving line search. Returns 1 when balanced, else 0.
    """
    tangent = scratch[0:3]
    r = scratch[3]
    # relative: in a step of a microsecond a free mass moves less than any fixed tolerance
    goal = _TOLERANCE * math.sqrt(free[0] * free[0] + free[1] * free[1] + free[2] * free[2])
    size = residual(c, count, free, compliance, x[0], x[1], x[2], step, r)
    for _ in range(_ITERATIONS):
        if size <= goal:
            return 1
        before = size
        tangent[:] = 0.0
        for i in range(count):
            add_tangent_stiffness(c, i, x[0], x[1], x[2], step, tangent)
        d0, d1, d2 = newton_direction(tangent, compliance, r)
        share = 1.0
        y0, y1, y2 = x[0], x[1], x[2]
        while True:
            y0, y1, y2 = x[0] - share * d0, x[1] - share * d1, x[2] - share * d2
            size = residual(c, count, free, compliance, y0, y1, y2, step, r)
            if size < (1.0 - 1e-4 * share) * before or size <= goal or share < 2e-3:
                break
            share *= 0.5
        x[0], x[1], x[2] = y0, y1, y2
        if size >= before and size < _ROUNDING:
            return 1
    return 1 if size < 1e-9 else 0


@kernel
def newton_direction(tangent, compliance, r):
    """(I + G T)^-1 r for 3x3 G, T."""
    g, t = compliance, tangent
    a00 = 1.0 + g[0, 0] * t[0, 0] + g[0, 1] * t[1, 0] + g[0, 2] * t[2, 0]
    a01 = g[0, 0] * t[0, 1] + g[0, 1] * t[1, 1] + g[0, 2] * t[2, 1]
    a02 = g[0, 0] * t[0, 2] + g[0, 1] * t[1, 2] + g[0, 2] * t[2, 2]
    a10 = g[1, 0] * t[0, 0] + g[1, 1] * t[1, 0] + g[1, 2] * t[2, 0]
    a11 = 1.0 + g[1, 0] * t[0, 1] + g[1, 1] * t[1, 1] + g[1, 2] * t[2, 1]
    a12 = g[1, 0] * t[0, 2] + g[1, 1] * t[1, 2] + g[1, 2] * t[2, 2]
    a20 = g[2, 0] * t[0, 0] + g[2, 1] * t[1, 0] + g[2, 2] * t[2, 0]
    a21 = g[2, 0] * t[0, 1] + g[2, 1] * t[1, 1] + g[2, 2] * t[2, 1]
    a22 = 1.0 + g[2, 0] * t[0, 2] + g[2, 1] * t[1, 2] + g[2, 2] * t[2, 2]
    c00 = a11 * a22 - a12 * a21
    c01 = a12 * a20 - a10 * a22
    c02 = a10 * a21 - a11 * a20
    det = a00 * c00 + a01 * c01 + a02 * c02
    if abs(det) < 1e-300:
        return r[0], r[1], r[2]
    c10 = a02 * a21 - a01 * a22
    c11 = a00 * a22 - a02 * a20
    c12 = a01 * a20 - a00 * a21
    c20 = a01 * a12 - a02 * a11
    c21 = a02 * a10 - a00 * a12
    c22 = a00 * a11 - a01 * a10
    return (
        (c00 * r[0] + c10 * r[1] + c20 * r[2]) / det,
        (c01 * r[0] + c11 * r[1] + c21 * r[2]) / det,
        (c02 * r[0] + c12 * r[1] + c22 * r[2]) / det,
    )


@kernel
def balance_with_fixed_limits(c, count, free, compliance, step, x, scratch):
    """`balance` for a carrier on which sliding raises the normal force without bound (jamming).

    A fixed-point iteration over the friction limits. Each iteration holds them at the friction coefficient times the
    last normal force, which leaves a monotone problem with exactly one solution. The solution is in balance and
    dissipates energy even if the iteration does not converge; its friction then belongs to the normal force of the
    iteration before.
    """
    x[:] = 0.0
    for i in range(count):
        c[i, FIXED_LIMIT] = 0.0
    done = 0
    for _ in range(_FIXED_POINT_ITERATIONS):
        done = balance(c, count, free, compliance, step, x, scratch)
        change = 0.0
        for i in range(count):
            contact_force(c, i, x[0], x[1], x[2], step)
            wanted = c[i, LIMIT] * c[i, PRESS]
            change = max(change, abs(wanted - c[i, FIXED_LIMIT]) - 1e-9 * wanted)
            c[i, FIXED_LIMIT] = 0.5 * (wanted + c[i, FIXED_LIMIT])
        if change < 1e-12:
            break
    return done


@kernel
def settle(c, count, free, compliance, step, slow, x, scratch):
    """Balance with static or sliding friction at each contact.

    A contact that slipped slower than `slow` [m/s] in the last step holds up to STATIC; once it slips it has SLIDING.
    This is a Stribeck curve with two branches, and gives stick-slip with any compliance. Returns 1 if balanced, 2 if
    only with fixed friction limits, 0 if not balanced.
    """
    may_slip = False
    for i in range(count):
        holds = c[i, SLIP] < slow
        c[i, FIXED_LIMIT] = -1.0
        c[i, LIMIT] = c[i, STATIC] if holds else c[i, SLIDING]
        may_slip = may_slip or (holds and c[i, STATIC] > c[i, SLIDING])
    done = balance(c, count, free, compliance, step, x, scratch)
    if may_slip:
        slips = False
        for i in range(count):
            if c[i, LIMIT] > c[i, SLIDING] and contact_force(c, i, x[0], x[1], x[2], step):
                c[i, LIMIT] = c[i, SLIDING]
                slips = True
        if slips:
            done = balance(c, count, free, compliance, step, x, scratch)
    if done == 0:
        done = 2 * balance_with_fixed_limits(c, count, free, compliance, step, x, scratch)
    for i in range(count):
        _update_row(c, i, x, step)
    return done


@kernel
def _update_row(c, i, x, step):
    """Row `i` at x: centre, gap, and the bristle that corresponds to the friction force; the rest has slipped."""
    contact_force(c, i, x[0], x[1], x[2], step)
    n0, n1, n2 = c[i, NORMAL], c[i, NORMAL + 1], c[i, NORMAL + 2]
    along = n0 * x[0] + n1 * x[1] + n2 * x[2]
    a = c[i, LEVER]
    slip = 0.0
    press = c[i, PRESS]
    f0, f1, f2 = c[i, FORCE] - press * n0, c[i, FORCE + 1] - press * n1, c[i, FORCE + 2] - press * n2
    if c[i, FRICTION_SINE] != 0.0:
        f0, f1, f2 = turned(n0, n1, n2, f0, f1, f2, -c[i, FRICTION_SINE])
    friction = (f0, f1, f2)
    for j in range(3):
        n = c[i, NORMAL + j]
        moved = c[i, BRISTLE + j] + a * (x[j] - along * n)
        held = 0.0
        if c[i, SHEAR] > 0.0:
            held = -friction[j] / c[i, SHEAR]
        slip += (moved - held) ** 2
        c[i, BRISTLE + j] = held
        c[i, CENTRE + j] += a * x[j]
    c[i, SLIP] = math.sqrt(slip) / step
    c[i, GAP] += a * along
