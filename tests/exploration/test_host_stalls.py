"""What is said of a host from how late it wakes a process up."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from lwrprobe.exploration.procedures import host_stalls
from lwrprobe.exploration.procedures.host_stalls import host_checks, smallest_cycle, stalls
from lwrprobe.host.real_time import LOOP, real_time_priority
from lwrprobe.scene import load_scene


def naive_smallest(late):
    for cycle in host_stalls.CYCLES_MS:
        missed, half = 0, 0.5e-3 * cycle
        for one in late:
            while one > half:
                missed, one = missed + 1, one - 1e-3 * cycle
        if missed <= 1e-3 * len(late) / cycle or max(late) < half:
            return 1e-3 * cycle
    return None


@pytest.mark.parametrize(
    ("late", "expected"),
    [
        (np.full(5000, 1e-4), 0.001),
        (np.full(5000, 8e-4), 0.002),
        (np.r_[np.full(4999, 1e-4), 0.004], 0.001),
        (np.r_[np.full(4000, 1e-4), np.full(1000, 0.004)], 0.01),
        (np.full(100, 0.3), None),
    ],
)
def test_cycle_that_a_host_allows(late, expected):
    assert smallest_cycle(late) == pytest.approx(expected) if expected else smallest_cycle(late) is None
    assert smallest_cycle(late) == naive_smallest(late.tolist())


def test_a_stall_is_seen(monkeypatch):
    """The clock jumps by 50 ms once."""
    real, jumps = time.sleep, [0.05]
    monkeypatch.setattr(host_stalls.time, "sleep", lambda s: real(s + (jumps.pop() if jumps else 0.0)))
    late = stalls(0.2)
    assert late.max() >= 0.05
    assert (late >= 0.0).all()


@pytest.mark.parametrize("permitted", [True, False])
def test_what_is_said(monkeypatch, permitted):
    late = iter([np.r_[np.full(990, 1e-4), np.full(10, 0.03)], np.full(1000, 1e-4)])
    monkeypatch.setattr(host_stalls, "stalls", lambda seconds: next(late))

    def sched(*_):
        if not permitted:
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", sched, raising=False)
    found = {check.name: check for check in host_checks(load_scene("block"), 0.01, 0.006, 1.0)}
    assert found["host stalls"].detail["longest_ms"] == pytest.approx(30.0)
    assert found["cycle allowed"].good is permitted
    assert ("isolcpus" in found["cycle allowed"].value) is not permitted
    assert found["real-time priority"].detail["permitted"] is permitted
    speed = found["speed along the stick"].detail
    # The loop has the priority that is permitted, and is kept from running no more than that lets it be.
    share = speed["speed_mm_s"] / speed["speed_without_mm_s"]
    assert 0.9 < share < 1.0 if permitted else 0.0 < share < 0.6


def test_priority_is_given_back():
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with real_time_priority(LOOP) as permitted:
        assert (os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO) is permitted
        begun = subprocess.run(
            [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"], capture_output=True, check=True
        )
        assert int(begun.stdout) == os.SCHED_OTHER
    assert (os.sched_getscheduler(0), os.sched_getparam(0)) == before


def test_a_heavy_arm_may_approach_less_fast():
    light, heavy = (host_checks(load_scene("block"), 0.01, 0.006, 0.1, mass)[-1] for mass in (0.0, 16.0))
    assert 0.0 < heavy.detail["speed_without_mm_s"] < 0.7 * light.detail["speed_without_mm_s"]
