"""The Point Cloud Library's PCD files, version 0.7: ASCII, binary and compressed binary in, ASCII out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError
from lwrprobe.mapping.cloud import Cloud
from lwrprobe.mapping.cloud_kernels import expand_lzf

VIEWPOINT = "0 0 0 0 0 0 1"
"""As OctoMap's octree2pointcloud writes it; PCL's own files say 0 0 0 1 0 0 0. Neither is used here."""

_NORMALS = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
_TYPES = {
    f"{kind}{size}": f"<{kind.lower()}{size}" for kind in "IUF" for size in (1, 2, 4, 8) if kind + str(size) != "F1"
}
_LONGEST_HEADER = 1 << 16
_MAX_GROWTH = 88  # LZF: three bytes stand for 264 at most


@dataclass(slots=True)
class _Header:
    row: np.dtype
    points: int
    data: str
    start: int
    lines: int

    @property
    def names(self) -> tuple[str, ...]:
        return self.row.names or ()

    def count(self, name: str) -> int:
        """Values of a field."""
        return math.prod(self.row[name].shape)


def encode(cloud: Cloud) -> bytes:
    """ASCII, as octree2pointcloud writes it."""
    names, rows = cloud.table()
    count = len(names)
    head = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(_NORMALS.get(name, name) for name in names),
        "SIZE" + " 4" * count,
        "TYPE" + " F" * count,
        "COUNT" + " 1" * count,
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        f"VIEWPOINT {VIEWPOINT}",
        f"POINTS {len(rows)}",
        "DATA ascii",
    ]
    form = " ".join(["%.9g"] * count)
    return ("\n".join(head + [form % tuple(row) for row in rows.tolist()]) + "\n").encode("ascii")


def decode(path: Path, content: bytes) -> dict[str, np.ndarray]:
    """Columns by name; padding and fields of several values are left out."""
    header = _header(path, content)
    columns = _READERS[header.data](path, content, header)
    names = [name for name in header.names if header.row[name].shape == () and not name.startswith("_")]
    return {name: np.asarray(columns[name], np.float64) for name in names}


def _header(path: Path, content: bytes) -> _Header:
    fields: dict[str, list[str]] = {}
    start, lines = 0, 0
    while "DATA" not in fields:
        end = content.find(b"\n", start, _LONGEST_HEADER)
        if end < 0:
            raise FormatError(f"{path}: no line DATA in the first {_LONGEST_HEADER} bytes; is it a PCD file?")
        lines += 1
        try:
            words = content[start:end].decode("ascii").split()
        except UnicodeDecodeError:
            raise FormatError(f"{path}: line {lines}: the header is not plain text") from None
        start = end + 1
        if words and not words[0].startswith("#"):
            fields[words[0].upper()] = words[1:]
    return _checked(path, fields, start, lines)


def _checked(path: Path, fields: dict[str, list[str]], start: int, lines: int) -> _Header:
    names = fields.get("FIELDS", fields.get("COLUMNS", []))
    width, height = _number(path, fields, "WIDTH"), _number(path, fields, "HEIGHT")
    points = _number(path, fields, "POINTS") if "POINTS" in fields else width * height
    if points != width * height:
        raise FormatError(f"{path}: POINTS {points}; allowed: WIDTH x HEIGHT, {width * height}")
    data = " ".join(fields["DATA"])
    if data not in ("ascii", "binary", "binary_compressed"):
        raise FormatError(f"{path}: DATA: got {data[:40]!r}; allowed: ascii, binary, binary_compressed")
    return _Header(_row(path, fields, names), points, data, start, lines)


def _row(path: Path, fields: dict[str, list[str]], names: list[str]) -> np.dtype:
    sizes, kinds = fields.get("SIZE", []), fields.get("TYPE", [])
    counts = fields.get("COUNT", ["1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts) > 0:
        raise FormatError(f"{path}: FIELDS, SIZE, TYPE, COUNT: not one entry each for every field")
    row = []
    for i, (name, size, kind, count) in enumerate(zip(names, sizes, kinds, counts)):
        if kind.upper() + size not in _TYPES:
            raise FormatError(
                f"{path}: field {name[:40]!r}: TYPE {kind} SIZE {size}; allowed: I, U, F of 1, 2, 4, 8 bytes"
            )
        if not (count.isascii() and count.isdigit() and 1 <= int(count[:8]) <= 4096):
            raise FormatError(f"{path}: field {name[:40]!r}: COUNT {count[:40]}; allowed: 1 to 4096")
        shape = () if int(count) == 1 else (int(count),)
        row.append((f"_{i}" if name == "_" else name, _TYPES[kind.upper() + size], shape))
    try:
        return np.dtype(row)
    except ValueError:
        raise FormatError(f"{path}: FIELDS {' '.join(names)[:80]}; allowed: distinct names") from None


def _number(path: Path, fields: dict[str, list[str]], name: str) -> int:
    text = " ".join(fields.get(name, []))
    if not (text.isascii() and text.isdigit() and len(text) < 13):
        raise FormatError(f"{path}: {name}: got {text[:40]!r}; allowed: a whole number")
    return int(text)


def _ascii(path: Path, content: bytes, header: _Header) -> dict[str, np.ndarray]:
    places = sum(header.count(name) for name in header.names)
    rows = []
    for number, line in enumerate(content[header.start :].splitlines(), start=header.lines + 1):
        cells = line.split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise FormatError(f"{path}: line {number}: got {line[:60]!r}; allowed: numbers") from None
        if len(row) != places:
            raise FormatError(f"{path}: line {number}: {len(row)} numbers; allowed: {places}")
        rows.append(row)
    if len(rows) != header.points:
        raise FormatError(f"{path}: POINTS {header.points}, but {len(rows)} lines of data")
    table = np.array(rows, np.float64).reshape(-1, places)
    columns, at = {}, 0
    for name in header.names:
        columns[name] = table[:, at]
        at += header.count(name)
    return columns


def _binary(path: Path, content: bytes, header: _Header) -> np.ndarray:
    wanted, there = header.points * header.row.itemsize, len(content) - header.start
    if there < wanted:
        raise FormatError(
            f"{path}: byte {header.start}: {there} bytes of data; allowed: {wanted} for {header.points} points"
        )
    return np.frombuffer(content, header.row, header.points, header.start)


def _compressed(path: Path, content: bytes, header: _Header) -> dict[str, np.ndarray]:
    sizes = np.frombuffer(content[header.start : header.start + 8].ljust(8, b"\0"), "<u4")
    packed_size, plain_size = int(sizes[0]), int(sizes[1])
    packed = np.frombuffer(content, np.uint8, offset=header.start)[8 : 8 + packed_size]
    if len(packed) != packed_size:
        raise FormatError(f"{path}: byte {header.start}: {len(packed)} compressed bytes; allowed: {packed_size}")
    if plain_size != header.points * header.row.itemsize or plain_size > _MAX_GROWTH * packed_size:
        raise FormatError(
            f"{path}: byte {header.start + 4}: {plain_size} bytes unpacked do not fit {header.points} points"
        )
    plain = np.empty(plain_size, np.uint8)
    if expand_lzf(packed, plain) != plain_size:
        raise FormatError(f"{path}: byte {header.start + 8}: the compressed data are broken")
    columns, at = {}, 0
    for name in header.names:
        kind = header.row[name]
        columns[name] = plain[at : at + header.points * kind.itemsize].view(kind.base)
        at += header.points * kind.itemsize
    return columns


_READERS: dict[str, Callable[[Path, bytes, _Header], dict[str, np.ndarray] | np.ndarray]] = {
    "ascii": _ascii,
    "binary": _binary,
    "binary_compressed": _compressed,
}
