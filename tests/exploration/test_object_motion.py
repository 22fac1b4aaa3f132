import numpy as np
import pytest

from lwrprobe.contracts import Contact, Doubt
from lwrprobe.exploration.stages.object_motion import ObjectMotionMonitor, ObjectMoved
from lwrprobe.exploration.stages.object_motion_kernels import deepest

RADIUS = 0.005
NOTHING = np.zeros(3)


def watch(**options) -> ObjectMotionMonitor:
    return ObjectMotionMonitor(RADIUS, 0.0006, 0.2, **options)


def touch(monitor: ObjectMotionMonitor, time: float, centre: np.ndarray, normal: np.ndarray, tilt: float = 0.0) -> None:
    """A contact on a surface with that normal; the one estimated leans by `tilt` rad along y."""
    lean = normal + np.tan(tilt) * np.array([0.0, 1.0, 0.0])
    lean /= np.linalg.norm(lean)
    contact = Contact(time, centre - RADIUS * lean, lean, 0.8 * normal, centre)
    monitor.see(time, centre, 0.8 * normal, contact)


def along(start, end, spacing: float = 2e-4):
    start, end = np.array(start), np.array(end)
    count = int(np.linalg.norm(end - start) / spacing) + 1
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("tilt", [0.0, 0.1, -0.1])
def test_sliding_to_and_fro_over_a_plane_says_nothing(tilt):
    monitor = watch()
    for k, place in enumerate([*along((0, -0.03, 0), (0, 0.03, 0)), *along((0, 0.03, 0), (0, -0.03, 0))]):
        touch(monitor, 0.008 * k, place, UP, tilt)
    assert monitor.moved_since is None
    assert monitor.report()["pushed_mm"] < 0.1


@pytest.mark.parametrize(("confidence", "moved"), [(0.55, False), (1.0, True)])
def test_a_normal_of_low_confidence_that_is_wrong_is_no_surface(confidence, moved):
    """Where friction turns at an edge, normals were wrong by 45 degrees for some samples; the contour then goes on."""
    monitor, wrong = watch(), np.array([0.0, -1.0, -1.0]) / np.sqrt(2.0)

    def round_an_edge():
        for k, z in enumerate(np.arange(0.0, 0.002, 0.0006)):
            place = np.array([0.0, 0.0, z])
            contact = Contact(0.1 * k, place - RADIUS * wrong, wrong, 0.8 * wrong, place, confidence)
            monitor.see(0.1 * k, place, 0.8 * wrong, contact)
        for k, z in enumerate(np.arange(0.002, 0.006, 0.0006)):
            touch(monitor, 1.0 + 0.1 * k, np.array([0.0, 0.3 * z, z]), np.array([0.0, -1.0, 0.0]))

    if moved:
        with pytest.raises(ObjectMoved, match="contradict"):
            round_an_edge()
    else:
        round_an_edge()
        assert monitor.moved_since is None


def test_an_object_that_is_pushed_by_the_touch_is_noticed_within_two_millimetres():
    monitor = watch()
    gone = []

    def push():
        for k, place in enumerate(along((0, 0, 0), (0, 0.02, 0.02))):  # up its side, and into it as much
            gone.append(place[1])
            touch(monitor, 0.008 * k, place, np.array([0.0, -1.0, 0.0]))

    with pytest.raises(ObjectMoved, match="gave way"):
        push()
    assert gone[-1] < 0.002
    assert monitor.moved_since == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("rate", [125.0, 10.0])
def test_a_push_is_noticed_however_rarely_the_sensor_reads(rate):
    monitor = watch(rate=rate)

    def push():
        for k, place in enumerate(along((0, 0, 0), (0, 0.02, 0.02))):
            touch(monitor, k / rate, place, np.array([0.0, -1.0, 0.0]))

    with pytest.raises(ObjectMoved, match="gave way"):
        push()


def test_an_object_too_light_for_a_contact_is_noticed_by_the_force_that_does_not_grow():
    monitor = watch()

    def push():
        for k, place in enumerate(along((0, 0, 0), (0, 0.02, 0))):
            monitor.see(0.008 * k, place, np.array([0.0, -0.15, -0.05]), None)

    with pytest.raises(ObjectMoved, match="gave way"):
        push()


