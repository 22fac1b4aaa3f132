"""Models by name, and arms from and to other libraries."""

import numpy as np
import pytest
from naive_kinematics import pose_error

from lwrprobe.contracts import FormatError, InputError, UnknownNameError
from lwrprobe.kinematics import (
    IKSolver,
    from_roboticstoolbox,
    from_urdf,
    iiwa14,
    lwr4,
    panda,
    puma560,
    robot_by_name,
    to_roboticstoolbox,
    ur5e,
)

MODELS = {"lwr4": lwr4, "iiwa14": iiwa14, "ur5e": ur5e, "panda": panda, "puma560": puma560}
TOOL = np.array([[0.0, -1, 0, 0.02], [1, 0, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1]])


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_there_and_back_through_roboticstoolbox(name):
    robot = MODELS[name](tool=TOOL, base=np.linalg.inv(TOOL))
    back = from_roboticstoolbox(to_roboticstoolbox(robot), speed=robot.speed)
    np.testing.assert_array_equal(back.chain, robot.chain)


@pytest.mark.parametrize("name", ["Puma560", "Panda", "LWR4", "Stanford", "UR5", "Cobra600"])
def test_roboticstoolbox_models_come_over(name):
    import roboticstoolbox

    theirs = getattr(roboticstoolbox.models.DH, name)()
    ours = from_roboticstoolbox(theirs)
    rng = np.random.default_rng(0)
    low, high = np.maximum(ours.lower, -3), np.minimum(ours.upper, 3)
    for q in rng.uniform(low, high, (5, ours.n)):
        np.testing.assert_allclose(ours.fk(q).A, theirs.fkine(q).A, atol=1e-12)
        np.testing.assert_allclose(ours.link_frames(q), theirs.fkine_all(q).A, atol=1e-12)


def test_puma_and_panda_have_the_tables_of_roboticstoolbox():
    import roboticstoolbox

    for ours, theirs in (
        (puma560(), roboticstoolbox.models.DH.Puma560()),
        (panda(), roboticstoolbox.models.DH.Panda()),
    ):
        other = from_roboticstoolbox(theirs)
        for name in ("a", "alpha", "d", "theta", "lower", "upper"):
            np.testing.assert_allclose(getattr(ours, name), getattr(other, name), atol=1e-12)


def test_only_dh_robots_come_over():
    with pytest.raises(InputError, match="DHRobot"):
        from_roboticstoolbox("Puma560")


def test_the_lwr_is_found_by_name_and_others_are_listed():
    robot = robot_by_name("lwr4", tool=TOOL)
    np.testing.assert_array_equal(robot.tool, TOOL)
    with pytest.raises(UnknownNameError, match="lwr4"):
        robot_by_name("lwr5")


URDF = """<robot name="three">
  <link name="root"/><link name="one"/><link name="two"/><link name="mount"/><link name="three"/><link name="tip"/>
  <joint name="a" type="revolute"><parent link="root"/><child link="one"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/><axis xyz="0 1 1"/>
    <limit lower="-1" upper="2" velocity="3" effort="1"/></joint>
  <joint name="b" type="prismatic"><parent link="one"/><child link="two"/>
    <origin xyz="0 0 0.4" rpy="1.5707963 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.2" velocity="0.5" effort="1"/></joint>
  <joint name="f" type="fixed"><parent link="two"/><child link="mount"/>
    <origin xyz="0.05 0 0" rpy="0 0.7 0"/></joint>
  <joint name="c" type="continuous"><parent link="mount"/><child link="three"/>
    <origin xyz="0 0.3 0"/><axis xyz="0 0 -1"/></joint>
  <joint name="g" type="fixed"><parent link="three"/><child link="tip"/><origin xyz="0 0 0.1" rpy="0 0 1"/></joint>
</robot>"""


def urdf_of(robot, name="arm"):
    """A URDF whose every joint turns about z, one link a DH row, written with the digits files usually have."""
    from scipy.spatial.transform import Rotation

    links, joints, before = ['<link name="link0"/>'], [], np.eye(4)
    for i in range(robot.n):
        rpy = Rotation.from_matrix(before[:3, :3]).as_euler("xyz")
        links.append(f'<link name="link{i + 1}"/>')
        joints.append(
            f'<joint name="j{i}" type="revolute"><parent link="link{i}"/><child link="link{i + 1}"/>'
            f'<origin xyz="{" ".join(f"{x:.9g}" for x in before[:3, 3])}" rpy="{" ".join(f"{x:.9g}" for x in rpy)}"/>'
            f'<axis xyz="0 0 1"/><limit lower="{robot.lower[i]}" upper="{robot.upper[i]}" '
            f'velocity="{robot.speed[i]}" effort="1"/></joint>'
        )
        a, alpha, d = robot.a[i], robot.alpha[i], robot.d[i]
        c, s = np.cos(alpha), np.sin(alpha)
        before = np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1]])
    return f'<robot name="{name}">{"".join(links)}{"".join(joints)}</robot>'


def test_a_urdf_chain_moves_as_its_reader_says(tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy")
    file = tmp_path / "three.urdf"
    file.write_text(URDF)
    robot, reference = from_urdf(file), yourdfpy.URDF.load(str(file))
    assert robot.n == 3
    assert robot.prismatic.tolist() == [False, True, False]
    np.testing.assert_allclose(robot.lower, [-1, -0.1, -np.inf])
    np.testing.assert_allclose(robot.speed, [3, 0.5, np.inf])
    for q in np.random.default_rng(0).uniform(-1, 1, (20, 3)):
        reference.update_cfg(q)
        np.testing.assert_allclose(robot.fk(q).A, reference.get_transform("tip", "root"), atol=1e-12)


def test_a_urdf_of_the_lwr_is_recognised_despite_rounded_angles(tmp_path):
    pytest.importorskip("yourdfpy")
    file = tmp_path / "lwr.urdf"
    file.write_text(urdf_of(lwr4()))
    robot, rng = from_urdf(file), np.random.default_rng(1)
    solver, q = IKSolver(robot), np.empty(7)
    assert solver.closed_form
    for true, seed in rng.uniform(robot.lower, robot.upper, (200, 2, 7)):
        pose = robot.fk(true).A
        assert solver.reach(pose, seed, q) == 0
        assert max(pose_error(robot.fk(q).A, pose)) < 1e-6
        np.testing.assert_allclose(robot.fk(true).t, lwr4().fk(true).t, atol=1e-7)


@pytest.mark.parametrize(
    ("text", "tip", "error", "match"),
    [
        (URDF, "nowhere", InputError, "tip"),
        (URDF.replace('"c" type="continuous"', '"c" type="floating"'), None, InputError, "joint c"),
        (URDF.replace('<axis xyz="0 0 -1"/>', '<axis xyz="0 0 -1"/><mimic joint="a"/>'), None, InputError, "mimic"),
        (URDF.replace('<link name="tip"/>', '<link name="tip"/><link name="x"/>'), None, InputError, "last links"),
        (URDF, "root", InputError, "moving joint"),
        ("<robot", None, FormatError, "three.urdf"),
        ("", None, FormatError, "three.urdf"),
    ],
)
def test_urdf_files_that_make_no_chain(tmp_path, text, tip, error, match):
    pytest.importorskip("yourdfpy")
    file = tmp_path / "three.urdf"
    file.write_text(text)
    with pytest.raises(error, match=match):
        from_urdf(file, tip)


def test_a_missing_urdf_file_is_named(tmp_path):
    pytest.importorskip("yourdfpy")
    with pytest.raises(FormatError, match=r"gone\.urdf"):
        from_urdf(tmp_path / "gone.urdf")
