"""The emulated device against a terminal and a decoder written from the layout alone."""

import socket
import time

import numpy as np
import pytest
from naive_ati import PlainTerminal, naive_crc, naive_records

from lwrprobe.contracts import InputError, LwrprobeError
from lwrprobe_ati.emulator import AtiEmulator
from lwrprobe_rig.reactor import Reactor

pytestmark = pytest.mark.realtime

START = bytes.fromhex("000a0001000000007346")
STOP = bytes.fromhex("000600027d48")
RESET_TELNET = bytes.fromhex("0006ff050e50")

# fmt: off
COMMANDS = [
    "trans 2", "calib 1", "calib", "cal", "rate", "rate 125 16", "filter", "filter 1 mean 8", "xpwr", "xpwr 3 on",
    "xpwr 3 off", "xpwr off", "bias", "bias 3 on", "bias 3 off", "bias * on", "power", "bright 25", "versions",
    "band", "ssid", "gateip", "devip", "destip", "ip", "net", "net ap", "net mode", "net udpact", "net key", "rssi",
    "wlan", "ntp", "dump off", "d off", "t off", "t on", "saveall", "technician", "user", "ntp enable 0",
    "net date 2017/03/16", "net time 10:33:42", "sdrec on", "cal mult on", "nonsense", "rate 9 9 9", "rate x",
    "trans 7", "calib 0", "filter 9", "bias", "xpwr 0 on", "RATE", "Versions",
]
# fmt: on


def emulator(**options):
    return AtiEmulator("127.0.0.1:0", "127.0.0.1:0", **options)


@pytest.fixture
def device():
    emulated = emulator(active=[2, 5], noise=0.0)
    with Reactor([emulated]):
        yield emulated


@pytest.fixture
def terminal(device):
    terminal = PlainTerminal(device.telnet_address)
    terminal.greeting = terminal.read()
    yield terminal
    terminal.close()


@pytest.fixture
def line(device):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        host, _, port = device.udp_address.partition(":")
        line.bind(("127.0.0.1", 0))
        line.connect((host, int(port)))
        line.settimeout(2.0)
        yield line


