"""`lwrprobe bench NAME`: error against run time, beside the installed peer libraries."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lwrprobe.cli.shared_options import key_values

if TYPE_CHECKING:
    from rich.console import Console

    from lwrprobe.bench.report import BenchReport


def bench(
    name: Annotated[str, typer.Argument(help="Benchmark (see `lwrprobe list benches`).")],
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all figures into this JSON file.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write a Markdown page, the tables and the pictures into this folder."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A shorter run, at most a minute.")] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change one value of the benchmark; repeatable."),
    ] = None,
    case: Annotated[int | None, typer.Option(metavar="N", help="Run this case alone (bench stability).")] = None,
) -> None:
    """Measure one part beside peer libraries and compare the figures with the stated limits."""
    from rich.console import Console

    from lwrprobe.bench import BENCHES
    from lwrprobe.cli.checks import check_folder, check_output
    from lwrprobe.errors import UnknownNameError

    if name not in BENCHES:
        raise UnknownNameError("bench", name, BENCHES)
    check_output("--json", json_file)
    check_folder("--out", out)
    options = key_values(settings)
    if case is not None:
        options["case"] = str(case)
    report = import_module(BENCHES[name]).run(quick, options)
    show(report, Console())
    for path in report.write(json_file, out):
        typer.echo(f"wrote {path}", err=True)


def show(report: BenchReport, console: Console) -> None:
    """Print title, tables, verdicts and notes, each text as it is."""
    from rich.text import Text

    from lwrprobe.bench.report import cell_text
    from lwrprobe.cli.table import print_table

    console.print(Text(report.title, style="bold"))
    for table in report.tables:
        print_table(console, table.title, table.columns, [[cell_text(cell) for cell in row] for row in table.rows])
    for verdict in report.verdicts:
        mark = Text("held  ", style="green") if verdict.held else Text("missed", style="red")
        console.print(Text.assemble(mark, f"  {verdict.requirement}: {verdict.measured}"))
    for note in report.notes:
        console.print(Text(f"- {note}"))
