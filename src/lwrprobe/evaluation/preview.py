"""The picture of a run: what was touched, what was made of it, what it really is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.charts import ticks
from lwrprobe.evaluation.ramps import ERROR
from lwrprobe.evaluation.render import Sight, View, png, render_points
from lwrprobe.evaluation.summary import Summary
from lwrprobe.evaluation.truth import true_solid
from lwrprobe.scene import Scene

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

_INK, _FAINT, _RULE, _WALL = "#22303c", "#7b8794", "#e0e4e8", "#f7f9fa"
_MESH, _TRUTH = (0.98, 0.66, 0.32), (0.47, 0.62, 0.78)
_AZIMUTH, _ELEVATION = np.radians(-58.0), np.radians(26.0)
_MAX_POINTS = 20_000
_BALL = 7e-4  # m, radius of a contact in the picture
_WIDTH, _HEIGHT = 500, 440  # of one panel
_TOP, _SIDE = 90, 20
_FINER = 2  # the frame and the words are drawn larger and then reduced


def run_preview(scene: Scene, summary: Summary, points: np.ndarray, mesh: TriangleMesh | None) -> bytes:
    """The picture of a run, or of several merged ones, as a PNG; see `preview`."""
    solid = true_solid(scene) if summary.truth_known else None
    truth = None if solid is None else solid.mesh()
    title, contacts = scene.title or scene.name, f"{len(points)} contacts"
    if summary.merged is not None:
        return preview(f"{title}, merged", points, mesh, truth, [f"{len(summary.merged)} runs", contacts])
    facts = [contacts, f"{summary.sim_time_s:.0f} s"]
    if summary.mesh_error_mm is not None:
        facts.append(f"mesh error {summary.mesh_error_mm['mean']:.2f} mm")
    if summary.mesh_error_aligned_mm is not None:
        facts.append(f"{summary.mesh_error_aligned_mm['mean']:.2f} mm after alignment")
    return preview(f"{title}: {scene.strategy.name}", points, mesh, truth, facts)


def preview(
    title: str, points: np.ndarray, mesh: TriangleMesh | None, truth: TriangleMesh | None, facts: list[str]
) -> bytes:
    """Contact points (n, 3), mesh and true shape side by side, from one viewpoint and in one scale, as a PNG."""
    from PIL import Image, ImageDraw

    view = View(_AZIMUTH, _ELEVATION, *_bounds(points, mesh, truth), _WIDTH, _HEIGHT)
    panels = (
        ("touched", _points(points, view)),
        ("reconstructed", _shape(mesh, _MESH, view)),
        ("true shape", _shape(truth, _TRUTH, view)),
    )
    size = (3 * (_WIDTH + _SIDE) + _SIDE, _TOP + _HEIGHT + _SIDE)
    sheet = Image.new("RGB", (_FINER * size[0], _FINER * size[1]), "white")
    pen = ImageDraw.Draw(sheet)
    _write(pen, (_SIDE, 28), title, 21, _INK, "lm")
    _write(pen, (size[0] - _SIDE, 28), "    ".join(facts), 15, _FAINT, "rm")
    corners = [(_SIDE + i * (_WIDTH + _SIDE), _TOP) for i in range(len(panels))]
    for (name, picture), corner in zip(panels, corners):
        _write(pen, (corner[0] + _WIDTH // 2, 68), name, 18, _INK, "mm")
        _frame(pen, view, corner)
        if picture is None:
            _write(pen, (corner[0] + _WIDTH // 2, _TOP + _HEIGHT // 2), "nothing", 16, _FAINT, "mm")
    sheet = sheet.reduce(_FINER)
    for (_, picture), corner in zip(panels, corners):
        if picture is not None:
            layer = Image.fromarray(picture)
            sheet.paste(layer, corner, layer)
    return png(np.asarray(sheet))


def _points(points: np.ndarray, view: View) -> np.ndarray | None:
    if not len(points):
        return None
    shown = points[:: len(points) // _MAX_POINTS + 1]
    low, high = points[:, 2].min(), points[:, 2].max()
    return render_points(shown, ERROR.colours((shown[:, 2] - low) / max(high - low, 1e-9)), view, _BALL)


def _shape(mesh: TriangleMesh | None, colour: tuple[float, float, float], view: View) -> np.ndarray | None:
    if mesh is None or not len(mesh.faces):
        return None
    return Sight(mesh, view).paint(np.tile(colour, (len(mesh.vertices), 1)))


def _frame(pen: ImageDraw, view: View, corner: tuple[int, int]) -> None:
    """Floor and the two walls behind, ruled at round millimetres, with the numbers along the near edges."""
    low, high = view.lower, view.upper

    def place(x: float, y: float, z: float) -> tuple[float, float]:
        across, down, _ = view.place(np.array([[x, y, z]]))[0][0]
        return _FINER * (corner[0] + across), _FINER * (corner[1] + down)

    (x0, y0, z0), (x1, y1, z1) = low, high
    for quad in (
        ((x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)),
        ((x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1)),
        ((x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)),
    ):
        pen.polygon([place(*point) for point in quad], fill=_WALL, outline=_RULE)
    for x in _rules(x0, x1):
        pen.line([place(x, y0, z0), place(x, y1, z0), place(x, y1, z1)], fill=_RULE, width=_FINER)
        _number(pen, place(x, y0, z0), x, (-6, 11))
    for y in _rules(y0, y1):
        pen.line([place(x1, y, z0), place(x0, y, z0), place(x0, y, z1)], fill=_RULE, width=_FINER)
        _number(pen, place(x1, y, z0), y, (13, 7))
    for z in _rules(z0, z1):
        pen.line([place(x0, y0, z), place(x0, y1, z), place(x1, y1, z)], fill=_RULE, width=_FINER)
        _number(pen, place(x1, y1, z), z, (14, 0))
    for axis, at, shift in (
        ("x mm", place(0.5 * (x0 + x1), y0, z0), (-22, 26)),
        ("y mm", place(x1, 0.5 * (y0 + y1), z0), (38, 20)),
        ("z mm", place(x1, y1, z1), (0, -12)),
    ):
        _write(pen, (at[0] / _FINER + shift[0], at[1] / _FINER + shift[1]), axis, 12, _FAINT, "mm")


def _rules(low: float, high: float) -> np.ndarray:
    """m, round millimetres between two heights."""
    return 1e-3 * ticks(1e3 * low, 1e3 * high, 6)


def _number(pen: ImageDraw, at: tuple[float, float], metres: float, shift: tuple[int, int]) -> None:
    _write(pen, (at[0] / _FINER + shift[0], at[1] / _FINER + shift[1]), f"{1e3 * metres:.0f}", 11, _FAINT, "mm")


def _write(pen: ImageDraw, at: tuple[float, float], text: str, size: int, colour: str, anchor: str) -> None:
    from PIL import ImageFont

    pen.text((_FINER * at[0], _FINER * at[1]), text, colour, ImageFont.load_default(_FINER * size), anchor)


def _bounds(points: np.ndarray, mesh: TriangleMesh | None, truth: TriangleMesh | None) -> tuple[np.ndarray, np.ndarray]:
    """m, from the table up, with a margin around all that is drawn."""
    clouds = [c for c in (points, *(m.vertices for m in (mesh, truth) if m is not None)) if len(c)]
    if not clouds:
        return np.array([-0.05, -0.05, 0.0]), np.array([0.05, 0.05, 0.05])
    everything = np.vstack(clouds)
    low, high = everything.min(axis=0) - 0.008, everything.max(axis=0) + 0.004
    low[2] = min(0.0, low[2] + 0.008)
    return low, high
