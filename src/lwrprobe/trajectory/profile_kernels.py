"""Piecewise constant jerk on several axes: the one form in which every plan is kept and evaluated.

A plan holds one row an axis, `ROW` numbers each: the durations of `PIECES` pieces and their sum, the jerk of each
piece, and position, velocity, acceleration at the start of each piece and at the end, after which the velocity goes on.

A request to the planner is an array with the rows below; what else is to be known about it stands in `facts`.
"""

from math import frexp, ldexp

from lwrprobe.compiled import allocation_free_kernel as kernel

PIECES = 9
BRAKE = 2
"""Of the pieces, these come first and are only there where the motion starts beyond its limits."""
MAIN = PIECES - BRAKE
NODES = PIECES + 1
LAST = NODES - 1
JERK = NODES
POSITION = JERK + PIECES
VELOCITY = POSITION + NODES
ACCELERATION = VELOCITY + NODES
ROW = ACCELERATION + NODES

# rows of a request; TARGET is a position or a velocity, after MOVES; the planner gets the first 7 in units of TIME
# and LENGTH, powers of two, so that nothing is rounded
TARGET, RATE, SECOND, MAX_RATE, MAX_SECOND, MAX_JERK, MOVES, TIME, LENGTH = range(9)
LINES = 9
STAYS, TO_POSITION, TO_VELOCITY = 0.0, 1.0, 2.0

# facts: speed above the asked one, a brake may come first, then [s] the plan's end, and until when the motion is
# bent, or too fast
TOO_FAST, BRAKES, DURATION, BENT_UNTIL, FAST_UNTIL = range(5)
FACTS = 5

NEAR = 1e-12
"""m or rad: nearer to the goal than this is at the goal."""
SLACK = 1e-11
"""Share of a limit below which a velocity or an acceleration counts as none."""
LONGEST = 1000.0
"""s: longer plans are handed over in a longer unit of time (the planner refuses more than about 7600)."""
UNREACHED = 100.0
"""Limits above this many natural units, which a move in them never comes near, are handed over as this."""


@kernel
def settle(request, first, end, kind, max_rate, max_second):
    """Mark the axes that move towards a position or a velocity and set values below the thresholds to exactly zero.

    TARGET comes as what is left to go, for a velocity the change of it, which becomes the velocity itself. Returns
    the number of axes that move.
    """
    count = 0
    near = NEAR if kind == TO_POSITION else SLACK * max_rate
    for i in range(first, end):
        if abs(request[TARGET, i]) < near:
            request[TARGET, i] = 0.0
        if abs(request[RATE, i]) < SLACK * max_rate:
            request[RATE, i] = 0.0
        if abs(request[SECOND, i]) < SLACK * max_second:
            request[SECOND, i] = 0.0
        moves = request[TARGET, i] != 0.0 or request[SECOND, i] != 0.0
        if kind == TO_POSITION:
            moves |= request[RATE, i] != 0.0
        else:
            request[TARGET, i] += request[RATE, i]
        request[MOVES, i] = kind if moves else STAYS
        count += int(moves)
    return count


@kernel
def common_units(request):
    """The same units for all axes: metres or radians, and seconds, doubled until the longest plan is short in them."""
    time = 1.0
    for i in range(request.shape[1]):
        if request[MOVES, i] != STAYS:
            longest = longest_time(request, i)
            while longest > LONGEST * time and time < 1e30:
                time *= 2.0
    for i in range(request.shape[1]):
        request[TIME, i], request[LENGTH, i] = time, 1.0


@kernel
def natural_units(request):
    """Units in which each axis's own move is of the order of 1, for axes that need not end together.

    The planner's tolerances are absolute (1e-8 for a position): too coarse for very small moves.
    """
    for i in range(request.shape[1]):
        if request[MOVES, i] == STAYS:
            continue
        j, second = request[MAX_JERK, i], abs(request[SECOND, i])
        time = longest_time(request, i) / LONGEST
        if request[MOVES, i] == TO_POSITION:
            distance = longest_path(request, i)
            time = max(time, (distance / j) ** (1.0 / 3.0))
        else:
            change = abs(request[TARGET, i] - request[RATE, i]) + second**2 / j
            time = max(time, (change / j) ** 0.5)
            distance = change * time
        request[TIME, i], request[LENGTH, i] = ldexp(1.0, frexp(time)[1]), ldexp(1.0, frexp(distance)[1])


