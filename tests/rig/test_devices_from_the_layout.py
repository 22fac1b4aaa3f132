"""A run begins with a controller and a sensor that were written from the byte layout alone."""

import json
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.host.real_time import ANSWERS, real_time_priority
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

sys.path.append(str(Path(__file__).parents[1] / "ati"))

from naive_device import NaiveDevice

pytestmark = pytest.mark.realtime

MON, CMD, PERFECT = 1, 2, 3
EXPLORE = "from lwrprobe.cli.app import main; main()"


class NaiveController:
    """Sends a measurement every 10 ms and moves to the joints of the last answer, by the offsets of the layout."""

    def __init__(self, joints, remote):
        self.joints, self.state, self.answers = list(joints), MON, 0
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.bind(("127.0.0.1", 0))
        self._remote = remote
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._stop.set()
        self._thread.join()
        self.line.close()

    def _run(self):
        with real_time_priority(ANSWERS):  # a device keeps its own time, whatever else this host does
            self._serve()

    def _serve(self):
        sequence, due = 0, time.monotonic()
        while not self._stop.is_set():
            sequence = sequence + 1 & 0xFFFF
            self.line.sendto(self._measurement(sequence), self._remote)
            due += 0.01
            while (left := due - time.monotonic()) > 0.0:
                self.line.settimeout(left)
                try:
                    self._take(self.line.recv(2048), sequence)
                except TimeoutError:
                    break

    def _take(self, command, sequence):
        if struct.unpack_from("<H", command, 2)[0] != sequence:
            return
        self.answers += 1
        self._reflected = struct.unpack_from("<H", command, 0)[0]
        if self.state == CMD:
            self.joints = list(struct.unpack_from("<7f", command, 144))
        wish = struct.unpack_from("<i", command, 72 + 4 * 15)[0]
        if wish == 10 and self.answers > 50:
            self.state = CMD
        if wish == 20:
            self.state = MON

    _reflected = 0

    def _measurement(self, sequence):
        data = bytearray(916)
        struct.pack_into("<4H", data, 0, sequence, self._reflected, 916, 0x2006)
        struct.pack_into("<i", data, 72 + 4 * 15, 20 if self.state == CMD else 10)
        struct.pack_into("<f2H2f", data, 140, 0.01 * sequence, self.state, PERFECT, 0.01, 0.01)
        struct.pack_into("<2H", data, 180, 0x7F, 1)
        struct.pack_into("<7f", data, 216, *self.joints)
        struct.pack_into("<7f", data, 292, *self.joints)
        return bytes(data)


def test_the_run_starts(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        bind = probe.getsockname()
    scene = load_scene("empty")
    _, q = start_posture(scene, robot_of(scene))
    with NaiveDevice(noise=2000) as sensor, NaiveController(q, bind) as controller:
        host, port = controller.line.getsockname()
        settings = {
            "drivers.fri.bind": f"127.0.0.1:{bind[1]}",
            "drivers.fri.remote": f"{host}:{port}",
            "drivers.ati.telnet": sensor.address("console"),
            "drivers.ati.udp": sensor.address("data"),
        }
        words = [word for key, value in settings.items() for word in ("--set", f'{key}="{value}"')]
        words += ["--set", "run.until.time=3.0", "--out", str(tmp_path / "run"), "--quiet"]
        # In a process of its own: an explorer with real-time priority leaves the threads of this one little time.
        command = [sys.executable, "-c", EXPLORE, "explore", "empty", "--arm", "fri", "--sensor", "ati", *words]
        subprocess.run(command, timeout=300.0, check=False)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "done", summary["reason"]
    assert summary["sim_time_s"] >= 3.0
    assert np.abs(np.array(controller.joints) - q).max() > 0.005, "it was moved"
    assert controller.state == MON, "command mode is left at the end"
    assert "versions" in sensor.asked
