"""Bags as others read them: mcap, mcap-ros2-support and rosbags are the judges."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader, Writer
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_typestore

import lwrprobe as lp
from lwrprobe.bags import messages
from lwrprobe.bags.bag_file import BagState, bag_files, read_bag, read_file
from lwrprobe.bags.bag_writer import BagWriter, state_of
from lwrprobe.bags.recover import recover_bag
from lwrprobe.contracts import FormatError, InputError, StorageError
from lwrprobe.exploration.procedures.replay import Replay, recorded_scene
from lwrprobe.exploration.recording.recording import read_recording
from lwrprobe.exploration.recording.run_bag import SAMPLE_COLUMNS, quaternion

pytestmark = pytest.mark.slow  # its imports take seconds

TOPICS = {
    "/joint_states", "/wrench", "/probe_tip", "/tf", "/contacts", "/map", "/markers", "/goal", "/rosout",
    "/lwrprobe/run", "/lwrprobe/samples", "/lwrprobe/state",
}  # fmt: skip


@pytest.fixture(scope="module")
def run(recorded_cylinder) -> Path:
    return recorded_cylinder


@pytest.fixture(scope="module")
def decoded(run) -> list[tuple[str, int, object]]:
    """Topic, time and content of every message, as mcap and its decoder read them."""
    with (run / "bag" / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [(c.topic, m.log_time, decoded) for _, c, m, decoded in reader.iter_decoded_messages()]


def test_mcap_and_its_ros_decoder_read_all_messages(run, decoded):
    assert {topic for topic, _, _ in decoded} >= TOPICS
    assert len(decoded) == sum(1 for _ in read_bag(run))
    wrenches = [m for topic, _, m in decoded if topic == "/wrench"]
    recording = read_recording(run)
    measured = recording.rows[recording.run(), 4:10]
    assert len(wrenches) == len(measured)
    for message, row in zip(wrenches, measured):
        w = message.wrench
        assert [w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z] == row.tolist()


def test_rosbags_reads_folder_metadata_and_messages(run):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(run / "bag") as reader:
        assert {c.topic for c in reader.connections} >= TOPICS
        joints = [c for c in reader.connections if c.topic == "/joint_states"]
        read = [store.deserialize_cdr(raw, c.msgtype) for c, _, raw in reader.messages(connections=joints)]
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert reader.message_count == sum(counts.values())
    recording = read_recording(run)
    assert (np.array([m.position for m in read]) == recording.joints[recording.run()]).all()
    assert read[0].name == [f"lwr4_joint_{k}" for k in range(1, 8)]


def test_contacts_and_map_are_those_of_the_run(run, decoded):
    clouds = [m for topic, _, m in decoded if topic == "/contacts"]
    rows = np.vstack([np.frombuffer(bytes(m.data), np.float32).reshape(-1, 9) for m in clouds])
    own = np.loadtxt(run / "contacts.csv", delimiter=",", skiprows=1)
    assert rows[:, :6] == pytest.approx(own[:, 1:7], abs=1e-5)
    assert rows[:, 8] == pytest.approx(own[:, 0], abs=1e-4)
    assert rows[:, 6] == pytest.approx(own[:, 7], abs=1e-4)
    last = [m for topic, _, m in decoded if topic == "/map"][-1]
    content = (run / "map.bt").read_bytes()
    assert np.array(last.data, np.int8).tobytes() == content[content.index(b"\ndata\n") + 6 :]
    assert last.resolution == 0.002
    states = [json.loads(m.data) for topic, _, m in decoded if topic == "/lwrprobe/state"]
    covered = [state["covered"] for state in states]
    assert covered == sorted(covered)
    assert sorted(set(covered) - {1.0}) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8]), "lines done"
    with (run / "states.csv").open() as file:
        changes = list(csv.DictReader(file))
    at = np.searchsorted([float(change["time"]) for change in changes], [state["time"] for state in states], "right")
    begun = [changes[0]["state"], *(change["next"] for change in changes)]
    assert [state["state"] for state in states] == [begun[k] for k in at]
    last = max(float(change["time"]) for change in changes if change["state"] != "transit")
    assert all((state["covered"] == 1.0) == (state["time"] >= last) for state in states), (
        "only the way off is left then"
    )


def test_the_tip_is_where_the_joints_put_it(run, decoded):
    robot = lp.kinematics.robot_by_name("lwr4")
    scene = lp.load_scene(run / "scene.toml")
    robot = robot.with_base(scene.arm.base.matrix()).with_tool(scene.arm.tool.matrix())
    joints = {time: m for topic, time, m in decoded if topic == "/joint_states"}
    tips = [(time, m) for topic, time, m in decoded if topic == "/probe_tip"][::97]
    for time, message in tips:
        pose = robot.fk(np.array(joints[time].position)).A
        p, o = message.pose.position, message.pose.orientation
        assert [p.x, p.y, p.z] == pytest.approx(pose[:3, 3], abs=1e-12)
        assert [o.x, o.y, o.z, o.w] == pytest.approx(quaternion(pose), abs=1e-9)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternions_agree_with_scipy(q):
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(q).as_matrix()
    expected = Rotation.from_quat(q).as_quat()
    assert abs(np.dot(quaternion(pose), expected)) == pytest.approx(1.0, abs=1e-9)


def test_a_replay_gives_the_same_bytes(run, tmp_path):
    recording = read_recording(run)
    outcome = Replay(recording, recorded_scene(recording), tmp_path / "again").run()
    assert outcome.status == "done"
    for name in ("contacts.csv", "states.csv", "trace.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (run / name).read_bytes()


def test_the_bag_alone_is_enough(run, tmp_path):
    file = tmp_path / "alone.mcap"
    file.write_bytes((run / "bag" / "bag_0.mcap").read_bytes())
    recording = read_recording(file)
    Replay(recording, recorded_scene(recording), tmp_path / "again").run()
    assert (tmp_path / "again" / "contacts.csv").read_bytes() == (run / "contacts.csv").read_bytes()


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("streams", [("/joint_states",), ("/probe_tip",)])
def test_a_bag_of_others_gives_the_same_surface(run, tmp_path, streams, storage):
    """Written by rosbags, with the standard messages and nothing of lwrprobe's."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    recording = read_recording(run)
    pause = recording.pauses()[-1]
    with Writer(tmp_path / "other", version=9, storage_plugin=storage) as writer:
        made = {}
        kinds = {m.topic: m.type for m in read_bag(run) if m.topic in (*streams, "/wrench")}
        for topic, kind in kinds.items():
            made[topic] = writer.add_connection(topic, kind, typestore=store)
        own = [m for m in read_bag(run) if m.topic in kinds]
        begin = own[0].time
        first = {topic: next(m for m in own if m.topic == topic) for topic in kinds}
        for k, row in enumerate(pause):  # the rest before the run: lwrprobe records it in its own table alone
            time = begin + int((k - len(pause) - 1) * 8e6)
            for topic in kinds:
                message = first[topic].decode()
                message.header.stamp = messages.stamp(time)
                if topic == "/wrench":
                    sample, w = recording.sample(row), message.wrench
                    w.force.x, w.force.y, w.force.z = sample.force
                    w.torque.x, w.torque.y, w.torque.z = sample.torque
                writer.write(made[topic], time, store.serialize_cdr(message, kinds[topic]))
        for message in own:
            writer.write(made[message.topic], message.time, message.data)
    other = read_recording(tmp_path / "other")
    assert not other.own
    (file,) = bag_files(tmp_path / "other")
    assert file.suffix == {StoragePlugin.MCAP: ".mcap", StoragePlugin.SQLITE3: ".db3"}[storage]
    passage = Replay(other, lp.load_scene(run / "scene.toml"), None, same=False)
    passage.run()
    points = np.array([contact.point for contact in passage.contacts])
    own_points = np.loadtxt(run / "contacts.csv", delimiter=",", skiprows=1)[:, 1:4]
    assert len(points) > 0.8 * len(own_points)
    from scipy.spatial import cKDTree

    assert np.median(cKDTree(own_points).query(points)[0]) < 1e-4


