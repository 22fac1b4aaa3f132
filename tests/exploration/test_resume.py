from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lwrprobe.contracts import (
    Area,
    Clearance,
    Contact,
    Done,
    Doubt,
    FormatError,
    Goal,
    Observation,
    Probe,
    Progress,
    Task,
    VelocityCommand,
)
from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.procedures.explore import resume
from lwrprobe.exploration.procedures.recover import recover
from lwrprobe.exploration.recording.logbook import OBSERVATIONS, WIDTH, WORDS, Logbook, Logged, Past, read_log
from lwrprobe.exploration.recording.recorder import CONTACT_COLUMNS
from lwrprobe.exploration.recording.resume import Resumed
from lwrprobe.exploration.recording.return_path import ReturnSpeeds, return_path
from lwrprobe.scene import load_scene, write_scene

pytestmark = pytest.mark.slow

NOTHING = np.zeros(3)


def seen(k: int, force: float = 0.0, **more) -> Observation:
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = 0.0, 1e-3 * k, 0.02
    return Observation(0.008 * k, pose, np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, force]), **more)


def touching(k: int) -> Observation:
    n = np.array([0.0, 0.6, 0.8])
    contact = Contact(0.008 * k, np.array([1.0, 2.0, 3.0]), n, 0.8 * n, np.array([4.0, 5.0, 6.0]), 0.7, Doubt.IMPRECISE)
    near = Clearance(0.01, np.array([7.0, 8.0, 9.0]), np.array([1.5, 2.5, 3.5]), "sensor", 0.02)
    return seen(k, 0.8, contact=contact, clearance=near, goal_reached=True, blocked="out of reach: joint limit")


class Counting:
    """Answers with how many observations it was shown, and asks for its reach at every fifth."""

    line_spacing = None

    def start(self, task: Task) -> None:
        self.task, self.shown, self.answers, self.trace = task, [], [], []

    def step(self, observation: Observation) -> VelocityCommand:
        self.shown.append(observation)
        if len(self.shown) % 5 == 0:
            self.answers.append(self.task.reachable([observation.pose]))
            self.trace.append((observation.time, "a", "fifth", "b"))
        return VelocityCommand(np.array([float(len(self.shown)), 0.0, 0.0]))

    def progress(self) -> Progress:
        return Progress("counting")


class Room:
    """Stands in for the pipeline and the recorder."""

    sweep = object_motion = None
    touch_speed = 0.005

    def __init__(self) -> None:
        self.voxels, self.force, self.contacts, self.inserted = self, self, [], []

        self.felt: list = []

    def add_point(self, point: np.ndarray) -> None:
        self.inserted.append(point)

    def begin(self, delay: float, stated: float | None = None, tip_mass: float = 0.0) -> None:
        assert not self.felt

    def update(self, wrench, pose: np.ndarray, contact: Contact | None) -> None:
        self.felt.append((wrench, contact))


def a_task(**more) -> Task:
    area = Area(np.array([-0.1, -0.1, 0.005]), np.array([0.1, 0.1, 0.06]))
    return Task(
        area, Probe(), np.eye(3), np.array([0.0, 0.0, 0.06]), 0.1, 0.02, 0.03, 1.0, 0.2, 0.8, 3.0, 0.01, 1e5, 0.01,
        **more,
    )  # fmt: skip


@pytest.fixture
def cut_off(tmp_path: Path) -> Counting:
    """A log in the folder: 40 free samples, then a touch that was not finished; the strategy as it was."""
    strategy, log = Counting(), Logbook(tmp_path)
    logged = Logged(strategy, log)
    asked = iter([True, False] * 20)
    logged.start(replace(a_task(), start=np.array([0.0, -0.1, 0.05]), delay=0.017, reachable=lambda _: next(asked)))
    for k in range(40):
        logged.step(seen(k))
    for k in range(40, 47):
        logged.step(touching(k))
    log.close()
    return strategy


def test_a_log_gives_back_what_was_shown(cut_off, tmp_path):
    past = read_log(tmp_path, 0.1)
    assert past.start == pytest.approx([0.0, -0.1, 0.05])
    assert past.delay == 0.017
    k = int(np.flatnonzero(past.rows[:, 22])[0])
    back, was = past.observation(k), touching(40)
    for name in ("time", "goal_reached", "blocked"):
        assert getattr(back, name) == getattr(was, name)
    for mine, own in ((back, was), (back.contact, was.contact), (back.clearance, was.clearance)):
        for name in ("pose", "velocity", "point", "normal", "force", "centre", "on_robot", "on_map"):
            if hasattr(own, name):
                assert (getattr(mine, name) == getattr(own, name)).all()
    assert (back.contact.confidence_score, back.contact.reason) == (0.7, Doubt.IMPRECISE)
    assert (back.clearance.link, back.clearance.required, back.clearance.distance) == ("sensor", 0.02, 0.01)
    assert past.observation(0).contact is None
    assert past.observation(0).clearance is None


