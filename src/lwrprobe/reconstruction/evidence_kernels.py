"""What is known to be solid or free, column by column, and how a surface goes on beyond the last line."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel


@kernel
def mark_places(places, origin, step, marks):
    """Write each place's number into its nearest grid node; places beyond the grid are left out."""
    nx, ny, nz = marks.shape
    for p in range(places.shape[0]):
        i = int(np.rint((places[p, 0] - origin[0]) / step))
        j = int(np.rint((places[p, 1] - origin[1]) / step))
        k = int(np.rint((places[p, 2] - origin[2]) / step))
        if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
            marks[i, j, k] = p


@kernel
def freely_below(point, normal, radius, origin, step, free, contacts):
    """Whether the sphere passed under the place from which it touched `point`, touching nothing.

    Numbers in `free` below `contacts` are of places in contact.
    """
    nx, ny, _ = free.shape
    i = int(np.rint((point[0] + radius * normal[0] - origin[0]) / step))
    j = int(np.rint((point[1] + radius * normal[1] - origin[1]) / step))
    if not (0 <= i < nx and 0 <= j < ny):
        return False
    for k in range(int(np.floor((point[2] + radius * (normal[2] - 1.0) - origin[2]) / step))):
        if free[i, j, k] >= contacts:
            return True
    return False


@kernel
def mark_below(points, normals, radius, origin, step, free, contacts, solid):
    """Columns under contacts are solid down to the next place that the sphere visited, or to an undercut.

    A contact from below (a normal that points down, or leans down where the sphere passed freely below) says nothing
    about what lies under it, and ends the columns of the contacts over it, two cells around.
    """
    nx, ny, nz = solid.shape
    undercut = np.full((nx, ny), -1, np.int64)
    over = np.zeros(points.shape[0], np.bool_)
    for p in range(points.shape[0]):
        lean = normals[p, 2]
        if lean > -0.08:
            continue
        over[p] = lean < -0.25 or freely_below(points[p], normals[p], radius, origin, step, free, contacts)
        if not over[p]:
            continue
        i = int(np.rint((points[p, 0] - origin[0]) / step))
        j = int(np.rint((points[p, 1] - origin[1]) / step))
        k = int(np.rint((points[p, 2] - origin[2]) / step))
        for a in range(max(0, i - 2), min(nx, i + 3)):
            for b in range(max(0, j - 2), min(ny, j + 3)):
                undercut[a, b] = max(undercut[a, b], k)
    for p in range(points.shape[0]):
        i = int(np.rint((points[p, 0] - origin[0]) / step))
        j = int(np.rint((points[p, 1] - origin[1]) / step))
        k = min(int(np.rint((points[p, 2] - origin[2]) / step)), nz - 1)
        if not (0 <= i < nx and 0 <= j < ny and k >= 0):
            continue
        lowest = k
        if normals[p, 2] > -0.2 and not over[p]:
            lowest = undercut[i, j] if 0 <= undercut[i, j] <= k else 0
        while k >= lowest and free[i, j, k] < 0:
            solid[i, j, k] = p
            k -= 1


@kernel
def mark_above(places, stood, origin, step, solid, free):
    """Columns over visited places, where an upright stick `stood` (bool), are free up to the next solid node."""
    nx, ny, nz = free.shape
    for p in range(places.shape[0]):
        i = int(np.rint((places[p, 0] - origin[0]) / step))
        j = int(np.rint((places[p, 1] - origin[1]) / step))
        k = int(np.rint((places[p, 2] - origin[2]) / step))
        if not stood[p] or not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
            continue
        k += 1
        while k < nz and solid[i, j, k] < 0:
            if free[i, j, k] < 0:
                free[i, j, k] = p
            k += 1


@kernel
def upstream(centres, normals, along, order, direction, pitch, pairs):
    """Hermite pairs across one line gap: for each centre its partner on the line before, against `direction`.

    `along` are the centres' positions in that direction, `order` sorts them. A row of `pairs` (n, 9) holds sine and
    cosine of the tilt towards `direction`, sine and cosine of the partner's, run and drop from partner to centre,
    and the unit vector in the normal's plane across `direction`; NaN where there is no partner.
    """
    n = centres.shape[0]
    across, binormal = np.empty(3), np.empty(3)
    for a in range(n):
        i = order[a]
        pairs[i, 0] = np.nan
        sine = normals[i, 0] * direction[0] + normals[i, 1] * direction[1] + normals[i, 2] * direction[2]
        if not -0.15 < sine < 0.97:
            continue
        cosine = np.sqrt(1.0 - sine * sine)
        for m in range(3):
            across[m] = (normals[i, m] - sine * direction[m]) / cosine
        for m in range(3):
            o, q = (m + 1) % 3, (m + 2) % 3
            binormal[m] = direction[o] * across[q] - direction[q] * across[o]
        best, least = -1, np.inf
        b = a - 1
        while b >= 0 and along[i] - along[order[b]] < 1.6 * pitch:
            j = order[b]
            b -= 1
            if along[i] - along[j] < 0.5 * pitch:
                continue
            lateral, height, facing, twist = 0.0, 0.0, 0.0, 0.0
            for m in range(3):
                lateral += (centres[j, m] - centres[i, m]) * binormal[m]
                height += (centres[j, m] - centres[i, m]) * across[m]
                facing += normals[j, m] * across[m]
                twist += normals[j, m] * binormal[m]
            cost = abs(lateral) + abs(height)
            if abs(lateral) < 0.3 * pitch and facing > 0.5 and abs(twist) < 0.15 and cost < least:
                best, least = j, cost
        if best < 0:
            continue
        pairs[i, 0], pairs[i, 1], pairs[i, 2], pairs[i, 3], pairs[i, 5] = sine, cosine, 0.0, 0.0, 0.0
        for m in range(3):
            pairs[i, 2] += normals[best, m] * direction[m]
            pairs[i, 3] += normals[best, m] * across[m]
            pairs[i, 5] += (centres[best, m] - centres[i, m]) * across[m]
            pairs[i, 6 + m] = across[m]
        pairs[i, 4] = along[i] - along[best]


