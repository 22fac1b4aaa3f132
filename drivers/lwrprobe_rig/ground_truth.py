"""The ground truth of the simulated world on the operator's console."""

from __future__ import annotations

import json
import selectors

from lwrprobe.contracts import UnknownNameError
from lwrprobe.scene import scene_content
from lwrprobe_rig.world import SimulatedWorld

_MAX_SAMPLES = 200
"""Contacts that fit into one datagram."""


class GroundTruth:
    """A `lwrprobe_rig.reactor.Device` without sockets that answers from the simulated world.

    `status` answers one line of JSON, `mark` makes the peak since then count from now on; `scene` and
    `contacts FIRST COUNT` are what the evaluation of a run needs, as JSON.
    """

    WORDS = ("status", "mark", "scene", "contacts", "help")

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world

    def open(self, selector: selectors.BaseSelector) -> None: ...

    def due(self) -> float:
        return float("inf")

    def work(self, now: float) -> None: ...

    def close(self) -> None: ...

    def control(self, line: str) -> str:
        """One line of the operator."""
        match line.split():
            case ["status"]:
                return json.dumps(self._world.truth())
            case ["scene"]:
                return json.dumps(scene_content(self._world.ground_truth.scene))
            case ["contacts", first, count] if first.isdigit() and count.isdigit():
                return json.dumps(self._world.contacts(int(first), min(int(count), _MAX_SAMPLES)))
            case ["mark"]:
                self._world.mark()
                return "ok"
            case ["help"]:
                return "status | mark | scene | contacts FIRST COUNT | quit"
            case _:
                raise UnknownNameError("control word", line.strip(), self.WORDS)
