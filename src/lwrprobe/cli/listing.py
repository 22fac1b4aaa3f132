"""`lwrprobe list`: what can be named elsewhere on the command line."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Kind(StrEnum):
    """What can be listed."""

    scenes = "scenes"
    profiles = "profiles"
    strategies = "strategies"
    drivers = "drivers"
    robots = "robots"
    reconstructors = "reconstructors"
    benches = "benches"


_PLUGIN_KIND = {
    Kind.strategies: "strategy",
    Kind.drivers: "driver",
    Kind.robots: "robot",
    Kind.reconstructors: "reconstructor",
}


def list_names(kind: Annotated[Kind, typer.Argument(help="What to list.")]) -> None:
    """List scenes, profiles, strategies, drivers, robots, reconstructors or benches."""
    for name, note in _rows(kind):
        typer.echo(f"{name:<24} {note}".rstrip())


def _rows(kind: Kind) -> list[tuple[str, str]]:
    if kind is Kind.scenes:
        from lwrprobe.scene import load_scene, scene_names

        return [(name, load_scene(name).title) for name in scene_names()]
    if kind is Kind.profiles:
        from lwrprobe.scene import profile_names

        return [(name, "") for name in profile_names()]
    if kind is Kind.benches:
        from lwrprobe.bench import BENCHES

        return [(name, "") for name in BENCHES]
    from lwrprobe.contracts.plugins import discover

    rows = []
    for plugin in discover(_PLUGIN_KIND[kind]):
        note = f"BROKEN: {plugin.broken}" if plugin.broken else _first_line(plugin.loaded.__doc__)
        source = "" if plugin.distribution == "lwrprobe" else f" [{plugin.distribution} {plugin.version}]"
        rows.append((plugin.name, note + source))
    return rows


def _first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0]
