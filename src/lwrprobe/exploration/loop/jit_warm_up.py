"""Run every kernel once before the arm moves, so that none compiles while it does."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from lwrprobe.compiled.pipeline import on_compilation
from lwrprobe.contracts import WrenchSample
from lwrprobe.exploration.stages.pipeline import Choices, compose
from lwrprobe.scene import Scene


@contextmanager
def settled_memory() -> Iterator[None]:
    """While the arm moves, the collector does not walk through all that has been loaded before."""
    young, *older = gc.get_threshold()
    gc.collect()
    gc.freeze()
    # Nearly all that is made goes by itself: to look through the young so often finds nothing.
    gc.set_threshold(10 * young, *older)
    try:
        with on_compilation(lambda name: gc.freeze()):  # what a compilation leaves stays as well
            yield
    finally:
        gc.set_threshold(young, *older)
        gc.unfreeze()


def warm_up(scene: Scene, choices: Choices, cycle: float, rate: float, pose: np.ndarray, q: np.ndarray) -> None:
    """Call each stage of a throw-away pipeline with a made-up touch at the start pose."""
    pipe = compose(scene, choices, cycle, rate)
    pipe.robot.fk_into(q, np.empty((4, 4)))
    pipe.solver.track(pose, q, np.empty_like(q))
    rotation = pose[:3, :3]
    free = [WrenchSample(i / rate, np.zeros(3), np.zeros(3), i) for i in range(16)]
    pipe.conditioner.take_bias(free, rotation)
    for i, force in enumerate((0.5, 1.0, 1.0)):
        sample = WrenchSample(1.0 + i / rate, np.array([0.0, force, 0.0]), np.zeros(3), 16 + i)
        wrench = pipe.conditioner.condition(sample, rotation)
        contact = pipe.estimator.estimate(wrench, pose[:3, 3], rotation, np.zeros(3))
    pipe.add_point(contact.point)
    if pipe.sweep is not None:
        for _ in range(2):
            pipe.sweep.move_to(pose[:3, 3])
        pipe.sweep.leave()
    if pipe.object_motion is not None:
        pipe.object_motion.see(1.0, pose[:3, 3].copy(), wrench.world_force, contact)
        pipe.object_motion.see(1.1, pose[:3, 3] + 1e-3, np.zeros(3), None)
    if pipe.clearance is not None:
        pipe.clearance.nearest(pose, q)
        pipe.clearance.objection(pose, pose, q)
    pipe.place_tip(pose, q)
    ahead = pose.copy()
    ahead[2, 3] -= 0.01
    pipe.trajectory.set_goal(ahead, scene.motion.free_speed)
    pipe.trajectory.step()
    pipe.trajectory.set_velocity(np.array([0.01, 0.0, 0.0]), 0.05, None)
    pipe.trajectory.step()
    if pipe.governor is not None:
        pipe.governor.watch(q)