def test_while_the_stick_touches_the_path_of_the_sphere_says_nothing():
    """It turns about what the stick leans on, against the force, which falls below a contact's now and then."""
    monitor, force = watch(), np.array([0.0, -0.15, 0.0])
    for k, place in enumerate(along((0, 0, 0), (0, 0.01, 0))):
        by_stick = Contact(0.008 * k, NOTHING, NOTHING, 2 * force, place, 0.0, Doubt.AXIS_MISSES)
        monitor.see(0.008 * k, place, force * (1 + k % 2), by_stick if k % 2 else None)
    assert monitor.report()["pushed_mm"] == 0.0


def test_pressing_into_something_soft_is_no_movement():
    monitor = watch()
    for k, place in enumerate(along((0, 0, 0), (0, 0.004, 0), 4e-5)):
        force = np.array([0.0, -200.0 * place[1], 0.0])
        monitor.see(0.008 * k, place, force, None, compliance=1.0 / 200.0)
    assert monitor.moved_since is None


@pytest.mark.parametrize(("shift", "noticed"), [(0.0003, False), (0.001, True), (-0.001, True)])
def test_lines_that_cross_tell_of_a_movement_in_between(shift, noticed):
    monitor = watch()
    for k, place in enumerate(along((0, -0.02, 0), (0, 0.02, 0))):
        touch(monitor, 0.008 * k, place, UP)

    def cross():
        for k, place in enumerate(along((-0.02, 0, shift), (0.02, 0, shift), 1e-4)):
            touch(monitor, 10.0 + 0.008 * k, place, UP)

    if noticed:
        with pytest.raises(ObjectMoved, match="contradict"):
            cross()
        assert monitor.moved_since == pytest.approx(11.6, abs=0.3)
    else:
        cross()


def test_free_flight_through_what_was_touched_is_noticed():
    monitor = watch()
    for k, place in enumerate(along((0, -0.02, 0), (0, 0.02, 0))):
        touch(monitor, 0.008 * k, place, UP)

    def fly():
        for place in along((0, -0.02, -0.003), (0, 0.02, -0.003)):
            monitor.see(5.0, place, NOTHING, None)

    with pytest.raises(ObjectMoved, match="contradict"):
        fly()


def test_both_faces_of_a_thin_plate_are_no_contradiction():
    monitor = watch()
    for side in (1.0, -1.0):
        for place in along((0, side * 0.00525, 0), (0, side * 0.00525, 0.03)):
            touch(monitor, 0.0, place, np.array([0.0, side, 0.0]))
        monitor.see(0.0, np.array([0.0, 0.0, 0.05]), NOTHING, None)
    assert monitor.moved_since is None


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("lean", [-0.29, -0.17])
def test_a_normal_that_the_force_denies_is_a_sensor_that_disagrees_and_no_movement(friction, lean):
    """A sensor whose torque is wrong turns the normals against the slide; the force stays in its cone."""
    monitor = watch()
    leaning = np.array([0.0, np.sin(lean), np.cos(lean)])
    force = 0.8 * (UP - friction * np.array([0.0, 1.0, 0.0]))
    for k, place in enumerate(along((0, -0.03, 0), (0, 0.03, 0))):
        contact = Contact(0.008 * k, place - RADIUS * leaning, leaning, force, place)
        monitor.see(0.008 * k, place, force, contact)
    assert monitor.moved_since is None
    told = monitor.report()["torque_disagreement"]
    assert told == (pytest.approx(np.sin(-lean), abs=0.02) if lean < -0.2 else pytest.approx(0.169, abs=0.01))


def test_normals_that_are_right_tell_of_no_disagreement():
    monitor = watch()
    for k, place in enumerate([*along((0, -0.03, 0), (0, 0.03, 0)), *along((0, 0.03, 0), (0, -0.03, 0))]):
        touch(monitor, 0.008 * k, place, UP, 0.1)
    assert monitor.report()["torque_disagreement"] == 0.0


