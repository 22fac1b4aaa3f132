"""`lwrprobe emulate ati`: the emulated sensor as a program of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import typer

from lwrprobe.contracts import InputError
from lwrprobe_ati.emulator.device import AtiEmulator
from lwrprobe_ati.emulator.transducer import Wrench
from lwrprobe_rig.console import run_command, serve

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def run(argv: list[str]) -> int:
    """Serve until `quit`, an interrupt or the end of the time; the exit code, 2 for bad options."""
    return run_command(app, "ati", argv)


def build(
    telnet: str,
    udp: str,
    active: str,
    loads: Mapping[int, Wrench],
    noise: float = 1.0,
    sticky: bool = False,
    faults: str = "",
    seed: int = 0,
) -> AtiEmulator:
    """The emulated sensor under any loads, those of a simulated world too; a device for `lwrprobe_rig`'s reactor."""
    if not active.isdigit():
        raise InputError("active", active, "digits from 1 to 6, such as 25")
    device = AtiEmulator(telnet, udp, [int(digit) for digit in active], noise, seed, sticky=sticky)
    for transducer, load in loads.items():
        device.set_load(transducer, load)
    device.set_faults(faults)
    return device


@app.command()
def ati(
    telnet: Annotated[str, typer.Option(help="HOST:PORT of the console.")] = "127.0.0.1:10023",
    udp: Annotated[str, typer.Option(help="HOST:PORT of commands and data.")] = "127.0.0.1:49152",
    active: Annotated[str, typer.Option(help="Transducers that are powered: 25 = inputs 2 and 5.")] = "1",
    load: Annotated[str, typer.Option(help="T=Fx,Fy,Fz,Tx,Ty,Tz in N and N-mm; several with ;.")] = "",
    faults: Annotated[str, typer.Option(help="loss=0.05,delay=0.002,pieces=0.002,... from the start.")] = "",
    noise: Annotated[float, typer.Option(help="Of the gages, in steps of about 0.6 mN.")] = 1.0,
    sticky: Annotated[bool, typer.Option(help="Keep the first destination, as some devices do.")] = False,
    control: Annotated[str, typer.Option(help="HOST:PORT of a UDP port for control lines.")] = "",
    seconds: Annotated[float, typer.Option(help="End after that long.")] = float("inf"),
    seed: Annotated[int, typer.Option(help="Of noise and faults.")] = 0,
) -> None:
    """Emulate the ATI Wireless F/T: control lines on standard input, `help` lists them."""
    device = build(telnet, udp, active, {}, noise, sticky, faults, seed)
    device.set_loads(load)
    greeting = f"ATI Wireless F/T: console at {telnet}, data at {udp}, transducers {', '.join(active)}"
    raise typer.Exit(serve({"ati": device}, greeting, control, seconds))
