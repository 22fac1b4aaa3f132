"""Self-check of the probe on a reference sphere: its radius, and where its centre really sits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError, Probe
from lwrprobe.contracts.samples import Vector

_FEWEST = 6
_ROUNDS = 20


@dataclass(slots=True, frozen=True)
class ProbeCheck:
    """Dimensions of the probe that follow from contacts on a sphere of known radius.

    Attributes
    ----------
    radius : m, of the probe's sphere; radius_error : m, against the stated one
    offset : (3,) m, the sphere's centre against where the probe's description has it, tip frame axes (a bent stick, a
        wrong `sensor_distance`)
    reference : (3,) m, centre of the reference sphere, world
    residual : m, root mean square distance of the touches from the fitted sphere
    torque_residual : N·m, what the torques leave
    """

    radius: float
    radius_error: float
    offset: Vector
    reference: Vector
    residual: float
    torque_residual: float


def check_probe(
    probe: Probe,
    centres: np.ndarray,
    rotations: np.ndarray,
    forces: np.ndarray,
    torques: np.ndarray,
    reference_radius: float,
) -> ProbeCheck:
    """Radius and centre offset of the probe from touches all over a reference sphere.

    Two things have to fit: the true centres lie on a sphere of reference plus probe radius, and the torque is that of
    the force at the contact, `t = (l + r u) x f` with l the centre in the sensor frame and u towards the reference's
    centre. The second is linear in l for known u, the first gives u; they take turns (at most 20 rounds, to 1e-9 m).

    Parameters
    ----------
    centres : (n, 3) m, world, where the stated probe puts the sphere's centre (deflection taken off)
    rotations : (n, 3, 3) of the sensor in the world
    forces, torques : (n, 3) conditioned, sensor frame
    reference_radius : m

    Raises
    ------
    InputError : shapes, NaN, fewer than six touches, or touches that do not go round the sphere (less than 60 degrees
        apart, or forces all along one line)
    """
    c, f, t = (np.asarray(a, dtype=np.float64).reshape(-1, 3) for a in (centres, forces, torques))
    turns = np.asarray(rotations, dtype=np.float64).reshape(-1, 3, 3)
    n = len(c)
    if n < _FEWEST or not len(f) == len(t) == len(turns) == n:
        raise InputError("centres", (n, len(f), len(t), len(turns)), f"at least {_FEWEST} touches, complete")
    if not all(np.isfinite(a).all() for a in (c, f, t, turns)):
        raise InputError("centres", "NaN or infinite values", "finite numbers only")
    if not (np.isfinite(reference_radius) and reference_radius > 0.0):
        raise InputError("reference_radius", reference_radius, "a positive length")
    world = np.einsum("nij,nj->ni", turns, f)
    towards = world / np.linalg.norm(world, axis=1)[:, None]
    if np.linalg.svd(towards, compute_uv=False)[1] < 0.25 * np.sqrt(n):
        raise InputError("centres", "touches too close together", "touches from directions 60 degrees apart and more")

    stated = np.array([0.0, 0.0, probe.sensor_distance]) + np.asarray(probe.compliance) * f
    offset, radius = np.zeros(3), probe.radius
    for _ in range(_ROUNDS):
        place = c + turns @ offset
        reference, reach = _fit_sphere(place)
        radius = reach - reference_radius
        u = np.einsum("nji,nj->ni", turns, (reference - place) / reach)
        arm = np.cross(stated + radius * u, f)
        step, *_ = np.linalg.lstsq(np.concatenate([-_cross(v) for v in f]), (t - arm).ravel(), rcond=None)
        moved = np.abs(step - offset).max()
        offset = step
        if moved < 1e-9:
            break
    place = c + turns @ offset
    reference, reach = _fit_sphere(place)
    left = np.linalg.norm(place - reference, axis=1) - reach
    torque_left = t - arm - np.cross(offset, f)
    return ProbeCheck(
        radius=float(reach - reference_radius),
        radius_error=float(reach - reference_radius - probe.radius),
        offset=offset,
        reference=reference,
        residual=float(np.sqrt(np.mean(left**2))),
        torque_residual=float(np.sqrt(np.mean(torque_left**2))),
    )


def _fit_sphere(points: np.ndarray) -> tuple[Vector, float]:
    """Centre and radius: algebraic start, then Gauss-Newton on the distances."""
    middle = points.mean(axis=0)
    p = points - middle
    found, *_ = np.linalg.lstsq(np.column_stack([2.0 * p, np.ones(len(p))]), (p**2).sum(axis=1), rcond=None)
    centre, radius = found[:3], float(np.sqrt(max(found[3] + found[:3] @ found[:3], 0.0)))
    for _ in range(10):
        away = p - centre
        distance = np.linalg.norm(away, axis=1)
        design = np.column_stack([-away / distance[:, None], -np.ones(len(p))])
        step, *_ = np.linalg.lstsq(design, radius - distance, rcond=None)
        centre, radius = centre + step[:3], radius + float(step[3])
        if np.abs(step).max() < 1e-12:
            break
    return centre + middle, radius


def _cross(v: Vector) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
