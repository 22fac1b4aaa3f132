"""The command line's entry: the table of commands, and one way out for every error.

Exit codes: 0 done, 1 a run ended early with its data kept, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import _thread
import sys
from threading import Timer
from typing import Annotated

import typer

import lwrprobe
from lwrprobe.cli import (
    bench,
    calibrate,
    compare,
    doctor,
    emulate,
    evaluate,
    explore,
    film,
    listing,
    map_file,
    merge,
    reconstruct,
    recover,
    repeat,
    replay,
    report,
    rescan,
    resume,
    sweep,
    view,
)
from lwrprobe.cli.help_page import Command, Group
from lwrprobe.errors import DriverError, LwrprobeError, PluginError, StorageError, UnknownNameError

app = typer.Typer(
    name="lwrprobe",
    cls=Group,
    help="Blind shape detection by touch: explore an unseen object, map it, mesh it.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command("explore", cls=Command)(explore.explore)
app.command("resume", cls=Command)(resume.resume)
app.command("recover", cls=Command)(recover.recover)
app.command("replay", cls=Command)(replay.replay)
app.command("rescan", cls=Command)(rescan.rescan)
app.command("reconstruct", cls=Command)(reconstruct.reconstruct)
app.command("fit", cls=Command)(reconstruct.fit)
app.command("evaluate", cls=Command)(evaluate.evaluate)
app.command("report", cls=Command)(report.report)
app.command("compare", cls=Command)(compare.compare)
app.command("view", cls=Command)(view.view)
app.command("film", cls=Command)(film.film)
app.command("merge", cls=Command)(merge.merge)
app.command("sweep", cls=Command)(sweep.sweep)
app.command("list", cls=Command)(listing.list_names)
app.command("doctor", cls=Command)(doctor.doctor)
app.command("calibrate", cls=Command)(calibrate.calibrate)
app.command("repeat", cls=Command)(repeat.repeat)
app.command("bench", cls=Command)(bench.bench)
app.add_typer(emulate.app, name="emulate")
app.add_typer(map_file.app, name="map")

INTERRUPTED = 130
"""Exit code, that of the shell for SIGINT."""

LISTED = {
    "scene": "scenes",
    "profile": "profiles",
    "strategy": "strategies",
    "driver": "drivers",
    "robot": "robots",
    "reconstructor": "reconstructors",
    "emulator": "emulators",
    "bench": "benches",
}
"""By the kind of an unknown name: what `lwrprobe list` calls all of that kind."""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lwrprobe {lwrprobe.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None: ...


def main() -> None:
    """Run the command line; a known error becomes one sentence and exit code 2."""
    sys.unraisablehook = _deliver_interrupt
    try:
        app()
    except LwrprobeError as error:
        typer.echo(f"lwrprobe: {error}{_next_step(error)}", err=True)
        sys.exit(1 if isinstance(error, StorageError) else 2)
    except SystemExit as end:
        if end.code == INTERRUPTED:  # typer's answer to Ctrl-C
            typer.echo("lwrprobe: interrupted; what was written so far is kept", err=True)
        raise
    except BrokenPipeError:
        sys.exit(1)


def _deliver_interrupt(raised: sys.UnraisableHookArgs) -> None:
    """Raise Ctrl-C again that fell into a finaliser, where Python would drop it with a traceback.

    It is raised a moment later: at once it would fall into this function.
    """
    if issubclass(raised.exc_type, KeyboardInterrupt):
        again = Timer(0.02, _thread.interrupt_main)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(raised)


def _next_step(error: LwrprobeError) -> str:
    """What to do about an error, where its own sentence cannot know the command."""
    if isinstance(error, UnknownNameError) and error.kind in LISTED:
        return f"; `lwrprobe list {LISTED[error.kind]}` describes each"
    if isinstance(error, PluginError):
        return "; `lwrprobe doctor` shows the state of every plug-in"
    if isinstance(error, DriverError):
        return "; `lwrprobe doctor --arm NAME --sensor NAME` checks the devices without moving anything"
    return ""
