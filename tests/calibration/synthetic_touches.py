"""Touches of a reference sphere by formulas, with known departures of arm, probe, sensor and clocks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from lwrprobe.calibration import Touch
from lwrprobe.contracts import Probe
from lwrprobe.kinematics import IKSolver, IKStatus, Robot, robot_by_name
from lwrprobe.kinematics.path import rotations

PROBE = Probe(compliance=np.array([1 / 2500, 1 / 2500, 1 / 1.3e6]), mass=0.003)
CENTRE = np.array([0.0, 0.0, 0.02])
REFERENCE = 0.015


def robot() -> Robot:
    base, tool = np.eye(4), np.eye(4)
    base[:3, 3] = -0.6, 0.0, 0.31
    tool[2, 3] = 0.25
    return robot_by_name("lwr4").with_base(base).with_tool(tool)


@dataclass
class World:
    """What differs from the stated robot and probe."""

    tool: np.ndarray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0
    stick: float = 1.0
    joints: np.ndarray = field(default_factory=lambda: np.ones(7))
    surface: float = 1e-6
    clock: float = 0.0
    sensor: np.ndarray = field(default_factory=lambda: np.eye(6))
    dh: dict = field(default_factory=dict)
    ripple: float = 0.0
    noise: float = 1.0


def draw(seed: int) -> World:
    random = np.random.default_rng(seed)
    normal = random.standard_normal
    gaps = np.concatenate([PROBE.force_range, PROBE.torque_range])
    sensor = 0.01 * normal((6, 6)) * gaps[:, None] / gaps
    np.fill_diagonal(sensor, 0.015 * normal(6))
    tool = np.array([2e-4, 2e-4, 3e-4]) * normal(3)
    lever = np.eye(6)
    x, y, z = tool
    lever[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    return World(
        tool=tool,
        radius=3e-5 * normal(),
        stick=float(np.exp(0.2 * normal())),
        joints=np.exp(0.4 * normal(7)),
        surface=float(np.exp(random.uniform(np.log(1e-7), np.log(2e-4)))),
        clock=8e-3 * normal(),
        sensor=(np.eye(6) + sensor) @ lever,
        dh={"a": 3e-4 * normal(7), "alpha": 8.7e-4 * normal(7), "d": 3e-4 * normal(7), "theta": 8.7e-4 * normal(7)},
        ripple=8.7e-5,
    )


def orientations(tilts=(0.0, 0.4, 0.7), around: int = 6, turns=(0.0, 1.6, -1.6)) -> list[np.ndarray]:
    """Tip orientations: pointing down, leaned by each tilt to several sides, and turned about the stick."""
    down = np.diag([-1.0, 1.0, -1.0])
    found, k = [], 0
    for tilt in tilts:
        for side in range(around if tilt else 3):
            phi = 2 * np.pi * (side + 0.5 * (tilt > 0.5)) / around
            lean = rotations(np.array([np.cos(phi), np.sin(phi), 0.0]), np.array([tilt]))[0]
            spin = rotations(np.array([0.0, 0.0, 1.0]), np.array([turns[k % len(turns)]]))[0]
            found.append(lean @ down @ spin)
            k += 1
    return found


def directions(rotation: np.ndarray, per: int, k: int) -> list[np.ndarray]:
    """Outward normals at which to touch: along the stick and across it, above the equator."""
    back = -rotation[:, 2]
    found = []
    side = np.cross(back, [0.3, 0.8, 0.1])
    side /= np.linalg.norm(side)
    for j in range(per):
        angle = [0.0, 1.45, 0.8, 1.45][j % 4]
        for attempt in range(8):
            phi = 2.4 * (k * per + j) + 0.785 * attempt
            spin = rotations(back, np.array([phi]))[0]
            u = np.cos(angle) * back + np.sin(angle) * (spin @ side)
            if u[2] > 0.05:
                found.append(u)
                break
    return found


def touches(world: World, rots: list[np.ndarray], per: int, seed: int = 0, force: float = 1.6) -> list[Touch]:
    """Presses on a sphere with the world's departures; joints solved with the stated robot."""
    random = np.random.default_rng(seed)
    stated = robot()
    solver = IKSolver(stated)
    tool = stated.tool.copy()
    tool[:3, 3] += world.tool
    actual = replace(stated, tool=tool, **{n: getattr(stated, n) + v for n, v in world.dh.items()})
    phases = random.uniform(0, 2 * np.pi, 7)
    q = np.array([0.0, 0.4, 0.0, -1.4, 0.0, 1.2, 0.0])
    centre = None
    out, time = [], 0.0
    compliance = PROBE.compliance / world.stick
    joint_c = 1e-4 / world.joints
    for k, rotation in enumerate(rots):
        for u in directions(rotation, per, k):
            pose = np.eye(4)
            pose[:3, :3] = rotation
            pose[:3, 3] = CENTRE + (REFERENCE + PROBE.radius) * u
            found = solver.solve(pose, q)
            if found.status != IKStatus.CONVERGED:
                continue
            q = found.q
            jac = stated.jacobian(q)[:3]
            if centre is None:
                link = q + world.ripple * np.sin(320 * q + phases)
                centre = np.asarray(actual.fk(link).A)[:3, 3] - (REFERENCE + PROBE.radius) * u
            # compliance matrix at the tip
            c_tip = rotation @ np.diag(compliance) @ rotation.T + jac @ np.diag(joint_c) @ jac.T
            c_tip = c_tip + world.surface * np.outer(u, u)
            # friction keeps the tangential force at a share of the normal one
            tangent = np.cross(u, random.standard_normal(3))
            tangent /= np.linalg.norm(tangent)
            f_dir = u + 0.15 * tangent
            up = np.linspace(0.1, 1.0, 16) * force
            down = np.linspace(1.0, 0.1, 16) * force
            fast = 0.06 if k % 2 else 0.3
            t_up, t_down = np.linspace(0, 0.4, 16), 0.42 + np.linspace(0, fast, 16)
            load = np.concatenate([up, down])
            t = np.concatenate([t_up, t_down])
            # joints such that the actual centre, with deflection, is where the indented sphere holds it
            want = centre + np.outer(REFERENCE + PROBE.radius + world.radius - world.surface * load, u)
            want = want - np.outer(load, (c_tip - world.surface * np.outer(u, u)) @ f_dir)
            grid = np.arange(-0.08, t[-1] + 0.08, 0.001)
            line = np.column_stack([np.interp(grid, t, w) for w in want.T])
            v0, v1 = (want[1] - want[0]) / (t[1] - t[0]), (want[-1] - want[-2]) / (t[-1] - t[-2])
            line[grid < 0] += np.outer(grid[grid < 0], v0)
            line[grid > t[-1]] += np.outer(grid[grid > t[-1]] - t[-1], v1)
            qs = np.tile(q, (len(line), 1))
            pinv = np.linalg.pinv(actual.jacobian(q)[:3])
            for _ in range(4):
                link = qs + world.ripple * np.sin(320 * qs + phases)
                qs = qs + (line - actual.fk_batch(link)[:, :3, 3]) @ pinv.T
            f_sensor = np.outer(load, rotation.T @ f_dir)
            inward = rotation.T @ u
            lever = (
                np.array([0, 0, PROBE.sensor_distance]) + f_sensor * compliance - (PROBE.radius + world.radius) * inward
            )
            true = np.column_stack([f_sensor, np.cross(lever, f_sensor)])
            read = true @ world.sensor.T
            noise = world.noise * np.array([3e-3] * 3 + [2e-5] * 3)
            read = read + noise * random.standard_normal(read.shape)
            read = read + noise * 2.0 * random.standard_normal(6)
            out.append(Touch("sphere", 0, time + t + world.clock, read, np.arange(32) < 16, time + grid, qs))
            time += 3.0
    return out
