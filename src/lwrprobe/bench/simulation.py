"""The simulator: error against time step and run time, energy, MuJoCo as reference, cost of a cycle.

One sphere on a stick is pressed against a wall and let go again. The reference is scipy's Radau at 1e-10; beside the
simulator stand the explicit, semi-implicit and implicit Euler steps of the same equation. The simulator itself runs
on three straight axes, everything else as in a run.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from lwrprobe.bench import simulation_kernels as kernels
from lwrprobe.bench.gantry import build_world, follow
from lwrprobe.bench.mujoco_reference import compare_with_mujoco
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.bench.timing import interleave
from lwrprobe.contracts import DriverContext
from lwrprobe.contracts.plugins import load
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.scene import load_scene

TOP = 0.055  # m, height of the sphere's centre when it just touches the block
GAP = 1e-4  # m, from which it starts
STICK = 2500.0  # N/m
RELAXATION = 0.002  # s, of the stick
DAMPING = 5.0  # N s/m, of the contact
MASS = 0.002  # kg, of the swinging tip
PEAK = 2.0  # N, aimed at
OWN = "simulator"
RIVALS: dict[str, Callable[..., int]] = {
    "explicit": kernels.explicit_steps,
    "semi-implicit": kernels.semi_implicit_steps,
    "implicit, 1-D": kernels.implicit_steps,
}
STEPS_MS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
_KNOTS = np.linspace(0.0, 1.0, 1001)  # s, the arm's cycles
STIFFNESSES = tuple(10.0**k for k in range(2, 8))


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench simulation`; no options."""
    Options("simulation", options)
    report = BenchReport("simulation", "The simulator: error, energy, cost", machine=_machine())
    quiet = _error_at_rest(report, STEPS_MS if not quick else (0.1, 1.0, 5.0))
    swing = _error_swinging(report, (1, 4, 16, 64, 256) if quick else (1, 4, 16, 64, 256, 1024))
    _energy(report, quick)
    compare_with_mujoco(report)
    _cost(report, 0.3 if quick else 2.0)
    report.figures["error"] = lambda figure: _draw(figure, quiet, swing)
    return report


def _machine() -> dict[str, str]:
    return machine() | versions("numpy", "numba", "scipy", "mujoco")


Instant = TypeVar("Instant", float, np.ndarray)


def _foot(t: Instant, depth: float) -> Instant:
    """Where the stick's foot is below the place of first touch: in and out again within a second."""
    return -GAP + (depth + GAP) * 0.5 * (1.0 - np.cos(2.0 * np.pi * t))


def _foot_speed(t: float, depth: float) -> float:
    return (depth + GAP) * np.pi * np.sin(2.0 * np.pi * t)


def _driven_foot(t: Instant, depth: float) -> Instant:
    """The same as an arm drives it: straight from one cycle of 1 ms to the next."""
    return np.interp(t, _KNOTS, _foot(_KNOTS, depth))


def _depth(stiffness: float) -> float:
    return PEAK * (1.0 / STICK + 1.0 / stiffness)


def _reference_at_rest(stiffness: float, times: np.ndarray) -> np.ndarray:
    """Contact force without inertia: k u + k t u' = N, N = max(0, K y + D y') with y = p - u."""
    depth = _depth(stiffness)

    def bend(t: float, u: float) -> tuple[float, float]:
        inside = _foot(t, depth) - u
        push = stiffness * inside + DAMPING * _foot_speed(t, depth)
        rate = (push - STICK * u) / (STICK * RELAXATION + DAMPING)
        press = STICK * u + STICK * RELAXATION * rate
        return (rate, press) if inside > 0.0 and press > 0.0 else (-u / RELAXATION, 0.0)

    bent = _radau(lambda t, u: [bend(t, u[0])[0]], [0.0], times, 1e-3)[0]
    return np.array([bend(t, u)[1] for t, u in zip(times, bent)])


