"""The table `[truth]`: what it draws, what it changes in the simulated world, and that nothing else reads it."""

import ast
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from gantry_rig import CLEAN, Rig, gantry

import lwrprobe_sim.driver as sim_driver
from lwrprobe.contracts import DriverContext, SceneError
from lwrprobe.evaluation.truth import with_given_area
from lwrprobe.kinematics import IKSolver, robot_by_name
from lwrprobe.scene import load_scene, write_scene
from lwrprobe.scene.actual_scene import actual_scene, placed
from lwrprobe.scene.table import Pose
from lwrprobe.scene.truth import PROFILES, QUANTITIES, Kind, TruthTable
from lwrprobe_sim import SimConfig, SimDriver, sensor_kernels
from lwrprobe_sim import world_kernels as kernels
from lwrprobe_sim.actual_world import actual_world
from lwrprobe_sim.start import start_joints
from lwrprobe_sim.world import World
from run_alone import run_alone

ROOT = Path(__file__).resolve().parents[2]
Q = np.array([0.3, 0.6, -0.2, -1.4, 0.1, 1.1, 0.4])


def actual(*settings, seed=7, scene="block"):
    return actual_world(
        load_scene(scene, [f"truth.{setting}" for setting in ("profile=ideal", *settings)]), SimConfig(), seed
    )


def tip(world):
    out = np.empty((4, 4))
    world.robot.fk_into(Q, out)
    return out


# --- who reads it


@cache
def text(file):
    return file.read_text()


def modules(word, *folders):
    """Those that hold the word: to parse them all takes seconds."""
    return [file for folder in folders for file in sorted((ROOT / folder).rglob("*.py")) if word in text(file)]


