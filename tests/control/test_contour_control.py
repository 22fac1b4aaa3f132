"""Speeds and forces of a contour: never faster than what the hardest surface ahead allows."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.contracts import InputError
from lwrprobe.control import run_on
from lwrprobe.control.contour_control import FORCE_RESERVE, ContourControl
from lwrprobe.control.contour_kernels import FRICTION
from strategy_task import DOWN, task


def stiffness_along(t, normal):
    """N/m of object, arm and stick in series along a normal, for a stick along z."""
    give = t.probe.compliance[0] * (normal[0] ** 2 + normal[1] ** 2) + t.probe.compliance[2] * normal[2] ** 2
    return 1.0 / (1.0 / t.stiffness + give)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: sqrt(sum(x * x for x in v)) > 0.1),
    st.floats(1e3, 1e6),
)
def test_no_surface_ahead_is_hit_harder_than_the_room_allows(direction, stiffness):
    t = task(stiffness=stiffness)
    d = np.array(direction) / np.linalg.norm(direction)
    speed = ContourControl(t).approach_speed(d, DOWN)
    random = np.random.default_rng(1)
    normals = random.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:2] = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    hardest = max(stiffness_along(t, n) * max(float(d @ n), 0.0) for n in normals)
    force = t.force_threshold + hardest * (speed * t.delay + speed**2 / (2.0 * t.acceleration))
    assert force <= FORCE_RESERVE * t.force_limit * 1.02
    assert force >= 0.8 * FORCE_RESERVE * t.force_limit, "and no slower than that asks for"


@pytest.mark.parametrize("mass", [0.5, 3.2, 16.0])
def test_no_surface_ahead_is_struck_harder_by_an_arm_with_mass(mass):
    """K (v (tau + T) + v^2 / 2a) over all normals stays within the room, with the run-on T of each normal."""
    arm = 2.2e4
    t, light = replace(task(), arm_mass=mass, arm_stiffness=arm), ContourControl(task())
    control, random = ContourControl(t), np.random.default_rng(2)
    normals = random.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for direction in random.normal(size=(20, 3)):
        d = direction / np.linalg.norm(direction)
        speed, back = control.approach_speed(d, DOWN), control.return_speed(d, DOWN)
        for n in normals[normals @ d > 0.05]:
            k = stiffness_along(t, n)
            late, depth = t.delay + run_on(mass, k, arm), float(n @ d)
            force = t.force_threshold + k * depth * (speed * late + speed**2 / (2.0 * t.acceleration))
            assert force <= FORCE_RESERVE * t.force_limit * 1.02
            assert k * depth * back * run_on(mass, k, arm) <= 0.5 * t.force_target * 1.02
        assert back <= speed < light.approach_speed(d, DOWN)
        again = light.return_speed(d, DOWN)
        assert 0.5 * light.approach_speed(d, DOWN) < again < light.approach_speed(d, DOWN)


@pytest.mark.parametrize("torque", [0.03, 0.06, 0.096])
def test_no_surface_ahead_twists_the_sensor_beyond_its_limit(torque):
    """Across the stick the lever brings the torque to its limit before the force is at its own."""
    t, random = replace(task(), torque_limit=torque), np.random.default_rng(3)
    control, unlimited = ContourControl(t), ContourControl(task())
    normals = random.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:2] = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    slower = 0
    for direction in [np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), *random.normal(size=(20, 3))]:
        d = direction / np.linalg.norm(direction)
        speed = control.approach_speed(d, DOWN)
        for n in normals[normals @ d > 0.05]:
            push = float(n @ d) * (speed * t.delay + speed**2 / (2.0 * t.acceleration))
            force = t.force_threshold + stiffness_along(t, n) * push
            assert force <= FORCE_RESERVE * t.force_limit * 1.02
            assert force * np.hypot(n[0], n[1]) * t.probe.sensor_distance <= torque * 1.02
        assert speed <= unlimited.approach_speed(d, DOWN)
        slower += speed < unlimited.approach_speed(d, DOWN)
    assert slower > 0 or torque > 0.05
    assert control.approach_speed(np.array([0.0, 0.0, 1.0]), DOWN) > 0.0


def test_a_torque_limit_below_that_of_a_touch_is_refused():
    with pytest.raises(InputError, match="torque_range"):
        ContourControl(replace(task(), torque_limit=0.9 * task().force_threshold * task().probe.sensor_distance))


def test_a_task_may_ask_for_less():
    assert ContourControl(task(approach=0.001)).approach_speed(np.array([1.0, 0.0, 0.0]), DOWN) == 0.001


@pytest.mark.parametrize("travel", [1.0, -1.0])
def test_a_wall_is_left_downwards_more_slowly_than_it_is_climbed(travel):
    control = ContourControl(task())
    binormal = (travel, 0.0, 0.0)
    up, down = np.array([0.0, -travel, 0.0]), np.array([0.0, travel, 0.0])
    speeds = {}
    for name, normal in (("up", up), ("down", down)):
        control.begin(normal)
        velocity = control.velocity(normal, 0.8, binormal, 0.02, DOWN, 0.008)
        speeds[name] = velocity[2]
    assert speeds["up"] == pytest.approx(0.02, rel=0.05)
    assert -0.012 < speeds["down"] < 0.0


def test_too_much_force_yields_and_too_little_presses():
    control = ContourControl(task())
    normal = np.array([0.0, 0.0, 1.0])
    binormal = (1.0, 0.0, 0.0)
    for force, sign in ((1.6, 1.0), (0.3, -1.0)):
        control.begin(normal)
        velocity = control.velocity(normal, force, binormal, 0.02, DOWN, 0.008)
        assert np.sign(velocity @ normal) == sign
        assert velocity[1] > 0.0


@pytest.mark.parametrize("stiffness", [2e3, 2e4, 3e5])
def test_down_a_wall_the_foot_and_the_wall_together_stay_within_the_room(stiffness):
    t = replace(task(stiffness=stiffness), contour_speed=1.0)
    control = ContourControl(t)
    wall = np.array([0.0, -1.0, 0.0])
    control.begin(wall)
    down = -float(control.velocity(wall, t.force_target, (-1.0, 0.0, 0.0), 1.0, DOWN, 0.008)[2])
    assert down > 0.0
    assert control.descent_speed(DOWN) == pytest.approx(down, rel=0.02), "what planning reckons with"
    up = stiffness_along(t, (0.0, 0.0, 1.0))
    foot = t.force_threshold + up * (down * t.delay + down**2 / (2.0 * t.acceleration))
    assert np.hypot(foot + 0.5 * t.force_target, t.force_target) <= FORCE_RESERVE * t.force_limit * 1.001


@pytest.mark.parametrize("slope", [20, 40, 60, 80])
def test_down_a_slope_its_own_force_leaves_less_to_what_is_met(slope):
    """The vector sum of what slope, friction and a foot press with, for a foot that is met along the stick."""
    t = replace(task(), contour_speed=1.0)
    control, angle = ContourControl(t), np.radians(slope)
    normal, tangent = np.array([0.0, -np.sin(angle), np.cos(angle)]), np.array([0.0, -np.cos(angle), -np.sin(angle)])
    control.begin(normal)
    velocity = control.velocity(normal, t.force_target, (-1.0, 0.0, 0.0), 1.0, DOWN, 0.008)
    down, speed = -float(velocity[2]), float(np.linalg.norm(velocity))
    assert velocity @ tangent == pytest.approx(speed)
    push = down * t.delay + speed * down / (2.0 * t.acceleration)
    foot = t.force_threshold + stiffness_along(t, (0.0, 0.0, 1.0)) * push
    slid = t.force_target * (normal - FRICTION * tangent)
    total = np.linalg.norm(slid + np.array([0.0, 0.0, foot]))
    assert total <= FORCE_RESERVE * t.force_limit * 1.001
    assert total >= 0.7 * FORCE_RESERVE * t.force_limit, "and no slower than that asks for"


@pytest.mark.parametrize("slope", [20, 40, 60])
def test_between_a_slope_and_its_stick_the_sphere_presses_no_harder_than_the_room_allows(slope):
    """The stick meets the other side of a gap: what holds the sphere along the stick is the slope's force alone."""
    t, angle = task(), np.radians(slope)
    control = ContourControl(t)
    normal, tangent = np.array([0.0, -np.sin(angle), np.cos(angle)]), np.array([0.0, -np.cos(angle), -np.sin(angle)])
    control.begin(normal)
    speed = control.wedge_speed(tangent, DOWN)
    push = -speed * tangent[2] * (t.delay + speed / (2.0 * t.acceleration))
    pressed = t.force_target + t.force_threshold + stiffness_along(t, (0.0, 0.0, 1.0)) * push / normal[2]
    assert pressed <= FORCE_RESERVE * t.force_limit
    assert pressed >= 0.65 * FORCE_RESERVE * t.force_limit, "and no slower than that asks for"
    assert control.wedge_speed(-tangent, DOWN) == np.inf, "upwards nothing is wedged"


