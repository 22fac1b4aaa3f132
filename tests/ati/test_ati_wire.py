"""Commands and records: worked vectors, recorded figures, every mask against the emulator, nothing invalid accepted."""

import os

import numpy as np
import pytest
from naive_ati import naive_crc, naive_records

from lwrprobe.contracts import SampleStatus
from lwrprobe_ati.emulator.datagrams import crc, read_order, record_bytes
from lwrprobe_ati.wire import (
    Command,
    Light,
    Record,
    battery_light,
    decode_datagram,
    encode_command,
    powered,
    status_flags,
)

RANDOM = np.random.default_rng(17)
FUZZ = int(os.environ.get("LWRPROBE_FUZZ", 20_000))
"""Datagrams thrown at each decoder; the figure in the docs is from a million."""
LIMIT = 2**31

VECTORS = [
    (Command.START, 0, 0, "000a0001000000007346"),
    (Command.START, 7, 100, "000a0701000000649725"),
    (Command.STOP, 0, 0, "000600027d48"),
    (Command.STOP, 1, 0, "000601024e79"),
    (Command.PING, 0, 0, "000600041d8e"),
    (Command.RESET_TELNET, 255, 0, "0006ff050e50"),
]

RECORDED = [
    # stamp, sequence, status 1, status 2, battery, mask, first three counts
    "4e886762 0004085e 00150aaa 01050009 07 1f fff9bae4 fffe5f4b fffc9374",
    "4e886783 0004085f 00150aaa 01050009 07 1f fff9bae4 fffe5f4b fffc9374",
    "4e8867a4 00040860 00150aaa 01050009 07 1f fff9bae4 fffe5ef1 fffc9374",
    "4e8867c5 00040861 00150aaa 01050009 07 1f fff9bae4 fffe5ef1 fffc9374",
    "4e8867e5 00040862 00150aaa 01050009 07 1f fff9bae4 fffe5ef1 fffc9374",
]


def counts(transducers):
    return {t: RANDOM.integers(-LIMIT, LIMIT, 6).tolist() for t in transducers}


def mask_of(transducers):
    return sum(1 << (t - 1) for t in transducers)


@pytest.mark.parametrize(("command", "sequence", "packets", "expected"), VECTORS)
def test_commands_match_the_worked_vectors(command, sequence, packets, expected):
    data = encode_command(command, sequence, packets)
    assert data.hex() == expected
    assert crc(data) == naive_crc(data) == 0
    assert read_order(data).code == command
    assert read_order(data).packets == packets


def test_check_string():
    assert crc(b"123456789") == naive_crc(b"123456789") == 0xEDEB


def test_sequence_of_commands_wraps():
    assert encode_command(Command.STOP, 257) == encode_command(Command.STOP, 1)


@pytest.mark.parametrize("mask", range(1, 64))
def test_blocks_are_packed_by_mask(mask):
    active = [t for t in range(1, 7) if mask >> (t - 1) & 1]
    blocks = counts(active)
    data = record_bytes(5, 6, 7, 8, 9, mask, blocks.values())
    assert len(data) == 18 + 24 * len(active)
    for transducer in range(1, 7):
        decoded = decode_datagram(data, transducer)
        if transducer not in active:
            assert decoded == "absent"
            continue
        record = decoded.records[0]
        assert record == Record(5, 6, (7, 8), 9, mask, tuple(blocks[transducer]))
    assert naive_records(data)[0][-1] == {t: tuple(c) for t, c in blocks.items()}


@pytest.mark.parametrize("left_over", [0, 1, 2, 17])
def test_several_records_and_left_over_bytes(left_over):
    rows = [counts([2, 5]) for _ in range(4)]
    data = b"".join(record_bytes(k, 100 + k, 0, 0, 7, 0x12, row.values()) for k, row in enumerate(rows))
    decoded = decode_datagram(data + bytes(left_over), 5)
    assert [r.counts for r in decoded.records] == [tuple(row[5]) for row in rows]
    assert decoded.left_over == left_over


def test_eighteen_bytes_behind_are_no_left_over():
    data = record_bytes(1, 1, 0, 0, 7, 1, counts([1]).values())
    assert decode_datagram(data + bytes(18), 1) == "size"


def test_records_that_do_not_follow_each_other_are_not_believed():
    first = record_bytes(1, 10, 0, 0, 7, 1, [[0] * 6])
    for sequence, mask, blocks in ((10, 1, 1), (12, 1, 1), (11, 3, 2)):
        second = record_bytes(2, sequence, 0, 0, 7, mask, [[0] * 6] * blocks)
        assert decode_datagram(first + second, 1) == "content"
    wrapped = record_bytes(1, 2**32 - 1, 0, 0, 7, 1, [[0] * 6]) + record_bytes(2, 0, 0, 0, 7, 1, [[0] * 6])
    assert len(decode_datagram(wrapped, 1).records) == 2