def test_three_estimators_on_one_recording(run, tmp_path):
    from lwrprobe.runs.replay import replay

    names = ("force_direction", "wrench_axis", "fused")
    found = {row.estimator: row for row in replay(run, estimators=names, out=str(tmp_path / "out"))}
    assert [row.folder for row in found.values()] == [tmp_path / "out" / name for name in names]
    assert all((row.folder / "contacts.csv").is_file() for row in found.values())
    assert found["force_direction"].error_mm["median"] > 2.0 * found["fused"].error_mm["median"]
    assert found["wrench_axis"].contacts > 100


@pytest.mark.parametrize("out", [".", "bag", ".."])
def test_the_library_replays_into_no_folder_that_it_reads(run, out):
    from lwrprobe.runs.replay import replay

    before = sorted(path.stat().st_mtime_ns for path in run.rglob("*"))
    with pytest.raises(InputError, match="apart from"):
        replay(run, out=run / out)
    assert sorted(path.stat().st_mtime_ns for path in run.rglob("*")) == before


def small(folder: Path, count: int = 400) -> Path:
    writer = BagWriter(folder, "small")
    for k in range(count):
        writer.send("/text", 1_000_000 * k + 1, messages.text(f"message {k}" + "." * 80))
        if k % 50 == 49:
            writer.flush()
    writer.close()
    return writer.path


