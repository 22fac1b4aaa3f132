"""How near groups of links are that keep different distances, sample after sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from lwrprobe.collision import watch_kernels as kernels
from lwrprobe.collision.clearance_kernels import ANSWER, WHO
from lwrprobe.collision.link_rows import NO_FRAMES, link_rows
from lwrprobe.collision.shape_kernels import CARRIER, reach
from lwrprobe.compiled import entry
from lwrprobe.contracts import Clearance, LinkShape
from lwrprobe.mapping import VoxelMap

TABLE = "table"
"""What a link is near to, when it is the table."""


@dataclass(frozen=True, slots=True)
class LinkGroup:
    """Links that keep one distance, from the voxels of the map unless stated otherwise.

    Attributes
    ----------
    links : shapes of the robot
    keep : m
    table : (4,) unit normal of a plane and how far [m] it lies along that from the world's origin: from that
    pairs : numbers of links: the one from the other
    """

    links: Sequence[LinkShape]
    keep: float
    table: np.ndarray | None = None
    pairs: Sequence[tuple[int, int]] | None = None

    @property
    def kind(self) -> float:
        """As the kernels have it."""
        if self.pairs is not None:
            return kernels.EACH_OTHER
        return kernels.MAP if self.table is None else kernels.TABLE

    def names(self) -> list[tuple[str, str]]:
        """Who came near and to what, by an answer's number; the second is empty for the map."""
        if self.pairs is not None:
            return [(self.links[one].name, self.links[other].name) for one, other in self.pairs]
        return [(link.name, "" if self.table is None else TABLE) for link in self.links]


class ClearanceWatch:
    """Of several groups of links the nearest pair with the least distance above what its group has to keep.

    While nothing threatens the answer is quick and may be a bound: the distance is never too large, exact to 0.2 um
    below what is to be kept, elsewhere at least a third of the true one; the pair is the one measured last.

    Parameters
    ----------
    groups : at least one, each with a link
    voxels : read at every call, never copied

    Raises
    ------
    InputError : for a link kind or carrier that is not known
    """

    def __init__(self, groups: Sequence[LinkGroup], voxels: VoxelMap) -> None:
        self.voxels = voxels
        self._names = [group.names() for group in groups]
        self._keeps = [group.keep for group in groups]
        self._rows = link_rows([link for group in groups for link in group.links])
        self._pairs = np.array([pair for group in groups for pair in group.pairs or ()], np.int64).reshape(-1, 2)
        carriers = 1 + int(self._rows[:, CARRIER].max())
        self._memory = np.full((len(groups), kernels.CARRIERS + carriers * kernels.CARRIER), np.nan)
        row = pair = 0
        for memory, group in zip(self._memory, groups):
            memory[[kernels.KIND, kernels.KEEP, kernels.LEAST]] = group.kind, group.keep, np.inf
            memory[[kernels.FIRST, kernels.FIRST_PAIR]] = row, pair
            row, pair = row + len(group.links), pair + len(group.pairs or ())
            memory[[kernels.LAST, kernels.LAST_PAIR]] = row, pair
            if group.table is not None:
                memory[kernels.PLANE : kernels.PLANE + 4] = group.table
            reaches = memory[kernels.CARRIERS :: kernels.CARRIER]
            reaches[:] = -1.0
            for link in self._rows[int(memory[kernels.FIRST]) : row]:
                carrier = int(link[CARRIER])
                reaches[carrier] = max(reaches[carrier], reach(link))
        self._call = _entry()

    def nearest(self, tip: np.ndarray, frames: np.ndarray = NO_FRAMES) -> Clearance:
        """The most urgent pair at a tip pose (4, 4) and link frames (m, 4, 4): contiguous float64, nothing is checked.

        Its `required` is what the pair's group keeps.
        """
        answer = np.empty(ANSWER)
        number = self._call(self.voxels.occupied_words, self._rows, self._pairs, self._memory, tip, frames, answer)
        who = int(answer[WHO])
        link, against = self._names[number][who] if who >= 0 else ("", "")
        return Clearance(float(answer[0]), answer[1:4], answer[4:7], link, self._keeps[number], against)

    @property
    def smallest(self) -> float:
        """m, the smallest distance of any group in all calls, exact."""
        return float(self._memory[:, kernels.LEAST].min())


@cache
def _entry() -> Callable:
    words, pairs = np.empty(0, np.int64), np.empty((0, 2), np.int64)
    table, answer = np.empty((0, 0)), np.empty(0)
    return entry(kernels.most_urgent, words, table, pairs, table, np.eye(4), NO_FRAMES, answer)
