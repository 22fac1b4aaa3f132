"""How near groups of links are that keep different distances, sample after sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from lwrprobe.collision import watch_kernels as kernels
from lwrprobe.collision.clearance_kernels import ANSWER, WHO
from lwrprobe.collision.link_rows import NO_FRAMES, link_rows
from lwrprobe.collision.shape_kernels import CARRIER, reach
from lwrprobe.compiled import entry
from lwrprobe.contracts import Clearance, LinkShape
from lwrprobe.mapping import VoxelMap


class ClearanceWatch:
    """Nearest pair of links and voxels with the least distance above what its group has to keep.

    While nothing threatens the answer is quick and may be a bound: the distance is never too large, exact to 0.2 um
    below what is to be kept, elsewhere at least a third of the true one; the pair is the one measured last.

    Parameters
    ----------
    groups : links and the distance [m] that they keep, at least one group
    voxels : read at every call, never copied

    Raises
    ------
    InputError : for a link kind or carrier that is not known
    """

    def __init__(self, groups: Sequence[tuple[Sequence[LinkShape], float]], voxels: VoxelMap) -> None:
        self.voxels = voxels
        self._rows = link_rows([link for links, _ in groups for link in links])
        self._names = [[link.name for link in links] for links, _ in groups]
        self._keeps = [keep for _, keep in groups]
        carriers = 1 + int(self._rows[:, CARRIER].max())
        self._groups = np.full((len(groups), kernels.CARRIERS + carriers * kernels.CARRIER), np.nan)
        first = 0
        for group, (links, keep) in zip(self._groups, groups):
            last = first + len(links)
            group[[kernels.KEEP, kernels.FIRST, kernels.LAST, kernels.LEAST]] = keep, first, last, np.inf
            group[kernels.CARRIERS :: kernels.CARRIER] = -1.0
            for row in self._rows[first:last]:
                place = kernels.CARRIERS + int(row[CARRIER]) * kernels.CARRIER
                group[place] = max(group[place], reach(row))
            first = last
        self._call = _entry()

    def nearest(self, tip: np.ndarray, frames: np.ndarray = NO_FRAMES) -> Clearance:
        """The most urgent pair at a tip pose (4, 4) and link frames (m, 4, 4): contiguous float64, nothing is checked.

        Its `required` is what the pair's group keeps.
        """
        answer = np.empty(ANSWER)
        group = self._call(self.voxels.occupied_words, self._rows, self._groups, tip, frames, answer)
        who = int(answer[WHO])
        name = self._names[group][who] if who >= 0 else ""
        return Clearance(float(answer[0]), answer[1:4], answer[4:7], name, self._keeps[group])

    @property
    def smallest(self) -> float:
        """m, the smallest distance of any group in all calls, exact."""
        return float(self._groups[:, kernels.LEAST].min())


@cache
def _entry() -> Callable:
    words, table, pose, frames, answer = np.empty(0, np.int64), np.empty((0, 0)), np.eye(4), NO_FRAMES, np.empty(0)
    return entry(kernels.most_urgent, words, table, table, pose, frames, answer)
