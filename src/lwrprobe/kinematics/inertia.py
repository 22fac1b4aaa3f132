"""Mass of an arm: of its links, and as something feels it that is struck by its tip.

The links' masses are rarely published. The mass of the whole arm is, and is spread here over the links in proportion to
their volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError, LinkShape
from lwrprobe.kinematics.robot import Robot

MIN_RADIUS = 0.05
"""m, of a link whose shape is not known."""
MIN_MASS = 1e-3
"""kg, of a link without a shape between links that have one."""


@dataclass(slots=True, frozen=True)
class LinkInertia:
    """A rigid link in its own link frame.

    Attributes
    ----------
    mass : kg
    centre : (3,) m, centre of mass
    tensor : (3, 3) kg m^2, about the centre of mass
    """

    mass: float
    centre: np.ndarray
    tensor: np.ndarray


def link_inertias(robot: Robot, mass: float) -> tuple[LinkInertia, ...]:
    """The n moving links of an arm of `mass` kg, solid bodies of one density; rods where no shape is known.

    Raises InputError for a mass that is not positive and finite.
    """
    if not (np.isfinite(mass) and mass > 0.0):
        raise InputError("arm mass", mass, "more than 0 kg")
    shapes: list[list[LinkShape]] = [[] for _ in range(robot.n + 1)]
    for link in robot.links:
        shapes[int(link.carrier)].append(link)
    volume = sum(_volume(link) for links in shapes[1:] for link in links)
    if volume > 0.0:
        return tuple(_bodies(mass / volume, links) for links in shapes[1:])
    return tuple(_rod(mass / robot.n, robot, i) for i in range(robot.n))


def mass_matrix(robot: Robot, links: tuple[LinkInertia, ...], q: np.ndarray) -> np.ndarray:
    """(n, n) kg m^2 (kg for prismatic joints) for q (n,): sum of J_v' m J_v + J_w' I J_w over the links."""
    frames = robot.link_frames(q)
    total = np.zeros((robot.n, robot.n))
    # Joint i turns about the z axis of frame i, or of frame i + 1 in Craig's convention.
    first = 1 if robot.convention == "modified" else 0
    axes, places = frames[first : first + robot.n, :3, 2], frames[first : first + robot.n, :3, 3]
    for count, (link, frame) in enumerate(zip(links, frames[1:]), 1):
        turn, centre = frame[:3, :3], frame[:3, :3] @ link.centre + frame[:3, 3]
        linear, angular = np.zeros((3, robot.n)), np.zeros((3, robot.n))
        for i in range(count):
            if robot.prismatic[i]:
                linear[:, i] = axes[i]
            else:
                linear[:, i], angular[:, i] = np.cross(axes[i], centre - places[i]), axes[i]
        total += link.mass * linear.T @ linear + angular.T @ turn @ link.tensor @ turn.T @ angular
    return total


def apparent_mass(robot: Robot, mass: float, q: np.ndarray) -> float:
    """kg of an arm of `mass` kg as its tip shows it to what it strikes, at joint values q (n,), in the worst direction.

    The largest 1 / (u' J M^-1 J' u) over all directions u, with the tip's linear Jacobian J and the mass matrix M
    (Khatib 1995, doi:10.1177/027836499501400103). The joints give way freely and the tool has no mass; never more than
    `mass`. Raises InputError for bad values.
    """
    q = robot.joint_values(q)
    linear = robot.jacobian(q)[:3]
    mobility = linear @ np.linalg.solve(mass_matrix(robot, link_inertias(robot, mass), q), linear.T)
    least = float(np.linalg.eigvalsh(0.5 * (mobility + mobility.T))[0])
    return min(mass, 1.0 / least) if least > 0.0 else mass


def _volume(link: LinkShape) -> float:
    if link.kind == "box":
        return float(np.prod(link.size))
    radius, length = link.size
    ball = 4.0 / 3.0 * np.pi * radius**3 if link.kind == "capsule" else 0.0
    return float(np.pi * radius**2 * length + ball)


def _bodies(density: float, links: list[LinkShape]) -> LinkInertia:
    """A link of several bodies, each about as heavy at its edge as the box around it."""
    if not links:
        return LinkInertia(MIN_MASS, np.zeros(3), MIN_MASS * 0.4 * MIN_RADIUS**2 * np.eye(3))
    masses = np.array([density * _volume(link) for link in links])
    centre = np.asarray(masses @ [link.pose[:3, 3] for link in links]) / masses.sum()
    tensor = np.zeros((3, 3))
    for share, link in zip(masses.tolist(), links):
        x, y, z = link.size if link.kind == "box" else (np.sqrt(3.0) * link.size[0],) * 2 + (link.size[1],)
        own = share / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
        r = link.pose[:3, 3] - centre
        tensor += link.pose[:3, :3] @ own @ link.pose[:3, :3].T + share * (r @ r * np.eye(3) - np.outer(r, r))
    return LinkInertia(float(masses.sum()), centre, tensor)


def _rod(mass: float, robot: Robot, i: int) -> LinkInertia:
    """A link of unknown shape: its mass half way to the next joint."""
    if robot.convention == "modified":
        middle = np.array([0.0, 0.0, -0.5 * robot.d[i]])
    else:
        c, s = np.cos(robot.alpha[i]), np.sin(robot.alpha[i])
        middle = -0.5 * np.array([robot.a[i], s * robot.d[i], c * robot.d[i]])
    own = mass * (4.0 * float(middle @ middle) / 12.0 + 0.4 * MIN_RADIUS**2)
    return LinkInertia(mass, middle, own * np.eye(3))
