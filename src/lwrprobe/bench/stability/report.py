"""The bench's run: all cases or one, as table, JSON and picture."""

from __future__ import annotations

from typing import Any

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.bench.stability.case import COUNT, Result, all_cases, run_case
from lwrprobe.contracts import InputError
from lwrprobe.evaluation.machine import machine, versions


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`--case N` runs one, `--set case=1,2,34` some; `quick` runs fewer settings of each."""
    Options("stability", options, "case")
    cases = all_cases()
    chosen = cases
    if "case" in options:
        numbers = [int(text) if text.isdecimal() else 0 for text in options["case"].split(",")]
        if not cases.keys() >= set(numbers):
            raise InputError("case", options["case"], "one of " + ", ".join(str(n) for n in cases))
        chosen = {number: cases[number] for number in sorted(set(numbers))}
    results = [run_case(group, case, quick) for group, case in chosen.values()]
    report = BenchReport("stability", "Stiff and extreme cases", machine=machine() | versions("numpy", "numba"))
    report.tables = [_summary(results), _details(results)]
    report.verdicts = [_verdict(result) for result in results]
    held = sum(result.held for result in results)
    report.notes.append(f"{held} of {len(results)} cases pass.")
    if quick:
        report.notes.append("The short run (`--quick`): fewer settings of each case.")
    left = [str(n) for n in cases if n not in chosen]
    if left:
        report.notes.append("Not run here: " + ", ".join(left) + ".")
    missing = [n for n in range(1, COUNT + 1) if n not in cases]
    if missing:
        report.notes.append("No case yet for " + ", ".join(str(n) for n in missing) + ".")
    report.data["cases"] = [_record(result) for result in results]
    report.figures["cases"] = lambda figure: _draw(figure, results)
    return report


def _summary(results: list[Result]) -> Table:
    rows = [[r.case.number, r.case.title, r.group, "pass" if r.held else "falls short", r.seconds] for r in results]
    return Table("Cases", ["case", "what", "group", "outcome", "s"], rows)


def _details(results: list[Result]) -> Table:
    rows = []
    for result in results:
        for f in result.findings:
            figure = None if f.value is None else f"{f.value:.4g} {f.unit}".strip()
            bound = None if f.bound is None else f"{f.bound:.4g} {f.unit}".strip()
            rows.append([result.case.number, f.setting, f.happened, figure, bound, "pass" if f.sound else "short"])
    return Table("What happened", ["case", "setting", "what happened", "figure", "bound", "outcome"], rows)


def _verdict(result: Result) -> Verdict:
    short = [finding for finding in result.findings if not finding.sound]
    failures = "; ".join(f"{f.setting}: {f.happened}" if f.setting else f.happened for f in short)
    good = sum(finding.sound for finding in result.findings)
    measured = failures or f"{good} of {len(result.findings)} settings"
    return Verdict(f"{result.case.number} {result.case.title}: {result.case.wanted}", measured, result.held)


def _record(result: Result) -> dict[str, Any]:
    return {
        "case": result.case.number,
        "title": result.case.title,
        "wanted": result.case.wanted,
        "group": result.group,
        "held": result.held,
        "seconds": round(result.seconds, 3),
        "findings": [
            {"setting": f.setting, "happened": f.happened, "value": f.value, "bound": f.bound, "unit": f.unit}
            | {"held": f.sound}
            for f in result.findings
        ],
    }


def _draw(figure: Any, results: list[Result]) -> None:
    """Each case's worst figure as a share of what is allowed; without a figure, pass or short at the border."""
    figure.set_size_inches(9.0, max(2.0, 0.8 + 0.27 * len(results)))
    axes = figure.subplots()
    for row, result in enumerate(results):
        shares = [f.value / f.bound for f in result.findings if f.value is not None and f.bound and f.value == f.value]
        share = max(shares, default=None)
        colour = "tab:green" if result.held else "tab:red"
        if share is None:
            axes.plot(1.0, row, "s", color=colour)
        else:
            axes.barh(row, min(max(share, 1e-3), 1e2), color=colour, height=0.6)
    axes.axvline(1.0, color="black", linewidth=1.0)
    axes.set_xscale("log")
    axes.set_xlim(1e-3, 1e2)
    axes.set_yticks(range(len(results)), [f"{r.case.number} {r.case.title}" for r in results], fontsize=7)
    axes.set_ylim(len(results) - 0.4, -0.6)
    axes.set_xlabel("worst figure / allowed (green: passes, red: falls short, square: decided without a figure)")
