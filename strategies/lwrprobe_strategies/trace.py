"""The run's trace: which skill ran when, and what ended it."""

from __future__ import annotations

from typing import Protocol

Row = tuple[float, str, str, str]


class Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str: ...


class Trace:
    """Follows the skills as they begin and end; no row is written by hand.

    Attributes
    ----------
    rows : (time s, skill, event, next skill), one for each sample after which another skill moves the tip
    time : s, of the latest observation
    running : the skills that run, the innermost last
    ended : the skill that ended last
    event : how it ended, or what interrupted the innermost one
    state : name of the skill that moves the tip
    """

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.time = 0.0
        self.running: list[Named] = []
        self.ended: Named | None = None
        self.event = ""
        self.state = ""
        self._changed = False

    def begin(self, skill: Named) -> None:
        """A skill begins, after the last one or inside another."""
        self.running.append(skill)
        self._changed = True

    def end(self, event: str) -> None:
        """The innermost skill has ended."""
        self.ended, self.event, self._changed = self.running.pop(), event, True

    def settle(self, finished: bool = False) -> None:
        """The program has answered the latest observation, or has ended."""
        if not (self._changed or finished):
            return
        state = "finished" if finished else self.running[-1].name if self.running else "program"
        if self.state:
            self.rows.append((self.time, self.state, self.event or "calls", state))
        self.state, self.event, self._changed = state, "", False
