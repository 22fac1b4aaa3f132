"""`calibration.toml`: written, read, applied to a scene, refused where it is broken or of another probe."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from typer.testing import CliRunner

from lwrprobe.calibration import (
    Calibration,
    Quantity,
    drifts,
    previous_path,
    read_calibration,
    write_calibration,
)
from lwrprobe.calibration.calibration_file import LENGTHS
from lwrprobe.cli.app import app
from lwrprobe.contact import identify_payload
from lwrprobe.contracts import FormatError, InputError, SceneError, StorageError, WrenchSample
from lwrprobe.evaluation.truth import is_world_of
from lwrprobe.exploration.loop.calibrated_sensor import CalibratedSensor
from lwrprobe.exploration.procedures.calibrate import with_reference_sphere
from lwrprobe.exploration.procedures.dry_run import stability
from lwrprobe.exploration.procedures.explore import Exploration, RunOptions, explore
from lwrprobe.exploration.procedures.host_stalls import host_checks
from lwrprobe.exploration.procedures.repeat import safe_speed
from lwrprobe.exploration.procedures.replay import Replay, recorded_scene
from lwrprobe.exploration.procedures.start_posture import scene_at_start
from lwrprobe.exploration.recording.recording import read_recording
from lwrprobe.exploration.recording.run_warnings import ANOTHER_WORLD
from lwrprobe.kinematics import robot_by_name
from lwrprobe.kinematics.path import rotations
from lwrprobe.scene import load_scene
from lwrprobe.scene.actual_scene import actual_scene
from lwrprobe.scene.calibrated_scene import calibrated, stated_hash, stiff_as_calibrated

VALUES = {
    "tool_shift": [1e-4, -2e-4, 3e-4], "sphere_radius": [0.00501], "stick_stiffness": [2000.0, 1.1e6],
    "arm_stiffness": [2e4, 1e4, 2e4], "clock_offset": [0.004], "sensor_latency": [0.005], "table": [0.001, 0.0, 0.002],
    "payload": [0.0031, 0.0, 0.0, 0.03], "tool": [2e-4, 1e-4, -3e-4], "joint_hysteresis": [4e-5],
    "kinematic_table": [1e-4] * 7 + [2e-4] * 7 + [3e-4] * 7 + [4e-4] * 7, "gear_waves": [5e-5] * 7 + [-6e-5] * 7,
}  # fmt: skip

ARM_ERRORS = tuple(tuple(row) for row in (np.eye(2, 31) * 7e-4).tolist())
FORCE_ERRORS = tuple(tuple(row) for row in (np.eye(2, 18) * 8e-4).tolist())


@pytest.fixture
def calibration():
    scene = load_scene("block")
    quantities = {}
    for name, count in LENGTHS.items():
        values = VALUES.get(name, [1.0] * (count or 7))
        if name == "sensor_matrix":
            values = (1.02 * np.eye(6)).ravel().tolist()
        if name == "force_to_torque":
            values = [0.0, -0.05, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0]
        visible = [True] * len(values)
        if name == "stick_stiffness":
            visible[1] = False
        quantities[name] = Quantity("SI", tuple(values), tuple([1e-5] * len(values)), tuple(visible))
    date = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    return Calibration(
        date, "block", stated_hash(scene), "lwr4", 0.03, 75, 3e-6, 240.0, quantities, ARM_ERRORS, FORCE_ERRORS
    )


def test_file_holds_all(calibration, tmp_path):
    write_calibration(calibration, tmp_path / "c.toml")
    assert read_calibration(tmp_path / "c.toml") == calibration


def test_a_full_disk_costs_neither_of_two_calibrations(calibration, tmp_path):
    file = tmp_path / "calibration.toml"
    write_calibration(calibration, file)
    write_calibration(replace(calibration, touches=7), file)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(before) == {"calibration.toml", "calibration.previous.toml"}
    (tmp_path / "calibration.toml.new.part").symlink_to("/dev/full")
    with pytest.raises(StorageError, match=r"calibration\.toml"):
        write_calibration(replace(calibration, touches=8), file)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def changed(calibration, name, values):
    quantity = replace(calibration.quantities[name], values=tuple(values))
    later = calibration.date + timedelta(days=30)
    return replace(calibration, date=later, quantities={**calibration.quantities, name: quantity})


def test_doctor_says_what_has_changed_since_the_calibration_before(calibration, tmp_path):
    path = tmp_path / "c.toml"
    today = replace(calibration, date=datetime.now(UTC).replace(microsecond=0) - timedelta(days=61))
    write_calibration(today, path)
    asked = ["doctor", "--scene", "block", "--set", f'calibration="{path}"']
    assert "calibration drift" not in CliRunner().invoke(app, asked).output
    write_calibration(changed(today, "tool_shift", [1e-4, -2e-4, 3.4e-4]), path)
    assert read_calibration(previous_path(path)) == today
    assert "nothing has changed" in CliRunner().invoke(app, asked).output
    write_calibration(changed(today, "tool_shift", [1e-4, -2e-4, 6e-4]), path)
    found = CliRunner().invoke(app, asked)
    assert "tool_shift[2] from 0.00034 to 0.0006" in found.output
    assert found.exit_code == 1


def test_doctor_counts_a_calibration_that_cannot_be_used_as_a_problem(calibration, tmp_path):
    """It had ended behind its list, without a mark in it."""
    path = tmp_path / "c.toml"
    asked = ["doctor", "--scene", "block", "--set", f'calibration="{path}"']
    write_calibration(replace(calibration, scene_hash="another"), path)
    contents = ["format = 3\n", path.read_text(), None]
    for content, words in zip(contents, ("date is None", "calibrate again", "an existing file")):
        path.unlink()
        if content is not None:
            path.write_text(content)
        found = CliRunner().invoke(app, asked)
        (line,) = (line for line in found.output.splitlines() if line.startswith("! "))
        assert line.startswith("! calibration ")
        assert words in line
        assert "problems found: 1" in found.output
        assert found.exit_code == 1


def test_doctor_refuses_a_scene_that_is_wrong_at_once():
    found = CliRunner().invoke(app, ["doctor", "--scene", "nowhere.toml"])
    assert isinstance(found.exception, SceneError)
    assert found.output == ""


def test_only_what_both_have_seen_counts_as_changed(calibration):
    stick = changed(calibration, "stick_stiffness", [2000.0, 5e6])
    assert drifts(stick, calibration) == []
    two = changed(changed(calibration, "sphere_radius", [0.00506]), "tool_shift", [2e-4, -2e-4, 3e-4])
    assert [(one.quantity, one.index) for one in drifts(two, calibration)] == [("tool_shift", 0), ("sphere_radius", 0)]


def test_scene_is_used_with_what_was_measured(calibration, tmp_path):
    write_calibration(calibration, tmp_path / "c.toml")
    stated = load_scene("block", {"calibration": str(tmp_path / "c.toml")})
    used = calibrated(stated)
    tip = stated.arm.tool.matrix() @ np.array([2e-4, 1e-4, -3e-4, 1.0])
    assert used.arm.tool.matrix()[:3, 3] == pytest.approx(tip[:3])
    assert used.probe.radius == 0.00501
    assert used.probe.stiffness_lateral == 2000.0
    assert used.probe.stiffness_axial == stated.probe.stiffness_axial, "not visible: as stated"
    assert used.contact.stiffness == stated.contact.stiffness, "that of the arm depends on its posture"
    assert used.table.height == 0.001
    assert used.area.lower[2] >= used.table.height + used.probe.radius
    plane = used.table.normal()
    assert plane[1] / plane[2] == pytest.approx(-0.002)
    assert used.uncertainty.probe_length_mm == pytest.approx(0.01)
    change = np.repeat([[1e-4], [2e-4], [3e-4], [4e-4]], 7, axis=1)
    assert used.arm.correction.table_change(7) == pytest.approx(change)
    assert used.arm.correction.waves(7) == pytest.approx(np.repeat([[5e-5], [-6e-5]], 7, axis=1))
    assert used.arm.correction.joint_hysteresis_deg == pytest.approx(np.degrees(4e-5))
    assert used.uncertainty.dh_a_mm == pytest.approx(0.01)
    assert used.uncertainty.dh_twist_deg == pytest.approx(np.degrees(1e-5))
    assert used.uncertainty.gear_ripple_deg == pytest.approx(np.degrees(1e-5))
    assert calibrated(load_scene("block")) == load_scene("block")


def test_the_arm_is_as_stiff_as_its_joints_in_the_posture_of_the_run(calibration):
    """Against the shift of a tip whose joints were turned by the torques of 1 N along the stick."""
    found = changed(calibration, "joint_stiffness", [8e3, 9e3, 1e4, 1.1e4, 1.2e4, 1.3e4, 1.4e4])
    scene, robot = load_scene("block"), robot_by_name("lwr4")
    ways = []
    for q in np.radians(
        [[-17.0, -52.0, 19.0, 80.0, -19.0, -51.0, 7.0], [32.0, -78.0, 105.0, -80.0, -105.0, -78.0, -45.0]]
    ):
        tip = robot.fk_batch(q[None])[0]
        torques = robot.jacobian(q)[:3].T @ tip[:3, 2]
        turned = robot.fk_batch((q + 1e-3 * torques / found.values("joint_stiffness"))[None])[0]
        way = float((turned - tip)[:3, 3] @ tip[:3, 2]) / 1e-3
        used = stiff_as_calibrated(scene, found, robot, q)
        assert used.contact.stiffness == pytest.approx(1.0 / way, rel=1e-4)
        assert used.uncertainty.arm_stiffness_percent < 1e-4
        assert stiff_as_calibrated(scene, None, robot, q) == scene
        ways.append(way)
    assert max(ways) > 1.1 * min(ways)


@pytest.mark.slow
def test_a_run_with_another_table_than_stated_is_in_the_world_of_its_scene(calibration, tmp_path):
    """The simulated world is built from what the scene states, not from what the calibration has found."""
    write_calibration(calibration, tmp_path / "c.toml")
    settings = [f'calibration="{tmp_path / "c.toml"}"', "truth.profile=lab", "run.time_limit=1.0"]
    scene = load_scene("block", settings)
    assert not is_world_of(actual_scene(scene), calibrated(scene)), "its objects rise with the table"
    assert ANOTHER_WORLD not in explore(scene)["warnings"]


@pytest.mark.slow
def test_a_calibrated_run_is_replayed_as_it_was(calibration, tmp_path):
    write_calibration(changed(calibration, "joint_stiffness", [1.3e4] * 7), tmp_path / "c.toml")
    settings = [
        f'calibration="{tmp_path / "c.toml"}"', "truth.profile=ideal", "strategy.step=0.02",
        "area.lower=[-0.012, 0.0, 0.020]", "area.upper=[0.012, 0.045, 0.06]",
    ]  # fmt: skip
    out = tmp_path / "run"
    with Exploration(load_scene("block", settings), RunOptions(out=out, record=True)) as exploration:
        for _ in exploration:
            pass
    exploration.finish()
    recording = read_recording(out)
    again = Replay(recording, recorded_scene(recording), tmp_path / "again")
    assert again.run().status == "done"
    assert again.scene.contact.stiffness == exploration.scene.contact.stiffness != 2e4
    assert (tmp_path / "again" / "contacts.csv").read_bytes() == (out / "contacts.csv").read_bytes()


def test_speeds_that_are_called_safe_are_those_of_the_calibrated_arm(calibration, tmp_path):
    """They were those of the stated stiffness, while a run takes the calibrated one."""
    write_calibration(changed(calibration, "joint_stiffness", [3e4] * 7), tmp_path / "c.toml")
    stated = load_scene("block")
    scene = load_scene(stated, [f'calibration="{tmp_path / "c.toml"}"'])
    used = scene_at_start(scene)[0]
    assert used.contact.stiffness > 1.2 * scene.contact.stiffness
    spelled_out = used.model_copy(update={"calibration": ""})
    assert stability(scene, 0.01, 0.006, 16.0) == stability(spelled_out, 0.01, 0.006, 16.0)
    assert stability(scene, 0.01, 0.006, 16.0).value != stability(stated, 0.01, 0.006, 16.0).value
    for speed in (
        lambda scene: safe_speed(scene, 0.01, 0.006, 16.0),
        lambda scene: host_checks(scene, 0.01, 0.006, 0.01, 16.0)[-1].detail["speed_without_mm_s"],
    ):
        assert speed(scene) == pytest.approx(speed(spelled_out), rel=1e-6)
        assert speed(scene) != pytest.approx(speed(stated), rel=0.05)


def test_sensor_is_read_with_its_matrix_and_clock(calibration):
    class Fake:
        rate, latency = 125.0, 0.0

        def read(self):
            return [WrenchSample(1.0, np.array([1.02, 0.0, 2.04]), np.array([0.0, 0.0, 0.102]), 3, 0)]

    sensor = CalibratedSensor(Fake(), calibration)
    (sample,) = sensor.read()
    assert sample.time == pytest.approx(0.996)
    assert sample.sequence == 3
    assert sample.force == pytest.approx([1.0, 0.0, 2.0])
    assert sample.torque == pytest.approx([0.0, 0.0, 0.1])
    assert sensor.latency == 0.005
    assert sensor.rate == 125.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format = 3", "format = 9", "format"),
        ("touches = 75", 'touches = "many"', "touches"),
        ("[quantity.table]", "[other.table]", "quantity.table is missing"),
        ("[quantity.table]", "[quantity.tabel]", "quantity.tabel is none of"),
        ("[quantity.clock_offset]", "[quantity.clock_offset", "TOML"),
        ("0.00501,", "nan,", "sphere_radius"),
        ("-6e-05,\n", "", "gear_waves"),
        ("0.0007,\n", "", "arm_errors"),
        ("0.0007,\n", "nan,\n", "arm_errors"),
        ("0.0008,\n", "", "force_errors"),
        ("0.0008,\n", "inf,\n", "force_errors"),
        ("0.00501,", "5.0,", r"quantity.sphere_radius.values is \[5.0\], not 1 finite numbers from 0.0001 to 0.5"),
        ("0.0003,\n", "0.3,\n", "quantity.tool_shift.values"),
        ("1e-05,\n", "-1e-05,\n", "quantity.tool_shift.sigma .* from 0 to"),
        ("2000.0,", "0.0,", "quantity.stick_stiffness.values"),
        ("residual_m = 3e-06", "residual_m = nan", "residual_m is nan"),
        ("date = 2026", "date = 2126", "date is 2126-01-02 .* in the future"),
        ("05+00:00", "05", "without a time zone"),
    ],
)
def test_broken_file_is_refused_with_its_place(calibration, tmp_path, old, new, message):
    path = tmp_path / "c.toml"
    write_calibration(calibration, path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(FormatError, match=message):
        read_calibration(path)


def test_a_setting_names_the_file_as_seen_from_the_working_folder_and_a_scene_as_seen_from_its_own(
    calibration, tmp_path, monkeypatch
):
    """`--set calibration=...` for a built-in scene had looked in the folder of the built-in scenes."""
    work, scenes = tmp_path / "work", tmp_path / "scenes"
    for folder in (work, scenes):
        folder.mkdir()
        write_calibration(calibration, folder / "c.toml")
    monkeypatch.chdir(work)
    (scenes / "own.toml").write_text('calibration = "c.toml"\n')
    for scene in ("block", scenes / "own.toml"):
        assert load_scene(scene, ["calibration=./c.toml"]).calibration == str(work / "c.toml")
    assert load_scene(scenes / "own.toml").calibration == str(scenes / "c.toml")


def test_missing_file_and_another_probe_are_refused(calibration, tmp_path):
    with pytest.raises(SceneError, match="lwrprobe calibrate"):
        load_scene("block", {"calibration": str(tmp_path / "none.toml")})
    write_calibration(calibration, tmp_path / "c.toml")
    with pytest.raises(SceneError, match="calibrate again"):
        load_scene("block", {"calibration": str(tmp_path / "c.toml"), "probe.radius": 0.004})
    with pytest.raises(SceneError, match="calibrate again"):
        load_scene("block", {"calibration": str(tmp_path / "c.toml"), "arm.gear_waves": 200.0})


@pytest.mark.parametrize("diameter", [0.0, 30.0, float("nan")])
def test_diameter_is_in_metres(diameter):
    with pytest.raises(InputError, match="reference-sphere"):
        with_reference_sphere(load_scene("block"), diameter)


def test_command_asks_for_the_diameter():
    result = CliRunner().invoke(app, ["calibrate", "block"])
    assert result.exit_code == 2
    assert "--reference-sphere" in result.output


def test_load_is_told_from_drift():
    random = np.random.default_rng(1)
    turns = [rotations(random.standard_normal(3), np.array([a]))[0] for a in np.linspace(0.1, 1.2, 40)]
    com, readings = np.array([0.0, 0.001, 0.03]), []
    for k, turn in enumerate(turns):
        time, weight = 3.0 * k, -0.003 * 9.80665 * turn[2]
        force = weight + [0.1, -0.2, 0.3] + time * np.array([1e-3, 0.0, -1e-3]) + 1e-4 * random.standard_normal(3)
        torque = np.cross(com, weight) + np.array([1e-3, 0.0, 0.0]) + 1e-6 * random.standard_normal(3)
        readings.append(WrenchSample(time, force, torque, k))
    load = identify_payload(readings, turns)
    assert abs(load.mass - 0.003) < 4.0 * load.mass_sigma < 1e-4
    assert (np.abs(load.com - com) < 4.0 * load.com_sigma + 1e-4).all()
    assert load.drift[:3] == pytest.approx([1e-3, 0.0, -1e-3], abs=2e-6)
