"""An object that is not screwed down: it holds, slides, turns and tips by the laws of friction and levers."""

import numpy as np
import pytest
from gantry_rig import Rig, kernels

from lwrprobe.contracts import InputError
from lwrprobe_sim import body_kernels as body

MOVABLE = ["object.0.movable=true", "object.0.mass=0.5", "probe.mass=0.0"]
GRAVITY = (0.0, 0.0, -9.81)
WEIGHT = 0.5 * 9.81


def pushed(way, height=0.01, x=0.0, overrides=(), seconds=0.5, **config):
    """A rig whose sphere starts 1 mm off the block's -y side and goes `way` m in +y."""
    start = (x, -0.031, height)
    rig = Rig(start, [*MOVABLE, *overrides], gravity=GRAVITY, **config)
    wrench = rig.line(start, (x, -0.031 + way, height), seconds)
    return rig, wrench[:, 1]  # the sensor's y is the world's -y


def mode(rig):
    return rig.world.state[kernels.BODY + body.MODE]


def test_rests_below_the_friction_of_its_foot():
    rig, force = pushed(0.00115)
    assert force[-1] == pytest.approx(1.5, rel=0.02)
    assert (rig.world.object_pose() == np.eye(4)).all()


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5, 1e6, 1e7])
def test_slides_at_the_friction_of_its_foot(stiffness):
    rig, force = pushed(0.01, overrides=[f"object.0.stiffness={stiffness}"], seconds=2.0)
    assert force[-1] == pytest.approx(0.4 * WEIGHT, rel=0.01)
    moved = rig.world.object_pose()[1, 3]
    assert moved == pytest.approx(0.009 - force[-1] / stiffness, abs=2e-5)
    assert rig.unbalanced == 0


def test_stops_when_no_longer_pushed():
    rig, _ = pushed(0.005)
    at = rig.centre
    rig.line(at, at - (0.0, 0.005, 0.0), 0.5)
    assert mode(rig) == body.RESTING
    where = rig.world.object_pose()
    rig.go(*[rig.centre] * 100)
    assert (rig.world.object_pose() == where).all()
    assert rig.wrench == pytest.approx(0.0)


def test_turns_towards_the_side_that_is_pushed():
    rig, force = pushed(0.01, x=0.04)
    pose = rig.world.object_pose()
    assert pose[1, 0] > 0.05
    assert force.max() < 0.4 * WEIGHT
    touched = pose[:3, :3] @ [0.04, -0.025, 0.01] + pose[:3, 3]
    assert rig.centre[1] + 0.005 == pytest.approx(touched[1], abs=1e-3)


def test_tips_over_its_far_edge_when_it_cannot_slide():
    rig, force = pushed(0.004, height=0.045, foot_friction=1.0, overrides=["object.0.damping=50.0"], seconds=1.0)
    assert mode(rig) == body.TIPPING
    assert force.max() == pytest.approx(WEIGHT * 0.025 / 0.045, rel=0.1)
    far_edge = rig.world.object_pose() @ [0.0, 0.025, 0.0, 1.0]
    assert far_edge[:3] == pytest.approx([0.0, 0.025, 0.0], abs=1e-6)
    at = rig.centre
    rig.line(at, at - (0.0, 0.008, 0.0), 0.4)
    rig.go(*[rig.centre] * 500)
    assert mode(rig) == body.RESTING
    assert rig.world.object_pose() == pytest.approx(np.eye(4), abs=1e-9)


def test_falls_on_its_side_when_pushed_too_far():
    rig, _ = pushed(0.035, height=0.045, foot_friction=1.0, seconds=2.0)
    assert mode(rig) == body.LYING
    pose = rig.world.object_pose()
    assert pose[:3, :3] @ [0.0, 0.0, 1.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert pose[:3, :3] @ [0.0, 0.025, 0.0] + pose[:3, 3] == pytest.approx([0.0, 0.025, 0.0], abs=1e-9)


@pytest.mark.parametrize("height", [0.005, 0.025, 0.045])
def test_a_firm_foot_tips_and_a_slippery_one_slides(height):
    assert mode(pushed(0.006, height, foot_friction=0.05, seconds=1.0)[0]) == body.SLIDING
    tips = WEIGHT * 0.025 / height
    rig, _ = pushed(0.006, height, foot_friction=1.5, seconds=1.0)
    assert mode(rig) == (body.TIPPING if tips < 1.5 * WEIGHT else body.SLIDING)


def test_pressing_down_holds_it_by_the_added_friction():
    rig = Rig((0.0, 0.0, 0.0555), [*MOVABLE, "object.0.friction=1.0"], gravity=GRAVITY)
    rig.line((0.0, 0.0, 0.0555), (0.0, 0.0, 0.0546), 0.1)
    rig.line((0.0, 0.0, 0.0546), (0.003, 0.0, 0.0546), 0.5)
    # the sphere sticks to the top (friction 1) and drags the block (friction 0.4 of weight and press)
    assert -rig.force[0] == pytest.approx(0.4 * (WEIGHT + rig.force[2]), rel=0.02)
    assert rig.world.object_pose()[0, 3] > 2e-3


def test_at_most_one_object_may_move():
    with pytest.raises(InputError, match="at most one"):
        Rig((0.0, 0.0, 0.3), ["object.0.movable=true", "object.1.movable=true"], scene="stacked_blocks")
