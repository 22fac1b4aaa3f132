"""A bag read from its files up to the first bad record, whatever was done to them; no index is needed.

Every size that a file claims is compared with what is there before anything of that size is made.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from struct import error as StructError
from struct import unpack_from
from typing import Any, BinaryIO

from lwrprobe.bags import messages
from lwrprobe.bags.sqlite_bag import read_rows
from lwrprobe.errors import FormatError, LwrprobeError

MAGIC = b"\x89MCAP0\r\n"
SQLITE = b"SQLite f"
STORAGES = (".mcap", ".db3")
LARGEST_RECORD = 64 * 2**20
"""Bytes of a record, compressed or not: lwrprobe's chunks have 16 kB, those of rosbag2 less than 1 MB."""
_CHUNK, _DATA_END, _FOOTER = 0x06, 0x0F, 0x02
_HEAD = 9  # opcode and length of a record


@dataclass(slots=True, frozen=True)
class BagMessage:
    """One message as it lies in a bag.

    Attributes
    ----------
    topic, type : `/wrench`, `geometry_msgs/msg/WrenchStamped`
    time : ns since the epoch, when it was recorded
    data : CDR
    """

    topic: str
    type: str
    time: int
    data: bytes

    def decode(self) -> Any:
        """The message; raises FormatError where the bytes are none of its type."""
        try:
            return messages.deserialise(self.data, self.type)
        except LwrprobeError:
            raise
        except KeyError:
            raise FormatError(f"{self.topic}: the type {self.type} is unknown") from None
        except Exception as error:  # whatever a hostile message makes of the generated code
            raise FormatError(f"{self.topic}: no message of type {self.type}: {error}") from None


@dataclass(slots=True)
class BagState:
    """What was found while a file was read.

    Attributes
    ----------
    counts : messages by topic
    types : of the topics
    first, last : ns, of the messages; 0 without one
    complete : the file ends as it should, with its index
    broken : where and why reading ended early, empty where it did not
    good : bytes up to the end of the last good record
    """

    counts: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    first: int = 0
    last: int = 0
    complete: bool = False
    broken: str = ""
    good: int = 0


def bag_files(path: str | Path) -> list[Path]:
    """The `.mcap` or `.db3` files of a bag, of a run folder with one, or the file itself, oldest first.

    Raises FormatError where there is none.
    """
    path = Path(path)
    if path.is_file():
        return [path]
    folder = path / "bag" if (path / "bag").is_dir() else path
    for ending in STORAGES:
        files = sorted(folder.glob(f"*{ending}"), key=lambda file: (len(file.name), file.name))
        if files:
            return files
    raise FormatError(f"{path}: no bag: neither a file {' or '.join(STORAGES)} nor a folder with one")


def read_bag(path: str | Path) -> Iterator[BagMessage]:
    """All messages of a bag in the order in which they were written; what follows a bad record is left out.

    Raises FormatError for what is no bag at all, and MissingExtraError.
    """
    messages.require("a bag")
    for file in bag_files(path):
        yield from read_file(file, BagState())


def read_file(path: Path, state: BagState) -> Iterator[BagMessage]:
    """The messages of one file; `state` says in the end what was found. Raises as `read_bag` does."""
    try:
        with path.open("rb") as stream:
            first = stream.read(len(MAGIC))
            if first == SQLITE:
                yield from _rows(path, state)
                return
            if first != MAGIC:
                raise FormatError(f"{path}: neither MCAP nor SQLite: its first bytes are others")
            yield from _messages(stream, path.stat().st_size, state)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None


def _rows(path: Path, state: BagState) -> Iterator[BagMessage]:
    try:
        for topic, kind, time, data in read_rows(path, LARGEST_RECORD):
            state.types[topic] = kind
            yield _counted(BagMessage(topic, kind, time, data), state)
    except FormatError as error:
        if not state.counts:
            raise
        state.broken = str(error)
        return
    state.good, state.complete = path.stat().st_size, True


def _counted(message: BagMessage, state: BagState) -> BagMessage:
    state.counts[message.topic] += 1
    state.first = min(state.first or message.time, message.time)
    state.last = max(state.last, message.time)
    return message


def _messages(stream: BinaryIO, size: int, state: BagState) -> Iterator[BagMessage]:
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message, Schema

    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    state.good = len(MAGIC)
    while True:
        try:
            records, last = _records(stream, size, state)
            for record in records:
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record.topic, schemas.get(record.schema_id, "")
                    state.types[record.topic] = schemas.get(record.schema_id, "")
                elif isinstance(record, Message):
                    topic, kind = channels[record.channel_id]
                    yield _counted(BagMessage(topic, kind, record.log_time, record.data), state)
        except (
            FormatError,
            McapError,
            StructError,
            KeyError,
            UnicodeDecodeError,
            EOFError,
            OverflowError,
            ValueError,
            RuntimeError,
        ) as bad:
            state.broken = f"byte {state.good}: {type(bad).__name__}: {bad}"
            return
        state.good = stream.tell()
        if last:
            state.complete = True
            return


def _records(stream: BinaryIO, size: int, state: BagState) -> tuple[list[Any], bool]:
    """The next record, or those of the next chunk, and whether the data end here."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import breakup_chunk

    head = stream.read(_HEAD)
    if len(head) < _HEAD:
        raise FormatError("the file ends without its index")
    opcode, length = unpack_from("<BQ", head)
    if length > size - stream.tell():
        raise FormatError(f"a record of {length} bytes, of which {size - stream.tell()} are there")
    if length > LARGEST_RECORD:
        raise FormatError(f"a record of {length} bytes; allowed: {LARGEST_RECORD}")
    content = stream.read(length)
    data = ReadDataStream(BytesIO(content))
    if opcode == _CHUNK:
        chunk = Chunk.read(data)
        _check_expansion(chunk)
        return breakup_chunk(chunk, validate_crc=True), False
    if opcode in (_DATA_END, _FOOTER):
        stream.seek(-len(MAGIC), 2)
        if stream.read(len(MAGIC)) != MAGIC:
            raise FormatError("the file ends without its index")
        return [], True
    for number, kind in ((0x03, Schema), (0x04, Channel)):
        if opcode == number:
            return [kind.read(data)], False
    return ([Message.read(data, length)] if opcode == 0x05 else []), False


def _check_expansion(chunk: Any) -> None:
    """Refuse a chunk that would fill the memory when it is decompressed."""
    claimed = chunk.uncompressed_size
    if chunk.compression == "zstd":
        import zstandard

        claimed = max(claimed, zstandard.frame_content_size(chunk.data))
    elif chunk.compression == "lz4":
        import lz4.frame

        claimed = max(claimed, lz4.frame.get_frame_info(chunk.data)["content_size"], 255 * len(chunk.data))
    elif chunk.compression:
        raise FormatError(f"a chunk of the compression {chunk.compression[:20]!r}; allowed: zstd, lz4, none")
    if claimed > LARGEST_RECORD:
        raise FormatError(f"a chunk of {claimed} bytes; allowed: {LARGEST_RECORD}")
