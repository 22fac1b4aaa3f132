"""`lwrprobe bench stability`: the cheap cases, and what the bench does with a case that fails."""

import json

import pytest

from lwrprobe.bench.stability import run
from lwrprobe.bench.stability.case import Case, Finding, all_cases, run_case, within
from lwrprobe.contracts import InputError, UnknownNameError

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("number", [1, 2, 25, 26, 27, 29, 31, 32, 34, 35])
def test_cheap_cases_hold(number):
    group, case = all_cases()[number]
    result = run_case(group, case, quick=True)
    assert result.held, [finding for finding in result.findings if not finding.sound]


def test_cases_are_numbered_and_say_what_is_wanted():
    cases = all_cases()
    assert list(cases) == sorted(cases)
    assert all(1 <= number <= 40 and case.number == number for number, (_, case) in cases.items())
    assert all(case.title and case.wanted for _, case in cases.values())


def test_a_figure_that_is_no_number_and_an_exception_fall_short():
    assert not within("", "", float("nan"), 1.0, "mm").sound
    assert not Finding("", "", True, float("nan"), 1.0).sound
    assert within("", "", 1.0, 1.0, "mm").sound
    assert not within("", "", 0.5, 1.0, "mm", also=False).sound

    def fail(quick):
        raise ZeroDivisionError("made up")

    result = run_case("group", Case(7, "title", "wanted", fail), quick=True)
    assert not result.held
    assert "ZeroDivisionError: made up" in result.findings[0].happened
    assert not run_case("group", Case(7, "title", "wanted", lambda quick: []), quick=True).held


def test_one_case_is_run_and_written(tmp_path):
    report = run(True, {"case": "27"})
    assert len(report.verdicts) == 1
    written = report.write(tmp_path / "s.json", tmp_path)
    assert [path.suffix for path in written] == [".json", ".md", ".csv", ".csv", ".png"]
    record = json.loads((tmp_path / "s.json").read_text())["cases"][0]
    assert record["case"] == 27
    assert record["held"]
    assert record["findings"][0]["value"] <= record["findings"][0]["bound"]


def test_unknown_options_and_cases_are_refused():
    with pytest.raises(UnknownNameError, match="case"):
        run(True, {"cass": "3"})
    for bad in ("41", "0", "x"):
        with pytest.raises(InputError, match="case"):
            run(True, {"case": bad})
