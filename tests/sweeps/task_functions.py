"""What the spawned processes of these tests do. They import this alone: the libraries of the tests take seconds."""

import os
import signal
import time

from lwrprobe.sweeps.worker import THREADS


def squared(number: int) -> dict:
    return {"status": "done", "square": number * number, "threads": [os.environ[name] for name in THREADS]}


def doubled(number: int) -> dict:
    return {"double": 2 * number}


def deadly(number: int) -> dict:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 4:
        raise ValueError("four is refused")
    time.sleep(0.02)
    return squared(number)
