"""Closed form for arms with a spherical shoulder, an elbow and a spherical wrist (Shimizu et al., IEEE T-RO 24, 2008).

The wrist's place fixes the elbow joint and leaves the elbow one circle; the arm angle psi goes round it. Shoulder and
wrist are each a rotation Rz(a) Rx(s1 90 deg) Rz(b) Rx(s2 90 deg) Rz(c) whose entries are linear in cos psi and sin psi,
so every joint limit is met at the roots of A cos psi + B sin psi + C = 0: the ends of the feasible arcs are exact.

The elbow's place is taken from the circle and never divided by sin q4, so that the straight arm is an arm like others.

`shape` is (3, width): the shoulder frame in the world as 3x4, the wrist frame in the tip's as 3x4, and the row of signs
and lengths named below. `work` are SCRATCH rows.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import LOWER, THETA, UPPER

# columns of the last row of `shape`: the signs of the six quarter-turn twists, then lengths
SIGN, UPPER_ARM, FOREARM, NEAREST, FARTHEST = 0, 6, 7, 8, 9
# rows of the scratch block: four halves (elbow + shoulder, wrist; elbow - shoulder, wrist), then
CUTS, GOAL, CIRCLE, SPARE = 4, 5, 6, 7
SCRATCH = 8
# more arcs than any branch can have
ARCS = 32
# each half holds seven entries of its rotation, three coefficients each
R11, R21, R31, R13, R23, R33, R32 = 0, 3, 6, 9, 12, 15, 18
# GOAL row: rotation of the last frame in the shoulder's by columns, then the wrist's place
WRIST = 9
# CIRCLE row: e1, e2, and the axis n from shoulder to wrist; elbow joint for both sides; bend, and length along n
AXIS, ELBOW, BEND, DISTANCE = 6, 9, 11, 12

TURN = 2.0 * math.pi
NONE = 1e300
SINGULAR = 1e-9
# rad by which rounding may put a joint beyond its limit: near the straight arm, and where an arc is a single point
ELBOW_SLACK, POINT_SLACK = 1e-7, 1e-7
GUESSES = 6


@kernel
def _place_wrist(shape, target, goal):
    """The target as the arm sees it: last frame's columns and wrist centre in the shoulder frame, into goal."""
    base, tail = shape[0], shape[1]
    for m in range(12):
        goal[m] = 0.0
    for i in range(3):
        t0, t1, t2 = target[4 * i], target[4 * i + 1], target[4 * i + 2]
        for j in range(4):
            world = t0 * tail[j] + t1 * tail[4 + j] + t2 * tail[8 + j]
            if j == 3:
                world += target[4 * i + 3] - base[4 * i + 3]
            for k in range(3):
                goal[3 * j + k] += base[4 * i + k] * world


@kernel
def beyond(shape, target, slack):
    """Whether the wrist is to be nearer or farther than the elbow's limits allow: `lay_wrist` tells where to."""
    base, tail, law = shape[0], shape[1], shape[2]
    square = 0.0
    for i in range(3):
        row = 4 * i
        turned = target[row] * tail[3] + target[row + 1] * tail[7] + target[row + 2] * tail[11]
        gap = turned + target[row + 3] - base[row + 3]
        square += gap * gap
    distance = math.sqrt(square)
    return distance < law[NEAREST] - slack or distance > law[FARTHEST] + slack


@kernel
def fit(angle, row, seed, slack):
    """The joint value for a DH angle, turned into the limits as near the seed as it goes; NONE where it cannot."""
    low, high = row[LOWER] - slack, row[UPPER] + slack
    q = angle - row[THETA]
    q += TURN * math.floor((seed - q) / TURN + 0.5)
    if q > high:
        q -= TURN * math.ceil((q - high) / TURN)
    if q < low:
        q += TURN * math.ceil((low - q) / TURN)
    if not q <= high:
        return NONE
    return min(max(q, row[LOWER]), row[UPPER])


@kernel
def _reach_of(shape, q4):
    """Distance from shoulder to wrist centre for a DH angle of the elbow joint."""
    law = shape[2]
    straight = -law[SIGN + 2] * law[SIGN + 3] * math.cos(q4)
    upper, fore = law[UPPER_ARM], law[FOREARM]
    return math.sqrt(max(upper * upper + fore * fore + 2.0 * upper * fore * straight, 0.0))


