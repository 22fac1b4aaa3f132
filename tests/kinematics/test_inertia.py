"""Mass of an arm, against kinetic energy from finite differences and by hand."""

import numpy as np
import pytest

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import LinkInertia, Robot, apparent_mass, link_inertias, lwr4, mass_matrix, robot_by_name


def plane_arm(lengths=(0.5, 0.5)):
    n = len(lengths)
    flat, wide = np.zeros(n), np.full(n, np.pi)
    return Robot("plane", np.array(lengths), flat, flat, flat, -wide, wide, np.ones(n))


@pytest.mark.parametrize("name", ["lwr4", "ur5e", "panda", "puma560"])
def test_the_mass_matrix_gives_the_kinetic_energy_of_the_moving_links(name):
    """Twin: each link's frame a little earlier and later, its centre's velocity and its turn from their difference."""
    robot, random, step = robot_by_name(name), np.random.default_rng(5), 1e-6
    links = link_inertias(robot, 16.0)
    for _ in range(3):
        q, speed = random.uniform(-1.0, 1.0, robot.n), random.uniform(-1.0, 1.0, robot.n)
        before, after = robot.link_frames(q - step * speed), robot.link_frames(q + step * speed)
        energy = 0.0
        for link, a, b in zip(links, before[1:], after[1:]):
            centre = [f[:3, :3] @ link.centre + f[:3, 3] for f in (a, b)]
            moved = (centre[1] - centre[0]) / (2.0 * step)
            spin = (b[:3, :3] - a[:3, :3]) / (2.0 * step) @ (0.5 * (a + b))[:3, :3].T
            turn = (0.5 * (a + b))[:3, :3].T @ [spin[2, 1], spin[0, 2], spin[1, 0]]
            energy += 0.5 * link.mass * moved @ moved + 0.5 * turn @ link.tensor @ turn
        assert 0.5 * speed @ mass_matrix(robot, links, q) @ speed == pytest.approx(energy, rel=1e-5)


def test_links_share_the_mass_by_their_volume():
    links = link_inertias(lwr4(), 16.0)
    assert len(links) == 7
    assert sum(link.mass for link in links) == pytest.approx(16.0)
    assert links[0].mass > links[6].mass > 0.0
    rods = link_inertias(plane_arm(), 3.0)
    assert [link.mass for link in rods] == [1.5, 1.5]
    np.testing.assert_allclose(rods[0].centre, [-0.25, 0.0, 0.0])


def test_a_point_mass_on_a_rod_shows_itself_at_the_rod_s_end():
    """One joint, a mass m at the rod's end: m across the rod; along it the joint gives no way at all."""
    robot = plane_arm((0.5,))
    link = LinkInertia(2.0, np.zeros(3), np.zeros((3, 3)))
    assert mass_matrix(robot, (link,), np.zeros(1)) == pytest.approx(2.0 * 0.25)
    assert apparent_mass(robot, 2.0, np.zeros(1)) == 2.0


def test_the_lwr_shows_a_few_kilograms_above_the_table():
    """Pointing down with a tool of 25 cm, the arm gives way to a vertical push by its shoulder and elbow."""
    tool = np.eye(4)
    tool[2, 3] = 0.25
    robot, q = lwr4(tool), np.radians([0.0, 30.0, 0.0, -80.0, 0.0, 70.0, 0.0])
    found = apparent_mass(robot, 16.0, q)
    assert 2.0 < found < 6.0
    assert apparent_mass(robot, 8.0, q) == pytest.approx(0.5 * found)


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan, np.inf])
def test_a_mass_that_is_none_is_refused(mass):
    with pytest.raises(InputError, match="arm mass"):
        apparent_mass(lwr4(), mass, np.zeros(7))
