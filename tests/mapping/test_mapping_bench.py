"""The bench runs, compares like with like and says what it left out."""

from __future__ import annotations

import numpy as np
import pytest

from lwrprobe.bench import mapping
from lwrprobe.bench.voxel_block import EDGE, block_surface
from lwrprobe.contracts import UnknownNameError
from lwrprobe.mapping import VoxelMap

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(mapping, "QUICK_BUDGET", 0.02)


def test_a_small_run(tmp_path):
    report = mapping.run(True, {"voxels": "1500"})
    (table,) = report.tables
    assert [row[0] for row in table.rows] == list(report.data["seconds"])
    assert all(cell > 0.0 for row in table.rows for cell in row[2:])
    same = [verdict for verdict in report.verdicts if "byte for byte" in verdict.requirement]
    assert same
    assert all(verdict.held for verdict in same)
    written = report.write(tmp_path / "m.json", tmp_path)
    assert {path.name for path in written} == {"m.json", "mapping.md", "mapping-1.csv", "mapping-time.png"}


def test_without_peers_there_are_figures_but_no_ratios(monkeypatch):
    monkeypatch.setattr(mapping, "PEERS", {"no_such_module_at_all": "no-such-package"})
    report = mapping.run(True, {"voxels": "500"})
    assert report.verdicts == []
    assert any("no-such-package is not installed" in note for note in report.notes)


def test_unknown_option():
    with pytest.raises(UnknownNameError, match="voxels"):
        mapping.run(True, {"voxel": "10"})


@pytest.mark.parametrize("count", [1, 100, 5000])
def test_the_block_has_that_many_voxels_on_its_surface(count):
    centres, middle, size = block_surface(count)
    voxels = VoxelMap(EDGE)
    assert voxels.insert(centres) == count
    beyond = np.abs(centres - middle) - 0.5 * size
    np.testing.assert_allclose(beyond.max(axis=1), -0.5 * EDGE, atol=1e-9)
    assert centres[:, 2].min() >= 0.0
