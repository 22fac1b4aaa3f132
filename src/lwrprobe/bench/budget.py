"""The error budget's claims against many drawn worlds: the contacts of one run, moved by drawn departures.

No world is explored again. A draw of the table `[truth]` gives another arm, probe and surface; where each contact would
then lie follows from forward kinematics with the drawn numbers, not from the budget's derivatives. Two parts are drawn
as the budget states them: how far the sensor's zero turns the normals, and what presses leave of the compliance along
the normal. Options (`--set`): `draws`; `profile` of the truth; `scene`; `strategy`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from lwrprobe.bench.exploration import SOURCE_SCENES, STRATEGIES
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import Contact, Probe
from lwrprobe.evaluation import aligned_points
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.exploration.recording.error_sources import ALONG
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene
from lwrprobe.scene.table import Pose

SEED = 7
"""Of the run whose contacts are moved."""
MAX_CONTACTS = 1500
"""Contacts that are moved."""
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
WANTED = (0.90, 0.98)
"""Share of the errors that may lie in the stated 95 % region, over all draws."""
JOINT_COMPLIANCE = 1e-4
"""rad/(N m) of the simulated arm's joints."""
WAVES = 320.0
"""Waves of a gear a turn."""
KNOT = 2.0
"""s between the independent values of the wandering zero."""


