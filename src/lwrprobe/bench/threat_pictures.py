"""The picture of how the strategies differ: an object taller than the probe's stick, touched by each of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

SCENE = "stacked_blocks"
MAX_POINTS = 2500
LEVEL = 0.2
"""Share of height in a piece of the path that counts as level."""
STILL = 5e-5
"""m between two touches, below which the probe turns around or rests."""
SOON = 0.1
"""s between two touches of one contour."""


def touches_of(folder: Path) -> dict[str, Any]:
    """`points` (n, 3) m and `level` (n,): whether a wall was followed level around, in the plane X_Y, there."""
    from lwrprobe.evaluation.run_folder import read_run

    run = read_run(folder)
    record, normals = run.record, run.record.normals
    assert normals is not None, "contacts.csv has them"
    displacement, pause = np.diff(record.points, axis=0), np.diff(run.times)
    across = np.linalg.norm(displacement[:, :2], axis=1)
    level = (across > STILL) & (np.abs(displacement[:, 2]) < LEVEL * across) & (pause < SOON)
    level &= np.abs(normals[1:, 2]) < 0.5
    every = max(1, len(level) // MAX_POINTS)
    return {"points": record.points[1::every].round(5).tolist(), "level": level[::every].tolist()}


def draw_touches(figure: Any, found: list[dict[str, Any]]) -> None:
    """One view a run that has `touches`, before the true object."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    from lwrprobe.scene import load_scene

    mesh = load_scene(SCENE).solid().mesh()
    runs = [item for item in found if item.get("touches")]
    figure.set_size_inches(3.6 * len(runs), 4.2)
    for i, item in enumerate(runs):
        axes = figure.add_subplot(1, len(runs), i + 1, projection="3d", computed_zorder=False)
        axes.add_collection3d(Poly3DCollection(1e3 * mesh.vertices[mesh.faces], facecolor="0.85", alpha=0.25))
        points, level = 1e3 * np.array(item["touches"]["points"]), np.array(item["touches"]["level"], bool)
        for which, colour, label in ((~level, "tab:blue", "up, over and down"), (level, "tab:orange", "level around")):
            if which.any():
                axes.scatter(*points[which].T, s=1, color=colour, label=label)
        low, high = 1e3 * mesh.vertices.min(axis=0), 1e3 * mesh.vertices.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(0.0, high[2]))
        axes.set_box_aspect(high - np.append(low[:2], 0.0), zoom=0.9)
        axes.view_init(elev=18.0, azim=-60.0)
        axes.set_title(f"{item['strategy']}\nlowest touch at {points[:, 2].min():.0f} mm", fontsize=9)
        axes.locator_params(axis="y", nbins=3)
        axes.tick_params(labelsize=7)
    marks = {dots.get_label(): dots for axes in figure.axes for dots in axes.collections[1:]}
    figure.legend(marks.values(), marks.keys(), loc="lower center", ncols=2, markerscale=5, fontsize=8)
