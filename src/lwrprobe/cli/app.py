"""The command line's entry: the table of commands, and one way out for every error.

Exit codes: 0 done, 1 a run ended early with its data kept, 2 bad input.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer

import lwrprobe
from lwrprobe.cli import (
    bench,
    doctor,
    emulate,
    evaluate,
    explore,
    listing,
    map_file,
    merge,
    reconstruct,
    repeat,
    report,
    resume,
    weigh,
)
from lwrprobe.errors import LwrprobeError

app = typer.Typer(
    name="lwrprobe",
    help="Blind shape detection by touch: explore an unseen object, map it, mesh it.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command("explore")(explore.explore)
app.command("resume")(resume.resume)
app.command("reconstruct")(reconstruct.reconstruct)
app.command("fit")(reconstruct.fit)
app.command("evaluate")(evaluate.evaluate)
app.command("report")(report.report)
app.command("merge")(merge.merge)
app.command("list")(listing.list_names)
app.command("doctor")(doctor.doctor)
app.command("weigh")(weigh.weigh)
app.command("repeat")(repeat.repeat)
app.command("bench")(bench.bench)
app.command(
    "emulate",
    add_help_option=False,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)(emulate.emulate)
app.add_typer(map_file.app, name="map")


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
    try:
        app()
    except LwrprobeError as error:
        typer.echo(f"lwrprobe: {error}", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        typer.echo("lwrprobe: interrupted", err=True)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)
