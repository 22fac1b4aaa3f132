"""The map: voxels that were touched or swept free, and the files they travel in."""

from lwrprobe.mapping.map_file import describe, to_cloud
from lwrprobe.mapping.swept_sphere import SweptSphere
from lwrprobe.mapping.voxel_map import Leaves, VoxelMap, VoxelState

__all__ = ["Leaves", "SweptSphere", "VoxelMap", "VoxelState", "describe", "to_cloud"]
