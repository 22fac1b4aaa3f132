"""A growing set of voxels: the flat array of a bit tree and its capacity."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.mapping import kernels

WORDS_AT_FIRST = 1 << 13
MAX_WORDS = 1 << 28
"""2 GiB: no input, however made, makes a map larger than that."""


class VoxelSet:
    """Owner of one tree's array. `words` is replaced when the tree outgrows it: never keep it over an insertion."""

    __slots__ = ("words",)

    def __init__(self, resolution: float) -> None:
        self.words = np.empty(WORDS_AT_FIRST, np.int64)
        kernels.clear(self.words, resolution)

    def grow(self) -> None:
        """Double the capacity; raises InputError where the tree would need more than `MAX_WORDS`."""
        if self.words.size >= MAX_WORDS:
            raise InputError("map", f"{self.words.size * 8 >> 20} MiB of voxels", f"at most {MAX_WORDS * 8 >> 20} MiB")
        words = np.empty(2 * self.words.size, np.int64)
        used = self.words[kernels.USED]
        words[:used] = self.words[:used]
        self.words = words

    def __len__(self) -> int:
        return int(self.words[kernels.COUNT])

    @property
    def nodes(self) -> int:
        """Nodes that were made, an upper bound of those in use."""
        return int(self.words[kernels.NODES])
