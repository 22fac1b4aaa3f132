"""Rows of numbers that are added one at a time, and read all at once."""

from __future__ import annotations

from array import array

import numpy as np

Row = tuple[float, ...]


class GrowingTable:
    """A table that keeps its columns together in memory: what reads all rows looks at few of their numbers.

    Parameters
    ----------
    columns : number of columns

    Attributes
    ----------
    last : the row that was added last, None at first
    """

    __slots__ = ("_columns", "_count", "_new", "last")

    def __init__(self, columns: int) -> None:
        self.last: Row | None = None
        self._columns, self._count = np.empty((columns, 256)), 0
        self._new = array("d")

    def add(self, row: Row) -> None:
        """Add a row; called while the tip moves, so nothing is computed."""
        self._new.extend(row)
        self.last = row

    def __len__(self) -> int:
        return self._count + len(self._new) // len(self._columns)

    def rows(self) -> np.ndarray:
        """(n, columns) all rows; not to be written to."""
        if self._new:
            before, self._count = self._count, len(self)
            if self._count > self._columns.shape[1]:
                kept, self._columns = self._columns, np.empty((len(self._columns), 2 * self._count))
                self._columns[:, :before] = kept[:, :before]
            self._columns[:, before : self._count] = np.array(self._new).reshape(-1, len(self._columns)).T
            self._new = array("d")
        return self._columns[:, : self._count].T
