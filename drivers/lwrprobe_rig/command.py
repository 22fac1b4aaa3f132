"""Emulated arm controller (FRI) and sensor (ATI) in one simulated scene: explore it as if it were hardware."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from lwrprobe.contracts.plugins import load
from lwrprobe_rig.console import joint_angles, run_command, serve
from lwrprobe_rig.ground_truth import GroundTruth
from lwrprobe_rig.shared_options import (
    CONSOLE_ADDRESS,
    DATA_ADDRESS,
    DRIVER_ADDRESS,
    FRI_ADDRESS,
    Bind,
    Bridged,
    CycleMs,
    Joints,
    Krl,
    Remote,
    Seconds,
    Telnet,
    Udp,
)
from lwrprobe_rig.world import SimulatedWorld

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def run(argv: list[str]) -> int:
    """Serve until `quit`, an interrupt or the end of the time; the exit code, 2 for bad options."""
    return run_command(app, "rig", argv)


@app.command()
def rig(
    scene: Annotated[
        str, typer.Argument(help="Built-in scene (see `lwrprobe list scenes`) or scene file: the object to touch.")
    ],
    bind: Bind = FRI_ADDRESS,
    remote: Remote = DRIVER_ADDRESS,
    telnet: Telnet = CONSOLE_ADDRESS,
    udp: Udp = DATA_ADDRESS,
    transducer: Annotated[
        int, typer.Option(metavar="N", help="Number of the input that the sensor is connected to, 1 to 6.")
    ] = 1,
    cycle_ms: CycleMs = 10.0,
    krl: Krl = "A",
    bridged: Bridged = 3,
    joints: Joints = "",
    fri_faults: Annotated[
        str, typer.Option(metavar="FAULTS", help="Faults of the controller's connection: loss=0.05,delay=0.002,...")
    ] = "",
    ati_faults: Annotated[
        str, typer.Option(metavar="FAULTS", help="Faults of the sensor's connection: loss=0.05,delay=0.002,...")
    ] = "",
    control: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="UDP port that accepts control lines; empty for none.")
    ] = "127.0.0.1:49160",
    seconds: Seconds = float("inf"),
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="Seed of noise and faults; the scene's if left out.")
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change one value of the scene; repeatable.")
    ] = None,
) -> None:
    """Emulate arm and sensor for `lwrprobe explore SCENE --arm fri --sensor ati`, over real sockets, in real time.

    Control lines on standard input begin with `fri`, `ati` or `world`: `ati fault down=1`, `world status`; `quit` ends.
    The last line of output is JSON: the true peak force and the collisions.
    """
    from lwrprobe.scene import load_scene

    loaded = load_scene(scene, settings or [])
    seed = loaded.run.seed if seed is None else seed
    world = SimulatedWorld(loaded, seed, joint_angles(joints) if joints else None)
    controller = {"cycle": cycle_ms / 1000.0, "krl": krl, "bridged": bridged, "faults": fri_faults, "seed": seed}
    arm = load("emulator", "fri").build(world, bind, remote, **controller)
    # The world's sensor brings its own noise.
    loads = {transducer: world.wrench}
    sensor = load("emulator", "ati").build(telnet, udp, str(transducer), loads, 0.0, faults=ati_faults, seed=seed)
    sensor.set_load(transducer, lambda instant: world.record(sensor.sequence, instant), world.measured_at)
    greeting = (
        f"{loaded.name}: FRI at {bind} every {cycle_ms:g} ms, answers expected from {remote}; "
        f"ATI console at {telnet}, data at {udp}, transducer {transducer}"
    )
    code = serve({"fri": arm, "ati": sensor, "world": GroundTruth(world)}, greeting, control, seconds)
    typer.echo(json.dumps(world.truth() | {"overruns": arm.overruns}))
    raise typer.Exit(code)