@kernel
def curvature_radii(centres, along, order, pairs, pitch, noise, out):
    """Radius of the arc that leads from the line before to each centre, and its standard deviation; out (n, 3).

    Between the two the surface runs straight and then turns by the angle between the normals: the drop beyond the
    straight part tells the radius. The third column is the smoothed sine of the tilt. Pairs are averaged over
    neighbours on the same line that face alike, since single normals are too noisy for it.
    """
    n = centres.shape[0]
    mean = np.empty(6)
    smooth = 1.5 * pitch
    for a in range(n):
        i = order[a]
        out[i, 0] = np.nan
        if np.isnan(pairs[i, 0]):
            continue
        mean[:] = 0.0
        total, squares = 0.0, 0.0
        for side in range(2):
            b = a if side == 0 else a + 1
            while 0 <= b < n and abs(along[order[b]] - along[i]) < 0.25 * pitch:
                j = order[b]
                b += 2 * side - 1
                if np.isnan(pairs[j, 0]) or abs(pairs[j, 0] - pairs[i, 0]) > 0.25:
                    continue
                apart, alike = 0.0, 0.0
                for m in range(3):
                    apart += (centres[j, m] - centres[i, m]) ** 2
                    alike += pairs[j, 6 + m] * pairs[i, 6 + m]
                if alike < 0.8:
                    continue
                weight = np.exp(-0.5 * apart / (smooth * smooth))
                total += weight
                squares += weight * weight
                for m in range(6):
                    mean[m] += weight * pairs[j, m]
        mean /= total
        sine, before = mean[0], mean[2]
        out[i, 2] = sine
        if sine <= 0.0 or before >= sine - 0.01:
            continue
        cosine, cosine_before = np.sqrt(1.0 - sine * sine), np.sqrt(1.0 - before * before)
        slope = before / cosine_before
        bend = (cosine_before - cosine) - (sine - before) * slope
        if bend < 1e-9:
            continue
        radius = (mean[5] - mean[4] * slope) / bend
        count = total * total / squares
        turn = max(radius, 0.0) * (sine - before) * 0.05 / bend
        out[i, 0] = radius
        out[i, 1] = np.sqrt(((noise / bend) ** 2 + turn * turn) / count)


@kernel
def extrapolate(centres, pairs, radii, members, direction, place, least_radius, floor, scratch, out):
    """Where the surface beyond the line of `members` lies at `place`, along `direction`, and which way it faces.

    Each member's arc is followed to the depth of the place; the weighted median over the members decides.
    `out` (5,) takes position, standard deviation and normal; False where fewer than four members can tell.
    """
    count, total, squares = 0, 0.0, 0.0
    for m in range(2, 5):
        out[m] = 0.0
    for a in range(members.shape[0]):
        i = members[a]
        sine = radii[i, 2]
        spread = radii[i, 1] * (1.0 - sine)
        if spread > 0.8 * least_radius:
            continue
        radius = min(max(radii[i, 0], least_radius), 20.0 * least_radius)
        depth, apart, start = 0.0, 0.0, 0.0
        for m in range(3):
            depth += (centres[i, m] - place[m]) * pairs[i, 6 + m]
            apart += (centres[i, m] - place[m]) ** 2
            start += centres[i, m] * direction[m]
        rise = max(np.sqrt(1.0 - sine * sine) - max(depth, 0.0) / radius, 0.0)
        reach = np.sqrt(1.0 - rise * rise)
        weight = np.exp(-np.sqrt(apart) / (1.6 * least_radius)) / (spread + floor) ** 2
        scratch[count, 0], scratch[count, 1], scratch[count, 2] = start + radius * (reach - sine), weight, spread
        for m in range(3):
            out[2 + m] += weight * (rise * pairs[i, 6 + m] + reach * direction[m])
        total += weight
        squares += weight * weight
        count += 1
    if count < 4:
        return False
    out[0] = weighted_median(scratch[:count, 0], scratch[:count, 1])
    deviation = 1.5 * weighted_median(np.abs(scratch[:count, 0] - out[0]), scratch[:count, 1])
    spread = weighted_median(scratch[:count, 2], scratch[:count, 1])
    out[1] = max(floor, deviation / np.sqrt(max(0.5 * total * total / squares, 1.0)), 0.7 * spread)
    length = np.sqrt(out[2] ** 2 + out[3] ** 2 + out[4] ** 2)
    for m in range(2, 5):
        out[m] /= length
    return True


@kernel
def weighted_median(values, weights):
    """The value at which half of the weight is reached."""
    order = np.argsort(values)
    half = 0.5 * np.sum(weights)
    reached = 0.0
    for a in order:
        reached += weights[a]
        if reached >= half:
            return values[a]
    return values[order[-1]]
