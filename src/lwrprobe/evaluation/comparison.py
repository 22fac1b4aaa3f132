"""Two runs side by side on one page: errors, times, forces, and deviations on one scale."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.charts import Line, line_chart
from lwrprobe.evaluation.deviation_map import VIEWS, deviation_colours
from lwrprobe.evaluation.mesh_error import deviation
from lwrprobe.evaluation.ramps import DEVIATION
from lwrprobe.evaluation.render import Sight, View, png
from lwrprobe.evaluation.run_folder import RunFolder, read_run, run_mesh
from lwrprobe.host.whole_file import write_whole
from lwrprobe.reconstruction.choice import offsets
from lwrprobe.scene.mesh_distance import MeshDistance

LEAST, MOST = 0.0002, 0.005
"""m, between which the end of the scale of the deviations is chosen."""

FIGURES: tuple[tuple[str, tuple[str, ...], str, int], ...] = (
    ("contacts", ("contacts",), "", 0),
    ("robot time", ("sim_time_s",), "s", 1),
    ("lower bound of the time", ("lower_bound_time_s",), "s", 1),
    ("path of the sphere", ("path_length_m",), "m", 2),
    ("coverage", ("coverage",), "", 3),
    ("contact error, median", ("contact_error_mm", "median"), "mm", 3),
    ("contact error, 95 %", ("contact_error_mm", "p95"), "mm", 3),
    ("contact error aligned, median", ("contact_error_aligned_mm", "median"), "mm", 3),
    ("normal error, median", ("normal_error_deg", "median"), "deg", 2),
    ("mesh error, mean", ("mesh_error_mm", "mean"), "mm", 3),
    ("mesh error, largest", ("mesh_error_mm", "hausdorff"), "mm", 2),
    ("mesh error aligned, mean", ("mesh_error_aligned_mm", "mean"), "mm", 3),
    ("largest force, measured", ("peak_force_n",), "N", 2),
    ("largest force, true", ("true_peak_force_n",), "N", 2),
    ("rejected touches", ("rejected_share",), "", 3),
    ("link collisions", ("link_collisions",), "", 0),
    ("computing time a cycle", ("cycle_us",), "us", 1),
    ("wall time", ("wall_time_s",), "s", 1),
)
"""Row of the table, where it stands in summary.json, unit, decimals."""


@dataclass(slots=True)
class _Side:
    """One of the two runs, with its mesh and what this deviates from."""

    run: RunFolder
    name: str
    mesh: TriangleMesh | None
    signed: np.ndarray | None = None
    """(n,) m, of the mesh's vertices."""


def write_comparison(first: str | Path, second: str | Path, path: str | Path) -> Path:
    """Write the page of two run folders; the path.

    Deviations are from the true shape where the runs are simulated, else of each mesh from the other one. Raises
    FormatError for a folder that is no run's, StorageError where the page cannot be written.
    """
    path = Path(path)
    sides = [_side(Path(first)), _side(Path(second))]
    if sides[0].name == sides[1].name:
        sides[0].name, sides[1].name = str(first), str(second)
    against = _deviations(sides)
    style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    title = escape(" and ".join(side.name for side in sides))
    body = _head(sides) + _table(sides) + _maps(sides, against) + _charts(sides)
    content = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title} · lwrprobe</title><style>\n{style}</style></head>\n"
        f"<body><main>\n{body}\n</main></body></html>\n"
    )
    write_whole(path, content.encode())
    return path


def _side(folder: Path) -> _Side:
    return _Side(read_run(folder), folder.resolve().name, run_mesh(folder))


def _deviations(sides: list[_Side]) -> str:
    """Fill in the deviations; what they are from, empty where there are none."""
    if any(side.mesh is None for side in sides):
        return ""
    solids = [side.run.true_solid() for side in sides]
    if all(solid is not None for solid in solids):
        for side, solid in zip(sides, solids):
            assert side.mesh is not None
            assert solid is not None
            side.signed = deviation(side.mesh, solid)
        return "the true shape"
    for side, other in zip(sides, reversed(sides)):
        assert side.mesh is not None
        assert other.mesh is not None
        side.signed = _from_mesh(side.mesh, other.mesh)
    return "the other run's mesh"


def _from_mesh(mesh: TriangleMesh, other: TriangleMesh) -> np.ndarray:
    """(n,) m from the other mesh to the vertices of a mesh, positive outside."""
    distance = MeshDistance(other).distance(mesh.vertices)
    return np.copysign(distance, offsets(other, mesh.vertices))


def _head(sides: list[_Side]) -> str:
    names = " and ".join(escape(side.name) for side in sides)
    scenes = dict.fromkeys(side.run.scene.title or side.run.scene.name for side in sides)
    lead = f"Explorations of {escape(', '.join(scenes))}."
    if len(scenes) > 1:
        lead += ' <span class="warn">The scenes differ.</span>'
    return f'<h1>{names}</h1><p class="lead">{lead}</p>'


