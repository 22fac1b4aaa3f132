"""A run as a bag: standard ROS 2 messages for everybody's tools, and every sample exactly, for `lwrprobe replay`.

Streams are written at 125 Hz at most. The samples themselves go in tables, one for each flush, with all that the loop
knew of them: the numbers are those of the run, bit by bit, and a table costs as much as a single message.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from math import sqrt
from pathlib import Path
from time import time_ns
from typing import Any

import numpy as np

from lwrprobe.bags import messages
from lwrprobe.bags.bag_writer import BagWriter
from lwrprobe.contracts import Clearance, Contact, Goal, Motion, Observation, Progress, Sensor, Task, WrenchSample
from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.kinematics import Robot
from lwrprobe.mapping import VoxelMap

SAMPLES, RUN, ANSWERS, WORDS = "/lwrprobe/samples", "/lwrprobe/run", "/lwrprobe/answers", "/lwrprobe/words"
PAUSES = "/lwrprobe/pauses"
JOINTS, WRENCH, TIP, FRAMES = "/joint_states", "/wrench", "/probe_tip", "/tf"
CONTACTS, MAP, MARKERS, GOALS = "/contacts", "/map", "/markers", "/goal"
STATE, LOG = "/lwrprobe/state", "/rosout"

SAMPLE_COLUMNS = (
    "listening", "time", "sequence", "status", "fx", "fy", "fz", "tx", "ty", "tz", "arm_time", "acceleration",
    "arrived", "blocked", "vx", "vy", "vz", "mx", "my", "mz",
)  # fmt: skip
"""Of a row of samples, before the joints' values: `listening` counts the pauses in which the bias was taken, 0 after
them, -1 in an interruption, where the strategy is not shown the sample; `blocked` is a code of `WORDS`; vx, vy, vz are
the commanded velocity of the tip, mx, my, mz the measured one."""

SLOW, RARE, MAP_EVERY = 0.2, 0.5, 20.0
"""s of the robot's time between two messages: transforms; state and markers; maps."""
FASTEST = 0.0079
"""s between two messages of a stream."""


