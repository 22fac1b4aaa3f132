"""Which files make a run folder, and how an earlier run's give way to a new one."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from shutil import rmtree

from lwrprobe.errors import InputError, StorageError

RUN_FILES = frozenset(
    (
        "bag", "cloud.pcd", "compared.html", "contact_errors.csv", "contacts.csv", "contacts.ply", "hiding.ply",
        "map.bt", "mesh.stl", "observations.f64", "observations.words", "preview.png", "report.html", "scene.toml",
        "states.csv", "summary.json", "trace.csv",
    )
)  # fmt: skip
"""What a run may leave in its folder."""

_FIRST_COLUMNS = b"time,x,y,z,nx,ny,nz,force,"  # of contacts.csv in all versions


def is_run(folder: Path) -> bool:
    """Whether lwrprobe made the folder: beside scene.toml, which may be anybody's, a run always has its contacts."""
    try:
        with (folder / "contacts.csv").open("rb") as file:
            return file.read(len(_FIRST_COLUMNS)) == _FIRST_COLUMNS and (folder / "scene.toml").is_file()
    except OSError:
        return False


def check_own(folder: Path) -> None:
    """Raise InputError for a folder that is no run's and has files which a run would write over."""
    if is_run(folder):
        return
    others = sorted(name for name in RUN_FILES if (folder / name).exists())
    if others:
        allowed = f"a folder without such files, or a run's; this one is no run's and has {', '.join(others[:3])}"
        raise InputError("out", str(folder), allowed)


def check_apart(field: str, folder: Path, sources: Iterable[Path]) -> None:
    """Raise InputError for a folder to write that is one of the sources, inside one, or has one in it."""
    place = folder.resolve()
    for source in sources:
        read = source.resolve()
        if place == read or place in read.parents or read in place.parents:
            raise InputError(field, str(folder), f"a folder apart from {source}, which is read")


def clear_run(folder: Path) -> None:
    """Remove what an earlier run left, before a new one begins in its folder; raises StorageError.

    A folder that is no run's stays as it is. Of a run, scene.toml and contacts.csv stay until they are written anew:
    killed in between, the folder is still a run's.
    """
    if not is_run(folder):
        return
    try:
        for name in RUN_FILES - {"scene.toml", "contacts.csv"}:
            path = folder / name
            if path.is_dir() and not path.is_symlink():
                rmtree(path)
            else:
                path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(folder, error) from None
