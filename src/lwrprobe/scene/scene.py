"""The scene: everything that one exploration depends on, validated, with a documented default for each value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from lwrprobe.contracts import Area, LinkShape, Probe, SceneError
from lwrprobe.scene.arm_correction import ArmCorrection
from lwrprobe.scene.safety import SafetyTable
from lwrprobe.scene.shape import Shape
from lwrprobe.scene.table import Coordinate, Length, NonNegative, Place, Pose, Refusal, Size, Table, Vector3, in_metres
from lwrprobe.scene.truth import TruthTable
from lwrprobe.scene.uncertainty import UncertaintyTable

if TYPE_CHECKING:
    from lwrprobe.scene.solid import Solid


INERTIA = 0.3
"""Of the threshold of a touch, that the probe's own inertia may read."""
ProbeLength = Annotated[Length, in_metres(0.5)]
BEHIND = 0.002
"""m, by which sphere and stick may reach behind the sensor's origin: a calibration measures the sphere alone."""


class ArmTable(Table):
    """Which arm, where it stands and what it carries."""

    driver: str = "sim"
    """Driver plug-in of the arm."""
    robot: str = "lwr4"
    """Robot model, an entry of the group `lwrprobe.robots`."""
    base: Pose = Pose(xyz=(-0.6, 0.0, 0.31))
    """The robot's base frame (LWR 4+: the shoulder) in the world."""
    tool: Pose = Pose(xyz=(0.0, 0.0, 0.25))
    """The tip frame (sphere's centre, z along the stick away from the flange) in the robot's last frame."""
    correction: ArmCorrection = ArmCorrection()
    """By how much this arm differs from its model."""
    tip_rpy_deg: Vector3 = (180.0, 0.0, 180.0)
    """degrees about the world's x, y, z: how the tip is held while exploring; the default points straight down."""
    start_deg: tuple[float, ...] | None = Field(default=None, strict=False)
    """Joint angles at the start; left out, the pose above the area's start is solved for."""
    gear_waves: NonNegative = 320.0
    """Waves of each joint's gear a turn: two for each tooth of a harmonic drive of ratio 160; 0: not known.
    Contacts show how large they are, and are corrected for them after the run."""


class ProbeTable(Table):
    """The probe: sphere, stick, sensor, holder and the gripper's fingers, one behind the other along the tip's z."""

    radius: ProbeLength = 0.005
    """m, of the sphere."""
    stick_radius: ProbeLength = 0.002
    stick_length: ProbeLength = 0.045
    """m, of the stick's free part, from the sphere's surface to the sensor."""
    sensor_distance: ProbeLength = 0.05
    """m, from the sensor frame's origin to the sphere's centre."""
    sensor_radius: ProbeLength = 0.0085
    sensor_length: ProbeLength = 0.0145
    holder_radius: ProbeLength = 0.0125
    holder_length: ProbeLength = 0.04
    fingers: bool = True
    """Two finger boxes grip the holder from both sides along the tip frame's x."""
    finger_size: tuple[ProbeLength, ProbeLength, ProbeLength] = Field(default=(0.012, 0.020, 0.070), strict=False)
    finger_overlap: NonNegative = 0.01
    """m, length of the holder's upper end that lies between the fingers."""
    stiffness_lateral: NonNegative = 2500.0
    """N/m of the tip against the sensor across the stick; 0 = rigid. Printed resin, 6 mm thick, 60 mm: 3 E I / L^3."""
    stiffness_axial: NonNegative = 1.3e6
    """N/m along the stick; 0 = rigid. The same stick: E A / L."""
    mass: NonNegative = 0.003
    """kg of what hangs on the sensor (stick and sphere)."""
    centre_of_mass: Vector3 = (0.0, 0.0, 0.03)
    """m, in the sensor frame."""
    force_range: tuple[Length, Length, Length] = Field(default=(12.0, 12.0, 17.0), strict=False)
    """N, ends of the sensor's range (ATI nano17e, SI-12-0.12)."""
    torque_range: tuple[Length, Length, Length] = Field(default=(0.12, 0.12, 0.12), strict=False)
    """N m"""
    force_resolution: Length = 1.0 / 320.0
    """N, one count."""
    torque_resolution: Length = 1.0 / 64000.0
    """N m, one count."""

    @model_validator(mode="after")
    def _stick_fits(self) -> Self:
        if self.stick_radius >= self.radius:
            raise Refusal("stick_radius", self.stick_radius, f"less than the sphere's radius, {self.radius:g}")
        begin = self.radius + self.stick_length
        if self.sensor_distance < begin - BEHIND:
            allowed = f"about radius + stick_length, {begin:g}, or more: the sensor begins where the stick ends"
            raise Refusal("sensor_distance", self.sensor_distance, allowed)
        return self

    def as_probe(self) -> Probe:
        """The probe as contact estimators, clearance and strategies see it."""
        lateral, axial = (1.0 / k if k else 0.0 for k in (self.stiffness_lateral, self.stiffness_axial))
        return Probe(
            radius=self.radius,
            sensor_distance=self.sensor_distance,
            stick_radius=self.stick_radius,
            compliance=np.array([lateral, lateral, axial]),
            mass=self.mass,
            centre_of_mass=np.array(self.centre_of_mass),
            force_range=np.array(self.force_range),
            torque_range=np.array(self.torque_range),
            force_resolution=self.force_resolution,
            torque_resolution=self.torque_resolution,
            links=self._links(),
        )

    def _links(self) -> tuple[LinkShape, ...]:
        sensor_top = -self.radius - self.stick_length
        holder_top = sensor_top - self.sensor_length
        fingers_top = holder_top - self.holder_length + self.finger_overlap
        links = [
            LinkShape(
                "stick", "cylinder", (self.stick_radius, self.stick_length), _behind(-self.radius, self.stick_length)
            ),
            LinkShape(
                "sensor", "cylinder", (self.sensor_radius, self.sensor_length), _behind(sensor_top, self.sensor_length)
            ),
            LinkShape(
                "holder", "cylinder", (self.holder_radius, self.holder_length), _behind(holder_top, self.holder_length)
            ),
        ]
        if self.fingers:
            aside = self.holder_radius + 0.5 * self.finger_size[0]
            links += [
                LinkShape(name, "box", self.finger_size, _behind(fingers_top, self.finger_size[2], x))
                for name, x in (("finger_left", -aside), ("finger_right", aside))
            ]
        return tuple(links)


