"""Everything that reads files of others, and well-formed files to damage.

`python tests/hostile/readers.py SECONDS` damages them at random for so long and prints what it counted; an input that a
reader does not refuse with a typed error is kept in `tests/hostile/broken`.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lwrprobe.bags.bag_file import read_bag
from lwrprobe.calibration.calibration_file import (
    EACH_JOINT,
    LENGTHS,
    Calibration,
    Quantity,
    read_calibration,
    write_calibration,
)
from lwrprobe.contracts import LwrprobeError, TriangleMesh
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.exploration.recording.logbook import OBSERVATIONS, read_log
from lwrprobe.exploration.recording.recorder import CONTACT_COLUMNS, TRACE_COLUMNS
from lwrprobe.exploration.recording.recording import read_recording
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import Cloud, read_cloud, write_cloud
from lwrprobe.reconstruction.meshes import read_mesh, write_mesh
from lwrprobe.scene import load_scene
from lwrprobe.sweeps.journal import Journal
from lwrprobe.sweeps.plan import read_plan
from lwrprobe_ati.calibration import parse_calibration
from lwrprobe_ati.emulator import Transducer

BROKEN = Path(__file__).with_name("broken")
MEMORY = 3 * 2**30
"""Bytes of address space beyond what is in use, that a damaged file of some kB may make a reader ask for."""
SLOW = 10.0
"""s of computing time that a file of some kB may take."""


def bag(path: Path) -> None:
    """Every message of a bag, and the recording that they are."""
    for message in read_bag(path):
        try:
            message.decode()
        except LwrprobeError:
            continue
    read_recording(path)


def contacts(path: Path) -> None:
    """A run folder with these contacts."""
    beside(path, "contacts.csv", TRACE_COLUMNS + "\n", "trace.csv")


def trace(path: Path) -> None:
    """A run folder with this path of the sphere."""
    beside(path, "trace.csv", CONTACT_COLUMNS + "\n", "contacts.csv")


def summary(path: Path) -> None:
    """A run folder with this summary."""
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    (folder / "contacts.csv").write_text(CONTACT_COLUMNS + "\n")
    (folder / "scene.toml").write_text(SCENE)
    (folder / "summary.json").write_bytes(path.read_bytes())
    read_run(folder)


def beside(path: Path, name: str, other: str, other_name: str) -> None:
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    (folder / "scene.toml").write_text(SCENE)
    (folder / other_name).write_text(other)
    (folder / name).write_bytes(path.read_bytes())
    read_run(folder)


def observations(path: Path) -> None:
    """The log of a run that was cut off."""
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    (folder / OBSERVATIONS).write_bytes(path.read_bytes())
    (folder / "observations.words").write_text("a\nb\n")
    past = read_log(folder, 0.1)
    for k in range(min(len(past.rows), 50)):
        if past.rows[k, 0] == 1.0:
            past.observation(k)


def journal(path: Path) -> None:
    """The journal of a sweep."""
    Journal(path).close()


def console(path: Path) -> None:
    """What a sensor's console prints."""
    parse_calibration(path.read_bytes().decode("latin-1"), 2, 1)


SCENE = '[[object]]\nshape = "box"\nsize = [0.05, 0.04, 0.03]\n'

READERS: dict[str, Callable[[Path], object]] = {
    "scene.toml": load_scene,
    "plan.toml": read_plan,
    "bag.mcap": bag,
    "bag.db3": bag,
    "cloud.pcd": read_cloud,
    "cloud.ply": read_cloud,
    "cloud.csv": read_cloud,
    "mesh.stl": read_mesh,
    "mesh.ply": read_mesh,
    "mesh.obj": read_mesh,
    "map.bt": VoxelMap.read,
    "map.ot": VoxelMap.read,
    "contacts.csv": contacts,
    "trace.csv": trace,
    "summary.json": summary,
    "observations.f64": observations,
    "journal.jsonl": journal,
    "console.txt": console,
    "calibration.toml": read_calibration,
}
"""By the name of a file: what reads it. The part after the first dot is its ending."""


