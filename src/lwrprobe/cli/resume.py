"""`lwrprobe resume RUN`: take up a run that was cut off."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.explore import finish


def resume(
    run: Annotated[
        Path, typer.Argument(help="Folder of a run that was killed, or lost its power.", show_default=False)
    ],
    realtime: Annotated[bool, typer.Option(help="A simulator keeps pace with the wall clock.")] = False,
    confirm: Annotated[int, typer.Option(help="Ask for each of the first so many motions; Enter stops each.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as the last line of output.")] = False,
    quiet: Annotated[bool, typer.Option(help="No progress, no table.")] = False,
) -> None:
    """Go on where the probe was last free, with map, contacts and strategy as they were."""
    from lwrprobe.cli.progress import ProgressLine
    from lwrprobe.exploration.procedures.explore import resume as take_up
    from lwrprobe.exploration.safety.confirm import Confirm

    with ProgressLine(quiet) as line:
        asking = Confirm(confirm, line.tell) if confirm > 0 else None
        summary = take_up(run, realtime=realtime, watch=line.watch, tell=line.tell, confirm=asking)
    finish(summary, run, as_json, quiet)
