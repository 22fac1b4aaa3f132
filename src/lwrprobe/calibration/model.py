"""The model of all touches: from the unknowns to residuals of place and torque, each divided by what it may be off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lwrprobe.calibration.parameters import Parameters
from lwrprobe.calibration.priors import Priors
from lwrprobe.calibration.sensor_play import directions, held_back
from lwrprobe.calibration.touches import Touch
from lwrprobe.contact import Payload
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.kinematics import Robot

_PLACE_NOISE = 8e-6
"""m, of one sample against the others of its touch: four times what the noise of a force makes of the stick's bending.
The noise is in the force that predicts the place. Stated as small as it is, the solver would choose the matrix of the
sensor that makes it smaller, and the stick would seem stiffer by its share.
"""
_TURN_SHARE = 0.3
"""Share of the sensor's hysteresis that its model leaves between rise and fall."""
_GROWTH = 0.1
"""Share of the sensor's hysteresis by which it grows along a rise beside its model. Force and torque of one sensor lag
alike, so that less is left of their ratio than of either. Stated much larger than it is, the prior would count: found
ratios would lie between what was read and what the scene states.
"""
_BENT = 0.1
"""Share of the slope of a gear's wave that its model leaves."""
_TURNS_BACK = 0.2
"""Share of the sensor's hysteresis that is taken for noise of a single sample."""
_MIN_RISE = 0.1
"""N, of a touch's force, for its softness."""
_STEP = 1e-6
"""rad and m, by which a parameter of the kinematic table is moved for its derivative."""
_DH = ("a", "alpha", "d", "theta")


@dataclass(slots=True)
class _Rows:
    """What each of N samples contributes, computed once.

    Beginning and step [s] of the times at which path (N, K, 3) m holds where the tip was around the sample; jacobian
    (N, 3, n); by_dh (N, 3, 4 n); by_ripple (N, 3, 2 n); rotation (N, 3, 3); reading (N, 6); rate (N, 3) N/s of the
    force, sensor frame; play (N, 3) m, shift of the tip by a play of the prior's width; lag (N, 6) N and N m, by which
    a hysteresis of the prior's width lets the reading stay behind, and the zero that was taken before the touch; touch
    (N,) index; place (N,); on_table (N,) bool.
    """

    times: Vector
    path_begin: Vector
    path_step: Vector
    path: np.ndarray
    jacobian: np.ndarray
    by_dh: np.ndarray
    by_ripple: np.ndarray
    rotation: np.ndarray
    reading: np.ndarray
    rate: np.ndarray
    play: np.ndarray
    lag: np.ndarray
    touch: np.ndarray
    place: np.ndarray
    on_table: np.ndarray


@dataclass(slots=True)
class _State:
    """What follows from the unknowns for each of N samples: the tip, its load, and the surface that it touches."""

    centre: np.ndarray
    wrench: np.ndarray
    matrix: np.ndarray
    velocity: np.ndarray
    bend: np.ndarray
    turned: np.ndarray
    normal: np.ndarray
    inward: np.ndarray
    distance: Vector
    load: Vector
    rate: Vector
    lever: np.ndarray


