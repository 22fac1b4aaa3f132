"""Emulated KUKA KRC2 lr controller of an LWR 4+, with FRI 1.0."""

from __future__ import annotations

from typing import Annotated

import typer

from lwrprobe_fri.emulator.controller import Controller, ControllerSettings
from lwrprobe_fri.emulator.device import FriEmulator
from lwrprobe_fri.emulator.plant import LaggingArm, Plant
from lwrprobe_rig.console import joint_angles, run_command, serve
from lwrprobe_rig.shared_options import (
    DRIVER_ADDRESS,
    FRI_ADDRESS,
    Bind,
    Bridged,
    Control,
    CycleMs,
    Faults,
    Joints,
    Krl,
    Remote,
    Seconds,
)

_START = "0,45,0,-80,0,55,0"

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def run(argv: list[str]) -> int:
    """Serve until `quit`, an interrupt or the end of the time; the exit code, 2 for bad options."""
    return run_command(app, "fri", argv)


def build(
    plant: Plant,
    bind: str,
    remote: str,
    cycle: float = 0.01,
    krl: str = "A",
    acknowledge: str = "auto",
    bridged: int = 3,
    faults: str = "",
    seed: int = 0,
) -> FriEmulator:
    """The emulated controller of any arm, one in a simulated world too; a device for `lwrprobe_rig`'s reactor."""
    settings = ControllerSettings(cycle=cycle, krl=krl, acknowledge=acknowledge, bridged=bridged)
    device = FriEmulator(lambda: Controller(plant, settings), bind, remote, seed)
    device.set_faults(faults)
    return device


@app.command()
def fri(
    bind: Bind = FRI_ADDRESS,
    remote: Remote = DRIVER_ADDRESS,
    cycle_ms: CycleMs = 10.0,
    krl: Krl = "A",
    joints: Joints = _START,
    bridged: Bridged = 3,
    faults: Faults = "",
    acknowledge: Annotated[
        str, typer.Option(metavar="auto|manual", help="auto: the next start clears an error.")
    ] = "auto",
    control: Control = "",
    seconds: Seconds = float("inf"),
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the faults.")] = 0,
) -> None:
    """Emulate the KRC2 lr with FRI 1.0. Type control lines on standard input; `help` lists them, `quit` ends."""
    arm = LaggingArm(joint_angles(joints))
    device = build(arm, bind, remote, cycle_ms / 1000.0, krl, acknowledge, bridged, faults, seed)
    greeting = f"FRI controller at {bind}, answers expected from {remote}, {cycle_ms:g} ms, program {krl}"
    raise typer.Exit(serve({"fri": device}, greeting, control, seconds))
