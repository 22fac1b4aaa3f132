"""A world that differs from its scene: one departure at a time on one scene, and whole profiles on many.

Every run is a full one with the scene's `[truth]` set; see docs/explanation/simulator.md. Each run of a profile has a
world of its own, drawn from scene, strategy and draw: what a draw has in common moves all its contacts together, so
that few draws say little of a stated error. The profiles of one draw share the draw. Options (`--set`): `rows`, names
of departures separated by commas, `all` or `none`; `scenes`, `strategies`, `profiles` (see `PROFILES`, or `none`) as
comma-separated lists; `count`, draws of each run of a profile and of each departure that is drawn, from the number
`first` on, where several numbers separated by commas are those of the profiles in turn; `jobs`, processes; `journal`,
a file in which each run's record is kept, so that a bench that was cut off goes on with the next run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, product, repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np

from lwrprobe.bench.arm_alone import arm_alone
from lwrprobe.bench.budget import draw_calibration, shares_inside
from lwrprobe.bench.criterion import Criterion
from lwrprobe.bench.exploration import SOURCE_SCENES, STRATEGIES
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.contracts import LwrprobeError
from lwrprobe.contracts.plugins import names
from lwrprobe.evaluation import aligned_points
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.sweeps.execute import run_kept
from lwrprobe.sweeps.plan import SweepTask

if TYPE_CHECKING:
    from lwrprobe.exploration.procedures.explore import Exploration

SEED = 7
"""Of the noise in the rows of single departures."""
CLAIMED = (0.90, 0.98)
"""Share of the true errors that may lie inside the stated 95 % region."""
UNTOLD = 0.10
"""Share of a run's contacts that may lie outside of the stated 95 % region without a warning."""
MOVED = "the object has moved"
"""Begin of a run's reason that is false where the object is held."""
LEANING = "orientation_change"
"""Strategy that is judged by all that the sphere can reach."""
KINDS = ("absolute", "after alignment")
SPHERE = 0.03
"""m, diameter of the reference sphere."""
TRUTH_PROFILES = ("ideal", "lab", "datasheet", "rough")
"""Of the scene's table `[truth]`."""
CALIBRATED = "calibrated"
PROFILES: dict[str, tuple[str, ...]] = {
    "ideal": ("truth.profile=ideal",),
    "lab": ("truth.profile=lab",),
    "datasheet": ("truth.profile=datasheet", "uncertainty.profile=datasheet"),
    CALIBRATED: ("truth.profile=datasheet", "uncertainty.profile=datasheet"),
    "rough": ("truth.profile=rough", "uncertainty.profile=datasheet"),
}
"""Settings of each profile. `calibrated` is `datasheet` after `lwrprobe calibrate` in the same world. Who has measured
nothing says so: a scene states `lab` where it says nothing."""


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
    Criterion("coverage of what the strategy can reach >= 0.95", "reachable", lambda v: v >= 0.95),
    Criterion("contact error after alignment, median <= 0.12 mm", "aligned", lambda v: v <= 0.12),
    Criterion("contact error after alignment, p95 <= 0.40 mm", "aligned_p95", lambda v: v <= 0.40),
    Criterion("mesh error after alignment, mean <= 0.20 mm", "mesh_aligned", lambda v: v <= 0.20),
    Criterion("mesh error of what the strategy can reach, mean <= 0.20 mm", "mesh_reachable", lambda v: v <= 0.20),
)
"""Of a world as well known as its scene says."""
HONEST = (
    Criterion("no false reason", "false_reason", lambda v: not v),
    Criterion("nothing silently wrong", "untold", lambda v: not v),
    Criterion("true peak force <= 3 N", "peak", lambda v: v <= 3.0),
)
"""Of a world in which nothing was measured."""
ALONE = Criterion("arm alone, median <= 0.12 mm", "arm_alone", lambda v: v <= 0.12)
"""Of the runs whose contacts can keep to as much at all."""
ASKED = {"ideal": CRITERIA, "lab": CRITERIA, CALIBRATED: CRITERIA, "datasheet": HONEST, "rough": HONEST}
STATED = ("lab", "datasheet", CALIBRATED)
"""Profiles whose uncertainty is what the scene states of it."""
FIGURES = {
    "status": "status",
    "peak N": "peak",
    "contact median mm": "contact",
    "contact p95 mm": "contact_p95",
    "aligned median mm": "aligned",
    "arm alone mm": "arm_alone",
    "aligned p95 mm": "aligned_p95",
    "mesh mean mm": "mesh",
    "mesh max mm": "mesh_max",
    "mesh aligned mm": "mesh_aligned",
    "mesh of reachable mm": "mesh_reachable",
    "coverage": "coverage",
    "of reachable": "reachable",
    "rejected": "rejected",
    "claims": "claims",
    "claims aligned": "claims_aligned",
    "warnings": "warnings",
}
NOTES = (
    "Each run of a profile has a world of its own, the same in `datasheet` and `calibrated`. `calibrated` is "
    f"`datasheet` after `lwrprobe calibrate` in that world, on a reference sphere of {1e3 * SPHERE:g} mm.",
    "Coverage and `mesh of reachable` are those of what the strategy can reach: with the probe upright for all "
    "strategies but `orientation_change`, which leans it and is judged by all that the sphere can reach "
    "(`coverage_upright` and `coverage` of `summary.json`).",
    f"Silently wrong is a run without a warning in which more than {UNTOLD:.0%} of the contacts lie outside of the "
    "stated 95 % region. A false reason says that the object has moved, where it is held.",
    "`arm alone` is the median error after alignment that the arm's table and gears leave if all else is exact and "
    "nothing corrects them: a calibration takes most of it away.",
    "The requirement on the stated regions is on the mean over all draws: what a draw has in common moves all its "
    "contacts into the region or out of it.",
)


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench reality`."""
    asked = Options("reality", options, "rows", "scenes", "strategies", "profiles", "count", "first", "jobs", "journal")
    scenes = asked.words("scenes", SOURCE_SCENES[:1] if quick else SOURCE_SCENES)
    usual = STRATEGIES[:1] if quick else STRATEGIES[:3]
    strategies = asked.names("strategies", "strategy", usual, names("strategy"))
    first, counts = asked.count("first", 1), asked.counts("count", 1 if quick else 5)
    draws = [range(first, first + count) for count in counts]
    single = [_single(row, draw) for row in _rows(asked, quick) for draw in (draws[0] if row.drawn else draws[0][:1])]
    whole = [
        _whole(profile, scene, strategy, draw)
        for profile, mine in zip(_profiles(asked, quick), chain(draws, repeat(draws[-1])))
        for scene, strategy, draw in product(scenes, strategies, mine)
    ]
    tasks = {task.key: task for task in single + whole}
    journal = Path(options["journal"]) if "journal" in asked else None
    made = run_kept(tasks, _explored, asked.count("jobs", 1), journal)
    report = BenchReport("reality", "A world that differs from its scene")
    report.machine = machine() | versions("numpy", "numba", "ruckig")
    _report_profiles(report, [task.named() | made[task.key] for task in whole])
    _report_single(report, [task.named() | {"draw": _draw_of(task)} | made[task.key] for task in single])
    return report


def _report_profiles(report: BenchReport, found: list[dict[str, Any]]) -> None:
    """Tables, verdicts and picture of the whole profiles; `variant` names the profile of a run."""
    if not found:
        return
    names = {"profile": "variant", "scene": "scene", "strategy": "strategy", "seed": "seed"}
    of = {
        name: [item for item in found if item["variant"] == name] for name in dict.fromkeys(r["variant"] for r in found)
    }
    kept = {c.requirement: c for c in (*CRITERIA, ALONE, *HONEST)}
    requirements = list(kept)
    rows = [
        [
            name,
            len(mine),
            *(kept[r].kept(mine) for r in requirements),
            _share(mine, "claims"),
            _share(mine, "claims_aligned"),
        ]
        for name, mine in of.items()
    ]
    columns = ["profile", "runs", *requirements, "in 95 % regions", "in 95 % regions aligned"]
    report.table("Worlds: whole profiles", columns, rows)
    report.records(
        "Every run of a profile", {**names, **FIGURES, "silently wrong": "untold", "reason": "reason"}, found
    )
    for name, mine in of.items():
        for criterion in ASKED[name]:
            verdict = criterion.verdict(mine, "{scene}/{strategy}/{seed}".format_map)
            report.require(f"{name}: {verdict.requirement}", verdict.measured, verdict.held)
        if name in STATED:
            report.verdicts += _claims(name, mine)
    curves = {
        f"{name}, {key}": _mean_curve(mine, index) for name, mine in of.items() for index, key in enumerate(KINDS)
    }
    report.figures["calibration"] = partial(draw_calibration, curves={k: c for k, c in curves.items() if c})
    report.notes += NOTES
    report.data["runs"] = found


def _report_single(report: BenchReport, found: list[dict[str, Any]]) -> None:
    """The same of one departure at a time; `variant` names it."""
    if not found:
        return
    title = f"Worlds: one departure at a time, {SOURCE_SCENES[0]}, {STRATEGIES[0]}, seed {SEED}"
    names = {"the world differs by": "variant", "draw": "draw", **FIGURES, "reason": "reason"}
    report.records(title, names, found)
    for criterion in CRITERIA:
        verdict = criterion.verdict(found)
        report.require(f"one departure: {verdict.requirement}", verdict.measured, verdict.held)
    report.data["departures"] = found


def _rows(asked: Options, quick: bool) -> list[Row]:
    known = {row.name: row for row in ROWS}
    usual = ("nothing", "gain 1 %") if quick else ("all",)
    given = asked.names("rows", "row", usual, ("all", "none", *known))
    return list(ROWS) if "all" in given else [known[name] for name in given if name != "none"]


def _profiles(asked: Options, quick: bool) -> list[str]:
    given = asked.names("profiles", "profile", ("none",) if quick else STATED, ("none", *PROFILES))
    return [name for name in given if name != "none"]


def _single(row: Row, draw: int) -> SweepTask:
    settings = [f"truth.{setting}" for setting in ("profile=ideal", *row.settings, f"seed={draw}")]
    return SweepTask(SOURCE_SCENES[0], STRATEGIES[0], "none", row.name, SEED, tuple(settings))


def _draw_of(task: SweepTask) -> int:
    return int(task.settings[-1].partition("=")[2])


def _whole(profile: str, scene: str, strategy: str, draw: int) -> SweepTask:
    seed = crc32(f"{scene}/{strategy}/{draw}".encode())
    return SweepTask(scene, strategy, "none", profile, seed, PROFILES[profile])


def _explored(task: SweepTask) -> dict[str, Any]:
    """One run; of the profile `calibrated` after a calibration in the same world."""
    from lwrprobe.calibration import write_calibration
    from lwrprobe.exploration.procedures.calibrate import calibrate
    from lwrprobe.scene import load_scene

    settings = task.for_worker()["set"]
    if task.variant != CALIBRATED:
        return explored(task.scene, settings)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "calibration.toml"
        try:
            found, _ = calibrate(load_scene(task.scene, settings), SPHERE)
        except LwrprobeError as error:
            return {"status": "refused", "reason": f"calibration: {error}"}
        write_calibration(found, file)
        return explored(task.scene, [*settings, f'calibration="{file}"'])


def explored(name: str, settings: list[str]) -> dict[str, Any]:
    """One run as a flat record; a scene that cannot be run is a record that says so."""
    from lwrprobe.exploration.procedures.explore import Exploration
    from lwrprobe.scene import load_scene
    from lwrprobe.scene.scene_robot import robot_of

    try:
        scene = load_scene(name, settings)
        with Exploration(scene) as exploration:
            for _ in exploration:
                pass
        summary = exploration.finish().as_dict()
    except LwrprobeError as error:
        return {"status": "refused", "reason": str(error)}
    contact, aligned = summary["contact_error_mm"] or {}, summary["contact_error_aligned_mm"] or {}
    mesh = summary["mesh_error_mm"] or {}
    told = [share for share in (summary["claims_within_95"], summary["claims_aligned_within_95"]) if share is not None]
    held = "object_mass_kg" not in summary["truth"]
    leaning = summary["strategy"] == LEANING
    reached = "reachable" if leaning else "upright"
    joints = np.array([state[0] for state in exploration.recorder.states if state is not None])
    alone = arm_alone(robot_of(scene), joints, summary["truth"] or {}, summary["seed"])
    return {
        "status": summary["status"],
        "reason": summary["reason"],
        "collisions": summary["link_collisions"],
        "peak": summary["true_peak_force_n"],
        "contact": contact.get("median"),
        "contact_p95": contact.get("p95"),
        "aligned": aligned.get("median"),
        "aligned_p95": aligned.get("p95"),
        "arm_alone": None if alone is None else 1e3 * alone,
        "mesh": mesh.get("mean"),
        "mesh_max": mesh.get("hausdorff"),
        "mesh_aligned": (summary["mesh_error_aligned_mm"] or {}).get("mean"),
        "mesh_reachable": (summary[f"mesh_error_{reached}_aligned_mm"] or {}).get("mean"),
        "coverage": summary["coverage"],
        "reachable": summary["coverage" if leaning else "coverage_upright"],
        "rejected": summary["rejected_share"],
        "claims": summary["claims_within_95"],
        "claims_aligned": summary["claims_aligned_within_95"],
        "untold": bool(told) and min(told) < 1.0 - UNTOLD and not summary["warnings"],
        "false_reason": held and MOVED in str(summary["reason"]),
        "curves": _curves(exploration),
        "warnings": "; ".join(summary["warnings"]),
        "time": summary["sim_time_s"],
        "truth": summary["truth"],
    }


def _curves(exploration: Exploration) -> list[list[float]] | None:
    """Shares of the true errors inside the regions of `LEVELS`, one list for each of `KINDS`."""
    budget, truth, recorder = exploration.budget, exploration.truth, exploration.recorder
    if budget is None or truth is None:
        return None
    touches = [truth.contact_at(sequence) for sequence in recorder.sequences]
    known = np.array([true is not None for true in touches])
    if not known.any():
        return None
    true = np.array([touch.point for touch in touches if touch is not None])
    points = recorder.points()[known]
    moved = (points, aligned_points(points, true))
    return [shares_inside(budget.squares(p - true, known, aligned)) for p, aligned in zip(moved, (False, True))]


def _mean_curve(found: Sequence[dict[str, Any]], index: int) -> list[float]:
    """Of all runs, each counted alike; empty without any."""
    curves = [item["curves"][index] for item in found if item.get("curves")]
    return np.mean(curves, axis=0).tolist() if curves else []


def _share(found: Sequence[dict[str, Any]], key: str) -> float | None:
    """Mean over the runs, which are draws, of a share of their contacts."""
    shares = [item[key] for item in found if item.get(key) is not None]
    return float(np.mean(shares)) if shares else None


def _claims(profile: str, found: Sequence[dict[str, Any]]) -> list[Verdict]:
    """Whether the share of the true errors inside the stated 95 % region is one, over all draws of a profile."""
    verdicts, (low, high) = [], CLAIMED
    for key, name in zip(("claims", "claims_aligned"), KINDS):
        share = _share(found, key)
        text = f"{profile}: {low:.0%} to {high:.0%} of the errors in the 95 % region, {name}"
        measured = "no run" if share is None else f"{share:.1%} of {len(found)} draws"
        verdicts.append(Verdict(text, measured, share is not None and low <= share <= high))
    return verdicts
