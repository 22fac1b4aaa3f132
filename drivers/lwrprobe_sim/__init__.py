"""The simulator: driver plug-in `sim` for the roles arm and sensor, and the ground truth."""

from lwrprobe_sim.config import SimConfig
from lwrprobe_sim.driver import SimDriver

__all__ = ["SimConfig", "SimDriver"]
