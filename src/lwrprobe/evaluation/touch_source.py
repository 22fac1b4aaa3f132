"""Touches from wherever they come: a run folder, a cloud, a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError, TouchRecord, UnknownNameError
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import ENDINGS as CLOUDS
from lwrprobe.mapping.clouds import read_cloud

MAPS = (".bt", ".ot")


def read_touches(path: str | Path, probe_radius: float | None = None, table: float | None = None) -> TouchRecord:
    """A record from a run folder, a cloud (.pcd, .ply, .csv; normals are used where it has them) or a map (.bt, .ot).

    `probe_radius` and `table` [m] are for files that do not contain them; a run folder does. A cloud's field
    `confidence` (`trust` in older files) is used.

    Raises FormatError for broken files and UnknownNameError for an unknown ending.
    """
    path = Path(path)
    if path.is_dir():
        return read_run(path).record
    if not path.exists():
        raise FormatError(f"{path}: no such file or folder")
    ending = path.suffix.lower()
    if ending in MAPS:
        voxels = VoxelMap.read(path)
        return TouchRecord(
            voxels.centres(), probe_radius=probe_radius, table=table, resolution=float(voxels.resolution)
        )
    if ending not in CLOUDS:
        raise UnknownNameError("ending of a cloud or map", ending, (*CLOUDS, *MAPS))
    cloud = read_cloud(path)
    confidence = cloud.scalars.get("confidence", cloud.scalars.get("trust"))
    return TouchRecord(
        np.asarray(cloud.points, dtype=np.float64),
        normals=cloud.normals,
        confidence=confidence,
        probe_radius=probe_radius,
        table=table,
    )
