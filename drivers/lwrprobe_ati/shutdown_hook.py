"""Stopping the stream on every way out of the process.

The device goes on streaming to a dead client, and may not serve another one until it is switched off and on.
"""

from __future__ import annotations

import atexit
import os
import signal
import threading
from collections.abc import Callable
from types import FrameType

_stops: list[Callable[[], None]] = []


def register(stop: Callable[[], None]) -> None:
    """Call `stop` when the interpreter ends, by itself or by SIGTERM or SIGHUP that nobody else handles."""
    if not _stops:
        atexit.register(_stop_all)
    _stops.append(stop)
    if threading.current_thread() is not threading.main_thread():
        return  # only the main thread may set handlers
    for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):  # no SIGHUP on Windows
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _on_signal)


def unregister(stop: Callable[[], None]) -> None:
    """The stream has been stopped in the ordinary way."""
    if stop in _stops:
        _stops.remove(stop)
    if not _stops:
        atexit.unregister(_stop_all)


def _stop_all() -> None:
    for stop in list(_stops):
        stop()


def _on_signal(number: int, frame: FrameType | None) -> None:
    _stop_all()
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
