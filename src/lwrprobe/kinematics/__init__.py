"""Serial arms: forward kinematics, Jacobians, inverse kinematics, straight paths and workspaces."""

from lwrprobe.kinematics.gears import Gears
from lwrprobe.kinematics.inertia import LinkInertia, apparent_mass, link_inertias, mass_matrix
from lwrprobe.kinematics.models import iiwa14, lwr4, panda, puma560, robot_by_name, ur5e
from lwrprobe.kinematics.path import FollowReport, follow, sensitivity, straight_line
from lwrprobe.kinematics.preference import Preference
from lwrprobe.kinematics.robot import Robot
from lwrprobe.kinematics.rtb import from_roboticstoolbox, to_roboticstoolbox
from lwrprobe.kinematics.solver import Branch, IKResult, IKSolver, IKStatus
from lwrprobe.kinematics.urdf import from_urdf
from lwrprobe.kinematics.workspace import Reachability, Workspace, dexterity, reachable, sample_workspace

__all__ = [
    "Branch",
    "FollowReport",
    "Gears",
    "IKResult",
    "IKSolver",
    "IKStatus",
    "LinkInertia",
    "Preference",
    "Reachability",
    "Robot",
    "Workspace",
    "apparent_mass",
    "dexterity",
    "follow",
    "from_roboticstoolbox",
    "from_urdf",
    "iiwa14",
    "link_inertias",
    "lwr4",
    "mass_matrix",
    "panda",
    "puma560",
    "reachable",
    "robot_by_name",
    "sample_workspace",
    "sensitivity",
    "straight_line",
    "to_roboticstoolbox",
    "ur5e",
]
