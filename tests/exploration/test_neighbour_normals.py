"""Normals turned towards the lines on both sides: what slopes show, where they do not, and how sure that is."""

import tracemalloc

import numpy as np
import pytest

from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.corrections import Corrections
from lwrprobe.exploration.recording.error_sources import recorded_budget
from lwrprobe.exploration.recording.neighbour_normals import CHORD, slopes, turn_to_neighbours, weighed
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.side_turn import aside_of
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.scene import load_scene

RADIUS, SPACING = 0.005, 0.01
LINES = np.arange(-0.04, 0.045, SPACING)
OFF = 0.03
"""rad, standard deviation of the turn of a line's normals: each line has its own, as a sensor's hysteresis makes it."""


def touched(height, off=OFF, seed=1):
    """Centres, true and seen normals, velocities and numbers of lines to and fro over `height(x, y)` m."""
    random = np.random.default_rng(seed)
    x, step = np.arange(-0.04, 0.04, 5e-4), 1e-6
    parts = []
    for number, y in enumerate(LINES):
        sign = 1 - 2 * (number % 2)
        along, beside = x[::sign], np.full_like(x, y)
        slope_x = (height(along + step, beside) - height(along - step, beside)) / (2.0 * step)
        slope_y = (height(along, beside + step) - height(along, beside - step)) / (2.0 * step)
        true = np.column_stack([-slope_x, -slope_y, np.ones_like(x)])
        true /= np.linalg.norm(true, axis=1, keepdims=True)
        path = 0.02 * sign * np.column_stack([np.ones_like(x), np.zeros_like(x), slope_x])
        seen = true + off * random.standard_normal() * aside_of(true, path)
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        centres = np.column_stack([along, beside, height(along, beside)])
        parts.append((centres, true, seen, path, np.full(len(x), number)))
    return tuple(np.concatenate(part) for part in zip(*parts))


def bowl(x, y):
    return 8.0 * (x**2 + y**2)


def waves(x, y):
    return 4e-4 * np.sin(2.0 * np.pi * y / 0.032 + 40.0 * x)


def recorded(centres, normals, velocities):
    recorder = Recorder(None)
    for k, (centre, normal, velocity) in enumerate(zip(centres, normals, velocities)):
        contact = Contact(0.025 * k, centre - RADIUS * normal, normal, 0.8 * normal, centre, 0.95)
        recorder.contact(contact, k, (np.array([0.3, 0.6, -0.2, -1.4, 0.1, 1.1, 0.4]), velocity))
    return recorder


def spread(normals, true):
    return np.sqrt(((normals - true) ** 2).sum(axis=1).mean())


@pytest.mark.parametrize("height", [bowl, lambda x, y: 0.0 * x], ids=["bowl", "plane"])
def test_lines_on_both_sides_show_the_normal_between_them(height):
    centres, true, seen, velocities, number = touched(height)
    angles, _ = slopes(centres, seen, aside_of(seen, velocities), SPACING)
    inside = (number > 0) & (number < len(LINES) - 1)
    assert np.isfinite(angles[inside]).mean() > 0.9
    assert np.isnan(angles[~inside]).all(), "a line with nothing on one side stays"
    known = np.isfinite(angles)
    turned = seen[known] - angles[known, None] * aside_of(seen, velocities)[known]
    assert spread(turned, true[known]) < 0.15 * spread(seen[known], true[known])


def test_lines_far_apart_take_no_more_memory_than_lines_near_each_other():
    """All pairs of 9000 contacts within 40 mm took a gigabyte, and half a minute."""

    def memory(times):
        """As many contacts on each metre of path as before, at lines that are so many times as far apart."""
        y, x = np.meshgrid(times * LINES, np.arange(-0.1, 0.1, 5e-4), indexing="ij")
        centres = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        aside = np.tile([0.0, 1.0, 0.0], (x.size, 1))
        tracemalloc.start()
        slopes(centres, np.tile([0.0, 0.0, 1.0], (x.size, 1)), aside, times * SPACING)
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size

    assert memory(2.5) < 1.2 * memory(1.0)


