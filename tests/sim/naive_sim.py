"""Textbook forms that the simulator's kernels are held against."""

import numpy as np


def contact_force(row, x, step):
    """(force, slipping) of one contact: spring and damper that only press, Coulomb friction through a bristle."""
    depth = -(row["gap"] + row["normal"] @ x)
    rate = (max(depth, 0.0) - row["penetration"]) / step
    press = max(0.0, row["stiffness"] * depth + row["damping"] * rate) if depth > 0.0 else 0.0
    across = np.eye(3) - np.outer(row["normal"], row["normal"])
    stretch = row["bristle"] + across @ x
    limit = row["friction"] * press
    pull = row["shear"] * np.linalg.norm(stretch)
    slipping = pull > limit
    share = 0.0 if pull == 0.0 else min(1.0, limit / pull)
    return press * row["normal"] - share * row["shear"] * stretch, slipping


def displacement(row, x):
    """(3,) of a contact, with the probe displaced by x (2, 3): bent, and moved as a whole."""
    return row["lever"] * x[0] + x[1]


def balance_by_relaxation(rows, free, compliance, step, rounds=200_000, share=None):
    """Displacement where x = free + G f(x), by small steps towards it: slow, but with nothing that could be wrong.

    `free` is (2, 3), `compliance` (2, 3, 3): of the bending stick, and of what moves as a whole.
    """
    stiffest = sum(row["stiffness"] + row["damping"] / step + row["shear"] for row in rows)
    soft = sum(np.linalg.norm(part, 2) for part in compliance)
    share = share or 0.5 / (1.0 + soft * stiffest)
    x = np.array(free)
    for _ in range(rounds):
        forces = [contact_force(row, displacement(row, x), step)[0] for row in rows]
        pulls = sum(row["lever"] * force for row, force in zip(rows, forces)), sum(forces)
        change = free + np.array([part @ pull for part, pull in zip(compliance, pulls)]) - x
        x = x + share * change
        if np.linalg.norm(change) < 1e-14:
            break
    return x


def wrench_about(origin, points, forces):
    """(6,) sum of forces and of their torques about a point."""
    return np.r_[np.sum(forces, axis=0), np.sum(np.cross(points - origin, forces), axis=0)]
