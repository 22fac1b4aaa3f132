"""Where an exploration starts: the joints keep most of their ranges, whichever arm of its kind it is."""

import numpy as np
import pytest

from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.kinematics import IKSolver
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of


def found(scene):
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    np.testing.assert_allclose(robot.fk(q).A, pose, atol=1e-5)
    return robot, pose, q


@pytest.mark.parametrize("name", ["block", "stacked_blocks", "jaw_chuck"])
@pytest.mark.parametrize("shift", [0.0, 1e-3, -1e-3])
def test_an_arm_of_slightly_other_size_starts_in_the_same_posture(name, shift):
    """The elbow is nearest to its limit in all solutions: by the least margin alone, any of them could be chosen."""
    settings = [f"arm.correction.dh_d_mm=[0,0,{1e3 * shift},0,{-0.4e3 * shift},0,0]"] if shift else []
    robot, _, q = found(load_scene(name, settings))
    reference = found(load_scene("block"))[2]
    assert np.abs(q - reference).max() < 0.5
    share = np.minimum(q - robot.lower, robot.upper - q) / (0.5 * (robot.upper - robot.lower))
    assert share.min() > 0.2
    assert np.delete(share, 3).min() > 0.5, "all but the elbow"


def test_no_other_of_many_solutions_leaves_the_joints_more_of_their_ranges():
    robot, pose, q = found(load_scene("block"))

    def left(q):
        return np.prod(np.minimum(q - robot.lower, robot.upper - q) / (0.5 * (robot.upper - robot.lower)))

    solver = IKSolver(robot)
    seeds = np.random.default_rng(7).uniform(robot.lower, robot.upper, (200, robot.n))
    others = [left(result.q) for result in (solver.solve(pose, seed) for seed in seeds) if not result.status]
    assert len(others) > 50
    assert left(q) > 0.95 * max(others)
