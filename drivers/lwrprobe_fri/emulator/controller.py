"""The emulated KRC2 lr: interface states, rating, checks of every command, bridging and stop ramp; no sockets.

Where the real controller's numbers are not published, the choice is a field of `ControllerSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe_fri.emulator.datagrams import blank_measurement, read_command
from lwrprobe_fri.emulator.frames import frame_and_jacobian
from lwrprobe_fri.emulator.krl import PROGRAMS
from lwrprobe_fri.emulator.plant import Plant
from lwrprobe_fri.emulator.rating import QUALITIES, Rating, Thresholds

MON, CMD = 1, 2
_POSITION, _JOINT_IMPEDANCE = 1, 3
_JOINT_POSITION, _JOINT_TORQUE = 0x0001, 0x0004
_ALLOWED_FLAGS = {_POSITION: 0x0001, _JOINT_IMPEDANCE: 0x0001 | 0x0004 | 0x0010 | 0x0020}
_DRIVES_ON = 0x007F
_RECENT = 100


def _degrees(*values: float) -> np.ndarray:
    return np.radians(np.array(values))


@dataclass(slots=True)
class ControllerSettings:
    """How the emulated controller behaves.

    Attributes
    ----------
    cycle : s between measurements, as given to friOpen
    krl : which program runs, `A`, `B` or `none`
    thresholds : of the quality rating
    enter_quality, leave_quality : rating needed to enter, and to stay in, command mode
    bridged : missing answers in a row that are bridged by the last velocity
    entry_tolerance : rad between set point and command at the switch to command mode
    speed_trip, range : (7,) rad/s and rad
    torque_step : N·m of added torque that is accepted in the first cycle
    stop_deceleration : rad/s^2 of the stop ramp
    poll : s between two looks of the KRL program at its variables
    acknowledge : `auto` = an error is cleared by the next friStart, `manual` = by the operator alone
    """

    cycle: float = 0.01
    krl: str = "A"
    thresholds: Thresholds = field(default_factory=Thresholds)
    enter_quality: int = 2
    leave_quality: int = 2
    bridged: int = 3
    entry_tolerance: float = 0.01
    speed_trip: np.ndarray = field(default_factory=lambda: _degrees(112.5, 112.5, 128, 128, 204, 184, 184))
    range: np.ndarray = field(default_factory=lambda: _degrees(170, 120, 170, 120, 170, 120, 170))
    torque_step: float = 1.0
    stop_deceleration: float = radians(600.0)
    poll: float = 0.05
    acknowledge: str = "auto"
    first_sequence: int = 1

    def __post_init__(self) -> None:
        if not 0.001 <= self.cycle <= 0.1:
            raise InputError("cycle", self.cycle, "0.001 .. 0.1 s")
        if self.krl not in PROGRAMS:
            raise InputError("krl", self.krl, ", ".join(PROGRAMS))
        if self.acknowledge not in ("auto", "manual"):
            raise InputError("acknowledge", self.acknowledge, "auto, manual")


class Controller:
    """One cycle after the other: `tick` ends one and begins the next, `receive` takes what came in between."""

    def __init__(self, plant: Plant, settings: ControllerSettings) -> None:
        self.settings = settings
        self.rating = Rating(settings.thresholds)
        self.state = MON
        self.power = _DRIVES_ON
        self.error = 0
        self.warning = 0
        self.events: list[str] = []
        """What happened, in words, newest last."""
        self.malformed = 0
        self.late = 0
        self.fastest = np.zeros(7)
        """(7,) rad/s, the largest speed of the set point while commanded."""
        self._plant = plant
        self._program = PROGRAMS[settings.krl]()
        self._record = blank_measurement()
        self._sequence = (settings.first_sequence - 1) & 0xFFFF
        self._reflected = 0
        self._asked = [0] * 16
        self._sent_at = 0.0
        self._answer: np.void | None = None
        self._latency = 0.0
        self._time = 0.0
        self._next_poll = 0.0
        self._control = _POSITION
        self._safety = 1.0
        self._start_wanted = False
        self._switched_off = False
        self._missing = 0
        self._first_torque = True
        self._velocity = np.zeros(7)
        self._set_point = plant.joints()
        self._base = self._set_point.copy()

    # --- what a KRL program sees ---

    @property
    def quality(self) -> int:
        return self.rating.quality

    @property
    def commanding(self) -> bool:
        return self.state == CMD

    def set_strategy(self, control: int) -> None:
        """Takes effect in monitor mode only."""
        if self.state == MON:
            self._control = control

    def fri_start(self, safety: float) -> None:
        """Enter command mode as soon as quality and drives allow it; drives that a person switched off stay off."""
        if self.settings.acknowledge == "auto" and not self._switched_off:
            self.acknowledge()
        self._safety = safety
        self._start_wanted = True

    def fri_stop(self) -> None:
        """Back to monitor mode; the drives stay on."""
        self._start_wanted = False
        if self.state == CMD:
            self._leave("friStop")

    # --- what the operator does ---

    def acknowledge(self) -> None:
        """Clear an error and switch the drives on again."""
        self.error = 0
        self.power = _DRIVES_ON
        self._switched_off = False

    def emergency_stop(self) -> None:
        """As the red button: the drives stay off until the operator acknowledges it."""
        self.drives_off()
        self.events.append("emergency stop")

    def drives_off(self) -> None:
        """By the operator, who alone switches them on again."""
        self.power = 0
        self._switched_off = True
        if self.state == CMD:
            self._leave("drives off")

    def violate(self, what: str, joint: int = 0) -> None:
        """As the real one on any violation: drives off, brakes, monitor mode, an error to be acknowledged."""
        self.power = 0
        self.error |= 1 << joint
        self._start_wanted = False
        self._leave(f"{what} (joint {joint + 1})")

    # --- cycles ---

    def receive(self, data: bytes, now: float) -> None:
        """Take one datagram of the remote."""
        command = read_command(data)
        if command is None:
            self.malformed += 1
            return
        age = (self._sequence - int(command["reflected"])) & 0xFFFF
        if age >= _RECENT or not self._sent_at:
            return  # an early or very old one: its positions mean nothing
        self._reflected = int(command["sequence"])
        self._asked = command["krl_int"].tolist()
        if age:
            self.late += 1
        elif self._answer is None:
            self._answer = command
            self._latency = now - self._sent_at

    def tick(self, now: float) -> bytes:
        """End the cycle, move, begin the next one; the measurement to be sent."""
        cycle = self.settings.cycle
        if self._sent_at:
            self.rating.note(self._answer is not None, self._latency)
        before = self._set_point
        self._set_point = self._commanded() if self.state == CMD else self._ramp_down()
        self._velocity = (self._set_point - before) / cycle
        self._plant.advance(before, self._set_point, cycle)
        self._time += cycle
        if self._time >= self._next_poll:
            self._next_poll = self._time + self.settings.poll
            self._program.poll(self._asked, self)
        self._change_state()
        self._answer = None
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._sent_at = now
        return self._measurement()

    @property
    def set_point(self) -> np.ndarray:
        """(7,) rad."""
        return self._set_point.copy()

    def describe(self) -> str:
        """State in one line, for the operator."""
        state = "CMD" if self.state == CMD else "MON"
        quality = QUALITIES[self.quality]
        joints = " ".join(f"{q:+.4f}" for q in self._plant.joints())
        last = f"; last: {self.events[-1]}" if self.events else ""
        return (
            f"{state} {quality} power={self.power:#06x} error={self.error:#06x} "
            f"answered={self.rating.answer_rate:.3f} missed={self.rating.misses} late={self.late} "
            f"malformed={self.malformed} joints {joints}{last}"
        )

    # --- motion ---

    def _commanded(self) -> np.ndarray:
        """The next set point in command mode, with every check that the controller makes."""
        command = self._answer
        if command is None or not command["flags"]:
            return self._bridged()
        self._missing = 0
        target = command["joints"].astype(np.float64)
        problem = self._problem(command, target)
        if problem:
            self.violate(*problem)
            return self._ramp_down()
        self.fastest = np.maximum(self.fastest, np.abs(target - self._set_point) / self.settings.cycle)
        return target

    def _problem(self, command: np.void, target: np.ndarray) -> tuple[str, int] | None:
        settings = self.settings
        flags = int(command["flags"])
        if flags & ~_ALLOWED_FLAGS.get(self._control, 0) or not flags & _JOINT_POSITION:
            return f"command flags {flags:#06x} do not fit the control strategy", 0
        if not np.isfinite(target).all():
            return "commanded joint is not a number", int(np.argmin(np.isfinite(target)))
        beyond = np.abs(target) - settings.range
        if beyond.max() > 0.0:
            return "joint range exceeded", int(beyond.argmax())
        speed = np.abs(target - self._set_point) / settings.cycle / (settings.speed_trip * self._safety)
        if speed.max() > 1.0:
            return "excessive commanded joint speed", int(speed.argmax())
        if flags & _JOINT_TORQUE and self._first_torque:
            torque = np.abs(command["added_torque"])
            self._first_torque = False
            if not torque.max() <= settings.torque_step:
                return "cmd.addJntTrq not properly initialized", int(torque.argmax())
        return None

    def _bridged(self) -> np.ndarray:
        self._missing += 1
        if self._missing > self.settings.bridged:
            self.power = 0
            self._leave(f"{self._missing} answers in a row missing")
            return self._ramp_down()
        return self._set_point + self._velocity * self.settings.cycle

    def _ramp_down(self) -> np.ndarray:
        """All joints slow down by one factor, so that the arm stays on its path."""
        cycle = self.settings.cycle
        fastest = np.abs(self._velocity).max()
        if fastest == 0.0:
            return self._set_point
        keep = max(0.0, 1.0 - self.settings.stop_deceleration * cycle / fastest)
        return self._set_point + keep * self._velocity * cycle

    # --- states ---

    def _change_state(self) -> None:
        if self.state == CMD and self.quality < self.settings.leave_quality:
            self._leave(f"quality {QUALITIES[self.quality]}")
        elif self._start_wanted and self.state == MON:
            self._try_to_enter()

    def _try_to_enter(self) -> None:
        command = self._answer
        if self.quality < self.settings.enter_quality or not self.power or command is None:
            return
        if self._velocity.any():
            return
        self._start_wanted = False
        apart = np.abs(command["joints"] - self._set_point)
        if not command["flags"] & _JOINT_POSITION or not apart.max() <= self.settings.entry_tolerance:
            self.violate("FRI interpolation error", int(np.argmax(apart)))
            return
        self.state = CMD
        self._base = self._set_point.copy()
        self._missing = 0
        self._first_torque = True
        self.events.append("command mode")

    def _leave(self, why: str) -> None:
        self.state = MON
        self.events.append(f"monitor mode: {why}")

    # --- the datagram ---

    def _measurement(self) -> bytes:
        record, joints = self._record[0], self._plant.joints()
        record["sequence"] = self._sequence
        record["reflected"] = self._reflected
        record["krl_int"] = self._program.answers
        record["timestamp"] = self._time
        record["state"] = self.state
        record["quality"] = self.quality
        record["measurement_time"] = record["command_time"] = self.settings.cycle
        record["safety_limits"] = self._safety
        record["answer_rate"] = self.rating.answer_rate
        record["latency"] = self.rating.latency
        record["jitter"] = self.rating.jitter
        record["miss_rate"] = 1.0 - self.rating.answer_rate
        record["miss_counter"] = self.rating.misses
        record["power"] = self.power
        record["control"] = self._control
        record["error"] = self.error
        record["warning"] = self.warning
        record["temperature"] = 35.0
        record["measured_joints"] = joints
        record["commanded_joints"] = self._base if self.state == CMD else self._set_point
        record["joint_offset"] = self._set_point - record["commanded_joints"]
        frame, jacobian = frame_and_jacobian(joints)
        record["measured_frame"] = frame.ravel()
        record["commanded_frame"] = frame_and_jacobian(self._set_point)[0].ravel()
        record["jacobian"] = jacobian.ravel()
        return record.tobytes()
