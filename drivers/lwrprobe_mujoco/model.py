"""The MuJoCo model of a scene: arm, probe, table and objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from lwrprobe.contracts import LinkShape
from lwrprobe.kinematics import LinkInertia, Robot, link_inertias
from lwrprobe.scene import Scene
from lwrprobe_mujoco.config import MujocoConfig
from lwrprobe_mujoco.solids import Piece, pieces

TOUCHED, TOUCHING = 1, 2
"""Collision bits of what stands around, and of what moves."""
MIN_RADIUS = 0.05
"""m, of a body that counts for nothing."""
NEAR = 0.002
"""m, at which the steps become short."""
LARGEST_STIFFNESS = 0.5
"""Of a spring, over mass and 1/step^2; a stiffer one cannot be integrated and is taken as rigid."""
RESOLVED = 0.25
"""Natural frequency of a contact times the step, up to which the step resolves it, with MuJoCo's mean mass of the
stick. Across, that is lighter: at twice as much it chatters, and a stiffer contact grows without bound."""
STICK_HINGE = 1.0 / 3.0
"""Where a rigid stick must be hinged, as a share of its length from its foot, so that both the deflection and the
slope at its end are those of a cantilever: F L^3 / 3 E I and F L^2 / 2 E I."""

_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "hull": mujoco.mjtGeom.mjGEOM_MESH,
}


@dataclass(slots=True, frozen=True)
class Model:
    """A compiled model and where its parts are.

    Attributes
    ----------
    compiled : mujoco.MjModel
    joints : number of the arm's joints, the first ones of the model
    sphere, stick : numbers of these geometries; stick is -1 without one
    links : numbers of the geometries of all that must not touch anything
    softened : N/m, of contacts that are stiffer in the scene than a step resolves, 0 where none is
    """

    compiled: Any
    joints: int
    sphere: int
    stick: int
    links: frozenset[int]
    softened: float


def build(scene: Scene, robot: Robot, config: MujocoConfig) -> Model:
    """The model of a scene with the arm `robot`. Raises SceneError for an object that cannot be."""
    spec = mujoco.MjSpec()
    spec.option.timestep = config.timestep
    spec.option.gravity = config.gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = config.friction_stiffening
    spec.option.noslip_iterations = 10
    spec.compiler.balanceinertia = True
    names = _add_surroundings(spec, scene, config)
    flange = _add_arm(spec, robot, config)
    links = _add_body_of_probe(flange, robot, scene)
    _add_probe(spec, flange, robot, scene, config)
    compiled = spec.compile()
    softened = _set_contacts(compiled, scene, config, names)
    number = {compiled.geom(i).name: i for i in range(compiled.ngeom)}
    arm_links = [f"link {i}" for i in range(len(robot.swinging_links))]
    return Model(
        compiled=compiled,
        joints=robot.n,
        sphere=number["sphere"],
        stick=number.get("stick", -1),
        links=frozenset(number[name] for name in links + arm_links),
        softened=softened,
    )


def _quaternion(pose: np.ndarray) -> np.ndarray:
    out = np.empty(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(pose[:3, :3]).ravel())
    return out


def _add_surroundings(spec: Any, scene: Scene, config: MujocoConfig) -> list[list[str]]:
    """Table and objects; the names of the geometries of each, the table's first."""
    names: list[list[str]] = [[]]
    if scene.table.present:
        plane = scene.table.plane()
        assert plane is not None
        frame = np.eye(4)
        frame[:3, 2] = plane[:3]
        frame[:3, 0] = np.cross([0.0, 1.0, 0.0], plane[:3])
        frame[:3, 0] /= np.linalg.norm(frame[:3, 0])
        frame[:3, 1] = np.cross(frame[:3, 2], frame[:3, 0])
        geom = spec.worldbody.add_geom(
            name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1], pos=plane[3] * plane[:3]
        )
        geom.quat = _quaternion(frame)
        geom.contype, geom.conaffinity = TOUCHED, TOUCHING
        names[0].append("table")
    for k, shape in enumerate(scene.objects):
        body = spec.worldbody
        parts = pieces(shape, config.mesh_tolerance)
        if shape.movable:
            body = spec.worldbody.add_body(name="movable")
            body.add_freejoint()
        for i, piece in enumerate(parts):
            geom = _add_piece(spec, body, f"object {k} {i}", piece)
            geom.contype, geom.conaffinity = TOUCHED, TOUCHING
            if shape.movable:
                geom.contype |= TOUCHING  # it stands on the table
                geom.mass = shape.mass / len(parts)
        names.append([f"object {k} {i}" for i in range(len(parts))])
    return names


