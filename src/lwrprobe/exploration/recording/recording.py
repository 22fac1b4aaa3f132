"""Sensor data read back from a bag: of lwrprobe's own, sample by sample, or of others with the standard messages."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from lwrprobe.bags.bag_file import bag_files, read_bag
from lwrprobe.bags.messages import seconds
from lwrprobe.contracts import FormatError, WrenchSample
from lwrprobe.exploration.recording.run_bag import ANSWERS, LOG, PAUSES, RUN, SAMPLE_COLUMNS, SAMPLES, STATE, WORDS

REST = 0.8
"""s at the beginning of a foreign bag in which the probe rests in free space: the sensor's bias is taken there."""
_JOINTS, _WRENCH, _POSE = (
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/PoseStamped",
)
_FIXED = len(SAMPLE_COLUMNS)
_COLUMN = {name: k for k, name in enumerate(SAMPLE_COLUMNS)}


@dataclass(slots=True, frozen=True)
class Pause:
    """What happened in an interruption of a run before its row `row`: the zero was checked, or the run went on.

    Attributes
    ----------
    row : number of samples before it
    rest : number of the samples before it that were taken at rest; 0 where the run went on
    since : s, those of the rest that are later count
    rotation : (3, 3) of the sensor in the world, at rest
    pause : s that the strategy was not shown, where the run went on
    """

    row: int
    rest: int = 0
    since: float = 0.0
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    pause: float = 0.0


@dataclass(slots=True)
class Recording:
    """Samples of a run with what the loop knew of them.

    Attributes
    ----------
    path : of the bag
    rows : (n, 20 + joints), columns as `SAMPLE_COLUMNS`, then joint values [rad]
    words : by the code of the column `blocked`
    poses : (n, 4, 4) of the tip where the bag has no joint values, None where it has
    cycle, rate, latency : of the devices: s, Hz, s
    zero, delay : s, the arm's clock at the run's start, and the task's delay; None where the bag does not say it
    arm_mass : kg, the task's
    start : (4, 4) tip pose where the strategy took over, None likewise
    scene : the scene's text, empty likewise
    interruptions : what the run did in them, in the order of the rows
    answers : to the strategy's questions
    frames : moments of the strategy's state, (time s, content)
    log : (time s, sentence)
    own : recorded by lwrprobe
    """

    path: Path
    rows: np.ndarray
    words: list[str] = field(default_factory=lambda: [""])
    poses: np.ndarray | None = None
    cycle: float = 0.001
    rate: float = 125.0
    latency: float = 0.0
    zero: float = 0.0
    delay: float | None = None
    arm_mass: float = 0.0
    start: np.ndarray | None = None
    scene: str = ""
    interruptions: list[Pause] = field(default_factory=list)
    answers: list[bool] = field(default_factory=list)
    frames: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    log: list[tuple[float, str]] = field(default_factory=list)
    own: bool = True

    @property
    def joints(self) -> np.ndarray:
        """(n, joints) rad."""
        return self.rows[:, _FIXED:]

    def column(self, name: str) -> np.ndarray:
        """(n,) of one of `SAMPLE_COLUMNS`."""
        return self.rows[:, _COLUMN[name]]

    def sample(self, k: int) -> WrenchSample:
        """That of row k."""
        row = self.rows[k]
        return WrenchSample(float(row[1]), row[4:7].copy(), row[7:10].copy(), int(row[2]), int(row[3]))

    def pauses(self) -> list[list[int]]:
        """Rows of each pause in which the bias was taken."""
        number = self.column("listening")
        return [np.flatnonzero(number == k).tolist() for k in np.unique(number[number > 0.0])]

    def run(self) -> np.ndarray:
        """Rows of the run itself, that its strategy was shown."""
        return np.flatnonzero(self.column("listening") == 0.0)

    def shown(self, k: int) -> bool:
        """Whether the strategy was shown the sample of row k, rather than it came in an interruption."""
        return bool(self.rows[k, 0] == 0.0)

    def sequel(self) -> np.ndarray:
        """Rows from the begin of the run on, those of its interruptions among them."""
        return np.flatnonzero(self.column("listening") <= 0.0)


