"""Interruptions that a run survives: samples that stay away, and an arm that has stopped by itself."""

import numpy as np
import pytest

from lwrprobe.contracts import DeviceRefused, Goal, MotionInterrupted, RestartableArm
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.sample_step import SampleStep
from lwrprobe.exploration.procedures.explore import Exploration, RunOptions
from lwrprobe.exploration.procedures.replay import Replay, recorded_scene
from lwrprobe.exploration.recording.recording import read_recording
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.safety.reaction import MAX_LATE, ReactionExcess
from lwrprobe.exploration.safety.silence_guard import Silence, SilenceGuard
from lwrprobe.exploration.stages.force import ForceStage
from lwrprobe.scene import load_scene
from lwrprobe_strategies.grid_version import GridVersion

SMALL = [
    "truth.profile='ideal'",
    "area.lower=[-0.012, 0.0, 0.020]",
    "area.upper=[0.012, 0.045, 0.06]",
    "strategy.step=0.02",
]


class StoppingArm:
    """The simulated arm, which stops by itself after so many cycles in contact."""

    def __init__(self, arm, world, stops, unasked=True, ready=True):
        self._arm, self._world = arm, world
        self.stops, self.unasked, self.ready = list(stops), unasked, ready
        self.cycle = arm.cycle
        self.asked = []
        self._stopped, self._touching = False, 0

    def open(self):
        self._arm.open()

    def close(self):
        self._arm.close()

    def stop(self):
        self._arm.stop()

    def read(self):
        if self._stopped:
            raise MotionInterrupted("the controller left command mode", self.unasked)
        state = self._arm.read()
        self._touching += self._world.force_now() > 0.4
        if self.stops and self._touching > self.stops[0]:
            self.stops.pop(0)
            self._stopped = True
            self._arm.stop()
            for _ in range(300):
                state = self._arm.read()
            raise MotionInterrupted("the controller left command mode", self.unasked)
        return state

    def command(self, q):
        if self._stopped:
            raise MotionInterrupted("the controller left command mode", self.unasked)
        self._arm.command(q)

    def reenter(self, seconds, asked):
        self.asked.append(asked)
        if not self.ready:
            raise DeviceRefused(f"command mode was not entered within {seconds:g} s")
        self._stopped = False


class Truth:
    """The force on the sphere at the latest sample."""

    def __init__(self, driver):
        self._driver = driver

    def force_now(self):
        world = self._driver._world
        return float(world.truth[max(0, int(world.counts[_taken()]) - 1), 6])


def _taken():
    from lwrprobe_sim import world_kernels

    return world_kernels.TAKEN


def run(monkeypatch, tmp_path, stops, settings=(), confirm=None, **how):
    """A run whose arm stops by itself; the summary, the arm and what was said."""
    made, said = [], []
    assemble = Devices.assemble.__func__

    def with_stops(cls, *arguments):
        devices = assemble(cls, *arguments)
        (driver,) = devices.drivers.values()
        devices.arm = StoppingArm(devices.arm, Truth(driver), stops, **how)
        made.append(devices.arm)
        return devices

    monkeypatch.setattr(Devices, "assemble", classmethod(with_stops))
    scene = load_scene("cylinder_vertical", [*SMALL, *settings])
    options = RunOptions(out=tmp_path / "run", message=said.append, confirm=confirm, record=True)
    with Exploration(scene, options) as exploration:
        for _ in exploration:
            pass
    return exploration.finish(), made[0], said


def assert_replayed(folder):
    """The recording gives the same bytes again, whatever the run was interrupted by."""
    recording = read_recording(folder / "run")
    Replay(recording, recorded_scene(recording), folder / "again").run()
    for name in ("contacts.csv", "states.csv"):
        assert (folder / "again" / name).read_bytes() == (folder / "run" / name).read_bytes()


@pytest.mark.slow
def test_run_goes_on_after_the_arm_has_stopped_in_contact(monkeypatch, tmp_path):
    summary, arm, said = run(monkeypatch, tmp_path, [500, 2000, 4000])
    assert isinstance(arm, RestartableArm)
    assert summary.status == "done", summary.reason
    assert not arm.stops
    assert arm.asked == [False] * 3
    assert summary.reentries == len(summary.interruptions) == 3
    assert summary.true_peak_force_n < 3.0
    assert summary.link_collisions == 0
    assert summary.contact_error_mm["median"] < 0.05
    assert [one["device"] for one in summary.interruptions] == ["arm"] * 3
    assert sum("interrupted" in sentence for sentence in said) == 3
    times = [one["time_s"] for one in summary.interruptions]
    assert times == sorted(times)
    assert all(0.4 < one["pause_s"] < 20.0 for one in summary.interruptions)
    assert_replayed(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "how", "words"),
    [
        ((), {"unasked": False}, "left command mode"),
        (("safety.reentries=0",), {}, "safety.reentries allows 0"),
        ((), {"ready": False}, "not re-entered: command mode was not entered within 10 s"),
    ],
)
def test_run_ends_where_the_arm_may_not_or_cannot_be_set_in_motion(monkeypatch, tmp_path, settings, how, words):
    summary, arm, _ = run(monkeypatch, tmp_path, [500], settings, **how)
    assert summary.status == "ended early"
    assert words in summary.reason
    assert summary.reentries == 0
    assert summary.contacts > 0
    assert len(arm.asked) == (how.get("ready") is False)


