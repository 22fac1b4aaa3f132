"""What a sweep has done so far, a line of JSON each; a sweep that was cut off goes on after the last whole line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lwrprobe.errors import StorageError
from lwrprobe.exploration.recording.stream import write_all

LONGEST = 1 << 22
"""Bytes of a line."""


class Journal:
    """Results by the keys of their tasks.

    Parameters
    ----------
    path : of the file, made when missing; None keeps nothing on disk
    restart : begin anew

    Raises StorageError where it cannot be written.
    """

    def __init__(self, path: Path | None, restart: bool = False) -> None:
        self._path = path
        self.results: dict[str, dict[str, Any]] = {}
        if path is None:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if restart:
                path.unlink(missing_ok=True)
            good = 0
            if path.is_file():
                for key, result, end in _lines(path):
                    self.results[key] = result
                    good = end
            self._stream = open(path, "ab", buffering=0)  # noqa: SIM115
            self._stream.truncate(good)
        except OSError as error:
            raise StorageError(path, error) from None

    def add(self, key: str, result: dict[str, Any]) -> None:
        """A result, on disk when this returns; raises StorageError."""
        self.results[key] = result
        if self._path is None:
            return
        content = json.dumps({"key": key, "result": result}).encode() + b"\n"
        write_all(self._stream, content, self._path)

    def close(self) -> None:
        """Give the file back."""
        if self._path is not None:
            self._stream.close()


def _lines(path: Path) -> Iterator[tuple[str, dict[str, Any], int]]:
    """Key, result, and where the line ends; up to the first line that is none."""
    end = 0
    with path.open("rb") as stream:
        while line := stream.readline(LONGEST):
            try:
                entry = json.loads(line)
                key, result = entry["key"], entry["result"]
            except (ValueError, KeyError, TypeError, RecursionError):
                return
            if not (line.endswith(b"\n") and isinstance(key, str) and isinstance(result, dict)):
                return
            end += len(line)
            yield key, result, end
