"""One's own loop around an exploration, and one's own strategies in it."""

from dataclasses import dataclass

import numpy as np
import pytest

import lwrprobe as lp
from lwrprobe.contracts import STRATEGY_CONTRACT, PluginError, Reconstruction, UnknownNameError

pytestmark = pytest.mark.slow

DOWN = np.array([0.0, 0.0, -0.02])
SHORT = {"run.time_limit": 20.0, "truth.profile": "ideal"}


def session(**given):
    return lp.Session("block", progress=False, settings=given.pop("settings", SHORT), **given)


def down(seen):
    """As deep as it goes, but no deeper than the first touch."""
    if seen.contact is not None:
        return lp.Done("touched")
    return lp.VelocityCommand(DOWN)


class Descent:
    """The same as an object, over the middle of the area."""

    @dataclass
    class Config:
        speed: float = 0.02

    line_spacing = 0.007

    def __init__(self):
        self.trace = []
        self.over = False

    def start(self, task):
        self.speed = 0.02 if task.options is None else task.options.speed
        self.above = np.eye(4)
        self.above[:3, :3], self.above[:3, 3] = task.orientation, (0.0, 0.0, task.start[2])

    def step(self, seen):
        self.over = self.over or bool(np.linalg.norm(seen.pose[:3, 3] - self.above[:3, 3]) < 1e-4)
        if not self.over:
            return lp.Goal(self.above, 0.1)
        if seen.contact is not None:
            self.trace.append((seen.time, "descent", "touched", "done"))
            return lp.Done("touched")
        return lp.VelocityCommand(np.array([0.0, 0.0, -self.speed]))

    def progress(self):
        return lp.Progress("descending", 0.5, "descent")


class Listening:
    """A display that keeps what it was shown."""

    def __init__(self):
        self.messages, self.seen = [], []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.closed = True

    def message(self, sentence):
        self.messages.append(sentence)

    def watch(self, snapshot):
        self.seen.append(snapshot)


@pytest.fixture(scope="module")
def shown():
    """A whole run with a reconstructor by name, and the display that followed it."""
    display = Listening()
    return lp.explore("block", reconstructor="convex_hull", settings=SHORT, seed=3, progress=display), display


def test_it_goes_on_step_by_step_and_everything_can_be_looked_at():
    with session() as s:
        assert s.observation is None
        assert s.contact is None
        first = s.step()
        assert s.observation is first
        assert 0.0 < s.time < 0.1
        assert s.outcome is None
        while s.contact is None:
            assert s.step() is not None
        before = s.time
        assert s.contact is s.observation.contact
        for _ in range(40):
            s.step()
        assert s.time > before
        assert len(s.map) > 0
        assert len(s.contacts) > 5
        seen = s.contacts
    assert s.outcome.status == "ended early"
    assert s.outcome.reason == "stopped by the caller"
    run = s.finish()
    assert run.contacts.times[: len(seen)].tobytes() == seen.times.tobytes()
    # After the run normals are turned towards the path, about the sphere's centre.
    radius = run.scene.probe.radius
    before, after = (c.points + radius * c.normals for c in (seen, run.contacts))
    assert after[: len(seen)] == pytest.approx(before, abs=1e-4)
    assert s.finish().summary is run.summary
    assert s.step() is None


def test_a_loop_gives_the_run_that_one_call_gives(shown):
    whole, _ = shown
    with session(seed=3) as s:
        times = [seen.time for seen in s]
        run = s.finish()
    assert run.contacts.points.tobytes() == whole.contacts.points.tobytes()
    assert (np.diff(times) > 0.0).all()
    assert run.summary.reason == whole.summary.reason


@pytest.mark.parametrize("make", [lambda: Descent, Descent])
def test_a_class_or_an_object_of_ones_own_explores(make):
    with session(strategy=make()) as s:
        for _ in s:
            pass
        assert isinstance(s.strategy, Descent)
        assert s.strategy.trace[0][2] == "touched"
    run = s.finish()
    assert (run.summary.status, run.summary.reason.split(";")[0]) == ("done", "touched")
    assert run.summary.strategy == "Descent"
    assert run.summary.line_spacing_m == 0.007
    assert s.observation.pose[2, 3] == pytest.approx(0.055, abs=1e-3)


