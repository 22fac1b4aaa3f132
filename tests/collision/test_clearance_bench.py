"""The bench of the clearance runs, compares like with like, and rates what it measured."""

import numpy as np
import pytest

from lwrprobe.bench import clearance
from lwrprobe.bench.timing import installed
from lwrprobe.contracts import UnknownNameError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clearance, "TENFOLD", (100, 1_000))
        return clearance.run(False, {"poses": "12", "rounds": "2"})


def test_everyone_is_timed_at_every_size(report, tmp_path):
    times, ratios = report.tables
    assert [row[0] for row in times.rows] == [row[0] for row in ratios.rows] == [100, 1000]
    assert all(len(row) == len(table.columns) for table in report.tables for row in table.rows)
    assert all(cell > 0.0 for row in times.rows for cell in row)
    written = report.write(tmp_path / "c.json", tmp_path)
    names = {"c.json", "clearance.md", "clearance-1.csv", "clearance-2.csv", "clearance-time.png"}
    assert {path.name for path in written} == names


def test_each_wanted_time_and_the_error_are_judged(report):
    requirements = [verdict.requirement for verdict in report.verdicts]
    assert "100 voxels: median <= 5 us" in requirements
    assert "1000 voxels: median <= 8 us" in requirements
    assert "p99 <= 30 us throughout" in requirements
    error = [verdict for verdict in report.verdicts if "brute force" in verdict.requirement]
    assert all(verdict.held for verdict in error)


def test_all_libraries_find_the_same_distances():
    libraries, _ = installed(clearance.LIBRARIES)
    setting = clearance._Setting(200, 6, libraries)
    for pose in setting.poses:
        answers = [ask(pose) for ask in setting.asks.values()]
        assert np.ptp(answers) < 2e-4  # python-fcl's own error


def test_an_option_that_is_not_known_is_refused():
    with pytest.raises(UnknownNameError, match="pose"):
        clearance.run(True, {"pose": "3"})
