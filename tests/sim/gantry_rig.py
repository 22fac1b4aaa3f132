"""A probe on three straight axes over any scene: the physics of touch without an arm's geometry."""

import numpy as np

from lwrprobe.kinematics import Robot
from lwrprobe.scene import load_scene
from lwrprobe_sim import SimConfig
from lwrprobe_sim import contact_kernels as contact
from lwrprobe_sim import world_kernels as kernels
from lwrprobe_sim.world import World

CLEAN = dict(
    lag=0.0, joint_compliance=0.0, gravity=(0.0, 0.0, 0.0), inertia=False, noise_force=0.0, noise_torque=0.0,
    quantisation=False, saturation=False, bias_force=(0.0, 0.0, 0.0), bias_torque=(0.0, 0.0, 0.0),
    drift_force=(0.0, 0.0, 0.0), latency=0.0, late_share=0.0, loss=0.0,
)  # fmt: skip
"""A sensor without faults and a rigid arm without lag."""

PLAIN = ["probe.stiffness_lateral=0.0", "probe.stiffness_axial=0.0", "table.friction=0.0", "table.stiffness=1e4"]
"""A rigid stick and a slippery table."""


def plain_objects(scene):
    """Settings that make each object slippery and of 1e4 N/m, so that a test names whatever else it needs."""
    indices = range(len(load_scene(scene).objects))
    return [f"object.{i}.{setting}" for i in indices for setting in ("friction=0.0", "stiffness=1e4")]


def gantry(tilt: float = 0.0) -> Robot:
    """Joint values are the tip's x, y, z in the world; the probe points down, tilted by `tilt` rad about y."""
    base = np.eye(4)
    base[:3, :3] = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    c, s = np.cos(tilt), np.sin(tilt)
    tool = np.eye(4)
    tool[:3, :3] = np.diag([-1.0, 1.0, -1.0]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    quarter = 0.5 * np.pi
    zero = np.zeros(3)
    return Robot(
        "gantry", zero, np.array([-quarter, -quarter, 0.0]), zero, np.array([0.0, quarter, 0.0]),
        -np.ones(3), np.ones(3), np.full(3, 100.0), np.ones(3, bool), base=base, tool=tool,
    )  # fmt: skip


class Rig:
    """World and the little that tests ask of it."""

    def __init__(self, at, overrides=(), scene="block", tilt=0.0, seed=1, **config):
        settings = [*PLAIN, *plain_objects(scene), *overrides]
        self.world = World(load_scene(scene, settings), SimConfig(**{**CLEAN, **config}), seed, gantry(tilt))
        self.solid = self.world.scene.solid()
        self.cycle = self.world.config.cycle
        self.world.place(np.array(at, dtype=float))

    def go(self, *places):
        """One cycle a place; returns the true wrenches (n, 6) at the sensor."""
        wrenches = []
        for place in places:
            assert self.world.command(np.array(place, dtype=float)) == 0
            self.world.advance()
            wrenches.append(self.wrench)
        return np.array(wrenches)

    def line(self, start, end, seconds):
        """Straight on at constant speed."""
        steps = round(seconds / self.cycle)
        shares = np.arange(1, steps + 1) / steps
        return self.go(*(np.array(start) + s * (np.array(end) - np.array(start)) for s in shares))

    @property
    def wrench(self):
        """(6,) true force and torque in the sensor frame now."""
        return self.world.wrench

    @property
    def force(self):
        """(3,) true force on the probe, world frame."""
        return self.world.tip()[:3, :3] @ self.wrench[:3]

    @property
    def rows(self):
        """Pressing contacts (n, WIDTH)."""
        rows = self.world.state[kernels.ROWS_OLD : kernels.ROWS].reshape(-1, contact.WIDTH)
        return rows[: self.world.counts[kernels.N_ROWS]].copy()

    @property
    def centre(self):
        """(3,) of the sphere."""
        return self.world.centre

    def energy(self):
        """J stored in motion, stick and contacts."""
        state, compliance = self.world.state, self.world.probe.compliance
        velocity = state[kernels.VELOCITY : kernels.VELOCITY + 3]
        bend = self.world.tip()[:3, :3].T @ state[kernels.BEND : kernels.BEND + 3]
        total = 0.5 * self.world.config.tip_mass * velocity @ velocity
        total += 0.5 * np.sum(bend[compliance > 0] ** 2 / compliance[compliance > 0])
        for row in self.rows:
            bristle = row[contact.BRISTLE : contact.BRISTLE + 3]
            total += 0.5 * row[contact.SHEAR] * bristle @ bristle
        # a surface that is still dented holds its energy even while its damper lets it press with nothing
        touch = self.solid.touch(self.centre, self.world.probe.radius)
        stiffness = [self.world.scene.objects[part].stiffness for part in touch.parts]
        return total + 0.5 * np.sum(stiffness * touch.depths**2)

    @property
    def unbalanced(self):
        """Steps in which the contact forces did not come into balance."""
        return self.world.unbalanced
