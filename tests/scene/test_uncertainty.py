"""The table `[uncertainty]`: what it believes, and what one entry changes."""

import pytest

from lwrprobe.contracts import SceneError
from lwrprobe.scene import load_scene, write_scene
from lwrprobe.scene.truth import PROFILES as TRUTH
from lwrprobe.scene.uncertainty import PROFILES, UncertaintyTable

KEYS = [name for name in UncertaintyTable.model_fields if name not in ("profile", "force_errors")]
OWN = {"sensor_delay_ms", "object_compliance_um_n"}
RENAMED = {
    "zero_force_mn": "zero_wander_force_mn", "zero_torque_unm": "zero_wander_torque_unm",
    "arm_stiffness_percent": "joint_stiffness_percent",
}  # fmt: skip


def test_every_key_has_a_figure_in_each_profile_but_ideal():
    assert set(PROFILES["lab"]) == set(PROFILES["datasheet"]) == set(KEYS)
    assert all(PROFILES["lab"][name] <= PROFILES["datasheet"][name] for name in KEYS)
    assert all(UncertaintyTable(profile="ideal").sigma(name) == 0.0 for name in KEYS)


@pytest.mark.parametrize("profile", ["lab", "datasheet"])
def test_profiles_believe_what_the_profiles_of_the_simulated_world_draw(profile):
    for name in set(KEYS) - OWN:
        departure = TRUTH[profile][RENAMED.get(name, name)]
        assert PROFILES[profile][name] == (departure.sigma or (departure.value or (0.0,))[0]), name


def test_a_scene_without_the_table_believes_a_good_set_up():
    table = load_scene("block").uncertainty
    assert table == UncertaintyTable(profile="lab")
    assert table.sigma("probe_length_mm") == 0.05


def test_an_entry_replaces_the_profile_s_and_survives_the_file(tmp_path):
    scene = load_scene("block", ["uncertainty.profile=datasheet", "uncertainty.probe_length_mm=0"])
    assert scene.uncertainty.sigma("probe_length_mm") == 0.0
    assert scene.uncertainty.sigma("sphere_off_axis_mm") == 0.2
    write_scene(scene, tmp_path / "scene.toml")
    assert load_scene(tmp_path / "scene.toml").uncertainty == scene.uncertainty


def test_the_truth_changes_nothing_of_it():
    plain, other = load_scene("block"), load_scene("block", ["truth.profile=datasheet"])
    assert plain.uncertainty == other.uncertainty


@pytest.mark.parametrize(
    "setting",
    [
        "probe_length_mm=-0.1", "profile=rough", "probe_lenght_mm=0.1",
        "force_errors=[[0.1, 0.2]]", "force_errors=0.1", f"force_errors=[{[0.0] * 17 + ['nan']}]",
    ],
)  # fmt: skip
def test_what_is_no_standard_deviation_is_refused_by_name(setting):
    with pytest.raises(SceneError, match=f"uncertainty.{setting.split('=')[0]}"):
        load_scene("block", [f"uncertainty.{setting}"])
