"""The run folder, written during the run: killed at any moment, what was touched so far can be read back."""

from __future__ import annotations

import csv
from dataclasses import replace
from errno import ENOENT
from io import FileIO, StringIO
from os import strerror
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import Contact, InputError, StorageError
from lwrprobe.evaluation.run_folder import RunFolder
from lwrprobe.exploration.recording.run_files import clear_run
from lwrprobe.exploration.recording.stream import write_all
from lwrprobe.exploration.recording.swept_path import SweptPath

if TYPE_CHECKING:
    from lwrprobe.exploration.recording.run_bag import RunBag

CONTACT_COLUMNS = "time,x,y,z,nx,ny,nz,force,confidence"
TRACE_COLUMNS = "time,x,y,z,force,touching,clearance,state,lean"
STATE_COLUMNS = "time,state,event,next"

LOOK_EVERY = 0.5
"""s of wall-clock time between two looks whether the folder is still there: a lost one takes lines without an error."""
NO_SAMPLE = -1
"""Sequence number of a contact whose wrench sample belongs to an earlier part of the run."""


class Recorder:
    """Streams contacts and the probe's path into files, and keeps them for what follows the run.

    Parameters
    ----------
    folder : the run folder; None records in memory alone
    earlier : what an earlier part of the run left there, to go on after; None begins anew

    Attributes
    ----------
    bag : the run as a bag, None where none is recorded
    swept : where the probe has been in this part of the run

    Until `open` nothing is written. Raises StorageError when the folder cannot be written to any more.
    """

    def __init__(self, folder: Path | None, earlier: RunFolder | None = None) -> None:
        self.folder = folder
        self.bag: RunBag | None = None
        self.swept = SweptPath()
        self._look_due = 0.0
        self.contacts: list[Contact] = []
        self.sequences: list[int] = []
        self.states: list[tuple[np.ndarray, np.ndarray] | None] = []
        """Joint values (n,) and velocity (3,) m/s of the centre at each contact, None for one of an earlier part."""
        self.passed: list[tuple[float, np.ndarray]] = []
        """s and (3,) m, of the centre without a force, at touches that are no contacts: the path between contacts."""
        self.withheld_since = np.inf
        """s, from which on what was recorded is kept out of what follows the run."""
        self.accepted = 0
        """Contacts of this part of the run, those that are withheld or left out afterwards among them."""
        self._trace: list[tuple[float, float, float, float, float, bool, float, float]] = []
        if earlier is not None:
            self._take_over(earlier)
        self._goes_on = earlier is not None
        self._contact_file: FileIO | None = None
        self._trace_file: FileIO | None = None
        self._state_file: FileIO | None = None

    def open(self) -> None:
        """The run begins: make the folder where it is missing, remove what another run left there, open the streams.

        Raises InputError when the folder cannot be made or written to.
        """
        if self.folder is None:
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if not self._goes_on:
                clear_run(self.folder)
            self._contact_file = self._open(self.folder / "contacts.csv", CONTACT_COLUMNS)
            self._trace_file = self._open(self.folder / "trace.csv", TRACE_COLUMNS)
            self._state_file = self._open(self.folder / "states.csv", STATE_COLUMNS)
        except OSError as error:
            raise InputError("out", str(self.folder), f"a folder that can be written to ({error.strerror})") from None

    def contact(self, contact: Contact, sequence: int, state: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        """One trusted contact, the wrench sample it comes from, and the arm's state (see `states`)."""
        self.contacts.append(contact)
        self.sequences.append(sequence)
        self.states.append(state)
        self.accepted += 1
        if self._contact_file is not None:
            self._write(self._contact_file, _line(contact))
        if self.bag is not None:
            self.bag.contact(contact)

    def touch(self, contact: Contact, radius: float) -> None:
        """A touch of the sphere of `radius` m that is not trusted: it shows no normal, but where the sphere went."""
        self.passed.append((contact.time, contact.point + radius * contact.normal))

    def trace_row(
        self, time: float, tip: np.ndarray, force: float, touching: bool, clearance: float, state: str, lean: float
    ) -> None:
        """Where the sphere's centre is, whether it touches, what the strategy is doing, and how far the stick leans."""
        x, y, z = tip.tolist()
        self._trace.append((time, x, y, z, force, touching, clearance, lean))
        if self._trace_file is not None:
            line = (
                f"{time:.4f},{x:.6f},{y:.6f},{z:.6f},{force:.4f},{int(touching)},{clearance:.5f},{state},{lean:.4f}\n"
            )
            self._write(self._trace_file, line)
            self._look()

    def transition(self, time: float, state: str, event: str, following: str) -> None:
        """One step of the strategy's state machine."""
        if self._state_file is not None:
            row = StringIO()  # an event may have a comma
            csv.writer(row, lineterminator="\n").writerow([f"{time:.4f}", state, event, following])
            self._write(self._state_file, row.getvalue())
        if self.bag is not None:
            self.bag.log(f"{state}: {event}, then {following}")

    def withhold(self, since: float) -> None:
        """Keep contacts and path from `since` s on out of what follows the run; on disk they stay."""
        self.withheld_since = since
        left = sum(contact.time < since for contact in self.contacts)
        del self.contacts[left:], self.sequences[left:], self.states[left:]
        self.passed = [touch for touch in self.passed if touch[0] < since]

    def free_path(self) -> np.ndarray:
        """(n, 3) m, where the sphere's centre was without a touch, as far as that follows the run."""
        trace = self.trace()
        return trace[(trace[:, 5] == 0.0) & (trace[:, 0] < self.withheld_since), 1:4]

    def shift(self, shifts: np.ndarray) -> None:
        """Move the contacts that follow the run by (n, 3) m, and the touches between them alike; on disk they stay."""
        self.contacts = [
            replace(contact, point=contact.point + shift, centre=contact.centre + shift)
            for contact, shift in zip(self.contacts, shifts)
        ]
        if self.passed:
            times, between = [contact.time for contact in self.contacts], [time for time, _ in self.passed]
            moved = np.column_stack([np.interp(between, times, axis) for axis in shifts.T])
            self.passed = [(time, centre + shift) for (time, centre), shift in zip(self.passed, moved)]

    def leave_out(self, which: np.ndarray) -> None:
        """Keep contacts marked in (n,) bool out of what follows the run; on disk they stay."""
        kept = np.flatnonzero(~which)
        self.contacts, self.sequences = [self.contacts[k] for k in kept], [self.sequences[k] for k in kept]
        self.states = [self.states[k] for k in kept]

    def turn(self, normals: np.ndarray, which: np.ndarray, radius: float) -> None:
        """Give the contacts that are `which` (n,) their `normals` (n, 3), about the centres of the sphere (`radius` m).

        On disk they stay.
        """
        for k in np.flatnonzero(which):
            contact = self.contacts[k]
            centre = contact.point + radius * contact.normal
            self.contacts[k] = replace(contact, point=centre - radius * normals[k], normal=normals[k])

    def arm_states(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Joint values (n, m) rad and velocities (n, 3) m/s of the centre at the contacts that follow the run.

        None without contacts, and where some belong to an earlier part of the run, of which they are not known.
        """
        known = [state for state in self.states if state is not None]
        if not known or len(known) < len(self.contacts):
            return None
        return np.array([joints for joints, _ in known]), np.array([velocity for _, velocity in known])

    def points(self) -> np.ndarray:
        """(n, 3) m."""
        return np.array([c.point for c in self.contacts]).reshape(-1, 3)

    def normals(self) -> np.ndarray:
        """(n, 3)."""
        return np.array([c.normal for c in self.contacts]).reshape(-1, 3)

    def trace(self) -> np.ndarray:
        """(k, 8): time, x, y, z, force, touching, clearance, lean."""
        return np.array(self._trace, dtype=np.float64).reshape(-1, 8)

    @property
    def places(self) -> int:
        """How many places of the path are recorded."""
        return len(self._trace)

    def free_places(self, first: int = 0) -> np.ndarray:
        """(k, 3) m, places from number `first` of the path on at which the sphere touched nothing."""
        return np.array([row[1:4] for row in self._trace[first:] if not row[5]]).reshape(-1, 3)

    def write_again(self) -> None:
        """Contacts and path anew, where the folder was lost while the run went on; raises OSError."""
        assert self.folder is not None
        self.folder.mkdir(parents=True, exist_ok=True)
        lines = [CONTACT_COLUMNS + "\n", *map(_line, self.contacts)]
        (self.folder / "contacts.csv").write_text("".join(lines), encoding="utf-8")
        rows = [
            f"{t:.4f},{x:.6f},{y:.6f},{z:.6f},{f:.4f},{int(on)},{c:.5f},,{lean:.4f}\n"
            for t, x, y, z, f, on, c, lean in self._trace
        ]
        (self.folder / "trace.csv").write_text("".join([TRACE_COLUMNS + "\n", *rows]), encoding="utf-8")

    def close(self) -> None:
        """Close the streams; the folder is complete up to here."""
        for stream in (self._contact_file, self._trace_file, self._state_file):
            if stream is not None:
                stream.close()

    def _look(self) -> None:
        now = monotonic()
        if now >= self._look_due:
            self._look_due = now + LOOK_EVERY
            if self.folder is not None and not (self.folder / "contacts.csv").exists():
                raise StorageError(self.folder, OSError(ENOENT, strerror(ENOENT)))

    def _write(self, stream: FileIO, line: str) -> None:
        write_all(stream, line.encode(), self.folder)

    def _take_over(self, earlier: RunFolder) -> None:
        """Contacts and path; no true contact is known of them any more."""
        record, radius = earlier.record, earlier.scene.probe.radius
        assert record.times is not None
        assert record.normals is not None
        assert record.confidence is not None
        for row in zip(record.times, record.points, record.normals, earlier.force, record.confidence):
            time, point, normal, force, confidence = row
            contact = Contact(float(time), point, normal, force * normal, point + radius * normal, float(confidence))
            self.contacts.append(contact)
            self.sequences.append(NO_SAMPLE)
            self.states.append(None)
        self._trace += [(*row[:5], bool(row[5]), *row[6:]) for row in earlier.trace.tolist()]

    def _open(self, path: Path, header: str) -> FileIO:
        # No buffer: a line goes to the system as soon as it is written, in one piece.
        if self._goes_on and path.is_file():
            _cut_to_whole_lines(path)
            return path.open("ab", buffering=0)
        stream = path.open("wb", buffering=0)
        self._write(stream, f"{header}\n")
        return stream


def _line(contact: Contact) -> str:
    (x, y, z), (nx, ny, nz) = contact.point.tolist(), contact.normal.tolist()  # numpy's own print slowly
    return (
        f"{contact.time:.6f},{x:.7f},{y:.7f},{z:.7f},{nx:.6f},{ny:.6f},{nz:.6f},"
        f"{contact.magnitude:.5f},{contact.confidence_score:.3f}\n"
    )


def _cut_to_whole_lines(path: Path) -> None:
    """What was being written when the run was cut off is no line."""
    with path.open("r+b") as file:
        file.truncate(file.read().rfind(b"\n") + 1)
