"""Scenes x strategies x profiles x seeds, explored: errors, coverage, time against the bound, and what it cost.

Every run is a full one: simulator, sensor noise, contact estimation, map, clearance, strategy. The error over time is
that of the mesh as if the run had ended at each of some instants, over what an upright probe reaches; the error of the
whole mesh stands in a column of its own.

Options (`--set`): `scenes`, `strategies` (those of plug-ins too) and `profiles` as comma-separated lists, `seeds`, how
many of them (from 1 on), `jobs` for runs side by side, `journal`, a file in which each run's record is kept, so that a
bench that was cut off goes on with the runs that are missing. `--set profiles=default,lab` does the same in the world
`lab` beside the ideal one, with errors after alignment. `--set profiles=blind,given` explores objects of which nothing
is known, and each of them once more where it lies, with an area around it. `--set scenes=large` explores four objects
200 to 400 mm long and says how wrong the mesh is after eight strokes.
"""

from __future__ import annotations

from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lwrprobe.bench.criterion import Criterion
from lwrprobe.bench.error_curves import (
    AFTER,
    IDEAL,
    Row,
    certified,
    columns,
    draw_curves,
    error_curve,
    errors_at,
    lifts,
    reached,
)
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.bench.stroke_pictures import SCENE as STROKED
from lwrprobe.bench.stroke_pictures import STRATEGY as STROKES
from lwrprobe.bench.stroke_pictures import draw_strokes, stroke_ends, strokes_of
from lwrprobe.bench.threat_pictures import SCENE as STACKED
from lwrprobe.bench.threat_pictures import draw_touches, touches_of
from lwrprobe.contracts import LwrprobeError
from lwrprobe.contracts.plugins import names
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.evaluation.truth import with_given_area
from lwrprobe.scene import Scene, load_scene, profile_names
from lwrprobe.sweeps.execute import run_kept

Job = tuple[str, str, str, int]
"""Scene, strategy, profile and seed."""

SOURCE_SCENES = (
    "block", "cylinder_vertical", "cylinder_horizontal", "bridge", "combination", "polystyrene_1", "polystyrene_2",
    "jaw_chuck", "stacked_blocks",
)  # fmt: skip
STRATEGIES = ("grid_version", "surface_contour", "orientation_change", "active")
POKES = ("random_pokes", "grid_pokes", "variance_pokes")
"""What the strategies are compared with, in error against time alone: they touch from above."""
BOUND = "lower bound"
"""Of the time, as a row beside the strategies."""
QUICK_SCENES = ("block", "stacked_blocks")
DEFAULT, THESIS = "default", "thesis"
LAB = "lab"
"""As `default`, in a world that differs from its scene as in a laboratory that measures with care."""
BLIND, GIVEN = "blind", "given"
RASTER_SHARE, RASTER_WORST = 0.6, 1.1
"""Times the best raster's seconds to the wanted errors, that `active` should take in the median and at most."""
LARGE = "large"
LARGE_SCENES = ("random:extrusion:1:300", "random:hull:2:250", "random:bumps:4:200", "random:organic:3:400")
FEW, FEW_ERROR = 8, 2.5
"""Strokes, and mm of the mesh's mean error after them: 8 slides gave 2.5 mm over objects of this size (GPAtlasRRT)."""
FOUND_WITHIN, BLIND_FACTOR = 25.0, 1.3
"""s until an object is found, and times the run with an area that is given: medians that a blind start should keep."""

