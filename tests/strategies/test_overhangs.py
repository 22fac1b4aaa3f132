"""Where the stick may be met before the sphere, and how fast it may go there."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Clearance, Contact, Doubt, Observation
from lwrprobe.control import ContourControl
from lwrprobe_strategies.grid_version import GridVersion
from lwrprobe_strategies.orientation_change import OrientationChange
from lwrprobe_strategies.outcomes import CollisionThreat, Ended, UnknownSpace
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.overhangs import MIN_LEANING, Overhangs
from lwrprobe_strategies.planning.raised_line import RAISE, above_what_was_met
from lwrprobe_strategies.planning.shaft import UNEXPECTED
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import guarded_move, release
from lwrprobe_strategies.skills.follow_contour import slide
from lwrprobe_strategies.surface_contour import SurfaceContour
from lwrprobe_strategies.tip import Tip
from strategy_task import AREA, DOWN, task

ALONG = np.array([0.0, 1.0, 0.0])
LOW, HIGH = 0.006, 0.04


def pose_at(place, rotation=DOWN):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    return pose


def contact(point, normal, confidence=1.0):
    point, normal = np.array(point), np.array(normal) / np.linalg.norm(normal)
    return Contact(0.0, point, normal, normal, point + 0.005 * normal, confidence)


def touch(overhangs, place, normal, times=1, confidence=1.0):
    for _ in range(times):
        point = np.array(place) - 0.005 * np.array(normal) / np.linalg.norm(normal)
        overhangs.note(pose_at(place), contact(point, normal, confidence))


@pytest.fixture
def overhangs():
    return Overhangs(AREA, task().probe, 0.015)


def test_a_plain_wall_is_no_overhang(overhangs):
    touch(overhangs, [0.0, -0.01, HIGH], [0.0, -1.0, 0.0], 20)
    assert not overhangs.ahead(np.array([0.01, -0.012, LOW]), ALONG)


def test_what_leans_above_the_sphere_is_one_all_around_what_is_known_there(overhangs):
    touch(overhangs, [0.0, -0.01, HIGH], [0.0, -0.9, -0.4], MIN_LEANING - 1)
    assert not overhangs.ahead(np.array([0.01, -0.012, LOW]), ALONG), "a few may be noise"
    touch(overhangs, [0.0, -0.01, HIGH], [0.0, -0.9, -0.4], 4, confidence=0.2)
    assert not overhangs.ahead(np.array([0.01, -0.012, LOW]), ALONG), "not certain enough"
    touch(overhangs, [0.0, -0.01, HIGH], [0.0, -0.9, -0.4], MIN_LEANING)
    assert overhangs.ahead(np.array([0.01, -0.012, LOW]), ALONG)
    assert overhangs.ahead(np.array([0.01, -0.012, LOW]), -ALONG), "on the other side too"
    assert not overhangs.ahead(np.array([0.0, -0.035, LOW]), ALONG), "nothing is known there"
    assert not overhangs.ahead(np.array([0.01, -0.012, HIGH + 0.006]), ALONG), "it is below"


@pytest.mark.parametrize(("up", "confidence", "found"), [(-0.16, 0.55, False), (-0.25, 0.55, True), (-0.16, 0.9, True)])
def test_touches_that_lean_by_no_more_than_their_normals_may_be_wrong_are_no_overhang(overhangs, up, confidence, found):
    """Four touches in a row at the foot of a plain wall, all 9 degrees off, slowed all lines after them."""
    touch(overhangs, [0.0, -0.01, HIGH], [0.0, -np.sqrt(1.0 - up * up), up], MIN_LEANING, confidence)
    assert overhangs.found is found


@pytest.mark.parametrize(("confidence", "reach"), [(1.0, 0.02 - LOW), (0.2, HIGH - LOW)])
def test_below_where_the_sphere_has_touched_a_wall_the_stick_meets_nothing_up_there(confidence, reach):
    """An outline below another one was as slow as if the stick could be met by what stands out above."""
    overhangs, along = Overhangs(AREA, task().probe, 0.015, tallest=HIGH), np.array([1.0, 0.0, 0.0])
    touch(overhangs, [0.0, 0.0, HIGH], [0.0, -1.0, 0.0])
    touch(overhangs, [0.01, 0.003, 0.02], [0.0, -1.0, 0.0], confidence=confidence)
    assert overhangs.beneath(np.array([0.007, 0.003, LOW]), along) == pytest.approx(reach)


def test_one_is_possible_below_what_is_taller_until_a_surface_that_faces_the_motion_was_touched(overhangs):
    here = np.array([0.0, -0.02, LOW])
    assert not overhangs.possible(here, ALONG), "nothing is known"
    touch(overhangs, [0.0, -0.01, HIGH], [0.0, -0.6, 0.8])
    assert overhangs.possible(here, ALONG)
    assert not overhangs.possible(here, -ALONG), "a motion away from it"
    assert overhangs.possible(np.array([-0.01, 0.0, LOW]), np.array([1.0, 0.0, 0.0]))
    touch(overhangs, [0.02, 0.0, LOW], [1.0, 0.0, 0.0])
    assert overhangs.possible(here, ALONG), "that surface faces another way"
    touch(overhangs, [0.01, -0.03, LOW], [0.0, -1.0, 0.0])
    assert overhangs.possible(here, ALONG), "that surface lies behind"
    touch(overhangs, [0.017, -0.01, LOW], [0.0, -1.0, 0.0])
    assert overhangs.possible(here, ALONG), "that surface is farther abreast than what is near"
    touch(overhangs, [0.01, -0.01, LOW + 0.006], [0.0, -1.0, 0.0])
    assert overhangs.possible(here, ALONG), "that surface is above the sphere"
    touch(overhangs, [0.01, -0.01, LOW], [0.0, -1.0, 0.0])
    assert not overhangs.possible(here, ALONG)
    assert overhangs.possible(np.array([0.0, 0.004, LOW]), -ALONG), "the other side is not known"


@pytest.mark.parametrize(("force", "times", "known"), [(0.5, 1, False), (0.5, 2, True), (2.0, 1, True)])
def test_two_contacts_of_the_stick_in_a_row_show_an_overhang_and_one_with_a_clear_force(force, times, known):
    overhangs = Overhangs(AREA, task().probe, 0.015, clear_force=0.8)
    here, met = np.array([0.0, -0.01, LOW]), np.array([0.0, -0.008, HIGH])
    for _ in range(times):
        pressed = Contact(0.0, met, -ALONG, -force * ALONG, here, 0.0, Doubt.AXIS_MISSES)
        overhangs.note(pose_at(here), pressed)
    overhangs.note(pose_at(here), contact(here + 0.005 * ALONG, -ALONG, confidence=0.2))
    assert overhangs.ahead(np.array([0.005, -0.01, LOW]), ALONG) == known


def test_where_the_stick_has_stood_nothing_is(overhangs):
    overhangs.stick_met(np.array([0.0, 0.0, LOW]))
    assert overhangs.ahead(np.array([0.0, -0.008, LOW]), ALONG)
    for y in np.arange(-0.012, -0.002, 0.001):
        overhangs.note(pose_at([0.0, y, LOW]), None)
    assert not overhangs.ahead(np.array([0.0, -0.008, LOW]), ALONG)
    assert overhangs.ahead(np.array([0.004, -0.008, LOW]), ALONG), "beside that it has not"
    assert overhangs.ahead(np.array([0.0, -0.008, LOW - 0.002]), ALONG), "nor lower"


@pytest.mark.parametrize(("above", "top"), [(0.0, np.inf), (0.004, np.inf), (0.010, 0.015)])
def test_what_the_stick_has_met_reaches_as_high_as_it_was_met(overhangs, above, top):
    """And a radius higher, as the height follows from a torque; over all of the stick where it is not known."""
    touch(overhangs, [0.0, 0.0, 0.06], [0.0, 0.0, 1.0])
    overhangs.stick_met(np.array([0.0, 0.0, LOW]), above)
    for z in (0.012, 0.02, 0.04):
        assert overhangs.ahead(np.array([0.0, -0.008, LOW + z]), ALONG) == (z < top)


def test_where_an_object_overhangs_elsewhere_an_unknown_place_is_no_free_way():
    tip, there = Tip(task(approach=0.03)), np.array([0.0, 0.0, LOW])
    tip.observe(Observation(0.0, pose_at(there), np.zeros(3), np.zeros(3)))
    away = np.array([-0.02, -0.035, HIGH])
    touch(tip.overhangs, away, [0.0, -1.0, 0.0], MIN_LEANING)
    assert tip.stick_limit(ALONG) == np.inf, "so far it does not overhang"
    touch(tip.overhangs, away, [0.0, -0.9, -0.4], MIN_LEANING)
    assert not tip.overhangs.ahead(there, ALONG)
    assert not tip.overhangs.possible(there, ALONG)
    reach = tip.overhangs.reach(there, ALONG)
    assert tip.stick_limit(ALONG) == pytest.approx(UNEXPECTED * tip.control.stick_speed(reach, ALONG))
    tip.observe(Observation(0.0, pose_at([0.0, 0.003, LOW]), np.zeros(3), np.zeros(3)))
    assert tip.overhangs.anywhere(there, ALONG) is False, "the stick has stood there"


def stand_along_y(overhangs, x, z, left_out=()):
    """The stick stands on a line through all of the area, but for some places."""
    for y in np.arange(AREA.lower[1], AREA.upper[1] + 1e-9, 0.0005):
        if not any(begin < y < end for begin, end in left_out):
            overhangs.note(pose_at([x, y, z]), None)


def test_what_was_touched_does_not_reach_over_a_line_along_which_the_stick_has_stood():
    overhangs, beyond = Overhangs(AREA, task().probe, 0.015), np.array([0.02, 0.0, LOW])
    touch(overhangs, [-0.02, -0.01, HIGH], [0.0, -0.9, -0.4], MIN_LEANING)
    stand_along_y(overhangs, 0.01, LOW, left_out=[(0.0, 0.004)])
    overhangs.survey(LOW)
    assert not overhangs.cut_off(beyond, ALONG), "something may reach through where the stick has not stood"
    stand_along_y(overhangs, 0.01, LOW)
    assert not overhangs.cut_off(beyond, ALONG), "only as of the last survey"
    overhangs.survey(LOW)
    assert overhangs.cut_off(beyond, ALONG)
    assert overhangs.cut_off(beyond + np.array([0.0, 0.0, 0.03]), ALONG), "the stick has stood there as well"
    assert not overhangs.cut_off(beyond - np.array([0.0, 0.0, 0.002]), ALONG), "something low may lead there"
    assert not overhangs.cut_off(np.array([0.0, 0.0, LOW]), ALONG), "on the side of what was touched"
    assert not overhangs.cut_off(np.array([0.01, 0.0, LOW]), np.array([-1.0, 0.0, 0.0])), "and towards it"
    touch(overhangs, [0.025, 0.0, LOW], [-1.0, 0.0, 0.0])
    assert not overhangs.cut_off(beyond, ALONG), "now something is there"
    overhangs.survey(LOW)
    assert not overhangs.cut_off(beyond, ALONG)


def test_where_nothing_reaches_the_stick_is_as_free_as_before_an_overhang_was_found():
    tip, beyond = Tip(task(approach=0.03)), np.array([0.02, 0.0, LOW])
    touch(tip.overhangs, [-0.02, -0.01, HIGH], [0.0, -0.9, -0.4], MIN_LEANING)
    tip.observe(Observation(0.0, pose_at([0.02, -0.005, LOW]), np.zeros(3), np.zeros(3)))
    assert tip.stick_limit(ALONG) < np.inf
    stand_along_y(tip.overhangs, 0.01, LOW)
    tip.overhangs.survey(LOW)
    tip.observe(Observation(0.0, pose_at(beyond), np.zeros(3), np.zeros(3)))
    assert tip.stick_limit(ALONG) == np.inf


def test_what_was_touched_on_the_border_may_reach_around_a_line(overhangs):
    stand_along_y(overhangs, 0.01, LOW)
    touch(overhangs, [-0.02, float(AREA.upper[1]), HIGH], [0.0, 0.0, 1.0])
    overhangs.survey(LOW)
    assert not overhangs.cut_off(np.array([0.02, 0.0, LOW]), ALONG)


def test_places_outside_the_area_are_those_on_its_border(overhangs):
    overhangs.stick_met(np.array([10.0, 10.0, LOW]))
    assert not overhangs.ahead(np.array([0.0, 0.0, LOW]), ALONG)
    assert overhangs.ahead(np.array([9.0, 9.0, LOW]), ALONG)


def test_the_higher_the_stick_is_met_the_stiffer_it_is():
    control = ContourControl(task())
    speeds = [control.stick_speed(reach) for reach in np.linspace(0.0, 0.06, 13)]
    assert (np.diff(speeds) <= 0.0).all()
    assert speeds[-1] < 0.3 * speeds[0]
    assert control.stick_speed(0.05) == control.stick_speed(0.06), "no more than clamped"


def test_the_stick_may_be_met_faster_where_the_arm_gives_way_and_slower_where_it_does_not():
    control = ContourControl(replace(task(), softer=np.diag([-2e-5, 5e-5, 0.0])))
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    usual = control.stick_speed(0.05)
    stiffer = ContourControl(task(stiffness=1.0 / 3e-5)).stick_speed(0.05)
    assert control.stick_speed(0.05, x) == pytest.approx(stiffer)
    assert stiffer < usual
    assert control.stick_speed(0.05, y) == pytest.approx(ContourControl(task(stiffness=1e4)).stick_speed(0.05))
    assert control.stick_speed(0.05, 0.6 * y + [0.0, 0.0, 0.8]) == control.stick_speed(0.05, y), "sideways counts"
    assert usual < control.stick_speed(0.05, (x + 2.0 * y) / np.sqrt(5.0)) < control.stick_speed(0.05, y)


def test_towards_what_is_known_beside_the_stick_it_goes_slowly():
    tip = Tip(task())
    here = np.array([0.0, 0.0, LOW])
    edge = here + np.array([0.0, 0.0025, 0.03])
    near = Clearance(0.0005, edge - [0.0, 0.0005, 0.0], edge, "stick", required=0.0001)
    tip.observe(Observation(0.0, pose_at(here), np.zeros(3), np.zeros(3), None, near))
    assert tip.stick_limit(ALONG) == pytest.approx(tip.control.stick_speed(0.03))
    assert tip.stick_limit(-ALONG) == np.inf
    assert tip.stick_limit(np.array([1.0, 0.0, 0.0])) == np.inf, "along an edge"
    assert tip.stick_limit(np.array([0.0, 0.0, 1.0])) == np.inf, "the stick follows its own column"


@pytest.mark.parametrize(
    ("distance", "touched", "slow"), [(0.002, False, True), (0.002, True, False), (0.004, False, False)]
)
def test_in_free_space_it_goes_slowly_towards_what_the_sphere_would_have_met_if_it_were_a_wall(distance, touched, slow):
    """A lobe 32 mm above the sphere stood out beside where it was touched: the stick met it at 28 mm/s, with 3.6 N."""
    tip, here = Tip(task()), np.array([0.0, 0.0, LOW])
    edge = here + np.array([0.0, 0.002 + distance, 0.03])
    near = Clearance(distance, edge - [0.0, distance, 0.0], edge, "stick", required=0.0001)
    touch = contact(here + 0.005 * ALONG, -ALONG) if touched else None
    tip.observe(Observation(0.0, pose_at(here), np.zeros(3), np.zeros(3), touch, near))
    assert tip.near_limit(ALONG) == (pytest.approx(tip.control.stick_speed(0.03)) if slow else np.inf)


def test_up_a_wall_it_goes_slowly_where_nobody_knows_what_is_above_and_where_something_overhangs():
    tip = Tip(task(approach=0.03))
    tip.overhangs, tip.reliable = Overhangs(AREA, tip.task.probe, 0.015), True
    place, up, slope = np.array([0.0, 0.0, 0.03]), np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.9, 0.43])
    tip.here = place
    wall = np.array([0.0, -1.0, 0.0])
    touch(tip.overhangs, place, wall)
    assert tip.climb_limit(up) == pytest.approx(tip.control.climb_speed), "nothing as high was touched"
    assert tip.climb_limit(slope) == np.inf
    steep = np.array([0.0, 0.76, 0.65])
    assert tip.climb_limit(steep) == pytest.approx(tip.control.climb_speed / 0.65), "an eave over it was met with 3.2 N"
    touch(tip.overhangs, [0.01, 0.0, 0.05], wall)
    assert tip.climb_limit(up) == np.inf, "the line beside goes on up this wall"
    edge = np.array([0.0, 0.0, 0.05])
    tip.here = edge
    assert tip.climb_limit(up) == pytest.approx(tip.control.climb_speed), "the line beside was as high and no higher"
    touch(tip.overhangs, [0.01, 0.003, 0.055], np.array([0.0, 0.0, 1.0]))
    assert tip.climb_limit(up) == np.inf, "the sphere went over the edge there"
    tip.here = place
    touch(tip.overhangs, [0.01, 0.0, 0.045], np.array([0.0, -0.6, -0.8]), times=MIN_LEANING)
    assert tip.climb_limit(up) == pytest.approx(tip.control.climb_speed), "something overhangs up there"
    tip.reliable = False
    assert tip.climb_limit(up) == pytest.approx(tip.control.held_speed), "the stick may press on the wall"


def test_up_a_wall_it_goes_slowly_below_a_top_alone_on_an_object_that_overhangs_elsewhere():
    """A line beside went over a plate on a column: how far that reaches on this side, nobody knows."""
    tip = Tip(task(approach=0.03))
    tip.overhangs, tip.reliable = Overhangs(AREA, tip.task.probe, 0.015), True
    up, wall = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    tip.control.begin(wall)
    tip.here = np.array([0.0, 0.0, 0.03])
    touch(tip.overhangs, [0.01, 0.01, 0.06], up)
    assert tip.climb_limit(up) == np.inf
    touch(tip.overhangs, [0.08, 0.08, 0.05], np.array([0.0, 0.6, -0.8]), times=MIN_LEANING)
    assert tip.climb_limit(up) == pytest.approx(tip.control.climb_speed)
    touch(tip.overhangs, [0.01, 0.0, 0.05], wall)
    assert tip.climb_limit(up) == np.inf, "the line beside goes on up this wall"


def test_up_a_wall_it_goes_slowly_where_the_line_beside_was_further_out_above():
    """What stands out there by a millimetre stands out further here: it was met from below at sliding speed."""
    tip = Tip(task(approach=0.03))
    tip.overhangs, tip.reliable = Overhangs(AREA, tip.task.probe, 0.015), True
    up, wall = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    tip.control.begin(wall)
    for z in np.arange(0.02, 0.07, 0.001):
        touch(tip.overhangs, [0.01, 0.0 if z < 0.04 else -0.001, z], wall)
    tip.here = np.array([0.0, 0.0, 0.03])
    assert tip.climb_limit(up) == np.inf, "the same wall goes on"
    tip.here = np.array([0.0, 0.0, 0.0385])
    assert tip.climb_limit(up) == pytest.approx(tip.control.climb_speed)
    tip.here = np.array([0.0, -0.001, 0.0385])
    assert tip.climb_limit(up) == np.inf, "on a wall as far out"


@pytest.mark.parametrize(("out", "slow"), [(-0.002, False), (0.002, True), (0.008, False)])
def test_up_a_wall_it_goes_slowly_below_a_surface_that_faces_somewhat_alike_and_stands_out(out, slow):
    """The upper of two boxes, turned about the vertical: where lines beside met it, it faced another way."""
    tip = Tip(task(approach=0.03))
    tip.overhangs, tip.reliable = Overhangs(AREA, tip.task.probe, 0.015), True
    wall, upper = np.array([0.0, -1.0, 0.0]), np.array([np.sin(1.2), -np.cos(1.2), 0.0])
    tip.control.begin(wall)
    tip.here = np.array([0.0, 0.0, 0.03])
    along = np.array([np.cos(1.2), np.sin(1.2), 0.0])
    for z in np.arange(0.035, 0.07, 0.001):
        touch(tip.overhangs, tip.here + out * upper - 0.012 * along + [0.0, 0.0, z - 0.03], upper)
    found = tip.climb_limit(np.array([0.0, 0.0, 1.0]))
    assert found == pytest.approx(tip.control.climb_speed) if slow else found == np.inf


def test_up_a_round_wall_it_goes_as_fast_as_up_a_plane_one():
    """Beside a cylinder the sphere was outside its tangent, in a hollow one further out: neither overhangs."""
    for outwards in (1.0, -1.0):
        tip = Tip(task(approach=0.03))
        tip.overhangs = Overhangs(AREA, tip.task.probe, 0.015)
        beside, here = (outwards * np.array([np.sin(angle), -np.cos(angle), 0.0]) for angle in (0.3, 0.0))
        for z in np.arange(0.02, 0.07, 0.001):
            touch(tip.overhangs, outwards * 0.04 * beside + [0.0, 0.0, z], beside)
        tip.control.begin(here)
        tip.here = outwards * 0.04 * here + [0.0, 0.0, 0.03]
        assert tip.climb_limit(np.array([0.0, 0.0, 1.0])) == np.inf


def test_over_a_floor_below_what_is_taller_it_goes_as_slowly_as_the_stick_may_be_met():
    """The stick was met at sliding speed by what overhangs a floor that the sphere followed."""
    tip, _ = level_contour([0.0, -0.02, LOW], [0.0, 0.0, 1.0])
    frame, up = TrackingFrame(Line(1, 0.0, -0.1, 0.1, LOW), AREA), np.array([0.0, 0.0, 1.0])
    fast = float(np.linalg.norm(slide(tip, frame, up, "").velocity))
    touch(tip.overhangs, [0.0, -0.01, HIGH], [0.0, -0.6, 0.8])
    slow = tip.control.stick_speed(tip.overhangs.reach(tip.here, ALONG), ALONG, share=1.0)
    assert slow < 0.7 * fast
    assert np.linalg.norm(slide(tip, frame, up, "").velocity) == pytest.approx(slow, rel=0.1)
    for y in np.linspace(-0.02, 0.0, 21):
        tip.overhangs.note(pose_at([0.0, y, LOW]), None)
    assert np.linalg.norm(slide(tip, frame, up, "").velocity) == pytest.approx(fast, rel=0.1), "the stick stood there"


def test_a_raised_line_meets_the_edge_that_the_stick_has_met_with_the_side_of_the_sphere():
    here, edge = np.array([0.0, -0.01, LOW]), np.array([0.0, -0.008, HIGH])
    pressed = Contact(0.0, edge, -ALONG, -ALONG, here, 0.0, Doubt.AXIS_MISSES)
    seen = Observation(0.0, pose_at(here), np.zeros(3), np.zeros(3), pressed)
    line = above_what_was_met(Line(1, 0.0, -0.02, 0.02, LOW), seen, task(), 0.01, -np.inf)
    assert edge[2] - 0.6 * task().probe.radius < line.height < edge[2]


def test_a_line_that_was_raised_goes_higher_when_it_leads_in_under_the_same_again():
    """Above a foot that it meets it goes down to that, and there the stick comes near what overhangs once more."""
    seen = Observation(0.0, pose_at([0.0, 0.0, LOW]), np.zeros(3), np.zeros(3))
    line = Line(1, 0.0, -0.03, 0.05, 0.019)
    first = above_what_was_met(line, seen, task(), 0.01, -np.inf)
    assert first.height == pytest.approx(LOW + RAISE)
    again = above_what_was_met(replace(line, raised=True), seen, task(), 0.01, -np.inf)
    assert again.height == pytest.approx(0.019 + RAISE)
    line = replace(line, raised=True)
    heights = []
    while line is not None:
        heights.append(line.height)
        line = above_what_was_met(line, seen, task(), 0.01, -np.inf)
    assert max(heights) <= AREA.upper[2]
    assert len(heights) < 1 + (AREA.upper[2] - 0.019) / RAISE, "it ends"


@pytest.mark.parametrize(("raised", "height"), [(False, LOW + RAISE), (True, 0.057 + RAISE)])
def test_a_line_that_has_led_down_by_itself_goes_on_above_what_it_came_down_from(raised, height):
    """From a wall's top, which it met on its way to where it was to begin, it had led down once for each step."""
    seen = Observation(0.0, pose_at([0.0, 0.0, LOW]), np.zeros(3), np.zeros(3))
    line = Line(1, 0.0, -0.03, 0.05, LOW + RAISE if raised else LOW, raised=raised)
    assert above_what_was_met(line, seen, task(), 0.01, 0.057).height == pytest.approx(height)


