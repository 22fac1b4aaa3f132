"""Which points of the primitives' surfaces bound the solid, each point of it counted once."""

from __future__ import annotations

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.scene.mesh_kernels import mesh_nearest
from lwrprobe.scene.program import MESHES
from lwrprobe.scene.surface_kernels import contains, on_patch, surface_gradient, surface_value

_SKIN = 1e-7  # m
_SAME = 1e-9  # m


@kernel
def keep_faces(numbers, indices, k, points, normals, keep):
    """For points (n, 3) of surface k (-1: of a mesh) with gradients (n, 3): 1 or -1 to keep one, 0 to drop it.

    -1 where the gradient points into the solid. Points outside of the surface's own primitive, and those that an
    earlier primitive's coincident surface has already, are dropped.
    """
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        above = _within(numbers, indices, x + _SKIN * nx, y + _SKIN * ny, z + _SKIN * nz)
        below = _within(numbers, indices, x - _SKIN * nx, y - _SKIN * ny, z - _SKIN * nz)
        keep[n] = 0
        if above != below and (k < 0 or _owns(numbers, k, x, y, z, nx, ny, nz)):
            keep[n] = 1 if below else -1


@kernel
def _within(numbers, indices, x, y, z):
    inside = contains(numbers, indices, x, y, z)
    for m in range(indices[MESHES]):
        inside = inside or mesh_nearest(numbers, indices, m, x, y, z)[0] < 0.0
    return inside


@kernel
def _owns(numbers, k, x, y, z, nx, ny, nz):
    """Whether surface k is the first whose patch holds the point."""
    if not on_patch(numbers, k, x, y, z, _SAME):
        return False
    for other in range(k):
        if abs(surface_value(numbers, other, x, y, z)) > _SAME:
            continue
        gx, gy, gz = surface_gradient(numbers, other, x, y, z)
        if abs(gx * nx + gy * ny + gz * nz) > 1.0 - 1e-9 and on_patch(numbers, other, x, y, z, _SAME):
            return False
    return True
