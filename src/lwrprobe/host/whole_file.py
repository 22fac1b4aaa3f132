"""A file written whole or not at all."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from lwrprobe.contracts import StorageError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file in one step, and make its folder: what stood there stays until all of the content is on disk.

    Raises StorageError naming the file.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise StorageError(path, error) from None