def _reference_swinging(stiffness: float, damping: float, times: np.ndarray) -> np.ndarray:
    """Contact force with the tip's inertia: m y'' = k (p - y) - N."""
    depth = _depth(stiffness)

    def press(y: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.where(y > 0.0, np.maximum(0.0, stiffness * y + damping * v), 0.0)

    def motion(t: float, s: np.ndarray) -> list[float]:
        return [s[1], (STICK * (_driven_foot(t, depth) - s[0]) - press(s[0], s[1])) / MASS]

    return press(*_radau(motion, [-GAP, 0.0], times, 1e-3))


def _radau(motion: Callable, start: list[float], times: np.ndarray, longest: float) -> np.ndarray:
    from scipy.integrate import solve_ivp

    solved = solve_ivp(motion, (0.0, times[-1]), start, "Radau", t_eval=times, rtol=1e-10, atol=1e-14, max_step=longest)
    return solved.y


def _simulated(stiffness: float, times: np.ndarray, damping: float, **config: Any) -> tuple[np.ndarray, float]:
    """Contact force of the simulator and its run time [s]."""
    material = [f"probe.stiffness_axial={STICK}", f"object.0.stiffness={stiffness}", f"object.0.damping={damping}"]
    world = build_world(material, cycle=float(times[1] - times[0]), **config)
    foot = _foot(times, _depth(stiffness))
    path = np.c_[np.zeros((len(foot), 2)), TOP - foot]
    begin = time.perf_counter()
    force = follow(world, path)[:, 2]
    return force, time.perf_counter() - begin


def _error_at_rest(report: BenchReport, steps_ms: tuple[float, ...]) -> dict[float, list[tuple[float, float, float]]]:
    """Press without inertia: the simulator as it is by default, over stiffness and step."""
    rows = []
    found: dict[float, list[tuple[float, float, float]]] = {}
    worst = 0.0
    for stiffness in STIFFNESSES:
        found[stiffness] = []
        for step in steps_ms:
            times = np.arange(0.0, 1.0 + 0.5e-3 * step, 1e-3 * step)
            reference = _reference_at_rest(stiffness, times)
            force, seconds = _simulated(stiffness, times, DAMPING, stick_relaxation=RELAXATION)
            error = np.abs(force - reference) / reference.max()
            found[stiffness].append((step, error.max(), np.sqrt(np.mean(error**2))))
            rows.append([stiffness, step, 100 * error.max(), 100 * found[stiffness][-1][2], 1e6 * seconds / len(times)])
            worst = max(worst, error.max())
    columns = ["K [N/m]", "step [ms]", "max error [% of peak]", "RMS error [% of peak]", "us a step, from Python"]
    report.table("Normal force against a stiff reference, no inertia", columns, rows)
    report.require(
        "normal force error <= 1 % over 1e2..1e7 N/m, 0.1..5 ms", f"{100 * worst:.2f} %", bool(worst <= 0.01)
    )
    return found


def _error_swinging(report: BenchReport, divisions: tuple[int, ...]) -> dict[str, list[tuple[float, float, float]]]:
    """A tip with inertia strikes: all schemes over the step, with the order seen and the time of a step."""
    stiffness, damping = 1e4, 1.0
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in (*RIVALS, OWN)}
    rows = []
    reference = _reference_swinging(stiffness, damping, np.arange(0.0, 1.0005, 1e-3))
    for name in found:
        for parts in divisions:
            force, seconds = _one_run(name, stiffness, damping, parts)
            error = np.inf if force is None else np.sqrt(np.mean((force - reference) ** 2)) / reference.max()
            worst = np.inf if force is None else np.max(np.abs(force - reference)) / reference.max()
            before = found[name][-1] if found[name] else None
            order = None
            if before is not None and np.isfinite(before[1]) and 0.0 < error < np.inf:
                order = np.log(before[1] / error) / np.log(before[0] / (1e-3 / parts))
            found[name].append((1e-3 / parts, error, seconds))
            shown = [100 * error, 100 * worst] if error < 10.0 else ["blows up", "blows up"]
            rows.append([name, 1.0 / parts, *shown, order, 1e9 * seconds / (1000 * parts)])
    columns = ["scheme", "step [ms]", "RMS error [% of peak]", "max error [% of peak]", "order", "ns a step"]
    report.table(f"A tip of {1e3 * MASS:g} g strikes, K = {stiffness:g} N/m", columns, rows)
    report.require("converges with the step at first order", f"order {rows[-1][4]:.2f}", rows[-1][4] > 0.8)
    report.notes.append("The simulator's time a step holds geometry search, friction, six axes and one call a cycle.")
    return found


def _one_run(name: str, stiffness: float, damping: float, parts: int) -> tuple[np.ndarray | None, float]:
    """Force every 1 ms over 1 s with `parts` steps in each (None where the scheme blew up), and the run's seconds."""
    times = np.linspace(0.0, 1.0, 1000 * parts + 1)
    if name == OWN:
        return _simulated(stiffness, times[::parts], damping, tip_mass=MASS, substeps=parts)
    force, foot = np.zeros(len(times)), _driven_foot(times, _depth(stiffness))
    arguments = (MASS, STICK, stiffness, damping, float(times[1]), foot, force)
    RIVALS[name](*arguments)
    begin = time.perf_counter()
    done = RIVALS[name](*arguments)
    return (force[::parts] if done == len(times) else None), time.perf_counter() - begin


