"""Faults of the sensor's stream: each case of the stability suite holds."""

import pytest

from lwrprobe.bench.stability.cases.devices import CASES

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case.number))
def test_case_holds(case):
    findings = case.run(True)
    assert findings
    assert [f"{f.setting}: {f.happened}" for f in findings if not f.sound] == []
