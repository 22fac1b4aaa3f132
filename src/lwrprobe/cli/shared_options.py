"""Arguments and options that several commands have."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from lwrprobe.errors import InputError

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
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def overrides(settings: list[str] | None, given: dict[str, str | int | None]) -> list[str]:
    """`--set` of a command, and what its own options set, by the scene's key; None = not given."""
    own = [f"{key}={json.dumps(value)}" for key, value in given.items() if value is not None]
    return [*(settings or []), *own]


def key_values(settings: list[str] | None) -> dict[str, str]:
    """`--set` of a command that sets no scene's values; raises InputError for what is no key=value."""
    found = {}
    for setting in settings or []:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise InputError("--set", setting, "key=value")
        found[key.strip()] = value
    return found
