"""A sensor that is three times as loud as the data sheet says, which nobody has told the run."""

from __future__ import annotations

import csv

import pytest

import lwrprobe as lp
from lwrprobe.contact import WrenchNoise

LOUD = {"drivers.sim.noise_force": 0.009, "drivers.sim.noise_torque": 6e-5}


@pytest.mark.slow
def test_contacts_are_not_lost_on_plain_faces(tmp_path):
    """The readings at rest show the noise; with the stated one, 13 % of the touches were rejected."""
    settings = {"run.until.time": 140.0, "truth.profile": "ideal", "strategy.step": 0.01, **LOUD}
    run = lp.explore("block", strategy="grid_version", seed=2, settings=settings, out=tmp_path / "run", progress=False)
    assert run.summary.rejected_share < 0.06
    with (run.folder / "states.csv").open() as rows:
        lost = sum(row["event"] == "contact lost" for row in csv.DictReader(rows))
    assert lost < 60
    stated = WrenchNoise.of(run.scene.probe.as_probe())
    over = LOUD["drivers.sim.noise_torque"] / stated.torque
    assert run.summary.noise_at_rest["over_stated"] == pytest.approx(over, rel=0.1)
    assert any("as noisy at rest" in sentence for sentence in run.summary.warnings)