class SensorTable(Table):
    """Which force/torque sensor, and how fast it samples."""

    driver: str = "sim"
    """Driver plug-in of the sensor."""
    rate: float = Field(default=125.0, gt=0, le=10_000)
    """Hz"""


class GroundTable(Table):
    """The plane that the objects stand on."""

    present: bool = True
    height: Coordinate = 0.0
    """m, world z of its top at the origin."""
    tilt_deg: float = Field(default=0.0, ge=0, le=30)
    """degrees out of level."""
    tilt_axis: Vector3 = (1.0, 0.0, 0.0)
    """Horizontal axis it is tilted about, through the origin."""
    friction: NonNegative = 0.3
    stiffness: Length = 100_000.0
    """N/m"""
    damping: NonNegative = 5.0
    """N s/m"""

    @model_validator(mode="after")
    def _axis_is_level(self) -> Self:
        if self.tilt_axis[2] != 0.0 or not any(self.tilt_axis):
            raise Refusal("tilt_axis", self.tilt_axis, "a horizontal direction, not zero")
        return self

    def normal(self) -> np.ndarray:
        """(3,) unit, upwards."""
        axis = np.array(self.tilt_axis) / np.linalg.norm(self.tilt_axis)
        angle = np.radians(self.tilt_deg)
        return np.cos(angle) * np.array([0.0, 0.0, 1.0]) + np.sin(angle) * np.cross(axis, [0.0, 0.0, 1.0])

    def plane(self) -> np.ndarray | None:
        """(4,) unit normal and how far [m] its top lies along that from the world's origin; None without a table."""
        normal = self.normal()
        return np.append(normal, self.height * normal[2]) if self.present else None


