"""Touches become voxels; the map answers what is near and is written as an OctoMap file."""

import tempfile
from pathlib import Path

import numpy as np

from lwrprobe.mapping import VoxelMap

angle = np.linspace(0, 2 * np.pi, 200)
ring = np.column_stack([0.024 * np.cos(angle), 0.024 * np.sin(angle), np.full(200, 0.03)])

voxels = VoxelMap(resolution=0.002)
voxels.insert(ring)
distance, centre = voxels.nearest(np.array([0.0, 0.03, 0.03]))
print(len(voxels), "voxels; the nearest to y = 30 mm is", round(1e3 * distance, 2), "mm away")

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "ring.bt"
    voxels.write(path)
    assert len(VoxelMap.read(path)) == len(voxels)
    print(path.name, path.stat().st_size, "bytes")