CRITERIA = (
    Criterion("status done", "status", lambda v: v == "done"),
    Criterion("no link collision", "collisions", lambda v: v == 0),
    Criterion("peak force <= 3 N", "peak_force_n", lambda v: v <= 3.0),
    Criterion("force and torque within the sensor's range", "range_used", lambda v: v < 1.0),
    Criterion("contact error median <= 0.15 mm", "contact_median", lambda v: v <= 0.15),
    Criterion("contact error p95 <= 0.5 mm", "contact_p95", lambda v: v <= 0.5),
    Criterion("coverage >= 0.97 of what the strategy can reach", "reachable", lambda v: v >= 0.97),
    Criterion("ends in x found within 0.3 mm", "ends", lambda v: v <= 0.3),
)
RASTER_CRITERIA = (
    Criterion("rasters: time <= 2 x the lower bound", "ratio", lambda v: v <= 2.0),
    Criterion("rasters: time <= 2 x the lower bound with walls descended", "ratio_descending", lambda v: v <= 2.0),
    Criterion("rasters: time <= 2 x the lower bound in unknown space", "ratio_unknown", lambda v: v <= 2.0, 75 / 81),
)
"""Strokes are judged by the time to an error, beside the rasters."""
GOAL = "s to 0.3 and p95 1 mm"
COLUMNS = {
    "scene": "scene",
    "strategy": "strategy",
    "profile": "profile",
    "seed": "seed",
    "status": "status",
    "collisions": "collisions",
    "peak N": "peak_force_n",
    "range used": "range_used",
    "contact mm": "contact_median",
    "p95 mm": "contact_p95",
    "s to 1 mm": "seconds_1",
    "s to 0.3 mm": "seconds_0.3",
    "s to 0.1 mm": "seconds_0.1",
    GOAL: "seconds_goal",
    **{f"p95 mm, {after:g} s": f"p95_{after:g}" for after in AFTER},
    **{f"certified mm, {after:g} s": f"certified_{after:g}" for after in AFTER},
    "coverage": "coverage",
    "of upright": "coverage_upright",
    "ends mm": "ends",
    "mesh mm": "mesh",
    "clearance mm": "clearance",
    "found s": "found",
    "bounded s": "bounded",
    "robot s": "time",
    "bound s": "bound",
    "times bound": "ratio",
    "times bound, descending": "ratio_descending",
    "times bound, unknown": "ratio_unknown",
    "path m": "path",
    "lifts": "lifts",
    "strokes": "strokes",
    f"mesh mm, {FEW} strokes": "mesh_few",
    f"all of the mesh mm, {FEW} strokes": "mesh_few_whole",
    "strategy us": "strategy_us",
    "planning ms": "planning_ms",
    "cycle us": "cycle_us",
    "x real time": "real_time",
}


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench exploration`."""
    jobs, processes, journal = _jobs(quick, options)
    made = run_kept({".".join(map(str, job)): job for job in jobs}, _explored, processes, journal)
    found = [_named(job) | made[".".join(map(str, job))] for job in jobs]
    report = BenchReport("exploration", "Exploring: errors, coverage and time")
    report.machine = machine() | versions("numpy", "numba", "ruckig")
    report.records("Every run", COLUMNS, found)
    _summarise(report, found)
    beside = _beside_rasters(found)
    if beside:
        report.table("active beside the others", list(BESIDE_RASTERS), [list(row.values()) for row in beside])
    _beside_thesis(report, found)
    usual = [item for item in found if item["profile"] == DEFAULT and item["scene"] not in LARGE_SCENES]
    judged = [item for item in usual if item["strategy"] not in POKES]
    name = "{scene}/{strategy}".format_map
    rasters = [item for item in judged if item["strategy"] != STROKES]
    report.verdicts = [criterion.verdict(judged, name) for criterion in CRITERIA if judged]
    report.verdicts += [criterion.verdict(rasters, name) for criterion in RASTER_CRITERIA if rasters]
    report.verdicts += _raster_verdicts(beside)
    blind = _beside_given(found)
    if blind:
        report.table("Blind starts beside given areas", list(BESIDE_GIVEN), [list(row.values()) for row in blind])
        report.verdicts += _blind_verdicts(blind)
    large = [item for item in found if item["scene"] in LARGE_SCENES and item["strategy"] == STROKES]
    if large:
        limit = f"large objects: mesh error below {FEW_ERROR:g} mm in the mean after {FEW} strokes of {STROKES}"
        report.verdicts.append(Criterion(limit, "mesh_few", lambda v: v < FEW_ERROR).verdict(large, name))
    report.figures["coverage"] = partial(_draw_growth, found=found)
    if any(item.get("curve") for item in found):
        report.figures["error"] = partial(draw_curves, found=found)
    if any(item.get("touches") for item in found):
        report.figures["touches"] = partial(draw_touches, found=found)
    if any(item.get("stroke_touches") for item in found):
        report.figures["strokes"] = partial(draw_strokes, found=found)
    report.data["runs"] = found
    return report


def _jobs(quick: bool, options: dict[str, str]) -> tuple[list[Job], int, Path | None]:
    asked = Options("exploration", options, "scenes", "strategies", "profiles", "seeds", "jobs", "journal")
    scenes = asked.words("scenes", QUICK_SCENES if quick else SOURCE_SCENES)
    scenes = list(LARGE_SCENES) if scenes == [LARGE] else scenes
    for scene in scenes:
        load_scene(scene)  # what is no scene is refused before the first one is explored
    usual = STRATEGIES[:1] if quick else (*STRATEGIES, *POKES)
    strategies = asked.names("strategies", "strategy", usual, names("strategy"))
    profiles = asked.names(
        "profiles", "profile", (DEFAULT,) if quick else (DEFAULT, THESIS), (DEFAULT, LAB, GIVEN, *profile_names())
    )
    seeds = range(1, asked.count("seeds", 1 if quick else 3) + 1)
    journal = Path(options["journal"]) if "journal" in asked else None
    return list(product(scenes, strategies, profiles, seeds)), asked.count("jobs", 1), journal


def _named(job: Job) -> dict[str, Any]:
    """What a record has although its run has failed."""
    name, strategy, profile, seed = job
    return {
        "scene": name, "strategy": strategy, "profile": profile, "seed": seed, "collisions": None, "growth": [],
    }  # fmt: skip


def _explored(job: Job) -> dict[str, Any]:
    """One run as a flat record; a scene that cannot be run is a record that says so."""
    name, strategy, profile, seed = job
    record = _named(job)
    try:
        world = LAB if profile == LAB else IDEAL
        settings = [f'strategy.name="{strategy}"', f"run.seed={seed}", f'truth.profile="{world}"']
        scene = load_scene(name, settings, {DEFAULT: None, LAB: None, GIVEN: BLIND}.get(profile, profile))
        if profile == GIVEN:
            scene = with_given_area(scene, load_scene(name, settings))
        touched = (name, profile, seed) == (STACKED, DEFAULT, 1)
        if touched or (name, strategy, profile, seed) == (STROKED, STROKES, DEFAULT, 1):
            with TemporaryDirectory() as folder:
                summary, over_time = _run(scene, Path(folder))
                if touched:
                    record["touches"] = touches_of(Path(folder))
                else:
                    record["stroke_touches"] = strokes_of(Path(folder))
        else:
            summary, over_time = _run(scene, None)
    except LwrprobeError as error:
        return record | {"status": f"refused: {error}"}
    remains = "_aligned" if profile == LAB else ""
    contact, mesh = (summary[f"{what}_error{remains}_mm"] or {} for what in ("contact", "mesh"))
    planning: dict[str, Any] = next((stage for stage in summary["stages"] if stage["name"] == "strategy"), {})
    bound, descending = summary["lower_bound_time_s"], summary["lower_bound_descending_s"]
    unknown = summary["lower_bound_unknown_s"]
    ends = summary["end_errors_mm"]
    return record | {
        "status": summary["status"],
        "reason": summary["reason"],
        "collisions": summary["link_collisions"],
        "peak_force_n": summary["peak_force_n"],
        "range_used": summary["range_used"],
        "contact_median": contact.get("median"),
        "contact_p95": contact.get("p95"),
        "coverage": summary["coverage"],
        "coverage_upright": summary["coverage_upright"],
        "reachable": summary["coverage" if strategy == "orientation_change" else "coverage_upright"],
        "ends": max(map(abs, ends)) if ends and None not in ends else None,
        "mesh": mesh.get("mean"),
        "clearance": None if summary["min_clearance_m"] is None else 1e3 * summary["min_clearance_m"],
        "true_peak_n": summary["true_peak_force_n"],
        "found": summary["found_at_s"],
        "bounded": summary["search_time_s"],
        "time": summary["sim_time_s"],
        "bound": bound,
        "ratio": summary["sim_time_s"] / bound if bound else None,
        "ratio_descending": summary["sim_time_s"] / descending if descending else None,
        "ratio_unknown": summary["sim_time_s"] / unknown if unknown else None,
        "path": summary["path_length_m"],
        "strategy_us": planning.get("us_median"),
        "planning_ms": 1e-3 * planning["us_max"] if planning else None,
        "cycle_us": summary["cycle_us"],
        "real_time": summary["real_time_factor"],
        "left_out": [item["stage"] for item in summary["left_out"]],
        "growth": summary["coverage_over_time"] or [],
        **over_time,
    }


def _run(scene: Scene, folder: Path | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """The summary of a whole run, and what is known of it over its time."""
    from lwrprobe.exploration.procedures.explore import Exploration, RunOptions

    with Exploration(scene, RunOptions(out=folder)) as exploration:
        for _ in exploration:
            pass
    summary = exploration.finish().as_dict()
    truth = exploration.truth
    ends = stroke_ends(row[:3] for row in exploration.pipeline.strategy.trace)
    curve: list[Row] = []
    few: list[Row] = []
    if truth is not None:
        within = reached(exploration, truth)
        curve = error_curve(exploration, truth, within)
        few = errors_at(exploration, truth, within, ends[FEW - 1 : FEW])
    over_time = {"curve": curve, **columns(curve), "lifts": lifts(exploration.recorder.trace()), "strokes": len(ends)}
    over_time |= {"mesh_few": few[0][1] if few else None, "mesh_few_whole": few[0][3] if few else None}
    return summary, over_time | certified(exploration)


def _summarise(report: BenchReport, found: list[dict[str, Any]]) -> None:
    """Medians over the seeds and scenes, a row each strategy and profile; and of the lower bound of the time."""
    keys = {
        "contact mm": "contact_median", "p95 mm": "contact_p95", "coverage": "coverage", "ends mm": "ends",
        "mesh mm": "mesh", "times bound": "ratio", "s": "time", "s to 1 mm": "seconds_1", "s to 0.3 mm": "seconds_0.3",
        "s to 0.1 mm": "seconds_0.1", GOAL: "seconds_goal",
    }  # fmt: skip
    keys |= {name: key for name, key in COLUMNS.items() if name.endswith(" s") and "mm, " in name}
    keys |= {name: COLUMNS[name] for name in ("path m", "lifts", "peak N", "strategy us", "planning ms")}
    rows = []
    for strategy, profile in sorted({(item["strategy"], item["profile"]) for item in found}):
        own = [item for item in found if (item["strategy"], item["profile"]) == (strategy, profile)]
        done = sum(item["status"] == "done" for item in own)
        rows.append([strategy, profile, f"{done} of {len(own)}", *(_median(own, key) for key in keys.values())])
    ours = [item for item in found if item["profile"] == DEFAULT and item["strategy"] in STRATEGIES[:3]]
    if _median(ours, "bound") is not None:
        bound = {"s": _median(ours, "bound"), "times bound": 1.0}
        rows.append([BOUND, DEFAULT, None, *(bound.get(name) for name in keys)])
    report.table("Medians over scenes and seeds", ["strategy", "profile", "done", *keys], rows)


def _beside_thesis(report: BenchReport, found: list[dict[str, Any]]) -> None:
    """The thesis profile beside the default, medians over the seeds; a factor is the first over the second."""
    compared = {"contact mm": "contact_median", "p95 mm": "contact_p95", "mesh mm": "mesh", "robot s": "time"}
    alone = {"coverage": "coverage", "ends mm": "ends", "peak N": "peak_force_n"}
    rows = []
    for scene, strategy in dict.fromkeys((item["scene"], item["strategy"]) for item in found):
        pair = [
            [item for item in found if (item["scene"], item["strategy"], item["profile"]) == (scene, strategy, profile)]
            for profile in (DEFAULT, THESIS)
        ]
        if not all(pair):
            continue
        row: list[Any] = [scene, strategy]
        for key in (*compared.values(), *alone.values()):
            default, thesis = (_median(runs, key) for runs in pair)
            row += [default, thesis]
            if key in compared.values():
                row.append(thesis / default if default and thesis is not None else None)
        row += [f"{sum(item['status'] == 'done' for item in runs)} of {len(runs)}" for runs in pair]
        rows.append(row)
    columns = ["scene", "strategy"]
    columns += [f"{name}{what}" for name in compared for what in ("", ", thesis", ", factor")]
    columns += [f"{name}{what}" for name in (*alone, "done") for what in ("", ", thesis")]
    if rows:
        report.table("The thesis profile beside the default, medians over the seeds", columns, rows)


BESIDE_RASTERS = (
    "scene", "profile", "seed", "active s", "best raster s", "factor", "best pokes s", "pokes over active",
)  # fmt: skip


def _beside_rasters(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Seconds of `active` to the wanted errors beside those of the quickest raster and of the quickest pokes.

    A row for each scene, profile and seed that `active` and a raster explored; infinite where they are never reached.
    """
    seconds: dict[tuple[Any, ...], dict[str, float]] = {}
    for item in found:
        if item["profile"] in (DEFAULT, LAB):
            goal = item.get("seconds_goal")
            place = item["scene"], item["profile"], item["seed"]
            seconds.setdefault(place, {})[item["strategy"]] = np.inf if goal is None else goal
    rows = []
    for place, own in seconds.items():
        raster, pokes = (
            min((own[name] for name in names if name in own), default=None) for names in (STRATEGIES[:3], POKES)
        )
        if STROKES not in own or raster is None:
            continue
        active = own[STROKES]
        factor = active / raster if np.isfinite(active) else np.inf
        gained = None if pokes is None else np.inf if np.isinf(pokes) else pokes / active
        rows.append(dict(zip(BESIDE_RASTERS, (*place, active, raster, factor, pokes, gained))))
    return rows


def _raster_verdicts(rows: list[dict[str, Any]]) -> list[Verdict]:
    verdicts = []
    for profile in dict.fromkeys(row["profile"] for row in rows):
        factors = [row["factor"] for row in rows if row["profile"] == profile]
        middle, worst = float(np.median(factors)), max(factors)
        what = f"{profile}: {STROKES} to mean 0.3 and p95 1 mm"
        verdicts += [
            Verdict(f"{what}, median <= {RASTER_SHARE:g} x the best raster", f"{middle:.3g}", middle <= RASTER_SHARE),
            Verdict(f"{what}, never above {RASTER_WORST:g} x that", f"{worst:.3g}", worst <= RASTER_WORST),
        ]
    return verdicts


BESIDE_GIVEN = (
    "scene", "strategy", "seed", "status", "found s", "bounded s", "robot s", "robot s, given", "factor", "true peak N",
    "collisions", "mesh mm", "mesh mm, given",
)  # fmt: skip


def _beside_given(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each blind start beside the run with the area given, a row each with the columns of `BESIDE_GIVEN`."""

    def key(item: dict[str, Any]) -> tuple[Any, ...]:
        return item["scene"], item["strategy"], item["seed"]

    given = {key(item): item for item in found if item["profile"] == GIVEN}
    rows = []
    for item in found:
        if item["profile"] != BLIND:
            continue
        beside = given.get(key(item), {})
        time, other = item.get("time"), beside.get("time")
        values = [
            *key(item), item["status"], item.get("found"), item.get("bounded"), time, other,
            time / other if time and other else None, item.get("true_peak_n"), item["collisions"], item.get("mesh"),
            beside.get("mesh"),
        ]  # fmt: skip
        rows.append(dict(zip(BESIDE_GIVEN, values)))
    return rows


def _blind_verdicts(rows: list[dict[str, Any]]) -> list[Verdict]:
    def median(column: str, most: float, requirement: str) -> Verdict:
        # What was not found, or has nothing beside it, counts as taking for ever.
        values = [row[column] if row[column] is not None else np.inf for row in rows]
        middle = float(np.median(values))
        return Verdict(requirement, f"{middle:.3g}, {min(values):.3g} to {max(values):.3g}", middle <= most)

    done = sum(row["status"] == "done" for row in rows)
    safe = sum(row["collisions"] == 0 and (row["true peak N"] or 0.0) <= 3.0 for row in rows)
    return [
        Verdict("blind start: status done", f"{done} of {len(rows)}", done == len(rows)),
        Verdict("blind start: no link collision, true peak <= 3 N", f"{safe} of {len(rows)}", safe == len(rows)),
        median("found s", FOUND_WITHIN, f"blind start: found within {FOUND_WITHIN:g} s in the median"),
        median("factor", BLIND_FACTOR, f"blind start: at most {BLIND_FACTOR:g} x the run with a given area, median"),
    ]


def _median(runs: list[dict[str, Any]], key: str) -> float | None:
    values = [item[key] for item in runs if item.get(key) is not None]
    return float(np.median(values)) if values else None


def _draw_growth(figure: Any, found: list[dict[str, Any]]) -> None:
    """Coverage against robot time, one curve a run of the first seed."""
    strategies = list(dict.fromkeys(item["strategy"] for item in found))
    axes = figure.subplots(1, len(strategies), sharey=True, squeeze=False)[0]
    seed = min(item["seed"] for item in found)
    for panel, strategy in zip(axes, strategies):
        for item in found:
            if item["strategy"] != strategy or item["seed"] != seed or not item["growth"]:
                continue
            times, shares = zip(*item["growth"])
            panel.plot(times, shares, "-" if item["profile"] == DEFAULT else ":", label=item["scene"], lw=1)
        panel.set_title(strategy)
        panel.set_xlabel("robot time, s")
    axes[0].set_ylabel("coverage")
    axes[0].set_ylim(0, 1)
    axes[0].legend(fontsize=7)
