"""One object that slides on the table or tips over an edge of its foot when it is pushed too hard.

Sliding is planar with three coordinates (x, y, radius of gyration times turn), in which the inertia is the same in
all directions and the friction of the foot is a ball of radius grip * load: the ellipsoidal limit surface of Goyal,
Ruina and Papadopoulos (Wear 143, 1991). Tipping turns about one side of the foot's bounding rectangle. Mass is spread
as in the object's bounding box.

In a step the object answers the probe's force -f at a contact with the displacement `AHEAD - GIVE @ f`, which the
contact step takes in just as it takes in the probe's compliance.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe_sim.scenery_kernels import POSE

MASS, GRIP, GRAVITY, GYRATION, BASE, HEIGHT = range(6)
LOWER, UPPER = 6, 8  # 2 each, foot's rectangle at the start
PLACE, SPEED, DIRECTION = 10, 13, 16  # 3 each: x, y, turn; velocities of x, y, gyration * turn; unit, of sliding
LEAN, LEAN_RATE, SIDE, MODE = 19, 20, 21, 22
GIVE, AHEAD = 23, 32  # 9, 3
PUSH = 35  # force on the object 3, torque about the middle of its foot 3
SETTINGS = 41

RESTING, SLIDING, TIPPING, LYING = range(4)


@kernel
def respond(b, at, step):
    """GIVE and AHEAD for a contact at `at` (3,) in the present mode."""
    for i in range(12):
        b[GIVE + i] = 0.0
    if b[MODE] == SLIDING:
        ease = step * step / b[MASS]
        x, y = foot_middle(b)
        turn_x, turn_y = -(at[1] - y) / b[GYRATION], (at[0] - x) / b[GYRATION]
        b[GIVE] = ease * (1.0 + turn_x * turn_x)
        b[GIVE + 1] = b[GIVE + 3] = ease * turn_x * turn_y
        b[GIVE + 4] = ease * (1.0 + turn_y * turn_y)
        drop = step * _braking(b)
        turning = b[SPEED + 2] - drop * b[DIRECTION + 2]
        b[AHEAD] = step * (b[SPEED] - drop * b[DIRECTION] + turn_x * turning)
        b[AHEAD + 1] = step * (b[SPEED + 1] - drop * b[DIRECTION + 1] + turn_y * turning)
    elif b[MODE] == TIPPING:
        arm = _arm(b, at[0], at[1], at[2], int(b[SIDE]))
        rate = b[LEAN_RATE] - step * _righting(b, int(b[SIDE]), b[LEAN]) / _tipping_inertia(b)
        for i in range(3):
            b[AHEAD + i] = step * rate * arm[i]
            for j in range(3):
                b[GIVE + 3 * i + j] = step * step / _tipping_inertia(b) * arm[i] * arm[j]


@kernel
def breaks_loose(b):
    """Whether PUSH moves the resting object; MODE then holds how."""
    force, limit = _generalised(b), b[GRIP] * _weight(b)
    size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    side, tips = _overturned(b, 0.0, 0.0)
    slides = size / limit if limit > 0.0 else 1e9 * size
    if max(slides, tips) <= 1.0:
        return False
    b[LEAN_RATE] = 0.0
    if tips > slides:
        b[MODE], b[SIDE] = TIPPING, side
        return True
    b[MODE] = SLIDING
    for i in range(3):
        b[DIRECTION + i] = force[i] / size
        b[SPEED + i] = 0.0
    return True


@kernel
def move(b, v, step):
    """Advance the object one step under PUSH; its pose into `v`. Returns an upper bound of the motion of its points."""
    moved = 0.0
    if b[MODE] == SLIDING:
        moved = _slide(b, step)
    elif b[MODE] == TIPPING:
        moved = _tip(b, step)
    if moved > 0.0:
        _write_pose(b, v)
    return moved


@kernel
def _slide(b, step):
    force = _generalised(b)
    drop = step * _braking(b)
    pull_x = b[PUSH] - b[MASS] * _braking(b) * b[DIRECTION]
    pull_y = b[PUSH + 1] - b[MASS] * _braking(b) * b[DIRECTION + 1]
    along = square = 0.0
    for i in range(3):
        b[SPEED + i] += step * force[i] / b[MASS] - drop * b[DIRECTION + i]
        along += b[SPEED + i] * b[DIRECTION + i]
        square += b[SPEED + i] ** 2
    if along <= 0.0:
        b[SPEED] = b[SPEED + 1] = b[SPEED + 2] = 0.0
        b[MODE] = RESTING
        return 0.0
    speed = math.sqrt(square)
    for i in range(3):
        b[DIRECTION + i] = b[SPEED + i] / speed
    b[PLACE] += step * b[SPEED]
    b[PLACE + 1] += step * b[SPEED + 1]
    b[PLACE + 2] += step * b[SPEED + 2] / b[GYRATION]
    side, tips = _overturned(b, pull_x, pull_y)
    if tips > 1.0:
        b[MODE], b[SIDE] = TIPPING, side
        b[SPEED] = b[SPEED + 1] = b[SPEED + 2] = b[LEAN_RATE] = 0.0
    return step * (math.hypot(b[SPEED], b[SPEED + 1]) + abs(b[SPEED + 2]) / b[GYRATION] * _size(b)) + 1e-12


@kernel
def _tip(b, step):
    side = int(b[SIDE])
    torque = _tipping_torque(b, side) - _righting(b, side, b[LEAN])
    b[LEAN_RATE] += step * torque / _tipping_inertia(b)
    lean = b[LEAN] + step * b[LEAN_RATE]
    end = min(max(lean, 0.0), 0.5 * math.pi)
    moved = abs(end - b[LEAN]) * 2.0 * _size(b) + 1e-12
    b[LEAN] = end
    if end != lean or (end == 0.0 and b[LEAN_RATE] <= 0.0):
        b[MODE] = LYING if end > 0.0 else RESTING
        b[LEAN_RATE] = 0.0
    return moved


@kernel
def _weight(b):
    """Load on the foot: weight and what the probe presses down."""
    return max(0.0, b[MASS] * b[GRAVITY] - b[PUSH + 2])


@kernel
def _braking(b):
    return b[GRIP] * _weight(b) / b[MASS]


@kernel
def _generalised(b):
    return b[PUSH], b[PUSH + 1], b[PUSH + 5] / b[GYRATION]


@kernel
def foot_middle(b):
    """Middle of the foot, in the world."""
    return 0.5 * (b[LOWER] + b[UPPER]) + b[PLACE], 0.5 * (b[LOWER + 1] + b[UPPER + 1]) + b[PLACE + 1]


@kernel
def _half(b, side):
    axis = side // 2
    return 0.5 * (b[UPPER + axis] - b[LOWER + axis])


@kernel
def _size(b):
    return math.sqrt(_half(b, 0) ** 2 + _half(b, 2) ** 2 + b[HEIGHT] ** 2)


@kernel
def _outward(b, side):
    """Horizontal unit vector towards a side of the foot, 0..3 = +x, -x, +y, -y of the object, in the world."""
    sign = 1.0 - 2.0 * (side % 2)
    c, s = math.cos(b[PLACE + 2]), math.sin(b[PLACE + 2])
    if side < 2:
        return sign * c, sign * s
    return -sign * s, sign * c


@kernel
def _overturned(b, pull_x, pull_y):
    """The side with the largest ratio of tipping to holding torque of the upright object, and that ratio (> 1 tips).

    `pull` is the force that accelerates it: its reaction in the middle holds the object down.
    """
    worst, share = 0, 0.0
    for side in range(4):
        bears = _righting(b, side, 0.0)
        ox, oy = _outward(b, side)
        torque = _tipping_torque(b, side) - 0.5 * b[HEIGHT] * (ox * pull_x + oy * pull_y)
        if torque > share * bears:
            worst, share = side, torque / bears
    return worst, share


@kernel
def _tipping_torque(b, side):
    """Torque of PUSH over a side's edge, positive when it tips."""
    ox, oy = _outward(b, side)
    return ox * b[PUSH + 4] - oy * b[PUSH + 3] + _half(b, side) * b[PUSH + 2]


