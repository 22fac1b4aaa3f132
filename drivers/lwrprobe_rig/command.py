"""`lwrprobe emulate rig SCENE`: emulated controller and sensor in one simulated world, over real sockets."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from lwrprobe.contracts.plugins import load
from lwrprobe_rig.console import joint_angles, run_command, serve
from lwrprobe_rig.ground_truth import GroundTruth
from lwrprobe_rig.world import SimulatedWorld

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def run(argv: list[str]) -> int:
    """Serve until `quit`, an interrupt or the end of the time; the exit code, 2 for bad options."""
    return run_command(app, "rig", argv)


@app.command()
def rig(
    scene: Annotated[str, typer.Argument(help="A built-in scene or a scene file: what there is to be touched.")],
    bind: Annotated[str, typer.Option(help="HOST:PORT of the emulated controller.")] = "127.0.0.1:49939",
    remote: Annotated[str, typer.Option(help="HOST:PORT of the FRI driver.")] = "127.0.0.1:49938",
    telnet: Annotated[str, typer.Option(help="HOST:PORT of the emulated sensor's console.")] = "127.0.0.1:10023",
    udp: Annotated[str, typer.Option(help="HOST:PORT of its commands and data.")] = "127.0.0.1:49152",
    transducer: Annotated[int, typer.Option(help="Input that the probe's sensor is plugged into.")] = 1,
    cycle_ms: Annotated[float, typer.Option(help="Cycle of the interface in ms, 1 to 100.")] = 10.0,
    krl: Annotated[str, typer.Option(help="Program on the controller: A, B or none.")] = "A",
    bridged: Annotated[int, typer.Option(help="Missing answers in a row that the controller bridges.", min=0)] = 3,
    joints: Annotated[str, typer.Option(help="Where the arm stands, seven angles in degrees.")] = "",
    fri_faults: Annotated[str, typer.Option(help="Of the controller's line, from the start.")] = "",
    ati_faults: Annotated[str, typer.Option(help="Of the sensor's line, from the start.")] = "",
    control: Annotated[str, typer.Option(help="HOST:PORT of a UDP port for control lines.")] = "",
    seconds: Annotated[float, typer.Option(help="End after that long.")] = float("inf"),
    seed: Annotated[int | None, typer.Option(help="Of noise and faults; the scene's when left out.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value of the scene; repeatable.")] = None,
) -> None:
    """Let `lwrprobe explore SCENE --arm fri --sensor ati` touch a simulated object over real sockets, in real time.

    A control line begins with `fri`, `ati` or `world`: `ati fault down=1`, `fri drives off`, `world status`. At the end
    one line of JSON tells the truth: peak force and collisions.
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
    greeting = (
        f"{loaded.name}: FRI at {bind} every {cycle_ms:g} ms, answers expected from {remote}; "
        f"ATI console at {telnet}, data at {udp}, transducer {transducer}"
    )
    code = serve({"fri": arm, "ati": sensor, "world": GroundTruth(world)}, greeting, control, seconds)
    typer.echo(json.dumps(world.truth() | {"overruns": arm.overruns}))
    raise typer.Exit(code)
