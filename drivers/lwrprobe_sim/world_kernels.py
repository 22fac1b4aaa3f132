"""One cycle of the simulated world: arm, touch, wrench, samples, link collisions, in one call.

All state lives in two arrays, so that the call from Python stays cheap: `world` (float64) and `counts` (int64), laid
out by the constants below. A part of `world` ends where the next one begins.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import LOWER, SPEED, UPPER, axes_to_jacobian, tip_and_axes, tip_frame
from lwrprobe_sim import body_kernels as body
from lwrprobe_sim import contact_kernels as contact
from lwrprobe_sim import link_kernels as links
from lwrprobe_sim import scenery_kernels as scenery
from lwrprobe_sim import sensor_kernels as sensor
from lwrprobe_sim import touch_kernels as touch

JOINTS_MAX = 16
DELAY_MAX = 64
QUEUE = 256
RECENT_MAX = 16
_ROUNDS = 6
"""How often at most the contact planes are searched again in one step."""
_FLATNESS_ERROR = 1e-5
"""N, allowed force error of a contact plane in place of a surface that is as round as the sphere."""
RECORD = 14
"""True wrench 6, contact point 3, normal 3, force, number of contacts at one instant."""

# --- settings
CYCLE, LAG_DECAY, ENCODER, BRAKE = range(4)
RELAX, TIP_MASS, SENSOR_DISTANCE, LOAD, SLOW, INERTIA = range(4, 10)
COMPLIANCE = 10  # 3, m/N in the tip frame
LOAD_CENTRE = 13  # 3, m in the sensor frame
GRAVITY = 16  # 3, m/s^2
JOINT_COMPLIANCE = 19  # JOINTS_MAX, rad/(N m)
SENSOR = JOINT_COMPLIANCE + JOINTS_MAX
SCENERY = SENSOR + sensor.SETTINGS
BODY = SCENERY + scenery.SETTINGS
TOUCH = BODY + body.SETTINGS
WATCH = TOUCH + touch.SETTINGS
# --- state
SET = WATCH + links.SETTINGS  # set point of the last cycle
SET_SPEED = SET + JOINTS_MAX
Q = SET_SPEED + JOINTS_MAX  # where the motors are
Q_MEASURED = Q + JOINTS_MAX
QD = Q_MEASURED + JOINTS_MAX
TIP = QD + JOINTS_MAX  # 12, frame tuple of the undeflected tip
CENTRE = TIP + 12  # 3, the sphere's centre
BEND = CENTRE + 3  # 3, stick's deflection, world frame
VELOCITY = BEND + 3  # 3, of the sphere
LOAD_AT = VELOCITY + 3  # 3, the load's centre of mass
LOAD_SPEED = LOAD_AT + 3  # 3
TIME, PEAK, SPHERE_FORCE = range(LOAD_SPEED + 3, LOAD_SPEED + 6)
TOUCHED = LOAD_SPEED + 6  # 3, point of the last main contact
RECORD_OLD = TOUCHED + 3
RECORD_NEW = RECORD_OLD + RECORD
LAST_SAMPLE = RECORD_NEW + RECORD
# --- scratch of one cycle
GOAL = LAST_SAMPLE + sensor.SAMPLE  # JOINTS_MAX, motors at the end of the cycle
START = GOAL + JOINTS_MAX  # JOINTS_MAX, motors at its beginning
LOAD_FORCE = START + JOINTS_MAX  # 3, weight and inertia of the load, world frame
INSTANT = LOAD_FORCE + 3  # RECORD, interpolated to the instant of a sample
FRESH = INSTANT + RECORD  # the newest sample
# --- scratch of one step: centre = FREE + CARRIER[0] @ sum(lever force) + CARRIER[1] @ sum(force)
CARRIER = FRESH + sensor.SAMPLE  # 2 x 3 x 3, m/N, compliance of stick and of joints
FREE = CARRIER + 18  # 3, the sphere's centre without contact
SOFTENED = FREE + 3  # 2 x 3 x 3, m/N, CARRIER and, with the joints, the movable object's compliance
REFERENCE = SOFTENED + 18  # 3, centre that the gaps belong to; after the balance where the centre has come to
FREE_FROM_REFERENCE = REFERENCE + 3  # 2 x 3
SHIFT = FREE_FROM_REFERENCE + 6  # 2 x 3, displacement of the centre from REFERENCE
TIP_TURN = SHIFT + 6  # 3, rotation vector of the tip
BALANCE = TIP_TURN + 3  # scratch of `contact_kernels.settle`
# --- queues and rows
LINE = BALANCE + contact.SCRATCH  # delayed set points, DELAY_MAX x JOINTS_MAX
ROWS_OLD = LINE + DELAY_MAX * JOINTS_MAX
ROWS = ROWS_OLD + touch.ROWS_MAX * contact.WIDTH
WAITING = ROWS + touch.ROWS_MAX * contact.WIDTH
READY = WAITING + QUEUE * sensor.SAMPLE
JACOBIAN = READY + QUEUE * sensor.SAMPLE
RECENT = JACOBIAN + 6 * JOINTS_MAX
LINK_SIDE = RECENT + 6 * RECENT_MAX  # joint values behind the gears
PLAYED = LINK_SIDE + JOINTS_MAX  # joint values behind the gears' play alone
RIPPLE_PHASE = PLAYED + JOINTS_MAX
JOINT_PLAY, RIPPLE, PROBE_FORCE, PROBE_PEAK = range(RIPPLE_PHASE + JOINTS_MAX, RIPPLE_PHASE + JOINTS_MAX + 4)
WORLD = RIPPLE_PHASE + JOINTS_MAX + 4
RIPPLES = 320.0
"""Waves a turn of a joint: two a turn of the motor of a harmonic drive of ratio 160."""

# --- counts
CYCLES, STEPS, JOINTS, DELAY, SEED, TAKEN, N_WAITING, N_READY, GAP, BRAKING = range(10)
N_ROWS, N_FOUND, FIXED_LIMITS, UNBALANCED, HAS_JOINT_COMPLIANCE, NEAR_STEPS = range(10, 16)
HAS_GEARS = 16
SCENERY_COUNTS = 17
WATCH_COUNTS = SCENERY_COUNTS + scenery.COUNTS
COUNTS = WATCH_COUNTS + links.COUNTS


@kernel
def accept(world, counts, chain, q):
    """Take the set point q (n,) for the next cycle; 0, or i + 1 for a joint limit, -(i + 1) for a jump of joint i."""
    n = counts[JOINTS]
    reach = world[CYCLE] * (1.0 + 1e-6)
    for i in range(n):
        if not (chain[i + 1, LOWER] - 1e-9 <= q[i] <= chain[i + 1, UPPER] + 1e-9):
            return i + 1
        if not abs(q[i] - world[SET + i]) <= chain[i + 1, SPEED] * reach:
            return -(i + 1)
    for i in range(n):
        world[SET_SPEED + i] = (q[i] - world[SET + i]) / world[CYCLE]
        world[SET + i] = q[i]
    counts[BRAKING] = 0
    return 0


@kernel
def _advance(world, counts, chain, numbers, indices, truth):
    """Advance the world by one cycle; the samples that have arrived can then be fetched."""
    counts[CYCLES] += 1
    before = world[TIME]
    world[TIME] = counts[CYCLES] * world[CYCLE]
    _swap_records(world)
    goal, start = world[GOAL:START], world[START:LOAD_FORCE]
    _move_set_point(world, counts, chain, goal)
    steps = counts[STEPS]
    n = counts[JOINTS]
    q = world[Q : Q + JOINTS_MAX]
    joint_travel = 0.0
    for i in range(n):
        start[i] = q[i]
        joint_travel += abs(goal[i] - start[i]) / steps
    for k in range(steps):
        share = (k + 1.0) / steps
        for i in range(n):
            q[i] = start[i] + share * (goal[i] - start[i])
        _step(world, counts, chain, numbers, indices, world[CYCLE] / steps, joint_travel)
    _read_encoders(world, counts, start)
    if world[LOAD] > 0.0:
        _add_load(world)
    _sample(world, counts, truth, before)
    _deliver(world, counts)


@kernel
def step_many(world, counts, chain, numbers, indices, truth, rows, times, joints, max_deviation):
    """`accept` for each row of `rows` (m, n) and a cycle of the world for each of `times` (c,), c >= m.

    A cycle beyond the last row gets no set point. Fills times (c,) and measured joints (c, n). Ends after the first row
    from which a joint deviates by more than `max_deviation` [rad]. Returns the number of executed cycles and what
    `accept` returned for the next one. All cycles go through this kernel: each one that Python calls and that contains
    the world takes seconds to compile.
    """
    n = counts[JOINTS]
    for k in range(times.shape[0]):
        commanded = k < rows.shape[0]
        if commanded:
            refused = accept(world, counts, chain, rows[k])
            if refused != 0:
                return k, refused
        _advance(world, counts, chain, numbers, indices, truth)
        times[k] = world[TIME]
        deviates = False
        for i in range(n):
            joints[k, i] = world[Q_MEASURED + i]
            deviates = deviates or (commanded and not abs(joints[k, i] - rows[k, i]) <= max_deviation)
        if deviates:
            return k + 1, 0
    return times.shape[0], 0


@kernel
def cycles_until_sample(world, counts, max_cycles):
    """Number of the next cycles, up to `max_cycles`, that end before a sample arrives."""
    if counts[N_READY] > 0:
        return 0
    s = world[SENSOR:SCENERY]
    number = counts[TAKEN] + 1
    arrival = number * s[sensor.PERIOD] + sensor.delay(s, counts[SEED], number)
    if counts[N_WAITING] > 0:
        arrival = world[WAITING + sensor.ARRIVAL]
    cycles = 0
    while cycles < max_cycles and (counts[CYCLES] + cycles + 1) * world[CYCLE] + 1e-12 < arrival:
        cycles += 1
    return cycles


@kernel
def _copy(row, to):
    for i in range(row.shape[0]):
        to[i] = row[i]


@kernel
def _swap_records(world):
    for i in range(RECORD):
        world[RECORD_OLD + i] = world[RECORD_NEW + i]
        world[RECORD_NEW + i] = 0.0


@kernel
def _move_set_point(world, counts, chain, goal):
    """Motor positions at the end of the cycle into goal (n,): the set point after delay line and lag."""
    n = counts[JOINTS]
    if counts[BRAKING] == 1:
        for i in range(n):
            speed = world[SET_SPEED + i]
            slower = math.copysign(max(0.0, abs(speed) - world[BRAKE] * world[CYCLE]), speed)
            ahead = world[SET + i] + slower * world[CYCLE]
            world[SET + i] = min(max(ahead, chain[i + 1, LOWER]), chain[i + 1, UPPER])
            world[SET_SPEED + i] = slower
    line = world[LINE:ROWS_OLD].reshape((DELAY_MAX, JOINTS_MAX))
    slot = counts[CYCLES] % DELAY_MAX
    late = (counts[CYCLES] - counts[DELAY]) % DELAY_MAX
    for i in range(n):
        line[slot, i] = world[SET + i]
        goal[i] = line[late, i] + world[LAG_DECAY] * (world[Q + i] - line[late, i])


@kernel
def _read_encoders(world, counts, start):
    sigma = world[ENCODER]
    for i in range(counts[JOINTS]):
        q = world[Q + i]
        world[QD + i] = (q - start[i]) / world[CYCLE]
        if sigma > 0.0:
            q += sigma * sensor.normal_pair(counts[SEED] + 1, 2 * i, counts[CYCLES])[0]
        world[Q_MEASURED + i] = q


@kernel
def _step(world, counts, chain, numbers, indices, step, joint_travel):
    """One physical step [s] to the present motor positions: stick, sphere, object and links."""
    jac = world[JACOBIAN:RECENT].reshape((6, JOINTS_MAX))
    at = Q
    if counts[HAS_GEARS] == 1:
        at = LINK_SIDE
        _apply_gears(world, counts)
        joint_travel *= 1.0 + RIPPLES * world[RIPPLE]
    q = world[at : at + JOINTS_MAX]
    tip = tip_and_axes(chain, q, jac)
    old, free, centre = world[TIP:CENTRE], world[FREE:SOFTENED], world[CENTRE:BEND]
    moved, turned = _tip_motion(old, tip)
    compliance = world[CARRIER:FREE].reshape((2, 3, 3))
    _carrier(world, tip, step, compliance[0], free)
    drift = math.sqrt((free[0] - centre[0]) ** 2 + (free[1] - centre[1]) ** 2 + (free[2] - centre[2]) ** 2)
    if touch.may_touch(world[TOUCH:WATCH], drift, moved, turned) or counts[N_ROWS] > 0:
        counts[NEAR_STEPS] += 1
        if counts[HAS_JOINT_COMPLIANCE] == 1:
            axes_to_jacobian(chain, tip, 1.0, 1.0, jac)
            _joint_compliance(world, counts, jac, compliance[1])
        _contact_step(world, counts, numbers, indices, tip, drift, step)
    else:
        counts[N_FOUND] = 0
        _free_step(world, tip, free, step)
    if counts[SCENERY_COUNTS + scenery.MOVABLE] == 1:
        _move_object(world, step)
    around, watched = counts[SCENERY_COUNTS:WATCH_COUNTS], counts[WATCH_COUNTS:COUNTS]
    links.watch(
        world[WATCH:SET], watched, world[SCENERY:BODY], around, numbers, indices,
        chain, q, tip, moved, turned, joint_travel,
    )  # fmt: skip
    for i in range(12):
        old[i] = tip[i]


@kernel
def _tip_motion(old, tip):
    """Distance [m] between two tip frames, and an upper bound of the angle [rad] (Frobenius norm)."""
    moved = math.sqrt((tip[9] - old[9]) ** 2 + (tip[10] - old[10]) ** 2 + (tip[11] - old[11]) ** 2)
    turned = 0.0
    for i in range(9):
        turned += (tip[i] - old[i]) ** 2
    return moved, math.sqrt(turned)


@kernel
def _move_object(world, step):
    """Move the movable object; all known clearances shrink by its motion."""
    shifted = body.move(world[BODY:TOUCH], world[SCENERY:BODY], step)
    world[TOUCH + touch.FREE_SPHERE] -= shifted
    world[TOUCH + touch.FREE_STICK] -= shifted
    world[WATCH + links.FREE] -= shifted
    world[WATCH + links.ARM_FREE] -= shifted


@kernel
def _apply_gears(world, counts):
    """Joint values on the link side: the motor positions after the gears' play, plus their ripple."""
    for i in range(counts[JOINTS]):
        q, half = world[Q + i], world[JOINT_PLAY]
        world[PLAYED + i] = min(max(world[PLAYED + i], q - half), q + half)
        world[LINK_SIDE + i] = world[PLAYED + i] + world[RIPPLE] * math.sin(RIPPLES * q + world[RIPPLE_PHASE + i])


