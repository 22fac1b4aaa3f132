"""Scene files: what is accepted, what is refused and in which words, and that nothing is lost in writing."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lwrprobe.contracts import SceneError, UnknownNameError
from lwrprobe.scene import Scene, json_schema, load_scene, profile_names, scene_names, write_scene

BAD = Path(__file__).with_name("bad")

COSTLY = pytest.param("jaw_chuck", marks=pytest.mark.slow)
SCENES = [COSTLY if name == "jaw_chuck" else name for name in scene_names()]

# file: (key the message must name, what it must show of the value, what it must say is allowed)
REFUSED = {
    "syntax": ("syntax.toml", "line 1", "TOML"),
    "not_utf8": ("not_utf8.toml", "position 9", "TOML"),
    "unknown_table": ("prob", "radius", "did you mean 'probe'"),
    "unknown_key": ("probe.radiuss", "0.005", "did you mean 'radius'"),
    "unknown_key_deep": ("arm.base.rpy", "0.0", "did you mean 'rpy_deg'"),
    "radius_negative": ("probe.radius", "-0.005", "greater than 0"),
    "radius_zero": ("probe.radius", "0.0", "greater than 0"),
    "radius_nan": ("probe.radius", "nan", "a finite number"),
    "radius_infinite": ("probe.radius", "inf", "a finite number"),
    "radius_text": ("probe.radius", "5 mm", "a number"),
    "stick_thicker_than_sphere": ("probe.stick_radius", "0.006", "less than the sphere's radius"),
    "probe_in_millimetres": ("probe.radius", "5.0", "at most 0.5 in size: lengths are in metres, and 5 mm are 0.005"),
    "stick_through_sensor": ("probe.sensor_distance", "0.05", "radius + stick_length, 0.205, or more"),
    "probe_heavy": ("probe.mass", "0.15", "at most 0.03 kg"),
    "lever_long": ("contact.target", "0.8", "less than 0.64 N"),
    "area_inverted": ("area.lower x", "0.1", "less than upper x"),
    "area_in_millimetres": ("area.lower[0]", "-85.0", "lengths are in metres"),
    "area_in_table": ("area.lower z", "0.001", "table.height + probe.radius"),
    "area_two_numbers": ("area.lower[2]", "-0.06", "the missing number"),
    "area_four_numbers": ("area.lower", "0.006", "at most 3 items"),
    "shape_unknown": ("object[0]", "cyllinder", "did you mean 'cylinder'"),
    "shape_missing": ("object[0]", "size", "shape = one of"),
    "box_without_size": ("object[0].size", "nothing", "the key is missing"),
    "box_key_of_cylinder": ("object[0].radius", "0.02", "size"),
    "box_flat": ("object[0].size[1]", "0.0", "greater than 0"),
    "box_in_millimetres": ("object[0].size[0]", "120.0", "lengths are in metres, and 120 mm are 0.12"),
    "box_far_away": ("object[0].at.xyz[2]", "25.0", "lengths are in metres"),
    "union_empty": ("object[0].children", "[]", "at least 1"),
    "difference_of_one": ("object[0].children", "sphere", "at least 2"),
    "random_kind": ("object[0].kind", "orgnic", "'organic'"),
    "random_seed": ("object[0].seed", "-1", "greater than or equal to 0"),
    "child_with_friction": ("object[0].children[0].friction", "0.3", "outermost"),
    "mesh_missing": ("object[0].file", "nowhere.stl", "existing mesh file"),
    "mesh_in_difference": ("object[0].children[0].shape", "mesh", "no mesh inside of a difference"),
    "blend_without_balls": ("object[0].balls", "[]", "at least 1"),
    "friction_negative": ("object[0].friction", "-0.1", "greater than or equal to 0"),
    "object_is_a_table": ("object", "sphere", "[[object]]"),
    "approach_faster_than_free": ("motion.approach_speed", "0.1", "no more than free_speed"),
    "motion_mode": ("motion.mode", "carthesian", "'cartesian' or 'joint'"),
    "speed_negative": ("motion.contour_speed", "-0.02", "greater than 0"),
    "threshold_above_limit": ("contact.threshold", "6.0", "threshold < target < limit"),
    "target_above_limit": ("contact.threshold, target, limit", "5.5", "threshold < target < limit"),
    "clearance_word": ("clearance.enabled", "sometimes", "true, false or 'auto'"),
    "rate_zero": ("sensor.rate", "0", "greater than 0"),
    "seed_float": ("run.seed", "1.5", "a whole number"),
    "seed_negative": ("run.seed", "-1", "greater than or equal to 0"),
    "resolution_huge": ("map.resolution", "2.0", "less than or equal to 0.1"),
    "tilt_axis_upright": ("table.tilt_axis", "1.0", "horizontal"),
    "drivers_not_a_table": ("drivers.sim", "3", "a table"),
    "bool_as_number": ("table.height", "True", "a number"),
}

# These load, since the file is in order; the solid that they ask for is not.
NO_SOLID = {
    "half_space_alone": ("object[0]", "without end", "bounded"),
    "intersection_apart": ("object[0]", "do not meet", "holds something"),
    "mesh_open": ("object[0].file", "open.stl", "watertight"),
    "mesh_not_a_mesh": ("object[0].file", "syntax.toml", "readable triangle mesh"),
}


def test_every_bad_file_is_listed():
    assert {file.stem for file in BAD.glob("*.toml")} == set(REFUSED) | set(NO_SOLID)
    assert len(REFUSED) >= 25


@pytest.mark.parametrize("stem", REFUSED)
def test_a_bad_file_gives_one_clear_error(stem):
    key, value, allowed = REFUSED[stem]
    with pytest.raises(SceneError) as caught:
        load_scene(BAD / f"{stem}.toml")
    error = caught.value
    assert f"{stem}.toml" in error.field
    assert key in error.field
    assert value in str(error.value)
    assert allowed in error.allowed
    assert "\n" not in str(error)


@pytest.mark.parametrize("stem", NO_SOLID)
def test_an_impossible_solid_gives_one_clear_error(stem):
    key, value, allowed = NO_SOLID[stem]
    with pytest.raises(SceneError) as caught:
        load_scene(BAD / f"{stem}.toml").solid()
    assert stem in caught.value.field
    assert key in caught.value.field
    assert value in str(caught.value.value)
    assert allowed in caught.value.allowed


@pytest.mark.parametrize("name", SCENES)
def test_a_written_scene_loads_as_an_equal_one(name, tmp_path):
    scene = load_scene(name, ["strategy.step=0.005", "drivers.sim.noise=0.001"])
    write_scene(scene, tmp_path / "scene.toml")
    assert load_scene(tmp_path / "scene.toml") == scene


def test_a_mesh_file_is_found_beside_the_scene_and_after_the_scene_has_moved(tmp_path):
    import trimesh

    trimesh.creation.box([0.1, 0.05, 0.05]).export(tmp_path / "box.stl")
    here = tmp_path / "here.toml"
    here.write_text('[[object]]\nshape = "mesh"\nfile = "box.stl"\nat = { xyz = [0.0, 0.0, 0.025] }\n')
    scene = load_scene(here)
    moved = tmp_path / "run" / "scene.toml"
    moved.parent.mkdir()
    write_scene(scene, moved)
    assert load_scene(moved) == scene
    assert np.allclose(scene.solid().bounds(), [[-0.05, -0.025, 0.0], [0.05, 0.025, 0.05]])


def test_overrides_reach_every_level():
    overrides = {
        "probe.radius": "0.004",
        "object.0.friction": "0.3",
        "object.0.children.1.radius": "0.02",
        "area.upper": "[0.1, 0.06, 0.1]",
        "motion.mode": "joint",
        "strategy.name": "surface_contour",
        "strategy.step": "0.015",
        "drivers.sim.noise": "0.0",
        "clearance.enabled": "false",
        "truth.profile": "ideal",
    }
    scene = load_scene("bridge", overrides)
    assert scene == load_scene("bridge", [f"{key}={value}" for key, value in overrides.items()])
    assert scene.probe.radius == 0.004
    assert scene.objects[0].friction == 0.3
    assert scene.objects[0].children[1].radius == 0.02
    assert scene.area.upper == (0.1, 0.06, 0.1)
    assert scene.motion.mode == "joint"
    assert (scene.strategy.name, scene.strategy.options) == ("surface_contour", {"step": 0.015})
    assert scene.drivers == {"sim": {"noise": 0.0}}
    assert scene.clearance.enabled is False


@pytest.mark.parametrize(
    ("override", "key", "allowed"),
    [
        ("probe.radius", "setting", "key=value"),
        ("object.3.friction=0.1", "object.3.friction", "an index below 1"),
        ("object.first.friction=0.1", "object.first.friction", "an index below 1"),
        ("probe.radius.inner=1", "probe.radius", "a number"),
        ("title.inner.most=1", "title.inner.most", "a single value"),
        ("probe.radius=", "probe.radius", "a number"),
    ],
)
def test_a_bad_override_is_refused(override, key, allowed):
    with pytest.raises(SceneError) as caught:
        load_scene("block", [override])
    assert key in caught.value.field
    assert allowed in caught.value.allowed


@pytest.mark.parametrize(
    ("overrides", "source", "key"),
    [
        (["run.seed=3", "probe.radius=5"], "--set probe.radius=5", "probe.radius"),
        ({"run.until.time": -1}, "--set run.until.time=-1", "run.until.time"),
        (["contact.target=0.1", "run.seed=3"], "--set contact.target=0.1", "contact.threshold, target, limit"),
        (["contact.threshold=1", "contact.target=1.5", "contact.limit=1"], "--set contact.limit=1", "contact.thr"),
        (["calibration=gone.toml"], "--set calibration=gone.toml", "calibration"),
        (["object.3.friction=0.1"], "--set object.3.friction=0.1", "object.3.friction"),
    ],
)
def test_what_was_set_beside_the_file_is_blamed_on_the_setting(overrides, source, key):
    """Messages had named block.toml, which is in order."""
    with pytest.raises(SceneError) as caught:
        load_scene("block", overrides)
    assert caught.value.field.startswith(f"{source}: {key}")
    assert "block.toml" not in str(caught.value)


def test_what_a_file_has_wrong_is_blamed_on_the_file_whatever_was_set():
    with pytest.raises(SceneError) as caught:
        load_scene(BAD / "radius_zero.toml", ["run.seed=3", "probe.stick_length=0.04"])
    assert caught.value.field == "radius_zero.toml: probe.radius"


def test_an_unknown_name_lists_the_known_ones_and_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'bridge'"):
        load_scene("brigde")
    with pytest.raises(SceneError, match="existing scene file"):
        load_scene("missing.toml")


def test_a_scene_does_not_change():
    scene = load_scene("block")
    with pytest.raises(ValueError, match="frozen"):
        scene.name = "other"
    with pytest.raises(ValueError, match="frozen"):
        scene.probe.radius = 0.1


def test_built_in_scenes_are_all_there():
    source = "block cylinder_vertical cylinder_horizontal bridge combination polystyrene_1 polystyrene_2 jaw_chuck"
    limits = "sphere wedge_15deg slot_8mm slot_12mm thin_plate cliff inner_corner tilted_table empty overhang"
    assert set(scene_names()) >= {*source.split(), *limits.split(), "stacked_blocks"}


@pytest.mark.parametrize("name", [name for name in SCENES if name != "empty"])
def test_the_area_leaves_room_around_the_object(name):
    scene = load_scene(name)
    lower, upper = scene.solid().bounds()
    assert scene.title
    assert (np.array(scene.area.lower[:2]) <= lower[:2] - 0.02).all()
    assert (np.array(scene.area.upper[:2]) >= upper[:2] + 0.02).all()
    assert scene.area.upper[2] >= upper[2] + scene.probe.radius + 0.002
    assert scene.area.lower[2] >= scene.table.height + scene.probe.radius + 0.001
    assert lower[2] == pytest.approx(0.0, abs=0.002)  # a leaning block's lowest corner is 1.3 mm lower


def test_the_probe_has_its_shapes_one_behind_the_other():
    probe = load_scene("block").probe.as_probe()
    reach = {}
    for link in probe.links:
        half = link.size[-1] / 2
        reach[link.name] = (link.pose[2, 3] + half, link.pose[2, 3] - half)
        assert link.carrier == "tip"
    assert reach["stick"][0] == pytest.approx(-probe.radius)
    assert reach["sensor"][0] == pytest.approx(reach["stick"][1])
    assert reach["holder"][0] == pytest.approx(reach["sensor"][1])
    assert (
        reach["finger_left"]
        == reach["finger_right"]
        == pytest.approx((reach["holder"][1] + 0.01, reach["holder"][1] - 0.06))
    )
    assert reach["sensor"][0] - 0.001 <= -probe.sensor_distance <= reach["sensor"][0] + 0.0145
    left, right = (next(link for link in probe.links if link.name == f"finger_{side}") for side in ("left", "right"))
    assert right.pose[0, 3] - left.pose[0, 3] - right.size[0] == pytest.approx(2 * 0.0125)


def test_a_sphere_that_was_measured_a_little_larger_is_no_contradiction():
    """What `lwrprobe calibrate` finds changes the radius alone, and a world may be built from such a scene."""
    assert load_scene(load_scene("block"), ["probe.radius=0.0051"]).probe.radius == 0.0051


def test_compliance_of_a_rigid_and_of_a_soft_stick():
    assert (
        not load_scene("block", ["probe.stiffness_lateral=0", "probe.stiffness_axial=0"])
        .probe.as_probe()
        .compliance.any()
    )
    soft = load_scene("block", ["probe.stiffness_lateral=2500.0", "probe.stiffness_axial=1e6"]).probe.as_probe()
    assert soft.compliance == pytest.approx([4e-4, 4e-4, 1e-6])


def test_a_pose_turns_about_fixed_axes_in_turn():
    from lwrprobe.scene.table import Pose

    def turn(axis, degrees):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return {
            "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
            "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
            "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
        }[axis]

    pose = Pose(xyz=(1.0, 2.0, 3.0), rpy_deg=(10.0, -70.0, 130.0)).matrix()
    assert pose[:3, :3] == pytest.approx(turn("z", 130) @ turn("y", -70) @ turn("x", 10), abs=1e-15)
    assert pose[:3, 3] == pytest.approx([1.0, 2.0, 3.0])
    square = Pose(rpy_deg=(90.0, 0.0, -90.0)).matrix()
    assert set(np.abs(square).ravel()) == {0.0, 1.0}


def test_the_table_leans_about_its_axis():
    table = load_scene("tilted_table").table
    assert table.normal() == pytest.approx([0.0, -np.sin(np.radians(3)), np.cos(np.radians(3))])


def test_the_schema_accepts_the_built_in_scenes_and_is_the_published_one():
    schema = json_schema()
    published = Path(__file__).parents[2] / "docs" / "reference" / "scene.schema.json"
    assert json.loads(published.read_text()) == schema, "write json_schema() to docs/reference/scene.schema.json anew"
    known = set(schema["properties"])
    for name in scene_names():
        from lwrprobe.scene.library import scene_path

        content = tomllib.loads(scene_path(name).read_text())
        assert set(content) <= known
    assert schema["additionalProperties"] is False
    assert schema["$defs"]["StrategyTable"]["additionalProperties"] is True
    assert "description" in schema["$defs"]["ProbeTable"]["properties"]["radius"]


def test_a_scene_with_nothing_in_it_is_a_scene():
    assert Scene().objects == ()
    assert Scene().solid().empty


def test_a_profile_lies_over_the_scene_and_under_the_overrides(tmp_path):
    plain, thesis = load_scene("block"), load_scene("block", profile="thesis")
    assert "thesis" in profile_names()
    assert (thesis.motion.mode, thesis.contact.estimator, thesis.reconstruction.points) == (
        "joint",
        "force_direction",
        "voxels",
    )
    assert thesis.strategy.options == dict.fromkeys(("climb", "low_lines", "near_sides", "across", "find_ends"), False)
    assert thesis.objects == plain.objects
    assert thesis.area == plain.area
    assert load_scene("block", ["motion.mode='cartesian'"], "thesis").motion.mode == "cartesian"
    own = tmp_path / "slow.toml"
    own.write_text("[motion]\nfree_speed = 0.05\n")
    slow = load_scene("block", profile=str(own))
    assert slow.motion.free_speed == 0.05
    assert slow.motion.contour_speed == plain.motion.contour_speed


def test_an_unknown_profile_is_named_with_its_neighbours():
    with pytest.raises(UnknownNameError, match="thesis"):
        load_scene("block", profile="thesys")