def _table(sides: list[_Side]) -> str:
    texts = [
        ("strategy", *(side.run.scene.strategy.name for side in sides), ""),
        ("contact estimator", *(side.run.scene.contact.estimator for side in sides), ""),
        ("seed", *(str(side.run.scene.run.seed) for side in sides), ""),
        ("ended", *(_ended(side.run) for side in sides), ""),
    ]
    rows = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in texts)
    for name, place, unit, decimals in FIGURES:
        values = [_value(side.run, place) for side in sides]
        if all(value is None for value in values):
            continue
        cells = [f"{value:.{decimals}f} {unit}" if value is not None else "" for value in values]
        change = ""
        if None not in values and values[0]:
            change = f"{100.0 * (values[1] / values[0] - 1.0):+.1f} %"
        rows += f"<tr><td>{name}</td>{''.join(f'<td>{cell}</td>' for cell in cells)}<td>{change}</td></tr>"
    warnings = [_warnings(side.run) for side in sides]
    if any(warnings):
        rows += f"<tr><td>warnings</td>{''.join(f'<td>{escape(text)}</td>' for text in warnings)}<td></td></tr>"
    head = "".join(f"<th>{escape(name)}</th>" for name in ("", *(side.name for side in sides), "change"))
    return f'<h2>Figures</h2><figure class="scroll"><table><tr>{head}</tr>{rows}</table></figure>'


def _value(run: RunFolder, place: tuple[str, ...]) -> Any:
    value: Any = None if run.summary is None else run.summary.as_dict()
    for name in place:
        value = value.get(name) if isinstance(value, dict) else None
    if place == ("contacts",) and value is None:
        return len(run.record.points)
    return value if isinstance(value, int | float) else None


def _ended(run: RunFolder) -> str:
    return "cut off" if run.summary is None else f"{run.summary.status}: {run.summary.reason}"


def _warnings(run: RunFolder) -> str:
    return "" if run.summary is None else "; ".join(run.summary.warnings)


def _maps(sides: list[_Side], against: str) -> str:
    if not against:
        return "<h2>Deviation</h2><p>One of the runs has no mesh, so there is nothing to compare.</p>"
    signed = np.concatenate([np.abs(side.signed) for side in sides if side.signed is not None])
    limit = float(np.clip(np.percentile(signed, 98.0), LEAST, MOST))
    vertices = np.vstack([side.mesh.vertices for side in sides if side.mesh is not None])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    figures = ""
    for side in sides:
        assert side.mesh is not None
        assert side.signed is not None
        paint = deviation_colours(side.signed, limit)
        sights = [Sight(side.mesh, View(*view, low, high)) for view in VIEWS]
        images = "".join(_image(sight.paint(paint), side.name) for sight in sights)
        mean = 1e3 * np.abs(side.signed).mean()
        text = f"mean of the vertices {mean:.3f} mm, median {1e3 * np.median(np.abs(side.signed)):.3f} mm"
        figures += f"<figure>{images}<figcaption><b>{escape(side.name)}</b>: {text}.</figcaption></figure>"
    ramp = f'<span class="ramp" style="background:{DEVIATION.css()}"></span>'
    scale = f"−{1e3 * limit:.2f} mm, too deep{ramp}+{1e3 * limit:.2f} mm, too far out"
    return f'<h2>Deviation from {against}</h2><p>One scale for both: {scale}.</p><div class="grid">{figures}</div>'


def _image(picture: np.ndarray, name: str) -> str:
    content = base64.b64encode(png(picture)).decode()
    name = escape(name, quote=True)
    return f'<img alt="deviation of {name}" width="560" height="420" src="data:image/png;base64,{content}">'


def _charts(sides: list[_Side]) -> str:
    force, covered, counts = [], [], []
    for side, colour in zip(sides, "ab"):
        trace = side.run.trace
        if len(trace) > 1:
            span = max(1, len(trace) // 350)
            starts = np.arange(0, len(trace), span)
            force.append(Line(trace[starts, 0], np.maximum.reduceat(trace[:, 4], starts), side.name, colour))
        growth = side.run.summary.coverage_over_time if side.run.summary is not None else None
        if growth:
            times, shares = np.array(growth).T
            covered.append(Line(times, 100.0 * shares, side.name, colour))
        if len(side.run.times):
            counts.append(Line(side.run.times, 1e-3 * np.arange(1.0, len(side.run.times) + 1.0), side.name, colour))
    limit = sides[0].run.scene.contact.limit
    charts = []
    if covered:
        charts.append(("Coverage", line_chart(covered, "robot time, s", "coverage, %", top=105.0)))
    if counts:
        thin = [Line(c.x[:: len(c.x) // 300 + 1], c.y[:: len(c.y) // 300 + 1], c.name, c.colour) for c in counts]
        charts.append(("Contacts", line_chart(thin, "robot time, s", "contacts, thousands")))
    if force:
        levels = [(limit, f"limit {limit:g} N")]
        charts.append(("Force on the sphere", line_chart(force, "robot time, s", "force, N", levels)))
    figures = "".join(f"<figure>{chart}<figcaption><b>{name}</b></figcaption></figure>" for name, chart in charts)
    return f'<h2>While they ran</h2><div class="grid">{figures}</div>' if figures else ""
