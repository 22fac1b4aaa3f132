"""The device's time stamps on the host's clock."""

from __future__ import annotations

from lwrprobe_ati.packet_filter import TICKS

_DRIFT = 2e-4  # s per s by which two quartz clocks may part, doubled
_STEP = 1e-6


class DeviceClock:
    """Maps stamps (1/4096 s, modulo 2^32) to seconds of `time.monotonic`.

    No record arrives before it was measured, and now and then one arrives without delay: the least difference
    between arrival and stamp is the offset of the clocks. It may grow slowly, since clocks drift. Times that are
    given out always increase.
    """

    def __init__(self) -> None:
        self._last_stamp: int | None = None
        self._device = 0.0
        self._offset = 0.0
        self._arrival = 0.0
        self._last = float("-inf")

    def host_time(self, stamp: int, arrival: float) -> float:
        """s, the instant of measurement."""
        if self._last_stamp is None:
            self._offset, self._arrival = arrival, arrival
        else:
            self._device += ((stamp - self._last_stamp) & 0xFFFFFFFF) / TICKS
        self._last_stamp = stamp
        grown = self._offset + _DRIFT * (arrival - self._arrival)
        self._offset, self._arrival = min(grown, arrival - self._device), arrival
        self._last = max(self._device + self._offset, self._last + _STEP)
        return self._last

    def forget(self) -> None:
        """Begin anew: the device's clock has been set."""
        self._last_stamp, self._device = None, 0.0
