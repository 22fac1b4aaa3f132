"""All observations and answers of a strategy while it ran, so that a run that was cut off can be resumed.

A strategy has no clock and no I/O: shown the same observations again, it is where it was. The log is written sample by
sample beside contacts and path, and removed when the run is done.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import (
    STRATEGY_CONTRACT,
    Bounds,
    CarefulStrategy,
    Clearance,
    Contact,
    Doubt,
    FormatError,
    InputError,
    Motion,
    Observation,
    Progress,
    RaisingStrategy,
    SearchingStrategy,
    Strategy,
    Task,
)
from lwrprobe.contracts.contact import RELIABLE_FROM
from lwrprobe.exploration.recording.stream import write_all

OBSERVATIONS, WORDS = "observations.f64", "observations.words"
WIDTH = 48
"""Numbers a row: kind, time, then what the kind says; little-endian float64."""
TASK, SEEN, ANSWER = 0.0, 1.0, 2.0

_NO_CONTACT, _NOTHING_NEAR = (0.0,) * 16, (0.0,) * 10

EVEN = 10
"""Samples in a row without a force, or in a contact whose normal is known, after which a run can be resumed there."""

Question = Callable[[Sequence[np.ndarray]], bool]


class Logbook:
    """Writes rows, each handed to the system when the call returns.

    Parameters
    ----------
    folder : of the run
    keep : rows of an earlier part of the run that stay, None = begin anew

    Raises InputError when the folder cannot be written to, StorageError when that fails later, and FormatError for
    words of the earlier part that cannot be read.
    """

    def __init__(self, folder: Path, keep: int | None = None) -> None:
        self._folder = folder
        self._paths = folder / OBSERVATIONS, folder / WORDS
        known = [] if keep is None else _read_words(self._paths[1])
        try:
            self._rows = open(self._paths[0], "wb" if keep is None else "r+b", buffering=0)  # noqa: SIM115
            self._words = open(self._paths[1], "wb", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise InputError("out", str(folder), f"a folder that can be written to ({error.strerror})") from None
        self._row = np.zeros(WIDTH)
        self._code: dict[str, float] = {"": 0.0}
        for word in known:
            self._of(word)
        if keep is not None:
            self._rows.truncate(keep * self._row.nbytes)
            self._rows.seek(0, 2)

    def begin(self, task: Task) -> None:
        """Where the strategy takes over."""
        row = self._empty(TASK, 0.0)
        row[2:11], row[11:14], row[14] = task.orientation.ravel(), task.start, task.delay
        write_all(self._rows, row.tobytes(), self._folder)

    def answer(self, answer: bool) -> bool:
        """The answer to the strategy's question for the arm's reach or for the links' clearance."""
        row = self._empty(ANSWER, 0.0)
        row[2] = answer
        write_all(self._rows, row.tobytes(), self._folder)
        return answer

    def note(self, seen: Observation) -> None:
        """One observation."""
        contact, near = seen.contact, seen.clearance
        # Once a sample: a list is put together in half the time of an array's slices.
        row = [SEEN, seen.time, *seen.pose[:3].ravel().tolist(), *seen.velocity.tolist(), *seen.force.tolist()]
        row += (float(seen.goal_reached), self._of(seen.blocked))
        if contact is None:
            row += _NO_CONTACT
        else:
            row += (1.0, contact.time, contact.confidence_score, *contact.point.tolist(), *contact.normal.tolist())
            row += (*contact.force.tolist(), *contact.centre.tolist(), self._of(contact.reason))
        if near is None:
            row += _NOTHING_NEAR
        else:
            row += (1.0, near.distance, near.required, *near.on_robot.tolist(), *near.on_map.tolist())
            row.append(self._of(near.link))
        write_all(self._rows, array("d", row).tobytes(), self._folder)

    def close(self) -> None:
        """The run was cut off and may be resumed."""
        self._rows.close()
        self._words.close()

    def discard(self) -> None:
        """The run has come to its end; there is nothing to take up."""
        self.close()
        for path in self._paths:
            path.unlink(missing_ok=True)

    def _empty(self, kind: float, time: float) -> np.ndarray:
        self._row[:] = 0.0
        self._row[0], self._row[1] = kind, time
        return self._row

    def _of(self, word: str) -> float:
        code = self._code.get(word)
        if code is None:
            code = self._code[word] = float(len(self._code))
            write_all(self._words, word.replace("\n", " ").encode() + b"\n", self._folder)
        return code


