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
