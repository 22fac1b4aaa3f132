"""Speeds and forces of a contour: never faster than what the hardest surface ahead allows."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.control import run_on
from lwrprobe.control.contour_control import FORCE_RESERVE, ContourControl
from strategy_task import DOWN, task


def stiffness_along(t, normal):
    """N/m of object, arm and stick in series along a normal, for a stick along z."""
    give = t.probe.compliance[0] * (normal[0] ** 2 + normal[1] ** 2) + t.probe.compliance[2] * normal[2] ** 2
    return 1.0 / (1.0 / t.stiffness + give)


@settings(max_examples=60)
@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: sqrt(sum(x * x for x in v)) > 0.1),
    st.floats(1e3, 1e6),
)
def test_no_surface_ahead_is_hit_harder_than_the_room_allows(direction, stiffness):
    t = task(stiffness=stiffness)
    d = np.array(direction) / np.linalg.norm(direction)
    speed = ContourControl(t).approach_speed(d, DOWN)
    random = np.random.default_rng(1)
    normals = random.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:2] = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    hardest = max(stiffness_along(t, n) * max(float(d @ n), 0.0) for n in normals)
    force = t.force_threshold + hardest * (speed * t.delay + speed**2 / (2.0 * t.acceleration))
    assert force <= FORCE_RESERVE * t.force_limit * 1.02
    assert force >= 0.8 * FORCE_RESERVE * t.force_limit, "and no slower than that asks for"


@pytest.mark.parametrize("mass", [0.5, 3.2, 16.0])
def test_no_surface_ahead_is_struck_harder_by_an_arm_with_mass(mass):
    """K (v (tau + T) + v^2 / 2a) over all normals stays within the room, with the run-on T of each normal."""
    arm = 2.2e4
    t, light = replace(task(), arm_mass=mass, arm_stiffness=arm), ContourControl(task())
    control, random = ContourControl(t), np.random.default_rng(2)
    normals = random.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for direction in random.normal(size=(20, 3)):
        d = direction / np.linalg.norm(direction)
        speed, back = control.approach_speed(d, DOWN), control.return_speed(d, DOWN)
        for n in normals[normals @ d > 0.05]:
            k = stiffness_along(t, n)
            late, depth = t.delay + run_on(mass, k, arm), float(n @ d)
            force = t.force_threshold + k * depth * (speed * late + speed**2 / (2.0 * t.acceleration))
            assert force <= FORCE_RESERVE * t.force_limit * 1.02
            assert k * depth * back * run_on(mass, k, arm) <= 0.5 * t.force_target * 1.02
        assert back <= speed < light.approach_speed(d, DOWN)
        again = light.return_speed(d, DOWN)
        assert 0.5 * light.approach_speed(d, DOWN) < again < light.approach_speed(d, DOWN)


def test_a_task_may_ask_for_less():
    assert ContourControl(task(approach=0.001)).approach_speed(np.array([1.0, 0.0, 0.0]), DOWN) == 0.001


@pytest.mark.parametrize("travel", [1.0, -1.0])
def test_a_wall_is_left_downwards_more_slowly_than_it_is_climbed(travel):
    control = ContourControl(task())
    binormal = (travel, 0.0, 0.0)
    up, down = np.array([0.0, -travel, 0.0]), np.array([0.0, travel, 0.0])
    speeds = {}
    for name, normal in (("up", up), ("down", down)):
        control.begin(normal)
        velocity = control.velocity(normal, 0.8, binormal, 0.02, DOWN, 0.008)
        speeds[name] = velocity[2]
    assert speeds["up"] == pytest.approx(0.02, rel=0.05)
    assert -0.012 < speeds["down"] < 0.0


def test_too_much_force_yields_and_too_little_presses():
    control = ContourControl(task())
    normal = np.array([0.0, 0.0, 1.0])
    binormal = (1.0, 0.0, 0.0)
    for force, sign in ((1.6, 1.0), (0.3, -1.0)):
        control.begin(normal)
        velocity = control.velocity(normal, force, binormal, 0.02, DOWN, 0.008)
        assert np.sign(velocity @ normal) == sign
        assert velocity[1] > 0.0


@pytest.mark.parametrize("stiffness", [2e3, 2e4, 3e5])
def test_down_a_wall_the_foot_and_the_wall_together_stay_within_the_room(stiffness):
    t = replace(task(stiffness=stiffness), contour_speed=1.0)
    control = ContourControl(t)
    wall = np.array([0.0, -1.0, 0.0])
    control.begin(wall)
    down = -float(control.velocity(wall, t.force_target, (-1.0, 0.0, 0.0), 1.0, DOWN, 0.008)[2])
    assert down > 0.0
    up = stiffness_along(t, (0.0, 0.0, 1.0))
    foot = t.force_threshold + up * (down * t.delay + down**2 / (2.0 * t.acceleration))
    assert foot + 0.3 * t.force_target <= FORCE_RESERVE * t.force_limit * 1.001
