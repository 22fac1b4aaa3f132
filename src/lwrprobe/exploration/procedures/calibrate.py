"""Calibration by touch: drive the probe around a reference sphere, keep what arm and sensor send, solve."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lwrprobe.calibration import (
    Calibration,
    CalibrationRefused,
    Priors,
    Touch,
    Touches,
    solve,
)
from lwrprobe.calibration.quantities import arm_errors, force_errors, quantities
from lwrprobe.calibration.touches import Target
from lwrprobe.contact import identify_payload
from lwrprobe.contracts import InputError, SafetyStop, WrenchSample
from lwrprobe.contracts.samples import Vector
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.explorer import Explorer, Outcome, WatchFunction
from lwrprobe.exploration.procedures.explore import BIAS_SECONDS
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.exploration.recording.device_log import DeviceLog
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.kinematics import Robot, follow, reachable
from lwrprobe.kinematics.path import rotations
from lwrprobe.scene import Scene, widened_area
from lwrprobe.scene.calibrated_scene import stated_hash
from lwrprobe.scene.scene import AreaTable, ClearanceTable, StrategyTable
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.scene.shape import Sphere
from lwrprobe.scene.table import Pose

STRATEGY = "reference_sphere"
SIDE_MARGIN, ABOVE = 0.045, 0.02
"""m of the area beside the sphere and above it: for the probe and for a sphere that stands elsewhere."""
PENETRATION = 0.008
"""m, how deep the table may be sought below where the scene has it."""
APART = 0.12
"""m between the middles of two reference spheres, so that the leaning stick stays clear of the other ones."""
DIAMETERS = (0.006, 0.1)
"""m, smallest and largest reference sphere."""
TILTS = ((0.0, 3), (0.5, 5), (1.0, 7))
"""rad out of the orientation of the start, and to how many sides. The wider, the better the length of the probe is told
from the lengths of the wrist's links."""
LEANING = 0.4
"""rad, of the orientations in which the kinematic table's errors are asked for over the area."""
SPINS = (0.0, 1.2, -1.2)
"""rad about the stick, in turn: they tell an offset of the sphere from errors of the arm."""
SMALLER = (1.0, 0.8, 0.6)
"""Shares of a tilt that are tried until the arm can take it."""
LIMIT_MARGIN, DEXTERITY, JOINT_STEP = 0.2, 0.4, 0.2
"""rad from a joint limit, share of the manipulability, and rad that a joint may move while the probe turns by 0.05 rad:
what a change of orientation has to keep."""
UPRIGHT = (0.0, 0.0, 0.0)
FEWEST_LEANS = 4
TURN = 2.0 * np.pi
MAX_STIFFNESS = 9e4
"""N/m of arm and sphere in series: an upper bound for an arm of unknown stiffness and a sphere of metal. With 6e4 an
arm of 1.3e5 N/m along the stick pressed with 3.6 N."""
STIFFER = 2.2
"""Times what joints of the usual stiffness make of the arm: three standard deviations of a data sheet's 40 %."""
ROWS = 16
"""Samples of the rise and of the fall of a touch that are solved with."""
LIGHT = 0.25
"""N, below which a sample of a touch says little."""
TURNED = 0.6
"""Share of the largest force of a touch below which it has surely fallen: the friction has turned, the play of the
joints is taken up, and each axis of the sensor has left its hysteresis."""
BEFORE, AFTER = 1.5, 0.1
"""s of the arm's motion that are kept before a touch, on which the play of each joint was taken up, and after it."""
SETTLING = 0.05
"""s of a rest that do not count yet."""
EVEN = 2e-3
"""rad/s, slowest joint that tells how late the arm follows."""


@dataclass(slots=True)
class Measurement:
    """What the drive around the sphere has brought.

    Attributes
    ----------
    touches : all of them
    centres : (p, 3) m, where the sphere was found
    outcome : how the run ended
    ground_truth : of a simulated world from its scene, for whoever compares; None on real devices
    """

    touches: Touches
    centres: np.ndarray
    outcome: Outcome
    ground_truth: Any


