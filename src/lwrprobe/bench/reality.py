"""A world that differs from its scene: one departure at a time on one scene, and whole profiles on many.

Every run is a full one with the scene's `[truth]` set; see docs/explanation/simulator.md. Options (`--set`): `rows`,
names of departures separated by commas, `all` or `none`; `scenes`, `strategies`, `profiles` (`lab`, `datasheet`,
`rough`, or `none`) as comma-separated lists; `count`, draws of each profile and of each departure that is drawn;
`jobs`, processes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

from lwrprobe.bench.criterion import Criterion
from lwrprobe.bench.exploration import SOURCE_SCENES, STRATEGIES
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.contracts import LwrprobeError, UnknownNameError
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.sweeps.execute import run_in_order

SEED = 7
"""Of the noise in the rows of single departures."""
CLAIMED = (0.90, 0.98)
"""Share of the true errors that may lie inside the stated 95 % region."""
TRUTH_PROFILES = ("ideal", "lab", "datasheet", "rough")
"""Of the scene's table `[truth]`."""


@dataclass(slots=True, frozen=True)
class Row:
    """One departure: `settings` of the table `[truth]`, and whether they are drawn from a seed."""

    name: str
    settings: tuple[str, ...]
    drawn: bool = False


ROWS = (
    Row("nothing", ()),
    Row(
        "gain 2 % and crosstalk 1 %", ("sensor_gain_percent={sigma=2.0}", "sensor_crosstalk_percent={sigma=1.0}"), True
    ),
    Row("gain 2 %", ("sensor_gain_percent={sigma=2.0}",), True),
    Row("gain 1 %", ("sensor_gain_percent={sigma=1.0}",), True),
    Row("crosstalk 0.25 %", ("sensor_crosstalk_percent={sigma=0.25}",), True),
    Row("stick stiffness -30 %", ("stick_stiffness_percent=-30",)),
    Row("stick stiffness +30 %", ("stick_stiffness_percent=30",)),
    Row("probe 0.5 mm longer", ("probe_length_mm=0.5",)),
    Row("probe 0.5 mm shorter", ("probe_length_mm=-0.5",)),
    Row("sphere 0.3 mm off the axis", ("sphere_off_axis_mm=[0.3, 0.0]",)),
    Row("sphere radius +0.1 mm", ("sphere_radius_mm=0.1",)),
    Row("arm 10 ms later", ("arm_delay_ms=10",)),
    Row("sensor 10 ms later", ("sensor_delay_ms=10",)),
    Row("arm's lag 18 ms more", ("arm_lag_ms=18",)),
    Row("clocks 10 ms apart", ("clock_skew_ms=10",)),
    Row("DH angles 0.05 deg", ("dh_offset_deg={sigma=0.05}", "dh_twist_deg={sigma=0.05}"), True),
    Row("joint hysteresis 0.003 deg", ("joint_hysteresis_deg=0.003",)),
    Row("gear ripple 0.005 deg", ("gear_ripple_deg=0.005",)),
    Row("zero wanders 6 mN and 30 uN m", ("zero_wander_force_mn=6", "zero_wander_torque_unm=30")),
    Row("friction 5 deg off the slip", ("friction_direction_deg=5",)),
    Row("bursts of loss of 40 ms", ("loss_burst_ms=40",)),
    Row("bursts of loss of 80 ms", ("loss_burst_ms=80",)),
    Row("object 5e3 N/m", ("object_stiffness=5e3",)),
    Row("joints 85 % softer", ("joint_stiffness_percent=-85",)),
    Row("joints twice as stiff", ("joint_stiffness_percent=100",)),
    Row("joints five times as stiff", ("joint_stiffness_percent=400",)),
)
"""The departures, each by itself."""

