"""Order of records, and the device's clock on the host's."""

import numpy as np
import pytest

from lwrprobe_ati.clock import DeviceClock
from lwrprobe_ati.packet_filter import PacketFilter
from lwrprobe_ati.wire import Record

RATE = 125.0


def record(sequence, stamp=None, mask=1):
    stamp = round(sequence * 4096 / RATE) if stamp is None else stamp
    return Record(stamp & 0xFFFFFFFF, sequence & 0xFFFFFFFF, (0, 0), 7, mask, (0,) * 6)


def gaps(packets, *records):
    return [packets.gap(r, 1000.0 + k / RATE) for k, r in enumerate(records)]


def test_losses_over_the_wrap_of_the_sequence():
    packets = PacketFilter(RATE)
    first = 2**32 - 2
    records = [record(first + k, round(k * 32.768)) for k in (0, 1, 3, 4, 9)]
    assert gaps(packets, *records) == [0, 0, 1, 0, 4]
    assert packets.lost == 5


def test_recorded_gap_of_104():
    packets = PacketFilter(RATE)
    assert gaps(packets, record(1000), record(1001), record(1106)) == [0, 0, 104]


def test_repetition_and_late_comer():
    packets = PacketFilter(RATE)
    assert gaps(packets, record(5), record(6), record(6), record(4), record(7)) == [0, 0, None, None, 0]
    assert (packets.repeated, packets.old, packets.lost) == (1, 1, 0)


@pytest.mark.parametrize("wild", [record(7, 5), record(2**31, 231), record(100, 230), record(8, mask=3)])
def test_single_record_that_fits_nothing(wild):
    packets = PacketFilter(RATE)
    assert gaps(packets, record(5), record(6), wild, record(7), record(8)) == [0, 0, None, 0, 0]
    assert packets.implausible == 1
    assert not packets.rebooted


def test_rebooted_device_is_recognised_by_its_clock():
    packets = PacketFilter(RATE)
    records = [record(5000), record(5001), *(record(k, 90_000 + 33 * k) for k in range(4))]
    assert gaps(packets, *records) == [0, 0, None, None, 1, 0]
    assert packets.rebooted


def test_stream_that_only_counts_anew_goes_on():
    packets = PacketFilter(RATE)
    start = record(5001).stamp
    records = [record(5000), record(5001), *(record(k, start + round(32.768 * (k + 1))) for k in range(4))]
    assert gaps(packets, *records) == [0, 0, None, None, 1, 0]
    assert not packets.rebooted


def times(clock, stamps, arrivals):
    return np.array([clock.host_time(s & 0xFFFFFFFF, a) for s, a in zip(stamps, arrivals)])


def test_jitter_of_arrival_is_taken_out():
    random = np.random.default_rng(2)
    measured = 50.0 + np.arange(2000) / RATE
    delay = 0.001 + random.exponential(0.004, 2000)
    stamps = np.floor((measured + 12345.0) * 4096).astype(np.int64)
    mapped = times(DeviceClock(), stamps.tolist(), measured + delay)
    late = mapped - measured
    assert (np.diff(mapped) > 0.0).all()
    assert late[200:].std() < 3e-4
    assert 0.0005 < np.median(late[200:]) < 0.0018


def test_wrap_of_the_stamp():
    stamps = [2**32 - 66, 2**32 - 33, 0, 33, 66]
    arrivals = 10.0 + np.arange(5) * 33 / 4096
    assert times(DeviceClock(), stamps, arrivals) == pytest.approx(arrivals, abs=1e-5)


def test_drifting_clocks_are_followed():
    measured = np.arange(40_000) / RATE
    stamps = np.round(measured * (1 - 1e-4) * 4096).astype(np.int64)
    mapped = times(DeviceClock(), stamps.tolist(), measured + 0.001)
    assert np.abs(mapped - measured).max() < 0.003


def test_time_increases_even_when_the_first_record_came_late():
    clock = DeviceClock()
    arrivals = [1.050, 1.050, 1.050, 1.024, 1.032]
    mapped = times(clock, [0, 33, 66, 98, 131], arrivals)
    assert (np.diff(mapped) > 0.0).all()
