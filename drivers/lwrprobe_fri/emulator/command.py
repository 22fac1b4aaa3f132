"""`lwrprobe emulate fri`: the emulated controller as a program of its own."""

from __future__ import annotations

from typing import Annotated

import typer

from lwrprobe_fri.emulator.controller import Controller, ControllerSettings
from lwrprobe_fri.emulator.device import FriEmulator
from lwrprobe_fri.emulator.plant import LaggingArm, Plant
from lwrprobe_rig.console import joint_angles, run_command, serve

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
    bind: Annotated[str, typer.Option(help="HOST:PORT of the emulated controller.")] = "127.0.0.1:49939",
    remote: Annotated[str, typer.Option(help="HOST:PORT of the driver.")] = "127.0.0.1:49938",
    cycle_ms: Annotated[float, typer.Option(help="Cycle of the interface in ms, 1 to 100.")] = 10.0,
    krl: Annotated[str, typer.Option(help="Program on the controller: A, B or none.")] = "A",
    joints: Annotated[str, typer.Option(help="Where the arm stands, seven angles in degrees.")] = _START,
    bridged: Annotated[int, typer.Option(help="Missing answers in a row that are bridged.", min=0)] = 3,
    faults: Annotated[str, typer.Option(help="loss=0.05,delay=0.002,quality=bad,... from the start.")] = "",
    acknowledge: Annotated[str, typer.Option(help="auto: the next start clears an error; manual.")] = "auto",
    control: Annotated[str, typer.Option(help="HOST:PORT of a UDP port for control lines.")] = "",
    seconds: Annotated[float, typer.Option(help="End after that long.")] = float("inf"),
    seed: Annotated[int, typer.Option(help="Of the faults.")] = 0,
) -> None:
    """Emulate the KRC2 lr with FRI 1.0: control lines on standard input, `help` lists them."""
    arm = LaggingArm(joint_angles(joints))
    device = build(arm, bind, remote, cycle_ms / 1000.0, krl, acknowledge, bridged, faults, seed)
    greeting = f"FRI controller at {bind}, answers expected from {remote}, {cycle_ms:g} ms, program {krl}"
    raise typer.Exit(serve({"fri": device}, greeting, control, seconds))
