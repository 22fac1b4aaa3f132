"""The simulated world behind arm and sensor: a scene and a config laid out for the kernels."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts import DeviceRefused, InputError, LeftOut, LinkShape, Probe
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.scene.solid import Solid
from lwrprobe_sim import body_kernels as body
from lwrprobe_sim import contact_kernels as contact
from lwrprobe_sim import link_kernels as links
from lwrprobe_sim import scenery_kernels as scenery
from lwrprobe_sim import sensor_kernels as sensor
from lwrprobe_sim import touch_kernels as touch
from lwrprobe_sim import world_kernels as kernels
from lwrprobe_sim.config import SimConfig
from lwrprobe_sim.sensor_settings import sensor_settings
from lwrprobe_sim.start import start_joints

_KINDS = {"box": links.BOX, "cylinder": links.CYLINDER, "capsule": links.CAPSULE}


class World:
    """State of arm, probe, object and sensor; `advance` moves all of it on by one cycle.

    `robot` stands in for the scene's arm (a gantry, to measure the physics alone).

    Attributes
    ----------
    state, counts : the arrays of `world_kernels`
    truth : (capacity, 8) true contact at each sample's instant: point, normal, force, number of contacts
    left_out : what this world does without, and why
    """

    def __init__(self, scene: Scene, config: SimConfig, seed: int, robot: Robot | None = None) -> None:
        self.scene, self.config = scene, config
        self.robot = robot or robot_of(scene)
        self.probe: Probe = scene.probe.as_probe()
        self.state = np.zeros(kernels.WORLD)
        self.counts = np.zeros(kernels.COUNTS, np.int64)
        self._ready = self.state[kernels.READY : kernels.JACOBIAN].reshape(kernels.QUEUE, sensor.SAMPLE)
        self.truth = np.zeros((4096, 8))
        self.left_out: list[LeftOut] = []
        if self.robot.n > kernels.JOINTS_MAX:
            raise InputError("arm.robot", self.robot.name, f"at most {kernels.JOINTS_MAX} joints")
        self.counts[kernels.JOINTS] = self.robot.n
        self.counts[kernels.SEED] = seed
        self._set_arm()
        self._set_probe()
        self.numbers, self.indices = self._set_objects()
        self._set_links()
        self._set_sensor()
        self._ahead = kernels.QUEUE + round(2.0 * scene.sensor.rate * config.cycle)
        self._arrays = (self.state, self.counts, self.robot.chain, self.numbers, self.indices)
        self._accept = entry(kernels.accept, *self._arrays[:3], self.state)
        self._step_many = entry(kernels.step_many, *self._arrays, self.truth, self.truth, self.state, self.truth, 0.0)
        n = self.robot.n
        self._one_cycle = np.empty((0, n)), np.empty(1), np.empty((1, n)), np.inf  # no set point
        self._cycles_until_sample = entry(kernels.cycles_until_sample, self.state, self.counts, 0)
        self.place(start_joints(scene, self.robot, config.start_q))

    def advance(self) -> int:
        """Advance by one cycle; returns the number of samples that can be fetched."""
        self._step_many(*self._arrays, self.truth, *self._one_cycle)
        ready = self.counts.item(kernels.N_READY)
        if ready and self.counts.item(kernels.TAKEN) + self._ahead > len(self.truth):
            self.truth = np.concatenate([self.truth, np.zeros_like(self.truth)])
        return ready

    def step_many(
        self, rows: np.ndarray, times: np.ndarray, joints: np.ndarray, max_deviation: float
    ) -> tuple[int, int]:
        """Send the set points (m, n), one a cycle, until a joint deviates by more than `max_deviation` [rad].

        Fills the times (m,) and measured joints (m, n). Returns the number of executed set points, and the refusal of
        the next one (see `command`).

        Raises InputError for anything but arrays of these shapes of float64 numbers.
        """
        shape = len(times), self.robot.n
        for name, array, wanted in (("rows", rows, shape), ("times", times, shape[:1]), ("joints", joints, shape)):
            if array.shape != wanted or array.dtype != np.float64 or not array.flags.c_contiguous:
                raise InputError(name, f"{array.dtype} {array.shape}", f"{wanted}, float64, contiguous")
        return self._step_many(*self._arrays, self.truth, rows, times, joints, max_deviation)

    def cycles_until_sample(self, max_cycles: int) -> int:
        """Number of the next cycles, up to `max_cycles`, that end before a sample arrives."""
        return self._cycles_until_sample(self.state, self.counts, max_cycles)

    def fetch(self) -> list[list[float]]:
        """Samples that have arrived, oldest first, as rows of `sensor_kernels`; they are gone then."""
        rows = self._ready[: self.counts.item(kernels.N_READY)].tolist()
        self.counts[kernels.N_READY] = 0
        return rows

    def tare(self) -> None:
        """Move the bias so that the mean of the last samples reads zero."""
        recent = self.state[kernels.RECENT : kernels.RECENT + 6 * kernels.RECENT_MAX].reshape(-1, 6)
        taken = min(int(self.counts[kernels.TAKEN]), kernels.RECENT_MAX)
        if taken:
            at = kernels.SENSOR + sensor.BIAS
            self.state[at : at + 6] -= recent[:taken].mean(axis=0)

    def place(self, q: np.ndarray) -> None:
        """Put the resting arm at q (n,) without a motion. Raises DeviceRefused beyond the joint limits."""
        if not self.robot.within_limits(q, 1e-9):
            raise DeviceRefused(f"start {np.round(q, 4).tolist()} rad is beyond the joint limits of {self.robot.name}")
        self.state[kernels.Q : kernels.Q + self.robot.n] = q
        kernels.place(self.state, self.counts, self.robot.chain)

    def command(self, q: np.ndarray) -> int:
        """Set point q (n,) for the next cycle; 0, or the joint that refuses it (see `world_kernels.accept`).

        Raises InputError for anything but n float64 numbers.
        """
        if q.shape != (self.robot.n,) or q.dtype != np.float64 or not q.flags.c_contiguous:
            raise InputError("q", f"{q.dtype} {q.shape}", f"{self.robot.n} joint values, float64, contiguous")
        return self._accept(self.state, self.counts, self.robot.chain, q)

    def tip(self) -> np.ndarray:
        """(4, 4) of the undeflected tip: the truth behind the lag."""
        pose = np.eye(4)
        frame = self.state[kernels.TIP : kernels.TIP + 12].reshape(4, 3)
        pose[:3, :] = frame.T
        return pose

    @property
    def wrench(self) -> np.ndarray:
        """(6,) true force and torque in the sensor frame at the end of the last cycle."""
        return self.state[kernels.RECORD_NEW : kernels.RECORD_NEW + 6].copy()

    @property
    def centre(self) -> np.ndarray:
        """(3,) of the sphere."""
        return self.state[kernels.CENTRE : kernels.CENTRE + 3].copy()

    @property
    def unbalanced(self) -> int:
        """Steps in which the contact forces did not come into balance."""
        return int(self.counts[kernels.UNBALANCED])

    def energy(self) -> float:
        """J stored in the sphere's motion, the stick and the contacts (rigid joints, object at rest)."""
        soft = self.probe.compliance > 0.0
        bend = self.tip()[:3, :3].T @ self.state[kernels.BEND : kernels.BEND + 3]
        velocity = self.state[kernels.VELOCITY : kernels.VELOCITY + 3]
        stored = self.config.tip_mass * velocity @ velocity + np.sum(bend[soft] ** 2 / self.probe.compliance[soft])
        rows = self.state[kernels.ROWS : kernels.WAITING].reshape(touch.ROWS_MAX, contact.WIDTH)
        for row in rows[: self.counts[kernels.N_FOUND]]:
            # a surface that is still dented holds its energy even while its damper lets it press with nothing
            stored += row[contact.STIFFNESS] * max(0.0, -row[contact.GAP]) ** 2
            if row[contact.PRESS] > 0.0:
                bristle = row[contact.BRISTLE : contact.BRISTLE + 3]
                stored += row[contact.SHEAR] * bristle @ bristle
        return 0.5 * float(stored)

    def object_pose(self) -> np.ndarray:
        """(4, 4) by which the movable object has left the place that the scene gave it."""
        pose = np.eye(4)
        at = kernels.SCENERY + scenery.POSE
        pose[:3, :] = self.state[at : at + 12].reshape(4, 3).T
        return pose

    def _leave_out(self, stage: str, why: str) -> None:
        self.left_out.append({"stage": stage, "why": why})

    def _set_arm(self) -> None:
        c, s = self.config, self.state
        s[kernels.CYCLE] = c.cycle
        s[kernels.LAG_DECAY] = np.exp(-c.cycle / c.lag) if c.lag > 0.0 else 0.0
        s[kernels.ENCODER] = c.encoder_noise
        s[kernels.BRAKE] = c.brake
        self.counts[kernels.STEPS] = c.substeps
        self.counts[kernels.DELAY] = round(c.delay / c.cycle)
        s[kernels.JOINT_PLAY], s[kernels.RIPPLE] = 0.5 * c.joint_hysteresis, c.gear_ripple
        self.counts[kernels.HAS_GEARS] = c.joint_hysteresis > 0.0 or c.gear_ripple > 0.0
        phases = np.random.default_rng([self.counts.item(kernels.SEED), 320]).uniform(0.0, 2.0 * np.pi, self.robot.n)
        s[kernels.RIPPLE_PHASE : kernels.RIPPLE_PHASE + self.robot.n] = phases
        soft = np.array(c.joint_compliance, dtype=np.float64)
        if soft.ndim and soft.shape != (self.robot.n,):
            raise InputError(
                "sim.joint_compliance", c.joint_compliance, f"one number, or one for each of {self.robot.n}"
            )
        s[kernels.JOINT_COMPLIANCE : kernels.JOINT_COMPLIANCE + self.robot.n] = soft
        self.counts[kernels.HAS_JOINT_COMPLIANCE] = bool(soft.any())
        if not soft.any():
            self._leave_out("joint compliance", "drivers.sim.joint_compliance is zero")
        if c.lag == 0.0 and c.delay == 0.0:
            self._leave_out("tracking lag", "drivers.sim.lag and delay are zero")

    def _set_probe(self) -> None:
        c, s, probe = self.config, self.state, self.probe
        s[kernels.SENSOR_DISTANCE] = probe.sensor_distance
        s[kernels.COMPLIANCE : kernels.COMPLIANCE + 3] = probe.compliance
        s[kernels.RELAX], s[kernels.TIP_MASS] = c.stick_relaxation, c.tip_mass
        s[kernels.SLOW] = c.slow_sliding
        s[kernels.LOAD], s[kernels.INERTIA] = probe.mass, c.inertia
        s[kernels.LOAD_CENTRE : kernels.LOAD_CENTRE + 3] = probe.centre_of_mass
        s[kernels.GRAVITY : kernels.GRAVITY + 3] = c.gravity
        if not probe.compliance.any():
            self._leave_out("stick compliance", "probe.stiffness_lateral and stiffness_axial are zero (rigid)")
        if probe.mass == 0.0 or not (c.inertia or any(c.gravity)):
            s[kernels.LOAD] = 0.0
            self._leave_out("weight and inertia of the probe", "probe.mass, or gravity and inertia, are zero")

    def _set_objects(self) -> tuple[np.ndarray, np.ndarray]:
        table, objects = self.scene.table, self.scene.objects
        movable = [shape for shape in objects if shape.movable]
        fixed = [shape for shape in objects if not shape.movable]
        if len(movable) > 1:
            raise InputError("object", f"{len(movable)} movable ones", "at most one movable object")
        if len(objects) >= touch.MATERIALS_MAX:
            raise InputError("object", len(objects), f"at most {touch.MATERIALS_MAX - 1} objects")
        self._set_table()
        self._set_materials((table, *fixed, *movable))
        still, moving = Solid.from_shapes(fixed), Solid.from_shapes(movable)
        counts = self.counts[kernels.SCENERY_COUNTS : kernels.WATCH_COUNTS]
        counts[scenery.SPLIT_NUMBERS], counts[scenery.SPLIT_INDICES] = len(still.numbers), len(still.indices)
        counts[scenery.FIXED], counts[scenery.MOVABLE] = len(fixed), len(movable)
        if movable:
            self._set_movable(movable[0].mass, *moving.bounds())
        else:
            self._leave_out("object motion", "no object is movable")
        if not objects and not table.present:
            self._leave_out("touch", "there is nothing to touch")
        return np.concatenate([still.numbers, moving.numbers]), np.concatenate([still.indices, moving.indices])

    def _set_table(self) -> None:
        table = self.scene.table
        v = self.state[kernels.SCENERY : kernels.BODY]
        v[scenery.POSE : scenery.POSE + 12] = np.eye(4)[:, :3].ravel()
        if table.present:
            normal = table.normal()
            v[scenery.PLANE : scenery.PLANE + 3] = normal
            v[scenery.PLANE + 3] = table.height * normal[2]
        else:
            self._leave_out("table", "table.present is false")

    def _set_materials(self, bodies: tuple) -> None:
        s, c = self.state[kernels.TOUCH : kernels.WATCH], self.config
        s[touch.RADIUS], s[touch.STICK_RADIUS] = self.probe.radius, self.probe.stick_radius
        stick = next((link for link in self.probe.links if link.name == "stick"), None)
        if stick is None:
            self._leave_out("stick contact", "the probe has no link named stick")
        else:
            s[touch.STICK_LENGTH] = 0.5 * stick.size[1] - stick.pose[2, 3]
        s[touch.FRICTION_SINE] = np.sin(c.friction_turn)
        for i, solid in enumerate(bodies):
            row = touch.MATERIAL + 5 * i
            static, shear = c.static_friction * solid.friction, c.shear * solid.stiffness
            s[row : row + 5] = solid.stiffness, solid.damping, static, solid.friction, shear
        if not any(solid.friction for solid in bodies):
            self._leave_out("friction", "the friction of all objects is zero")

    def _set_movable(self, mass: float, lower: np.ndarray, upper: np.ndarray) -> None:
        b = self.state[kernels.BODY : kernels.TOUCH]
        width = upper - lower
        b[body.MASS], b[body.GRIP] = mass, self.config.foot_friction
        b[body.GRAVITY] = max(0.0, -self.config.gravity[2])
        b[body.GYRATION] = np.sqrt((width[0] ** 2 + width[1] ** 2) / 12.0)
        b[body.BASE], b[body.HEIGHT] = lower[2], width[2]
        b[body.LOWER : body.LOWER + 2], b[body.UPPER : body.UPPER + 2] = lower[:2], upper[:2]

    def _set_links(self) -> None:
        s = self.state[kernels.WATCH : kernels.SET]
        counts = self.counts[kernels.WATCH_COUNTS :]
        on_tip = [link for link in self.probe.links if link.name != "stick"]
        watched = [*on_tip, *self.robot.swinging_links]
        if len(watched) > links.LINK_MAX:
            raise InputError("probe.links", len(watched), f"at most {links.LINK_MAX} links, with the arm's own")
        for k, link in enumerate(watched):
            s[links.LINKS + k * links.LINK : links.LINKS + (k + 1) * links.LINK] = _link_row(link)
        s[links.TIP_REACH] = max((_reach(link) for link in on_tip), default=0.0)
        s[links.JOINT_REACH] = self.robot.length
        counts[links.N_LINKS] = len(watched)
        counts[links.ON_ARM] = len(watched) - len(on_tip)
        if not self.scene.objects and not self.scene.table.present:
            counts[links.N_LINKS] = counts[links.ON_ARM] = 0
            self._leave_out("link collision", "there is nothing to hit")

    def _set_sensor(self) -> None:
        c = self.config
        self.state[kernels.SENSOR : kernels.SCENERY] = sensor_settings(c, self.probe, self.scene.sensor.rate)
        for stage, present in (
            ("sensor noise", c.noise_force or c.noise_torque),
            ("quantisation", c.quantisation),
            ("drift", any(c.drift_force) or any(c.drift_torque)),
            ("loss", c.loss or c.burst_rate),
            ("spikes", c.spike_rate or c.garbage_rate),
        ):
            if not present:
                self._leave_out(stage, "its options in drivers.sim are zero")


def _link_row(link: LinkShape) -> np.ndarray:
    row = np.zeros(links.LINK)
    row[:12] = link.pose[:3].ravel()
    row[links.HALF : links.HALF + 3] = _half_edges(link)
    row[links.KIND] = _KINDS[link.kind]
    row[links.CARRIER] = links.TIP_CARRIER if link.carrier == "tip" else float(link.carrier)
    return row


def _half_edges(link: LinkShape) -> np.ndarray:
    if link.kind == "box":
        return 0.5 * np.array(link.size)
    radius, length = link.size
    return np.array([radius, radius, 0.5 * length + (radius if link.kind == "capsule" else 0.0)])


def _reach(link: LinkShape) -> float:
    """m, from the tip to the link's farthest point at most."""
    return float(np.linalg.norm(link.pose[:3, 3]) + np.linalg.norm(_half_edges(link)))
