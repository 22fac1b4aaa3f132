"""Clearance beside the collision libraries: five links of a probe against the voxels of a block.

Each library gets what serves it best: one manager of links against one manager of voxel boxes, both trees of boxes. The
poses have the tip near the object, as in a run; blocks of poses are asked of everyone in turn.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.bench.timing import installed, interleave, load_before, take_turns
from lwrprobe.bench.voxel_block import EDGE, block_surface
from lwrprobe.collision import NO_FRAMES, ClearanceQuery, ClearanceWatch, LinkGroup
from lwrprobe.contracts import LinkShape
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.mapping import VoxelMap

OWN, COAL, FCL = "lwrprobe", "coal", "python-fcl"
LIBRARIES = {FCL: "fcl", COAL: "coal"}
TENFOLD = (100, 1_000, 10_000, 100_000)
BRUTE_VOXELS = 1_000
BLOCK = 20
NEED = {100: 5e-6, 1_000: 8e-6, 10_000: 12e-6, 100_000: 15e-6}
"""s, wanted median at so many voxels."""
NEED_P99 = 30e-6
COAL_LEAD, COAL_LEAD_P99, FCL_LEAD, MAX_ERROR = 2.0, 5.0, 30.0, 1e-6
KEEP, SAMPLE_STEP = 0.003, 0.00016
"""m, what links keep in a run, and what the tip goes from one sample to the next (20 mm/s, 125 Hz)."""
ROUNDS = 7
"""Along a path; the median of each sample's counts."""

