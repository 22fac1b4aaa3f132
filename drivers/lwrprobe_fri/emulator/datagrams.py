"""Both datagrams of FRI 1.0 as the controller sees them: byte layouts by offset.

Written from the layout alone and sharing nothing with the driver's `wire`, so that each checks the other.
"""

from __future__ import annotations

import numpy as np


def _layout(size: int, rows: list[tuple[int, str, str, tuple[int, ...]]]) -> np.dtype:
    return np.dtype(
        {
            "names": [name for _, name, _, _ in rows],
            "formats": [(kind, shape) for _, _, kind, shape in rows],
            "offsets": [offset for offset, _, _, _ in rows],
            "itemsize": size,
        }
    )


_KRL = [
    (8, "krl_real", "<f4", (16,)),
    (72, "krl_int", "<i4", (16,)),
    (136, "krl_bool", "<u2", ()),
]
_HEAD = [(0, "sequence", "<u2", ()), (2, "reflected", "<u2", ()), (4, "size", "<u2", ()), (6, "id", "<u2", ())]

MEASUREMENT = _layout(
    916,
    [
        *_HEAD,
        *_KRL,
        (140, "timestamp", "<f4", ()),
        (144, "state", "<u2", ()),
        (146, "quality", "<u2", ()),
        (148, "measurement_time", "<f4", ()),
        (152, "command_time", "<f4", ()),
        (156, "safety_limits", "<f4", ()),
        (160, "answer_rate", "<f4", ()),
        (164, "latency", "<f4", ()),
        (168, "jitter", "<f4", ()),
        (172, "miss_rate", "<f4", ()),
        (176, "miss_counter", "<u4", ()),
        (180, "power", "<u2", ()),
        (182, "control", "<u2", ()),
        (184, "error", "<u2", ()),
        (186, "warning", "<u2", ()),
        (188, "temperature", "<f4", (7,)),
        (216, "measured_joints", "<f4", (7,)),
        (244, "measured_frame", "<f4", (12,)),
        (292, "commanded_joints", "<f4", (7,)),
        (320, "joint_offset", "<f4", (7,)),
        (348, "commanded_frame", "<f4", (12,)),
        (396, "frame_offset", "<f4", (12,)),
        (444, "torque", "<f4", (7,)),
        (472, "external_torque", "<f4", (7,)),
        (500, "tcp_wrench", "<f4", (6,)),
        (524, "jacobian", "<f4", (42,)),
        (692, "mass_matrix", "<f4", (49,)),
        (888, "gravity", "<f4", (7,)),
    ],
)

COMMAND = _layout(
    376,
    [
        *_HEAD,
        *_KRL,
        (140, "flags", "<u4", ()),
        (144, "joints", "<f4", (7,)),
        (172, "frame", "<f4", (12,)),
        (220, "added_torque", "<f4", (7,)),
        (248, "added_wrench", "<f4", (6,)),
        (272, "joint_stiffness", "<f4", (7,)),
        (300, "joint_damping", "<f4", (7,)),
        (328, "cart_stiffness", "<f4", (6,)),
        (352, "cart_damping", "<f4", (6,)),
    ],
)


def blank_measurement() -> np.ndarray:
    """(1,) record with size and id filled in, to be filled and sent with `tobytes` every cycle."""
    record = np.zeros(1, MEASUREMENT)
    record["size"] = 916
    record["id"] = 0x2006
    return record


def read_command(data: bytes) -> np.void | None:
    """The command in a datagram, None where size, packet size or id are wrong."""
    if len(data) != 376:
        return None
    command = np.frombuffer(data, COMMAND)[0]
    if command["size"] != 376 or command["id"] != 0x1005:
        return None
    return command
