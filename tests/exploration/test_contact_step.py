"""What becomes of a touch: a contact where it is trusted, else a place of the path."""

from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contact import Wrench
from lwrprobe.contracts import Contact
from lwrprobe.exploration.loop.contact_step import SETTLED, ContactStep
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.scene import load_scene

SCENE = load_scene("block")
RADIUS = SCENE.probe.radius
UP = np.array([0.0, 0.0, 1.0])


def touches(confidence, force=1.0, count=SETTLED + 3):
    """The recorder after touches on a level surface while the sphere is led along x."""

    def estimate(wrench, centre, rotation, velocity):
        return Contact(wrench.time, centre - RADIUS * UP, UP, wrench.world_force, centre, confidence)

    recorder = Recorder(None)
    history = SimpleNamespace(q=np.zeros(7), measured_velocity=lambda time: np.array([0.01, 0.0, 0.0]))
    pipeline = SimpleNamespace(
        sweep=None, deflection=None, torque=None, probe=SCENE.probe.as_probe(), add_point=lambda point: None,
        estimator=SimpleNamespace(estimate=estimate, reset=lambda: None),
        force=SimpleNamespace(stiffness=SimpleNamespace(settled=True)),
    )  # fmt: skip
    clock, arm = SimpleNamespace(lap=lambda stage: None), SimpleNamespace(history=history)
    step = ContactStep(SimpleNamespace(scene=SCENE, pipeline=pipeline, arm=arm, recorder=recorder, clock=clock))
    for k in range(count):
        wrench = Wrench(0.008 * k, force * UP, np.zeros(3), force * UP, k, 0)
        step.find(SimpleNamespace(time=wrench.time, sequence=k), wrench, 1e-4 * k * UP[::-1], np.eye(3), wrench.time)
    return recorder


def test_a_touch_that_is_not_trusted_is_a_place_of_the_path_and_no_contact():
    recorder = touches(confidence=0.3)
    assert not recorder.contacts
    assert [time for time, _ in recorder.passed] == pytest.approx(0.008 * np.arange(SETTLED + 3))
    assert np.array([place for _, place in recorder.passed])[:, 0] == pytest.approx(1e-4 * np.arange(SETTLED + 3))


def test_so_are_the_first_touches_and_light_ones():
    assert len(touches(confidence=0.9).passed) == SETTLED
    light = 0.5 * (SCENE.contact.threshold + 0.5 * SCENE.contact.target)
    assert len(touches(confidence=0.9, force=light).passed) == SETTLED + 3


def test_what_is_no_touch_of_the_sphere_is_no_place_of_its_path():
    assert not touches(confidence=0.0).passed


def test_places_after_the_object_has_moved_are_left_out_as_contacts_are():
    recorder = touches(confidence=0.3)
    recorder.withhold(0.02)
    assert [time for time, _ in recorder.passed] == pytest.approx([0.0, 0.008, 0.016])
