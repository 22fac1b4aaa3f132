"""The sensor's own faults: noise, drift, spikes, saturation, quantisation, and a transmission with delays and losses.

Randomness is a counter hashed with the seed (splitmix64: Steele, Lea, Flood 2014), so that a sample's noise depends
on its number alone and never on what was asked before.
"""

import math

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel

NOISE_FORCE, NOISE_TORQUE, COUNT_FORCE, COUNT_TORQUE = range(4)
RANGE = 4  # 6, N and N m
BIAS = 10  # 6
DRIFT = 16  # 6, per second
SPIKES, SPIKE_FORCE, GARBAGE = 22, 23, 24  # chance a sample, N, chance a sample
PERIOD, LATENCY, LATE_SHARE, LATE_BY, LOSS, BURST, BURST_LENGTH = 25, 26, 27, 28, 29, 30, 31
FREEZE_FROM, FREEZE_TO, SKEW, LATE_LIMIT = 32, 33, 34, 35
MATRIX = 36  # 36, of the true wrench, row by row; all zero = the identity
WANDER_FORCE, WANDER_TORQUE, WANDER_TIME = 72, 73, 74
PLAY, PLAYED = 75, 81  # 6 half widths, and 6 readings behind the play: state
MIXED, PLAYS = 87, 88  # whether there is a matrix, and a play
SETTINGS = 89

# columns of a sample
TIME, FORCE, TORQUE, SEQUENCE, STATUS, ARRIVAL, SAMPLE = 0, 1, 4, 7, 8, 9, 10

# lwrprobe.contracts.SampleStatus
SATURATED, LATE, LOST_BEFORE = 1, 2, 4

# streams of random numbers: 0..5 are the axes' noise
_SPIKE, _SPIKE_AXIS, _GARBAGE, _LATE, _LATE_BY, _LOSS, _BURST = 8, 9, 10, 11, 12, 13, 14
_WANDER = 16  # to 21
_WIDTH = math.sqrt(12.0)  # of a uniform distribution with standard deviation 1


@kernel
def uniform(seed, stream, number):
    """A number in (0, 1) that depends on nothing but the three integers."""
    z = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(stream) * np.uint64(0xD1B54A32D192ED03)
    z = z + np.uint64(number) * np.uint64(0xBF58476D1CE4E5B9) + np.uint64(0x9E3779B97F4A7C15)
    for _ in range(2):
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (float(z >> np.uint64(11)) + 0.5) / 9007199254740992.0


@kernel
def normal_pair(seed, stream, number):
    """Two independent standard normal numbers (Box, Muller 1958)."""
    length = math.sqrt(-2.0 * math.log(uniform(seed, stream, number)))
    angle = 2.0 * math.pi * uniform(seed, stream + 1, number)
    return length * math.cos(angle), length * math.sin(angle)


@kernel
def mix(s, wrench):
    """The wrench (6,) multiplied by MATRIX, in place."""
    x0, x1, x2, x3, x4, x5 = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
    for i in range(6):
        m = MATRIX + 6 * i
        wrench[i] = s[m] * x0 + s[m + 1] * x1 + s[m + 2] * x2 + s[m + 3] * x3 + s[m + 4] * x4 + s[m + 5] * x5


@kernel
def play(s, wrench):
    """A play of half width PLAY in each axis of the wrench (6,), in place: the reading follows at that distance."""
    for i in range(6):
        s[PLAYED + i] = min(max(s[PLAYED + i], wrench[i] - s[PLAY + i]), wrench[i] + s[PLAY + i])
        wrench[i] = s[PLAYED + i]


@kernel
def wander(s, seed, axis, time):
    """Bounded random process of standard deviation 1: smooth between values that are independent every WANDER_TIME."""
    at = time / s[WANDER_TIME]
    knot = math.floor(at)
    share = at - knot
    share *= share * (3.0 - 2.0 * share)
    here = uniform(seed, _WANDER + axis, int(knot)) - 0.5
    there = uniform(seed, _WANDER + axis, int(knot) + 1) - 0.5
    # Two independent values mixed vary less than each: divided out, the deviation is the same at all times.
    return _WIDTH * ((1.0 - share) * here + share * there) / math.sqrt((1.0 - share) ** 2 + share**2)


@kernel
def measure(s, seed, number, time, wrench, out):
    """The measured sample of the true wrench (6,) at its instant, into out (SAMPLE,).

    A matrix and a play change `wrench` in place.
    """
    if s[MIXED] > 0.0:
        mix(s, wrench)
    if s[PLAYS] > 0.0:
        play(s, wrench)
    status = 0
    spike = -1
    if s[SPIKES] > 0.0 and uniform(seed, _SPIKE, number) < s[SPIKES]:
        spike = int(3.0 * uniform(seed, _SPIKE_AXIS, number))
    noise_a = noise_b = 0.0
    for i in range(6):
        sigma = s[NOISE_FORCE] if i < 3 else s[NOISE_TORQUE]
        count = s[COUNT_FORCE] if i < 3 else s[COUNT_TORQUE]
        value = wrench[i] + s[BIAS + i] + s[DRIFT + i] * time
        wandering = s[WANDER_FORCE] if i < 3 else s[WANDER_TORQUE]
        if wandering > 0.0:
            value += wandering * wander(s, seed, i, time)
        if sigma > 0.0:
            if i % 2 == 0:
                noise_a, noise_b = normal_pair(seed, i, number)
                value += sigma * noise_a
            else:
                value += sigma * noise_b
        if i == spike:
            value += s[SPIKE_FORCE]
        if count > 0.0:
            value = count * math.floor(value / count + 0.5)
        limit = s[RANGE + i]
        if abs(value) >= limit:
            value = math.copysign(limit, value)
            status |= SATURATED
        out[FORCE + i] = value
    if s[GARBAGE] > 0.0 and uniform(seed, _GARBAGE, number) < s[GARBAGE]:
        out[FORCE] = math.nan
    out[TIME] = time + s[SKEW]
    out[SEQUENCE] = number
    out[STATUS] = status


@kernel
def lost(s, seed, number):
    """Whether the sample is lost: single losses, and bursts that lose all samples that begin within them."""
    if s[LOSS] > 0.0 and uniform(seed, _LOSS, number) < s[LOSS]:
        return True
    if s[BURST] > 0.0:
        for back in range(int(s[BURST_LENGTH] / s[PERIOD]) + 1):
            if number - back > 0 and uniform(seed, _BURST, number - back) < s[BURST]:
                return True
    return False


@kernel
def delay(s, seed, number):
    """s from the instant of measurement to arrival."""
    wait = s[LATENCY]
    if s[LATE_SHARE] > 0.0 and uniform(seed, _LATE, number) < s[LATE_SHARE]:
        wait += s[LATE_BY] * uniform(seed, _LATE_BY, number)
    return wait
