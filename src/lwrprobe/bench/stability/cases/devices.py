"""Faults of the sensor's stream, in the simulator: seeded and without sockets (`lwrprobe bench faults` has those)."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.bench.stability.runs import Run, strip
from lwrprobe.contact import RELIABLE_FROM, Wrench, make_estimator
from lwrprobe.contracts import Probe
from lwrprobe.exploration.procedures.calibrate import calibrate
from lwrprobe.scene import load_scene

_SCENE = "cylinder_vertical"
_HALF = 0.012
_EARLY = 8.0
"""s, when the bias has been taken and nothing has been touched yet."""
_PHANTOM = 1.0
"""mm off the true surface, beyond which a contact is one of nothing."""


_ENOUGH = "time limit"
"""What ends a run that continues: the line's first half, up the wall and over the edge, is long enough."""


def _run(*settings: str) -> Run:
    return strip(_SCENE, ["run.time_limit=60.0", *settings], _HALF)


def _phantoms(run: Run) -> float:
    """mm, of the contact farthest from the true surface."""
    return 1e3 * float(np.abs(run.distance).max()) if len(run.distance) else 0.0


def _goes_on(setting: str, run: Run) -> Finding:
    """No contact is found where there is no object, and the run continues unchanged."""
    went_on = run.summary["status"] == "done" or _ENOUGH in run.summary["reason"]
    good = went_on and run.within_limit and len(run.points) > 20
    return within(setting, run.describe() + ", contact farthest off", _phantoms(run), _PHANTOM, "mm", also=good)


def _ends(setting: str, run: Run, words: str) -> Finding:
    """The run stops by itself with that sentence, and the true force has stayed below the limit."""
    said = re.search(words, run.summary["reason"]) is not None
    held = said and run.summary["status"] == "ended early" and len(run.points) == run.summary["contacts"]
    return within(setting, run.describe(), run.summary["peak_force_n"], run.scene.contact.limit, "N", also=held)


def _late_and_lost(quick: bool) -> list[Finding]:
    late = ("drivers.sim.late_share=0.3", "drivers.sim.late_by=0.02", "drivers.sim.loss=0.05")
    findings = [_goes_on("30 % late by up to 20 ms, 5 % lost", _run(*late))]
    silent = _run(*late, "drivers.sim.burst_rate=0.3", "drivers.sim.burst_length=1.0")
    period = 1.0 / silent.scene.sensor.rate
    allowed = silent.scene.safety.sensor_wait
    findings.append(_ends("and bursts of 1 s without a sample", silent, "no usable wrench sample"))
    waited = re.search(r"no usable wrench sample for ([\d.]+) s", silent.summary["reason"])
    seconds = float(waited[1]) if waited else np.inf
    findings.append(within("silence until the stop", silent.ended, 1e3 * seconds, 1e3 * (allowed + 2.0 * period), "ms"))
    return findings


def _frozen(quick: bool) -> list[Finding]:
    """The stream freezes in the middle of the first contour."""
    clean = _run()
    touching = np.flatnonzero(clean.touching)
    if len(touching) < 40:
        return [Finding("a run without faults", f"{clean.describe()}: too short to freeze in", False)]
    # The path, noted at every fifth sample, counts from where the strategy took over, the freeze from where the world
    # began: a run that freezes in the air tells the difference, to the length of the silence.
    early = _run(f"drivers.sim.freeze_at={_EARLY}", "drivers.sim.freeze_for=1000.0")
    noted = 5.0 / clean.scene.sensor.rate
    start = _EARLY + early.scene.safety.silence - noted * len(early.path)
    instant = start + noted * (touching[20] + 1)
    run = _run(f"drivers.sim.freeze_at={instant}", "drivers.sim.freeze_for=1000.0")
    found = _ends("frozen at its last value while touching", run, "no usable wrench sample|cannot be relied on")
    return [replace(found, held=found.held and len(run.points) > 0)]


