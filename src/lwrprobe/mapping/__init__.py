"""The voxel map of occupied and free space, and its files."""

from lwrprobe.mapping.body_over_heights import BodyOverHeights
from lwrprobe.mapping.map_file import describe, to_cloud
from lwrprobe.mapping.path_corners import path_corners
from lwrprobe.mapping.plan_view import PlanView
from lwrprobe.mapping.swept_columns import SweptColumns
from lwrprobe.mapping.swept_sphere import SweptSphere
from lwrprobe.mapping.voxel_map import Leaves, VoxelMap, VoxelState

__all__ = [
    "BodyOverHeights",
    "Leaves",
    "PlanView",
    "SweptColumns",
    "SweptSphere",
    "VoxelMap",
    "VoxelState",
    "describe",
    "path_corners",
    "to_cloud",
]
