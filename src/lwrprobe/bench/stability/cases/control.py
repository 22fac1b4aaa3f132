"""Stiffness, delay, the first touch: does the force stay where the formulas put it?"""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.bench.gantry import build_world, rest
from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.bench.stability.gantry_loop import TOP, UPRIGHT, press
from lwrprobe.bench.stability.runs import strip
from lwrprobe.contact import WrenchConditioner, agreed_bias, zero_force_point
from lwrprobe.contracts import WrenchSample
from lwrprobe.control import Refusal, choose_force_law, peak_force

TARGET, LIMIT, THRESHOLD, BRAKING = 0.8, 3.0, 0.2, 1.0
STICK = 1.3e6
CYCLE = 1e-4
SAMPLING = 80  # cycles between two readings
GRAVITY = 9.80665
OFFSET = np.array([0.12, -0.08, 0.25, 1e-3, -2e-3, 5e-4])


def _pressed(stiffness: float, delay: float, rigid: bool) -> Finding:
    """Peak on approach against the formula; the force limit and the hold decide as well."""
    series = stiffness if rigid else 1.0 / (1.0 / stiffness + 1.0 / STICK)
    stick = "rigid stick" if rigid else "stick 1.3e6 N/m"
    setting = f"K {stiffness:.0e} N/m, {stick}, tau {1e3 * delay:g} ms"
    law = choose_force_law(
        series, delay + CYCLE, TARGET, LIMIT, force_threshold=THRESHOLD, braking=BRAKING, max_speed=0.5
    )
    if isinstance(law, Refusal):
        return Finding(setting, f"refused: {law.reason}", held=True)
    settings = [f"object.0.stiffness={stiffness}", "object.0.damping=0.0"]
    settings += [f"probe.stiffness_axial={0.0 if rigid else STICK}"]
    response = press(law, delay, THRESHOLD, BRAKING, settings, cycle=CYCLE)
    formula = peak_force(law.approach_speed, series, delay, BRAKING, THRESHOLD)
    off = abs(response.peak_approach - formula) / formula
    steady = response.swing < 0.05 * TARGET and abs(response.rest - TARGET) < 0.05 * TARGET
    text = (
        f"S {law.stability_number:.3f}, {1e3 * law.approach_speed:.3g} mm/s, peak {response.peak_approach:.3f} N "
        f"(formula {formula:.3f}), largest {response.peak:.3f} N, "
        f"rests at {response.rest:.3f} N within {response.swing:.2g} N"
    )
    return within(setting, text, off, 0.10, "of the formula", also=steady and response.peak <= LIMIT)


def _stiffness_sweep(quick: bool) -> list[Finding]:
    decades = (1e2, 1e5, 1e7) if quick else tuple(10.0**k for k in range(2, 8))
    return [_pressed(k, 0.010, rigid) for rigid in (False, True) for k in decades]


def _latency_sweep(quick: bool) -> list[Finding]:
    delays = (0.0, 0.01, 0.05) if quick else (0.0, 0.002, 0.005, 0.01, 0.02, 0.05)
    return [_pressed(1e5, delay, rigid=True) for delay in delays]


def _start_in_contact(quick: bool) -> list[Finding]:
    """The sensor's own offset hides a light touch: only a second place shows it."""
    found = []
    for depth in (0.0, 1e-4) if quick else (0.0, 1e-5, 3e-5, 1e-4, 3e-4):
        world = build_world(
            ["object.0.stiffness=1e4"], bias_force=tuple(OFFSET[:3]), bias_torque=tuple(OFFSET[3:]),
            gravity=(0.0, 0.0, -GRAVITY), noise_force=0.003, noise_torque=2e-5,
        )  # fmt: skip
        conditioner = WrenchConditioner(world.probe, world.scene.sensor.rate)
        place = np.array([0.0, 0.0, TOP - depth if depth else TOP + 0.001])

        def retreat(place: np.ndarray = place) -> None:
            place[2] += 0.002

        def readings(world: Any = world, place: np.ndarray = place) -> list[WrenchSample]:
            return rest(world, place, 100)

        taken = agreed_bias(conditioner, readings, retreat, UPRIGHT)
        off = 1e3 * float(np.abs(conditioner.bias[:3] - OFFSET[:3]).max())
        right = taken.outcome.taken and taken.touched == (depth > 0.0)
        text = (
            f"{'touch seen' if taken.touched else 'no touch seen'}, {taken.retreats} retreats, bias off by {off:.2g} mN"
        )
        found.append(within(f"pressed with {1e4 * depth:.2g} N at t = 0", text, off, 5.0, "mN", also=right))
    return [*found, _run_from_contact()]


