"""What the records of runs have to fulfil."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lwrprobe.bench.report import Verdict

Record = Mapping[str, Any]
NAMED = 4
"""Runs that failed, named with a requirement; the table has all of them."""


@dataclass(slots=True, frozen=True)
class Criterion:
    """What one run has to fulfil, and the share of the runs that has to.

    Attributes
    ----------
    requirement : in words
    key : of the run's record; None there fails
    good : of the value
    share : of the runs
    """

    requirement: str
    key: str
    good: Callable[[Any], bool]
    share: float = 1.0

    def holds(self, record: Record) -> bool:
        """Whether a run fulfils it."""
        value = record.get(self.key)
        return value is not None and bool(self.good(value))

    def kept(self, found: Sequence[Record]) -> str:
        """By how many of how many runs."""
        return f"{sum(self.holds(record) for record in found)} of {len(found)}"

    def verdict(self, found: Sequence[Record], named: Callable[[Any], str] | None = None) -> Verdict:
        """Over all runs; the first of those that fail are `named`."""
        bad = [record for record in found if not self.holds(record)]
        names = sorted(set(map(named, bad))) if named is not None else []
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        failed = f"; not {', '.join(names[:NAMED])}{more}" if names else ""
        enough = len(found) - len(bad) >= self.share * len(found)
        return Verdict(self.requirement, self.kept(found) + failed, enough)