@pytest.mark.slow
@pytest.mark.parametrize("answer", ["", "n"])
def test_operator_is_asked_before_an_arm_that_was_switched_off_moves_again(monkeypatch, tmp_path, answer):
    asked = []
    confirm = Confirm(1, asked.append, lambda: "" if confirm.left and not asked[1:] else answer)
    confirm.left = 0
    confirm.message = asked.append

    summary, arm, _ = run(monkeypatch, tmp_path, [500], ["run.time_limit=30.0"], confirm, unasked=False)
    assert any("back into motion after: the controller left command mode" in sentence for sentence in asked)
    assert arm.asked == ([True] if answer == "" else [])
    assert summary.reentries == (answer == "")
    assert_replayed(tmp_path)
    if answer:
        assert "the operator said 'n'" in summary.reason


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 6])
def test_after_a_pause_the_strategy_is_told_of_its_own_goal_and_not_of_the_way_back(monkeypatch, seed):
    """A waypoint had counted as reached where a pause began: the next one lay behind the object, which took 136 N."""
    told, step = [], GridVersion.step

    def watched(strategy, seen):
        if seen.goal_reached and isinstance(strategy.asked, Goal):
            told.append(float(np.abs(seen.pose[:3, 3] - strategy.asked.pose[:3, 3]).max()))
        strategy.asked = step(strategy, seen)
        return strategy.asked

    monkeypatch.setattr(GridVersion, "asked", None, raising=False)
    monkeypatch.setattr(GridVersion, "step", watched)
    bursts = ["truth.loss_burst_ms=300", "truth.loss_bursts_per_min=10", f"run.seed={seed}"]
    with Exploration(load_scene("cylinder_vertical", [*SMALL, *bursts])) as exploration:
        for _ in exploration:
            pass
    summary = exploration.finish()
    assert summary.status == "done"
    assert len(summary.interruptions) > 3
    assert summary.true_peak_force_n < 3.0
    assert told
    assert max(told) < 5e-4


@pytest.mark.slow
def test_samples_that_stay_away_before_the_first_one_are_waited_for():
    """A burst in the first tenth of a second had ended in a traceback."""
    bursts = ["truth.loss_burst_ms=300", "truth.loss_bursts_per_min=10", "run.seed=16", "run.until.time=5"]
    with Exploration(load_scene("cylinder_vertical", [*SMALL, *bursts])) as exploration:
        for _ in exploration:
            pass
    assert exploration.finish().interruptions[0]["time_s"] < 2.0


@pytest.mark.slow
@pytest.mark.parametrize(("milliseconds", "per_minute"), [(40, 20), (300, 10)])
def test_run_survives_bursts_of_lost_samples(tmp_path, milliseconds, per_minute):
    burst = [f"truth.loss_burst_ms={milliseconds}", f"truth.loss_bursts_per_min={per_minute}"]
    scene = load_scene("cylinder_vertical", [*SMALL, *burst])
    with Exploration(scene, RunOptions(out=tmp_path / "run", record=True)) as exploration:
        for _ in exploration:
            pass
    summary = exploration.finish()
    assert summary.status == "done"
    assert summary.true_peak_force_n < 3.0
    assert summary.true_peak_force_n <= summary.peak_force_bound_n
    assert summary.sensor_gaps > 3
    assert bool(summary.interruptions) == (milliseconds > 100)
    assert {one["device"] for one in summary.interruptions} <= {"sensor"}
    assert summary.reentries == 0
    assert summary.contact_error_mm["median"] < 0.06
    assert_replayed(tmp_path)


