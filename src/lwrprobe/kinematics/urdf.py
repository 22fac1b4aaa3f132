"""Serial chains out of URDF files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import FormatError, InputError, MissingExtraError
from lwrprobe.kinematics.robot import Array, Robot

if TYPE_CHECKING:
    from yourdfpy import URDF
    from yourdfpy.urdf import Joint


def from_urdf(path: str | Path, tip: str | None = None) -> Robot:
    """The chain from a URDF file's root link to the link `tip`, by default its only last one, as a DH table.

    The DH frames follow from the joint axes (Denavit, Hartenberg 1955), so they are not the file's link frames; joint
    values, base and tip are. Fixed joints are folded in. Raises FormatError for a file that cannot be read, InputError
    for a `tip` that is not in it or is ambiguous, for a joint that is no revolute, continuous or prismatic one, and
    for one that mimics another; MissingExtraError without the URDF reader.
    """
    model = _read(Path(path))
    joints = _chain(model, tip)
    frame, axes, moving = np.eye(4), [], []
    for joint in joints:
        frame = frame @ (np.eye(4) if joint.origin is None else joint.origin)
        if joint.type != "fixed":
            direction = frame[:3, :3] @ np.asarray(joint.axis, dtype=float)
            axes.append((frame, direction / np.linalg.norm(direction)))
            moving.append(_checked(joint))
    if not moving:
        raise InputError("tip", tip, "a link behind at least one moving joint")
    base, rows, last = _dh_rows(axes)
    limits = np.array([_limits(joint) for joint in moving])
    return Robot(
        name=model.robot.name,
        a=rows[:, 0],
        alpha=rows[:, 1],
        d=rows[:, 2],
        theta=rows[:, 3],
        lower=limits[:, 0],
        upper=limits[:, 1],
        speed=limits[:, 2],
        prismatic=np.array([joint.type == "prismatic" for joint in moving]),
        base=base,
        tool=np.linalg.inv(last) @ frame,
    )


def _read(path: Path) -> URDF:
    try:
        from yourdfpy import URDF
    except ImportError as error:
        raise MissingExtraError("reading URDF files", "yourdfpy", "urdf") from error
    if not path.is_file():
        raise FormatError(f"{path}: no such file")
    try:
        return URDF.load(str(path), build_scene_graph=False, load_meshes=False, load_collision_meshes=False)
    except Exception as error:
        raise FormatError(f"{path}: no URDF that can be read: {error}") from error


def _chain(model: URDF, tip: str | None) -> list[Joint]:
    above = {joint.child: joint for joint in model.robot.joints}
    parents = {joint.parent for joint in model.robot.joints}
    ends = [link.name for link in model.robot.links if link.name not in parents]
    if tip is None and len(ends) != 1:
        raise InputError("tip", tip, f"one of the last links: {', '.join(ends)}")
    link = ends[0] if tip is None else tip
    if link not in {known.name for known in model.robot.links}:
        raise InputError("tip", tip, ", ".join(known.name for known in model.robot.links))
    joints = []
    while link in above:
        joints.append(above[link])
        link = above[link].parent
    return joints[::-1]


def _checked(joint: Joint) -> Joint:
    if joint.type not in ("revolute", "continuous", "prismatic"):
        raise InputError(f"joint {joint.name}", joint.type, "revolute, continuous, prismatic or fixed")
    if joint.mimic is not None:
        raise InputError(f"joint {joint.name}", "mimic", "joints that move on their own")
    return joint


def _limits(joint: Joint) -> tuple[float, float, float]:
    limit = joint.limit
    speed = np.inf if limit is None or not limit.velocity else limit.velocity
    if joint.type == "continuous" or limit is None:
        return -np.inf, np.inf, speed
    return limit.lower or 0.0, limit.upper or 0.0, speed


def _dh_rows(axes: list[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Base, rows (a, alpha, d, theta) and last frame of a chain of joint frames (4, 4) and axes (3,) at rest."""
    frame = _frame_on(*axes[0])
    base, rows = frame, []
    for k in range(1, len(axes)):
        row = _to_next_axis(frame, axes[k][0][:3, 3], axes[k][1])
        rows.append(row)
        frame = frame @ dh_transform(*row)
    rows.append((0.0, 0.0, 0.0, 0.0))
    return base, np.array(rows), frame


def _frame_on(frame: Array, axis: Array) -> Array:
    """The joint frame with its z turned onto the axis."""
    out = frame.copy()
    x = frame[:3, 0] if abs(frame[:3, 0] @ axis) < 0.7 else frame[:3, 1]
    x = x - (x @ axis) * axis
    x /= np.linalg.norm(x)
    out[:3, 0], out[:3, 1], out[:3, 2] = x, np.cross(axis, x), axis
    return out


def _to_next_axis(frame: Array, point: Array, axis: Array) -> tuple[float, float, float, float]:
    """a, alpha, d, theta from a frame whose z is one joint's axis to one whose z is the next, through `point`."""
    x, z, origin = frame[:3, 0], frame[:3, 2], frame[:3, 3]
    gap = point - origin
    normal = np.cross(z, axis)
    size = np.linalg.norm(normal)
    if size > 1e-9:
        normal /= size
        # the feet of the common normal on both axes
        d, along = np.linalg.solve(np.array([[1.0, -(z @ axis)], [z @ axis, -1.0]]), [gap @ z, gap @ axis])
        a = float((point + along * axis - origin - d * z) @ normal)
        if normal @ x < -1e-9:
            normal, a = -normal, -a
    else:
        d = float(gap @ z)
        normal = gap - d * z
        a = float(np.linalg.norm(normal))
        normal = normal / a if a > 1e-9 else x
        a = a if a > 1e-9 else 0.0
    theta = np.arctan2(np.cross(x, normal) @ z, x @ normal)
    alpha = np.arctan2(np.cross(z, axis) @ normal, z @ axis)
    return a, float(alpha), float(d), float(theta)


def dh_transform(a: float, alpha: float, d: float, theta: float) -> Array:
    """(4, 4) of one standard DH row."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