def _run_from_contact() -> Finding:
    """A whole run that starts pressed by 0.1 mm onto a post, which the start pose of the strip stands on."""
    block = "{ shape = 'box', size = [0.1, 0.05, 0.05], at = { xyz = [0.0, 0.0, 0.025] } }"
    post = "{ shape = 'box', size = [0.004, 0.004, 0.0531], at = { xyz = [0.0, -0.06, 0.02655] } }"
    run = strip("block", [f"object=[{block}, {post}]"])
    error = run.summary["contact_error_mm"]["median"] if run.summary["contact_error_mm"] else float("nan")
    text = f"{run.describe()}; contacts off by {error:.3f} mm, which a wrong zero of 2 N would not leave so"
    return within("a run from the top of a post", text, error, 0.15, "mm", also=run.summary["contacts"] > 500)


def _soft_object(quick: bool) -> list[Finding]:
    """A slow touch, read at 125 Hz with 3 mN of noise, is extrapolated to zero force.

    Without that the place would be wrong by the indentation.
    """
    found, random = [], np.random.default_rng(11)
    for stiffness in (1e2, 1e3) if quick else (1e2, 2e2, 5e2, 1e3):
        law = choose_force_law(stiffness, 0.01, TARGET, LIMIT, force_threshold=THRESHOLD, max_speed=0.002)
        settings = [f"object.0.stiffness={stiffness}", "object.0.damping=0.0"]
        if isinstance(law, Refusal):
            found.append(Finding(f"one touch, K {stiffness:.0e} N/m", f"refused: {law}", False))
            continue
        response = press(law, 0.01, THRESHOLD, BRAKING, settings)
        depths, forces = np.array(response.depths)[::SAMPLING], np.array(response.forces)[::SAMPLING]
        fit = zero_force_point(depths, forces + random.normal(0.0, 0.003, len(forces)))
        indentation = 1e3 * response.peak_approach / stiffness
        text = f"K found {fit.stiffness:.4g} N/m, surface off by {1e3 * fit.zero:+.3f} mm; "
        text += f"the indentation was {indentation:.2f} mm"
        found.append(within(f"one touch, K {stiffness:.0e} N/m", text, 1e3 * abs(fit.zero), 0.2, "mm"))
    for stiffness in (1e3,) if quick else (3e2, 1e3):
        settings = [f"object.0.stiffness={stiffness}", f"contact.stiffness={2.0 * stiffness}"]
        run = strip("block", settings)
        off = run.summary["surface_error_mm"]["median"]
        control = run.summary["force_control"]
        text = f"{run.describe()}; K found {control['object_stiffness']} N/m, surface off by {off:.3f} mm"
        setting = f"a run, K {stiffness:.0e} N/m where twice that was stated"
        found.append(within(setting, text, off, 0.2, "mm", also=run.summary["status"] == "done"))
    return found


CASES = (
    Case(1, "stiffness sweep", "peak within 10 % of the formula, below the limit, or refused", _stiffness_sweep),
    Case(2, "latency sweep", "speed reduced by the formula, peak within 10 % of it", _latency_sweep),
    Case(10, "start already in contact", "no bias while touching; after a retreat it is right", _start_in_contact),
    Case(11, "soft object", "corrected to zero force, error < 0.2 mm", _soft_object),
)
