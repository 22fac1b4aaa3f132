"""The law of a contact, and a sphere's velocity along a surface under it (kernels, private).

`law` has the numbers of one task; its elements are named below.
"""

from __future__ import annotations

from math import acos, cos, e, sin, sqrt

from lwrprobe.compiled import allocation_free_kernel as kernel

DELAY, TARGET, SLACK = 0, 1, 2
"""s; N that is wanted; N from there to the limit."""
SERIES, LATERAL, ALONG = 3, 4, 5
"""m/N of object and arm, and of the probe across its stick and along it."""
LIMIT, THRESHOLD = 6, 7
"""N that sliding may reach; N above which a touch is one."""
RADIUS = 8
"""m of the sphere."""
SIZE = 9

MAX_INWARD = 0.01
"""m/s towards the surface. More would only deepen a contact that is about to return."""
MAX_OUTWARD = 0.05
"""m/s away from the surface: what the arm follows within one delay."""
NORMAL_MEMORY = 0.5
"""Share of the last normal in the tracked one: halves the noise, costs one sample of delay."""
NEW_NORMAL = 1.0 - NORMAL_MEMORY
"""Share of the new one."""
MIN_NORMAL = 0.1
"""Length of the mean of two normals below which they oppose each other, and the new one counts alone."""
ROUND, UNSTEADY = 1.25, 0.01
"""Times the turn with which the sphere goes around a sharp edge, and rad, by which the tracked normal may turn towards
the motion from sample to sample: no single contact turns faster, and a normal that does leads into the surface."""
RESET_TIME = 8.0
"""Integral time of the steady part in units of the delay: slow enough not to disturb the stability of the law."""
MAX_STEADY = 0.5
"""Share of the inward speed, and of the sliding speed, that the steady part may reach: a tangent 27 degrees off."""
NEEDLESS = 1.0
"""Share of the target force that is coming in excess, at which nothing is left of a steady part towards the surface.
Around an edge it makes up for the surface that turns away; on the flat behind, it would press on with e times that
force until it is taken up in turn.
"""
TURN = 0.08
"""rad by which the surface may turn within one delay: a sliding speed of F_target / (K tau TURN) keeps the contact."""
MIN_SLIDING = 0.1
"""Share of the sliding speed that remains however large the force error is, so that a corner is left."""
CONE = 0.35
"""rad by which the normal may turn towards the stick before the law knows; the stiffest direction in it counts."""
DIVE = 0.3
"""Share of the sliding speed along the stick, towards its tip, from which on sliding is also an approach."""
FRICTION = 0.5
"""Of what the sphere slides down on, as large as that of dry contacts mostly is."""


@kernel
def normal_velocity(error, damping, steady, inward, outward):
    """m/s along the outward normal; see `force_law.normal_velocity`."""
    return min(max(error / damping + steady, -inward), outward)


@kernel
def damping_without_overshoot(stiffness, delay):
    """N s/m, B = e K tau; see `force_law.damping_without_overshoot`."""
    return e * delay * stiffness


@kernel
def stiffness(law, axial):
    """N/m of object, arm and probe in series, by the share of the normal along the stick."""
    angle = max(acos(min(abs(axial), 1.0)) - CONE, 0.0)
    return 1.0 / (law[SERIES] + sin(angle) ** 2 * law[LATERAL] + cos(angle) ** 2 * law[ALONG])


@kernel
def by_direction(speeds, axial):
    """Of the speeds (n,) from across the stick to along it, the one for a direction with this share along it."""
    steps = len(speeds) - 1
    return speeds[min(int(abs(axial) * steps) + 1, steps)]


@kernel
def outward_limit(safe, axial):
    """m/s away from a surface by whose normal the tip moves with this share along the stick, towards its end.

    Off a wall the tip is fast. Friction turns the normal that the force shows: with a small share along the stick the
    tip would meet a floor below faster than any approach does.
    """
    slowest = safe[len(safe) - 1]
    return min(MAX_OUTWARD, slowest / axial) if axial * MAX_OUTWARD > slowest else MAX_OUTWARD


