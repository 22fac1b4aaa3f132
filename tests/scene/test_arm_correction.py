"""Table `[arm.correction]`: what it does to the robot, and that the simulated arm has it too."""

import numpy as np
import pytest

from lwrprobe.contracts import SceneError
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import gears_of, robot_of
from lwrprobe_sim.actual_world import actual_world
from lwrprobe_sim.config import SimConfig

ROW = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]


def test_the_robots_table_is_the_models_and_the_correction():
    model, corrected = (
        robot_of(load_scene("block", settings))
        for settings in ([], [f"arm.correction.dh_a_mm={ROW}", f"arm.correction.dh_offset_deg={ROW}"])
    )
    assert corrected.a - model.a == pytest.approx(1e-3 * np.array(ROW))
    assert corrected.theta - model.theta == pytest.approx(np.radians(ROW))
    assert corrected.d == pytest.approx(model.d)


def test_the_simulated_arm_differs_from_the_corrected_one_by_the_truth_alone():
    scene = load_scene(
        "block", [f"arm.correction.dh_d_mm={ROW}", "truth.profile=ideal", "truth.dh_a_mm=[0.1,0,0,0,0,0,0]"]
    )
    real, stated = actual_world(scene, SimConfig(), 1).robot, robot_of(scene)
    assert real.d == pytest.approx(stated.d)
    assert real.a - stated.a == pytest.approx([1e-4, 0, 0, 0, 0, 0, 0])


def test_gears_are_those_that_are_stated():
    assert gears_of(load_scene("block"), 7) is None
    stated = load_scene("block", [f"arm.correction.gear_sine_deg={ROW}", "arm.correction.joint_hysteresis_deg=0.01"])
    motors = np.full((1, 7), np.pi / 640.0)
    assert gears_of(stated, 7).links(motors) - motors == pytest.approx(np.radians([ROW]))


def test_rows_of_errors_have_a_number_for_all_of_table_and_tool():
    with pytest.raises(SceneError, match=r"arm.correction.errors.*31 numbers"):
        robot_of(load_scene("block", ["arm.correction.errors=[[1.0, 2.0]]"]))


@pytest.mark.parametrize("key", ["dh_twist_deg", "gear_cosine_deg"])
def test_another_number_of_joints_is_refused(key):
    scene = load_scene("block", [f"arm.correction.{key}=[1.0, 2.0]"])
    with pytest.raises(SceneError, match=rf"arm.correction.{key}.*7 numbers"):
        (robot_of if key.startswith("dh") else lambda scene: gears_of(scene, 7))(scene)
