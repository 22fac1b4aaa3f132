"""Order of measurements: gaps, repetitions, late-comers, nonsense and restarts."""

import numpy as np
import pytest

from lwrprobe_fri.emulator import datagrams
from lwrprobe_fri.packet_filter import PacketFilter
from lwrprobe_fri.wire import decode_measurement


def at(sequence, joint=0.0):
    record = datagrams.blank_measurement()
    record["state"] = 1
    record["measurement_time"] = record["command_time"] = 0.01
    record["sequence"] = sequence & 0xFFFF
    record["measured_joints"] = joint
    return decode_measurement(record.tobytes())


@pytest.fixture
def packets():
    return PacketFilter(np.full(7, 2.0))


def steps(packets, *sequences):
    return [packets.steps(at(sequence)) for sequence in sequences]


def test_losses_are_counted_over_the_wrap(packets):
    assert steps(packets, 65533, 65534, 1, 2) == [1, 1, 3, 1]
    assert packets.lost == 2


def test_repetition_and_late_comer_are_not_used(packets):
    assert steps(packets, 10, 11, 11, 9, 12) == [1, 1, 0, 0, 1]
    assert (packets.repeated, packets.old, packets.lost) == (1, 1, 0)


def test_single_wild_sequence_number_changes_nothing(packets):
    assert steps(packets, 10, 11, 5000, 12, 13) == [1, 1, 0, 1, 1]
    assert (packets.implausible, packets.restarts) == (1, 0)


def test_restarted_controller_is_accepted_after_three(packets):
    assert steps(packets, 5000, 5001, 1, 2, 3, 4) == [1, 1, 0, 0, 1, 1]
    assert packets.restarts == 1


def test_joint_that_cannot_have_got_there_is_refused(packets):
    assert packets.steps(at(1, 0.0)) == 1
    assert packets.steps(at(2, 0.5)) == 0
    assert packets.steps(at(3, 0.01)) == 2
    assert packets.implausible == 1
