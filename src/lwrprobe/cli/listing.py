"""`lwrprobe list`: what can be named elsewhere on the command line."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.errors import InputError


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


def list_names(
    kind: Annotated[Kind, typer.Argument(help="What to list.")],
    pictures: Annotated[
        Path | None, typer.Option(help="Of scenes: write a page with a picture of each into this folder.")
    ] = None,
) -> None:
    """List scenes, profiles, strategies, drivers, robots, reconstructors or benches."""
    rows = _rows(kind)
    for name, note in rows:
        typer.echo(f"{name:<24} {note}".rstrip())
    if pictures is not None:
        if kind is not Kind.scenes:
            raise InputError("--pictures", str(kind), "scenes, which can be drawn")
        typer.echo(f"wrote {_draw(rows, pictures)}", err=True)


def _draw(rows: list[tuple[str, str]], folder: Path) -> Path:
    """`scenes.md` and the pictures in it, under `folder`; the page."""
    from lwrprobe.evaluation.scene_picture import draw_scene
    from lwrprobe.scene import load_scene

    lines = [
        "# Built-in scenes",
        "",
        "`lwrprobe list scenes --pictures docs/reference` makes this page. x runs to the lower right, y,",
    ]
    lines += ["along which the lines go, to the upper right; the frame is where the sphere's centre may move.", ""]
    lines += ["| | |", "|---|---|"]
    cells = []
    for name, title in rows:
        draw_scene(folder / "scenes" / f"{name}.png", load_scene(name))
        cells.append(f"![{name}](scenes/{name}.png)<br>`{name}`: {title}")
    cells += [""] * (len(cells) % 2)
    lines += [f"| {left} | {right} |" for left, right in zip(cells[::2], cells[1::2])]
    page = folder / "scenes.md"
    page.write_text("\n".join(lines) + "\n")
    return page


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
