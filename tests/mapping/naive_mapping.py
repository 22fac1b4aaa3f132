"""Obviously right twins of the map's kernels."""

from __future__ import annotations

import struct
from itertools import product

import numpy as np

HALF = 32768


def keys(points, edge):
    """OctoMap's keys of (n, 3) points."""
    return np.floor(np.asarray(points) * (1.0 / edge)).astype(int) + HALF


def centres(cells, edge):
    return (np.asarray(cells) - HALF + 0.5) * edge


def nearest(cells, edge, point):
    """Distance to the nearest of all voxel centres."""
    return np.linalg.norm(centres(cells, edge) - point, axis=1).min()


def distance_to_segment(points, begin, end):
    displacement = end - begin
    length2 = displacement @ displacement
    t = np.clip((points - begin) @ displacement / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(points))
    return np.linalg.norm(points - begin - t[:, None] * displacement, axis=1)


def swept(begin, end, radius, edge):
    """Keys of all voxels with all eight corners in the capsule."""
    low, high = keys([np.minimum(begin, end) - radius, np.maximum(begin, end) + radius], edge)
    cells = np.stack(np.meshgrid(*[np.arange(a, b + 1) for a, b in zip(low, high)], indexing="ij"), -1).reshape(-1, 3)
    corners = [[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    inside = np.ones(len(cells), bool)
    for corner in np.array(corners) * edge:
        inside &= distance_to_segment(centres(cells, edge) + corner, begin, end) <= radius
    return {tuple(cell) for cell in cells[inside]}


def pack_lzf(plain):
    """A plain LZF packer: the longest copy from the last 8191 bytes where there is one, else literals."""
    out, run, at = bytearray(), bytearray(), 0
    while at < len(plain):
        best, back = 0, 0
        for start in range(max(0, at - 200), at):
            length = 0
            while length < 264 and at + length < len(plain) and plain[start + length] == plain[at + length]:
                length += 1
            if length > best:
                best, back = length, at - start - 1
        if best < 3:
            run.append(plain[at])
            at += 1
        if run and (best >= 3 or len(run) == 32 or at == len(plain)):
            out += bytes([len(run) - 1]) + run
            run = bytearray()
        if best >= 3:
            short = min(best - 2, 7)
            out.append(short << 5 | back >> 8)
            if short == 7:
                out.append(best - 2 - 7)
            out.append(back & 0xFF)
            at += best
    return bytes(out)


def pcd(fields, data, rows):
    """A PCD file from [(name, type letter, size)] and (n, fields) rows."""
    head = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
    head += "FIELDS " + " ".join(name for name, _, _ in fields) + "\n"
    head += "SIZE " + " ".join(str(size) for _, _, size in fields) + "\n"
    head += "TYPE " + " ".join(kind for _, kind, _ in fields) + "\n"
    head += "COUNT " + " ".join("1" for _ in fields) + "\n"
    head += f"WIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\nDATA {data}\n"
    columns = [
        np.asarray([row[i] for row in rows], f"<{kind.lower()}{size}") for i, (_, kind, size) in enumerate(fields)
    ]
    if data == "ascii":
        return (head + "".join(" ".join(map(str, row)) + "\n" for row in rows)).encode()
    if data == "binary":
        return head.encode() + b"".join(column[i].tobytes() for i in range(len(rows)) for column in columns)
    plain = b"".join(column.tobytes() for column in columns)
    packed = pack_lzf(plain)
    return head.encode() + struct.pack("<II", len(packed), len(plain)) + packed


def lowered_to_path(points, start, centres, joined, radius):
    """`start` or the distance of points (n, 3) from a sphere along centres, where that is smaller."""
    values = np.full(len(points), start)
    for row, centre in enumerate(centres):
        before = centres[row - 1] if row and joined[row] else centre
        way = centre - before
        length2 = way @ way
        share = np.clip((points - before) @ way / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(points))
        values = np.minimum(values, np.linalg.norm(points - before - share[:, None] * way, axis=1) - radius)
    return values


def distance_to_links(points, poses, kind, size):
    """(n,) distance of points (n, 3) from the nearest of a link's poses (k, 4, 4), 0 inside."""
    values = np.full(len(points), np.inf)
    for pose in poses:
        own = (points - pose[:3, 3]) @ pose[:3, :3]
        if kind == "box":
            distance = np.linalg.norm(np.maximum(np.abs(own) - 0.5 * np.asarray(size), 0.0), axis=1)
        else:
            along = np.maximum(np.abs(own[:, 2]) - 0.5 * size[1], 0.0)
            across = np.hypot(own[:, 0], own[:, 1])
            if kind == "capsule":
                distance = np.maximum(np.hypot(across, along) - size[0], 0.0)
            else:
                distance = np.hypot(np.maximum(across - size[0], 0.0), along)
        values = np.minimum(values, distance)
    return values


def nearest_middle(point, contacts, cover):
    """How near a middle may lie that keeps a distance from contacts (n, 3), by many directions from a point (3,)."""
    count = 400_000
    up = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    around = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    level = np.sqrt(1.0 - up * up)
    directions = np.column_stack([level * np.cos(around), level * np.sin(around), up])
    farthest = np.zeros(count)
    for contact in contacts - point:
        square = contact @ contact
        if square < cover * cover:
            along = directions @ contact
            farthest = np.maximum(farthest, along + np.sqrt(along * along - square + cover * cover))
    return farthest.min()


class ConvexObject:
    """A block or an upright cylinder on the table, and the path of a perfect sphere over it."""

    def __init__(self, half, height, angle, place, round_):
        self.half, self.height, self.place, self.round = half, height, place, round_
        self.turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    @classmethod
    def random(cls, rng):
        half = rng.uniform(0.006, 0.016, 2)
        return cls(
            half, rng.uniform(0.01, 0.024), rng.uniform(0.0, 3.0), rng.uniform(-0.006, 0.006, 2), rng.random() < 0.4
        )

    def distance(self, points):
        """(n,) m, negative inside."""
        flat = (points[:, :2] - self.place) @ self.turn
        if self.round:
            sides = [np.hypot(*flat.T) - self.half[0]]
        else:
            sides = [np.abs(flat[:, i]) - self.half[i] for i in range(2)]
        beyond = np.column_stack([*sides, points[:, 2] - self.height])
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)

    def gradient(self, points):
        """(n, 3) of the distance."""
        step = 1e-6
        rises = [self.distance(points + step * axis) - self.distance(points - step * axis) for axis in np.eye(3)]
        return np.column_stack(rises) / (2.0 * step)

    def raster(self, area, radius, pitch, skip, rng):
        """Centres, close together, of a sphere on lines along y and along x, and what they touch.

        With `skip` some lines are left out. Above each line the sphere also sweeps what is free, every 3 mm.
        """
        lines = np.arange(area.lower[0], area.upper[0] + 1e-9, pitch)
        along = np.arange(area.lower[1], area.upper[1] + 1e-9, 0.0005)
        centres, touched = [], []
        for axis in (0, 1):
            for line in lines[rng.random(len(lines)) < 0.7] if skip else lines:
                plane = np.empty((len(along), 2))
                plane[:, axis], plane[:, 1 - axis] = line, along
                heights = np.arange(area.lower[2], area.upper[2] + 1e-9, 0.0005)
                points = np.column_stack([np.repeat(plane, len(heights), axis=0), np.tile(heights, len(along))])
                gap = self.distance(points) - radius
                free = gap >= 0.0
                grid = free.reshape(len(along), -1)
                lowest = len(heights) - np.argmin(grid[:, ::-1], axis=1)
                lowest[grid.all(axis=1)] = 0
                on = [k * len(heights) + i for k, i in enumerate(lowest) if i < len(heights)]
                centres.append(points[on])
                wall = free & (gap < 0.0005)
                centres.append(points.reshape(*grid.shape, 3)[::6, ::6][grid[::6, ::6]])
                centres.append(points[wall])
                touched.append(points[wall])
        centres, touching = np.vstack(centres), np.vstack(touched)
        return centres, self.nearest(touching)

    def nearest(self, points):
        """(n, 3) on the surface, by steps down the distance."""
        eps = 1e-7
        found = points.copy()
        for _ in range(3):
            base = self.distance(found)
            slope = np.column_stack([(self.distance(found + eps * np.eye(3)[i]) - base) / eps for i in range(3)])
            found = found - base[:, None] * slope
        return found


def distances(marked, edge):
    """From each grid point to the nearest one that is not marked: all pairs."""
    free = np.argwhere(~marked)
    if not len(free):
        return np.full(marked.shape, np.inf)
    points = np.argwhere(np.ones(marked.shape, bool))
    squares = ((points[:, None] - free[None]) ** 2).sum(axis=2)
    return edge * np.sqrt(squares.min(axis=1)).reshape(marked.shape)


def squares_under(points, pose, low, cell, shape, top):
    """Row and column of the square under each point of a body below the top, or of the nearest one; and its height."""
    for point in points:
        x, y, z = pose[:3, :3] @ point + pose[:3, 3]
        if z >= top:
            continue
        i, j = round((x - low[0]) / cell), round((y - low[1]) / cell)
        yield min(max(i, 0), shape[0] - 1), min(max(j, 0), shape[1] - 1), z


def body_depth(points, pose, heights, low, cell, top):
    """How far a body reaches below what is under it."""
    under = squares_under(points, pose, low, cell, heights.shape, top)
    return max((heights[i, j] - z for i, j, z in under), default=-np.inf)


def body_was(points, poses, shape, low, cell, top):
    """The least height of the body over each square that is not on the border."""
    lowest = np.full(shape, np.inf)
    for pose in poses:
        for i, j, z in squares_under(points, pose, low, cell, shape, top):
            if 0 < i < shape[0] - 1 and 0 < j < shape[1] - 1:
                lowest[i, j] = min(lowest[i, j], z)
    return lowest


def in_window(window, shape):
    """Rows and columns of the squares in a window."""
    i, end_i, j, end_j = window
    return [(row, column) for row in range(i, min(end_i, shape[0])) for column in range(j, min(end_j, shape[1]))]


class SweptColumns:
    """Of each square the two upper spans of height that were swept, as lists; square by square."""

    def __init__(self, shape, half):
        self.half, self.spans = half, {at: [] for at in np.ndindex(shape)}

    def note(self, at, height):
        around = len(self.half) // 2
        for square, spans in self.spans.items():
            row, column = np.array(square) - at + around
            if not (0 <= row < len(self.half) and 0 <= column < len(self.half) and self.half[row, column] > 0.0):
                continue
            low, high = height - self.half[row, column], height + self.half[row, column]
            touching = [span for span in spans if span[0] <= high and span[1] >= low]
            if not touching and len(spans) == 2:
                spans.remove(min(spans))
            for span in touching:
                low, high = min(low, span[0]), max(high, span[1])
                spans.remove(span)
            spans.append((low, high))

    def free_from(self, above):
        found = above.copy()
        for square, spans in self.spans.items():
            for low, high in sorted(spans, reverse=True):
                if high >= found[square]:
                    found[square] = min(found[square], low)
        return found


def bridged(heights, known, touched, hidden):
    """The heights where known, and between two known squares in a row the tallest beside either; square by square."""
    found = _bridged(heights, known, touched, hidden, False)
    return _bridged(found, found < np.inf, touched, hidden, True)


def _bridged(heights, known, touched, hidden, nearest):
    found = np.where(known, heights, np.inf)
    for flip in (False, True):
        seen, good, met, out = (array.T if flip else array for array in (heights, known, touched, found))
        for at, across in np.ndindex(out.shape):
            rows = np.flatnonzero(good[:, across])
            for begin, end in product(rows[rows < at], rows[rows > at]):
                gap = int(end - begin)
                if gap >= len(hidden) or met[begin + 1 : end, across].any():
                    continue
                if nearest and good[begin + 1 : end, across].any():
                    continue
                half = (gap + 1) // 2
                near = np.s_[[begin, end], max(across - half, 0) : across + half + 1]
                tall = max(seen[near][good[near]])
                tall += hidden[gap] if met[[begin, end], across].any() else 0.0
                out[at, across] = min(out[at, across], tall)
    return found
