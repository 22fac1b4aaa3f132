"""Contact detection of the probe: one row for each contact of the sphere and of the stick.

Most of the time nothing is near. Sphere and stick therefore each keep a lower bound of their clearance: the distance
found last, minus all motion since. Contacts are searched only when that bound reaches zero.
"""

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe_sim import contact_kernels as contact
from lwrprobe_sim import scenery_kernels as scenery

ROWS_MAX = 12
MATERIALS_MAX = 33
MARGIN = 1e-4
"""m beyond the motion of a step within which a surface becomes a contact row."""
_STRIDE = 1e-3  # m, smallest step of the search along the stick
_REFINED = 1e-4  # m, accuracy of the place along the stick
_ONE_PLACE = 1e-3  # m along the stick, up to which the nearest places of both halves are one
_MAX_AXIAL = 0.3  # largest cosine between the stick and the normal of a contact on its side

RADIUS, STICK_RADIUS, STICK_LENGTH = range(3)
FREE_SPHERE, FREE_STICK = 3, 4
MATERIAL = 5  # rows of 5: stiffness, damping, static and sliding friction, shear
POINT = MATERIAL + 5 * MATERIALS_MAX
FRICTION_SINE = POINT + 3  # sine of the angle between friction and the opposite of the slip
SETTINGS = POINT + 4


@kernel
def may_touch(s, drift, moved, turned):
    """Whether sphere or stick may touch after a motion of at most `drift` and `moved` [m] and `turned` [rad]."""
    s[FREE_SPHERE] -= drift
    s[FREE_STICK] -= drift + moved + turned * s[STICK_LENGTH]
    return s[FREE_SPHERE] <= 0.0 or s[FREE_STICK] <= 0.0


@kernel
def find(s, v, counts, numbers, indices, tip, centre, reach, rows):
    """Fill the rows of all surfaces within `reach` of the sphere at `centre` and of the stick; returns their number.

    `s` are the settings above, `v` and `counts` the arrays of `scenery_kernels`.
    """
    n = 0
    n, bound = _around(s, v, counts, numbers, indices, centre, s[RADIUS], reach, 1.0, rows, n)
    s[FREE_SPHERE] = bound - s[RADIUS] - reach if n == 0 else 0.0
    if s[STICK_LENGTH] > 0.0 and s[FREE_STICK] <= 0.0:
        n = _along_stick(s, v, counts, numbers, indices, tip, centre, reach, rows, n)
    return n


@kernel
def _around(s, v, counts, numbers, indices, centre, radius, reach, lever, rows, n):
    """Append a row for each surface within `reach` of a ball; returns row count and a lower bound of all distances."""
    found, bound = scenery.contacts_near(v, counts, numbers, indices, centre, radius + reach)
    for k in range(min(found, ROWS_MAX - n)):
        row = rows[n]
        point, normal = scenery.FOUND + 3 * k, scenery.FOUND + 3 * (scenery.FOUND_MAX + k)
        along = 0.0
        for i in range(3):
            row[contact.CENTRE + i], row[contact.NORMAL + i] = centre[i], v[normal + i]
            along += (centre[i] - v[point + i]) * v[normal + i]
        row[contact.GAP] = along - radius
        row[contact.RADIUS] = radius
        row[contact.LEVER] = lever
        row[contact.BODY] = counts[scenery.MATERIAL + k]
        row[contact.FRICTION_SINE] = s[FRICTION_SINE]
        material = MATERIAL + 5 * counts[scenery.MATERIAL + k]
        row[contact.STIFFNESS] = s[material]
        row[contact.DAMPING] = s[material + 1]
        row[contact.STATIC] = s[material + 2]
        row[contact.SLIDING] = s[material + 3]
        row[contact.SHEAR] = s[material + 4]
        n += 1
    return n, bound


@kernel
def _along_stick(s, v, counts, numbers, indices, tip, centre, reach, rows, n):
    """Append at most one row for each half of the stick, at its nearest place.

    Two rows, since a stick that lies against a wall is supported at both ends of the touching part. Where both places
    are one, at the middle, it is the nearer one that presses.
    """
    length, radius = s[STICK_LENGTH], s[STICK_RADIUS]
    middle = 0.5 * (s[RADIUS] + length)
    point = s[POINT : POINT + 3]
    low, low_distance, low_free = _nearest_on_stick(s, v, counts, numbers, indices, tip, centre, s[RADIUS], middle)
    high, high_distance, high_free = _nearest_on_stick(s, v, counts, numbers, indices, tip, centre, middle, length)
    one = high - low <= _ONE_PLACE
    for half in range(2):
        at, distance = (low, low_distance) if half == 0 else (high, high_distance)
        farther = distance > high_distance if half == 0 else distance >= low_distance
        if distance < radius + reach and not (one and farther):
            point[0], point[1], point[2] = stick_point(tip, centre, length, at)
            first = n
            n, _ = _around(s, v, counts, numbers, indices, point, radius, reach, 1.0 - at / length, rows, n)
            n = _keep_deepest_across(rows, first, n, tip)
    s[FREE_STICK] = min(low_free, high_free) - reach
    return n


@kernel
def stick_point(tip, centre, length, at):
    """Point `at` m behind the sphere on the straight line from its centre to the stick's unbent foot."""
    share = at / length
    return (
        centre[0] + share * (tip[9] - length * tip[6] - centre[0]),
        centre[1] + share * (tip[10] - length * tip[7] - centre[1]),
        centre[2] + share * (tip[11] - length * tip[8] - centre[2]),
    )


