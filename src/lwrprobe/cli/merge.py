"""`lwrprobe merge RUN RUN ...`: several runs over one object as one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def merge(
    runs: Annotated[list[Path], typer.Argument(help="Run folders; the first one's place is kept.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder for the merged run.")],
    method: Annotated[str | None, typer.Option(help="Reconstructor; the first run's when left out.")] = None,
    as_is: Annotated[bool, typer.Option("--as-is", help="Leave every run where it is, without registration.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as the last line of output.")] = False,
    quiet: Annotated[bool, typer.Option(help="No words.")] = False,
) -> None:
    """Join the contacts of runs over the same object, moved by a few millimetres in between or not."""
    from lwrprobe.exploration.procedures.merge import merge as run

    tell = (lambda text: None) if quiet else (lambda text: typer.echo(text, err=True))
    summary = run(runs, out, method=method, as_is=as_is, tell=tell)
    if not quiet:
        for fact in summary["merged"]:
            typer.echo(_line(fact), err=True)
        typer.echo(f"{summary['contacts']} contacts in {summary['voxels']} voxels: {out}", err=True)
    if as_json:
        typer.echo(json.dumps(summary))


def _line(fact: dict) -> str:
    text = f"{fact['folder']}: {fact['contacts']} contacts"
    found = fact.get("registration")
    if found is None:
        return text
    text += f", {found['apart_before_mm']:.2f} mm off the others"
    if found["moved"]:
        text += (
            f"; moved by {found['shift_mm']:.2f} mm and {found['turn_deg']:.2f} deg: {found['apart_after_mm']:.2f} mm"
        )
    if found["left_open"]:
        text += f" (the touches do not tell: {', '.join(found['left_open'])})"
    return text
