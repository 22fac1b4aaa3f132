"""Lines for `lwrprobe doctor`: how the sensor behaves while nothing touches it."""

from __future__ import annotations

import time

import numpy as np

from lwrprobe.contracts import DriverError, HealthCheck, SampleStatus, WrenchSample
from lwrprobe_ati.calibration import Calibration
from lwrprobe_ati.sensor import AtiSensor
from lwrprobe_ati.setup import Setup
from lwrprobe_ati.wire import Record, battery_light

_POLL = 0.002
_AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")


def sensor_health(sensor: AtiSensor, seconds: float) -> list[HealthCheck]:
    """Listen for `seconds`, opening the sensor for them if need be; raises ConnectionLost when it falls silent."""
    if not sensor.is_open:
        with sensor:
            return sensor_health(sensor, seconds)
    samples: list[WrenchSample] = []
    ages: list[float] = []
    before = sensor.counters()
    end = time.monotonic() + seconds
    while time.monotonic() < end or len(samples) < 3:
        for sample in sensor.read():
            samples.append(sample)
            ages.append(time.monotonic() - sample.time)
        time.sleep(_POLL)
    setup, record = sensor.setup, sensor.stream.last if sensor.stream is not None else None
    if setup is None or record is None:
        raise DriverError("the sensor is not open")
    counts = {name: value - before[name] for name, value in sensor.counters().items()}
    return [
        *_timing(sensor, samples, ages),
        _losses(counts),
        *_wrench(setup.calibration, samples),
        _flags(samples),
        *_device(setup, record),
    ]


def _timing(sensor: AtiSensor, samples: list[WrenchSample], ages: list[float]) -> list[HealthCheck]:
    times = np.array([s.time for s in samples])
    rate = (samples[-1].sequence - samples[0].sequence) / max(times[-1] - times[0], 1e-9)
    oldest = 1000.0 * float(np.quantile(ages, 0.99))
    return [
        HealthCheck(
            "rate", f"{rate:.1f} Hz of {sensor.rate:g}", abs(rate / sensor.rate - 1.0) < 0.05, {"rate_hz": rate}
        ),
        HealthCheck(
            "jitter of arrival",
            f"median {1000.0 * float(np.median(ages)):.2f} ms, p99 {oldest:.2f} ms after the fastest",
            oldest < 1000.0 * sensor.config.late_after,
            {"p99_ms": oldest},
        ),
        HealthCheck("latency", f"{1000.0 * sensor.latency:.2f} ms from averaging and filter, without the radio"),
    ]


def _losses(counts: dict[str, int]) -> HealthCheck:
    total = counts["received"] + counts["lost"]
    bad = {k: v for k, v in counts.items() if v and k not in ("received", "datagrams")}
    text = ", ".join(f"{v} {k.replace('_', ' ')}" for k, v in bad.items()) or "none"
    return HealthCheck(
        "losses", f"{text} of {total}", counts["lost"] <= 0.01 * total and not counts["malformed"], counts
    )


def _wrench(calibration: Calibration, samples: list[WrenchSample]) -> list[HealthCheck]:
    """In N and N·mm; drift compares the last fifth with the first."""
    values = np.array([[*s.force, *(1000.0 * s.torque)] for s in samples])
    noise, mean = values.std(axis=0), values.mean(axis=0)
    fifth = max(1, len(values) // 5)
    drift = values[-fifth:].mean(axis=0) - values[:fifth].mean(axis=0)
    limits = calibration.ratings * np.repeat([1.0, 1000.0], 3)
    return [
        HealthCheck("noise", _six(noise), bool((noise < 0.01 * limits).all()), {"sigma": noise.tolist()}),
        HealthCheck("bias", _six(mean), bool((np.abs(mean) < 0.5 * limits).all()), {"mean": mean.tolist()}),
        HealthCheck("drift", _six(drift), bool((np.abs(drift) < 0.01 * limits).all()), {"drift": drift.tolist()}),
    ]


def _six(values: np.ndarray) -> str:
    return ", ".join(f"{axis} {value:.3g}" for axis, value in zip(_AXES, values)) + " (N, N·mm)"


def _flags(samples: list[WrenchSample]) -> HealthCheck:
    seen = SampleStatus.OK
    for sample in samples:
        seen |= SampleStatus(sample.status)
    text = ", ".join((flag.name or "").lower() for flag in SampleStatus if flag and flag in seen)
    return HealthCheck("flags", text or "none", seen in (SampleStatus.OK, SampleStatus.LOST_BEFORE))


def _device(setup: Setup, record: Record) -> list[HealthCheck]:
    calibration = setup.calibration
    light = battery_light(record)
    named = f"serial {calibration.serial or '?'}, {calibration.part or '?'} of {calibration.date or '?'}"
    who = "the device" if calibration.device_multiplies else "this host (Mult OFF)"
    limits = calibration.ratings
    return [
        HealthCheck("battery", f"light {light.name.lower()}, level {record.battery}", light.name in ("GREEN", "DARK")),
        HealthCheck(
            "calibration", f"{calibration.number} of transducer {calibration.transducer}: {named}; matrix by {who}"
        ),
        HealthCheck("range", f"{limits[0]:g} {limits[1]:g} {limits[2]:g} N, {1000.0 * limits[3]:g} N·mm"),
        HealthCheck("firmware", setup.firmware or "not reported"),
    ]
