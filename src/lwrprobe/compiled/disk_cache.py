"""numba's cache on disk, safe when several processes compile at once and exact about what has changed.

numba numbers the data files of a kernel by their position in its index, without a lock: two processes that store
different specialisations at once can exchange them. Here a lock on the folder is held while index and data are read or
written.

numba takes a file's time for its state and looks at the kernel's own file alone. Here the state is the content of that
file and of all kernel files that it imports, directly or through others: a fresh checkout of the same code compiles
nothing, and a change in a callee compiles its callers again.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

from filelock import FileLock, SoftFileLock, Timeout
from numba.core.caching import IndexDataCacheFile

LOCK_NAME = "kernels.lock"
MAX_WAIT = 20.0
"""s; a process that holds the lock for longer has been stopped. The kernel is then compiled without the cache."""

loads: list[str] = []
"""Index files of the specialisations that this process took from the disk."""


def make_safe(dispatcher: Any) -> None:
    """Give a kernel's cache the lock and the stamp of this module."""
    # These attributes are private to numba; without them its own cache works, only less carefully.
    store: Any = getattr(dispatcher, "_cache", None)
    base = getattr(getattr(store, "_impl", None), "filename_base", None)
    if base is not None and hasattr(store, "_cache_file"):
        folder = str(store.cache_path)
        store._cache_file = IndexFile(folder, base, _state(dispatcher.py_func.__module__))


def is_stored(dispatcher: Any) -> bool:
    """Whether the disk has a specialisation of a kernel; True where nothing can be said about it."""
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    return not isinstance(file, IndexFile) or file.holds_any()


class IndexFile(IndexDataCacheFile):
    """Index and data files of one kernel; a lock on the folder is held while they are read or written."""

    def save(self, key: Any, data: Any) -> None:
        with _locked(self._cache_path) as held:
            if held:
                super().save(key, data)

    def load(self, key: Any) -> Any:
        if not Path(self._index_path).exists():
            return None
        with _locked(self._cache_path) as held:
            found = super().load(key) if held else None
        if found is not None:
            loads.append(self._index_path)
        return found

    def holds_any(self) -> bool:
        """Whether there is an entry for the kernel as it is now."""
        if not Path(self._index_path).exists():
            return False
        with _locked(self._cache_path) as held:
            return not held or bool(self._load_index())

    def flush(self) -> None:
        with _locked(self._cache_path) as held:
            if held:
                super().flush()


@cache
def _lock(folder: str) -> FileLock:
    return FileLock(Path(folder, LOCK_NAME))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_lock.cache_clear)  # a lock belongs to the process that has made it


@contextmanager
def _locked(folder: str) -> Iterator[bool]:
    """Hold the lock of a folder; False where another process has not given it back within `MAX_WAIT`."""
    if FileLock is SoftFileLock:  # no locks of the system: a file that a killed process left behind would never go
        yield True
        return
    lock = _lock(folder)
    try:
        lock.acquire(timeout=MAX_WAIT)
    except Timeout:
        yield False
        return
    except (OSError, NotImplementedError):  # read only, or a file system without locks: nobody else can be kept out
        yield True
        return
    try:
        yield True
    finally:
        lock.release()


@cache
def _state(module: str) -> tuple[int, ...]:
    """Check sums over a kernel file and over those it imports. Its imports stand above its first kernel."""
    own = crc32(Path(sys.modules[module].__file__ or "").read_bytes())
    below = [f"{name} {_state(name)}" for name in sorted(_imported_kernels(module))]
    return own, crc32("\n".join(below).encode())  # not hash(): that differs from process to process


def _imported_kernels(module: str) -> set[str]:
    names = set()
    for value in vars(sys.modules[module]).values():
        if hasattr(value, "py_func"):
            names.add(value.py_func.__module__)
        elif isinstance(value, type(sys)):
            names.add(value.__name__)
    return {name for name in names if "kernels" in name and name != module}
