"""`lwrprobe merge RUN RUN ...`: several runs over one object as one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.shared_options import SummaryJson


def merge(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Run folders, two or more; the others are registered to the first.", show_default=False),
    ],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Run folder to write.")],
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Reconstructor (see `lwrprobe list reconstructors`); the first run's if left out.",
        ),
    ] = None,
    as_is: Annotated[bool, typer.Option("--as-is", help="Do not register: take every run's frame as it is.")] = False,
    as_json: SummaryJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but the result of --json.")] = False,
) -> None:
    """Join the contacts of several runs over one object, which may have moved a few millimetres between them."""
    from lwrprobe.cli.checks import check_apart, check_folder, check_name, check_replaceable, check_run
    from lwrprobe.errors import InputError

    if len(runs) < 2:
        raise InputError("runs", [str(run) for run in runs], "two run folders or more")
    for folder in runs:
        check_run("runs", folder)
    check_name("reconstructor", method)
    check_folder("--out", out)
    check_apart("--out", out, runs)
    check_replaceable("--out", out)
    from lwrprobe.exploration.procedures.merge import merge as run

    message = (lambda text: None) if quiet else (lambda text: typer.echo(text, err=True))
    summary = run(runs, out, method=method, as_is=as_is, message=message)
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
        text += f" (the contacts do not determine: {', '.join(found['left_open'])})"
    return text
