"""Calibration by touch in simulated worlds that differ from their scene: what is found against what was drawn.

Options (`--set`): `draws`, how many; `first`, seed of the first; `profile` of the truth; `diameter` of the reference
sphere in m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.calibration import Calibration, Parameters, Priors, force_to_torque, tool_shift_rows
from lwrprobe.contracts import LwrprobeError, Probe
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.kinematics import Robot

SCENE = "block"
MAX_TIME = 300.0
"""s of robot time that a calibration may take."""
SHARE = 0.9
"""Of the draws that must lie within two stated standard deviations."""
BASE_LAG, CYCLE = 0.002, 0.001
"""s, of the simulated arm as its options have them."""


@dataclass(slots=True, frozen=True)
class Row:
    """One figure of one draw, in its own unit: what was found, what was drawn, stated standard deviation, limit."""

    name: str
    found: float
    true: float
    sigma: float
    limit: float

    @property
    def error(self) -> float:
        return abs(self.found - self.true)


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench calibration`."""
    asked = Options("calibration", options, "draws", "first", "profile", "diameter")
    draws, first = asked.count("draws", 1 if quick else 20), asked.count("first", 1)
    profile, (diameter, *_) = asked.text("profile", "datasheet"), asked.numbers("diameter", (0.03,))
    report = BenchReport("calibration", "Calibration by touch")
    report.machine = machine() | versions("numpy", "scipy", "numba")
    runs = [_draw(seed, profile, diameter) for seed in range(first, first + draws)]
    done = [one for one in runs if "rows" in one]
    report.tables.append(
        Table(
            f"Each draw, truth.profile {profile}",
            ["seed", "status", "time s", "touches", "residual mm", "peak N"],
            [[one.get(key) for key in ("seed", "status", "time", "touches", "residual", "peak")] for one in runs],
        )
    )
    names = [row.name for row in done[0]["rows"]] if done else []
    summary, verdicts = [], []
    for index, name in enumerate(names):
        rows: list[Row] = [one["rows"][index] for one in done]
        errors = np.array([row.error for row in rows])
        inside = sum(row.error <= row.limit for row in rows)
        covered = sum(row.error <= 2.0 * row.sigma for row in rows)
        sigma = float(np.median([row.sigma for row in rows]))
        summary.append([name, float(np.median(errors)), float(errors.max()), sigma, rows[0].limit, inside, covered])
        verdicts.append(Verdict(f"{name}: within its limit", f"{inside} of {len(runs)}", inside == len(runs)))
        held = covered >= SHARE * len(runs)
        verdicts.append(Verdict(f"{name}: within two standard deviations", f"{covered} of {len(runs)}", held))
    heads = ["quantity", "median error", "largest error", "median sigma", "limit", "within limit", "within 2 sigma"]
    report.tables.append(Table("All draws", heads, summary))
    times = [one["time"] for one in done]
    if times:
        verdicts.append(Verdict(f"robot time <= {MAX_TIME:g} s", f"{max(times):.0f} s", max(times) <= MAX_TIME))
    report.verdicts = verdicts
    report.notes.append(
        "The length is compared in the arm's own scale: what a sphere at one place shows of it (see the how-to page)."
    )
    report.data["runs"] = [
        {**one, "rows": [[r.name, r.found, r.true, r.sigma, r.limit] for r in one.get("rows", ())]} for one in runs
    ]
    return report


def _draw(seed: int, profile: str, diameter: float) -> dict[str, Any]:
    from lwrprobe.exploration.procedures.calibrate import calibrate, with_reference_sphere
    from lwrprobe.exploration.procedures.start_posture import start_posture
    from lwrprobe.scene import load_scene
    from lwrprobe.scene.scene_robot import robot_of

    scene = load_scene(SCENE, [f"run.seed={seed}", f'truth.profile="{profile}"'])
    try:
        found, measured = calibrate(scene, diameter)
    except LwrprobeError as error:
        return {"seed": seed, "status": str(error)}
    robot = robot_of(scene)
    _, q = start_posture(with_reference_sphere(scene, diameter), robot)
    truth = measured.ground_truth
    return {
        "seed": seed,
        "status": "done",
        "time": found.time,
        "touches": found.touches,
        "residual": 1e3 * found.residual,
        "peak": truth.probe_peak_force,
        "rows": _rows(found, truth.differences, robot, scene.probe.as_probe(), q),
    }


