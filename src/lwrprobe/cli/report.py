"""`lwrprobe report RUN`: the page of a run, made again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(
    run: Annotated[Path, typer.Argument(help="A run folder, complete or cut short.")],
) -> None:
    """Write report.html into a run folder: pictures, errors, forces, times, and how to repeat the run."""
    from lwrprobe.evaluation.run_report import write_report

    typer.echo(f"wrote {write_report(run)}")