def test_the_force_direction_alone_is_given_more_room():
    """Without a normal free of friction, a lean by friction is not even a disagreement."""

    def slide(**options):
        monitor = watch(**options)
        for k, place in enumerate(along((0, -0.02, 0), (0, 0.02, 0))):
            touch(monitor, 0.008 * k, place, UP, tilt=-0.29)  # friction 0.3, for which the normal is not corrected
        return monitor.report()["torque_disagreement"]

    assert slide(knows_friction=False) == 0.0
    assert slide(knows_friction=True) > 0.2


@pytest.mark.parametrize(("zero", "noticed"), [(0.0, True), (0.03, False)])
def test_a_small_force_whose_zero_is_wrong_points_anywhere(zero, noticed):
    """Sliding on with 0.12 N, of which the zero of the sensor turns the direction by 25 degrees more than friction."""
    monitor, moved = watch(), False
    force = 0.12 * np.array([0.0, -np.sin(0.9), np.cos(0.9)])
    for k, place in enumerate(along((0, 0, 0), (0, 0.03, 0))):
        try:
            monitor.see(0.008 * k, place, force, None, zero=zero)
        except ObjectMoved:
            moved = True
            break
    assert moved is noticed


@pytest.mark.parametrize(("zero", "noticed"), [(0.01, True), (0.1, False)])
def test_a_force_that_may_be_the_zero_alone_is_no_touch(zero, noticed):
    """After a long contact the sphere leaves a wall; what the sensor's zero has drifted by reads as a touch."""
    monitor, moved = watch(), False
    outwards = np.array([0.0, 1.0, 0.0])
    for k, place in enumerate(along((0, 0, 0.02), (0, 0, 0))):
        touch(monitor, 0.008 * k, place, outwards)
    for k, place in enumerate(along((0, 0, 0), (0, 0.01, 0)), 200):
        contact = Contact(0.008 * k, place - RADIUS * outwards, outwards, 0.21 * outwards, place)
        try:
            monitor.see(0.008 * k, place, 0.21 * outwards, contact, zero=zero)
        except ObjectMoved:
            moved = True
            break
    assert moved is noticed


def test_the_kernel_agrees_with_its_definition():
    random = np.random.default_rng(1)
    for _ in range(200):
        places = random.normal(0.0, 0.003, (20, 3))
        normals = random.normal(size=(20, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals[random.random(20) < 0.5] = 0.0
        centre, normal = random.normal(0.0, 0.002, 3), np.array([0.6, 0.0, 0.8])
        sticks, stick = random.normal(size=(20, 3)), random.normal(size=3)
        for touching in (False, True):
            worst = 0.0
            for place, own, held in zip(places, normals, sticks):
                less = 0.0005 * np.linalg.norm(stick - held)
                displacement = centre - place
                for axis, sign in ((own, -1.0), (normal, 1.0)):
                    depth = sign * float(displacement @ axis)
                    asked = own.any() if sign < 0.0 else touching
                    if asked and depth <= 0.0075 and np.linalg.norm(displacement - sign * depth * axis) <= 0.001:
                        worst = max(worst, depth - less)
            found = deepest(places, normals, sticks, 20, centre, normal, stick, 0.0005, touching, 0.001, 0.0075)
            assert found == pytest.approx(worst)


@pytest.mark.parametrize(("turn", "moved"), [(0.0, True), (0.7, False)])
def test_touches_in_another_orientation_may_contradict_by_what_arm_and_probe_are_uncertain(turn, moved):
    """A table that is 0.05 degrees off moves the sphere by a millimetre where the stick leans by 40 degrees."""
    monitor = ObjectMotionMonitor(RADIUS, 0.0006, 0.2, turned=0.0022)
    for k, x in enumerate(np.arange(0.0, 0.01, 0.001)):
        monitor.see(0.008 * k, np.array([x, 0.0, 0.0]), NOTHING, None)
    stick = np.array([0.0, np.sin(turn), -np.cos(turn)])

    def touch_deeper():
        for k, x in enumerate(np.arange(0.0, 0.01, 0.001)):
            place = np.array([x, 0.0, 0.00096])
            contact = Contact(1.0 + k, place - RADIUS * UP, UP, 0.8 * UP, place)
            monitor.see(1.0 + k, place, 0.8 * UP, contact, stick=stick)

    if moved:
        with pytest.raises(ObjectMoved, match="contradict each other by 1"):
            touch_deeper()
    else:
        touch_deeper()
        assert monitor.moved_since is None
