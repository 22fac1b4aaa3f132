"""What happens in a worker process. Imports nothing heavy: a worker sets its threads before numba is loaded."""

from __future__ import annotations

import os
from typing import Any

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """A worker uses one thread: there are as many workers as cores. Numbers read by libraries when they are loaded."""
    for name in THREADS:
        os.environ[name] = "1"


def explored(task: dict[str, Any]) -> dict[str, Any]:
    """Explore what a task of `lwrprobe.sweeps.plan` asks for; the summary, or why there is none."""
    one_thread()
    from lwrprobe.errors import LwrprobeError
    from lwrprobe.exploration.procedures.explore import explore
    from lwrprobe.scene import load_scene

    try:
        return explore(load_scene(task["scene"], task["set"], task["profile"]))
    except LwrprobeError as error:
        return {"status": "refused", "reason": str(error)}


def prepared(task: dict[str, Any]) -> dict[str, Any]:
    """Compile the kernels of a task into the cache by running it for a moment."""
    return explored(task | {"set": [*task["set"], "run.time_limit=2.0"]})
