"""What errors of the sensor's force do to contacts: they bend the stick in the estimate, and turn the normal.

While the sphere slides, the normal aside of its path is the direction of the force less its part along the path. Gain
and crosstalk are one matrix for the whole run, and so is the rate at which each axis drifts. Crosstalk counts most
where the sphere is pushed from the side: 1 N at a lever of 50 mm is nearly half of a torque axis' full scale, of which
one percent of crosstalk makes 0.05 N in a force axis.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Probe
from lwrprobe.scene.uncertainty import UncertaintyTable

SMALLEST = 1e-3
"""N across the path, below which a force has no direction."""


def matrix_errors(table: UncertaintyTable, probe: Probe, forces: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n, 18, 3) N, sensor frame: independent errors of the force by the sensor's matrix, one standard deviation each.

    They are those of a calibration, or of each entry alone.
    `forces` (n, 3) N on the sphere and `normals` (n, 3) of the contacts are in the sensor frame.
    """
    arms = np.array([0.0, 0.0, probe.sensor_distance]) - probe.radius * normals
    wrenches = np.concatenate([forces, np.cross(arms, forces)], axis=1)
    if table.force_errors:
        return np.einsum("kij,nj->nki", np.reshape(table.force_errors, (-1, 3, 6)), wrenches)
    spans = np.concatenate([probe.force_range, probe.torque_range])
    sigma = 0.01 * table.sigma("sensor_crosstalk_percent") * spans[:3, None] / spans
    np.fill_diagonal(sigma, 0.01 * table.sigma("sensor_gain_percent"))
    found = np.zeros((len(forces), 3, 6, 3))
    for axis in range(3):
        found[:, axis, :, axis] = sigma[axis] * wrenches
    return found.reshape(len(forces), 18, 3)


def shifts_by_force(
    probe: Probe, errors: np.ndarray, rotations: np.ndarray, forces: np.ndarray, normals: np.ndarray,
    paths: np.ndarray, left: np.ndarray | float = 1.0,
) -> np.ndarray:  # fmt: skip
    """(n, k, 3) m, shifts of contacts by errors (n, k, 3) N of the force in the sensor frame, one field for each of k.

    Parameters
    ----------
    rotations : (n, 3, 3) of the sensor in the world
    forces, normals, paths : (n, 3) N, unit and unit, zero where the sphere stands; world frame
    left : (n,) share of the normal's turn that nothing has corrected
    """
    across = forces - np.einsum("ni,ni->n", forces, paths)[:, None] * paths
    size = np.maximum(np.linalg.norm(across, axis=1), SMALLEST)
    aside = np.cross(normals, paths)
    turns = np.einsum("nij,nkj,ni->nk", rotations, errors, aside) * (left / size)[:, None]
    bends = np.einsum("nij,nkj->nki", rotations, probe.compliance * errors)
    return bends - probe.radius * turns[:, :, None] * aside[:, None]