def level_contour(place, normal, reason=None, force=0.8):
    """A tip that follows a wall in the level plane at a place (3,), with something touched above the sphere or not."""
    tip, place, normal = Tip(task(approach=0.03)), np.array(place), np.array(normal)
    met = place - 0.005 * normal if reason is None else place + np.array([0.0, 0.002, 0.03])
    met = Contact(0.0, met, normal, force * normal, place, 1.0 if reason is None else 0.0, reason)
    tip.overhangs = Overhangs(AREA, tip.task.probe, 0.015)
    tip.observe(Observation(0.0, pose_at(place), np.zeros(3), force * normal, met))
    tip.control.begin(normal)
    return tip, TrackingFrame.around(AREA, 1.0, place[2])


def test_a_level_contour_below_what_is_taller_is_as_slow_as_the_stick_may_be_met():
    """Nothing but the stick would meet what stands out of a wall above the sphere."""
    wall, here = np.array([-1.0, 0.0, 0.0]), [0.0, 0.0, LOW]
    tip, frame = level_contour(here, wall)
    fast = float(np.linalg.norm(slide(tip, frame, wall, "").velocity[:2]))
    assert fast == pytest.approx(tip.task.contour_speed, rel=0.1), "nothing near is taller"
    touch(tip.overhangs, [0.0, -0.01, HIGH], wall)
    slow = tip.control.stick_speed(HIGH - LOW)
    assert np.linalg.norm(slide(tip, frame, wall, "").velocity[:2]) == pytest.approx(slow, rel=0.1)
    assert slow < 0.5 * fast
    for step in np.linspace(-0.006, 0.006, 13):
        tip.overhangs.note(pose_at([0.0, step, LOW]), None)
    assert np.linalg.norm(slide(tip, frame, wall, "").velocity[:2]) == pytest.approx(fast), "the stick stood there"


