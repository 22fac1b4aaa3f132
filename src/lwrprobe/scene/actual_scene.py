"""The scene as it really is: objects, table and probe with the departures of `[truth]`, and an area that holds them."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import ValidationError

from lwrprobe.contracts import SceneError
from lwrprobe.scene.scene import GroundTable, ProbeTable, Scene
from lwrprobe.scene.table import Pose
from lwrprobe.scene.truth import ANYWHERE, TruthTable

_MOVES = ("object_turn_deg", "object_shift_mm", "table_height_mm", "table_tilt_deg")
_OF_THE_PROBE = ("probe_length_mm", "sphere_radius_mm")
_LENGTHS = (
    "table_height_mm", "base_shift_mm", "probe_length_mm", "sphere_radius_mm", "dh_a_mm", "dh_d_mm",
)  # fmt: skip
_TURNS = ("base_turn_deg", "dh_offset_deg", "dh_twist_deg")
"""What raises or lowers the table as the arm sees it: by itself, and by its lever from the arm's base."""
_BESIDE, _ABOVE = 3.0, 1.2
"""Radii from the objects to the border of the area within which the sphere's centre moves."""
_SAMPLES = 5000
"""Points of the surface that say how far objects reach once they are turned."""
Drawn = dict[str, np.ndarray]


def actual_scene(scene: Scene) -> Scene:
    """The same scene with actual objects, table and probe, and without a table of departures; itself where ideal.

    For the simulator and for whoever compares a result with the truth. Raises SceneError naming a departure that
    leaves no probe, or objects that are too large for their area.
    """
    if scene.truth.ideal:
        return scene
    drawn = placed(scene, scene.truth.draw(scene.run.seed))
    table = _table(scene.table, drawn)
    return scene.model_copy(
        update={
            "truth": TruthTable(profile="ideal"),
            "probe": _probe(scene.probe, drawn),
            "table": table,
            "objects": _objects(scene, table, drawn),
        }
    )


def placed(scene: Scene, drawn: Drawn) -> Drawn:
    """What was drawn, with a place anywhere in the area as a turn and a shift of the objects.

    Raises SceneError for objects that do not fit into the area so turned.
    """
    if ANYWHERE not in drawn:
        return drawn
    others = {name: numbers for name, numbers in drawn.items() if name != ANYWHERE}
    if not scene.objects:
        return others
    turn, *shares = drawn[ANYWHERE]
    angle = 360.0 * float(turn) - 180.0
    solid = scene.solid()
    middle = 0.5 * np.add(*solid.bounds())
    points = (solid.sample_surface(_SAMPLES)[0] - middle) @ Pose(rpy_deg=(0.0, 0.0, angle)).matrix()[:3, :3].T
    beside = _BESIDE * scene.probe.radius
    least = np.array(scene.area.lower[:2]) + beside - points.min(axis=0)[:2]
    most = np.array(scene.area.upper[:2]) - beside - points.max(axis=0)[:2]
    if not (least <= most).all():
        needed = 1e3 * (np.ptp(points, axis=0)[:2] + 2.0 * beside)
        allowed = f"an area of at least {needed[0]:.0f} x {needed[1]:.0f} mm: the objects are turned by {angle:.0f} deg"
        raise SceneError(f"truth.{ANYWHERE}", True, allowed)
    shift = least + np.array(shares) * (most - least) - middle[:2]
    return others | {"object_turn_deg": np.array([angle]), "object_shift_mm": 1e3 * shift}


