"""Links on the arm itself, carried by its joints' frames, are watched like those behind the sphere."""

from dataclasses import replace

import numpy as np

from lwrprobe.contracts import DriverContext, LinkShape
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene import ProbeTable
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe_sim import SimConfig, SimDriver, actual_world

START = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0])


def test_a_forearm_that_sinks_into_the_table_is_counted(monkeypatch):
    forearm = np.eye(4)
    forearm[2, 3] = -0.2  # half way down the forearm, along the fifth link's axis
    link = LinkShape("forearm", "capsule", (0.05, 0.1), forearm, "5")
    plain = ProbeTable.as_probe
    monkeypatch.setattr(ProbeTable, "as_probe", lambda table: replace(plain(table), links=()))
    monkeypatch.setattr(actual_world, "robot_of", lambda scene: replace(robot_of(scene), links=(link,)))
    scene = load_scene("empty", ["truth.profile=ideal", "table.height=-1.0"])
    driver = SimDriver(DriverContext(SimConfig(start_q=tuple(START), lag=0.0), scene, 1))
    frame = driver._world.robot.link_frames(START)[5] @ forearm
    below = float(frame[2, 3]) - 0.2
    area = [f"area.lower=[-0.05, -0.05, {below + 0.006}]", f"area.upper=[0.05, 0.05, {below + 0.1}]"]
    scene = load_scene("empty", ["truth.profile=ideal", f"table.height={below}", *area])
    driver = SimDriver(DriverContext(SimConfig(start_q=tuple(START), lag=0.0), scene, 1))
    arm, truth = driver.arm(), driver.ground_truth()
    arm.open()
    q, lowest = START.copy(), []
    while truth.link_collisions == 0 and len(lowest) < 2000:
        q[1] += 0.0005
        arm.command(q)
        state = arm.read()
        pose = driver._world.robot.link_frames(state.q)[5] @ forearm
        lowest.append(pose[2, 3] - abs(pose[2, 2]) * 0.05 - 0.05)
    assert abs(lowest[-1] - below) < 1e-3
    assert min(lowest[:-1]) > below - 1e-9
