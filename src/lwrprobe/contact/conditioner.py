"""From the sensor's reading to the wrench of contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contact import conditioning_kernels as k
from lwrprobe.contact.payload import GRAVITY, Payload
from lwrprobe.contact.wrench import Wrench, WrenchNoise
from lwrprobe.contracts import InputError, Probe, WrenchSample
from lwrprobe.contracts.samples import Vector

_BAD_RUN_LIMIT = 3
_CLOCK_JUMP = 10.0  # s between two readings: the clock was set, a stream that pauses for so long ends the run
_GOOD_SHARE = 0.8
_SPIKE_SPREAD = 16.0  # standard deviations off the median
_STILL_SPREAD = 4.0  # standard deviations; a still sensor has one
_LOUDEST = 8.0  # standard deviations: a sensor that much louder than stated cannot be distinguished from a moving one
_WHITE = 1.5  # of the noise between neighbouring readings: a spread below that is not motion
_FEWEST = 4
_FROZEN_TIME = 0.2  # s of equal values; with noise on six axes that never happens by chance


@dataclass(slots=True, frozen=True)
class Counters:
    """What the conditioner has seen since it was made."""

    samples: int
    invalid: int
    saturated: int
    lost: int
    late: int
    frozen: int
    spikes: int
    reordered: int


@dataclass(slots=True, frozen=True)
class BiasOutcome:
    """Whether a bias was taken, and why not.

    Attributes
    ----------
    taken : the conditioner uses `bias` from now on
    reason : empty, or one of `"too few samples"`, `"bad samples"`, `"not still"`, `"touching"`
    bias : (6,) N and N·m, what would be or was taken
    change : (6,) against the bias before
    noise : (6,) standard deviation of the readings
    """

    taken: bool
    reason: str
    bias: Vector
    change: Vector
    noise: Vector


class WrenchConditioner:
    """Takes bias and payload off every reading and says what is wrong with it.

    In order: values that are no readings (NaN, infinite, beyond four times the range), sequence and time (repeated,
    out of order, lost), values that stand still although the sensor has noise, saturation of all six axes, bias and
    weight, jumps (two of three), low pass. What cannot be used is counted and the last good wrench is held.

    A jump beyond `jump` is handed out at once, marked `UNCONFIRMED`, and confirmed when the next reading has jumped
    to the same side too: one sample of delay for jumps, none for everything else.

    Parameters
    ----------
    probe : ranges, resolutions and payload
    rate : Hz, the sensor's nominal rate
    jump : N between two samples that needs confirmation; torque in proportion to the sensor's distance
    cutoff : Hz of the first-order low pass, None = no filter
    payload : in place of the one the probe states
    noise : of one reading at rest, None = the probe's resolutions (`WrenchNoise.of`)
    """

    def __init__(
        self,
        probe: Probe,
        rate: float,
        *,
        jump: float = 0.5,
        cutoff: float | None = None,
        payload: Payload | None = None,
        noise: WrenchNoise | None = None,
    ) -> None:
        for name, value in (("rate", rate), ("jump", jump), ("cutoff", cutoff)):
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise InputError(f"conditioner.{name}", value, "a positive number")
        self.probe = probe
        self.rate = float(rate)
        self._zeroing = 0
        self._drift: Vector | None = None
        self._drifted = 0.0  # s, until when the bias is what it has drifted to

        self._params = np.zeros(k.PARAMS)
        ranges = np.concatenate([probe.force_range, probe.torque_range])
        steps = np.repeat([probe.force_resolution, probe.torque_resolution], 3)
        noise = WrenchNoise.of(probe) if noise is None else noise
        self._sigma = np.repeat([noise.force, noise.torque], 3)
        self._params[k.P_RANGE : k.P_RANGE + 6] = ranges - 1.5 * steps
        self._params[k.P_HUGE : k.P_HUGE + 6] = 4.0 * ranges
        self._params[k.P_JUMP : k.P_JUMP + 2] = jump, jump * max(probe.sensor_distance, probe.radius)
        self._params[k.P_SMOOTH] = 1.0 if cutoff is None else 1.0 - np.exp(-2.0 * np.pi * cutoff / rate)
        self._params[k.P_GRAVITY] = GRAVITY
        self._state = np.zeros(k.STATE)
        self._counts = np.zeros(k.COUNTS, dtype=np.int64)
        self._raw = np.zeros(6)
        self._rotation = np.eye(3)
        self._stamp = np.zeros(3)
        self._kernel = entry(
            k.condition, self._raw, self._rotation, self._stamp, self._params, self._state, self._counts, np.empty(9)
        )
        self.set_payload(Payload.of(probe) if payload is None else payload)

    def condition(self, sample: WrenchSample, rotation: np.ndarray) -> Wrench:
        """The contact wrench of one reading; never raises on what a sensor may send.

        `rotation` (3, 3) is the sensor frame in the world at the sample's time.
        """
        try:
            self._raw[:3] = sample.force
            self._raw[3:] = sample.torque
        except (TypeError, ValueError):
            self._raw[:] = np.nan
        self._rotation[:] = rotation
        if self._drift is not None:
            now = float(self._state[k.S_TIME])  # of the reading before, which has been found good
            if 0.0 < now - self._drifted < _CLOCK_JUMP:
                self._params[k.P_BIAS : k.P_BIAS + 6] += (now - self._drifted) * self._drift
            self._drifted = now
        stamp = self._stamp
        stamp[0], stamp[1], stamp[2] = sample.time, sample.sequence, sample.status
        out = np.empty(9)
        status = self._kernel(self._raw, self._rotation, self._stamp, self._params, self._state, self._counts, out)
        return Wrench(sample.time, out[:3], out[3:6], out[6:], sample.sequence, status, self._zeroing)

    @property
    def delay(self) -> float:
        """s by which the filter shifts a slow signal; 0 without one. A jump takes one sample more."""
        share = self._params[k.P_SMOOTH]
        return float((1.0 - share) / share / self.rate)

    @property
    def bias(self) -> Vector:
        """(6,) N and N·m taken off each reading."""
        return self._params[k.P_BIAS : k.P_BIAS + 6].copy()

    @property
    def counters(self) -> Counters:
        """What was rejected or marked so far."""
        return Counters(*(int(c) for c in self._counts[: k.C_REORDERED + 1]))

    @property
    def failing(self) -> str:
        """Why the stream can no longer be relied on, empty when it can."""
        bad, equal = self._counts.item(k.C_BAD_RUN), self._counts.item(k.C_EQUAL_RUN)
        if bad >= _BAD_RUN_LIMIT:
            return f"{bad} invalid readings in a row"
        if 0 < self._params.item(k.P_FROZEN) <= equal:
            return f"the same reading {equal + 1} times in a row"
        return ""

    def age(self, now: float) -> float:
        """s since the measurement of the last reading that moved on; inf before the first."""
        return now - float(self._state[k.S_TIME]) if self._counts[k.C_RECEIVED] else np.inf

    def set_payload(self, payload: Payload) -> None:
        """Use this mass and centre of mass, and the bias that was identified with them."""
        self._mass, self._com = payload.mass, np.array(payload.com, dtype=np.float64)
        self._params[k.P_MASS] = payload.mass
        self._params[k.P_MOMENT : k.P_MOMENT + 3] = payload.mass * self._com
        self._params[k.P_BIAS : k.P_BIAS + 6] = payload.bias
        self._zeroing += 1

    def shift_bias(self, change: Vector) -> None:
        """Add (6,) N and N·m to the bias; what is remembered of the last wrench is shifted with it."""
        change = np.asarray(change, dtype=np.float64)
        if change.shape != (6,) or not np.isfinite(change).all():
            raise InputError("bias.change", change.tolist(), "six finite numbers")
        self._params[k.P_BIAS : k.P_BIAS + 6] += change
        for at in (k.S_GOOD, k.S_SUSPECT, k.S_OUT):
            self._state[at : at + 6] -= change
        self._zeroing += 1

    def set_drift(self, rate: Vector) -> None:
        """From the next reading on, the bias moves by (6,) N/s and N·m/s; zero = it stays."""
        rate = np.asarray(rate, dtype=np.float64)
        if rate.shape != (6,) or not np.isfinite(rate).all():
            raise InputError("bias.drift", rate.tolist(), "six finite numbers")
        self._drift, self._drifted = (rate.copy() if rate.any() else None), float(self._state[k.S_TIME])

    def take_bias(
        self,
        samples: Sequence[WrenchSample],
        rotation: np.ndarray,
        touch_force: float = 0.15,
        expected: Vector | None = None,
    ) -> BiasOutcome:
        """Take the mean of the samples, less the weight, as bias, if the probe is free and still.

        Up to a fifth of the samples may be bad or spikes; they are left out.

        Refused as touching when the readings differ from what is expected by more than `touch_force`: from `expected`
        (6,) where given (the bias of an earlier run, or of another place); else from zero if, besides, the line of
        action of the reading meets the sphere, as that of a contact does and that of an offset hardly ever. A large
        unknown offset can hide a touch all the same: take the bias, retreat a little, and take it again with the
        first one as `expected`, until two agree.
        """
        values, reason = self._cleaned(samples)
        if reason:
            return BiasOutcome(False, reason, np.zeros(6), np.zeros(6), np.zeros(6))
        payload = Payload(self._mass, self._com, np.zeros(6))
        bias, noise = values.mean(axis=0) - payload.weight(rotation), values.std(axis=0)
        if self._moved(values):
            reason = "not still"
        elif self._touching(bias, expected, touch_force):
            reason = "touching"
        outcome = BiasOutcome(not reason, reason, bias, bias - self.bias, noise)
        if outcome.taken:
            self._adopt(bias, noise)
        return outcome

    def mean_error(self, samples: Sequence[WrenchSample]) -> float:
        """Standard error of the mean of samples at rest, over the noise of one reading: the largest of the six axes.

        Infinite where too few of the samples are readings.
        """
        values, reason = self._cleaned(samples)
        return np.inf if reason else float((values.std(axis=0) / self._sigma).max() / np.sqrt(len(values)))

    def _cleaned(self, samples: Sequence[WrenchSample]) -> tuple[np.ndarray, str]:
        """The readings (n, 6) without bad ones and spikes, or the reason why too few are left."""
        values = np.array([np.concatenate([s.force, s.torque]) for s in samples], dtype=np.float64).reshape(-1, 6)
        if len(values) < _FEWEST:
            return values, "too few samples"
        good = (np.abs(values) < self._params[k.P_RANGE : k.P_RANGE + 6]).all(axis=1)  # false for NaN
        if good.mean() < _GOOD_SHARE:
            return values, "bad samples"
        quiet = good & (np.abs(values - np.median(values[good], axis=0)) < _SPIKE_SPREAD * self._sigma).all(axis=1)
        return values[quiet] if quiet.mean() >= _GOOD_SHARE else values[good], ""

    def _moved(self, values: np.ndarray) -> bool:
        """Noise far above the sensor's, or a first half that differs from the second.

        The noise of neighbouring readings is independent, motion is not (von Neumann's ratio): a sensor that is louder
        than stated is still.
        """
        half = len(values) // 2
        trend = np.abs(values[:half].mean(axis=0) - values[half:].mean(axis=0))
        jitter = np.sqrt(0.5 * np.mean(np.diff(values, axis=0) ** 2, axis=0))
        allowed = _STILL_SPREAD * self._sigma
        loud = np.maximum(allowed, np.minimum(_WHITE * jitter, _LOUDEST * self._sigma))
        return bool((values.std(axis=0) > loud).any() or (trend > allowed).any())

    def _touching(self, bias: Vector, expected: Vector | None, touch_force: float) -> bool:
        if expected is not None:
            return bool(np.linalg.norm(bias[:3] - expected[:3]) > touch_force)
        force, torque = bias[:3], bias[3:]
        magnitude = np.linalg.norm(force)
        if magnitude <= touch_force:
            return False
        centre = np.array([0.0, 0.0, self.probe.sensor_distance])
        lever = np.linalg.norm(torque - np.cross(centre, force)) / magnitude
        return bool(lever < 1.2 * self.probe.radius)

    def _adopt(self, bias: Vector, noise: Vector) -> None:
        self._params[k.P_BIAS : k.P_BIAS + 6] = bias
        noisy = bool((noise > 0.1 * self._sigma).all())
        self._params[k.P_FROZEN] = max(3.0, _FROZEN_TIME * self.rate) if noisy else 0.0
        self._counts[[k.C_BEGUN, k.C_IS_SUSPECT]] = 0  # the change of bias is no jump
        self._zeroing += 1
