"""ATI Wireless F/T: the six-axis force/torque sensor behind the probe, over telnet and UDP."""

from lwrprobe_ati.config import AtiConfig
from lwrprobe_ati.driver import AtiDriver
from lwrprobe_ati.sensor import AtiSensor

__all__ = ["AtiConfig", "AtiDriver", "AtiSensor"]
