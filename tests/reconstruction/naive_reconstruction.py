"""Textbook twins of the reconstruction kernels: slow, short, obviously right."""

import numpy as np


def matern(x, y, length, s2):
    a = np.sqrt(5.0) / length * np.linalg.norm(np.subtract(x, y))
    return s2 * (1.0 + a + a * a / 3.0) * np.exp(-a)


def difference(function, place, axis, step):
    unit = step * np.eye(3)[axis]
    return (function(place + unit) - function(place - unit)) / (2.0 * step)


def covariance(points, length, s2, step):
    """Values and gradients of a Matern process, by finite differences of the covariance."""
    n = len(points)
    out = np.empty((4 * n, 4 * n))

    def against(j, b):
        def function(x):
            if b == 0:
                return matern(x, points[j], length, s2)
            return difference(lambda y: matern(x, y, length, s2), points[j], b - 1, step)

        return function

    for i in range(n):
        for j in range(n):
            for a in range(4):
                for b in range(4):
                    entry = against(j, b)
                    value = entry(points[i]) if a == 0 else difference(entry, points[i], a - 1, step)
                    out[a * n + i, b * n + j] = value
    return out


def triangle_distance(a, b, c, p, fine=200):
    """Distance to a triangle by trying a fine net of its points."""
    u, v = np.meshgrid(np.linspace(0, 1, fine + 1), np.linspace(0, 1, fine + 1))
    inside = u + v <= 1.0 + 1e-12
    net = a + np.outer(u[inside], b - a) + np.outer(v[inside], c - a)
    return np.linalg.norm(net - p, axis=1).min()


def edge_uses(faces):
    """How often each directed edge is used."""
    uses = {}
    for face in np.asarray(faces).tolist():
        for a, b in zip(face, face[1:] + face[:1]):
            uses[a, b] = uses.get((a, b), 0) + 1
    return uses


def closed(faces):
    uses = edge_uses(faces)
    return bool(uses) and all(n == 1 and uses.get((b, a)) == 1 for (a, b), n in uses.items())


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def weighted_median(values, weights):
    order = np.argsort(values)
    reached = np.cumsum(np.asarray(weights)[order])
    return float(np.asarray(values)[order][np.argmax(reached >= 0.5 * reached[-1])])


def best_rulings(centres, normals, shortest, longest, cosine, offset, grow, lower, cell):
    """Score of the best ruling through each cell that has one."""
    found = {}
    for i in range(len(centres)):
        for j in range(len(centres)):
            across = centres[j] - centres[i]
            length, alike = np.linalg.norm(across), normals[i] @ normals[j]
            if i == j or not shortest <= length <= longest or alike < cosine:
                continue
            if abs(0.5 * (normals[i] + normals[j]) @ across) > offset + grow * length:
                continue
            pieces = int(np.ceil(2.0 * length / cell))
            for piece in range(1, pieces):
                place = centres[i] + piece / pieces * across
                key = tuple(((place - lower) / cell).astype(int))
                score = length * (1.0 + (1.0 - alike) / (1.0 - cosine))
                found[key] = min(score, found.get(key, np.inf))
    return found


def refuted(begin, finish, normals, points, facing, width, tolerance, radius, deep):
    """Which rulings a point beside them speaks against."""
    out = []
    for a, b, n, depth in zip(begin, finish, normals, deep):
        length = np.linalg.norm(b - a)
        unit = (b - a) / length
        along, height = (points - a) @ unit, (points - a) @ n
        beside = np.linalg.norm(points - a - np.outer(along, unit) - np.outer(height, n), axis=1)
        near = beside <= np.minimum(width, np.minimum(along, length - along))
        if len(facing):
            alike = facing @ n
            against = height[near & (alike < -0.3)]  # faces towards the ruling: what lies beyond says nothing
            above, below = against[against > 0.0].min(initial=np.inf), -against[against <= 0.0].max(initial=-depth)
            over_edge = (-tolerance - 2.0 * radius * (1.0 - alike) <= height) & (height < 0.0)
            near &= (alike > 0.3) & (np.abs(height) > tolerance) & ~over_edge & (height > -below) & (height < above)
        else:
            near &= (-depth < height) & (height < -tolerance)
        wrong = near.any()
        out.append(wrong)
    return np.array(out)


def supported(claims, alike, points, normals, weight, reach):
    """Which claims at least a quarter of the weight beside them shares, and 1.5 in all."""
    out = np.zeros(len(points), bool)
    for i in np.flatnonzero(claims):
        same_side = (np.linalg.norm(points - points[i], axis=1) <= reach) & (normals @ normals[i] > 0.8)
        sharing, total = weight[same_side & alike].sum(), weight[same_side].sum()
        out[i] = sharing >= 1.5 and sharing >= 0.25 * total
    return out
