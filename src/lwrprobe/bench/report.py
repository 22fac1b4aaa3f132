"""What every bench returns, and how it is shown: tables on screen, JSON, Markdown, CSV, PNG."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

from lwrprobe.host.whole_file import write_whole


@dataclass(slots=True)
class Table:
    """A titled table; cells are numbers or text, None where there is nothing to say."""

    title: str
    columns: list[str]
    rows: list[list[Any]]


@dataclass(slots=True)
class Verdict:
    """One requirement held against what was measured."""

    requirement: str
    measured: str
    held: bool


@dataclass(slots=True)
class BenchReport:
    """One bench's outcome.

    `figures` maps a file stem to a function that draws on a fresh matplotlib `Figure`; `data` is what `--json`
    writes besides the tables.
    """

    name: str
    title: str
    tables: list[Table] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    figures: dict[str, Callable[[Any], None]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    data: dict[str, Any] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)
    date: str = field(default_factory=lambda: datetime.now(UTC).strftime("%Y-%m-%d"))

    def table(self, title: str, columns: list[str] | str, rows: list[list[Any]]) -> None:
        """Add a table; its columns as a list, or in one text with bars between them."""
        self.tables.append(Table(title, columns.split(" | ") if isinstance(columns, str) else columns, rows))

    def records(self, title: str, columns: Mapping[str, str], found: Iterable[Mapping[str, Any]]) -> None:
        """Add a table of records, a row each; `columns` names the key of each column."""
        self.table(title, list(columns), [[record.get(key) for key in columns.values()] for record in found])

    def require(self, requirement: str, measured: str, held: bool) -> None:
        """Add a verdict."""
        self.verdicts.append(Verdict(requirement, measured, bool(held)))

    def as_dict(self) -> dict[str, Any]:
        """JSON-able content."""
        return {
            "bench": self.name,
            "title": self.title,
            "date": self.date,
            "machine": self.machine,
            "tables": [{"title": t.title, "columns": t.columns, "rows": t.rows} for t in self.tables],
            "verdicts": [{"requirement": v.requirement, "measured": v.measured, "held": v.held} for v in self.verdicts],
            "notes": self.notes,
            **self.data,
        }

    def as_markdown(self) -> str:
        """The page that goes into docs/bench: three sentences, a short table, requirements, pictures."""
        from lwrprobe.bench.page import markdown

        return markdown(self)

    def write(self, json_file: Path | None = None, out: Path | None = None) -> list[Path]:
        """Write JSON to `json_file`, Markdown, CSV and PNG into `out`; returns what was written.

        Raises StorageError naming the file that cannot be written.
        """
        written = []
        if json_file is not None:
            write_whole(json_file, (json.dumps(self.as_dict(), indent=1, default=float) + "\n").encode())
            written.append(json_file)
        if out is not None:
            from lwrprobe.bench.page import write_csv

            page = out / f"{self.name}.md"
            write_whole(page, self.as_markdown().encode())
            written += [page, *write_csv(self, out)]
            written += [self._draw(stem, out) for stem in self.figures]
        return written

    def _draw(self, stem: str, out: Path) -> Path:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 5.5), dpi=130, layout="constrained")
        FigureCanvasAgg(figure)
        self.figures[stem](figure)
        path, png = out / f"{self.name}-{stem}.png", BytesIO()
        figure.savefig(png)
        write_whole(path, png.getvalue())
        return path


def cell_text(cell: Any) -> str:
    """A table cell as text: four significant digits, a dash for nothing."""
    if cell is None:
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float):
        return f"{cell:.4g}"
    return str(cell)
