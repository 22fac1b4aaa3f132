"""What hangs on the sensor, found by the arm itself: a few orientations in free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contact import Payload, identify_payload
from lwrprobe.contracts import InputError, WrenchSample
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.explorer import Explorer
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.stages.pipeline import choose, compose, robot_of
from lwrprobe.kinematics import IKSolver, IKStatus
from lwrprobe.kinematics.path import rotations
from lwrprobe.scene import Scene

LEAN = 0.4
"""rad by which the probe leans out of its usual orientation, to four sides."""
LIFT = 0.05
"""m above the start, so that a leaning holder has space."""
REST = 0.5
SECONDS = 1.0


@dataclass(slots=True, frozen=True)
class Weighing:
    """What was found, and what the scene says.

    Attributes
    ----------
    found : mass, centre of mass, bias, residual
    stated : the scene's
    """

    found: Payload
    stated: Payload

    def settings(self) -> list[str]:
        """The scene's keys that hold what was found."""
        com = ", ".join(f"{value:.5f}" for value in self.found.com)
        return [f"probe.mass={self.found.mass:.5f}", f"probe.centre_of_mass=[{com}]"]


def weigh(scene: Scene, confirm: Confirm | None = None) -> Weighing:
    """Lean the probe to four sides above the scene's start and identify the payload (`contact.identify_payload`).

    Nothing may be touched; the readings at rest alone count. `confirm` asks before the arm moves, as in `explore`.
    Raises InputError where an orientation is out of the arm's reach, and what drivers and guards raise.
    """
    robot = robot_of(scene)
    solver, (start, q) = IKSolver(robot), start_posture(scene, robot)
    places = []
    for pose in _poses(start):
        result = solver.solve(pose, q)
        if result.status != IKStatus.CONVERGED:
            raise InputError("area", np.round(pose[:3, 3], 4).tolist(), "a start above which the probe can lean")
        places.append((pose, result.q))
    devices = Devices.assemble(scene, scene.run.seed, False, q)
    pipeline = compose(scene, choose(scene), devices.arm.cycle, devices.sensor.rate)
    explorer = Explorer(scene, pipeline, devices, Recorder(None), confirm=confirm)
    samples: list[WrenchSample] = []
    rotations_of: list[np.ndarray] = []
    with devices:
        for pose, goal in places:
            explorer.start_up.take_place(pose, goal)
            explorer.start_up.listen(REST)
            usable = [sample for sample in explorer.start_up.listen(SECONDS) if sample.status == 0]
            samples += usable
            rotations_of += [pose[:3, :3]] * len(usable)
        explorer.come_to_rest()
    return Weighing(identify_payload(samples, rotations_of), Payload.of(pipeline.probe))


def _poses(start: np.ndarray) -> list[np.ndarray]:
    """Upright, then leaning to four sides about the sphere's centre."""
    poses = []
    for axis, angle in (((1, 0, 0), 0.0), ((1, 0, 0), LEAN), ((1, 0, 0), -LEAN), ((0, 1, 0), LEAN), ((0, 1, 0), -LEAN)):
        pose = start.copy()
        pose[2, 3] += LIFT
        pose[:3, :3] = rotations(np.array(axis, dtype=float), np.array([angle]))[0] @ start[:3, :3]
        poses.append(pose)
    return poses
