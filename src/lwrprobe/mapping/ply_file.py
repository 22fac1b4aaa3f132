"""Stanford's PLY files: the vertices of ASCII and binary ones in, little-endian binary out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError
from lwrprobe.mapping.cloud import Cloud

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 16


def encode(cloud: Cloud) -> bytes:
    """Binary, single precision."""
    names, rows = cloud.table()
    head = ["ply", "format binary_little_endian 1.0", "comment points in metres", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in names]
    return ("\n".join([*head, "end_header"]) + "\n").encode("ascii") + rows.astype("<f4").tobytes()


def decode(path: Path, content: bytes) -> dict[str, np.ndarray]:
    """Columns of the vertices by name; other elements, where they come after, are left out."""
    lines, start = _header_lines(path, content)
    order = _order(path, lines)
    row, count = _vertex(path, lines, order)
    if lines[1].split()[1] == "ascii":
        return _ascii(path, content[start:], row, count)
    if len(content) - start < count * row.itemsize:
        wanted = f"{count * row.itemsize} for {count} vertices"
        raise FormatError(f"{path}: byte {start}: {len(content) - start} bytes of data; allowed: {wanted}")
    table = np.frombuffer(content, row, count, start)
    return {name: np.asarray(table[name], np.float64) for name in row.names or ()}


def _header_lines(path: Path, content: bytes) -> tuple[list[str], int]:
    """Lines up to `end_header`, and where the data begin."""
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    stop = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or stop == 0:
        raise FormatError(f"{path}: no header from 'ply' to 'end_header'; is it a PLY file?")
    try:
        lines = [line.strip() for line in content[:end].decode("ascii").splitlines()]
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: byte {error.start}: the header is not plain text") from None
    return [line for line in lines if not line.startswith(("comment", "obj_info"))], stop


def _order(path: Path, lines: list[str]) -> str:
    words = lines[1].split() if len(lines) > 1 else []
    if len(words) != 3 or words[0] != "format" or words[1] not in _ORDERS:
        got = lines[1][:60] if len(lines) > 1 else ""
        raise FormatError(f"{path}: after 'ply': got {got!r}; allowed: format {', '.join(_ORDERS)} 1.0")
    return _ORDERS[words[1]]


def _vertex(path: Path, lines: list[str], order: str) -> tuple[np.dtype, int]:
    """Row type and number of the vertices, which have to come first."""
    words = lines[2].split() if len(lines) > 2 else []
    number = words[2] if len(words) == 3 else ""
    if words[:2] != ["element", "vertex"] or not (number.isascii() and number.isdigit() and len(number) < 13):
        raise FormatError(f"{path}: the first element: got {' '.join(words)[:60]!r}; allowed: element vertex <count>")
    row = []
    for line in lines[3:]:
        words = line.split()
        if words[:1] == ["element"]:
            break
        if len(words) != 3 or words[0] != "property" or words[1] not in _TYPES:
            raise FormatError(f"{path}: element vertex: got {line[:60]!r}; allowed: property <type> <name>, no lists")
        row.append((words[2], order + _TYPES[words[1]]))
    try:
        return np.dtype(row), int(number)
    except ValueError:
        raise FormatError(f"{path}: element vertex: two properties of the same name") from None


def _ascii(path: Path, content: bytes, row: np.dtype, count: int) -> dict[str, np.ndarray]:
    lines, names = content.splitlines()[:count], row.names or ()
    if len(lines) < count:
        raise FormatError(f"{path}: {len(lines)} lines of data; allowed: {count}, one a vertex")
    table = np.empty((count, len(names)))
    for i, line in enumerate(lines):
        try:
            values = [float(cell) for cell in line.split()]
        except ValueError:
            raise FormatError(f"{path}: vertex {i}: got {line[:60]!r}; allowed: numbers") from None
        if len(values) != len(names):
            raise FormatError(f"{path}: vertex {i}: {len(values)} numbers; allowed: {len(names)}")
        table[i] = values
    return {name: table[:, i] for i, name in enumerate(names)}
