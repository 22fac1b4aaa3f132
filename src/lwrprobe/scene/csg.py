"""From nested shapes to surfaces: every primitive becomes an intersection of smooth surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import SceneError
from lwrprobe.scene import program
from lwrprobe.scene.shape import (
    Blend,
    Box,
    Capsule,
    Cylinder,
    Difference,
    HalfSpace,
    Intersection,
    Shape,
    Sphere,
    Union,
)

Primitive = tuple[list["Surface"], np.ndarray, np.ndarray]
"""Surfaces whose intersection it is, lower and upper corner (3,) m of its box."""

_DEEPEST = 32  # of the tree's stack in the kernels


@dataclass(slots=True)
class Surface:
    """One smooth surface in the world frame; see `program` for what a, u, r, l mean of each kind."""

    kind: int
    part: int
    a: np.ndarray
    u: np.ndarray = field(default_factory=lambda: np.zeros(3))
    r: float = 0.0
    l: float = 0.0  # noqa: E741
    balls: np.ndarray = field(default_factory=lambda: np.empty((0, program.BALL_NUMBERS)))


@dataclass(slots=True)
class Group:
    """A primitive: the intersection of consecutive surfaces, with the box that holds it."""

    first: int
    last: int
    lower: np.ndarray
    upper: np.ndarray


@dataclass(slots=True)
class Composite:
    """An operation on nodes, with the box that holds the outcome."""

    operation: int
    nodes: list[Group | Composite]
    lower: np.ndarray = field(init=False)
    upper: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        lowers, uppers = [n.lower for n in self.nodes], [n.upper for n in self.nodes]
        if self.operation == program.UNION:
            self.lower, self.upper = np.min(lowers, axis=0), np.max(uppers, axis=0)
        elif self.operation == program.INTERSECTION:
            self.lower, self.upper = np.max(lowers, axis=0), np.min(uppers, axis=0)
        else:
            self.lower, self.upper = lowers[0], uppers[0]


Node = Group | Composite

_OPERATIONS = {"union": program.UNION, "intersection": program.INTERSECTION, "difference": program.DIFFERENCE}


class Flattener:
    """Collects the surfaces and groups of shapes, object by object."""

    def __init__(self) -> None:
        self.surfaces: list[Surface] = []
        self.groups: list[Group] = []

    def node(self, shape: Shape, part: int, frame: np.ndarray) -> Node:
        """The tree below one shape, whose parent's frame is `frame` (4, 4); `part` is the object's index."""
        frame = frame @ shape.at.matrix()
        if isinstance(shape, Union | Intersection | Difference):
            nodes = [self.node(child, part, frame) for child in shape.children]
            return Composite(_OPERATIONS[shape.shape], nodes)
        surfaces, lower, upper = _primitive(shape, part, frame)
        group = Group(len(self.surfaces), len(self.surfaces) + len(surfaces), lower, upper)
        self.surfaces += surfaces
        self.groups.append(group)
        return group


def tree_rows(node: Node) -> np.ndarray:
    """Reverse Polish rows of a tree; raises SceneError when it is nested too deeply."""
    rows: list[tuple[int, int, int]] = []
    depth, deepest = 0, 0
    for row in _polish(node):
        rows.append(row)
        depth += 1 if row[0] == program.GROUP else -1
        deepest = max(deepest, depth)
    if deepest > _DEEPEST:
        raise SceneError("object", f"{deepest} levels of shapes", f"at most {_DEEPEST} levels")
    return np.array(rows, dtype=np.int64).reshape(-1, program.TREE_INDICES)


def step_rows(node: Node) -> np.ndarray:
    """The decision steps of membership; the first row is where to begin."""
    rows: list[tuple[int, int, int]] = []
    _steps(node, rows, program.INSIDE, program.OUTSIDE)
    # Built from the end backwards, so that each step's successors exist: turn it round.
    last = len(rows) - 1
    turned = [(k, *(t if t < 0 else last - t for t in ends)) for k, *ends in reversed(rows)]
    return np.array(turned, dtype=np.int64).reshape(-1, program.STEP_INDICES)


def _polish(node: Node) -> Iterator[tuple[int, int, int]]:
    if isinstance(node, Group):
        yield program.GROUP, node.first, node.last
        return
    for i, child in enumerate(node.nodes):
        yield from _polish(child)
        if i:
            yield node.operation, 0, 0


def _steps(node: Node, rows: list, inside: int, outside: int) -> int:
    """Append the steps of a node, given where to go when decided; returns its entry."""
    if isinstance(node, Group):
        entry = inside
        for k in range(node.last - 1, node.first - 1, -1):
            rows.append((k, entry, outside))
            entry = len(rows) - 1
        return entry
    if node.operation == program.UNION:
        entry = outside
        for child in reversed(node.nodes):
            entry = _steps(child, rows, inside, entry)
        return entry
    entry = inside
    for i in range(len(node.nodes) - 1, -1, -1):
        taken_away = node.operation == program.DIFFERENCE and i > 0
        entry = _steps(node.nodes[i], rows, outside if taken_away else entry, entry if taken_away else outside)
    return entry


def _primitive(shape: Shape, part: int, frame: np.ndarray) -> Primitive:
    match shape:
        case Box():
            return _box(shape, part, frame)
        case Cylinder():
            return _cylinder(shape, part, frame)
        case Sphere():
            return _sphere(shape, part, frame)
        case Capsule():
            return _capsule(shape, part, frame)
        case HalfSpace():
            return _half_space(shape, part, frame)
        case Blend():
            return _blend(shape, part, frame)
    raise SceneError("object", shape.shape, "a shape with exact surfaces; meshes are bodies of their own")


def _box(shape: Box, part: int, frame: np.ndarray) -> Primitive:
    half = 0.5 * np.array(shape.size)
    rotation, centre = frame[:3, :3], frame[:3, 3]
    surfaces = [
        Surface(program.PLANE, part, centre + sign * half[axis] * rotation[:, axis], sign * rotation[:, axis])
        for axis in range(3)
        for sign in (-1.0, 1.0)
    ]
    reach = np.abs(rotation) @ half
    return surfaces, centre - reach, centre + reach


def _cylinder(shape: Cylinder, part: int, frame: np.ndarray) -> Primitive:
    axis, centre, half = frame[:3, 2], frame[:3, 3], 0.5 * shape.length
    surfaces = [
        Surface(program.CYLINDER, part, centre.copy(), axis.copy(), shape.radius),
        Surface(program.PLANE, part, centre - half * axis, -axis),
        Surface(program.PLANE, part, centre + half * axis, axis.copy()),
    ]
    reach = half * np.abs(axis) + shape.radius * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
    return surfaces, centre - reach, centre + reach


def _sphere(shape: Sphere, part: int, frame: np.ndarray) -> Primitive:
    centre = frame[:3, 3]
    return [Surface(program.SPHERE, part, centre, r=shape.radius)], centre - shape.radius, centre + shape.radius


def _capsule(shape: Capsule, part: int, frame: np.ndarray) -> Primitive:
    axis, half = frame[:3, 2], 0.5 * shape.length
    ends = frame[:3, 3] - half * axis, frame[:3, 3] + half * axis
    surface = Surface(program.CAPSULE, part, ends[0], axis.copy(), shape.radius, shape.length)
    return [surface], np.minimum(*ends) - shape.radius, np.maximum(*ends) + shape.radius


def _half_space(shape: HalfSpace, part: int, frame: np.ndarray) -> Primitive:
    normal, point = frame[:3, 2], frame[:3, 3]
    lower, upper = np.full(3, -np.inf), np.full(3, np.inf)
    for axis in range(3):
        if normal[axis] > 1.0 - 1e-12:
            upper[axis] = point[axis]
        elif normal[axis] < -1.0 + 1e-12:
            lower[axis] = point[axis]
    return [Surface(program.PLANE, part, point.copy(), normal.copy())], lower, upper


def _blend(shape: Blend, part: int, frame: np.ndarray) -> Primitive:
    rows = [(*_moved(b.centre, frame), b.radius, 1.0) for b in shape.balls]
    rows += [(*_moved(b.centre, frame), b.radius, -1.0) for b in shape.hollows]
    balls = np.array(rows)
    solid = balls[: len(shape.balls)]
    # The soft minimum of n equal values lies k log n below them: the blend swells by no more than that.
    reach = solid[:, 3:4] + shape.smoothing * np.log(len(solid))
    surface = Surface(program.BLEND, part, solid[:, :3].mean(axis=0), r=shape.smoothing, balls=balls)
    return [surface], (solid[:, :3] - reach).min(axis=0), (solid[:, :3] + reach).max(axis=0)


def _moved(point: tuple[float, float, float], frame: np.ndarray) -> np.ndarray:
    return frame[:3, :3] @ np.array(point) + frame[:3, 3]