def test_where_samples_are_missing_the_tip_goes_to_where_the_last_force_is_gone(monkeypatch):
    """By what stick, arm and object give under that force: nowhere near as far along the stick as across it."""
    given = []

    def give_way(self):
        original(self)
        given.append((self.observation, self._request.current))

    original = SampleStep.give_way
    monkeypatch.setattr(SampleStep, "give_way", give_way)
    scene = load_scene("block", [*SMALL, "truth.loss_burst_ms=60", "truth.loss_bursts_per_min=60"])
    with Exploration(scene) as exploration:
        for _ in exploration:
            pass
    pressed = [(seen, motion) for seen, motion in given if seen.contact is not None]
    assert len(pressed) > 3
    for seen, motion in pressed:
        turn = seen.pose[:3, :3]
        gives = turn @ np.diag(exploration.pipeline.probe.compliance) @ turn.T + np.eye(3) / scene.contact.stiffness
        way = 1.5 * gives @ seen.force
        length = np.linalg.norm(way)
        assert motion.velocity * motion.hold == pytest.approx(way * min(1.0, 1e-3 / length), abs=1e-9)
    assert all(not motion.velocity.any() for seen, motion in given if seen.contact is None)


def test_tip_waits_for_one_lost_sample_and_gives_way_at_two():
    for lost, expected in ((0, []), (1, [Silence.OVERDUE]), (2, [Silence.OVERDUE, Silence.MISSING])):
        guard, begun = SilenceGuard(0.1, 0.001, 0.008), []
        for k in range(400):
            late = 2 if k // 8 % 3 == 0 else 0  # samples come a quarter of a period late
            if k % 8 == late and not 104 <= k < 104 + 8 * lost:
                guard.update(0)
            begun.append(guard.check(0.001 * k))
        found = [k for k, silence in enumerate(begun) if silence]
        assert [begun[k] for k in found] == expected
        assert guard.yields == expected.count(Silence.MISSING)
        if found:
            assert found[0] - 98 <= 1e3 * (0.008 + guard.late) + 1, "ms after the last sample"


def test_reaction_is_as_stated_until_something_is_late():
    excess = ReactionExcess(0.01, 0.006, 0.008)
    for k in range(100):
        excess.note_state(0.01 * k, False)
        excess.note_age(0.02)
    assert excess.seconds == excess.largest == 0.0
    excess.note_state(1.0, True)
    assert excess.seconds == pytest.approx(0.01)
    for k in range(10):
        excess.note_state(1.01 + 0.01 * k, True)
    assert excess.seconds == pytest.approx(MAX_LATE * 0.01)
    excess.note_state(11.1, False)
    assert excess.seconds == pytest.approx(MAX_LATE * 0.01 / np.e, rel=0.01)
    excess.note_age(10.0)
    assert 0.03 < excess.seconds < 0.05, "what comes later than that finds the tip already off the surface"
    assert excess.largest >= excess.seconds
    excess.note_silence(0.2)
    assert excess.seconds > 0.2
    excess.note_state(70.0, False)
    assert 0.1 < excess.seconds < 0.2, "a silent sensor is remembered for longer than a busy host"


def test_speed_towards_a_surface_follows_the_measured_reaction():
    from lwrprobe.contact import Wrench, WrenchConditioner, make_estimator
    from lwrprobe.contracts import Contact, Goal, VelocityCommand

    scene = load_scene("block", ["uncertainty.profile=ideal"])
    probe = scene.probe.as_probe()
    conditioner = WrenchConditioner(probe, 125.0)
    force = ForceStage(scene, probe, conditioner, make_estimator("fused", probe), 125.0)
    force.begin(0.016)
    up = np.array([0.0, 0.0, 1.0])
    wrench = Wrench(1.0, 0.8 * up, np.zeros(3), 0.8 * up)
    sliding = VelocityCommand(np.array([0.02, 0.0, -0.004]))
    assert force.limit(sliding, wrench, 0.0) is sliding
    safe = force.touch_speed
    force.speeds.excess = 0.016
    assert force.limit(sliding, wrench, 0.0).velocity == pytest.approx([0.01, 0.0, -0.002])
    assert force.touch_speed == pytest.approx(0.5 * safe)
    assert force.limit(Goal(np.eye(4), 0.02), wrench, 1.0).speed == pytest.approx(0.01)
    assert force.limit(Goal(np.eye(4), 0.2), wrench, 1.0).speed == 0.2, (
        "nothing is touched on the way through free space"
    )
    force.update(wrench, np.eye(4), Contact(1.0, np.zeros(3), up, 0.8 * up, 0.005 * up))
    leaving = VelocityCommand(np.array([0.02, 0.0, 0.03]))
    assert force.limit(leaving, wrench, 0.0).velocity == pytest.approx([0.01, 0.0, 0.015])
    pressing = (1.1 * scene.contact.target) * up
    wrench = Wrench(1.0, pressing, np.zeros(3), pressing)
    assert force.limit(leaving, wrench, 0.0).velocity == pytest.approx([0.01, 0.0, 0.03])
