"""The bench of the planning times each choice of a stroke, and judges those with many contacts."""

import numpy as np
import pytest

from lwrprobe.bench import planning
from lwrprobe.contracts import UnknownNameError
from lwrprobe.mapping.estimate import SurfaceEstimate

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report():
    return planning.run(True, {"seconds": "45", "contacts": "600"})


def test_each_choice_is_timed_apart_from_the_update_before_it(report):
    made = np.array(report.data["choices"]["block"])
    assert len(made) >= 2
    assert (np.diff(made[:, 0]) >= 0).all(), "contacts become more"
    assert (made[:, 1:] > 0.0).all()
    (row,) = report.tables[0].rows
    cells = dict(zip(report.tables[0].columns, row))
    assert cells["choices"] == len(made)
    assert cells["contacts"] == made[-1, 0] > 600
    assert cells["update ms"] == pytest.approx(1e3 * np.median(made[:, 1]))
    assert cells["choice ms, most"] == pytest.approx(1e3 * made[:, 2].max())


def test_choices_with_few_contacts_are_not_judged(report):
    made = np.array(report.data["choices"]["block"])
    late = np.count_nonzero(made[:, 0] >= 600)
    assert 0 < late <= len(made)
    assert all(verdict.measured.endswith(f"ms in {late}") for verdict in report.verdicts)
    assert [verdict.requirement.split(" from")[0] for verdict in report.verdicts] == [
        "updating the estimate",
        "choosing a stroke",
    ]


def test_without_a_run_that_came_so_far_nothing_is_held(monkeypatch):
    monkeypatch.setattr(planning, "choices", lambda scene, seconds: (1.0, [(10, 0.001, 0.002)]))
    report = planning.run(True, {"contacts": "11"})
    assert [(verdict.held, verdict.measured) for verdict in report.verdicts] == [(False, "no run came so far")] * 2
    assert all(verdict.held for verdict in planning.run(True, {"contacts": "10"}).verdicts)


def test_the_estimate_is_left_as_it_was(report, tmp_path):
    assert SurfaceEstimate.update.__module__ == "lwrprobe.mapping.estimate"
    assert {path.name for path in report.write(out=tmp_path)} >= {"planning.md", "planning-contacts.png"}


def test_unknown_option():
    with pytest.raises(UnknownNameError, match="seconds"):
        planning.run(True, {"second": "10"})
