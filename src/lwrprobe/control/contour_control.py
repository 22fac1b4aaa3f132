"""Hybrid force and velocity control of a sphere on a surface: force along the normal, speed along the tangent.

The tangent is taken as in the source (Rau 2017, sections 4.2.5 and 5.3.3, figure 4.8): perpendicular to the contact
normal, in the plane of the tracking frame, on the side that leads onward. The normal part is the law of `force_law`.
Its steady part integrates the force error, so that a constant error of the tangent's direction needs no steady force
error.

The probe is a stick. It is hundreds of times stiffer along its axis than across. Damping and safe speeds therefore
depend on the direction, and follow from the task's forces, stiffness and delay.
"""

from __future__ import annotations

from math import acos, cos, e, sin, sqrt

import numpy as np

from lwrprobe.contracts import InputError, Task
from lwrprobe.control.force_law import approach_speed, damping_without_overshoot, normal_velocity, run_on

MAX_INWARD = 0.01
"""m/s towards the surface. More would only deepen a contact that is about to return."""
MAX_OUTWARD = 0.05
"""m/s away from the surface: what the arm follows within one delay."""
NORMAL_MEMORY = 0.5
"""Share of the last normal in the tracked one: halves the noise, costs one sample of delay."""
NEW_NORMAL = 1.0 - NORMAL_MEMORY
"""Share of the new one."""
MIN_NORMAL = 0.1
"""Length of the mean of two normals below which they oppose each other, and the new one counts alone."""
RESET_TIME = 8.0
"""Integral time of the steady part in units of the delay: slow enough not to disturb the stability of the law."""
MAX_STEADY = 0.5
"""Share of the inward speed, and of the sliding speed, that the steady part may reach: a tangent 27 degrees off."""
TURN = 0.08
"""rad by which the surface may turn within one delay: a sliding speed of F_target / (K tau TURN) keeps the contact."""
MIN_SLIDING = 0.1
"""Share of the sliding speed that remains however large the force error is, so that a corner is left."""
CONE = 0.35
"""rad by which the normal may turn towards the stick before the law knows; the stiffest direction in it counts."""
NORMALS = np.linspace(0.0, 0.5 * np.pi, 91)
"""rad from the stick's axis: normals of the surfaces that a motion may meet, in steps of one degree."""
DIRECTIONS = 200
"""Steps from across the stick to along it for which the approach speed is computed beforehand."""
FORCE_RESERVE = 0.85
"""Share of the force limit that a first touch may use. Friction and a wall beside a foot take the rest."""
COLUMN_PLAY = 0.0005
"""m sideways by which the sphere may miss the column of its stick."""
RETURN = 2.0
"""Of the target force, that the return to a lost contact may reach. The rest is for surfaces stiffer than assumed."""
BOUNCE = 0.5
"""Share of the target force that a returning arm's mass may add: the law takes the rest as depth, and would back off
from a blow."""
STICK_SHARE = 0.6
"""Share of the speed at which the stick may be met: near the sensor nothing bends but the arm, which is stiffer in some
directions than in others."""
FRICTION = 0.3
"""Of a wall under the sphere, whose share of the wanted force adds to what a foot presses with."""
DIVE = 0.3
"""Share of the sliding speed along the stick, towards its tip, from which on sliding is also an approach."""

Vector = tuple[float, float, float]


