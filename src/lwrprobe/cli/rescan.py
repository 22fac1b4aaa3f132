"""`lwrprobe rescan RUN --region X0,Y0,X1,Y1`: touch a part of an object again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lwrprobe.cli.explore import finish
from lwrprobe.cli.shared_options import Confirmed, Quiet, Settings, SummaryJson, overrides

if TYPE_CHECKING:
    from lwrprobe.runs.run import Run


def rescan(
    run: Annotated[Path, typer.Argument(help="Run folder.", show_default=False)],
    region: Annotated[
        str,
        typer.Option(metavar="X0,Y0,X1,Y1", help="Corners in m, world frame: where the sphere's centre may go."),
    ],
    strategy: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Strategy (see `lwrprobe list strategies`); the run's if left out."),
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Run folder to write; RUN-rescan if left out.")
    ] = None,
    confirm: Confirmed = 0,
    record: Annotated[
        bool | None,
        typer.Option(
            "--record/--no-record", help="Write a rosbag2 bag (MCAP) into the run folder; on with real devices."
        ),
    ] = None,
    as_json: SummaryJson = False,
    quiet: Quiet = False,
) -> None:
    """Explore a part of a run's area again, and say how far the new contacts are from the run's."""
    from lwrprobe.cli.checks import (
        beside,
        check_apart,
        check_folder,
        check_name,
        check_plugins,
        check_replaceable,
        check_run,
    )
    from lwrprobe.errors import InputError
    from lwrprobe.runs.progress import ProgressLine
    from lwrprobe.scene import load_scene

    check_run("run", run)
    check_name("strategy", strategy)
    try:
        x0, y0, x1, y1 = (float(text) for text in region.split(","))
    except ValueError:
        raise InputError("--region", region, "four numbers X0,Y0,X1,Y1 in m") from None
    earlier = load_scene(run / "scene.toml")
    low, high = earlier.area.lower, earlier.area.upper
    lower, upper = [max(x0, low[0]), max(y0, low[1]), low[2]], [min(x1, high[0]), min(y1, high[1]), high[2]]
    if not (lower[0] < upper[0] and lower[1] < upper[1]):
        allowed = f"a part of the run's area, {low[0]:g},{low[1]:g},{high[0]:g},{high[1]:g}"
        raise InputError("--region", region, allowed)
    changes = [f"area.lower={lower}", f"area.upper={upper}", *overrides(settings, {"strategy.name": strategy})]
    scene = load_scene(run / "scene.toml", changes)
    # Departures of a simulated object may have widened the area again: the region is what was asked for.
    area = scene.area.model_copy(update={"lower": tuple(lower), "upper": tuple(upper)})
    scene = scene.model_copy(update={"area": area})
    check_plugins(scene)
    folder = out if out is not None else beside(run, "-rescan")
    check_folder("--out", folder)
    check_apart("--out", folder, [run])
    check_replaceable("--out", folder)
    from lwrprobe.exploration.safety.confirm import Confirm
    from lwrprobe.runs.explore import explore
    from lwrprobe.runs.run import Run

    with ProgressLine(quiet) as line:
        asking = Confirm(confirm, line.message) if confirm > 0 else None
        found = explore(scene, out=folder, progress=line, confirm=asking, record=record)
    if not quiet:
        typer.echo(_apart(Run.read(run), found), err=True)
        typer.echo(f"`lwrprobe merge {run} {folder} --out FOLDER` joins both", err=True)
    finish(found.summary.as_dict(), folder, as_json, quiet)


def _apart(old: Run, new: Run) -> str:
    """How far the new contacts are from the old surface, along the old normals."""
    import numpy as np
    from scipy.spatial import cKDTree

    if not (len(old.contacts) and len(new.contacts)):
        return "one of the runs has no contacts, so there is nothing to compare"
    distance, at = cKDTree(old.contacts.points).query(new.contacts.points)
    along = np.abs(((new.contacts.points - old.contacts.points[at]) * old.contacts.normals[at]).sum(axis=1))
    near = distance < 0.01
    if not near.any():
        return "the new contacts lie where the run has none"
    return f"new contacts are {1e3 * np.median(along[near]):.3f} mm off the run's surface (median of {near.sum()})"
