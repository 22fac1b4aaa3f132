"""`lwrprobe emulate NAME ...`: the emulated devices, for whoever has no hardware."""

from __future__ import annotations

from typing import Annotated

import typer


def emulate(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="fri, ati or rig; an entry of the group lwrprobe.emulators.")],
) -> None:
    """Run an emulated device; `lwrprobe emulate NAME --help` lists its own options."""
    from lwrprobe.contracts.plugins import load

    arguments = list(context.args)
    if name == "rig" and arguments and not arguments[0].startswith("-") and "--joints" not in arguments:
        arguments += ["--joints", _start_of(arguments[0])]
    raise typer.Exit(load("emulator", name).run(arguments))


def _start_of(scene: str) -> str:
    """Where an exploration of the scene begins, so that the emulated arm stands there and not a metre away."""
    from math import degrees

    from lwrprobe.exploration.procedures.start_posture import start_posture
    from lwrprobe.exploration.stages.pipeline import robot_of
    from lwrprobe.scene import load_scene

    loaded = load_scene(scene)
    _, q = start_posture(loaded, robot_of(loaded))
    return ",".join(f"{degrees(angle):.6f}" for angle in q)
