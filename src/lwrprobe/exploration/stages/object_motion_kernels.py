"""Detection of object motion: two places of the sphere that one rigid surface cannot explain (kernels, private)."""

from __future__ import annotations

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def deepest(places, normals, count, centre, normal, touching, aside, reach):
    """m, by which the surface has moved between one of the `count` earlier `places` and `centre`; 0 if it has not.

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
        n = normals[k]
        if n[0] != 0.0 or n[1] != 0.0 or n[2] != 0.0:
            depth = -(x * n[0] + y * n[1] + z * n[2])
            if worst < depth <= reach and square - depth * depth <= aside * aside:
                worst = depth
        if touching:
            depth = x * normal[0] + y * normal[1] + z * normal[2]
            if worst < depth <= reach and square - depth * depth <= aside * aside:
                worst = depth
    return worst