class ContourControl:
    """Turns contact normal and force into a velocity of the sphere.

    It is called with every sample. Numpy needs a microsecond for each operation on three numbers, so vectors are
    computed by component.

    Parameters
    ----------
    task : forces, stiffness, delay, probe and speeds

    Raises
    ------
    InputError : no force left between the threshold of a contact and the force limit

    Attributes
    ----------
    normal : (3,) unit, world frame, the tracked normal of the surface; zero before the first contact
    column_speed : m/s along the stick, where the stick has been and the sphere has not: what stands there is met with
        the sphere's flank
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.normal = np.zeros(3)
        self._steady = 0.0
        lateral, _, along = task.probe.compliance.tolist()
        self._compliance = 1.0 / task.stiffness, lateral, along
        self._delay, self._target, self._slack = task.delay, task.force_target, task.force_limit - task.force_target
        give = np.sin(NORMALS) ** 2 * lateral + np.cos(NORMALS) ** 2 * along
        # The largest K(n) (d n) over the normals n of a surface that a motion along d may meet. It grows with the share
        # of d along the stick, so that the end of each step counts.
        axial = np.arccos(np.linspace(0.0, 1.0, DIRECTIONS + 1))
        soft = 1.0 / task.stiffness + give
        hard = np.cos(axial[:, None] - NORMALS) / soft
        hardest = hard.max(axis=1)
        # A moving mass presses along each normal with its part of the speed, as a longer delay would.
        longer = np.array([run_on(task.arm_mass, k, task.arm_stiffness) for k in (1.0 / soft).tolist()])
        struck = (hard * longer).max(axis=1)
        late = task.delay + struck / hardest
        spare = FORCE_RESERVE * task.force_limit - task.force_threshold
        if spare <= 0.0:
            raise InputError("contact.limit", task.force_limit, f"more than {task.force_threshold / FORCE_RESERVE:g} N")
        self._reserve = spare
        # At a foot the sphere still slides down the wall, whose friction adds to what the foot presses with.
        self._foot_share = max(spare - FRICTION * task.force_target, 0.0) / spare
        pairs = list(zip(hardest.tolist(), late.tolist()))
        safe = [approach_speed(spare, k, delay, task.acceleration) for k, delay in pairs]
        self._safe = np.minimum(np.minimum.accumulate(safe), task.approach_speed).tolist()
        back = RETURN * task.force_target - task.force_threshold
        slow = [approach_speed(back, k, delay, task.acceleration) for k, delay in pairs]
        slow = np.minimum(slow, BOUNCE * task.force_target / np.maximum(struck, 1e-9))
        self._return = np.minimum(np.minimum.accumulate(slow), self._safe).tolist()
        probe = task.probe
        flank = np.arcsin(np.clip((probe.stick_radius - COLUMN_PLAY) / probe.radius, 0.0, 1.0))
        beside = (np.cos(NORMALS) / soft)[flank <= NORMALS]
        met = int(np.argmax(beside))
        delay = task.delay + float(longer[flank <= NORMALS][met])
        self.column_speed = min(
            approach_speed(spare, float(beside[met]), delay, task.acceleration), task.approach_speed
        )

    def begin(self, normal: np.ndarray) -> None:
        """Track a fresh contact with this (3,) normal, of any length; the steady part starts at zero."""
        self.normal = normal / np.sqrt(normal @ normal)
        self._steady = 0.0

    def tangent(self, binormal: Vector) -> Vector:
        """Unit direction onward: normal x binormal.

        With z up, a binormal of +x leads over an object in +y and up a wall that stands ahead there.
        """
        nx, ny, nz = self.normal.tolist()
        return _perpendicular(nx, ny, nz, *binormal)

    def velocity(
        self,
        normal: np.ndarray,
        force: float,
        binormal: Vector,
        speed: float,
        rotation: np.ndarray,
        period: float,
    ) -> np.ndarray:
        """(3,) m/s in the world frame for the next `period` s.

        Parameters
        ----------
        normal : (3,) unit, the surface's at this sample
        force : N, the acting force's component along the normal
        binormal : unit, perpendicular to the plane of the contour, signed as in `tangent`
        speed : m/s, wanted along the tangent
        rotation : (3, 3) of the tip
        """
        (mx, my, mz), (nx, ny, nz) = self.normal.tolist(), normal.tolist()
        bx = NORMAL_MEMORY * mx + NEW_NORMAL * nx
        by = NORMAL_MEMORY * my + NEW_NORMAL * ny
        bz = NORMAL_MEMORY * mz + NEW_NORMAL * nz
        size = sqrt(bx * bx + by * by + bz * bz)
        if size > MIN_NORMAL:
            nx, ny, nz = bx / size, by / size, bz / size
        self.normal = np.array((nx, ny, nz))
        ax, ay, az = rotation[:, 2].tolist()
        axial = nx * ax + ny * ay + nz * az
        delay, target = self._delay, self._target
        damping = damping_without_overshoot(self._stiffness(axial), delay)
        error = force - target
        inward = min(_by_direction(self._safe, axial), MAX_INWARD)
        steady = self._steady + error * period / (damping * RESET_TIME * delay)
        self._steady = min(max(steady, -MAX_STEADY * inward), MAX_STEADY * speed)
        press = normal_velocity(error, damping, self._steady, inward, MAX_OUTWARD)
        tx, ty, tz = _perpendicular(nx, ny, nz, *binormal)
        slide, dive = speed, tx * ax + ty * ay + tz * az
        if dive > DIVE:  # down a wall towards a foot that has not been touched yet, stick first
            slide = min(slide, self._foot_share * _by_direction(self._safe, dive))
        slide = min(slide, target / (damping / e * TURN))
        slide *= min(max(1.0 - abs(error) / self._slack, MIN_SLIDING), 1.0)
        return np.array((slide * tx + press * nx, slide * ty + press * ny, slide * tz + press * nz))

    def approach_speed(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """m/s at which a first touch met along `direction` (unit) stays below `FORCE_RESERVE` of the force limit.

        F = F_threshold + K (v tau + v^2 / (2 a)), solved for v, with the K of whatever surface would be met hardest,
        and with a tau that the arm's mass makes longer (`force_law.run_on`); never above the task's approach speed.
        `rotation` (3, 3) is the tip's.
        """
        return _by_direction(self._safe, float(rotation[:, 2] @ direction))

    def stick_speed(self, reach: float, share: float = STICK_SHARE) -> float:
        """m/s across the stick at which it may be met up to `reach` m above the sphere's centre.

        The stick is a beam that is clamped at the sensor: its compliance falls with the third power of the distance
        from there (Euler and Bernoulli). The task's approach speed is never exceeded.
        `share` is that of the safe speed which is used.
        """
        probe, (series, lateral, _) = self.task.probe, self._compliance
        left = min(max(1.0 - reach / probe.sensor_distance, 0.0), 1.0)
        stiffness = 1.0 / (series + lateral * left**3)
        delay = self.task.delay + run_on(self.task.arm_mass, stiffness, self.task.arm_stiffness)
        safe = approach_speed(self._reserve, stiffness, delay, self.task.acceleration)
        return min(share * safe, self.task.approach_speed)

    def return_speed(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """m/s at which a contact that was just lost is sought again along `direction` (unit).

        As `approach_speed`, for `RETURN` times the target force in place of the limit: the surface is near, so that
        little time is lost. An arm with mass strikes so slowly that it does not bounce.
        """
        axial = float(rotation[:, 2] @ direction)
        return _by_direction(self._return, axial)

    def damping(self, normal: np.ndarray, rotation: np.ndarray) -> float:
        """N s/m of the force law along a unit normal (3,), for a tip held in an orientation (3, 3)."""
        return damping_without_overshoot(self._stiffness(float(rotation[:, 2] @ normal)), self.task.delay)

    def release_velocity(self, force: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """(3,) m/s along an overlarge force (3,) N, so that the excess is gone after about one delay."""
        size = float(np.sqrt(force @ force))
        along = force / size if size > 1e-9 else self.normal
        excess = max(size - self.task.force_target, 0.0)
        speed = excess / (self._stiffness(float(rotation[:, 2] @ self.normal)) * self.task.delay)
        return along * min(speed, MAX_OUTWARD)

    def _stiffness(self, axial: float) -> float:
        """N/m of object, arm and probe in series, by the share of the normal along the stick."""
        angle = max(acos(min(abs(axial), 1.0)) - CONE, 0.0)
        series, lateral, along = self._compliance
        return 1.0 / (series + sin(angle) ** 2 * lateral + cos(angle) ** 2 * along)


def _by_direction(speeds: list[float], axial: float) -> float:
    """Of the `DIRECTIONS + 1` speeds, the one for a direction with this share along the stick."""
    return speeds[min(int(abs(axial) * DIRECTIONS) + 1, DIRECTIONS)]


def _perpendicular(nx: float, ny: float, nz: float, ax: float, ay: float, az: float) -> Vector:
    """Unit vector along n x a, zero where they are parallel."""
    x, y, z = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    size = sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-6 else (0.0, 0.0, 0.0)