@pytest.mark.parametrize(("reason", "end"), [(Doubt.AXIS_MISSES, Ended.SHAFT_CONTACT), (None, Ended.RELEASED)])
def test_a_level_contour_whose_stick_has_met_something_does_not_press_on(reason, end):
    tip, frame = level_contour([0.0, 0.0, LOW], [-1.0, 0.0, 0.0], reason, force=2.5)
    skill = release(tip, frame)
    next(skill)
    with pytest.raises(StopIteration) as stop:
        skill.send(tip.observe(Observation(0.008, pose_at([0.0, 0.0, LOW]), np.zeros(3), np.array([-0.5, 0.0, 0.0]))))
    assert stop.value.value is end


def test_where_a_level_contour_has_met_something_with_the_stick_the_probe_goes_back_the_way_it_came():
    strategy = SurfaceContour()
    strategy.start(task())
    strategy.tip.observe(Observation(0.0, pose_at([0.0, 0.0, LOW]), np.zeros(3), np.zeros(3)))
    strategy.drive.frame = strategy.drive.frame.horizontal(1.0)
    assert strategy.next_skill(Ended.SHAFT_CONTACT) is None, "the line is given up"
    assert strategy.retractions.back == strategy.options.retreat
    assert strategy.tip.overhangs.found
    assert not strategy.lines.next(strategy.tip.here).raised, "it was no line that led in under that"