def well_formed(folder: Path) -> dict[str, list[bytes]]:
    """Files that the readers take, by the names in `READERS`."""
    from lwrprobe.bags import messages
    from lwrprobe.bags.bag_writer import BagWriter

    generator = np.random.default_rng(1)
    points = generator.normal(size=(12, 3))
    cloud = Cloud(points, points / np.linalg.norm(points, axis=1, keepdims=True), {"force": points[:, 0]})
    found: dict[str, list[bytes]] = {}
    for name in ("cloud.pcd", "cloud.ply", "cloud.csv"):
        found[name] = [write_cloud(folder / name, cloud).read_bytes()]
    head = (
        b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 12\nHEIGHT 1\nPOINTS 12\nDATA binary\n"
    )
    found["cloud.pcd"].append(head + points.astype("<f4").tobytes())
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for name in ("mesh.stl", "mesh.ply", "mesh.obj"):
        found[name] = [write_mesh(folder / name, TriangleMesh(corners, faces)).read_bytes()]
    voxels = VoxelMap(0.002)
    voxels.insert(0.01 * points)
    voxels.carve_path(np.array([[0.05, 0.0, 0.0], [0.07, 0.0, 0.0]]), 0.005)
    for name in ("map.bt", "map.ot"):
        found[name] = [voxels.write(folder / name).read_bytes()]
    writer = BagWriter(folder / "bag", "a")
    for k in range(3):
        writer.send("/wrench", k + 1, messages.deserialise(messages.wrench("ft").at(k, range(6)), _WRENCH))
        writer.send(
            "/joints", k + 1, messages.deserialise(messages.joint_state(list("abcdefg")).at(k, range(7)), _JOINT)
        )
        writer.send("/lwrprobe/samples", k + 1, messages.table(_COLUMNS, _samples(generator)))
        writer.send("/contacts", k + 1, messages.cloud(k, generator.normal(size=(4, 9))))
        writer.send("/lwrprobe/run", k + 1, messages.text(_ABOUT))
    writer.close()
    found["bag.mcap"] = [writer.path.read_bytes(), _foreign_bag(folder / "foreign")]
    found["bag.db3"] = [_sqlite_bag(folder / "sqlite")]
    rows = "\n".join(",".join(f"{v:.4f}" for v in row) for row in generator.normal(size=(5, 9)))
    found["contacts.csv"] = [f"{CONTACT_COLUMNS}\n{rows}\n".encode()]
    rows = "\n".join(",".join(f"{v:.4f}" for v in row) + ",approach,0.02" for row in generator.normal(size=(5, 7)))
    found["trace.csv"] = [f"{TRACE_COLUMNS}\n{rows}\n".encode()]
    found["summary.json"] = [b'{"scene": "box", "seed": 1, "status": "done", "contacts": 3, "coverage": 0.5}']
    rows_of_log = np.zeros((15, 48))
    rows_of_log[1:, 0] = 1.0
    found["observations.f64"] = [rows_of_log.tobytes()]
    found["journal.jsonl"] = [b'{"key": "a", "result": {"status": "done"}}\n{"key": "b", "result": {}}\n']
    found["scene.toml"] = [SCENE.encode(), b'[[object]]\nshape = "mesh"\nfile = "../../../etc/passwd"\n']
    found["plan.toml"] = [b'scenes = ["block"]\nseeds = 3\nset = ["strategy.step=0.01"]\n']
    lengths = {name: count or EACH_JOINT[name] for name, count in LENGTHS.items()}
    quantities = {name: Quantity("m", (0.1,) * n, (0.01,) * n, (True,) * n) for name, n in lengths.items()}
    write_calibration(
        Calibration(datetime(2026, 1, 1, tzinfo=UTC), "block", "0", "lwr4", 0.02, 3, 1e-5, 60.0, quantities),
        folder / "c.toml",
    )
    found["calibration.toml"] = [(folder / "c.toml").read_bytes()]
    found["console.txt"] = ["\n".join(Transducer(2, 0.0, 3).table()).encode()]
    return found


def _foreign_bag(folder: Path) -> bytes:
    """With the messages of any robot."""
    from lwrprobe.bags.bag_writer import BagWriter

    writer = BagWriter(folder, "a")
    for topic, kind, stamp, data in _foreign_messages():
        writer.write(topic, kind, stamp, data)
    writer.close()
    return writer.path.read_bytes()


def _sqlite_bag(folder: Path) -> bytes:
    """The same, written by rosbags."""
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import StoragePlugin

    from lwrprobe.bags import messages

    connections = {}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind, stamp, data in _foreign_messages():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=messages.type_store())
            writer.write(connections[topic], stamp, data)
    return next(folder.glob("*.db3")).read_bytes()