class Logged:
    """A strategy whose observations and answers are logged before it gets them."""

    Config: ClassVar[type] = object
    contract: ClassVar[int] = STRATEGY_CONTRACT

    def __init__(self, strategy: Strategy, log: Logbook) -> None:
        self.strategy, self._log = strategy, log

    @property
    def line_spacing(self) -> float | None:
        """The strategy's own."""
        return self.strategy.line_spacing

    @property
    def bounds(self) -> Bounds | None:
        """The strategy's own; None for one that does not search."""
        return self.strategy.bounds if isinstance(self.strategy, SearchingStrategy) else None

    @property
    def raised(self) -> float:
        """m by which the strategy has raised the area's upper end."""
        return self.strategy.raised if isinstance(self.strategy, RaisingStrategy) else 0.0

    def touching_poses(self, centre: np.ndarray, facing: np.ndarray) -> Sequence[tuple[np.ndarray, bool]]:
        """The strategy's own; none of one that does not say."""
        return self.strategy.touching_poses(centre, facing) if isinstance(self.strategy, CarefulStrategy) else ()

    @property
    def trace(self) -> Sequence[tuple[float, str, str, str]]:
        """The strategy's own."""
        return self.strategy.trace

    def start(self, task: Task) -> None:
        """Take over, and ask through the log."""
        self._log.begin(task)
        self.strategy.start(self.asking(task))

    def step(self, seen: Observation) -> Motion:
        """What the strategy answers."""
        self._log.note(seen)
        return self.strategy.step(seen)

    def progress(self) -> Progress:
        """The strategy's own."""
        return self.strategy.progress()

    def asking(self, task: Task) -> Task:
        """The task with its questions going through `asked`."""

        def through(ask: Question) -> Question:
            return lambda poses: self.asked(ask, poses)

        return replace(task, reachable=through(task.reachable), clear=through(task.clear))

    def asked(self, ask: Question, poses: Sequence[np.ndarray]) -> bool:
        """The answer to a question of the strategy, written down."""
        return self._log.answer(ask(poses))


@dataclass(slots=True)
class Past:
    """A log read back.

    Attributes
    ----------
    orientation, start, delay : of the task, (3, 3), (3,) m, s
    rows : (n, WIDTH) after the task's
    words : by their codes
    last : index of the row up to which the past is shown again: the probe had been free, or had touched, for a while
    """

    orientation: np.ndarray
    start: np.ndarray
    delay: float
    rows: np.ndarray
    words: list[str]
    last: int

    def observation(self, k: int) -> Observation:
        """That of row k, whose kind is SEEN."""
        row = self.rows[k].copy()
        pose = np.eye(4)
        pose[:3] = row[2:14].reshape(3, 4)
        contact = near = None
        if row[22]:
            reason = Doubt(self.words[int(row[37])])
            contact = Contact(row[23], row[25:28], row[28:31], row[31:34], row[34:37], float(row[24]), reason)
        if row[38]:
            near = Clearance(float(row[39]), row[41:44], row[44:47], self.words[int(row[47])], float(row[40]))
        blocked = self.words[int(row[21])]
        return Observation(float(row[1]), pose, row[14:17], row[17:20], contact, near, bool(row[20]), blocked)


def read_log(folder: Path, free_force: float) -> Past:
    """The log of a run that was cut off; a row that was not written to its end is left out.

    Below `free_force` N the probe is free. Raises FormatError where there is no log, or none that can be resumed.
    """
    path = folder / OBSERVATIONS
    if not path.is_file():
        ended = (folder / "summary.json").is_file()
        why = "the run has come to its end" if ended else f"the run left no {OBSERVATIONS}"
        raise FormatError(f"{folder}: nothing to take up: {why}")
    numbers = np.fromfile(path)
    rows = numbers[: len(numbers) // WIDTH * WIDTH].reshape(-1, WIDTH)
    words = ["", *_read_words(folder / WORDS)]
    codes = rows[:, [21, 37, 47]]
    known = ((codes >= 0.0) & (codes < len(words))).all()  # false for NaN
    if not len(rows) or rows[0, 0] != TASK or (rows[1:, 0] == TASK).any() or not known:
        raise FormatError(f"{path}: not a log of observations")
    if not {words[int(code)] for code in rows[:, 37]} <= set(Doubt):
        raise FormatError(f"{path}: the reason of a contact's low confidence is unknown")
    first = rows[0]
    last = _last_even(rows[1:], free_force)
    if last is None:
        raise FormatError(f"{folder}: nothing to take up: the run was cut off before the probe had moved freely")
    return Past(first[2:11].reshape(3, 3).copy(), first[11:14].copy(), float(first[14]), rows[1:], words, last)


def _last_even(rows: np.ndarray, free_force: float) -> int | None:
    """Index of the last observation at the end of at least EVEN without a force, or in contact, and not blocked.

    None for a probe that had never moved freely: there is no way back to where it was.
    """
    seen = np.flatnonzero(rows[:, 0] == SEEN)
    if not len(seen):
        return None
    moving, touching = rows[seen, 21] == 0.0, rows[seen, 22] > 0.0
    free = moving & ~touching & (np.linalg.norm(rows[seen, 17:20], axis=1) < free_force)
    known = moving & touching & (rows[seen, 24] >= RELIABLE_FROM)
    ends = [np.flatnonzero(np.convolve(which, np.ones(EVEN))[: len(seen)] >= EVEN) for which in (free, known)]
    return int(seen[max(int(end[-1]) for end in ends if len(end))]) if len(ends[0]) else None


def _read_words(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").split("\n")[:-1] if path.is_file() else []
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read: {error}") from None
