"""One call for any reconstructor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lwrprobe.contracts import (
    LwrprobeError,
    PluginError,
    Reconstruction,
    Reconstructor,
    TouchRecord,
    TriangleMesh,
)
from lwrprobe.contracts.plugins import failed, load
from lwrprobe.reconstruction.closed import is_closed


def reconstruct(
    record: TouchRecord,
    method: str = "contact_surface",
    progress: Callable[[str, float], None] | None = None,
    **options: Any,
) -> Reconstruction:
    """Reconstruct with the plug-in `method` and its options.

    `progress` is called with the stage and its share done by methods that take long; an error that it raises, or a
    keyboard interrupt, ends the work. Raises UnknownNameError for an unknown method or option, InputError for a
    record that carries no surface, PluginError for a method that fails or whose mesh is none.
    """
    from lwrprobe.contracts.options import configure

    plugin = load("reconstructor", method)
    worker = plugin(configure(plugin.Config, options, f"reconstruction {method}"))
    ended: list[Exception] = []

    def report(stage: str, share: float) -> None:
        assert progress is not None
        try:
            progress(stage, share)
        except Exception as error:
            ended.append(error)
            raise

    if progress is not None and hasattr(worker, "progress"):
        worker.progress = report
    try:
        return reconstructed(worker, record, method)
    except PluginError:
        if ended:
            raise ended[0] from None
        raise


def reconstructed(worker: Reconstructor, record: TouchRecord, name: str) -> Reconstruction:
    """What a reconstructor makes of a record; `watertight` of its report is what the mesh is.

    Raises InputError for a record that carries no surface, PluginError, naming the method, where it fails otherwise or
    its mesh has no triangles, vertices that are not finite, or triangles of vertices that are not there.
    """
    try:
        found = worker.reconstruct(record)
    except LwrprobeError:
        raise
    except Exception as error:
        raise failed("reconstructor", name, error) from error
    wrong = _wrong(found)
    if wrong:
        raise PluginError(f"reconstructor plug-in {name!r}: {wrong}")
    found.report["watertight"] = is_closed(found.mesh.faces)
    for key, value in (("method", name), ("seconds", 0.0), ("without", [])):
        found.report.setdefault(key, value)
    return found


def _wrong(found: object) -> str:
    """What is wrong with the answer of a reconstructor, "" where nothing is."""
    if not isinstance(found, Reconstruction) or not isinstance(found.mesh, TriangleMesh):
        return f"it returned {type(found).__name__}; allowed: a Reconstruction with a TriangleMesh"
    if not isinstance(found.report, dict):
        return f"its report is {type(found.report).__name__}; allowed: a dictionary"
    vertices, faces = np.asarray(found.mesh.vertices), np.asarray(found.mesh.faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        return f"its vertices have the shape {vertices.shape}; allowed: (n, 3) finite numbers"
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces) or not np.issubdtype(faces.dtype, np.integer):
        return f"its faces have the shape {faces.shape} and the type {faces.dtype}; allowed: (m, 3) integers, m > 0"
    if faces.min() < 0 or faces.max() >= len(vertices):
        return f"its faces name vertex {faces.max()}; allowed: 0 to {len(vertices) - 1}"
    return ""