def with_reference_sphere(scene: Scene, diameter: float, poses: Sequence[tuple[float, float]] = ()) -> Scene:
    """The scene with a sphere of a diameter [m] on its table, in the middle of its area, and nothing else.

    With `poses`, x and y in m, a sphere stands at each of them, and none in the middle. Raises InputError for a
    diameter that is no length between 6 and 100 mm, and for poses closer to each other than 120 mm.
    """
    if not (np.isfinite(diameter) and DIAMETERS[0] <= diameter <= DIAMETERS[1]):
        raise InputError("--reference-sphere", diameter, f"a diameter from {DIAMETERS[0]:g} to {DIAMETERS[1]:g} m")
    radius, probe = 0.5 * diameter, scene.probe.radius
    middle = (np.array(scene.area.lower[:2]) + np.array(scene.area.upper[:2])) / 2.0
    places = np.array(poses if len(poses) else [middle], dtype=float)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise InputError("--poses", list(poses), "pairs of x and y in m")
    if any(np.hypot(*(one - other)) < APART for one, other in combinations(places, 2)):
        raise InputError("--poses", [list(place) for place in poses], f"places {APART:g} m apart and more")
    table = scene.table.height if scene.table.present else scene.area.lower[2] - probe
    z = table + radius
    side = radius + probe + SIDE_MARGIN
    options = {
        "radius": radius,
        "places": [[float(x), float(y), z] for x, y in places],
        "table": scene.table.height if scene.table.present else float("nan"),
        "torque": scene.safety.torque_share * min(scene.probe.torque_range),
    }
    material: dict[str, Any] = (
        {"friction": scene.objects[0].friction, "stiffness": scene.objects[0].stiffness} if scene.objects else {}
    )
    changed = scene.model_copy(
        update={
            "objects": tuple(
                Sphere(shape="sphere", radius=radius, at=Pose(xyz=(float(x), float(y), z)), **material)
                for x, y in places
            ),
            "area": AreaTable(
                lower=(*(places.min(axis=0) - side).tolist(), table + probe),
                upper=(*(places.max(axis=0) + side).tolist(), table + diameter + 2.0 * probe + ABOVE),
            ),
            "strategy": StrategyTable(name=STRATEGY, options=options),
            # The sphere and its place are known: the plan itself keeps the stick clear of it.
            "clearance": ClearanceTable(enabled=False),
            # An uncalibrated sensor contradicts itself; whether the sphere has moved is asked afterwards.
            "safety": scene.safety.model_copy(
                update={"shift": 0.0, "table_penetration": max(PENETRATION, scene.safety.table_penetration)}
            ),
        }
    )
    return widened_area(changed)


Lean = tuple[float, float, float]
Span = tuple[str, float, float]
"""Skill, and s at which it begins and ends, as the sensor's stamps count."""


def feasible_leans(scene: Scene) -> tuple[list[Lean], list[float]]:
    """Orientations at the sphere in the order to take, and the share of the approach speed that each allows.

    An orientation is the tilt, its direction and the turn about the stick [rad]. The arm keeps away from joint limits
    and singularities in each of them and on the path between two. Its stiffness along the stick differs by a factor of
    five; where it may be above `MAX_STIFFNESS` the approach is slower. Raises InputError where there are fewer than
    four orientations.
    """
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    wanted: list[Lean] = []
    for tilt, sides in TILTS:
        wanted += [(tilt, TURN * (side + 0.5) / sides, SPINS[(len(wanted) + side) % 3]) for side in range(sides)]
    upright = pose[:3, :3]
    now, here, order, least = q, upright, list[Lean](), DEXTERITY * robot.manipulability(q)
    shares: list[float] = []
    while wanted:
        wanted.sort(key=lambda lean: _angle(here, _leaned(upright, *lean)))
        for share, lean, spin in product(SMALLER, wanted, SPINS):
            smaller = (share * lean[0], lean[1], _turned(lean[2], spin))
            reached = _swing(robot, pose, here, _leaned(upright, *smaller), now, least)
            if reached is not None:
                order.append(smaller)
                wanted.remove(lean)
                now, here = reached, _leaned(upright, *smaller)
                shares.append(_speed_share(robot, now, here))
                break
        else:
            if order and order[-1] == UPRIGHT:
                break
            # From here none of the others can be reached: back to the start, from where more of them can.
            order.append(UPRIGHT)
            now, here = q, upright
            shares.append(_speed_share(robot, now, here))
    if len(order) < FEWEST_LEANS:
        raise InputError("arm", scene.arm.robot, "an arm that can lean the probe to at least four sides at the sphere")
    return order, shares