def _foreign_messages() -> Iterator[tuple[str, str, int, bytes]]:
    """Wrenches, joint states and poses over two seconds."""
    from lwrprobe.bags import messages

    for k in range(20):
        time = 100_000_000 * (k + 1)
        for topic, kind, template, numbers in (
            ("/ft", _WRENCH, messages.wrench("ft"), range(6)),
            ("/joint_states", _JOINT, messages.joint_state(list("abcdefg")), range(7)),
            ("/tip", "geometry_msgs/msg/PoseStamped", messages.pose(), (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0)),
        ):
            yield topic, kind, time, template.at(time, numbers)


_ABOUT = json.dumps(
    {
        "cycle": 0.001,
        "rate": 125.0,
        "latency": 0.0,
        "zero": 0.0,
        "delay": 0.01,
        "start": np.eye(4).tolist(),
        "scene": "",
    }
)
_WRENCH, _JOINT = "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState"
_COLUMNS = (
    "listening", "time", "sequence", "status", "fx", "fy", "fz", "tx", "ty", "tz", "arm_time", "acceleration",
    "arrived", "blocked", "vx", "vy", "vz", "mx", "my", "mz", *(f"q{k}" for k in range(1, 8)),
)  # fmt: skip
_WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"1e308",
    b"999999999999",
    b"\x00",
    b"\xff\xff\xff\xff",
    b"",
    b"[" * 2000,
    b"{}",
    b"..",
)


def _samples(generator: np.random.Generator) -> np.ndarray:
    rows = generator.normal(size=(2, 27))
    rows[:, [0, 13]] = 0.0
    return rows


def damaged(content: bytes, choose: random.Random) -> bytes:
    """The content with some bytes changed, left out, repeated or replaced by what is hard to read."""
    data = bytearray(content)
    for _ in range(choose.randint(1, 4)):
        at = choose.randrange(len(data) + 1)
        how = choose.randrange(7)
        if how == 0 and data:
            data[at % len(data)] = choose.randrange(256)
        elif how == 1:
            del data[at:]
        elif how == 2:
            del data[at : at + choose.randint(1, 40)]
        elif how == 3:
            data[at:at] = data[at : at + choose.randint(1, 80)]
        elif how == 4:
            data[at : at + choose.randint(0, 8)] = choose.choice(_WORDS)
        elif how == 5:
            data[at : at + 8] = choose.randrange(2**64).to_bytes(8, "little")
        else:
            number = choose.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63))
            data[at : at + choose.choice((4, 8))] = number.to_bytes(8, "little")
    return bytes(data)


def outcome(name: str, content: bytes, folder: Path) -> str:
    """`read`, `refused`, or the error that must not be; a reader has `MEMORY` and the time `SLOW` for it."""
    path = folder / name
    path.write_bytes(content)
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    begin, before = time.process_time(), resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, before[1]))
    try:
        READERS[name](path)
    except LwrprobeError:
        return "refused"
    except RecursionError as error:
        return f"RecursionError: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    return "slow" if time.process_time() - begin > SLOW else "read"


def fuzz(seconds: float, seed: int = 1) -> Counter[tuple[str, str]]:
    """Damage files for some seconds; how often each reader read, refused or failed."""
    choose, counts = random.Random(seed), Counter()
    end = time.monotonic() + seconds
    with TemporaryDirectory() as place:
        folder = Path(place)
        files = well_formed(folder)
        for name, contents in files.items():
            outcome(name, contents[0], folder)  # kernels are compiled here
        while time.monotonic() < end:
            for name, contents in files.items():
                content = damaged(choose.choice(contents), choose)
                found = outcome(name, content, folder)
                if found not in ("read", "refused"):
                    BROKEN.mkdir(exist_ok=True)
                    kept = BROKEN / f"{counts.total()}_{name}"
                    kept.write_bytes(content)
                    print(f"{kept.name}: {found}", flush=True)
                    found = "failed"
                counts[name, found] += 1
    return counts


if __name__ == "__main__":
    counted = fuzz(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    for name in READERS:
        print(f"{name:<18}", ", ".join(f"{what} {counted[name, what]}" for what in ("read", "refused", "failed")))
    print("in all", counted.total())
