"""One call for any reconstructor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lwrprobe.contracts import RECONSTRUCTOR_CONTRACT, Reconstruction, TouchRecord
from lwrprobe.contracts.plugins import load


def reconstruct(
    record: TouchRecord,
    method: str = "contact_surface",
    progress: Callable[[str, float], None] | None = None,
    **options: Any,
) -> Reconstruction:
    """Reconstruct with the plug-in `method` and its options.

    `progress` is called with the stage and its share done by methods that take long; an error that it raises, or a
    keyboard interrupt, ends the work. Raises UnknownNameError for an unknown method or option, InputError for a
    record that carries no surface.
    """
    from lwrprobe.contracts.options import configure

    plugin = load("reconstructor", method, RECONSTRUCTOR_CONTRACT)
    worker = plugin(configure(plugin.Config, options, f"reconstruction {method}"))
    if progress is not None and hasattr(worker, "progress"):
        worker.progress = progress
    return worker.reconstruct(record)