def imports(file):
    names = set()
    for node in ast.walk(ast.parse(text(file))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_only_simulator_and_evaluation_know_the_modules_of_the_truth():
    knowing = {"lwrprobe.scene.truth", "lwrprobe.scene.actual_scene"}
    found = {
        str(file.relative_to(ROOT))
        for word in ("truth", "actual_scene")
        for file in modules(word, "src/lwrprobe", "drivers", "strategies")
        if imports(file) & knowing and file.parent != ROOT / "src/lwrprobe/scene"
    }
    judges = {"src/lwrprobe/evaluation/truth.py", "src/lwrprobe/bench/shapes.py"}
    assert found == {"drivers/lwrprobe_sim/actual_world.py"} | judges


def test_what_compares_with_the_truth_is_used_after_a_run_alone():
    package = ROOT / "src/lwrprobe"
    afterwards = [package / f"exploration/procedures/{name}.py" for name in ("merge", "explore")]
    parts = {
        file.relative_to(package).parts[0]
        for file in modules("truth", "src/lwrprobe")
        if "lwrprobe.evaluation.truth" in imports(file) and file not in afterwards
    }
    assert parts == {"evaluation", "runs", "views", "bench"}


def test_nothing_that_acts_during_a_run_imports_the_evaluation():
    acting = ("collision", "contact", "control", "kinematics", "mapping", "reconstruction", "trajectory")
    acting += ("exploration/loop", "exploration/safety", "exploration/stages")
    files = modules("evaluation", *(f"src/lwrprobe/{name}" for name in acting), "drivers", "strategies")
    importing = {
        str(file.relative_to(ROOT)): name
        for file in files
        for name in imports(file)
        if name.startswith("lwrprobe.evaluation")
    }
    assert importing == {}


def test_no_stage_strategy_or_device_driver_reads_the_table():
    folders = [f"src/lwrprobe/{name}" for name in ("contact", "exploration", "mapping", "reconstruction", "trajectory")]
    drivers = [f"drivers/lwrprobe_{name}" for name in ("ati", "fri")]
    for file in modules(".truth", *folders, *drivers, "strategies"):
        for node in ast.walk(ast.parse(text(file))):
            assert not (isinstance(node, ast.Attribute) and node.attr == "truth"), f"{file}:{node.lineno}"


SLOW = ["run.time_limit=25.0", "run.seed=3", "truth.profile=ideal"]


@pytest.mark.slow
def test_decisions_depend_on_sensor_data_and_not_on_the_table(tmp_path, monkeypatch):
    """The same devices' data with another table: the same contacts, way and states. The table alone: others."""
    one, other = (
        load_scene("block", [*SLOW, f"truth.probe_length_mm={mm}", f"truth.sensor_gain_percent={gain}"])
        for mm, gain in ((0.4, 1.0), (-0.4, -1.0))
    )

    def decisions(name, scene):
        run_alone(scene, tmp_path / name)
        return [(tmp_path / name / file).read_bytes() for file in ("contacts.csv", "trace.csv", "states.csv")]

    first = decisions("one", one)
    assert first[0].count(b"\n") > 20
    assert decisions("other", other)[0] != first[0]
    world = sim_driver.actual_world
    monkeypatch.setattr(sim_driver, "actual_world", lambda scene, config, seed: world(one, config, seed))
    assert decisions("other_table_same_data", other) == first


# --- what it draws


def test_a_quantity_set_alone_leaves_the_draws_of_all_others():
    drawn = TruthTable(profile="datasheet").draw(5, 7)
    for name, quantity in QUANTITIES.items():
        one = TruthTable(profile="datasheet", **{name: 0.25}).draw(5, 7)
        assert one[name] == pytest.approx(np.full(quantity.count or 7, 0.25))
        assert all(np.array_equal(one[key], drawn[key]) for key in drawn if key != name)


def test_seeds_change_all_draws_and_the_table_may_have_its_own():
    table = TruthTable(profile="lab")
    a, b = table.draw(1, 7), table.draw(2, 7)
    fixed = {name for name, departure in PROFILES["lab"].items() if departure.value is not None}
    assert {name for name in a if np.array_equal(a[name], b[name])} == fixed
    own = TruthTable(profile="lab", seed=1).draw(2, 7)
    assert all(np.array_equal(own[name], a[name]) for name in a)


@pytest.mark.parametrize("profile", ["lab", "datasheet", "rough"])
def test_draws_have_the_stated_spread(profile):
    draws = [TruthTable(profile=profile).draw(seed, 7) for seed in range(400)]
    for name, departure in PROFILES[profile].items():
        values, kind = np.concatenate([draw[name] for draw in draws]), QUANTITIES[name].kind
        if departure.sigma is not None:
            if kind is Kind.PERCENT:
                assert values.min() > -100.0
                values = 100.0 * np.log1p(0.01 * values)
            assert np.sqrt(np.mean(values**2)) == pytest.approx(departure.sigma, rel=0.12), name
            assert kind is not Kind.SIZE or values.min() >= 0.0
        elif departure.between is not None:
            ends = np.array(departure.between)
            if kind is Kind.SCALE:
                values, ends = np.log(values), np.log(ends)
            assert ends[0] <= values.min() < ends[0] + 0.05 * np.ptp(ends), name
            assert ends[1] >= values.max() > ends[1] - 0.05 * np.ptp(ends), name
            assert values.mean() == pytest.approx(ends.mean(), abs=0.08 * np.ptp(ends)), name


def test_what_was_drawn_makes_the_same_world_again():
    drawn = actual("profile=datasheet").drawn
    set_alone = [f"truth.{name}={value}" for name, value in drawn.items() if name != "profile"]
    again = load_scene("block", ["truth.profile=ideal", *set_alone])
    world, copy = actual("profile=datasheet"), actual_world(again, SimConfig(), 99)
    assert tip(copy) == pytest.approx(tip(world), abs=1e-8)
    assert copy.config.wrench_matrix == pytest.approx(world.config.wrench_matrix, abs=1e-7)
    assert copy.scene.objects[0].at.xyz == pytest.approx(world.scene.objects[0].at.xyz, abs=1e-8)


def test_a_written_scene_keeps_its_truth_and_its_area(tmp_path):
    scene = load_scene("block", ["truth.profile=rough", "truth.dh_a_mm={sigma=0.2}", "truth.base_shift_mm=[1, 2, 3]"])
    write_scene(scene, tmp_path / "scene.toml")
    assert load_scene(tmp_path / "scene.toml") == scene


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("profile=good", "'ideal', 'lab', 'datasheet' or 'rough'"),
        ("probe_length_mm=long", "a number, a list of numbers"),
        ("probe_length_mm=true", "a number, a list of numbers"),
        ("probe_length_mm=nan", "finite number"),
        ("probe_length_mm=[1, 2]", "one number or 1"),
        ("probe_length_mm={sigma=-1}", "greater than or equal to 0"),
        ("probe_length_mm={sigma=1, between=[0, 1]}", "a number, a list of numbers"),
        ("object_friction={sigma=0.1}", "between"),
        ("object_friction={between=[0.5, 0.1]}", "low <= high"),
        ("stick_stiffness_percent=-100", "above -100"),
        ("arm_lag_ms=-1", "at least 0"),
        ("object_stiffness=0", "above 0"),
        ("probe_lenght_mm=1", "did you mean 'probe_length_mm'"),
    ],
)
def test_bad_values_are_refused_with_what_is_allowed(setting, words):
    with pytest.raises(SceneError, match=words):
        load_scene("block", [f"truth.{setting}"])