def wait_for(condition, seconds=10.0):
    """The device gets to it as soon as the machine lets it."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


def greeted(device):
    """Whether a new terminal is let in."""
    new = PlainTerminal(device.telnet_address)
    try:
        return "opened by client" in new.read(1.0)
    finally:
        new.close()


def record_like(line, good, count=500):
    """The first record that is as wanted; those before it were on their way already."""
    for _ in range(count):
        record = naive_records(line.recv(2048))[0]
        if good(record):
            return record
    raise AssertionError(f"none of {count} records was as wanted, the last one: {record}")


def test_greeting(terminal):
    assert "WLAN:" in terminal.greeting
    assert "Telnet connection opened by client\r\n" in terminal.greeting


@pytest.mark.parametrize("command", COMMANDS)
def test_every_line_is_echoed_answered_and_prompted(terminal, command):
    text = terminal.ask(command)
    assert text.startswith(f"{command}\r\n")
    assert text.endswith("\r\n>")
    if command not in ("dump off", "d off"):
        assert text[len(command) :].strip("\r\n>")


def test_empty_line_gives_a_prompt(terminal):
    assert terminal.ask("") == "\r\n\r\n>"


def test_recorded_replies(terminal):
    assert "Active: Transducer = 2 Calibration = 1\r\n" in terminal.ask("trans 2")
    assert "Active: Transducer = 2 Calibration = 3\r\n" in terminal.ask("calib 3")
    assert "Active: Transducer = 1 Calibration = 1\r\n" in terminal.ask("trans 1")
    assert "Active: Transducer = 2 Calibration = 3\r\n" in terminal.ask("trans 2")
    rate = "Packet rate =  125 Hz\r\nADC    rate = 2000 Hz\r\nOversample  =   16\r\n"
    assert rate in terminal.ask("rate 125 16")
    assert "LED brightness: Analog Board = 25% Power Button = 25%" in terminal.ask("bright 25")
    assert " 5 ON     ON\r\n 6 OFF    OFF\r\nAnalog power = ON in AUTO mode" in terminal.ask("xpwr")
    assert "Tr Filter  Taps\r\n-- ------  ----\r\n 1 MEAN      8\r\n" in terminal.ask("filter")


def test_options_of_a_client_are_mentioned(terminal):
    terminal.line.sendall(b"\xff\xfd\x03\xff\xfb\x18")
    text = terminal.read() + terminal.ask("power") + terminal.read(0.3)
    assert "Telnet: DO SUPPRESS-GO-AHEAD" in text
    assert "Telnet: WILL TERMINAL-TYPE" in text
    assert "POWER On" in text


def test_one_connection_at_a_time_until_it_is_freed_by_udp(device, terminal, line):
    second = PlainTerminal(device.telnet_address)
    assert second.read(1.0) == ""
    second.close()
    line.send(RESET_TELNET)
    wait_for(lambda: greeted(device))


def test_streaming_with_a_sparse_mask(device, line):
    device.control("load 2=1,-2,3.5,10,-20,30")
    device.control("load 5=0,0,-4,0,0,0")
    line.send(START)
    records = [naive_records(line.recv(2048)) for _ in range(10)]
    assert all(len(r) == 1 for r in records)
    heads = [r[0] for r in records]
    assert {head[5] for head in heads} == {0x12}
    assert np.diff([head[1] for head in heads]).tolist() == [1] * 9
    # A device that was kept from running for a quarter of a second pauses; its stamps tell.
    steps = np.diff([head[0] for head in heads])
    assert all(step in (32, 33) or step > 1024 for step in steps)
    assert (steps < 1024).any()
    two, five = heads[-1][-1][2], heads[-1][-1][5]
    assert np.array(two) / 1e6 == pytest.approx([1, -2, 3.5, 10, -20, 30], abs=0.02)
    assert np.array(five) / 1e6 == pytest.approx([0, 0, -4, 0, 0, 0], abs=0.02)
    line.send(STOP)


def test_number_of_packets_and_stop(device, line):
    body = bytes.fromhex("000a070100000005")
    line.send(body + naive_crc(body).to_bytes(2, "big"))
    assert len([line.recv(2048) for _ in range(5)]) == 5
    line.settimeout(0.1)
    with pytest.raises(TimeoutError):
        line.recv(2048)
    assert not device.streaming


@pytest.mark.parametrize("bad", ["000a0001000000007347", "000a00010000000073", "000600017d48", "00", "000600027d4800"])
def test_wrong_length_or_crc_is_ignored(device, line, bad):
    line.send(bytes.fromhex(bad))
    wait_for(lambda: device.refused == 1)
    line.settimeout(0.1)
    with pytest.raises(TimeoutError):
        line.recv(2048)
    assert device.refused == 1


def test_several_records_a_datagram_at_high_rates(device, terminal, line):
    terminal.ask("rate 1000 4")
    line.send(START)
    sizes = {len(line.recv(2048)) for _ in range(20)}
    assert sizes == {4 * (18 + 2 * 24)}


def test_losses_leave_gaps(device, line):
    device.control("fault loss=0.3")
    while not device.streaming:
        line.send(START)
        time.sleep(0.01)
    numbers = [naive_records(line.recv(2048))[0][1] for _ in range(60)]
    assert max(np.diff(numbers)) > 1
    assert min(np.diff(numbers)) >= 1


def test_bias_voltage_and_gages(device, terminal, line):
    device.control("load 2=1,-2,3.5,10,-20,30")
    for command in ("trans 2", "technician", "cal mult off"):
        terminal.ask(command)
    line.send(START)
    gages = np.array(naive_records(line.recv(2048))[0][-1][2])
    assert device.transducers[2].matrix @ gages / 1e6 == pytest.approx([1, -2, 3.5, 10, -20, 30], abs=0.02)
    terminal.ask("cal mult on")
    terminal.ask("bias 2 on")
    record_like(line, lambda record: record[-1][2] == (0,) * 6)
    terminal.ask("calib 3")
    terminal.ask("bias 2 off")
    volts = np.array(record_like(line, lambda record: any(record[-1][2]) and record[-1][2][0] < 1e6)[-1][2])
    assert volts == pytest.approx(90.25 * np.round(volts / 90.25), abs=0.51)


def test_overload_saturates(device, line):
    device.control("load 2=60,0,0,0,0,0")
    line.send(START)
    head = naive_records(line.recv(2048))[0]
    assert head[2] >> 25 & 1
    assert head[2] >> 2 & 3 == 1
    assert not head[3] >> 25 & 1


def test_status_words_follow_the_operator(device, line):
    for order in ("battery low", "bridge 5 on", "saturate 2 on"):
        assert device.control(order) == "ok"
    line.send(START)
    head = naive_records(line.recv(2048))[0]
    assert head[2] >> 10 & 3 == 1
    assert head[4] == 1
    assert head[3] >> 28 & 1
    assert head[2] >> 25 & 1
    device.control("fault none")
    record_like(line, lambda record: (record[2], record[3]) == (0x00040A88, 0x00040008))


def test_sticky_destination_serves_the_first_port_alone():
    emulated = emulator(sticky=True)
    with Reactor([emulated]):
        host, _, port = emulated.udp_address.partition(":")
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
        ):
            for line in (first, second):
                line.settimeout(5.0)
                line.sendto(START, (host, int(port)))
                if line is first:
                    assert first.recv(2048)
            # Records go on coming to the first port, and none to the second.
            for _ in range(30):
                assert first.recv(2048)
            second.settimeout(0.05)
            with pytest.raises(TimeoutError):
                second.recv(2048)


@pytest.mark.parametrize(
    "order", ["load 9=1,2,3,4,5,6", "load 2=1,2", "load 2=a,b,c,d,e,f", "fault wind=1", "dance", ""]
)
def test_operator_is_told_what_would_have_been_right(device, order):
    with pytest.raises(LwrprobeError, match="allowed"):
        device.control(order)


def test_no_transducer_is_refused():
    with pytest.raises(InputError, match="active"):
        emulator(active=[7])


def test_nothing_that_is_typed_makes_the_console_fail(terminal):
    random = np.random.default_rng(7)
    words = " ".join(COMMANDS).split()
    for _ in range(300):
        line = " ".join(random.choice(words, size=int(random.integers(1, 5))))
        line = line.replace("reset", "").replace("dump", "")
        if random.random() < 0.3:
            line += bytes(random.integers(33, 255, 3).astype(np.uint8)).decode("latin-1")
        terminal.line.sendall(line.encode("latin-1", "replace") + b"\r\n")
        assert terminal.read().endswith("\r\n>")
