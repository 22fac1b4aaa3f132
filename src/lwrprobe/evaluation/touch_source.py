"""Touches from wherever they come: a run folder, a cloud, a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError, InputError, TouchRecord, UnknownNameError
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import ENDINGS as CLOUDS
from lwrprobe.mapping.clouds import read_cloud

MAPS = (".bt", ".ot")


def read_touches(path: str | Path, probe_radius: float | None = None, table: float | None = None) -> TouchRecord:
    """A record from a run folder, a cloud (.pcd, .ply, .csv; normals are used where it has them) or a map (.bt, .ot).

    `probe_radius` and `table` [m] are for files that do not contain them; a run folder does. A cloud's field
    `confidence` (`trust` in older files) is used.

    Raises FormatError for broken files, UnknownNameError for an unknown ending, and InputError for a `table` that is
    no height or above all points.
    """
    path = Path(path)
    if path.is_dir():
        return read_run(path).record
    if not path.exists():
        raise FormatError(f"{path}: no such file or folder")
    ending = path.suffix.lower()
    if ending in MAPS:
        voxels = VoxelMap.read(path)
        record = TouchRecord(voxels.centres(), probe_radius=probe_radius, table=table, resolution=voxels.resolution)
        return _on_table(record)
    if ending not in CLOUDS:
        raise UnknownNameError("ending of a cloud or map", ending, (*CLOUDS, *MAPS))
    cloud = read_cloud(path)
    confidence = cloud.scalars.get("confidence", cloud.scalars.get("trust"))
    record = TouchRecord(
        np.asarray(cloud.points, dtype=np.float64),
        normals=cloud.normals,
        confidence=confidence,
        probe_radius=probe_radius,
        table=table,
    )
    return _on_table(record)


def _on_table(record: TouchRecord) -> TouchRecord:
    """The record, of which something has to lie above the table that was given with it.

    A run's own table is not judged: where it is stated too high, what was measured is still of use.
    """
    highest = float(record.points[:, 2].max(initial=-np.inf))
    if record.table is not None and len(record.points) and record.table > highest:
        raise InputError("table", record.table, f"a height in metres up to that of the highest point, {highest:g}")
    return record
