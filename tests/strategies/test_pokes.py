"""Touches from above: where they go, and that the Gaussian process is that of the textbook."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import InputError
from lwrprobe_strategies.grid_pokes import GridPokes, GridPokesConfig
from lwrprobe_strategies.random_pokes import RandomPokes, RandomPokesConfig
from lwrprobe_strategies.variance_pokes import (
    LENGTHS,
    NOISE,
    VariancePokes,
    VariancePokesConfig,
    log_likelihood,
    variances,
)
from strategy_task import task


def visited(strategy, options, height):
    """All places of a strategy, (n, 2) m, where the sphere ends at `height` of each."""
    strategy.task = replace(task(), options=options)
    places, found = strategy.places(), []
    place = next(places, None)
    while place is not None:
        found.append(place)
        try:
            place = places.send(height(*place))
        except StopIteration:
            place = None
    return np.array(found)


def test_a_grid_covers_the_area_from_border_to_border_by_the_shortest_way():
    found, area = visited(GridPokes(), GridPokesConfig(0.01), lambda x, y: 0.0), task().area
    np.testing.assert_allclose([found.min(axis=0), found.max(axis=0)], [area.lower[:2], area.upper[:2]])
    apart = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert apart.max() < 0.012
    assert len(np.unique(found.round(9), axis=0)) == len(found)


def test_random_places_lie_in_the_area_and_follow_from_the_seed():
    one, again, other = (visited(RandomPokes(), RandomPokesConfig(20, seed), lambda x, y: 0.0) for seed in (1, 1, 2))
    area = task().area
    assert one.shape == (20, 2)
    assert (one == again).all()
    assert (one != other).all()
    assert ((one >= area.lower[:2]) & (one <= area.upper[:2])).all()


def test_the_variance_is_that_of_the_textbook():
    random = np.random.default_rng(3)
    places, at = random.uniform(0.0, 0.1, (9, 2)), random.uniform(0.0, 0.1, (5, 2))

    def k(a, b):
        return np.array([[np.exp(-0.5 * ((p - q) ** 2).sum() / 0.02**2) for q in b] for p in a])

    inverse = np.linalg.inv(k(places, places) + NOISE * np.eye(9))
    wanted = [1.0 - k([p], places) @ inverse @ k(places, [p]) for p in at]
    np.testing.assert_allclose(variances(places, at, 0.02), np.ravel(wanted), atol=1e-9)


@pytest.mark.parametrize("length", [0.01, 0.04])
def test_heights_of_a_process_are_likeliest_with_its_own_length(length):
    random = np.random.default_rng(5)
    places = random.uniform(0.0, 0.12, (120, 2))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    covariance = np.exp(-0.5 * (apart / length) ** 2) + NOISE * np.eye(120)
    heights = 0.03 + 0.01 * np.linalg.cholesky(covariance) @ random.standard_normal(120)
    assert max(LENGTHS, key=lambda scale: log_likelihood(places, heights, scale)) == length


def test_variance_leads_far_away_from_what_was_touched():
    found = visited(VariancePokes(), VariancePokesConfig(30), lambda x, y: 0.02 + 0.1 * x)
    apart = np.linalg.norm(found[:, None] - found[None], axis=2) + np.eye(30)
    random = task().area.lower[:2] + np.random.default_rng(1).random((30, 2)) * np.ptp(
        [task().area.lower[:2], task().area.upper[:2]], axis=0
    )
    by_chance = np.linalg.norm(random[:, None] - random[None], axis=2) + np.eye(30)
    assert apart.min() > 2.0 * by_chance.min()


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (GridPokesConfig, {"step": 0.0}),
        (GridPokesConfig, {"step": np.nan}),
        (VariancePokesConfig, {"pokes": 0}),
        (RandomPokesConfig, {"pokes": 0}),
        (RandomPokesConfig, {"seed": -1}),
    ],
)
def test_options_out_of_range_are_refused(kind, given):
    with pytest.raises(InputError, match=next(iter(given))):
        kind(**given)
