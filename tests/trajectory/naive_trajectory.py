"""Textbook forms of what the trajectory kernels do, and a watch that holds a generator to its limits at every tick."""

import numpy as np
from scipy.spatial.transform import Rotation


def pose(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)):
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    result[:3, 3] = x, y, z
    return result


def motion_at(durations, jerks, velocity, acceleration, time):
    """(position, velocity, acceleration) after pieces of constant jerk, one polynomial after the other."""
    p = np.polynomial.Polynomial([0.0, velocity, acceleration / 2.0])
    for h, j in [*zip(durations, jerks), (np.inf, 0.0)]:
        p = np.polynomial.Polynomial([p(0.0), p.deriv()(0.0), p.deriv(2)(0.0) / 2.0, j / 6.0])
        if time < h:
            return p(time), p.deriv()(time), p.deriv(2)(time)
        time -= h
        p = np.polynomial.Polynomial([p(h), p.deriv()(h), p.deriv(2)(h) / 2.0])
    raise AssertionError


def angular_motion(r, rate, second, h=1e-4):
    """Angular velocity and acceleration of exp([r(t)]) by central differences of rotations."""

    def rotation(t):
        return Rotation.from_rotvec(r + t * rate + 0.5 * t * t * second)

    def omega(t):
        return (rotation(t + h) * rotation(t - h).inv()).as_rotvec() / (2.0 * h)

    return omega(0.0), (omega(h) - omega(-h)) / (2.0 * h)


class Watch:
    """Steps a `CartesianTrajectory` and asserts, on norms and within rounding, that it is where its motion says."""

    def __init__(self, tip, tolerance=1e-9):
        limits = self.limits = tip.limits
        self.tip, self.tolerance = tip, tolerance
        self.allowed = np.array(
            (
                limits.speed,
                limits.acceleration,
                limits.turn_rate,
                limits.turn_acceleration,
                limits.jerk,
                limits.turn_jerk,
            )
        )
        self.bend = limits.turn_jerk + limits.turn_rate * (limits.turn_acceleration + limits.turn_rate**2)
        self.worst = np.zeros(6)
        self.pose, self.motion = tip.pose.copy(), self.read()

    def read(self):
        tip = self.tip
        return np.concatenate((tip.velocity, tip.acceleration, tip.angular_velocity, tip.angular_acceleration)).reshape(
            4, 3
        )

    def step(self, elapsed=None):
        tip, limits = self.tip, self.limits
        status = tip.step(elapsed)
        h = tip.cycle if elapsed is None else elapsed
        pose, motion = tip.pose.copy(), self.read()
        jerks = (motion[1::2] - self.motion[1::2]) / h
        used = np.sqrt((np.concatenate((motion, jerks)) ** 2).sum(axis=1)) / self.allowed
        self.worst = np.maximum(self.worst, used)
        assert used.max() <= 1.0 + self.tolerance, (used, status)
        # position and rotation move as the velocities say (trapezium rule, whose error the jerk bounds)
        v, w = h * (motion[::2] + self.motion[::2]) / 2.0
        displacement = np.abs(pose[:3, 3] - self.pose[:3, 3] - v).max()
        assert displacement <= limits.jerk * h**3 / 6.0 + 1e-11 + 1e-15 * np.abs(pose[:3, 3]).max()
        turn = pose[:3, :3] @ self.pose[:3, :3].T
        sine = np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])) / 2.0
        assert np.abs(sine - w).max() <= (self.bend + limits.turn_rate**3) * h**3 / 6.0 + 1e-11
        assert np.abs(pose[:3, :3].T @ pose[:3, :3] - np.eye(3)).max() < 1e-14
        self.pose, self.motion = pose, motion
        return status