def contents(path: Path) -> list[str]:
    return [m.decode().data.split(".")[0] for m in read_file(path, BagState())]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    return small(tmp_path_factory.mktemp("whole")).read_bytes()


@pytest.mark.parametrize("share", np.linspace(0.0, 1.0, 60))
def test_a_file_cut_anywhere_is_read_to_the_cut_and_recovered(whole, tmp_path, share):
    file = tmp_path / "cut.mcap"
    file.write_bytes(whole[: max(8, int(share * len(whole)))])
    read = contents(file)
    assert read == [f"message {k}" for k in range(len(read))]
    assert len(read) >= 400 * share - 180
    (found,) = recover_bag(file)
    assert found.messages == len(read)
    with file.open("rb") as stream:  # mcap's own reader, with the index
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        again = [m.data.split(".")[0] for _, _, _, m in reader.iter_decoded_messages()]
    assert again == read
    with Reader(tmp_path) as reader:
        assert reader.message_count == len(read)


def test_a_bag_is_readable_while_it_is_open(tmp_path):
    writer = BagWriter(tmp_path, "open")
    assert (tmp_path / "metadata.yaml").is_file()
    writer.send("/text", 1, messages.text("now"))
    writer.flush()
    assert [m.decode().data for m in read_bag(tmp_path)] == ["now"]
    assert not state_of(writer.path).complete
    writer.close()
    assert state_of(writer.path).complete


def test_a_second_part_goes_into_a_file_of_its_own(tmp_path):
    for part in range(2):
        writer = BagWriter(tmp_path, "bag")
        writer.send("/lwrprobe/samples", part + 1, messages.table(SAMPLE_COLUMNS, np.zeros((1, 20))))
        writer.close()
    with Reader(tmp_path) as reader:
        assert reader.message_count == 2
        assert len({c.topic for c in reader.connections}) == 1
    with pytest.raises(FormatError, match="several parts"):
        read_recording(tmp_path)


