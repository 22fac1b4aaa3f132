"""What is said when an address, a port or a peer is wrong: the sentence names the cause."""

import socket
import threading
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from lwrprobe.contracts import ConnectionLost, DriverContext, DriverError
from lwrprobe.contracts.plugins import load
from lwrprobe_ati.emulator.device import AtiEmulator
from lwrprobe_fri import FriConfig, FriDriver
from lwrprobe_fri.emulator import Controller, ControllerSettings, FriEmulator, LaggingArm
from lwrprobe_rig.reactor import Reactor

pytestmark = pytest.mark.realtime

START = np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])


def free_address(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def controller(remote):
    emulator = FriEmulator(lambda: Controller(LaggingArm(START), ControllerSettings()), "127.0.0.1:0", remote)
    with Reactor([emulator]):
        yield emulator


def arm(bind, remote, **options):
    return FriDriver(DriverContext(FriConfig(bind, remote, connect_timeout=1.5, **options), None)).arm()


@pytest.mark.parametrize("remote", ["127.0.0.2:0", "127.0.0.1:1"], ids=["wrong address", "wrong port"])
def test_controller_speaks_from_elsewhere(remote):
    bind = free_address()
    with controller(bind), pytest.raises(ConnectionLost) as lost:
        arm(bind, remote).open()
    count = int(str(lost.value).split("; ")[1].split()[0])
    assert "datagrams came from other addresses" in str(lost.value)
    assert count > 20


def test_peer_is_another_program():
    """Datagrams from the right address that are none of FRI's."""
    bind, stop = free_address(), threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        host, port = bind.split(":")

        def send():
            while not stop.wait(0.02):
                peer.sendto(b"hello", (host, int(port)))

        threading.Thread(target=send, daemon=True).start()
        try:
            with pytest.raises(ConnectionLost, match=r"0 datagrams came from other addresses, \d\d+ were malformed"):
                arm(bind, f"127.0.0.1:{peer.getsockname()[1]}").open()
        finally:
            stop.set()


def test_nobody_speaks():
    bind = free_address()
    expected = r"no measurement came from 127.0.0.1:1 at .* within 1.5 s; 0 datagrams .* 0 were malformed"
    with pytest.raises(ConnectionLost, match=expected):
        arm(bind, "127.0.0.1:1").open()


def test_second_client_of_the_controller():
    bind = free_address()
    with controller(bind) as emulator:
        first = arm(bind, emulator.address)
        first.open()
        try:
            with pytest.raises(
                ConnectionLost, match=rf"cannot bind {bind} \(drivers.fri.bind\): Address already in use"
            ):
                arm(bind, emulator.address).open()
            first.read()
        finally:
            first.close()


@contextmanager
def device():
    emulator = AtiEmulator("127.0.0.1:0", "127.0.0.1:0")
    with Reactor([emulator]):
        yield emulator


def sensor(emulator, **options):
    ati = load("driver", "ati")
    addresses = {"telnet": emulator.telnet_address, "udp": emulator.udp_address, "local": "127.0.0.1:0"}
    return ati(DriverContext(ati.Config(**(addresses | {"timeout": 1.0} | options)), None)).sensor()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("telnet", "Connection refused"),
        ("udp", "sends nothing to"),
        ("local", "no data line from"),
    ],
)
def test_sensor_is_elsewhere(wrong, words):
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    address = {
        "telnet": free_address(socket.SOCK_STREAM),
        "udp": free_address(),
        "local": f"127.0.0.1:{taken.getsockname()[1]}",
    }[wrong]
    with device() as emulator, taken, pytest.raises(DriverError, match=words) as refused:
        sensor(emulator, **{wrong: address}).open()
    assert address in str(refused.value)


def read_on(sensor):
    """Until an error comes."""
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        sensor.read()
        time.sleep(0.01)


def test_second_client_of_the_sensor_does_not_disturb_the_first():
    with device() as emulator, sensor(emulator) as first:
        for local in ("127.0.0.1:0", f"{first._socket.getsockname()[0]}:{first._socket.getsockname()[1]}"):
            with pytest.raises(ConnectionLost) as refused:
                sensor(emulator, local=local).open()
            own = "another client may hold the console: end that one, or set drivers.ati.take_over"
            assert (own if local.endswith(":0") else "Address already in use") in str(refused.value)
        before = first.counters()["received"]
        while first.counters()["received"] < before + 20:
            first.read()
            time.sleep(0.01)
        counts = first.counters()
        assert (counts["lost"], counts["restarts"], counts["implausible"]) == (0, 0, 0)


def test_sensor_that_another_client_has_taken_over():
    """The first one ends with a sentence and leaves the stream to the second."""
    with device() as emulator, sensor(emulator) as first, sensor(emulator, take_over=True) as second:
        with pytest.raises(ConnectionLost, match="another client has taken it over"):
            read_on(first)
        first.close()
        before = second.counters()["received"]
        while second.counters()["received"] < before + 20:
            second.read()
            time.sleep(0.01)
        assert second.counters()["restarts"] == 0


def test_data_come_from_another_program():
    """Datagrams from the right port that are none of the sensor's."""
    with device() as emulator, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        where = f"127.0.0.1:{peer.getsockname()[1]}"
        peer.settimeout(10.0)

        def answer():
            with suppress(OSError):
                while True:
                    peer.sendto(b"hello", peer.recvfrom(2048)[1])

        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(
            ConnectionLost, match=rf"no usable record from {where}: of \d+ datagrams \d+ were malformed"
        ):
            sensor(emulator, udp=where).open()


def test_console_that_is_no_console():
    """A peer that takes the connection and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as mute, device() as emulator:
        where = f"127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(ConnectionLost, match=rf"console {where}: no full reply|connected, but no prompt"):
            sensor(emulator, telnet=where).open()


def test_input_without_a_transducer():
    with device() as emulator:
        emulator.control("plug 1 out")
        with pytest.raises(DriverError, match="stays without power: is it plugged into input 1"):
            sensor(emulator).open()
        emulator.control("plug 1 in")
        with sensor(emulator) as opened:
            assert opened.is_open


def test_console_that_was_flooded_serves_the_next_client():
    with device() as emulator:
        host, _, port = emulator.telnet_address.partition(":")
        with socket.create_connection((host, int(port))) as flood:
            flood.settimeout(20.0)
            reader = threading.Thread(target=lambda: [None for _ in iter(lambda: flood.recv(65536), b"")], daemon=True)
            reader.start()
            flood.sendall(b"x" * 2_000_000)
            flood.shutdown(socket.SHUT_WR)
            reader.join(20.0)
        with sensor(emulator, timeout=5.0) as opened:
            assert opened.is_open
