"""In which orientations a calibration presses, and how fast the probe may approach the sphere in each."""

import numpy as np

from lwrprobe.exploration.procedures.calibrate import MAX_STIFFNESS, feasible_leans, with_reference_sphere
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.kinematics import follow
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe_strategies.planning.sphere_touches import leaned


def test_where_the_arm_may_be_stiffer_than_assumed_along_the_stick_the_approach_is_slower():
    scene = with_reference_sphere(load_scene("block"), 0.03)
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    leans, shares = feasible_leans(scene)
    assert len(leans) == len(shares) >= 12
    assert max(shares) == 1.0
    assert min(shares) < 0.6
    for (tilt, side, spin), share in zip(leans, shares):
        path = np.tile(pose, (60, 1, 1))
        for k, part in enumerate(np.linspace(0.0, 1.0, len(path))):
            path[k, :3, :3] = leaned(pose[:3, :3], part * tilt, side, part * spin)
        there = follow(robot, path, q).q[-1]
        along = robot.jacobian(there)[:3].T @ path[-1, :3, 2]
        stiffness = 1e4 / float(along @ along)  # joints of 1e4 N m/rad, and more than twice as stiff at most
        # Another way there leaves the elbow elsewhere, which changes little along the stick.
        assert share * 2.2 * stiffness < 1.3 * MAX_STIFFNESS
