"""The driver against the emulated device over real sockets on the loopback interface."""

import socket
import time
from contextlib import contextmanager

import numpy as np
import pytest
from naive_device import NaiveDevice

from lwrprobe.contracts import (
    ConnectionLost,
    DeviceRefused,
    Driver,
    DriverContext,
    DriverError,
    InputError,
    SampleStatus,
)
from lwrprobe_ati import AtiConfig, AtiDriver
from lwrprobe_ati.emulator import AtiEmulator
from lwrprobe_ati.emulator import device as device_module
from lwrprobe_ati.emulator.datagrams import read_order
from lwrprobe_ati.emulator.dialogue import Dialogue
from lwrprobe_ati.health_checks import sensor_health
from lwrprobe_ati.wire import Command, encode_command
from lwrprobe_rig.reactor import Reactor

pytestmark = pytest.mark.realtime

LOAD = "2=1,-2,3.5,10,-20,30"
MACHINE_BUSY = SampleStatus.LATE | SampleStatus.LOST_BEFORE
"""What a stall of this machine may add to any sample."""
FORCE, TORQUE = [1.0, -2.0, 3.5], [0.010, -0.020, 0.030]


def sensor_for(device, local="127.0.0.1:0", **config):
    options = {"transducer": 2, "timeout": 3.0} | config
    addresses = {"telnet": device.telnet_address, "udp": device.udp_address, "local": local}
    return AtiDriver(DriverContext(AtiConfig(**addresses, **options), None)).sensor()


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def bench(emulate=None, **config):
    """(sensor, device), the sensor not yet open."""
    device = AtiEmulator("127.0.0.1:0", "127.0.0.1:0", **({"active": [2, 5]} | (emulate or {})))
    device.set_loads(LOAD)
    with Reactor([device]):
        sensor = sensor_for(device, **config)
        try:
            yield sensor, device
        finally:
            sensor.close()


def collect(sensor, count, seconds=10.0):
    samples, end = [], time.monotonic() + seconds
    while len(samples) < count:
        assert time.monotonic() < end, f"only {len(samples)} of {count} samples came"
        samples += sensor.read()
        time.sleep(0.002)
    return samples


def wait_for(condition, seconds=10.0):
    """The other side gets to it as soon as the machine lets it."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


def collect_until(sensor, wanted, seconds=10.0):
    """Read until a sample has the wanted flag; that sample."""
    end = time.monotonic() + seconds
    while True:
        assert time.monotonic() < end, f"{wanted!r} was never flagged"
        for sample in sensor.read():
            if sample.status & wanted:
                return sample
        time.sleep(0.002)


def read_on(sensor, seconds=10.0):
    """Read until an error comes."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sensor.read()
        time.sleep(0.005)


def test_plugin_fills_the_role_sensor():
    driver = AtiDriver(DriverContext(None, None))
    assert isinstance(driver, Driver)
    assert driver.roles == {"sensor"}
    assert driver.ground_truth() is None
    with pytest.raises(DriverError, match="role sensor"):
        driver.arm()


@pytest.mark.parametrize(("rate", "oversampling"), [(125, 16), (1000, 4), (4000, 1)])
def test_newtons_and_newton_metres(rate, oversampling):
    with bench(rate=rate, oversampling=oversampling) as (sensor, device):
        sensor.open()
        samples = collect(sensor, 40)
        mean = np.mean([np.r_[s.force, s.torque] for s in samples], axis=0)
        assert mean[:3] == pytest.approx(FORCE, abs=0.005)
        assert mean[3:] == pytest.approx(TORQUE, abs=5e-5)
        assert (np.diff([s.sequence for s in samples]) >= 1).all()
        times = np.diff([s.time for s in samples])
        assert (times > 0.0).all()
        assert abs(samples[-1].time - time.monotonic()) < 5.0
        assert device.settings.rate == rate


def test_second_transducer_of_a_sparse_mask():
    with bench(transducer=5) as (sensor, device):
        device.control("load 5=0,0,-4,0,0,1")
        sensor.open()
        assert collect(sensor, 10)[-1].force == pytest.approx([0, 0, -4], abs=0.02)