CRITERIA = (
    Criterion("status done", "status", lambda v: v == "done"),
    Criterion("no link collision", "collisions", lambda v: v == 0),
    Criterion("true peak force <= 3 N", "peak", lambda v: v <= 3.0),
    Criterion("coverage >= 0.95", "coverage", lambda v: v >= 0.95),
    Criterion("contact error after alignment, median <= 0.12 mm", "aligned", lambda v: v <= 0.12),
    Criterion("contact error after alignment, p95 <= 0.40 mm", "aligned_p95", lambda v: v <= 0.40),
    Criterion("mesh error after alignment, mean <= 0.20 mm", "mesh_aligned", lambda v: v <= 0.20),
)
FIGURES = {
    "status": "status",
    "peak N": "peak",
    "contact median mm": "contact",
    "contact p95 mm": "contact_p95",
    "aligned median mm": "aligned",
    "aligned p95 mm": "aligned_p95",
    "mesh mean mm": "mesh",
    "mesh max mm": "mesh_max",
    "mesh aligned mm": "mesh_aligned",
    "coverage": "coverage",
    "rejected": "rejected",
    "claims": "claims",
    "claims aligned": "claims_aligned",
    "warnings": "warnings",
}


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench reality`."""
    asked = Options("reality", options, "rows", "scenes", "strategies", "profiles", "count", "jobs")
    scenes = asked.words("scenes", SOURCE_SCENES[:1] if quick else SOURCE_SCENES)
    strategies = asked.words("strategies", STRATEGIES[:1] if quick else STRATEGIES)
    count = asked.count("count", 1 if quick else 5)
    rows, profiles = _rows(asked, quick), _profiles(asked, quick)
    report = BenchReport("reality", "A world that differs from its scene")
    report.machine = machine() | versions("numpy", "numba", "ruckig")
    jobs = [_single(row, draw) for row in rows for draw in range(1, 1 + (count if row.drawn else 1))]
    departures = len(jobs)
    jobs += [
        _whole(scene, strategy, profile, seed)
        for profile, scene, strategy, seed in product(profiles, scenes, strategies, range(1, 1 + count))
    ]
    found = run_in_order(jobs, _explored, asked.count("jobs", 1))
    single, whole = found[:departures], found[departures:]
    if single:
        title = f"One departure at a time, {SOURCE_SCENES[0]}, {STRATEGIES[0]}, seed {SEED}"
        names = {"the world differs by": "row", "draw": "draw", **FIGURES, "reason": "reason"}
        report.records(title, names, single)
    if whole:
        names = {"profile": "profile", "scene": "scene", "strategy": "strategy", "seed": "seed", **FIGURES}
        report.records("Whole profiles", {**names, "reason": "reason"}, whole)
    report.verdicts = [c.verdict(found) for c in CRITERIA if found] + _claims(whole)
    report.data["runs"] = single + whole
    return report


def _rows(asked: Options, quick: bool) -> list[Row]:
    names = asked.words("rows", ("nothing", "gain 1 %") if quick else ("all",))
    if names == ["none"]:
        return []
    known = {row.name: row for row in ROWS}
    if names == ["all"]:
        return list(ROWS)
    for name in names:
        if name not in known:
            raise UnknownNameError("row", name, ("all", "none", *known))
    return [known[name] for name in names]


def _profiles(asked: Options, quick: bool) -> list[str]:
    names = asked.words("profiles", ("none",) if quick else ("lab", "datasheet"))
    for name in names:
        if name not in ("none", *TRUTH_PROFILES):
            raise UnknownNameError("profile", name, ("none", *TRUTH_PROFILES))
    return [name for name in names if name != "none"]


Job = tuple[dict[str, Any], str, list[str]]
"""What the run is called in the table, its scene, and its settings."""


def _single(row: Row, draw: int) -> Job:
    settings = [f"truth.{setting}" for setting in ("profile=ideal", *row.settings, f"seed={draw}")]
    named = {"row": row.name, "draw": draw if row.drawn else None}
    return named, SOURCE_SCENES[0], [f'strategy.name="{STRATEGIES[0]}"', f"run.seed={SEED}", *settings]


def _whole(scene: str, strategy: str, profile: str, seed: int) -> Job:
    settings = [f'strategy.name="{strategy}"', f"run.seed={seed}", f'truth.profile="{profile}"']
    return {"profile": profile, "scene": scene, "strategy": strategy, "seed": seed}, scene, settings


def _explored(job: Job) -> dict[str, Any]:
    named, scene, settings = job
    return named | explored(scene, settings)


def explored(name: str, settings: list[str]) -> dict[str, Any]:
    """One run as a flat record; a scene that cannot be run is a record that says so."""
    from lwrprobe.exploration.procedures.explore import explore
    from lwrprobe.scene import load_scene

    try:
        summary = explore(load_scene(name, settings))
    except LwrprobeError as error:
        return {"status": "refused", "reason": str(error)}
    contact, aligned = summary["contact_error_mm"] or {}, summary["contact_error_aligned_mm"] or {}
    mesh = summary["mesh_error_mm"] or {}
    return {
        "status": summary["status"],
        "reason": summary["reason"],
        "collisions": summary["link_collisions"],
        "peak": summary["true_peak_force_n"],
        "contact": contact.get("median"),
        "contact_p95": contact.get("p95"),
        "aligned": aligned.get("median"),
        "aligned_p95": aligned.get("p95"),
        "mesh": mesh.get("mean"),
        "mesh_max": mesh.get("hausdorff"),
        "mesh_aligned": (summary["mesh_error_aligned_mm"] or {}).get("mean"),
        "coverage": summary["coverage"],
        "rejected": summary["rejected_share"],
        "claims": summary["claims_within_95"],
        "claims_aligned": summary["claims_aligned_within_95"],
        "warnings": "; ".join(summary["warnings"]),
        "time": summary["sim_time_s"],
        "truth": summary["truth"],
    }


def _claims(whole: list[dict[str, Any]]) -> list[Verdict]:
    """Share of the true errors inside the stated 95 % region, over all draws of a profile.

    What all contacts of a draw share moves them together, so that a single draw says nothing. The scene states `lab`,
    and is wrong on purpose in the other profiles.
    """
    verdicts = []
    for profile in dict.fromkeys(item["profile"] for item in whole if item["profile"] == "lab"):
        for key, name in (("claims", "absolute"), ("claims_aligned", "after alignment")):
            shares = [item[key] for item in whole if item["profile"] == profile and item.get(key) is not None]
            share, (low, high) = sum(shares) / max(len(shares), 1), CLAIMED
            text = f"{profile}: {low:.0%} to {high:.0%} of the errors in the 95 % region, {name}"
            verdicts.append(Verdict(text, f"{share:.1%} of {len(shares)} draws", low <= share <= high))
    return verdicts
