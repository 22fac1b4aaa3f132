"""The KRL programs that open, start and stop the interface, as two public controllers run them.

KRL counts from 1, the wire and this file from 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

STRATEGIES = {10: 1, 20: 2, 30: 3}
"""Code asked for -> value of the measurement's `control` field: position, Cartesian and joint impedance."""


class Interface(Protocol):
    """What a program may do and ask: the KRL functions and variables of FRI."""

    @property
    def quality(self) -> int: ...

    @property
    def commanding(self) -> bool: ...

    def set_strategy(self, control: int) -> None: ...

    def fri_start(self, safety: float) -> None: ...

    def fri_stop(self) -> None: ...


class Program(Protocol):
    """A KRL program: it reads what the remote asks for and answers in the integers of the measurement."""

    answers: list[int]

    def poll(self, asked: Sequence[int], interface: Interface) -> None: ...


class ProgramA:
    """Stanford's FRIControl: integer 14 names the strategy, 15 the request; it answers in 15.

    20 in its answer means that friStart was called, not that command mode is on.
    """

    def __init__(self) -> None:
        self.answers = [0] * 16
        self.answers[14] = 30
        self.answers[15] = 10

    def poll(self, asked: Sequence[int], interface: Interface) -> None:
        if asked[15] == 10 and self.answers[15] != 20:
            interface.set_strategy(STRATEGIES.get(asked[14], 1))
            interface.fri_start(1.0)
            self.answers[15] = 20
        elif asked[15] == 20 and self.answers[15] != 10:
            interface.fri_stop()
            self.answers[15] = 10
        elif asked[15] == self.answers[14]:
            interface.fri_stop()
            # The real program ends here and is started again by a person; the code alternates, so that an old one
            # does not end the next run.
            self.answers[14] = 70 - self.answers[14]
            self.answers[15] = 10


class ProgramB:
    """CentroEPiaggio's ros_control: integer 0 names the strategy, 1 asks for start or stop; it waits for PERFECT."""

    def __init__(self) -> None:
        self.answers = [0] * 16
        self.answers[1] = 10

    def poll(self, asked: Sequence[int], interface: Interface) -> None:
        if asked[1] == 1 and self.answers[1] != 1:
            if interface.quality < 3:
                return
            interface.set_strategy(STRATEGIES.get(asked[0], 1))
            interface.fri_start(1.0)
            self.answers[1] = 1
        elif asked[1] == 0 and self.answers[1] == 1:
            interface.fri_stop()
            self.answers[1] = 0


class ByHand:
    """No program listens: the operator starts and stops, here by `start` and `stop` on the control line."""

    def __init__(self) -> None:
        self.answers = [0] * 16

    def poll(self, asked: Sequence[int], interface: Interface) -> None: ...


PROGRAMS: dict[str, Callable[[], Program]] = {"A": ProgramA, "B": ProgramB, "none": ByHand}
