"""The MuJoCo world behind arm and sensor: `advance` moves all of it on by one cycle of the arm."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from lwrprobe.contracts import DeviceRefused, LeftOut, TrueContact, WrenchSample
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene
from lwrprobe_mujoco.config import MujocoConfig
from lwrprobe_mujoco.model import Model, build
from lwrprobe_mujoco.transmission import Transmission

_NOT_MODELLED = {
    "joint_hysteresis": "joint hysteresis",
    "gear_ripple": "gear ripple",
    "friction_turn": "friction beside the slip",
    "stick_relaxation": "relaxation of the stick",
}
_STIFF = 0.5
"""A rigid joint gets the stiffness whose natural period is 2 pi / _STIFF steps."""


@dataclass(slots=True)
class Instant:
    """Truth at the end of a cycle: wrench (6,) in the sensor frame, and the sphere's strongest contact."""

    wrench: np.ndarray
    contact: TrueContact | None


class World:
    """State of arm, probe, objects and sensor.

    Attributes
    ----------
    q, qd : (n,) rad and rad/s, measured on the motors' side
    time : s
    truth : the sphere's contact at each sample's instant, by the sample's number
    peak_force, probe_peak_force : N, largest so far on the sphere, and of sphere and stick together or alone
    link_collisions : how often something else of the arm began to touch
    left_out : what this world does without, and why
    """

    def __init__(self, scene: Scene, config: MujocoConfig, seed: int, robot: Robot, start: np.ndarray) -> None:
        self.scene, self.config, self.robot = scene, config, robot
        self.model: Model = build(scene, robot, config)
        self._m: Any = self.model.compiled
        self._d: Any = mujoco.MjData(self._m)
        self._random = np.random.default_rng([seed, 7])
        self._transmission = Transmission(config, scene.probe.as_probe(), scene.sensor.rate, seed)
        if not robot.within_limits(start, 1e-9):
            raise DeviceRefused(f"start {np.round(start, 4).tolist()} rad is beyond the joint limits of {robot.name}")
        self.q, self.qd = start.copy(), np.zeros(robot.n)
        self.time, self._cycles = 0.0, 0
        self._set_point, self._set_speed, self._braking = start.copy(), np.zeros(robot.n), False
        self._motor, self._motor_speed = start.copy(), np.zeros(robot.n)
        self._line: deque[np.ndarray] = deque([start.copy()] * round(config.delay / config.cycle))
        self._follow = 1.0 - np.exp(-config.cycle / config.lag) if config.lag > 0.0 else 1.0
        self.truth: dict[int, TrueContact] = {}
        self.peak_force = self.probe_peak_force = 0.0
        self.link_collisions = 0
        self._hitting: frozenset[int] = frozenset()
        self._d.qpos[: robot.n] = start
        mujoco.mj_forward(self._m, self._d)
        self._damping = self._set_springs()
        self._begin = self._end = Instant(self._wrench(), None)
        self.left_out = self._without()

    def _set_springs(self) -> np.ndarray:
        """Stiffness and damping of joints and stick; the dampers' constants (n,) of the joints."""
        m, n, dt = self._m, self.robot.n, max(self.config.timestep, self.config.free_timestep)
        inertia = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, self._d, inertia)
        own = np.diag(inertia)
        soft = np.broadcast_to(np.asarray(self.config.joint_compliance, np.float64), (n,))
        rigid = own[:n] * (_STIFF / dt) ** 2
        stiffness = np.where(soft > 0.0, 1.0 / np.where(soft > 0.0, soft, 1.0), rigid)
        damping = np.maximum(2.0 * self.config.joint_damping * np.sqrt(stiffness * own[:n]), stiffness * dt)
        for i in range(n):
            m.joint(i).stiffness[0] = stiffness[i]
            m.dof_damping[m.jnt_dofadr[i]] = damping[i]
        for i in range(n, m.njnt):
            at, k = m.jnt_dofadr[i], float(m.joint(i).stiffness[0])
            if not m.joint(i).name.startswith("stick"):
                continue
            m.dof_damping[at] = 2.0 * self.config.stick_damping * np.sqrt(k * own[at])
        self._m.qpos_spring[:n] = self._motor
        return damping

    def _without(self) -> list[LeftOut]:
        why = "MuJoCo's world does not model it"
        left: list[LeftOut] = [
            {"stage": stage, "why": why} for name, stage in _NOT_MODELLED.items() if getattr(self.config, name)
        ]
        if self.model.softened > 0.0:
            step = 1e3 * self.config.timestep
            why = f"steps of {step:g} ms resolve contacts of up to {self.model.softened:.2g} N/m"
            left.append({"stage": "stiffness of the object", "why": why})
        return left

    def command(self, q: np.ndarray) -> int:
        """Set point q (n,) for the next cycle; 0, or i + 1 for a joint limit, -(i + 1) for a jump of joint i."""
        robot, cycle = self.robot, self.config.cycle
        beyond = (q < robot.lower - 1e-9) | (q > robot.upper + 1e-9) | ~np.isfinite(q)
        if beyond.any():
            return int(np.argmax(beyond)) + 1
        jumps = np.abs(q - self._set_point) > robot.speed * cycle * (1.0 + 1e-6)
        if jumps.any():
            return -int(np.argmax(jumps)) - 1
        self._set_speed = (q - self._set_point) / cycle
        self._set_point = q.copy()
        self._braking = False
        return 0

    def jump_speed(self, q: np.ndarray, joint: int) -> float:
        """rad/s that a set point asks of a joint."""
        return float(abs(q[joint] - self._set_point[joint])) / self.config.cycle

    def brake(self) -> None:
        """Let all joints come to rest; the next set point takes over again."""
        self._braking = True

    def advance(self) -> list[WrenchSample]:
        """Advance by one cycle; the samples that have arrived by its end."""
        c, n, m, d = self.config, self.robot.n, self._m, self._d
        before = self.time
        self._cycles += 1
        self.time = self._cycles * c.cycle
        motor = self._next_motor()
        speed = (motor - self._motor) / c.cycle
        torque = self._damping * speed
        if c.feedforward > 0.0:
            wanted, needed = np.zeros(m.nv), np.zeros(m.nv)
            wanted[:n] = (speed - self._motor_speed) / c.cycle
            mujoco.mj_mulM(m, d, needed, wanted)
            torque += c.feedforward * needed[:n]
        d.qfrc_applied[:n] = torque
        self._begin = self._end
        contact = None
        m.opt.timestep = c.timestep if d.ncon else c.free_timestep
        steps = round(c.cycle / m.opt.timestep)
        for k in range(steps):
            m.qpos_spring[:n] = self._motor + (k + 1) / steps * (motor - self._motor)
            mujoco.mj_step(m, d)
            contact = self._look_at_contacts() if d.ncon else None
        self._motor, self._motor_speed = motor, speed
        self._end = Instant(self._wrench(), contact)
        q = motor + c.encoder_noise * self._random.standard_normal(n) if c.encoder_noise > 0.0 else motor.copy()
        self.qd, self.q = (q - self.q) / c.cycle, q
        self._sample(before)
        return self._transmission.arrived(self.time)

    def cycles_until_sample(self, limit: int) -> int:
        """How many of the next cycles, up to `limit`, end before a sample arrives."""
        arrival, cycles = self._transmission.next_arrival, 0
        while cycles < limit and (self._cycles + cycles + 1) * self.config.cycle + 1e-12 < arrival:
            cycles += 1
        return cycles

    def tare(self) -> None:
        """Move the sensor's bias so that the mean of the last samples reads zero."""
        self._transmission.tare()

    def _next_motor(self) -> np.ndarray:
        if self._braking:
            step = self.config.brake * self.config.cycle
            slower = np.maximum(np.abs(self._set_speed) - step, 0.0)
            self._set_speed = np.copysign(slower, self._set_speed)
            moved = self._set_point + self.config.cycle * self._set_speed
            self._set_point = np.clip(moved, self.robot.lower, self.robot.upper)
        self._line.append(self._set_point)
        return self._motor + self._follow * (self._line.popleft() - self._motor)

    def _wrench(self) -> np.ndarray:
        """(6,) N, N m on the probe in the sensor frame; MuJoCo gives what the probe's side takes up."""
        return -self._d.sensordata[:6]

    def _look_at_contacts(self) -> TrueContact | None:
        """Count forces and collisions of the step; the sphere's strongest contact."""
        m, d, sphere, stick = self._m, self._d, self.model.sphere, self.model.stick
        on_sphere, on_stick = np.zeros(3), np.zeros(3)
        wrench = np.zeros(6)
        best = None
        hitting: set[int] = set()
        for i in range(d.ncon):
            contact = d.contact[i]
            if contact.dist >= 0.0:  # near, not touching
                continue
            first, second = contact.geom
            hitting |= self.model.links.intersection((first, second))
            if not {sphere, stick}.intersection((first, second)):
                continue
            mujoco.mj_contactForce(m, d, i, wrench)
            frame = contact.frame.reshape(3, 3)
            sign = 1.0 if second in (sphere, stick) else -1.0  # the frame's x axis points from the first to the second
            force = sign * frame.T @ wrench[:3]
            if stick in (first, second):
                on_stick += force
                continue
            on_sphere += force
            size = float(np.linalg.norm(force))
            if size > 0.0 and (best is None or size > best.force):
                normal = sign * frame[0]
                best = TrueContact(contact.pos - 0.5 * contact.dist * normal, normal, size)
        self.link_collisions += len(hitting - self._hitting)
        self._hitting = frozenset(hitting)
        force = float(np.linalg.norm(on_sphere))
        self.peak_force = max(self.peak_force, force)
        both = float(np.linalg.norm(on_sphere + on_stick))
        self.probe_peak_force = max(self.probe_peak_force, force, float(np.linalg.norm(on_stick)), both)
        return best

    def _sample(self, before: float) -> None:
        """Take all samples whose instants lie in this cycle."""
        line = self._transmission
        while line.next_instant <= self.time + 1e-12:
            share = min(1.0, (line.next_instant - before) / (self.time - before))
            nearer = self._end if share >= 0.5 else self._begin
            if nearer.contact is not None:
                self.truth[line.next_number] = nearer.contact
            line.take(self._begin.wrench + share * (self._end.wrench - self._begin.wrench))
