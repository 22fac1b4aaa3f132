"""How near each part of the probe comes to a wall of voxels, and where the nearest points lie."""

import numpy as np

from lwrprobe.collision import ClearanceQuery
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import load_scene

probe = load_scene("block").probe.as_probe()
print("links behind the sphere:", ", ".join(link.name for link in probe.links))

y, z = np.meshgrid(np.arange(-0.02, 0.02, 0.002), np.arange(0.0, 0.06, 0.002))
wall = np.column_stack([np.full(y.size, 0.03), y.ravel(), z.ravel()])  # m, at x = 30 mm, 60 mm high
voxels = VoxelMap(resolution=0.002)
voxels.insert(wall)
query = ClearanceQuery(probe.links, voxels)

tip = np.diag([1.0, -1.0, -1.0, 1.0])  # the probe points down
tip[2, 3] = 0.03
for x in (0.0, 0.01, 0.02, 0.024):
    tip[0, 3] = x
    found = query.nearest(tip)
    print(f"sphere centre {1e3 * (0.03 - x):2.0f} mm from the wall: {found.link} {1e3 * found.distance:5.2f} mm")

tips = np.repeat(tip[None], 1000, axis=0)
tips[:, 0, 3] = np.linspace(-0.05, 0.024, 1000)
distances = query.nearest_batch(tips)[:, 0]
print(f"over 1000 poses the smallest distance is {1e3 * distances.min():.2f} mm")
