"""Obviously right twins of the map's kernels."""

from __future__ import annotations

import struct

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