@kernel
def bend(shape, distance):
    """Angle between upper arm and forearm for a distance from shoulder to wrist; exact near the straight arm."""
    upper, fore = shape[2, UPPER_ARM], shape[2, FOREARM]
    open_ = max((upper + fore - distance) * (upper + fore + distance), 0.0)
    shut = max((distance - upper + fore) * (distance + upper - fore), 0.0)
    return 2.0 * math.atan2(math.sqrt(open_), math.sqrt(shut))


@kernel
def _elbow_angle(shape, gamma, side):
    """DH angle of the elbow joint for a bend and a side, +1 or -1."""
    law = shape[2]
    return math.atan2(side * law[SIGN + 3] * math.sin(gamma), -law[SIGN + 2] * law[SIGN + 3] * math.cos(gamma))


@kernel
def nearest_reach(shape, row, distance):
    """The distance from shoulder to wrist nearest to `distance` that the elbow joint's limits allow."""
    upper, fore = shape[2, UPPER_ARM], shape[2, FOREARM]
    inside = min(max(distance, abs(upper - fore)), upper + fore)
    gamma = bend(shape, inside)
    plus, minus = _elbow_angle(shape, gamma, 1.0), _elbow_angle(shape, gamma, -1.0)
    if min(fit(plus, row, 0.0, ELBOW_SLACK), fit(minus, row, 0.0, ELBOW_SLACK)) < NONE:
        return inside
    at_low, at_high = _reach_of(shape, row[LOWER] + row[THETA]), _reach_of(shape, row[UPPER] + row[THETA])
    return at_low if abs(at_low - distance) < abs(at_high - distance) else at_high


@kernel
def _linear(out, at, radial, tangent, along, g1, g2, gn):
    """Coefficients of cos psi, sin psi and 1 of (radial e_r + tangent e_t + along n) . g, e_r going round with psi."""
    out[at] = radial * g1 + tangent * g2
    out[at + 1] = radial * g2 - tangent * g1
    out[at + 2] = along * gn


@kernel
def _lay_circle(goal, circle):
    """e1, e2 and n = unit vector to the wrist, right-handed, into circle; returns the wrist's distance."""
    w0, w1, w2 = goal[WRIST], goal[WRIST + 1], goal[WRIST + 2]
    distance = math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    n0, n1, n2 = (w0 / distance, w1 / distance, w2 / distance) if distance > 1e-12 else (0.0, 0.0, 1.0)
    # psi counts from the vertical plane through the wrist, from the x axis where the wrist is overhead
    if abs(n2) < 0.95:
        a0, a1, a2 = -n2 * n0, -n2 * n1, 1.0 - n2 * n2
    else:
        a0, a1, a2 = 1.0 - n0 * n0, -n0 * n1, -n0 * n2
    size = math.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
    a0, a1, a2 = a0 / size, a1 / size, a2 / size
    circle[0], circle[1], circle[2] = a0, a1, a2
    circle[3], circle[4], circle[5] = n1 * a2 - n2 * a1, n2 * a0 - n0 * a2, n0 * a1 - n1 * a0
    circle[AXIS], circle[AXIS + 1], circle[AXIS + 2] = n0, n1, n2
    return distance


