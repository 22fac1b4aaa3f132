"""One loop that serves emulated devices: their sockets when something comes, their clocks when something is due."""

from __future__ import annotations

import selectors
import threading
import time
from collections.abc import Sequence
from typing import Protocol

_LONGEST_SLEEP = 0.05


class Device(Protocol):
    """An emulated device, served by one thread and therefore free of locks."""

    def open(self, selector: selectors.BaseSelector) -> None:
        """Bind and register sockets; the data of each registration is a callable without arguments."""

    def due(self) -> float:
        """When `work` wants to be called next, on the clock of `time.monotonic`."""

    def work(self, now: float) -> None:
        """Do what is due."""

    def control(self, line: str) -> str:
        """Carry out one line of the operator and answer it; raises InputError."""

    def close(self) -> None:
        """Release the sockets."""


class Reactor:
    """Serves devices until stopped; as a context manager, in a thread of its own."""

    def __init__(self, devices: Sequence[Device]) -> None:
        self._devices = devices
        # select() takes microseconds, epoll only milliseconds.
        self._selector = selectors.SelectSelector()
        self._stopping = False
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None
        opened: list[Device] = []
        try:
            for device in devices:
                device.open(self._selector)
                opened.append(device)
        except BaseException:
            for device in opened:
                device.close()
            raise

    def run(self, seconds: float = float("inf")) -> None:
        """Serve for that long, or until `stop`; then close the devices."""
        end = time.monotonic() + seconds
        try:
            while not self._stopping and time.monotonic() < end:
                self._turn()
        finally:
            for device in self._devices:
                device.close()
            self._selector.close()

    def stop(self) -> None:
        """Make `run` return soon; may be called from any thread and from a device."""
        self._stopping = True

    def __enter__(self) -> Reactor:
        self._thread = threading.Thread(target=self._run_quietly, name="reactor", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()
        if self._thread is not None:
            self._thread.join()
        if self._failure is not None and error[0] is None:
            raise self._failure

    def _run_quietly(self) -> None:
        try:
            self.run()
        except BaseException as error:
            self._failure = error

    def _turn(self) -> None:
        """What has arrived is read before the clocks are looked at: an answer in the buffer came in time."""
        wait = min(device.due() for device in self._devices) - time.monotonic()
        for key, _ in self._selector.select(max(0.0, min(wait, _LONGEST_SLEEP))):
            key.data()
        now = time.monotonic()
        for device in self._devices:
            if device.due() <= now:
                device.work(now)