def test_down_a_steep_slope_a_wedge_gives_way_sideways():
    """However steep: sphere and stick come to rest nowhere."""
    control = ContourControl(task())
    control.begin(np.array([0.0, -1.0, 0.01]))
    assert control.wedge_speed(np.array([0.0, -0.01, -1.0]), DOWN) > 0.2 * control.approach_speed(DOWN[:, 2], DOWN)


def test_off_a_wall_by_a_normal_that_leads_down_the_tip_is_no_faster_down_than_an_approach():
    """Friction on a wall turns the normal; what stands below is met as hard as in any approach, at most."""
    t = task()
    control, reached = ContourControl(t), 0.0
    down = control.approach_speed(np.array([0.0, 0.0, -1.0]), DOWN)
    for lean in np.radians([0.0, 5.0, 15.0, 30.0]):
        normal = np.array([0.0, -np.cos(lean), -np.sin(lean)])
        control.begin(normal)
        velocity = control.velocity(normal, 2.8, (1.0, 0.0, 0.0), 0.0, DOWN, 0.008)
        release = control.release_velocity(2.8 * normal, DOWN)
        for v in (velocity, release):
            assert -v[2] <= 1.001 * down
            assert v @ normal > 0.0
        reached = max(reached, -release[2])
    assert reached > 0.9 * down