def _energy(report: BenchReport, quick: bool) -> None:
    """The foot jumps into contact and stays: from then on the stored energy may only fall."""
    worst, unbalanced, runs = 0.0, 0, 0
    rows = []
    for stiffness in STIFFNESSES:
        highest = 0.0
        for step in (1e-4, 1e-3, 5e-3):
            for damping in (0.0, 5.0, 5e3):
                for friction in (0.0,) if quick else (0.0, 0.5):
                    rise, lost = _rise(stiffness, step, damping, friction)
                    highest, unbalanced, runs = max(highest, rise), unbalanced + lost, runs + 1
        rows.append([stiffness, highest])
        worst = max(worst, highest)
    columns = ["K [N/m]", "largest rise in a step [share of the energy put in]"]
    report.table("Energy after a blow, 0.1..5 ms, damping 0..5000 N s/m", columns, rows)
    report.require("no blow-up, energy never created", f"{worst:.1e} in {runs} runs", worst < 1e-9)
    report.require("contact forces in balance in every step", f"{unbalanced} not", unbalanced == 0)


def _rise(stiffness: float, step: float, damping: float, friction: float) -> tuple[float, int]:
    given = {"stiffness": stiffness, "damping": damping, "friction": friction}
    overrides = ["probe.stiffness_lateral=2500.0", "probe.stiffness_axial=1.3e4"]
    world = build_world(overrides + [f"object.0.{k}={v}" for k, v in given.items()], cycle=step, tip_mass=MASS)
    world.place(np.array([0.0, 0.0, TOP + GAP]))
    energies = []
    for _ in range(150):
        world.command(np.array([5e-4, 2e-4, TOP - 5e-4]))
        world.advance()
        energies.append(world.energy())
    return float(np.max(np.diff(energies)) / energies[0]), world.unbalanced


def _cost(report: BenchReport, budget: float) -> None:
    """One cycle of 1 ms in several states, and through the driver's two faces as the runner calls it."""
    bent = ["probe.stiffness_lateral=2500.0", "probe.stiffness_axial=1.3e6", "object.0.friction=0.3"]
    states = {
        "in the air": _held([], (0.0, 0.0, 0.2)),
        "rigid stick, no friction": _held([], (0.0, 0.0, TOP - 1e-4)),
        "bending stick, sliding": _sliding(bent, "block", TOP - 1e-4),
        "bending stick, sliding in a slot, two contacts": _sliding(bent, "slot_8mm", 0.0527),
        "driver: read, command, sensor.read; in the air": _driver_cycle(),
    }
    blocks = {name: (lambda job=job: [job() for _ in range(200)]) for name, job in states.items()}
    gc.collect()
    rounds = max(5, int(budget / 0.006))
    seconds = {name: np.median(taken) / 200 for name, taken in interleave(blocks, rounds).items()}
    rows = [[name, 1e6 * each, 1e-3 / each] for name, each in seconds.items()]
    report.table("Cost of a cycle of 1 ms, called from Python", ["state", "us", "x real time"], rows)
    slowest = max(each for name, each in seconds.items() if "driver" not in name)
    report.verdicts += [
        Verdict("contact step at least 100x real time", f"{1e-3 / slowest:.0f}x", bool(slowest <= 1e-5)),
        Verdict("driver cycle <= 8 us", f"{rows[-1][1]:.1f} us", bool(rows[-1][1] <= 8.0)),
    ]
    report.data["seconds_per_cycle"] = seconds


def _held(overrides: list[str], place: tuple[float, float, float]) -> Callable[[], object]:
    world = build_world(overrides)
    world.place(np.array(place))
    return world.advance


def _sliding(overrides: list[str], scene: str, height: float) -> Callable[[], object]:
    world = build_world(overrides, scene)
    world.place(np.array([0.0, 0.0, height]))
    places = np.zeros((2000, 3))
    places[:, 0] = 0.02 * np.sin(np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False))
    places[:, 2] = height
    turn = iter(range(10**9))

    def step() -> object:
        world.command(places[next(turn) % 2000])
        return world.advance()

    return step


def _driver_cycle() -> Callable[[], object]:
    plugin = load("driver", "sim")
    driver = plugin(DriverContext(plugin.Config(), load_scene("block", ["truth.profile=ideal"]), 1))
    arm, sensor = driver.arm(), driver.sensor()
    arm.open()
    sensor.open()
    q = arm.read().q

    def cycle() -> object:
        arm.read()
        arm.command(q)
        return sensor.read()

    return cycle


def _draw(figure: Any, quiet: dict, swing: dict) -> None:
    rest, steps, times = figure.subplots(1, 3)
    for stiffness, points in quiet.items():
        step, _, error = np.array(points).T
        rest.loglog(step, 100 * error, "o-", label=f"{stiffness:.0e} N/m")
    rest.set(title="no inertia", xlabel="step [ms]", ylabel="RMS force error [% of peak]")
    rest.legend(fontsize=8)
    for name, points in swing.items():
        step, error, seconds = np.array(points).T
        good = error < 10.0
        steps.loglog(1e3 * step[good], 100 * error[good], "o-", label=name)
        times.loglog(1e3 * seconds[good], 100 * error[good], "o-", label=name)
    steps.set(title="a 2 g tip strikes", xlabel="step [ms]")
    times.set(title="the same", xlabel="run time of one second [ms]")
    steps.legend(fontsize=8)
