"""Error metrics, error against run time, reports."""

from lwrprobe.evaluation.coverage import (
    Coverage,
    coverage,
    coverage_over_time,
    end_errors,
    gap_over_time,
    gap_p95_over_time,
    touched,
)
from lwrprobe.evaluation.lower_bound import lower_bound_path, lower_bound_time
from lwrprobe.evaluation.mesh_error import (
    MeshError,
    deviation,
    face_deviation,
    is_watertight,
    mesh_error,
    reachable_error,
)
from lwrprobe.evaluation.point_error import (
    NormalError,
    PointError,
    aligned_points,
    normal_error,
    point_error,
    surface_error,
)
from lwrprobe.evaluation.reach import Reach, reach, upright

__all__ = [
    "Coverage",
    "MeshError",
    "NormalError",
    "PointError",
    "Reach",
    "aligned_points",
    "coverage",
    "coverage_over_time",
    "deviation",
    "end_errors",
    "face_deviation",
    "gap_over_time",
    "gap_p95_over_time",
    "is_watertight",
    "lower_bound_path",
    "lower_bound_time",
    "mesh_error",
    "normal_error",
    "point_error",
    "reach",
    "reachable_error",
    "surface_error",
    "touched",
    "upright",
]
