"""`lwrprobe film RUN`: a film of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def film(
    run: Annotated[Path, typer.Argument(help="Run folder; with a bag the arm moves as recorded.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Film to write: .gif, .mp4 or .webm; RUN.gif if left out.")
    ] = None,
    seconds: Annotated[float, typer.Option(metavar="S", help="Length of the film.")] = 10.0,
    rate: Annotated[int, typer.Option(metavar="HZ", help="Pictures a second.")] = 12,
    width: Annotated[int, typer.Option(metavar="PIXELS", help="Width of a picture.")] = 640,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show no progress.")] = False,
) -> None:
    """Film the arm exploring and the mesh growing, with error and time."""
    from lwrprobe.cli.bar import StageBar
    from lwrprobe.cli.checks import beside, check_folder, check_run

    check_run("run", run)
    target = out if out is not None else beside(run, ".gif")
    check_folder("--out", target.parent)
    from lwrprobe.views.film import write_film

    with StageBar(quiet) as bar:
        path = write_film(
            run, target, seconds=seconds, rate=rate, width=width, watch=lambda done, of: bar("drawing", done / of)
        )
    typer.echo(f"wrote {path}, {path.stat().st_size / 1e6:.2f} MB", err=True)
