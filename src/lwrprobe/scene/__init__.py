"""Scene files, shapes with ground truth, the built-in scene library."""

from lwrprobe.scene.actual_scene import widened_area
from lwrprobe.scene.library import profile_names, scene_names
from lwrprobe.scene.scene import Scene
from lwrprobe.scene.scene_file import json_schema, load_scene, scene_content, write_scene

__all__ = [
    "Scene",
    "json_schema",
    "load_scene",
    "profile_names",
    "scene_content",
    "scene_names",
    "widened_area",
    "write_scene",
]