class RunBag:
    """Writes what a run measures and decides into `folder/bag`.

    Parameters
    ----------
    folder : of the run
    robot : of the run
    sensor, cycle : of the devices, s
    radius : m, of the sphere

    Raises StorageError where the bag cannot be written.
    """

    def __init__(self, folder: Path, robot: Robot, sensor: Sensor, cycle: float, radius: float) -> None:
        self._folder = folder
        self._robot, self._radius = robot, radius
        self._about = {"cycle": cycle, "rate": float(sensor.rate), "latency": float(sensor.latency)}
        names = [f"{robot.name}_joint_{k + 1}" for k in range(robot.n)]
        self._frames = np.empty((robot.n + 1, 4, 4))
        self._frame_names = [f"{robot.name}_link_{k}" for k in range(robot.n + 1)] + ["probe_tip"]
        self._templates = {
            JOINTS: (messages.joint_state(names), "sensor_msgs/msg/JointState"),
            WRENCH: (messages.wrench("ft_sensor"), "geometry_msgs/msg/WrenchStamped"),
            TIP: (messages.pose(), "geometry_msgs/msg/PoseStamped"),
            GOALS: (messages.pose(), "geometry_msgs/msg/PoseStamped"),
        }
        self._rows: list[list[float]] = []
        self._count = 0
        self._contacts: list[list[float]] = []
        self._codes: dict[str, float] = {}
        self._at_rest = 0
        self._epoch = 0
        self._zero = self._now = 0.0
        self._stream_due = self._slow_due = self._rare_due = 0.0
        self._map_due = MAP_EVERY
        self._goal: np.ndarray | None = None

    def open(self) -> None:
        """The run begins, and its scene.toml is there; raises MissingExtraError."""
        self._writer = BagWriter(self._folder / "bag", "bag")
        self._scene = (self._folder / "scene.toml").read_text(encoding="utf-8")

    def record_at_rest(self, samples: Sequence[WrenchSample], q: np.ndarray) -> None:
        """The samples of a pause in which the bias is taken, with the joints at q (n,)."""
        self._at_rest += 1
        for sample in samples:
            self._row(self._at_rest, sample, (0.0,) * 10, q)

    def begin(self, zero: float, elapsed: float, start: np.ndarray, task: Task) -> None:
        """The strategy takes over at a tip pose (4, 4): time `zero` on the arm's clock is 0 s of the run.

        `elapsed` s are those of an earlier part of the run.
        """
        self._zero, self._now = zero, elapsed
        self._epoch = time_ns() - int(1e9 * elapsed)
        loop = {"delay": task.delay, "arm_mass": task.arm_mass}
        about = self._about | {"zero": zero, "elapsed": elapsed, "start": start.tolist()} | loop
        self._send(RUN, messages.text(json.dumps(about | {"columns": SAMPLE_COLUMNS, "scene": self._scene})))
        self.log("the strategy begins" if elapsed == 0.0 else f"the run goes on after {elapsed:.1f} s")
        self._flush()

    def sample(
        self,
        sample: WrenchSample,
        arm: ArmMotion,
        arrived: bool,
        pose: np.ndarray,
        velocity: np.ndarray,
        shown: bool = True,
    ) -> None:
        """One wrench sample; the tip had `arrived`, its pose (4, 4) and commanded velocity (3,) m/s are of its instant.

        `shown` is False for a sample that the strategy is not shown, because the run is interrupted.
        """
        history = arm.history
        q, measured = history.q, history.measured_velocity(sample.time)
        blocked = self._code(arm.blocked) if shown and arm.blocked else 0.0
        state = (
            arm.time, history.acceleration, shown and arrived, blocked, *velocity.tolist(), *measured.tolist()
        )  # fmt: skip
        self._row(0 if shown else -1, sample, state, q)
        self._now = now = sample.time - self._zero
        if now < self._stream_due:
            return
        self._stream_due = now + FASTEST
        self._stream(JOINTS, q.tolist())
        self._stream(WRENCH, [*sample.force.tolist(), *sample.torque.tolist()])
        self._stream(TIP, [*pose[:3, 3].tolist(), *quaternion(pose)])

    def interrupted(self, why: str) -> None:
        """The strategy has to wait; what was touched before goes on disk now."""
        self.log(f"interrupted: {why}", warning=True)
        self._flush()

    def zero_checked(self, samples: int, since: float, rotation: np.ndarray) -> None:
        """The sensor's zero was checked on those of the last `samples` that are later than `since` s.

        `rotation` (3, 3) is the sensor's in the world.
        """
        self._pause({"samples": samples, "since": since, "rotation": rotation.tolist()})

    def went_on(self, pause: float) -> None:
        """The strategy goes on, after a pause [s] that it is not shown."""
        self._pause({"pause": pause})

    def answer(self, answer: bool) -> bool:
        """The answer to a strategy's question for reach or clearance."""
        self._send(ANSWERS, messages.kind("std_msgs/msg/Bool")(bool(answer)))
        return answer

    def contact(self, contact: Contact) -> None:
        """One accepted contact."""
        self._contacts.append(
            [*contact.point, *contact.normal, contact.magnitude, contact.confidence_score, contact.time]
        )

    def decided(
        self,
        seen: Observation,
        motion: Motion | None,
        progress: Callable[[], Progress],
        voxels: VoxelMap,
        q: np.ndarray,
    ) -> None:
        """What the strategy was shown and what it answered; called after `sample`, joints at q (n,)."""
        if isinstance(motion, Goal) and (self._goal is None or not np.array_equal(motion.pose, self._goal)):
            self._goal = motion.pose.copy()
            self._stream(GOALS, [*motion.pose[:3, 3].tolist(), *quaternion(motion.pose)])
        now = self._now
        if now >= self._slow_due:
            self._slow_due = now + SLOW
            self._send_frames(seen.pose, q)
        if now >= self._rare_due:
            self._rare_due = now + RARE
            self._send_state(seen, progress())
        if now >= self._map_due and len(voxels):
            self._map_due = now + MAP_EVERY
            self._send(MAP, messages.octomap(self._stamp, voxels.encoded(".bt"), voxels.resolution))
        self.flush_when_due()

    def flush_when_due(self) -> None:
        """Hand everything to the system when the last time is long enough ago."""
        if self._writer.due:
            self._flush()

    def log(self, sentence: str, warning: bool = False) -> None:
        """A sentence for whoever reads along."""
        self._send(LOG, messages.log(self._stamp, sentence, warning))

    def close(self, voxels: VoxelMap, status: str) -> None:
        """The run has ended; the last map, and the index. May be called more than once."""
        if self._epoch == 0 and not self._rows:
            self._writer.close()
            return
        self.log(status)
        if len(voxels):
            self._send(MAP, messages.octomap(self._stamp, voxels.encoded(".bt"), voxels.resolution))
        self._flush()
        self._writer.close()

    @property
    def _stamp(self) -> int:
        """ns since the epoch of the robot's present."""
        return (self._epoch or time_ns()) + int(1e9 * self._now)

    def _row(self, listening: int, sample: WrenchSample, state: Sequence[float], q: np.ndarray) -> None:
        row = [listening, sample.time, sample.sequence, int(sample.status)]
        row += sample.force.tolist()
        row += sample.torque.tolist()
        row += state
        row += q.tolist()
        self._rows.append(row)
        self._count += 1

    def _pause(self, what: dict[str, Any]) -> None:
        """`row` is the number of samples before it."""
        self._send(PAUSES, messages.text(json.dumps({"row": self._count} | what)))

    def _code(self, word: str) -> float:
        if word not in self._codes:
            self._codes[word] = float(len(self._codes) + 1)
            self._send(WORDS, messages.text(word))
        return self._codes[word]

    def _stream(self, topic: str, numbers: Sequence[float]) -> None:
        template, kind = self._templates[topic]
        stamp = self._stamp
        self._writer.write(topic, kind, stamp, template.at(stamp, numbers))

    def _send(self, topic: str, message: Any) -> None:
        self._writer.send(topic, self._stamp, message)

    def _send_frames(self, pose: np.ndarray, q: np.ndarray) -> None:
        self._robot.link_frames_into(q, self._frames)
        frames = [*self._frames, pose]
        numbers = np.array([[*frame[:3, 3].tolist(), *quaternion(frame)] for frame in frames])
        self._send(FRAMES, messages.transforms(self._stamp, self._frame_names, numbers))

    def _send_state(self, seen: Observation, progress: Progress) -> None:
        content = {
            "time": round(seen.time, 4), "doing": progress.doing, "state": progress.state,
            "covered": round(progress.covered, 4), "force": round(float(np.linalg.norm(seen.force)), 4),
            "blocked": seen.blocked, "clearance": _distance(seen.clearance),
        }  # fmt: skip
        self._send(STATE, messages.text(json.dumps(content)))
        stamp, blue, red = self._stamp, (0.2, 0.4, 0.9, 1.0), (0.9, 0.2, 0.1, 1.0)
        found = [messages.marker(stamp, "probe", messages.SPHERE, blue, 2.0 * self._radius, seen.pose[None, :3, 3])]
        near = seen.clearance
        if near is not None and np.isfinite(near.distance):
            ends = np.array([near.on_robot, near.on_map])
            found.append(messages.marker(stamp, "clearance", messages.LINES, red, 0.001, ends))
        self._send(MARKERS, messages.markers(found))

    def _flush(self) -> None:
        if self._rows:
            columns = [*SAMPLE_COLUMNS, *(f"q{k + 1}" for k in range(self._robot.n))]
            self._send(SAMPLES, messages.table(columns, np.array(self._rows)))
            self._rows.clear()
        if self._contacts:
            self._send(CONTACTS, messages.cloud(self._stamp, np.array(self._contacts)))
            self._contacts.clear()
        self._writer.flush()


def quaternion(pose: np.ndarray) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of the rotation in a pose (4, 4); Shepperd 1978, the largest part first."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = pose.tolist()
    parts = (a - e - i, e - a - i, i - a - e, a + e + i)
    k = max(range(4), key=parts.__getitem__)
    s = 2.0 * sqrt(max(1.0 + parts[k], 1e-30))
    if k == 3:
        return (h - f) / s, (c - g) / s, (d - b) / s, 0.25 * s
    if k == 0:
        return 0.25 * s, (b + d) / s, (c + g) / s, (h - f) / s
    if k == 1:
        return (b + d) / s, 0.25 * s, (f + h) / s, (c - g) / s
    return (c + g) / s, (f + h) / s, 0.25 * s, (d - b) / s


def _distance(near: Clearance | None) -> float | None:
    return round(near.distance, 5) if near is not None and np.isfinite(near.distance) else None
