"""Comma-separated columns under a line of names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError
from lwrprobe.mapping.cloud import Cloud


def encode(cloud: Cloud) -> bytes:
    """Every digit of every number."""
    names, rows = cloud.table()
    lines = [",".join(names)]
    lines += [",".join(map(repr, row)) for row in rows.tolist()]
    return ("\n".join(lines) + "\n").encode()


def decode(path: Path, content: bytes) -> dict[str, np.ndarray]:
    """Columns by name."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: byte {error.start}: not plain text") from None
    names = [name.strip() for name in lines[0].split(",")] if lines else [""]
    if len(set(names)) != len(names) or "" in names:
        raise FormatError(f"{path}: line 1: got {', '.join(names)[:80]!r}; allowed: one distinct name a column")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        try:
            row = [float(cell) for cell in line.split(",")]
        except ValueError:
            raise FormatError(f"{path}: line {number}: got {line[:60]!r}; allowed: numbers") from None
        if len(row) != len(names):
            raise FormatError(f"{path}: line {number}: {len(row)} numbers; allowed: {len(names)}, one a column")
        rows.append(row)
    table = np.array(rows, np.float64).reshape(-1, len(names))
    return {name: table[:, i] for i, name in enumerate(names)}