def test_input_that_was_off_is_powered():
    with bench(transducer=3) as (sensor, device):
        sensor.open()
        assert device.transducers[3].powered
        assert len(collect(sensor, 5)) >= 5


def test_matrix_is_applied_by_the_host_when_the_device_does_not():
    with bench() as (sensor, device):
        device.transducers[2].multiply = False
        sensor.open()
        assert not sensor.setup.calibration.device_multiplies
        mean = np.mean([np.r_[s.force, s.torque] for s in collect(sensor, 30)], axis=0)
        assert mean == pytest.approx(FORCE + TORQUE, abs=0.005)


def test_tare_removes_the_load():
    with bench() as (sensor, _):
        sensor.open()
        collect(sensor, 5)
        sensor.tare()
        after = collect(sensor, 20)
        assert np.abs([s.force for s in after]).max() < 0.02
        assert after[0].sequence > 5


def test_device_that_knows_neither_versions_nor_the_heading_of_the_bias_table():
    with bench() as (sensor, device):
        answer = device.console._answer

        def other_firmware(line):
            if line.startswith("versions"):
                return ["Error: unknown command"]
            return [row for row in answer(line) if "Bias" not in row]

        device.console._answer = other_firmware
        sensor.open()
        assert sensor.setup.firmware == ""
        sensor.tare()
        assert np.abs([s.force for s in collect(sensor, 20)]).max() < 0.02


def test_bias_that_the_device_does_not_take_is_refused():
    with bench() as (sensor, device):
        sensor.open()
        answer = device.console._answer
        device.console._answer = lambda line: ["OK"] if line == "bias 2 on" else answer(line)
        with pytest.raises(DeviceRefused, match="'bias' was answered with: Tr Ch Pwr"):
            sensor.tare()


@pytest.mark.parametrize("fault", ["pieces=0.001", "chatter=0.02", "pieces=0.001,chatter=0.05"])
def test_console_in_pieces_and_with_chatter(fault):
    with bench() as (sensor, device):
        device.control(f"fault {fault}")
        sensor.open()
        assert sensor.setup.calibration.serial == "FT20002"
        assert sensor.setup.firmware == "2.1.27"
        sensor.tare()


@pytest.mark.parametrize(
    ("order", "flag"),
    [
        ("saturate 2 on", SampleStatus.SATURATED),
        ("load 2=12.5,0,0,0,0,0", SampleStatus.SATURATED),
        ("load 2=0,0,0,0,0,121", SampleStatus.SATURATED),
        ("battery low", SampleStatus.LOW_BATTERY),
        ("bridge 2 on", SampleStatus.BRIDGE_LOW),
        ("stuck 2 on", SampleStatus.FROZEN),
        ("fault freeze", SampleStatus.FROZEN),
        ("fault loss=0.3", SampleStatus.LOST_BEFORE),
    ],
)
def test_faults_are_flagged_and_end_again(order, flag):
    with bench() as (sensor, device):
        sensor.open()
        collect(sensor, 5)
        device.control(order)
        collect_until(sensor, flag)
        device.control("fault none")
        device.set_loads(LOAD)
        # What was on its way may come for a while yet; then twenty in a row have to be free of it.
        wait_for(lambda: not any(s.status & flag & ~MACHINE_BUSY for s in collect(sensor, 20)))


def test_neighbours_saturation_does_not_concern_us():
    with bench() as (sensor, device):
        device.control("saturate 5 on")
        device.control("bridge 5 on")
        sensor.open()
        assert not any(s.status & ~MACHINE_BUSY for s in collect(sensor, 20))


def test_late_records_are_flagged():
    with bench() as (sensor, device):
        sensor.open()
        collect(sensor, 20)
        device.control("fault delay=0.09")
        sample = collect_until(sensor, SampleStatus.LATE)
        assert time.monotonic() - sample.time > 0.05


