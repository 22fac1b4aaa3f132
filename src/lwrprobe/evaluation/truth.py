"""The true shape to hold something against: a scene, or a mesh file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError
from lwrprobe.reconstruction.meshes import WRITERS
from lwrprobe.scene import Scene, load_scene
from lwrprobe.scene.actual_scene import actual_scene
from lwrprobe.scene.scene_file import states_truth
from lwrprobe.scene.shape import Mesh
from lwrprobe.scene.solid import Solid

_SIMULATORS = ("sim", "mujoco")


def true_solid(scene: Scene) -> Solid | None:
    """The objects where they really are in a simulation of the scene; None where it has none."""
    return actual_scene(scene).solid() if scene.objects else None


def is_simulated(scene: Scene) -> bool:
    """Whether the scene's arm is a simulator, whose world is that of the scene, as far as its driver's name tells."""
    return scene.arm.driver in _SIMULATORS


def is_world_of(world: Scene, scene: Scene) -> bool:
    """Whether a simulated world has its objects where a scene has them; not that of a rig started with another one."""
    return world.objects == actual_scene(scene).objects


def with_given_area(blind: Scene, own: Scene) -> Scene:
    """A scene as it really is, with an area as far from its objects as that of the same scene not begun blindly.

    For runs that a blind start is compared with.
    """
    actual, area = actual_scene(blind), own.area
    (low, high), (own_low, own_high) = actual.solid().bounds(), own.solid().bounds()
    lower, upper = np.array(area.lower), np.array(area.upper)
    lower[:2] += (low - own_low)[:2]
    upper[:2] += (high - own_high)[:2]
    around = area.model_copy(update={"lower": tuple(lower.tolist()), "upper": tuple(upper.tolist())})
    return actual.model_copy(update={"area": around})


def read_truth(name: str) -> tuple[Solid, float]:
    """Solid, and the height [m] above which it is compared: what the sphere's centre can get down to.

    `name` is a built-in scene, a scene file, or a closed mesh (.stl, .ply, .obj, .glb; compared from its lowest point
    up). Objects are where the scene states them; those of a file with a table `[truth]`, as a run folder's has, where
    that puts them.
    Raises FormatError, SceneError or UnknownNameError for what is neither.
    """
    if Path(name).suffix.lower() not in WRITERS:
        scene = load_scene(name)
        return (actual_scene(scene) if states_truth(name) else scene).solid(), scene.area.lower[2]
    if not Path(name).is_file():
        raise FormatError(f"{name}: no such file")
    solid = Solid.from_shapes([Mesh(shape="mesh", file=name)])
    return solid, float(solid.bounds()[0][2]) - 1e-6
