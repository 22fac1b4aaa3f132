"""A run that was cut off, resumed where the probe was last free, or followed a surface.

The strategy is shown what it had been shown until then, and so knows what it knew. Map, contacts, what presses have
shown of the stiffness, and the memory of where the sphere has been are restored the same way: an object that was moved
in the meantime is noticed at the first touch that contradicts. The probe goes over the top of the area, comes down
where it was before and nothing stands above it, and drives on the path it came, off the surface; then the strategy
continues as after a contact that was lost for a moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lwrprobe.contact import Wrench
from lwrprobe.contracts import (
    Confidence,
    Contact,
    Done,
    Goal,
    Motion,
    Observation,
    PluginError,
    Progress,
    SafetyStop,
    Strategy,
    Task,
)
from lwrprobe.exploration.recording.logbook import ANSWER, SEEN, Logbook, Logged, Past, Question
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.return_path import Leg, ReturnSpeeds, return_path
from lwrprobe.exploration.stages.pipeline import Pipeline

ARRIVED = 2e-4
"""m"""
KNOWN = 0.003
"""m from the path that was driven, within which a touch on the return is of the surface that was touched there."""
ASIDE = 0.002
"""m off such a surface, before the return goes on."""
TOUCHES = 8
"""Touches of known surfaces, after which the return is given up."""


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
        self._path: list[Leg] = []
        self._touched = np.empty((0, 3))
        self._touches, self._leaving = 0, False

    @property
    def trace(self) -> Sequence[tuple[float, str, str, str]]:
        """The strategy's own time since the run was resumed."""
        return super().trace[self._old_steps :]

    def recall(self, task: Task, pipeline: Pipeline, recorder: Recorder) -> None:
        """Show the strategy its past and fill map and memory; takes seconds, so it is done before the arm is asked.

        Raises PluginError for a strategy that does not do again what it did, SafetyStop for a surface that must not be
        touched.
        """
        pipeline.force.begin(task.delay, tip_mass=task.arm_mass)
        past, contacts = self._past, iter(recorder.contacts)
        coming = next(contacts, None)
        try:
            self.strategy.start(
                replace(self.asking(task), start=past.start, orientation=past.orientation, delay=past.delay)
            )
            for k in np.flatnonzero(past.rows[:, 0] == SEEN):
                seen = past.observation(int(k))
                while coming is not None and coming.time <= seen.time + 1e-6:
                    pipeline.add_point(coming.point)
                    coming = next(contacts, None)
                _remember(pipeline, seen)
                if k <= past.last:
                    self._motion = self.strategy.step(seen)
        except SafetyStop:
            raise
        except Exception as error:
            raise PluginError(f"the strategy does not do again what it did: {type(error).__name__}: {error}") from error
        if isinstance(self._motion, Done):
            raise PluginError("the strategy does not do again what it did: it has come to an end")
        self._recalling = False
        self._old_steps = len(super().trace)
        speeds = ReturnSpeeds(task.free_speed, task.approach_speed, pipeline.force.touch_speed)
        self._path = return_path(past, task.area, task.probe.radius, speeds)
        self._touched = np.array([contact.point for contact in recorder.contacts]).reshape(-1, 3)

    def start(self, task: Task) -> None:
        """The strategy has started long ago."""

    def step(self, seen: Observation) -> Motion:
        """The return first; then what the strategy answers."""
        if not self._path:
            return super().step(seen)
        if seen.blocked:
            return Done(f"no way back to where the run was cut off: {seen.blocked}", complete=False)
        self._leaving = self._leaving and seen.contact is not None
        if seen.contact is not None and not self._goes_on(seen, seen.contact):
            return Done("something stands in the way back to where the run was cut off", complete=False)
        if self._path and self._is_near(seen, ARRIVED) and seen.goal_reached:
            self._path.pop(0)
        if not self._path:
            assert self._motion is not None
            return self._motion
        return Goal(self._path[0].pose, self._path[0].speed, "back to where the run was cut off")

    def _is_near(self, seen: Observation, distance: float) -> bool:
        """Whether each coordinate of the tip lies within `distance` [m] of the end of the leg that is driven."""
        return bool(np.abs(seen.pose[:3, 3] - self._path[0].pose[:3, 3]).max() < distance)

    def _goes_on(self, seen: Observation, contact: Contact) -> bool:
        """Whether the return goes on with a contact: the surface was touched there before, and the probe leaves it."""
        if len(self._path) == 1 and self._is_near(seen, KNOWN):
            self._path.pop(0)  # as near as the surface allows
            return True
        if self._leaving:
            return True
        self._touches += 1
        known = np.abs(self._touched - contact.point).max(axis=1).min(initial=np.inf) < KNOWN
        if not known or self._touches > TOUCHES:
            return False
        aside = seen.pose.copy()
        aside[:3, 3] += ASIDE * contact.normal
        self._path.insert(0, Leg(aside, self._path[0].speed))
        self._leaving = True
        return True

    def progress(self) -> Progress:
        """The strategy's own, or that the probe returns."""
        progress = super().progress()
        return replace(progress, doing="back to where the run was cut off") if self._path else progress

    def asked(self, ask: Question, poses: Sequence[np.ndarray]) -> bool:
        """The logged answer while the past is replayed, after that the present one."""
        return bool(next(self._answers, 0.0)) if self._recalling else super().asked(ask, poses)


def _remember(pipeline: Pipeline, seen: Observation) -> None:
    place = seen.pose[:3, 3]
    contact = seen.contact
    known = contact if contact is not None and contact.confidence is Confidence.RELIABLE else None
    wrench = Wrench(seen.time, seen.pose[:3, :3].T @ seen.force, np.zeros(3), seen.force)
    pipeline.force.update(wrench, seen.pose, known)
    if pipeline.sweep is not None:
        if seen.contact is None:
            pipeline.sweep.move_to(place)
        else:
            pipeline.sweep.leave()
    if pipeline.object_motion is not None:
        pipeline.object_motion.recall(place, seen.contact, seen.pose[:3, 2])
