"""Options of a bench, given with `--set`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lwrprobe.contracts import InputError, UnknownNameError


class Options:
    """The options of one bench, each checked when it is asked for.

    Raises UnknownNameError for a name that is not `allowed`.
    """

    def __init__(self, bench: str, given: dict[str, str], *allowed: str) -> None:
        self._bench, self._given = bench, given
        for name in given:
            if name not in allowed:
                raise UnknownNameError(f"bench {bench} option", name, allowed)

    def __contains__(self, name: str) -> bool:
        return name in self._given

    def text(self, name: str, default: str) -> str:
        """As given."""
        return self._given.get(name, default)

    def words(self, name: str, default: Sequence[str]) -> list[str]:
        """Separated by commas."""
        return self._given[name].split(",") if name in self._given else list(default)

    def names(self, option: str, kind: str, default: Sequence[str], known: Iterable[str]) -> list[str]:
        """Separated by commas, each of them known; raises UnknownNameError."""
        found, known = self.words(option, default), list(known)
        for name in found:
            if name not in known:
                raise UnknownNameError(kind, name, known)
        return found

    def count(self, name: str, default: int) -> int:
        """A whole number from 1 on; raises InputError."""
        return self._count(name, self._given.get(name, str(default)))

    def counts(self, name: str, default: int) -> list[int]:
        """Whole numbers from 1 on, separated by commas; raises InputError."""
        return [self._count(name, text) for text in self.words(name, [str(default)])]

    def _count(self, name: str, text: str) -> int:
        if not (text.isascii() and text.isdigit() and int(text) > 0):
            raise InputError(f"bench {self._bench} option {name}", text, "a whole number above 0")
        return int(text)

    def numbers(self, name: str, default: Sequence[float], above: float = 0.0) -> list[float]:
        """Numbers above a bound, separated by commas; raises InputError."""
        try:
            values = [float(text) for text in self.words(name, ())] if name in self._given else list(default)
        except ValueError:
            values = []
        allowed = f"numbers above {above:g}, separated by commas"
        if not values or not all(above < value < float("inf") for value in values):
            raise InputError(f"bench {self._bench} option {name}", self._given[name], allowed)
        return values
