"""Objects that nobody tuned for: strategies over random objects, judged by distances that are made with trimesh.

Options (`--set`): `count`, random objects, whose kinds take turns; `base_seed`, seed of the first, which the others
follow; `kinds`, `strategies` and `profiles` of the table `[truth]` as comma-separated lists; `step`, m between two
lines; `objects`, scenes in place of random objects, and `seeds`, runs of each; `noise`, times the sensor's; `jobs` side
by side;
`journal`, a file in which each run's record is kept, so that a bench that was cut off goes on with the runs that are
missing; `keep`, a folder in which the run folders stay.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from itertools import product
from os import cpu_count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from lwrprobe.bench.criterion import Criterion
from lwrprobe.bench.exploration import STRATEGIES
from lwrprobe.bench.options import Options
from lwrprobe.bench.reality import TRUTH_PROFILES
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import LwrprobeError, TouchRecord, TriangleMesh
from lwrprobe.contracts.plugins import load
from lwrprobe.sweeps.execute import run_kept

if TYPE_CHECKING:
    from lwrprobe.bench.true_mesh import TrueMesh
    from lwrprobe.scene import Scene

METHODS = ("convex_hull", "hermite_rbf", "poisson")
"""What the run's own mesh is held against, made from the same contacts."""

UPRIGHT = ("grid_version", "surface_contour")
"""Strategies that hold the probe as the scene says all the time."""

IDEAL = "ideal"
"""Profile in which the scene knows the world; in the others errors are judged after alignment."""

SIM = "sim"
"""The driver whose noise is multiplied."""

WORST = 20
"""Runs that the page shows."""

_SURFACE = 4000  # points of the true surface
_CONTACTS = 5000  # contacts that are measured, of many
_FALSE = 1.5e-3  # m from every link to the object, at which a collision threat is a false alarm
SAME_SIDE = 0.5  # cosine between a contact's normal and the surface's, for the contact to count there

_FACES = 0.5  # of a normal's z: a top or an underside

_PICTURE = 260, 195  # pixels
_LIMIT_FORCE = 3.0  # N
_LIMIT = 0.002  # m of deviation at which a picture's colours saturate


@dataclass(slots=True, frozen=True)
class Job:
    """One run."""

    name: str
    seed: int
    strategy: str
    profile: str
    step: float
    noise: float
    keep: str

    @property
    def key(self) -> str:
        """Of its record."""
        name = self.name.removeprefix("random:").removesuffix(f":{self.seed}").replace(":", "-")
        return f"{name}_{self.seed}.{self.strategy}.{self.profile}" + (f".{self.noise:g}" if self.noise != 1.0 else "")


CRITERIA = (
    Criterion("done", "status", lambda v: v == "done", 0.98),
    Criterion("no link collision", "collisions", lambda v: v == 0, 1.0),
    Criterion("largest force <= 3 N", "peak", lambda v: v <= _LIMIT_FORCE, 0.99),
    Criterion("largest force <= 4.5 N", "peak", lambda v: v <= 4.5, 1.0),
    Criterion("coverage of what an upright probe reaches >= 0.95", "coverage", lambda v: v >= 0.95, 0.95),
    Criterion("mesh no worse than the best other method by 10 %", "over_best", lambda v: v <= 1.1, 0.95),
    Criterion("mesh closed, each edge with two faces", "manifold", bool, 1.0),
)
MEDIANS = (
    Criterion("coverage, median >= 0.99", "coverage", lambda v: v >= 0.99, 0.5),
    Criterion("contact error, median <= 0.05 mm", "contact", lambda v: v <= 0.05, 0.5),
    Criterion("mesh error of what is reachable, median <= 0.15 mm", "mesh_reachable", lambda v: v <= 0.15, 0.5),
    Criterion("robot time, median <= 2.5 times the bound", "ratio", lambda v: v <= 2.5, 0.5),
    Criterion("robot time, median <= 2.5 times the bound in unknown space", "ratio_unknown", lambda v: v <= 2.5, 0.5),
)

