"""The older storage of rosbag2: messages in a table of a SQLite file (`.db3`)."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from lwrprobe.errors import FormatError

_TABLES = ("messages", "topics")
_ROWS = (
    "SELECT topics.name, topics.type, topics.serialization_format, messages.timestamp, messages.data "
    "FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp, messages.id"
)


def read_rows(path: Path, largest: int) -> Iterator[tuple[str, str, int, bytes]]:
    """Topic, type, time [ns] and CDR of each message, in the order of their times.

    Raises FormatError for a file without the tables of a bag, with a message of more than `largest` bytes, or at the
    first page that is broken.
    """
    try:
        # Immutable: no journal beside the file is looked for, or made.
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)) as file:
            file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, largest)
            file.execute("PRAGMA trusted_schema = OFF")
            # A view of that name could be a query without an end.
            tables = {name for (name,) in file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not tables.issuperset(_TABLES):
                raise FormatError(f"{path}: not a rosbag2 file: it lacks a table {' or '.join(_TABLES)}")
            for topic, kind, encoding, time, data in file.execute(_ROWS):
                kinds = isinstance(topic, str), isinstance(kind, str), isinstance(time, int), isinstance(data, bytes)
                if not all(kinds) or encoding != "cdr":
                    raise FormatError(f"{path}: a message that is not CDR, or without topic, type or time")
                yield topic, kind, time, data
    except (sqlite3.Error, UnicodeDecodeError, OverflowError, MemoryError) as error:
        raise FormatError(f"{path}: not a rosbag2 file: {error}") from None
