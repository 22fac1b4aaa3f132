"""Analytic surfaces that answer motions with observations: no robot, no simulator, no time to speak of."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import Clearance, Contact, Done, Goal, Observation, VelocityCommand
from lwrprobe.control.contour_kernels import MAX_OUTWARD
from lwrprobe_strategies.planning.tracking_frame import MAX_RETURN

Distance = Callable[[np.ndarray], float]
"""Signed distance of a place (3,) to a surface, m; negative inside."""


def plane(height: float = 0.02) -> Distance:
    return lambda p: p[2] - height


def box(half=(0.05, 0.03), height: float = 0.02) -> Distance:
    """An upright block from below the table's top up to `height`."""

    def distance(p):
        q = np.array([abs(p[0]) - half[0], abs(p[1]) - half[1], p[2] - height])
        return float(np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0))

    return distance


def step(at: float = 0.0, low: float = 0.02, high: float = 0.035) -> Distance:
    """A floor with a wall in +y: an inner edge, a corner, an upper edge."""
    floor, wall = plane(low), box((1.0, 1.0), high)
    return lambda p: min(floor(p), wall(np.array([p[0], p[1] - at - 1.0, p[2]])))


def hole(half: float = 0.02, height: float = 0.02) -> Distance:
    """A plane with a slot without a bottom across y."""
    side = box((1.0, 1.0), height)
    return lambda p: side(np.array([p[0], abs(p[1]) - half - 1.0, p[2]]))


@dataclass
class FakeSurface:
    """Arm, sensor and estimator in one: the tip does at once what a motion asks for, the surface presses back.

    Attributes
    ----------
    distance : the surface
    task : stiffness, threshold and the probe's radius come from here
    place : (3,) m, of the sphere's centre
    noise : N, standard deviation of the force's components
    shift : m/s, at which the surface moves up
    held_back : (3,) m, by which the measured tip is not where the motors have it
    """

    distance: Distance
    task: object
    place: np.ndarray
    noise: float = 0.0
    shift: float = 0.0
    stiffness: float = 2000.0
    period: float = 0.008
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))
    time: float = 0.0
    rotation: np.ndarray | None = None
    peak: float = 0.0
    fastest: float = 0.0
    clearance: Clearance | None = None
    blocked: str = ""
    held_back: np.ndarray | None = None

    def __post_init__(self):
        self.place = np.array(self.place, dtype=float)
        self.rotation = self.task.orientation.copy() if self.rotation is None else self.rotation
        self.velocity = np.zeros(3)

    def normal(self, place: np.ndarray) -> np.ndarray:
        e = 1e-7
        g = np.array([self.distance(place + d) - self.distance(place - d) for d in e * np.eye(3)])
        return g / max(np.linalg.norm(g), 1e-12)

    def look(self) -> Observation:
        """What the tip sees where it is."""
        sunk = self.place - [0.0, 0.0, self.shift * self.time]
        depth = self.task.probe.radius - self.distance(sunk)
        normal = self.normal(sunk)
        force = self.stiffness * max(depth, 0.0) * normal + self.noise * self.random.normal(size=3)
        size = float(np.linalg.norm(force))
        self.peak = max(self.peak, size)
        contact = None
        if size >= self.task.force_threshold:
            point = self.place - (self.task.probe.radius - max(depth, 0.0)) * normal
            contact = Contact(self.time, point, normal, force, self.place.copy())
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation, self.place
        if self.held_back is not None:
            pose[:3, 3] += self.held_back
        arrived = not self.velocity.any()
        return Observation(
            self.time, pose, self.velocity.copy(), force, contact, self.clearance, arrived, self.blocked
        )  # fmt: skip

    def check(self, motion) -> None:
        """No motion is faster than the task and the force law allow."""
        if isinstance(motion, Goal):
            assert motion.speed <= self.task.free_speed
        else:
            most = np.hypot(max(self.task.contour_speed, self.task.approach_speed), MAX_OUTWARD) + MAX_RETURN
            assert np.linalg.norm(motion.velocity) <= most * (1.0 + 1e-9)

    def obey(self, motion) -> Observation:
        """One period later."""
        self.time += self.period
        if isinstance(motion, Done):
            return self.look()
        before = self.place.copy()
        self.check(motion)
        if isinstance(motion, Goal):
            displacement = motion.pose[:3, 3] - self.place
            size = float(np.linalg.norm(displacement))
            self.place = self.place + displacement * min(1.0, motion.speed * self.period / max(size, 1e-12))
            self.rotation = motion.pose[:3, :3]
        else:
            assert isinstance(motion, VelocityCommand)
            self.place = self.place + motion.velocity * self.period
            if motion.pose is not None:
                self.rotation = motion.pose[:3, :3]
        assert np.isfinite(self.place).all()
        self.velocity = (self.place - before) / self.period
        self.fastest = max(self.fastest, float(np.linalg.norm(self.velocity)))
        return self.look()