@kernel
def _free_step(world, tip, free, step):
    """The end of a step without contact: the sphere's centre is at `free`, no force acts."""
    for i in range(3):
        world[VELOCITY + i] = (free[i] - world[CENTRE + i]) / step
        world[CENTRE + i] = free[i]
        world[BEND + i] = free[i] - tip[9 + i]
    for i in range(RECORD):
        world[RECORD_NEW + i] = 0.0
    for i in range(6):
        world[BODY + body.PUSH + i] = 0.0


@kernel
def _carrier(world, tip, step, compliance, free):
    """The affine law of the stick in this step, on joints that do not give way: centre = free + compliance @ force.

    Per axis of the tip, with stick compliance c, relaxation time t, mass m and the stick's deflection u, backward
    Euler of m c y'' + t u' + u = c f.
    """
    c = world[COMPLIANCE : COMPLIANCE + 3]
    compliance[:] = 0.0
    free[0], free[1], free[2] = tip[9], tip[10], tip[11]
    if c[0] == 0.0 and c[1] == 0.0 and c[2] == 0.0:
        return
    lag = world[RELAX] / step
    inertia = world[TIP_MASS] / (step * step)
    for a in range(3):
        if c[a] == 0.0:
            continue
        axis = (tip[3 * a], tip[3 * a + 1], tip[3 * a + 2])
        bend = axis[0] * world[BEND] + axis[1] * world[BEND + 1] + axis[2] * world[BEND + 2]
        coast = 0.0
        for i in range(3):
            coast += axis[i] * (world[CENTRE + i] + step * world[VELOCITY + i] - tip[9 + i])
        share = 1.0 / (1.0 + lag + inertia * c[a])
        rest = share * (lag * bend + inertia * c[a] * coast)
        for i in range(3):
            free[i] += rest * axis[i]
            for j in range(3):
                compliance[i, j] += share * c[a] * axis[i] * axis[j]


