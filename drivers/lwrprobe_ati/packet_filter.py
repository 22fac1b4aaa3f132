"""Packet filter: which records are used, in order, once, and with a clock that agrees with their numbers."""

from __future__ import annotations

from lwrprobe_ati.wire import Record

TICKS = 4096.0
"""Ticks of the time stamp per second."""
_CONVINCING = 3  # doubtful records in a row that agree with each other: the device has begun anew
_SLACK = 6.0  # ticks of rounding and start-up
_CLOCK_STEP = 0.5  # s by which the device's clock may differ from the host's over a gap


class PacketFilter:
    """Counts lost, repeated and late records, and distinguishes a restarted device from corrupt records.

    Parameters
    ----------
    rate : Hz, of the records
    """

    def __init__(self, rate: float) -> None:
        self._period = TICKS / rate
        self._last: Record | None = None
        self._last_arrival = 0.0
        self._doubtful: list[Record] = []
        self.received = 0
        self.lost = 0
        self.repeated = 0
        self.old = 0
        self.implausible = 0
        self.rebooted = False
        """The device's clock has jumped: it was switched off, its settings and bias may be gone."""
        self.repeats_in_a_row = 0

    def gap(self, record: Record, arrival: float) -> int | None:
        """Records lost just before this one, or None when it is not to be used."""
        last = self._last
        if last is None:
            return self._accept(record, arrival, 0)
        ahead, ticks = _signed(record.sequence - last.sequence), _signed(record.stamp - last.stamp)
        if ahead == 0 and ticks == 0:
            self.repeated += 1
            self.repeats_in_a_row += 1
            return None
        if self._follows(last, record):
            self.lost += ahead - 1
            return self._accept(record, arrival, ahead - 1)
        if ahead < 0 and ticks < 0:
            self.old += 1
        else:
            self.implausible += 1
        return self._doubt(last, record, arrival)

    def _doubt(self, last: Record, record: Record, arrival: float) -> int | None:
        if self._doubtful and not self._follows(self._doubtful[-1], record):
            self._doubtful = []
        self._doubtful.append(record)
        if len(self._doubtful) < _CONVINCING:
            return None
        passed = _signed(record.stamp - last.stamp) / TICKS
        self.rebooted |= abs(passed - (arrival - self._last_arrival)) > _CLOCK_STEP
        return self._accept(record, arrival, 1)

    def _accept(self, record: Record, arrival: float, gap: int) -> int:
        self._last, self._last_arrival = record, arrival
        self._doubtful = []
        self.repeats_in_a_row = 0
        self.received += 1
        return gap

    def _follows(self, earlier: Record, later: Record) -> bool:
        ahead, ticks = _signed(later.sequence - earlier.sequence), _signed(later.stamp - earlier.stamp)
        expected = ahead * self._period
        return ahead > 0 and later.mask == earlier.mask and 0.5 * expected - _SLACK <= ticks <= 2.0 * expected + _SLACK


def _signed(difference: int) -> int:
    """A difference of 32-bit counters, the short way round."""
    return (difference + 0x80000000 & 0xFFFFFFFF) - 0x80000000
