"""What an emulated rig knows of the run over it: the true forces, collisions and contacts, for the evaluation alone.

A real device has no such port. It is asked only where the device's own address is one of this host's loopback.
"""

from __future__ import annotations

import json
import socket
from typing import Any

import numpy as np

from lwrprobe.contracts import ConnectionLost, TrueContact
from lwrprobe.contracts.address import as_address, is_loopback
from lwrprobe.scene import Scene
from lwrprobe_ati.config import AtiConfig

_WAIT = 2.0  # s for an answer; the emulator looks at the port between two of its cycles
_TRIES = 5  # a busy host may keep both processes from running for that long
_PAGE = 100  # contacts an answer
_LARGEST = 65536


class EmulatedTruth:
    """`lwrprobe.contracts.GroundTruth`, asked for over the rig's control port.

    Parameters
    ----------
    config : of the sensor; its `ground_truth` is the port
    ahead : how far the device's record numbers are ahead of the samples' sequence

    Attributes
    ----------
    scene, differences, link_collisions, peak_force, probe_peak_force : see `lwrprobe.contracts.GroundTruth`

    Raises ConnectionLost when nothing answers.
    """

    def __init__(self, config: AtiConfig, ahead: int) -> None:
        self._address = as_address(config.ground_truth, "drivers.ati.ground_truth")
        self._ahead = ahead
        self._pages: dict[int, list[list[float] | None]] = {}
        status = self._ask("world status", tries=1)  # a sensor alone has no such port
        self.scene = Scene.model_validate(self._ask("world scene"))
        self.differences: dict[str, Any] = status["differences"]
        self.link_collisions = int(status["link_collisions"])
        self.peak_force = float(status["peak_force_n"])
        self.probe_peak_force = float(status["probe_peak_force_n"])

    @classmethod
    def of(cls, config: AtiConfig, ahead: int | None) -> EmulatedTruth | None:
        """That of the rig which the sensor belongs to; None for a real device, and where no rig answers."""
        host, _ = as_address(config.udp, "drivers.ati.udp")
        if not config.ground_truth or ahead is None or not is_loopback(host):
            return None
        try:
            return cls(config, ahead)
        except (ConnectionLost, KeyError):
            return None  # an emulated sensor alone, without a world

    def contact_at(self, sequence: int) -> TrueContact | None:
        """True contact at the instant of the wrench sample with that sequence number, None when free."""
        page, row = divmod(sequence + self._ahead, _PAGE)
        if page not in self._pages:
            self._pages[page] = self._ask(f"world contacts {page * _PAGE} {_PAGE}")
        found = self._pages[page][row]
        return None if found is None else TrueContact(np.array(found[:3]), np.array(found[3:6]), found[6])

    def _ask(self, line: str, tries: int = _TRIES) -> Any:
        for _ in range(tries):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
                port.settimeout(_WAIT)
                try:
                    port.connect(self._address)
                    port.send(line.encode())
                    return json.loads(port.recv(_LARGEST))
                except TimeoutError:
                    continue
                except (OSError, ValueError):
                    break
        raise ConnectionLost(f"{line!r}: no answer from {self._address} (drivers.ati.ground_truth)")
