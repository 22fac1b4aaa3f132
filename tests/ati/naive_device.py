"""A device as short as can be, written from the layout of its console and datagrams alone.

It does not know `versions`, says nothing to a setting, and its table of biased channels has no word `Bias`.
"""

import socket
import struct
import threading
import time

from naive_ati import naive_crc

from lwrprobe.host.real_time import ANSWERS, real_time_priority


class NaiveDevice:
    """Serves one console and one stream, each in a thread, while its `with` block runs."""

    def __init__(self, counts=(1_000_000, 0, 0, 0, 0, 0), noise=0):
        self.console = socket.create_server(("127.0.0.1", 0))
        self.data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.data.bind(("127.0.0.1", 0))
        self.console.settimeout(0.05)
        self.data.settimeout(0.004)
        self.counts, self.noise, self.biased, self.asked = counts, noise, False, []
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=each, daemon=True) for each in (self._talk, self._stream)]

    def __enter__(self):
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error):
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self.console.close()
        self.data.close()

    def address(self, which):
        host, port = getattr(self, which).getsockname()
        return f"{host}:{port}"

    def _talk(self):
        while not self._stop.is_set():
            try:
                client, _ = self.console.accept()
            except TimeoutError:
                continue
            with client:
                client.settimeout(0.05)
                client.sendall(b"WLAN: connection opened\r\n>")
                self._serve(client)

    def _serve(self, client):
        typed = b""
        while not self._stop.is_set():
            try:
                piece = client.recv(100)
            except TimeoutError:
                continue
            if not piece:
                return
            typed += piece
            while b"\r\n" in typed:
                line, _, typed = typed.partition(b"\r\n")
                reply = "".join(f"{text}\r\n" for text in self._reply(line.decode().split()))
                client.sendall(line + b"\r\n" + reply.encode() + b"\r\n>")

    def _reply(self, words):
        self.asked.append(" ".join(words))
        match words:
            case ["rate", rate, oversampling]:
                return [f"Packet rate = {rate} Hz", "ADC rate = 2000 Hz", f"Oversample = {oversampling}"]
            case ["xpwr"]:
                return ["Tr Auto Now", "-- ---- ---", " 1 ON     ON", " 2 OFF    OFF"]
            case ["filter"]:
                return ["Tr Filter Taps", "-- ------ ----", " 1 MEAN      8"]
            case ["trans", number]:
                return [f"Active: Transducer = {number} Calibration = 1"]
            case ["calib", number]:
                return [f"Active: Transducer = 1 Calibration = {number}"]
            case ["cal"]:
                return self._table()
            case ["bias", "1", "on"]:
                self.biased = True
                return []
            case ["bias"]:
                rows = [f" 1 {channel} ON  {channel}" for channel in range(6)] if self.biased else []
                return ["Tr Ch Pwr  Value", "-- -- ---  -----", *rows]
            case [] | ["xpwr", *_] | ["filter", *_]:
                return []
            case _:
                return [f"? {words[0]}"]

    def _table(self):
        extra = ["Serial: FT1", "Date: 2016/11/07", "Part: SI-12-0.12", "Force: 1000000 counts/N"]
        extra += ["Torque: 1000000 counts/N-mm", "Mult: ON"]
        rows = [
            f" 1 1 610 30000 {row} {axis} {'0 ' * row}1 {'0 ' * (5 - row)}{extra[row]}"
            for row, axis in enumerate(("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))
        ]
        head = ["Tr Cal Gain Offset Row Axis G0 G1 G2 G3 G4 G5", "-- --- ---- ------ --- ---- -- -- -- -- -- --"]
        return [*head, *rows, " 1 0 MaxRatings:", " 1 0 12 12 17 120 120 120"]

    def _stream(self):
        with real_time_priority(ANSWERS):  # a device keeps its own time, whatever else this host does
            self._send_records()

    def _send_records(self):
        peer, sequence, due = None, 0, time.monotonic()
        while not self._stop.is_set():
            try:
                order, sender = self.data.recvfrom(100)
            except TimeoutError:
                pass
            else:
                if naive_crc(order) == 0 and order[3] in (1, 2):
                    peer = sender if order[3] == 1 else None
            if peer is not None and time.monotonic() >= due:
                due += 0.008
                wave = self.noise * (sequence * 37 % 11 - 5) // 5
                counts = [wave + (0 if self.biased else value) for value in self.counts]
                stamp = round(4096 * sequence * 0.008)
                self.data.sendto(struct.pack(">4I2B6i", stamp, sequence, 1 << 16 | 2, 0, 7, 1, *counts), peer)
                sequence += 1
            elif peer is None:
                due = time.monotonic()
