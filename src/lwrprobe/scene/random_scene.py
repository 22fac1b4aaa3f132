"""Scenes with one random object, named `random:KIND:SEED` or `random:KIND:SEED:MM`."""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.contracts import SceneError, UnknownNameError
from lwrprobe.scene.shape import KINDS

_PREFIX = "random:"
_BESIDE, _ABOVE = 0.03, 0.02  # m, between the object's box and the border of the area
_SIZES = range(20, 1001)  # mm, that a name may give as the length
_LOWEST = 0.006  # m, the area's lower border, as in the built-in scenes


def random_scene(name: str) -> dict[str, Any] | None:
    """Content of the scene file of `random:KIND:SEED`; None for a name that does not begin so.

    A third part of the name is the object's length in mm. The area holds the object with margins. Raises
    UnknownNameError for another kind and SceneError for a seed or length that is no whole number.
    """
    if not name.startswith(_PREFIX):
        return None
    kind, _, numbers = name.removeprefix(_PREFIX).partition(":")
    seed, *sizes = numbers.split(":")
    if kind not in KINDS:
        raise UnknownNameError("kind of random object", kind, KINDS)
    whole = all(number.isascii() and number.isdecimal() for number in (seed, *sizes))
    if not whole or len(sizes) > 1 or int(seed) >= 2**63 or any(int(size) not in _SIZES for size in sizes):
        allowed = f"{_PREFIX}{kind}:SEED or {_PREFIX}{kind}:SEED:MM with whole numbers, SEED from 0 to 2^63 - 1"
        raise SceneError("scene", name, f"{allowed} and MM from {_SIZES[0]} to {_SIZES[-1]}")
    from lwrprobe.scene.random_object import random_mesh

    length = 1e-3 * int(sizes[0]) if sizes else None
    vertices, _ = random_mesh(kind, int(seed), length)
    half = np.abs(vertices[:, :2]).max(axis=0) + _BESIDE
    x, y = (float(length) for length in np.ceil(1e3 * half) / 1e3)
    top = float(np.ceil(1e3 * (vertices[:, 2].max() + _ABOVE)) / 1e3)
    long = {} if length is None else {"length": length}
    return {
        "name": "_".join(["random", kind, str(int(seed)), *sizes]),
        "title": f"A random object: {kind}, seed {int(seed)}" + "".join(f", {size} mm long" for size in sizes),
        "object": [{"shape": "random", "kind": kind, "seed": int(seed)} | long],
        "area": {"lower": [-x, -y, _LOWEST], "upper": [x, y, top]},
    }