def _rows(found: Calibration, drawn: dict[str, Any], robot: Robot, probe: Probe, q: np.ndarray) -> list[Row]:
    def numbers(name: str, count: int = 1) -> np.ndarray:
        return np.array(drawn[name], dtype=float) if name in drawn else np.zeros(count)

    def row(name: str, quantity: str, index: int, true: float, factor: float, limit: float) -> Row:
        value, sigma = found.values(quantity)[index], found.sigma(quantity)[index]
        return Row(name, factor * float(value), factor * true, factor * float(sigma), limit)

    tool = 1e-3 * np.array([*numbers("sphere_off_axis_mm", 2), numbers("probe_length_mm")[0]])
    shift = _true_shift(drawn, tool, robot, probe, q, numbers)
    ratio, lever = force_to_torque(_true_matrix(tool, probe, numbers), probe).ravel(), probe.sensor_distance
    lag = BASE_LAG + 1e-3 * numbers("arm_lag_ms")[0]
    decay = np.exp(-CYCLE / lag)
    following = round(numbers("arm_delay_ms")[0]) * CYCLE + CYCLE * decay / (1.0 - decay)
    soft = 1e-4 / (1.0 + 0.01 * numbers("joint_stiffness_percent", robot.n))
    arm = 1.0 / (robot.jacobian(q)[:3] ** 2 @ soft)
    stick = 1.0 / probe.compliance[0] * (1.0 + 0.01 * numbers("stick_stiffness_percent")[0])
    return [
        row("sphere off axis x, mm", "tool_shift", 0, shift[0], 1e3, 0.03),
        row("sphere off axis y, mm", "tool_shift", 1, shift[1], 1e3, 0.03),
        row("probe length, mm", "tool_shift", 2, shift[2], 1e3, 0.03),
        row("torque x for force y, %", "force_to_torque", 1, ratio[1], 1e2 / lever, 0.3),
        row("torque y for force x, %", "force_to_torque", 3, ratio[3], 1e2 / lever, 0.3),
        row("clock offset, ms", "clock_offset", 0, 1e-3 * numbers("clock_skew_ms")[0], 1e3, 1.0),
        row("arm's delay, ms", "arm_delay", 0, following, 1e3, 1.0),
        row("stick stiffness, %", "stick_stiffness", 0, stick, 1e2 / stick, 3.0),
        *(row(f"arm stiffness {a}, %", "arm_stiffness", k, arm[k], 1e2 / arm[k], 10.0) for k, a in enumerate("xyz")),
    ]


def _true_shift(
    drawn: dict[str, Any], tool: np.ndarray, robot: Robot, probe: Probe, q: np.ndarray, numbers: Any
) -> np.ndarray:
    """(3,) m, the drawn departures of tool and arm as the calibration states them."""
    n = robot.n
    gaps = np.concatenate([probe.force_range, probe.torque_range])
    parameters = Parameters.of(n, probe, np.zeros((1, 3)), 0.0, gaps, Priors())
    x = np.zeros(len(parameters))
    x[parameters.slices["tool"]] = tool
    x[parameters.slices["dh"]] = np.concatenate(
        [
            1e-3 * numbers("dh_a_mm", n), np.radians(numbers("dh_twist_deg", n)), 1e-3 * numbers("dh_d_mm", n),
            np.radians(numbers("dh_offset_deg", n)),
        ]
    )  # fmt: skip
    return tool_shift_rows(parameters, robot, q) @ x


def _true_matrix(tool: np.ndarray, probe: Probe, numbers: Any) -> np.ndarray:
    """(6, 6), the drawn sensor's reading for a unit wrench about the point where the scene has the sensor."""
    span = np.concatenate([probe.force_range, probe.torque_range])
    share = np.zeros((6, 6))
    share[~np.eye(6, dtype=bool)] = 0.01 * numbers("sensor_crosstalk_percent", 30)
    reads = np.diag(1.0 + 0.01 * numbers("sensor_gain_percent", 6)) + share * span[:, None] / span
    lever = np.eye(6)
    x, y, z = tool
    lever[3:, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return reads @ lever
