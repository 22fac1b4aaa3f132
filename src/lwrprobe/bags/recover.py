"""A bag whose recording was cut off, made good: what can be read is kept and gets its index."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lwrprobe.bags import messages
from lwrprobe.bags.bag_file import BagState, bag_files, read_file
from lwrprobe.bags.bag_writer import CHUNK, state_of, write_metadata
from lwrprobe.errors import FormatError, StorageError


@dataclass(slots=True, frozen=True)
class RecoveredFile:
    """One file of a bag.

    Attributes
    ----------
    path : of the file
    messages : how many it holds
    lost : bytes after the last good record, which were given up
    reason : why reading ended there, empty for a file that was complete
    """

    path: Path
    messages: int
    lost: int
    reason: str


def recover_bag(path: str | Path) -> list[RecoveredFile]:
    """Write the files of a bag that were cut off again, with their index, and the bag's metadata.

    Complete files stay untouched. Each new file is read back before it takes the place of the old one. Raises
    FormatError for what is no bag, StorageError where it cannot be written, and MissingExtraError.
    """
    messages.require("recovering a bag")
    found, states = [], {}
    files = bag_files(path)
    for file in files:
        if file.suffix != ".mcap":
            raise FormatError(f"{file}: only bags in MCAP can be made good; SQLite keeps its own files whole")
        state = state_of(file)
        lost = 0
        if not state.complete:
            lost = file.stat().st_size - state.good
            _rewrite(file, sum(state.counts.values()))
        states[file.name] = state
        found.append(RecoveredFile(file, sum(state.counts.values()), lost, state.broken))
    try:
        write_metadata(files[0].parent, states)
    except OSError as error:
        raise StorageError(files[0].parent, error) from None
    return found


def _rewrite(file: Path, count: int) -> None:
    from mcap.writer import CompressionType, Writer

    part = file.with_name(file.name + ".part")
    try:
        with part.open("wb") as stream:
            writer = Writer(stream, chunk_size=CHUNK, compression=CompressionType.NONE)
            writer.start("ros2", "lwrprobe")
            channels: dict[tuple[str, str], int] = {}
            for message in read_file(file, BagState()):
                key = message.topic, message.type
                if key not in channels:
                    known = message.type in messages.type_store().types
                    text = messages.definition(message.type).encode() if known else b""
                    schema = writer.register_schema(message.type, "ros2msg", text)
                    channels[key] = writer.register_channel(message.topic, "cdr", schema, {"offered_qos_profiles": ""})
                writer.add_message(channels[key], message.time, message.data, message.time)
            writer.finish()
        again = state_of(part)
        if not again.complete or sum(again.counts.values()) != count:
            raise OSError(5, "what was written cannot be read back")
        part.replace(file)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise StorageError(file.parent, error) from None
