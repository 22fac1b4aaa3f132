"""The vector of unknowns: names, places, priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.calibration.priors import Priors
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector


@dataclass(slots=True, frozen=True)
class Parameters:
    """Where each unknown lies in the vector, and what is known of it beforehand.

    Attributes
    ----------
    slices : name to its part of the vector, in this order:
        tool (3,) m, the sphere's centre against where the scene has it, tip frame axes;
        centre (3 p,) m, of the reference sphere at each of p places, world;
        radius (1,) m, of the probe's sphere;
        stick (2,), logarithm of the compliance across and along the stick over the scene's;
        arm (n,), logarithm of each joint's compliance over the prior's;
        surface (2,) m/N, compliance of the reference sphere and of the table at the contact;
        damping (1,) m s/N, by which a surface yields late;
        clock (1,) s, by which the sensor's time stamps are ahead of the arm's clock;
        play (1,), width of the joints' play over the prior's;
        hysteresis (1,), width of the sensor's hysteresis over the prior's;
        dh (4 n,) m, rad, m, rad: a, alpha, d, theta against the robot's table, quantity by quantity;
        ripple (2 n,) rad, sine and cosine of the wave of each joint's gear;
        sensor (36,), the reading for a wrench of one unit less the identity, row by row;
        table (3,) m and slopes, height of the table at the world's origin and its rise along x and y
    mean, sigma : (m,) the prior
    """

    slices: dict[str, slice]
    mean: Vector
    sigma: Vector

    def __len__(self) -> int:
        return len(self.mean)

    @classmethod
    def of(
        cls, joints: int, probe: Probe, centres: np.ndarray, table: float, gaps: Vector, priors: Priors
    ) -> Parameters:
        """The unknowns of an arm with so many joints and a probe.

        `centres` (p, 3) m and `table` m are first guesses of the reference sphere's places and the table's height,
        `gaps` (6,) N and N m the ends of the sensor's range.
        """
        p = priors
        blocks: list[tuple[str, Vector, Vector]] = [
            ("tool", np.zeros(3), np.array([p.sphere_off_axis, p.sphere_off_axis, p.probe_length])),
            ("centre", centres.ravel(), np.full(centres.size, p.sphere_place)),
            ("radius", np.array([probe.radius]), np.array([p.sphere_radius])),
            ("stick", np.zeros(2), np.full(2, p.stick_stiffness)),
            ("arm", np.zeros(joints), np.full(joints, p.joint_stiffness)),
            ("surface", np.zeros(2), np.full(2, p.surface_compliance)),
            ("damping", np.zeros(1), np.array([p.damping_time * p.surface_compliance])),
            ("clock", np.zeros(1), np.array([p.clock_offset])),
            ("play", np.zeros(1), np.ones(1)),
            ("hysteresis", np.zeros(1), np.ones(1)),
            ("dh", np.zeros(4 * joints), np.repeat([p.dh_length, p.dh_angle, p.dh_length, p.dh_angle], joints)),
            ("ripple", np.zeros(2 * joints), np.full(2 * joints, p.gear_ripple)),
            ("sensor", np.zeros(36), sensor_prior(gaps, p).ravel()),
            ("table", np.array([table, 0.0, 0.0]), np.array([p.table_height, p.table_tilt, p.table_tilt])),
        ]
        slices, begin = {}, 0
        for name, mean, _ in blocks:
            slices[name] = slice(begin, begin + len(mean))
            begin += len(mean)
        return cls(slices, np.concatenate([b[1] for b in blocks]), np.concatenate([b[2] for b in blocks]))


def sensor_prior(gaps: Vector, priors: Priors) -> np.ndarray:
    """(6, 6) standard deviations of the sensor's matrix.

    Torque is meant about the point straight behind the sphere's centre at the scene's sensor distance. How far the
    sensor's origin lies from there is a part of the matrix, and cannot be distinguished from crosstalk.
    """
    sigma = priors.sensor_crosstalk * gaps[:, None] / gaps
    np.fill_diagonal(sigma, priors.sensor_gain)
    lever = np.zeros((3, 3))
    lever[0, 2] = lever[1, 2] = lever[2, 0] = lever[2, 1] = priors.sphere_off_axis
    lever[0, 1] = lever[1, 0] = priors.probe_length
    sigma[3:, :3] = np.hypot(sigma[3:, :3], lever)
    return sigma
