"""Explorations back to back: what the bench counts of its own process, and when it says that something grows."""

from dataclasses import replace

import pytest

from lwrprobe.bench import endurance
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import UnknownNameError


def states(**growth):
    """Twenty explorations of a process in which each of `growth` grows by so much with each of them."""
    flat = endurance.State(1, 60.0, 10.0, 9.0, 400.0, 12, 3, 25.0, 4000.0, "done")
    return [
        replace(
            flat,
            exploration=n,
            wall_time=10.0 * n,
            **{name: getattr(flat, name) + n * by for name, by in growth.items()},
        )
        for n in range(1, 21)
    ]


@pytest.mark.parametrize(
    ("growth", "missed"),
    [
        ({}, ""),
        ({"memory": 0.1}, ""),
        ({"memory": 2.0}, "memory grows"),
        ({"handles": 1}, "no handle"),
        ({"threads": 1}, "no thread"),
        ({"cycle": 1.0}, "a cycle takes"),
        ({"cycle": 1.0, "piece": 160.0}, ""),
    ],
)
def test_what_grows_is_a_requirement_that_is_not_met(growth, missed):
    report = BenchReport("endurance", "")
    endurance._requirements(report, states(**growth))
    assert [v.requirement[: len(missed)] for v in report.verdicts if not v.held] == ([missed] if missed else [])
    assert len(report.verdicts) == 5


def test_an_exploration_that_ends_early_is_a_requirement_that_is_not_met():
    report = BenchReport("endurance", "")
    endurance._requirements(report, [*states()[:-1], replace(states()[-1], status="ended early")])
    assert [v.measured for v in report.verdicts if not v.held] == ["19 of 20"]


def test_unknown_options_are_refused():
    with pytest.raises(UnknownNameError):
        endurance.run(True, {"scenes": "block"})


@pytest.mark.slow
def test_a_run_becomes_a_row_of_the_process():
    report = endurance.run(False, {"seconds": "2", "set": "run.time_limit=3.0"})
    (table,) = report.tables
    assert len(table.rows) >= 1
    assert table.columns[4] == "memory MB"
    for row in table.rows:
        assert 50.0 < row[4] < 10_000.0
        assert row[5] > 2
        assert row[6] >= 1
