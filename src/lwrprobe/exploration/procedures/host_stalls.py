"""What this host allows: for how long it keeps a process from running that wants to, and which cycle that leaves."""

from __future__ import annotations

import time

import numpy as np

from lwrprobe.contracts import HealthCheck
from lwrprobe.control import ForceLaw
from lwrprobe.exploration.procedures.start_posture import scene_at_start
from lwrprobe.exploration.stages.pipeline import reaction_delay
from lwrprobe.exploration.stages.touch_law import tip_mass, touch_law
from lwrprobe.host.real_time import LOOP, real_time_priority
from lwrprobe.scene import Scene

CYCLES_MS = (1, 2, 4, 5, 10, 20, 50, 100)
"""That FRI can be opened with and that are reported."""
MISSED = 1e-3
"""Share of the cycles that may be missed: the best rating takes 97 % of the answers, and three missing in a row stop
the arm."""
TICK = 0.001
"""s between two wake-ups."""

_QUIETER = (
    "real-time priority (`- rtprio 99` and `- memlock unlimited` in /etc/security/limits.conf), a core of its own "
    "(isolcpus, drivers.fri.core), or fewer programs beside it"
)


def stalls(seconds: float) -> np.ndarray:
    """(n,) s by which a process that sleeps for a millisecond at a time wakes up too late."""
    late, end = [], time.monotonic() + seconds
    while (now := time.monotonic()) < end:
        time.sleep(TICK)
        late.append(time.monotonic() - now - TICK)
    return np.maximum(np.array(late), 0.0)


def smallest_cycle(late: np.ndarray) -> float | None:
    """s: least of `CYCLES_MS` of which half is enough to wake up in, but for a share `MISSED`; None where none is."""
    for cycle in CYCLES_MS:
        # A stall takes with it all cycles that begin meanwhile.
        missed = np.ceil(np.maximum(late - 0.5e-3 * cycle, 0.0) / (1e-3 * cycle)).sum()
        if missed <= MISSED * max(1.0, len(late) * TICK / (1e-3 * cycle)) or (late < 0.5e-3 * cycle).all():
            return 1e-3 * cycle
    return None


def host_checks(
    scene: Scene, cycle: float, latency: float, seconds: float, arm_mass: float = 0.0, late: float = 0.0
) -> list[HealthCheck]:
    """Idle for some seconds, half of them with real-time priority where that is permitted, and evaluate it.

    Parameters
    ----------
    cycle : s, of the arm
    latency : s, of the sensor
    arm_mass : kg, of the arm's moving links
    late : s, by which the arm follows set points later than in the next cycle
    """
    ordinary = stalls(0.5 * seconds)
    with real_time_priority(LOOP) as permitted:
        preferred = stalls(0.5 * seconds) if permitted else ordinary
    allowed = smallest_cycle(preferred)
    enough = allowed is not None and allowed <= cycle + 1e-9
    text = "none: it is too busy" if allowed is None else f"{1e3 * allowed:g} ms or longer"
    checks = [
        HealthCheck("host stalls", _described(ordinary), True, {"longest_ms": 1e3 * float(ordinary.max())}),
        HealthCheck(
            "real-time priority",
            f"permitted; then {_described(preferred)}" if permitted else f"not permitted; better: {_QUIETER}",
            True,
            {"permitted": permitted, "longest_ms": 1e3 * float(preferred.max())},
        ),
        HealthCheck(
            "cycle allowed",
            f"{text}; the arm's is {1e3 * cycle:g} ms" + ("" if enough else f"; better: {_QUIETER}"),
            enough,
            {"cycle_ms": None if allowed is None else 1e3 * allowed},
        ),
    ]
    delay = reaction_delay(scene, cycle, latency, scene.sensor.rate, arm_delay=late)
    return [*checks, _speed(scene, delay, float(np.quantile(preferred, 0.999)), arm_mass)]


def _described(late: np.ndarray) -> str:
    median, high, longest = 1e3 * np.quantile(late, (0.5, 0.999, 1.0))
    return f"median {median:.2f} ms, p99.9 {high:.2f} ms, longest {longest:.2f} ms of {len(late)} wake-ups"


def _speed(scene: Scene, delay: float, stall: float, arm_mass: float) -> HealthCheck:
    """How fast a surface may be approached with a stall in the way, beside what the stated delay allows."""
    scene, robot, _, q = scene_at_start(scene)
    mass, speeds = tip_mass(robot, arm_mass, q), []
    for seconds in (delay, delay + stall):
        law = touch_law(scene, seconds, mass, max_speed=1.0)
        speeds.append(1e3 * law.approach_speed if isinstance(law, ForceLaw) else 0.0)
    return HealthCheck(
        "speed along the stick",
        f"{speeds[1]:.1f} mm/s with a stall of {1e3 * stall:.1f} ms, {speeds[0]:.1f} mm/s without",
        speeds[1] > 0.0,
        {"speed_mm_s": speeds[1], "speed_without_mm_s": speeds[0]},
    )
