"""Clearance: the distance between the robot's links and the map, the table, meshes and each other."""

from lwrprobe.collision.clearance import ClearanceQuery
from lwrprobe.collision.link_rows import NO_FRAMES
from lwrprobe.collision.watch import ClearanceWatch, LinkGroup

__all__ = ["NO_FRAMES", "ClearanceQuery", "ClearanceWatch", "LinkGroup"]