@pytest.mark.parametrize("setting", ["probe_length_mm=-46", "sphere_radius_mm=-3.5", "dh_a_mm=[1, 2, 3]"])
def test_what_no_probe_or_arm_can_have_is_refused_when_the_world_is_made(setting):
    with pytest.raises(SceneError, match="truth"):
        actual(setting)


# --- what it changes


def test_ideal_is_the_scene_itself():
    scene, config = load_scene("block", ["truth.profile=ideal"]), SimConfig()
    world = actual_world(scene, config, 7)
    assert world.scene is scene
    assert world.config is config
    assert world.drawn == {"profile": "ideal"}
    assert actual_scene(scene) is scene


def test_probe_and_arm_are_where_the_numbers_say():
    ideal = tip(actual())
    longer = tip(actual("probe_length_mm=0.5", "sphere_off_axis_mm=[0.3, -0.2]"))
    assert np.linalg.solve(ideal, longer)[:3, 3] == pytest.approx([3e-4, -2e-4, 5e-4], abs=1e-12)
    moved = tip(actual("base_shift_mm=[1, 2, 3]"))
    assert moved[:3, 3] - ideal[:3, 3] == pytest.approx([1e-3, 2e-3, 3e-3], abs=1e-12)
    turned, base = tip(actual("base_turn_deg=[0, 0, 90]")), actual().robot.base
    assert np.linalg.solve(base, turned)[:3, 3] == pytest.approx(
        np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]) @ np.linalg.solve(base, ideal)[:3, 3], abs=1e-12
    )
    offset = actual(f"dh_offset_deg=[0, 0, 0, {np.degrees(0.01)}, 0, 0, 0]").robot
    assert pytest.approx(ideal, abs=1e-9) == offset.fk(Q - 0.01 * np.eye(7)[3]).A
    robot = actual("dh_d_mm=[0, 0, 2, 0, 0, 0, 0]", "dh_a_mm=1", "dh_twist_deg=0.1").robot
    plain = actual().robot
    assert robot.d - plain.d == pytest.approx([0, 0, 2e-3, 0, 0, 0, 0])
    assert robot.a - plain.a == pytest.approx(np.full(7, 1e-3))
    assert robot.alpha - plain.alpha == pytest.approx(np.full(7, np.radians(0.1)))


def test_probe_of_the_world_keeps_its_sensor_in_place():
    probe, given = actual("probe_length_mm=0.5", "sphere_radius_mm=0.1").scene.probe, load_scene("block").probe
    assert probe.sensor_distance == pytest.approx(given.sensor_distance + 5e-4)
    assert probe.radius == pytest.approx(given.radius + 1e-4)
    assert probe.radius + probe.stick_length == pytest.approx(given.radius + given.stick_length + 5e-4)
    soft = actual("stick_stiffness_percent=-30", "payload_percent=10").scene.probe
    assert soft.stiffness_lateral == pytest.approx(0.7 * given.stiffness_lateral)
    assert soft.stiffness_axial == pytest.approx(0.7 * given.stiffness_axial)
    assert soft.mass == pytest.approx(1.1 * given.mass)


def test_options_of_the_simulator_follow_the_numbers():
    config = actual(
        "arm_delay_ms=3", "arm_lag_ms=8", "sensor_delay_ms=5", "clock_skew_ms=-4", "drift_mn_per_min=[1, 2, 3]",
        "loss_burst_ms=40", "loss_bursts_per_min=6", "zero_wander_force_mn=6", "zero_wander_torque_unm=28",
        "zero_wander_s=3", "joint_stiffness_percent=100", "sensor_hysteresis_percent=0.3",
    ).config  # fmt: skip
    plain = SimConfig()
    assert config.delay == pytest.approx(plain.delay + 0.003)
    assert config.lag == pytest.approx(plain.lag + 0.008)
    assert config.latency == pytest.approx(plain.latency + 0.005)
    assert config.clock_skew == pytest.approx(-0.004)
    assert np.subtract(config.drift_force, plain.drift_force) == pytest.approx([1e-3, 2e-3, 3e-3])
    assert (config.burst_length, config.burst_rate) == pytest.approx((0.04, 0.1))
    assert (config.wander_force, config.wander_torque, config.wander_time) == pytest.approx((6e-3, 28e-6, 3.0))
    assert config.joint_compliance == pytest.approx(np.full(7, 0.5 * plain.joint_compliance))
    assert config.hysteresis == pytest.approx(0.003)


