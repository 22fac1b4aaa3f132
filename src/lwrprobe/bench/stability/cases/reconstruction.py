"""Cases 36 to 38: what reconstructors are given when it is too little, too flat, too much or turned over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.bench.sampled_lines import LOWEST, sample_lines
from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.contracts import InputError, LwrprobeError, MissingExtraError, Reconstruction, TouchRecord
from lwrprobe.evaluation import is_watertight, mesh_error
from lwrprobe.reconstruction.closed import count_pieces
from lwrprobe.reconstruction.concave_hull import ConcaveHull
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.convex_hull import ConvexHull
from lwrprobe.reconstruction.hermite_rbf import HermiteRbf
from lwrprobe.reconstruction.poisson import Poisson
from lwrprobe.scene import load_scene

_METHODS = {
    "convex_hull": ConvexHull,
    "concave_hull": ConcaveHull,
    "hermite_rbf": HermiteRbf,
    "contact_surface": ContactSurface,
}
_MILLION = 1_000_000


def _ball(n: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    normals = np.random.default_rng(36).normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def _inputs() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(36)
    lattice = np.stack(np.meshgrid(*[[0.0, 0.01, 0.02]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    flat = np.column_stack([rng.random((200, 2)), np.zeros(200)])
    bad = rng.random((100, 3))
    bad[7, 1] = np.nan
    return {
        **{f"{n} points": rng.random((n, 3)) for n in range(4)},
        "collinear": np.outer(np.linspace(0.0, 1.0, 50), [1.0, 2.0, 3.0]),
        "coplanar": flat,
        "all the same": np.full((50, 3), 0.1),
        "NaN": bad,
        "infinite": np.where(np.isnan(bad), np.inf, bad),
        "lattice of cospherical cells": lattice,
        "scale 1e-9": 1e-9 * _ball(300, 0.025)[0],
        "scale 1e6": 1e6 * _ball(300, 0.025)[0],
    }


_REFUSED = frozenset(
    {"0 points", "1 points", "2 points", "3 points", "collinear", "coplanar", "all the same", "NaN", "infinite"}
)


def _closed(found: Reconstruction) -> bool:
    return bool(np.isfinite(found.mesh.vertices).all() and is_watertight(found.mesh))


def _hull_inputs(quick: bool) -> list[Finding]:
    findings = []
    for name, method in _METHODS.items():
        for setting, points in _inputs().items():
            findings.append(_refusal_or_mesh(name, method, setting, points))
    findings.append(_many("convex_hull", ConvexHull(), 100_000 if quick else _MILLION))
    config = ContactSurface.Config(pitch=0.010)
    findings.append(_many("contact_surface", ContactSurface(config), 100_000 if quick else _MILLION))
    return findings


def _refusal_or_mesh(name: str, method: type, setting: str, points: np.ndarray) -> Finding:
    label = f"{name}, {setting}"
    try:
        found = method().reconstruct(TouchRecord(points))
    except InputError as error:
        return Finding(label, f"refused: {error}", setting in _REFUSED or name != "convex_hull")
    if setting in _REFUSED:
        return Finding(label, f"{len(found.mesh.faces)} triangles of points that span no solid", False)
    text = f"{len(found.mesh.faces)} triangles, {'closed' if found.report['watertight'] else 'said to be open'}"
    return Finding(label, text, found.report["watertight"] == is_watertight(found.mesh))


def _many(name: str, worker: ConvexHull | ContactSurface, count: int) -> Finding:
    """A ball touched with an error of up to 0.1 mm."""
    points, normals = _ball(count, 0.05)
    points += np.clip(np.random.default_rng(1).normal(0.0, 3e-5, (count, 1)), -1e-4, 1e-4) * normals
    found = worker.reconstruct(TouchRecord(points, normals=normals, probe_radius=0.005))
    error = 1e3 * float(np.abs(np.linalg.norm(found.mesh.vertices, axis=1) - 0.05).max())
    text = f"{len(found.mesh.faces)} triangles; the farthest vertex off a ball of 50 mm"
    return within(f"{name}, {count} points", text, error, 0.2, "mm", also=_closed(found))


def _alphas(quick: bool) -> list[Finding]:
    record = sample_lines(load_scene("bridge").solid(), 0.010)
    findings = []
    for label, config in (
        ("alpha 1 mm, shards", ConcaveHull.Config(alpha=0.001)),
        ("alpha 15 mm, the thesis's", ConcaveHull.Config(alpha=0.015)),
        ("alpha 1 m, convex", ConcaveHull.Config(alpha=1.0)),
        ("automatic", ConcaveHull.Config()),
    ):
        try:
            found = ConcaveHull(config).reconstruct(record)
        except InputError as error:
            findings.append(Finding(label, f"refused: {error}", "shards" in label))
            continue
        pieces, closed = count_pieces(found.mesh.faces), is_watertight(found.mesh)
        honest = found.report["watertight"] == closed and found.report["components"] == pieces
        text = f"{pieces} pieces, {'closed' if closed else 'open'}, and says so; alpha {found.report['alpha']:.3g} m"
        single = pieces == 1 if label in ("alpha 1 m, convex", "automatic") else True
        findings.append(Finding(label, text, bool(honest and single)))
    return findings


def _one_sided(quick: bool) -> list[Finding]:
    """Sparse lines of the bridge: from contact normals, from estimated ones, and from normals that were turned over."""
    solid = load_scene("bridge").solid()
    record = sample_lines(solid, 0.010)
    hull = 1e3 * mesh_error(ConvexHull().reconstruct(record).mesh, solid, LOWEST, samples=4000).mean
    rng = np.random.default_rng(38)
    turned = np.array(record.normals)
    turned[rng.random(len(turned)) < 0.05] *= -1.0
    cases: dict[str, tuple[Callable[[], Reconstruction], bool]] = {
        "contact_surface, contact normals": (lambda: ContactSurface().reconstruct(record), True),
        "contact_surface, estimated normals": (
            lambda: ContactSurface().reconstruct(replace(record, normals=None)), True,
        ),
        "contact_surface, 5 % of the normals turned over": (
            lambda: ContactSurface().reconstruct(replace(record, normals=turned)), True,
        ),
        "poisson, contact normals": (lambda: Poisson().reconstruct(record), False),
        "poisson, as in the thesis": (
            lambda: Poisson(Poisson.Config(normals="estimated")).reconstruct(record), False,
        ),
    }  # fmt: skip
    findings = []
    for label, (call, offered) in cases.items():
        try:
            found = call()
        except MissingExtraError as error:
            findings.append(Finding(label, f"not offered: {error}", True))
            continue
        except LwrprobeError as error:
            findings.append(Finding(label, f"refused: {error}", not offered))
            continue
        mean = 1e3 * mesh_error(found.mesh, solid, LOWEST, samples=4000).mean
        also = not offered or is_watertight(found.mesh)
        findings.append(within(label, "mean error, against that of the convex hull", mean, hull, "mm", also=also))
    return findings


CASES = (
    Case(36, "hull inputs", "a typed error or a result that says what it is; no crash", _hull_inputs),
    Case(37, "alpha too small or too large", "automatic alpha, watertight flag, number of pieces", _alphas),
    Case(
        38, "sparse, one-sided, flipped normals", "better than the hull on a hollow shape, or not offered", _one_sided
    ),
)