@kernel
def lay_halves(shape, work):
    """The shoulder's and wrist's rotations as functions of psi, for both sides of the elbow."""
    law, goal, circle = shape[2], work[GOAL], work[CIRCLE]
    upper, fore = law[UPPER_ARM], law[FOREARM]
    distance = circle[DISTANCE]
    cg, sg = math.cos(circle[BEND]), math.sin(circle[BEND])
    # the elbow from the shoulder, in upper arm lengths: along n and out to the circle
    high = (upper + fore * cg) / distance if distance > 1e-12 else 0.0
    out = fore * sg / distance if distance > 1e-12 else 1.0
    s3, s4 = law[SIGN + 2], law[SIGN + 3]
    for k in range(2):
        side = 1.0 - 2.0 * k
        q4 = circle[ELBOW + k]
        c4, z4 = math.cos(q4), math.sin(q4)
        shoulder, wrist = work[2 * k], work[2 * k + 1]
        # frame 3 axes as (radial, tangent, along): x3, y3 = (0, -side, 0), z3
        xr, xn = -side * high, side * out
        zr, zn = out, high
        for i in range(3):
            _linear(shoulder, R11 + 3 * i, xr, 0.0, xn, circle[i], circle[3 + i], circle[AXIS + i])
            _linear(shoulder, R13 + 3 * i, zr, 0.0, zn, circle[i], circle[3 + i], circle[AXIS + i])
        # frame 4 axes: x4, y4 = (0, yt, 0), z4
        ur, un = c4 * xr + s3 * z4 * zr, c4 * xn + s3 * z4 * zn
        yt = s3 * s4 * side
        fr, fn = s4 * z4 * xr - s3 * s4 * c4 * zr, s4 * z4 * xn - s3 * s4 * c4 * zn
        for j in range(3):
            g1 = circle[0] * goal[3 * j] + circle[1] * goal[3 * j + 1] + circle[2] * goal[3 * j + 2]
            g2 = circle[3] * goal[3 * j] + circle[4] * goal[3 * j + 1] + circle[5] * goal[3 * j + 2]
            gn = circle[6] * goal[3 * j] + circle[7] * goal[3 * j + 1] + circle[8] * goal[3 * j + 2]
            first = R32 if j == 1 else (R11 if j == 0 else R13)
            if j == 1:
                _linear(shoulder, first, 0.0, -side, 0.0, circle[2], circle[5], circle[AXIS + 2])
                _linear(wrist, first, fr, 0.0, fn, g1, g2, gn)
            else:
                _linear(wrist, first, ur, 0.0, un, g1, g2, gn)
                _linear(wrist, first + 3, 0.0, yt, 0.0, g1, g2, gn)
                _linear(wrist, first + 6, fr, 0.0, fn, g1, g2, gn)


@kernel
def lay_wrist(chain, shape, target, work):
    """Wrist, elbow circle and elbow joint for the target or, where the elbow cannot reach it, for the nearest one with
    the same orientation; returns how far the wrist had to be moved along the circle's axis [m]."""
    circle = work[CIRCLE]
    _place_wrist(shape, target, work[GOAL])
    wanted = _lay_circle(work[GOAL], circle)
    distance = nearest_reach(shape, chain[4], wanted)
    gamma = bend(shape, distance)
    circle[ELBOW], circle[ELBOW + 1] = _elbow_angle(shape, gamma, 1.0), _elbow_angle(shape, gamma, -1.0)
    circle[BEND], circle[DISTANCE] = gamma, distance
    return distance - wanted


@kernel
def move_along_axis(shape, work, distance, target):
    """Shift the target by `distance` along the line from shoulder to wrist."""
    base, circle = shape[0], work[CIRCLE]
    for i in range(3):
        row = 4 * i
        along = base[row] * circle[AXIS] + base[row + 1] * circle[AXIS + 1] + base[row + 2] * circle[AXIS + 2]
        target[row + 3] += distance * along


@kernel
def _shared_turn(total, mirror, row_a, row_c, seed_a):
    """The angle a nearest to its seed for which a + mirror * c = total and both keep their limits; else the seed's."""
    low, high = row_a[LOWER] + row_a[THETA], row_a[UPPER] + row_a[THETA]
    c_low, c_high = row_c[LOWER] + row_c[THETA], row_c[UPPER] + row_c[THETA]
    start, end = (total - c_high, total - c_low) if mirror > 0.0 else (total + c_low, total + c_high)
    wish = seed_a + row_a[THETA]
    best, found = NONE, min(max(wish, low), high)
    for k in range(-3, 4):
        lo, hi = max(low, start + TURN * k), min(high, end + TURN * k)
        if lo <= hi:
            a = min(max(wish, lo), hi)
            if abs(a - wish) < best:
                best, found = abs(a - wish), a
    return found


@kernel
def _triple(half, s1, s2, c, s, row_a, row_c, seed_a):
    """Angles a, b, c of one half at (cos psi, sin psi) for sin b >= 0, and sin b; the other flip is a + pi, -b, c + pi.

    c follows from a, so that the two stay consistent however small sin b is; at a singularity a is free to choose.
    """
    x1 = half[R11] * c + half[R11 + 1] * s + half[R11 + 2]
    x2 = half[R21] * c + half[R21 + 1] * s + half[R21 + 2]
    x3 = half[R31] * c + half[R31 + 1] * s + half[R31 + 2]
    z1 = half[R13] * c + half[R13 + 1] * s + half[R13 + 2]
    z2 = half[R23] * c + half[R23 + 1] * s + half[R23 + 2]
    z3 = half[R33] * c + half[R33 + 1] * s + half[R33 + 2]
    sb, cb = math.sqrt(z1 * z1 + z2 * z2), -s1 * s2 * z3
    b = math.atan2(sb, cb)
    if sb > SINGULAR:
        ca, sa = s2 * z1 / sb, s2 * z2 / sb
        a = math.atan2(sa, ca)
    else:
        total = math.atan2(x2, x1) + (math.pi if cb < 0.0 else 0.0)
        a = _shared_turn(total, 1.0 if z3 > 0.0 else -1.0, row_a, row_c, seed_a)
        ca, sa = math.cos(a), math.sin(a)
    across, along = ca * x2 - sa * x1, ca * x1 + sa * x2
    return a, b, math.atan2(-s1 * s2 * across, cb * along + sb * s1 * x3), sb