def test_the_sensor_says_the_latency_that_it_is_believed_to_have():
    driver = SimDriver(
        DriverContext(SimConfig(), load_scene("block", ["truth.profile=ideal", "truth.sensor_delay_ms=10"]), 7)
    )
    driver.arm().open()
    first = next(state.time for state in (driver.arm().read() for _ in range(100)) if driver.sensor().read())
    assert driver.sensor().latency == SimConfig().latency
    assert first == pytest.approx(1 / 125 + 0.004 + 0.010, abs=0.0035)


def test_sphere_off_axis_gives_the_torque_of_its_lever():
    x, y, span = 3e-4, -2e-4, load_scene("block").probe.sensor_distance
    matrix = np.reshape(actual(f"sphere_off_axis_mm=[{1e3 * x}, {1e3 * y}]").config.wrench_matrix, (6, 6))
    force, point = np.array([0.4, -0.7, 1.1]), np.array([0.001, 0.002, -0.004])  # from the sphere's centre
    behind_sphere = np.r_[force, np.cross(point + np.array([0, 0, span]), force)]
    assert matrix @ behind_sphere == pytest.approx(
        np.r_[force, np.cross(point + np.array([x, y, span]), force)], abs=1e-15
    )
    probe = actual(f"sphere_off_axis_mm=[{1e3 * x}, {1e3 * y}]").scene.probe
    assert probe.centre_of_mass == pytest.approx((-x, -y, 0.03))


def test_gain_and_crosstalk_are_the_matrix_that_the_samples_show():
    cross = np.arange(30.0) * 0.02
    world = actual("sensor_gain_percent=[1, 2, 3, 4, 5, 6]", f"sensor_crosstalk_percent={cross.tolist()}")
    span = np.array([12, 12, 17, 0.12, 0.12, 0.12])
    expected = np.diag([1.01, 1.02, 1.03, 1.04, 1.05, 1.06])
    expected[~np.eye(6, dtype=bool)] += 0.01 * cross * np.array([a / b for i, a in enumerate(span)
                                                                for j, b in enumerate(span) if i != j])  # fmt: skip
    assert np.reshape(world.config.wrench_matrix, (6, 6)) == pytest.approx(expected)
    rig = Rig([0.0, 0.0, 0.055], wrench_matrix=world.config.wrench_matrix)
    rig.line([0.0, 0.0, 0.055], [0.0, 0.0, 0.0548], 0.05)
    rig.go(*[[0.0, 0.0, 0.0548]] * 20)
    row = np.array(rig.world.fetch()[-1][1:7])
    assert abs(rig.wrench[2]) > 1.0
    assert row == pytest.approx(expected @ rig.wrench, rel=1e-9, abs=1e-12)


def stream(seconds, path=None, seed=1, **config):
    world = World(load_scene("block", ["truth.profile=ideal"]), SimConfig(**{**CLEAN, **config}), seed, gantry())
    world.place(np.array([0.0, 0.0, 0.2]))
    rows = []
    for i in range(round(seconds / world.config.cycle)):
        if path is not None:
            assert world.command(path(i * world.config.cycle)) == 0
        if world.advance():
            rows += world.fetch()
    return np.array(rows)


def test_wandering_zero_is_bounded_slow_and_of_its_stated_size():
    s = np.zeros(sensor_kernels.SETTINGS)
    s[sensor_kernels.WANDER_TIME] = 2.0
    times = np.arange(0.0, 4000.0, 0.1)
    for axis in range(6):
        values = np.array([sensor_kernels.wander(s, 7, axis, t) for t in times])
        assert values.std() == pytest.approx(1.0, abs=0.08)
        assert np.abs(values).max() <= np.sqrt(6.0)
        assert np.abs(np.diff(values)).max() < 0.5
        ahead = [np.mean(values[: -int(10 * lag)] * values[int(10 * lag) :]) for lag in (0.3, 4.0)]
        assert ahead[0] > 0.9
        assert abs(ahead[1]) < 0.1
    rows = stream(20.0, wander_force=0.006, wander_torque=28e-6)
    assert 0.003 < rows[:, 1:4].std() < 0.009
    assert 14e-6 < rows[:, 4:7].std() < 42e-6