@kernel
def _joint_compliance(world, counts, jac, compliance):
    """The joints' compliance as it appears at the tip: J C J^T. What a push higher up the stick turns is left out."""
    compliance[:] = 0.0
    for k in range(counts[JOINTS]):
        soft = world[JOINT_COMPLIANCE + k]
        for i in range(3):
            for j in range(3):
                compliance[i, j] += soft * jac[i, k] * jac[j, k]


@kernel
def _contact_step(world, counts, numbers, indices, tip, drift, step):
    """Balance the contacts at the end of the step; forces into the new record and onto the movable object."""
    b = world[BODY:TOUCH]
    n = 0
    for _ in range(2):
        if counts[SCENERY_COUNTS + scenery.MOVABLE] == 1:
            body.respond(b, world[TOUCHED : TOUCHED + 3], step)
        n = _balance(world, counts, numbers, indices, tip, drift, step)
        _sum_forces(world, n, tip)
        if counts[SCENERY_COUNTS + scenery.MOVABLE] == 0:
            break
        _push_object(world, counts, n)
        if b[body.MODE] != body.RESTING or not body.breaks_loose(b):
            break
    _end_step(world, counts, n, tip, step)
    _into_sensor_frame(world, tip)


@kernel
def _balance(world, counts, numbers, indices, tip, drift, step):
    """Find the contact rows and balance them; REFERENCE becomes the centre after the step. Returns the row count.

    The frame is that of the movable object, which is held fixed during the step; its motion counts as compliance.
    Contacts with other objects in the same step see that motion one step late.
    """
    s, v = world[TOUCH:WATCH], world[SCENERY:BODY]
    rows = world[ROWS:WAITING].reshape((touch.ROWS_MAX, contact.WIDTH))
    old_rows = world[ROWS_OLD:ROWS].reshape((touch.ROWS_MAX, contact.WIDTH))
    old_tip, old_centre = world[TIP:CENTRE], world[CENTRE:BEND]
    softened, scratch = world[SOFTENED:REFERENCE].reshape((2, 3, 3)), world[BALANCE:LINE]
    reference, free = world[REFERENCE:FREE_FROM_REFERENCE], world[FREE_FROM_REFERENCE:SHIFT].reshape((2, 3))
    shift, turn = world[SHIFT:TIP_TURN].reshape((2, 3)), world[TIP_TURN:BALANCE]
    _rotation_vector(old_tip, tip, turn)
    _soften(world)
    for i in range(3):
        reference[i] = old_centre[i] + tip[9 + i] - old_tip[9 + i]
    # The joints have given way by so much: sphere and stick have moved alike.
    x = old_centre[0] - world[BEND] - old_tip[9]
    y = old_centre[1] - world[BEND + 1] - old_tip[10]
    z = old_centre[2] - world[BEND + 2] - old_tip[11]
    before = _moved(old_tip, x, y, z)
    n = 0
    done = 1
    reach = drift + touch.MARGIN
    # The balance takes each surface for a plane: search again at the new centre until the curvature adds no force.
    for _ in range(_ROUNDS):
        now = _moved(tip, x, y, z)
        n = touch.find(s, v, counts[SCENERY_COUNTS:WATCH_COUNTS], numbers, indices, now, reference, reach, rows)
        touch.inherit(rows, n, old_rows, counts[N_ROWS], old_centre, before, s[touch.STICK_LENGTH], turn)
        given = (x, y, z)
        for i in range(3):
            free[0, i] = world[FREE + i] + given[i] - reference[i]
            free[1, i] = -world[BODY + body.AHEAD + i] - given[i]
            shift[0, i] = shift[1, i] = 0.0
        done = contact.settle(rows, n, free, softened, step, world[SLOW], shift, scratch)
        square = 0.0
        for i in range(3):
            both = shift[0, i] + shift[1, i]
            reference[i] += both
            square += both * both
        x, y, z = x + shift[1, 0], y + shift[1, 1], z + shift[1, 2]
        if square * touch.stiffest(rows, n) < 2.0 * s[touch.RADIUS] * _FLATNESS_ERROR:
            break
        reach = touch.MARGIN
    counts[FIXED_LIMITS] += done == 2
    counts[UNBALANCED] += done == 0
    return n


