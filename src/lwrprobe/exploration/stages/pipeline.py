"""The pipeline, composed from the scene: what a scene does not need is left out, and the run says so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import cos, hypot, radians, sqrt
from typing import TypeVar

import numpy as np

from lwrprobe.contact import (
    Deflection,
    Estimator,
    TorqueAgreement,
    WrenchConditioner,
    WrenchNoise,
    check_estimator,
    make_estimator,
)
from lwrprobe.contracts import (
    Area,
    Bounds,
    CarefulStrategy,
    LeftOut,
    Probe,
    Progress,
    RaisingStrategy,
    Reconstructor,
    SearchingStrategy,
    Strategy,
)
from lwrprobe.contracts.options import configure
from lwrprobe.contracts.plugins import failed, load
from lwrprobe.contracts.strategy import check_line_spacing, check_progress, check_transition
from lwrprobe.exploration.loop.joint_space import JointSpaceTip
from lwrprobe.exploration.loop.loop_delay import LoopDelay
from lwrprobe.exploration.stages.arm_clearance import ArmClearanceStage
from lwrprobe.exploration.stages.clearance import ClearanceStage
from lwrprobe.exploration.stages.force import ForceStage
from lwrprobe.exploration.stages.object_motion import ObjectMotionMonitor
from lwrprobe.exploration.stages.sensor_errors import estimator_settings, torque_agreement
from lwrprobe.kinematics import IKSolver, IKStatus, Preference, Robot
from lwrprobe.mapping import SweptSphere, VoxelMap
from lwrprobe.scene import Scene
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, SpeedGovernor

TURNED = 3.0
"""Standard deviations along a normal, by which touches in different orientations may contradict each other."""
CLOSE = 1.0 + 2.0 * cos(0.1)
"""Trace of the turn between two orientations below which the arm is not yet asked for the second."""
UNNOTICED = 0.001
"""s by which the loop may be slower than stated: the reserve of the force limit covers it."""
SURFACE = 0.0005
"""m, edge of the cubes from which the probe's links keep their distance; the contacts of a contour are 0.2 mm apart."""
SENSITIVITY = 0.8
"""Share of the acceleration and of the jerk that a joint may have, which those of the tip may ask of it."""
NULL_SPACE_ACCELERATION = 20.0
"""rad/s^2, of the joints, when the motion off a joint limit begins."""
POSE_TOLERANCE = 1e-10
"""m and rad between the tip's pose and that of a set point. A cycle's motion has to be larger: the joints would else
rest in one cycle and jump in the next. Near a stretched elbow that is a jerk of tens of krad/s^3."""

Told = TypeVar("Told")


