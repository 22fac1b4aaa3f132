"""The ground truth of the simulated world on the operator's console."""

from __future__ import annotations

import json
import selectors

from lwrprobe.contracts import UnknownNameError
from lwrprobe_rig.world import SimulatedWorld


class GroundTruth:
    """A `lwrprobe_rig.reactor.Device` without sockets that answers from the simulated world.

    `status` answers one line of JSON, `mark` makes the peak since then count from now on.
    """

    WORDS = ("status", "mark", "help")

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world

    def open(self, selector: selectors.BaseSelector) -> None: ...

    def due(self) -> float:
        return float("inf")

    def work(self, now: float) -> None: ...

    def close(self) -> None: ...

    def control(self, line: str) -> str:
        """One line of the operator."""
        match line.strip():
            case "status":
                return json.dumps(self._world.truth())
            case "mark":
                self._world.mark()
                return "ok"
            case "help":
                return "status | mark | quit"
            case _:
                raise UnknownNameError("control word", line.strip(), self.WORDS)
