"""Recorded runs again: with the same settings to repeat every decision, with others to compare them offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contact import check_estimator
from lwrprobe.evaluation import surface_error
from lwrprobe.evaluation.truth import is_simulated, true_solid
from lwrprobe.exploration.procedures.replay import Replay, recorded_scene
from lwrprobe.exploration.recording.recording import Recording, read_recording
from lwrprobe.scene import Scene


@dataclass(slots=True, frozen=True)
class Replayed:
    """One passage.

    Attributes
    ----------
    estimator : its name
    status, reason : how the passage ended
    contacts : accepted ones
    error_mm : their distances from the surface of the simulated object, as of `PointError.as_dict`; None without one
    us_sample : us of computing time a sample
    folder : the run folder, None where none was asked for
    """

    estimator: str
    status: str
    reason: str
    contacts: int
    error_mm: dict[str, float] | None
    us_sample: float
    folder: Path | None

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self) | {"folder": None if self.folder is None else str(self.folder)}


def replay(
    source: str | Path,
    *,
    scene: Scene | None = None,
    settings: Sequence[str] = (),
    estimators: Sequence[str] = (),
    out: str | Path | None = None,
) -> list[Replayed]:
    """Take a recording through the pipeline once for each estimator.

    Parameters
    ----------
    source : run folder with a bag, bag folder, or .mcap or .db3 file
    scene : for a bag that does not contain its own
    settings : `key=value`
    estimators : names, none = the one that the scene names
    out : run folder to write, with several estimators one in it for each; None keeps nothing

    Raises FormatError for what is no recording, and InputError and its kin for settings that cannot be run.
    """
    for name in estimators:
        check_estimator(name)
    recording = read_recording(source)
    recorded = recorded_scene(recording, scene)
    found = []
    for name in estimators or ("",):
        changes = [*settings, *([f"contact.estimator={name}"] if name else [])]
        changed = recorded_scene(recording, scene, changes)
        folder = None if out is None else Path(out) / name if len(estimators) > 1 else Path(out)
        found.append(_passage(recording, changed, folder, changed == recorded))
    return found


def _passage(recording: Recording, scene: Scene, folder: Path | None, same: bool) -> Replayed:
    passage = Replay(recording, scene, folder, same)
    outcome = passage.run()
    error = None
    solid = true_solid(scene) if is_simulated(scene) and recording.own else None
    if solid is not None and passage.contacts:
        points = np.array([contact.point for contact in passage.contacts])
        error = surface_error(points, solid).as_dict()
    count = len(passage.contacts)
    if folder is not None:
        passage.finish()
    per_sample = 1e6 * passage.seconds / max(len(recording.run()), 1)
    return Replayed(scene.contact.estimator, outcome.status, outcome.reason, count, error, per_sample, folder)