def test_claims_beyond_the_file_are_refused_without_memory(tmp_path):
    import tracemalloc

    file = tmp_path / "claim.mcap"
    head = b"\x89MCAP0\r\n"
    chunk = (b"\0" * 16) + (2**30).to_bytes(8, "little") + b"\0" * 4 + (4).to_bytes(4, "little") + b"zstd"
    import zstandard

    bomb = zstandard.compress(b"\0" * 2**27)
    packed = chunk + len(bomb).to_bytes(8, "little") + bomb
    claims = [
        b"\x06" + (2**30).to_bytes(8, "little") + b"x" * 1000,
        b"\x06" + len(packed).to_bytes(8, "little") + packed,
        b"\x03" + (2**62).to_bytes(8, "little"),
    ]
    for claim in claims:
        file.write_bytes(head + claim)
        tracemalloc.start()
        state = BagState()
        assert list(read_file(file, state)) == []
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert state.broken
        assert peak < 2**20


def sqlite_bag(folder: Path, times: range, part: int = 0) -> Path:
    """Written by rosbags: a wrench and a pose at each time [ms]."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {"/ft": "geometry_msgs/msg/WrenchStamped", "/tip": "geometry_msgs/msg/PoseStamped"}
    with Writer(folder / f"w{part}", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for time in (1_000_000 * ms for ms in times):
            for topic, template, numbers in (
                ("/ft", messages.wrench("ft"), (float(part), 0.0, 0.0, 0.0, 0.0, 0.0)),
                ("/tip", messages.pose(), (0.0, 0.0, 1e-9 * time, 0.0, 0.0, 0.0, 1.0)),
            ):
                writer.write(connections[topic], time, template.at(time, numbers))
    return next((folder / f"w{part}").glob("*.db3"))


def test_a_bag_that_was_split_is_read_as_one(tmp_path):
    for part, times in enumerate((range(0, 1000, 10), range(1000, 2000, 10))):
        sqlite_bag(tmp_path, times, part).rename(tmp_path / f"long_{part}.db3")
    recording = read_recording(tmp_path)
    assert len(recording.rows) == 200
    assert recording.column("fx").tolist() == [0.0] * 100 + [1.0] * 100
    assert recording.poses[150, 2, 3] == pytest.approx(1.5)


def foreign_bag(folder: Path, sent: list[tuple[str, str, int, object]]) -> Path:
    """Written by rosbags: topic, type, time [ms] and message of each."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {topic: kind for topic, kind, _, _ in sent}
        made = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for topic, kind, ms, message in sent:
            message.header.stamp = messages.stamp(1_000_000 * ms)
            writer.write(made[topic], 1_000_000 * ms, store.serialize_cdr(message, kind))
    return folder


def wrench(ms: int, fx: float = 0.0, topic: str = "/ft"):
    kind = "geometry_msgs/msg/WrenchStamped"
    numbers = (fx, 0.0, 0.0, 0.0, 0.0, 0.0)
    return topic, kind, ms, messages.deserialise(messages.wrench("ft").at(1_000_000 * ms, numbers), kind)


def joints(ms: int, names: list[str], values: list[float], topic: str = "/joint_states"):
    kind = "sensor_msgs/msg/JointState"
    message = messages.deserialise(messages.joint_state(names).at(1_000_000 * ms, values), kind)
    return topic, kind, ms, message


def test_joints_of_others_are_told_by_their_names(tmp_path):
    """Messages with another order gave wrong angles."""
    sent = []
    for k in range(200):
        angles = {"elbow": 1.0 + 0.01 * k, "base": -1.0, "hand": 2.0}
        order = ["base", "elbow", "hand"] if k % 3 == 0 else ["hand", "base", "elbow"]
        sent += [wrench(10 * k), joints(10 * k, order, [angles[name] for name in order])]
    recording = read_recording(foreign_bag(tmp_path / "bag", sent))
    expected = np.column_stack([np.full(200, -1.0), 1.0 + 0.01 * np.arange(200), np.full(200, 2.0)])
    assert recording.joints == pytest.approx(expected)


