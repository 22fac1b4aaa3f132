"""KUKA LWR 4+ over the Fast Research Interface 1.0 of its KRC2 lr controller."""

from lwrprobe_fri.config import FriConfig
from lwrprobe_fri.driver import FriArm, FriDriver

__all__ = ["FriArm", "FriConfig", "FriDriver"]
