"""All that stands around the robot: the table, the fixed objects as one solid, and one object that can move.

The two solids lie behind one another in `numbers` and `indices`. Surfaces are named by their material: 0 the table,
then the fixed objects, and last the movable one.
"""

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.scene.program import MESHES, SURFACES
from lwrprobe.scene.solid_kernels import nearest, outside_bounds, sphere_contacts
from lwrprobe.scene.surface_kernels import tree_value

FOUND_MAX = 12
PLANE = 0  # the table: normal 3, height along it; normal 0 = none
POSE = 4  # of the movable object, away from where the scene put it: x axis, y axis, z axis, origin
FOUND = 16  # points, then normals
POINT = FOUND + 6 * FOUND_MAX
SETTINGS = POINT + 3

SPLIT_NUMBERS, SPLIT_INDICES, FIXED, MOVABLE = range(4)
"""Where the movable solid begins, how many fixed objects there are, and whether there is a movable one."""
MATERIAL = 4
COUNTS = MATERIAL + FOUND_MAX

NOTHING = 1e9


@kernel
def distance_bound(v, counts, numbers, indices, x, y, z):
    """Negative inside anything, else a lower bound of the distance to everything."""
    bound = NOTHING
    if _has_table(v):
        bound = v[PLANE] * x + v[PLANE + 1] * y + v[PLANE + 2] * z - v[PLANE + 3]
    for k in range(1 + counts[MOVABLE]):
        if k == 1:
            x, y, z = _into_body(v, x, y, z)
        bound = min(bound, _solid_bound(*_solid(counts, numbers, indices, k), x, y, z, bound))
    return bound


@kernel
def distance(v, counts, numbers, indices, x, y, z):
    """Exact distance to everything, negative inside."""
    best = NOTHING
    if _has_table(v):
        best = v[PLANE] * x + v[PLANE + 1] * y + v[PLANE + 2] * z - v[PLANE + 3]
    for k in range(1 + counts[MOVABLE]):
        if k == 1:
            x, y, z = _into_body(v, x, y, z)
        some_numbers, some_indices = _solid(counts, numbers, indices, k)
        best = min(best, nearest(some_numbers, some_indices, x, y, z)[0])
    return best


@kernel
def contacts_near(v, counts, numbers, indices, centre, reach):
    """Contacts of a ball into FOUND and MATERIAL; their number, and a lower bound of the distance to everything."""
    points = v[FOUND : FOUND + 3 * FOUND_MAX].reshape((FOUND_MAX, 3))
    normals = v[FOUND + 3 * FOUND_MAX : POINT].reshape((FOUND_MAX, 3))
    at = v[POINT : POINT + 3]
    at[0], at[1], at[2] = centre[0], centre[1], centre[2]
    found, bound = 0, NOTHING
    for k in range(1 + counts[MOVABLE]):
        if k == 1:
            at[0], at[1], at[2] = _into_body(v, centre[0], centre[1], centre[2])
        some_numbers, some_indices = _solid(counts, numbers, indices, k)
        if some_indices[SURFACES] == 0 and some_indices[MESHES] == 0:
            continue
        materials = counts[MATERIAL + found : COUNTS]
        more, far = sphere_contacts(some_numbers, some_indices, at, reach, points[found:], normals[found:], materials)
        for i in range(found, found + more):
            counts[MATERIAL + i] = 1 + counts[FIXED] if k == 1 else 1 + counts[MATERIAL + i]
            if k == 1:
                _out_of_body(v, points[i], normals[i])
        found += more
        bound = min(bound, far)
    if _has_table(v):
        height = v[PLANE] * centre[0] + v[PLANE + 1] * centre[1] + v[PLANE + 2] * centre[2] - v[PLANE + 3]
        bound = min(bound, height)
        if height < reach and found < FOUND_MAX:
            for i in range(3):
                points[found, i] = centre[i] - height * v[PLANE + i]
                normals[found, i] = v[PLANE + i]
            counts[MATERIAL + found] = 0
            found += 1
    return found, bound


@kernel
def _has_table(v):
    return v[PLANE] != 0.0 or v[PLANE + 1] != 0.0 or v[PLANE + 2] != 0.0


@kernel(inline="always")
def _solid(counts, numbers, indices, k):
    a, b = counts[SPLIT_NUMBERS], counts[SPLIT_INDICES]
    if k == 0:
        return numbers[:a], indices[:b]
    return numbers[a:], indices[b:]


@kernel
def _solid_bound(numbers, indices, x, y, z, enough):
    """Lower bound of the distance to one solid; any number above `enough` will do as well."""
    if indices[SURFACES] == 0 and indices[MESHES] == 0:
        return NOTHING
    outside = outside_bounds(numbers, indices, x, y, z)
    if outside > enough:
        return outside
    if indices[MESHES] > 0:
        return outside if outside > 0.0 else nearest(numbers, indices, x, y, z)[0]
    value = tree_value(numbers, indices, x, y, z)
    return max(outside, value) if outside > 0.0 else value


@kernel
def _into_body(v, x, y, z):
    x, y, z = x - v[POSE + 9], y - v[POSE + 10], z - v[POSE + 11]
    return (
        v[POSE] * x + v[POSE + 1] * y + v[POSE + 2] * z,
        v[POSE + 3] * x + v[POSE + 4] * y + v[POSE + 5] * z,
        v[POSE + 6] * x + v[POSE + 7] * y + v[POSE + 8] * z,
    )


@kernel
def _out_of_body(v, point, normal):
    for vector, origin in ((point, 1.0), (normal, 0.0)):
        x, y, z = vector[0], vector[1], vector[2]
        for i in range(3):
            turned = v[POSE + i] * x + v[POSE + 3 + i] * y + v[POSE + 6 + i] * z
            vector[i] = turned + origin * v[POSE + 9 + i]
