"""From datagrams to wrench samples: order, clock, units, flags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import SampleStatus, WrenchSample
from lwrprobe_ati.calibration import Calibration
from lwrprobe_ati.clock import DeviceClock
from lwrprobe_ati.config import AtiConfig
from lwrprobe_ati.packet_filter import PacketFilter
from lwrprobe_ati.wire import Record, decode_datagram, status_flags

_IMPOSSIBLE = 1.5  # times the range: nothing that the sensor can report
_FROZEN = 3  # repetitions in a row that are no mere duplicate of the network any more


@dataclass(slots=True)
class Traffic:
    """What came besides good records.

    Attributes
    ----------
    datagrams : all that came from the device
    malformed : refused: wrong size or content
    absent : without the wanted transducer
    left_over : bytes behind the last record, in all
    """

    datagrams: int = 0
    malformed: int = 0
    absent: int = 0
    left_over: int = 0


class Stream:
    """Turns what arrives into samples; never raises for what is on the line."""

    def __init__(self, config: AtiConfig, calibration: Calibration) -> None:
        self.traffic = Traffic()
        self.packets = PacketFilter(config.rate)
        self.last: Record | None = None
        self._config = config
        self._clock = DeviceClock()
        self._to_si = calibration.to_si
        self._limits = calibration.ratings
        self._sequence = 0
        self.ahead = 0
        """By how much the device's record numbers are ahead of the samples' sequence."""
        self._unchanged = 0
        self._stuck = round(config.stuck_after * config.rate) or 1 << 62

    def samples(self, data: bytes, arrival: float, now: float) -> list[WrenchSample]:
        """The good and the flagged samples in one datagram, oldest first; it came at `arrival`, is read `now` [s]."""
        self.traffic.datagrams += 1
        datagram = decode_datagram(data, self._config.transducer)
        if isinstance(datagram, str):
            if datagram == "absent":
                self.traffic.absent += 1
            else:
                self.traffic.malformed += 1
            return []
        self.traffic.left_over += datagram.left_over
        found = (self._sample(record, arrival, now) for record in datagram.records)
        return [sample for sample in found if sample is not None]

    def _sample(self, record: Record, arrival: float, now: float) -> WrenchSample | None:
        gap = self.packets.gap(record, arrival)
        if gap is None:
            return self._frozen_sample(record, arrival)
        self._unchanged = self._unchanged + 1 if self.last and record.counts == self.last.counts else 0
        self.last = record
        self._sequence += 1 + gap
        self.ahead = record.sequence - self._sequence
        time = self._clock.host_time(record.stamp, arrival)
        flags = status_flags(record, self._config.transducer)
        if gap:
            flags |= SampleStatus.LOST_BEFORE
        if now - time > self._config.late_after:
            flags |= SampleStatus.LATE
        if self._unchanged >= self._stuck:
            flags |= SampleStatus.FROZEN
        return self._in_si(record, time, flags)

    def _frozen_sample(self, record: Record, arrival: float) -> WrenchSample | None:
        if self.packets.repeats_in_a_row < _FROZEN:
            return None
        time = self._clock.host_time(record.stamp, arrival)
        return self._in_si(record, time, status_flags(record, self._config.transducer) | SampleStatus.FROZEN)

    def _in_si(self, record: Record, time: float, flags: SampleStatus) -> WrenchSample:
        wrench = self._to_si @ np.array(record.counts, dtype=np.float64)
        load = float((np.abs(wrench) / self._limits).max())
        if load >= 1.0:
            flags |= SampleStatus.SATURATED
        if load > _IMPOSSIBLE:
            flags |= SampleStatus.INVALID
        return WrenchSample(time, wrench[:3], wrench[3:], self._sequence, int(flags))
