"""Contacts that were lost for a moment and come back: harder than planned, they show a stiffer arm or object."""

import pytest

from lwrprobe.contact import ReturnPeaks
from lwrprobe.contracts import InputError

PLANNED, THRESHOLD, DELAY, PERIOD = 1.6, 0.2, 0.02, 0.008


def watched(peaks, away=4, share=1.0):
    """A watch that has seen contacts come back with these peaks [N], each after `away` samples without one."""
    watch, time = ReturnPeaks(PLANNED, THRESHOLD, DELAY), 0.0
    for peak in peaks:
        for _ in range(away):
            time += PERIOD
            watch.lose(time)
        for force in (0.4 * peak, peak, *[0.8] * 10):
            time += PERIOD
            watch.update(time, force, share)
    watch.lose(time + PERIOD)
    return watch


@pytest.mark.parametrize(
    ("peaks", "excess"),
    [
        ([1.6] * 5, 1.0),
        ([0.9] * 5, 1.0),
        ([3.0, 1.6, 1.2], 1.0),  # one alone may have met a corner
        ([3.0, 1.6, 2.3], 1.5),
        ([2.3, 3.0, 3.7], 2.0),
        ([30.0, 30.0], 4.0),
        ([3.0, 3.0, *[1.0] * 20], 1.0),  # long ago
    ],
)
def test_two_returns_have_to_agree(peaks, excess):
    assert watched(peaks).excess == pytest.approx(excess)


def test_a_slower_return_is_compared_with_what_was_planned_for_it():
    assert watched([1.6, 1.6], share=0.5).excess == pytest.approx(2.0)


def test_a_contact_after_a_long_way_is_no_return():
    assert watched([3.0] * 5, away=30).excess == 1.0


def test_a_force_that_rises_later_belongs_to_the_slide():
    watch = watched([1.0, 1.0])
    for k in range(100):
        watch.update(1.0 + PERIOD * k, 2.5, 1.0)
    assert watch.excess == 1.0


@pytest.mark.parametrize("numbers", [(0.2, 0.2, 0.02), (1.6, 0.0, 0.02), (1.6, 0.2, -0.01), (1.6, 0.2, float("nan"))])
def test_what_cannot_be_compared_is_refused(numbers):
    with pytest.raises(InputError, match="return_peaks"):
        ReturnPeaks(*numbers)