class Model:
    """Residuals of a set of touches.

    Two conditions hold at each sample. The sphere's centre, moved by stick and arm, is as far from the reference
    sphere's centre as the sum of the radii less the indentation (above the table accordingly): one number. And the
    torque is that of the force at the contact, `t = (l + d - r u) x f` with l the sphere's centre in the sensor
    frame, d the bending of the stick and u the surface's normal: three numbers. The friction does not matter to
    either, because the force is the measured one.

    Parameters
    ----------
    robot : the arm as the scene states it, with base and tool
    probe : as the scene states it
    touches : measured
    reference_radius : m, of the reference sphere
    parameters : the unknowns
    priors : standard deviations of what is not solved for (gears, zero, noise)
    """

    def __init__(
        self,
        robot: Robot,
        probe: Probe,
        touches: list[Touch],
        reference_radius: float,
        parameters: Parameters,
        priors: Priors,
    ) -> None:
        self.parameters, self.priors = parameters, priors
        self._robot, self._probe, self._reference = robot, probe, reference_radius
        gaps = np.concatenate([probe.force_range, probe.torque_range])
        self.rows = _rows(robot, probe, touches, gaps, priors)
        self._lever = np.array([0.0, 0.0, probe.sensor_distance])
        self.touches = len(touches)
        self._of_touch = [np.flatnonzero(self.rows.touch == k) for k in range(self.touches)]
        # Torques while the force rises alone: then each axis of the sensor lags behind by the same all the while.
        self._rising = [mine[touch.rising] for mine, touch in zip(self._of_touch, touches)]
        self._whiten_torque = [self._torque_whitening(mine) for mine in self._rising]
        self._up = np.concatenate([touch.rising for touch in touches])
        self._turn_error = _TURN_SHARE * priors.hysteresis * probe.force_range[0] * probe.compliance.max()
        self.place_error = 0.0
        self.set_place_error(1e-5)

    def set_place_error(self, sigma: float) -> None:
        """State by how much [m] a touch as a whole may be off: what the gears do beside the kinematic table."""
        self.place_error = sigma
        scale = self.priors.gear_ripple * self.priors.gear_waves
        self._whiten_place = []
        for mine in self._of_touch:
            travel = self.rows.path[mine, self.rows.path.shape[1] // 2]
            travel = np.linalg.norm(travel - travel.mean(axis=0), axis=1) * np.sign(
                (travel - travel.mean(axis=0)) @ (travel[-1] - travel[0])
            )
            # What is left of a gear's wave bends the path: a share of the path.
            bend = _BENT * scale * travel
            # What the play of joints and sensor leaves, in and out.
            side = np.where(self._up[mine], 1.0, -1.0)
            # The zero may have been taken anywhere in the hysteresis: a force that is off bends the stick.
            size = np.linalg.norm(self.rows.reading[mine, :3], axis=1)
            soft = np.ptp(travel) / max(np.ptp(size), _MIN_RISE)
            zero = 0.5 * self.priors.hysteresis * self._probe.force_range[0] * soft
            cover = _PLACE_NOISE**2 * np.eye(len(mine)) + sigma**2 + zero**2 + np.outer(bend, bend)
            cover += self._turn_error**2 * np.outer(side, side)
            self._whiten_place.append(np.linalg.inv(np.linalg.cholesky(cover)))

    def _torque_whitening(self, mine: np.ndarray) -> np.ndarray:
        """(m, m) for the torques of one touch.

        A zero that is off shifts all of them, and is left out. A hysteresis that is not the one modelled grows along
        the touch, as the torque itself does.
        """
        p, reach = self.priors, self._lever[2]
        noise = np.hypot(p.noise_torque, p.noise_force * reach)
        wander = np.hypot(p.zero_torque, p.zero_force * reach)
        width = p.hysteresis * np.hypot(self._probe.torque_range[0], self._probe.force_range[0] * reach)
        size = np.linalg.norm(self.rows.reading[mine, :3], axis=1)
        share = size / size.max()
        # An axis with little load turns back within the hysteresis, at any sample: a part of it counts as noise.
        cover = (noise**2 + wander**2 + (_TURNS_BACK * width) ** 2) * np.eye(len(mine)) + (4.0 * width) ** 2
        cover += np.outer(share, share) * (_GROWTH * width) ** 2
        return np.linalg.inv(np.linalg.cholesky(cover))

    def _state(self, x: Vector) -> _State:
        rows, at = self.rows, self.parameters.slices
        share = (rows.times - x[at["clock"]][0] - rows.path_begin) / rows.path_step
        cell = np.clip(share.astype(int), 0, rows.path.shape[1] - 2)
        share = (share - cell)[:, None]
        index = np.arange(len(cell))
        early, late = rows.path[index, cell], rows.path[index, cell + 1]
        matrix = np.linalg.inv(np.eye(6) + x[at["sensor"]].reshape(6, 6))
        wrench = (rows.reading + x[at["hysteresis"]][0] * rows.lag) @ matrix.T
        force = wrench[:, :3]
        across, along = np.exp(x[at["stick"]])
        bend = self._probe.compliance * np.array([across, across, along]) * force
        load = np.einsum("nij,nj->ni", rows.rotation, force)
        turned = np.einsum("nij,ni->nj", rows.jacobian, load)
        turned *= self.priors.joint_compliance * np.exp(x[at["arm"]])
        centre = (1.0 - share) * early + share * late
        centre += np.einsum("nij,nj->ni", rows.rotation, x[at["tool"]] + bend)
        centre += np.einsum("nij,nj->ni", rows.jacobian, turned)
        centre += rows.by_dh @ x[at["dh"]] + rows.by_ripple @ x[at["ripple"]] + x[at["play"]][0] * rows.play
        away = centre - x[at["centre"]].reshape(-1, 3)[rows.place]
        distance = np.linalg.norm(away, axis=1)
        height, *slope = x[at["table"]]
        up = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
        on_table = rows.on_table
        normal = np.where(on_table[:, None], up, away / distance[:, None])
        distance = np.where(on_table, centre @ up - height * up[2], distance - self._reference)
        inward = np.einsum("nji,nj->ni", rows.rotation, normal)
        return _State(
            centre=centre,
            wrench=wrench,
            matrix=matrix,
            velocity=(late - early) / rows.path_step[:, None],
            bend=bend,
            turned=turned,
            normal=normal,
            inward=inward,
            distance=distance,
            load=np.einsum("ni,ni->n", force, inward),
            rate=np.einsum("ni,ni->n", rows.rate, inward),
            # The stated radius: what the torque shows of it is less than what the sensor's hysteresis hides.
            lever=self._lever + bend - self._probe.radius * inward,
        )

    def raw(self, x: Vector) -> tuple[Vector, np.ndarray]:
        """(N,) m and (N, 3) N m: residuals of place and torque, not divided by anything."""
        return self._raw(x, self._state(x))

    def _raw(self, x: Vector, state: _State) -> tuple[Vector, np.ndarray]:
        at = self.parameters.slices
        sphere, table = x[at["surface"]]
        surface = np.where(self.rows.on_table, table, sphere)
        gap = state.distance - x[at["radius"]][0] + surface * state.load - x[at["damping"]][0] * state.rate
        own, cross = self._through_sensor(x, state)
        return gap, self.rows.reading[:, 3:] - np.einsum("nij,nj->ni", own @ cross, self.rows.reading[:, :3])

    def _through_sensor(self, x: Vector, state: _State) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3, 3) twice: torque that a unit force at the contact reads, and the force that a unit reading stands for.

        The torque is predicted from the force's reading alone. Were both corrected and compared, a matrix that makes
        the noise of the force smaller would seem the better one.
        """
        matrix = np.eye(6) + x[self.parameters.slices["sensor"]].reshape(6, 6)
        turn = cross_matrices(state.lever)
        return matrix[3:, :3] + matrix[3:, 3:] @ turn, np.linalg.inv(matrix[:3, :3] + matrix[:3, 3:] @ turn)

    def residuals(self, x: Vector) -> Vector:
        """All residuals over their standard deviations: places, torques, and the prior."""
        gap, torque = self.raw(x)
        return np.concatenate([*self._whitened(gap, torque), (x - self.parameters.mean) / self.parameters.sigma])

    def jacobian(self, x: Vector) -> np.ndarray:
        """Derivative of `residuals` by x.

        The torque's change by a turn of the normal is left out: it is the sphere's radius over the lever of a change
        that is small itself.
        """
        rows, at, state = self.rows, self.parameters.slices, self._state(x)
        count, size = len(rows.times), len(self.parameters)
        gap, torque = np.zeros((count, size)), np.zeros((count, 3, size))
        normal, ball = state.normal, ~rows.on_table
        for place, begin in enumerate(range(at["centre"].start, at["centre"].stop, 3)):
            mine = ball & (rows.place == place)
            gap[mine, begin : begin + 3] = -normal[mine]
        gap[:, at["tool"]] = state.inward
        gap[:, at["radius"]] = -1.0
        bent = state.inward * state.bend
        gap[:, at["stick"].start], gap[:, at["stick"].start + 1] = bent[:, 0] + bent[:, 1], bent[:, 2]
        own, cross = self._through_sensor(x, state)
        force = np.einsum("nij,nj->ni", cross, rows.reading[:, :3])
        through, true = own @ cross, np.hstack([force, np.cross(state.lever, force)])
        for k, part in enumerate((np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))):
            torque[:, :, at["stick"].start + k] = -np.cross(state.bend * part, force)
        gap[:, at["arm"]] = np.einsum("nij,ni->nj", rows.jacobian, normal) * state.turned
        gap[:, at["surface"].start], gap[:, at["surface"].start + 1] = state.load * ball, state.load * ~ball
        gap[:, at["damping"].start] = -state.rate
        gap[:, at["clock"].start] = -np.einsum("ni,ni->n", normal, state.velocity)
        gap[:, at["play"].start] = np.einsum("ni,ni->n", normal, rows.play)
        gap[:, at["dh"]] = np.einsum("ni,nij->nj", normal, rows.by_dh)
        gap[:, at["ripple"]] = np.einsum("ni,nij->nj", normal, rows.by_ripple)
        table = ~ball
        place = state.centre[table]
        gap[table, at["table"].start] = -normal[table, 2]
        gap[table, at["table"].start + 1] = -place[:, 0] * normal[table, 2]
        gap[table, at["table"].start + 2] = -place[:, 1] * normal[table, 2]
        by_wrench = self._gap_by_force(x, state)
        by_reading = (rows.lag @ state.matrix.T)[:, :3]
        gap[:, at["hysteresis"].start] = np.einsum("ni,ni->n", by_wrench, by_reading)
        for i in range(6):
            column = state.matrix[:, i]
            by_gap = -by_wrench @ column[:3]
            by_torque = through[:, :, i] if i < 3 else np.tile(-np.eye(3)[i - 3], (count, 1))
            for j in range(6):
                where = at["sensor"].start + 6 * i + j
                gap[:, where] = by_gap * state.wrench[:, j]
                torque[:, :, where] = by_torque * true[:, j : j + 1]
        return np.vstack([*self._whitened(gap, torque), np.diag(1.0 / self.parameters.sigma)])

    def by_shift(self, x: Vector, since: int) -> np.ndarray:
        """(r, 3): derivative of `residuals` by a shift [m] of the reference sphere from touch `since` on."""
        gap = self._shifted(self._state(x), since)
        return np.vstack([*self._whitened(gap, np.zeros((len(gap), 3, 3))), np.zeros((len(x), 3))])

    def _shifted(self, state: _State, since: int) -> np.ndarray:
        """(N, 3): derivative of the residuals of place by that shift."""
        mine = ~self.rows.on_table & (self.rows.touch >= since)
        return np.where(mine[:, None], -state.normal, 0.0)

    def _gap_by_force(self, x: Vector, state: _State) -> np.ndarray:
        """(N, 3) m/N, sensor frame: how the residual of place changes with the force."""
        rows, at = self.rows, self.parameters.slices
        across, along = np.exp(x[at["stick"]])
        soft = self._probe.compliance * np.array([across, across, along])
        joint = self.priors.joint_compliance * np.exp(x[at["arm"]])
        pressed = np.einsum("nij,ni->nj", rows.jacobian, state.normal) * joint
        arm = np.einsum("nij,nj->ni", rows.jacobian, pressed)
        sphere, table = x[at["surface"]]
        surface = np.where(rows.on_table, table, sphere)[:, None]
        return soft * state.inward + np.einsum("nji,nj->ni", rows.rotation, arm) + surface * state.inward

    def _whitened(self, gap: np.ndarray, torque: np.ndarray) -> list[np.ndarray]:
        """Places (N, ...) and torques (N, 3, ...) touch by touch over their standard deviations."""
        rest = gap.shape[1:]
        places = [whiten @ gap[mine] for whiten, mine in zip(self._whiten_place, self._of_touch)]
        torques = [
            np.tensordot(whiten, torque[mine], 1).reshape(-1, *rest)
            for whiten, mine in zip(self._whiten_torque, self._rising)
        ]
        return places + torques

    def per_touch(self, x: Vector, shift: Vector | None = None, since: int = 0) -> Vector:
        """(t,) m, mean residual of place of each touch; with the sphere shifted by (3,) m from touch `since` on."""
        state = self._state(x)
        gap, _ = self._raw(x, state)
        if shift is not None:
            gap = gap + self._shifted(state, since) @ shift
        return np.array([gap[mine].mean() for mine in self._of_touch])


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) of vectors (N, 3): matrix times b is their cross product with b."""
    out = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    return out - out.transpose(0, 2, 1)


