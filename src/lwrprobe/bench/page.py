"""The Markdown page of a bench: three sentences, a short table, and each full table as a CSV file beside the page."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lwrprobe.bench.report import BenchReport, Table, cell_text

COLUMNS = 8
"""Most columns of a table on a page."""
ROWS = 16
"""Most rows of a table on a page, below the summary."""
NAMED = 4
"""Most requirements that are named as not met in the text above the tables."""


class _Missing(LookupError):
    """A figure that a sentence needs was not measured, for example without one of the other libraries."""


@dataclass(slots=True, frozen=True)
class Figures:
    """Cells of a report by the begin of a table's title, the begin of a row, and a column."""

    report: BenchReport

    def cell(self, title: str, row: str | tuple[str, ...], column: str) -> str:
        """The cell as text; raises LookupError where there is none."""
        table = self.table(title)
        start = (row,) if isinstance(row, str) else row
        for cells in table.rows:
            if tuple(map(cell_text, cells[: len(start)])) == start and column in table.columns:
                text = cell_text(cells[table.columns.index(column)])
                if text != "-":
                    return text
        raise _Missing(f"{title}, {start}, {column}")

    def table(self, title: str) -> Table:
        """The first table whose title begins so; raises LookupError where there is none."""
        for table in self.report.tables:
            if table.title.startswith(title):
                return table
        raise _Missing(title)

    def count(self, title: str, column: str, value: str) -> str:
        """How many rows of how many have that value, as `3 of 4`."""
        table = self.table(title)
        cells = [cell_text(row[table.columns.index(column)]) for row in table.rows]
        return f"{cells.count(value)} of {len(cells)}"

    def measured(self, requirement: str) -> str:
        """What was measured for the first requirement that begins so."""
        for verdict in self.report.verdicts:
            if verdict.requirement.startswith(requirement):
                return verdict.measured
        raise _Missing(requirement)


@dataclass(slots=True, frozen=True)
class Summary:
    """What the page of one bench says first.

    Attributes
    ----------
    table : begin of the title of the table that is shown as the summary
    columns : those of its columns that are shown; empty for all
    subject : a sentence on what was compared
    result : makes the sentence on what was found
    """

    table: str
    columns: tuple[str, ...]
    subject: str
    result: Callable[[Figures], str]