def _turned(spin: float, by: float) -> float:
    """One of `SPINS`: `by` rad farther than another, in turn."""
    return SPINS[(SPINS.index(spin) + SPINS.index(by)) % len(SPINS)]


def _speed_share(robot: Robot, q: Vector, rotation: np.ndarray) -> float:
    """Share of the approach speed that the arm allows along the stick at joints q (n,)."""
    along = robot.jacobian(q)[:3].T @ rotation[:, 2]
    stiffness = STIFFER / max(Priors().joint_compliance * float(along @ along), 1e-12)
    return min(MAX_STIFFNESS / stiffness, 1.0)


def _swing(
    robot: Robot, pose: np.ndarray, begin: np.ndarray, end: np.ndarray, q: Vector, least: float
) -> Vector | None:
    """Joints (n,) after a turn from one orientation to another at the place of `pose`; None where it is not safe."""
    turn = end @ begin.T
    angle = _angle(begin, end)
    axis = Rotation.from_matrix(turn).as_rotvec() / max(angle, 1e-9)
    path = np.tile(pose, (2 + int(angle / 0.05), 1, 1))
    path[:, :3, :3] = rotations(axis, np.linspace(0.0, angle, len(path))) @ begin if angle > 1e-9 else begin
    followed = follow(robot, path, q)
    safe = (
        followed.complete
        and followed.limit_margin.min() > LIMIT_MARGIN
        and followed.manipulability.min() > least
        and np.abs(np.diff(followed.q, axis=0)).max(initial=0.0) < JOINT_STEP
    )
    return followed.q[-1] if safe else None


def _leaned(upright: np.ndarray, tilt: float, side: float, spin: float) -> np.ndarray:
    """(3, 3), as the strategy leans."""
    lean = rotations(np.array([np.cos(side), np.sin(side), 0.0]), np.array([tilt]))[0]
    return lean @ upright @ rotations(np.array([0.0, 0.0, 1.0]), np.array([spin]))[0]


def _postures_around(scene: Scene, robot: Robot) -> np.ndarray:
    """(m, n) joints with the tip at the corners of the area, upright and leaning to four sides, where the arm can."""
    pose, q = start_posture(scene, robot)
    corners = np.array(list(product(*zip(scene.area.lower, scene.area.upper))))
    turned = [pose[:3, :3], *(_leaned(pose[:3, :3], LEANING, side, 0.0) for side in np.arange(4) * TURN / 4.0)]
    found = [reachable(robot, corners, rotation, q) for rotation in turned]
    return np.concatenate([one.q[one.mask] for one in found])


def _angle(begin: np.ndarray, end: np.ndarray) -> float:
    """rad between two orientations."""
    return float(np.arccos(np.clip(0.5 * (np.trace(end @ begin.T) - 1.0), -1.0, 1.0)))


def measure(
    scene: Scene,
    message: Callable[[str], None] = lambda text: None,
    watch: WatchFunction | None = None,
    confirm: Confirm | None = None,
) -> Measurement:
    """Touch the reference sphere of a scene made by `with_reference_sphere`.

    Raises SafetyStop with the reason where the drive ended early, and what drivers and guards raise.
    """
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    leans, shares = feasible_leans(scene)
    options = {**scene.strategy.options, "leans": leans, "speed_shares": shares}
    scene = scene.model_copy(update={"strategy": StrategyTable(name=STRATEGY, options=options)})
    devices = Devices.assemble(scene, scene.run.seed, False, q)
    contact = scene.contact.model_copy(update={"stiffness": max(MAX_STIFFNESS, scene.contact.stiffness)})
    # The stiffness is an upper bound already, and the probe is too uncertain for presses to show it.
    exact = scene.uncertainty.model_copy(update={"arm_stiffness_percent": 0.0})
    scene = scene.model_copy(update={"contact": contact, "uncertainty": exact})
    pipeline = compose(scene, choose(scene), devices.arm.cycle, devices.sensor.rate)
    pipeline.force.learns = False
    log = DeviceLog.on(devices)
    explorer = Explorer(scene, pipeline, devices, Recorder(None), watch, confirm)
    with devices:
        message("taking the sensor's bias")
        explorer.start_up.take_place(pose, q)
        explorer.start_up.take_bias(BIAS_SECONDS)
        explorer.begin()
        message("touching the reference sphere")
        # The run's time stands still while the arm recovers from an interruption.
        zeros = [(seen.time, explorer.zero_time) for seen in explorer.observations(scene.run.time_limit)]
    outcome = explorer.outcome
    assert outcome is not None
    if outcome.status != "done":
        raise SafetyStop(f"the calibration was not finished: {outcome.reason}")
    centres = np.array(pipeline.strategy.centres)  # type: ignore[attr-defined]
    radius = scene.strategy.options["radius"]
    touches = _touches(log, _spans(pipeline.strategy.trace, zeros), robot, centres, radius + scene.probe.radius)
    return Measurement(touches, centres, outcome, devices.ground_truth)


