"""Three straight axes that carry the probe over the simulated world: the physics of touch without an arm's geometry."""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.contracts import WrenchSample
from lwrprobe.contracts.plugins import load
from lwrprobe.kinematics import Robot
from lwrprobe.scene import load_scene

CLEAN = {
    "lag": 0.0, "joint_compliance": 0.0, "gravity": (0.0, 0.0, 0.0), "inertia": False, "noise_force": 0.0,
    "noise_torque": 0.0, "quantisation": False, "saturation": False, "bias_force": (0.0, 0.0, 0.0),
    "bias_torque": (0.0, 0.0, 0.0), "drift_force": (0.0, 0.0, 0.0), "latency": 0.0, "late_share": 0.0, "loss": 0.0,
}  # fmt: skip
"""The simulator's options for a stiff arm without lag and a sensor without faults."""

PLAIN = [
    "probe.stiffness_lateral=0.0", "probe.stiffness_axial=0.0", "object.0.friction=0.0", "object.0.stiffness=1e4",
    "table.friction=0.0", "table.stiffness=1e4", "truth.profile=ideal",
]  # fmt: skip
"""A rigid stick, and one slippery object on a slippery table: whatever differs is named where it is measured."""


def gantry() -> Robot:
    """Joint values are the tip's x, y, z in the world [m]; the probe points down."""
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    tool[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    zero, quarter, one = np.zeros(3), 0.5 * np.pi, np.ones(3)
    return Robot(
        name="gantry",
        a=zero,
        alpha=np.array([-quarter, -quarter, 0.0]),
        d=zero,
        theta=np.array([0.0, quarter, 0.0]),
        lower=-one,
        upper=one,
        speed=100.0 * one,
        prismatic=np.ones(3, bool),
        base=base,
        tool=tool,
    )


def build_world(overrides: list[str], scene: str = "block", **config: Any) -> Any:
    """The simulator's world on the gantry, faultless but for what is asked."""
    driver = load("driver", "sim")
    return driver.World(load_scene(scene, [*PLAIN, *overrides]), driver.Config(**{**CLEAN, **config}), 1, gantry())


def follow(world: Any, path: np.ndarray) -> np.ndarray:
    """(n, 3) world-frame force on the probe along a path (n, 3) of the tip, one row a cycle, from its first row on."""
    world.place(path[0])
    forces = np.zeros((len(path), 3))
    for i in range(1, len(path)):
        world.command(path[i])
        world.advance()
        forces[i] = world.wrench[:3]
    return forces * (1.0, -1.0, -1.0)


def rest(world: Any, place: np.ndarray, count: int, settle: int = 8) -> list[WrenchSample]:
    """`count` samples while the world's arm stays at joint values `place`, after `settle` that are left out."""
    samples: list[WrenchSample] = []
    while len(samples) < count + settle:
        world.command(place)
        world.advance()
        samples += [
            WrenchSample(row[0], np.array(row[1:4]), np.array(row[4:7]), int(row[7]), int(row[8]))
            for row in world.fetch()
        ]
    return samples[settle:]
