"""`lwrprobe sweep FILE.toml`: many explorations on all cores or on a cluster."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def sweep(
    file: Annotated[Path, typer.Argument(help="Sweep file: lists of scenes, strategies, seeds.", show_default=False)],
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Folder to write; runs/FILE if left out.")] = None,
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Processes; as many as cores if left out.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler (tcp://host:port) whose workers do the work."),
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Forget the runs that the folder has already.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show no progress.")] = False,
) -> None:
    """Explore scenes x strategies x settings x seeds; a sweep that was cut off goes on where it was."""
    from lwrprobe.cli.bar import StageBar
    from lwrprobe.cli.checks import check_folder, check_input

    check_input("file", file)
    folder = out if out is not None else Path("runs") / file.stem
    check_folder("--out", folder)
    from lwrprobe.sweeps.sweep import sweep as run

    with StageBar(quiet) as bar:
        bar("compiling kernels", 0.0)
        found = run(
            file, folder, workers=jobs, scheduler=scheduler, restart=restart,
            watch=lambda done, of, name: bar(f"{done} of {of} runs: {name}", done / of),
        )  # fmt: skip
    if as_json:
        typer.echo(json.dumps(found.rows))
    failed = [row for row in found.rows if row["status"] != "done"]
    if not quiet:
        typer.echo(f"{len(found.rows)} runs, {found.known} of them done before, {len(failed)} not done", err=True)
        for row in failed[:10]:
            name = f"{Path(row['scene']).stem}, {row['strategy']}, seed {row['seed']}"
            typer.echo(f"  {name}: {row['status']}: {row['reason']}", err=True)
        for path in found.files:
            typer.echo(f"wrote {path}", err=True)
    if failed:
        raise typer.Exit(1)