def _rows(robot: Robot, probe: Probe, touches: list[Touch], gaps: Vector, priors: Priors) -> _Rows:
    parts: list[_Rows] = []
    half_play, payload = 0.5 * priors.hysteresis * gaps, Payload.of(probe)
    noise = np.repeat([priors.noise_force, priors.noise_torque], 3)
    # As the probe is held in the touch: before it, it may still have turned.
    joints = np.array([_joints_at(touch, touch.times[:1])[0] for touch in touches])
    weights = [payload.weight(rotation) for rotation in robot.fk_batch(joints)[:, :3, :3]]
    held = held_back([touch.wrenches for touch in touches], weights, half_play)
    for index, (touch, stuck) in enumerate(zip(touches, held)):
        count = len(touch.times)
        joints = _joints_at(touch, touch.times)
        poses = robot.fk_batch(joints)
        step, half = 1e-3, 40
        grid = touch.times[:, None] + step * np.arange(-half, half + 1)
        around = _joints_at(touch, grid.ravel())
        jacobian = robot.jacobian_batch(joints)[:, :3]
        played = _play(touch.arm_joints, priors.joint_hysteresis)
        played = np.column_stack([np.interp(touch.times, touch.arm_times, p) for p in played.T])
        lag = half_play * (directions(touch.wrenches, -stuck, noise) + stuck)
        rate = np.gradient(touch.wrenches[:, :3], touch.times, axis=0)
        parts.append(
            _Rows(
                times=touch.times,
                path_begin=grid[:, 0],
                path_step=np.full(count, step),
                path=robot.fk_batch(around)[:, :3, 3].reshape(count, 2 * half + 1, 3),
                jacobian=jacobian,
                by_dh=derivatives_by_table(robot, joints, poses),
                by_ripple=np.concatenate(
                    [
                        jacobian * np.sin(priors.gear_waves * joints)[:, None],
                        jacobian * np.cos(priors.gear_waves * joints)[:, None],
                    ],
                    axis=2,
                ),
                rotation=poses[:, :3, :3],
                reading=touch.wrenches,
                rate=rate,
                lag=lag,
                play=np.einsum("nij,nj->ni", jacobian, played),
                touch=np.full(count, index),
                place=np.full(count, touch.place),
                on_table=np.full(count, touch.target == "table"),
            )
        )
    names = _Rows.__dataclass_fields__
    return _Rows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _joints_at(touch: Touch, times: Vector) -> np.ndarray:
    """(m, n) rad at times (m,) s of the sensor's clock."""
    return np.column_stack([np.interp(times, touch.arm_times, q) for q in touch.arm_joints.T])


def derivatives_by_table(robot: Robot, joints: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(N, 3, 4 n): the tip's derivative by a, alpha, d and theta of each joint, in either convention."""
    columns = []
    for name in _DH:
        for joint in range(robot.n):
            moved = getattr(robot, name).copy()
            moved[joint] += _STEP
            shifted = replace(robot, **{name: moved}).fk_batch(joints)
            columns.append((shifted[:, :3, 3] - poses[:, :3, 3]) / _STEP)
    return np.stack(columns, axis=2)


def _play(joints: np.ndarray, width: float) -> np.ndarray:
    """(k, n) rad by which a play of a width lies behind joints (k, n), engaged at the first."""
    half = 0.5 * width
    first = joints[min(20, len(joints) - 1)] - joints[0]
    link = joints[0] - half * np.sign(first)
    out = np.empty_like(joints)
    for k, now in enumerate(joints):
        link = np.minimum(np.maximum(link, now - half), now + half)  # a third of the time of np.clip
        out[k] = link - now
    return out
