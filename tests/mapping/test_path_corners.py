"""A path with fewer places: straight pieces between those that are kept stay near to the ones that are not."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lwrprobe.mapping import path_corners

DOWN = np.array([0.0, 0.0, -1.0])


def still(count):
    return np.tile(DOWN, (count, 1))


def test_a_straight_path_needs_its_ends_alone():
    places = np.linspace([0.0, 0.0, 0.0], [0.1, -0.05, 0.02], 200)
    assert path_corners(places, still(200), 1e-4, 0.05) == [0, 199]


def test_the_corner_of_an_angle_is_kept():
    leg = np.linspace(0.0, 0.05, 51)
    places = np.zeros((101, 3))
    places[:51, 0], places[51:, 0], places[51:, 1] = leg, 0.05, leg[1:]
    assert path_corners(places, still(101), 1e-4, 0.05) == [0, 50, 100]


def test_a_turn_at_one_place_is_kept():
    directions = still(21)
    directions[10:] = [0.6, 0.0, -0.8]
    corners = path_corners(np.zeros((21, 3)), directions, 1e-4, 0.05)
    assert {9, 10} <= set(corners)


def test_a_path_that_returns_to_its_begin_keeps_its_far_end():
    places = np.zeros((41, 3))
    places[:, 0] = 0.01 * np.minimum(np.arange(41), 40 - np.arange(41))
    assert 20 in path_corners(places, still(41), 1e-4, 0.05)


@pytest.mark.parametrize("count", [1, 2])
def test_of_a_path_of_one_or_two_places_all_are_kept(count):
    assert path_corners(np.zeros((count, 3)), still(count), 1e-4, 0.05) == list(range(count))


@given(st.integers(0, 2**32 - 1), st.integers(3, 120), st.floats(1e-4, 0.02))
def test_what_is_left_out_lies_near_its_piece(seed, count, chord):
    rng = np.random.default_rng(seed)
    places = np.cumsum(rng.normal(0.0, 0.003, (count, 3)), axis=0)
    corners = path_corners(places, still(count), chord, 0.05)
    assert corners[0] == 0
    assert corners[-1] == count - 1
    for first, last in itertools.pairwise(corners):
        step = places[last] - places[first]
        for place in places[first + 1 : last]:
            share = np.clip((place - places[first]) @ step / max(step @ step, 1e-12), 0.0, 1.0)
            assert np.abs(place - places[first] - share * step).max() <= chord + 1e-12
