"""How the program on the controller is asked to start and stop: through integers that each datagram carries.

The interface is opened, started and stopped by a KRL program alone; two public ones are known here. Indices are
those of the wire, KRL's own are one higher.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lwrprobe_fri.wire import Measurement

STRATEGY_CODES = {"position": 10, "joint_impedance": 30}

Request = Literal["idle", "start", "stop"]


@dataclass(slots=True, frozen=True)
class Program:
    """Where a program looks for requests and where it answers.

    Attributes
    ----------
    strategy, request : index of the integer for the control strategy and of the request, remote to controller
    codes : what each request is written as
    answer, started : index of the program's answer and the value that claims command mode
    """

    strategy: int
    request: int
    codes: dict[Request, int]
    answer: int
    started: int

    def integers(self, request: Request, strategy: str) -> tuple[int, ...]:
        """The 16 integers that carry a request."""
        words = [0] * 16
        words[self.strategy] = STRATEGY_CODES[strategy]
        words[self.request] = self.codes[request]
        return tuple(words)

    def claims_started(self, measurement: Measurement) -> bool:
        """The program's state says that it has called friStart; the state may say otherwise."""
        return measurement.krl_int[self.answer] == self.started


class NoProgram:
    """Nobody listens to requests: a person starts and stops command mode."""

    def integers(self, request: Request, strategy: str) -> tuple[int, ...]:
        return (0,) * 16

    def claims_started(self, measurement: Measurement) -> bool:
        return False


PROGRAMS: dict[str, Program | NoProgram] = {
    "A": Program(strategy=14, request=15, codes={"idle": 0, "start": 10, "stop": 20}, answer=15, started=20),
    "B": Program(strategy=0, request=1, codes={"idle": 0, "start": 1, "stop": 0}, answer=1, started=1),
    "none": NoProgram(),
}