def test_hysteresis_leaves_a_loop_of_its_width():
    s = np.zeros(sensor_kernels.SETTINGS)
    s[sensor_kernels.PLAY : sensor_kernels.PLAY + 6] = 0.5 * 0.003 * 12.0
    loads = np.r_[np.linspace(0, 2, 200), np.linspace(2, 0, 200), np.linspace(0, 2, 200)]
    reads = []
    for load in loads:
        wrench = np.full(6, load)
        sensor_kernels.play(s, wrench)
        reads.append(wrench[2])
    reads = np.array(reads)
    assert reads[300] - reads[500] == pytest.approx(0.036, abs=0.011)
    assert np.interp(1.0, loads[400:], reads[400:]) == pytest.approx(1.0 - 0.018, abs=1e-9)
    assert np.interp(-1.0, -loads[200:400], reads[200:400]) == pytest.approx(1.0 + 0.018, abs=1e-9)


def test_gears_have_play_and_a_wave_that_encoders_do_not_see():
    play, wave = 1e-4, 5e-5
    world = World(
        load_scene("empty", ["truth.profile=ideal"]), SimConfig(lag=0.0, joint_hysteresis=play, gear_ripple=wave), 1
    )
    begin = world.state[kernels.Q : kernels.Q + 7].copy()
    world.place(begin)
    found = []
    way = np.r_[np.linspace(0, 2e-3, 60), np.linspace(2e-3, 0, 60)]
    for offset in way:
        assert world.command(begin + offset) == 0
        world.advance()
        motors = world.state[kernels.Q_MEASURED : kernels.Q_MEASURED + 7]
        assert motors == pytest.approx(begin + offset, abs=1e-12)
        found.append(world.state[kernels.LINK_SIDE : kernels.LINK_SIDE + 7] - motors)
        expected = np.empty((4, 4))
        world.robot.fk_into(world.state[kernels.LINK_SIDE : kernels.LINK_SIDE + 7].copy(), expected)
        assert world.tip() == pytest.approx(expected, abs=1e-12)
    found = np.array(found)
    phases = world.state[kernels.RIPPLE_PHASE : kernels.RIPPLE_PHASE + 7]
    lost = found - wave * np.sin(320.0 * (begin + way[:, None]) + phases)
    assert lost[55] == pytest.approx(np.full(7, -0.5 * play), abs=1e-12)
    assert lost[-5] == pytest.approx(np.full(7, 0.5 * play), abs=1e-12)


@pytest.mark.parametrize("degrees", [5.0, -3.0])
def test_friction_lies_beside_what_opposes_the_slip(degrees):
    rig = Rig([-0.02, 0.0, 0.055], ["object.0.friction=0.3"], friction_turn=np.radians(degrees))
    rig.line([-0.02, 0.0, 0.055], [-0.02, 0.0, 0.0549], 0.02)
    rig.line([-0.02, 0.0, 0.0549], [0.02, 0.0, 0.0549], 1.0)
    x, y, z = rig.force
    assert np.hypot(x, y) / z == pytest.approx(0.3, rel=1e-6)
    # turned by the angle about the upward normal from -x
    assert np.degrees(np.arctan2(-y, -x)) == pytest.approx(degrees, abs=0.05)
    assert rig.unbalanced == 0


def test_objects_stand_where_the_numbers_say():
    ideal = load_scene("bridge").solid()
    moved = ["object_turn_deg=90", "object_shift_mm=[4, -7]", "table_height_mm=1.5"]
    surface = ["object_friction=0.12", "object_stiffness=5e3", "object_damping=2"]
    settings = [f"truth.{setting}" for setting in ("profile=ideal", *moved, *surface)]
    world = actual_scene(load_scene("bridge", settings))
    lower, upper = ideal.bounds()
    middle = np.append(0.5 * (lower + upper)[:2], 0.0)
    points = np.random.default_rng(0).uniform(lower - 0.01, upper + 0.01, (300, 3))
    turned = (points - middle) @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]).T + middle + [0.004, -0.007, 0.0015]
    assert world.solid().signed_distance(turned) == pytest.approx(ideal.signed_distance(points), abs=1e-9)
    assert world.table.height == pytest.approx(0.0015)
    assert [(s.friction, s.stiffness, s.damping) for s in world.objects] == [(0.12, 5e3, 2.0)] * len(world.objects)


