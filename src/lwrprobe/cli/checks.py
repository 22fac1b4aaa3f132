"""What a command line names is checked here first, before anything that takes long to import or to compile."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING

from lwrprobe.contracts.plugins import names
from lwrprobe.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from lwrprobe.scene import Scene


def check_name(kind: str, name: str | None) -> None:
    """Raise UnknownNameError unless a plug-in of this kind has the name; None is no name and passes."""
    if name is not None and name not in (known := names(kind)):
        raise UnknownNameError(kind, name, known)


def check_plugins(scene: Scene) -> None:
    """Raise UnknownNameError for the first plug-in that the scene names and that is not installed."""
    check_name("strategy", scene.strategy.name)
    check_name("driver", scene.arm.driver)
    check_name("driver", scene.sensor.driver)
    check_name("robot", scene.arm.robot)
    check_name("reconstructor", scene.reconstruction.method)


def check_input(field: str, path: Path) -> None:
    """Raise InputError unless the file or folder exists."""
    if not path.exists():
        raise InputError(field, str(path), f"an existing file or folder; there is no such one in {Path.cwd()}")


def check_run(field: str, folder: Path) -> None:
    """Raise InputError unless the folder is one that `lwrprobe explore` left."""
    check_input(field, folder)
    if not (folder / "scene.toml").is_file():
        raise InputError(field, str(folder), "a run folder of `lwrprobe explore`; this one has no scene.toml")


def check_folder(field: str, folder: Path | None) -> None:
    """Raise InputError unless the folder can be written to, or made; it is not made here. None passes."""
    if folder is None:
        return
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not nearest.is_dir():
        raise InputError(field, str(folder), f"a folder that can be written to ({nearest} is a file)")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(field, str(folder), f"a folder that can be written to (no permission to write in {nearest})")


RUN_FILES = frozenset(
    (
        "bag", "cloud.pcd", "compared.html", "contact_errors.csv", "contacts.csv", "contacts.ply", "hiding.ply",
        "map.bt", "mesh.stl", "observations.f64", "observations.words", "preview.png", "report.html", "scene.toml",
        "states.csv", "summary.json", "trace.csv",
    )
)  # fmt: skip
"""What an exploration may find in its run folder, left there by an earlier one."""


def check_empty(field: str, folder: Path, overwrite: bool) -> None:
    """Raise InputError for a folder with other files than a run's, or with a run that can be resumed.

    With `overwrite` a run that can be resumed is replaced. A run that came to its end always is, all of it.
    """
    if not folder.is_dir():
        return
    others = sorted(path.name for path in folder.iterdir() if path.name not in RUN_FILES)
    runs = (folder / "scene.toml").is_file()
    if others and not runs:
        raise InputError(field, str(folder), f"a new, an empty or a run folder; this one has {', '.join(others[:3])}")
    if runs and (folder / "observations.f64").is_file() and not overwrite:
        raise InputError(
            field, str(folder),
            "another folder: this run was cut off. `lwrprobe resume` continues it, --overwrite replaces it",
        )  # fmt: skip
    for name in RUN_FILES:
        path = folder / name
        if path.is_dir():
            rmtree(path)
        else:
            path.unlink(missing_ok=True)


def check_output(field: str, file: Path | None, endings: Iterable[str] = ()) -> None:
    """Raise InputError unless the file can be written; with endings, its own must be among them. None passes."""
    if file is None:
        return
    if file.is_dir():
        raise InputError(field, str(file), "a file; this is a folder")
    endings = sorted(endings)
    if endings and file.suffix.lower() not in endings:
        raise InputError(field, str(file), f"a file name that ends in {', '.join(endings)}")
    check_folder(field, file.parent)
