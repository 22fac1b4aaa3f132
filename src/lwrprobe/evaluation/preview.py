"""The picture of a run: what was touched, what was made of it, what it really is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contracts import TriangleMesh

_INK = "#22303c"
_FAINT = "#7b8794"
_MESH = (0.93, 0.60, 0.26)
_TRUTH = (0.42, 0.56, 0.70)
_LIGHT = np.array([-0.45, -0.65, 0.75])


def draw_preview(
    path: Path, title: str, points: np.ndarray, mesh: TriangleMesh | None, truth: TriangleMesh | None, facts: list[str]
) -> None:
    """Draw contact points (n, 3), mesh and true shape side by side, from one viewpoint and in one scale, to a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 5.2), dpi=120, facecolor="white")
    FigureCanvasAgg(figure)
    low, high = _bounds(points, mesh, truth)
    panels = (
        ("touched", _draw_points, points),
        ("reconstructed", _draw_mesh, mesh),
        ("true shape", _draw_truth, truth),
    )
    for i, (name, draw, what) in enumerate(panels):
        axes = figure.add_axes((0.005 + i * 0.332, 0.02, 0.326, 0.86), projection="3d", computed_zorder=False)
        _frame(axes, low, high)
        if what is None or len(getattr(what, "vertices", what)) == 0:
            axes.text2D(0.5, 0.45, "nothing", ha="center", color=_FAINT, fontsize=13, transform=axes.transAxes)
        else:
            draw(axes, what)
        figure.text(0.168 + i * 0.332, 0.855, name, ha="center", color=_INK, fontsize=13, weight="bold")
    figure.text(0.02, 0.95, title, color=_INK, fontsize=15, weight="bold", va="center")
    figure.text(0.98, 0.95, "   ".join(facts), color=_FAINT, fontsize=11, ha="right", va="center")
    figure.savefig(path, facecolor="white")


def _draw_points(axes: Any, points: np.ndarray) -> None:
    shown = points if len(points) < 20_000 else points[:: len(points) // 20_000 + 1]
    millimetres = 1e3 * shown
    axes.scatter(*millimetres.T, c=millimetres[:, 2], cmap="viridis", s=4.0, linewidths=0.0, depthshade=False)


def _draw_mesh(axes: Any, mesh: TriangleMesh) -> None:
    _shade(axes, mesh, _MESH, edges=len(mesh.faces) < 3000)


def _draw_truth(axes: Any, mesh: TriangleMesh) -> None:
    _shade(axes, mesh, _TRUTH, edges=False)


def _shade(axes: Any, mesh: TriangleMesh, colour: tuple[float, float, float], edges: bool) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = 1e3 * mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = 0.35 + 0.65 * np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    shades = np.clip(np.outer(light, colour) + 0.08, 0.0, 1.0)
    lines = (
        {"edgecolors": (0.2, 0.2, 0.2, 0.35), "linewidths": 0.3} if edges else {"edgecolors": shades, "linewidths": 0.2}
    )
    axes.add_collection3d(Poly3DCollection(corners, facecolors=shades, **lines))


def _frame(axes: Any, low: np.ndarray, high: np.ndarray) -> None:
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(0.0, high[2])
    axes.set_box_aspect((high[0] - low[0], high[1] - low[1], high[2]), zoom=0.92)
    axes.view_init(elev=26.0, azim=-58.0)
    axes.tick_params(labelsize=7, colors=_FAINT, pad=-2)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.97, 0.975, 0.98, 1.0))
        axis.line.set_color((0.8, 0.82, 0.84, 1.0))
        axis._axinfo["grid"].update(color=(0.88, 0.9, 0.92, 1.0), linewidth=0.5)
    axes.set_xlabel("x mm", fontsize=8, color=_FAINT, labelpad=-6)
    axes.set_ylabel("y mm", fontsize=8, color=_FAINT, labelpad=-6)
    axes.set_zlabel("z mm", fontsize=8, color=_FAINT, labelpad=-8)


def _bounds(points: np.ndarray, mesh: TriangleMesh | None, truth: TriangleMesh | None) -> tuple[np.ndarray, np.ndarray]:
    """Millimetres, a margin around all that is drawn."""
    clouds = [c for c in (points, *(m.vertices for m in (mesh, truth) if m is not None)) if len(c)]
    if not clouds:
        return np.array([-50.0, -50.0, 0.0]), np.array([50.0, 50.0, 50.0])
    everything = 1e3 * np.vstack(clouds)
    return everything.min(axis=0) - 8.0, everything.max(axis=0) + 4.0
