"""Rotations as rotation vectors: exponential, logarithm, and what a moving rotation vector means as angular motion.

The rotation vector r is measured in the world frame from a reference R0: R = exp([r]) R0. Then
omega = r' + f r x r' + g r x (r x r') with f = (1 - cos t)/t^2, g = (t - sin t)/t^3, t = |r| (Chirikjian,
Stochastic Models, Information Theory, and Lie Groups 2, 2012, eq. 10.86).
"""

from math import atan2, cos, sin, sqrt

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def bend_coefficients(t2):
    """f, g and their derivatives by t, each divided by t."""
    if t2 < 2.5e-3:
        f = 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0 * (1.0 - t2 / 56.0))
        g = 1.0 / 6.0 - t2 / 120.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0))
        df = -1.0 / 12.0 + t2 / 180.0 * (1.0 - t2 * 3.0 / 112.0)
        dg = -1.0 / 60.0 + t2 / 1260.0 * (1.0 - t2 / 48.0)
        return f, g, df, dg
    t = sqrt(t2)
    s, c = sin(t), cos(t)
    f = (1.0 - c) / t2
    g = (t - s) / (t2 * t)
    return f, g, (t * s - 2.0 * (1.0 - c)) / (t2 * t2), (t * (1.0 - c) - 3.0 * (t - s)) / (t2 * t2 * t)


@kernel
def rotate_from(r, reference, out):
    """Write exp([r]) R0 into out[0:3, 0:3]; `reference` is R0 (3, 3)."""
    x, y, z = r[0], r[1], r[2]
    t2 = x * x + y * y + z * z
    f, g, _, _ = bend_coefficients(t2)
    s = 1.0 - g * t2
    for k in range(3):
        a, b, c = reference[0, k], reference[1, k], reference[2, k]
        u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
        out[0, k] = a + s * u + f * (y * w - z * v)
        out[1, k] = b + s * v + f * (z * u - x * w)
        out[2, k] = c + s * w + f * (x * v - y * u)


@kernel
def angular_motion(x, out):
    """Angular velocity and acceleration (world frame) into out (6,); x (3, 3) holds r, r' and r'' as rows."""
    r, rate, second = x[0], x[1], x[2]
    f, g, df, dg = bend_coefficients(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    growth = r[0] * rate[0] + r[1] * rate[1] + r[2] * rate[2]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        u = r[i] * rate[j] - r[j] * rate[i]
        w = r[i] * second[j] - r[j] * second[i]
        turned = triple(r, r, rate, k)
        out[k] = rate[k] + f * u + g * turned
        out[3 + k] = second[k] + f * w + g * (triple(r, r, second, k) + triple(rate, r, rate, k))
        out[3 + k] += growth * (df * u + dg * turned)


@kernel
def triple(a, b, c, k):
    """Component k of a x (b x c)."""
    ac = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return b[k] * ac - c[k] * ab


@kernel
def rotation_between(start, end, r):
    """Write r with exp([r]) start = end, |r| <= pi (both (3, 3); at half a turn one of the two axes)."""
    m00 = m01 = m02 = m10 = m11 = m12 = m20 = m21 = m22 = 0.0
    for k in range(3):
        m00 += end[0, k] * start[0, k]
        m01 += end[0, k] * start[1, k]
        m02 += end[0, k] * start[2, k]
        m10 += end[1, k] * start[0, k]
        m11 += end[1, k] * start[1, k]
        m12 += end[1, k] * start[2, k]
        m20 += end[2, k] * start[0, k]
        m21 += end[2, k] * start[1, k]
        m22 += end[2, k] * start[2, k]
    # Quaternion by its largest component (Shepperd 1978), so that no angle loses digits.
    trace = m00 + m11 + m22
    if trace >= m00 and trace >= m11 and trace >= m22:
        w, x, y, z = 1.0 + trace, m21 - m12, m02 - m20, m10 - m01
    elif m00 >= m11 and m00 >= m22:
        w, x, y, z = m21 - m12, 1.0 + m00 - m11 - m22, m01 + m10, m02 + m20
    elif m11 >= m22:
        w, x, y, z = m02 - m20, m01 + m10, 1.0 + m11 - m00 - m22, m12 + m21
    else:
        w, x, y, z = m10 - m01, m02 + m20, m12 + m21, 1.0 + m22 - m00 - m11
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    n = sqrt(x * x + y * y + z * z)
    scale = 2.0 * atan2(n, w) / n if n > 0.0 else 0.0
    r[0], r[1], r[2] = scale * x, scale * y, scale * z


@kernel
def orthonormalise(rotation):
    """One Newton step to the nearest rotation: R (3 I - R^T R) / 2, squares the error of a nearly orthonormal R."""
    s00 = s01 = s02 = s11 = s12 = s22 = 0.0
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        s00 += a * a
        s01 += a * b
        s02 += a * c
        s11 += b * b
        s12 += b * c
        s22 += c * c
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        rotation[k, 0] = a * (1.5 - 0.5 * s00) - 0.5 * (b * s01 + c * s02)
        rotation[k, 1] = b * (1.5 - 0.5 * s11) - 0.5 * (a * s01 + c * s12)
        rotation[k, 2] = c * (1.5 - 0.5 * s22) - 0.5 * (a * s02 + b * s12)
