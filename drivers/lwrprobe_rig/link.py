"""A line with faults: what an emulated device sends and receives goes through one of these."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from lwrprobe.contracts import InputError, UnknownNameError


@dataclass(slots=True)
class LinkFaults:
    """What happens to datagrams on their way, in both directions.

    Attributes
    ----------
    loss, duplicate, reorder, corrupt, resize : probability, of each datagram, to vanish, to come twice, to come
        after the next one, to have some bytes changed, to have bytes cut off or added
    delay, jitter : s, added to each datagram; jitter is uniform from 0 and keeps the order
    down : 1 = nothing passes
    """

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    resize: float = 0.0
    down: float = 0.0

    def set(self, name: str, value: str) -> None:
        """Change one by name; raises UnknownNameError and InputError."""
        known = {f.name for f in fields(self)}
        if name not in known:
            raise UnknownNameError("fault", name, known)
        highest = 60.0 if name in ("delay", "jitter") else 1.0
        try:
            number = float(value or "1")
        except ValueError:
            number = -1.0
        if not 0.0 <= number <= highest:
            raise InputError(f"fault {name}", value, f"a number from 0 to {highest:g}")
        setattr(self, name, number)

    def clear(self) -> None:
        for f in fields(self):
            setattr(self, f.name, 0.0)


class FaultyLink:
    """One direction of a line: datagrams go in, and come out when they are due, or never, or otherwise."""

    def __init__(self, faults: LinkFaults, seed: int = 0) -> None:
        self._faults = faults
        self._random = np.random.default_rng(seed)
        self._under_way: list[tuple[float, int, bytes]] = []
        self._held: bytes | None = None
        self._count = 0
        self._last_due = 0.0

    def put(self, data: bytes, now: float) -> None:
        """Start a datagram on its way."""
        faults = self._faults
        if faults.down or self._happens(faults.loss):
            return
        if self._happens(faults.corrupt):
            data = self._corrupted(data)
        if self._happens(faults.resize):
            data = self._resized(data)
        if self._held is None and self._happens(faults.reorder):
            self._held = data
            return
        copies = 2 if self._happens(faults.duplicate) else 1
        for _ in range(copies):
            self._push(data, now)
        if self._held is not None:
            self._push(self._held, now)
            self._held = None

    def due(self) -> float:
        """When the next datagram comes out, inf when none is under way."""
        return self._under_way[0][0] if self._under_way else float("inf")

    def arrived(self, now: float) -> Iterator[bytes]:
        """Take out what is due."""
        while self._under_way and self._under_way[0][0] <= now:
            yield heapq.heappop(self._under_way)[2]

    def _push(self, data: bytes, now: float) -> None:
        delay = self._faults.delay
        if self._faults.jitter:
            delay += self._faults.jitter * self._random.random()
        self._last_due = max(self._last_due, now + delay)
        self._count += 1
        heapq.heappush(self._under_way, (self._last_due, self._count, data))

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._random.random() < probability

    def _corrupted(self, data: bytes) -> bytes:
        changed = bytearray(data)
        for place in self._random.integers(0, len(data), size=4):
            changed[place] ^= int(self._random.integers(1, 256))
        return bytes(changed)

    def _resized(self, data: bytes) -> bytes:
        if self._random.random() < 0.5:
            return data[: int(self._random.integers(0, len(data)))]
        return data + self._random.bytes(int(self._random.integers(18, 60)))