def widened_area(scene: Scene) -> Scene:
    """The scene with its area widened so that it holds the objects wherever `[truth]` may put them, and off the table.

    The area's floor rises to where the sphere stays off the table by three standard deviations of all that raises the
    table as the arm sees it, but not above the objects' middle: nobody lets the area of a probe reach into the table.
    What may be drawn counts, not what is drawn: the area says no more of the truth than its profile does. An area
    that is wide enough is kept, and where the objects lie anywhere in it, its sides and its top are.
    """
    reach = {name: departure.reach() for name in _MOVES if (departure := scene.truth.departure(name)) is not None}
    if not any(reach.values()) or not scene.objects:
        return scene
    lower, upper = scene.solid().bounds()
    low, high = np.array(scene.area.lower), np.array(scene.area.upper)
    half, middle = 0.5 * (upper - lower)[:2], 0.5 * (upper + lower)[:2]
    if reach.get("object_turn_deg"):
        half = np.full(2, np.hypot(*half))
    # The need does not depend on the area there is: a scene that was widened and written is not widened again.
    half = half + _BESIDE * scene.probe.radius + 1e-3 * reach.get("object_shift_mm", 0.0)
    most, least = np.maximum(high[:2], middle + half), np.minimum(low[:2], middle - half)
    top = float(high[2])
    if scene.truth.object_anywhere:
        most, least = high[:2], low[:2]
        middle, half = 0.5 * (most + least), 0.5 * (most - least)
    elif top >= upper[2]:
        raised = 1e-3 * reach.get("table_height_mm", 0.0)
        raised += np.tan(np.radians(reach.get("table_tilt_deg", 0.0))) * float(np.hypot(*half))
        top = max(top, float(upper[2]) + _ABOVE * scene.probe.radius + raised)
    floor = max(
        float(low[2]), min(_off_the_table(scene, middle, half), 0.5 * (lower[2] + upper[2]) + scene.probe.radius)
    )
    corners = {"lower": _corner(least[0], least[1], floor), "upper": _corner(most[0], most[1], top)}
    return scene.model_copy(update={"area": scene.area.model_copy(update=corners)})


def _off_the_table(scene: Scene, middle: np.ndarray, half: np.ndarray) -> float:
    """m, lowest height of the sphere's centre at which it stays off the table wherever `[truth]` may put that.

    `middle` and `half` (2,) m are those of what may be explored.
    """
    if not scene.table.present:
        return -np.inf
    lever = float(np.linalg.norm(middle[:2] - scene.arm.base.matrix()[:2, 3]))
    scales = dict.fromkeys(_LENGTHS, 1e-3) | dict.fromkeys(_TURNS, np.radians(1.0) * lever)
    scales["table_tilt_deg"] = np.radians(1.0) * float(np.hypot(*half))
    given = ((scale, scene.truth.departure(name)) for name, scale in scales.items())
    raised = [scale * departure.reach() for scale, departure in given if departure is not None]
    return scene.table.height + scene.probe.radius + float(np.sqrt(np.sum(np.square(raised))))


def _corner(x: float, y: float, z: float) -> tuple[float, float, float]:
    """To the micrometre."""
    return round(float(x), 6), round(float(y), 6), round(float(z), 6)


def _probe(probe: ProbeTable, drawn: Drawn) -> ProbeTable:
    changed: dict[str, Any] = {}
    if "probe_length_mm" in drawn:
        longer = 1e-3 * float(drawn["probe_length_mm"][0])
        changed["sensor_distance"] = probe.sensor_distance + longer
        changed["stick_length"] = probe.stick_length + longer
    if "sphere_radius_mm" in drawn:
        larger = 1e-3 * float(drawn["sphere_radius_mm"][0])
        changed["radius"] = probe.radius + larger
        changed["stick_length"] = changed.get("stick_length", probe.stick_length) - larger
    if "stick_stiffness_percent" in drawn:
        stiffer = 1.0 + 0.01 * float(drawn["stick_stiffness_percent"][0])
        changed["stiffness_lateral"] = probe.stiffness_lateral * stiffer
        changed["stiffness_axial"] = probe.stiffness_axial * stiffer
    if "payload_percent" in drawn:
        changed["mass"] = probe.mass * (1.0 + 0.01 * float(drawn["payload_percent"][0]))
    if "sphere_off_axis_mm" in drawn:
        # The sensor's frame lies behind the sphere and goes aside with it: the load stays where it is.
        aside, centre = 1e-3 * drawn["sphere_off_axis_mm"], probe.centre_of_mass
        changed["centre_of_mass"] = (centre[0] - float(aside[0]), centre[1] - float(aside[1]), centre[2])
    try:
        return ProbeTable(**{**probe.model_dump(), **changed})
    except ValidationError as error:
        given = {name: round(float(drawn[name][0]), 4) for name in _OF_THE_PROBE if name in drawn}
        reason = error.errors(include_url=False)[0]["msg"]
        raise SceneError("truth", given, f"departures that leave a probe ({reason})") from None


