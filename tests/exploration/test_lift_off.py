"""A long contact is interrupted for the sensor's zero: when it is due, how far off, and what is not taken for zero."""

import numpy as np
import pytest

from lwrprobe.contact import DriftWatch, Wrench, WrenchConditioner
from lwrprobe.contracts import Goal, Probe, VelocityCommand, WrenchSample
from lwrprobe.exploration.stages.lift_off import LIFT, LiftOff

UP, SLIDE = np.array([0.0, 0.0, 1.0]), VelocityCommand(np.array([0.01, 0.0, 0.0]))
DUE = 5.0


class Pressed:
    """A probe on a level floor, whose zero drifts along z; `ceiling` m above the floor it is touched again."""

    def __init__(self, ceiling=1.0, drift=0.005):
        self.conditioner = WrenchConditioner(Probe(), 125.0)
        free = np.random.default_rng(1).normal(size=(100, 6)) * np.repeat([3e-3, 1.6e-5], 3)
        self.conditioner.take_bias([WrenchSample(k / 125.0, v[:3], v[3:], k) for k, v in enumerate(free)], np.eye(3))
        self.watch = DriftWatch(self.conditioner, window=0.5)
        self.lift = LiftOff(self.watch, DUE, gentle=1.2, unchanged=0.05, speed=0.01)
        self.place, self.time, self.ceiling, self.drift = np.array([0.0, 0.0, -3e-4]), 0.0, ceiling, drift
        self.first = self.conditioner.bias[2]

    @property
    def error(self):
        """N by which the zero is off."""
        return self.drift * self.time - (self.conditioner.bias[2] - self.first)

    def run(self, seconds, asked=SLIDE):
        """The highest place, m, and the longest interruption, s."""
        highest = longest = away = 0.0
        for _ in range(int(125 * seconds)):
            self.time += 0.008
            above = max(self.place[2] - self.ceiling, 0.0)
            true = 2500.0 * (max(-self.place[2], 0.0) - above)
            force = np.array([0.0, 0.0, true + self.error])
            wrench = Wrench(self.time, force, np.zeros(3), force, round(125 * self.time), 0)
            normal = UP if abs(force[2]) > 0.2 else None
            motion = self.lift.motion(asked, wrench, self.place, normal, 4e-4, 0.0)
            if motion is None:
                self.place[2], away = -3e-4, 0.0
            else:
                self.place = self.place + 0.008 * motion.velocity
                away += 0.008
            highest, longest = max(highest, self.place[2]), max(longest, away)
        return highest, longest


def test_the_zero_is_taken_off_the_surface_each_time_it_is_due():
    pressed = Pressed()
    assert pressed.run(4.9)[0] <= 0.0
    assert pressed.error == pytest.approx(0.0245, abs=1e-3)
    highest, longest = pressed.run(20.0)
    assert pressed.lift.taken == 4
    assert pressed.error < 0.005 * DUE
    assert LIFT < highest < 2.0 * LIFT
    assert longest < 1.0


def test_what_is_touched_on_the_other_side_is_no_zero():
    pressed = Pressed(ceiling=3e-4)
    pressed.run(12.0)
    assert pressed.lift.taken == 0
    assert pressed.error == pytest.approx(0.06, abs=1e-3)


def test_on_the_way_to_a_goal_nothing_is_interrupted():
    assert Pressed().run(10.0, asked=Goal(np.eye(4), 0.1))[0] <= 0.0