@kernel
def _nearest_on_stick(s, v, counts, numbers, indices, tip, centre, low, high):
    """(place, distance of the axis, lower bound of the clearance) of the nearest place between low and high.

    The distance changes by at most 1 m per metre: steps of half the clearance cannot skip a contact.
    """
    place, nearest, clear = low, scenery.NOTHING, scenery.NOTHING
    radius = s[STICK_RADIUS]
    at = low
    while True:
        value = _stick_distance(s, v, counts, numbers, indices, tip, centre, at)
        clear = min(clear, 0.5 * (value - radius))
        if value < nearest - 1e-9:
            place, nearest = at, value
        if at >= high:
            break
        at = min(high, at + max(0.5 * abs(value - radius), _STRIDE))
    if nearest < radius + _STRIDE:
        low, high = max(low, place - _STRIDE), min(high, place + _STRIDE)
        while high - low > _REFINED:
            left, right = low + 0.382 * (high - low), high - 0.382 * (high - low)
            at_left = _stick_distance(s, v, counts, numbers, indices, tip, centre, left)
            at_right = _stick_distance(s, v, counts, numbers, indices, tip, centre, right)
            if at_left < nearest - 1e-9:
                place, nearest = left, at_left
            if at_right < nearest - 1e-9:
                place, nearest = right, at_right
            low, high = (low, right) if at_left <= at_right else (left, high)
    return place, nearest, clear


@kernel
def _stick_distance(s, v, counts, numbers, indices, tip, centre, at):
    """Distance from the stick's axis: exact near the stick, a lower bound of its size elsewhere."""
    x, y, z = stick_point(tip, centre, s[STICK_LENGTH], at)
    bound = scenery.distance_bound(v, counts, numbers, indices, x, y, z)
    if abs(bound) > s[STICK_RADIUS] + 2.0 * _STRIDE:
        return bound
    return scenery.distance(v, counts, numbers, indices, x, y, z)


@kernel
def _keep_deepest_across(rows, first, n, tip):
    """Keep the deepest of the rows from `first` on that presses across the stick.

    A normal along the stick belongs to its end, which is inside the sphere or the holder.
    """
    best = -1
    for i in range(first, n):
        row = rows[i]
        along = row[contact.NORMAL] * tip[6] + row[contact.NORMAL + 1] * tip[7] + row[contact.NORMAL + 2] * tip[8]
        if abs(along) < _MAX_AXIAL and (best < 0 or row[contact.GAP] < rows[best, contact.GAP]):
            best = i
    if best < 0:
        return first
    if best != first:
        for i in range(contact.WIDTH):
            rows[first, i] = rows[best, i]
    return first + 1


@kernel
def stiffest(rows, n):
    """N/m of the stiffest contact; that of hard steel without contacts, so that none is missed."""
    stiffness = 0.0 if n > 0 else 1e7
    for i in range(n):
        stiffness = max(stiffness, rows[i, contact.STIFFNESS])
    return stiffness


@kernel
def inherit(rows, n, old_rows, n_old, old_centre, old_tip, length, turn):
    """Set bristle, penetration and slip speed of each row from the same contact in the last step.

    `turn` (3,) is the rotation vector of the tip in this step: a rotation of the sphere moves its surface over the
    object.
    """
    for i in range(n):
        row = rows[i]
        n0, n1, n2 = row[contact.NORMAL], row[contact.NORMAL + 1], row[contact.NORMAL + 2]
        lever, r = row[contact.LEVER], row[contact.RADIUS]
        at = (1.0 - lever) * length
        x, y, z = old_centre[0], old_centre[1], old_centre[2]
        if lever < 1.0:
            x, y, z = stick_point(old_tip, old_centre, length, at)
        d0, d1, d2 = row[contact.CENTRE] - x, row[contact.CENTRE + 1] - y, row[contact.CENTRE + 2] - z
        row[contact.PENETRATION] = max(0.0, -(row[contact.GAP] - (n0 * d0 + n1 * d1 + n2 * d2)))
        d0 -= r * (turn[1] * n2 - turn[2] * n1)
        d1 -= r * (turn[2] * n0 - turn[0] * n2)
        d2 -= r * (turn[0] * n1 - turn[1] * n0)
        row[contact.SLIP] = 0.0
        match = _same_contact(row, old_rows, n_old)
        if match >= 0:
            d0 += old_rows[match, contact.BRISTLE]
            d1 += old_rows[match, contact.BRISTLE + 1]
            d2 += old_rows[match, contact.BRISTLE + 2]
            row[contact.SLIP] = old_rows[match, contact.SLIP]
        along = d0 * n0 + d1 * n1 + d2 * n2
        row[contact.BRISTLE] = d0 - along * n0
        row[contact.BRISTLE + 1] = d1 - along * n1
        row[contact.BRISTLE + 2] = d2 - along * n2


@kernel
def _same_contact(row, old_rows, n_old):
    """Index of the pressing old row on the same object with the most similar normal and place, -1 when none is near."""
    best, match = 0.7, -1
    for k in range(n_old):
        old = old_rows[k]
        if old[contact.PRESS] <= 0.0 or old[contact.BODY] != row[contact.BODY]:
            continue
        if (old[contact.LEVER] == 1.0) != (row[contact.LEVER] == 1.0):
            continue
        alike = (
            old[contact.NORMAL] * row[contact.NORMAL]
            + old[contact.NORMAL + 1] * row[contact.NORMAL + 1]
            + old[contact.NORMAL + 2] * row[contact.NORMAL + 2]
            - abs(old[contact.LEVER] - row[contact.LEVER])
        )
        if alike > best:
            best, match = alike, k
    return match
