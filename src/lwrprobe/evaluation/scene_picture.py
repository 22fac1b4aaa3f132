"""A small picture of a scene: what stands on its table, and the box in which the sphere may move."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.render import Sight, View, png
from lwrprobe.host.whole_file import write_whole
from lwrprobe.scene import Scene

WIDTH, HEIGHT = 360, 250
AZIMUTH, ELEVATION = np.radians(-55.0), np.radians(28.0)
OBJECT, TABLE, BOX = (0.42, 0.56, 0.72), (0.80, 0.77, 0.71), (0.86, 0.45, 0.18)
EDGE = 0.0004
"""m, half the thickness of the box's edges."""


def draw_scene(path: Path, scene: Scene) -> Path:
    """Draw a scene's true shapes, its table and the edges of its area to a PNG; the path. Raises StorageError."""
    low, high = np.array(scene.area.lower), np.array(scene.area.upper)
    parts = [(_edges(low, high), BOX)]
    if scene.table.present:
        parts.append((_table(scene, low, high), TABLE))
    if scene.objects:
        parts.append((scene.solid().mesh(), OBJECT))
    vertices = np.concatenate([mesh.vertices for mesh, _ in parts])
    colours = np.concatenate([np.tile(colour, (len(mesh.vertices), 1)) for mesh, colour in parts])
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh, _ in parts[:-1])])
    faces = np.concatenate([mesh.faces + start for (mesh, _), start in zip(parts, starts)])
    view = View(AZIMUTH, ELEVATION, vertices.min(axis=0), vertices.max(axis=0), WIDTH, HEIGHT)
    picture = Sight(TriangleMesh(vertices, faces), view).paint(colours)
    cover = picture[..., 3:] / 255.0
    write_whole(path, png(np.round(picture[..., :3] * cover + 255.0 * (1.0 - cover)).astype(np.uint8)))
    return path


def _table(scene: Scene, low: np.ndarray, high: np.ndarray) -> TriangleMesh:
    """A thin slab under the area, leaning as the table does."""
    normal = scene.table.normal()
    corners = []
    for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])):
        x, y = x + np.sign(x) * 0.01, y + np.sign(y) * 0.01
        corners.append((x, y, scene.table.height - (normal[0] * x + normal[1] * y) / normal[2]))
    top = np.array(corners)
    return _hexahedron(top - (0.0, 0.0, 0.003), top)


def _edges(low: np.ndarray, high: np.ndarray) -> TriangleMesh:
    """The twelve edges of a box as thin bars."""
    bars = []
    for axis in range(3):
        for a in (0, 1):
            for b in (0, 1):
                start = low.copy()
                start[(axis + 1) % 3], start[(axis + 2) % 3] = (
                    (low, high)[a][(axis + 1) % 3], (low, high)[b][(axis + 2) % 3],
                )  # fmt: skip
                end = start.copy()
                end[axis] = high[axis]
                bars.append(_bar(start - EDGE, end + EDGE))
    counts = np.cumsum([0, *(len(bar.vertices) for bar in bars[:-1])])
    return TriangleMesh(
        np.concatenate([bar.vertices for bar in bars]),
        np.concatenate([bar.faces + count for bar, count in zip(bars, counts)]),
    )


def _bar(low: np.ndarray, high: np.ndarray) -> TriangleMesh:
    around = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])])
    bottom, top = (np.column_stack([around, np.full(4, z)]) for z in (low[2], high[2]))
    return _hexahedron(bottom, top)


def _hexahedron(bottom: np.ndarray, top: np.ndarray) -> TriangleMesh:
    """Solid between two quadrilaterals (4, 3), counter-clockwise seen from above."""
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, 4 + j), (i, 4 + j, 4 + i)]
    return TriangleMesh(np.concatenate([bottom, top]), np.array(faces, dtype=np.int64))