@kernel
def _moved(frame, x, y, z):
    """The frame moved by x, y, z m."""
    return (
        frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], frame[6], frame[7], frame[8],
        frame[9] + x, frame[10] + y, frame[11] + z,
    )  # fmt: skip


@kernel
def _soften(world):
    """SOFTENED = CARRIER, and with the joints the movable object's compliance: both move sphere and stick alike."""
    for i in range(9):
        world[SOFTENED + i] = world[CARRIER + i]
        world[SOFTENED + 9 + i] = world[CARRIER + 9 + i] + world[BODY + body.GIVE + i]


@kernel
def _rotation_vector(old, new, out):
    """Small rotation from one frame to the next: half the sum of old axis x new axis."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = 0.0
        for a in range(3):
            out[i] += 0.5 * (old[3 * a + j] * new[3 * a + k] - old[3 * a + k] * new[3 * a + j])


@kernel
def _sum_forces(world, n, tip):
    """Total force, torque about the tip (both world frame) and main contact of the balanced rows into the record."""
    rows = world[ROWS:WAITING].reshape((touch.ROWS_MAX, contact.WIDTH))
    record = world[RECORD_NEW : RECORD_NEW + RECORD]
    record[:] = 0.0
    main = -1
    best = 0.0
    on_sphere, on_stick = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    total, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n):
        row = rows[i]
        if row[contact.PRESS] <= 0.0:
            continue
        record[13] += 1.0
        force = (row[contact.FORCE], row[contact.FORCE + 1], row[contact.FORCE + 2])
        total = _plus(total, force)
        torque = _plus(torque, _cross(_arm(row, tip[9], tip[10], tip[11]), force))
        if row[contact.LEVER] == 1.0:
            on_sphere = _plus(on_sphere, force)
            if _length(force) > best:
                best, main = _length(force), i
        else:
            on_stick = _plus(on_stick, force)
    world[SPHERE_FORCE] = _length(on_sphere)
    world[PROBE_FORCE] = max(_length(on_stick), max(_length(total), world[SPHERE_FORCE]))
    for i in range(3):
        record[i], record[3 + i] = total[i], torque[i]
    if main < 0:
        return
    row = rows[main]
    record[12] = best
    for j in range(3):
        depth = row[contact.GAP] + row[contact.RADIUS]
        world[TOUCHED + j] = row[contact.CENTRE + j] - depth * row[contact.NORMAL + j]
        record[6 + j] = world[TOUCHED + j]
        record[9 + j] = row[contact.NORMAL + j]


@kernel
def _arm(row, x, y, z):
    """Vector from a point to the contact point on the undeformed ball of the probe."""
    r = row[contact.RADIUS]
    return (
        row[contact.CENTRE] - r * row[contact.NORMAL] - x,
        row[contact.CENTRE + 1] - r * row[contact.NORMAL + 1] - y,
        row[contact.CENTRE + 2] - r * row[contact.NORMAL + 2] - z,
    )


@kernel
def _plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _length(a):
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel
def _push_object(world, counts, n):
    """Wrench of the probe on the movable object, about the middle of its foot."""
    rows = world[ROWS:WAITING].reshape((touch.ROWS_MAX, contact.WIDTH))
    b = world[BODY:TOUCH]
    x, y = body.foot_middle(b)
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n):
        row = rows[i]
        if row[contact.BODY] == 1.0 + counts[SCENERY_COUNTS + scenery.FIXED]:
            pushed = (-row[contact.FORCE], -row[contact.FORCE + 1], -row[contact.FORCE + 2])
            force = _plus(force, pushed)
            torque = _plus(torque, _cross(_arm(row, x, y, b[body.BASE]), pushed))
    for i in range(3):
        b[body.PUSH + i], b[body.PUSH + 3 + i] = force[i], torque[i]


@kernel
def _end_step(world, counts, n, tip, step):
    """State at the end of a step with contacts: sphere, stick, and the rows that press."""
    rows = world[ROWS:WAITING].reshape((touch.ROWS_MAX, contact.WIDTH))
    old_rows = world[ROWS_OLD:ROWS].reshape((touch.ROWS_MAX, contact.WIDTH))
    stick, joints = world[CARRIER : CARRIER + 9].reshape((3, 3)), world[CARRIER + 9 : FREE].reshape((3, 3))
    free, reference, b = world[FREE:SOFTENED], world[REFERENCE:FREE_FROM_REFERENCE], world[BODY:TOUCH]
    kept = 0
    bending, total = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n):
        row = rows[i]
        if row[contact.PRESS] > 0.0:
            a = row[contact.LEVER]
            total = _plus(total, (row[contact.FORCE], row[contact.FORCE + 1], row[contact.FORCE + 2]))
            bending = _plus(bending, (a * row[contact.FORCE], a * row[contact.FORCE + 1], a * row[contact.FORCE + 2]))
            _copy(row, old_rows[kept])
            kept += 1
    counts[N_ROWS], counts[N_FOUND] = kept, n
    world[PEAK] = max(world[PEAK], world[SPHERE_FORCE])
    world[PROBE_PEAK] = max(world[PROBE_PEAK], world[PROBE_FORCE])
    for i in range(3):
        centre = reference[i]
        given = joints[i, 0] * total[0] + joints[i, 1] * total[1] + joints[i, 2] * total[2]
        if b[body.MODE] != body.RESTING:
            bent = stick[i, 0] * bending[0] + stick[i, 1] * bending[1] + stick[i, 2] * bending[2]
            centre = free[i] + bent + given
        world[VELOCITY + i] = (centre - world[CENTRE + i]) / step
        world[CENTRE + i] = centre
        world[BEND + i] = centre - tip[9 + i] - given


@kernel
def _into_sensor_frame(world, tip):
    """Transform the new record's wrench from the undeflected tip, world axes, to the sensor frame."""
    r = world[RECORD_NEW : RECORD_NEW + 6]
    # the sensor is behind the tip, and moves with it when the joints give way
    arm = (
        world[SENSOR_DISTANCE] * tip[6] + tip[9] - (world[CENTRE] - world[BEND]),
        world[SENSOR_DISTANCE] * tip[7] + tip[10] - (world[CENTRE + 1] - world[BEND + 1]),
        world[SENSOR_DISTANCE] * tip[8] + tip[11] - (world[CENTRE + 2] - world[BEND + 2]),
    )
    force = (r[0], r[1], r[2])
    torque = _plus((r[3], r[4], r[5]), _cross(arm, force))
    for i in range(3):
        r[i] = tip[3 * i] * force[0] + tip[3 * i + 1] * force[1] + tip[3 * i + 2] * force[2]
        r[3 + i] = tip[3 * i] * torque[0] + tip[3 * i + 1] * torque[1] + tip[3 * i + 2] * torque[2]


