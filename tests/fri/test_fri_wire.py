"""Both datagrams: worked vectors, every field against the emulator's layout, and nothing invalid accepted."""

import math
import os
import struct

import numpy as np
import pytest

from lwrprobe_fri import wire
from lwrprobe_fri.emulator import datagrams
from lwrprobe_fri.wire import CommandWriter, Field, Quality, State, decode_measurement

RANDOM = np.random.default_rng(5)
FUZZ = int(os.environ.get("LWRPROBE_FUZZ", 20_000))
"""Datagrams thrown at each decoder; the figure in the docs is from a million."""


def measurement(**fields):
    record = datagrams.blank_measurement()
    record["state"], record["quality"] = 1, 3
    record["measurement_time"] = record["command_time"] = 0.01
    for name, value in fields.items():
        record[name] = value
    return record.tobytes()


def test_sizes_are_those_of_the_vendor_header():
    assert datagrams.MEASUREMENT.itemsize == wire._MEASUREMENT.size == wire.MEASUREMENT_SIZE == 916
    assert datagrams.COMMAND.itemsize == wire._COMMAND.size == wire.COMMAND_SIZE == 376


def test_command_matches_the_worked_vector():
    writer = CommandWriter(Field.JOINT_POSITION, [0.0] * 7, [0.0] * 7)
    data = writer.pack(1, 2, [0] * 16, [0.5] + [0.0] * 6)
    assert data[:8].hex(" ") == "01 00 02 00 78 01 05 10"
    assert data[140:148].hex(" ") == "01 00 00 00 00 00 00 3f"
    assert not any(data[148:])


def test_measurement_matches_the_worked_vector():
    assert measurement(sequence=1, reflected=2)[:8].hex(" ") == "01 00 02 00 94 03 06 20"


def test_every_command_field_arrives_where_the_emulator_looks():
    joints, integers = RANDOM.uniform(-2, 2, 7), RANDOM.integers(-(2**31), 2**31, 16).tolist()
    stiffness, damping = RANDOM.uniform(0, 900, 7), RANDOM.uniform(0, 1, 7)
    fields = Field.JOINT_POSITION | Field.JOINT_STIFFNESS | Field.JOINT_DAMPING
    command = datagrams.read_command(bytes(CommandWriter(fields, stiffness, damping).pack(65535, 7, integers, joints)))
    assert (command["sequence"], command["reflected"], command["flags"]) == (65535, 7, 0x31)
    assert command["krl_int"].tolist() == integers
    for name, sent in (("joints", joints), ("joint_stiffness", stiffness), ("joint_damping", damping)):
        assert command[name] == pytest.approx(sent, rel=1e-6)
    for name in ("krl_real", "frame", "added_torque", "added_wrench", "cart_stiffness", "cart_damping"):
        assert not command[name].any()


@pytest.mark.parametrize(
    ("field", "attribute"),
    [
        ("sequence", "sequence"),
        ("reflected", "reflected"),
        ("krl_bool", "krl_bool"),
        ("timestamp", "timestamp"),
        ("safety_limits", "safety_factor"),
        ("answer_rate", "answer_rate"),
        ("latency", "latency"),
        ("jitter", "jitter"),
        ("miss_rate", "miss_rate"),
        ("miss_counter", "misses"),
        ("power", "power"),
        ("control", "control"),
        ("error", "error"),
        ("warning", "warning"),
    ],
)
def test_scalar_fields(field, attribute):
    assert getattr(decode_measurement(measurement(**{field: 3})), attribute) == 3


@pytest.mark.parametrize(
    ("field", "attribute", "size"),
    [
        ("krl_real", "krl_real", 16),
        ("krl_int", "krl_int", 16),
        ("temperature", "temperature", 7),
        ("measured_joints", "measured", 7),
        ("measured_frame", "measured_frame", 12),
        ("torque", "torque", 7),
        ("mass_matrix", "mass_matrix", 49),
        ("external_torque", "external_torque", 7),
    ],
)
def test_vector_fields(field, attribute, size):
    values = (np.arange(size) + 1) / 8 if field != "krl_int" else np.arange(size) - 5
    decoded = decode_measurement(measurement(**{field: values}))
    assert np.ravel(getattr(decoded, attribute)).tolist() == values.tolist()