def test_a_class_gets_its_options_and_refuses_others():
    with session(strategy=Descent, settings={**SHORT, "strategy.speed": 0.01}) as s:
        s.step()
        assert s.strategy.speed == 0.01
    with pytest.raises(UnknownNameError, match="option of strategy Descent"):
        session(strategy=Descent, settings={"strategy.sped": 0.01})


def test_a_plain_function_explores(tmp_path):
    run = lp.explore("block", strategy=down, settings={"run.time_limit": 1.0}, out=tmp_path / "run", progress=False)
    assert run.summary.strategy == "down"
    assert "time limit" in run.summary.reason
    assert lp.open_run(tmp_path / "run").summary == run.summary


def test_what_a_strategy_does_wrong_ends_the_run_with_its_name():
    def nothing(seen):
        return None

    def broken(seen):
        raise ZeroDivisionError("of course")

    for strategy, words in (
        (nothing, "step returned NoneType; allowed: Goal, VelocityCommand, Done"),
        (broken, "of course"),
    ):
        run = lp.explore("block", strategy=strategy, progress=False)
        assert run.summary.status == "ended early"
        assert words in run.summary.reason
        assert strategy.__name__ in run.summary.reason


def test_ones_own_reconstructor_makes_the_mesh(shown):
    class Box:
        def reconstruct(self, record):
            mesh = lp.load_scene("block").solid().mesh()
            return Reconstruction(mesh, {"method": "box", "seconds": 0.0, "watertight": True, "without": []})

    run = lp.explore("block", reconstructor=Box(), settings=SHORT, progress=False)
    assert run.summary.mesh_error_mm["method"] == "box"
    assert run.mesh.volume == pytest.approx(0.1 * 0.05 * 0.05)
    named, _ = shown
    assert named.summary.mesh_error_mm["method"] == "convex_hull"


def test_bad_input_is_refused_before_anything_moves():
    class Halfway:
        def start(self, task): ...

    class Old(Descent):
        contract = STRATEGY_CONTRACT - 1

    for given, error in (
        ({"strategy": "grid_versio"}, UnknownNameError),
        ({"strategy": 3}, lp.InputError),
        ({"strategy": Halfway}, lp.InputError),
        ({"strategy": Old()}, PluginError),
        ({"reconstructor": 3}, lp.InputError),
        ({"reconstructor": "poison"}, UnknownNameError),
        ({"seed": -1}, lp.InputError),
        ({"settings": {"probe.radus": 1.0}}, lp.InputError),
        ({"settings": ["probe.radius"]}, lp.InputError),
        ({"settings": "probe.radius=0.004"}, lp.InputError),
        ({"settings": {"strategy.step": np.nan}}, lp.InputError),
        ({"profile": "nobody"}, UnknownNameError),
    ):
        with pytest.raises(error):
            session(**given)
    with pytest.raises(UnknownNameError):
        lp.explore("blok")


def test_a_session_is_used_in_its_block_and_once():
    s = session()
    with pytest.raises(lp.LwrprobeError, match="with Session"):
        _ = s.map
    with s:
        s.step()
    with pytest.raises(lp.InputError, match="a new Session"):
        s.__enter__()


def test_an_error_in_ones_own_loop_brings_the_arm_to_rest_and_passes():
    class Mine(Exception):
        pass

    def loop(s):
        with s:
            s.step()
            raise Mine

    s = session()
    with pytest.raises(Mine):
        loop(s)
    assert s.outcome.reason == "stopped by the caller"


def test_a_scene_gets_settings_on_top_and_stays_as_it_was():
    scene = lp.load_scene("block")
    s = lp.Session(
        scene, settings={"probe.radius": 0.004, "contact.deflection": False}, seed=np.int64(5), progress=False
    )
    assert (s.scene.probe.radius, s.scene.contact.deflection, s.scene.run.seed) == (0.004, False, 5)
    assert s.scene.objects == scene.objects
    assert (scene.probe.radius, scene.run.seed) == (0.005, 1)


def test_progress_is_shown_where_it_is_asked_for(shown):
    _, display = shown
    assert "exploring" in display.messages
    assert display.seen[-1].time > 11.0
    assert display.closed
