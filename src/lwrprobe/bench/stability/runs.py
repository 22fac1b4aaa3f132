"""Whole explorations, short ones, and what they found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.exploration.procedures.explore import Exploration
from lwrprobe.scene import Scene, load_scene
from lwrprobe.scene.solid import Solid

LINES_ONLY = ("strategy.across=false", "strategy.find_ends=false")
"""The grid's own lines and nothing after them: the case is in the line, and the run is short."""


@dataclass(slots=True)
class Run:
    """A run and its data.

    Attributes
    ----------
    points, normals : (n, 3) of the contacts that were trusted
    distance : (n,) m of these from the true surface, outside positive
    path : (m, 3) m, where the sphere was; force : (m,) N; touching : (m,) at those times
    """

    scene: Scene
    summary: dict[str, Any]
    points: np.ndarray
    normals: np.ndarray
    distance: np.ndarray
    path: np.ndarray
    force: np.ndarray
    touching: np.ndarray

    @property
    def solid(self) -> Solid:
        """The true object."""
        return self.scene.solid()

    @property
    def ended(self) -> str:
        """How, in the summary's words."""
        return f"{self.summary['status']}: {self.summary['reason']}"

    @property
    def within_limit(self) -> bool:
        """The true force stayed below the scene's limit."""
        return self.summary["peak_force_n"] <= self.scene.contact.limit

    def describe(self) -> str:
        """The figures that every run has."""
        s = self.summary
        return f"{self.ended}; {s['contacts']} contacts in {s['sim_time_s']:.0f} s, peak {s['peak_force_n']:.2f} N"


HALF = 0.005
"""m, half the width of a strip that the sphere sweeps in one line along x = 0."""


def strip(name: str, settings: list[str] | None = None, half_width: float = HALF, top: float | None = None) -> Run:
    """Explore a scene between x = -half_width and half_width only, and up to `top` m: one line, or three if wider."""
    area = load_scene(name).area
    bounds = [
        f"area.lower=[{-half_width}, {area.lower[1]}, {area.lower[2]}]",
        f"area.upper=[{half_width}, {area.upper[1]}, {area.upper[2] if top is None else top}]",
        f"strategy.step={2.0 * half_width}",
    ]
    return explored(name, [*bounds, *LINES_ONLY, *(settings or [])])


def explored(name: str, settings: list[str]) -> Run:
    """Explore a scene, keeping nothing on disk; 600 s of robot time at most unless set."""
    scene = load_scene(name, ['truth.profile="ideal"', "run.time_limit=600.0", *settings])
    with Exploration(scene) as exploration:
        for _ in exploration:
            pass
    summary = exploration.finish().as_dict()
    solid, path = scene.solid(), exploration.recorder.trace()
    points, normals = exploration.record.points, exploration.record.normals
    assert normals is not None
    distance = solid.signed_distance(points) if len(points) and scene.objects else np.full(len(points), np.nan)
    return Run(scene, summary, points, normals, distance, path[:, 1:4], path[:, 4], path[:, 5] > 0.0)
