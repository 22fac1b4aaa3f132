"""Reconstructors of other libraries, behind the call of our own: a touch record in, a mesh out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lwrprobe.bench.timing import installed
from lwrprobe.contracts import TouchRecord, TriangleMesh

Method = Callable[[TouchRecord], TriangleMesh]

_ALPHA = 0.015  # m, as the thesis chose it


def peers() -> tuple[dict[str, Method], list[str]]:
    """Methods of the installed peers by name, and a sentence for each library that is missing."""
    makers = {"open3d": _open3d, "pymeshlab": _pymeshlab}
    found, missing = installed({name: name for name in makers})
    methods = [makers[name](library) for name, library in found.items()]
    return {name: method for some in methods for name, method in some.items()}, missing


def _open3d(library: Any) -> dict[str, Method]:
    library.utility.set_verbosity_level(library.utility.VerbosityLevel.Error)  # else a line for each sliver

    def cloud(record: TouchRecord) -> Any:
        made = library.geometry.PointCloud(library.utility.Vector3dVector(record.points))
        made.normals = library.utility.Vector3dVector(record.normals)
        return made

    def mesh(made: Any) -> TriangleMesh:
        return TriangleMesh(np.asarray(made.vertices).copy(), np.asarray(made.triangles).astype(np.int64))

    shapes = library.geometry.TriangleMesh

    def pivoting(record: TouchRecord) -> TriangleMesh:
        radii = library.utility.DoubleVector([0.004, 0.008, 0.016])
        return mesh(shapes.create_from_point_cloud_ball_pivoting(cloud(record), radii))

    return {
        "open3d alpha shape": lambda record: mesh(shapes.create_from_point_cloud_alpha_shape(cloud(record), _ALPHA)),
        "open3d ball pivoting": pivoting,
    }


def _pymeshlab(library: Any) -> dict[str, Method]:
    def through(filter_name: str, **options: Any) -> Method:
        def run(record: TouchRecord) -> TriangleMesh:
            work = library.MeshSet()
            work.add_mesh(library.Mesh(vertex_matrix=record.points, v_normals_matrix=record.normals))
            work.apply_filter(filter_name, **options)
            made = work.current_mesh()
            return TriangleMesh(made.vertex_matrix().copy(), made.face_matrix().astype(np.int64))

        return run

    return {
        "pymeshlab screened Poisson": through("generate_surface_reconstruction_screened_poisson", depth=6, threads=1),
        "pymeshlab RIMLS": through("generate_marching_cubes_rimls", resolution=80),
    }
