"""Random objects: closed, of the size and in the pose that is promised, the same for the same kind and seed."""

import subprocess
import sys
import tomllib
from functools import cache

import numpy as np
import pytest

from lwrprobe.contracts import SceneError, UnknownNameError
from lwrprobe.scene import load_scene, write_scene
from lwrprobe.scene.random_object import KINDS as MAKERS
from lwrprobe.scene.random_object import random_mesh
from lwrprobe.scene.shape import KINDS

trimesh = pytest.importorskip("trimesh")
SEEDS = (0, 1, 2, 3, 2**62)


@cache
def mesh_of(kind, seed):
    vertices, faces = random_mesh(kind, seed)
    return trimesh.Trimesh(vertices, faces, process=False)


def test_the_scene_file_names_the_kinds_that_are_made():
    assert set(KINDS) == set(MAKERS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_object_is_closed_manifold_and_of_the_size_that_is_promised(kind, seed):
    mesh = mesh_of(kind, seed)
    _, uses = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    assert (uses == 2).all()
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert len(mesh.split(only_watertight=False)) == 1
    lower, upper = mesh.bounds
    longest = (upper - lower).max()
    assert 0.06 - 1e-5 <= longest <= 0.12 + 1e-5 or upper[2] == pytest.approx(0.09, abs=1e-5)
    assert upper[2] <= 0.09 + 1e-5
    assert lower[2] == 0.0
    assert (0.5 * (lower + upper)[:2]) == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("kind", ["hull", "extrusion", "organic", "stack"])
def test_an_object_with_a_length_has_it_and_is_pressed_flat_where_it_would_be_too_high(kind):
    scene = load_scene(f"random:{kind}:1:320")
    lower, upper = scene.solid().bounds()
    assert (upper - lower)[:2].max() == pytest.approx(0.32, abs=1e-5)
    assert upper[2] <= 0.09 + 1e-5
    assert scene.area.upper[0] > upper[0] + 0.02
    assert scene.name == f"random_{kind}_1_320"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_object_stands_with_its_centre_of_mass_over_its_feet(kind, seed):
    mesh = mesh_of(kind, seed)
    feet = mesh.vertices[mesh.vertices[:, 2] < 2e-4][:, :2]
    middle = mesh.center_mass[:2]
    # Over a point inside of the feet, half of them in every direction are on either side.
    turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    assert ((feet - middle) @ directions.T).max(axis=0).min() > -5e-5


@pytest.mark.slow
def test_half_of_the_kinds_overhang_often_and_the_convex_one_is_convex():
    shares = {}
    for kind in KINDS:
        over = []
        for seed in range(6):
            mesh = mesh_of(kind, seed)
            down = (mesh.face_normals[:, 2] < -0.1) & (mesh.triangles_center[:, 2] > 2e-3)
            over.append(mesh.area_faces[down].sum() / mesh.area)
        shares[kind] = np.array(over)
    assert sum((share > 0.05).mean() >= 0.5 for share in shares.values()) >= 5
    assert all((share > 0.01).any() for share in shares.values())
    assert all(mesh_of("hull", seed).is_convex for seed in range(6))


@pytest.mark.slow
def test_seeds_give_different_objects_and_the_same_seed_the_same_in_another_process():
    assert mesh_of("boolean", 1).volume != pytest.approx(mesh_of("boolean", 2).volume, rel=1e-3)
    code = (
        "from lwrprobe.scene.random_object import KINDS, random_mesh;"
        "print([[random_mesh(k, 5)[n].sum().item() for n in (0, 1)] for k in KINDS])"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    here = [[random_mesh(kind, 5)[n].sum().item() for n in (0, 1)] for kind in MAKERS]
    assert np.allclose(eval(other), here, rtol=0.0, atol=1e-9)


# Volume mm^3 and height mm of seed 5, as they were when the kinds were laid down: a change here is another set of
# objects, and figures that were measured with the old one no longer compare.
KEPT = {
    "hull": (np.float64(60043.108), np.float64(51.78641)),
    "bumps": (np.float64(175329.857), np.float64(65.89301)),
    "extrusion": (np.float64(250776.011), np.float64(53.87446)),
    "revolution": (np.float64(58324.253), np.float64(60.98806)),
    "boolean": (np.float64(123788.894), np.float64(43.35957)),
    "organic": (np.float64(409239.815), np.float64(90.0)),
    "thin": (np.float64(47676.123), np.float64(65.5492)),
    "steps": (np.float64(28868.439), np.float64(26.46746)),
    "stack": (np.float64(304009.962), np.float64(90.0)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_objects_of_a_seed_are_kept(kind):
    mesh = mesh_of(kind, 5)
    assert [1e9 * mesh.volume, 1e3 * mesh.bounds[1, 2]] == pytest.approx(KEPT[kind], rel=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_by_kind_and_seed_holds_the_object_with_margins(kind):
    scene = load_scene(f"random:{kind}:3")
    assert scene.name == f"random_{kind}_3"
    lower, upper = scene.solid().bounds()
    assert (np.array(scene.area.upper)[:2] - upper[:2] >= 0.029).all()
    assert (lower[:2] - np.array(scene.area.lower)[:2] >= 0.029).all()
    assert scene.area.upper[2] - upper[2] >= 0.0199


def test_a_scene_by_kind_and_seed_is_written_and_read_back(tmp_path):
    scene = load_scene("random:organic:5", ["object.0.friction=0.2"])
    write_scene(scene, tmp_path / "scene.toml")
    assert tomllib.loads((tmp_path / "scene.toml").read_text())["object"][0]["seed"] == 5
    again = load_scene(tmp_path / "scene.toml")
    assert again == scene
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (50, 3))
    assert (again.solid().signed_distance(points) == scene.solid().signed_distance(points)).all()


def test_the_simulated_solid_is_the_mesh():
    mesh, solid = mesh_of("revolution", 4), load_scene("random:revolution:4").solid()
    points = mesh.sample(60, seed=1) + np.random.default_rng(2).normal(0.0, 0.004, (60, 3))
    triangles = 1e3 * mesh.triangles  # trimesh takes products of lengths below 1e-13 for zero
    nearest = [trimesh.triangles.closest_point(triangles, np.tile(1e3 * p, (len(triangles), 1))) for p in points]
    distance = np.array([np.linalg.norm(1e-3 * feet - p, axis=1).min() for feet, p in zip(nearest, points)])
    inside = mesh.contains(points)
    assert solid.signed_distance(points) == pytest.approx(np.where(inside, -distance, distance), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("random:orgnic:5", "did you mean 'organic'"),
        ("random", "scene"),
        ("random:", "boolean"),
        ("random:hull", "random:hull:SEED"),
        ("random:hull:", "random:hull:SEED"),
        ("random:hull:-1", "random:hull:SEED"),
        ("random:hull:1.5", "random:hull:SEED"),
        ("random:hull:1:2", "MM from 20 to 1000"),
        ("random:hull:1:200:3", "random:hull:SEED"),
        ("random:hull:1:1e2", "random:hull:SEED"),
        (f"random:hull:{2**63}", "2^63"),
    ],
)
def test_a_wrong_kind_or_seed_gives_one_clear_error(name, said):
    with pytest.raises((SceneError, UnknownNameError), match="allowed") as caught:
        load_scene(name)
    assert said in str(caught.value)


def test_random_objects_may_be_joined_but_not_cut():
    child = {"shape": "random", "kind": "hull", "seed": 1}
    box = {"shape": "box", "size": [0.01, 0.01, 0.01]}
    from lwrprobe.scene import Scene

    assert not Scene.model_validate({"object": [{"shape": "union", "children": [child, box]}]}).solid().empty
    with pytest.raises(ValueError, match="no mesh inside of a difference"):
        Scene.model_validate({"object": [{"shape": "difference", "children": [child, box]}]})