@kernel
def foot_share(law, axial, dive):
    """Of the approach speed, what remains down a slope or wall, towards a foot that has not been touched.

    `axial` and `dive` are the shares of normal and tangent along the stick. What the sphere presses on meanwhile, and
    its friction, add to what the foot presses with along the stick: of a slope the most, of a wall across it.
    """
    target, limit = law[TARGET], law[LIMIT]
    along = target * (FRICTION * dive - axial)
    across = max(target * target * (1.0 + FRICTION * FRICTION) - along * along, 0.0)
    foot = sqrt(max(limit * limit - across, 0.0)) - along - law[THRESHOLD]
    return max(foot, 0.0) / (limit - law[THRESHOLD])


@kernel
def perpendicular(nx, ny, nz, ax, ay, az):
    """Unit vector along n x a, zero where they are parallel."""
    x, y, z = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    size = sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-6 else (0.0, 0.0, 0.0)


@kernel
def follow(law, safe, last, normal, force, rise, bx, by, bz, speed, rotation, period, steady, tracked, velocity):
    """The tracked normal (3,) and the velocity (3,) m/s for the next `period` s; returns the steady part, m/s.

    `last` (3,) is the normal that was tracked, `normal` (3,) that of this sample, `force` its N along it, which has
    grown by `rise` N/s since the last sample, `safe` (n,) the approach speeds, b the binormal, `speed` m/s wanted along
    the tangent, `rotation` (3, 3) the tip's, and `steady` the steady part so far.
    """
    nx, ny, nz = normal[0], normal[1], normal[2]
    mx = NORMAL_MEMORY * last[0] + NEW_NORMAL * nx
    my = NORMAL_MEMORY * last[1] + NEW_NORMAL * ny
    mz = NORMAL_MEMORY * last[2] + NEW_NORMAL * nz
    size = sqrt(mx * mx + my * my + mz * mz)
    if size > MIN_NORMAL:
        nx, ny, nz = mx / size, my / size, mz / size
    ox, oy, oz = perpendicular(last[0], last[1], last[2], bx, by, bz)
    turn = nx * ox + ny * oy + nz * oz
    excess = turn - ROUND * speed * period / law[RADIUS] - UNSTEADY
    if excess > 0.0 and size > MIN_NORMAL:
        nx, ny, nz = nx - excess * ox, ny - excess * oy, nz - excess * oz
        size = sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / size, ny / size, nz / size
    tracked[0], tracked[1], tracked[2] = nx, ny, nz
    ax, ay, az = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    axial = nx * ax + ny * ay + nz * az
    delay = law[DELAY]
    damping = damping_without_overshoot(stiffness(law, axial), delay)
    error = force - law[TARGET]
    inward = min(by_direction(safe, axial), MAX_INWARD)
    # What the force grows by until the loop reacts.
    coming = error + max(rise, 0.0) * delay
    needed = min(max(1.0 - coming / (NEEDLESS * law[TARGET]), 0.0), 1.0)
    steady += error * period / (damping * RESET_TIME * delay)
    steady = min(max(steady, -MAX_STEADY * inward * needed), MAX_STEADY * speed)
    press = normal_velocity(error, damping, steady, inward, outward_limit(safe, axial))
    tx, ty, tz = perpendicular(nx, ny, nz, bx, by, bz)
    slide, dive = speed, tx * ax + ty * ay + tz * az
    if dive > DIVE:  # towards a foot that has not been touched yet, stick first
        slide = min(slide, foot_share(law, axial, dive) * by_direction(safe, dive))
    slide = min(slide, law[TARGET] / (damping / e * TURN))
    # A wrong normal leads the sliding into the surface.
    slide *= min(max(1.0 - max(abs(error), coming) / law[SLACK], MIN_SLIDING), 1.0)
    velocity[0], velocity[1], velocity[2] = slide * tx + press * nx, slide * ty + press * ny, slide * tz + press * nz
    return steady