@dataclass(slots=True)
class Pipeline:
    """The stages between drivers and strategy, made once for a run."""

    robot: Robot
    solver: IKSolver
    trajectory: CartesianTrajectory | JointSpaceTip
    governor: SpeedGovernor | None
    conditioner: WrenchConditioner
    estimator: Estimator
    torque: TorqueAgreement | None
    deflection: Deflection | None
    force: ForceStage
    object_motion: ObjectMotionMonitor | None
    voxels: VoxelMap
    surface: VoxelMap
    """What the probe's links keep their distance from; finer than the map, whose cubes reach beyond the surface."""
    sweep: SweptSphere | None
    clearance: ClearanceStage | ArmClearanceStage | None
    strategy: Strategy
    strategy_name: str
    reconstructor: Reconstructor
    options: object
    probe: Probe
    area: Area
    sensitivity: float
    """rad/m, up to which a joint follows the tip's acceleration and jerk within its own."""
    left_out: list[LeftOut] = field(default_factory=list)
    line_spacing: float | None = None
    """m between two neighbouring lines of the strategy, known once it has started; None for one without lines."""
    noise_at_rest: WrenchNoise | None = None
    """Of the readings from which the bias was last taken; None before that."""

    def progress(self) -> Progress:
        """How far the strategy is; PluginError, naming it, for what is no `Progress`."""
        return self._told(lambda: check_progress(self.strategy.progress()))

    def transitions(self, since: int) -> list[tuple[float, str, str, str]]:
        """Rows of the strategy's trace from one on; PluginError, naming it, for what is none."""
        return self._told(lambda: [check_transition(row) for row in self.strategy.trace[since:]])

    def ask_line_spacing(self) -> None:
        """Take `line_spacing` from the strategy; PluginError, naming it, for what is no length."""
        self.line_spacing = self._told(lambda: check_line_spacing(self.strategy.line_spacing))

    def _told(self, ask: Callable[[], Told]) -> Told:
        try:
            return ask()
        except Exception as error:
            raise failed("strategy", self.strategy_name, error) from error

    @property
    def bounds(self) -> Bounds | None:
        """Of an object that the strategy has searched for; None where it has not, or has not found any."""
        return self.strategy.bounds if isinstance(self.strategy, SearchingStrategy) else None

    def touching_poses(self, centre: np.ndarray, facing: np.ndarray) -> Sequence[tuple[np.ndarray, bool]]:
        """How the strategy would hold the probe to touch somewhere; see `CarefulStrategy`."""
        return self.strategy.touching_poses(centre, facing) if isinstance(self.strategy, CarefulStrategy) else ()

    @property
    def explored(self) -> Area:
        """Where the sphere's centre may go while the object is explored: all of the area, or what was bounded in it."""
        return (self.area if self.bounds is None else self.bounds.area).raised(self.raised)

    @property
    def raised(self) -> float:
        """m by which the strategy has raised the area's upper end."""
        return self.strategy.raised if isinstance(self.strategy, RaisingStrategy) else 0.0

    def adopt_noise(self, measured: np.ndarray) -> None:
        """Expect the noise (6,) N and N·m of readings at rest, where that is more than stated.

        With less, the estimator takes noise for a sphere that sticks, and its normals lead the sphere off the surface.
        """
        self.noise_at_rest = WrenchNoise.mean_of(measured)
        self.estimator.set_noise(WrenchNoise.of(self.probe).or_louder(self.noise_at_rest))

    def place_tip(self, pose: np.ndarray, q: np.ndarray) -> None:
        """Let the generator rest at a pose (4, 4), which the joints hold at q (n,)."""
        if isinstance(self.trajectory, JointSpaceTip):
            self.trajectory.reset(q)
        else:
            self.trajectory.reset(pose)

    def add_point(self, point: np.ndarray) -> None:
        """Something was touched at a point (3,)."""
        self.voxels.insert_point(point)
        self.surface.insert_point(point)

    def ik_status(self, pose: np.ndarray, q: np.ndarray, out: np.ndarray) -> int:
        """An IKStatus: whether the arm, at q, can go to a pose (4, 4); CONVERGED where it is too early to say."""
        if isinstance(self.trajectory, JointSpaceTip):
            return self.trajectory.ik_status(pose)
        # A far goal is checked once the tip has come near; a jump of the joints says nothing about it.
        return self.solver.track(pose, q, out) if _near(pose, self.trajectory.pose) else IKStatus.CONVERGED


def _near(pose: np.ndarray, now: np.ndarray) -> bool:
    a, b = pose.ravel().tolist(), now.ravel().tolist()
    if max(abs(a[3] - b[3]), abs(a[7] - b[7]), abs(a[11] - b[11])) >= 0.02:
        return False
    trace = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    trace += a[4] * b[4] + a[5] * b[5] + a[6] * b[6]
    trace += a[8] * b[8] + a[9] * b[9] + a[10] * b[10]
    return trace > CLOSE


@dataclass(slots=True, frozen=True)
class Choices:
    """Strategy and reconstructor of a run, with their options checked.

    Attributes
    ----------
    strategy : makes one
    strategy_options : handed to it in its task
    reconstructor : makes one from its options
    """

    strategy: Callable[[], Strategy]
    strategy_options: object
    reconstructor: Callable[[object], Reconstructor]
    reconstructor_options: object


def _made(plugin: Callable[[], Strategy], name: str) -> Strategy:
    """A strategy of a plug-in; PluginError, naming it, for one that cannot be made."""
    try:
        return plugin()
    except Exception as error:
        raise failed("strategy", name, error) from error


