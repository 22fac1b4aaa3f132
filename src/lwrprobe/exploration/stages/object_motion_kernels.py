"""Detection of object motion: two places of the sphere that one rigid surface cannot explain (kernels, private)."""

from __future__ import annotations

import math

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def deepest(places, normals, sticks, count, centre, normal, stick, turned, touching, aside, reach):
    """m, by which the surface has moved between one of the `count` earlier `places` and `centre`; 0 if it has not.

    `turned` m is taken off for each unit by which the stick's direction was another one.

    An earlier touch says that nothing can be behind it along its normal; a touch now says so of all earlier places.
    Only places within `aside` m of that normal's line and `reach` m along it are asked. `normals` are zero where
    nothing was touched.
    """
    worst = 0.0
    for k in range(count):
        x, y, z = centre[0] - places[k, 0], centre[1] - places[k, 1], centre[2] - places[k, 2]
        square = x * x + y * y + z * z
        if square > reach * reach + aside * aside:
            continue
        n, other = normals[k], sticks[k]
        u, v, w = stick[0] - other[0], stick[1] - other[1], stick[2] - other[2]
        less = turned * math.sqrt(u * u + v * v + w * w)
        if n[0] != 0.0 or n[1] != 0.0 or n[2] != 0.0:
            depth = -(x * n[0] + y * n[1] + z * n[2])
            if worst < depth - less and depth <= reach and square - depth * depth <= aside * aside:
                worst = depth - less
        if touching:
            depth = x * normal[0] + y * normal[1] + z * normal[2]
            if worst < depth - less and depth <= reach and square - depth * depth <= aside * aside:
                worst = depth - less
    return worst
