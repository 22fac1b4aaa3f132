"""Lines and rows to disk, each whole or with the system's reason."""

from __future__ import annotations

from io import FileIO

from lwrprobe.contracts import StorageError


def write_all(stream: FileIO, content: bytes, place: object) -> None:
    """Write to an unbuffered file, which a nearly full disk takes in parts; raises StorageError naming `place`."""
    try:
        while content:
            content = content[stream.write(content) :]
    except OSError as error:
        raise StorageError(place, error) from None
