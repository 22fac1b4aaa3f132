"""Options of the ATI Wireless F/T driver: table `[drivers.ati]` of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from lwrprobe.contracts import InputError
from lwrprobe.contracts.address import as_address
from lwrprobe.scene import Scene


@dataclass(slots=True, frozen=True)
class AtiConfig:
    """How to reach and to set up the sensor.

    Attributes
    ----------
    telnet : HOST:PORT of the device's console (port 23 on a real one)
    udp : HOST:PORT of the device's data port (49152 on a real one), the only peer listened to
    local : HOST:PORT of this end; a fixed port, since the device may go on serving the port it knows
    transducer : input 1..6 that the probe's sensor is plugged into
    calibration : 1..3 of that transducer, one that counts N and N-mm
    serial : serial number that the calibration must carry, empty = any
    rate : records per second, 0 = the scene's `sensor.rate`, or 125 without a scene
    oversampling : readings averaged into one record; rate times this is at most 4000 Hz
    filter, taps : the device's own filter: mean, median or iir, over so many readings
    timeout : s to wait for the console and for the first record
    take_over : free a console that another client holds; that client has to be dead, or it loses the sensor
    silence : s without record after which start is sent again
    lost_after : s without record after which the sensor counts as lost
    late_after : s of age beyond which a record is flagged late
    ground_truth : HOST:PORT of an emulated rig's control port, asked for the truth after a run where the device is an
        emulated one, on this host's loopback address; empty = never
    stuck_after : s over which six unchanging values are flagged frozen, 0 = never
    """

    telnet: str = "127.0.0.1:10023"
    udp: str = "127.0.0.1:49152"
    local: str = "127.0.0.1:49153"
    transducer: int = 1
    calibration: int = 1
    serial: str = ""
    rate: int = 0
    oversampling: int = 16
    filter: Literal["mean", "median", "iir"] = "mean"
    taps: int = 8
    timeout: float = 5.0
    take_over: bool = False
    silence: float = 0.1
    lost_after: float = 1.0
    late_after: float = 0.05
    stuck_after: float = 0.5
    ground_truth: str = "127.0.0.1:49160"

    def __post_init__(self) -> None:
        for name in ("telnet", "udp", "local"):
            as_address(getattr(self, name), f"drivers.ati.{name}")
        if self.ground_truth:
            as_address(self.ground_truth, "drivers.ati.ground_truth")
        self._require("transducer", 1 <= self.transducer <= 6, "1 .. 6")
        self._require("calibration", 1 <= self.calibration <= 3, "1 .. 3")
        self._require("rate", self.rate == 0 or 5 <= self.rate <= 4000, "0, or 5 .. 4000 Hz")
        highest = 4000 // (self.rate or 5)
        self._require(
            "oversampling", 1 <= self.oversampling <= highest, f"1 .. {highest}, so that rate x it is at most 4000"
        )
        self._require("filter", self.filter in ("mean", "median", "iir"), "mean, median, iir")
        self._require("taps", 1 <= self.taps <= 64, "1 .. 64")
        for name in ("timeout", "silence", "lost_after", "late_after"):
            self._require(name, 0.0 < getattr(self, name) <= 60.0, "more than 0, at most 60 s")
        self._require("lost_after", self.lost_after >= self.silence, "at least as long as silence")
        if self.rate:
            self._require("silence", self.silence >= 2.0 / self.rate, f"at least two records, {2.0 / self.rate:g} s")
        self._require("stuck_after", 0.0 <= self.stuck_after <= 60.0, "0 .. 60 s")

    def at_rate_of(self, scene: Scene | None) -> AtiConfig:
        """The same with a rate, checked against the rest: its own, or the scene's."""
        if self.rate:
            return self
        return replace(self, rate=round(scene.sensor.rate) if scene is not None else 125)

    def _require(self, name: str, good: bool, allowed: str) -> None:
        if not good:
            raise InputError(f"drivers.ati.{name}", getattr(self, name), allowed)
