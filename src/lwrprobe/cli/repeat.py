"""`lwrprobe repeat SCENE`: repeatability, from touching one place again and again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.shared_options import Arm, Realtime, SceneName, Sensor, Settings, overrides


def repeat(
    scene: SceneName,
    above: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Start of each approach in m; the middle of the area's top if left out."),
    ] = None,
    direction: Annotated[str, typer.Option(metavar="X,Y,Z", help="Direction of the approach.")] = "0,0,-1",
    reach: Annotated[
        float | None,
        typer.Option(metavar="M", help="Longest approach in m; down to the area's bottom if left out."),
    ] = None,
    speeds: Annotated[
        str,
        typer.Option(
            metavar="V,V,...", help="Approach speeds in m/s; a quarter, a half and all of the safe one if left out."
        ),
    ] = "",
    count: Annotated[int, typer.Option(metavar="N", help="Touches at each speed.")] = 10,
    arm: Arm = None,
    sensor: Sensor = None,
    settings: Settings = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Run folder to write; nothing is written if left out.")
    ] = None,
    realtime: Realtime = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON, as the last line.")] = False,
) -> None:
    """Touch one place N times at each speed: mean, sigma and range along the approach, and the bias of each speed."""
    import numpy as np

    from lwrprobe.cli.checks import check_folder, check_plugins, check_replaceable, check_scene_apart
    from lwrprobe.runs.progress import ProgressLine
    from lwrprobe.scene import load_scene

    changes = overrides(settings, {"arm.driver": arm, "sensor.driver": sensor})
    check_folder("--out", out)
    if out is not None:
        check_scene_apart("--out", out, scene)
        check_replaceable("--out", out, overwrite=True)
    loaded = load_scene(scene, changes, check=check_plugins)
    from lwrprobe.exploration.procedures.repeat import Plan
    from lwrprobe.exploration.procedures.repeat import repeat as touch

    plan = Plan(
        above=None if above is None else np.array(_numbers("above", above, 3)),
        direction=np.array(_numbers("direction", direction, 3)),
        reach=reach,
        speeds=tuple(_numbers("speeds", speeds)) if speeds else (),
        count=count,
    )
    with ProgressLine(False) as line:
        found = touch(loaded, plan, out, realtime=realtime, watch=line.watch, message=line.message)
    _show(found["speeds"])
    if as_json:
        typer.echo(json.dumps(found))


def _numbers(name: str, text: str, count: int | None = None) -> list[float]:
    from lwrprobe.contracts import InputError

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or (count is not None and len(numbers) != count):
        raise InputError(f"--{name}", text, f"{count or 'some'} numbers, separated by commas")
    return numbers


def _show(rows: list[dict[str, float]]) -> None:
    from rich.console import Console

    from lwrprobe.cli.table import print_table

    heads = ("speed mm/s", "touches", "bias mm", "sigma mm", "range mm", "sigma across mm", "force N")
    keys = ("speed_mm_s", "touches", "bias_mm", "sigma_mm", "range_mm", "sigma_across_mm", "force_n")
    title = "Contact point along the approach, relative to the mean at the slowest speed"
    print_table(Console(), title, heads, [[f"{row[key]:.4g}" for key in keys] for row in rows])
