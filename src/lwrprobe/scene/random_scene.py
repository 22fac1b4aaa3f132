"""Scenes with one random object, named `random:KIND:SEED`."""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.contracts import SceneError, UnknownNameError
from lwrprobe.scene.shape import KINDS

_PREFIX = "random:"
_BESIDE, _ABOVE = 0.03, 0.02  # m, between the object's box and the border of the area
_LOWEST = 0.006  # m, the area's lower border, as in the built-in scenes


def random_scene(name: str) -> dict[str, Any] | None:
    """Content of the scene file of `random:KIND:SEED`; None for a name that does not begin so.

    The area holds the object with margins. Raises UnknownNameError for another kind and SceneError for a
    seed that is no whole number from 0 up.
    """
    if not name.startswith(_PREFIX):
        return None
    kind, _, seed = name.removeprefix(_PREFIX).partition(":")
    if kind not in KINDS:
        raise UnknownNameError("kind of random object", kind, KINDS)
    if not (seed.isascii() and seed.isdecimal() and int(seed) < 2**63):
        raise SceneError("scene", name, f"{_PREFIX}{kind}:SEED with a whole number from 0 to 2^63 - 1")
    from lwrprobe.scene.random_object import random_mesh

    vertices, _ = random_mesh(kind, int(seed))
    half = np.abs(vertices[:, :2]).max(axis=0) + _BESIDE
    x, y = (float(length) for length in np.ceil(1e3 * half) / 1e3)
    top = float(np.ceil(1e3 * (vertices[:, 2].max() + _ABOVE)) / 1e3)
    return {
        "name": f"random_{kind}_{int(seed)}",
        "title": f"A random object: {kind}, seed {int(seed)}",
        "object": [{"shape": "random", "kind": kind, "seed": int(seed)}],
        "area": {"lower": [-x, -y, _LOWEST], "upper": [x, y, top]},
    }
