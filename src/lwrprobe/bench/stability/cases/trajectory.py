"""Irregular clocks and goals that never stay: the generator's limits at every tick."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.bench.trajectory import LIMITS, Watch
from lwrprobe.trajectory import CartesianTrajectory


def _pose(*place: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


def _watch(cycle: float) -> Watch:
    tip = CartesianTrajectory(cycle, LIMITS)
    tip.reset(np.eye(4))
    return Watch(tip)


def _time_steps(quick: bool) -> list[Finding]:
    found = []
    for cycle in (1e-4, 1e-3, 0.02):
        for irregular in (False, True):
            watch, random, goal = _watch(cycle), np.random.default_rng(34), _pose(0.2, -0.1, 0.05)
            watch.tip.set_goal(goal, 0.25)
            for _ in range(round(6.0 / cycle)):
                watch.step(cycle * random.uniform(0.1, 3.0) if irregular else None)
                if watch.tip.arrived:
                    break
            off = float(np.abs(watch.tip.pose - goal).max())
            setting = f"cycle {1e3 * cycle:g} ms" + (", irregular (0.1 to 3 cycles)" if irregular else "")
            text = f"ends {off:.1g} m off the goal, at rest: {'yes' if watch.tip.resting else 'no'}"
            also = off == 0.0 and bool(watch.tip.arrived)
            found.append(within(setting, text, watch.worst.max(), 1.0 + 1e-9, "of the limits", also=also))
    return found


def _goals(quick: bool) -> list[Finding]:
    random = np.random.default_rng(35)
    ticks = 2000 if quick else 8000

    def every_tick(watch: Watch, k: int) -> None:
        watch.tip.set_goal(_pose(*random.uniform(-0.1, 0.1, 3)), 0.25)

    def reversed_goal(watch: Watch, k: int) -> None:
        if k % 40 == 0:
            watch.tip.set_goal(_pose(0.1 if k % 80 == 0 else -0.1, 0.0, 0.0), 0.25)

    def too_fast(watch: Watch, k: int) -> None:
        if k % 500 == 0:
            watch.tip.set_goal(_pose(0.1 if k % 1000 == 0 else -0.1, 0.0, 0.0), 1e3)

    def flickering_velocity(watch: Watch, k: int) -> None:
        watch.tip.set_velocity(random.normal(size=3), 0.05)

    found = [
        _driven(name, act, ticks)
        for name, act in (
            ("a new goal at every tick", every_tick),
            ("reversed every 40 ms", reversed_goal),
            ("asked for 1000 m/s", too_fast),
            ("a new velocity at every tick, beyond the limit", flickering_velocity),
        )
    ]
    watch = _watch(1e-3)
    watch.tip.set_goal(np.eye(4), 0.1)
    watch.step()
    at_once = bool(watch.tip.arrived)
    return [*found, Finding("equal to where it is", "arrived at once" if at_once else "still moving", at_once)]


def _driven(name: str, act: Callable[[Watch, int], None], ticks: int) -> Finding:
    watch = _watch(1e-3)
    for k in range(ticks):
        act(watch, k)
        watch.step()
    watch.tip.set_goal(_pose(0.05, 0.0, 0.0), 0.25)
    for _ in range(4000):
        watch.step()
    off = float(np.abs(watch.tip.pose - _pose(0.05, 0.0, 0.0)).max())
    text = f"{watch.tip.failures} plans refused by the planner; the last goal is met to {off:.1g} m"
    return within(name, text, watch.worst.max(), 1.0 + 1e-9, "of the limits", also=off == 0.0)


CASES = (
    Case(34, "time step torture", "limits held at every tick, ends on the goal", _time_steps),
    Case(35, "goals that never stay", "no overshoot of limits; a zero move is over at once", _goals),
)
