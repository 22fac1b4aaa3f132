"""Two faults during a contour over real sockets; `lwrprobe bench faults` has all of them."""

import pytest

from lwrprobe.bench.faults import FAULTS, suffer

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize("name", ["sensor silent", "drives off"])
def test_fault_stops_the_arm_keeps_the_data_and_says_why(name):
    outcome = suffer(next(fault for fault in FAULTS if fault.name == name))
    reason = outcome.summary["reason"]
    assert outcome.before, f"the run ended before the fault: {reason}"
    assert outcome.stopped
    assert any(word in reason for word in outcome.fault.words), reason
    assert outcome.kept >= outcome.before > 0
    assert outcome.peak <= outcome.limit
    assert outcome.collisions == 0
    assert outcome.travel <= outcome.fault.travel
    if outcome.fault.goes_back:
        assert not outcome.touching