def test_objects_lean_with_the_table():
    scene = load_scene(
        "tilted_table", ["truth.profile=ideal", "truth.table_tilt_deg=[0.4, -0.3]", "truth.table_height_mm=1"]
    )
    given, world = load_scene("tilted_table", ["truth.profile=ideal"]), actual_scene(scene)
    on_table = given.solid().bounds()
    points = np.random.default_rng(0).uniform(on_table[0], on_table[1], (200, 3))
    turn = world.objects[0].at.matrix() @ np.linalg.inv(given.objects[0].at.matrix())
    moved = points @ turn[:3, :3].T + turn[:3, 3]
    before, after = given.table.plane(), world.table.plane()
    assert moved @ after[:3] - after[3] == pytest.approx(points @ before[:3] - before[3], abs=1e-9)
    assert world.solid().signed_distance(moved) == pytest.approx(given.solid().signed_distance(points), abs=1e-9)


def test_a_single_object_stands_free_and_several_stay():
    free = actual_scene(load_scene("block", ["truth.profile=ideal", "truth.object_mass_kg=0.4"])).objects[0]
    assert (free.movable, free.mass) == (True, 0.4)
    assert not any(
        shape.movable for shape in actual_scene(load_scene("stacked_blocks", ["truth.profile=rough"])).objects
    )


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["block", "bridge", "stacked_blocks"])
def test_the_area_holds_the_object_wherever_it_may_be(scene):
    area = load_scene(scene, ["truth.profile=lab"]).area
    for seed in range(12):
        world = load_scene(scene, ["truth.profile=lab", f"run.seed={seed}"])
        assert world.area == area  # it says nothing of the draw
        lower, upper = actual_scene(world).solid().bounds()
        radius = world.probe.radius
        assert (lower[:2] - np.array(area.lower)[:2] >= 2 * radius).all()
        assert (np.array(area.upper)[:2] - upper[:2] >= 2 * radius).all()
        assert area.upper[2] - upper[2] >= radius


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["lab", "datasheet"])
def test_the_sphere_stays_off_the_table_as_the_arm_sees_it(profile):
    """At the area's floor, for draws of table, base and arm: 99 % of the corners of the area are clear of the table."""
    told, clear = load_scene("block", [f"truth.profile={profile}"]), []
    area, believed = told.area, robot_by_name("lwr4", told.arm.tool.matrix(), told.arm.base.matrix())
    solver, down = IKSolver(believed), Pose(rpy_deg=told.arm.tip_rpy_deg).matrix()
    start = start_joints(told, believed, None)
    corners = [(x, y, area.lower[2]) for x in (area.lower[0], area.upper[0]) for y in (area.lower[1], area.upper[1])]
    joints = []
    for corner in corners:
        pose = down.copy()
        pose[:3, 3] = corner
        joints.append(solver.solve(pose, start).q)
    for seed in range(1, 61):
        world = actual(f"profile={profile}", seed=seed)
        plane, radius = world.scene.table.plane(), world.scene.probe.radius
        for q in joints:
            clear.append(float(world.robot.fk(q).A[:3, 3] @ plane[:3] - plane[3]) > radius)
    assert np.mean(clear) > 0.99
    assert area.lower[2] < 0.012
    ideal, turned = ["truth.profile=ideal"], ["truth.profile=ideal", "truth.object_turn_deg=10"]
    assert load_scene("block", turned).area.lower[2] == load_scene("block", ideal).area.lower[2]


def test_what_moves_nothing_leaves_the_area():
    ideal, longer = ["truth.profile=ideal"], ["truth.profile=ideal", "truth.probe_length_mm=0.5"]
    assert load_scene("block", longer).area == load_scene("block", ideal).area


