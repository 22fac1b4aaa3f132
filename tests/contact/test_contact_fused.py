"""The fused estimator on sequences: sliding, sticking, pressing, edges and inner edges."""

import naive_contact as naive
import numpy as np
import pytest

from lwrprobe.contact import RELIABLE_FROM, Settings, Wrench, make_estimator
from lwrprobe.contracts import Probe

PROBE = Probe()
DOWN = np.diag([1.0, -1.0, -1.0])
PERIOD = 0.008
X, Y, Z = np.eye(3)


def at_rate(rate):
    """Let all courses of this test have another sensor rate."""
    global PERIOD
    PERIOD = 1.0 / rate


@pytest.fixture(autouse=True)
def _usual_rate():
    yield
    at_rate(125.0)


def slide(normals, centres, velocities, mu, push):
    """(centre, velocity, true contacts) of a sphere that slides with Coulomb friction."""
    for n, c, v in zip(normals, centres, velocities):
        yield c, v, [(n, push * (n - mu * naive.unit(v)))]


def plane(n, direction, mu, push=1.0, speed=0.02, count=150):
    centres = [PROBE.radius * n + direction * speed * PERIOD * k for k in range(count)]
    return slide([n] * count, centres, [speed * direction] * count, mu, push)


def cylinder(mu, push=1.0, radius=0.024, speed=0.02):
    reach = radius + PROBE.radius
    angles = np.arange(-1.2, 1.2, speed * PERIOD / reach)
    normals = [np.cos(a) * Z + np.sin(a) * Y for a in angles]
    velocities = [speed * (np.cos(a) * Y - np.sin(a) * Z) for a in angles]
    return slide(normals, [reach * n for n in normals], velocities, mu, push)


def follow(sequence, seed=0, counts=1.0, speed_noise=3e-4, name="fused", estimator=None):
    """Errors [deg, mm], contacts and the estimator, over one sequence of (centre, velocity, contacts)."""
    rng = np.random.default_rng(seed)
    estimator = make_estimator(name, PROBE) if estimator is None else estimator
    errors, contacts = [], []
    for k, (centre, velocity, true) in enumerate(sequence):
        wrench = naive.contact_wrench(PROBE, DOWN, true, k * PERIOD, rng, counts)
        contact = estimator.estimate(wrench, centre, DOWN, velocity + speed_noise * rng.normal(size=3))
        n = true[0][0]
        point = centre - PROBE.radius * n
        errors.append((naive.angle(contact.normal, n), 1e3 * np.linalg.norm(contact.point - point)))
        contacts.append(contact)
    return np.array(errors), contacts, estimator


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.6])
@pytest.mark.parametrize(
    "path",
    [
        lambda mu: plane(Z, Y, mu),
        lambda mu: plane(-Y, -Z, mu),
        lambda mu: plane(-Y, X, mu),
        lambda mu: cylinder(mu),
    ],
    ids=["top", "side, down", "side, across", "cylinder"],
)
def test_sliding_at_one_newton_is_within_a_tenth_of_a_millimetre_and_one_degree(path, mu):
    errors, contacts, estimator = follow(path(mu))
    assert np.median(errors[:, 0]) <= 1.0
    assert np.median(errors[:, 1]) <= 0.10
    assert np.mean([c.confidence_score >= RELIABLE_FROM for c in contacts]) > 0.98
    friction, sigma = estimator.friction
    assert friction == pytest.approx(mu, abs=0.03)
    assert sigma < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_fast_sensors_are_no_worse(rate):
    at_rate(rate)
    for path in (plane(Z, Y, 0.3, count=int(0.8 * rate)), cylinder(0.3)):
        errors, contacts, _ = follow(path)
        assert np.median(errors[:, 0]) <= 1.0
        assert np.mean([c.confidence_score >= RELIABLE_FROM for c in contacts]) > 0.98


def test_fusing_beats_both_of_its_parts():
    for mu in (0.3, 0.6):
        medians = {
            name: np.median(follow(cylinder(mu), name=name)[0][:, 1])
            for name in ("fused", "wrench_axis", "force_direction")
        }
        assert medians["fused"] < 0.5 * medians["wrench_axis"]
        assert medians["fused"] < 0.1 * medians["force_direction"]


def test_pressing_without_sliding_averages_the_wrench_axis():
    """Friction anywhere in the tangent plane, nothing moves: the noise is averaged, no bias towards the force."""
    rng = np.random.default_rng(1)
    first, last = [], []
    for seed in range(40):
        t = rng.normal(size=2) * 0.25
        force = naive.unit(Z + t[0] * X + t[1] * Y)
        errors, _, _ = follow(((PROBE.radius * Z, 0.0 * X, [(Z, force)]) for _ in range(25)), seed)
        first.append(errors[0, 0])
        last.append(errors[-1, 0])
    assert np.median(last) < 0.75
    assert np.median(last) < 0.6 * np.median(first)


