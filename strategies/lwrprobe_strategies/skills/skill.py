"""What makes a procedure a skill: a name, the interruptions that concern it, and an entry in the run's trace.

A procedure is a generator over the strategy contract, `seen = yield motion`: it yields a motion, is sent the next
observation, and returns its outcome. It starts from the latest observation, `tip.seen`; its first motion answers that
one. One procedure calls another with `outcome = yield from skill(tip, ...)`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Concatenate, Generic, ParamSpec

from lwrprobe.contracts import Motion, Observation
from lwrprobe_strategies.outcomes import Interruption, Outcome
from lwrprobe_strategies.tip import Tip

P = ParamSpec("P")
Procedure = Generator[Motion, Observation, Outcome]


class Skill(Generic[P]):
    """A compliant motion with a typed outcome.

    Attributes
    ----------
    name : in the field's words, as the trace has it
    interruptions : which kinds the supervisor raises in it
    seeks_contact : a fresh contact is what it looks for, and is its own matter before any interruption
    """

    def __init__(
        self,
        procedure: Callable[Concatenate[Tip, P], Procedure],
        interruptions: tuple[type[Interruption], ...],
        seeks_contact: bool,
    ) -> None:
        self._procedure = procedure
        self.__doc__ = procedure.__doc__
        self.name = procedure.__name__.replace("_", " ")
        self.interruptions = frozenset(interruptions)
        self.seeks_contact = seeks_contact

    def __call__(self, tip: Tip, *args: P.args, **options: P.kwargs) -> Procedure:
        """The procedure, entered in the trace when it begins and when it ends."""
        tip.trace.begin(self)
        try:
            outcome = yield from self._procedure(tip, *args, **options)
        except Interruption as interruption:
            tip.trace.end(str(interruption))
            raise
        tip.trace.end(str(outcome))
        return outcome


def tried(step: Generator[Motion, Observation, Outcome | None]) -> Generator[Motion, Observation, Outcome | None]:
    """What a procedure ends with; None where it was interrupted."""
    try:
        return (yield from step)
    except Interruption:
        return None


def skill(
    *interruptions: type[Interruption], seeks_contact: bool = False
) -> Callable[[Callable[Concatenate[Tip, P], Procedure]], Skill[P]]:
    """Make a procedure a skill that these interruptions concern."""
    return lambda procedure: Skill(procedure, interruptions, seeks_contact)
