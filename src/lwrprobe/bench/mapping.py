"""The voxel map beside OctoMap's two Python packages: insertion, look-up, files, leaves.

All are given the same voxels, the surface of a block in random order, and must end with the same tree: the `.bt` files
are compared byte by byte.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.bench.timing import installed, interleave, load_before
from lwrprobe.bench.voxel_block import EDGE, block_surface
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.mapping import SweptSphere, VoxelMap

PEERS = {"octomap": "octomap-python", "pyoctomap": "pyoctomap"}
OWN = "lwrprobe"
SINGLES = 1000  # calls timed together, so that the clock does not count
BATCH_LEAD = 20.0
BUDGET, QUICK_BUDGET = 3.0, 0.3
"""s a task, for all together."""

Job = Callable[[], object]


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench mapping`; option `voxels`."""
    count = Options("mapping", options, "voxels").count("voxels", 20_000 if quick else 100_000)
    centres, _, _ = block_surface(count)
    libraries, missing = installed({package: name for name, package in PEERS.items()})
    peers = {name: libraries[package] for name, package in PEERS.items() if package in libraries}
    report = BenchReport("mapping", "The voxel map: insertion, look-up, files", machine=_machine())
    with tempfile.TemporaryDirectory() as folder:
        jobs = {OWN: _own_jobs(centres, Path(folder))}
        jobs |= {name: _peer_jobs(module, centres, Path(folder), name) for name, module in peers.items()}
        seconds = {task: _per_unit(task, jobs, count, QUICK_BUDGET if quick else BUDGET) for task in jobs[OWN]}
        same = {name: (Path(folder) / f"{name}.bt").read_bytes() for name in jobs}
    report.tables.append(_table(seconds, list(jobs), count))
    report.verdicts = _verdicts(seconds) if peers else []
    report.verdicts += [
        Verdict(f"the same .bt, byte for byte, as {name}", f"{len(same[OWN])} bytes", same[name] == same[OWN])
        for name in peers
    ]
    report.notes = [*missing, *_carving()]
    report.figures["time"] = lambda figure: _draw(figure, seconds)
    report.data["seconds"] = seconds
    return report


def _machine() -> dict[str, str]:
    return machine() | load_before() | versions("numpy", "numba", *PEERS.values())


def _own_jobs(centres: np.ndarray, folder: Path) -> dict[str, Job]:
    voxels = VoxelMap(EDGE)
    voxels.insert(centres)
    some = list(centres[:SINGLES])

    def insert_one_by_one() -> None:
        fresh = VoxelMap(EDGE)
        for point in some:
            fresh.insert_point(point)

    return {
        "insert one": insert_one_by_one,
        "insert batch": lambda: VoxelMap(EDGE).insert(centres),
        "look up one": lambda: [voxels.occupied(point) for point in some],
        "look up batch": lambda: voxels.states(centres),
        "write .bt": lambda: voxels.write(folder / f"{OWN}.bt"),
        "read .bt": lambda: VoxelMap.read(folder / f"{OWN}.bt"),
        "write .ot": lambda: voxels.write(folder / f"{OWN}.ot"),
        "list leaves": voxels.leaves,
    }


def _peer_jobs(module: Any, centres: np.ndarray, folder: Path, name: str) -> dict[str, Job]:
    tree = module.OcTree(EDGE)
    for point in centres:
        tree.updateNode(point, True)
    some = list(centres[:SINGLES])
    bt, ot = str(folder / f"{name}.bt"), str(folder / f"{name}.ot")
    tree.writeBinary(bt)

    def insert_one_by_one() -> None:
        fresh = module.OcTree(EDGE)
        for point in some:
            fresh.updateNode(point, True)

    return {
        "insert one": insert_one_by_one,
        "insert batch": lambda: module.OcTree(EDGE).updateNodes(centres, True),
        "look up one": lambda: [tree.isNodeOccupied(tree.search(point)) for point in some],
        "look up batch": lambda: tree.getLabels(centres),
        "write .bt": lambda: tree.writeBinary(bt),
        "read .bt": lambda: module.OcTree(EDGE).readBinary(bt),
        "write .ot": lambda: tree.write(ot),
        "list leaves": lambda: [(leaf.getCoordinate(), leaf.getSize()) for leaf in tree.begin_leafs()],
    }


