"""Tips for many joint vectors at once, a lane each: what one vector instruction does for several of them.

The frames of LANES joint vectors lie number by number in a row of lanes each, so that the loops over lanes become
vector instructions. Sine and cosine are polynomials (fdlibm's, Ng
1993) behind a reduction by multiples of a quarter turn in three parts (Cody and Waite 1980), since a call to the
library's would go lane by lane.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import COS_ALPHA, MODIFIED, PRISMATIC, SIN_ALPHA, THETA, A, D

LANES = 128
# rows of lanes: a frame's twelve numbers (x, y, z axis, origin), then cosine, sine and slide of the joint
COS, SIN, SLIDE = 12, 13, 14
ROWS = 15

# a quarter turn in three parts, 33 bits each: products with whole numbers below 2^20 are exact
QUARTER_1, QUARTER_2, QUARTER_3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21
PER_QUARTER = 2.0 / math.pi
# rad up to which the reduction is exact; beyond, the library's functions are called
FAR = 1e5


@kernel
def _turns(cos, sin):
    """Cosine, in place, and sine of angles (LANES,) below FAR."""
    for t in range(LANES):
        quarters = math.floor(cos[t] * PER_QUARTER + 0.5)
        r = cos[t] - quarters * QUARTER_1
        r -= quarters * QUARTER_2
        r -= quarters * QUARTER_3
        z = r * r
        p = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
        p = -1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * p))
        s = r + r * z * p
        p = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
        p = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * p)
        p = 4.16666666666666019037e-02 + z * p
        half = 0.5 * z
        # 1 - z / 2 loses what its own rounding leaves, which is added again
        w = 1.0 - half
        c = w + ((1.0 - w) - half + z * z * p)
        place = quarters - 4.0 * math.floor(0.25 * quarters)
        odd = place == 1.0 or place == 3.0
        a, b = (s, c) if odd else (c, s)
        cos[t] = -a if place == 1.0 or place == 2.0 else a
        sin[t] = -b if place >= 2.0 else b


@kernel
def _take_joint(row, qs, start, i, lanes):
    """Cosine, sine and slide of the i-th joint for the joint vectors from `start` on."""
    cos, sin, slide = lanes[COS], lanes[SIN], lanes[SLIDE]
    slides = row[PRISMATIC] != 0.0
    largest = 0.0
    for t in range(LANES):
        angle = row[THETA] + (0.0 if slides else qs[start + t, i])
        cos[t] = angle
        slide[t] = row[D] + (qs[start + t, i] if slides else 0.0)
        largest = max(largest, abs(angle))
    if largest < FAR:
        _turns(cos, sin)
    else:
        for t in range(LANES):
            cos[t], sin[t] = math.cos(cos[t]), math.sin(cos[t])


@kernel
def _turn_lanes(lanes):
    """Rz(theta) Tz(d): the joint's own motion."""
    cos, sin, slide = lanes[COS], lanes[SIN], lanes[SLIDE]
    for k in range(3):
        x, y, z, o = lanes[k], lanes[3 + k], lanes[6 + k], lanes[9 + k]
        for t in range(LANES):
            along, across = x[t], y[t]
            x[t] = cos[t] * along + sin[t] * across
            y[t] = cos[t] * across - sin[t] * along
            o[t] += slide[t] * z[t]


@kernel
def _twist_lanes(row, lanes):
    """Tx(a) Rx(alpha): the link's fixed part."""
    a, c, s = row[A], row[COS_ALPHA], row[SIN_ALPHA]
    for k in range(3):
        x, y, z, o = lanes[k], lanes[3 + k], lanes[6 + k], lanes[9 + k]
        for t in range(LANES):
            o[t] += a * x[t]
            along, across = y[t], z[t]
            y[t] = c * along + s * across
            z[t] = c * across - s * along


@kernel
def _write_tips(tool, lanes, start, out):
    for k in range(3):
        x, y, z, o = lanes[k], lanes[3 + k], lanes[6 + k], lanes[9 + k]
        for j in range(4):
            t0, t1, t2, one = tool[j], tool[4 + j], tool[8 + j], (1.0 if j == 3 else 0.0)
            for t in range(LANES):
                out[start + t, k, j] = x[t] * t0 + y[t] * t1 + z[t] * t2 + one * o[t]
    for t in range(LANES):
        for j in range(4):
            out[start + t, 3, j] = 1.0 if j == 3 else 0.0


@kernel
def forward_lanes(chain, qs, lanes, out):
    """The tips for joint values qs (m, n), m >= LANES, into out (m, 4, 4); `lanes` (ROWS, LANES) is written over.

    The last block is moved up to end with the last row, so that some rows may be computed twice.
    """
    count, joints = qs.shape[0], chain.shape[0] - 2
    modified = chain[0, MODIFIED] != 0.0
    base = chain[0]
    for block in range((count + LANES - 1) // LANES):
        start = min(block * LANES, count - LANES)
        for k in range(12):
            for t in range(LANES):
                lanes[k, t] = base[4 * (k % 3) + k // 3]
        for half in range(2 * joints):
            row = chain[half // 2 + 1]
            if (half % 2 == 0) == modified:
                _twist_lanes(row, lanes)
            else:
                _take_joint(row, qs, start, half // 2, lanes)
                _turn_lanes(lanes)
        _write_tips(chain[joints + 1], lanes, start, out)