COLUMNS = {
    "profile": "profile",
    "object": "object",
    "strategy": "strategy",
    "status": "status",
    "mesh mm": "mesh",
    "expected mm": "expected",
    "times the best": "over_best",
    "coverage": "coverage",
    "peak N": "peak",
    "times bound": "ratio",
    "times bound, unknown": "ratio_unknown",
    "what went wrong": "wrong",
    "fails": "fails",
    "contact mm": "contact",
    "reachable mesh mm": "mesh_reachable",
    "largest mm": "mesh_max",
    "convex hull mm": "convex_hull",
    "hermite_rbf mm": "hermite_rbf",
    "poisson mm": "poisson",
    "method": "method",
    "closed, manifold": "manifold",
    "collisions": "collisions",
    "threats": "threats",
    "false": "false_threats",
    "robot s": "time",
    "bound s": "bound",
    "reason": "reason",
}


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench shapes`."""
    jobs, processes, journal = _jobs(quick, options)
    judged = run_kept({job.key: job for job in jobs}, _judged, processes, journal)
    return _report([_record(job, judged[job.key]) for job in jobs])


def _jobs(quick: bool, options: dict[str, str]) -> tuple[list[Job], int, Path | None]:
    from lwrprobe.scene.shape import KINDS

    asked = Options(
        "shapes", options, "count", "base_seed", "kinds", "strategies", "profiles", "step", "objects", "seeds", "noise",
        "jobs", "journal", "keep",
    )  # fmt: skip
    kinds = asked.names("kinds", "kind", KINDS, KINDS)
    strategies = asked.names("strategies", "strategy", STRATEGIES[:1] if quick else STRATEGIES[:3], STRATEGIES)
    profiles = asked.names("profiles", "profile", (IDEAL,) if quick else (IDEAL, "lab"), TRUTH_PROFILES)
    first = asked.count("base_seed", 1)
    count, seeds = asked.count("count", 2 if quick else 18), range(first, first + asked.count("seeds", 1))
    objects = [(f"random:{kinds[n % len(kinds)]}:{first + n}", first + n) for n in range(count)]
    if "objects" in asked:
        objects = list(product(asked.words("objects", ()), seeds))
    step, noise, keep = asked.numbers("step", (0.01,))[0], asked.numbers("noise", (1.0,))[0], asked.text("keep", "")
    jobs = [
        Job(name, seed, strategy, profile, step, noise, keep)
        for profile, (name, seed), strategy in product(profiles, objects, strategies)
    ]
    journal = Path(options["journal"]) if "journal" in asked else None
    return jobs, min(asked.count("jobs", cpu_count() or 1), len(jobs)), journal


def _judged(job: Job) -> dict[str, Any]:
    """What became of one run; a scene that cannot be run is a record that says so."""
    with TemporaryDirectory() as folder:
        place = Path(job.keep) / job.key if job.keep else Path(folder) / "run"
        try:
            return _explored(job, place)
        except LwrprobeError as error:
            return {"status": "refused", "reason": str(error)}


def _record(job: Job, judged: dict[str, Any]) -> dict[str, Any]:
    """One row: the run, what became of it, and the criteria that it fails."""
    found = {"object": job.name, "strategy": job.strategy, "seed": job.seed, "profile": job.profile} | judged
    fails = [c.requirement for c in CRITERIA if not c.holds(found)]
    return found | {"fails": ", ".join(fails), "wrong": _wrong(found)}


def _wrong(found: dict[str, Any]) -> str:
    """What went wrong in a run, in words; the place of the largest error where nothing else did."""
    said = []
    if found["status"] != "done":
        said.append(f"{found['status']}: {found['reason']}")
    if (found.get("peak") or 0.0) > _LIMIT_FORCE:
        said.append(f"pressed with {found['peak']:.1f} N")
    if found.get("collisions"):
        said.append(f"{found['collisions']} collisions of links")
    if found.get("where"):
        said.append(found["where"])
    return "; ".join(said)


def _explored(job: Job, folder: Path) -> dict[str, Any]:
    from lwrprobe.exploration.procedures.explore import explore
    from lwrprobe.scene import load_scene

    settings = [f'strategy.name="{job.strategy}"', f"run.seed={job.seed}", f'truth.profile="{job.profile}"']
    if job.noise != 1.0:
        usual = load("driver", SIM).Config()
        settings += [
            f"drivers.{SIM}.{name}={job.noise * getattr(usual, name)}" for name in ("noise_force", "noise_torque")
        ]
    if job.strategy in STRATEGIES[:3]:  # those that drive lines
        settings.append(f"strategy.step={job.step}")
    scene = load_scene(job.name, settings)
    summary = explore(scene, folder)
    return judge(scene, summary, folder, job.strategy in UPRIGHT, job.profile != IDEAL)


def judge(scene: Scene, summary: dict[str, Any], folder: Path, upright: bool, aligned: bool) -> dict[str, Any]:
    """Figures of a run, beside what its summary says; its collision threats only where the probe was held `upright`.

    `aligned`: errors are those that remain when the object is moved to where the contacts have it.
    """
    from lwrprobe.bench.true_mesh import TrueMesh, edges_of_two, mesh_errors
    from lwrprobe.evaluation.run_folder import read_run
    from lwrprobe.reconstruction.meshes import read_mesh
    from lwrprobe.scene.actual_scene import actual_scene

    bound, unknown = summary["lower_bound_time_s"], summary["lower_bound_unknown_s"]
    found: dict[str, Any] = {
        "status": summary["status"],
        "reason": summary["reason"],
        "collisions": summary["link_collisions"],
        "peak": summary["true_peak_force_n"],
        "time": summary["sim_time_s"],
        "bound": bound,
        "ratio": summary["sim_time_s"] / bound if bound else None,
        "ratio_unknown": summary["sim_time_s"] / unknown if unknown else None,
        "method": (summary["mesh_error_mm"] or {}).get("method"),
        "expected": (summary["expected_mesh_error_mm"] or {}).get("aligned_whole_mean" if aligned else "whole_mean"),
    }
    left = read_run(folder)
    record, actual = left.record, actual_scene(scene)
    if not len(record.points):
        return found
    solid = actual.solid().mesh()
    true = TrueMesh(solid.vertices, solid.faces)
    if aligned:
        true = true.aligned_with(_some(record.points))
    lowest, radius = scene.area.lower[2], scene.probe.radius
    points, normals = true.surface(_SURFACE, lowest, radius)
    offsets, keep = _probe_points(scene)
    reached = true.fits(points + radius * normals, radius, offsets, keep)
    found["contact"] = 1e3 * float(np.median(true.distance(_some(record.points))))
    found["coverage"] = _coverage(record, points[reached], normals[reached])
    if upright:
        places = _threats(folder, left.trace)
        found["threats"] = len(places)
        found["false_threats"] = int(true.fits(places, -np.inf, offsets, np.full(len(keep), _FALSE)).sum())
    file = folder / "mesh.stl"
    if file.is_file():
        mesh = read_mesh(file)
        found["manifold"], errors = edges_of_two(mesh), mesh_errors(mesh, true, points, lowest)
        found["picture"] = _picture(mesh, actual)
        if errors is None:
            return found
        found |= {"mesh": 1e3 * errors[0], "mesh_max": 1e3 * errors[1]}
        found["where"] = _where(mesh, record, true, points, normals, reached)
        found["mesh_reachable"] = _mean(mesh_errors(mesh, true, points, lowest, reached))
        others = {method: _other(method, record, true, points, lowest) for method in METHODS}
        found |= others
        best = min((error for error in others.values() if error is not None), default=None)
        found["over_best"] = found["mesh"] / best if best else None
    return found


def _some(points: np.ndarray) -> np.ndarray:
    """Of contacts (n, 3), so many as are measured."""
    return points[np.linspace(0, len(points) - 1, min(_CONTACTS, len(points))).astype(int)]


def _where(
    mesh: TriangleMesh,
    record: TouchRecord,
    true: TrueMesh,
    points: np.ndarray,
    normals: np.ndarray,
    reached: np.ndarray,
) -> str:
    """What lies farthest from the mesh, of surface points (n, 3): which way it faces, and how near a contact is."""
    from scipy.spatial import cKDTree

    from lwrprobe.bench.true_mesh import TrueMesh

    off = TrueMesh(mesh.vertices, mesh.faces).distance(points)
    worst = int(off.argmax())
    gap = cKDTree(record.points).query(points[worst])[0]
    side = "top" if normals[worst, 2] > _FACES else "underside" if normals[worst, 2] < -_FACES else "side"
    reach = "reachable" if reached[worst] else "not reachable upright"
    return f"{side}, {reach}, is {1e3 * off[worst]:.1f} mm off, {1e3 * gap:.0f} mm from a contact"


def _probe_points(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(k, 3) m from the sphere's centre to points of the upright probe's links, and (k,) m that each keeps."""
    from lwrprobe.bench.true_mesh import link_points
    from lwrprobe.scene.table import Pose

    tip = Pose(rpy_deg=scene.arm.tip_rpy_deg).matrix()[:3, :3]
    clearance = scene.clearance
    groups = [
        (link_points(link) @ tip.T, clearance.stick_threshold if link.name == "stick" else clearance.threshold)
        for link in scene.probe.as_probe().links
    ]
    return np.concatenate([places for places, _ in groups]), np.repeat(
        [keep for _, keep in groups], [len(places) for places, _ in groups]
    )


def _coverage(record: TouchRecord, points: np.ndarray, normals: np.ndarray) -> float | None:
    """Share of the surface points (n, 3) with a contact within half a line pitch and 1 mm that faces the same way."""
    from scipy.spatial import cKDTree

    if not len(points) or record.normals is None or not record.pitch:
        return None
    near = cKDTree(record.points).query_ball_point(points, 0.5 * record.pitch + 0.001)
    return float(np.mean([bool((record.normals[rows] @ n > SAME_SIDE).any()) for rows, n in zip(near, normals)]))


def _threats(folder: Path, trace: np.ndarray) -> np.ndarray:
    """(k, 3) m, where the tip was at each collision threat."""
    import csv

    with (folder / "states.csv").open(newline="", encoding="utf-8") as file:
        times = [float(row["time"]) for row in csv.DictReader(file) if row["event"] == "collision threat"]
    rows = np.clip(np.searchsorted(trace[:, 0], times), 0, len(trace) - 1)
    return trace[rows, 1:4]


def _other(method: str, record: TouchRecord, true: TrueMesh, points: np.ndarray, above: float) -> float | None:
    """mm, mean error of another method's mesh; None where its library is missing or it makes none."""
    from lwrprobe.bench.true_mesh import mesh_errors
    from lwrprobe.reconstruction.reconstruct import reconstruct

    try:
        mesh = reconstruct(record, method).mesh
    except LwrprobeError:
        return None
    return _mean(mesh_errors(mesh, true, points, above)) if len(mesh.faces) else None


def _mean(errors: tuple[float, float] | None) -> float | None:
    """mm, the mean of two errors in m."""
    return None if errors is None else 1e3 * errors[0]


def _picture(mesh: TriangleMesh, scene: Scene) -> str:
    """The mesh, red where it is too far out, blue where too deep: a PNG file in base64, as a journal can keep it."""
    from matplotlib.image import imsave

    from lwrprobe.evaluation.deviation_map import VIEWS, deviation_colours
    from lwrprobe.evaluation.mesh_error import deviation
    from lwrprobe.evaluation.render import Sight, View

    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    view = View(*VIEWS[0], low, high, *_PICTURE)
    file = BytesIO()
    imsave(file, Sight(mesh, view).paint(deviation_colours(deviation(mesh, scene.solid()), _LIMIT)), format="png")
    return b64encode(file.getvalue()).decode()


def _report(found: list[dict[str, Any]]) -> BenchReport:
    from lwrprobe.evaluation.machine import machine, versions

    report = BenchReport("shapes", "Random objects: what nobody tuned for")
    report.machine = machine() | versions("numpy", "numba", "trimesh", "manifold3d")
    worst = sorted(found, key=_badness, reverse=True)[:WORST]
    of: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for item in found:
        of.setdefault((item["profile"], item["strategy"]), []).append(item)
    shares = [[*key, *(c.kept(mine) for c in CRITERIA), *_middles(mine)] for key, mine in of.items()]
    columns = ["profile", "strategy", *(c.requirement for c in CRITERIA), *(f"median of {c.key}" for c in MEDIANS)]
    report.table("Runs that fulfil it", columns, shares)
    pictures = [item.pop("picture", None) for item in worst]
    for item in found:
        item.pop("picture", None)
    numbered = [item | {"no.": number} for number, item in enumerate(worst, 1)]
    report.records(f"The {len(worst)} worst runs", {"no.": "no."} | COLUMNS, numbered)
    report.records("Every run", COLUMNS, found)
    for profile in dict.fromkeys(item["profile"] for item in found):
        mine = [item for item in found if item["profile"] == profile]
        for criterion in CRITERIA:
            requirement = f"{profile}: {criterion.requirement} in {100.0 * criterion.share:.0f} %"
            report.verdicts.append(replace(criterion, requirement=requirement).verdict(mine))
        for criterion, middle in zip(MEDIANS, _middles(mine)):
            measured = f"{middle:.3g}" if np.isfinite(middle) else "no run has it"
            report.require(f"{profile}: {criterion.requirement}", measured, criterion.good(middle))
    threats = [(item["false_threats"], item["threats"]) for item in found if item.get("threats") is not None]
    false, all_of_them = np.sum(threats, axis=0).tolist() if threats else (0, 0)
    report.require("false collision threats < 5 %", f"{false} of {all_of_them}", false <= 0.05 * all_of_them)
    report.notes = [
        "Mesh errors are means of both ways, above the lowest height of the sphere's centre, undersides that no sphere "
        "reaches included; `reachable mesh` is that of what an upright probe reaches alone, both ways. What lies under "
        "an overhang is a guess: contacts without error on all that an upright probe reaches leave 0.5 to 3.6 mm on "
        "objects of which it reaches 28 to 84 %. `expected mm` is what the run itself expects of the same mesh.",
        "In a world that differs from its scene errors are those that remain when the object is moved to where the "
        "contacts have it.",
        "A threat is false where every link was 1.5 mm or more from the object. It is judged for strategies that do "
        "not lean the probe.",
    ]
    compared = [item for item in found if item.get("convex_hull") is not None]
    if compared and all(item.get("poisson") is None for item in compared):
        report.notes.append("Poisson is left out: Open3D is not installed.")
    if any(picture is not None for picture in pictures):
        report.figures["worst"] = partial(_draw_worst, worst=worst, pictures=pictures)
    report.data["runs"] = found
    return report


def _middles(found: list[dict[str, Any]]) -> list[float]:
    """The medians that are asked for; NaN where no run has the figure."""
    values = [[item[c.key] for item in found if item.get(c.key) is not None] for c in MEDIANS]
    return [float(np.median(some)) if some else float("nan") for some in values]


def _badness(item: dict[str, Any]) -> tuple[int, float]:
    """Runs that fail most come first, then by the mesh."""
    return sum(not c.holds(item) for c in CRITERIA), item.get("mesh") or np.inf


def _draw_worst(figure: Any, worst: list[dict[str, Any]], pictures: list[str | None]) -> None:
    """The meshes of the worst runs, numbered as in the table."""
    from matplotlib.image import imread

    figure.set_size_inches(10.0, 1.9 * -(-len(worst) // 5) + 0.2)
    panels = figure.subplots(-(-len(worst) // 5), 5, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for number, (axes, item, picture) in enumerate(zip(panels, worst, pictures), 1):
        if picture is not None:
            axes.imshow(imread(BytesIO(b64decode(picture))))
        axes.set_title(f"{number}: {item['object'].removeprefix('random:')}", fontsize=7)
