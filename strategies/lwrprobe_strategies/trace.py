"""The run's trace: which skill ran when, and how it ended."""

from __future__ import annotations

from typing import Protocol

Row = tuple[float, str, str, str]


class Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str: ...


class Trace:
    """Follows the skills as they begin and end; nobody writes a row by hand.

    Attributes
    ----------
    rows : (time s, skill, event, next skill)
    time : s, of the latest observation
    running : the skills that run, the innermost last
    last : the innermost skill that runs, or the one that ran last
    event : how the last skill ended, or what interrupted the innermost one
    """

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.time = 0.0
        self.running: list[Named] = []
        self.event = ""
        self.last: Named | None = None

    @property
    def state(self) -> str:
        """Name of `last`."""
        return self.last.name if self.last is not None else "finished"

    def begin(self, skill: Named) -> None:
        """A skill begins, after the last one or inside it."""
        self.running.append(skill)
        self._to(skill)

    def end(self, event: str) -> None:
        """The innermost skill has ended; the one outside of it goes on, where there is one."""
        self.running.pop()
        self.event = event
        if self.running:
            self._to(self.running[-1])

    def finish(self) -> None:
        """The program has ended."""
        self._to(None)

    def _to(self, following: Named | None) -> None:
        before, self.last = self.last, following
        if before is not None:
            self.rows.append((self.time, before.name, self.event, self.state))