@pytest.mark.parametrize("force", [1.0, 3.0])
@pytest.mark.parametrize("friction", [0.4 * X, 0.4 * Y, -0.2 * X + 0.3 * Y], ids=["across", "pushing", "mixed"])
@pytest.mark.parametrize("moves", [0.0, 1.0], ids=["centre rests", "centre moves on"])
def test_a_sphere_that_sticks_while_the_arm_reports_motion_is_not_taken_for_sliding(force, friction, moves):
    travel = moves * 0.01 * PERIOD * Y
    sequence = ((PROBE.radius * Z + k * travel, 0.01 * Y, [(Z, force * naive.unit(Z + friction))]) for k in range(100))
    errors, _, estimator = follow(sequence)
    assert np.median(errors[:, 0]) < 1.0
    assert errors[10:, 0].max() < 3.0
    assert estimator.friction[1] > 0.1  # nothing was learnt from it


def test_a_slip_that_has_just_begun_need_not_take_all_of_a_known_friction():
    """The friction is well known, and the sphere lands anew and creeps: the normal had been turned by 25 degrees."""
    _, _, estimator = follow(plane(Z, Y, 0.46))
    assert estimator.friction[1] < 0.03
    estimator.reset()
    sequence = ((PROBE.radius * Z + 8e-6 * k * X, 1e-3 * X, [(Z, 1.2 * Z)]) for k in range(4))
    errors, _, _ = follow(sequence, estimator=estimator, speed_noise=0.0)
    assert errors[:, 0].max() < 10.0


@pytest.mark.parametrize("mu", [0.1, 0.3, 0.5])
def test_a_stick_that_slides_along_a_rim_just_above_the_sphere_is_not_taken_for_the_sphere(mu):
    """Sliding explains direction and friction of the force, and a zero that is off by 4 deviations its torque."""
    rng, step = np.random.default_rng(1), np.repeat([PROBE.force_resolution, PROBE.torque_resolution], 3)
    settings = Settings(zero_error=0.0085, zero_time=2.0, lag=0.012, lever_error=1.4e-4)
    estimator, speed, trusted = make_estimator("fused", PROBE, settings), 0.005, 0
    for k in range(90):
        height = 0.0052 + max(k - 12, 0) * PERIOD * speed  # of the rim above the centre of the sphere
        force = min(0.1 * (k + 1), 0.9) * (Y - mu * Z)  # sensor frame: z points down, the stick goes down
        rim = naive.lever(PROBE, force) - height * Z - PROBE.stick_radius * Y
        values = np.concatenate([force, np.cross(rim, force)]) + step * rng.normal(size=6)
        wrench = Wrench(k * PERIOD, values[:3], values[3:], DOWN @ values[:3])
        velocity = speed * (-Z if k > 8 else Y - Z) + 3e-4 * rng.normal(size=3)
        contact = estimator.estimate(wrench, -speed * PERIOD * k * Z, DOWN, velocity)
        trusted += contact.confidence_score >= RELIABLE_FROM
    assert trusted == 0


def test_a_sphere_that_turns_back_after_a_slide_sticks_first():
    """The arm swings back while friction still points against the slide: one normal had been wrong by 37 degrees."""
    course = list(plane(Z, Y, 0.46))
    last = course[-1][0]
    course += [(last - 2e-5 * (k + 1) * Y, -2.5e-3 * Y, [(Z, Z - (0.35 - 0.1 * k) * Y)]) for k in range(3)]
    errors, _, estimator = follow(course, speed_noise=0.0)
    assert estimator.friction[1] < 0.03
    assert errors[150:, 0].max() < 10.0


@pytest.mark.parametrize("drift", [0.006, 0.012])
def test_what_a_zero_does_to_all_normals_of_a_rest_is_in_their_stated_error(drift):
    """The mean over a hundred samples has little noise, and the zero's whole error: a tenth of it had been stated."""
    fused = make_estimator("fused", PROBE, Settings(zero_error=0.01, zero_time=2.0))
    rng = np.random.default_rng(5)
    for k in range(100):
        wrench = naive.contact_wrench(PROBE, DOWN, [(Z, 1.0 * Z)], k * PERIOD, rng)
        wrench.force[1] += drift
        contact = fused.estimate(wrench, PROBE.radius * Z, DOWN, np.zeros(3))
    stated = 0.1 * np.sqrt(1.0 / contact.confidence_score - 1.0)
    assert np.radians(naive.angle(contact.normal, Z)) < 2.5 * stated


