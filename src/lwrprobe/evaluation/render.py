"""Pictures of a mesh or a cloud with a colour for each vertex, on a transparent ground."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.render_kernels import cover, draw_points, paint, smooth

_FINER = 2  # pixels of the buffer for one of the picture, each way
_LIGHT = np.array([-0.35, 0.55, 0.75])  # from the left, above and the viewer
_MARGIN = 0.04


@dataclass(slots=True, frozen=True)
class View:
    """Orthographic: from `azimuth` and `elevation` [rad], showing the box from `lower` to `upper` m.

    Azimuth 0 looks from +x, pi/2 from +y.
    """

    azimuth: float
    elevation: float
    lower: np.ndarray
    upper: np.ndarray
    width: int = 560
    height: int = 420

    def axes(self) -> np.ndarray:
        """Rows: to the right, up, towards the viewer."""
        ca, sa, ce, se = np.cos(self.azimuth), np.sin(self.azimuth), np.cos(self.elevation), np.sin(self.elevation)
        return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])

    def place(self, points: np.ndarray, finer: int = 1) -> tuple[np.ndarray, float]:
        """Pixels across, down and depth (n, 3) of points (n, 3) m; and pixels per metre."""
        axes = self.axes()
        corners = np.stack(np.meshgrid(*np.column_stack([self.lower, self.upper]), indexing="ij"), axis=-1)
        seen = corners.reshape(-1, 3) @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        span = np.maximum(high - low, 1e-9)
        scale = (1.0 - 2.0 * _MARGIN) * finer * min(self.width / span[0], self.height / span[1])
        middle = 0.5 * (low + high)
        turned = (points @ axes.T - middle) * scale
        across, down = turned[:, 0] + 0.5 * finer * self.width, 0.5 * finer * self.height - turned[:, 1]
        return np.column_stack([across, down, turned[:, 2]]), scale


class Sight:
    """A mesh as it is seen in a view, to be painted in one way or another."""

    def __init__(self, mesh: TriangleMesh, view: View) -> None:
        self.view, self.faces = view, mesh.faces
        places, _ = view.place(mesh.vertices, _FINER)
        corners = mesh.vertices[mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        facing = normals @ view.axes().T @ (_LIGHT / np.linalg.norm(_LIGHT))
        self._light = 0.45 + 0.6 * np.clip(facing, 0.0, 1.0)
        shape = (_FINER * view.height, _FINER * view.width)
        self._face, self._share = np.full(shape, -1), np.empty((*shape, 2), dtype=np.float32)
        cover(places, mesh.faces, self._face, self._share, np.full(shape, -np.inf))

    def paint(self, colours: np.ndarray) -> np.ndarray:
        """(height, width, 4) uint8 with colours (n, 3), 0..1, of the mesh's vertices."""
        image = np.zeros((*self._face.shape, 4), dtype=np.float32)
        paint(self._face, self._share, self.faces, np.ascontiguousarray(colours, dtype=np.float64), self._light, image)
        return _smooth(image, self.view)


def render_points(points: np.ndarray, colours: np.ndarray, view: View, radius: float) -> np.ndarray:
    """(height, width, 4) uint8 of points (n, 3) m as balls of `radius` m with colours (n, 3)."""
    places, scale = view.place(points, _FINER)
    shape = (_FINER * view.height, _FINER * view.width)
    image, depth = np.zeros((*shape, 4), dtype=np.float32), np.full(shape, -np.inf)
    draw_points(places, np.ascontiguousarray(colours, dtype=np.float64), max(radius * scale, 1.5), image, depth)
    return _smooth(image, view)


def _smooth(image: np.ndarray, view: View) -> np.ndarray:
    out = np.empty((view.height, view.width, 4), dtype=np.uint8)
    smooth(image, _FINER, out)
    return out


def png(image: np.ndarray) -> bytes:
    """An image (height, width, 3 or 4) uint8 as a PNG file."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "png", compress_level=4)  # a tenth larger than the usual 6, in 2/3 of its time
    return stream.getvalue()