@kernel
def longest_path(request, i):
    """Upper bound of the order of the path to a position and of the detour that the present motion makes."""
    a, j, rate = request[MAX_SECOND, i], request[MAX_JERK, i], abs(request[RATE, i])
    return abs(request[TARGET, i]) + rate * (rate / a + (rate / j) ** 0.5) + abs(request[SECOND, i]) ** 3 / j**2


@kernel
def longest_time(request, i):
    """Upper bound of the order of the duration [s] of an axis's plan."""
    v, a, j = request[MAX_RATE, i], request[MAX_SECOND, i], request[MAX_JERK, i]
    rate, second = abs(request[RATE, i]), abs(request[SECOND, i])
    if request[MOVES, i] == TO_VELOCITY:
        rate += abs(request[TARGET, i])
    time = second / j + rate / a + 2.0 * (rate / j) ** 0.5
    if request[MOVES, i] == TO_POSITION:
        distance = longest_path(request, i)
        time += distance / v + 2.0 * (distance / a) ** 0.5 + 4.0 * (distance / j) ** (1.0 / 3.0)
    return time


@kernel
def hand_over(request, facts, handed):
    """Write the request in the planner's units into `handed` (7, n), and whether a brake may come first."""
    facts[BRAKES] = 0.0
    for i in range(request.shape[1]):
        time, length = request[TIME, i], request[LENGTH, i]
        rate = time / length
        handed[TARGET, i] = request[TARGET, i] * (rate if request[MOVES, i] == TO_VELOCITY else 1.0 / length)
        handed[RATE, i], handed[MAX_RATE, i] = request[RATE, i] * rate, request[MAX_RATE, i] * rate
        handed[SECOND, i] = request[SECOND, i] * rate * time
        handed[MAX_SECOND, i] = request[MAX_SECOND, i] * rate * time
        handed[MAX_JERK, i] = request[MAX_JERK, i] * rate * time * time
        handed[MOVES, i] = request[MOVES, i]
        if request[MOVES, i] != STAYS and beyond(request, i):
            facts[BRAKES] = 1.0
        if length != 1.0:
            handed[MAX_RATE, i] = min(handed[MAX_RATE, i], UNREACHED)
            handed[MAX_SECOND, i] = min(handed[MAX_SECOND, i], UNREACHED)


@kernel
def beyond(request, i):
    """Whether an axis is, or will be, beyond its limits whatever it does; with a margin for rounding."""
    fast = axis_need(request, i, request[MAX_JERK, i]) > request[MAX_RATE, i] * (1.0 - 1e-9)
    return fast or abs(request[SECOND, i]) > request[MAX_SECOND, i] * (1.0 - 1e-9)


@kernel
def axis_need(request, i, jerk):
    """|velocity| that axis i cannot avoid: now, or once its acceleration has been taken away."""
    v, a = request[RATE, i], request[SECOND, i]
    return max(abs(v), abs(v + a * abs(a) / (2.0 * jerk)))


@kernel
def load(plan, request, facts, pieces):
    """Turn the planner's pieces (see `Planner`) into a plan; False where they break a limit or miss the target."""
    facts[DURATION] = facts[FAST_UNTIL] = 0.0
    at, brake_at = 0, 0
    for i in range(request.shape[1]):
        brake_at += 2 * MAIN * int(request[MOVES, i] != STAYS)
    for i in range(request.shape[1]):
        row = i * ROW
        if request[MOVES, i] == STAYS:
            hold_row(plan, row, request[RATE, i])
            continue
        for k in range(MAIN):
            plan[row + BRAKE + k] = pieces[at + k]
            plan[row + JERK + BRAKE + k] = pieces[at + MAIN + k]
        for k in range(BRAKE):
            plan[row + k] = pieces[brake_at + k] if facts[BRAKES] != 0.0 else 0.0
            plan[row + JERK + k] = pieces[brake_at + BRAKE + k] if facts[BRAKES] != 0.0 else 0.0
        at += 2 * MAIN
        brake_at += 2 * BRAKE
        time, length = request[TIME, i], request[LENGTH, i]
        for k in range(PIECES):
            plan[row + k] = max(plan[row + k], 0.0) * time
            plan[row + JERK + k] *= length / (time * time * time)
        integrate_row(plan, row, request[RATE, i], request[SECOND, i])
        if request[MOVES, i] == TO_POSITION:
            trim_cruise(plan, row, request[TARGET, i])
        if not ends_well(plan, row, request, i):
            return False
        facts[DURATION] = max(facts[DURATION], plan[row + LAST])
        facts[FAST_UNTIL] = max(facts[FAST_UNTIL], slow_from(plan, row, request[MAX_RATE, i]))
    return True


