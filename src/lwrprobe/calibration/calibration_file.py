"""The result of a calibration and its file, `calibration.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contracts import FormatError, StorageError
from lwrprobe.host.whole_file import write_whole

FORMAT = 3
LENGTHS: dict[str, int | None] = {
    "tool_shift": 3, "sphere_radius": 1, "stick_stiffness": 2, "joint_stiffness": None, "arm_stiffness": 3,
    "sensor_matrix": 36, "force_to_torque": 9, "clock_offset": 1, "arm_delay": 1, "sensor_latency": 1, "table": 3,
    "payload": 4, "kinematic_table": None, "tool": 3, "gear_waves": None,
    "joint_hysteresis": 1, "joint_offset": None, "surface_compliance": 1,
}  # fmt: skip
"""How many numbers each quantity has; None = some for each joint."""
EACH_JOINT = {"joint_stiffness": 1, "joint_offset": 1, "kinematic_table": 4, "gear_waves": 2}
"""How many."""
RANGES: dict[str, tuple[float, float]] = {
    "tool_shift": (-0.1, 0.1), "sphere_radius": (1e-4, 0.5), "stick_stiffness": (1e-3, 1e12),
    "joint_stiffness": (1e-3, 1e12), "arm_stiffness": (1e-3, 1e12), "sensor_matrix": (-1e3, 1e3),
    "force_to_torque": (-1.0, 1.0), "clock_offset": (-10.0, 10.0), "arm_delay": (-10.0, 10.0),
    "sensor_latency": (-10.0, 10.0), "table": (-5.0, 5.0), "payload": (-10.0, 10.0), "kinematic_table": (-1.0, 1.0),
    "tool": (-0.1, 0.1), "gear_waves": (-0.1, 0.1), "joint_hysteresis": (0.0, 0.1), "joint_offset": (-1.0, 1.0),
    "surface_compliance": (-1.0, 1.0),
}  # fmt: skip
"""Of the values, in SI units: what is outside was typed wrong, no calibration finds it."""
MAX_AHEAD = timedelta(days=1)
"""Of a date, before the clock of this computer."""
FORCE_ROWS = 18
"""Numbers in the force's rows of the sensor's matrix."""


@dataclass(slots=True, frozen=True)
class Quantity:
    """Numbers of one kind.

    Attributes
    ----------
    unit : SI
    values, sigma : (k,) and their standard deviations
    visible : (k,) whether the touches have at least halved what was uncertain before
    """

    unit: str
    values: tuple[float, ...]
    sigma: tuple[float, ...]
    visible: tuple[bool, ...]


@dataclass(slots=True, frozen=True)
class Calibration:
    """What a calibration has found.

    Attributes
    ----------
    date : when, in UTC
    scene : its name
    scene_hash : digest of what it states of arm, probe and sensor, see `lwrprobe.scene.calibrated_scene`
    robot : model
    reference_sphere : m, diameter
    touches : of sphere and table
    residual : m, root mean square of the touches
    time : s of the robot's time
    quantities : by name:
        tool_shift (3) m, sphere's centre against where the scene has it, tip frame;
        sphere_radius m;
        stick_stiffness (2) N/m, across and along;
        joint_stiffness (n) N m/rad;
        arm_stiffness (3) N/m, of the arm alone at the sphere along the world's axes;
        sensor_matrix (36), reading for a unit wrench, row by row;
        force_to_torque (9) m, torque read for a unit force read at the sphere's centre, row by row;
        clock_offset s, by which the sensor's stamps are ahead of the arm's clock;
        arm_delay s, from a set point to the motion;
        sensor_latency s, from an instant to the arrival of its sample;
        table (3) m and slopes, height at the world's origin, rise along x and y;
        payload (4) kg and m, mass and centre of mass;
        kinematic_table (4 n) m and rad, a, alpha, d and theta of all joints against the robot's model; sums of them are
        known far better than each, and their standard deviations are those of independent errors that would leave as
        much of the tip's;
        tool (3) m, as tool_shift, where the table is corrected too;
        gear_waves (2 n) rad, sine and cosine of all joints, link less motor over the motor's position; their standard
        deviations as those of the table;
        joint_hysteresis rad, width of the joints' play;
        joint_offset (n) rad;
        surface_compliance m/N, of the reference sphere at the contact
    arm_errors : (k, 4 n + 3) m and rad, what is left of kinematic_table and tool together: independent errors of one
        standard deviation each, a row each
    force_errors : (k, 18) 1 and 1/m, the same of the force's three rows of sensor_matrix
    """

    date: datetime
    scene: str
    scene_hash: str
    robot: str
    reference_sphere: float
    touches: int
    residual: float
    time: float
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    arm_errors: tuple[tuple[float, ...], ...] = ()
    force_errors: tuple[tuple[float, ...], ...] = ()

    def values(self, name: str) -> np.ndarray:
        """(k,) of a quantity."""
        return np.array(self.quantities[name].values)

    def sigma(self, name: str) -> np.ndarray:
        """(k,) standard deviations."""
        return np.array(self.quantities[name].sigma)


def previous_path(path: str | Path) -> Path:
    """Where the calibration is kept that stood in a file before, `calibration.previous.toml` beside it."""
    return Path(path).with_suffix(".previous.toml")


def write_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write `calibration.toml`; what stood there is kept (`previous_path`), for the comparison with it.

    Raises StorageError; what stood there is in its place then.
    """
    import tomli_w

    path = Path(path)
    content = {
        "format": FORMAT,
        "date": calibration.date,
        "scene": calibration.scene,
        "scene_hash": calibration.scene_hash,
        "robot": calibration.robot,
        "reference_sphere_m": calibration.reference_sphere,
        "touches": calibration.touches,
        "residual_m": calibration.residual,
        "time_s": calibration.time,
        "quantity": {
            name: {
                "unit": quantity.unit,
                "values": list(quantity.values),
                "sigma": list(quantity.sigma),
                "visible": list(quantity.visible),
            }
            for name, quantity in calibration.quantities.items()
        },
        "arm_errors": [list(row) for row in calibration.arm_errors],
        "force_errors": [list(row) for row in calibration.force_errors],
    }
    new = path.with_name(path.name + ".new")
    write_whole(new, tomli_w.dumps(content).encode())
    try:
        if path.is_file():
            path.replace(previous_path(path))
        new.replace(path)
    except OSError as error:
        raise StorageError(path, error) from None


