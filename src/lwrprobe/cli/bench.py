"""`lwrprobe bench NAME`: error against run time, side by side with the installed peers."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from lwrprobe.bench.report import BenchReport


def bench(
    name: Annotated[str, typer.Argument(help="Which bench; `lwrprobe list benches` names them.")],
    json_file: Annotated[Path | None, typer.Option("--json", help="Write all figures to this JSON file.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write a Markdown page and PNG figures into this folder.")] = None,
    quick: Annotated[bool, typer.Option(help="A shorter run, within a minute.")] = False,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value of the bench, repeatable.")] = None,
    case: Annotated[int | None, typer.Option(help="Only this case (bench stability).")] = None,
) -> None:
    """Measure one part beside its peers and hold the figures against the promises."""
    from rich.console import Console

    from lwrprobe.bench import BENCHES
    from lwrprobe.contracts import InputError, UnknownNameError

    if name not in BENCHES:
        raise UnknownNameError("bench", name, BENCHES)
    options = {}
    for setting in settings or []:
        key, equals, value = setting.partition("=")
        if not equals:
            raise InputError("--set", setting, "key=value")
        options[key] = value
    if case is not None:
        options["case"] = str(case)
    report = import_module(BENCHES[name]).run(quick, options)
    _show(report, Console())
    for path in report.write(json_file, out):
        typer.echo(f"wrote {path}", err=True)


def _show(report: BenchReport, console: Console) -> None:
    from rich.table import Table

    from lwrprobe.bench.report import cell_text

    console.print(f"[bold]{report.title}[/bold]")
    for table in report.tables:
        grid = Table(*table.columns, title=table.title, title_justify="left")
        for row in table.rows:
            grid.add_row(*(cell_text(cell) for cell in row))
        console.print(grid)
    for verdict in report.verdicts:
        mark = "[green]held[/green]" if verdict.held else "[red]SHORT[/red]"
        console.print(f"{mark}  {verdict.promise}: {verdict.measured}", highlight=False)
    for note in report.notes:
        console.print(f"- {note}", highlight=False, markup=False)
