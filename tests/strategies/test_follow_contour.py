"""A contour is followed with a normal that may be wrong: what the force says comes first."""

import numpy as np
import pytest

from lwrprobe.contracts import Contact, Doubt, Observation
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.follow_contour import HELD_BACK, PRESSED, last_touched, slide
from lwrprobe_strategies.tip import Tip
from strategy_task import AREA, DOWN, task

RADIUS = task().probe.radius
HERE = np.array([0.0, 0.0, 0.03])
TILTED = np.array([0.0, 0.2, 0.98]) / np.hypot(0.2, 0.98)


def touching(force, normal=TILTED, rotation=DOWN, score=1.0, reason=Doubt.NONE):
    """A tip that touches something at HERE with a force (3,) N."""
    tip, pose = Tip(task(approach=0.03)), np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, HERE
    contact = Contact(0.0, HERE - RADIUS * normal, normal, normal, HERE, score, reason)
    tip.observe(Observation(0.0, pose, np.zeros(3), np.asarray(force, dtype=float), contact))
    tip.control.begin(normal)
    return tip, TrackingFrame(Line(1, 0.0, -0.1, 0.1, 0.006), AREA)


def sliding(force, normal=TILTED):
    """(3,) m/s of the tip, some samples on."""
    tip, frame = touching(force, normal)
    for _ in range(20):
        command = slide(tip, frame, normal, "slide")
    return command.velocity


def test_a_tip_that_presses_goes_no_farther_along_its_stick():
    """The sphere sticks on a level face whose normal is found eleven degrees off."""
    wanted = task().force_target
    light, hard = sliding([0.0, -0.2, 0.8 * wanted]), sliding([0.0, -0.5, 1.01 * (PRESSED + HELD_BACK) * wanted])
    assert light[2] < -0.001, "down the slope that it believes in"
    assert hard[2] >= 0.0
    assert hard[1] == pytest.approx(light[1], rel=0.2), "it slides on"


def test_a_tip_that_presses_on_a_wall_still_goes_down_it():
    """Across the stick the probe gives way, and friction is no floor."""
    wall, force = np.array([0.0, 1.0, 0.0]), 1.5 * PRESSED * task().force_target
    assert sliding([0.0, force, 0.2 * force], wall)[2] < -0.001


def test_a_normal_that_is_only_imprecise_does_not_keep_the_sphere_stuck():
    """It is imprecise because the sphere sticks; so slow that any normal would do, it stayed stuck for long."""
    level, target = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, task().force_target])
    doubts = {"none": (1.0, Doubt.NONE), "imprecise": (0.3, Doubt.IMPRECISE), "two walls": (0.3, Doubt.AMBIGUOUS)}
    speed = {}
    for name, (score, reason) in doubts.items():
        tip, frame = touching(target, level, score=score, reason=reason)
        speed[name] = float(np.linalg.norm(slide(tip, frame, level, "slide").velocity))
    assert 2.0 * speed["two walls"] < speed["imprecise"] <= speed["none"]


def test_after_a_false_wall_the_contact_before_it_is_sought():
    tip, _ = touching([0.0, 0.0, 0.8])
    before = HERE - RADIUS * TILTED
    wall = np.array([0.0, -1.0, 0.0])
    assert last_touched(tip, HERE, wall, met=True) == pytest.approx(HERE - RADIUS * wall), "nothing else is known"
    tip.memory.add(HERE, before, TILTED, 0.0)
    assert last_touched(tip, HERE, wall, met=True) == pytest.approx(before)
    assert last_touched(tip, HERE, TILTED, met=False) == pytest.approx(before)
    far = HERE + np.array([0.0, 0.03, 0.0])
    assert last_touched(tip, far, wall, met=True) == pytest.approx(far - RADIUS * wall), "that was elsewhere"