def velocity_of(t, control, last, steady, before, normal, force, binormal, speed, rotation, period):
    """The tracked normal, the steady part and the velocity, written down with vectors."""
    mean = 0.5 * last + 0.5 * normal
    n = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 0.1 else normal
    onward = np.cross(last, binormal)
    onward /= max(np.linalg.norm(onward), 1e-6)
    excess = n @ onward - 1.25 * speed * period / t.probe.radius - 0.01
    if excess > 0.0 and np.linalg.norm(mean) > 0.1:
        n = n - excess * onward
        n /= np.linalg.norm(n)
    angle = max(np.arccos(min(abs(n @ rotation[:, 2]), 1.0)) - 0.35, 0.0)
    lateral, _, along = t.probe.compliance
    stiffness = 1.0 / (1.0 / t.stiffness + np.sin(angle) ** 2 * lateral + np.cos(angle) ** 2 * along)
    damping, error = np.e * stiffness * t.delay, force - t.force_target
    inward = min(control.approach_speed(n, rotation), 0.01)
    growth = error + max(force - before, 0.0) / period * t.delay
    needed = np.clip(1.0 - growth / t.force_target, 0.0, 1.0)
    steady = np.clip(steady + error * period / (damping * 8.0 * t.delay), -0.5 * inward * needed, 0.5 * speed)
    outward = min(0.05, control.approach_speed(rotation[:, 2], rotation) / max(n @ rotation[:, 2], 1e-9))
    press = np.clip(error / damping + steady, -inward, outward)
    tangent = np.cross(n, binormal)
    tangent /= np.linalg.norm(tangent)
    slide = min(speed, t.force_target / (stiffness * t.delay * 0.08))
    if tangent @ rotation[:, 2] > 0.3:
        limit, pressed = FORCE_RESERVE * t.force_limit, t.force_target * np.array([1.0, FRICTION])
        up = pressed @ [-n @ rotation[:, 2], tangent @ rotation[:, 2]]
        foot = np.sqrt(limit**2 - max(pressed @ pressed - up**2, 0.0)) - up - t.force_threshold
        slide = min(slide, foot / (limit - t.force_threshold) * control.approach_speed(tangent, rotation))
    slide *= np.clip(1.0 - max(abs(error), growth) / (FORCE_RESERVE * t.force_limit - t.force_target), 0.1, 1.0)
    return n, steady, slide * tangent + press * n


