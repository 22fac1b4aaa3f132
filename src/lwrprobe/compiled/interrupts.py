"""Ctrl-C waits while a kernel is compiled or taken from the disk.

llvmlite frees what it has made in `close`, and notes after that that it is freed. An interrupt in between leaves it to
be freed once more by its finaliser, which ends the process ("double free detected").
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupts_held() -> Iterator[None]:
    """A Ctrl-C that comes in the block is answered at its end. Only the main thread is ever interrupted."""
    answer = signal.getsignal(signal.SIGINT)
    if not callable(answer) or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, answer)
        if came:
            answer(*came[0])
