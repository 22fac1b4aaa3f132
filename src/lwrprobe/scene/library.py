"""The built-in scenes: TOML files that travel with the package."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).with_name("library")


def scene_names() -> list[str]:
    """Names of the built-in scenes, sorted."""
    return sorted(file.stem for file in _FOLDER.glob("*.toml"))


def scene_path(name: str) -> Path:
    """The file of a built-in scene."""
    return _FOLDER / f"{name}.toml"
