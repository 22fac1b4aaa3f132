"""Slow the tip in time where the joints would have to be too fast, or to change their speed too fast."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.trajectory.cartesian import CartesianTrajectory

LOW_USE = 0.25
"""Share of a joint speed limit below which the next look may wait."""
LONGER = 4
"""How many times longer, then."""
SUDDEN = 0.5
"""Share of the time between two poses of a close look, within which a joint may change its speed."""
FASTER = 1.5
"""Growth of the speed asked for that does not wait for the next look."""


class SpeedGovernor:
    """Keeps the joints below their limits by scaling the tip's speed, inside the tip's own limits.

    The plan is looked at ahead for as long as the tip needs to stop, and while it is slowed for as far as it would
    need without: inverse kinematics of a few poses on it gives the largest share of a joint speed limit that the plan
    will ask for and where. At one place that share is
    proportional to the tip's speed, so that the speed which brings it back into the band follows at once. The
    acceleration that a joint needs because its path bends is proportional to the square of that speed: the root of
    its share counts as a share does. Between two poses it may bend all at once. The tip speeds up again
    where the joints can follow that: near a singularity the acceleration of the tip alone may ask too much of them. Far
    from the limits it looks less often and less closely.

    Parameters
    ----------
    trajectory : the generator whose speed is scaled
    track_all : (poses (m, 4, 4), q_seed (n,), q_out (m, n)) -> how many were solved in turn; as `IKSolver.track_all`
    speed, acceleration : (n,) rad/s and rad/s^2, joint limits; a number is that of all joints
    every : cycles from one look to the next, `LONGER` times that below `LOW_USE`
    samples : poses a look, the present one counted; half as many below `LOW_USE`
    highest : share above which the tip slows down
    lowest : share below which it speeds up again, if it had been slowed
    slowest : factor below which the speed is never scaled, so that the tip leaves the place

    Attributes
    ----------
    use : largest share ahead at the last look, of speed or the root of that of acceleration
    blocked_in : s from the last look to the first pose on the plan without solution, inf where there is none
    """

    def __init__(
        self,
        trajectory: CartesianTrajectory,
        track_all: Callable[[np.ndarray, np.ndarray, np.ndarray], int],
        speed: np.ndarray,
        acceleration: np.ndarray | float = inf,
        every: int = 10,
        samples: int = 17,
        highest: float = 0.8,
        lowest: float = 0.6,
        slowest: float = 0.002,
    ) -> None:
        if not 0.0 < lowest < highest < 1.0 or not 0.0 < slowest < 1.0:
            raise InputError("lowest, highest, slowest", (lowest, highest, slowest), "0 < lowest < highest < 1")
        if every < 1 or samples < 3:
            raise InputError("every, samples", (every, samples), "1 or more, 3 or more")
        self._trajectory, self._track_all = trajectory, track_all
        self._speed = np.array(speed, dtype=np.float64)
        self._acceleration = np.broadcast_to(np.float64(acceleration), self._speed.shape)
        self._every, self._slowest = every, slowest
        self._lowest, self._middle, self._highest = lowest, 0.5 * (lowest + highest), highest
        self._poses, self._speed_ratio = np.empty((samples, 4, 4)), np.empty(samples)
        self._joints = np.empty((samples, self._speed.size))
        self._wait = 0
        self._low_use = False
        self._asked = (0.0, 0.0)
        self.use, self.blocked_in = 0.0, inf

    @property
    def due(self) -> float:
        """Cycles from now to the next look, at least 1; inf at rest."""
        if self._trajectory.resting:
            return inf
        return 1 if self.blocked_in < inf or self._is_faster() else max(self._wait + 1, 1)

    def watch(self, q: np.ndarray, cycles: int = 1) -> float:
        """Call after so many steps, up to `due`, with the joints (n,) after the last of them; returns `use`."""
        if self._trajectory.resting:
            self._trajectory.scale(1.0)
            self._wait, self._low_use, self.use, self.blocked_in = 0, False, 0.0, inf
            return 0.0
        self._wait -= cycles
        if self._wait < 0 or self._is_faster():
            pause = LONGER * self._every if self._low_use else self._every
            self._wait = pause - 1
            self._low_use = self._look(q, pause) < LOW_USE and self.blocked_in == inf
        return self.use

    def _is_faster(self) -> bool:
        """Whether more is asked for than at the last look."""
        (speed, turn_rate), (old_speed, old_rate) = self._trajectory.asked, self._asked
        return speed > FASTER * old_speed or turn_rate > FASTER * old_rate

    def _look(self, q: np.ndarray, cycles: int) -> float:
        """The largest share of a joint speed limit until the tip could stand; the tip's speed is scaled."""
        trajectory, count = self._trajectory, len(self._speed_ratio)
        self._asked = trajectory.asked
        seconds = trajectory.stopping_time + cycles * trajectory.cycle
        further, allowed = 0.0, inf
        if trajectory.factor < 1.0:
            _, _, further, allowed = self._ahead(q, seconds / trajectory.factor, count)
        count = count // 2 + 1 if self._low_use else count
        solved, fastest, near, allowed_near = self._ahead(q, seconds, count)
        self.blocked_in = solved * seconds / (count - 1) if solved < count else inf
        self.use = max(near, further)
        self._scale(min(allowed, allowed_near), solved)
        return fastest

    def _ahead(self, q: np.ndarray, seconds: float, count: int) -> tuple[int, float, float, float]:
        """What the plan asks of the joints, at so many poses from now, where they are at q (n,), to `seconds` ahead.

        How many poses were solved; the largest share of a joint speed limit; that, or the root of the largest share of
        an acceleration limit, if it is larger; the factor of the tip's speed that brings it back into the band.
        """
        poses, speed_ratio, joints = self._poses[:count], self._speed_ratio[:count], self._joints
        spacing = seconds / (count - 1)
        self._trajectory.preview(seconds, poses, speed_ratio)
        joints[0] = q
        solved = 1 + self._track_all(poses[1:], q, joints[1:count])
        speeds = np.diff(joints[:solved], axis=0) / spacing
        use = (np.abs(speeds) / self._speed).max(axis=1, initial=0.0)
        fastest = float(use.max(initial=0.0))
        # Where a joint comes to the end of its range, the others change their speeds from one cycle to the next.
        close = count == len(self._speed_ratio)
        sudden = max(self._trajectory.cycle, SUDDEN * spacing) if close else spacing
        bends = np.abs(np.diff(speeds, axis=0)) / (sudden * self._acceleration)
        use[1:] = np.maximum(use[1:], np.sqrt(bends.max(axis=1, initial=0.0)))
        over = use > self._highest
        ratio = 0.5 * (speed_ratio[: solved - 1] + speed_ratio[1:solved])
        allowed = float((ratio[over] / use[over]).min(initial=inf)) * self._middle
        return solved, fastest, float(use.max(initial=0.0)), allowed

    def _scale(self, allowed: float, solved: int) -> None:
        """Slow down to the allowed factor, or speed up where the poses solved in this look leave room for it."""
        trajectory = self._trajectory
        if self.use > self._highest:
            wanted = max(self._slowest, min(allowed, trajectory.factor))
        elif self.use < self._lowest and trajectory.factor < 1.0 and self._of_acceleration(solved) <= self._highest:
            wanted = min(1.0, trajectory.factor * min(1.5, self._middle / max(self.use, 1e-3)))
        else:
            return
        if abs(wanted - trajectory.factor) > 0.02 * trajectory.factor:
            trajectory.scale(wanted)

    def _of_acceleration(self, solved: int) -> float:
        """Largest share of a joint's acceleration that the tip's own may ask for, at the poses solved in this look."""
        limits, poses = self._trajectory.limits, self._poses[:solved]
        moved, steps = np.abs(np.diff(self._joints[:solved], axis=0)), np.diff(poses, axis=0)
        turns = np.linalg.norm(steps[:, :3, :3], axis=(1, 2)) / np.sqrt(2.0)
        way = np.maximum(
            np.linalg.norm(steps[:, :3, 3], axis=1) / limits.acceleration, turns / limits.turn_acceleration
        )
        going = way > 0.0
        return float((moved[going] / (way[going, None] * self._acceleration)).max(initial=0.0))