def _per_unit(task: str, jobs: dict[str, dict[str, Job]], count: int, budget: float) -> dict[str, float]:
    """Median seconds a point, or a file or list, of everyone who has the task, in about `budget` seconds for all."""
    units = SINGLES if task.endswith("one") else count if task.endswith("batch") else 1
    candidates = {name: own[task] for name, own in jobs.items()}
    once = sum(float(seconds[0]) for seconds in interleave(candidates, 1).values())
    times = interleave(candidates, int(np.clip(budget / once, 5, 500)))
    return {name: float(np.median(seconds)) / units for name, seconds in times.items()}


def _table(seconds: dict[str, dict[str, float]], names: list[str], count: int) -> Table:
    rows = []
    for task, by_who in seconds.items():
        scale, unit = (1e6, "us a point") if task.endswith(("one", "batch")) else (1e3, "ms")
        best = min((by_who[name] for name in names if name != OWN), default=None)
        ahead = None if best is None else best / by_who[OWN]
        rows.append([task, unit, *(scale * by_who[name] for name in names), ahead])
    title = f"{count} voxels of {1e3 * EDGE:g} mm, called from Python, medians"
    return Table(title, ["task", "unit", *names, "best peer / lwrprobe"], rows)


def _verdicts(seconds: dict[str, dict[str, float]]) -> list[Verdict]:
    """Ahead in every task; by far where one call takes many points and the peers are called once a point."""
    lead = {task: min(t for name, t in by_who.items() if name != OWN) / by_who[OWN] for task, by_who in seconds.items()}
    held = [Verdict(f"{task}: ahead of the best peer", f"{ratio:.2g} x", ratio > 1.0) for task, ratio in lead.items()]
    for task in ("insert", "look up"):
        single = min(t for name, t in seconds[f"{task} one"].items() if name != OWN)
        ratio = single / seconds[f"{task} batch"][OWN]
        wanted = f"{task}: {BATCH_LEAD:g} x the best peer's single call, in batch"
        held.append(Verdict(wanted, f"{ratio:.2g} x", ratio >= BATCH_LEAD))
    return held


def _carving() -> list[str]:
    """What a millisecond of motion costs that has to be marked free; no peer marks a swept sphere."""
    path = np.column_stack([np.linspace(0.0, 0.1, 2001), np.zeros(2001), np.zeros(2001)])
    voxels = VoxelMap(EDGE)
    sphere = SweptSphere(voxels, 0.005)

    def sweep() -> None:
        for place in path:
            sphere.move_to(place)
        sphere.leave()

    seconds = interleave({"steps": lambda: voxels.carve_path(path, 0.005), "sweep": sweep}, 5)
    steps, sweeping = (1e6 * float(np.median(seconds[name])) / (len(path) - 1) for name in ("steps", "sweep"))
    return [
        f"marking free what a 5 mm sphere sweeps in steps of 0.05 mm costs {steps:.2g} us a step; checked place after "
        f"place, as in a run, {sweeping:.2g} us, since a straight path is marked at once"
    ]


def _draw(figure: Any, seconds: dict[str, dict[str, float]]) -> None:
    axes = figure.subplots()
    names = list(next(iter(seconds.values())))
    for i, name in enumerate(names):
        places = np.arange(len(seconds)) + 0.8 * (i / len(names) - 0.5)
        axes.barh(places, [1e6 * by_who[name] for by_who in seconds.values()], 0.8 / len(names), label=name)
    axes.set_yticks(np.arange(len(seconds)), list(seconds))
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel("us a point, or a file, or a list")
    axes.legend()
