"""Real-time priority for what has to keep a device's time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

ANSWERS = 80
"""Priority of what answers a device in every cycle."""
LOOP = 40
"""Priority of the control loop, which the answers may interrupt."""


@contextmanager
def real_time_priority(priority: int) -> Iterator[bool]:
    """Real-time priority (SCHED_FIFO) of the calling thread while the block runs; whether the system permits it.

    Threads and processes that are begun meanwhile are ordinary ones.
    """
    if not hasattr(os, "sched_setscheduler"):
        yield False
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        yield False
        return
    try:
        yield True
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, *before)