@kernel
def _add_load(world):
    """Add weight and inertia of the load behind the sensor to the new record's wrench."""
    tip = world[TIP:CENTRE]
    c0, c1, c2 = world[LOAD_CENTRE], world[LOAD_CENTRE + 1], world[LOAD_CENTRE + 2]
    pull = world[LOAD_FORCE:INSTANT]
    for i in range(3):
        at = tip[9 + i] - world[SENSOR_DISTANCE] * tip[6 + i] + tip[i] * c0 + tip[3 + i] * c1 + tip[6 + i] * c2
        speed = (at - world[LOAD_AT + i]) / world[CYCLE]
        pull[i] = world[LOAD] * (world[GRAVITY + i] - world[INERTIA] * (speed - world[LOAD_SPEED + i]) / world[CYCLE])
        world[LOAD_AT + i], world[LOAD_SPEED + i] = at, speed
    f0 = tip[0] * pull[0] + tip[1] * pull[1] + tip[2] * pull[2]
    f1 = tip[3] * pull[0] + tip[4] * pull[1] + tip[5] * pull[2]
    f2 = tip[6] * pull[0] + tip[7] * pull[1] + tip[8] * pull[2]
    world[RECORD_NEW] += f0
    world[RECORD_NEW + 1] += f1
    world[RECORD_NEW + 2] += f2
    world[RECORD_NEW + 3] += c1 * f2 - c2 * f1
    world[RECORD_NEW + 4] += c2 * f0 - c0 * f2
    world[RECORD_NEW + 5] += c0 * f1 - c1 * f0


