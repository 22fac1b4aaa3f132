"""`lwrprobe report RUN`: write the report of a run again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(
    run: Annotated[Path, typer.Argument(help="Run folder, complete or interrupted.")],
) -> None:
    """Write report.html into a run folder: pictures, errors, forces, times, and how to repeat the run."""
    from lwrprobe.cli.checks import check_folder, check_run

    check_run("run", run)
    check_folder("run", run)
    from lwrprobe.evaluation.run_report import write_report

    typer.echo(f"wrote {write_report(run)}")