def _table(table: GroundTable, drawn: Drawn) -> GroundTable:
    changed: dict[str, Any] = {}
    if "table_height_mm" in drawn:
        changed["height"] = table.height + 1e-3 * float(drawn["table_height_mm"][0])
    if "table_tilt_deg" in drawn:
        x, y, z = _tilt(drawn) @ table.normal()
        changed["tilt_deg"] = float(np.degrees(np.arctan2(np.hypot(x, y), z)))
        if changed["tilt_deg"] > 0.0:
            changed["tilt_axis"] = (-float(y), float(x), 0.0)
    return table.model_copy(update=changed) if table.present else table


def _objects(scene: Scene, table: GroundTable, drawn: Drawn) -> tuple:
    changed: dict[str, Any] = {}
    for name, key in (
        ("friction", "object_friction"),
        ("stiffness", "object_stiffness"),
        ("damping", "object_damping"),
    ):
        if key in drawn:
            changed[name] = float(drawn[key][0])
    if "object_mass_kg" in drawn and len(scene.objects) == 1:
        changed |= {"movable": True, "mass": float(drawn["object_mass_kg"][0])}
    if any(name in drawn for name in _MOVES) and scene.objects:
        motion = _motion(scene, table, drawn)
        return tuple(shape.model_copy(update={**changed, "at": _moved(shape.at, motion)}) for shape in scene.objects)
    return tuple(shape.model_copy(update=changed) for shape in scene.objects)


def _motion(scene: Scene, table: GroundTable, drawn: Drawn) -> np.ndarray:
    """(4, 4) from where the scene puts the objects to where they are: moved on the table, and then with it."""
    ground = np.eye(4)
    if scene.table.present:
        ground[:3, :3] = _upright(scene.table.normal())
        ground[2, 3] = scene.table.height
    lower, upper = scene.solid().bounds()
    middle = np.linalg.solve(ground, np.append(0.5 * (lower + upper), 1.0))[:3]
    turn = Pose(rpy_deg=(0.0, 0.0, float(drawn.get("object_turn_deg", [0.0])[0]))).matrix()
    shift = np.append(1e-3 * drawn.get("object_shift_mm", np.zeros(2)), 0.0)
    turn[:3, 3] = middle + shift - turn[:3, :3] @ middle
    moved = ground.copy()
    if scene.table.present:
        moved[:3, :3] = _tilt(drawn) @ ground[:3, :3]
        moved[2, 3] = table.height
    return moved @ turn @ np.linalg.inv(ground)


def _upright(normal: np.ndarray) -> np.ndarray:
    """(3, 3) the smallest rotation from z to a unit normal."""
    from scipy.spatial.transform import Rotation

    axis = np.cross([0.0, 0.0, 1.0], normal)
    angle = np.arctan2(np.linalg.norm(axis), normal[2])
    return Rotation.from_rotvec(axis * (angle / max(np.linalg.norm(axis), 1e-300))).as_matrix()


def _tilt(drawn: Drawn) -> np.ndarray:
    x, y = (float(angle) for angle in drawn.get("table_tilt_deg", np.zeros(2)))
    return Pose(rpy_deg=(x, y, 0.0)).matrix()[:3, :3]


def _moved(at: Pose, motion: np.ndarray) -> Pose:
    from scipy.spatial.transform import Rotation

    pose = motion @ at.matrix()
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return Pose(xyz=tuple(pose[:3, 3].tolist()), rpy_deg=tuple(angles.tolist()))
