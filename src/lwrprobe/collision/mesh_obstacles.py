"""Known triangle meshes that the links must not touch, through python-fcl (Pan, Chitta, Manocha 2012)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import fcl
import numpy as np

from lwrprobe.collision.shape_kernels import ROTATION, TRANSLATION
from lwrprobe.contracts import Clearance, InputError, LinkShape


class MeshObstacles:
    """Links against meshes that stand still in the world.

    The library's distances between a cylinder and a mesh are iterative: expect errors of some 10 um.
    """

    def __init__(self, links: Sequence[LinkShape], meshes: Sequence[Any]) -> None:
        self._names = [link.name for link in links]
        self._bodies = [fcl.CollisionObject(_geometry(link)) for link in links]
        self._meshes = [fcl.CollisionObject(_mesh(mesh, i)) for i, mesh in enumerate(meshes)]

    def nearest(self, placed: np.ndarray, best: Clearance) -> Clearance:
        """The nearest pair with a mesh for links placed in the world (n, 17), where nearer than `best`."""
        for row, body, name in zip(placed, self._bodies, self._names):
            body.setTransform(fcl.Transform(row[ROTATION:TRANSLATION].reshape(3, 3), row[TRANSLATION:]))
            for mesh in self._meshes:
                found = _pair(body, mesh, name)
                if found.distance < best.distance:
                    best = found
        return best


def _pair(body: Any, mesh: Any, name: str) -> Clearance:
    hits = fcl.CollisionResult()
    if fcl.collide(body, mesh, fcl.CollisionRequest(enable_contact=True), hits):
        point = np.array(hits.contacts[0].pos)
        return Clearance(0.0, point, point.copy(), name)
    result = fcl.DistanceResult()
    distance = fcl.distance(body, mesh, fcl.DistanceRequest(enable_nearest_points=True), result)
    # The library names the mesh's point first, whichever body it was given first.
    on_mesh, on_robot = (np.array(point) for point in result.nearest_points)
    return Clearance(max(float(distance), 0.0), on_robot, on_mesh, name)


def _geometry(link: LinkShape) -> Any:
    if link.kind == "box":
        return fcl.Box(*link.size)
    return (fcl.Cylinder if link.kind == "cylinder" else fcl.Capsule)(*link.size)


def _mesh(mesh: Any, number: int) -> Any:
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise InputError(f"obstacles[{number}].vertices", vertices.shape, "finite metres of the shape (n, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0 or not 0 <= faces.min() <= faces.max() < len(vertices):
        raise InputError(f"obstacles[{number}].faces", faces.shape, "(m, 3) numbers of vertices, at least one face")
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return model