@pytest.mark.parametrize("felt", [False, True])
def test_a_line_that_is_raised_once_more_does_not_go_down_to_the_same_foot_again(felt):
    """It went down and up again with every 2.5 mm that it was raised by, to above the top of what overhangs."""
    strategy = SurfaceContour()
    strategy.start(task())
    tip = strategy.tip
    tip.observe(Observation(0.0, pose_at([0.0, 0.0, 0.02]), np.zeros(3), np.zeros(3)))
    line = Line(1, 0.0, -0.05, 0.05, 0.02, raised=True, foot_followed=felt)
    strategy.approach(line).close()
    tip.control.begin(np.array([0.0, -1.0, 0.0]))
    tip.trace.ended = guarded_move
    strategy.drive.along_surface().close()
    assert strategy.drive.frame.backward == (not felt)
    assert strategy.drive.raise_line() is None
    assert strategy.lines.next(tip.here).foot_followed


@pytest.mark.parametrize(("height", "down"), [(0.02, True), (LOW, False)])
def test_a_line_up_a_side_that_meets_it_above_its_foot_follows_it_down_before_it_goes_up(height, down):
    strategy = GridVersion()
    strategy.start(task())
    strategy.tip.observe(Observation(0.0, pose_at([0.0, 0.0, height]), np.zeros(3), np.zeros(3)))
    strategy.approach(Line(1, 0.0, -0.05, 0.05, height, low=True)).close()
    strategy.tip.control.begin(np.array([0.0, -1.0, 0.0]))
    strategy.tip.trace.ended = guarded_move
    strategy.drive.along_surface().close()
    assert strategy.drive.frame.backward is down


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_line_that_the_body_stops_is_given_up_where_it_cannot_go_on_higher(goes_on, monkeypatch):
    strategy, given_up = GridVersion(), []
    strategy.start(task())
    strategy.tip.observe(Observation(0.0, pose_at([0.0, -0.03, LOW]), np.zeros(3), np.zeros(3)))
    line = Line(1, 0.0, -0.05, 0.05, LOW, low=True, ceiling=0.04)
    strategy.approach(line).close()
    strategy.tip.trace.ended = guarded_move
    monkeypatch.setattr(strategy.lines, "go_on_higher", lambda line, here, rotation: goes_on)
    monkeypatch.setattr(strategy.lines, "give_up", lambda line, *given: given_up.append(line))
    assert strategy.answer_interruption(UnknownSpace()) is None
    assert given_up == ([] if goes_on else [line])