@kernel
def _righting(b, side, lean):
    """Torque of the weight that holds the object down."""
    half, height = _half(b, side), 0.5 * b[HEIGHT]
    return b[MASS] * b[GRAVITY] * (half * math.cos(lean) - height * math.sin(lean))


@kernel
def _tipping_inertia(b):
    return b[MASS] * (4.0 * _half(b, int(b[SIDE])) ** 2 + b[HEIGHT] ** 2) / 3.0


@kernel
def _arm(b, x, y, z, side):
    """Velocity of a point of the object per rate of lean."""
    ox, oy = _outward(b, side)
    mx, my = foot_middle(b)
    along = (x - mx) * ox + (y - my) * oy - _half(b, side)
    up = z - b[BASE]
    return up * ox, up * oy, -along


@kernel
def _write_pose(b, v):
    """Lean about the edge, then turn about the middle of the foot and move."""
    c, s = math.cos(b[PLACE + 2]), math.sin(b[PLACE + 2])
    side = int(b[SIDE])
    axis, sign = side // 2, 1.0 - 2.0 * (side % 2)
    cl, sl = math.cos(b[LEAN]), sign * math.sin(b[LEAN])
    mx, my = 0.5 * (b[LOWER] + b[UPPER]), 0.5 * (b[LOWER + 1] + b[UPPER + 1])
    edge = sign * _half(b, side)
    for column in range(4):
        x = 1.0 if column == 0 else 0.0
        y = 1.0 if column == 1 else 0.0
        z = 1.0 if column == 2 else 0.0
        if column == 3:
            x, y, z = -mx, -my, -b[BASE]
        out = x if axis == 0 else y
        if column == 3:
            out -= edge
        leaned, z = cl * out + sl * z, cl * z - sl * out
        if column == 3:
            leaned += edge
        if axis == 0:
            x = leaned
        else:
            y = leaned
        wx, wy = c * x - s * y, s * x + c * y
        if column == 3:
            wx, wy, z = wx + mx + b[PLACE], wy + my + b[PLACE + 1], z + b[BASE]
        v[POSE + 3 * column], v[POSE + 3 * column + 1], v[POSE + 3 * column + 2] = wx, wy, z