def test_normals_are_turned_about_the_centres_and_the_budget_follows():
    scene = load_scene("block")
    centres, true, seen, velocities, _ = touched(bowl)
    recorder = recorded(centres, seen, velocities)
    pipeline = compose(scene, choose(scene), 0.001, 125.0)
    before = recorded_budget(scene, pipeline, recorder)
    found = turn_to_neighbours(recorder, scene, SPACING)
    turned = found.share > 0.0
    assert recorder.points() + RADIUS * recorder.normals() == pytest.approx(centres, abs=1e-12)
    assert spread(recorder.normals()[turned], true[turned]) < 0.3 * spread(seen[turned], true[turned])
    assert (recorder.normals()[~turned] == seen[~turned]).all()
    after = recorded_budget(scene, pipeline, recorder, Corrections(neighbours=found))
    aside = aside_of(seen, velocities)
    old, new = (np.einsum("ni,nij,nj->n", aside, budget.random, aside) for budget in (before, after))
    assert new[~turned] == pytest.approx(old[~turned], rel=1e-6)
    old_shared, new_shared = (
        np.linalg.norm(np.einsum("ni,nki->nk", aside, budget.shared), axis=1) for budget in (before, after)
    )
    assert (new_shared[turned] < old_shared[turned]).all()
    assert new_shared[~turned] == pytest.approx(old_shared[~turned], rel=1e-6)
    assert (new[turned] >= (RADIUS * found.error[turned]) ** 2).all()


def test_a_step_between_two_lines_turns_nothing_beside_it():
    centres, _, seen, velocities, number = touched(lambda x, y: np.where(y > 0.005, 0.004, 0.0))
    angles, _ = slopes(centres, seen, aside_of(seen, velocities), SPACING)
    beside = np.isin(number, (4, 5))
    assert np.isnan(angles[beside]).all()
    assert np.isfinite(angles[np.isin(number, (1, 2, 3, 6, 7))]).mean() > 0.9


@pytest.mark.parametrize(("height", "off"), [(bowl, OFF), (waves, 0.0), (waves, OFF)], ids=["bowl", "waves", "both"])
def test_slopes_weigh_what_the_surface_lets_them(height, off):
    """Over many draws less is left than there was, and about as much as is told; told is rather too much."""
    true_squares, left_squares, told = [], [], []
    for seed in range(20):
        centres, true, seen, velocities, _ = touched(height, off, seed)
        aside = aside_of(seen, velocities)
        angles, disagreements = slopes(centres, seen, aside, SPACING)
        known = np.isfinite(angles)
        share, error = weighed(angles[known], disagreements[known])
        wrong = np.einsum("ni,ni->n", true - seen, aside)[known]
        true_squares.append((wrong**2).mean())
        left_squares.append(((wrong + share * angles[known]) ** 2).mean())
        told.append((error**2).mean())
    assert np.mean(left_squares) < max(np.mean(true_squares), CHORD**2)
    assert 0.6 < np.sqrt(np.mean(told) / max(np.mean(left_squares), CHORD**2)) < 2.2


def test_normals_that_are_right_are_left_alone_on_a_surface_that_waves():
    centres, _, seen, velocities, _ = touched(waves, 0.0)
    angles, disagreements = slopes(centres, seen, aside_of(seen, velocities), SPACING)
    known = np.isfinite(angles)
    assert np.sqrt((angles[known] ** 2).mean()) > 2.0 * CHORD
    assert weighed(angles[known], disagreements[known])[0].mean() < 0.25


def test_nothing_is_turned_where_nothing_is_open_or_known():
    centres, _, seen, velocities, number = touched(bowl)
    recorder = recorded(centres, seen, velocities)
    exact = load_scene("block", ["uncertainty.friction_direction_deg=0.0"])
    assert turn_to_neighbours(recorder, exact, SPACING) is None
    assert turn_to_neighbours(recorder, load_scene("block"), None) is None
    assert (recorder.normals() == seen).all()
    first = number == 0
    alone = recorded(centres[first], seen[first], velocities[first])
    assert turn_to_neighbours(alone, load_scene("block"), SPACING) is None
    assert turn_to_neighbours(Recorder(None), load_scene("block"), SPACING) is None


def test_a_slope_that_disagrees_in_another_way_than_a_wrong_normal_counts_less():
    angles, odd = np.full(200, 0.03), np.zeros(200)
    odd[:20] = 0.05
    share, error = weighed(angles, 0.5 * angles + odd)
    assert share[20:].min() > 0.9
    assert share[:20].max() < 0.5
    assert error[:20].min() > 2.0 * error[20:].max()
