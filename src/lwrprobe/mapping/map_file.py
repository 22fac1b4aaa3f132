"""What a map file holds, and its voxels as a cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.mapping.cloud import Cloud
from lwrprobe.mapping.clouds import write_cloud
from lwrprobe.mapping.voxel_map import VoxelMap, VoxelState


def describe(path: str | Path) -> dict[str, Any]:
    """Resolution, counts, volumes and bounds of a `.bt` or `.ot`; raises FormatError for a broken one."""
    path = Path(path)
    voxels = VoxelMap.read(path)
    leaves = voxels.leaves()
    occupied = leaves.states == VoxelState.OCCUPIED
    free = voxels.free_count()
    bounds = voxels.bounds()
    low, high = ([None] * 3, [None] * 3) if bounds is None else (np.round(corner, 9).tolist() for corner in bounds)
    return {
        "file": str(path),
        "bytes": path.stat().st_size,
        "resolution_m": voxels.resolution,
        "occupied_voxels": len(voxels),
        "free_voxels": free,
        "occupied_leaves": int(occupied.sum()),
        "free_leaves": int(len(occupied) - occupied.sum()),
        "occupied_volume_m3": len(voxels) * voxels.resolution**3,
        "free_volume_m3": free * voxels.resolution**3,
        "lower_m": low,
        "upper_m": high,
    }


def to_cloud(path: str | Path, out: str | Path) -> int:
    """Write the centres of all occupied voxels of a map file to a cloud file; how many. Pruned cubes are expanded."""
    centres = VoxelMap.read(path).centres()
    write_cloud(out, Cloud(centres))
    return len(centres)