def test_a_row_cut_in_the_middle_is_left_out(cut_off, tmp_path):
    whole = read_log(tmp_path, 0.1).rows
    path = tmp_path / OBSERVATIONS
    path.write_bytes(path.read_bytes()[:-100])
    assert (read_log(tmp_path, 0.1).rows == whole[:-1]).all()


def test_damaged_words_cannot_be_taken_up_and_the_contacts_are_saved(cut_off, tmp_path):
    write_scene(load_scene("block"), tmp_path / "scene.toml")
    row = "1.5,0.01,0.0,0.05,0.0,0.0,1.0,0.8,0.9"
    (tmp_path / "contacts.csv").write_text(f"{CONTACT_COLUMNS}\n{row}\n2.0,0.0")
    (tmp_path / WORDS).write_bytes(b"sen\xffsor\n")
    with pytest.raises(FormatError, match=r"observations\.words: cannot be read"):
        resume(tmp_path)
    found = recover(tmp_path)
    assert (found.contacts, found.dropped["contacts.csv"], found.resumable) == (1, 1, False)
    assert (tmp_path / "contacts.csv").read_text() == f"{CONTACT_COLUMNS}\n{row}\n"
    assert Summary.read(tmp_path / "summary.json").contacts == 1


def resumed(folder: Path) -> tuple[Resumed, Counting, Logbook]:
    past = read_log(folder, 0.1)
    strategy, log = Counting(), Logbook(folder, keep=past.last + 2)
    again, room = Resumed(strategy, log, past), Room()
    again.recall(a_task(reachable=lambda _: True), room, room)
    return again, strategy, log


def test_the_strategy_is_where_it_was_when_the_probe_was_last_free(cut_off, tmp_path):
    again, strategy, _ = resumed(tmp_path)
    assert len(strategy.shown) == 40
    assert strategy.answers == cut_off.answers[:8]
    assert (strategy.task.start == [0.0, -0.1, 0.05]).all()
    assert list(again.trace) == []  # what is in the run folder already is not said again
    again.start(a_task())
    top = again.step(seen(0))
    assert isinstance(top, Goal)
    assert top.pose[:3, 3] == pytest.approx([0.0, 0.039, 0.06]), "above where it was free"
    assert top.speed == 0.1
    down = again.step(replace(seen(0, goal_reached=True), pose=top.pose))
    assert down.pose[:3, 3] == pytest.approx(seen(39).pose[:3, 3])
    assert down.speed == Room.touch_speed
    there = seen(39, goal_reached=True)
    assert again.step(there).velocity[0] == 40.0  # what it had answered last
    assert again.step(there).velocity[0] == 41.0
    assert len(strategy.shown) == 41


def test_in_an_even_contact_the_strategy_goes_on_where_it_was_cut_off(cut_off, tmp_path):
    """The probe comes back off the surface; the touch of its last step, or its end, gives the strategy the word."""
    again, _, log = resumed(tmp_path)
    for leg in [*again._path]:
        again.step(replace(seen(39), pose=leg.pose, goal_reached=True))
    for k in range(50, 62):
        again.step(replace(touching(k), blocked=""))
    log.close()
    for touched in (True, False):
        again, strategy, log = resumed(tmp_path)
        assert len(strategy.shown) == 52
        end = again._path[-1].pose[:3, 3]
        assert end == pytest.approx(seen(61).pose[:3, 3])
        assert again._path[-2].pose[:3, 3] == pytest.approx(end + 0.001 * touching(61).contact.normal)
        for leg in again._path[:-1]:
            assert isinstance(again.step(replace(seen(61), pose=leg.pose.copy(), goal_reached=True)), Goal)
        here = replace(touching(61), blocked="") if touched else seen(61, goal_reached=True)
        assert again.step(here).velocity[0] == 52.0, "what it had answered last"
        assert again.step(here).velocity[0] == 53.0
        log.close()
        (tmp_path / OBSERVATIONS).write_bytes((tmp_path / OBSERVATIONS).read_bytes()[: -8 * WIDTH])


def test_what_was_felt_is_known_again(cut_off, tmp_path):
    past = read_log(tmp_path, 0.1)
    room = Room()
    Resumed(Counting(), Logbook(tmp_path, keep=past.last + 2), past).recall(
        a_task(reachable=lambda _: True), room, room
    )
    assert [wrench.time for wrench, _ in room.felt] == pytest.approx([0.008 * k for k in range(47)])
    assert (room.felt[-1][0].world_force == touching(46).force).all()
    assert room.felt[-1][0].force == pytest.approx([0.0, 0.0, -0.8]), "in the sensor's frame"
    assert room.felt[39][1] is None
    assert room.felt[-1][1].confidence_score == 0.7


def test_it_can_be_taken_up_twice(cut_off, tmp_path):
    again, _, log = resumed(tmp_path)
    for leg in [*again._path]:
        again.step(replace(seen(39), pose=leg.pose, goal_reached=True))
    for k in range(60, 75):
        again.step(seen(k))
    log.close()
    assert (tmp_path / OBSERVATIONS).stat().st_size % (8 * WIDTH) == 0
    _, strategy, _ = resumed(tmp_path)
    assert [o.time for o in strategy.shown] == pytest.approx([0.008 * k for k in [*range(40), *range(60, 75)]])


