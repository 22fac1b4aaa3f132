"""Deviations side by side for each way that the true surface faces."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.mesh_error import sample_mesh
from lwrprobe.scene.solid import Solid

_WAYS = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}
_STRAIGHT = np.cos(np.radians(10.0))


@dataclass(slots=True, frozen=True)
class FacingError:
    """Signed deviations of the mesh, positive outside the true solid, where the true surface faces one way.

    Attributes
    ----------
    facing : an axis, within 10 degrees, or `oblique`
    share : of the mesh's area
    bias, rms, largest : m; the bias is the mean with its sign
    """

    facing: str
    share: float
    bias: float
    rms: float
    largest: float

    def as_dict(self) -> dict[str, float | str]:
        """Millimetres and shares."""
        lengths = {name: round(1e3 * getattr(self, name), 4) for name in ("bias", "rms", "largest")}
        return {**asdict(self), "share": round(self.share, 4), **lengths}


def facing_errors(mesh: TriangleMesh, solid: Solid, above: float, samples: int = 20_000) -> list[FacingError]:
    """Above the height `above` m, for each facing that occurs, the six axes first."""
    points, _ = sample_mesh(mesh, above, samples)
    near = solid.nearest(points)
    names = np.full(len(points), "oblique")
    for name, axis in _WAYS.items():
        names[near.normals @ np.array(axis, dtype=np.float64) > _STRAIGHT] = name
    found = []
    for name in (*_WAYS, "oblique"):
        d = near.distance[names == name]
        if len(d):
            largest = float(d[np.argmax(np.abs(d))])
            share = len(d) / len(points)
            found.append(FacingError(name, share, float(d.mean()), float(np.sqrt(np.mean(d**2))), largest))
    return found
