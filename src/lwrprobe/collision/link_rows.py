"""Link shapes as the kernels read them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.collision import shape_kernels
from lwrprobe.contracts import InputError, LinkShape, UnknownNameError, as_pose

_KINDS = {"cylinder": shape_kernels.CYLINDER, "capsule": shape_kernels.CAPSULE, "box": shape_kernels.BOX}
NO_FRAMES = np.empty((0, 4, 4))
"""Link frames of a robot whose links all ride on the tip."""


def link_rows(links: Sequence[LinkShape]) -> np.ndarray:
    """(n, 17), a row a link; raises InputError for a kind or carrier that is not known."""
    return np.array([_row(link) for link in links]).reshape(-1, shape_kernels.ROW)


def _row(link: LinkShape) -> np.ndarray:
    if link.kind not in _KINDS:
        raise UnknownNameError(f"link {link.name}.kind", link.kind, _KINDS)
    pose = as_pose(link.pose, f"link {link.name}.pose")
    size = [0.5 * edge for edge in link.size] if link.kind == "box" else [link.size[0], 0.5 * link.size[1], 0.0]
    return np.concatenate([[_KINDS[link.kind], *size, _carrier(link)], pose[:3, :3].ravel(), pose[:3, 3]])


def _carrier(link: LinkShape) -> float:
    if link.carrier == "tip":
        return 0.0
    if not (link.carrier.isascii() and link.carrier.isdigit() and len(link.carrier) < 4):
        raise InputError(f"link {link.name}.carrier", link.carrier, "'tip' or the number of a link frame as text")
    return 1.0 + int(link.carrier)