@pytest.mark.parametrize("degrees", [0, 30, 60, 80])
def test_an_approach_is_not_taken_for_sliding(degrees):
    """The velocity points into the surface: the normal must not be turned away from it."""
    d = np.sin(np.radians(degrees)) * Y - np.cos(np.radians(degrees)) * Z
    sequence = ((PROBE.radius * Z + d * 8e-5 * k, 0.01 * d, [(Z, (0.2 + 0.2 * k) * (Z - 0.2 * Y))]) for k in range(12))
    errors, _, _ = follow(sequence)
    assert errors[4:, 0].max() < 8.0
    assert errors[-1, 0] < 2.0


def test_a_convex_edge_is_followed_without_rounding_and_stays_trusted():
    """A right-angled edge: the normal turns by 1.8 degrees a sample while the sphere rolls over it."""
    r, speed = PROBE.radius, 0.02
    angles = np.arange(0.0, np.pi / 2, speed * PERIOD / r)
    normals = [Z] * 60 + [np.cos(a) * Z + np.sin(a) * Y for a in angles] + [Y] * 60
    travel = speed * PERIOD
    centres = [r * Z - travel * (60 - k) * Y for k in range(60)]
    centres += [r * n for n in normals[60 : 60 + len(angles)]] + [r * Y - travel * k * Z for k in range(60)]
    velocities = (
        [speed * Y] * 60 + [speed * np.cross(-X, n) for n in normals[60 : 60 + len(angles)]] + [-speed * Z] * 60
    )
    for mu in (0.0, 0.3, 0.6):
        errors, contacts, _ = follow(slide(normals, centres, velocities, mu, 1.0))
        on_edge = errors[60 : 60 + len(angles), 0]
        assert np.median(on_edge) < 1.5
        assert np.percentile(errors[:, 0], 95) < 2.5
        assert np.mean([c.confidence_score >= RELIABLE_FROM for c in contacts]) > 0.97


@pytest.mark.parametrize("rate", [125, 1000])
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_an_inner_edge_is_marked_ambiguous_until_the_first_wall_is_left(mu, rate):
    at_rate(rate)
    r, travel, many = PROBE.radius, 0.02 / rate, rate // 125
    corner = r * Z - r * Y
    floor = [(corner - travel * (60 * many - k) * Y, 0.02 * Y, [(Z, Z - mu * Y)]) for k in range(60 * many)]
    growth = np.minimum(1.0, 0.1 / many * np.arange(1, 40 * many + 1))
    both = [(corner, 0.0 * Y, [(Z, Z - (1 - g) * mu * Y), (-Y, -g * Y)]) for g in growth]
    climb = [(corner + travel * (k + 1) * Z, 0.02 * Z, [(-Y, -Y - mu * Z)]) for k in range(60 * many)]
    _, contacts, _ = follow(floor + both + climb)
    trusted = np.array([c.confidence_score >= RELIABLE_FROM for c in contacts])
    assert trusted[: 60 * many].mean() > 0.95
    assert not trusted[68 * many : 100 * many].any()  # the force has built up to most of the floor's
    assert {c.reason for c in contacts[68 * many : 100 * many]} == {"ambiguous normal"}
    assert trusted[105 * many :].mean() > 0.95  # 0.15 mm off the floor


def test_a_jump_on_one_surface_is_forgotten_when_the_sphere_goes_on_along_it():
    """A force that points elsewhere for some samples, as where the sphere sticks and slips: no second wall."""
    sequence = list(plane(Z, Y, 0.5, count=200))
    for k in range(80, 90):
        centre, velocity, _ = sequence[k]
        aside = np.cos(0.9) * Z + np.sin(0.9) * X
        sequence[k] = centre, 0.0 * velocity, [(aside, aside)]
    _, contacts, _ = follow(sequence)
    reasons = [c.reason for c in contacts]
    assert "ambiguous normal" in reasons[80:90]
    assert all(c.confidence_score >= RELIABLE_FROM for c in contacts[110:])  # 2 mm behind
    errors = [np.arccos(min(float(c.normal @ Z), 1.0)) for c in contacts[110:]]
    assert max(errors) < 0.1


def test_a_change_of_friction_is_followed():
    _, _, estimator = follow(plane(Z, Y, 0.6, count=300))
    follow(plane(Z, Y, 0.2, count=600), estimator=estimator)
    assert estimator.friction[0] == pytest.approx(0.2, abs=0.04)


def test_memory_ends_with_contact_and_with_reset():
    (_, _, estimator), (_, _, twin) = follow(plane(Z, Y, 0.3)), follow(plane(Z, Y, 0.3))
    wall = [(PROBE.radius * X + 0.1 * Y, 0.0 * X, [(X, X)]) for _ in range(5)]  # 0.1 m away, another surface
    errors, contacts, _ = follow(wall, estimator=estimator)
    assert errors[0, 0] < 5.0
    assert contacts[0].reason == ""
    twin.reset()
    assert twin.friction[0] == pytest.approx(0.3, abs=0.03)
    errors, _, _ = follow(wall, estimator=twin)
    assert errors[0, 0] < 5.0


