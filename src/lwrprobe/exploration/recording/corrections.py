"""The corrections of a run's contacts after its end, in the order in which each relies on those before it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.exploration.recording.gear_waves import GearWaves, take_waves_off
from lwrprobe.exploration.recording.give import Give, take_give_off
from lwrprobe.exploration.recording.neighbour_normals import NeighbourTurn, turn_to_neighbours
from lwrprobe.exploration.recording.path_normals import PathTurn, turn_to_path
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.side_turn import SideTurn, take_side_turn_off
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene


@dataclass(slots=True, frozen=True, kw_only=True)
class Corrections:
    """What was corrected; None where nothing was.

    Attributes
    ----------
    give : positions, by the compliance of object, arm and stick
    waves : positions, by the waves of the arm's gears
    path : normals, by the path on both sides of them
    side : normals, by the angle of friction that all have in common
    neighbours : normals, by the slope to the lines beside them
    """

    give: Give | None = None
    waves: GearWaves | None = None
    path: PathTurn | None = None
    side: SideTurn | None = None
    neighbours: NeighbourTurn | None = None

    def report(self) -> dict[str, Any]:
        """By attribute of the run's summary."""
        parts = {
            "give": self.give,
            "gear_waves": self.waves,
            "side_turn": self.side,
            "neighbour_turn": self.neighbours,
        }
        return {name: None if part is None else part.report() for name, part in parts.items()}


def correct_contacts(recorder: Recorder, scene: Scene, pipeline: Pipeline, start: np.ndarray) -> Corrections:
    """Correct the contacts that follow the run; on disk they stay as measured.

    `start` (n,) rad: joint values where the stiffness of the arm is stated.
    """
    spacing = pipeline.line_spacing
    return Corrections(
        give=take_give_off(recorder, scene, pipeline, start),
        waves=take_waves_off(recorder, scene, pipeline.robot),
        path=turn_to_path(recorder, scene.probe.radius),
        side=take_side_turn_off(recorder, scene, spacing),
        neighbours=turn_to_neighbours(recorder, scene, spacing),
    )
