"""What gave way under the contacts: learnt from all touches, taken off all contacts, stated as far as it is known."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contact import TouchRise
from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.corrections import Corrections
from lwrprobe.exploration.recording.error_sources import recorded_budget
from lwrprobe.exploration.recording.give import joint_compliance, learn, rise_slopes, take_give_off
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.exploration.stages.touch_law import arm_stiffness
from lwrprobe.kinematics import IKSolver
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

SCENE = load_scene("block", ["uncertainty.profile=lab"])
ROBOT = robot_of(SCENE)
FACES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
BIASED = 0.65
"""Of the true compliance along the stick: what presses showed in simulated worlds."""


def explored(compliance, stick=1.04, arm=1.1, noise=0.0):
    """Recorder and pipeline of touches on five faces of a block, and the true points.

    The object has `compliance` m/N; stick and arm give way that much more than stated. A third of the contacts was
    corrected with what the scene states, the others with what presses showed.
    """
    pipeline, solver, random = compose(SCENE, choose(SCENE), 0.001, 125.0), IKSolver(ROBOT), np.random.default_rng(1)
    start = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0])
    joint, radius = joint_compliance(SCENE, pipeline, start), SCENE.probe.radius
    axial = 1.0 / arm_stiffness(SCENE)
    press = BIASED * (arm * axial + compliance)
    pipeline.force = SimpleNamespace(
        rises=SimpleNamespace(found=[]),
        stiffness=SimpleNamespace(pressed=(press, 0.1 * press), sigma=lambda *_: 0.1 * press),
        zero=SimpleNamespace(age=np.zeros_like),
    )
    recorder, true, time = Recorder(None), [], 0.0
    for visit in range(6):
        for face in FACES:
            time += 5.0
            point = np.array([0.0, 0.0, 0.03]) + 0.04 * face + 0.01 * random.uniform(-1.0, 1.0, 3)
            pose = np.array(ROBOT.fk(start).A)
            pose[:3, 3] = point + radius * face
            q = np.array(solver.solve(pose, start).q)
            turn, linear = pose[:3, :3], ROBOT.jacobian(q)[:3]
            soft = turn @ np.diag(pipeline.probe.compliance) @ turn.T
            gives = stick * soft + arm * joint * linear @ linear.T + compliance * np.outer(face, face)
            pushes = np.linspace(0.05, 0.85, 15)[:, None] * (face - 0.3 * np.roll(face, 1))
            places = pose[:3, 3] - pushes @ gives + noise * random.standard_normal((15, 3))
            pipeline.force.rises.found.append(TouchRise(time, places, pushes))
            used = 1.0 / SCENE.contact.stiffness if visit < 2 else press
            for place, push in zip(places[-4:], pushes[-4:]):
                time += 0.008
                centre = place + soft @ push
                at = centre - (radius - used * float(push @ face)) * face
                contact = Contact(time, at, face, push, centre, 0.99)
                recorder.contact(contact, 1, (q, 0.01 * np.roll(face, 1)))
                true.append(point)
    return recorder, pipeline, np.array(true), start


@pytest.mark.parametrize("compliance", [1e-7, 1e-5, 5e-5, 1.5e-4])
def test_all_contacts_come_to_the_surface_without_force(compliance):
    recorder, pipeline, true, start = explored(compliance, noise=3e-6)
    before = np.linalg.norm(recorder.points() - true, axis=1)
    give = take_give_off(recorder, SCENE, pipeline, start)
    after = np.linalg.norm(recorder.points() - true, axis=1)
    assert after.max() < 2e-5, "walls, whose sum is known, and the top, where stick and object are told apart"
    assert np.median(after) < 0.5 * np.median(before)
    assert abs(give.object - compliance) < 3.0 * np.sqrt((give.errors**2).sum(axis=0))[2]


def test_touches_between_two_contacts_move_with_them():
    """Else the path that normals are turned to would lead up and down between both."""
    recorder, pipeline, _, start = explored(1.5e-4)
    contacts = recorder.contacts
    recorder.passed = [(0.5 * (a.time + b.time), 0.5 * (a.centre + b.centre)) for a, b in pairwise(contacts)]
    take_give_off(recorder, SCENE, pipeline, start)
    for (_, centre), (a, b) in zip(recorder.passed, pairwise(recorder.contacts)):
        assert centre == pytest.approx(0.5 * (a.centre + b.centre), abs=1e-9)


def test_the_band_contains_what_is_left():
    for stick, arm in ((0.95, 0.85), (1.05, 1.0), (1.0, 1.15)):
        recorder, pipeline, true, start = explored(1.5e-4, stick, arm, noise=3e-6)
        give = take_give_off(recorder, SCENE, pipeline, start)
        budget = recorded_budget(SCENE, pipeline, recorder, Corrections(give=give))
        errors = recorder.points() - true
        assert budget.claims_within_95(errors, np.ones(len(errors), dtype=bool), aligned=True) > 0.9


def test_touches_of_walls_show_the_sum_of_stick_and_object():
    recorder, pipeline, _, start = explored(1.5e-4)
    wall = np.abs(recorder.normals()[:, 2]) < 0.5
    del pipeline.force.rises.found[:: len(FACES)]  # those of the top
    pipeline.force.stiffness.pressed = (0.0, float("inf"))
    give = take_give_off(recorder, SCENE, pipeline, start)
    apart = np.diag(np.sqrt((give.errors**2).sum(axis=0)))
    together, alone = (
        np.linalg.norm(np.einsum("nki,ni->nk", give.shifts(errors), recorder.normals())[wall], axis=1)
        for errors in (give.errors, apart)
    )
    assert (together < 0.5 * alone).all()


def test_without_a_touch_the_contacts_keep_what_is_stated():
    recorder, pipeline, _, start = explored(1e-5)
    pipeline.force.rises.found, pipeline.force.stiffness.pressed = [], (0.0, float("inf"))
    give = take_give_off(recorder, SCENE, pipeline, start)
    assert (give.stick, give.arm, give.object) == (0.0, 0.0, 1.0 / SCENE.contact.object_stiffness)
    assert give.errors[2, 2] == pytest.approx(5e-5)


def test_one_wrong_touch_hardly_counts():
    rows = np.array([[1.5e-4, 4e-4, 5e-5, 1e-5]] * 12)
    exact = learn(SCENE, rows, 4e-5, (0.0, float("inf")))[0]
    rows[5, 0] = 6e-4
    assert learn(SCENE, rows, 4e-5, (0.0, float("inf")))[0] == pytest.approx(exact, abs=1e-5)


def test_a_rise_along_the_surface_says_nothing():
    up, still = np.array([0.0, 0.0, 1.0]), np.zeros((3, 3))
    forces = np.linspace(0.05, 0.8, 10)[:, None] * up
    places = -1e-4 * forces
    assert rise_slopes(TouchRise(0.0, places, forces), up, still, still)[0] == pytest.approx(1e-4)
    slid = places + np.linspace(0.0, 5e-3, 10)[:, None] * np.array([1.0, 0.0, 0.0])
    assert rise_slopes(TouchRise(0.0, slid, forces), up, still, still) is None


def test_contacts_of_an_earlier_part_are_left_as_they_are():
    recorder, pipeline, _, start = explored(1e-4)
    recorder.states[0] = None
    assert take_give_off(recorder, SCENE, pipeline, start) is None
