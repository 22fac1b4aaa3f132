"""Singularities, joint limits, branches, and links that meet each other or the table."""

from __future__ import annotations

import numpy as np

from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.collision import ClearanceQuery
from lwrprobe.contracts import Probe, SceneError
from lwrprobe.exploration.stages.arm_clearance import ArmClearanceStage
from lwrprobe.exploration.stages.clearance import PLAY
from lwrprobe.kinematics import IKSolver, IKStatus, Preference, Robot, follow, lwr4, straight_line
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import load_scene
from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, SpeedGovernor

TOOL = np.eye(4)
TOOL[2, 3] = 0.25
LIMITS = CartesianLimits(0.1, 4.0, 1000.0, 0.5, 3.0, 50.0)
CYCLE = 1e-3


def _singularities(quick: bool) -> list[Finding]:
    """Straight moves through a singularity at contour speed, under the governor; joints at every cycle."""
    wrist = np.deg2rad([0.0, 30, 0, -90, 0, 17, 0])
    aligned = wrist * [1, 1, 1, 1, 1, -1, 1]
    elbow = np.deg2rad([0.0, 50, 0, -40, 0, 60, 0])
    robot = lwr4(tool=TOOL)
    out = robot.fk(elbow).A
    away = out.copy()
    away[:3, 3] += 0.4 * (out[:3, 3] - [0.0, 0.0, 0.0]) / np.linalg.norm(out[:3, 3])
    return [
        _governed("wrist aligned (q6 = 0)", robot, wrist, robot.fk(aligned).A, reached=True),
        _governed("elbow straight, 0.4 m outwards", robot, elbow, away, reached=False),
    ]


def _governed(setting: str, robot: Robot, q: np.ndarray, goal: np.ndarray, reached: bool) -> Finding:
    solver, trajectory = IKSolver(robot), CartesianTrajectory(CYCLE, LIMITS)
    governor = SpeedGovernor(trajectory, solver.track_all, robot.speed)
    trajectory.reset(robot.fk(q).A)
    trajectory.set_goal(goal, 0.02)
    q, step, fastest, behind, ended = q.copy(), np.zeros(robot.n), 0.0, 0.0, ""
    for _ in range(60_000):
        trajectory.step()
        status = solver.track(trajectory.pose, q, step)
        if status != IKStatus.CONVERGED:
            ended = IKStatus(status).name.lower()
            trajectory.stop()
            break
        use = float(np.max(np.abs(step - q) / (robot.speed * CYCLE)))
        fastest = max(fastest, use)
        q += (step - q) / max(use, 1.0)  # as in a run, where the last guard clips what the governor left
        behind = max(behind, 1e3 * float(np.linalg.norm(robot.fk(q).t - trajectory.pose[:3, 3])))
        governor.watch(q)
        if trajectory.arrived:
            break
    text = f"{'arrived' if trajectory.arrived else 'stopped: ' + (ended or 'not there in a minute')}; "
    text += f"{100 * fastest:.0f} % of a joint's speed limit wanted, clipped to it the tip is {behind:.3f} mm behind"
    right = bool(trajectory.arrived) if reached else bool(ended) and bool(np.isfinite(q).all())
    return within(setting, text, behind, 0.1, "mm", also=right)


def _joint_limit(quick: bool) -> list[Finding]:
    """The same path without and with the freedom used to stay off the limits; and one that no freedom saves."""
    robot = lwr4(tool=TOOL)
    q0 = np.deg2rad([0.0, 60, 50, -80, 20, 95, 30])
    path = straight_line(robot.fk(q0), robot.fk(q0).A @ _turn_y(-0.6), turn=0.002)
    bold = follow(robot, path, q0, solver=IKSolver(robot, preference=Preference(null_space_step=0.0)))
    wary = follow(robot, path, q0, solver=IKSolver(robot, preference=Preference(zone=0.4, null_space_step=0.005)))
    margins = np.degrees([bold.limit_margin.min(), wary.limit_margin.min()])
    text = f"nearest limit {margins[0]:.1f} deg off without, {margins[1]:.1f} deg with the null space"
    found = [Finding("joint 6 towards 120 deg", text, bool(wary.complete and margins[1] > margins[0] + 2.0))]
    q0 = np.deg2rad([0.0, 30, 0, -90, 0, 60, 0])
    for degrees in (120.0, -120.0):
        turned = straight_line(robot.fk(q0), robot.fk(q0).A @ _turn_y(np.radians(degrees)), turn=0.005)
        report = follow(robot, turned, q0)
        text = "followed to its end" if report.complete else f"ends after {report.reached} poses: {report.reason}"
        jump = float(np.abs(np.diff(report.q, axis=0)).max())
        found.append(
            within(f"tip turned by {degrees:g} deg", text + f"; largest step {jump:.3f} rad", jump, 0.1, "rad")
        )
    return found