SUMMARIES = {
    "start": Summary(
        "Time of exploring",
        ("start", "wall s", "processor s", "of it second process", "kernels"),
        "An exploration was started with an empty kernel cache, and once more with the cache that this left behind.",
        lambda f: (
            f"The cold start took {f.cell('Time of exploring', 'cold', 'wall s')} s and "
            f"{f.cell('Time of exploring', 'cold', 'processor s')} s of processor time, the warm one "
            f"{f.cell('Time of exploring', 'warm', 'wall s')} s and "
            f"{f.cell('Time of exploring', 'warm', 'processor s')} s."
        ),
    ),
    "kinematics": Summary(
        "Tracking",
        (),
        "Forward and inverse kinematics of the LWR 4+ were timed beside other libraries, and each answer was checked.",
        lambda f: (
            f"While tracking, an inverse solution of lwrprobe takes {f.cell('Tracking', 'lwrprobe', 'median [us]')} us "
            f"in the median and {f.cell('Tracking', 'lwrprobe', 'success [%]')} % succeed; a forward solution takes "
            f"{f.cell('Forward', 'lwrprobe', 'tip [us]')} us."
        ),
    ),
    "trajectory": Summary(
        "Time of one call",
        (),
        "The jerk-limited generators were timed beside bare Ruckig and their goals were changed at random moments.",
        lambda f: (
            f"A step of the joint generator takes "
            f"{f.cell('Time of one', ('step', 'JointTrajectory, 7 joints'), 'median [us]')} us and a step of the "
            f"Cartesian one {f.cell('Time of one', ('step', 'CartesianTrajectory'), 'median [us]')} us in the median."
        ),
    ),
    "contact": Summary(
        "Sliding at 1 N, against friction",
        (),
        "The contact estimators were given simulated wrenches with friction, sensor noise and further errors.",
        lambda f: (
            f"At friction 0.3 and 1 N the median error of the contact point is "
            f"{f.cell('Sliding at 1 N, against', ('0.3', 'fused'), 'point mm')} mm for `fused`, "
            f"{f.cell('Sliding at 1 N, against', ('0.3', 'wrench_axis'), 'point mm')} mm for `wrench_axis` and "
            f"{f.cell('Sliding at 1 N, against', ('0.3', 'force_direction'), 'point mm')} mm for `force_direction`."
        ),
    ),
    "simulation": Summary(
        "Cost of a cycle",
        (),
        "The contact model of the simulator was compared with a finely integrated reference and with MuJoCo.",
        lambda f: (
            f"The largest error of the normal force is {f.measured('normal force error')}; forces differ from those of "
            f"MuJoCo by at most {f.measured('forces within')}."
        ),
    ),
    "mapping": Summary(
        "100000 voxels",
        (),
        "Insertion, look-up and files of the voxel map were timed beside two Python bindings of OctoMap.",
        lambda f: (
            f"One insertion takes {f.cell('100000', 'insert one', 'lwrprobe')} us, in a batch "
            f"{f.cell('100000', 'insert batch', 'lwrprobe')} us a point; the faster binding takes "
            f"{f.cell('100000', 'insert one', 'best peer / lwrprobe')} and "
            f"{f.cell('100000', 'insert batch', 'best peer / lwrprobe')} times as long."
        ),
    ),
    "clearance": Summary(
        "us a query",
        ("voxels", "lwrprobe median", "lwrprobe p99", "python-fcl median", "python-fcl p99", "coal median", "coal p99"),
        "The distance between the links of the arm and the nearest voxel was asked for at 200 poses.",
        lambda f: (
            f"With 100000 voxels a query takes {f.cell('us a query', '100000', 'lwrprobe median')} us in the median; "
            f"coal takes {f.cell('Times as long', '100000', 'coal median')} times and python-fcl "
            f"{f.cell('Times as long', '100000', 'python-fcl median')} times as long."
        ),
    ),
    "reconstruction": Summary(
        "Lines 10 mm apart, explored",
        (),
        "Objects were reconstructed from their contacts by the methods of lwrprobe and of other libraries.",
        lambda f: (
            f"From explored lines 10 mm apart, `contact_surface` has a mean error of "
            f"{f.cell('Lines 10 mm apart, explored', 'contact_surface', 'mean mm')} mm and a largest error of "
            f"{f.cell('Lines 10 mm apart, explored', 'contact_surface', 'max mm')} mm in the median over the objects, "
            f"the convex hull {f.cell('Lines 10 mm apart, explored', 'convex_hull', 'mean mm')} mm and "
            f"{f.cell('Lines 10 mm apart, explored', 'convex_hull', 'max mm')} mm."
        ),
    ),
    "exploration": Summary(
        "Medians over scenes and seeds",
        ("strategy", "profile", "done", "contact mm", "p95 mm", "coverage", "mesh mm", "times bound"),
        "The strategies explored objects with several seeds, with lwrprobe's settings and with those of the thesis.",
        lambda f: (
            f"With `grid_version` the median contact error is "
            f"{f.cell('Medians', ('grid_version', 'default'), 'contact mm')} mm with lwrprobe's settings and "
            f"{f.cell('Medians', ('grid_version', 'thesis'), 'contact mm')} mm with those of the thesis; the runs take "
            f"{f.cell('Medians', ('grid_version', 'default'), 'times bound')} and "
            f"{f.cell('Medians', ('grid_version', 'thesis'), 'times bound')} times the lower bound of the time."
        ),
    ),
    "stability": Summary(
        "Cases",
        (),
        "Stiff and extreme cases were run, each with several settings.",
        lambda f: f"{f.count('Cases', 'outcome', 'pass')} cases pass.",
    ),
    "reality": Summary(
        "One departure at a time",
        (
            "the world differs by",
            "status",
            "peak N",
            "contact median mm",
            "contact p95 mm",
            "mesh mean mm",
            "coverage",
            "warnings",
        ),
        "The simulated world was made to differ from what the scene says of it, one departure at a time.",
        lambda f: (
            f"Runs that came to their end: {f.measured('status done')}; runs in which the probe pressed with at most "
            f"3 N: {f.measured('true peak')}."
        ),
    ),
    "physics": Summary(
        "grid_version",
        ("scene", "world", "status", "peak N", "contact median mm", "contact p95 mm", "mesh mean mm", "coverage"),
        "The same explorations were run in two simulated worlds, `sim` and MuJoCo's.",
        lambda f: (
            f"With a light arm in MuJoCo's world: {f.measured('status done: mujoco, arm of 1 kg')} done, "
            f"{f.measured('true peak force <= 3 N: mujoco, arm of 1 kg')} with at most 3 N. With an arm of 16 kg: "
            f"{f.measured('status done: mujoco, arm of 16 kg')} done, "
            f"{f.measured('true peak force <= 3 N: mujoco, arm of 16 kg')} with at most 3 N."
        ),
    ),
    "budget": Summary(
        "Share inside",
        (),
        "The contacts of one run were moved by the departures of many drawn worlds, and held against the error budget.",
        lambda f: (
            f"Inside the stated 95 % region: {f.measured('absolute')} of the errors, and {f.measured('after')} after "
            "alignment."
        ),
    ),
    "calibration": Summary(
        "All draws",
        (),
        "Probe, sensor and arm were calibrated on a reference sphere in worlds drawn from the profile `datasheet`.",
        lambda f: "Each quantity stands with its largest error and with how often it was within its limit.",
    ),
    "shapes": Summary(
        "The ",
        ("no.", "object", "strategy", "mesh mm", "times the best", "coverage", "times bound", "what went wrong"),
        "Random objects were explored that no setting was tuned for, and judged with distances made by trimesh.",
        lambda f: (
            f"Done: {f.measured('done')} runs; mesh no worse than the best other method by more than a tenth: "
            f"{f.measured('mesh no worse')}."
        ),
    ),
    "faults": Summary(
        "What the run does",
        ("fault", "ended", "exit code", "moved on mm", "peak N", "touches", "sentence"),
        "Each fault of the arm and the sensor was caused while the probe followed a contour, over real sockets.",
        lambda f: (
            f"The run ended by itself in {f.count('What the run does', 'ended', 'by itself')} cases and went on in "
            f"{f.count('What the run does', 'ended', 'goes on')}."
        ),
    ),
    "stalls": Summary(
        "What became of each run",
        (
            "disturbance",
            "scene",
            "status",
            "true peak N",
            "contact error RMS mm",
            "late set points %",
            "halts",
            "re-entries",
            "gaps",
        ),
        "Whole explorations ran over real sockets while the host was kept busy, or processes were halted.",
        lambda f: f"Runs that came to their end: {f.count('What became of each run', 'status', 'done')}.",
    ),
    "kills": Summary(
        "Resumed",
        (),
        "Recorded runs were killed at random times, their folders recovered and read, and some of them resumed.",
        lambda f: (
            f"Folders that could not be read: {f.measured('no folder')}; runs that were done after they were resumed: "
            f"{f.measured('resumed runs')}."
        ),
    ),
    "endurance": Summary(
        "The process",
        (),
        "Explorations ran back to back in one process.",
        lambda f: f"Explorations that were done: {f.measured('all explorations')}.",
    ),
    "loop": Summary(
        "Compute, jitter",
        (),
        "The control loop answered an emulated controller at several cycle times.",
        lambda f: (
            f"At a cycle of 10 ms the result was: {f.measured('answers in time')}. At least 99 % of the answers "
            f"were in time down to a cycle of {f.cell('Shortest', '99 %', 'cycle ms')} ms."
        ),
    ),
}


