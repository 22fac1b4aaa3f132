"""A serial chain in one table, and what follows from it: tip, link frames, Jacobian.

`chain` is (n + 2, max(16, n)): row 0 the base and row n + 1 the tool as 3x4, row by row; row i the i-th joint with
the columns named below. Frames travel as tuples of twelve numbers: x axis, y axis, z axis, origin. A standard row
moves along and about z and then x, a modified one (Craig) along and about x and then z.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel

A, COS_ALPHA, SIN_ALPHA, D, THETA, PRISMATIC, LOWER, UPPER, SPEED, UNIT = range(10)
# columns of row 0 behind the twelve numbers of the base
LENGTH, MODIFIED = 12, 13


@kernel
def turn(row, q, f):
    """Rz(theta) Tz(d): the joint's own motion."""
    theta, d = row[THETA], row[D]
    if row[PRISMATIC] != 0.0:
        d += q
    else:
        theta += q
    c, s = math.cos(theta), math.sin(theta)
    return (
        c * f[0] + s * f[3],
        c * f[1] + s * f[4],
        c * f[2] + s * f[5],
        c * f[3] - s * f[0],
        c * f[4] - s * f[1],
        c * f[5] - s * f[2],
        f[6],
        f[7],
        f[8],
        f[9] + d * f[6],
        f[10] + d * f[7],
        f[11] + d * f[8],
    )


@kernel
def twist(row, f):
    """Tx(a) Rx(alpha): the link's fixed part."""
    a, c, s = row[A], row[COS_ALPHA], row[SIN_ALPHA]
    return (
        f[0],
        f[1],
        f[2],
        c * f[3] + s * f[6],
        c * f[4] + s * f[7],
        c * f[5] + s * f[8],
        c * f[6] - s * f[3],
        c * f[7] - s * f[4],
        c * f[8] - s * f[5],
        f[9] + a * f[0],
        f[10] + a * f[1],
        f[11] + a * f[2],
    )


@kernel
def base_frame(chain):
    b = chain[0]
    return (b[0], b[4], b[8], b[1], b[5], b[9], b[2], b[6], b[10], b[3], b[7], b[11])


@kernel
def through_tool(chain, f):
    t = chain[chain.shape[0] - 1]
    return (
        f[0] * t[0] + f[3] * t[4] + f[6] * t[8],
        f[1] * t[0] + f[4] * t[4] + f[7] * t[8],
        f[2] * t[0] + f[5] * t[4] + f[8] * t[8],
        f[0] * t[1] + f[3] * t[5] + f[6] * t[9],
        f[1] * t[1] + f[4] * t[5] + f[7] * t[9],
        f[2] * t[1] + f[5] * t[5] + f[8] * t[9],
        f[0] * t[2] + f[3] * t[6] + f[6] * t[10],
        f[1] * t[2] + f[4] * t[6] + f[7] * t[10],
        f[2] * t[2] + f[5] * t[6] + f[8] * t[10],
        f[0] * t[3] + f[3] * t[7] + f[6] * t[11] + f[9],
        f[1] * t[3] + f[4] * t[7] + f[7] * t[11] + f[10],
        f[2] * t[3] + f[5] * t[7] + f[8] * t[11] + f[11],
    )


@kernel
def write_frame(f, out):
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = f[0], f[3], f[6], f[9]
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = f[1], f[4], f[7], f[10]
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = f[2], f[5], f[8], f[11]
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = 0.0, 0.0, 0.0, 1.0


@kernel
def tip_frame(chain, q):
    """The tip for joint values q (n,), as a frame tuple."""
    modified = chain[0, MODIFIED] != 0.0
    f = base_frame(chain)
    for i in range(chain.shape[0] - 2):
        row = chain[i + 1]
        f = turn(row, q[i], twist(row, f)) if modified else twist(row, turn(row, q[i], f))
    return through_tool(chain, f)


@kernel
def forward(chain, q, out):
    """The tip for joint values q (n,) into out (4, 4)."""
    write_frame(tip_frame(chain, q), out)


@kernel
def forward_batch(chain, qs, out):
    """`forward` for qs (m, n) into out (m, 4, 4)."""
    for k in range(qs.shape[0]):
        write_frame(tip_frame(chain, qs[k]), out[k])


@kernel
def link_frames(chain, q, out):
    """The base and all link frames, in the table's own convention and without the tool, into out (n + 1, 4, 4)."""
    modified = chain[0, MODIFIED] != 0.0
    f = base_frame(chain)
    write_frame(f, out[0])
    for i in range(chain.shape[0] - 2):
        row = chain[i + 1]
        f = turn(row, q[i], twist(row, f)) if modified else twist(row, turn(row, q[i], f))
        write_frame(f, out[i + 1])


@kernel
def put_axis(f, i, jac):
    """A point on the z axis of f and its direction into column i of jac."""
    jac[0, i], jac[1, i], jac[2, i] = f[9], f[10], f[11]
    jac[3, i], jac[4, i], jac[5, i] = f[6], f[7], f[8]


@kernel
def tip_and_axes(chain, q, jac):
    """The tip as a frame tuple; a point on each joint's axis over its direction into jac (6, n).

    One loop for each convention: asking inside costs a third of the whole.
    """
    f = base_frame(chain)
    if chain[0, MODIFIED] != 0.0:
        for i in range(chain.shape[0] - 2):
            f = twist(chain[i + 1], f)
            put_axis(f, i, jac)
            f = turn(chain[i + 1], q[i], f)
    else:
        for i in range(chain.shape[0] - 2):
            put_axis(f, i, jac)
            f = twist(chain[i + 1], turn(chain[i + 1], q[i], f))
    return through_tool(chain, f)


@kernel
def axes_to_jacobian(chain, f, linear, angular, jac):
    """What `tip_and_axes` left in jac becomes the geometric Jacobian of the tip f in the world frame, linear rows over
    angular ones, each half times its factor."""
    for i in range(chain.shape[0] - 2):
        z0, z1, z2 = jac[3, i], jac[4, i], jac[5, i]
        if chain[i + 1, PRISMATIC] != 0.0:
            v0, v1, v2 = z0, z1, z2
            z0 = z1 = z2 = 0.0
        else:
            r0, r1, r2 = f[9] - jac[0, i], f[10] - jac[1, i], f[11] - jac[2, i]
            v0, v1, v2 = z1 * r2 - z2 * r1, z2 * r0 - z0 * r2, z0 * r1 - z1 * r0
        jac[0, i], jac[1, i], jac[2, i] = linear * v0, linear * v1, linear * v2
        jac[3, i], jac[4, i], jac[5, i] = angular * z0, angular * z1, angular * z2


@kernel
def tip_and_jacobian(chain, q, jac):
    """The tip as a frame tuple; the geometric Jacobian of the tip in the world frame into jac (6, n), linear first."""
    f = tip_and_axes(chain, q, jac)
    axes_to_jacobian(chain, f, 1.0, 1.0, jac)
    return f


@kernel
def jacobian(chain, q, jac):
    """The geometric Jacobian of the tip in the world frame into jac (6, n)."""
    tip_and_jacobian(chain, q, jac)


@kernel
def jacobian_batch(chain, qs, jacs):
    """`jacobian` for qs (m, n) into jacs (m, 6, n)."""
    for k in range(qs.shape[0]):
        tip_and_jacobian(chain, qs[k], jacs[k])
