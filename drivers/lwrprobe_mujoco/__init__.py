"""A second physics: driver plug-in `mujoco` for the roles arm and sensor, and the ground truth.

Arm, stick, contacts and friction are MuJoCo's. What a sample suffers behind the sensor (noise, resolution, range,
latency, loss) and what `[truth]` changes are those of the plug-in `sim`, so that a difference between the two is one
of physics. Needs the extra `mujoco`.
"""

from lwrprobe_mujoco.config import MujocoConfig
from lwrprobe_mujoco.driver import MujocoDriver

__all__ = ["MujocoConfig", "MujocoDriver"]
