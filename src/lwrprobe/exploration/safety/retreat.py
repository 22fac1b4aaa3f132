"""Where the tip has been, so that it can retreat when forces are no longer measured."""

from __future__ import annotations

from collections import deque
from itertools import islice
from math import dist, inf

import numpy as np

from lwrprobe.contracts.samples import Vector

_SPACING = 0.001  # m between two remembered places
_REMEMBERED = 256
_STRIDE = 0.003  # m between two places to go back to: round an edge the chord cuts off 0.2 mm, less than a lift


class Retreat:
    """The last stretch of the tip's path; places in contact are remembered a little off the surface.

    Parameters
    ----------
    lift : m off the surface, along its outward normal
    floor : m, the tip is nowhere led lower, but where it was lower itself

    Attributes
    ----------
    gone : the tip has gone back since it was noted last
    """

    def __init__(self, lift: float, floor: float = -inf) -> None:
        self._lift, self._floor = lift, floor
        self._places: deque[np.ndarray] = deque(maxlen=_REMEMBERED)
        self._last: list[float] | None = None
        self._normal: Vector | None = None
        self.gone, self._passed = False, 0

    def note(self, tip: Vector, normal: Vector | None) -> None:
        """The tip (3,) is here, and touches a surface with this outward normal, or nothing."""
        self._normal, self.gone, self._passed = normal, False, 0
        here, last = tip.tolist(), self._last
        if last is not None and dist(here, last) < _SPACING:
            return
        self._last = here
        self._places.append(self._off(tip))

    @property
    def normal(self) -> Vector | None:
        """(3,) unit, outward normal of what is touched now, None where nothing is."""
        return self._normal

    def _off(self, tip: Vector) -> np.ndarray:
        """A place (3,) off what is touched, with the tip at another one."""
        if self._normal is None:
            return tip.copy()
        off = tip + self._lift * self._normal
        off[2] = max(off[2], min(self._floor, tip[2]))
        return off

    def places(self, tip: Vector, length: float) -> list[np.ndarray]:
        """Places (3,) to go to, one after the other, from `tip`: off the surface first, then back for `length` m.

        The tip stops at each, so they are a few millimetres apart. It counts as gone there: the next call leads farther
        back, and not once more over what it left.
        """
        if length <= 0.0:
            return []
        path, here, left = [], tip, length
        if self._normal is not None and not self.gone:
            here = self._off(tip)
            path.append(here)
        self.gone, since = True, 0.0
        for place in islice(reversed(self._places), self._passed, None):
            step = float(np.linalg.norm(place - here))
            if step >= left:
                path.append(here + (left / step) * (place - here))
                return path
            self._passed += 1
            here, left, since = place, left - step, since + step
            if since >= _STRIDE:
                path.append(place)
                since = 0.0
        if since > 0.0:
            path.append(here)
        return path