class AreaTable(Table):
    """Where the sphere's centre may go while exploring; the start lies above its first corner."""

    lower: Place = (-0.085, -0.06, 0.006)
    upper: Place = (0.085, 0.06, 0.09)
    search_for: Length | None = None
    """m. Nobody knows where in the area the object is: it is searched for and bounded before it is explored.
    The search ends when nothing can have been missed over which a level circle of this diameter fits. Left out, the
    area is around the object. In the simulator alone: around an object that overhangs, the body behind the
    stick may press without being sensed."""
    detail: Size | None = None
    """m, width of the narrowest part of the object that is to be seen. Strategies that cover the area by lines put
    them no farther apart than that. Left out, they are as far apart as the strategy says."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for axis, low, high in zip("xyz", self.lower, self.upper):
            if low >= high:
                raise Refusal(f"lower {axis}", low, f"less than upper {axis}, {high:g}")
        narrowest = min(high - low for low, high in zip(self.lower[:2], self.upper[:2]))
        if self.search_for is not None and self.search_for > narrowest:
            raise Refusal("search_for", self.search_for, f"at most {narrowest:g}, the area's shorter side")
        return self

    def as_area(self) -> Area:
        """The same for a strategy's task."""
        return Area(np.array(self.lower), np.array(self.upper))


class MotionTable(Table):
    """Speeds and their derivatives, of the tip."""

    mode: Literal["cartesian", "joint"] = "cartesian"
    """Straight lines in space, or straight lines in joint space (which bow)."""
    free_speed: Length = 0.2
    """m/s where nothing is expected to be touched."""
    approach_speed: Length = 0.03
    """m/s where it is."""
    contour_speed: Length = 0.02
    """m/s while touching."""
    acceleration: Length = 2.0
    """m/s^2"""
    jerk: Length = 3000.0
    """m/s^3"""
    turn_rate: Length = 0.5
    """rad/s"""
    turn_acceleration: Length = 3.0
    """rad/s^2"""
    turn_jerk: Length = 50.0
    """rad/s^3"""

    @model_validator(mode="after")
    def _free_is_fastest(self) -> Self:
        for name in ("approach_speed", "contour_speed"):
            if getattr(self, name) > self.free_speed:
                raise Refusal(name, getattr(self, name), f"no more than free_speed, {self.free_speed:g}")
        return self


class ContactTable(Table):
    """Contact detection and estimation, and the forces of the force control."""

    estimator: Literal["force_direction", "wrench_axis", "fused"] = "fused"
    """Contact estimator."""
    deflection: bool = True
    """The sphere is where the bent stick holds it, not where the joints alone say."""
    threshold: Length = 0.2
    """N, above it a touch is declared."""
    target: Length = 0.8
    """N, wanted while contouring."""
    limit: Length = 3.0
    """N, never to be exceeded; above it the tip yields whatever the strategy commands."""
    delay: NonNegative | None = None
    """s, total reaction delay of the loop; left out, it is put together from sensor, cycle and jerk."""
    stiffness: Length = 20_000.0
    """N/m, of object and arm as far as known beforehand, else an upper bound; the stick's is the probe's own."""
    object_stiffness: Length = 220_000.0
    """N/m, of the stiffest object that may be met: what an arm with a mass strikes. Wood under a 5 mm sphere at 1 N
    (Hertz)."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.threshold < self.target < self.limit:
            forces = (self.threshold, self.target, self.limit)
            raise Refusal("threshold, target, limit", forces, "threshold < target < limit")
        return self


class MapTable(Table):
    """The voxel map of what was touched."""

    resolution: float = Field(default=0.002, ge=1e-5, le=0.1)
    """m, edge of the smallest voxel."""
    free_space: bool = True
    """Record what the sphere has swept without a touch as well: that nothing is there is knowledge."""


class ClearanceTable(Table):
    """The watch over the distance between robot links and map."""

    enabled: bool | Literal["auto"] = "auto"
    """`auto` leaves it out where no link can come near anything."""
    threshold: Length = 0.003
    """m, below it a collision threatens: for everything behind the stick."""
    stick_threshold: Length = 0.0001
    """m, the same for the stick, which is near by design; the sensor detects its contacts. On an oblique wall a voxel's
    corner comes as near as 0.2 mm while the sphere touches."""
    links: Literal["probe", "arm"] = "probe"
    """Watch the probe's shapes, or the arm's own links too, and all of them also against the table and each other."""


class ChoiceTable(Table):
    """A plug-in's name and, beside it in the same table, the plug-in's own options."""

    options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        own = {key: value for key, value in given.items() if key in cls.model_fields}
        rest = {key: value for key, value in given.items() if key not in cls.model_fields}
        return {**own, "options": {**own.get("options", {}), **rest}} if rest else own

    @model_serializer(mode="wrap")
    def _spread(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        plain = handler(self)
        return {**{k: v for k, v in plain.items() if k != "options"}, **plain.get("options", {})}


class StrategyTable(ChoiceTable):
    """The exploration strategy; all further keys of the table are its own options, checked by the plug-in."""

    name: str = "grid_version"


class ReconstructionTable(ChoiceTable):
    """How the contacts become a mesh; all further keys of the table are the method's own options."""

    method: str = "contact_surface"
    points: Literal["contacts", "voxels"] = "contacts"
    """What the mesh is made from: contacts with their normals, or the map's voxel centres alone."""