def _saturated(quick: bool) -> list[Finding]:
    narrow = "[0.6, 0.6, 0.6]"
    run = _run(f"probe.force_range={narrow}")
    findings = [_ends("force range of 0.6 N, 0.8 N wanted", run, "end of its range")]
    share = 0.4
    twist = _run(f"safety.torque_share={share}", "run.time_limit=30.0")
    yields = twist.summary["force_guard_interventions"]
    findings.append(
        within(
            "torque range to be used up to two fifths: 0.96 N sideways",
            f"{twist.describe()}, {yields} times yielded, share used",
            twist.summary["range_used"],
            1.25 * share,
            "",
            also=twist.within_limit and len(twist.points) > 20,
        )
    )
    return findings


def _drift(quick: bool) -> list[Finding]:
    drift = ("drivers.sim.drift_force=[0.05, -0.05, 0.05]", "drivers.sim.drift_torque=[2e-4, 2e-4, 0.0]")
    return [_goes_on("0.05 N/min on each axis", _run(*drift))]


def _nothing_felt(quick: bool) -> list[Finding]:
    """A wrench of nothing, or less than the noise, given to each estimator as a contact."""
    findings = []
    probe = _probe()
    for name in ("fused", "force_direction", "wrench_axis"):
        estimator = make_estimator(name, probe)
        worst, finite = 0.0, True
        for size in (0.0, 1e-300, 1e-12, 1e-4, 2e-3):
            force = np.array([0.0, size, 0.0])
            wrench = Wrench(0.0, force, np.zeros(3), force)
            contact = estimator.estimate(wrench, np.zeros(3), np.eye(3), np.zeros(3))
            finite &= bool(np.isfinite([*contact.point, *contact.normal, contact.magnitude]).all())
            worst = max(worst, contact.confidence_score)
        text = "every number finite, largest confidence" if finite else "numbers that are none, largest confidence"
        findings.append(within(f"0 to 2 mN, {name}", text, worst, np.nextafter(RELIABLE_FROM, 0.0), "", also=finite))
    return findings


def _probe() -> Probe:
    from lwrprobe.scene import load_scene

    return load_scene(_SCENE).probe.as_probe()


def _garbage(quick: bool) -> list[Finding]:
    some = _run("drivers.sim.garbage_rate=2.0")
    rejected = sum(v for k, v in some.summary["wrench_counters"].items() if k in ("invalid", "rejected"))
    first = _goes_on("a NaN twice a second", some)
    first = replace(first, held=first.held and rejected > 0)
    all_bad = _run("drivers.sim.garbage_rate=60.0")
    return [
        first,
        _ends("a NaN in every other sample", all_bad, "bad samples|invalid readings in a row|no usable wrench sample"),
    ]


def _spikes(quick: bool) -> list[Finding]:
    return [_goes_on("5 N for one sample, once a second", _run("drivers.sim.spike_rate=1.0"))]


def _skew(quick: bool) -> list[Finding]:
    """The sensor's time stamps are ahead of the arm's clock; a calibration by touch finds by how much."""
    findings = []
    for skew in (10,) if quick else (-10, 10):
        calibration, _ = calibrate(load_scene("block", ["truth.profile=ideal", f"truth.clock_skew_ms={skew}"]), 0.03)
        seen, sigma = 1e3 * calibration.values("clock_offset")[0], 1e3 * calibration.sigma("clock_offset")[0]
        text = f"found {seen:.2f} ms, sigma {sigma:.2f} ms, off by"
        findings.append(within(f"{skew} ms", text, abs(seen - skew), 1.0, "ms"))
    return findings


CASES = (
    Case(3, "jitter and loss", "stop at most two periods after the limit of silence, go back", _late_and_lost),
    Case(4, "sensor drop-out in contact", "a frozen value is found; stop, no further push", _frozen),
    Case(5, "force saturation", "flagged, no contact, retreat; torque checked first", _saturated),
    Case(6, "drift", "no phantom contacts", _drift),
    Case(7, "zero-norm force", "no NaN, no contact stored", _nothing_felt),
    Case(8, "NaN readings", "rejected and counted; three in a row stop", _garbage),
    Case(9, "impulse noise", "no false contact", _spikes),
    Case(33, "clock skew of force and pose", "found by a calibration to 1 ms", _skew),
)
