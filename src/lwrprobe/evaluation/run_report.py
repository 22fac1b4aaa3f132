"""`report.html` of a run: one file that shows what was explored, how well it is known, and how to do it again."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contracts import LwrprobeError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.evaluation.charts import Line, bars, histogram, line_chart
from lwrprobe.evaluation.coverage import coverage_over_time, gap_over_time
from lwrprobe.evaluation.deviation_map import VIEWS, deviation_colours
from lwrprobe.evaluation.facings import facing_errors
from lwrprobe.evaluation.mesh_error import deviation, mean_error, mesh_error, sample_mesh
from lwrprobe.evaluation.ramps import DEVIATION, ERROR, HEIGHT, Ramp
from lwrprobe.evaluation.reach import reach
from lwrprobe.evaluation.render import Sight, View, png, render_points
from lwrprobe.evaluation.run_folder import HIDING_FILE, RunFolder, read_run
from lwrprobe.evaluation.summary import area_by_reason
from lwrprobe.host.whole_file import write_whole
from lwrprobe.mapping.clouds import read_cloud
from lwrprobe.reconstruction.fits import fit
from lwrprobe.reconstruction.reconstruct import reconstruct
from lwrprobe.scene.solid import Solid

_PLAIN = np.array([0.80, 0.74, 0.62])
_BEYOND = np.array([0.62, 0.36, 0.70])
_STAGES_OF_TIME = (1 / 3, 2 / 3)  # of the run, at which the mesh is made as well
_MAX_VERTICES = 60_000  # of a mesh that the page can turn about
_SAMPLES = 4000


def write_report(folder: str | Path, surface: Reconstruction | None = None) -> Path:
    """Write `report.html` into a run folder and return its path.

    `surface` is the run's mesh if it is available; otherwise it is reconstructed with the scene's method. Raises
    FormatError for a folder that is no run's, StorageError where the page cannot be written.
    """
    run = read_run(folder)
    error = run.summary.mesh_error_mm if surface is not None and run.summary is not None else None
    page = _Page(run, surface or _surface(run, run.record), error)
    path = run.folder / "report.html"
    write_whole(path, page.html().encode())
    return path


def _surface(run: RunFolder, record: TouchRecord) -> Reconstruction | None:
    method = run.scene.reconstruction
    try:
        return reconstruct(record, method.method, **method.options) if len(record.points) else None
    except LwrprobeError:
        return None


@dataclass(slots=True, frozen=True)
class _Compared:
    """The mesh beside the true shape: signed distance (n,) m of its vertices, and `MeshError.as_dict`."""

    mesh: TriangleMesh
    solid: Solid
    signed: np.ndarray
    error: dict[str, Any]


def _compared(mesh: TriangleMesh, solid: Solid, lowest: float, error: dict[str, Any] | None) -> _Compared | None:
    """`error` where it is known already; None for a scrap of a mesh, too low or too small to be compared."""
    try:
        known = error or mesh_error(mesh, solid, lowest, samples=_SAMPLES).as_dict()
    except LwrprobeError:
        return None
    return _Compared(mesh, solid, deviation(mesh, solid), known)


class _Page:
    """The sections of one report, each a piece of HTML, empty where the run has nothing for it."""

    def __init__(self, run: RunFolder, surface: Reconstruction | None, error: dict[str, Any] | None) -> None:
        """`error` is the mesh's, as `MeshError.as_dict` gives it, where it is known already."""
        self.run = run
        self.summary = run.summary
        self.surface = surface if surface is not None and len(surface.mesh.faces) else None
        self.mesh = self.surface.mesh if self.surface is not None else None
        self.lowest = run.scene.area.lower[2]
        self.solid: Solid | None = run.true_solid()
        self.compared: _Compared | None = None
        if self.mesh is not None and self.solid is not None:
            self.compared = _compared(self.mesh, self.solid, self.lowest, error)

    def html(self) -> str:
        title = escape(self.run.scene.title or self.run.scene.name)
        style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
        script = Path(__file__).with_name("report.js").read_text(encoding="utf-8")
        body = "\n".join(
            section() for section in (
                self._head, self._viewer, self._pictures, self._errors, self._budget, self._over_time, self._hiding,
                self._shapes, self._stages, self._again,
            )
        )  # fmt: skip
        return (
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{title} · lwrprobe</title><style>\n{style}</style></head>\n<body><main>\n{body}\n</main>\n"
            f"<script>\n{script}</script></body></html>\n"
        )

    def _head(self) -> str:
        scene, s = self.run.scene, self.summary
        tiles = [("contacts", f"{len(self.run.record.points)}", "")]
        if s is not None:
            tiles.append(("robot time", f"{s.sim_time_s:.0f}", "s"))
        if s is not None and s.search_time_s is not None:
            tiles.append(("of it to find and bound", f"{s.search_time_s:.0f}", "s"))
        if s is not None and s.coverage is not None:
            tiles.append(("touched of what can be", f"{100 * s.coverage:.1f}", "%"))
        if self.compared is not None:
            error = self.compared.error
            tiles.append(("mesh error, mean", f"{error['mean']:.2f}", "mm"))
            tiles.append(("mesh error, largest", f"{error['hausdorff']:.1f}", "mm"))
            if error["volume_error"] is not None:
                tiles.append(("volume error", f"{100 * error['volume_error']:+.1f}", "%"))
        if s is not None and s.peak_force_n is not None:
            tiles.append(("peak force", f"{s.peak_force_n:.2f}", "N"))
        cells = "".join(
            f"<div><dt>{name}</dt><dd>{value} <small>{unit}</small></dd></div>" for name, value, unit in tiles
        )
        title = escape(scene.title or scene.name)
        lead = (
            f"Explored by touch with {escape(scene.strategy.name)}, a sphere of {1e3 * scene.probe.radius:g} mm radius"
        )
        ended = (
            f"{s.status}: {s.reason}"
            if s is not None
            else "the run did not get to its end; this is what it left behind"
        )
        mark = "" if s is not None and s.status == "done" else ' class="warn"'
        unknown = "".join(f'<p class="warn">{escape(sentence)}.</p>' for sentence in self._unknown())
        return (
            f'<h1>{title}</h1><p class="lead">{lead}.</p><p{mark}>{escape(ended)}.</p>{unknown}'
            f'<dl class="tiles">{cells}</dl>'
        )

    def _unknown(self) -> list[str]:
        """Where the mesh says something that no touch has said, and the run's warnings."""
        if self.summary is None:
            return []
        found = []
        zones, sides = self.summary.bridged, self.summary.open_borders
        if zones:
            widest = zones[0]
            places = "1 place" if len(zones) == 1 else f"{len(zones)} places"
            found.append(
                f"Bridged in {places}, narrower than the probe, where no surface is claimed; "
                f"the widest is a{'n' if widest['kind'] == 'inner edge' else ''} {widest['kind']} of "
                f"{widest['width_mm']:.1f} mm"
            )
        table = self.summary.table_found
        if table:
            tilt = f"it leans by {table['tilt_deg']:.2f} degrees"
            found.append(f"{table['contacts']} contacts are the table's and left out; {tilt}")
        if sides:
            names = ", ".join(side["side"] for side in sides)
            found.append(f"Open border {names}: the object goes on beyond the area, and the mesh is closed there")
        left = self.summary.untouched
        if left:
            area, places = sum(one["area_mm2"] for one in left), "1 place" if len(left) == 1 else f"{len(left)} places"
            why = ", ".join(f"{part:.0f} mm² ({reason})" for reason, part in area_by_reason(left))
            found.append(f"Untouched: {area:.0f} mm² of the mesh in {places}: {why}")
        return found + [sentence[:1].upper() + sentence[1:] for sentence in self.summary.warnings]

    def _viewer(self) -> str:
        if self.surface is None or len(self.surface.mesh.vertices) > _MAX_VERTICES:
            return ""
        mesh = self.surface.mesh
        lower, upper = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        places = 2.0 * (mesh.vertices - 0.5 * (lower + upper)) / np.linalg.norm(upper - lower)
        paints = self._paints(self.surface)
        shape = {
            "places": _base64(places.astype("<f4").tobytes()),
            "faces": _base64(mesh.faces.astype("<u4").tobytes()),
            "paints": {name: _base64(np.round(255 * c).astype(np.uint8).tobytes()) for name, (c, _) in paints.items()},
        }
        buttons = "".join(
            f'<button data-paint="{name}" aria-pressed="false">{name}</button>' for name in reversed(list(paints))
        )
        method = escape(self.surface.report["method"])
        return (
            f'<h2>The shape found</h2><figure><div class="modes">{buttons}</div>'
            '<div id="viewer"><canvas tabindex="0" aria-label="The mesh; drag to turn"></canvas></div>'
            f"<figcaption>{method}: {len(mesh.faces)} triangles. Drag to turn, wheel to come closer.</figcaption>"
            f'<script type="application/json" id="shape">{json.dumps(shape)}</script></figure>'
        )

    def _paints(self, surface: Reconstruction) -> dict[str, tuple[np.ndarray, str]]:
        """Colours (n, 3) of the mesh's vertices and what they say, by name."""
        vertex_error, n = surface.mesh.vertex_error, len(surface.mesh.vertices)
        paints = {"shape": (np.tile(_PLAIN, (n, 1)), "What was made of the contacts.")}
        beyond = surface.unreachable
        if beyond is not None:
            text = (
                f"Violet: {beyond.mean():.0%} of the vertices close the mesh where no sphere of this size can touch "
                "(inner edges, slots, under its lowest height); no surface is claimed there."
            )
            paints["beyond reach"] = (np.where(beyond[:, None], _BEYOND, _PLAIN), text)
        for name, error in (("expected error", vertex_error), ("aligned", surface.mesh.vertex_error_aligned)):
            if error is not None:
                ramp = _legend(ERROR, "0", "1.5 mm or more")
                after = " after alignment" if name == "aligned" else ""
                paints[name] = (ERROR.colours(error / 0.0015), f"Error to expect{after}: {ramp}")
        if self.compared is not None:
            ramp = _legend(DEVIATION, "−2 mm, too deep", "+2 mm, too far out")
            paints["deviation"] = (deviation_colours(self.compared.signed, 0.002), f"Against the truth: {ramp}")
        return paints

    def _pictures(self) -> str:
        points = self.run.record.points
        if not len(points):
            return "<h2>Nothing was touched</h2><p>There is no shape to show.</p>"
        both = points if self.mesh is None else np.vstack([points, self.mesh.vertices])
        views = [View(a, e, both.min(axis=0), both.max(axis=0)) for a, e in VIEWS]
        shown = points[:: len(points) // 20_000 + 1]
        height = shown[:, 2] / max(float(points[:, 2].max()), 1e-9)
        paint = HEIGHT.colours(0.15 + 0.85 * np.clip(height, 0.0, 1.0))
        images = [render_points(shown, paint, view, 6e-4) for view in views]
        figures = [_figure("touched", images, f"{len(points)} contacts, brighter the higher.")]
        if self.surface is not None:
            sights = [Sight(self.surface.mesh, view) for view in views]
            for name, (paint, text) in self._paints(self.surface).items():
                figures.append(_figure(name, [sight.paint(paint) for sight in sights], text))
        return f'<h2>From two sides</h2><div class="grid">{"".join(figures)}</div>'

    def _errors(self) -> str:
        if self.compared is None:
            return ""
        mesh, solid = self.compared.mesh, self.compared.solid
        points, _ = sample_mesh(mesh, self.lowest, _SAMPLES)
        rows = "".join(
            f"<tr><td>{e.facing}</td><td>{e.share:.0%}</td><td>{1e3 * e.bias:+.3f}</td><td>{1e3 * e.rms:.3f}</td>"
            f"<td>{1e3 * e.largest:+.2f}</td></tr>"
            for e in facing_errors(mesh, solid, self.lowest, _SAMPLES)
        )
        chart = histogram(1e3 * solid.signed_distance(points), "deviation, mm", 2.0)
        return (
            '<h2>Against the truth</h2><div class="grid">'
            f"<figure>{chart}<figcaption><b>Deviations of the mesh</b>, positive "
            "outside the true shape.</figcaption></figure>"
            '<figure class="scroll"><table><tr><th>facing</th><th>of the area</th><th>bias mm</th><th>RMS mm</th>'
            f"<th>largest mm</th></tr>{rows}</table></figure></div>"
        )

    def _budget(self) -> str:
        budget = self.summary.error_budget if self.summary is not None else None
        if not budget:
            return ""
        charts = []
        for key, text in (("causes_mm", "by cause"), ("causes_aligned_mm", "by cause, after alignment")):
            causes = sorted(budget.get(key, {}).items(), key=lambda cause: -cause[1])
            share = [(name, value, f"{value:.3f} mm") for name, value in causes if value > 0.0]
            if share:
                charts.append(
                    f"<figure>{bars(share)}<figcaption>One standard deviation along the normal, {text}."
                    "</figcaption></figure>"
                )
        sums = (
            ("differs from contact to contact", budget["random_mm"]),
            ("after the contacts are aligned with their true places", budget["shape_mm"]),
            ("everything", budget["whole_mm"]),
        )
        rows = "".join(f"<tr><td>{escape(name)}</td><td>{value:.3f}</td></tr>" for name, value in sums)
        s = self.summary
        if s is not None:
            expected = s.expected_mesh_error_mm or {}
            for key, name in (
                ("mean", "expected error of the mesh where a sphere can touch, mean"),
                ("aligned_mean", "the same after alignment"),
                ("whole_mean", "expected error of all of the mesh, mean"),
                ("aligned_whole_mean", "the same after alignment"),
            ):
                if key in expected:
                    rows += f"<tr><td>{name}</td><td>{expected[key]:.3f}</td></tr>"
            for within, name in ((s.claims_within_95, ""), (s.claims_aligned_within_95, " after alignment")):
                if within is not None:
                    rows += f"<tr><td>true errors{name} inside the stated 95 % region</td><td>{within:.0%}</td></tr>"
        return (
            f'<h2>Error budget of the contacts</h2><div class="grid">{"".join(charts)}'
            f'<figure class="scroll"><table><tr><th>root sum square</th><th>mm</th></tr>{rows}</table></figure></div>'
        )

    def _over_time(self) -> str:
        run, charts = self.run, []
        if self.solid is not None and len(run.record.points) > 1:
            charts += self._learning(self.solid)
        if len(run.trace) > 1:
            limits = run.scene.contact
            time, force = _peaks(run.trace[:, 0], run.trace[:, 4])
            levels = [(limits.limit, f"limit {limits.limit:g} N"), (limits.target, f"aim {limits.target:g} N")]
            chart = line_chart([Line(time, force, "force", "b")], "robot time, s", "force, N", levels)
            charts.append(f"<figure>{chart}<figcaption><b>Force</b> on the sphere.</figcaption></figure>")
        return f'<h2>While it ran</h2><div class="grid">{"".join(charts)}</div>' if charts else ""

    def _learning(self, solid: Solid) -> list[str]:
        """Coverage and errors against the robot's time."""
        record, instants, scene = self.run.record, self.run.times, self.run.scene
        found = reach(solid, scene.probe.radius, self.lowest, self.run.area, _SAMPLES // 2)
        if not len(found.points) or record.normals is None:
            return []
        times = np.linspace(0.0, float(instants.max()), 41)[1:]
        covered = 100.0 * coverage_over_time(
            record.points, record.normals, instants, times, found, record.pitch or 0.010
        )
        away = 1e3 * gap_over_time(record.points, instants, times, found)
        at, error = self._meshes_during_run(solid)
        charts = [
            line_chart([Line(times, covered, "touched", "c")], "robot time, s", "touched, %", top=105.0),
            line_chart(
                [
                    Line(times, away, "from the true surface to the nearest contact", "a"),
                    Line(at, error, "mesh made of the contacts so far", "b", dots=True),
                ],
                "robot time, s", "mean distance, mm",
                decades=True,
            ),
        ]  # fmt: skip
        texts = ["<b>Coverage</b> of what the sphere can touch.", "<b>Error</b> against run time."]
        return [f"<figure>{chart}<figcaption>{text}</figcaption></figure>" for chart, text in zip(charts, texts)]

    def _meshes_during_run(self, solid: Solid) -> tuple[np.ndarray, np.ndarray]:
        instants = self.run.times
        at: list[float] = []
        error: list[float] = []
        last = float(instants.max())
        for share in _STAGES_OF_TIME:
            made = _surface(self.run, self.run.until(share * last))
            if made is not None:
                at.append(share * last)
                error.append(self._mean_error(made.mesh, solid))
        if self.compared is not None:
            at.append(last)
            error.append(self.compared.error["mean"])
        return np.array(at), np.array(error)

    def _mean_error(self, mesh: TriangleMesh, solid: Solid) -> float:
        try:
            return 1e3 * mean_error(mesh, solid, self.lowest, _SAMPLES // 4)
        except LwrprobeError:
            return np.nan

    def _hiding(self) -> str:
        """What the certificate leaves open: where, and how it shrank."""
        s = self.summary
        if s is None or s.certified_mm is None or s.certificate is None:
            return ""
        figures, rows = [], s.error_against_time or []
        if (self.run.folder / HIDING_FILE).is_file():
            cloud = read_cloud(self.run.folder / HIDING_FILE)
            figures.append(self._hiding_places(cloud.points, cloud.scalars["size"], 1e-3 * s.certified_mm))
        if len(rows) > 1:
            at, d = np.array([[row["time_s"], row["certified_mm"]] for row in rows]).T
            chart = line_chart([Line(at, d, "largest ball that can hide", "c")], "robot time, s", "diameter, mm")
            figures.append(f"<figure>{chart}<figcaption><b>Certificate</b> against run time.</figcaption></figure>")
        text = (
            f"No ball larger than {s.certified_mm:.1f} mm can hide where the probe could get to. "
            f"{s.certificate['unknown_cm3']:.0f} cm³ within reach were not swept, "
            f"{s.certificate['out_of_reach_cm3']:.0f} cm³ are out of reach, the inside of the object among them."
        )
        return f'<h2>What could still hide</h2><p>{text}</p><div class="grid">{"".join(figures)}</div>'

    def _hiding_places(self, places: np.ndarray, sizes: np.ndarray, largest: float) -> str:
        touched = self.run.record.points
        area = self.run.area
        paint = np.vstack([np.tile(_PLAIN, (len(touched), 1)), ERROR.colours(sizes / largest)])
        views = [View(a, e, area.lower, area.upper) for a, e in VIEWS]
        images = [render_points(np.vstack([touched, places]), paint, view, 6e-4) for view in views]
        ramp = _legend(ERROR, "0", f"{1e3 * largest:.1f} mm")
        return _figure("where", images, f"Middles of hidden balls of at least 60 % of that size: {ramp}")

    def _shapes(self) -> str:
        """What the run has fitted with its error budget; without one the shapes are fitted here."""
        rows = self._fitted()
        if rows is None:
            try:
                fits = fit(self.run.record)
            except LwrprobeError as error:
                none = f"<h2>Simple shapes</h2><p>None fitted: {escape(str(error))}.</p>"
                return none if len(self.run.record.points) else ""
            rows = [(str(f), f.warranted, f.share, 1e3 * f.rms) for f in fits]
        table = "".join(
            f"<tr><td>{'<b>' if warranted else ''}{escape(text)}{'</b>' if warranted else ''}</td>"
            f"<td>{share:.0%}</td><td>{rms:.3f}</td></tr>"
            for text, warranted, share, rms in rows
        )
        return (
            '<h2>Simple shapes held against the contacts</h2><figure class="scroll"><table><tr><th>shape</th>'
            f"<th>contacts explained</th><th>RMS mm</th></tr>{table}</table></figure>"
        )

    def _fitted(self) -> list[tuple[str, bool, float, float]] | None:
        """Text, whether warranted, share and RMS [mm] of the shapes in the summary; None where it has none."""
        if self.summary is None or not self.summary.fits:
            return None
        rows = []
        for one in self.summary.fits:
            text = f"no {one['shape']}: {one['why_not']}"
            if one["warranted"]:
                sizes = (
                    f"{name} {size:.2f} ± {one['sigma_mm'][name]:.2f} mm (± {one['sigma_aligned_mm'][name]:.2f} after "
                    "alignment)"
                    for name, size in one["size_mm"].items()
                )
                text = f"{one['shape']} {' x '.join(sizes)}".strip()
            rows.append((text, one["warranted"], one["share"], one["rms_mm"]))
        return rows

    def _stages(self) -> str:
        s = self.summary
        if s is None:
            return ""
        rows = [
            (stage["name"], 100.0 * stage["share"], f"{100 * stage['share']:.0f} %, {stage['us_median']:.1f} µs each")
            for stage in sorted(s.stages, key=lambda stage: -stage["share"])
        ]
        omitted = "".join(
            f"<tr><td>{escape(item['stage'])}</td><td>{escape(item['why'])}</td></tr>" for item in s.left_out
        )
        return (
            f'<h2>Where the time went</h2><div class="grid"><figure>{bars(rows)}<figcaption>'
            "Share of the computing time, and the median of one call.</figcaption></figure>"
            f'<figure class="scroll"><table><tr><th>left out</th><th>because</th></tr>{omitted}</table></figure></div>'
        )

    def _again(self) -> str:
        s = self.summary
        made_with = s.versions | s.machine if s is not None else {}
        facts = {**made_with, "seed": self.run.scene.run.seed}
        rows = "".join(f"<tr><td>{escape(str(k))}</td><td>{escape(str(v))}</td></tr>" for k, v in facts.items())
        scene = escape((self.run.folder / "scene.toml").read_text(encoding="utf-8"))
        return (
            "<h2>Do it again</h2><p>From this folder, bit for bit on one machine:</p>"
            "<pre>lwrprobe explore scene.toml --out again</pre>"
            f'<figure class="scroll"><table>{rows}</table></figure>'
            f"<details><summary>The scene as it was run</summary><pre>{scene}</pre></details>"
        )


def _peaks(time: np.ndarray, value: np.ndarray, max_count: int = 700) -> tuple[np.ndarray, np.ndarray]:
    """The largest value of each of `max_count` spans of time, so that no peak is lost."""
    span = max(1, -(-len(time) // max_count))
    starts = np.arange(0, len(time), span)
    return time[starts], np.maximum.reduceat(value, starts)


def _figure(name: str, images: list[np.ndarray], text: str) -> str:
    pictures = "".join(
        f'<img alt="{name}" width="560" height="420" src="data:image/png;base64,{_base64(png(image))}">'
        for image in images
    )
    return f"<figure>{pictures}<figcaption><b>{name.capitalize()}.</b> {text}</figcaption></figure>"


def _legend(ramp: Ramp, low: str, high: str) -> str:
    return f'{low}<span class="ramp" style="background:{ramp.css()}"></span>{high}'


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