@kernel
def _sample(world, counts, truth, before):
    """Take all samples whose instants lie in this cycle, and send those that are not lost."""
    s = world[SENSOR:SCENERY]
    record, fresh = world[INSTANT:FRESH], world[FRESH:CARRIER]
    while (counts[TAKEN] + 1) * s[sensor.PERIOD] <= world[TIME] + 1e-12:
        counts[TAKEN] += 1
        number = counts[TAKEN]
        instant = number * s[sensor.PERIOD]
        _interpolate(world, min(1.0, (instant - before) / (world[TIME] - before)), record)
        if number < truth.shape[0]:
            for i in range(8):
                truth[number, i] = record[6 + i]
        if sensor.lost(s, counts[SEED], number):
            counts[GAP] = 1
            continue
        sensor.measure(s, counts[SEED], number, instant, record, fresh)
        for i in range(6):
            world[RECENT + 6 * (number % RECENT_MAX) + i] = fresh[sensor.FORCE + i]
        _send(world, counts, number, instant)


@kernel
def _send(world, counts, number, instant):
    """Put the fresh sample into the line of waiting ones, with the faults of the transmission."""
    s = world[SENSOR:SCENERY]
    waiting = world[WAITING:READY].reshape((QUEUE, sensor.SAMPLE))
    fresh, last = world[FRESH:CARRIER], world[LAST_SAMPLE:GOAL]
    if s[sensor.FREEZE_FROM] <= instant < s[sensor.FREEZE_TO]:
        _copy(last, fresh)
    elif counts[GAP] == 1:
        fresh[sensor.STATUS] += sensor.LOST_BEFORE
        counts[GAP] = 0
    wait = sensor.delay(s, counts[SEED], number)
    if wait > s[sensor.LATE_LIMIT]:
        fresh[sensor.STATUS] = int(fresh[sensor.STATUS]) | sensor.LATE
    # the line keeps the order: one late sample delays those behind it
    fresh[sensor.ARRIVAL] = max(instant + wait, last[sensor.ARRIVAL])
    _copy(fresh, last)
    if counts[N_WAITING] < QUEUE:
        _copy(fresh, waiting[counts[N_WAITING]])
        counts[N_WAITING] += 1
    else:
        counts[GAP] = 1


