"""Where a reference sphere is, as an arm sees it whose tool and kinematic table are known roughly."""

from __future__ import annotations

import numpy as np

from lwrprobe_strategies.planning.sphere_touches import angle_between

SURE = 3.0
"""Standard deviations of the surface's place by which an approach begins before it."""
STEADY, TURNING = 1e-4, 7e-4
"""m, and m for each radian of a turn, by which an arm with another kinematic table sees the sphere elsewhere in another
orientation: 0.05 degrees of a wrist joint are a quarter of a millimetre. With 0.4 mm for a radian, the usual amount, an
arm with twice that at several joints met the sphere 3 mm early, at 100 mm/s."""
OFF_TOOL = 3e-4
"""m, of the probe's sphere beside where the tool has it, along each axis of the tip."""
ROUGH, PRECISE = 1e-3, 1e-4
"""m, of the sphere's place when it has been found, and of one touch."""
PRIOR = 0.02
"""m, by which the sphere may stand elsewhere than the first touch says: only steadies the fit."""


class SphereEstimate:
    """The sphere's centre and the tool's error, corrected by each touch (Kalman 1960).

    Parameters
    ----------
    centre : (3,) m, as far as known
    rotation : (3, 3), orientation of the tip in which it is seen there
    reach : m, between the centres of both spheres when they touch

    Attributes
    ----------
    centre : (3,) m, as seen in the present orientation
    """

    def __init__(self, centre: np.ndarray, rotation: np.ndarray, reach: float) -> None:
        self.centre, self._rotation, self._reach = centre, rotation, reach
        self._tool = np.zeros(3)  # m, error of the tool, in the tip's frame
        self._covariance = np.diag([ROUGH**2] * 3 + [OFF_TOOL**2] * 3)  # m^2, of centre and tool

    def fit(self, met: np.ndarray) -> None:
        """Set the centre by places of the tip (n, 3) m at which it has met the sphere (Gauss-Newton)."""
        centre = self.centre.copy()
        for _ in range(10):
            away = met - centre
            distance = np.linalg.norm(away, axis=1)
            normal = away / distance[:, None]
            left = self._reach - distance
            square = normal.T @ normal + (PRECISE / PRIOR) ** 2 * np.eye(3)
            centre = centre - np.linalg.solve(square, normal.T @ left)
        self.centre = centre

    def turn_to(self, rotation: np.ndarray) -> None:
        """In another orientation the tool's error points elsewhere, and so do those of the arm's kinematic table."""
        self.centre = self.centre + (self._rotation - rotation) @ self._tool
        moved = np.hstack([np.eye(3), self._rotation - rotation])
        self._covariance[:3] = moved @ self._covariance
        self._covariance[:, :3] = self._covariance @ moved.T
        self.doubt(STEADY + TURNING * angle_between(self._rotation, rotation))
        self._rotation = rotation.copy()

    def doubt(self, more: float = ROUGH) -> None:
        """The sphere may be seen elsewhere than before by so many metres."""
        self._covariance[:3, :3] += more**2 * np.eye(3)

    def touched(self, here: np.ndarray, normal: np.ndarray) -> None:
        """The tip has met the sphere at a place (3,), along a normal (3,): correct sphere and tool."""
        across = self._covariance[:, :3] @ normal
        gain = across / (normal @ across[:3] + PRECISE**2)
        change = gain * float((here - self.centre) @ normal - self._reach)
        self.centre, self._tool = self.centre + change[:3], self._tool + change[3:]
        self._covariance = self._covariance - np.outer(gain, across)

    def uncertainty(self, normal: np.ndarray) -> float:
        """m before or behind where the surface is expected along a normal (3,), within which it surely is."""
        return float(SURE * np.sqrt(normal @ self._covariance[:3, :3] @ normal + PRECISE**2))
