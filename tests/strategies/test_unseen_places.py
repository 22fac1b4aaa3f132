"""Where nothing was touched or passed."""

from __future__ import annotations

import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.unseen_places import longest_unseen

AREA = Area(np.array([-0.09, -0.06, 0.006]), np.array([0.09, 0.06, 0.06]))
SQUARES = (60, 40)  # of 3 mm
REACH = 0.015


def naive(seen, there):
    """Square by square, from the distances to everything that is known and to the border."""
    centres = [-0.0885 + 0.003 * np.arange(60), -0.0585 + 0.003 * np.arange(40)]
    known = [(x, y) for i, x in enumerate(centres[0]) for j, y in enumerate(centres[1]) if there[i, j]]
    for x, y in seen:
        known.append((centres[0][int((x + 0.09) / 0.003)], centres[1][int((y + 0.06) / 0.003)]))
    free = np.zeros(SQUARES, dtype=bool)
    for i, x in enumerate(centres[0]):
        for j, y in enumerate(centres[1]):
            border = min(i + 1, 60 - i, j + 1, 40 - j) * 0.003
            free[i, j] = min([border, *(np.hypot(x - u, y - v) for u, v in known)]) > REACH + 1e-12
    longest = 0
    for row in (*free, *free.T):
        run = 0
        for square in row:
            run = run + 1 if square else 0
            longest = max(longest, run)
    return 0.003 * longest


@pytest.mark.parametrize("seed", range(4))
def test_the_longest_line_is_that_of_a_full_search(seed):
    rng = np.random.default_rng(seed)
    seen = rng.uniform(AREA.lower[:2], AREA.upper[:2], (3 * seed, 2))
    there = np.zeros(SQUARES, dtype=bool)
    there[20 : 20 + 4 * seed, 10:14] = True
    assert longest_unseen(AREA, seen, there, REACH) == pytest.approx(naive(seen, there))


def test_an_area_that_was_passed_all_over_is_seen():
    x, y = np.meshgrid(np.arange(-0.08, 0.081, 0.02), np.arange(-0.05, 0.051, 0.02))
    seen = np.stack([x.ravel(), y.ravel()], axis=1)
    assert longest_unseen(AREA, seen, np.zeros(SQUARES, dtype=bool), REACH) == 0.0
    assert longest_unseen(AREA, seen[seen[:, 0] < 0.0], np.zeros(SQUARES, dtype=bool), REACH) > 0.05
