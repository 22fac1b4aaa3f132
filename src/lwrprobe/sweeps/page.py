"""The page of a sweep: error against run time with the runs that no other one beats, and every row."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.evaluation.charts import Line, line_chart
from lwrprobe.host.whole_file import write_whole
from lwrprobe.sweeps.table import Row

ERRORS = {
    "mesh_aligned_mean_mm": "mesh error aligned, mean, mm",
    "contact_aligned_median_mm": "contact error aligned, median, mm",
}
_COLOURS = "bcd"


def pareto(time: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Indices of the points that no other one beats in both, by growing time."""
    front: list[int] = []
    for k in np.lexsort((error, time)):
        if not front or error[k] < error[front[-1]]:
            front.append(int(k))
    return np.array(front, dtype=np.int64)


def write_page(folder: Path, rows: Sequence[Row], seconds: float) -> Path:
    """sweep.html of the rows of a sweep that took so many seconds; raises StorageError."""
    style = files("lwrprobe.evaluation").joinpath("report.css").read_text(encoding="utf-8")
    done = sum(row["status"] == "done" for row in rows)
    tiles = [("runs", len(rows)), ("done", done), ("not done", len(rows) - done), ("s of computing", f"{seconds:.0f}")]
    cells = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in tiles)
    figures = [figure for scene in dict.fromkeys(row["scene"] for row in rows) for figure in _charts(scene, rows)]
    content = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>sweep · lwrprobe</title><style>\n{style}</style></head>\n<body><main>\n"
        f'<h1>Sweep</h1><p class="lead">Error against run time of {len(rows)} explorations.</p>'
        f'<dl class="tiles">{cells}</dl><h2>Error against run time</h2><div class="grid">{"".join(figures)}</div>'
        f"<h2>Every run</h2>{_table(rows)}</main></body></html>\n"
    )
    path = folder / "sweep.html"
    write_whole(path, content.encode())
    return path


def _charts(scene: str, rows: Sequence[Row]) -> list[str]:
    found = []
    for key, label in ERRORS.items():
        own = [
            row for row in rows if row["scene"] == scene and row[key] is not None and row["robot_time_s"] is not None
        ]
        if not own:
            continue
        time = np.array([row["robot_time_s"] for row in own])
        error = np.array([row[key] for row in own])
        front = pareto(time, error)
        lines = [Line(time[front], error[front], "best for its time", "a")]
        for k, strategy in enumerate(dict.fromkeys(row["strategy"] for row in own)):
            mine = np.array([row["strategy"] == strategy for row in own])
            lines.append(Line(time[mine], error[mine], strategy, _COLOURS[k % len(_COLOURS)], dots=True))
        chart = line_chart(lines, "robot time, s", label)
        found.append(f"<figure>{chart}<figcaption><b>{escape(Path(scene).stem)}</b>, {label}.</figcaption></figure>")
    return found


def _table(rows: Sequence[Row]) -> str:
    if not rows:
        return "<p>No run has ended.</p>"
    head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
    body = "".join(f"<tr>{''.join(f'<td>{_text(value)}</td>' for value in row.values())}</tr>" for row in rows)
    return f'<figure class="scroll"><table><tr>{head}</tr>{body}</table></figure>'


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
