"""`lwrprobe compare RUN RUN`: two runs side by side on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def compare(
    first: Annotated[Path, typer.Argument(help="Run folder.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="Run folder that is compared with it.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Page to write; SECOND/compared.html if left out.")
    ] = None,
) -> None:
    """Write a page with errors, times, forces and deviations of two runs, on one scale."""
    from lwrprobe.cli.checks import check_output, check_run

    check_run("first", first)
    check_run("second", second)
    path = out if out is not None else second / "compared.html"
    check_output("--out", path, (".html",))
    from lwrprobe.evaluation.comparison import write_comparison

    typer.echo(f"wrote {write_comparison(first, second, path)}")
