"""Hybrid force and velocity control of a sphere on a surface: force along the normal, speed along the tangent.

The tangent is taken as in the thesis (Rau 2017, sections 4.2.5 and 5.3.3, figure 4.8): perpendicular to the contact
normal, in the plane of the tracking frame, on the side that leads onward. The normal part is the law of `force_law`.
Its steady part integrates the force error, so that a constant error of the tangent's direction needs no steady force
error.

The probe is a stick. It is hundreds of times stiffer along its axis than across. Damping and safe speeds therefore
depend on the direction, and follow from the task's forces, stiffness and delay.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import inf, isnan, nan

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts import InputError, Task
from lwrprobe.control import contour_kernels as kernels
from lwrprobe.control.force_law import approach_speed, damping_without_overshoot, run_on

NORMALS = np.linspace(0.0, 0.5 * np.pi, 91)
"""rad from the stick's axis: normals of the surfaces that a motion may meet, in steps of one degree."""
DIRECTIONS = 200
"""Steps from across the stick to along it for which the approach speed is computed beforehand."""
FORCE_RESERVE = 0.85
"""Share of the force limit that a first touch may use, and sliding. Friction and a wall beside a foot take the rest."""
COLUMN_PLAY = 0.0005
"""m sideways by which the sphere may miss the column of its stick."""
RETURN = 2.0
"""Of the target force, that the return to a lost contact may reach. The rest is for surfaces stiffer than assumed."""
BOUNCE = 0.5
"""Share of the target force that a returning arm's mass may add: the law takes the rest as depth, and would back off
from a blow."""
STICK_SHARE = 0.75
"""Share of the speed at which the stick may be met: near the sensor nothing bends but the arm, whose stiffness varies
over the area and from joint to joint, and which gives way less to what pushes it nearer to its last axes."""
LEAST_GIVE = 0.5
"""Of the stated compliance of object and arm, that an arm leaves in its stiffest direction at least."""
BESIDE = 1.25
"""Times the wanted force, from which on what is met beside a surface counts."""
LEAST_SPARE = 0.25
"""Share of what a first touch may use, that a climb plans with at least: with a limit near the wanted force it would
come to rest."""

STEEPEST = 0.4
"""Share of a normal along the stick, at which a sphere is wedged hardest between a surface and its stick: sqrt(c / C),
C the compliance along the stick and c that with which object and stick give way to the wedge."""

Vector = tuple[float, float, float]