def read_recording(path: str | Path) -> Recording:
    """The recording in a run folder, a bag, or an .mcap or .db3 file; what follows a bad record is left out.

    A bag of others that was split into several files is read as one. Its joints are in the order of the first message
    with joint values; of samples with the same stamp the first one counts.

    Raises FormatError for what is no bag, for one without wrench samples and places of the probe or with several topics
    of them, for joints whose names change, and for a run that was resumed, whose parts are files of their own; and
    MissingExtraError.
    """
    path = Path(path)
    files = bag_files(path)
    parts: dict[str, list[tuple[int, Any]]] = {}
    wanted = (SAMPLES, RUN, ANSWERS, WORDS, PAUSES, STATE, LOG)
    kinds: dict[str, list[tuple[str, Any]]] = {kind: [] for kind in (_JOINTS, _WRENCH, _POSE)}
    own = False
    for message in read_bag(path):
        own = own or message.topic == SAMPLES
        if own and len(files) > 1:
            names = ", ".join(str(file) for file in files)
            raise FormatError(f"{path}: the recording has several parts; give one of them: {names}")
        if message.topic in wanted:
            parts.setdefault(message.topic, []).append((message.time, message.decode()))
        elif message.type in kinds and not own:
            kinds[message.type].append((message.topic, message.decode()))
    return _own(files[0], parts) if own else _foreign(files[0], kinds)


def _own(path: Path, parts: dict[str, list[tuple[int, Any]]]) -> Recording:
    tables = []
    for _, message in parts[SAMPLES]:
        dims, data = message.layout.dim, np.asarray(message.data, dtype=np.float64)
        columns = dims[1].label.split(",") if len(dims) == 2 else []
        if tuple(columns[:_FIXED]) != SAMPLE_COLUMNS or len(data) % len(columns):
            raise FormatError(
                f"{path}: {SAMPLES}: columns {','.join(columns)[:80]!r}; allowed: {','.join(SAMPLE_COLUMNS)}"
            )
        tables.append(data.reshape(-1, len(columns)))
    if len({table.shape[1] for table in tables}) != 1:
        raise FormatError(f"{path}: {SAMPLES}: the number of joints changes")
    rows = np.vstack(tables)
    words = ["", *(message.data for _, message in parts.get(WORDS, ()))]
    if not np.isfinite(rows[:, [1, 2, 3]]).all() or not ((rows[:, 13] >= 0) & (rows[:, 13] < len(words))).all():
        raise FormatError(f"{path}: {SAMPLES}: numbers that no run writes")
    found = Recording(path, rows, words)
    if RUN in parts:
        _about(found, parts[RUN][0][1].data)
    found.interruptions = [_interruption(found, message.data) for _, message in parts.get(PAUSES, ())]
    begin = parts[RUN][0][0] if RUN in parts else parts[SAMPLES][0][0]
    found.answers = [bool(message.data) for _, message in parts.get(ANSWERS, ())]
    for time, message in parts.get(STATE, ()):
        try:
            content = json.loads(message.data)
        except (ValueError, RecursionError):
            continue
        if isinstance(content, dict):
            found.frames.append((1e-9 * (time - begin), content))
    found.log = [(1e-9 * (time - begin), message.msg) for time, message in parts.get(LOG, ())]
    return found


def _interruption(found: Recording, text: str) -> Pause:
    try:
        content = json.loads(text)
        row, rest = int(content["row"]), int(content.get("samples", 0))
        since, pause = float(content.get("since", 0.0)), float(content.get("pause", 0.0))
        rotation = np.array(content.get("rotation", np.eye(3)), dtype=np.float64).reshape(3, 3)
        if not (0 <= rest <= row and np.isfinite([since, pause, *rotation.ravel()]).all()):
            raise ValueError("numbers that no run writes")
    except (ValueError, KeyError, TypeError, OverflowError, AttributeError, RecursionError) as error:
        raise FormatError(f"{found.path}: {PAUSES}: {error}") from None
    return Pause(row, rest, since, rotation, pause)