def choose(
    scene: Scene,
    strategy: Callable[[], Strategy] | None = None,
    options: object = None,
    reconstructor: Reconstructor | None = None,
) -> Choices:
    """Load strategy and reconstructor and check their options, and the estimator's name, before anything is built.

    What is given stands in for the plug-in that the scene names: `strategy` makes one, which finds `options` in its
    task. Raises UnknownNameError, PluginError or InputError.
    """
    check_estimator(scene.contact.estimator)
    if strategy is None:
        name = scene.strategy.name
        strategy = plugin = load("strategy", name)
        options = configure(plugin.Config, scene.strategy.options, f"strategy {name}")
    if reconstructor is not None:
        given = reconstructor
        return Choices(strategy, options, lambda config: given, None)
    return Choices(strategy, options, *named_reconstructor(scene))


def named_reconstructor(scene: Scene) -> tuple[Callable[[object], Reconstructor], object]:
    """What makes the scene's reconstructor from its options, and these; raises as `choose` does."""
    method = scene.reconstruction.method
    plugin = load("reconstructor", method)
    return plugin, configure(plugin.Config, scene.reconstruction.options, f"reconstruction {method}")


def compose(scene: Scene, choices: Choices, cycle: float, rate: float) -> Pipeline:
    """The pipeline for a scene, an arm's cycle [s] and a sensor's rate [Hz].

    Raises what the parts raise for bad options.
    """
    probe, area = scene.probe.as_probe(), scene.area.as_area()
    robot = robot_of(scene)
    voxels = VoxelMap(scene.map.resolution)
    surface = VoxelMap(min(scene.map.resolution, SURFACE))
    deflection, no_deflection = _deflection(scene, probe)
    motion, safety = scene.motion, scene.safety
    limits = CartesianLimits(
        speed=motion.free_speed,
        acceleration=motion.acceleration,
        jerk=motion.jerk,
        turn_rate=motion.turn_rate,
        turn_acceleration=motion.turn_acceleration,
        turn_jerk=motion.turn_jerk,
    )
    # The null space is used so gently that its beginning is no jerk: a change of speed that one cycle may hold.
    null_space_step = min(Preference().null_space_step, NULL_SPACE_ACCELERATION * cycle * cycle)
    solver = IKSolver(
        robot,
        tolerance=POSE_TOLERANCE,
        rotation_tolerance=POSE_TOLERANCE,
        preference=Preference(null_space_step=null_space_step),
    )
    clearance, no_clearance = _clearance(scene, probe, robot, solver, voxels, surface)
    trajectory, governor, no_governor = _motion(scene, cycle, robot, solver, limits)
    conditioner = WrenchConditioner(probe, rate)
    estimator = make_estimator(scene.contact.estimator, probe, estimator_settings(scene))
    return Pipeline(
        robot=robot,
        solver=solver,
        trajectory=trajectory,
        governor=governor,
        conditioner=conditioner,
        estimator=estimator,
        torque=torque_agreement(scene, probe),
        deflection=deflection,
        force=ForceStage(scene, probe, conditioner, estimator, rate),
        object_motion=_object_motion(scene, probe.radius, rate),
        voxels=voxels,
        surface=surface,
        sweep=SweptSphere(voxels, probe.radius) if scene.map.free_space else None,
        clearance=clearance,
        strategy=_made(choices.strategy, scene.strategy.name),
        strategy_name=scene.strategy.name,
        reconstructor=choices.reconstructor(choices.reconstructor_options),
        options=choices.strategy_options,
        probe=probe,
        area=area,
        sensitivity=SENSITIVITY * min(safety.joint_acceleration / motion.acceleration, safety.joint_jerk / motion.jerk),
        left_out=[
            LeftOut(stage=stage, why=why)
            for stage, why in (
                ("clearance", no_clearance),
                (
                    "arm links",
                    "the clearance watches the probe's links alone" if scene.clearance.links == "probe" else "",
                ),
                ("deflection", no_deflection),
                ("governor", no_governor),
                ("stillness", "" if scene.safety.shift > 0.0 else "switched off in the scene"),
                ("free space", "" if scene.map.free_space else "switched off in the scene"),
            )
            if why
        ],
    )