@kernel
def _interpolate(world, share, out):
    """The record at a share of the cycle: linear if both ends have the same contact, else the nearer end's contact."""
    old, new = world[RECORD_OLD : RECORD_OLD + RECORD], world[RECORD_NEW : RECORD_NEW + RECORD]
    for i in range(6):
        out[i] = old[i] + share * (new[i] - old[i])
    alike = old[13] == new[13] and old[9] * new[9] + old[10] * new[10] + old[11] * new[11] > 0.99
    nearer = new if share >= 0.5 else old
    for i in range(6, RECORD):
        out[i] = old[i] + share * (new[i] - old[i]) if alike else nearer[i]


@kernel
def _deliver(world, counts):
    """Move the samples that have arrived from WAITING to READY; a full READY drops its oldest sample."""
    waiting = world[WAITING:READY].reshape((QUEUE, sensor.SAMPLE))
    ready = world[READY:JACOBIAN].reshape((QUEUE, sensor.SAMPLE))
    arrived = 0
    while arrived < counts[N_WAITING] and waiting[arrived, sensor.ARRIVAL] <= world[TIME] + 1e-12:
        if counts[N_READY] == QUEUE:
            for k in range(QUEUE - 1):
                _copy(ready[k + 1], ready[k])
            counts[N_READY] -= 1
        _copy(waiting[arrived], ready[counts[N_READY]])
        counts[N_READY] += 1
        arrived += 1
    if arrived > 0:
        for k in range(counts[N_WAITING] - arrived):
            _copy(waiting[k + arrived], waiting[k])
        counts[N_WAITING] -= arrived