@pytest.mark.slow
def test_the_summary_says_what_was_drawn_and_compares_with_it(tmp_path):
    settings = ["truth.profile=ideal", "truth.object_shift_mm=[0.0, 3.0]", "run.time_limit=25.0", "run.seed=3"]
    summary = run_alone(load_scene("block", settings), tmp_path).finish().as_dict()
    assert summary["truth"] == {"profile": "ideal", "object_shift_mm": [0.0, 3.0]}
    assert summary["contacts"] > 5
    assert summary["contact_error_mm"]["median"] < 0.15
    assert summary["surface_error_mm"]["median"] < 0.15
    again = load_scene(tmp_path / "scene.toml")
    assert again.truth.object_shift_mm.value == (0.0, 3.0)


def test_the_documented_figures_are_those_of_the_profiles():
    lines = (ROOT / "docs/explanation/simulator.md").read_text().splitlines()
    rows = {cells[1].strip(" `"): [cell.strip() for cell in cells[2:5]] for line in lines
            if len(cells := line.split("|")) == 7 and cells[1].startswith(" `")}  # fmt: skip

    def cell(departure):
        if departure is None:
            return "–"
        if departure.sigma is not None:
            return f"{departure.sigma:g}"
        if departure.between is not None:
            return "{:g} to {:g}".format(*departure.between)
        return f"= {departure.value[0]:g}"

    profiles = ("lab", "datasheet", "rough")
    known = {name: [cell(PROFILES[p].get(name)) for p in profiles] for name in QUANTITIES}
    assert known.pop("sensor_delay_ms") == ["–"] * 3
    assert rows == known


@pytest.mark.parametrize(
    ("scene", "draws"),
    [
        ("block", 30),
        pytest.param("polystyrene_1", 30, marks=pytest.mark.slow),
        pytest.param("jaw_chuck", 4, marks=pytest.mark.slow),
    ],
)
def test_an_object_that_may_be_anywhere_stays_off_the_border_and_the_area_says_nothing_of_it(scene, draws):
    area, middles = load_scene(scene, profile="blind").area, []
    for seed in range(draws):
        world = load_scene(scene, [f"run.seed={seed}"], "blind")
        assert world.area == area
        assert (world.area.lower, world.area.upper) == ((-0.12, -0.1, 0.006), (0.12, 0.1, 0.13))
        lower, upper = actual_scene(world).solid().bounds()
        assert (lower[:2] - np.array(area.lower)[:2] >= 2.5 * world.probe.radius).all()
        assert (np.array(area.upper)[:2] - upper[:2] >= 2.5 * world.probe.radius).all()
        middles.append(0.5 * (lower + upper)[:2])
    if draws >= 30:
        assert (np.ptp(middles, axis=0) > 0.04).all()


def test_what_lies_anywhere_is_drawn_apart_and_written_down():
    scene = load_scene("block", ["run.seed=4"], "blind")
    drawn = scene.truth.draw(4)
    assert list(drawn) == ["object_anywhere"]
    with_friction = load_scene("block", ["truth.object_friction=0.2"], "blind").truth.draw(4)
    assert np.array_equal(drawn["object_anywhere"], with_friction["object_anywhere"])
    turn, shift = (placed(scene, drawn)[name].tolist() for name in ("object_turn_deg", "object_shift_mm"))
    settings = ["truth.profile=ideal", f"truth.object_turn_deg={turn}", f"truth.object_shift_mm={shift}"]
    same = actual_scene(load_scene("block", settings))
    anywhere = actual_scene(scene).objects[0].at.matrix()
    assert same.objects[0].at.matrix() == pytest.approx(anywhere, abs=1e-9)


def test_objects_too_large_for_their_area_are_refused_with_what_they_need():
    scene = load_scene("block", ["truth.profile=ideal", "truth.object_anywhere=true", "area.upper=[0.0, 0.0, 0.13]"])
    with pytest.raises(SceneError, match=r"an area of at least .* mm"):
        actual_scene(scene)


def test_a_given_area_lies_as_far_from_the_object_as_the_scenes_own():
    blind, own = load_scene("block", ["run.seed=2"], "blind"), load_scene("block", ["truth.profile=ideal"])
    around = with_given_area(blind, own)
    lower, upper = around.solid().bounds()
    assert np.array(around.area.lower)[:2] - lower[:2] == pytest.approx([-0.035, -0.035], abs=1e-3)
    assert np.array(around.area.upper)[:2] - upper[:2] == pytest.approx([0.035, 0.035], abs=1e-3)
    assert around.area.search_for is None
    assert around.truth.ideal
