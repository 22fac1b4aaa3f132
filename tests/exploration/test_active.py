"""The strategy `active` and the rule `accurate`, in whole runs."""

from __future__ import annotations

import numpy as np
import pytest

import lwrprobe as lp
from lwrprobe.exploration.procedures.explore import Exploration
from lwrprobe.scene import load_scene

pytestmark = pytest.mark.slow

SETTINGS = {"truth.profile": "ideal"}


@pytest.fixture(scope="module")
def active():
    return lp.explore("cylinder_vertical", strategy="active", seed=7, settings=SETTINGS, progress=False).summary


def test_it_ends_by_itself_with_an_accurate_mesh(active):
    assert (active.status, active.stopped_by) == ("done", "strategy")
    assert active.mesh_error_mm["mean"] <= 0.3
    assert active.mesh_error_mm["p95"] <= 1.0


def test_it_is_as_careful_as_the_others(active):
    assert active.peak_force_n <= 3.0
    assert active.link_collisions == 0


def test_it_takes_less_time_than_lines(active):
    assert active.sim_time_s < 0.75 * 167.0  # of surface_contour over the same object


def test_a_run_that_ends_before_the_surface_is_as_accurate_as_wanted_says_so():
    settings = SETTINGS | {"strategy.aim": 1e-6}
    summary = lp.explore("cylinder_vertical", strategy="active", seed=7, settings=settings, progress=False).summary
    assert (summary.status, summary.stopped_by) == ("done", "strategy")
    assert summary.reason.startswith("area covered, with an expected error of 0.")


def test_a_run_ends_when_the_surface_is_as_accurate_as_wanted():
    settings = SETTINGS | {"run.until.accurate": 1.0, "run.until.time": 150.0}
    summary = lp.explore("cylinder_vertical", strategy="active", seed=7, settings=settings, progress=False).summary
    assert (summary.status, summary.stopped_by) == ("done", "accurate")
    assert "expected error" in summary.reason
    assert summary.mesh_error_mm["mean"] < 1.5
    assert summary.sim_time_s < 150.0


def test_random_pokes_touch_from_above():
    settings = SETTINGS | {"strategy.pokes": 3, "run.until.time": 80.0}
    summary = lp.explore(
        "cylinder_vertical", strategy="random_pokes", seed=7, settings=settings, progress=False
    ).summary
    assert summary.status == "done"
    assert summary.peak_force_n <= 3.0
    assert summary.link_collisions == 0


def test_a_poke_is_a_contact_in_a_world_that_differs_from_its_scene():
    """A sphere at rest shows its normal to ten degrees: without a slide after each touch no contact was certain."""
    scene = load_scene("block", ["strategy.name='random_pokes'", "strategy.pokes=30", "run.seed=3"])
    with Exploration(scene) as exploration:
        for _ in exploration:
            pass
    skills = exploration.pipeline.strategy.trace
    touches = [time for time, skill, outcome, *_ in skills if (skill, str(outcome)) == ("guarded move", "contact")]
    contacts = np.array([contact.time for contact in exploration.recorder.contacts])
    followed = [bool(((contacts > time) & (contacts < time + 2.0)).any()) for time in touches]
    assert len(touches) >= 3
    assert np.mean(followed) > 0.7


def test_what_strokes_do_not_reach_is_touched_by_lines():
    """Strokes end 38 mm above the table; below that the sides lean out. It had ended with a coverage of 0.88."""
    settings = SETTINGS | {"run.until.time": 600.0}
    summary = lp.explore("random:organic:9401:80", strategy="active", seed=1, settings=settings, progress=False).summary
    assert summary.status == "done"
    assert summary.coverage_upright >= 0.95
    assert summary.peak_force_n <= 3.0
    assert summary.link_collisions == 0