def test_what_stands_in_the_way_back_ends_the_run(cut_off, tmp_path):
    again, _, _ = resumed(tmp_path)
    answer = again.step(replace(touching(3), blocked=""))
    assert isinstance(answer, Done)
    assert not answer.complete
    assert "stands in the way" in answer.reason


def test_a_surface_that_was_touched_before_is_left_and_the_return_goes_on(cut_off, tmp_path):
    again, _, _ = resumed(tmp_path)
    again._touched = np.array([[1.0, 2.0, 3.0]])
    aside = again.step(replace(touching(3), blocked=""))
    assert aside.pose[:3, 3] == pytest.approx(touching(3).pose[:3, 3] + 0.002 * touching(3).contact.normal)
    assert again.step(replace(touching(3), blocked="")).pose == pytest.approx(aside.pose)
    back = again.step(replace(seen(3, goal_reached=True), pose=aside.pose))
    assert back.pose[:3, 3] == pytest.approx([0.0, 0.039, 0.06]), "on to where it was going"
    for _ in range(20):
        again.step(seen(3))
        answer = again.step(replace(touching(3), blocked=""))
    assert isinstance(answer, Done), "not for ever"


def rows_of(observations):
    """A past with these observations and nothing else."""
    rows = np.zeros((len(observations), WIDTH))
    rows[:, 0] = 1.0
    for row, one in zip(rows, observations, strict=True):
        row[2:14] = one.pose[:3].ravel()
        if one.contact is not None:
            row[22], row[24] = 1.0, one.contact.confidence_score
            row[25:28], row[28:31] = one.contact.point, one.contact.normal
    return Past(np.eye(3), NOTHING, 0.0, rows, [""], len(rows) - 1)


def at(x, y, z, contact=None):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([1.0, -1.0, -1.0]), (x, y, z)
    return Observation(0.0, pose, NOTHING, NOTHING, contact)


def beside_a_wall(bulge):
    """From the area's border along a floor, with a loop, and up a wall; `bulge`: touched above the wall before."""
    radius = a_task().probe.radius

    def wall(z):
        return Contact(0.0, np.array([-0.05, -0.02 + radius, z]), np.array([0.0, -1.0, 0.0]), NOTHING, NOTHING, 1.0)

    over = Contact(0.0, np.array([-0.05, -0.022, 0.05]), np.array([0.0, -1.0, 0.0]), NOTHING, NOTHING, 1.0)
    on_border = [at(-0.05, -0.1, z) for z in np.arange(0.06, 0.02, -0.001)]
    first = [at(-0.05, -0.1, 0.06, over)] if bulge else []
    inward = [at(-0.05, y, 0.02) for y in np.arange(-0.1, -0.02, 0.001)]
    around = [at(0.02 * np.sin(a) - 0.05, -0.02 * np.cos(a), 0.02) for a in np.linspace(0.0, 2.0 * np.pi, 100)]
    up = [at(-0.05, -0.02, z, wall(z)) for z in np.arange(0.02, 0.04, 0.001)]
    past = rows_of([*first, *on_border, *inward, *around, *up])
    legs = return_path(past, a_task().area, radius, ReturnSpeeds(0.2, 0.03, 0.006))
    return np.array([leg.pose[:3, 3] for leg in legs]), [leg.speed for leg in legs]


def test_under_a_bulge_the_probe_returns_the_way_it_came_without_its_loops():
    path, speeds = beside_a_wall(bulge=True)
    assert path[0] == pytest.approx([-0.05, -0.1, 0.06])
    assert path[1] == pytest.approx([-0.05, -0.1, 0.021], abs=0.0021), "straight down where nothing stands"
    assert (np.abs(path[:, 0] + 0.05) < 0.0012).all(), "without the loop"
    assert path[-2] == pytest.approx([-0.05, -0.021, 0.039]), "off the wall"
    assert path[-1] == pytest.approx([-0.05, -0.02, 0.039]), "to the wall"
    assert len(path) < 10
    assert speeds == [0.2] + [0.03] * (len(path) - 1), "open at the border, and nowhere along the stick"


def test_the_probe_comes_down_where_it_stood_and_nothing_was_touched_above():
    """Slower than at the border, as a touch there is one along the stick, and yet sooner back."""
    path, speeds = beside_a_wall(bulge=False)
    assert path[0] == pytest.approx([-0.05, -0.021, 0.06])
    assert path[1] == pytest.approx([-0.05, -0.021, 0.039])
    assert path[2] == pytest.approx([-0.05, -0.02, 0.039])
    assert speeds == [0.2, 0.006, 0.03]


def test_a_finished_run_and_a_run_that_never_moved_freely_cannot_be_taken_up(cut_off, tmp_path):
    with pytest.raises(FormatError, match="moved freely"):
        read_log(tmp_path, -1.0)
    Logbook(tmp_path, keep=1).discard()
    with pytest.raises(FormatError, match="the run left no observations"):
        read_log(tmp_path, 0.1)
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(FormatError, match="come to its end"):
        read_log(tmp_path, 0.1)