@kernel
def _half_joints(chain, shape, half, first, c, s, seed, slack, flips, out):
    """Joints first..first+2 of one half into out, for the flip of its middle joint that is nearer to the seed; their
    largest distance from it, NONE where limits forbid them. `flips`: +1 or -1 for that flip alone, 0 for both."""
    law = shape[2]
    row_a, row_b, row_c = chain[first + 1], chain[first + 2], chain[first + 3]
    seed_a, seed_b, seed_c = seed[first], seed[first + 1], seed[first + 2]
    a, b, g, sb = _triple(half, law[SIGN + first], law[SIGN + first + 1], c, s, row_a, row_c, seed_a)
    # at a singularity both flips are one
    turn = math.pi if sb > SINGULAR else 0.0
    best = NONE
    for flip in range(2):
        if (flip == 0 and flips >= 0.0) or (flip == 1 and flips <= 0.0):
            qb = fit(b, row_b, seed_b, slack)
            qa = fit(a, row_a, seed_a, slack) if qb < NONE else NONE
            qc = fit(g, row_c, seed_c, slack) if qa < NONE else NONE
            far = max(abs(qa - seed_a), abs(qb - seed_b), abs(qc - seed_c))
            if qc < NONE and far < best:
                best = far
                out[first], out[first + 1], out[first + 2] = qa, qb, qc
        a, b, g = a + turn, -b, g + turn
    return best


@kernel
def best_at(chain, shape, c, s, seed, slack, cap, work, out):
    """The configuration nearest to the seed among all branches at (cos psi, sin psi), into out; returns its largest
    joint distance, or `cap` with `out` untouched where none is nearer than that."""
    spare = work[SPARE]
    for side in range(2):
        cost = branch_at(chain, shape, side, 0.0, 0.0, c, s, seed, slack, work, spare)
        if cost < cap:
            cap = cost
            for i in range(7):
                out[i] = spare[i]
    return cap


@kernel
def branch_at(chain, shape, side, flip_shoulder, flip_wrist, c, s, seed, slack, work, out):
    """The same for one side of the elbow (0 or 1) and the flips asked for (see half_joints); NONE where none is."""
    elbow = fit(work[CIRCLE, ELBOW + side], chain[4], seed[3], ELBOW_SLACK)
    far = abs(elbow - seed[3])
    for part in range(2):
        flips = flip_wrist if part else flip_shoulder
        if far < NONE:
            half = work[2 * side + part]
            far = max(far, _half_joints(chain, shape, half, 4 * part, c, s, seed, slack, flips, out))
    out[3] = elbow
    return far


@kernel
def roots(a, b, c, cuts, count):
    """psi with a cos psi + b sin psi + c = 0, appended to cuts; returns the new count.

    A line that only just misses the circle counts as touching it: at worst one cut too many.
    """
    size = math.sqrt(a * a + b * b)
    if not (size > 1e-14 and abs(c) <= size * (1.0 + 1e-12)):
        return count
    middle, spread = math.atan2(b, a), math.acos(min(max(-c / size, -1.0), 1.0))
    cuts[count], cuts[count + 1] = middle - spread, middle + spread
    return count + 2


@kernel
def _all_cuts(chain, shape, side, work):
    """Every psi at which a joint may meet one of its limits, for one side of the elbow, into CUTS; their count."""
    law, cuts = shape[2], work[CUTS]
    count = 0
    for part in range(2):
        half = work[2 * side + part]
        cosine_sign = law[SIGN + 4 * part] * law[SIGN + 4 * part + 1]
        for end in range(LOWER, UPPER + 1):
            for joint in range(3):
                row = chain[4 * part + joint + 1]
                angle = row[end] + row[THETA]
                c, s = math.cos(angle), math.sin(angle)
                # an end at infinity makes NaN of all, which has no roots
                if joint == 1:
                    x, y, z = half[R33], half[R33 + 1], half[R33 + 2] + cosine_sign * c
                else:
                    # zero where (cosine, sine) entries point along the end's direction, or against it
                    cosine, sine = (R13, R23) if joint == 0 else (R31, R32)
                    s = s if joint == 0 else -s
                    x = half[sine] * c - half[cosine] * s
                    y = half[sine + 1] * c - half[cosine + 1] * s
                    z = half[sine + 2] * c - half[cosine + 2] * s
                count = roots(x, y, z, cuts, count)
    return count


