"""Options of the FRI driver: table `[drivers.fri]` of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal

from lwrprobe.contracts import InputError
from lwrprobe.contracts.address import as_address


@dataclass(slots=True, frozen=True)
class FriConfig:
    """How to reach and to drive the arm.

    Attributes
    ----------
    bind : HOST:PORT of this end; the controller's friSetup names it
    remote : HOST:PORT of the controller, the only peer listened to; port 0 = any port of that host
    krl : which program runs on the controller: `A` (Stanford FRIControl: int 14 strategy, int 15 request), `B`
        (ros_control: int 0 strategy, int 1 request) or `none` (a person starts it at the pendant)
    strategy : position control or joint impedance with position set points
    stiffness, damping : N·m/rad and 0..1 of every joint, in joint impedance
    cycle : s that the controller must have been opened with: who plans motions knows it before the first datagram
        comes; 0 = whatever the datagrams say
    quality : the least rating at which command mode is asked for; below it, the run is warned of
    speed, acceleration : (7) deg/s and deg/s^2, what goes on the wire never exceeds them
    range : (7) deg, set points beyond +- this are refused
    connect_timeout, start_timeout, stop_timeout : s to wait for measurements, for command mode, for its end
    silence : s without measurement after which the connection counts as lost
    priority : real-time priority (SCHED_FIFO) of the process that answers; 0 = ordinary, -1 = 80 where the system
        permits it. Its memory is locked where the system permits that
    mass : kg of the arm's moving links; -1 = 16, the LWR 4+'s (KUKA data sheet), or 0 where a controller on a loopback
        address of this host, which is an emulated one, sends a mass matrix of zeros
    core : processor that the answering process is kept on, -1 = any
    """

    bind: str = "127.0.0.1:49938"
    remote: str = "127.0.0.1:49939"
    krl: Literal["A", "B", "none"] = "A"
    strategy: Literal["position", "joint_impedance"] = "position"
    stiffness: float = 200.0
    damping: float = 0.7
    cycle: float = 0.01
    quality: Literal["bad", "ok", "perfect"] = "ok"
    # The lower of two published columns a joint: the speed at which the controller trips is not published.
    speed: tuple[float, ...] = (110.0, 110.0, 112.5, 112.5, 180.0, 112.5, 112.5)
    acceleration: tuple[float, ...] = (1000.0,) * 7
    range: tuple[float, ...] = (169.0, 119.0, 169.0, 119.0, 169.0, 119.0, 169.0)
    connect_timeout: float = 5.0
    start_timeout: float = 20.0
    stop_timeout: float = 5.0
    silence: float = 0.25
    priority: int = -1
    mass: float = -1.0
    core: int = -1

    def __post_init__(self) -> None:
        if as_address(self.bind, "drivers.fri.bind")[1] == 0:
            raise InputError("drivers.fri.bind", self.bind, "a fixed port: the controller has to know it")
        as_address(self.remote, "drivers.fri.remote")
        for name, known in (("krl", ("A", "B", "none")), ("strategy", ("position", "joint_impedance"))):
            self._require(name, getattr(self, name) in known, "one of " + ", ".join(known))
        self._require("quality", self.quality in ("bad", "ok", "perfect"), "one of bad, ok, perfect")
        self._require("stiffness", 0.01 <= self.stiffness <= 2000.0, "0.01 .. 2000 N·m/rad")
        self._require("damping", 0.0 <= self.damping <= 1.0, "0 .. 1")
        self._require("cycle", self.cycle == 0.0 or 0.001 <= self.cycle <= 0.1, "0 or 0.001 .. 0.1 s")
        for name in ("speed", "acceleration", "range"):
            values = getattr(self, name)
            good = len(values) == 7 and all(isfinite(v) and v > 0.0 for v in values)
            self._require(name, good, "seven positive numbers, in degrees")
        for name in ("connect_timeout", "start_timeout", "stop_timeout", "silence"):
            self._require(name, 0.0 < getattr(self, name) <= 3600.0, "more than 0, at most 3600 s")
        self._require("mass", self.mass == -1.0 or 0.0 <= self.mass <= 100.0, "-1 or 0 .. 100 kg")
        self._require("priority", -1 <= self.priority <= 99, "-1 .. 99")

    def _require(self, name: str, good: bool, allowed: str) -> None:
        if not good:
            raise InputError(f"drivers.fri.{name}", getattr(self, name), allowed)