def _touches(
    log: DeviceLog,
    spans: Sequence[Span],
    robot: Robot,
    centres: np.ndarray,
    reach: float,
) -> Touches:
    """The log cut into touches by the strategy's skills: rest, then load, then unload."""
    times, joints, sent = log.states()
    good = [(arrival, sample) for arrival, sample in log.samples if sample.status == 0]
    stamps = np.array([sample.time for _, sample in good])
    arrivals = np.array([arrival for arrival, _ in good])
    readings = np.array([[*sample.force, *sample.torque] for _, sample in good])
    found = Touches(following=_following(times, joints, sent), latency=float(np.min(arrivals - stamps)))
    free: np.ndarray | None = None
    for k, (name, begin, end) in enumerate(spans):
        if name == "rest":
            mine = (stamps > begin + SETTLING) & (stamps < end)
            if mine.sum() >= 4:
                at = int(np.searchsorted(times, 0.5 * (begin + end)))
                free = readings[mine].mean(axis=0)
                found.free.append(WrenchSample(0.5 * (begin + end), free[:3], free[3:], len(found.free)))
                found.free_joints.append(joints[min(at, len(joints) - 1)])
        elif name == "load" and free is not None and k + 1 < len(spans) and spans[k + 1][0] == "unload":
            touch = _touch(stamps, readings - free, (begin, end, spans[k + 1][2]), times, joints)
            if touch is not None:
                found.touches.append(touch)
            free = None
        elif not name:
            free = None
    _tell_apart(found, robot, centres, reach)
    return found


def _spans(trace: Sequence[tuple[float, str, str, str]], zeros: Sequence[tuple[float, float]]) -> list[Span]:
    """The skills in the strategy's trace; one that an interruption of the run cut in two has no name.

    `zeros` has the run's time of each observation, and the instant at which the run's time then had its zero.
    """
    times, begins = np.array(zeros).T
    spans = []
    for before, row in pairwise(trace):
        first, last = np.searchsorted(times, [before[0], row[0]])
        name = row[1] if begins[first] == begins[last] else ""
        spans.append((name, before[0] + float(begins[first]), row[0] + float(begins[last])))
    return spans


def _touch(
    stamps: Vector, wrenches: np.ndarray, span: tuple[float, float, float], times: Vector, joints: np.ndarray
) -> Touch | None:
    begin, top, last = span
    size = np.linalg.norm(wrenches[:, :3], axis=1)
    parts, rising = [], []
    for low, high, up in ((begin, top, True), (top, last, False)):
        mine = np.flatnonzero((stamps > low) & (stamps <= high + 1e-9) & (size > LIGHT))
        if not up and len(mine):
            # Near the turn the reading still stands, held back by the sensor's hysteresis.
            mine = mine[size[mine] < TURNED * size[mine].max()]
        if len(mine) > ROWS:
            mine = mine[np.round(np.linspace(0, len(mine) - 1, ROWS)).astype(int)]
        parts.append(mine)
        rising.append(np.full(len(mine), up))
    chosen = np.concatenate(parts)
    if len(parts[0]) < 4 or len(chosen) < 6:
        return None
    window = (times > stamps[chosen[0]] - BEFORE) & (times < stamps[chosen[-1]] + AFTER)
    return Touch(
        target="sphere",
        place=0,
        times=stamps[chosen],
        wrenches=wrenches[chosen],
        rising=np.concatenate(rising),
        arm_times=times[window],
        arm_joints=joints[window],
    )