Ask = Callable[[np.ndarray], float]


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench clearance`; options `poses`, `rounds`."""
    asked = Options("clearance", options, "poses", "rounds")
    poses_wanted, rounds = asked.count("poses", 60 if quick else 200), asked.count("rounds", 3 if quick else ROUNDS)
    libraries, missing = installed(LIBRARIES)
    report = BenchReport("clearance", "Clearance between links and voxels", machine=_machine())
    report.notes = missing

    times: dict[int, dict[str, np.ndarray]] = {}
    rows = []
    for count in TENFOLD[:3] if quick else TENFOLD:
        bench = _Setting(count, poses_wanted, libraries)
        times[count] = bench.times(rounds)
        rows.append([count, *bench.row(times[count])])
        if count == BRUTE_VOXELS:
            error = bench.error_against_brute_force(10 if quick else 40)
    names = [OWN, *libraries]
    columns = ["voxels", *(f"{name} {what}" for name in names for what in ("median", "p99"))]
    columns += ["batch, a pose", "add a voxel", "1 mm ahead", "watch, a sample", "nearest, mm (median)"]
    title = f"us a query over {poses_wanted} poses (each the median of {rounds} rounds)"
    report.tables = [Table(title, columns, rows), _ratio_table(times, list(libraries))]
    report.verdicts = _verdicts(times, libraries)
    if error is None:
        report.notes.append("no brute force without coal: the error was not measured")
    else:
        text = f"{1e6 * error:.2g} um"
        report.require(f"error against brute force below 1 um, {BRUTE_VOXELS} voxels", text, error <= MAX_ERROR)
    report.notes.append(
        f"Everyone in turn is asked {BLOCK} poses, {rounds} rounds; medians and 99th percentiles are over the poses, "
        "each the median of its rounds: what a pose costs, without the machine's pauses."
    )
    report.notes.append("add a voxel: into a map that has them all, seen by the next query; nothing is rebuilt")
    report.notes.append(
        f"watch, a sample: along a face of the block, {1e3 * SAMPLE_STEP:g} mm from one to the next, as in a run; what "
        "cannot matter is bounded, not measured"
    )
    report.figures["time"] = lambda figure: _draw(figure, times)
    return report


def probe_links() -> list[LinkShape]:
    """Stick, sensor, holder and two fingers of a probe, behind its tip."""

    def at(z: float, y: float = 0.0) -> np.ndarray:
        pose = np.eye(4)
        pose[1:3, 3] = y, z
        return pose

    return [
        LinkShape("stick", "cylinder", (0.002, 0.040), at(-0.025)),
        LinkShape("sensor", "cylinder", (0.0085, 0.0145), at(-0.05225)),
        LinkShape("holder", "cylinder", (0.0125, 0.040), at(-0.0795)),
        LinkShape("finger_left", "box", (0.012, 0.020, 0.070), at(-0.12, 0.0225)),
        LinkShape("finger_right", "box", (0.012, 0.020, 0.070), at(-0.12, -0.0225)),
    ]


def tip_poses(count: int, middle: np.ndarray, size: np.ndarray, seed: int = 7) -> np.ndarray:
    """(count, 4, 4): the tip 5 to 30 mm off the surface of a block, pointing at it within 45 deg."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for pose in poses:
        axis, sign = rng.integers(3), rng.choice([-1.0, 1.0])
        outward = sign * np.eye(3)[axis]
        pose[:3, 3] = middle + rng.uniform(-0.5, 0.5, 3) * size
        pose[axis, 3] = middle[axis] + sign * (0.5 * size[axis] + rng.uniform(0.005, 0.03))
        aside = np.cross(outward, rng.normal(size=3))
        lean = rng.uniform(0.0, np.pi / 4)
        z = -np.cos(lean) * outward + np.sin(lean) * aside / np.linalg.norm(aside)
        x = np.cross(aside, z)
        pose[:3, 0], pose[:3, 2] = x / np.linalg.norm(x), z
        pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
    return poses


class _Setting:
    """A block of so many voxels, the poses, and everyone who can answer."""

    def __init__(self, count: int, poses: int, libraries: dict[str, Any]) -> None:
        self.centres, middle, size = block_surface(count)
        self.poses = tip_poses(poses, middle, size)
        self.voxels = VoxelMap(EDGE)
        self.voxels.insert(self.centres)
        self.query = ClearanceQuery(probe_links(), self.voxels)
        self.libraries = libraries
        self.asks = {OWN: self._own()}
        self.asks |= {name: _Library(library, self.centres).managers() for name, library in libraries.items()}

    def times(self, rounds: int) -> dict[str, np.ndarray]:
        """Seconds (poses,) of everyone: of each pose the median over the rounds.

        Everyone in turn is asked a block of poses, so that each finds the caches as its own calls leave them.
        """
        seconds = take_turns(self.asks, [(pose,) for pose in self.poses], BLOCK, rounds)
        return {name: np.median(each, axis=0) for name, each in seconds.items()}

    def row(self, times: dict[str, np.ndarray]) -> list[float]:
        """Medians and 99th percentiles of everyone in us, then what lwrprobe alone does."""
        query, poses = self.query, self.poses
        steps = [(pose, _moved(pose, 0.001)) for pose in poses]
        fresh = iter(np.random.default_rng(1).uniform(0.5, 0.7, (5000, 3)))  # elsewhere: the object stays as it is
        batch = interleave({"": lambda: query.nearest_batch(poses)}, 9)[""]
        ahead = interleave({"": lambda: [query.ahead(a, b) for a, b in steps]}, 3)[""]
        nearest = [query.nearest(pose).distance for pose in poses]
        added = interleave({"": lambda: [self.voxels.insert_point(next(fresh)) for _ in range(200)]}, 9)[""]
        cells = [1e6 * float(np.percentile(seconds, q)) for seconds in times.values() for q in (50, 99)]
        cells += [1e6 * float(np.median(batch)) / len(poses), 1e6 * float(np.median(added)) / 200]
        cells.append(1e6 * float(np.median(ahead)) / len(poses))
        return [*cells, 1e6 * self._watched(), 1e3 * float(np.median(nearest))]

    def _watched(self) -> float:
        """Seconds a sample, on average, of a `ClearanceWatch` that goes along with a tip, as a run has it."""
        watch = ClearanceWatch([LinkGroup(probe_links(), KEEP)], self.voxels)
        middle, size = self.centres.mean(axis=0), np.ptp(self.centres, axis=0)
        path = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (int(size[1] / SAMPLE_STEP), 1, 1))
        path[:, :3, 3] = middle + np.array([0.5 * size[0] + 0.005, 0.0, 0.0])
        path[:, 1, 3] += np.linspace(-0.5, 0.5, len(path)) * size[1]
        seconds = np.empty((ROUNDS, len(path)))
        for turn in seconds:
            for k, pose in enumerate(path):
                begin = perf_counter()
                watch.nearest(pose)
                turn[k] = perf_counter() - begin
        return float(np.median(seconds, axis=0).mean())

    def error_against_brute_force(self, poses: int) -> float | None:
        """Largest difference [m] from coal's narrow phase over all pairs of link and voxel; None without coal."""
        if COAL not in self.libraries:
            return None
        nearest = _Library(self.libraries[COAL], self.centres).all_pairs()
        return max(abs(self.asks[OWN](pose) - nearest(pose)) for pose in self.poses[:poses])

    def _own(self) -> Ask:
        answer = np.empty(8)

        def ask(pose: np.ndarray) -> float:
            self.query.nearest_into(pose, NO_FRAMES, answer)
            return answer[0]

        return ask


def _machine() -> dict[str, str]:
    return machine() | load_before() | versions("numpy", "numba", FCL, COAL)


def _moved(pose: np.ndarray, step: float) -> np.ndarray:
    moved = pose.copy()
    moved[0, 3] += step
    return moved


class _Library:
    """The links and the voxels as bodies of coal or python-fcl, whose classes have the same names but for a few."""

    def __init__(self, library: Any, centres: np.ndarray) -> None:
        self.library, self.links = library, probe_links()
        self.coal = hasattr(library, "Transform3s")
        self.place = library.Transform3s if self.coal else library.Transform
        self.bodies = [self._body(link) for link in self.links]
        cube = library.Box(EDGE, EDGE, EDGE)
        self.boxes = [library.CollisionObject(cube, self.place(np.eye(3), centre)) for centre in centres]

    def _body(self, link: LinkShape) -> Any:
        shape = self.library.Box if link.kind == "box" else self.library.Cylinder
        return self.library.CollisionObject(shape(*link.size))

    def move(self, pose: np.ndarray) -> None:
        """Put the links where they are when the tip is at `pose`."""
        for link, body in zip(self.links, self.bodies):
            placed = pose @ link.pose
            body.setTransform(self.place(placed[:3, :3], placed[:3, 3]))
            if self.coal:
                body.computeAABB()

    def managers(self) -> Ask:
        """One manager of links against one of voxels, both trees of boxes."""
        robot, objects = (self._manager(members) for members in (self.bodies, self.boxes))
        library = self.library

        def ask(pose: np.ndarray) -> float:
            self.move(pose)
            robot.update()
            if self.coal:
                callback = library.DistanceCallBackDefault()
                callback.init()
                robot.distance(objects, callback)
                return max(callback.data.result.min_distance, 0.0)
            data = library.DistanceData()
            robot.distance(objects, data, library.defaultDistanceCallback)
            return max(data.result.min_distance, 0.0)

        return ask

    def _manager(self, members: list[Any]) -> Any:
        manager = self.library.DynamicAABBTreeCollisionManager()
        for member in members:
            manager.registerObject(member)
        manager.setup()
        return manager

    def all_pairs(self) -> Ask:
        """coal's narrow phase over all pairs of link and voxel."""
        request = self.library.DistanceRequest()
        request.gjk_tolerance = 1e-9

        def ask(pose: np.ndarray) -> float:
            self.move(pose)
            pairs = product(self.bodies, self.boxes)
            distances = (self.library.distance(*pair, request, self.library.DistanceResult()) for pair in pairs)
            return max(min(distances), 0.0)

        return ask


def _ratio_table(times: dict[int, dict[str, np.ndarray]], peers: list[str]) -> Table:
    columns = ["voxels", *(f"{name} {what}" for name in peers for what in ("median", "p99"))]
    rows = [[n, *(_ratio(by_who, name, q) for name in peers for q in (50, 99))] for n, by_who in times.items()]
    return Table("Times as long as lwrprobe", columns, rows)


def _ratio(by_who: dict[str, np.ndarray], name: str, percent: float) -> float:
    return float(np.percentile(by_who[name], percent) / np.percentile(by_who[OWN], percent))


def _verdicts(times: dict[int, dict[str, np.ndarray]], libraries: dict[str, Any]) -> list[Verdict]:
    held = []
    own = {n: [float(np.percentile(by_who[OWN], q)) for q in (50, 99)] for n, by_who in times.items()}
    for n, (median, _) in own.items():
        held.append(Verdict(f"{n} voxels: median <= {1e6 * NEED[n]:g} us", f"{1e6 * median:.3g} us", median <= NEED[n]))
    slowest = max(p99 for _, p99 in own.values())
    held.append(Verdict(f"p99 <= {1e6 * NEED_P99:g} us throughout", f"{1e6 * slowest:.3g} us", slowest <= NEED_P99))

    def require(text: str, name: str, percent: float, lead: float, at_least: int) -> None:
        ratios = [_ratio(by_who, name, percent) for n, by_who in times.items() if n >= at_least]
        if ratios:
            held.append(Verdict(text, f"{min(ratios):.2g} x at worst", min(ratios) >= lead))

    if COAL in libraries:
        require(f"{COAL_LEAD:g} x faster than coal's managers", COAL, 50, COAL_LEAD, 0)
        require(f"{COAL_LEAD_P99:g} x at the 99th percentile from 10000 voxels on", COAL, 99, COAL_LEAD_P99, 10_000)
    if FCL in libraries:
        require(f"{FCL_LEAD:g} x faster than python-fcl's managers from 1000 voxels on", FCL, 50, FCL_LEAD, 1_000)
    return held


def _draw(figure: Any, times: dict[int, dict[str, np.ndarray]]) -> None:
    axes = figure.subplots()
    counts = list(times)
    for name in times[counts[0]]:
        middle, high = ([1e6 * np.percentile(times[n][name], q) for n in counts] for q in (50, 99))
        (line,) = axes.plot(counts, middle, "o-", label=name)
        axes.plot(counts, high, ":", color=line.get_color())
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("voxels of 2 mm")
    axes.set_ylabel("us a query: median, 99th percentile dotted")
    axes.grid(alpha=0.3)
    axes.legend()
