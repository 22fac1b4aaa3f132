"""The faulty line: each fault does what it says, and no more."""

import itertools

import numpy as np
import pytest

from lwrprobe.contracts import InputError, UnknownNameError
from lwrprobe_rig.link import FaultyLink, LinkFaults

COUNT = 4000


def through(count=COUNT, step=0.01, **faults):
    """(instant sent, instant arrived, data) of all that came out, in order of arrival."""
    link = FaultyLink(LinkFaults(**faults), seed=3)
    came = []
    for k in range(count):
        now = k * step
        came += [(now, data) for data in link.arrived(now)]
        link.put(k.to_bytes(4, "big") + bytes(28), now)
        came += [(now, data) for data in link.arrived(now)]
    came += [(count * step, data) for data in link.arrived(float("inf"))]
    return came


def numbers(came):
    return [int.from_bytes(data[:4], "big") for _, data in came]


def test_line_without_faults_is_a_line():
    came = through()
    assert numbers(came) == list(range(COUNT))
    assert all(now == 0.01 * k for k, (now, _) in enumerate(came))


def test_loss_and_duplicates():
    assert len(through(loss=0.25)) == pytest.approx(0.75 * COUNT, rel=0.05)
    assert len(through(duplicate=0.25)) == pytest.approx(1.25 * COUNT, rel=0.05)


def test_down_passes_nothing():
    assert through(down=1.0) == []


def test_delay_and_jitter_keep_the_order():
    came = through(delay=0.03, jitter=0.02)
    assert numbers(came) == list(range(COUNT))
    waits = np.array([now - 0.01 * k for (now, _), k in zip(came[:-5], range(COUNT))])
    assert waits.min() >= 0.03 - 1e-9
    assert waits.max() <= 0.06 + 1e-9


def test_reordering_swaps_neighbours():
    order = numbers(through(reorder=0.2))
    assert sorted(order)[:-1] == list(range(COUNT))[: len(order) - 1]
    late = [a for a, b in itertools.pairwise(order) if b < a]
    assert 0.1 * COUNT < len(late) < 0.3 * COUNT
    assert max(abs(a - b) for a, b in zip(order, range(COUNT))) == 1


def test_corruption_changes_bytes_and_resize_the_length():
    changed = [data for k, (_, data) in enumerate(through(corrupt=1.0)) if data != k.to_bytes(4, "big") + bytes(28)]
    assert len(changed) > 0.99 * COUNT
    assert {len(data) for data in changed} == {32}
    assert all(len(data) != 32 for _, data in through(resize=1.0))


def test_faults_are_set_by_name():
    faults = LinkFaults()
    faults.set("loss", "0.5")
    faults.set("down", "")
    assert (faults.loss, faults.down) == (0.5, 1.0)
    faults.clear()
    assert faults == LinkFaults()
    with pytest.raises(UnknownNameError, match="jitter"):
        faults.set("jiter", "1")
    for bad in ("-1", "2", "much", "nan"):
        with pytest.raises(InputError, match="fault loss"):
            faults.set("loss", bad)
