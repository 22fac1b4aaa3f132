"""An exploration step by step: one's own loop around the runner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from lwrprobe.contracts import Contact, Goal, InputError, LwrprobeError, Observation, Strategy
from lwrprobe.exploration.loop.explorer import Outcome
from lwrprobe.exploration.procedures.explore import Exploration, RunOptions
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.mapping import VoxelMap
from lwrprobe.runs.own_strategy import OwnStrategy, StrategyLike, choose_own
from lwrprobe.runs.progress import ProgressDisplay, compilation_shown, progress_display
from lwrprobe.runs.run import Contacts, Run
from lwrprobe.scene import Scene, load_scene

Settings = Mapping[str, Any] | Sequence[str]
"""Keys of the scene file with their values, or texts `key=value`."""


class Session:
    """One exploration in one's own hands: step by step, with a look at everything in between.

    The arm moves inside the `with` block, and only during a call: each `step` advances to the next wrench sample.
    At the end of the block the arm is brought to rest and the devices are released. ::

        with Session("block", strategy="grid_version", seed=7) as session:
            for observation in session:
                if session.time > 20.0:
                    break
        run = session.finish()

    Parameters
    ----------
    scene : a built-in name, a scene file, or a `Scene`
    strategy : name of a plug-in; or a class or an object with `start(task)` and `step(observation)`; or a function of
        an `Observation` that returns a `Goal`, `VelocityCommand` or `Done`. None = the scene's
    seed : of everything random, None = the scene's
    settings : keys of the scene file: `{"probe.radius": 0.004}`, or `["probe.radius=0.004"]`
    profile : settings put over those of the scene: a built-in profile (`thesis`) or a file
    out : run folder, None = nothing is kept on disk
    reconstructor : name of a plug-in, or an object with `reconstruct(record)`; None = the scene's
    realtime : a simulator keeps pace with the wall clock
    progress : show what is going on; or a display of one's own with `message` and `watch`
    confirm : asks the operator for each of the first motions, None = does not ask
    record : write a bag into the run folder (extra `bags`); None = on real devices

    Attributes
    ----------
    scene : with the settings

    Raises InputError and its kin, before anything moves, for whatever cannot be run.
    """

    def __init__(
        self,
        scene: str | Path | Scene,
        *,
        strategy: StrategyLike = None,
        seed: int | None = None,
        settings: Settings | None = None,
        profile: str | None = None,
        out: str | Path | None = None,
        reconstructor: Any = None,
        realtime: bool = False,
        progress: bool | ProgressDisplay = True,
        confirm: Confirm | None = None,
        record: bool | None = None,
    ) -> None:
        loaded = load_scene(scene, settings or (), profile)
        named = {"strategy.name": strategy, "reconstruction.method": reconstructor}
        given: dict[str, Any] = {key: name for key, name in named.items() if isinstance(name, str)}
        if seed is not None:
            given["run.seed"] = seed
        if given:
            loaded = load_scene(loaded, given)
        own = [choice if not isinstance(choice, str) else None for choice in (strategy, reconstructor)]
        self.scene, choices = choose_own(loaded, *own)
        self._display = progress_display(not progress) if isinstance(progress, bool) else progress
        self._options = RunOptions(
            out=None if out is None else Path(out), realtime=realtime, watch=self._display.watch,
            message=self._display.message, choices=choices, confirm=confirm, record=record,
        )  # fmt: skip
        self._exploration: Exploration | None = None
        self._steps: Iterator[Observation] = iter(())
        self._shown = ExitStack()
        self._entered = False

    def __enter__(self) -> Self:
        if self._entered:
            raise InputError("session", "begun already", "a new Session for each exploration")
        self._entered = True
        with ExitStack() as shown:
            shown.enter_context(self._display)
            shown.enter_context(compilation_shown(self._display))
            exploration = Exploration(self.scene, self._options)
            exploration.__enter__()
            self._exploration = exploration
            self._shown = shown.pop_all()
        self._steps = iter(exploration)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._begun.close()
        self._shown.__exit__(kind, error, trace)

    def __iter__(self) -> Iterator[Observation]:
        """Go on sample by sample until the strategy is done or the run has ended early."""
        return self

    def __next__(self) -> Observation:
        return next(self._steps)

    def step(self) -> Observation | None:
        """Go on to the next wrench sample; what the strategy was shown, None when the run has ended."""
        return next(self._steps, None)

    @property
    def observation(self) -> Observation | None:
        """What the strategy was shown last, None before the first sample."""
        return self._begun.explorer.observation

    @property
    def contact(self) -> Contact | None:
        """The contact at the last sample, None where nothing was touched."""
        seen = self.observation
        return None if seen is None else seen.contact

    @property
    def contacts(self) -> Contacts:
        """What has been touched so far."""
        return contacts_of(self._begun.recorder)

    @property
    def joints(self) -> np.ndarray:
        """(n,) rad, at the sample of the last observation."""
        return self._begun.explorer.arm.history.q.copy()

    @property
    def goal(self) -> np.ndarray | None:
        """(3,) m, where the strategy wants the tip to go, None while it gives velocities."""
        motion = self._begun.explorer.asked
        return motion.pose[:3, 3] if isinstance(motion, Goal) else None

    @property
    def doing(self) -> str:
        """What the strategy does now, in words."""
        return self._begun.pipeline.progress().doing

    @property
    def map(self) -> VoxelMap:
        """The voxel map as it grows."""
        return self._begun.pipeline.voxels

    @property
    def time(self) -> float:
        """s since the start of the run, on the robot's clock."""
        return self._begun.explorer.time

    @property
    def outcome(self) -> Outcome | None:
        """How the run ended, None while it runs."""
        return self._begun.explorer.outcome

    @property
    def strategy(self) -> Strategy | Any:
        """The strategy object; one's own as it was given."""
        strategy: Any = self._begun.pipeline.strategy
        while not isinstance(strategy, OwnStrategy) and hasattr(strategy, "strategy"):
            strategy = strategy.strategy
        return strategy.inner if isinstance(strategy, OwnStrategy) else strategy

    def interrupt(self) -> None:
        """End the run as Ctrl-C does; for a caller that caught one in its own loop."""
        self._begun.interrupt()

    def finish(self) -> Run:
        """End the run where it still runs, make the mesh, compare it with the truth; what was found."""
        exploration = self._begun
        summary = exploration.finish()
        self._display.__exit__(None, None, None)
        recorder, surface = exploration.recorder, exploration.surface
        return Run(
            self.scene,
            contacts_of(recorder),
            exploration.record,
            recorder.trace(),
            summary,
            self._options.out,
            exploration.pipeline.voxels,
            None if surface is None else surface.mesh,
        )

    @property
    def _begun(self) -> Exploration:
        if self._exploration is None:
            raise LwrprobeError("the session has not begun: use it as `with Session(...) as session:`")
        return self._exploration


def contacts_of(recorder: Recorder) -> Contacts:
    """What a recorder holds, as arrays."""
    contacts = recorder.contacts
    return Contacts(
        recorder.points(),
        recorder.normals(),
        np.array([contact.magnitude for contact in contacts]),
        np.array([contact.time for contact in contacts]),
        np.array([contact.confidence_score for contact in contacts]),
    )
