"""The built-in scenes, and profiles to run any scene by: TOML files that travel with the package."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).with_name("library")
_PROFILES = Path(__file__).with_name("profiles")


def scene_names() -> list[str]:
    """Names of the built-in scenes, sorted."""
    return sorted(file.stem for file in _FOLDER.glob("*.toml"))


def scene_path(name: str) -> Path:
    """The file of a built-in scene."""
    return _FOLDER / f"{name}.toml"


def profile_names() -> list[str]:
    """Names of the built-in profiles, sorted."""
    return sorted(file.stem for file in _PROFILES.glob("*.toml"))


def profile_path(name: str) -> Path:
    """The file of a built-in profile."""
    return _PROFILES / f"{name}.toml"
