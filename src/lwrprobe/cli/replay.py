"""`lwrprobe replay RUN|BAG`: recorded sensor data through the pipeline again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.shared_options import Json, Settings


def replay(
    source: Annotated[
        Path,
        typer.Argument(
            help="Run folder with a bag, bag folder, or .mcap or .db3 file with standard messages.", show_default=False
        ),
    ],
    strategy: Annotated[
        str | None, typer.Option(metavar="NAME", help="Strategy (see `lwrprobe list strategies`).")
    ] = None,
    estimator: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Contact estimator; repeatable, to compare several.")
    ] = None,
    settings: Settings = None,
    scene: Annotated[
        str | None, typer.Option(metavar="NAME", help="Scene of a bag that was not recorded by lwrprobe.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Run folder to write; with several estimators one in it for each."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Take recorded sensor data through the pipeline again; with the same settings all contacts are the same."""
    from rich.console import Console

    from lwrprobe.cli.checks import check_apart, check_folder, check_input, check_name, check_plugins, check_replaceable
    from lwrprobe.cli.table import print_table
    from lwrprobe.scene import load_scene

    check_input("source", source)
    check_name("strategy", strategy)
    check_folder("--out", out)
    if out is not None:
        check_apart("--out", out, [source])
        several = estimator if estimator and len(estimator) > 1 else [""]
        for folder in [out / name for name in several]:
            check_replaceable("--out", folder, overwrite=True)
    from lwrprobe.runs.replay import replay as run

    changes = [*(settings or []), *([f"strategy.name={json.dumps(strategy)}"] if strategy else [])]
    given = load_scene(scene, check=check_plugins) if scene is not None else None
    found = run(source, scene=given, settings=changes, estimators=estimator or (), out=out)
    if as_json:
        typer.echo(json.dumps([row.as_dict() for row in found]))
        return
    columns = ("estimator", "contacts", "median mm", "95 % mm", "us a sample", "ended")
    cells = [
        (
            row.estimator, str(row.contacts), _mm(row.error_mm, "median"), _mm(row.error_mm, "p95"),
            f"{row.us_sample:.0f}", f"{row.status}: {row.reason}",
        )
        for row in found
    ]  # fmt: skip
    print_table(Console(), f"replay of {source}", columns, cells)
    if any(row.error_mm is not None for row in found):
        typer.echo("errors: distance of the accepted contacts from the surface of the simulated object")
    if out is not None:
        typer.echo(f"run folder: {out}")


def _mm(error: dict[str, float] | None, key: str) -> str:
    return "" if error is None else f"{error[key]:.4f}"
