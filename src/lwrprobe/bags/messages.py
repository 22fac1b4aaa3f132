"""Standard ROS 2 messages: their types, and CDR of those that a run writes many times a second.

The types and the serialisation are those of rosbags. A message of fixed length is serialised once and kept as a
template, into which each new stamp and its numbers are written.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np

from lwrprobe.errors import MissingExtraError

OCTOMAP = "octomap_msgs/msg/Octomap"
_OCTOMAP_TEXT = "std_msgs/Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data\n"
"""As in octomap_msgs 2.0 (BSD); no type store of rosbags contains it."""
_NANO = 1_000_000_000
_MARK = 123456.789


def require(what: str) -> None:
    """Raise MissingExtraError unless the libraries of the extra `bags` are installed."""
    for library in ("mcap", "rosbags"):
        if find_spec(library) is None:
            raise MissingExtraError(what, library, "bags")


@cache
def type_store() -> Any:
    """The message types of ROS 2 Humble, whose standard types later releases share, and octomap_msgs."""
    require("a bag")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_OCTOMAP_TEXT, OCTOMAP))
    return store


@cache
def kind(name: str) -> Any:
    """The message class of a type: `kind("std_msgs/msg/String")(data="...")`."""
    return type_store().types[name]


@cache
def definition(name: str) -> str:
    """The text of a type's definition with those that it contains, as a schema of the encoding `ros2msg`."""
    return str(type_store().generate_msgdef(name, ros_version=2)[0])


def serialise(message: Any) -> bytes:
    """CDR, little-endian, with its four bytes of encapsulation."""
    return bytes(type_store().serialize_cdr(message, message.__msgtype__))


def deserialise(data: bytes, name: str) -> Any:
    """The message of CDR; raises ValueError or the like where the bytes are no such message."""
    return type_store().deserialize_cdr(data, name)


def stamp(time: int) -> Any:
    """builtin_interfaces/Time of nanoseconds since the epoch."""
    return kind("builtin_interfaces/msg/Time")(*divmod(time, _NANO))


def header(time: int, frame: str = "world") -> Any:
    """std_msgs/Header."""
    return kind("std_msgs/msg/Header")(stamp(time), frame)


def seconds(of: Any) -> float:
    """s of a builtin_interfaces/Time."""
    return of.sec + 1e-9 * of.nanosec


class Template:
    """A stamped message whose only changes are its stamp and `count` float64 in a row.

    Parameters
    ----------
    message : with the numbers that `marks(count)` gives where the changing ones are, and any stamp
    count : of these
    """

    def __init__(self, message: Any, count: int) -> None:
        content = bytearray(serialise(message))
        place = content.find(struct.pack(f"<{count}d", *marks(count)))
        assert place >= 0, "the numbers of a template stand in a row"
        self._content, self._place = content, place
        self._numbers = struct.Struct(f"<{count}d")

    def at(self, time: int, numbers: Sequence[float]) -> bytes:
        """CDR of the message at a time [ns] with these numbers."""
        struct.pack_into("<iI", self._content, 4, *divmod(time, _NANO))
        self._numbers.pack_into(self._content, self._place, *numbers)
        return bytes(self._content)


def marks(count: int) -> list[float]:
    """Numbers that stand for the changing ones in a template."""
    return [_MARK + k for k in range(count)]


def joint_state(names: Sequence[str]) -> Template:
    """sensor_msgs/JointState of named joints, its positions [rad] to be filled in."""
    nothing = np.empty(0)
    message = kind("sensor_msgs/msg/JointState")(
        header(0, ""), list(names), np.array(marks(len(names))), nothing, nothing
    )
    return Template(message, len(names))


def wrench(frame: str) -> Template:
    """geometry_msgs/WrenchStamped in a frame; force [N] and torque [N·m] to be filled in."""
    vector, m = kind("geometry_msgs/msg/Vector3"), marks(6)
    both = kind("geometry_msgs/msg/Wrench")(vector(*m[:3]), vector(*m[3:]))
    return Template(kind("geometry_msgs/msg/WrenchStamped")(header(0, frame), both), 6)


def pose() -> Template:
    """geometry_msgs/PoseStamped in the world; place [m] and quaternion (x, y, z, w) to be filled in."""
    return Template(kind("geometry_msgs/msg/PoseStamped")(header(0), _pose(marks(7))), 7)


def _pose(numbers: Sequence[float]) -> Any:
    place = kind("geometry_msgs/msg/Point")(*numbers[:3])
    return kind("geometry_msgs/msg/Pose")(place, kind("geometry_msgs/msg/Quaternion")(*numbers[3:]))


def transforms(time: int, frames: Sequence[str], numbers: np.ndarray) -> Any:
    """tf2_msgs/TFMessage of frames in the world; `numbers` (n, 7) are place and quaternion (x, y, z, w)."""
    vector, turn = kind("geometry_msgs/msg/Vector3"), kind("geometry_msgs/msg/Quaternion")
    stamped, transform, head = (
        kind("geometry_msgs/msg/TransformStamped"),
        kind("geometry_msgs/msg/Transform"),
        header(time),
    )
    rows = [
        stamped(head, frame, transform(vector(*row[:3]), turn(*row[3:])))
        for frame, row in zip(frames, numbers.tolist())
    ]
    return kind("tf2_msgs/msg/TFMessage")(rows)


