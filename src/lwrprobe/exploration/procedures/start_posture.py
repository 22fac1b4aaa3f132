"""Where an exploration starts, and what of its area the arm can reach from there."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import IKResult, IKSolver, IKStatus, Robot, reachable
from lwrprobe.scene import Scene
from lwrprobe.scene.calibrated_scene import calibrated, calibration_of, stiff_as_calibrated
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.scene.table import Pose


def scene_at_start(stated: Scene) -> tuple[Scene, Robot, np.ndarray, np.ndarray]:
    """A scene as a run uses it, its arm, and there tip pose (4, 4) and joint values (n,) at the start.

    Where the scene refers to a calibration, it has what that measured, and the arm's stiffness in this posture.
    Raises what `calibration_of` and `start_posture` raise.
    """
    scene = calibrated(stated)
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    return stiff_as_calibrated(scene, calibration_of(stated), robot, q), robot, pose, q


def start_posture(scene: Scene, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Tip pose (4, 4) and joint values (n,) at the start: above the middle of the area's border in -y.

    Raises InputError when the arm cannot reach it.
    """
    pose = Pose(rpy_deg=scene.arm.tip_rpy_deg).matrix()
    low, high = np.array(scene.area.lower), np.array(scene.area.upper)
    pose[:3, 3] = 0.5 * (low[0] + high[0]), low[1], high[2]
    result = _widest(robot, pose, scene.arm.start_deg)
    if result.status != IKStatus.CONVERGED:
        place = [round(float(v), 4) for v in pose[:3, 3]]
        raise InputError("area", place, f"a start that the arm reaches (it ends {result.short_by * 1e3:.1f} mm short)")
    return pose, result.q


def _widest(robot: Robot, pose: np.ndarray, start_deg: tuple[float, ...] | None) -> IKResult:
    """The solution that leaves the joints the most of their ranges among those from a fixed set of seeds, or the one
    asked for.

    How far the joint nearest to a limit is from it does not tell solutions apart: it is the elbow's in most of them.
    """
    solver = IKSolver(robot)
    if start_deg is not None:
        start = robot.joint_values(np.radians(start_deg), "arm.start_deg")
        if not robot.within_limits(start, 1e-9):
            ranges = (f"{a:g} to {b:g}" for a, b in np.degrees(np.stack([robot.lower, robot.upper], axis=1)))
            raise InputError(
                "arm.start_deg", list(start_deg), f"degrees within the joints' ranges: {', '.join(ranges)}"
            )
        return solver.solve(pose, start)
    random = np.random.default_rng(0)
    low, high = robot.span
    seeds = [np.zeros(robot.n), *random.uniform(0.6 * low, 0.6 * high, (24, robot.n))]
    found = [solver.solve(pose, seed) for seed in seeds]
    solved = [result for result in found if result.status == IKStatus.CONVERGED]
    if not solved:
        return min(found, key=lambda result: result.short_by)
    return max(solved, key=lambda result: _range_left(robot, result.q))


def _range_left(robot: Robot, q: np.ndarray) -> float:
    """Product over the joints at q (n,) of the share of half their range that is left on the nearer side."""
    limited = np.isfinite(robot.upper - robot.lower)
    left = np.minimum(q - robot.lower, robot.upper - q)
    return float((left[limited] / (0.5 * (robot.upper - robot.lower)[limited])).prod())


def unreachable_part(scene: Scene, robot: Robot, pose: np.ndarray, q: np.ndarray) -> str:
    """A sentence naming the part of the area that the arm cannot get to with the probe held as wanted, or nothing."""
    low, high = scene.area.lower, scene.area.upper
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, (7, 5, 2))]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    found = reachable(robot, places, pose[:3, :3], q)
    if found.mask.all():
        return ""
    lost = places[~found.mask]
    bounds = ", ".join(f"{axis} {a:.3f} to {b:.3f} m" for axis, a, b in zip("xyz", lost.min(axis=0), lost.max(axis=0)))
    return f"out of reach: {len(lost)} of {len(places)} places of the area, within {bounds} ({found.reason})"