def test_a_line_reached_in_passing_has_a_foot_of_its_own():
    """That of the line before had been followed down: after it was raised, this one did not go down to its own."""
    strategy = SurfaceContour()
    going_in_under(strategy)
    assert strategy.drive.foot_followed
    strategy.drive.next_in_passing().close()
    assert not strategy.drive.foot_followed


def going_in_under(strategy):
    """A strategy on the way down to the foot of a line that was raised."""
    strategy.start(task())
    tip = strategy.tip
    tip.observe(Observation(0.0, pose_at([0.0, 0.0, 0.02]), np.zeros(3), np.zeros(3)))
    strategy.approach(Line(1, 0.0, -0.05, 0.05, 0.02, raised=True)).close()
    tip.control.begin(np.array([0.0, -1.0, 0.0]))
    tip.trace.ended = guarded_move
    strategy.drive.along_surface().close()
    assert strategy.drive.frame.backward


@pytest.mark.parametrize("why", [UnknownSpace, CollisionThreat])
@pytest.mark.parametrize("kind", [SurfaceContour, GridVersion, OrientationChange])
def test_from_a_foot_that_was_felt_every_strategy_goes_up_again(kind, why):
    """Where the body would have come into unknown space `orientation_change` gave the line up, and touched no top."""
    strategy = kind()
    going_in_under(strategy)
    assert strategy.answer_interruption(why()) is not None
    assert not strategy.drive.frame.backward
    assert not strategy.drive.frame.level


