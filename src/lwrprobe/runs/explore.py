"""One exploration in one call: the function behind `lwrprobe.explore` and the command of that name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.runs.own_strategy import StrategyLike
from lwrprobe.runs.progress import ProgressDisplay
from lwrprobe.runs.run import Run
from lwrprobe.runs.session import Session, Settings
from lwrprobe.scene import Scene


def explore(
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
    shown: Callable[[Session], None] | None = None,
) -> Run:
    """Explore a scene from start to end: a simulated object, or what stands in front of a real arm.

    Parameters
    ----------
    scene : a built-in name (`lwrprobe list scenes`), a scene file, or a `Scene`
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
    shown : called with the session after each sample, for a display of one's own

    Returns
    -------
    Run
        What was found. A run that ended early says so in `summary.status` and `summary.reason`.

    Raises
    ------
    InputError and its kin
        Before anything moves, for whatever cannot be run; UnknownNameError lists the names there are.
    """
    session = Session(
        scene,
        strategy=strategy,
        seed=seed,
        settings=settings,
        profile=profile,
        out=out,
        reconstructor=reconstructor,
        realtime=realtime,
        progress=progress,
        confirm=confirm,
        record=record,
    )
    with session:
        try:
            for _ in session:
                if shown is not None:
                    shown(session)
        except KeyboardInterrupt:
            session.interrupt()
        return session.finish()
