"""Points with what is known about each."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import InputError

_TAKEN = ("x", "y", "z", "nx", "ny", "nz")


@dataclass(slots=True)
class Cloud:
    """A point cloud.

    Attributes
    ----------
    points : (n, 3) m, finite
    normals : (n, 3) finite, or None
    scalars : further columns by name, (n,) each
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    scalars: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.points = _columns(self.points, "points", (-1, 3))
        if self.normals is not None:
            self.normals = _columns(self.normals, "normals", (len(self.points), 3))
        if taken := self.scalars.keys() & set(_TAKEN):
            raise InputError("scalars", sorted(taken), f"names other than {', '.join(_TAKEN)}")
        self.scalars = {
            name: _columns(column, f"scalars[{name!r}]", (len(self.points),), finite=False)
            for name, column in self.scalars.items()
        }

    def __len__(self) -> int:
        return len(self.points)

    def table(self) -> tuple[list[str], np.ndarray]:
        """All columns by name (x, y, z, nx, ny, nz, scalars; one plain word each) and as (n, columns)."""
        vectors = [self.points] if self.normals is None else [self.points, self.normals]
        words = [re.sub(r"[^!-+\--~]+", "_", name) for name in self.scalars]
        columns = [column[:, None] for column in self.scalars.values()]
        return [*_TAKEN[: 3 * len(vectors)], *words], np.hstack(vectors + columns)


def _columns(values: object, field_name: str, shape: tuple[int, ...], finite: bool = True) -> np.ndarray:
    try:
        array = np.ascontiguousarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(field_name, values, "numbers") from None
    wanted = " x ".join("n" if n < 0 else str(n) for n in shape)
    if array.ndim != len(shape) or any(n not in (-1, have) for n, have in zip(shape, array.shape)):
        raise InputError(field_name, array.shape, f"an array of {wanted}")
    if finite and not np.isfinite(array).all():
        raise InputError(field_name, "a value that is not finite", "finite numbers only")
    return array
