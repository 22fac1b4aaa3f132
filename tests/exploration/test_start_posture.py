"""Where an exploration starts: the joints keep most of their ranges, whichever arm of its kind it is."""

from dataclasses import replace
from importlib.metadata import EntryPoint

import numpy as np
import pytest

import lwrprobe as lp
from lwrprobe.contracts import plugins
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.kinematics import IKSolver, from_urdf, sample_workspace
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


JOINTS = [  # type, axis, offset from the joint before it in m
    ("continuous", "0 0 1", "0 0 0.3"),
    ("revolute", "0 1 0", "0 0 0.1"),
    ("revolute", "0 1 0", "0 0 0.4"),
    ("continuous", "1 0 0", "0.1 0 0"),
    ("revolute", "0 1 0", "0.3 0 0"),
    ("continuous", "1 0 0", "0.08 0 0"),
]


@pytest.fixture
def endless_arm(tmp_path, monkeypatch):
    """An arm of a URDF with joints that turn without end, known by the name `my_arm`."""
    links = "".join(f'<link name="link{n}"/>' for n in range(len(JOINTS) + 1))
    limit = {"revolute": '<limit lower="-2.9" upper="2.9" velocity="2" effort="50"/>', "continuous": ""}
    parts = "".join(
        f'<joint name="joint{n}" type="{kind}"><parent link="link{n}"/><child link="link{n + 1}"/>'
        f'<origin xyz="{offset}"/><axis xyz="{axis}"/>{limit[kind]}</joint>'
        for n, (kind, axis, offset) in enumerate(JOINTS)
    )
    (tmp_path / "my_arm.urdf").write_text(f'<robot name="my_arm">{links}{parts}</robot>')
    robot = from_urdf(tmp_path / "my_arm.urdf")

    class Entry(EntryPoint):
        def load(self):
            return lambda tool=None, base=None: robot

    found, own = plugins._entries, Entry("my_arm", "my_robot:my_arm", "lwrprobe.robots")
    monkeypatch.setattr(plugins, "_entries", lambda kind: [*found(kind), *([own] if kind == "robot" else ())])
    return robot


@pytest.mark.slow
def test_an_arm_whose_joints_turn_without_end_explores(endless_arm):
    """Its start was drawn between infinite limits: OverflowError."""
    assert np.isinf(endless_arm.upper).sum() == 3
    settings = {
        "arm.robot": "my_arm", "arm.tool.xyz": [0.0, 0.0, 0.2], "arm.tool.rpy_deg": [0.0, 90.0, 0.0],
        "arm.base.xyz": [-0.5, 0.0, 0.0], "truth.profile": "ideal", "strategy.step": 0.03,
        "area.lower": [-0.012, -0.012, 0.045], "area.upper": [0.012, 0.012, 0.058],
    }  # fmt: skip
    run = lp.explore("sphere", seed=1, settings=settings, progress=False)
    assert run.summary.status == "done"
    assert run.summary.surface_error_mm["median"] < 0.1


def test_joint_values_are_drawn_half_a_turn_around_the_middle_where_there_is_no_limit(endless_arm):
    endless = replace(
        endless_arm, lower=np.array([-np.inf, -1, 4, -np.inf, -2, -2]), upper=[np.inf, 1, np.inf, -4, 2, 2]
    )
    low, high = endless.span
    np.testing.assert_array_equal(low, [-np.pi, -1.0, 4.0, -4.0 - np.pi, -2.0, -2.0])
    np.testing.assert_array_equal(high, [np.pi, 1.0, 4.0 + np.pi, -4.0, 2.0, 2.0])
    drawn = sample_workspace(endless, 200).q
    assert ((drawn >= low) & (drawn <= high)).all()
    assert (np.ptp(drawn, axis=0) > 0.9 * (high - low)).all()
