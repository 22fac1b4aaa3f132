"""A mesh's deviation from the truth as a coloured picture and as a PLY with the deviation in it."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.mesh_error import deviation, face_deviation
from lwrprobe.evaluation.ramps import DEVIATION
from lwrprobe.evaluation.render import Sight, View
from lwrprobe.host.whole_file import write_whole
from lwrprobe.scene.solid import Solid

VIEWS = ((np.radians(-58.0), np.radians(28.0)), (np.radians(122.0), np.radians(28.0)))
"""Azimuth and elevation from which both long sides, both ends and the top are seen."""


def deviation_colours(signed: np.ndarray, limit: float) -> np.ndarray:
    """(n, 3): blue where the surface lies too deep, red where too far out, saturated at `limit` m."""
    return DEVIATION.colours(0.5 + 0.5 * signed / limit)


def draw_deviation(path: str | Path, mesh: TriangleMesh, solid: Solid, above: float, limit: float = 0.002) -> Path:
    """PNG of the mesh from two sides, coloured by its deviation, with the scale and a histogram.

    Raises StorageError.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.figure import Figure

    path, signed = Path(path), deviation(mesh, solid)
    figure = Figure(figsize=(12.0, 4.6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 3, width_ratios=[1.3, 1.3, 1.0])
    lower, upper = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    for axes, (azimuth, elevation) in zip(panels, VIEWS):
        sight = Sight(mesh, View(azimuth, elevation, lower, upper, 720, 560))
        axes.imshow(sight.paint(deviation_colours(signed, limit)))
        axes.set_axis_off()
    ramp = LinearSegmentedColormap.from_list("deviation", DEVIATION.rgb())
    scale = ScalarMappable(Normalize(-1e3 * limit, 1e3 * limit), ramp)
    figure.colorbar(scale, ax=panels[:2], location="bottom", shrink=0.5, label="mm, positive outside the true shape")
    high = signed[mesh.vertices[:, 2] > above]
    panels[2].hist(1e3 * high, bins=80, color="#4a7ba6")
    panels[2].set(xlabel="deviation of the vertices, mm", yticks=[], title=f"mean {1e3 * np.abs(high).mean():.3f} mm")
    picture = BytesIO()
    figure.savefig(picture)
    write_whole(path, picture.getvalue())
    return path


def write_deviation(path: str | Path, mesh: TriangleMesh, solid: Solid) -> Path:
    """PLY with the signed `deviation` [m] of each vertex and face, and colours saturated at 2 mm.

    Raises StorageError.
    """
    import trimesh

    path, signed = Path(path), deviation(mesh, solid)
    vertex: dict[str, ArrayLike] = {"deviation": signed.astype(np.float32)}
    if mesh.vertex_error is not None:
        vertex["vertex_error"] = mesh.vertex_error.astype(np.float32)
    made = trimesh.Trimesh(
        mesh.vertices, mesh.faces, process=False, vertex_attributes=vertex,
        face_attributes={"deviation": face_deviation(mesh, solid).astype(np.float32)},
        vertex_colors=np.round(255.0 * deviation_colours(signed, 0.002)).astype(np.uint8),
    )  # fmt: skip
    content = made.export(file_type="ply")
    assert isinstance(content, bytes), "a PLY is binary"
    write_whole(path, content)
    return path
