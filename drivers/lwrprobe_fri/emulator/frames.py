"""Tool frame and Jacobian of the LWR 4+, for the fields of the measurement that carry them."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

SHOULDER, UPPER_ARM, FOREARM, FLANGE = 0.31, 0.40, 0.39, 0.078
_TWISTS = (pi / 2, -pi / 2, -pi / 2, pi / 2, pi / 2, -pi / 2, 0.0)
_OFFSETS = (SHOULDER, 0.0, UPPER_ARM, 0.0, FOREARM, 0.0, FLANGE)


def frame_and_jacobian(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3, 4) frame of the flange over the mounting plane [m] and (6, 7) Jacobian, rows X Y Z RZ RY RX.

    Standard DH table of the arm (Gaz, Flacco, De Luca 2014); every joint turns about the z axis of the frame
    before it.
    """
    frame = np.eye(4)
    axes, origins = np.empty((7, 3)), np.empty((7, 3))
    for i in range(7):
        axes[i], origins[i] = frame[:3, 2], frame[:3, 3]
        frame = frame @ _link(joints[i], _TWISTS[i], _OFFSETS[i])
    jacobian = np.empty((6, 7))
    jacobian[:3] = np.cross(axes, frame[:3, 3] - origins).T
    jacobian[3:] = axes.T[::-1]
    return frame[:3], jacobian


def _link(theta: float, twist: float, offset: float) -> np.ndarray:
    c, s, ca, sa = cos(theta), sin(theta), cos(twist), sin(twist)
    return np.array([[c, -s * ca, s * sa, 0.0], [s, c * ca, -c * sa, 0.0], [0.0, sa, ca, offset], [0.0, 0.0, 0.0, 1.0]])