@kernel
def place(world, counts, chain):
    """Put the arm at world[Q], at rest and without contact."""
    n = counts[JOINTS]
    line = world[LINE:ROWS_OLD].reshape((DELAY_MAX, JOINTS_MAX))
    for i in range(n):
        world[SET + i] = world[Q_MEASURED + i] = world[Q + i]
        world[SET_SPEED + i] = world[QD + i] = 0.0
        for k in range(DELAY_MAX):
            line[k, i] = world[Q + i]
    at = Q
    if counts[HAS_GEARS] == 1:
        at = LINK_SIDE
        for i in range(n):
            world[PLAYED + i] = world[Q + i]
        _apply_gears(world, counts)
    tip = tip_frame(chain, world[at : at + JOINTS_MAX])
    for i in range(12):
        world[TIP + i] = tip[i]
    for i in range(3):
        world[CENTRE + i] = tip[9 + i]
        world[BEND + i] = world[VELOCITY + i] = world[LOAD_SPEED + i] = 0.0
        world[LOAD_AT + i] = tip[9 + i] - world[SENSOR_DISTANCE] * tip[6 + i]
        for a in range(3):
            world[LOAD_AT + i] += tip[3 * a + i] * world[LOAD_CENTRE + a]
    counts[N_ROWS] = 0
    for i in range(RECORD):
        world[RECORD_OLD + i] = world[RECORD_NEW + i] = 0.0
    if world[LOAD] > 0.0:
        _add_load(world)
