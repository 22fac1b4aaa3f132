"""The Markdown page of a bench: three sentences, a short table, and each full table as a CSV file beside the page."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

from lwrprobe.bench.report import BenchReport, Table, cell_text
from lwrprobe.host.whole_file import write_whole

COLUMNS = 8
"""Most columns of a table on a page."""
ROWS = 16
"""Most rows of a table on a page, below the summary."""
NAMED = 4
"""Most requirements that are named as not met in the text above the tables."""


class _Missing(LookupError):
    """A figure that a sentence needs was not measured, for example without one of the other libraries."""


@dataclass(slots=True, frozen=True)
class Summary:
    """What the page of one bench says first.

    Attributes
    ----------
    table : begin of the title of the table that is shown as the summary
    subject : a sentence on what was compared
    result : the sentence on what was found, with figures in braces: `{title|row|column}` a cell, by the begin of a
        table's title and the begin of a row, whose cells stand between semicolons; `{count: title|column|value}` how
        many rows have a value; `{measured: requirement}` what was measured for the first one that begins so
    columns : those of the table that are shown, separated by commas; empty for all
    """

    table: str
    subject: str
    result: str
    columns: str = ""

    def sentence(self, report: BenchReport) -> str:
        """`result` with its figures; raises LookupError where one was not measured."""
        return re.sub(r"\{(.*?)\}", lambda found: _figure(report, found[1]), self.result)


def _figure(report: BenchReport, wanted: str) -> str:
    """What one pair of braces of `Summary.result` stands for."""
    kind, _, name = wanted.partition(": ")
    if kind == "measured":
        return _first([v.measured for v in report.verdicts if v.requirement.startswith(name)], wanted)
    title, *place = (name if kind == "count" else wanted).split("|")
    table = _first([table for table in report.tables if table.title.startswith(title)], wanted)
    if kind == "count":
        column, value = place
        cells = [cell_text(row[table.columns.index(column)]) for row in table.rows]
        return f"{cells.count(value)} of {len(cells)}"
    start, column = place[0].split(";"), place[1]
    if column not in table.columns:
        raise _Missing(wanted)
    rows = [row for row in table.rows if [cell_text(cell) for cell in row[: len(start)]] == start]
    return _first([text for row in rows if (text := cell_text(row[table.columns.index(column)])) != "-"], wanted)


Found = TypeVar("Found")


def _first(found: list[Found], wanted: str) -> Found:
    if not found:
        raise _Missing(wanted)
    return found[0]


SUMMARIES = {
    "start": Summary(
        "Time of exploring",
        "An exploration was started with an empty kernel cache, and once more with the cache that this left behind.",
        "The cold start took {Time of exploring|cold|wall s} s and {Time of exploring|cold|processor s} s of processor "
        "time, the warm one {Time of exploring|warm|wall s} s and {Time of exploring|warm|processor s} s.",
        "start, wall s, processor s, of it second process, kernels",
    ),
    "kinematics": Summary(
        "Tracking",
        "Forward and inverse kinematics of the LWR 4+ were timed beside other libraries, and each answer was checked.",
        "While tracking, an inverse solution of lwrprobe takes {Tracking|lwrprobe|median [us]} us in the median and "
        "{Tracking|lwrprobe|success [%]} % succeed; a forward solution takes {Forward|lwrprobe|tip [us]} us.",
    ),
    "trajectory": Summary(
        "Time of one call",
        "The jerk-limited generators were timed beside bare Ruckig and their goals were changed at random moments.",
        "A step of the joint generator takes {Time of one|step;JointTrajectory, 7 joints|median [us]} us and a step of "
        "the Cartesian one {Time of one|step;CartesianTrajectory|median [us]} us in the median.",
    ),
    "contact": Summary(
        "Sliding at 1 N, against friction",
        "The contact estimators were given simulated wrenches with friction, sensor noise and further errors.",
        "At friction 0.3 and 1 N the median error of the contact point is "
        "{Sliding at 1 N, against|0.3;fused|point mm} mm for `fused`, "
        "{Sliding at 1 N, against|0.3;wrench_axis|point mm} mm for `wrench_axis` and "
        "{Sliding at 1 N, against|0.3;force_direction|point mm} mm for `force_direction`.",
    ),
    "simulation": Summary(
        "Cost of a cycle",
        "The contact model of the simulator was compared with a finely integrated reference and with MuJoCo.",
        "The largest error of the normal force is {measured: normal force error}; forces differ from those of MuJoCo "
        "by at most {measured: forces within}.",
    ),
    "mapping": Summary(
        "100000 voxels",
        "Insertion, look-up and files of the voxel map were timed beside two Python bindings of OctoMap.",
        "One insertion takes {100000|insert one|lwrprobe} us, in a batch {100000|insert batch|lwrprobe} us a point; "
        "the faster binding takes {100000|insert one|best peer / lwrprobe} and "
        "{100000|insert batch|best peer / lwrprobe} times as long.",
    ),
    "clearance": Summary(
        "us a query",
        "The distance between the links of the arm and the nearest voxel was asked for at 200 poses.",
        "With 100000 voxels a query takes {us a query|100000|lwrprobe median} us in the median; coal takes "
        "{Times as long|100000|coal median} times and python-fcl {Times as long|100000|python-fcl median} times as "
        "long.",
        "voxels, lwrprobe median, lwrprobe p99, python-fcl median, python-fcl p99, coal median, coal p99",
    ),
    "reconstruction": Summary(
        "Lines 10 mm apart, explored",
        "Objects were reconstructed from their contacts by the methods of lwrprobe and of other libraries.",
        "From explored lines 10 mm apart, `contact_surface` has a mean error of "
        "{Lines 10 mm apart, explored|contact_surface|mean mm} mm and a largest error of "
        "{Lines 10 mm apart, explored|contact_surface|max mm} mm in the median over the objects, the convex hull "
        "{Lines 10 mm apart, explored|convex_hull|mean mm} mm and "
        "{Lines 10 mm apart, explored|convex_hull|max mm} mm.",
    ),
    "certificate": Summary(
        "Bumps of one to three",
        "Random objects were explored by a perfect sphere, and balls larger than certified were hidden on them.",
        "On lines both ways the certified diameter is {Bumps of one|lines both ways|certified mm} mm in the median, "
        "and the largest ball that hides has {Bumps of one|lines both ways|largest hidden mm} mm.",
    ),
    "planning": Summary(
        "Every scene",
        "The strategy `active` chose strokes on objects of several sizes while its estimate of the surface was updated "
        "with every stroke.",
        "Over `random:organic:3:400` an update takes {Every scene|random:organic:3:400|update ms} ms and a choice "
        "{Every scene|random:organic:3:400|choice ms} ms in the median.",
    ),
    "exploration": Summary(
        "Medians over scenes and seeds",
        "The strategies explored objects in the ideal world (profile `default`), and where `lab` is listed in one that "
        "differs from its scene.",
        "With `grid_version` the median contact error is {Medians|grid_version;default|contact mm} mm, and the runs "
        "take {Medians|grid_version;default|times bound} times the lower bound of the time. With `active` the mesh is "
        "within 0.3 mm in the mean and 1 mm at the 95th percentile after "
        "{Medians|active;default|s to 0.3 and p95 1 mm} s, with `grid_version` after "
        "{Medians|grid_version;default|s to 0.3 and p95 1 mm} s.",
        "strategy, profile, done, contact mm, p95 mm, coverage, mesh mm, times bound",
    ),
    "stability": Summary(
        "Cases",
        "Stiff and extreme cases were run, each with several settings.",
        "{count: Cases|outcome|pass} cases pass.",
    ),
    "reality": Summary(
        "Worlds",
        "Explorations were run in simulated worlds that differ from what the scene says of them: `lab`, measured with "
        "care; `datasheet`, nothing measured; `calibrated`, the same after `lwrprobe calibrate`.",
        "In `lab` {Worlds|lab|status done} runs came to their end, and {Worlds|lab|true peak force <= 3 N} pressed "
        "with at most 3 N.",
        "profile, runs, status done, true peak force <= 3 N, coverage of what the strategy can reach >= 0.95, "
        "nothing silently wrong, in 95 % regions, in 95 % regions aligned, the world differs by, status, peak N, "
        "contact median mm, contact p95 mm, mesh mean mm, coverage, warnings",
    ),
    "physics": Summary(
        "grid_version",
        "The same explorations were run in two simulated worlds, `sim` and MuJoCo's.",
        "With a light arm in MuJoCo's world: {measured: status done: mujoco, arm of 1 kg} done, "
        "{measured: true peak force <= 3 N: mujoco, arm of 1 kg} with at most 3 N. With an arm of 16 kg: "
        "{measured: status done: mujoco, arm of 16 kg} done, "
        "{measured: true peak force <= 3 N: mujoco, arm of 16 kg} with at most 3 N.",
        "scene, world, status, peak N, contact median mm, contact p95 mm, mesh mean mm, coverage",
    ),
    "budget": Summary(
        "Share inside",
        "The contacts of one run were moved by the departures of many drawn worlds, and held against the error budget.",
        "Inside the stated 95 % region: {measured: absolute} of the errors, and {measured: after} after alignment.",
    ),
    "calibration": Summary(
        "All draws",
        "Probe, sensor and arm were calibrated on a reference sphere in worlds drawn from the profile `datasheet`.",
        "Each quantity stands with its largest error and with how often it was within its limit.",
    ),
    "shapes": Summary(
        "The ",
        "Random objects were explored that no setting was tuned for, and judged with distances made by trimesh.",
        "Done: {measured: done} runs; mesh no worse than the best other method by more than a tenth: "
        "{measured: mesh no worse}.",
        "no., object, strategy, mesh mm, times the best, coverage, times bound, what went wrong",
    ),
    "faults": Summary(
        "What the run does",
        "Each fault of the arm and the sensor was caused while the probe followed a contour, over real sockets.",
        "The run ended by itself in {count: What the run does|ended|by itself} cases and went on in "
        "{count: What the run does|ended|goes on}.",
        "fault, ended, exit code, moved on mm, peak N, touches, sentence",
    ),
    "stalls": Summary(
        "What became of each run",
        "Whole explorations ran over real sockets while the host was kept busy, or processes were halted.",
        "Runs that came to their end: {count: What became of each run|status|done}.",
        "disturbance, scene, status, true peak N, contact error RMS mm, late set points %, halts, re-entries, gaps",
    ),
    "kills": Summary(
        "Resumed",
        "Recorded runs were killed at random times, their folders recovered and read, and some of them resumed.",
        "Folders that could not be read: {measured: no folder}; runs that were done after they were resumed: "
        "{measured: resumed runs}.",
    ),
    "endurance": Summary(
        "The process",
        "Explorations ran back to back in one process.",
        "Explorations that were done: {measured: all explorations}.",
    ),
    "loop": Summary(
        "Compute, jitter",
        "The control loop answered an emulated controller at several cycle times.",
        "At a cycle of 10 ms the result was: {measured: answers in time}. At least 99 % of the answers were in time "
        "down to a cycle of {Shortest|99 %|cycle ms} ms.",
    ),
}


def sentences(report: BenchReport) -> str:
    """What the bench compared, what it found, and how many requirements are met."""
    said = []
    summary = SUMMARIES.get(report.name)
    if summary is not None:
        said.append(summary.subject)
        try:
            said.append(summary.sentence(report))
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
    wanted = chosen.columns.split(", ") if chosen is not None and chosen.columns else table.columns
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
        text = StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table.columns)
        writer.writerows(table.rows)
        write_whole(path, text.getvalue().encode())
        written.append(path)
    return written
