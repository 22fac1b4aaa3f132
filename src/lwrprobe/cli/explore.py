"""`lwrprobe explore SCENE`: explore, and show what the probe is doing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lwrprobe.cli.shared_options import (
    Arm,
    Confirmed,
    Quiet,
    Realtime,
    SceneName,
    Sensor,
    Settings,
    SummaryJson,
    overrides,
)
from lwrprobe.errors import InputError

if TYPE_CHECKING:
    from lwrprobe.runs.progress import ProgressLine
    from lwrprobe.scene import Scene
    from lwrprobe.views.viewer import Viewer

_MAX_ZONES = 3  # the widest, which are listed one by one


def explore(
    scene: SceneName,
    strategy: Annotated[
        str | None, typer.Option(metavar="NAME", help="Strategy (see `lwrprobe list strategies`).")
    ] = None,
    arm: Arm = None,
    sensor: Sensor = None,
    profile: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Settings put over those of the scene: a built-in profile or a TOML file."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="Seed of all random numbers; the scene's if left out.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Run folder to write; runs/SCENE if left out.")
    ] = None,
    settings: Settings = None,
    until: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="End at time=SECONDS of robot time, or once certified=MM or accurate=MM is reached; repeatable, "
            "the first counts.",
        ),
    ] = None,
    realtime: Realtime = False,
    dry: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Explore in the simulator to the end, and report reach, limits and time; no device is opened.",
        ),
    ] = False,
    confirm: Confirmed = 0,
    record: Annotated[
        bool | None,
        typer.Option(
            "--record/--no-record", help="Write a rosbag2 bag (MCAP) into the run folder; on with real devices."
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show the exploration in the browser while it goes on (port 8080).")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a run that was cut off and could be resumed.")
    ] = False,
    as_json: SummaryJson = False,
    quiet: Quiet = False,
) -> None:
    """Explore an unseen object; write contacts, point cloud, map, mesh, picture and report into a run folder."""
    from lwrprobe.cli.checks import check_folder, check_plugins, check_replaceable, check_scene_apart
    from lwrprobe.runs.progress import ProgressLine
    from lwrprobe.scene import load_scene

    given = {"strategy.name": strategy, "arm.driver": arm, "sensor.driver": sensor, "run.seed": seed}
    changes = overrides(settings, given) + [_until(rule) for rule in until or []]

    def run_folder(found: Scene) -> Path:
        return out if out is not None else Path("runs") / found.name

    def checked(found: Scene) -> None:
        check_plugins(found)
        if not dry:
            check_folder("--out", run_folder(found))
            check_scene_apart("--out", run_folder(found), scene)
            check_replaceable("--out", run_folder(found), overwrite)

    with ProgressLine(quiet) as line:
        line.message(f"loading scene {scene}")
        loaded = load_scene(scene, changes, profile, checked)
        if dry:
            return _dry_run(loaded, line, as_json)
        folder = run_folder(loaded)
        from lwrprobe.exploration.safety.confirm import Confirm
        from lwrprobe.runs.explore import explore as run

        asking = Confirm(confirm, line.message) if confirm > 0 else None
        viewer = _viewer(loaded, line) if view else None
        shown = viewer.update if viewer is not None else None
        found = run(loaded, out=folder, realtime=realtime, progress=line, confirm=asking, record=record, shown=shown)
    if viewer is not None:
        _keep_showing(viewer, folder)
    finish(found.summary.as_dict(), folder, as_json, quiet)


def _viewer(scene: Scene, line: ProgressLine) -> Viewer:
    from lwrprobe.views.playback import of_scene
    from lwrprobe.views.viewer import Viewer

    viewer = Viewer(of_scene(scene), live=True)
    line.message(f"{viewer.url} shows the exploration")
    return viewer


def _keep_showing(viewer: Viewer, folder: Path) -> None:
    """The whole run, until Ctrl-C."""
    from threading import Event

    from lwrprobe.views.playback import playback

    viewer.finish(playback(folder))
    typer.echo(f"{viewer.url} shows the run; Ctrl-C ends", err=True)
    try:
        viewer.play(Event())
    except KeyboardInterrupt:
        viewer.close()


def finish(summary: dict[str, Any], folder: Path, as_json: bool, quiet: bool) -> None:
    """Show how a run ended; exit code 1 where that was early."""
    if not quiet:
        _show(summary, folder)
    if as_json:
        typer.echo(json.dumps(summary))
    if summary["status"] != "done":
        if quiet:
            typer.echo(f"lwrprobe: {summary['reason']}", err=True)
        raise typer.Exit(1)


def _dry_run(scene: Scene, line: ProgressLine, as_json: bool) -> None:
    from lwrprobe.exploration.procedures.dry_run import dry_run

    found = dry_run(scene, line.message)
    for reading in found.readings:
        typer.echo(f"{'  ' if reading.good else '! '}{reading.name:<28} {reading.value}")
    if as_json:
        typer.echo(json.dumps(found.summary))
    if not found.good:
        raise typer.Exit(1)


def _until(rule: str) -> str:
    """The setting that a rule of --until stands for."""
    key, equals, value = (part.strip() for part in rule.partition("="))
    if key not in ("time", "certified", "accurate") or not equals or not value:
        raise InputError("--until", rule, "time=SECONDS, certified=MM or accurate=MM")
    return f"run.until.{key}={value}"


def _show(summary: dict[str, Any], folder: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(stderr=True)
    grid = Table(show_header=False, box=None, pad_edge=False)
    for name, text in _rows(summary):
        grid.add_row(Text(name, style="dim"), Text(text))
    console.print(grid)
    console.print(Text(f"run folder: {folder}"))


def _zone(zone: dict[str, Any]) -> str:
    middle = ", ".join(f"{0.5 * (low + high):.1f}" for low, high in zip(*zone["box_mm"]))
    return f"{zone['kind']} at ({middle}) mm, {zone['width_mm']:.1f} mm wide: narrower than the probe, not reached"


def _search(summary: dict[str, Any]) -> list[tuple[str, str]]:
    if summary["search_time_s"] is None:
        return []
    found, bounded = summary["found_at_s"], summary["search_time_s"]
    return [("search", f"first touch after {found:.1f} s, bounded after {bounded:.1f} s")]


def _rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    from lwrprobe.evaluation.summary import area_by_reason

    parts = summary["wall_time_parts_s"]
    rows = [
        ("status", f"{summary['status']}: {summary['reason']}"),
        ("contacts", f"{summary['contacts']} in {summary['voxels']} voxels"),
        ("robot time", f"{summary['sim_time_s']:.1f} s, {summary['real_time_factor']:.1f} times as fast as real"),
        *_search(summary),
        ("wall time", ", ".join(f"{name} {seconds:.1f} s" for name, seconds in parts.items())),
        ("peak force", f"{summary['peak_force_n']:.2f} N"),
    ]
    if summary["link_collisions"] is not None:
        rows.append(("link collisions", str(summary["link_collisions"])))
    if summary["coverage"] is not None:
        rows.append(("coverage", f"{summary['coverage']:.1%} of what the sphere can reach"))
    if summary["truth"] and summary["truth"]["profile"] != "ideal":
        rows.append(("world", f"differs from the scene: truth.profile is {summary['truth']['profile']}"))
    for key, label, unit in (
        ("contact_error_mm", "contact error", "mm"),
        ("contact_error_aligned_mm", "contact error aligned", "mm"),
        ("surface_error_mm", "surface error", "mm"),
        ("normal_error_deg", "normal error", "deg"),
    ):
        if summary[key] is not None:
            rows.append((label, ", ".join(f"{name} {value:.3f}" for name, value in summary[key].items()) + f" {unit}"))
    if summary["mesh_error_mm"] is not None:
        mesh = summary["mesh_error_mm"]
        rows.append(("mesh error", f"{mesh['method']}: mean {mesh['mean']:.3f}, largest {mesh['hausdorff']:.2f} mm"))
    if summary["mesh_error_aligned_mm"] is not None:
        mesh = summary["mesh_error_aligned_mm"]
        rows.append(("mesh error aligned", f"mean {mesh['mean']:.3f}, largest {mesh['hausdorff']:.2f} mm"))
    expected = summary["expected_mesh_error_mm"]
    if expected is not None:
        text = f"mean {expected['whole_mean']:.3f} mm, {expected['aligned_whole_mean']:.3f} mm after alignment"
        rows.append(("mesh error expected", text))
    rows += [("bridged", _zone(zone)) for zone in summary["bridged"][:_MAX_ZONES]]
    if len(summary["bridged"]) > _MAX_ZONES:
        rows.append(("bridged", f"{len(summary['bridged']) - _MAX_ZONES} more, narrower ones"))
    if summary["open_borders"]:
        sides = ", ".join(side["side"] for side in summary["open_borders"])
        rows.append(("open border", f"{sides}: the object goes on beyond the area, the mesh is closed there"))
    if summary["untouched"]:
        left = summary["untouched"]
        area = sum(place["area_mm2"] for place in left)
        why = ", ".join(f"{part:.0f} mm²: {reason}" for reason, part in area_by_reason(left))
        rows.append(("untouched", f"{area:.0f} mm² of the mesh ({why})"))
    if summary["certified_mm"] is not None:
        volume = summary["certificate"]["unknown_cm3"]
        text = f"nothing larger than {summary['certified_mm']:.1f} mm within reach; {volume:.0f} cm^3 there not swept"
        rows.append(("certified", text))
    if summary["table_found"]:
        table = summary["table_found"]
        rows.append(("table", f"{table['contacts']} contacts left out: it leans by {table['tilt_deg']:.2f} degrees"))
    rows += [("warning", sentence) for sentence in summary["warnings"]]
    rows += [("left out", f"{item['stage']}: {item['why']}") for item in summary["left_out"]]
    return rows
