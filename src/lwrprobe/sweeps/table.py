"""The table of a sweep: a row each run, in the order of the plan, as CSV and Parquet."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lwrprobe.errors import StorageError
from lwrprobe.sweeps.plan import SweepTask

FIGURES: dict[str, tuple[str, ...]] = {
    "status": ("status",),
    "reason": ("reason",),
    "contacts": ("contacts",),
    "robot_time_s": ("sim_time_s",),
    "lower_bound_s": ("lower_bound_time_s",),
    "coverage": ("coverage",),
    "contact_median_mm": ("contact_error_mm", "median"),
    "contact_p95_mm": ("contact_error_mm", "p95"),
    "contact_aligned_median_mm": ("contact_error_aligned_mm", "median"),
    "contact_aligned_p95_mm": ("contact_error_aligned_mm", "p95"),
    "mesh_mean_mm": ("mesh_error_mm", "mean"),
    "mesh_largest_mm": ("mesh_error_mm", "hausdorff"),
    "mesh_aligned_mean_mm": ("mesh_error_aligned_mm", "mean"),
    "peak_force_n": ("peak_force_n",),
    "link_collisions": ("link_collisions",),
    "rejected_share": ("rejected_share",),
    "warnings": ("warnings",),
}
"""Column, and where it stands in `summary.json`. All are determined by the task, none by the machine."""

_TEXTS = ("scene", "strategy", "profile", "variant", "status", "reason")
_WHOLE = ("seed", "contacts", "link_collisions", "warnings")

Row = dict[str, Any]


def rows_of(tasks: Sequence[SweepTask], results: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """A row each task that has a result; the figures that a run lacks are None."""
    found = []
    for task in tasks:
        result = results.get(task.key)
        if result is not None:
            found.append(task.named() | {column: _figure(result, path) for column, path in FIGURES.items()})
    return found


def _figure(result: Mapping[str, Any], path: tuple[str, ...]) -> Any:
    value: Any = result
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    return len(value) if isinstance(value, list) else value


def write_tables(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """results.csv, and results.parquet where pyarrow is installed; what was written. Raises StorageError."""
    columns = ["scene", "strategy", "profile", "variant", "seed", *FIGURES]
    written = [folder / "results.csv"]
    try:
        with written[0].open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows({name: "" if value is None else value for name, value in row.items()} for row in rows)
        try:
            import pyarrow as pa
            from pyarrow import parquet
        except ImportError:  # the CSV has the same rows
            return written
        kinds = {
            name: pa.string() if name in _TEXTS else pa.int64() if name in _WHOLE else pa.float64() for name in columns
        }
        data = {name: pa.array([_as(row[name], name) for row in rows], kinds[name]) for name in columns}
        parquet.write_table(pa.table(data), folder / "results.parquet")
    except OSError as error:
        raise StorageError(folder, error) from None
    return [*written, folder / "results.parquet"]


def _as(value: Any, name: str) -> Any:
    if value is None or name in _TEXTS:
        return value
    return int(value) if name in _WHOLE else float(value)
