"""What goes on the wire each cycle: the runner's set points, kept within speed and acceleration per cycle."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

_CATCH_UP = 0.25
"""Share of its speed by which a joint that is behind is faster: what was late is not made up for in one step."""
_SLOW = 0.01
"""Share of its speed limit with which one catches up with a set point that rests."""


class Ramp:
    """Follows set points that come once a cycle, or late, or not at all.

    A stream that keeps the limits itself passes unchanged. What is beyond them is caught up with, never jumped
    to; where no set point came, the joints brake together along their last direction.

    Parameters
    ----------
    speed, acceleration : (n) rad/s and rad/s^2
    """

    def __init__(self, speed: Sequence[float], acceleration: Sequence[float]) -> None:
        self._speed = tuple(speed)
        self._acceleration = tuple(acceleration)
        self.position = [0.0] * len(self._speed)
        self.velocity = [0.0] * len(self._speed)

    @property
    def resting(self) -> bool:
        return not any(self.velocity)

    def rest_at(self, position: Sequence[float]) -> None:
        """Take over a position at which the arm rests (the mirrored set point)."""
        self.position = list(position)
        self.velocity = [0.0] * len(self.position)

    def follow(self, target: Sequence[float], velocity: Sequence[float], cycle: float) -> list[float]:
        """Step towards `target`, which itself moves at `velocity`; the new position (n) rad."""
        for i, (goal, speed) in enumerate(zip(target, velocity)):
            max_speed, change = self._speed[i], self._acceleration[i] * cycle
            lag = goal - speed * cycle - self.position[i]
            limit = max(_CATCH_UP * abs(speed), _SLOW * max_speed)
            wanted = speed + max(-limit, min(limit, _closing_speed(lag, change, cycle)))
            old = self.velocity[i]
            new = max(old - change, min(old + change, wanted))
            new = max(-max_speed, min(max_speed, new))
            self.velocity[i] = new
            self.position[i] += new * cycle
        return self.position

    def brake(self, cycle: float) -> list[float]:
        """Step while slowing all joints by one common factor, so that the path stays the same."""
        if not self.resting:
            shares = zip(self.velocity, self._acceleration)
            keep = max(0.0, *(1.0 - limit * cycle / abs(speed) for speed, limit in shares if speed))
            self.velocity = [v * keep for v in self.velocity]
            self.position = [p + v * cycle for p, v in zip(self.position, self.velocity)]
        return self.position


def _closing_speed(lag: float, change: float, cycle: float) -> float:
    """Fastest speed that makes up for `lag` and can still be shed in steps of `change` a cycle."""
    far = abs(lag)
    speed = min(far / cycle, 0.5 * change * (sqrt(1.0 + 8.0 * far / (change * cycle)) - 1.0))
    return speed if lag > 0.0 else -speed
