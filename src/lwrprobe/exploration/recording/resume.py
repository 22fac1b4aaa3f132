"""A run that was cut off, resumed where the probe was last free.

The strategy is shown what it had been shown until then, and so knows what it knew. Map, contacts and the memory of
where the sphere has been are restored the same way: an object that was moved in the meantime is noticed at the first
touch that contradicts. The probe goes over the top of the area to where it was, and down where its stick has been;
from there on the strategy continues as if nothing had happened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Done, Goal, Motion, Observation, PluginError, Progress, Strategy, Task
from lwrprobe.exploration.recording.logbook import ANSWER, SEEN, Logbook, Logged, Past, Question
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline

ARRIVED = 2e-4
"""m"""
KNOWN = 0.002
"""m from where the run was cut off, within which a touch on the return is of the surface that is known there."""


class Resumed(Logged):
    """A strategy in the state that it had when its run was cut off; first it brings the probe back.

    Parameters
    ----------
    strategy : a new one
    log : continues with what follows
    past : what the strategy had been shown
    """

    def __init__(self, strategy: Strategy, log: Logbook, past: Past) -> None:
        super().__init__(strategy, log)
        self._past = past
        self._answers = iter(past.rows[past.rows[:, 0] == ANSWER, 2])
        self._recalling = True
        self._motion: Motion | None = None
        self._old_steps = 0
        self._path: list[np.ndarray] = []
        self._speeds = (0.0, 0.0)

    @property
    def trace(self) -> Sequence[tuple[float, str, str, str]]:
        """The strategy's own time since the run was resumed."""
        return super().trace[self._old_steps :]

    def recall(self, task: Task, pipeline: Pipeline, recorder: Recorder) -> None:
        """Show the strategy its past and fill map and memory; takes seconds, so it is done before the arm is asked.

        Raises PluginError for a strategy that does not do again what it did.
        """
        past, contacts = self._past, iter(recorder.contacts)
        coming = next(contacts, None)
        try:
            self.strategy.start(
                replace(self.asking(task), start=past.start, orientation=past.orientation, delay=past.delay)
            )
            for k in np.flatnonzero(past.rows[:, 0] == SEEN):
                seen = past.observation(int(k))
                while coming is not None and coming.time <= seen.time + 1e-6:
                    pipeline.voxels.insert_point(coming.point)
                    coming = next(contacts, None)
                _remember(pipeline, seen)
                if k <= past.last:
                    self._motion = self.strategy.step(seen)
        except Exception as error:
            raise PluginError(f"the strategy does not do again what it did: {type(error).__name__}: {error}") from error
        if isinstance(self._motion, Done):
            raise PluginError("the strategy does not do again what it did: it has come to an end")
        self._recalling = False
        self._old_steps = len(super().trace)
        self._speeds = task.free_speed, task.approach_speed
        self._path = _path_back(past.observation(past.last).pose, float(task.area.upper[2]))

    def start(self, task: Task) -> None:
        """The strategy has started long ago."""

    def step(self, seen: Observation) -> Motion:
        """The return first; then what the strategy answers."""
        if not self._path:
            return super().step(seen)
        here = seen.pose[:3, 3]
        known = np.abs(here - self._path[-1][:3, 3]).max() < KNOWN
        if seen.contact is not None and not (known and len(self._path) == 1):
            return Done("something stands in the way back to where the run was cut off", complete=False)
        if seen.blocked:
            return Done(f"no way back to where the run was cut off: {seen.blocked}", complete=False)
        there = np.abs(here - self._path[0][:3, 3]).max() < ARRIVED and seen.goal_reached
        if there or seen.contact is not None:
            self._path.pop(0)
            if not self._path:
                assert self._motion is not None
                return self._motion
        speed = self._speeds[len(self._path) == 1]
        return Goal(self._path[0], speed, "back to where the run was cut off")

    def progress(self) -> Progress:
        """The strategy's own, or that the probe returns."""
        progress = super().progress()
        return replace(progress, doing="back to where the run was cut off") if self._path else progress

    def asked(self, ask: Question, poses: Sequence[np.ndarray]) -> bool:
        """The logged answer while the past is replayed, after that the present one."""
        return bool(next(self._answers, 0.0)) if self._recalling else super().asked(ask, poses)


def _path_back(pose: np.ndarray, top: float) -> list[np.ndarray]:
    """Poses (4, 4): above the place, along the stick, at the area's top; then the place."""
    above, axis = pose.copy(), pose[:3, 2]
    if axis[2] < 0.0 and pose[2, 3] < top:
        above[:3, 3] += (top - pose[2, 3]) / axis[2] * axis
    return [above, pose]


def _remember(pipeline: Pipeline, seen: Observation) -> None:
    place = seen.pose[:3, 3]
    if pipeline.sweep is not None:
        if seen.contact is None:
            pipeline.sweep.move_to(place)
        else:
            pipeline.sweep.leave()
    if pipeline.object_motion is not None:
        pipeline.object_motion.recall(place, seen.contact)