def _add_piece(spec: Any, body: Any, name: str, piece: Piece) -> Any:
    geom = body.add_geom(name=name, type=_TYPES[piece.kind], pos=piece.pose[:3, 3])
    geom.quat = _quaternion(piece.pose)
    if piece.corners is None:
        geom.size = [*piece.size, *([0.0] * (3 - len(piece.size)))]
    else:
        mesh = spec.add_mesh(name=name)
        mesh.uservert = piece.corners.ravel()
        geom.meshname = name
    return geom


def _add_arm(spec: Any, robot: Robot, config: MujocoConfig) -> Any:
    """The chain of links; the last link's body, in whose frame the joint has turned already."""
    shapes: list[list[LinkShape]] = [[] for _ in range(robot.n + 1)]
    for link in robot.links:
        shapes[int(link.carrier)].append(link)
    count = 0
    parent, place = spec.worldbody, robot.base
    for i, inertia in enumerate(link_inertias(robot, config.arm_mass)):
        before, after = _halves(robot, i)
        pose = place @ before
        body = parent.add_body(name=f"arm {i}", pos=pose[:3, 3], quat=_quaternion(pose))
        kind = mujoco.mjtJoint.mjJNT_SLIDE if robot.prismatic[i] else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=f"arm {i}", type=kind, axis=[0.0, 0.0, 1.0])
        body.gravcomp = 1.0  # the controller carries the arm's own weight
        _set_inertia(body, inertia, after)
        for link in shapes[i + 1]:
            if i + 1 > 1:
                _add_link(body, f"link {count}", link, after @ link.pose)
                count += 1
        parent, place = body, after
    frame = parent.add_body(name="flange", pos=place[:3, 3], quat=_quaternion(place))
    _set_small_inertia(frame, 1e-4)
    return frame


def _halves(robot: Robot, i: int) -> tuple[np.ndarray, np.ndarray]:
    """What stands before and behind the motion of joint i in its Denavit-Hartenberg transform, (4, 4) each."""
    turn, move, twist, along = np.eye(4), np.eye(4), np.eye(4), np.eye(4)
    c, s = np.cos(robot.theta[i]), np.sin(robot.theta[i])
    turn[:2, :2] = (c, -s), (s, c)
    move[2, 3] = robot.d[i]
    c, s = np.cos(robot.alpha[i]), np.sin(robot.alpha[i])
    twist[1:3, 1:3] = (c, -s), (s, c)
    along[0, 3] = robot.a[i]
    if robot.convention == "modified":
        return twist @ along @ turn, move
    return turn, move @ along @ twist


def _set_inertia(body: Any, link: LinkInertia, pose: np.ndarray) -> None:
    """Give a body a link's inertia, whose frame stands at `pose` (4, 4) in the body's."""
    turn = pose[:3, :3]
    tensor = turn @ link.tensor @ turn.T
    body.explicitinertial = True
    body.mass, body.ipos = link.mass, turn @ link.centre + pose[:3, 3]
    body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _set_small_inertia(body: Any, mass: float) -> None:
    """A body that counts for nothing, but that MuJoCo needs an inertia of."""
    body.explicitinertial = True
    body.mass, body.ipos = mass, np.zeros(3)
    body.inertia = np.full(3, mass * 0.4 * MIN_RADIUS**2)


def _add_link(body: Any, name: str, link: LinkShape, pose: np.ndarray) -> None:
    size = [0.5 * edge for edge in link.size] if link.kind == "box" else [link.size[0], 0.5 * link.size[1], 0.0]
    geom = body.add_geom(name=name, type=_TYPES[link.kind], size=size, pos=pose[:3, 3], quat=_quaternion(pose))
    geom.mass = 0.0
    geom.contype, geom.conaffinity = TOUCHING, TOUCHED


def _add_body_of_probe(flange: Any, robot: Robot, scene: Scene) -> list[str]:
    """Sensor, holder and fingers, which the flange carries; their names."""
    rigid = [link for link in scene.probe.as_probe().links if link.name != "stick"]
    for link in rigid:
        _add_link(flange, link.name, link, robot.tool @ link.pose)
    return [link.name for link in rigid]


