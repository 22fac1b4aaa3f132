"""OctoMap's files: `.bt` (states) and `.ot` (log-odds), read and written natively.

Format: Hornung, Wurm, Bennewitz, Stachniss, Burgard (2013), OctoMap, and its library's own behaviour: a text header,
then the pruned octree in pre-order.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lwrprobe.contracts import FormatError, InputError
from lwrprobe.mapping import octomap_kernels as kernels
from lwrprobe.mapping.kernels import CENTRE_KEY, NO_CAPACITY
from lwrprobe.mapping.voxel_set import VoxelSet

_HEADER = {".bt": "# Octomap OcTree binary file", ".ot": "# Octomap OcTree file"}
_LONGEST_HEADER = 1 << 16
_MAX_LEAVES_AT_ONCE = 1 << 20
_CLAMPED = (0.5, 0.1192, 0.971)
"""Probabilities that OctoMap gives unknown, free and occupied when it reads a `.bt`."""


@dataclass(slots=True, frozen=True)
class Octree:
    """The pruned octree of a map as flat records in pre-order.

    Attributes
    ----------
    places : (n,) packed, see `octomap_kernels`; what is in them is unpacked when asked for
    codes : (n,) uint16, two bits a child: 0 unknown, 1 free, 2 occupied, 3 inner; 0 for leaves
    """

    places: np.ndarray
    codes: np.ndarray

    @property
    def keys(self) -> np.ndarray:
        """(n, 3) of each cube's lowest corner."""
        return np.stack([(self.places >> shift) & 0xFFFF for shift in (0, 16, 32)], axis=1)

    @property
    def sizes(self) -> np.ndarray:
        """(n,) edges in voxels."""
        return np.int64(1) << ((self.places >> 48) & 31)

    @property
    def states(self) -> np.ndarray:
        """(n,) 1 free, 2 occupied; of an inner node the strongest inside."""
        return self.places >> 53


def octree(occupied: VoxelSet, carved: VoxelSet) -> Octree:
    """Pruned octree over both sets."""
    capacity = min(72 * (occupied.nodes + carved.nodes), _MAX_LEAVES_AT_ONCE)
    while True:
        places, codes = np.empty(capacity, np.int64), np.empty(capacity, np.uint16)
        count = kernels.octree(occupied.words, carved.words, places, codes)
        if count <= capacity:
            break
        capacity = count
    return Octree(places[:count], codes[:count])


def encode(tree: Octree, resolution: float, ending: str) -> bytes:
    """Content of a file with that ending."""
    # Without a single inner node (an empty map) OctoMap writes no data at all.
    inner = tree.codes != 0
    if ending == ".bt":
        data = tree.codes[inner].astype("<u2").tobytes()
    else:
        nodes = np.zeros(len(tree.codes), np.dtype([("log_odds", "<f4"), ("children", "u1")]))
        nodes["log_odds"] = np.array([np.log(p / (1.0 - p)) for p in _CLAMPED])[tree.states]
        for part in range(8):
            nodes["children"] |= ((tree.codes >> (2 * part)) & 3 != 0).astype(np.uint8) << part
        data = nodes.tobytes()
    head = f"{_HEADER[ending]}\n# (feel free to add / change comments, but leave the first line as it is!)\n#\n"
    head += f"id OcTree\nsize {len(tree.codes)}\nres {repr(resolution).removesuffix('.0')}\ndata\n"
    return head.encode("ascii") + data


def decode(path: Path, ending: str) -> tuple[float, VoxelSet, VoxelSet]:
    """Resolution, occupied and carved voxels of a file; raises FormatError naming file and place."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    size, resolution, start = _header(path, content, _HEADER[ending])
    data = np.frombuffer(content, np.uint8, offset=start)
    occupied, carved = VoxelSet(resolution), VoxelSet(resolution)
    if size:
        state = np.zeros(3 + kernels.STACK, np.int64)
        state[1:4] = 1, 1, kernels.LEVELS << 48
        read = kernels.read_bt if ending == ".bt" else kernels.read_ot
        while (status := read(data, occupied.words, carved.words, state)) == NO_CAPACITY:
            try:
                occupied.grow()
                carved.grow()
            except InputError as error:
                raise FormatError(f"{path}: {error}") from None
        place = f"{path}: byte {start + int(state[0])}"
        if status == kernels.CUT_SHORT:
            raise FormatError(f"{place}: the file ends inside the tree")
        if status == kernels.TOO_DEEP:
            raise FormatError(f"{place}: a node below the deepest level ({kernels.LEVELS})")
        if status == kernels.NO_NUMBER:
            raise FormatError(f"{place}: a log-odds value that is not a number")
        if int(state[1]) != size:
            raise FormatError(f"{path}: header says size {size}, the tree has {int(state[1])} nodes")
        start += int(state[0])
    if start != len(content):
        raise FormatError(f"{path}: byte {start}: {len(content) - start} bytes after the end of the tree")
    return resolution, occupied, carved


def centres(keys: np.ndarray, sizes: np.ndarray, resolution: float) -> np.ndarray:
    """(n, 3) m, centres of cubes."""
    return (keys - CENTRE_KEY + 0.5 * sizes[:, None]) * resolution


def _header(path: Path, content: bytes, first: str) -> tuple[int, float, int]:
    """Number of nodes, resolution, and where the data begin."""
    end = content.find(b"\ndata\n", 0, _LONGEST_HEADER)
    if end < 0:
        raise FormatError(f"{path}: no line 'data' in the first {_LONGEST_HEADER} bytes; is it an OctoMap file?")
    try:
        lines = content[:end].decode("ascii").split("\n")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: byte {error.start}: the header is not plain text") from None
    if not lines[0].startswith(first):
        raise FormatError(f"{path}: line 1: got {lines[0][:60]!r}; allowed: {first!r}")
    fields: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        name, _, value = line.strip().partition(" ")
        if not name or name.startswith("#"):
            continue
        if name not in ("id", "size", "res"):
            raise FormatError(f"{path}: line {number}: unknown field {name[:40]!r}; allowed: id, size, res, data")
        fields[name] = value.strip()
    if fields.get("id") != "OcTree":
        raise FormatError(f"{path}: field id: got {fields.get('id')!r}; allowed: 'OcTree'")
    return _node_count(path, fields.get("size")), _resolution(path, fields.get("res")), end + len(b"\ndata\n")


def _node_count(path: Path, text: str | None) -> int:
    if text is None or not (text.isascii() and text.isdigit() and len(text) < 19):
        raise FormatError(f"{path}: field size: got {text!r}; allowed: the number of nodes")
    return int(text)


def _resolution(path: Path, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not 1e-6 <= value <= 1e3:
        raise FormatError(f"{path}: field res: got {text!r}; allowed: metres, 1e-6 to 1e3")
    return value
