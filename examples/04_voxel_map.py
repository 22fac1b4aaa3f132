"""Contacts become occupied voxels, the sphere's path becomes free ones; the map is written as an OctoMap file."""

import numpy as np

from lwrprobe.mapping import VoxelMap

angle = np.linspace(0, 2 * np.pi, 200)
ring = np.column_stack([0.025 * np.cos(angle), 0.025 * np.sin(angle), np.full(200, 0.031)])  # m

voxels = VoxelMap(resolution=0.002)
voxels.insert(ring)
voxels.carve_path(np.array([[-0.06, 0.04, 0.031], [0.06, 0.04, 0.031]]), radius=0.005)
print(len(voxels), "occupied and", voxels.free_count(), "free voxels of 2 mm")

distance, centre = voxels.nearest(np.array([0.0, 0.03, 0.031]))
print(f"the occupied voxel nearest to y = 30 mm has its centre {1e3 * distance:.2f} mm away")
for y in (0.0249, 0.04, 0.1):
    print(f"the voxel at y = {1e3 * y:.0f} mm is {voxels.state(np.array([0.0, y, 0.031])).name.lower()}")

path = voxels.write("ring.bt")
print(path, "has", path.stat().st_size, "bytes; read back it has", len(VoxelMap.read(path)), "occupied voxels")