def test_set_point_is_the_sum_of_both_parts():
    decoded = decode_measurement(measurement(commanded_joints=np.arange(7) / 8, joint_offset=np.full(7, 0.25)))
    assert decoded.set_point == [0.25 + i / 8 for i in range(7)]


def test_wrench_is_put_into_the_usual_order():
    decoded = decode_measurement(measurement(tcp_wrench=[1, 2, 3, 6, 5, 4]))
    assert decoded.tcp_wrench.tolist() == [1, 2, 3, 4, 5, 6]


def test_third_joint_of_the_wire_is_e1():
    assert wire.JOINTS == ("A1", "A2", "E1", "A3", "A4", "A5", "A6")


@pytest.mark.parametrize("size", [0, 1, 8, 376, 915, 917, 1832])
def test_wrong_size_is_refused(size):
    assert decode_measurement(bytes(size)) == "size"
    assert datagrams.read_command(bytes(min(size, 375))) is None


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"id": 0x1005}, "id"),
        ({"size": 915}, "id"),
        ({"state": 0}, "content"),
        ({"state": 3}, "content"),
        ({"quality": 4}, "content"),
        ({"command_time": 0.0}, "content"),
        ({"command_time": math.nan}, "content"),
        ({"measurement_time": 1.0}, "content"),
        ({"timestamp": math.inf}, "content"),
        ({"measured_joints": [0, 0, math.nan, 0, 0, 0, 0]}, "content"),
        ({"measured_joints": [0, 0, 0, 0, 0, 0, 4.0]}, "content"),
        ({"commanded_joints": [-math.inf, 0, 0, 0, 0, 0, 0]}, "content"),
        ({"joint_offset": [0, 7.0, 0, 0, 0, 0, 0]}, "content"),
        ({"temperature": [0, 0, 0, 0, 0, 0, math.nan]}, "content"),
        ({"external_torque": [math.inf, 0, 0, 0, 0, 0, 0]}, "content"),
    ],
)
def test_impossible_content_is_refused(fields, reason):
    assert decode_measurement(measurement(**fields)) == reason


def naive_validity(data):
    """The same promises, read off the layout one by one."""
    if len(data) != 916 or struct.unpack_from("<HH", data, 4) != (916, 0x2006):
        return False
    state, quality = struct.unpack_from("<HH", data, 144)
    times = struct.unpack_from("<ff", data, 148)
    joints = struct.unpack_from("<7f", data, 216) + struct.unpack_from("<7f", data, 292)
    finite = struct.unpack_from("<f", data, 140) + struct.unpack_from("<7f", data, 188)
    finite += struct.unpack_from("<14f", data, 444)
    return (
        state in (1, 2)
        and quality in (0, 1, 2, 3)
        and all(0 < t <= 0.2 for t in times)
        and all(math.isfinite(v) for v in finite)
        and all(abs(q) <= 3.2 for q in joints)
        and all(abs(q) <= 6.4 for q in struct.unpack_from("<7f", data, 320))
    )


def mutated(good, random):
    data = bytearray(good)
    kind = random.integers(0, 4)
    if kind == 0:
        return random.bytes(int(random.integers(0, 1400)))
    if kind == 1:
        return bytes(data[: int(random.integers(0, len(data)))])
    for place in random.integers(0, len(data), size=int(random.integers(1, 9))):
        data[place] = int(random.integers(0, 256))
    return bytes(data)


def test_random_and_mutated_measurements():
    good = measurement(measured_joints=RANDOM.uniform(-2, 2, 7), krl_int=RANDOM.integers(-9, 9, 16))
    accepted = 0
    for _ in range(FUZZ):
        data = mutated(good, RANDOM)
        decoded = decode_measurement(data)
        assert isinstance(decoded, str) != naive_validity(data)
        if not isinstance(decoded, str):
            accepted += 1
            assert State(decoded.state)
            assert Quality(decoded.quality) is not None
            assert np.isfinite(decoded.measured).all()
            assert np.isfinite(decoded.set_point).all()
    assert 0 < accepted < FUZZ


def test_random_and_mutated_commands():
    good = bytes(CommandWriter(Field.JOINT_POSITION, [0] * 7, [0] * 7).pack(3, 4, [0] * 16, [0.1] * 7))
    for _ in range(FUZZ):
        data = mutated(good, RANDOM)
        valid = len(data) == 376 and struct.unpack_from("<HH", data, 4) == (376, 0x1005)
        assert (datagrams.read_command(data) is not None) == valid
