"""Robot links that must not touch the object: exact bodies against the true solid, looked at only when they may.

Those on the tip and those on the arm are looked at by themselves: the tip is near the object and its motion is known
exactly, the arm is far and its motion is bounded through the joints.

A link's box is cut until each piece is clear, outside the link's body, or has its centre in both bodies. The solid's
value never exceeds the distance, so a piece is clear when the value at its centre exceeds its half diagonal.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import link_frames
from lwrprobe_sim.scenery_kernels import NOTHING, distance_bound

LINK_MAX = 24
LINK = 17
"""Numbers of a link: pose in its carrier 12 (rows of a 3x4), half edges of its box 3, kind, carrier."""
HALF, KIND, CARRIER = 12, 15, 16
BOX, CYLINDER, CAPSULE = range(3)
TIP_CARRIER = -1.0

FREE, ARM_FREE, TIP_REACH, JOINT_REACH = range(4)
FRAMES = 4
LINKS = FRAMES + 17 * 16
STACK = LINKS + LINK_MAX * LINK
STACK_MAX = 256
SETTINGS = STACK + 6 * STACK_MAX

N_LINKS, COLLISIONS, HITTING, ON_ARM, LOOKS = range(5)
COUNTS = 5

FINEST = 2.5e-4
"""m, half edge of the smallest piece: overlaps thinner than that may go unseen."""


@kernel
def watch(s, counts, v, around, numbers, indices, chain, q, tip, moved, turned, joint_travel):
    """Count links that begin to touch, after a motion of at most `moved` m, `turned` rad, `joint_travel` rad.

    `s` and `counts` are this file's, `v` and `around` the scenery's part of the world.
    """
    on_tip, on_arm = counts[N_LINKS] - counts[ON_ARM], counts[ON_ARM]
    if on_tip > 0:
        s[FREE] -= moved + turned * s[TIP_REACH]
        if s[FREE] <= 0.0:
            s[FREE] = look(s, counts, v, around, numbers, indices, tip, 0, on_tip)
    if on_arm > 0:
        s[ARM_FREE] -= joint_travel * s[JOINT_REACH]
        if s[ARM_FREE] <= 0.0:
            link_frames(chain, q, s[FRAMES:LINKS].reshape((17, 4, 4))[: chain.shape[0] - 1])
            s[ARM_FREE] = look(s, counts, v, around, numbers, indices, tip, on_tip, on_tip + on_arm)


@kernel
def look(s, counts, v, around, numbers, indices, tip, first, last):
    """Count the links that have begun to touch; how far the others are at least."""
    counts[LOOKS] += 1
    frames = s[FRAMES:LINKS].reshape((17, 4, 4))
    nearest = NOTHING
    for k in range(first, last):
        link = s[LINKS + k * LINK : LINKS + (k + 1) * LINK]
        clear = clearance(s, link, v, around, numbers, indices, pose_of(link, frames, tip))
        bit = 1 << k
        if clear <= 0.0:
            if counts[HITTING] & bit == 0:
                counts[COLLISIONS] += 1
                counts[HITTING] |= bit
            clear = FINEST
        else:
            counts[HITTING] &= ~bit
        nearest = min(nearest, clear)
    return nearest


@kernel
def pose_of(link, frames, tip):
    """The link's frame in the world as a tuple: x axis, y axis, z axis, origin."""
    c = int(link[CARRIER])
    if c < 0:
        a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11 = tip
    else:
        f = frames[c]
        a0, a1, a2 = f[0, 0], f[1, 0], f[2, 0]
        a3, a4, a5 = f[0, 1], f[1, 1], f[2, 1]
        a6, a7, a8 = f[0, 2], f[1, 2], f[2, 2]
        a9, a10, a11 = f[0, 3], f[1, 3], f[2, 3]
    return (
        a0 * link[0] + a3 * link[4] + a6 * link[8],
        a1 * link[0] + a4 * link[4] + a7 * link[8],
        a2 * link[0] + a5 * link[4] + a8 * link[8],
        a0 * link[1] + a3 * link[5] + a6 * link[9],
        a1 * link[1] + a4 * link[5] + a7 * link[9],
        a2 * link[1] + a5 * link[5] + a8 * link[9],
        a0 * link[2] + a3 * link[6] + a6 * link[10],
        a1 * link[2] + a4 * link[6] + a7 * link[10],
        a2 * link[2] + a5 * link[6] + a8 * link[10],
        a0 * link[3] + a3 * link[7] + a6 * link[11] + a9,
        a1 * link[3] + a4 * link[7] + a7 * link[11] + a10,
        a2 * link[3] + a5 * link[7] + a8 * link[11] + a11,
    )


@kernel
def clearance(s, link, v, around, numbers, indices, pose):
    """A lower bound of the distance between link and world, worth having where it is small; 0 when they overlap."""
    stack = s[STACK:SETTINGS].reshape((STACK_MAX, 6))
    for j in range(3):
        stack[0, j] = 0.0
        stack[0, 3 + j] = link[HALF + j]
    top = 0
    nearest = NOTHING
    while top >= 0:
        x, y, z = stack[top, 0], stack[top, 1], stack[top, 2]
        hx, hy, hz = stack[top, 3], stack[top, 4], stack[top, 5]
        top -= 1
        span = math.sqrt(hx * hx + hy * hy + hz * hz)
        body = _body_value(link, x, y, z)
        if body > span:
            continue
        wx = pose[9] + pose[0] * x + pose[3] * y + pose[6] * z
        wy = pose[10] + pose[1] * x + pose[4] * y + pose[7] * z
        wz = pose[11] + pose[2] * x + pose[5] * y + pose[8] * z
        value = distance_bound(v, around, numbers, indices, wx, wy, wz)
        if value <= 0.0 and body <= 0.0:
            return 0.0
        longest = max(hx, max(hy, hz))
        if value - span > 0.3 * value or (longest <= FINEST and value > 0.0):
            nearest = min(nearest, max(value - span, FINEST))
            continue
        if longest <= FINEST or top + 2 >= STACK_MAX:
            continue
        for side in range(2):
            top += 1
            sign = 1.0 - 2.0 * side
            stack[top, 0], stack[top, 1], stack[top, 2] = x, y, z
            stack[top, 3], stack[top, 4], stack[top, 5] = hx, hy, hz
            axis = 0 if hx == longest else (1 if hy == longest else 2)
            stack[top, axis] += 0.5 * sign * longest
            stack[top, 3 + axis] = 0.5 * longest
    return nearest


@kernel
def _body_value(link, x, y, z):
    """Signed value of the link's own body in its frame, never larger than the distance outside."""
    kind = int(link[KIND])
    hx, hz = link[HALF], link[HALF + 2]
    if kind == CYLINDER:
        return max(math.sqrt(x * x + y * y) - hx, abs(z) - hz)
    if kind == CAPSULE:
        along = max(0.0, abs(z) - (hz - hx))
        return math.sqrt(x * x + y * y + along * along) - hx
    return max(abs(x) - hx, max(abs(y) - link[HALF + 1], abs(z) - hz))