def _about(found: Recording, text: str) -> None:
    try:
        about = json.loads(text)
        for name in ("cycle", "rate", "latency", "zero", "delay", "arm_mass"):
            value = float(about.get(name, 0.0) if name == "arm_mass" else about[name])
            if not math.isfinite(value):
                raise ValueError(name)
            setattr(found, name, value)
        found.start = np.array(about["start"], dtype=np.float64).reshape(4, 4)
        found.scene = str(about["scene"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FormatError(f"{found.path}: {RUN}: {error}") from None
    if not (found.cycle > 0.0 and found.rate > 0.0 and np.isfinite(found.start).all()):
        raise FormatError(f"{found.path}: {RUN}: cycle and rate must be positive, the start finite")


def _foreign(path: Path, kinds: dict[str, list[tuple[str, Any]]]) -> Recording:
    """Standard messages of others: wrenches, each with the probe where joint states or poses around it say it was."""
    wrenches = _one_topic(path, _WRENCH, kinds[_WRENCH])
    moving = [(topic, message) for topic, message in kinds[_JOINTS] if len(message.position)]
    states = _one_topic(path, _JOINTS, moving)
    tips = _one_topic(path, _POSE, kinds[_POSE]) if len(states) < 2 else []
    if len(wrenches) < 2:
        raise FormatError(f"{path}: no geometry_msgs/WrenchStamped: nothing was measured")
    if len(states) < 2 and len(tips) < 2:
        raise FormatError(f"{path}: neither sensor_msgs/JointState nor geometry_msgs/PoseStamped of the probe's tip")
    origin = min(seconds(message.header.stamp) for message in wrenches)  # seconds since 1970 leave too few digits
    times, rising = _by_time(path, _WRENCH, wrenches, origin)
    wrenches = [wrenches[k] for k in rising]
    values = [[w.wrench.force.x, w.wrench.force.y, w.wrench.force.z] for w in wrenches]
    torques = [[w.wrench.torque.x, w.wrench.torque.y, w.wrench.torque.z] for w in wrenches]
    at, order = _by_time(path, _POSE if tips else _JOINTS, tips or states, origin)
    inside = (times >= at[0]) & (times <= at[-1])
    if inside.sum() < 2:
        raise FormatError(f"{path}: wrenches and places of the probe were not recorded at the same time")
    times = times[inside]
    joints, poses = np.empty((len(times), 0)), None
    if tips:
        poses = _poses_at(path, [tips[k] for k in order], at, times)
    else:
        joints = np.column_stack([np.interp(times, at, column) for column in _joint_values(path, states)[order].T])
    rows = np.zeros((len(times), _FIXED + joints.shape[1]))
    rows[:, 0] = times < REST
    rows[:, 1], rows[:, 2], rows[:, 10] = times, np.arange(len(times)), times
    rows[:, 4:7], rows[:, 7:10] = np.array(values)[inside], np.array(torques)[inside]
    rows[:, _FIXED:] = joints
    if not np.isfinite(joints).all():
        raise FormatError(f"{path}: joint values that are not finite")
    period, cycle = float(np.median(np.diff(times))), float(np.median(np.diff(at)))
    return Recording(
        path, rows, poses=poses, cycle=cycle, rate=1.0 / period, zero=min(REST, float(times[-1])), own=False
    )


def _one_topic(path: Path, kind: str, found: list[tuple[str, Any]]) -> list[Any]:
    """Messages of the one topic that has any; two sensors or arms are never one stream."""
    topics = sorted({topic for topic, _ in found})
    if len(topics) > 1:
        raise FormatError(f"{path}: {kind} on {', '.join(topics)}; allowed: one topic of this type")
    return [message for _, message in found]


def _by_time(path: Path, kind: str, found: list[Any], origin: float) -> tuple[np.ndarray, np.ndarray]:
    """(n,) s since the origin, rising, of messages with different stamps, and their indices (n,)."""
    times, order = np.unique(np.array([seconds(message.header.stamp) for message in found]) - origin, return_index=True)
    if len(times) < 2:
        raise FormatError(f"{path}: {kind}: the stamps do not grow")
    return times, order


def _joint_values(path: Path, states: list[Any]) -> np.ndarray:
    """(n, joints) of messages, each in the order of the first one's names."""
    names = list(states[0].name)
    q = np.empty((len(states), len(states[0].position)))
    for row, state in zip(q, states):
        given = list(state.name)
        if len(state.position) != len(row):
            raise FormatError(f"{path}: {_JOINTS}: {len(state.position)} joint values; allowed: {len(row)} as at first")
        if sorted(given) != sorted(names) or len({*given}) < len(given) or len(given) not in (0, len(row)):
            raise FormatError(
                f"{path}: {_JOINTS}: joints {', '.join(given)[:80]!r}; "
                f"allowed: a name for each of {len(row)} values, as at first: {', '.join(names)[:80]!r}"
            )
        row[:] = state.position if given == names else [state.position[given.index(name)] for name in names]
    return q


def _poses_at(path: Path, tips: list[Any], at: np.ndarray, times: np.ndarray) -> np.ndarray:
    place = np.array([[t.pose.position.x, t.pose.position.y, t.pose.position.z] for t in tips])
    turn = np.array([[getattr(t.pose.orientation, a) for a in "xyzw"] for t in tips])
    if not np.isfinite(place).all() or not (np.linalg.norm(turn, axis=1) > 0.5).all():
        raise FormatError(f"{path}: geometry_msgs/PoseStamped: not finite, or no quaternion")
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = Slerp(at, Rotation.from_quat(turn))(times).as_matrix()
    poses[:, :3, 3] = np.column_stack([np.interp(times, at, column) for column in place.T])
    return poses
