"""The lines that cover an area, and where a line leads."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lwrprobe.contracts import Area, InputError, Observation
from lwrprobe_strategies.planning.lines import Grid, Line, X
from lwrprobe_strategies.planning.tracking_frame import MAX_RETURN, TrackingFrame
from lwrprobe_strategies.surface_contour import SurfaceContour
from strategy_task import DOWN, task

AREA = Area(np.array([-0.085, -0.06, 0.006]), np.array([0.085, 0.06, 0.058]))


@given(
    step=st.floats(0.001, 0.2),
    first=st.floats(-0.1, 0.1),
    radius=st.floats(0.0, 0.005),
)
def test_no_strip_wider_than_a_step_is_left(step, first, radius):
    grid = Grid.over(AREA, step, first, radius)
    x = np.sort(grid.x)
    assert (np.diff(x) <= step + 1e-9).all()
    assert (np.diff(x) > 1e-9).all()
    assert x[0] - radius <= AREA.lower[0] + 1e-9
    assert x[-1] + radius >= AREA.upper[0] - 1e-9
    assert x[0] >= AREA.lower[0] - 1e-9
    assert x[-1] <= AREA.upper[0] + 1e-9


def test_one_side_after_the_other():
    grid = Grid.over(AREA, 0.01, 0.0, 0.005)
    assert grid.second_side == 9
    assert (np.diff(grid.x[:9]) > 0.0).all()
    assert (np.diff(grid.x[9:]) < 0.0).all()
    assert grid.x[9] == pytest.approx(-0.01)


@pytest.mark.parametrize("step", [0.0, -0.01, np.nan, np.inf])
def test_a_bad_step_is_named(step):
    with pytest.raises(InputError, match=r"strategy\.step"):
        Grid.over(AREA, step)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_tangent_leads_onward_over_the_top_and_up_a_wall_ahead(axis, sign):
    line = Line(axis, 0.01, -0.05 * sign, 0.05 * sign, 0.006)
    frame = TrackingFrame(line, AREA)
    ahead = line.ahead
    np.testing.assert_allclose(np.cross([0.0, 0.0, 1.0], frame.binormal), ahead, atol=1e-12)
    np.testing.assert_allclose(np.cross(-ahead, frame.binormal), [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(np.cross(ahead, frame.binormal), [0.0, 0.0, -1.0], atol=1e-12)
    assert not frame.past_end(line.start)
    assert frame.past_end(line.at(line.end))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_backward_leads_down_a_wall_ahead_until_the_line_begins(axis, sign):
    line = Line(axis, 0.01, -0.05 * sign, 0.05 * sign, 0.006)
    back = TrackingFrame(line, AREA).back_down()
    np.testing.assert_allclose(np.cross(-line.ahead, back.binormal), [0.0, 0.0, -1.0], atol=1e-12)
    assert back.past_end(line.start)
    assert not back.past_end(line.at(line.end))
    assert back.upright() == TrackingFrame(line, AREA)
    assert back.horizontal(1.0) == TrackingFrame(line, AREA).horizontal(1.0)


def test_a_probe_pushed_off_its_line_is_pulled_back_within_the_surface():
    frame = TrackingFrame(Line(1, 0.01, -0.05, 0.05, 0.006), AREA)
    normal = np.array([0.6, 0.0, 0.8])
    slide = np.array([0.0, 0.02, 0.0])
    pull = frame.guided(np.array([0.012, 0.0, 0.03]), slide, normal) - slide
    assert pull @ normal == pytest.approx(0.0, abs=1e-12)
    assert pull[0] < 0.0
    assert pull[1] == 0.0
    place, up = np.array([0.5, 0.0, 0.03]), np.array([0.0, 0.0, 1.0])
    assert frame.guided(place, slide, up)[0] == -MAX_RETURN
    slow = np.array([0.0, 0.002, -0.003])
    assert frame.guided(place, slow, up)[0] == pytest.approx(-0.001), "it had led into the surface at 5 mm/s"
    assert frame.guided(place, np.array([0.0, 0.0, -0.003]), up)[0] == 0.0
    level = frame.horizontal(1.0).guided(np.array([0.012, 0.0, 0.03]), np.array([0.0, 0.02, 0.0]), normal)
    assert level.tolist() == [0.0, 0.02, 0.0]


def test_no_velocity_leads_out_of_the_area():
    frame = TrackingFrame(Line(1, 0.01, -0.05, 0.05, 0.006), AREA)
    assert frame.bounded(np.array([0.0, 0.0, 0.005]), np.array([0.0, 0.01, -0.02]))[2] == 0.0
    assert frame.bounded(np.array([0.086, 0.0, 0.02]), np.array([0.01, 0.0, 0.0]))[0] == 0.0
    assert frame.bounded(np.array([0.086, 0.0, 0.02]), np.array([-0.01, 0.0, 0.0]))[0] == -0.01


@pytest.mark.parametrize(("detail", "spacing"), [(None, 0.015), (0.008, 0.008), (0.04, 0.015)])
def test_lines_are_no_farther_apart_than_the_detail_that_is_to_be_seen_is_wide(detail, spacing):
    strategy = SurfaceContour()
    strategy.start(replace(task(), detail=detail))
    assert strategy.line_spacing == strategy.options.step == spacing


@pytest.mark.parametrize(("normal", "onward"), [([1.0, 0.0, 0.0], True), ([-1.0, 0.0, 0.0], False)])
def test_a_line_along_x_that_is_threatened_down_in_a_hollow_goes_on_across_it(normal, onward):
    """The middle of a mug had stayed unknown: the line was given up at the wall that it had come down."""
    strategy = SurfaceContour()
    strategy.start(task())
    pose = np.eye(4)
    pose[:3, :3], pose[2, 3] = DOWN, 0.03
    strategy.tip.observe(Observation(0.0, pose, np.zeros(3), np.zeros(3)))
    strategy.drive.begin_line(Line(X, 0.0, -0.05, 0.05, 0.02))
    strategy.tip.control.begin(np.array(normal))
    skill = strategy.avoid()
    assert (skill is not None) == onward
    if onward:
        motion = next(skill)
        assert motion.velocity[0] > 0.0, "off the wall, and on along the line"
        skill.close()
