"""`lwrprobe repeat SCENE`: touch one place again and again, and say how well that repeats."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def repeat(
    scene: Annotated[str, typer.Argument(help="A built-in scene or a scene file.")],
    above: Annotated[
        str | None,
        typer.Option(help="x,y,z in m from where the place is sought; left out, the middle of the area's top."),
    ] = None,
    direction: Annotated[str, typer.Option(help="x,y,z of the touch.")] = "0,0,-1",
    reach: Annotated[float | None, typer.Option(help="m to seek through; to the area's bottom when left out.")] = None,
    speeds: Annotated[
        str, typer.Option(help="m/s, separated by commas; a quarter, half and all of the safe one.")
    ] = "",
    count: Annotated[int, typer.Option(help="Touches at each speed.")] = 10,
    arm: Annotated[str | None, typer.Option(help="Driver plug-in of the arm.")] = None,
    sensor: Annotated[str | None, typer.Option(help="Driver plug-in of the sensor.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value of the scene, repeatable.")] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; nothing is kept when left out.")] = None,
    realtime: Annotated[bool, typer.Option(help="A simulator keeps pace with the wall clock.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as the last line of output.")] = False,
) -> None:
    """Touch one place COUNT times at each speed: mean, sigma and range along the touch, and the bias of each speed."""
    import numpy as np

    from lwrprobe.cli.progress import ProgressLine
    from lwrprobe.exploration.procedures.repeat import Plan
    from lwrprobe.exploration.procedures.repeat import repeat as touch
    from lwrprobe.scene import load_scene

    given = (("arm.driver", arm), ("sensor.driver", sensor))
    overrides = [*(settings or []), *(f"{key}={json.dumps(value)}" for key, value in given if value is not None)]
    plan = Plan(
        above=None if above is None else np.array(_numbers("above", above, 3)),
        direction=np.array(_numbers("direction", direction, 3)),
        reach=reach,
        speeds=tuple(_numbers("speeds", speeds)) if speeds else (),
        count=count,
    )
    with ProgressLine(False) as line:
        found = touch(load_scene(scene, overrides), plan, out, realtime=realtime, watch=line.watch, tell=line.tell)
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
    from rich.table import Table

    heads = ("speed mm/s", "touches", "bias mm", "sigma mm", "range mm", "sigma across mm", "force N")
    grid = Table(*heads, title="Contact point along the touch, against the slowest speed's mean", title_justify="left")
    keys = ("speed_mm_s", "touches", "bias_mm", "sigma_mm", "range_mm", "sigma_across_mm", "force_n")
    for row in rows:
        grid.add_row(*(f"{row[key]:.4g}" for key in keys))
    Console().print(grid)
