"""What the emulated console answers; every line gets an answer, an unknown one a line of error text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from lwrprobe_ati.emulator.transducer import Transducer

FIRMWARE = "2.1.27"


@dataclass(slots=True)
class Settings:
    """Of the whole device; those of an input are in its `Transducer`.

    Attributes
    ----------
    active : the transducer that `calib` and `cal` speak about
    rate, oversampling : Hz and readings averaged into a record
    transmitting : `t on`
    dumping : `dump on`
    """

    active: int = 1
    rate: int = 125
    oversampling: int = 32
    brightness: int = 25
    transmitting: bool = True
    dumping: bool = False
    technician: bool = False


class Refused(Exception):
    """The line cannot be carried out; the text is the device's answer."""


@dataclass(slots=True)
class Dialogue:
    """Turns one line into the lines of its answer.

    Parameters
    ----------
    settings, transducers : what the commands read and change
    now : the clock, for `bias`
    restart : called by `reset`
    """

    settings: Settings
    transducers: Mapping[int, Transducer]
    now: Callable[[], float]
    restart: Callable[[], None]
    _table: dict[str, Callable[[list[str]], list[str]]] = field(init=False)

    def __post_init__(self) -> None:
        self._table = {
            "trans": self._trans,
            "calib": self._calib,
            "cal": self._cal,
            "rate": self._rate,
            "filter": self._filter,
            "xpwr": self._xpwr,
            "bias": self._bias,
            "bright": self._bright,
            "versions": self._versions,
            "dump": self._dump,
            "d": self._dump,
            "t": self._transmit,
            "technician": lambda words: self._mode(True),
            "user": lambda words: self._mode(False),
            "reset": self._reset,
            "net": self._net,
            "ip": self._ip,
        }

    def answer(self, line: str) -> list[str]:
        """Lines of the reply, without echo and prompt; commands are not case sensitive."""
        words = line.lower().split()
        if not words:
            return []
        fixed = _FIXED.get(words[0])
        try:
            if fixed is not None:
                return fixed
            if words[0] not in self._table:
                raise Refused(f"Error: unknown command '{words[0]}'")
            return self._table[words[0]](words[1:])
        except Refused as refusal:
            return [str(refusal)]

    def _trans(self, words: list[str]) -> list[str]:
        if words:
            self.settings.active = self._number(words[0], 6)
        return [self._active_line()]

    def _calib(self, words: list[str]) -> list[str]:
        if not words:
            rows = [f"{t.number:2d} {t.calibration:6d}" for t in self.transducers.values()]
            return ["Tr Calibration", "-- -----------", *rows]
        self._active.calibration = self._number(words[0], 3)
        return [self._active_line()]

    def _cal(self, words: list[str]) -> list[str]:
        if not words:
            return self._active.table()
        if words[0] != "mult" or words[1:] not in (["on"], ["off"]):
            raise Refused("Error: cal [mult on|off]")
        if not self.settings.technician:
            raise Refused("Error: technician mode needed")
        self._active.multiply = words[1] == "on"
        return [f"Mult:   {words[1].upper()}"]

    def _rate(self, words: list[str]) -> list[str]:
        if words:
            rate = self._number(words[0], 5000, lowest=5)
            oversampling = self._number(words[1], 64) if len(words) > 1 else self.settings.oversampling
            if rate * oversampling > 4000:
                raise Refused("Error: packet rate x oversample is limited to 4000 Hz")
            self.settings.rate, self.settings.oversampling = rate, oversampling
        rate, oversampling = self.settings.rate, self.settings.oversampling
        return [
            f"Packet rate = {rate:4d} Hz",
            f"ADC    rate = {rate * oversampling:4d} Hz",
            f"Oversample  = {oversampling:4d}",
        ]

    def _filter(self, words: list[str]) -> list[str]:
        if words:
            if len(words) < 2 or words[1] not in ("mean", "median", "iir"):
                raise Refused("Error: filter N mean|median|iir TAPS")
            taps = self._number(words[2], 255) if len(words) > 2 else 8
            self.transducers[self._number(words[0], 6)].filter = (words[1].upper(), taps)
        rows = [f"{t.number:2d} {t.filter[0]:6s} {t.filter[1]:4d}" for t in self.transducers.values()]
        return ["Tr Filter  Taps", "-- ------  ----", *rows]

    def _xpwr(self, words: list[str]) -> list[str]:
        if words and words[-1] not in ("on", "off"):
            raise Refused("Error: xpwr [N] on|off")
        if words:
            chosen = self.transducers.values() if len(words) == 1 else [self.transducers[self._number(words[0], 6)]]
            for transducer in chosen:
                transducer.set_power(words[-1] == "on")
        rows = [f"{t.number:2d} {_on(t.automatic):6s} {_on(t.powered)}" for t in self.transducers.values()]
        return ["Tr Auto   Now", "-- ----   ---", *rows, "Analog power = ON in AUTO mode"]

    def _bias(self, words: list[str]) -> list[str]:
        if words:
            if len(words) != 2 or words[1] not in ("on", "off"):
                raise Refused("Error: bias N|* on|off")
            chosen = (
                list(self.transducers.values()) if words[0] == "*" else [self.transducers[self._number(words[0], 6)]]
            )
            for transducer in chosen:
                transducer.set_bias(words[1] == "on", self.now())
        rows = [
            f"{t.number:2d} {channel:2d} {_on(t.powered):3s} {round(value):6d}"
            for t in self.transducers.values()
            if t.biased
            for channel, value in enumerate(t.bias)
        ]
        return ["Tr Ch Pwr   Bias", "-- -- ---   ----", *rows]

    def _bright(self, words: list[str]) -> list[str]:
        if words:
            self.settings.brightness = self._number(words[0], 100, lowest=0)
        level = self.settings.brightness
        return [f"LED brightness: Analog Board = {level}% Power Button = {level}%"]

    def _versions(self, words: list[str]) -> list[str]:
        return [
            "Component   Version",
            "---------   -------",
            f"Firmware    {FIRMWARE} - emulated",
            "WLAN Module emulated",
            "CPLD 0      04",
            "CPLD 1      04",
        ]

    def _dump(self, words: list[str]) -> list[str]:
        if words not in (["on"], ["off"]):
            raise Refused("Error: dump on|off")
        self.settings.dumping = words == ["on"]
        return []

    def _transmit(self, words: list[str]) -> list[str]:
        if words not in (["on"], ["off"]):
            raise Refused("Error: t on|off")
        self.settings.transmitting = words == ["on"]
        return [f"Transmit {_on(self.settings.transmitting)}"]

    def _mode(self, technician: bool) -> list[str]:
        self.settings.technician = technician
        return ["Technician mode" if technician else "User mode"]

    def _reset(self, words: list[str]) -> list[str]:
        self.restart()
        return ["Restarting"]

    def _net(self, words: list[str]) -> list[str]:
        match words[:1]:
            case ["mode"]:
                return ["NET MODE Normal CLIENT Mode"]
            case ["udpact"]:
                return ["NET UDPACT DROP"]
            case ["ap"]:
                return ["Access points: 1", "emulated  -40 dBm"]
            case ["date" | "time"]:
                return ["OK"]
            case ["key"]:
                return ["(not shown)"]
            case _:
                return ["NET sub-commands: AP DATE KEY MODE TIME UDPACT"]

    def _ip(self, words: list[str]) -> list[str]:
        return [
            "Parameter  Active            Default",
            "---------  ------            -------",
            "Device IP  192.0.2.7         192.0.2.7",
            "Gateway IP 192.0.2.1         192.0.2.1",
            "",
            "State       Type Device Remote Address",
            "LISTEN      TCP      23      0 0.0.0.0",
            "OPEN        UDP   49152      0 0.0.0.0",
            "OPEN        UDP   51000      0 0.0.0.0",
        ]

    @property
    def _active(self) -> Transducer:
        return self.transducers[self.settings.active]

    def _active_line(self) -> str:
        return f"Active: Transducer = {self.settings.active} Calibration = {self._active.calibration}"

    def _number(self, text: str, highest: int, lowest: int = 1) -> int:
        if not (text.isascii() and text.isdigit()) or not lowest <= int(text) <= highest:
            raise Refused(f"Error: '{text}' is not a number from {lowest} to {highest}")
        return int(text)


def _on(state: bool) -> str:
    return "ON" if state else "OFF"


_FIXED: dict[str, list[str]] = {
    "power": ["POWER On"],
    "band": ["Band = 2.4 GHz"],
    "ssid": ["SSID = 'emulated'"],
    "gateip": ["Gateway IP = 192.0.2.1"],
    "devip": ["Device IP = 192.0.2.7"],
    "destip": ["Destination IP = 0.0.0.0"],
    "rssi": ["RSSI = -40 dBm"],
    "wlan": ["WLAN: Power ON"],
    "ntp": ["Enable   = 0", "Server   = 0.0.0.0", "TimeZone = 0", "DST      = 0"],
    "saveall": ["Saved"],
    "sdrec": ["SD recording: no card"],
}
