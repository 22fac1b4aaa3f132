"""What a command line names is checked here first, before anything that takes long to import or to compile."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from lwrprobe.contracts.plugins import names
from lwrprobe.errors import InputError, UnknownNameError
from lwrprobe.exploration.recording.run_files import check_apart, is_run

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


def check_replaceable(field: str, folder: Path, overwrite: bool | None = None) -> None:
    """Raise InputError for a folder with any file that is no run's, or with a run that can be resumed.

    With `overwrite` a run that can be resumed passes; None where the command has no option for that. Nothing is removed
    here: a new run does that when it begins.
    """
    if not folder.is_dir():
        return
    if not is_run(folder):
        others = sorted(path.name for path in folder.iterdir())
        if others:
            allowed = f"a new, an empty or a run folder; this one is no run's and has {', '.join(others[:3])}"
            raise InputError(field, str(folder), allowed)
    elif (folder / "observations.f64").is_file() and not overwrite:
        option = "" if overwrite is None else ", --overwrite replaces it"
        allowed = f"another folder: this run was cut off. `lwrprobe resume` continues it{option}"
        raise InputError(field, str(folder), allowed)


def check_scene_apart(field: str, folder: Path, scene: str) -> None:
    """`check_apart` for the scene of a command line, where that is a file."""
    if Path(scene).is_file():
        check_apart(field, folder, [Path(scene)])


def beside(source: Path, ending: str) -> Path:
    """The path of a file or folder beside `source`, a run folder or a file, which is named after it."""
    named = source if source.name not in ("", "..") else source.resolve()
    return named.with_name((named.name if named.is_dir() else named.stem) + ending)


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