@kernel
def load_changes(plan, request, facts):
    """A plan for axes that move to velocities only, in closed form; False where one does not, or starts too fast."""
    facts[DURATION] = facts[FAST_UNTIL] = 0.0
    if facts[BRAKES] != 0.0:
        return False
    for i in range(request.shape[1]):
        row, rate = i * ROW, request[RATE, i]
        hold_row(plan, row, rate)
        if request[MOVES, i] == STAYS:
            continue
        change, second = request[TARGET, i] - rate, request[SECOND, i]
        if request[MOVES, i] != TO_VELOCITY:
            return False
        if not change_row(plan, row, change, second, request[MAX_SECOND, i], request[MAX_JERK, i]):
            return False
        if not ends_well(plan, row, request, i):
            return False
        facts[DURATION] = max(facts[DURATION], plan[row + LAST])
        facts[FAST_UNTIL] = max(facts[FAST_UNTIL], slow_from(plan, row, request[MAX_RATE, i]))
    return True


@kernel
def hold_row(plan, row, velocity):
    """An axis that keeps a constant velocity from position 0."""
    for k in range(row, row + ROW):
        plan[k] = 0.0
    for k in range(NODES):
        plan[row + VELOCITY + k] = velocity


@kernel
def release_row(plan, row, velocity, acceleration, jerk):
    """An axis that takes its acceleration away and keeps the velocity that is left."""
    hold_row(plan, row, velocity)
    plan[row + JERK] = -jerk if acceleration > 0.0 else jerk
    plan[row] = abs(acceleration) / jerk
    integrate_row(plan, row, velocity, acceleration)
    plan[row + ACCELERATION + LAST] = 0.0


@kernel
def ramp_row(plan, row, velocity, accel, jerk):
    """An axis without acceleration that comes to rest."""
    hold_row(plan, row, 0.0)
    rise = min(accel / jerk, (abs(velocity) / jerk) ** 0.5)
    flat = max(abs(velocity) / accel - accel / jerk, 0.0)
    plan[row + JERK] = -jerk if velocity > 0.0 else jerk
    plan[row + JERK + 2] = -plan[row + JERK]
    plan[row], plan[row + 1], plan[row + 2] = rise, flat, rise
    integrate_row(plan, row, velocity, 0.0)
    plan[row + VELOCITY + LAST] = plan[row + ACCELERATION + LAST] = 0.0


@kernel
def change_row(plan, row, change, acceleration, accel, jerk):
    """An axis that changes its velocity as fast as its limits allow; False where it is beyond them at the start.

    `row` has its velocity already. At the end there is no acceleration.
    """
    velocity = plan[row + VELOCITY]
    # What is left to change once the present acceleration has been taken away says which way to push.
    left = change - acceleration * abs(acceleration) / (2.0 * jerk)
    sign = 1.0 if left >= 0.0 else -1.0
    now = sign * acceleration
    if now > accel or -now > accel:
        return False
    peak = max(jerk * sign * change + 0.5 * now * now, 0.0) ** 0.5
    flat = 0.0
    if peak > accel:
        flat = (sign * change - (2.0 * accel * accel - now * now) / (2.0 * jerk)) / accel
        peak = accel
    plan[row], plan[row + 1], plan[row + 2] = max(peak - now, 0.0) / jerk, max(flat, 0.0), peak / jerk
    plan[row + JERK], plan[row + JERK + 2] = sign * jerk, -sign * jerk
    integrate_row(plan, row, velocity, acceleration)
    return True


@kernel
def integrate_row(plan, row, velocity, acceleration):
    """Fill the nodes of a row whose durations and jerks are set, from position 0, and the sum of the durations."""
    t, p, v, a = 0.0, 0.0, velocity, acceleration
    for k in range(NODES):
        plan[row + POSITION + k] = p
        plan[row + VELOCITY + k] = v
        plan[row + ACCELERATION + k] = a
        if k < PIECES:
            h, j = plan[row + k], plan[row + JERK + k]
            t += h
            p += h * (v + h * (a / 2.0 + h * j / 6.0))
            v += h * (a + h * j / 2.0)
            a += h * j
    plan[row + LAST] = t


