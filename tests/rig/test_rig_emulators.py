"""The emulators as programs: found by entry point, steered while they run, killed and served again."""

import ast
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from lwrprobe.bench.emulated import free_addresses
from lwrprobe.contracts.plugins import load, names

pytestmark = pytest.mark.realtime

ROOT = Path(__file__).resolve().parents[2]
EMULATE = (
    "import sys; from lwrprobe.contracts.plugins import load; sys.exit(load('emulator', sys.argv[1]).run(sys.argv[2:]))"
)
EXPLORER = """
import sys, time
import numpy as np
from lwrprobe.contracts import DriverContext
from lwrprobe.contracts.plugins import load

bind, remote, telnet, udp, local, seconds = sys.argv[1:]
fri, ati = load("driver", "fri"), load("driver", "ati")
arm = fri(DriverContext(fri.Config(bind=bind, remote=remote), None)).arm()
sensor = ati(DriverContext(ati.Config(telnet=telnet, udp=udp, local=local), None)).sensor()
arm.open()
sensor.open()
goal, samples = np.array(arm.measurement.set_point), 0
begin = time.monotonic()
while time.monotonic() - begin < float(seconds):
    arm.read()
    goal[0] += 0.0005
    arm.command(goal)
    new = len(sensor.read())
    if new and not samples:
        print("streaming", flush=True)
    samples += new
print("ended", samples, flush=True)
arm.close()
sensor.close()
"""


HOLDER = """
import sys, time
import numpy as np
from lwrprobe.contracts import DriverContext
from lwrprobe.contracts.plugins import load

fri = load("driver", "fri")
arm = fri(DriverContext(fri.Config(bind=sys.argv[1], remote=sys.argv[2], silence=2.0), None)).arm()
arm.open()
arm.command(np.array(arm.measurement.set_point))
before, first = arm.measurement.sequence, time.monotonic()
while time.monotonic() - first < 1.0:
    sum(range(3_000_000))  # one call that keeps the interpreter's lock
passed = arm.read().time - first
print("state", arm.measurement.state.name, "answered", arm.measurement.answer_rate, "passed", passed, flush=True)
arm.close()
"""


def heed_signals():
    """As in a terminal: what runs the tests in the background may have had these signals ignored."""
    for number in (signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)


@contextmanager
def running(code, *arguments):
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
        preexec_fn=heed_signals,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def line_of(process, wanted):
    """Read lines until one has the wanted text."""
    seen = []
    for line in process.stdout:
        seen.append(line)
        if wanted in line:
            return line
    raise AssertionError(f"{wanted!r} never came: {''.join(seen)}")


def ask(process, line):
    process.stdin.write(line + "\n")
    process.stdin.flush()
    return process.stdout.readline()


def over_udp(address, line):
    host, _, port = address.partition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.settimeout(10.0)
        s.sendto(line.encode(), (host, int(port)))
        return s.recv(4096).decode()


def eventually(question, wanted, seconds=20.0):
    """Ask until the answer has the wanted text."""
    end = time.monotonic() + seconds
    while wanted not in (answer := question()):
        assert time.monotonic() < end, f"{wanted!r} never came: {answer}"
        time.sleep(0.1)
    return answer


def test_emulators_are_found_by_entry_point():
    assert {"fri", "ati", "rig"} <= set(names("emulator"))


@pytest.mark.parametrize("name", ["fri", "ati", "rig"])
def test_help_and_bad_options(name, capsys):
    command = load("emulator", name)
    assert command.run(["--help"]) == 0
    assert "--control" in capsys.readouterr().out
    assert command.run(["--nonsense", "1"]) == 2


@pytest.mark.parametrize(
    ("name", "argv", "reason"),
    [
        ("fri", ["--bind", "nowhere"], "bind"),
        ("fri", ["--cycle-ms", "0.1"], "cycle"),
        ("fri", ["--krl", "C"], "krl"),
        ("fri", ["--joints", "1,2"], "--joints"),
        ("fri", ["--faults", "wind=1"], "fault"),
        ("ati", ["--active", "x"], "active"),
        ("ati", ["--active", "9"], "active"),
        ("ati", ["--load", "2=1"], "load"),
        ("ati", ["--udp", "127.0.0.1:123456"], "udp"),
    ],
)
def test_wrong_values_are_named(name, argv, reason, capsys):
    assert load("emulator", name).run(argv) == 2
    assert reason in capsys.readouterr().err