def _tell_apart(found: Touches, robot: Robot, centres: np.ndarray, reach: float) -> None:
    """Say of each touch what it met: the sphere at the nearest of its places, or the table."""
    for k, touch in enumerate(found.touches):
        begin = int(np.searchsorted(touch.arm_times, touch.times[0]))
        tip = robot.fk_batch(touch.arm_joints[begin][None])[0, :3, 3]
        away = np.abs(np.linalg.norm(centres - tip, axis=1) - reach)
        place = int(np.argmin(away))
        target: Target = "sphere" if away[place] < 0.25 * reach else "table"
        found.touches[k] = Touch(
            target, place, touch.times, touch.wrenches, touch.rising, touch.arm_times, touch.arm_joints
        )


def _following(times: Vector, joints: np.ndarray, sent: np.ndarray) -> float:
    """s, by which the measured joints follow the set points while they move evenly; nan where they never do."""
    period = np.gradient(times)
    speed = np.gradient(sent, axis=0) / period[:, None]
    even = np.abs(speed) > EVEN
    if not even.any():
        return float("nan")
    return float(np.sum((sent - joints)[even] * speed[even]) / np.sum(speed[even] ** 2))


def calibrate(
    scene: Scene,
    diameter: float,
    message: Callable[[str], None] = lambda text: None,
    watch: WatchFunction | None = None,
    confirm: Confirm | None = None,
    poses: Sequence[tuple[float, float]] = (),
) -> tuple[Calibration, Measurement]:
    """Measure what a scene states of probe, sensor, arm, clocks and table, on a reference sphere of a diameter [m].

    The sphere stands in the middle of the scene's area, to within some millimetres. In a simulator it is put there.
    With `poses`, x and y in m, equal spheres stand there instead, and the joints' offsets are asked for, too.
    Raises InputError for a bad diameter or poses, SafetyStop where the drive ended early, CalibrationRefused with the
    likely cause where the touches do not fit together, or show no joint's offset that was asked for.
    """
    touched = with_reference_sphere(scene.model_copy(update={"calibration": ""}), diameter, poses)
    robot, probe, priors = robot_of(touched), touched.probe.as_probe(), Priors(gear_waves=scene.arm.gear_waves)
    _, q = start_posture(scene, robot)  # the arm's stiffness counts where an exploration begins
    found = measure(touched, message, watch, confirm)
    message("solving")
    centre = found.centres.copy()
    solution = solve(robot, probe, found.touches.touches, 0.5 * diameter, centre, touched.table.height, priors)
    rotations_of = robot.fk_batch(np.array(found.touches.free_joints))[:, :3, :3]
    load = identify_payload(found.touches.free, list(rotations_of))
    offsets = slice(solution.parameters.slices["dh"].stop - robot.n, solution.parameters.slices["dh"].stop)
    if poses and not solution.visible("dh")[-robot.n :].any():
        sigma = np.degrees(np.sqrt(np.diag(solution.covariance)[offsets]))
        raise CalibrationRefused(
            f"the touches at {len(poses)} places do not show the joints' offsets: their standard deviations are still "
            f"{sigma.min():.3f} to {sigma.max():.3f} deg, {np.degrees(priors.dh_angle):.3f} deg were assumed. Place "
            "the spheres farther apart, or calibrate without --poses"
        )
    calibration = Calibration(
        date=datetime.now(UTC).replace(microsecond=0),
        scene=scene.name,
        scene_hash=stated_hash(scene),
        robot=scene.arm.robot,
        reference_sphere=diameter,
        touches=len(found.touches.touches),
        residual=solution.residual,
        time=found.outcome.time,
        quantities=quantities(solution, found.touches, load, robot, probe, priors, q, _postures_around(scene, robot)),
        arm_errors=arm_errors(solution),
        force_errors=force_errors(solution),
    )
    return calibration, found
