"""The picture of how `active` explores: what was touched after each stroke."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

SCENE, STRATEGY = "block", "active"
MAX_POINTS = 3000
MAX_PANELS = 12
FOLLOWED = "follow contour"
GOES_ON = ("contact", "contact lost", "overlarge force", "force released")
"""Events after which the same stroke goes on."""


def stroke_ends(rows: Iterable[tuple[float, str, str]]) -> list[float]:
    """s, when each stroke ended: of (time s, skill, event) whenever another skill begins to move the tip."""
    return [time for time, skill, event in rows if skill == FOLLOWED and event not in GOES_ON]


def strokes_of(folder: Path) -> dict[str, Any]:
    """`points` (n, 3) m, `times` (n,) s, and `ends` of the strokes, s, of a run's folder."""
    from lwrprobe.evaluation.run_folder import read_run

    run = read_run(folder)
    with (folder / "states.csv").open(encoding="utf-8", newline="") as file:
        rows = [(float(row["time"]), row["state"], row["event"]) for row in csv.DictReader(file)]
    every = max(1, len(run.times) // MAX_POINTS)
    return {
        "points": run.record.points[::every].round(5).tolist(),
        "times": run.times[::every].round(3).tolist(),
        "ends": stroke_ends(rows),
    }


def draw_strokes(figure: Any, found: list[dict[str, Any]]) -> None:
    """A view after each stroke of the first run that has `stroke_touches`, the new one in another colour."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    from lwrprobe.scene import load_scene

    item = next(item for item in found if item.get("stroke_touches"))
    points, times = 1e3 * np.array(item["stroke_touches"]["points"]), np.array(item["stroke_touches"]["times"])
    ends = item["stroke_touches"]["ends"][:MAX_PANELS]
    mesh = load_scene(item["scene"]).solid().mesh()
    low, high = 1e3 * mesh.vertices.min(axis=0), 1e3 * mesh.vertices.max(axis=0)
    wide = min(4, len(ends))
    tall = -(-len(ends) // wide)
    figure.set_size_inches(3.0 * wide, 2.4 * tall)
    for number, (begin, end) in enumerate(zip([0.0, *ends], ends)):
        axes = figure.add_subplot(tall, wide, number + 1, projection="3d", computed_zorder=False)
        axes.add_collection3d(Poly3DCollection(1e3 * mesh.vertices[mesh.faces], facecolor="0.85", alpha=0.25))
        for which, colour in ((times <= begin, "tab:blue"), ((times > begin) & (times <= end), "tab:orange")):
            axes.scatter(*points[which].T, s=1, color=colour)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(0.0, high[2]))
        axes.set_box_aspect(high - np.append(low[:2], 0.0), zoom=1.1)
        axes.view_init(elev=35.0, azim=-60.0)
        axes.set_title(f"stroke {number + 1}, {end:.0f} s", fontsize=8)
        axes.tick_params(labelsize=5)
