"""Arguments and options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

SceneName = Annotated[
    str, typer.Argument(help="Built-in scene or random:KIND:SEED (see `lwrprobe list scenes`), or scene file.")
]
Arm = Annotated[str | None, typer.Option(metavar="NAME", help="Driver of the arm (see `lwrprobe list drivers`).")]
Sensor = Annotated[str | None, typer.Option(metavar="NAME", help="Driver of the sensor (see `lwrprobe list drivers`).")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value of the scene: strategy.step=0.005; repeatable."),
]
Realtime = Annotated[bool, typer.Option("--realtime", help="Run the simulator at the speed of the wall clock.")]
Confirmed = Annotated[
    int, typer.Option(metavar="N", min=0, help="Ask before each of the first N motions; Enter stops a motion.")
]
SummaryJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON, as the last line.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress and no table.")]
