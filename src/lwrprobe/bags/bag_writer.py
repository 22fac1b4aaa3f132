"""A bag written while it grows: rosbag2's folder with `metadata.yaml` and MCAP files, readable from the start."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from io import BufferedWriter
from pathlib import Path
from time import monotonic, time_ns
from typing import Any

from lwrprobe.bags import messages
from lwrprobe.bags.bag_file import BagState, read_file
from lwrprobe.errors import StorageError

CHUNK = 16 * 1024
"""Bytes. What is in the open chunk is lost when the process is killed."""
EVERY = 0.1
"""s of wall-clock time after which the open chunk is written."""
METADATA_EVERY = 5.0
"""s between two refreshes of metadata.yaml."""


class BagWriter:
    """Writes messages into a new file of a bag.

    Parameters
    ----------
    folder : of the bag, made when missing; the files of an earlier part of the run that lie there stay
    name : of the files, numbered from 0

    Raises StorageError where a file cannot be written, also later, and MissingExtraError. After the first such error
    the bag is closed, and what is written to it is dropped.
    """

    def __init__(self, folder: Path, name: str) -> None:
        messages.require("recording a bag")
        from mcap.writer import CompressionType, Writer

        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            earlier = sorted(folder.glob("*.mcap"))
            self._earlier = {file.name: state_of(file) for file in earlier}
            self.path = folder / f"{name}_{len(earlier)}.mcap"
            self._raw = open(self.path, "xb", buffering=0)  # noqa: SIM115
            self._stream = BufferedWriter(self._raw, 4 * CHUNK)
            self._writer = Writer(self._stream, chunk_size=CHUNK, compression=CompressionType.NONE)
            self._writer.start("ros2", "lwrprobe")
            self._stream.flush()
        except OSError as error:
            raise StorageError(folder, error) from None
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._state = BagState()
        self._due = self._metadata_due = 0.0
        self._open = True
        self.write_metadata()

    def channel(self, topic: str, kind: str) -> int:
        """The number under which messages of a type are written to a topic."""
        if kind not in self._schemas:
            text = messages.definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
        number = self._writer.register_channel(topic, "cdr", self._schemas[kind], {"offered_qos_profiles": ""})
        self._channels[topic] = number
        self._state.types[topic] = kind
        return number

    def write(self, topic: str, kind: str, time: int, data: bytes) -> None:
        """One message, recorded at a time [ns]."""
        if not self._open:
            return
        number = self._channels.get(topic) or self.channel(topic, kind)
        state = self._state
        state.counts[topic] += 1
        if not state.first:
            state.first = time
        state.last = max(state.last, time)
        try:
            self._writer.add_message(number, time, data, time)
        except OSError as error:
            raise self._lost(error) from None

    def send(self, topic: str, time: int, message: Any) -> None:
        """`write` of a message that is no bytes yet."""
        self.write(topic, message.__msgtype__, time, messages.serialise(message))

    @property
    def due(self) -> bool:
        """`EVERY` has passed since the last `flush`."""
        return monotonic() >= self._due

    def flush(self) -> None:
        """Hand everything to the system."""
        if not self._open:
            return
        try:
            self._writer.flush()
        except OSError as error:
            raise self._lost(error) from None
        now = monotonic()
        self._due = now + EVERY
        if now >= self._metadata_due:
            self.write_metadata()

    def write_metadata(self) -> None:
        """metadata.yaml with what is there now, in one step."""
        self._metadata_due = monotonic() + METADATA_EVERY
        try:
            write_metadata(self.folder, {**self._earlier, self.path.name: self._state})
        except OSError as error:
            raise self._lost(error) from None

    def close(self) -> None:
        """Write the index and the metadata; may be called more than once."""
        if not self._open:
            return
        self._open = False
        try:
            self._writer.finish()
            self._stream.close()
        except OSError as error:
            raise self._lost(error) from None
        self.write_metadata()

    def _lost(self, error: OSError) -> StorageError:
        """No more can be written: what is on disk stays, for `lwrprobe recover`."""
        self._open = False
        with suppress(OSError, ValueError):
            self._raw.close()  # not the buffer, which would try again
        return StorageError(self.folder, error)


def state_of(file: Path) -> BagState:
    """What a file holds up to its first bad record."""
    state = BagState()
    for _ in read_file(file, state):
        pass
    return state


def write_metadata(folder: Path, files: dict[str, BagState]) -> None:
    """metadata.yaml of a bag from what its files hold, by name; version 5, which ROS 2 Humble and later read."""
    counts: Counter[str] = Counter()
    types: dict[str, str] = {}
    for state in files.values():
        counts.update(state.counts)
        types.update(state.types)
    filled = [state for state in files.values() if state.first]
    first = min((state.first for state in filled), default=time_ns())
    last = max((state.last for state in filled), default=first)
    lines = ["rosbag2_bagfile_information:", "  version: 5", "  storage_identifier: mcap"]
    lines += ["  duration:", f"    nanoseconds: {last - first}", "  starting_time:"]
    lines += [f"    nanoseconds_since_epoch: {first}", f"  message_count: {sum(counts.values())}"]
    lines.append("  topics_with_message_count:" if types else "  topics_with_message_count: []")
    for topic, kind in types.items():
        lines += ["    - topic_metadata:", f"        name: {topic}", f"        type: {kind}"]
        lines += ["        serialization_format: cdr", '        offered_qos_profiles: ""']
        lines.append(f"      message_count: {counts[topic]}")
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f"    - {name}" for name in files]
    lines.append("  files:")
    for name, state in files.items():
        start = state.first or first
        lines += [f"    - path: {name}", "      starting_time:", f"        nanoseconds_since_epoch: {start}"]
        lines += ["      duration:", f"        nanoseconds: {max(state.last - start, 0)}"]
        lines.append(f"      message_count: {sum(state.counts.values())}")
    part = folder / "metadata.yaml.part"
    part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    part.replace(folder / "metadata.yaml")
