"""What the arm's own table and gears leave of a contact's error."""

import numpy as np
import pytest

from lwrprobe.bench.arm_alone import arm_alone
from lwrprobe.kinematics import robot_by_name

ROBOT = robot_by_name("lwr4")
JOINTS = np.array([0.3, 0.6, 0.1, -1.2, 0.2, 0.9, 0.0]) + np.random.default_rng(1).uniform(-0.1, 0.1, (400, 7))


def test_an_arm_as_stated_leaves_nothing():
    assert arm_alone(ROBOT, JOINTS, {}, 1) == pytest.approx(0.0, abs=1e-9)
    assert arm_alone(ROBOT, np.empty((0, 7)), {}, 1) is None


def test_an_offset_of_the_first_joint_turns_all_alike():
    assert arm_alone(ROBOT, JOINTS, {"dh_offset_deg": [0.05, 0, 0, 0, 0, 0, 0]}, 1) == pytest.approx(0.0, abs=1e-9)
    assert arm_alone(ROBOT, JOINTS, {"dh_offset_deg": [0, 0, 0, 0.05, 0, 0, 0]}, 1) > 1e-5


def test_waves_of_the_gears_stay_whatever_is_aligned():
    """Each of the joints off by 0.007 of a degree at most, on levers of some decimetres."""
    left = arm_alone(ROBOT, JOINTS, {"gear_ripple_deg": [0.005], "joint_hysteresis_deg": [0.003]}, 1)
    assert 3e-5 < left < 1.5e-4
