"""The bench of the certificate: hidden bumps are found or not claimed, and a claim that is too small is seen."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.bench import certificate as bench
from lwrprobe.bench.perfect_sphere import PerfectSphere
from lwrprobe.contracts import Area
from lwrprobe.mapping.certificate import Certificate
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

AREA = Area(np.array([-0.03, -0.03, 0.006]), np.array([0.03, 0.03, 0.03]))
RADIUS, STICK = 0.005, 0.002


def test_the_perfect_sphere_goes_over_a_block_and_never_into_it():
    solid = Solid.from_shapes([Box(shape="box", size=(0.03, 0.02, 0.02), at=Pose(xyz=(0.0, 0.0, 0.01)))])
    sphere = PerfectSphere(solid, AREA, RADIUS, STICK, 0.05)
    trails = sphere.lines(1, np.array([-0.01, 0.0, 0.012]))
    centres, contacts = np.vstack([t.centres for t in trails]), np.vstack([t.contacts for t in trails])
    assert solid.signed_distance(centres).min() >= RADIUS - 1e-6
    assert np.abs(solid.signed_distance(contacts)).max() < 1e-6
    assert set(np.round(contacts[:, 1], 5)) >= {-0.01, 0.01}  # both walls
    assert np.isclose(contacts[:, 2], 0.02).any()
    assert np.isclose(np.abs(centres[:, 1]).max(), 0.03, atol=0.001)  # and on to the border


@pytest.fixture(scope="module")
def report():
    return bench.run(True, {"count": "6", "voxels": "30000"})


def test_no_bump_is_missed(report):
    assert all(verdict.held for verdict in report.verdicts)
    outcomes = [item["outcome"] for item in report.data["objects"]]
    assert outcomes.count(bench.FOUND) >= 4
    assert all(item["bump"] >= item["certified"] for item in report.data["objects"])
    assert all(0.0 < item["hidden"] < item["certified"] for item in report.data["objects"])


def test_a_certificate_that_claims_too_much_is_caught(monkeypatch):
    whole = Certificate.hiding
    monkeypatch.setattr(Certificate, "hiding", lambda self: replace(whole(self), diameter=0.1 * whole(self).diameter))
    caught = bench.run(True, {"count": "6", "voxels": "30000"}).verdicts[0]
    assert not caught.held
    assert int(caught.measured.split()[0]) > 0


def test_the_page_says_what_is_certified_and_what_hides(report, tmp_path):
    written = report.write(out=tmp_path)
    text = written[0].read_text()
    assert "mm in the median, and the largest ball that hides" in text
    assert (tmp_path / "certificate-sizes.png").stat().st_size > 10_000
