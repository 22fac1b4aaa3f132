"""A run without what is made of its contacts afterwards: mesh, comparison with the truth, pictures, report."""

from pathlib import Path

from lwrprobe.exploration.procedures.explore import Exploration, RunOptions
from lwrprobe.scene import Scene


def run_alone(scene: Scene, folder: Path) -> Exploration:
    """Explore to the end; the streams are in the folder then: contacts.csv, trace.csv, states.csv."""
    with Exploration(scene, RunOptions(out=folder)) as exploration:
        for _ in exploration:
            pass
    return exploration