def _add_probe(spec: Any, flange: Any, robot: Robot, scene: Scene, config: MujocoConfig) -> None:
    """Stick and sphere on the sensor. The stick is rigid and hinged where that bends like a cantilever."""
    probe = scene.probe.as_probe()
    length = probe.sensor_distance
    behind = np.eye(4)
    behind[2, 3] = -length
    pose = robot.tool @ behind
    mount = flange.add_body(name="mount", pos=pose[:3, 3], quat=_quaternion(pose))
    _set_small_inertia(mount, 1e-6)
    mount.add_site(name="sensor")
    for name, kind in (("force", mujoco.mjtSensor.mjSENS_FORCE), ("torque", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="sensor")
    stick = mount.add_body(name="probe")
    mass = max(probe.mass, 1e-5)
    stick.explicitinertial = True
    stick.mass, stick.ipos = mass, probe.centre_of_mass
    across = mass * length**2 / 12.0
    stick.inertia = [across, across, 0.4 * mass * probe.radius**2]
    for axis, (name, stiff) in enumerate(zip("xyz", 1.0 / np.where(probe.compliance > 0.0, probe.compliance, 1.0))):
        if probe.compliance[axis] == 0.0 or stiff * config.free_timestep**2 > LARGEST_STIFFNESS * mass:
            continue
        joint = stick.add_joint(name=f"stick {name}", pos=[0.0, 0.0, STICK_HINGE * length])
        if axis == 2:
            joint.type, joint.axis = mujoco.mjtJoint.mjJNT_SLIDE, [0.0, 0.0, 1.0]
            joint.stiffness = [stiff, 0.0, 0.0]
        else:  # deflection along x turns about y
            joint.type, joint.axis = mujoco.mjtJoint.mjJNT_HINGE, [0.0, 1.0, 0.0] if axis == 0 else [1.0, 0.0, 0.0]
            joint.stiffness = [stiff * ((1.0 - STICK_HINGE) * length) ** 2, 0.0, 0.0]
    sphere = stick.add_geom(name="sphere", type=_TYPES["sphere"], size=[probe.radius, 0.0, 0.0], pos=[0.0, 0.0, length])
    moving = [sphere]
    shape = next((link for link in probe.links if link.name == "stick"), None)
    if shape is not None:
        half = 0.5 * shape.size[1]
        moving.append(
            stick.add_geom(
                name="stick",
                type=_TYPES["capsule"],
                size=[shape.size[0], half, 0.0],
                pos=[0.0, 0.0, length + shape.pose[2, 3]],
            )
        )
    for geom in moving:
        geom.mass = 0.0
        geom.contype, geom.conaffinity = TOUCHING, TOUCHED


def _set_contacts(compiled: Any, scene: Scene, config: MujocoConfig, names: list[list[str]]) -> float:
    """Give each contact the stiffness K [N/m] and damping [N s/m] of its object; see `Model.softened`.

    MuJoCo's constraint at rest holds f = k r / ((1 - d) A) for a penetration r, with `solref` = (-k, -b), the
    impedance d, and A = 1/kg, the inverse mass that it finds at the sphere (MuJoCo's chapter on computation).
    """
    inverse_mass = float(compiled.body_invweight0[compiled.body("probe").id, 0])
    scale = (1.0 - config.impedance) * inverse_mass
    fastest, softened = RESOLVED / config.timestep, 0.0
    for material, geoms in zip((scene.table, *scene.objects), names):
        for name in geoms:
            i = compiled.geom(name).id
            compiled.geom_gap[i] = NEAR  # found from there on, forces from contact on
            compiled.geom_priority[i] = 1  # its numbers count, not the probe's
            stiff = min(material.stiffness * scale, fastest**2)
            if stiff < material.stiffness * scale:
                softened = stiff / scale
            # the step does not resolve how a light sphere bounces: its contact is damped critically at least
            damping = min(max(material.damping * scale, 2.0 * np.sqrt(stiff)), 2.0 * fastest)
            compiled.geom_solref[i] = -stiff, -damping
            compiled.geom_solimp[i] = config.impedance, config.impedance, 1e-3, 0.5, 2.0
            compiled.geom_friction[i] = material.friction, 0.0, 0.0
    return softened