class UntilTable(Table):
    """When a run may end before its strategy has come to its end: as soon as one of these is reached."""

    time: Length | None = None
    """s of the robot's time."""
    certified: Length | None = None
    """mm, that no larger ball can hide within reach of the probe; only in simulation."""
    accurate: Length | None = None
    """mm, that the expected error of the surface has in the mean at most, and its 95th percentile at most three times;
    only in simulation."""


class RunTable(Table):
    """Limits of the whole run."""

    seed: int = Field(default=1, ge=0, lt=2**63)
    """Of everything random."""
    time_limit: Length = 7200.0
    """s of the robot's time, then the run ends early with its data kept."""
    until: UntilTable = UntilTable()


class Scene(Table):
    """A whole exploration. World frame: z up, origin on the table under the object's middle, lines along y."""

    name: str = ""
    """The file's stem when left out."""
    title: str = ""
    calibration: str = ""
    """File that `lwrprobe calibrate` has written; a relative path starts at the scene file's folder."""
    arm: ArmTable = ArmTable()
    probe: ProbeTable = ProbeTable()
    sensor: SensorTable = SensorTable()
    drivers: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Tables `[drivers.<name>]`: each driver plug-in's own options, checked by the plug-in."""
    objects: tuple[Shape, ...] = Field(default=(), alias="object", strict=False)
    """Tables `[[object]]`: the objects on the table."""
    table: GroundTable = GroundTable()
    area: AreaTable = AreaTable()
    motion: MotionTable = MotionTable()
    contact: ContactTable = ContactTable()
    safety: SafetyTable = SafetyTable()
    map: MapTable = MapTable()
    clearance: ClearanceTable = ClearanceTable()
    strategy: StrategyTable = StrategyTable()
    reconstruction: ReconstructionTable = ReconstructionTable()
    run: RunTable = RunTable()
    uncertainty: UncertaintyTable = UncertaintyTable()
    truth: TruthTable = TruthTable()

    @model_validator(mode="after")
    def _table_is_out_of_reach(self) -> Self:
        lowest = self.table.height + self.probe.radius
        if self.table.present and not self.table.tilt_deg and self.area.lower[2] < lowest:
            height = self.area.lower[2]
            raise Refusal("area.lower z", height, f"at least table.height + probe.radius, {lowest:g}")
        return self

    @model_validator(mode="after")
    def _inertia_is_no_touch(self) -> Self:
        most = INERTIA * self.contact.threshold / self.motion.acceleration
        if self.probe.mass > most:
            allowed = (
                f"at most {most:.3g} kg: accelerated with {self.motion.acceleration:g} m/s^2 (motion.acceleration) a "
                f"heavier one reads like a touch of {self.contact.threshold:g} N (contact.threshold)"
            )
            raise Refusal("probe.mass", self.probe.mass, allowed)
        return self

    @model_validator(mode="after")
    def _torque_sensor_measures_the_target(self) -> Self:
        lever, torque = self.probe.sensor_distance, self.safety.torque_share * min(self.probe.torque_range[:2])
        if self.contact.target * lever >= torque:
            allowed = (
                f"less than {torque / lever:.3g} N: across a stick whose sphere is {lever:g} m from the sensor "
                f"(probe.sensor_distance) that is the torque up to which it is used (probe.torque_range, "
                "safety.torque_share)"
            )
            raise Refusal("contact.target", self.contact.target, allowed)
        return self

    def solid(self) -> Solid:
        """All objects, without the table, as one `Solid` with exact geometry; raises SceneError naming the object."""
        from lwrprobe.scene.solid import Solid

        try:
            return Solid.from_shapes(self.objects)
        except SceneError as error:
            raise SceneError(f"{self.name}: {error.field}", error.value, error.allowed) from error


def _behind(top: float, length: float, x: float = 0.0) -> np.ndarray:
    """Pose of a body that reaches from z = `top` by `length` towards the flange."""
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, top - 0.5 * length
    return pose