def _turn_y(angle: float) -> np.ndarray:
    pose = np.eye(4)
    pose[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
    return pose


def _branches(quick: bool) -> list[Finding]:
    """Around the shoulder with a nearly straight elbow: both elbow solutions are a hand's breadth apart."""
    robot, found = lwr4(tool=TOOL), []
    for bend in (-4.0,) if quick else (-8.0, -4.0, -1.0, -0.2):
        q0 = np.deg2rad([20.0, 50, 10, bend, 0, 60, 0])
        start = robot.fk(q0).A
        path = np.tile(np.eye(4), (400, 1, 1))
        for pose, angle in zip(path, np.linspace(0.0, 1.5, len(path))):
            pose[[0, 0, 1, 1], [0, 1, 0, 1]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
            pose[:] = pose @ start
        report = follow(robot, path, q0)
        kept = bool((np.sign(report.q[:, 3]) == np.sign(bend)).all())
        jump = float(np.abs(np.diff(report.q, axis=0)).max())
        text = f"{report.reached} of {len(path)} poses, {'branch kept' if kept else 'branch swapped'}, "
        text += f"largest step {jump:.4f} rad"
        found.append(within(f"elbow at {bend:g} deg", text, jump, 0.05, "rad", also=report.complete and kept))
    return found


def _self_and_table(quick: bool) -> list[Finding]:
    """Asked before the motion: what a scene lets the tip do, and what lies on a straight step."""
    try:
        load_scene("block", ["area.lower=[-0.085, -0.06, 0.001]"])
        refused = ""
    except SceneError as error:
        refused = str(error)
    found = [Finding("area below the table's reach", refused or "accepted", bool(refused))]
    probe = load_scene("block").probe.as_probe()
    query = ClearanceQuery(probe.links, VoxelMap(0.002), table=np.array([0.0, 0.0, 1.0, 0.0]))
    above, below = np.diag([1.0, -1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3], below[:3, 3] = 0.1, (0.05, 0.0, 0.02)
    below[:3, :3] = _turn_y(np.radians(100.0))[:3, :3] @ below[:3, :3]
    distance, link = query.table_ahead(above, below)
    text = f"the path to a tip leaning by 100 deg: {1e3 * distance:.2f} mm of the table, {link}"
    found.append(Finding("holder towards the table", text, distance == 0.0))
    return [*found, *_folding(probe)]


def _folding(probe: Probe) -> list[Finding]:
    """The wrist folds until the fingers meet the forearm: refused from there on, and not before."""
    robot = lwr4(tool=TOOL)
    whole = ClearanceQuery((*probe.links, *robot.links), VoxelMap(0.002))
    pairs = [(link.name, "forearm_end") for link in probe.links]

    def bent(bend: float) -> np.ndarray:
        return np.deg2rad([0.0, 30.0, 0.0, -90.0, 0.0, bend, 0.0])

    def distance_at(bend: float) -> float:
        q = bent(bend)
        return whole.self_clearance(pairs, robot.fk(q).A, robot.link_frames(q))[0]

    keep = 0.003
    stage = ArmClearanceStage(probe, robot, IKSolver(robot), VoxelMap(0.002), keep, 1e-4, None)
    meets = next((bend for bend in np.arange(0.0, 120.0, 0.1) if distance_at(bend) < keep - PLAY), np.inf)
    before, beyond = (stage.objection_to_swing(bent(0.0), bent(bend)) for bend in (meets - 1.0, 119.9))
    text = f"joint 6 by {meets - 1.0:.1f} deg: {before or 'allowed'}; by 119.9 deg: {beyond or 'allowed'}"
    return [Finding("folding the wrist", text, bool(beyond) and not before)]


CASES = (
    Case(25, "singularity on the path", "joint speeds within limits, arrives or stops and says so", _singularities),
    Case(26, "joint limit on the path", "seen ahead, avoided or named, no jump", _joint_limit),
    Case(27, "two near branches", "the branch is kept, no jump", _branches),
    Case(29, "holder against table, probe against forearm", "refused before the motion", _self_and_table),
)
