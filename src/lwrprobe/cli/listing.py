"""`lwrprobe list`: what can be named elsewhere on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.checks import check_folder
from lwrprobe.errors import InputError, UnknownNameError

AS_STATED = ("truth.profile=ideal",)
"""For the area as the scene's file has it."""

_PLUGINS = {
    "strategies": "strategy",
    "drivers": "driver",
    "robots": "robot",
    "reconstructors": "reconstructor",
    "emulators": "emulator",
}
KINDS = ("scenes", "profiles", *_PLUGINS, "benches")
"""What can be listed."""


def list_names(
    kind: Annotated[str, typer.Argument(help=f"One of {', '.join(KINDS)}.")],
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Of scenes: write a page with a picture of each into this folder."),
    ] = None,
) -> None:
    """List the names that other commands take: scenes, strategies, drivers, ..., each with one line about it."""
    if kind not in KINDS:
        raise UnknownNameError("kind", kind, KINDS)
    if pictures is not None and kind != "scenes":
        raise InputError("--pictures", kind, "scenes; nothing else can be drawn")
    check_folder("--pictures", pictures)
    rows = _rows(kind)
    for name, note in rows:
        typer.echo(f"{name:<24} {note}".rstrip())
    if pictures is not None:
        typer.echo(f"wrote {_draw(_built_in_scenes(), pictures)}", err=True)


def _draw(rows: list[tuple[str, str]], folder: Path) -> Path:
    """`scenes.md` and the pictures in it, under `folder`; the page."""
    from lwrprobe.evaluation.scene_picture import draw_scene
    from lwrprobe.host.whole_file import write_whole
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
        draw_scene(folder / "scenes" / f"{name}.png", load_scene(name, AS_STATED))
        cells.append(f"![{name}](scenes/{name}.png)<br>`{name}`: {title}")
    cells += [""] * (len(cells) % 2)
    lines += [f"| {left} | {right} |" for left, right in zip(cells[::2], cells[1::2])]
    page = folder / "scenes.md"
    write_whole(page, ("\n".join(lines) + "\n").encode())
    return page


def _rows(kind: str) -> list[tuple[str, str]]:
    if kind == "scenes":
        from lwrprobe.scene.random_object import KINDS

        random = [(f"random:{name}:SEED", _first_line(make.__doc__)) for name, make in KINDS.items()]
        return _built_in_scenes() + random
    if kind == "profiles":
        from lwrprobe.scene.library import profile_names, profile_path

        return [(name, _first_comment(profile_path(name))) for name in profile_names()]
    if kind == "benches":
        from lwrprobe.bench import BENCHES

        return [(name, _docstring(module)) for name, module in BENCHES.items()]
    from lwrprobe.contracts.plugins import discover

    rows = []
    for plugin in discover(_PLUGINS[kind]):
        note = f"BROKEN: {plugin.broken}" if plugin.broken else _first_line(plugin.loaded.__doc__)
        source = "" if plugin.distribution == "lwrprobe" else f" [{plugin.distribution} {plugin.version}]"
        rows.append((plugin.name, note + source))
    return rows


def _built_in_scenes() -> list[tuple[str, str]]:
    from lwrprobe.scene import load_scene, scene_names

    return [(name, load_scene(name, AS_STATED).title) for name in scene_names()]


def _first_comment(file: Path) -> str:
    return file.read_text(encoding="utf-8").partition("\n")[0].removeprefix("#").strip()


def _docstring(module: str) -> str:
    """The first line of a module's description, without importing the module and all that it measures."""
    import ast
    from importlib.util import find_spec

    found = find_spec(module)
    if found is None or found.origin is None:
        return ""
    return _first_line(ast.get_docstring(ast.parse(Path(found.origin).read_text(encoding="utf-8"))))


def _first_line(text: str | None) -> str:
    return (text or "").strip().partition("\n")[0]
