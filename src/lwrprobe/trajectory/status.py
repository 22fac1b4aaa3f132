"""What a generator is doing."""

from __future__ import annotations

from enum import IntEnum


class TrajectoryStatus(IntEnum):
    """Answer of every `step`; none of them is an error that stops the loop."""

    RESTING = 0
    """No motion: at the goal (`arrived`), or after a stop."""
    MOVING = 1
    """On the path to the goal."""
    TRACKING_VELOCITY = 2
    """Keeping, or turning to, the velocity fed."""
    STOPPING = 3
    """Coming to rest, jerk-limited."""
    YIELDING = 4
    """The motion does not fit the new aim yet: it is slowed first, then planned anew by itself."""
    TOO_FAST = 5
    """The speed is above what was asked for; it is brought down as fast as the limits allow."""
    RESCUED = 6
    """The planner failed; a jerk-limited stop is under way, or done."""
