"""Clearance between the robot's links and what must not be touched."""

from lwrprobe.collision.clearance import NO_FRAMES, ClearanceQuery

__all__ = ["NO_FRAMES", "ClearanceQuery"]
