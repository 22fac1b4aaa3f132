"""Options that several emulators have."""

from __future__ import annotations

from typing import Annotated

import typer

Bind = Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the emulated controller.")]
Remote = Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the FRI driver.")]
CycleMs = Annotated[float, typer.Option(metavar="MS", help="Cycle time of the interface in ms, 1 to 100.")]
Krl = Annotated[str, typer.Option(metavar="A|B|none", help="KRL program that runs on the controller.")]
Bridged = Annotated[
    int, typer.Option(metavar="N", min=0, help="Missing answers in a row that the controller tolerates.")
]
Joints = Annotated[str, typer.Option(metavar="DEG,DEG,...", help="Start position: seven joint angles in degrees.")]
Telnet = Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the sensor's console (telnet).")]
Udp = Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the sensor's commands and data (UDP).")]
Faults = Annotated[
    str, typer.Option(metavar="FAULTS", help="Faults of the device's connection: loss=0.05,delay=0.002,...")
]
Control = Annotated[str, typer.Option(metavar="HOST:PORT", help="UDP port that accepts control lines.")]
Seconds = Annotated[float, typer.Option(metavar="S", help="Stop after this time in s.")]

FRI_ADDRESS, DRIVER_ADDRESS = "127.0.0.1:49939", "127.0.0.1:49938"
CONSOLE_ADDRESS, DATA_ADDRESS = "127.0.0.1:10023", "127.0.0.1:49152"
