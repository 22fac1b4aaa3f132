"""Lines for `lwrprobe doctor`: how the line to the controller behaves while nothing moves."""

from __future__ import annotations

import time
from dataclasses import asdict

import numpy as np

from lwrprobe.contracts import HealthCheck
from lwrprobe_fri.connection import Connection
from lwrprobe_fri.wire import JOINTS, Measurement, Quality


def connection_health(line: Connection, seconds: float) -> list[HealthCheck]:
    """Listen for `seconds`; raises ConnectionLost when the controller falls silent."""
    joints: list[tuple[float, ...]] = []
    begin = time.monotonic()
    before = asdict(line.traffic)
    end = begin + seconds
    arrival = line.arrival()
    while time.monotonic() < end or not joints:
        arrival = line.next(arrival.index)
        joints.append(arrival.measurement.measured)
    counts = {name: value - before[name] for name, value in asdict(line.traffic).items()}
    m = arrival.measurement
    timing = line.timing()
    return [
        *_timing(timing[timing[:, 0] >= begin], m, counts["lost"]),
        _losses(counts),
        *_controller(m),
        *_drives(m),
        _rest(np.array(joints)),
    ]


def _timing(timing: np.ndarray, m: Measurement, lost: int) -> list[HealthCheck]:
    arrivals, turnarounds = 1000.0 * timing.T
    cycle = 1000.0 * m.cycle
    gaps = np.diff(arrivals) if len(arrivals) > 1 else np.array([cycle])
    jitter = np.abs(gaps - cycle)
    rate = 1000.0 / gaps.mean()
    share = rate * cycle / 1000.0
    p99, turn = float(np.quantile(jitter, 0.99)), float(np.quantile(turnarounds, 0.99))
    return [
        HealthCheck("cycle", f"{cycle:.1f} ms", 1.0 <= cycle <= 100.0, {"cycle_ms": cycle}),
        HealthCheck("rate", f"{rate:.1f} Hz of {1000.0 / cycle:.1f}{_of_whom(share, lost)}", abs(share - 1.0) < 0.02),
        HealthCheck(
            "jitter", f"median {np.median(jitter):.3f} ms, p99 {p99:.3f} ms", p99 < 0.5 * cycle, {"p99_ms": p99}
        ),
        HealthCheck("answer", f"sent after {np.median(turnarounds):.3f} ms, p99 {turn:.3f} ms", turn < 0.5 * cycle),
    ]


def _of_whom(share: float, lost: int) -> str:
    """Whether the controller sent too little or the way here lost it: sequence numbers count what was sent."""
    if abs(share - 1.0) < 0.02:
        return ""
    if lost:
        return f", {lost} lost on the way"
    return ", as many as the controller sent" + (": it paused" if share < 1.0 else "")


def _losses(counts: dict[str, int]) -> HealthCheck:
    total = counts["received"] + counts["lost"]
    bad = {k: v for k, v in counts.items() if v and k not in ("received", "late_set_points")}
    text = ", ".join(f"{v} {k.replace('_', ' ')}" for k, v in bad.items()) or "none"
    return HealthCheck("losses", f"{text} of {total}", sum(bad.values()) <= 0.01 * total, counts)


def _controller(m: Measurement) -> list[HealthCheck]:
    return [
        HealthCheck("quality", m.quality.name, m.quality >= Quality.OK, {"quality": int(m.quality)}),
        HealthCheck(
            "latency", f"{1000 * m.latency:.2f} ms round trip, jitter {1000 * m.jitter:.2f} ms", m.latency < m.cycle
        ),
        HealthCheck("answers", f"{100 * m.answer_rate:.1f} % in time, {m.misses} missed since it was opened"),
        HealthCheck("state", f"{m.state.name}, safety factor {m.safety_factor:g}", True, {"state": int(m.state)}),
    ]


def _drives(m: Measurement) -> list[HealthCheck]:
    hot = m.temperature.max()
    faulty = [name for i, name in enumerate(JOINTS) if (m.error | m.warning) >> i & 1]
    text = f"errors 0x{m.error:04x}, warnings 0x{m.warning:04x}" + (f" ({', '.join(faulty)})" if faulty else "")
    return [
        HealthCheck("drives", ("on, " if m.power else "off, ") + text, m.error == 0, {"power": m.power}),
        HealthCheck("temperature", f"up to {hot:.0f} degC", hot < 70.0, {"temperature": m.temperature.tolist()}),
    ]


def _rest(joints: np.ndarray) -> HealthCheck:
    spread = float(np.degrees(joints.std(axis=0)).max())
    drift = float(np.degrees(np.abs(joints[-1] - joints[0])).max())
    text = f"sigma up to {spread:.2g} deg, drift {drift:.2g} deg"
    return HealthCheck("joints at rest", text, spread < 0.01, {"sigma_deg": spread})
