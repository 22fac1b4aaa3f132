"""Obviously right twins of the solid's kernels: recursive membership, and a boundary sampled densely.

Nothing here knows of edges, steps or nearest points: the boundary is what a fine net on each primitive leaves after
membership just outside and just inside of it is asked.
"""

from __future__ import annotations

import numpy as np


def contains(shape, points, frame=None):
    """(n,) membership of points (n, 3) in a shape model, by definition."""
    frame = (np.eye(4) if frame is None else frame) @ shape.at.matrix()
    if shape.shape in ("union", "intersection", "difference"):
        inside = [contains(child, points, frame) for child in shape.children]
        if shape.shape == "union":
            return np.any(inside, axis=0)
        if shape.shape == "intersection":
            return np.all(inside, axis=0)
        return inside[0] & ~np.any(inside[1:], axis=0)
    p = (points - frame[:3, 3]) @ frame[:3, :3]
    if shape.shape == "box":
        return (np.abs(p) <= np.array(shape.size) / 2).all(axis=1)
    if shape.shape == "cylinder":
        return (np.hypot(p[:, 0], p[:, 1]) <= shape.radius) & (np.abs(p[:, 2]) <= shape.length / 2)
    if shape.shape == "sphere":
        return np.linalg.norm(p, axis=1) <= shape.radius
    if shape.shape == "capsule":
        held = np.clip(p[:, 2], -shape.length / 2, shape.length / 2)
        return np.hypot(np.hypot(p[:, 0], p[:, 1]), p[:, 2] - held) <= shape.radius
    if shape.shape == "half_space":
        return p[:, 2] <= 0.0
    return blend(shape, p) <= 0.0


def blend(shape, p):
    """The blend's formula, as its documentation gives it."""
    k = shape.smoothing

    def distance(ball):
        return np.linalg.norm(p - np.array(ball.centre), axis=1) - ball.radius

    s = -k * np.log(np.sum([np.exp(-distance(b) / k) for b in shape.balls], axis=0))
    if shape.hollows:
        s = k * np.log(np.exp(s / k) + np.sum([np.exp(-distance(b) / k) for b in shape.hollows], axis=0))
    return s


def boundary(shapes, spacing):
    """(n, 3) points on the boundary of the union of shapes, about `spacing` apart, and outward normals (n, 3)."""

    def inside(points):
        return np.any([contains(s, points) for s in shapes], axis=0)

    points, normals = [], []
    for shape in shapes:
        for p, n in _nets(shape, spacing, np.eye(4)):
            above, below = inside(p + 1e-9 * n), inside(p - 1e-9 * n)
            points += [p[above != below]]
            normals += [np.where(above[:, None], -n, n)[above != below]]
    return np.concatenate(points), np.concatenate(normals)


def _nets(shape, h, frame):
    frame = frame @ shape.at.matrix()
    if shape.shape in ("union", "intersection", "difference"):
        for child in shape.children:
            yield from _nets(child, h, frame)
        return
    for p, n in _primitive_nets(shape, h):
        yield p @ frame[:3, :3].T + frame[:3, 3], n @ frame[:3, :3].T


def _grid(*spans_and_h):
    *spans, h = spans_and_h
    axes = [np.linspace(a, b, max(int(np.ceil((b - a) / h)), 1) + 1) for a, b in spans]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(spans))


