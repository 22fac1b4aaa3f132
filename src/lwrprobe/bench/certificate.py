"""What the certificate claims, held against bumps that are hidden where nobody looked.

A perfect sphere on its stick explores random objects, by lines or by pokes, some of them left out: blocks, wedges and
cylinders that stand beside and on one another. A bump, a ball of one to three times the certified diameter, is then set
upon the object wherever it fits. It is found if sphere or stick would have met it at each of these places; else the
certificate must not have claimed that there is none. Options
(`--set`): `count`, objects; `first`, seed of the first; `voxels` of the certificate's grid; `jobs` side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from lwrprobe.bench.options import Options
from lwrprobe.bench.perfect_sphere import PerfectSphere, Trail
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import Area
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.exploration.recording.swept_path import WIDER
from lwrprobe.mapping.certificate import Certificate
from lwrprobe.scene.scene import ProbeTable
from lwrprobe.scene.shape import Box, Cylinder, HalfSpace, Intersection, Shape
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose
from lwrprobe.sweeps.execute import run_in_order

LARGEST = 3.0
"""Times the certified diameter, of a bump."""
BESIDE, ABOVE = 0.015, 0.008
"""m from the object to the border of the area."""
PITCHES = (0.002, 0.025)
"""m between lines."""
LEFT_OUT = 0.4
"""Share of the lines or pokes that are left out, at most; of half of the objects none is."""
PARTS = 3
"""Of an object, at most."""
WIDTHS, HEIGHTS = (0.01, 0.04), (0.006, 0.024)
"""m, of a part."""
STEEPEST = 25.0
"""degrees, of the top of a wedge."""
WAYS = ("lines", "lines both ways", "pokes")
PLACES = 2000
"""Of the surface, at which a bump may stand."""
SIZES = 40
"""Of bumps up to the drawn one, among which the largest that hides is sought."""
DRAWS = 8
"""Of a bump's size, each below the last, until one fits into the area."""
EXACT = 1e-9
"""m"""
FOUND, NO_ROOM, NOT_CLAIMED, MISSED = "found", "no room", "not within reach", "missed"
COLUMNS = {
    "object": "object",
    "explored by": "way",
    "pitch mm": "pitch",
    "certified mm": "certified",
    "bump mm": "bump",
    "outcome": "outcome",
    "largest hidden mm": "hidden",
}


@dataclass(slots=True)
class Job:
    """One object."""

    number: int
    voxels: int


