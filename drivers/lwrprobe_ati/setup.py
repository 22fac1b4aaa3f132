"""Setting the device up through its console; every setting is read back before it counts."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lwrprobe.contracts import DeviceRefused
from lwrprobe_ati.calibration import Calibration, parse_calibration
from lwrprobe_ati.config import AtiConfig
from lwrprobe_ati.console import Console


@dataclass(slots=True, frozen=True)
class Setup:
    """What the device has confirmed; `firmware` is empty where it does not say."""

    calibration: Calibration
    firmware: str


def set_up(console: Console, config: AtiConfig) -> Setup:
    """Rate, power, filter and calibration as the configuration wants them; raises DeviceRefused."""
    firmware = _firmware(console)
    _set_rate(console, config)
    _power(console, config.transducer)
    _set_filter(console, config)
    return Setup(_choose_calibration(console, config), firmware)


def take_bias(console: Console, transducer: int) -> None:
    """Let the device subtract its present reading from now on.

    The reply to the command is not specified, so the table that `bias` prints is read back: it has a line for each
    biased channel. Raises DeviceRefused where the transducer is not in it.
    """
    console.ask(f"bias {transducer} on", "")
    _ask(console, "bias", rf"^\s*{transducer}\s+\d+\s+(?:ON|OFF)\b")


def _ask(console: Console, command: str, pattern: str) -> re.Match[str]:
    """What the pattern finds in the reply to a command."""
    match = re.search(pattern, console.ask(command, pattern), re.MULTILINE)
    assert match is not None, "Console.ask returns only once the pattern is in the reply"
    return match


def _firmware(console: Console) -> str:
    """For display only: a device that does not know `versions` can be used all the same."""
    try:
        return _ask(console, "versions", r"^Firmware\s+(\S+)")[1]
    except DeviceRefused:
        return ""


def _set_rate(console: Console, config: AtiConfig) -> None:
    pattern = r"Packet\s+rate\s*=\s*(\d+)[\s\S]*?Oversample\s*=\s*(\d+)"
    found = _ask(console, f"rate {config.rate} {config.oversampling}", pattern)
    rate, oversampling = int(found[1]), int(found[2])
    if (rate, oversampling) != (config.rate, config.oversampling):
        raise DeviceRefused(
            f"the device runs at {rate} Hz x {oversampling}, not at {config.rate} Hz x {config.oversampling} as asked"
        )


def _power(console: Console, transducer: int) -> None:
    console.ask(f"xpwr {transducer} on", "")
    pattern = rf"^\s*{transducer}\s+(ON|OFF)\s+(ON|OFF)\s*$"
    if _ask(console, "xpwr", pattern)[2] != "ON":
        raise DeviceRefused(f"transducer {transducer} stays without power: is it plugged into input {transducer}?")


def _set_filter(console: Console, config: AtiConfig) -> None:
    console.ask(f"filter {config.transducer} {config.filter} {config.taps}", "")
    pattern = rf"^\s*{config.transducer}\s+([A-Za-z]+)\s+(\d+)\s*$"
    kind, taps = _ask(console, "filter", pattern).groups()
    if (kind.lower(), int(taps)) != (config.filter, config.taps):
        raise DeviceRefused(f"the device filters with {kind} {taps}, not with {config.filter} {config.taps} as asked")


def _choose_calibration(console: Console, config: AtiConfig) -> Calibration:
    console.ask(f"trans {config.transducer}", rf"Transducer\s*=\s*{config.transducer}\b")
    console.ask(
        f"calib {config.calibration}",
        rf"Transducer\s*=\s*{config.transducer}\s+Calibration\s*=\s*{config.calibration}\b",
    )
    reply = console.ask("cal", r"MaxRatings:\s*\d+\s+\d+(?:\s+\S+){6}")
    calibration = parse_calibration(reply, config.transducer, config.calibration)
    if config.serial and calibration.serial != config.serial:
        raise DeviceRefused(
            f"transducer {config.transducer} has the serial number {calibration.serial or '(none)'}, "
            f"the configuration wants {config.serial}"
        )
    return calibration