def sentences(report: BenchReport) -> str:
    """What the bench compared, what it found, and how many requirements are met."""
    said = []
    summary = SUMMARIES.get(report.name)
    if summary is not None:
        said.append(summary.subject)
        try:
            said.append(summary.result(Figures(report)))
        except _Missing:
            said.append("Some libraries or settings of the comparison were left out of this run.")
    missed = [verdict.requirement for verdict in report.verdicts if not verdict.held]
    if report.verdicts:
        text = f"{len(report.verdicts) - len(missed)} of {len(report.verdicts)} requirements are met"
        if missed:
            text += f"; not met: {'; '.join(missed[:NAMED])}"
        if len(missed) > NAMED:
            text += f"; and {len(missed) - NAMED} more"
        said.append(f"{text}.")
    return "\n".join(said)


def markdown(report: BenchReport) -> str:
    """The whole page."""
    summary = _summary(report)
    lines = [f"# {report.title}", "", sentences(report), "", *_grid(*summary[:2])]
    lines += ["", f"Written by `lwrprobe bench {report.name}` on {report.date}: "]
    lines[-1] += ", ".join(f"{key} {value}" for key, value in report.machine.items()) + "."
    lines += ["", "## Tables"]
    for number, table in enumerate(report.tables, 1):
        size = f"{len(table.rows)} rows, {len(table.columns)} columns"
        lines += ["", f"### {table.title}", "", f"[Full table as CSV]({report.name}-{number}.csv) ({size})"]
        if len(table.columns) <= COLUMNS and len(table.rows) <= ROWS and table is not summary[2]:
            lines += ["", *_grid(table.columns, table.rows)]
    if report.verdicts:
        rows = [[v.requirement, v.measured, "yes" if v.held else "**no**"] for v in report.verdicts]
        lines += ["", "## Requirements", "", *_grid(["requirement", "measured", "met"], rows)]
    if report.notes:
        lines += ["", "## Notes", "", *(f"- {note}" for note in report.notes)]
    lines += [line for stem in report.figures for line in ("", f"![{stem}]({report.name}-{stem}.png)")]
    return "\n".join(lines) + "\n"


def _summary(report: BenchReport) -> tuple[list[str], list[list[Any]], Table | None]:
    """Columns and rows of the first table on the page, and the table when it is shown whole."""
    chosen = SUMMARIES.get(report.name)
    starts = chosen.table if chosen is not None else ""
    table = next((table for table in report.tables if table.title.startswith(starts)), None)
    if table is None:
        return [], [], None
    wanted = chosen.columns if chosen is not None and chosen.columns else tuple(table.columns)
    kept = [n for n, column in enumerate(table.columns) if column in wanted][:COLUMNS]
    rows = [[row[n] for n in kept] for row in table.rows]
    return [table.columns[n] for n in kept], rows, table if len(kept) == len(table.columns) else None


def _grid(columns: list[str], rows: list[list[Any]]) -> list[str]:
    if not columns:
        return []
    lines = ["| " + " | ".join(column or " " for column in columns) + " |", "|" + "---|" * len(columns)]
    return lines + ["| " + " | ".join(cell_text(cell) for cell in row) + " |" for row in rows]


def write_csv(report: BenchReport, out: Path) -> list[Path]:
    """Each table with all columns, numbers in full precision, into `out`; the files."""
    written = []
    for number, table in enumerate(report.tables, 1):
        path = out / f"{report.name}-{number}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(table.columns)
            writer.writerows(table.rows)
        written.append(path)
    return written
