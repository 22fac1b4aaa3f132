"""A run ends when what `[run.until]` asks for is reached, and says so."""

from __future__ import annotations

import numpy as np
import pytest

import lwrprobe as lp
from lwrprobe.contracts import SceneError
from lwrprobe.evaluation.summary import Summary
from lwrprobe.mapping.clouds import read_cloud
from lwrprobe.scene import load_scene

LOOSE = 500.0
"""mm, more than the area has."""


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("until") / "run"
    settings = {"run.until.time": 45.0, "run.until.certified": 0.1, "truth.profile": "ideal"}
    return lp.explore("block", seed=7, settings=settings, out=folder, progress=False)


@pytest.mark.slow
def test_the_time_ends_the_run_with_its_data_kept(stopped):
    s = stopped.summary
    assert (s.status, s.stopped_by) == ("done", "time")
    assert 45.0 <= s.sim_time_s < 45.1
    assert len(stopped.contacts) == s.contacts > 0
    assert not (stopped.folder / "observations.f64").exists()


@pytest.mark.slow
def test_certificate_and_errors_over_time_are_written(stopped):
    s = Summary.read(stopped.folder / "summary.json")
    times, diameters = np.array([[row["time_s"], row["certified_mm"]] for row in s.error_against_time]).T
    assert (np.diff(times) > 0.0).all()
    assert (np.diff(diameters) <= 0.0).all()
    assert diameters[-1] == s.certified_mm > 0.0
    assert s.error_against_time[-1]["gap_p95_mm"] >= s.error_against_time[-1]["gap_mean_mm"] > 0.0
    assert s.certificate["unknown_cm3"] > 0.0
    hidden = read_cloud(stopped.folder / "hiding.ply")
    assert 1e3 * hidden.scalars["size"].max() <= s.certified_mm
    assert "What could still hide" in (stopped.folder / "report.html").read_text()


@pytest.mark.slow
def test_a_loose_certificate_ends_the_run_at_the_first_look():
    settings = {"run.until.certified": LOOSE, "run.until.time": 60.0, "truth.profile": "ideal"}
    s = lp.explore("block", seed=7, settings=settings, progress=False).summary
    assert (s.status, s.stopped_by) == ("done", "certified")
    assert 5.0 <= s.sim_time_s < 5.1
    assert "can hide" in s.reason


@pytest.mark.slow
def test_what_was_wanted_and_is_not_reached_is_said():
    settings = {
        "area.lower": [-0.012, -0.012, 0.045], "area.upper": [0.012, 0.012, 0.058], "truth.profile": "ideal",
    }  # fmt: skip
    wanted = {"run.until.accurate": 0.001, "run.until.certified": 0.1}
    plain, missed = (
        lp.explore("sphere", seed=5, settings=settings | rules, progress=False).summary for rules in ({}, wanted)
    )
    assert missed.stopped_by == plain.stopped_by == "strategy"
    assert missed.sim_time_s == plain.sim_time_s
    found = [sentence for sentence in missed.warnings if sentence not in plain.warnings]
    assert [sentence.split(":")[0] for sentence in found] == ["run.until.accurate", "run.until.certified"]
    assert "0.001 mm was wanted; it is 0." in found[0]


@pytest.mark.parametrize(
    ("rule", "named"),
    [
        ("run.until.exact=0.3", "exact"),
        ("run.until.accurate=0", "accurate"),
        ("run.until.time=-3", "time"),
        ("run.until.time=soon", "time"),
        ("run.until.certified=nan", "certified"),
        ("run.until.certified=0", "certified"),
        ("run.until.time", "run.until.time"),
    ],
)
def test_a_bad_rule_is_refused_with_its_name(rule, named):
    with pytest.raises(SceneError, match=named):
        load_scene("block", [rule])
