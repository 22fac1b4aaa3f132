"""`lwrprobe bench contact`, the short run: every requirement that is not about time."""

import json

import pytest

from lwrprobe.bench.contact import run
from lwrprobe.contracts import UnknownNameError

pytestmark = pytest.mark.slow


def test_the_short_run_keeps_its_requirements_and_can_be_written(tmp_path):
    report = run(True, {"seed": "3"})
    assert {v.requirement: v.measured for v in report.verdicts if not v.held and " us " not in v.requirement} == {}
    assert len(report.verdicts) == 6
    written = report.write(tmp_path / "c.json", tmp_path)
    assert [path.suffix for path in written] == [".json", ".md", *[".csv"] * len(report.tables), ".png", ".png"]
    tables = json.loads((tmp_path / "c.json").read_text())["tables"]
    assert {row[1] for row in tables[0]["rows"]} == {"force_direction", "wrench_axis", "fused"}


def test_unknown_options_are_refused():
    with pytest.raises(UnknownNameError, match="seed"):
        run(True, {"sead": "3"})
