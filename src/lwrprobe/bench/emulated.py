"""Emulated devices in processes of their own, and addresses on this host that nobody listens to."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.contracts import DriverError
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.scene import Scene
from lwrprobe.scene.scene_robot import robot_of

_RUN = (
    "import sys; from lwrprobe.contracts.plugins import load; sys.exit(load('emulator', sys.argv[1]).run(sys.argv[2:]))"
)


def free_addresses(count: int, kind: int = socket.SOCK_DGRAM) -> list[str]:
    """`127.0.0.1:PORT` each, of sockets of one kind that were free a moment ago."""
    probes = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    addresses = [f"127.0.0.1:{probe.getsockname()[1]}" for probe in probes]
    for probe in probes:
        probe.close()
    return addresses


@contextmanager
def emulated(name: str, *arguments: str) -> Iterator[None]:
    """An emulator, by its plug-in's name, while the block runs; raises DriverError when it does not start."""
    process = subprocess.Popen(
        [sys.executable, "-c", _RUN, name, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        if not process.stdout.readline():  # type: ignore[union-attr]
            raise DriverError(f"the emulator {name} did not start")
        yield
    finally:
        process.kill()
        process.communicate()


@dataclass(slots=True, frozen=True)
class Rig:
    """An emulated arm and sensor in one simulated world, by their addresses."""

    bind: str
    remote: str
    udp: str
    local: str
    control: str
    telnet: str

    @classmethod
    def anywhere(cls) -> Rig:
        """At addresses that are free."""
        return cls(*free_addresses(5), *free_addresses(1, socket.SOCK_STREAM))

    @property
    def settings(self) -> list[str]:
        """Of a scene that is explored with these devices."""
        fri, ati = {"bind": self.bind, "remote": self.remote}, {"telnet": self.telnet, "udp": self.udp}
        ati |= {"local": self.local, "ground_truth": self.control}
        drivers = {"fri": fri, "ati": ati}
        return [f'drivers.{driver}.{key}="{at}"' for driver, keys in drivers.items() for key, at in keys.items()]

    def running(
        self, name: str, scene: Scene, settings: Sequence[str], *arguments: str
    ) -> AbstractContextManager[None]:
        """The rig with a scene of that name and its `settings`, the arm where a run of `scene` begins."""
        _, q = start_posture(scene, robot_of(scene))
        words = ["--bind", self.remote, "--remote", self.bind, "--telnet", self.telnet, "--udp", self.udp]
        words += ["--control", self.control, "--joints", ",".join(f"{angle:.6f}" for angle in np.degrees(q))]
        words += [word for setting in settings for word in ("--set", setting)]
        return emulated("rig", name, *words, *arguments)

    def ask(self, line: str) -> str:
        """The answer to an operator's line; raises DriverError when none comes."""
        host, _, port = self.control.partition(":")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            control.settimeout(10.0)
            control.sendto(line.encode(), (host, int(port)))
            try:
                return control.recv(8192).decode()
            except TimeoutError:
                raise DriverError(f"the emulated rig did not answer {line!r}") from None

    def truth(self) -> dict[str, Any]:
        """What the simulated world knows now."""
        found: dict[str, Any] = json.loads(self.ask("world status"))
        return found