def test_losses_are_counted_as_the_sequence_tells():
    with bench() as (sensor, device):
        sensor.open()
        collect(sensor, 10)
        device.control("fault loss=0.2,duplicate=0.1,reorder=0.1,corrupt=0.05,resize=0.05")
        samples = collect(sensor, 120)
        packets, traffic = sensor.stream.packets, sensor.stream.traffic
        assert packets.lost > 5
        assert packets.repeated > 0
        assert packets.old + packets.implausible + traffic.malformed + traffic.absent > 0
        assert (np.diff([s.sequence for s in samples]) >= 1).all()
        assert (np.diff([s.time for s in samples]) > 0.0).all()
        assert not packets.rebooted


def test_silence_sends_start_again_and_goes_on():
    with bench(lost_after=10.0) as (sensor, device), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        sensor.open()
        collect(sensor, 5)
        host, _, port = device.udp_address.partition(":")
        stranger.sendto(encode_command(Command.STOP, 1), (host, int(port)))
        samples = collect(sensor, 10)
        assert sensor.restarts >= 1
        assert samples[-1].force == pytest.approx(FORCE, abs=0.02)


def test_lasting_silence_is_a_typed_loss():
    with bench(lost_after=0.4) as (sensor, device):
        sensor.open()
        device.control("fault down=1")
        with pytest.raises(ConnectionLost, match="has been silent for"):
            read_on(sensor)
        sensor.close()
        device.control("fault none")
        sensor.open()
        assert collect(sensor, 5)


def test_reboot_of_the_device_is_told_and_the_next_open_works():
    with bench(lost_after=5.0) as (sensor, device):
        sensor.open()
        collect(sensor, 5)
        device.control("restart 0.3")
        with pytest.raises(ConnectionLost, match="restarted"):
            read_on(sensor)
        sensor.close()
        sensor.open()
        assert collect(sensor, 5)[-1].force == pytest.approx(FORCE, abs=0.02)


def test_stop_and_close_stop_the_stream():
    with bench() as (sensor, device):
        sensor.open()
        assert device.streaming
        sensor.stop()
        wait_for(lambda: not device.streaming)
        sensor.close()
        sensor.close()
        sensor.open()
        assert device.streaming
        sensor.close()
        wait_for(lambda: not device.streaming)


def test_stop_is_sent_twice_since_one_may_be_lost(monkeypatch):
    orders = []

    def noted(data):
        orders.append(read_order(data))
        return orders[-1]

    with bench() as (sensor, device):
        sensor.open()
        wait_for(lambda: device.streaming)
        monkeypatch.setattr(device_module, "read_order", noted)
        sensor.close()
        wait_for(lambda: len(orders) >= 2)
        assert [order.code for order in orders] == [Command.STOP, Command.STOP]


def test_fixed_local_port_serves_a_device_that_sticks_to_it():
    with bench({"sticky": True}, local=f"127.0.0.1:{free_port()}") as (sensor, _):
        for _ in range(2):
            sensor.open()
            assert collect(sensor, 3)
            sensor.close()


