"""`lwrprobe resume RUN`: continue a run that was cut off."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.explore import finish
from lwrprobe.cli.shared_options import Confirmed, Quiet, Realtime, SummaryJson


def resume(
    run: Annotated[
        Path, typer.Argument(help="Run folder of a run that was killed or lost its power.", show_default=False)
    ],
    realtime: Realtime = False,
    confirm: Confirmed = 0,
    as_json: SummaryJson = False,
    quiet: Quiet = False,
) -> None:
    """Continue an interrupted run from where the probe was last free; map, contacts and strategy are restored."""
    from lwrprobe.cli.checks import check_plugins, check_run
    from lwrprobe.runs.progress import ProgressLine
    from lwrprobe.scene import load_scene

    check_run("run", run)
    load_scene(run / "scene.toml", check=check_plugins)
    from lwrprobe.exploration.procedures.explore import resume as take_up
    from lwrprobe.exploration.safety.confirm import Confirm

    with ProgressLine(quiet) as line:
        asking = Confirm(confirm, line.message) if confirm > 0 else None
        summary = take_up(run, realtime=realtime, watch=line.watch, message=line.message, confirm=asking)
    finish(summary, run, as_json, quiet)
