"""Cloud files by ending: one table of formats, one error for what is broken."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError, InputError, UnknownNameError
from lwrprobe.host.whole_file import write_whole
from lwrprobe.mapping import csv_file, pcd_file, ply_file
from lwrprobe.mapping.cloud import Cloud

__all__ = ["ENDINGS", "Cloud", "read_cloud", "write_cloud"]

_FORMATS = {".pcd": pcd_file, ".ply": ply_file, ".csv": csv_file}
ENDINGS = tuple(_FORMATS)


def read_cloud(path: str | Path) -> Cloud:
    """Cloud from a `.pcd`, `.ply` or `.csv`.

    Points that are not finite, or whose normal is not, are left out of a `.pcd` or `.ply`: that is how the Point Cloud
    Library marks missing ones. In a `.csv` they are an error.
    Raises FormatError naming file and place for a broken file or one that cannot be read.
    """
    path = Path(path)
    codec = _FORMATS[_ending(path)]
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    return _cloud(path, codec.decode(path, content))


def write_cloud(path: str | Path, cloud: Cloud) -> Path:
    """Write a `.pcd`, `.ply` or `.csv`, by the ending, and make its folder; the path as written.

    PCD and PLY hold single precision, as their readers expect; CSV holds every digit. Raises StorageError.
    """
    path = Path(path)
    write_whole(path, _FORMATS[_ending(path)].encode(cloud))
    return path


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in _FORMATS:
        raise UnknownNameError("cloud file ending", ending, ENDINGS)
    return ending


def _cloud(path: Path, columns: dict[str, np.ndarray]) -> Cloud:
    """Points, normals and the rest from named columns of equal length."""
    if not {"x", "y", "z"} <= columns.keys():
        raise FormatError(f"{path}: fields {', '.join(columns)}; allowed: x, y, z and others")
    points = np.stack([columns.pop(name) for name in "xyz"], axis=1)
    good = np.isfinite(points).all(axis=1)
    normals = None
    for names in (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z")):
        if all(name in columns for name in names):
            normals = np.stack([columns.pop(name) for name in names], axis=1)
            good &= np.isfinite(normals).all(axis=1)
            normals = normals[good]
            break
    if path.suffix.lower() == ".csv" and not good.all():
        raise FormatError(f"{path}: point {int(np.argmin(good)) + 1} is not finite; allowed: numbers")
    try:
        return Cloud(points[good], normals, {name: column[good] for name, column in columns.items()})
    except InputError as error:
        raise FormatError(f"{path}: {error}") from None