class ContourControl:
    """Turns contact normal and force into a velocity of the sphere.

    It is called with every sample. Numpy needs a microsecond for each operation on three numbers, so all that is done
    with each of them is in kernels.

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
    climb_speed : m/s, the same for a sphere that presses on a wall meanwhile
    held_speed : m/s, the same where its stick presses on the wall, and friction on what it meets with its flank keeps
        the sphere from giving way sideways
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.normal = np.zeros(3)
        self._steady, self._force = 0.0, nan
        lateral, _, along = task.probe.compliance.tolist()
        self._law = np.zeros(kernels.SIZE)
        self._law[[kernels.DELAY, kernels.TARGET]] = task.delay, task.force_target
        whole = task.force_limit - task.force_target
        self._law[kernels.SLACK] = max(FORCE_RESERVE * task.force_limit - task.force_target, 0.5 * whole)
        self._law[kernels.RADIUS] = task.probe.radius
        self._law[[kernels.LIMIT, kernels.THRESHOLD]] = FORCE_RESERVE * task.force_limit, task.force_threshold
        self._law[[kernels.SERIES, kernels.LATERAL, kernels.ALONG]] = 1.0 / task.stiffness, lateral, along
        (
            self._follow,
            self._perpendicular,
            self._by_direction,
            self._stiffness,
            self._outward_limit,
            self._foot_share,
        ) = _entries()
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
        # Across the stick the torque comes to its limit before the force does.
        sideways = task.torque_limit / (task.probe.sensor_distance * np.maximum(np.sin(NORMALS), 1e-9))
        spares = np.minimum(FORCE_RESERVE * task.force_limit, sideways) - task.force_threshold
        if spares.min() <= 0.0:
            least = task.force_threshold * task.probe.sensor_distance
            raise InputError("probe.torque_range", task.torque_limit, f"a share of it of more than {least:.3g} N m")
        self._reserve = spare
        pairs = list(zip(hardest.tolist(), late.tolist()))
        against = zip((hard * (spare / spares)).max(axis=1).tolist(), late.tolist())
        safe = [approach_speed(spare, k, delay, task.acceleration) for k, delay in against]
        self._safe = np.minimum(np.minimum.accumulate(safe), task.approach_speed)
        back = RETURN * task.force_target - task.force_threshold
        slow = [approach_speed(back, k, delay, task.acceleration) for k, delay in pairs]
        slow = np.minimum(slow, BOUNCE * task.force_target / np.maximum(struck, 1e-9))
        self._return = np.minimum(np.minimum.accumulate(slow), self._safe)
        (xx, xy, _), (_, yy, _), _ = task.softer.tolist()
        self._softer = xx, xy, yy  # m/N, in the plan view
        probe = task.probe
        flank = np.arcsin(np.clip((probe.stick_radius - COLUMN_PLAY) / probe.radius, 0.0, 1.0))
        limit, wall = FORCE_RESERVE * task.force_limit, task.force_target
        # Beside the wall a second contact shows once it presses as much as the wall does, and some more.
        climb = max(float(np.sqrt(max(limit**2 - wall**2, 0.0))) - BESIDE * wall, LEAST_SPARE * spare)
        climb, gives = min(climb, spare), np.cos(NORMALS) / soft
        # A contact that slopes less than the angle of friction does not slide: nothing of the stick's give is left.
        held = np.where(np.tan(NORMALS) < kernels.FRICTION, 1.0 / soft[0], gives)
        speeds = []
        for force, stiff in ((spare, gives), (climb, gives), (climb, held)):
            met = int(np.argmax(np.where(flank <= NORMALS, stiff, 0.0)))
            delay = task.delay + float(longer[met])
            speeds.append(min(approach_speed(force, float(stiff[met]), delay, task.acceleration), task.approach_speed))
        self.column_speed, self.climb_speed, self.held_speed = speeds

    def begin(self, normal: np.ndarray) -> None:
        """Track a fresh contact with this (3,) normal, of any length; the steady part starts at zero."""
        self.normal = normal / np.sqrt(normal @ normal)
        self._steady, self._force = 0.0, nan

    def tangent(self, binormal: Vector) -> Vector:
        """Unit direction onward: normal x binormal.

        With z up, a binormal of +x leads over an object in +y and up a wall that stands ahead there.
        """
        nx, ny, nz = self.normal.tolist()
        return self._perpendicular(nx, ny, nz, *binormal)

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
        last, normal = np.asarray(self.normal, dtype=np.float64), np.asarray(normal, dtype=np.float64)
        rotation = np.asarray(rotation, dtype=np.float64)
        self.normal, velocity = np.empty(3), np.empty(3)
        rise = 0.0 if isnan(self._force) else (force - self._force) / period
        self._force = force
        self._steady = self._follow(
            self._law, self._safe, last, normal, force, rise, *binormal, speed, rotation, period, self._steady,
            self.normal, velocity,
        )  # fmt: skip
        return velocity

    def approach_speed(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """m/s at which a first touch met along `direction` (unit) stays below `FORCE_RESERVE` of the force limit.

        F = F_threshold + K (v tau + v^2 / (2 a)), solved for v, with the K of whatever surface would be met hardest,
        and with a tau that the arm's mass makes longer (`force_law.run_on`); never above the task's approach speed.
        `rotation` (3, 3) is the tip's.
        """
        return self._by_direction(self._safe, float(rotation[:, 2] @ direction))

    def descent_speed(self, rotation: np.ndarray) -> float:
        """m/s down a wall in contact, towards a foot that has not been touched; `rotation` (3, 3) is the tip's."""
        along = float(rotation[2, 2])
        return self._foot_share(self._law, 0.0, abs(along)) * self._by_direction(self._safe, along)

    def wedge_speed(self, tangent: np.ndarray, rotation: np.ndarray) -> float:
        """m/s down the tracked surface along `tangent` (3,) unit, where the stick may be met from the other side.

        The sphere is then a wedge between the two: what holds it along the stick is the surface's force alone, which is
        the larger, the steeper the surface. From `STEEPEST` on, the wedge gives way sideways instead.
        """
        dive = float(rotation[:, 2] @ tangent)
        if dive <= 0.0:
            return inf
        press, law = max(-float(rotation[:, 2] @ self.normal), STEEPEST), self._law
        left = float(law[kernels.LIMIT] - BESIDE * law[kernels.TARGET] - law[kernels.THRESHOLD])
        left = max(left, LEAST_SPARE * self._reserve)
        return left * press / self._reserve * self._by_direction(self._safe, dive)

    def stick_speed(self, reach: float, along: np.ndarray | None = None, share: float = STICK_SHARE) -> float:
        """m/s across the stick at which it may be met up to `reach` m above the sphere's centre.

        The stick is a beam that is clamped at the sensor: its compliance falls with the third power of the distance
        from there (Euler and Bernoulli). The task's approach speed is never exceeded.
        `along` is the motion's unit vector (3,), of which what leads sideways counts: the arm may give way more there.
        None = any. `share` is that of the safe speed which is used.
        """
        probe, (series, lateral) = self.task.probe, self._law[[kernels.SERIES, kernels.LATERAL]].tolist()
        left = min(max(1.0 - reach / probe.sensor_distance, 0.0), 1.0)
        if along is not None:
            x, y, _ = along.tolist()
            sideways = x * x + y * y
            softer = x * (x * self._softer[0] + 2.0 * y * self._softer[1]) + y * y * self._softer[2]
            series = max(series + softer / sideways, LEAST_GIVE * series) if sideways > 1e-12 else series
        stiffness = 1.0 / (series + lateral * left**3)
        delay = self.task.delay + run_on(self.task.arm_mass, stiffness, self.task.arm_stiffness)
        safe = approach_speed(self._reserve, stiffness, delay, self.task.acceleration)
        return min(share * safe, self.task.approach_speed)

    def return_speed(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """m/s at which a contact that was just lost is sought again along `direction` (unit).

        As `approach_speed`, for `RETURN` times the target force in place of the limit: the surface is near, so that
        little time is lost. An arm with mass strikes so slowly that it does not bounce.
        """
        return self._by_direction(self._return, float(rotation[:, 2] @ direction))

    def damping(self, normal: np.ndarray, rotation: np.ndarray) -> float:
        """N s/m of the force law along a unit normal (3,), for a tip held in an orientation (3, 3)."""
        return damping_without_overshoot(self._stiffness(self._law, float(rotation[:, 2] @ normal)), self.task.delay)

    def release_velocity(self, force: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """(3,) m/s along an overlarge force (3,) N, so that the excess is gone after about one delay."""
        size = float(np.sqrt(force @ force))
        along = force / size if size > 1e-9 else self.normal
        excess = max(size - self.task.force_target, 0.0)
        speed = excess / (self._stiffness(self._law, float(rotation[:, 2] @ self.normal)) * self.task.delay)
        return along * min(speed, self._outward_limit(self._safe, float(rotation[:, 2] @ along)))


@cache
def _entries() -> tuple[Callable, ...]:
    """Machine code of what each sample needs, made before the arm moves; what is given may be a part of an array."""
    law, speeds, number, vector = np.ones(kernels.SIZE), np.zeros(1), 0.0, np.zeros(6)[::2]
    binormal, rotation, out = (number, number, number), np.eye(4)[:3, :3], np.zeros(3)
    for kernel, count in ((kernels.normal_velocity, 5), (kernels.damping_without_overshoot, 2)):
        entry(kernel, *[number] * count)  # called through `force_law`
    given = (law, speeds, vector, vector, number, number, *binormal, number, rotation, number, number)
    return (
        entry(kernels.follow, *given, out, out),
        entry(kernels.perpendicular, *[number] * 6),
        entry(kernels.by_direction, speeds, number),
        entry(kernels.stiffness, law, number),
        entry(kernels.outward_limit, speeds, number),
        entry(kernels.foot_share, law, number, number),
    )
