"""The calibration table that the console's `cal` prints."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import DeviceRefused

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_ROW = re.compile(
    rf"^[ \t]*(\d+)[ \t]+(\d+)[ \t]+\d+[ \t]+\d+[ \t]+\d+[ \t]+([FT][xyz])((?:[ \t]+{_NUMBER}){{6}})[ \t]*(.*?)[ \t]*$",
    re.MULTILINE,
)
_RATINGS = re.compile(rf"MaxRatings:\s*(?:\d+\s+0\s+)((?:{_NUMBER}\s+){{5}}{_NUMBER})")
_COUNTS = r"{}:\s*(\d+)\s*counts/(\S+)"
_AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_UNITS = {"N": 1.0, "N-mm": 1e-3, "N-m": 1.0}


@dataclass(slots=True, frozen=True)
class Calibration:
    """Of one transducer.

    Attributes
    ----------
    transducer, number : which one
    serial, date, part : as printed
    force_counts, torque_counts : counts per N and per N·m
    device_multiplies : the device applies the matrix itself; if not, the stream is gage counts
    matrix : (6, 6), gage counts to force and torque counts
    ratings : (6,) N and N·m, ends of the range
    """

    transducer: int
    number: int
    serial: str
    date: str
    part: str
    force_counts: float
    torque_counts: float
    device_multiplies: bool
    matrix: np.ndarray
    ratings: np.ndarray

    @property
    def to_si(self) -> np.ndarray:
        """(6, 6): what the stream has to be multiplied with to be N and N·m."""
        scale = np.repeat([1.0 / self.force_counts, 1.0 / self.torque_counts], 3)
        return np.diag(scale) @ self.matrix if not self.device_multiplies else np.diag(scale)


def parse_calibration(text: str, transducer: int, number: int) -> Calibration:
    """Read the table out of a reply; DeviceRefused names what is missing or does not fit."""
    rows = _ROW.findall(text)
    where = f"calibration {number} of transducer {transducer}"
    if [row[2] for row in rows] != list(_AXES):
        raise DeviceRefused(f"{where}: the device's table has the axes {[row[2] for row in rows]}, not {list(_AXES)}")
    if any((int(row[0]), int(row[1])) != (transducer, number) for row in rows):
        raise DeviceRefused(f"{where}: the device printed the table of transducer {rows[0][0]}, {rows[0][1]}")
    properties = "\n".join(row[4] for row in rows)
    matrix = np.array([[float(v) for v in row[3].split()] for row in rows])
    if abs(np.linalg.det(matrix / np.abs(matrix).max(axis=1, keepdims=True))) < 1e-9:
        raise DeviceRefused(f"{where}: the matrix is singular")
    force, force_unit = _counts(properties, "Force", where)
    torque, torque_unit = _counts(properties, "Torque", where)
    return Calibration(
        transducer,
        number,
        _property(properties, "Serial"),
        _property(properties, "Date"),
        _property(properties, "Part"),
        force / force_unit,
        torque / torque_unit,
        _multiplies(properties, where),
        matrix,
        _ratings(text, where) * np.repeat([force_unit, torque_unit], 3),
    )


def _counts(properties: str, name: str, where: str) -> tuple[float, float]:
    found = re.search(_COUNTS.format(name), properties)
    if not found or not int(found[1]):
        raise DeviceRefused(f"{where}: no line '{name}: ... counts/...' in the device's table")
    if found[2] not in _UNITS or (found[2] == "N") != (name == "Force"):
        raise DeviceRefused(f"{where} counts {name.lower()} per {found[2]}; choose one in N and N-mm")
    return float(found[1]), _UNITS[found[2]]


def _multiplies(properties: str, where: str) -> bool:
    state = _property(properties, "Mult").upper()
    if state not in ("ON", "OFF"):
        raise DeviceRefused(f"{where}: no line 'Mult: ON' or 'Mult: OFF' in the device's table")
    return state == "ON"


def _ratings(text: str, where: str) -> np.ndarray:
    found = _RATINGS.search(text)
    ratings = np.array([float(v) for v in found[1].split()]) if found else np.zeros(6)
    if not (ratings > 0.0).all():
        raise DeviceRefused(f"{where}: no line of six MaxRatings in the device's table")
    return ratings


def _property(properties: str, name: str) -> str:
    found = re.search(rf"^{name}:\s*(.*)$", properties, re.MULTILINE)
    return found[1].strip() if found else ""