def test_control_lines_on_standard_input_and_on_a_port():
    bind, remote, port = free_addresses(3)
    with running(EMULATE, "fri", "--bind", bind, "--remote", remote, "--control", port) as emulator:
        line_of(emulator, "FRI controller at")
        assert ask(emulator, "status").startswith("MON")
        assert ask(emulator, "fault loss=0.5") == "ok\n"
        assert "did you mean 'drives'" in ask(emulator, "drive off")
        assert over_udp(port, "drives off") == "ok"
        assert "power=0x0000" in over_udp(port, "status")
        assert ask(emulator, "quit") == "bye\n"
        assert emulator.wait(10.0) == 0


@contextmanager
def both_devices():
    """(addresses for the explorer, control port of the controller, of the sensor)."""
    bind, remote, udp, local, fri_port, ati_port = free_addresses(6)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        telnet = f"127.0.0.1:{probe.getsockname()[1]}"
    patient = ("--bridged", "50")  # the machine may be busy
    arm = running(EMULATE, "fri", "--bind", bind, "--remote", remote, "--control", fri_port, *patient)
    sensor = running(EMULATE, "ati", "--telnet", telnet, "--udp", udp, "--control", ati_port, "--sticky")
    with arm as arm, sensor as sensor:
        line_of(arm, "FRI controller at")
        line_of(sensor, "ATI Wireless F/T")
        yield (remote, bind, telnet, udp, local), fri_port, ati_port


def test_killed_explorer_is_followed_by_one_that_works():
    with both_devices() as (addresses, fri_port, ati_port):
        with running(EXPLORER, *addresses, "60") as explorer:
            line_of(explorer, "streaming")
            explorer.send_signal(signal.SIGKILL)
            explorer.wait(10.0)
        assert "streaming" in over_udp(ati_port, "status"), "nobody could stop the stream"
        # Whether silence or a quality that a loaded host had dropped before ended command mode, it has to be over.
        eventually(lambda: over_udp(fri_port, "status"), "MON")
        eventually(lambda: over_udp(fri_port, "status"), "answered=0.000")
        with running(EXPLORER, *addresses, "1") as explorer:
            line_of(explorer, "streaming")
            assert int(line_of(explorer, "ended").split()[1]) > 50
            assert explorer.wait(20.0) == 0
        eventually(lambda: over_udp(fri_port, "status"), "MON")
        eventually(lambda: over_udp(ati_port, "status"), "quiet")


def test_runner_that_holds_the_interpreter_does_not_keep_the_controller_waiting():
    """A hundred cycles without a word of the runner: without a process of its own, no answer would come meanwhile."""
    bind, remote = free_addresses(2)
    with running(EMULATE, "fri", "--bind", bind, "--remote", remote, "--bridged", "50") as emulator:
        line_of(emulator, "FRI controller at")
        with running(HOLDER, remote, bind) as runner:
            words = line_of(runner, "state").split()
            assert words[1] == "CMD"
            assert float(words[3]) > 0.5
            assert float(words[5]) > 0.9


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signal_stops_the_stream(number):
    with both_devices() as (addresses, fri_port, ati_port), running(EXPLORER, *addresses, "60") as explorer:
        line_of(explorer, "streaming")
        os.kill(explorer.pid, number)
        assert explorer.wait(20.0) != 0
        eventually(lambda: over_udp(ati_port, "status"), "quiet")
        eventually(lambda: over_udp(fri_port, "status"), "MON")


def imports_of(folder, inner):
    names = set()
    for file in folder.rglob("*.py"):
        if ("emulator" in file.parts) != inner:
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom):
                names.add(node.module)
            elif isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
    return {name for name in names if name.startswith("lwrprobe_")}


@pytest.mark.parametrize("package", ["lwrprobe_fri", "lwrprobe_ati"])
def test_driver_and_emulator_share_no_code(package):
    folder = ROOT / "drivers" / package
    assert not [name for name in imports_of(folder, inner=False) if ".emulator" in name or "lwrprobe_rig" in name]
    shared = [name for name in imports_of(folder, inner=True) if name.startswith(package)]
    assert all(name.startswith(f"{package}.emulator") for name in shared)