@kernel
def trim_cruise(plan, row, target):
    """Let the piece of constant velocity take up what is missing at the end.

    Ruckig's synchronised profiles end up to 1e-8 beside the target (its own tolerance), and all that do have such a
    piece; its duration changes by a few microseconds at most.
    """
    missing = target - plan[row + POSITION + LAST]
    best, fastest = 0, 0.0
    for k in range(PIECES):
        flat = plan[row + JERK + k] == 0.0 and abs(plan[row + ACCELERATION + k]) < 1e-9
        if flat and plan[row + k] > 0.0 and abs(plan[row + VELOCITY + k]) > fastest:
            best, fastest = k, abs(plan[row + VELOCITY + k])
    if fastest == 0.0:
        return
    more = missing / plan[row + VELOCITY + best]
    if abs(missing) > 1e-7 * (1.0 + abs(target)) or plan[row + best] + more < 0.0:
        return
    plan[row + best] += more
    plan[row + LAST] += more
    for k in range(best + 1, NODES):
        plan[row + POSITION + k] += missing


@kernel
def ends_well(plan, row, request, i):
    """Check one axis against its limits and its target, then make the end exact."""
    target = request[TARGET, i]
    rate, second, jerk = request[MAX_RATE, i], request[MAX_SECOND, i], request[MAX_JERK, i]
    good = True
    for k in range(PIECES):
        good &= abs(plan[row + JERK + k]) <= jerk * (1.0 + 1e-9) or plan[row + k] == 0.0
        good &= abs(plan[row + ACCELERATION + k]) <= max(second, abs(request[SECOND, i])) * (1.0 + 1e-6)
    if request[MOVES, i] == TO_POSITION:
        good &= peak_speed(plan, row) <= max(rate, axis_need(request, i, jerk)) * (1.0 + 1e-6)
        good &= abs(plan[row + POSITION + LAST] - target) <= 10.0 * NEAR * (1.0 + abs(target))
        plan[row + POSITION + LAST] = target
        target = 0.0
    good &= abs(plan[row + VELOCITY + LAST] - target) <= 1e-9 * (rate + abs(target))
    plan[row + VELOCITY + LAST] = target
    plan[row + ACCELERATION + LAST] = 0.0
    return good


@kernel
def peak_speed(plan, row):
    """Largest |velocity| of a row, at the nodes and where the acceleration passes zero between them."""
    peak = 0.0
    for k in range(NODES):
        v, a = plan[row + VELOCITY + k], plan[row + ACCELERATION + k]
        peak = max(peak, abs(v))
        if k < PIECES and a * plan[row + ACCELERATION + k + 1] < 0.0:
            peak = max(peak, abs(v - a * a / (2.0 * plan[row + JERK + k])))
    return peak


@kernel
def extent(plan, row):
    """Smallest and largest position of a row, at the nodes and where the velocity passes zero between them."""
    low = high = 0.0
    for k in range(NODES):
        p, v, a = plan[row + POSITION + k], plan[row + VELOCITY + k], plan[row + ACCELERATION + k]
        low, high = min(low, p), max(high, p)
        if k == PIECES:
            break
        j, h = plan[row + JERK + k], plan[row + k]
        for sign in range(-1, 2, 2):  # v + a t + j t^2 / 2 = 0, in the form that does not cancel
            root = a * a - 2.0 * j * v
            below = a + sign * (root**0.5 if root > 0.0 else 0.0)
            t = -2.0 * v / below if root >= 0.0 and below != 0.0 else -1.0
            if 0.0 < t < h:
                turn = p + t * (v + t * (a / 2.0 + t * j / 6.0))
                low, high = min(low, turn), max(high, turn)
    return low, high


@kernel
def slow_from(plan, row, rate):
    """First time from which on no node is above a velocity."""
    t = last = 0.0
    for k in range(NODES):
        t += plan[row + k]
        if abs(plan[row + VELOCITY + k]) > rate * (1.0 + 1e-9):
            last = t
    return min(last, plan[row + LAST])


@kernel
def evaluate_row(plan, row, time):
    """(position, velocity, acceleration) of a row at a time."""
    k, h = 0, time
    while k < PIECES and plan[row + k] <= h:
        h -= plan[row + k]
        k += 1
    p, v, a = plan[row + POSITION + k], plan[row + VELOCITY + k], plan[row + ACCELERATION + k]
    j = plan[row + JERK + k] if k < PIECES else 0.0
    return p + h * (v + h * (a / 2.0 + h * j / 6.0)), v + h * (a + h * j / 2.0), a + h * j