def test_the_stick_is_met_no_higher_than_from_where_it_has_stood(overhangs):
    here = np.array([0.0, -0.012, LOW])
    assert overhangs.reach(here) == overhangs.reach(here, ALONG) > 0.02
    for y in np.arange(-0.05, 0.0, 0.001):
        overhangs.note(pose_at([0.0, y, LOW + 0.01]), None)
    assert overhangs.reach(here, ALONG) == pytest.approx(0.01)
    assert overhangs.reach(np.array([0.0, -0.012, LOW + 0.02]), ALONG) == 0.0
    assert overhangs.reach(np.array([0.01, -0.012, LOW]), ALONG) == overhangs.reach(here), "beside it has not"


def test_the_stick_is_met_no_higher_than_what_is_known_to_be_tallest_or_was_touched_since():
    overhangs = Overhangs(AREA, task().probe, 0.015, tallest=LOW + 0.01)
    place = np.array([0.01, -0.012, LOW])
    assert overhangs.reach(place) == pytest.approx(0.01)
    touch(overhangs, [0.0, -0.01, LOW + 0.02], [0.0, -1.0, 0.0], 1)
    assert overhangs.reach(place) == pytest.approx(0.02)


def test_the_rounded_top_edge_of_a_round_wall_does_not_stand_out_over_the_wall_beside():
    """Walls of a cylinder had been climbed as if something stood out above."""
    radius, top = 0.025, 0.05
    overhangs = Overhangs(AREA, task().probe, 0.015)
    for z in np.arange(0.006, top, 0.001):
        touch(overhangs, [0.0, radius + 0.005, z], [0.0, 1.0, 0.0])
    for angle in np.radians(np.arange(0.0, 90.0, 3.0)):
        out, up = np.cos(angle), np.sin(angle)
        touch(overhangs, [0.0, radius + 0.005 * out, top + 0.005 * up], [0.0, out, up])
    side = np.array([0.5, np.sqrt(0.75), 0.0])
    assert not overhangs.above(np.array([0.0, 0.0, 0.02]) + 0.03 * side, side)
    ledge = np.array([0.0, np.cos(1.1), np.sin(1.1)])  # the upper edge of one that stands out by 2 mm
    touch(overhangs, [0.0, radius + 0.007 + 0.005 * ledge[1], 0.03 + 0.005 * ledge[2]], ledge)
    assert overhangs.above(np.array([0.0, radius + 0.005, 0.02]), np.array([0.0, 1.0, 0.0]))
