"""The turn of all normals aside of the path: what places show of it, what they do not, and how sure that is."""

import numpy as np
import pytest

from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.corrections import Corrections
from lwrprobe.exploration.recording.error_sources import recorded_budget
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.side_turn import aside_of, learn, take_side_turn_off
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.exploration.stages.sensor_errors import FRICTION, friction_turn
from lwrprobe.scene import load_scene

RADIUS, SPACING, STATED = 0.005, 0.01, 0.016
TURN = 0.02
"""rad."""


def lines(turn, bend=20.0, wave=0.0, noise=0.0, seed=1):
    """Centres, normals turned about the path, and velocities on lines to and fro over a bowl with waves."""
    random = np.random.default_rng(seed)
    x, rows = np.arange(-0.04, 0.04, 5e-4), np.arange(-0.04, 0.045, SPACING)
    centres, normals, velocities = [], [], []
    for number, y in enumerate(rows):
        along = x if number % 2 == 0 else x[::-1]
        k = 2.0 * np.pi / 0.05
        z = 0.5 * bend * (along**2 + y**2) + wave * np.sin(k * along + 1.0) * np.sin(k * y)
        slope_x = bend * along + wave * k * np.cos(k * along + 1.0) * np.sin(k * y)
        slope_y = bend * y + wave * k * np.sin(k * along + 1.0) * np.cos(k * y)
        normal = np.column_stack([-slope_x, -slope_y, np.ones_like(along)])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        path = np.column_stack([np.ones_like(along), np.zeros_like(along), slope_x]) * (1 - 2 * (number % 2))
        path *= 0.02 / np.linalg.norm(path, axis=1, keepdims=True)
        aside = np.cross(normal, path) / 0.02
        seen = normal + (turn + noise * random.standard_normal((len(along), 1))) * aside
        centres.append(np.column_stack([along, np.full_like(along, y), z]))
        normals.append(seen / np.linalg.norm(seen, axis=1, keepdims=True))
        velocities.append(path)
    return tuple(np.concatenate(part) for part in (centres, normals, velocities))


def learnt(*given, **changed):
    centres, normals, velocities = lines(*given, **changed)
    return learn(centres, normals, aside_of(normals, velocities), SPACING, STATED)


@pytest.mark.parametrize("turn", [TURN, -TURN, 0.0])
@pytest.mark.parametrize("bend", [0.0, 20.0, -10.0])
def test_lines_to_and_fro_over_an_even_bend_show_the_turn(turn, bend):
    found = learnt(turn, bend=bend, noise=0.01)
    assert found.angle == pytest.approx(turn, abs=0.0015)
    assert found.error < 0.004


def test_directions_that_show_other_turns_leave_the_angle_unsure():
    """A sensor's matrix turns the normals of one direction of travel alike; what friction does is the same in all."""
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    one, other = lines(0.09, noise=0.01), [part @ turned.T for part in lines(-0.03, noise=0.01)]
    other[0] = other[0] + np.array([1.0, 0.0, 0.0])
    centres, normals, velocities = (np.concatenate(parts) for parts in zip(one, other))
    found = learn(centres, normals, aside_of(normals, velocities), SPACING, STATED)
    assert abs(found.angle) < 0.02
    assert found.error > 0.8 * STATED


def test_over_many_wavy_surfaces_the_error_is_as_stated():
    """Bends of the surface are the larger part of it; they are the same in all chords across them."""
    off = []
    for seed in range(40):
        turn = STATED * np.random.default_rng(seed).standard_normal()
        found = learnt(turn, wave=3e-4, noise=0.01, seed=seed)
        off.append((found.angle - turn) / found.error)
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.5
    assert np.abs(off).max() < 4.0


def test_a_single_line_shows_nothing():
    centres, normals, velocities = lines(TURN)
    first = slice(0, 160)
    assert learn(centres[first], normals[first], aside_of(normals, velocities)[first], SPACING, STATED) is None
    still = np.zeros_like(normals)
    assert learn(centres, normals, still, SPACING, STATED) is None


def recorded(turn, friction=FRICTION):
    recorder = Recorder(None)
    for k, (centre, normal, velocity) in enumerate(zip(*lines(turn))):
        force = 0.8 * (normal - friction * velocity / np.linalg.norm(velocity))
        contact = Contact(0.025 * k, centre - RADIUS * normal, normal, force, centre, 0.95)
        recorder.contact(contact, k, (np.array([0.3, 0.6, -0.2, -1.4, 0.1, 1.1, 0.4]), velocity))
    return recorder


def test_the_turn_is_taken_off_about_the_centres_and_the_budget_counts_what_is_left():
    scene, recorder = load_scene("block"), recorded(TURN)
    _, true, _ = lines(0.0)
    pipeline = compose(scene, choose(scene), 0.001, 125.0)
    before = recorded_budget(scene, pipeline, recorder).causes_aligned["friction direction"]
    points = recorder.points() + RADIUS * recorder.normals()
    found = take_side_turn_off(recorder, scene, SPACING)
    assert found.angle == pytest.approx(TURN, abs=0.001)
    assert np.linalg.norm(recorder.normals() - true, axis=1).max() < 0.001
    assert recorder.points() + RADIUS * recorder.normals() == pytest.approx(points, abs=1e-12)
    budget = recorded_budget(scene, pipeline, recorder, Corrections(side=found))
    shift = np.linalg.norm(budget.shared, axis=2)
    assert np.isclose(shift, RADIUS * found.error, rtol=1e-3).any(axis=1).all()
    assert budget.causes_aligned["friction direction"] <= before


def test_much_friction_turns_the_normals_by_more_and_hardly_any_by_nothing():
    """By how much they may be turned is stated for a friction of 0.3, and goes with what the forces show."""
    scene = load_scene("block", ["uncertainty.friction_direction_deg=0.2"])
    little, usual, much = (take_side_turn_off(recorded(TURN, mu), scene, SPACING) for mu in (0.003, FRICTION, 0.6))
    assert little.angle < 0.1 * TURN
    assert little.angle < usual.angle < much.angle < TURN


def test_nothing_is_learnt_where_nothing_is_open():
    recorder = recorded(TURN)
    before = recorder.normals()
    exact = load_scene("block", ["uncertainty.friction_direction_deg=0.0"])
    assert friction_turn(exact) == 0.0
    assert take_side_turn_off(recorder, exact, SPACING) is None
    assert take_side_turn_off(recorder, load_scene("block"), None) is None
    assert (recorder.normals() == before).all()