@pytest.mark.parametrize(
    ("more", "refused"),
    [
        ([joints(2000, ["base", "finger"], [0.0, 0.0])], "base, finger.*as at first: 'base, elbow'"),
        ([joints(2000, ["base", "base"], [0.0, 0.0])], "base, base"),
        ([joints(2000, [], []), joints(2000, ["base"], [0.0])], "1 joint values.*2 as at first"),
        ([wrench(2000, topic="/other_ft")], r"WrenchStamped on /ft, /other_ft; allowed: one topic"),
        ([joints(2000, ["finger"], [0.0], "/gripper")], r"JointState on /gripper, /joint_states; allowed: one topic"),
    ],
)
def test_other_joints_and_several_topics_of_a_kind_are_refused(tmp_path, more, refused):
    sent = [part for k in range(200) for part in (wrench(10 * k), joints(10 * k, ["base", "elbow"], [0.0, 0.1]))]
    with pytest.raises(FormatError, match=refused):
        read_recording(foreign_bag(tmp_path / "bag", [*sent, *more]))


def test_samples_of_others_with_one_stamp_count_once(tmp_path):
    """Speeds had been divided by no time."""
    sent = []
    for k in range(200):
        sent += [wrench(10 * k, float(k)), wrench(10 * k, -1.0), joints(10 * k, ["a"], [0.1 * k])]
    recording = read_recording(foreign_bag(tmp_path / "bag", sent))
    assert recording.column("fx").tolist() == list(range(200))
    assert (np.diff(recording.column("time")) > 0.0).all()
    still = [part for _ in range(200) for part in (wrench(10), joints(10, ["a"], [0.0]))]
    with pytest.raises(FormatError, match="stamps do not grow"):
        read_recording(foreign_bag(tmp_path / "still", still))


@pytest.mark.parametrize("share", np.linspace(0.1, 0.95, 12))
def test_a_sqlite_bag_cut_anywhere_is_read_to_the_cut_or_refused(tmp_path, share):
    content = sqlite_bag(tmp_path, range(0, 4000, 10)).read_bytes()
    file = tmp_path / "cut.db3"
    file.write_bytes(content[: int(share * len(content))])
    state = BagState()
    try:
        read = list(read_file(file, state))
    except FormatError:
        return
    assert not state.complete
    assert state.broken
    assert len(read) < 800


def test_a_sqlite_file_is_read_without_running_what_is_in_it(tmp_path):
    """A view in the place of a table may be a query that never ends."""
    import sqlite3

    file = tmp_path / "view.db3"
    with sqlite3.connect(file) as made:
        made.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, i AS topic_id FROM n"
        made.execute(f"CREATE VIEW messages AS {endless}")
    made.close()
    with pytest.raises(FormatError, match="lacks a table"):
        list(read_file(file, BagState()))
    with pytest.raises(FormatError, match="only bags in MCAP"):
        recover_bag(sqlite_bag(tmp_path, range(0, 100, 10)))


def test_what_is_no_bag_is_refused(tmp_path):
    (tmp_path / "text.mcap").write_text("not a bag")
    for path in (tmp_path / "text.mcap", tmp_path / "nothing"):
        with pytest.raises(FormatError):
            list(read_bag(path))
    small(tmp_path / "bag")
    with pytest.raises(FormatError, match="WrenchStamped"):
        read_recording(tmp_path / "bag")


def test_a_full_disk_is_one_typed_error(tmp_path, monkeypatch):
    writer = BagWriter(tmp_path, "full")
    writer._stream.close()
    writer._stream = open("/dev/full", "wb")  # noqa: SIM115
    writer._writer._Writer__stream = writer._stream
    writer.send("/text", 1, messages.text("gone"))
    with pytest.raises(StorageError, match="No space left"):
        writer.flush()
    writer.close()


def test_the_table_names_its_columns(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    rows = np.arange(6.0).reshape(2, 3)
    raw = messages.serialise(messages.table(("a", "b", "c"), rows))
    read = store.deserialize_cdr(raw, "std_msgs/msg/Float64MultiArray")
    assert read.layout.dim[1].label == "a,b,c"
    assert (read.data.reshape(2, 3) == rows).all()
    assert SAMPLE_COLUMNS[1] == "time"
