"""Play and waves of gears, against a plain loop."""

import numpy as np
import pytest

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import Gears

WAVES, PLAY = 320.0, 1e-3
SINE, COSINE = np.array([1e-4, 0.0, -2e-4]), np.array([0.0, 3e-4, 1e-4])


def naive(motors):
    """Rows of links, one motor position after the other."""
    links, played = [], list(motors[0])
    for row in motors:
        for i, q in enumerate(row):
            if q - played[i] > 0.5 * PLAY:
                played[i] = q - 0.5 * PLAY
            elif played[i] - q > 0.5 * PLAY:
                played[i] = q + 0.5 * PLAY
        links.append(
            [p + s * np.sin(WAVES * q) + c * np.cos(WAVES * q) for p, q, s, c in zip(played, row, SINE, COSINE)]
        )
    return np.array(links)


def test_links_are_those_of_the_plain_loop_however_the_positions_are_cut():
    motors = np.cumsum(np.random.default_rng(1).normal(scale=4e-4, size=(500, 3)), axis=0)
    gears = Gears(WAVES, SINE, COSINE, PLAY)
    found = np.concatenate([gears.links(part) for part in np.split(motors, [1, 7, 300])])
    np.testing.assert_allclose(found, naive(motors), atol=1e-15)


def test_a_link_stays_behind_by_half_of_the_play_in_either_sense():
    gears = Gears(WAVES, np.zeros(1), np.zeros(1), PLAY)
    there, back = np.linspace(0.0, 0.1, 50)[:, None], np.linspace(0.1, 0.0, 50)[:, None]
    assert (there - gears.links(there))[-1] == pytest.approx(0.5 * PLAY)
    assert (back - gears.links(back))[-1] == pytest.approx(-0.5 * PLAY)


@pytest.mark.parametrize(("name", "cosine", "play"), [("cosine", np.zeros(2), 0.0), ("play", COSINE, np.nan)])
def test_bad_gears_are_refused(name, cosine, play):
    with pytest.raises(InputError, match=f"gears.{name}"):
        Gears(WAVES, SINE, cosine, play)