CLOUD_FIELDS = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "force", "confidence", "time")


def cloud(time: int, rows: np.ndarray) -> Any:
    """sensor_msgs/PointCloud2 in the world of rows (n, 9), float32: see `CLOUD_FIELDS`."""
    field, data = kind("sensor_msgs/msg/PointField"), np.ascontiguousarray(rows, np.float32)
    fields = [field(name, 4 * k, 7, 1) for k, name in enumerate(CLOUD_FIELDS)]
    width = 4 * len(CLOUD_FIELDS)
    flat = data.view(np.uint8).ravel()
    return kind("sensor_msgs/msg/PointCloud2")(
        header(time), 1, len(data), fields, False, width, width * len(data), flat, True
    )


def cloud_rows(message: Any) -> np.ndarray:
    """(n, 9) of a cloud that has the fields of `CLOUD_FIELDS`; those that it lacks are NaN.

    Raises ValueError for a cloud whose sizes contradict its data.
    """
    sizes = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
    count, step = int(message.width) * int(message.height), int(message.point_step)
    data = np.asarray(message.data, np.uint8)
    if count and (step <= 0 or count * step > len(data)):
        raise ValueError(f"a cloud of {count} points with {len(data)} bytes")
    rows = np.full((count, len(CLOUD_FIELDS)), np.nan)
    order = ">" if message.is_bigendian else "<"
    for field in message.fields:
        if field.name in CLOUD_FIELDS and field.datatype in sizes and count:
            form = np.dtype(order + sizes[field.datatype])
            if field.offset + form.itemsize > step:
                raise ValueError(f"field {field.name} lies outside its point")
            cells = data[: count * step].reshape(count, step)[:, field.offset : field.offset + form.itemsize]
            rows[:, CLOUD_FIELDS.index(field.name)] = np.ascontiguousarray(cells).view(form)[:, 0]
    return rows


def octomap(time: int, content: bytes, resolution: float) -> Any:
    """octomap_msgs/Octomap of the content of a `.bt` file."""
    data = np.frombuffer(content, np.int8, offset=content.index(b"\ndata\n") + 6)
    return kind(OCTOMAP)(header(time), True, "OcTree", resolution, data)


def table(columns: Sequence[str], rows: np.ndarray) -> Any:
    """std_msgs/Float64MultiArray of rows (n, columns); the names of the columns are the second dimension's label."""
    dimension, (n, width) = kind("std_msgs/msg/MultiArrayDimension"), rows.shape
    shape = [dimension("rows", n, n * width), dimension(",".join(columns), width, width)]
    return kind("std_msgs/msg/Float64MultiArray")(kind("std_msgs/msg/MultiArrayLayout")(shape, 0), rows.ravel())


def text(content: str) -> Any:
    """std_msgs/String."""
    return kind("std_msgs/msg/String")(content)


def log(time: int, sentence: str, warning: bool = False) -> Any:
    """rcl_interfaces/Log of the node `lwrprobe`."""
    return kind("rcl_interfaces/msg/Log")(stamp(time), 30 if warning else 20, "lwrprobe", sentence, "", "", 0)


SPHERE, LINES = 2, 5


def marker(time: int, name: str, shape: int, colour: Sequence[float], size: float, points: np.ndarray) -> Any:
    """visualization_msgs/Marker in the world: a sphere at points (1, 3), or lines between points (2 n, 3)."""
    point, vector = kind("geometry_msgs/msg/Point"), kind("geometry_msgs/msg/Vector3")
    place = points[0].tolist() if shape == SPHERE else [0.0, 0.0, 0.0]
    ends = [] if shape == SPHERE else [point(*row) for row in points.tolist()]
    cls = kind("visualization_msgs/msg/Marker")
    given: dict[str, Any] = {
        "header": header(time), "ns": name, "id": 0, "type": shape, "action": 0,
        "pose": _pose([*place, 0.0, 0.0, 0.0, 1.0]), "scale": vector(size, size, size),
        "color": kind("std_msgs/msg/ColorRGBA")(*colour), "lifetime": kind("builtin_interfaces/msg/Duration")(0, 0),
        "frame_locked": False, "points": ends, "colors": [], "texture_resource": "",
        "texture": kind("sensor_msgs/msg/CompressedImage")(header(time), "", np.empty(0, np.uint8)),
        "uv_coordinates": [], "text": "", "mesh_resource": "",
        "mesh_file": kind("visualization_msgs/msg/MeshFile")("", np.empty(0, np.uint8)),
        "mesh_use_embedded_materials": False,
    }  # fmt: skip
    return cls(**given)


def markers(found: Sequence[Any]) -> Any:
    """visualization_msgs/MarkerArray."""
    return kind("visualization_msgs/msg/MarkerArray")(list(found))