def _motion(
    scene: Scene, cycle: float, robot: Robot, solver: IKSolver, limits: CartesianLimits
) -> tuple[CartesianTrajectory | JointSpaceTip, SpeedGovernor | None, str]:
    """The generator, what keeps its joints in bounds, and why that is left out."""
    if scene.motion.mode == "joint":
        return (
            JointSpaceTip(cycle, robot, solver, limits),
            None,
            "in joint space the generator keeps the joints' limits",
        )
    trajectory = CartesianTrajectory(cycle, limits)
    governor = SpeedGovernor(trajectory, solver.track_all, robot.speed, scene.safety.joint_acceleration)
    return trajectory, governor, ""


def _clearance(
    scene: Scene, probe: Probe, robot: Robot, solver: IKSolver, voxels: VoxelMap, surface: VoxelMap
) -> tuple[ClearanceStage | ArmClearanceStage | None, str]:
    """The stage, or why it is left out: no link but the stick can come down to where anything can be touched."""
    settings = scene.clearance
    if settings.enabled is False:
        return None, "switched off in the scene"
    keep, stick = settings.threshold, settings.stick_threshold
    if settings.links == "arm":
        return ArmClearanceStage(probe, robot, solver, voxels, keep, stick, scene.table.plane()), ""
    if not probe.links:
        return None, "the probe has no link shapes"
    return ClearanceStage(probe.links, surface, keep, stick), ""


def _object_motion(scene: Scene, radius: float, rate: float) -> ObjectMotionMonitor | None:
    tolerance, knows_friction = scene.safety.shift, scene.contact.estimator != "force_direction"
    if tolerance <= 0.0:
        return None
    return ObjectMotionMonitor(radius, tolerance, scene.contact.threshold, knows_friction, _turned(scene), rate)


def _turned(scene: Scene) -> float:
    """m/rad, by which errors that are left of arm and probe move the sphere where the stick is held otherwise.

    The numbers are those of the LWR 4+ over the scenes' areas, up to 40 degrees: the standard deviation is 1 m times
    that of an angle of the table, and 3 times that of a length.
    """
    sigma = scene.uncertainty.sigma
    angles = radians(max(map(sigma, ("dh_twist_deg", "dh_offset_deg"))))
    lengths = 1e-3 * max(map(sigma, ("dh_a_mm", "dh_d_mm")))
    probe = 1e-3 * hypot(sigma("probe_length_mm"), sigma("sphere_off_axis_mm"))
    return TURNED * hypot(angles, 3.0 * lengths, probe) / sqrt(3.0)


def _deflection(scene: Scene, probe: Probe) -> tuple[Deflection | None, str]:
    if not scene.contact.deflection:
        return None, "switched off in the scene"
    deflection = Deflection(probe)
    return (None, "the probe is rigid") if deflection.rigid else (deflection, "")


def reaction_delay(
    scene: Scene,
    cycle: float,
    sensor_latency: float,
    rate: float,
    measured: LoopDelay | None = None,
    arm_delay: float = 0.0,
) -> float:
    """s, from a force at the sphere to the arm's answer, at worst: sensor, its period, one cycle, and the jerk ramp.

    An arm that follows set points later than in the next cycle adds its `arm_delay` [s]. What the start-up has
    `measured` counts where it is longer by more than `UNNOTICED`.
    """
    ramp = float(np.sqrt(scene.motion.contour_speed / scene.motion.jerk))
    stated = scene.contact.delay
    follows = cycle + arm_delay
    stated = sensor_latency + 1.0 / rate + follows + ramp if stated is None else float(stated)
    if measured is None:
        return stated
    latency = sensor_latency if measured.sensor is None else measured.sensor
    found = latency + 1.0 / rate + max(follows, measured.arm or 0.0) + ramp
    return found if found > stated + UNNOTICED else stated
