"""Strategies that are no plug-in: a class, an object or a plain function from a notebook or a script."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, get_args

from lwrprobe.contracts import STRATEGY_CONTRACT, InputError, Motion, Observation, PluginError, Progress, Task
from lwrprobe.contracts.options import configure
from lwrprobe.exploration.stages.pipeline import Choices, choose
from lwrprobe.scene import Scene

_MOTIONS = get_args(Motion)
_FORMS = "a name, a class or an object with start(task) and step(observation), or a function of an observation"

StrategyLike = Any
"""A name; a class or an object with `start(task)` and `step(observation)`; a function of an observation."""


class OwnStrategy:
    """Gives an object or a function the interface of a strategy plug-in; what it lacks gets a default.

    Parameters
    ----------
    inner : an object with `start` and `step`, or a function of an observation that returns a motion
    name : shown while nothing else is known
    """

    Config: ClassVar[type] = object
    contract: ClassVar[int] = STRATEGY_CONTRACT

    def __init__(self, inner: Any, name: str) -> None:
        self.inner, self._name = inner, name
        self._step: Callable[[Observation], Motion] = inner.step if hasattr(inner, "step") else inner

    @property
    def trace(self) -> Sequence[tuple[float, str, str, str]]:
        """Its own, or none."""
        return getattr(self.inner, "trace", ())

    @property
    def line_spacing(self) -> float | None:
        """m between two lines, where it says so."""
        return getattr(self.inner, "line_spacing", None)

    def start(self, task: Task) -> None:
        """Hand it the task; a function has no use for it."""
        if hasattr(self.inner, "start"):
            self.inner.start(task)

    def step(self, observation: Observation) -> Motion:
        """Its motion; raises TypeError for what is none."""
        motion = self._step(observation)
        if not isinstance(motion, _MOTIONS):
            allowed = ", ".join(kind.__name__ for kind in _MOTIONS)
            raise TypeError(f"step returned {type(motion).__name__}; allowed: {allowed}")
        return motion

    def progress(self) -> Progress:
        """Its own, or its name."""
        return self.inner.progress() if hasattr(self.inner, "progress") else Progress(self._name)


def choose_own(scene: Scene, strategy: StrategyLike = None, reconstructor: Any = None) -> tuple[Scene, Choices]:
    """The scene under its strategy's name, and what runs in it; None leaves the choice to the scene.

    `strategy` is a class, an object or a function, `reconstructor` an object with `reconstruct(record)`. Raises what
    `choose` raises, InputError for what is neither, and PluginError for a strategy that was written for another
    version of the contract.
    """
    if reconstructor is not None and not callable(getattr(reconstructor, "reconstruct", None)):
        allowed = "a reconstructor's name, or an object with reconstruct(record)"
        raise InputError("reconstructor", reconstructor, allowed)
    if strategy is None:
        return scene, choose(scene, reconstructor=reconstructor)
    name = getattr(strategy, "__name__", type(strategy).__name__)
    make, options = _maker(scene, strategy, name)
    own = scene.model_copy(update={"strategy": scene.strategy.model_copy(update={"name": name})})
    return own, choose(own, make, options, reconstructor)


def _maker(scene: Scene, strategy: StrategyLike, name: str) -> tuple[Callable[[], OwnStrategy], object]:
    """What makes the strategy for a run, and its options."""
    stated = getattr(strategy, "contract", STRATEGY_CONTRACT)
    if stated != STRATEGY_CONTRACT:
        raise PluginError(
            f"strategy {name!r}: written for contract {stated}, this lwrprobe speaks contract {STRATEGY_CONTRACT}"
        )
    has_both = callable(getattr(strategy, "start", None)) and callable(getattr(strategy, "step", None))
    if not has_both and (isinstance(strategy, type) or not callable(strategy)):
        raise InputError("strategy", strategy, _FORMS)
    if not isinstance(strategy, type):
        return lambda: OwnStrategy(strategy, name), None
    config = getattr(strategy, "Config", None)
    options = None if config is None else configure(config, scene.strategy.options, f"strategy {name}")
    return lambda: OwnStrategy(strategy(), name), options