@kernel
def _sorted_cuts(chain, shape, side, work):
    """All cuts for one side of the elbow (0 or 1) sorted in [-pi, pi), the first again a turn later; their count."""
    cuts = work[CUTS]
    count = _all_cuts(chain, shape, side, work)
    for i in range(count):
        psi = cuts[i] - TURN * math.floor((cuts[i] + math.pi) / TURN)
        j = i
        while j > 0 and cuts[j - 1] > psi:
            cuts[j] = cuts[j - 1]
            j -= 1
        cuts[j] = psi
    if count == 0:
        cuts[0], count = -math.pi, 1
    cuts[count] = cuts[0] + TURN
    return count


@kernel
def seed_angle(chain, shape, seed, work):
    """psi of the seed's elbow on the target's circle."""
    law, circle = shape[2], work[CIRCLE]
    a = seed[0] + chain[1, THETA]
    b = seed[1] + chain[2, THETA]
    s1, s2 = law[SIGN], law[SIGN + 1]
    u0, u1, u2 = s2 * math.sin(b) * math.cos(a), s2 * math.sin(b) * math.sin(a), -s1 * s2 * math.cos(b)
    return math.atan2(
        u0 * circle[3] + u1 * circle[4] + u2 * circle[5], u0 * circle[0] + u1 * circle[1] + u2 * circle[2]
    )


@kernel
def any_configuration(chain, shape, seed, work, out):
    """A configuration for what `lay_halves` laid out, into out; False when joint limits leave none.

    A few arm angles are tried first, from the seed's own by golden sections of the turn; most poses end there. What is
    left is decided on the exact arcs: between all cuts, and on the cuts themselves, where an arc may be one point.
    """
    psi = seed_angle(chain, shape, seed, work)
    for _ in range(GUESSES):
        if best_at(chain, shape, math.cos(psi), math.sin(psi), seed, 0.0, NONE, work, out) < NONE:
            return True
        psi += 0.3819660112501051 * TURN
    return on_arcs(chain, shape, seed, NONE, work, out) < NONE


@kernel
def on_arcs(chain, shape, seed, cap, work, out):
    """The nearest to the seed of the middles of all arcs, or of single points where no arc is left."""
    cuts = work[CUTS]
    for points in range(2):
        for side in range(2):
            count = _sorted_cuts(chain, shape, side, work)
            for i in range(count):
                psi = cuts[i] if points == 1 else 0.5 * (cuts[i] + cuts[i + 1])
                slack = POINT_SLACK if points == 1 else 0.0
                cap = best_at(chain, shape, math.cos(psi), math.sin(psi), seed, slack, cap, work, out)
        if cap < NONE:
            return cap
    return cap


@kernel
def branch_arcs(chain, shape, side, flip_shoulder, flip_wrist, seed, work, arcs):
    """The feasible arcs of one branch into arcs (ARCS, 2), from <= to in rad; their count."""
    cuts, spare = work[CUTS], work[SPARE]
    count = _sorted_cuts(chain, shape, side, work)
    found = 0
    for i in range(count):
        lo, hi = cuts[i], cuts[i + 1]
        mid = 0.5 * (lo + hi)
        c, s = math.cos(mid), math.sin(mid)
        inside = (
            lo < hi and branch_at(chain, shape, side, flip_shoulder, flip_wrist, c, s, seed, 0.0, work, spare) < NONE
        )
        c, s = math.cos(lo), math.sin(lo)
        touches = branch_at(chain, shape, side, flip_shoulder, flip_wrist, c, s, seed, POINT_SLACK, work, spare) < NONE
        if found > 0 and arcs[found - 1, 1] == lo and touches:
            arcs[found - 1, 1] = hi if inside else lo
        elif inside or touches:
            arcs[found, 0], arcs[found, 1] = lo, hi if inside else lo
            found += 1
    return found