@pytest.mark.parametrize("blocks", range(1, 7))
def test_mask_of_very_old_firmware_follows_from_the_length(blocks):
    rows = counts(range(1, blocks + 1))
    data = record_bytes(1, 1, 0, 0, 7, 0, rows.values())
    assert decode_datagram(data, blocks).records[0].counts == tuple(rows[blocks])
    assert decode_datagram(data, 6) == "absent" or blocks == 6


def test_recorded_heads():
    """Only the head and three values were recorded: the rest of each record is filled up with zeros."""
    decoded = []
    for line in RECORDED:
        data = bytes.fromhex(line.replace(" ", "")) + bytes(12 + 4 * 24)
        decoded.append(decode_datagram(data, 1).records[0])
    assert [r.sequence for r in decoded] == list(range(0x4085E, 0x40863))
    assert decoded[0].counts[:3] == (-410908, -106677, -224396)
    steps = np.diff([r.stamp for r in decoded])
    assert set(steps) <= {32, 33}
    assert decoded[0].stamp / 4096 == pytest.approx(321670.4614, abs=1e-4)
    for record in decoded:
        assert status_flags(record, 1) == SampleStatus.OK
        assert status_flags(record, 4) == SampleStatus.SATURATED
        assert status_flags(record, 6) == SampleStatus.INVALID
        assert [powered(record, t) for t in range(1, 7)] == [True] * 5 + [False]
        assert battery_light(record) is Light.GREEN


def test_dark_battery_light_of_the_records_is_blinking():
    record = Record(0, 0, (0x001502AA, 0x01050009), 7, 0x1F, (0,) * 6)
    assert battery_light(record) is Light.DARK
    assert status_flags(record, 1) == SampleStatus.OK


@pytest.mark.parametrize("transducer", range(1, 7))
def test_status_bits(transducer):
    group, place = divmod(transducer - 1, 3)

    def flags(bit, common=0):
        words = [common, 0]
        words[group] |= 1 << bit | 1 << (16 + 2 * place)
        return status_flags(Record(0, 0, tuple(words), 7, 63, (0,) * 6), transducer)

    assert flags(24 + place) == SampleStatus.SATURATED
    assert flags(27 + place) == SampleStatus.BRIDGE_LOW
    assert flags(2 * place) == SampleStatus.OK
    assert flags(2 * place, common=1 << 10) == SampleStatus.LOW_BATTERY


def mutated(good, random):
    data = bytearray(good)
    kind = random.integers(0, 5)
    if kind == 0:
        return random.bytes(int(random.integers(0, 400)))
    if kind == 1:
        return bytes(data[: int(random.integers(0, len(data)))])
    if kind == 2:
        return bytes(data) + random.bytes(int(random.integers(1, 60)))
    for place in random.integers(0, len(data), size=int(random.integers(1, 6))):
        data[place] = int(random.integers(0, 256))
    return bytes(data)


def test_random_and_mutated_records():
    good = [
        record_bytes(9, 10, 0x00150AAA, 0, 7, 0x12, counts([2, 5]).values()),
        b"".join(record_bytes(9 + k, 10 + k, 0, 0, 7, 0x01, counts([1]).values()) for k in range(3)),
        record_bytes(9, 10, 0, 0, 7, 0x3F, counts(range(1, 7)).values()),
    ]
    accepted = 0
    for n in range(FUZZ):
        data = mutated(good[n % 3], RANDOM)
        transducer = 1 + n % 6
        decoded = decode_datagram(data, transducer)
        if isinstance(decoded, str):
            continue
        accepted += 1
        expected = naive_records(data)
        assert expected is not None
        assert len(expected) == len(decoded.records)
        for record, (stamp, sequence, one, two, battery, mask, blocks) in zip(decoded.records, expected):
            assert record == Record(stamp, sequence, (one, two), battery, mask, blocks[transducer])
    assert 0 < accepted < FUZZ


def test_random_and_mutated_commands():
    good = [encode_command(command, 9, 100) for command in Command]
    accepted = 0
    for n in range(FUZZ):
        data = mutated(good[n % len(good)], RANDOM)
        order = read_order(data)
        if order is not None:
            accepted += 1
            assert naive_crc(data) == 0
            assert len(data) == (10 if order.code == 1 else 6)
    assert accepted < FUZZ / 50
