"""Emulated ATI Wireless F/T force/torque sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import typer

from lwrprobe.contracts import InputError
from lwrprobe_ati.emulator.device import AtiEmulator
from lwrprobe_ati.emulator.transducer import Wrench
from lwrprobe_rig.console import run_command, serve
from lwrprobe_rig.shared_options import CONSOLE_ADDRESS, DATA_ADDRESS, Control, Faults, Seconds, Telnet, Udp

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
    telnet: Telnet = CONSOLE_ADDRESS,
    udp: Udp = DATA_ADDRESS,
    active: Annotated[
        str, typer.Option(metavar="DIGITS", help="Inputs with a powered transducer: 25 means 2 and 5.")
    ] = "1",
    load: Annotated[
        str,
        typer.Option(metavar="T=Fx,...,Tz", help="Load on input T: T=Fx,Fy,Fz,Tx,Ty,Tz in N and N-mm; several with ;"),
    ] = "",
    faults: Faults = "",
    noise: Annotated[
        float, typer.Option(metavar="X", help="Noise of the strain gages, in steps of about 0.6 mN.")
    ] = 1.0,
    sticky: Annotated[
        bool, typer.Option("--sticky", help="Keep the first destination of the data, as some devices do.")
    ] = False,
    control: Control = "",
    seconds: Seconds = float("inf"),
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of noise and faults.")] = 0,
) -> None:
    """Emulate the ATI Wireless F/T. Type control lines on standard input; `help` lists them, `quit` ends."""
    device = build(telnet, udp, active, {}, noise, sticky, faults, seed)
    device.set_loads(load)
    greeting = f"ATI Wireless F/T: console at {telnet}, data at {udp}, transducers {', '.join(active)}"
    raise typer.Exit(serve({"ati": device}, greeting, control, seconds))
