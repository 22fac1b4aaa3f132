"""Clearance between the robot's links and what must not be touched."""

from lwrprobe.collision.clearance import ClearanceQuery
from lwrprobe.collision.link_rows import NO_FRAMES
from lwrprobe.collision.watch import ClearanceWatch, LinkGroup

__all__ = ["NO_FRAMES", "ClearanceQuery", "ClearanceWatch", "LinkGroup"]
