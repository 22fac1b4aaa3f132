"""`lwrprobe recover RUN`: make the folder of a killed run, or a bag, readable again."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer


def recover(
    run: Annotated[
        Path, typer.Argument(help="Run folder, bag folder or .mcap file that was cut off.", show_default=False)
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Make good what a killed run left: whole lines, the bag's index, summary, mesh and report."""
    from lwrprobe.cli.checks import check_folder, check_input

    check_input("run", run)
    check_folder("run", run if run.is_dir() else run.parent)
    if not (run / "scene.toml").is_file():
        from lwrprobe.bags.recover import recover_bag

        files = recover_bag(run)
        if as_json:
            typer.echo(json.dumps([asdict(file) | {"path": str(file.path)} for file in files]))
            return
        for file in files:
            typer.echo(_line(file.path, file.messages, file.lost, file.reason))
        return
    from lwrprobe.exploration.procedures.recover import recover as make_good

    found = make_good(run)
    if as_json:
        files_found = [asdict(file) | {"path": str(file.path)} for file in found.bag]
        typer.echo(json.dumps(asdict(found) | {"bag": files_found}))
        return
    typer.echo(f"{run}: {found.contacts} contacts")
    for name, count in found.dropped.items():
        if count:
            typer.echo(f"{name}: {count} broken line{'s' if count > 1 else ''} left out")
    for file in found.bag:
        typer.echo(_line(file.path, file.messages, file.lost, file.reason))
    if found.written:
        typer.echo(f"wrote summary, {'map' if found.no_mesh else 'map, mesh'} and report of what is there")
    if found.no_mesh:
        typer.echo(f"no mesh: {found.no_mesh}")
    if found.resumable:
        typer.echo(f"`lwrprobe resume {run}` continues the run")


def _line(path: Path, messages: int, lost: int, reason: str) -> str:
    return f"{path}: {messages} messages" + (f", {lost} bytes left out ({reason})" if reason else "")