@dataclass(slots=True)
class Swept:
    """What an upright probe has swept: sphere at centres (n, 3) m, and the stick above them."""

    centres: np.ndarray
    radius: float
    stick_radius: float
    stick: tuple[float, float]

    def unmet(self, points: np.ndarray, radius: float) -> np.ndarray:
        """Numbers of those of points (k, 3) about which a ball of a radius [m] meets nothing swept."""
        left = np.flatnonzero(cKDTree(self.centres).query(points)[0] > self.radius + radius)
        near = cKDTree(self.centres[:, :2]).query_ball_point(points[left, :2], radius + self.stick_radius)
        return left[[self._beside_stick(points[k], self.centres[row]) > radius for k, row in zip(left, near)]]

    def _beside_stick(self, point: np.ndarray, centres: np.ndarray) -> float:
        """m from a point (3,) to the stick above the centres (k, 3)."""
        apart, (low, high) = point - centres, self.stick
        across = np.maximum(np.hypot(apart[:, 0], apart[:, 1]) - self.stick_radius, 0.0)
        along = np.maximum(np.maximum(low - apart[:, 2], apart[:, 2] - high), 0.0)
        return float(np.hypot(across, along).min(initial=np.inf))


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench certificate`."""
    asked = Options("certificate", options, "count", "first", "voxels", "jobs")
    first, voxels = asked.count("first", 1), asked.count("voxels", 150_000)
    jobs = [Job(first + n, voxels) for n in range(asked.count("count", 45 if quick else 1000))]
    found = run_in_order(jobs, explored, asked.count("jobs", 1))
    report = BenchReport("certificate", "What the certificate claims, and what hides")
    report.machine = machine() | versions("numpy", "numba", "scipy")
    _summarise(report, found)
    report.records("Every object", COLUMNS, found)
    missed = sum(item.get("outcome") == MISSED for item in found)
    judged = sum(item.get("outcome") is not None for item in found)
    report.require("no bump is missed that was certified not to be there", f"{missed} of {judged}", missed == 0)
    report.require("every object was explored", f"{judged} of {len(found)}", judged == len(found))
    report.figures["sizes"] = partial(_draw, found=found)
    report.data["objects"] = found
    return report


def explored(job: Job) -> dict[str, Any]:
    """One object: what is certified, and what became of the bump."""
    random = np.random.default_rng(job.number)
    solid = Solid.from_shapes(_object(random))
    probe = ProbeTable().as_probe()
    stick = next(link for link in probe.links if link.name == "stick")
    lower, upper = solid.bounds()
    area = Area(
        np.array([*(lower[:2] - BESIDE), probe.radius + 0.001]), np.array([*(upper[:2] + BESIDE), upper[2] + ABOVE])
    )
    way, pitch = str(random.choice(WAYS)), float(random.uniform(*PITCHES))
    sphere = PerfectSphere(solid, area, probe.radius, stick.size[0], probe.sensor_distance)
    trails = _drive(sphere, area, way, pitch, random)
    centres, contacts = (np.vstack([getattr(trail, name) for trail in trails]) for name in ("centres", "contacts"))
    opening = WIDER * max(2.0 * probe.radius, 0.0 if way == "pokes" else pitch)
    certificate = Certificate(area, probe.radius, (stick,), opening=opening, max_voxels=job.voxels)
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(centres), 1, 1))
    poses[:, :3, 3] = centres
    certificate.sweep(centres, np.zeros(len(centres), bool), poses)
    certificate.touch(contacts)
    certified = certificate.hiding().diameter
    middle, half = -stick.pose[2, 3], 0.5 * stick.size[1]
    swept = Swept(centres, probe.radius, stick.size[0], (middle - half, middle + half))
    fate = partial(_fate, solid, area, swept, opening, job.number)
    largest = LARGEST * certified
    for _ in range(DRAWS):
        bump = float(random.uniform(certified, largest))
        outcome = fate(bump)
        if outcome != NO_ROOM:
            break
        largest = bump
    hidden = [size for size in np.linspace(0.0, bump, SIZES + 1)[1:].tolist() if fate(size) == MISSED]
    return {
        "object": job.number,
        "way": way,
        "pitch": None if way == "pokes" else 1e3 * pitch,
        "certified": 1e3 * certified,
        "bump": 1e3 * bump,
        "outcome": outcome,
        "hidden": 1e3 * max(hidden, default=0.0),
    }


def _object(random: np.random.Generator) -> list[Shape]:
    """Parts that stand on the table, in and beside one another; wedges are blocks that are cut off aslant."""
    parts: list[Shape] = []
    for _ in range(int(random.integers(1, PARTS + 1))):
        x, y = random.uniform(-1.0, 1.0, 2) * WIDTHS[0]
        length, width, height = *random.uniform(*WIDTHS, 2), random.uniform(*HEIGHTS)
        pose = Pose(xyz=(x, y, 0.5 * height), rpy_deg=(0.0, 0.0, float(random.uniform(0.0, 180.0))))
        kind = int(random.integers(3))
        if kind == 0:
            parts.append(Cylinder(shape="cylinder", radius=0.5 * length, length=height, at=pose))
            continue
        block = Box(shape="box", size=(length, width, height), at=pose)
        if kind == 1:
            parts.append(block)
            continue
        slope = (*random.uniform(-STEEPEST, STEEPEST, 2).tolist(), 0.0)
        above = HalfSpace(shape="half_space", at=Pose(xyz=(x, y, 0.9 * height), rpy_deg=slope))
        parts.append(Intersection(shape="intersection", children=(block, above)))
    return parts


def _drive(sphere: PerfectSphere, area: Area, way: str, pitch: float, random: np.random.Generator) -> list[Trail]:
    """The lines or pokes of one object, some left out."""
    axes = (0, 1) if way == "lines both ways" else (int(random.integers(2)),)
    kept = 1.0 - LEFT_OUT * max(random.uniform(-1.0, 1.0), 0.0)
    trails = []
    for axis in axes:
        across = np.arange(area.lower[1 - axis], area.upper[1 - axis], pitch)
        chosen = random.random(len(across)) < kept
        chosen[random.integers(len(across))] = True
        if way == "pokes":
            along = np.arange(area.lower[axis], area.upper[axis], pitch)
            plane = np.stack(np.meshgrid(across, along, indexing="ij"), axis=-1).reshape(-1, 2)
            plane = plane[random.random(len(plane)) < kept]
            trails.append(sphere.pokes(plane if axis else plane[:, ::-1]))
        else:
            trails += sphere.lines(axis, across[chosen])
    return trails


def _fate(solid: Solid, area: Area, swept: Swept, opening: float, seed: int, size: float) -> str:
    """What becomes of a ball of a diameter [m] that stands on the surface, wherever it fits."""
    radius = 0.5 * size
    points, normals = solid.sample_surface(PLACES, seed)
    centres = points + radius * normals
    beyond = np.maximum(area.lower - centres, centres - area.upper)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    stands = (outside <= swept.radius - radius) & (solid.signed_distance(centres) >= radius - EXACT)
    if not stands.any():
        return NO_ROOM
    points, normals, centres = points[stands], normals[stands], centres[stands]
    unmet = swept.unmet(centres, radius)
    if not len(unmet):
        return FOUND
    # Within reach: in a ball as wide as the opening that holds it and nothing of the object, and comes from above.
    wide = max(radius, 0.5 * opening)
    holding = centres[unmet] + (wide - radius) * normals[unmet]
    over = holding[:, 2] >= area.lower[2] - EXACT  # its middle stays in the area, at the foot of a wall, too
    free = over & (solid.signed_distance(holding) >= wide - EXACT)
    # No part stands out over another one, so that what is free is free upwards.
    return MISSED if free.any() else NOT_CLAIMED


def _summarise(report: BenchReport, found: list[dict[str, Any]]) -> None:
    """What became of the bumps, and how much of what is certified does hide, a row each way of exploring."""
    rows = []
    for way in WAYS:
        own = [item for item in found if item.get("way") == way]
        if not own:
            continue
        outcomes = [sum(item["outcome"] == end for item in own) for end in (FOUND, NOT_CLAIMED, NO_ROOM, MISSED)]
        sizes = np.array([[item["certified"], item["hidden"]] for item in own])
        middle = np.median(sizes[:, 0]), np.median(sizes[:, 1]), np.median(sizes[:, 1] / sizes[:, 0])
        rows.append([way, len(own), *outcomes, *map(float, middle)])
    ends = " | ".join((FOUND, NOT_CLAIMED, NO_ROOM, MISSED))
    report.table(
        "Bumps of one to three times the certified diameter",
        f"explored by | objects | {ends} | certified mm | largest hidden mm | hidden / certified",
        rows,
    )


def _draw(figure: Any, found: list[dict[str, Any]]) -> None:
    """The largest that hides against what is certified, and the line above which nothing may be."""
    axes = figure.subplots()
    for way in WAYS:
        own = [(item["certified"], item["hidden"]) for item in found if item.get("way") == way]
        if own:
            axes.plot(*zip(*own), ".", ms=4, label=way)
    limit = max((item.get("certified", 0.0) for item in found), default=1.0)
    axes.plot([0.0, limit], [0.0, limit], "k-", lw=0.8)
    axes.set_xlabel("certified diameter, mm")
    axes.set_ylabel("largest ball that hides within reach, mm")
    axes.legend()