@pytest.mark.slow
def test_the_velocity_is_that_of_the_law_along_the_tracked_normal_and_the_tangent():
    t, random = task(), np.random.default_rng(3)
    control, tracked, steady, dives = ContourControl(t), np.array([0.0, -1.0, 0.0]), 0.0, 0
    control.begin(tracked)
    before = np.inf
    for _ in range(3000):
        normal = tracked + random.normal(scale=0.2, size=3)
        if random.random() < 0.02:
            normal = -tracked + 0.01 * normal  # the surface on the other side of a slot
        normal /= np.linalg.norm(normal)
        lean = random.uniform(-0.4, 0.4)
        rotation = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]]) @ DOWN
        binormal = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)][random.integers(3)]
        force, speed, period = random.uniform(0.0, 2.5), random.uniform(0.0, 0.04), random.uniform(1e-3, 0.02)
        given = normal, force, binormal, speed, rotation, period
        tracked, steady, expected = velocity_of(t, control, tracked, steady, before, *given)
        before = force
        np.testing.assert_allclose(control.velocity(*given), expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(control.normal, tracked, atol=1e-12)
        dives += np.cross(tracked, binormal) @ rotation[:, 2] > 0.3
    assert dives > 100


def peak_on_a_plane(tilt, stiffer, away=0.0):
    """N, largest force on a level plane that is `stiffer` times as stiff as stated, with all normals `tilt` rad off.

    Before, for 1 s, the surface turned away from the probe at `away` m/s, as around an edge.
    """
    t, period = task(), 0.008
    control, up = ContourControl(t), np.array([0.0, 0.0, 1.0])
    stiffness = stiffer * stiffness_along(t, up)
    wrong = np.array([0.0, -np.sin(tilt), np.cos(tilt)])  # the sliding along it leads down
    late = round(t.delay / 1e-3)
    commands, depth, peak = [0.0] * late, t.force_target / stiffness, 0.0
    control.begin(up)
    velocity = np.zeros(3)
    for k in range(-1000 if away else 0, 600):
        force = max(stiffness * depth, 0.0)
        if k % 8 == 0:
            normal = wrong if k >= 64 else up
            velocity = control.velocity(normal, force * np.cos(tilt), (-1.0, 0.0, 0.0), 0.02, DOWN, period)
        commands.append(velocity[2])
        depth -= 1e-3 * (commands[-1 - late] + (away if k < 0 else 0.0))
        peak = max(peak, force)
    return peak


def test_a_wrong_normal_does_not_lead_the_sliding_into_a_stiff_surface():
    for tilt, stiffer in ((0.15, 2.0), (0.25, 1.0)):
        assert peak_on_a_plane(tilt, stiffer) < 0.9 * task().force_limit
    assert peak_on_a_plane(0.0, 1.0) <= 1.001 * task().force_target


def test_the_flat_behind_an_edge_is_not_pressed_with_what_the_edge_took():
    """The steady part that had pressed after the surface kept pressing, with twice the wanted force."""
    t = task()
    lost = t.force_target / (np.e * t.delay * stiffness_along(t, (0.0, 0.0, 1.0)))  # m/s, at which the contact is lost
    assert peak_on_a_plane(0.0, 1.0, away=1.2 * lost) < 1.95 * t.force_target


def test_a_normal_turns_towards_the_motion_no_faster_than_around_a_sharp_edge():
    """One sample with a wrong normal leads into the surface; around an edge the sphere rolls at its own radius."""
    t, control, up = task(), ContourControl(task()), np.array([0.0, 0.0, 1.0])
    control.begin(up)
    jump = np.array([0.0, np.sin(0.5), np.cos(0.5)])
    control.velocity(jump, t.force_target, (1.0, 0.0, 0.0), 0.02, DOWN, 0.008)
    assert np.arcsin(control.normal[1]) < 0.06
    control.begin(up)
    control.velocity(jump * (1.0, -1.0, 1.0), t.force_target, (1.0, 0.0, 0.0), 0.02, DOWN, 0.008)
    assert np.arcsin(-control.normal[1]) == pytest.approx(0.25, abs=1e-6), "what stands ahead is believed at once"
    control.begin(up)
    for k in range(100):  # around an edge at 20 mm/s
        angle = min(0.02 * 0.008 * k / t.probe.radius, 1.5)
        edge = np.array([0.0, np.sin(angle), np.cos(angle)])
        control.velocity(edge, t.force_target, (1.0, 0.0, 0.0), 0.02, DOWN, 0.008)
        assert np.arccos(min(control.normal @ edge, 1.0)) < 0.06


def test_parts_of_arrays_and_whole_numbers_are_taken_as_they_are():
    whole, parts = ContourControl(task()), ContourControl(task())
    for control in (whole, parts):
        control.begin(np.array([0.0, -1.0, 0.0]))
    pose, rows = np.eye(4), np.zeros((3, 5))
    pose[:3, :3], rows[:, 2] = DOWN, (0.0, -1.0, 0.0)
    ahead = (1.0, 0.0, 0.0), 0.02
    expected = whole.velocity(np.array([0.0, -1.0, 0.0]), 1.5, *ahead, DOWN.copy(), 0.008)
    np.testing.assert_array_equal(parts.velocity(rows[:, 2], 1.5, *ahead, pose[:3, :3], 0.008), expected)
    parts.normal = np.array([0, -1, 0])
    again = whole.velocity(np.array([0.0, -1.0, 0.0]), 1.5, *ahead, DOWN.copy(), 0.008)
    np.testing.assert_array_equal(parts.velocity(np.array([0, -1, 0]), 1.5, *ahead, pose[:3, :3], 0.008), again)


@pytest.mark.parametrize(("limit", "least"), [(3.0, 0.6), (1.2, 0.1)])
def test_a_wall_is_climbed_more_slowly_than_a_free_column_but_never_at_rest(limit, least):
    """A ledge above it was met with 3.7 N; and where the limit is near the wanted force, nothing was to spare."""
    control = ContourControl(replace(task(), force_limit=limit))
    assert least * control.column_speed < control.climb_speed < 0.8 * control.column_speed


def test_with_its_stick_on_a_wall_the_sphere_meets_an_eave_as_if_nothing_gave_way_sideways():
    t = task()
    control = ContourControl(t)
    push = control.held_speed * t.delay + control.held_speed**2 / (2.0 * t.acceleration)
    met = stiffness_along(t, (0.0, 0.0, 1.0)) * push + t.force_threshold
    assert np.hypot(met, t.force_target) <= FORCE_RESERVE * t.force_limit
    assert control.held_speed < 0.8 * control.climb_speed
