"""The contact step: several elastic contacts with Coulomb friction behind one common compliance.

The probe gives way in two ways. The stick bends: the sphere moves all of that, a contact on the stick its `LEVER`'s
share. Joints and the object give way: everything moves alike. In one time step both are affine laws, with a share of
inertia: bending = free + G sum(lever f), moving = free + G sum(f), with f the contacts' forces and each G a symmetric
3x3 compliance, which may be zero (rigid) in any direction. Each contact is a spring and a damper along its normal,
pressing only, and along its tangent a spring that slips at the friction limit. All forces are taken at the end of the
step (backward Euler), so that no stiffness and no damping can make the step unstable and no energy is created.

A contact is one row of a (n, WIDTH) array, columns as named below. Displacements are (2, 3): of the sphere's centre by
bending, and by what moves everything; `compliance` (2, 3, 3) is in the same order.
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
LEVER = 16  # share of the sphere's displacement by bending that this contact takes part in (1 on the sphere)
BODY = 17  # which object is touched
FORCE = 18  # 3, out: on the probe [N]
PRESS = 21  # out: normal part of the force [N]
SLIP = 22  # speed of slip [m/s]; in: of the last step, out: of this one
LIMIT = 23  # friction coefficient in force in this step
FIXED_LIMIT = 24  # friction limit that is held fixed while the normal force is computed [N]; < 0: LIMIT * PRESS
RADIUS = 25  # of the round body that touches [m]
FRICTION_SINE = 26  # sine of the angle about the normal between friction and the opposite of the slip
WIDTH = 27

TANGENT = 0  # 3 x 3 x 3: sums of the contacts' stiffness, times their lever to the power of the first index
RESIDUAL = 27  # 6
SYSTEM = 33  # 6 x 7, linear equations
SCRATCH = SYSTEM + 42
"""Numbers that `settle` needs for its own."""

_TOLERANCE = 1e-9  # relative to the free displacement
_ROUNDING = 1e-13  # m, residual that only rounding is left in
_ITERATIONS = 60  # of Newton's method
_FIXED_POINT_ITERATIONS = 20  # of the friction limits


@kernel
def contact_force(c, i, x0, x1, x2, step):
    """Force of contact row `i`, itself displaced by x; fills FORCE and PRESS; returns True while slipping."""
    n0, n1, n2 = c[i, NORMAL], c[i, NORMAL + 1], c[i, NORMAL + 2]
    along = n0 * x0 + n1 * x1 + n2 * x2
    depth = -(c[i, GAP] + along)
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
    s0 = c[i, BRISTLE] + x0 - along * n0
    s1 = c[i, BRISTLE + 1] + x1 - along * n1
    s2 = c[i, BRISTLE + 2] + x2 - along * n2
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
def displacement(c, i, x):
    """(3,) m, of the place where contact `i` is, with the probe displaced by x (2, 3)."""
    a = c[i, LEVER]
    return a * x[0, 0] + x[1, 0], a * x[0, 1] + x[1, 1], a * x[0, 2] + x[1, 2]


@kernel
def add_tangent_stiffness(c, i, x0, x1, x2, step, out):
    """Add minus the derivative of contact `i`'s force by its own displacement x to `out` (3, 3, 3).

    To out[k] times the lever to the power of k. The derivative is that of the branch (open, sticking, slipping) that
    holds at x: Newton's method on a piecewise smooth law.
    """
    slipping = contact_force(c, i, x0, x1, x2, step)
    press = c[i, PRESS]
    if press <= 0.0:
        return
    n0, n1, n2 = c[i, NORMAL], c[i, NORMAL + 1], c[i, NORMAL + 2]
    k = c[i, STIFFNESS] + c[i, DAMPING] / step
    mu = c[i, LIMIT] if c[i, FIXED_LIMIT] < 0.0 else 0.0
    limit = mu * press if c[i, FIXED_LIMIT] < 0.0 else c[i, FIXED_LIMIT]
    grip = 0.0
    t0 = t1 = t2 = 0.0
    if limit > 0.0:
        grip = c[i, SHEAR]
        if slipping:
            along = n0 * x0 + n1 * x1 + n2 * x2
            t0 = c[i, BRISTLE] + x0 - along * n0
            t1 = c[i, BRISTLE + 1] + x1 - along * n1
            t2 = c[i, BRISTLE + 2] + x2 - along * n2
            stretch = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
            grip = limit / stretch
            t0 /= stretch
            t1 /= stretch
            t2 /= stretch
    # along the slip direction the force does not grow with the slip, but with the normal force: -mu k t n^T
    p = (k * n0 - mu * k * t0, k * n1 - mu * k * t1, k * n2 - mu * k * t2)
    n, t = (n0, n1, n2), (t0, t1, t2)
    for row in range(3):
        for column in range(3):
            held = 1.0 if row == column else 0.0
            value = p[row] * n[column] + grip * (held - n[row] * n[column] - t[row] * t[column])
            for power in range(3):
                out[power, row, column] += value
                value *= c[i, LEVER]


@kernel
def residual(c, count, free, compliance, x, step, out):
    """x - free - G f(x) into `out` (6,); returns its length."""
    f0 = f1 = f2 = b0 = b1 = b2 = 0.0
    for i in range(count):
        x0, x1, x2 = displacement(c, i, x)
        contact_force(c, i, x0, x1, x2, step)
        a = c[i, LEVER]
        f0 += c[i, FORCE]
        f1 += c[i, FORCE + 1]
        f2 += c[i, FORCE + 2]
        b0 += a * c[i, FORCE]
        b1 += a * c[i, FORCE + 1]
        b2 += a * c[i, FORCE + 2]
    square = 0.0
    for j in range(3):
        g, h = compliance[0, j], compliance[1, j]
        out[j] = x[0, j] - free[0, j] - (g[0] * b0 + g[1] * b1 + g[2] * b2)
        out[3 + j] = x[1, j] - free[1, j] - (h[0] * f0 + h[1] * f1 + h[2] * f2)
        square += out[j] ** 2 + out[3 + j] ** 2
    return math.sqrt(square)


@kernel
def balance(c, count, free, compliance, step, x, scratch):
    """Displacement x (2, 3) at which springs, friction and what carries them are in balance; forces in the rows of `c`.

    `free` (2, 3) is where the centre would go without contact, relative to the reference place that the gaps belong to.
    Semi-smooth Newton with a halving line search. Returns 1 when balanced, else 0.
    """
    tangent, r = scratch[TANGENT:RESIDUAL].reshape((3, 3, 3)), scratch[RESIDUAL:SYSTEM]
    system = scratch[SYSTEM:SCRATCH].reshape((6, 7))
    # relative: in a step of a microsecond a free mass moves less than any fixed tolerance
    square = 0.0
    for i in range(3):
        square += free[0, i] ** 2 + free[1, i] ** 2
    goal = _TOLERANCE * math.sqrt(square)
    size = residual(c, count, free, compliance, x, step, r)
    for _ in range(_ITERATIONS):
        if size <= goal:
            return 1
        before = size
        tangent[:] = 0.0
        for i in range(count):
            x0, x1, x2 = displacement(c, i, x)
            add_tangent_stiffness(c, i, x0, x1, x2, step, tangent)
        newton_direction(tangent, compliance, r, system)
        gone, share = 0.0, 1.0
        while True:
            for i in range(3):
                x[0, i] -= (share - gone) * system[i, 6]
                x[1, i] -= (share - gone) * system[3 + i, 6]
            gone = share
            size = residual(c, count, free, compliance, x, step, r)
            if size < (1.0 - 1e-4 * share) * before or size <= goal or share < 2e-3:
                break
            share *= 0.5
        if size >= before and size < _ROUNDING:
            return 1
    return 1 if size < 1e-9 else 0


@kernel
def newton_direction(tangent, compliance, r, system):
    """(I + G T)^-1 r into the last column of `system` (6, 7): Gauss's elimination with row pivots."""
    for i in range(6):
        for j in range(6):
            power = 2 - i // 3 - j // 3
            value = 1.0 if i == j else 0.0
            for k in range(3):
                value += compliance[i // 3, i % 3, k] * tangent[power, k, j % 3]
            system[i, j] = value
        system[i, 6] = r[i]
    for i in range(6):
        best = i
        for k in range(i + 1, 6):
            if abs(system[k, i]) > abs(system[best, i]):
                best = k
        if abs(system[best, i]) < 1e-300:
            for k in range(6):
                system[k, 6] = r[k]
            return
        for j in range(i, 7):
            system[i, j], system[best, j] = system[best, j], system[i, j]
        for k in range(i + 1, 6):
            share = system[k, i] / system[i, i]
            for j in range(i + 1, 7):
                system[k, j] -= share * system[i, j]
    for i in range(5, -1, -1):
        for j in range(i + 1, 6):
            system[i, 6] -= system[i, j] * system[j, 6]
        system[i, 6] /= system[i, i]


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
    for left in range(_FIXED_POINT_ITERATIONS, 0, -1):
        done = balance(c, count, free, compliance, step, x, scratch)
        change = 0.0
        for i in range(count):
            x0, x1, x2 = displacement(c, i, x)
            contact_force(c, i, x0, x1, x2, step)
            wanted = c[i, LIMIT] * c[i, PRESS]
            change = max(change, abs(wanted - c[i, FIXED_LIMIT]) - 1e-9 * wanted)
        if change < 1e-12 or left == 1:
            break
        for i in range(count):
            c[i, FIXED_LIMIT] = 0.5 * (c[i, LIMIT] * c[i, PRESS] + c[i, FIXED_LIMIT])
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
            x0, x1, x2 = displacement(c, i, x)
            if c[i, LIMIT] > c[i, SLIDING] and contact_force(c, i, x0, x1, x2, step):
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
    u = displacement(c, i, x)
    contact_force(c, i, u[0], u[1], u[2], step)
    n0, n1, n2 = c[i, NORMAL], c[i, NORMAL + 1], c[i, NORMAL + 2]
    along = n0 * u[0] + n1 * u[1] + n2 * u[2]
    slip = 0.0
    press = c[i, PRESS]
    f0, f1, f2 = c[i, FORCE] - press * n0, c[i, FORCE + 1] - press * n1, c[i, FORCE + 2] - press * n2
    if c[i, FRICTION_SINE] != 0.0:
        f0, f1, f2 = turned(n0, n1, n2, f0, f1, f2, -c[i, FRICTION_SINE])
    friction = (f0, f1, f2)
    for j in range(3):
        n = c[i, NORMAL + j]
        moved = c[i, BRISTLE + j] + u[j] - along * n
        held = 0.0
        if c[i, SHEAR] > 0.0:
            held = -friction[j] / c[i, SHEAR]
        slip += (moved - held) ** 2
        c[i, BRISTLE + j] = held
        c[i, CENTRE + j] += u[j]
    c[i, SLIP] = math.sqrt(slip) / step
    c[i, GAP] += along