@dataclass(slots=True)
class Contacts:
    """What a run knows of its contacts: n of them, joints (n, j) rad, velocities (n, 3) m/s, the standard deviation
    [m/N] of the compliance that they are corrected with, and the time (n,) s since the sensor's zero was taken."""

    scene: Scene
    robot: Robot
    contacts: list[Contact]
    joints: np.ndarray
    velocities: np.ndarray
    gives: float
    since: np.ndarray


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench budget`."""
    asked = Options("budget", options, "draws", "profile", "scene", "strategy")
    draws, profile = asked.count("draws", 40 if quick else 400), asked.text("profile", "lab")
    report = BenchReport("budget", "The error budget's claims")
    report.machine = machine() | versions("numpy", "numba", "scipy")
    name, strategy = asked.text("scene", SOURCE_SCENES[0]), asked.text("strategy", STRATEGIES[0])
    known, budget = _explored(name, strategy, profile)
    squares: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for seed in range(1, draws + 1):
        errors = drawn_errors(known, profile, seed)
        left = aligned_points(budget.points + errors, budget.points) - budget.points
        for aligned, found in ((False, errors), (True, left)):
            squares[aligned].append(budget.squares(found, np.ones(len(found), dtype=bool), aligned))
    curves, rows = {}, []
    for aligned, name in ((False, "absolute"), (True, "after alignment")):
        pooled = np.concatenate(squares[aligned])
        curves[name] = shares_inside(pooled)
        share = curves[name][LEVELS.index(0.95)]
        each = [float((one <= chi2.ppf(0.95, 3)).mean()) for one in squares[aligned]]
        rows.append([name, share, *(float(np.percentile(each, p)) for p in (5.0, 50.0, 95.0))])
        held = WANTED[0] <= share <= WANTED[1]
        report.require(f"{name}: {WANTED[0]:.0%} to {WANTED[1]:.0%} inside the 95 % region", f"{share:.1%}", held)
    heads = ["claim", "share inside", "5 % of the draws below", "median draw", "5 % of the draws above"]
    report.table(f"{draws} draws of the profile {profile}", heads, rows)
    report.table(
        "Share inside by stated share", ["stated", *curves], [list(row) for row in zip(LEVELS, *curves.values())]
    )
    report.figures["calibration"] = lambda figure: draw_calibration(figure, curves)
    return report


def _explored(name: str, strategy: str, profile: str) -> tuple[Contacts, ErrorBudget]:
    """Contacts of a run in a world as its scene states it, and their budget with the uncertainty of the profile."""
    from lwrprobe.exploration.procedures.explore import Exploration
    from lwrprobe.exploration.recording.error_sources import error_budget
    from lwrprobe.scene import load_scene

    belief = profile if profile in ("lab", "datasheet") else "datasheet"
    settings = [f'strategy.name="{strategy}"', f"run.seed={SEED}", 'truth.profile="ideal"']
    scene = load_scene(name, [*settings, f'uncertainty.profile="{belief}"'])
    with Exploration(scene) as exploration:
        for _ in exploration:
            pass
    exploration.finish()
    recorder, pipeline = exploration.recorder, exploration.pipeline
    at = np.unique(np.linspace(0, len(recorder.contacts) - 1, MAX_CONTACTS).astype(int))
    states = [state for k in at if (state := recorder.states[k]) is not None]
    joints, velocities = np.array([q for q, _ in states]), np.array([velocity for _, velocity in states])
    table = scene.uncertainty
    gives = pipeline.force.stiffness.sigma(
        1e-6 * table.sigma("object_compliance_um_n"), 0.01 * table.sigma("arm_stiffness_percent")
    )
    contacts = [recorder.contacts[k] for k in at]
    since = pipeline.force.zero.age(np.array([contact.time for contact in contacts]))
    known = Contacts(scene, pipeline.robot, contacts, joints, velocities, gives, since)
    return known, error_budget(scene, pipeline, known.contacts, joints, velocities)


def drawn_errors(known: Contacts, profile: str, seed: int) -> np.ndarray:
    """(n, 3) m by which the contacts are wrong in the world of one draw."""
    scene, robot, random = known.scene, known.robot, np.random.default_rng(seed)
    drawn = scene.truth.model_copy(update={"profile": profile}).draw(seed, robot.n)

    def of(name: str, count: int = 1, unit: float = 1.0) -> np.ndarray:
        return unit * drawn.get(name, np.zeros(count))

    normals = np.array([contact.normal for contact in known.contacts])
    forces = np.array([contact.force for contact in known.contacts])
    times = np.array([contact.time for contact in known.contacts])
    speeds = np.maximum(np.linalg.norm(known.velocities, axis=1, keepdims=True), 1e-9)
    paths = known.velocities / speeds
    stated, probe = robot.fk_batch(known.joints), scene.probe.as_probe()
    rotations, jacobians = stated[:, :3, :3], robot.jacobian_batch(known.joints)
    # Where motors and links differ: play on the side of the last motion, and a wave.
    rates = np.einsum("nji,nj->ni", jacobians[:, :3], paths)
    play = -0.5 * of("joint_hysteresis_deg", 1, np.pi / 180.0) * np.sign(rates)
    phase = random.uniform(0.0, 2.0 * np.pi, robot.n)
    wave = of("gear_ripple_deg", 1, np.pi / 180.0)
    turned = wave * np.sin(WAVES * known.joints + phase)
    true = _arm(robot, of).fk_batch(known.joints + play + turned)
    errors = stated[:, :3, 3] - true[:, :3, 3]
    # Presses show what gives way along the normal; across it the arm yields and nothing corrects that.
    push = np.einsum("ni,ni->n", normals, forces)[:, None]
    soft = JOINT_COMPLIANCE / (1.0 + 0.01 * of("joint_stiffness_percent", robot.n))
    gave = np.einsum("nij,nj->ni", jacobians[:, :3], soft * np.einsum("nij,ni->nj", jacobians[:, :3], forces))
    errors += np.einsum("ni,ni->n", gave, normals)[:, None] * normals - gave
    errors += known.gives * random.standard_normal() * push * normals
    own = np.einsum("nji,nj->ni", rotations, forces)
    share = 1.0 - 1.0 / (1.0 + 0.01 * of("stick_stiffness_percent"))
    errors += np.einsum("nij,nj->ni", rotations, share * probe.compliance * own)
    errors += of("sphere_radius_mm", 1, 1e-3) * normals + of("clock_skew_ms", 1, 1e-3) * known.velocities
    errors += _of_wrong_force(known, probe, of, rotations, (normals, forces, paths))
    return errors + _of_turned_normals(known, probe, of, random, (normals, forces, paths, times))


def _of_wrong_force(known: Contacts, probe: Probe, of: Any, rotations: np.ndarray, given: Any) -> np.ndarray:
    """(n, 3) m, shift of the contacts by the sensor's matrix and drift: the stick seems to bend otherwise, and the
    normal aside of the path is the rest of the force that is read."""
    normals, forces, paths = given
    own, out = (np.einsum("nji,nj->ni", rotations, vectors) for vectors in (forces, normals))
    arms = np.array([0.0, 0.0, probe.sensor_distance]) - probe.radius * out
    spans = np.concatenate([probe.force_range, probe.torque_range])
    share = np.diag(of("sensor_gain_percent", 6, 1e-2))
    share[~np.eye(6, dtype=bool)] = of("sensor_crosstalk_percent", 30, 1e-2)
    wrong = np.concatenate([own, np.cross(arms, own)], axis=1) @ (share * spans[:, None] / spans)[:3].T
    wrong = wrong + known.since[:, None] * of("drift_mn_per_min", 3, 1e-3 / 60.0)
    read = forces + np.einsum("nij,nj->ni", rotations, wrong)
    seen, right = (f - np.einsum("ni,ni->n", f, paths)[:, None] * paths for f in (read, forces))
    seen, right = (f / np.maximum(np.linalg.norm(f, axis=1, keepdims=True), 1e-9) for f in (seen, right))
    moves = np.linalg.norm(paths, axis=1, keepdims=True) > 0.5
    return np.einsum("nij,nj->ni", rotations, probe.compliance * wrong) - probe.radius * moves * (seen - right)


def _of_turned_normals(known: Contacts, probe: Probe, of: Any, random: np.random.Generator, given: Any) -> np.ndarray:
    """(n, 3) m, shift of the contacts around the sphere by zero, friction and noise."""
    normals, forces, paths, times = given
    size = np.maximum(np.linalg.norm(forces, axis=1), 1e-3)
    knots = np.arange(times.min() - KNOT, times.max() + 2.0 * KNOT, KNOT)

    def wandering(sigma: float) -> np.ndarray:
        # The bias was taken at one instant of it.
        values = sigma * random.standard_normal(len(knots))
        return np.interp(times, knots, values) - sigma * random.standard_normal()

    # Half the width of the hysteresis, by which a reading lags behind the load, in either sense.
    lag = 0.5 * float(of("sensor_hysteresis_percent", 1, 1e-2)[0])
    force = np.hypot(float(of("zero_wander_force_mn", 1, 1e-3)[0]), lag * float(probe.force_range[0]))
    torque = np.hypot(float(of("zero_wander_torque_unm", 1, 1e-6)[0]), lag * float(probe.torque_range[0]))
    axis = np.hypot(torque, force * probe.sensor_distance) / probe.radius
    along = ALONG * wandering(axis) / size
    of_torque = force**2 / max(force**2 + axis**2, 1e-12)  # both answers weighed by their errors
    aside = (of_torque * wandering(axis) + (1.0 - of_torque) * wandering(force)) / size
    aside = aside + of("object_friction") * np.radians(of("friction_direction_deg"))
    confidence = np.clip([contact.confidence_score for contact in known.contacts], 0.01, 0.9999)
    noise = 0.1 * np.sqrt(0.5 * (1.0 / confidence - 1.0))
    along, aside = (part + noise * random.standard_normal(len(size)) for part in (along, aside))
    return probe.radius * (along[:, None] * paths + aside[:, None] * np.cross(normals, paths))


def _arm(robot: Robot, of: Any) -> Robot:
    """The arm with drawn table, base and tool."""
    base, tool = robot.base.copy(), robot.tool.copy()
    base[:3, 3] += of("base_shift_mm", 3, 1e-3)
    base = base @ Pose(rpy_deg=tuple(of("base_turn_deg", 3).tolist())).matrix()
    aside = np.append(of("sphere_off_axis_mm", 2, 1e-3), of("probe_length_mm", 1, 1e-3))
    tool[:3, 3] += tool[:3, :3] @ aside
    return replace(
        robot,
        a=robot.a + of("dh_a_mm", robot.n, 1e-3),
        d=robot.d + of("dh_d_mm", robot.n, 1e-3),
        alpha=robot.alpha + np.radians(of("dh_twist_deg", robot.n)),
        theta=robot.theta + np.radians(of("dh_offset_deg", robot.n)),
        base=base,
        tool=tool,
    )


def shares_inside(squares: np.ndarray) -> list[float]:
    """Share of squared deviations (n,) inside the regions of each of `LEVELS`."""
    return [round(float((squares <= chi2.ppf(level, 3)).mean()), 4) for level in LEVELS]


def draw_calibration(figure: Any, curves: dict[str, list[float]]) -> None:
    """Shares inside the regions of `LEVELS` against what is stated, a line each."""
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.7", label="as stated")
    for name, shares in curves.items():
        axes.plot(LEVELS, shares, "o-", label=name)
    axes.set_xlabel("stated share")
    axes.set_ylabel("share of the errors inside")
    axes.legend()