def _primitive_nets(shape, h):
    if shape.shape == "box":
        half = np.array(shape.size) / 2
        for axis in range(3):
            others = [a for a in range(3) if a != axis]
            flat = _grid(*((-half[a], half[a]) for a in others), h)
            for sign in (-1.0, 1.0):
                p = np.empty((len(flat), 3))
                p[:, others], p[:, axis] = flat, sign * half[axis]
                n = np.zeros_like(p)
                n[:, axis] = sign
                yield p, n
    elif shape.shape == "half_space":
        flat = _grid((-0.12, 0.12), (-0.12, 0.12), h)
        p = np.column_stack([flat, np.zeros(len(flat))])
        yield p, np.tile([0.0, 0.0, 1.0], (len(p), 1))
    elif shape.shape == "cylinder":
        r, half = shape.radius, shape.length / 2
        g = _grid((0, 2 * np.pi * r), (-half, half), h)
        n = np.column_stack([np.cos(g[:, 0] / r), np.sin(g[:, 0] / r), np.zeros(len(g))])
        yield r * n + np.outer(g[:, 1], [0, 0, 1]), n
        flat = _grid((-r, r), (-r, r), h)
        rim = np.column_stack([r * np.cos(g[:, 0] / r), r * np.sin(g[:, 0] / r)])
        flat = np.concatenate([flat[np.hypot(*flat.T) <= r], rim])
        for sign in (-1.0, 1.0):
            yield np.column_stack([flat, np.full(len(flat), sign * half)]), np.tile([0, 0, sign], (len(flat), 1))
    elif shape.shape in ("sphere", "capsule"):
        r, half = shape.radius, getattr(shape, "length", 0.0) / 2
        tilt = _grid((0, np.pi * r), h)[:, 0] / r
        for t in tilt:
            turn = _grid((0, 2 * np.pi * r * max(np.sin(t), h / r)), h)[:, 0] / (r * max(np.sin(t), h / r))
            n = np.column_stack([np.sin(t) * np.cos(turn), np.sin(t) * np.sin(turn), np.full(len(turn), np.cos(t))])
            yield r * n + np.outer(np.full(len(n), half if t <= np.pi / 2 else -half), [0, 0, 1]), n
        if half:
            g = _grid((0, 2 * np.pi * r), (-half, half), h)
            n = np.column_stack([np.cos(g[:, 0] / r), np.sin(g[:, 0] / r), np.zeros(len(g))])
            yield r * n + np.outer(g[:, 1], [0, 0, 1]), n
    else:
        yield _blend_net(shape, h)


def _blend_net(shape, h):
    """Along rays from the middle of the balls: the last crossing outwards, found by bisection."""
    middle = np.mean([b.centre for b in shape.balls], axis=0)
    reach = 0.15
    n = int(4 * np.pi * 0.03**2 / h**2)
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    turn = np.pi * (1 + 5**0.5) * k
    ray = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    low, high = np.zeros(n), np.full(n, reach)
    for _ in range(60):
        half = (low + high) / 2
        inside = blend(shape, middle + half[:, None] * ray) <= 0
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    p = middle + low[:, None] * ray
    step = 1e-6
    n = np.column_stack([(blend(shape, p + d) - blend(shape, p - d)) / (2 * step) for d in step * np.eye(3)])
    return p, n / np.linalg.norm(n, axis=1, keepdims=True)


def minima(shapes, points, tree, centre, radius, spacing):
    """(k, 3) samples nearer to `centre` than all samples around them, seen from outside, within `radius`.

    points (n, 3) are `boundary` samples, `tree` a KD-tree of them. Samples next to an inner edge that the net lost are
    told by the solid beginning at once on the way to the centre.
    """
    from scipy.spatial import cKDTree

    p = points[tree.query_ball_point(centre, radius)]
    if not len(p):
        return p
    distance = np.linalg.norm(p - centre, axis=1)
    around = cKDTree(p).query_ball_point(p, 1.6 * spacing)
    lowest = np.array([distance[i] <= distance[n].min() + 1e-12 for i, n in enumerate(around)])
    p, distance = p[lowest], distance[lowest]
    ahead = p + 1e-5 * (centre - p) / distance[:, None]
    return p[~np.any([contains(s, ahead) for s in shapes], axis=0)]


def is_local_minimum(shapes, point, centre, rng, reach=1e-5):
    """Whether no part of the solid within `reach` of a boundary point is nearer to the centre, by random sampling."""
    q = point + rng.uniform(-reach, reach, (1000, 3))
    inside = np.any([contains(s, q) for s in shapes], axis=0)
    return bool((np.linalg.norm(q[inside] - centre, axis=1) >= np.linalg.norm(point - centre) - 1e-8).all())