def test_stated_error_is_honest():
    """Share of errors within the stated expectation: neither boastful nor timid by more than a factor two."""
    from lwrprobe.contact import kernels as kk

    for path in (plane(Z, Y, 0.3), cylinder(0.3)):
        estimator = make_estimator("fused", PROBE)
        errors, contacts, _ = follow(path, estimator=estimator)
        stated = np.degrees([0.1 * np.sqrt(1 / c.confidence_score - 1) for c in contacts])
        ratio = np.sqrt(np.mean(errors[20:, 0] ** 2) / np.mean(stated[20:] ** 2))
        assert 0.4 < ratio < 2.0
    assert kk.O_SIGMA == 10


@pytest.mark.parametrize("drift", [0.005, 0.01])
def test_a_wandered_zero_is_learnt_while_sliding_and_forgotten_when_it_is_moved(drift):
    """10 mN on one force axis turn the wrench axis of 1 N by 6 degrees."""
    rng = np.random.default_rng(0)
    fused, axis = make_estimator("fused", PROBE), make_estimator("wrench_axis", PROBE)
    errors = {"fused": [], "wrench_axis": []}
    for k, (centre, velocity, true) in enumerate(plane(Z, Y, 0.3, count=200)):
        wrench = naive.contact_wrench(PROBE, DOWN, true, k * PERIOD, rng)
        wrench.force[1] += drift
        for estimator in (fused, axis):
            contact = estimator.estimate(wrench, centre, DOWN, velocity + 3e-4 * rng.normal(size=3))
            errors[estimator.name].append(naive.angle(contact.normal, true[0][0]))
    assert np.median(errors["fused"]) < 1.0
    assert np.median(errors["wrench_axis"]) > 400 * drift
    # At rest, with the surface forgotten, there is the wrench alone: its error shows whether the zero is known.
    last = naive.contact_wrench(PROBE, DOWN, [(Z, Z)], 201 * PERIOD)
    last.force[1] += drift
    resting = (PROBE.radius * Z, DOWN, np.zeros(3))
    fused.reset()
    learnt = naive.angle(fused.estimate(last, *resting).normal, Z)
    last.zeroing = 1  # the conditioner has moved its zero: what was learnt of the old one is void
    fused.reset()
    forgotten = naive.angle(fused.estimate(last, *resting).normal, Z)
    assert learnt < 0.3 * forgotten
    assert forgotten > 0.5 * naive.angle(axis.estimate(last, *resting).normal, Z)


def test_an_offset_that_was_learnt_while_the_load_fell_is_doubted_once_it_rises():
    """A sensor with 36 mN of hysteresis: what was learnt of its zero at one end of the loop is wrong at the other."""
    width, lever = 0.036, PROBE.sensor_distance
    settings = {"zero_error": 0.5 * width, "zero_time": 15.0}
    known, blind = (make_estimator("fused", PROBE, Settings(**settings, lag=lag)) for lag in (width, 0.0))
    errors = {}

    def wrench(force, k, end):
        made = naive.contact_wrench(PROBE, DOWN, [(Z, force)], k * PERIOD)
        made.force[1] += end * 0.5 * width
        made.torque[0] -= end * 0.5 * width * lever
        return made

    for name, fused in (("known", known), ("blind", blind)):
        for k in range(100):  # a slide along y whose force falls: the readings across stay above it
            push = 1.2 - 0.008 * k
            centre, velocity = PROBE.radius * Z + 0.02 * PERIOD * k * Y, 0.02 * Y
            fused.estimate(wrench(push * (Z - 0.3 * Y), k, 1.0), centre, DOWN, velocity)
        for k in range(100, 130):  # at rest, and pressed again
            push = 0.4 + 0.02 * (k - 100)
            contact = fused.estimate(wrench(push * (Z - 0.25 * Y), k, -1.0), centre, DOWN, np.zeros(3))
        errors[name] = naive.angle(contact.normal, Z)
    assert errors["known"] < 1.0 < 0.6 * errors["blind"]


def test_a_noisy_velocity_is_noticed():
    """3 mm/s on 20 mm/s: the velocity gets less weight, the result no worse than the wrench axis alone."""
    errors, _, _ = follow(plane(Z, Y, 0.3, count=300), speed_noise=3e-3)
    axis, _, _ = follow(plane(Z, Y, 0.3, count=300), speed_noise=3e-3, name="wrench_axis")
    assert np.median(errors[:, 0]) < np.median(axis[:, 0])


def test_the_same_samples_give_the_same_contacts():
    one, other = follow(cylinder(0.3), seed=3)[1], follow(cylinder(0.3), seed=3)[1]
    for a, b in zip(one, other):
        np.testing.assert_array_equal(a.point, b.point)
        assert a.confidence_score == b.confidence_score