def read_calibration(path: str | Path) -> Calibration:
    """Read `calibration.toml`; raises FormatError naming the file and what is wrong in it."""
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FormatError(f"{path}: no calibration file ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: not a calibration file in TOML: {error}") from error
    if content.get("format") != FORMAT:
        raise FormatError(f"{path}: format {content.get('format')!r}, not {FORMAT}: no calibration of this version")
    try:
        calibration = Calibration(
            date=_date(content),
            scene=_of(content, "scene", str),
            scene_hash=_of(content, "scene_hash", str),
            robot=_of(content, "robot", str),
            reference_sphere=_size(content, "reference_sphere_m"),
            touches=_of(content, "touches", int),
            residual=_size(content, "residual_m"),
            time=_size(content, "time_s"),
            quantities={name: _quantity(name, table) for name, table in _of(content, "quantity", dict).items()},
            arm_errors=_errors(content, "arm_errors"),
            force_errors=_errors(content, "force_errors"),
        )
    except ValueError as error:
        raise FormatError(f"{path}: {error}") from error
    missing = [name for name in LENGTHS if name not in calibration.quantities]
    if missing:
        raise FormatError(f"{path}: the table quantity.{missing[0]} is missing")
    joints = len(calibration.quantities["joint_stiffness"].values)
    for name, each in EACH_JOINT.items():
        found = len(calibration.quantities[name].values)
        if found != each * joints:
            raise FormatError(f"{path}: quantity.{name} has {found} numbers, not {each * joints} for {joints} joints")
    lengths = {len(row) for row in calibration.arm_errors}
    if not lengths <= {4 * joints + 3}:
        raise FormatError(f"{path}: arm_errors has rows of {lengths} numbers, not {4 * joints + 3} for {joints} joints")
    if not (lengths := {len(row) for row in calibration.force_errors}) <= {FORCE_ROWS}:
        raise FormatError(f"{path}: force_errors has rows of {lengths} numbers, not {FORCE_ROWS}")
    return calibration


def _of(content: Mapping[str, Any], key: str, kind: type) -> Any:
    value = content.get(key)
    if not isinstance(value, kind):
        raise ValueError(f"{key} is {value!r}, not a {kind.__name__}")
    return value


def _size(content: Mapping[str, Any], key: str) -> float:
    value: float = _of(content, key, float)
    if not 0.0 <= value < np.inf:
        raise ValueError(f"{key} is {value!r}, not a finite number of at least 0")
    return value


def _date(content: Mapping[str, Any]) -> datetime:
    date: datetime = _of(content, "date", datetime)
    if date.tzinfo is None:
        raise ValueError(f"date is {date}, without a time zone; 2026-01-02T03:04:05Z has one")
    if date > datetime.now(UTC) + MAX_AHEAD:
        raise ValueError(f"date is {date}, in the future by the clock of this computer: one of them is wrong")
    return date


def _errors(content: Mapping[str, Any], key: str) -> tuple[tuple[float, ...], ...]:
    rows = _of(content, key, list)
    for row in rows:
        if not isinstance(row, list) or not all(isinstance(v, int | float) and np.isfinite(v) for v in row):
            raise ValueError(f"{key} has {row!r}, not a list of finite numbers")
    return tuple(tuple(float(v) for v in row) for row in rows)


def _quantity(name: str, table: Any) -> Quantity:
    if not isinstance(table, dict):
        raise ValueError(f"quantity.{name} is no table")
    numbers = {}
    if name not in RANGES:
        raise ValueError(f"quantity.{name} is none of {', '.join(LENGTHS)}")
    for key, (low, high) in (("values", RANGES[name]), ("sigma", (0.0, 1e12))):
        row = table.get(key)
        allowed = f"{LENGTHS[name] or 'a list of'} finite numbers from {low:g} to {high:g}"
        if not isinstance(row, list) or LENGTHS[name] not in (None, len(row)):
            raise ValueError(f"quantity.{name}.{key} is {row!r}, not {allowed}")
        if not all(isinstance(v, int | float) and low <= v <= high for v in row):
            raise ValueError(f"quantity.{name}.{key} is {row!r}, not {allowed}")
        numbers[key] = tuple(float(v) for v in row)
    visible = table.get("visible")
    if not isinstance(visible, list):
        raise ValueError(f"quantity.{name}.visible is {visible!r}, not a list")
    if not len(visible) == len(numbers["values"]) == len(numbers["sigma"]):
        raise ValueError(f"quantity.{name}: values, sigma and visible differ in length")
    return Quantity(str(table.get("unit", "")), numbers["values"], numbers["sigma"], tuple(bool(v) for v in visible))
