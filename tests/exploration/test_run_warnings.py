"""Sentences that a run leaves with its figures, and the metrics that they rest on."""

import numpy as np
import pytest

from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.exploration.recording.run_warnings import run_warnings
from lwrprobe.scene import load_scene

FINE = dict(rejected_share=0.02, true_peak_force_n=2.9, link_collisions=0, wrench_counters={"samples": 1000, "lost": 5})


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({}, None),
        ({"rejected_share": 0.10}, None),
        ({"rejected_share": 0.49}, "49.0% of the touches were rejected"),
        ({"rejected_share": None, "true_peak_force_n": None, "link_collisions": None}, None),
        ({"true_peak_force_n": 3.7}, "up to 3.70 N, the limit is 3 N"),
        ({"stillness": {"torque_disagreement": 0.18}}, "torque and force disagree by 18%"),
        ({"stillness": {"torque_disagreement": 0.0}}, None),
        ({"torque": {"disagreement": 0.05, "over_expected": 1.6}}, "torque and force disagree by 5.0%"),
        ({"torque": {"disagreement": 0.01, "over_expected": 1.0}}, None),
        ({"torque": {"disagreement": 0.02, "over_expected": 1.4}}, None),
        ({"noise_at_rest": {"force_n": 0.01, "torque_nm": 5e-5, "over_stated": 3.0}}, "is 3.0 times as noisy at rest"),
        ({"noise_at_rest": {"force_n": 0.003, "torque_nm": 1.6e-5, "over_stated": 1.0}}, None),
        ({"force_control": {"warnings": ["the loop reacts after 26 ms"]}}, "the loop reacts after 26 ms"),
        ({"link_collisions": 2}, "hit something 2 times"),
        ({"wrench_counters": {"samples": 900, "lost": 100}}, "10.0% of the wrench samples were lost"),
        ({"devices": {"fri": {"late_set_points": 9, "received": 1000}}}, None),
        ({"devices": {"fri": {"late_set_points": 30, "received": 1000}, "ati": {"lost": 1}}}, "3.0% of the set points"),
        ({"status": "done", "contacts": 0}, "nothing was touched"),
        ({"status": "ended early", "contacts": 0}, None),
        ({"reentries": 2}, "set in motion again 2 times"),
        ({"area_raised_mm": 10.0}, "upper end was raised by 10 mm"),
        ({"unreachable_area": "out of reach: 3 of 70 places of the area"}, "out of reach: 3 of 70"),
    ],
)
def test_each_figure_that_is_not_fine_makes_one_sentence(changed, sentence):
    found = run_warnings(Summary(**{**FINE, **changed}), 3.0)
    assert len(found) == (sentence is not None)
    assert sentence is None or sentence in found[0]


@pytest.mark.slow
def test_an_uncalibrated_sensor_has_touches_rejected_and_says_so(tmp_path):
    """Contacts that are not accepted are counted; the share is that of the recorded path."""
    sensor = ["truth.sensor_gain_percent={sigma=3.0}", "truth.sensor_crosstalk_percent={sigma=2.0}", "truth.seed=1"]
    settings = ["run.seed=7", "run.time_limit=40.0", "truth.profile=ideal", *sensor]
    summary = explore(load_scene("block", settings), tmp_path)
    trace = np.loadtxt(tmp_path / "trace.csv", delimiter=",", skiprows=1, usecols=range(6))
    touching = 5.0 * float(trace[:, 5].sum())  # every fifth sample has a row
    accepted = len(np.loadtxt(tmp_path / "contacts.csv", delimiter=",", skiprows=1))
    assert accepted > 300, "a sensor that is worse than stated finds the object all the same"
    assert summary["rejected_share"] == pytest.approx(1.0 - accepted / touching, abs=0.03)
    assert summary["rejected_share"] > 0.10
    assert any("rejected" in sentence for sentence in summary["warnings"])
    page = (tmp_path / "report.html").read_text()
    assert "of the touches were rejected" in page