def test_strangers_are_not_listened_to():
    port = free_port()
    with (
        bench(local=f"127.0.0.1:{port}") as (sensor, _),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        sensor.open()
        before = sensor.stream.traffic.datagrams
        for _ in range(200):
            stranger.sendto(bytes(42), ("127.0.0.1", port))
        collect(sensor, 10)
        assert sensor.stream.traffic.malformed == 0
        assert sensor.stream.traffic.datagrams - before < 150


def test_console_that_a_dead_client_holds_is_freed_where_that_is_asked_for():
    with bench(take_over=True) as (sensor, device):
        host, _, port = device.telnet_address.partition(":")
        with socket.create_connection((host, int(port))):
            time.sleep(0.1)
            sensor.open()
            assert collect(sensor, 3)


def test_voltage_calibration_is_refused():
    with bench(calibration=3) as (sensor, _), pytest.raises(DeviceRefused, match="counts force per mV"):
        sensor.open()


def test_serial_number_is_checked():
    with bench(serial="FT12345") as (sensor, _), pytest.raises(DeviceRefused, match=r"FT20002.*wants FT12345"):
        sensor.open()


def test_refusal_of_the_device_is_quoted(monkeypatch):
    monkeypatch.setattr(Dialogue, "answer", lambda dialogue, line: ["Error: out of order"])
    with bench() as (sensor, device):
        with pytest.raises(DeviceRefused, match="'rate 125 16' was answered with: Error: out of order"):
            sensor.open()
        assert not device.streaming


def test_nobody_there_is_a_typed_error_in_time():
    config = AtiConfig("127.0.0.1:1", "127.0.0.1:1", "127.0.0.1:0", timeout=0.3)
    sensor = AtiDriver(DriverContext(config, None)).sensor()
    with pytest.raises(ConnectionLost, match=r"console 127\.0\.0\.1:1"):
        sensor.open()
    sensor.close()
    with pytest.raises(DriverError, match="not open"):
        sensor.read()


def test_console_that_says_nothing_is_a_typed_error():
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        config = AtiConfig(f"127.0.0.1:{mute.getsockname()[1]}", "127.0.0.1:1", "127.0.0.1:0", timeout=0.3)
        with pytest.raises(ConnectionLost, match="no full reply"):
            AtiDriver(DriverContext(config, None)).sensor().open()


def test_device_that_never_streams_is_a_typed_error():
    with bench(timeout=0.6) as (sensor, device):
        device.settings.transmitting = False
        with pytest.raises(ConnectionLost, match="sends nothing"):
            sensor.open()


def test_readings_for_the_doctor():
    with bench() as (sensor, device):
        readings = {reading.name: reading for reading in sensor_health(sensor, 1.0)}
        assert readings["rate"].detail["rate_hz"] == pytest.approx(125.0, rel=0.1)
        assert readings["bias"].detail["mean"] == pytest.approx([1, -2, 3.5, 10, -20, 30], abs=0.05)
        assert max(readings["noise"].detail["sigma"][:3]) < 0.01
        assert readings["battery"].good
        assert "FT20002" in readings["calibration"].value
        assert {"losses", "drift", "flags", "range", "firmware", "latency"} <= set(readings)
        wait_for(lambda: not device.streaming)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("telnet", "here"),
        ("udp", "127.0.0.1:x"),
        ("local", "127.0.0.1"),
        ("transducer", 0),
        ("calibration", 4),
        ("rate", 3),
        ("oversampling", 64),
        ("filter", "kalman"),
        ("taps", 0),
        ("timeout", -1.0),
        ("silence", 0.001),
        ("lost_after", 0.05),
        ("stuck_after", -1.0),
    ],
)
def test_bad_options_are_named(field, value):
    with pytest.raises(InputError, match=f"drivers.ati.{field}"):
        AtiConfig(**{"rate": 125, field: value})


def test_rate_is_the_scenes_unless_given():
    from lwrprobe.scene import load_scene

    scene = load_scene("block", ["sensor.rate=250.0"])
    assert AtiDriver(DriverContext(AtiConfig(), scene)).sensor().rate == 250.0
    assert AtiDriver(DriverContext(AtiConfig(rate=500, oversampling=8), scene)).sensor().rate == 500.0
    assert AtiDriver(DriverContext(AtiConfig(), None)).sensor().rate == 125.0
    with pytest.raises(InputError, match="oversampling"):
        AtiDriver(DriverContext(AtiConfig(oversampling=32), scene)).sensor()


def test_device_written_from_the_layout_alone_streams_and_is_tared():
    with NaiveDevice() as device:
        addresses = {"telnet": device.address("console"), "udp": device.address("data"), "local": "127.0.0.1:0"}
        with AtiDriver(DriverContext(AtiConfig(**addresses, rate=125), None)).sensor() as sensor:
            assert sensor.setup.firmware == ""
            assert "versions" in device.asked
            before = collect(sensor, 20)
            assert all(s.force == pytest.approx([1.0, 0.0, 0.0]) for s in before)
            sensor.tare()
            assert np.abs([s.force for s in collect(sensor, 20)]).max() == 0.0
            assert sensor.counters()["malformed"] == 0
