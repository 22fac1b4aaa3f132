"""Shapes are found where they are, within what the contacts can tell, and nowhere else."""

import numpy as np
import pytest

from lwrprobe.bench.sampled_lines import sample_lines
from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.reconstruction.fits import fit
from lwrprobe.scene import load_scene


def fitted(name, phase=0.25, pitch=0.01):
    return fit(sample_lines(load_scene(name).solid(), pitch, phase))


@pytest.mark.slow
@pytest.mark.parametrize("phase", [0.25, 0.8])
@pytest.mark.parametrize(
    ("scene", "kind", "truth"),
    [
        ("block", "box", {"width": 0.05, "height": 0.05}),
        ("stacked_blocks", "box", {"width": 0.05, "height": 0.1}),
        ("cylinder_vertical", "cylinder", {"radius": 0.024, "height": 0.05}),
        ("cylinder_horizontal", "cylinder", {"radius": 0.024, "length": 0.05}),
        ("sphere", "sphere", {"radius": 0.025}),
    ],
)
def test_dimensions_within_a_fifth_of_a_millimetre(scene, kind, truth, phase):
    best = fitted(scene, phase)[0]
    assert best.warranted
    assert best.kind == kind
    for name, value in truth.items():
        assert best.dimensions[name] == pytest.approx(value, abs=2e-4)
        assert best.uncertainty[name] < 2e-4


@pytest.mark.parametrize("phase", [0.1, 0.25, 0.5, 0.8])
def test_an_end_between_two_lines_is_as_uncertain_as_it_is(phase):
    box = fitted("block", phase)[0]
    assert box.warranted
    assert abs(box.dimensions["length"] - 0.1) < 2.5 * box.uncertainty["length"]
    assert "length" in str(box)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["bridge", "combination", "polystyrene_1", "polystyrene_2", "jaw_chuck"])
def test_no_shape_is_claimed_for_what_is_none(scene):
    for found in fitted(scene):
        assert not found.warranted
        assert found.why_not


def test_only_one_shape_is_claimed():
    for scene in ("block", "cylinder_vertical", "sphere"):
        assert [f.warranted for f in fitted(scene)].count(True) == 1


def test_free_space_contradicts_a_shape():
    """The same contacts as a block's, but the sphere has passed through where the block would be."""
    record = sample_lines(load_scene("block").solid(), 0.01, 0.25)
    assert fit(record)[0].warranted
    through = np.column_stack([np.zeros(400), np.linspace(-0.02, 0.02, 400), np.full(400, 0.03)])
    record.free_path = np.vstack([record.free_path, through])
    best = fit(record)[0]
    assert not best.warranted
    assert "freely" in best.why_not


def test_a_tilted_plane():
    rng = np.random.default_rng(1)
    normal = np.array([0.05, -0.03, 1.0])
    normal /= np.linalg.norm(normal)
    plan = rng.uniform(-0.05, 0.05, (400, 2))
    height = 0.01 - (plan @ normal[:2]) / normal[2]
    points = np.column_stack([plan, height]) + 1e-4 * rng.normal(size=(400, 3))
    best = fit(TouchRecord(points, normals=np.tile(normal, (400, 1)), probe_radius=0.005))[0]
    assert best.kind == "plane"
    assert best.warranted
    assert best.axis @ normal > np.cos(np.radians(0.1))


def test_the_same_contacts_give_the_same_fits():
    record = sample_lines(load_scene("cylinder_vertical").solid(), 0.01, 0.25)
    assert [f.dimensions for f in fit(record)] == [f.dimensions for f in fit(record)]


def test_a_turned_box():
    record = sample_lines(load_scene("block").solid(), 0.01, 0.25)
    angle = np.radians(20.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = TouchRecord(
        record.points @ turn.T,
        normals=record.normals @ turn.T,
        free_path=record.free_path @ turn.T,
        probe_radius=0.005,
        table=0.0,
        lowest=0.006,
    )
    best = fit(turned)[0]
    assert best.kind == "box"
    assert best.warranted
    assert best.dimensions["width"] == pytest.approx(0.05, abs=2e-4)


def test_points_on_a_line_are_refused():
    with pytest.raises(InputError):
        fit(TouchRecord(np.outer(np.arange(50.0), [0.001, 0, 0])))


def test_what_all_contacts_share_adds_to_the_dimensions():
    record = sample_lines(load_scene("sphere").solid(), 0.01, 0.25)
    plain = fit(record)[0]

    def shifts(points, normals):
        return np.full((len(points), 1), 1e-4), np.zeros((len(points), 1))

    larger, aside = fit(record, shifts)[0], fit(record, lambda _, n: (n[:, :1], n[:, 1:2]))[0]
    assert larger.uncertainty["radius"] == pytest.approx(np.hypot(1e-4, plain.uncertainty["radius"]), rel=1e-2)
    assert larger.uncertainty_aligned["radius"] == pytest.approx(plain.uncertainty["radius"])
    assert aside.uncertainty["radius"] < 0.1, "a sphere that is moved by a metre is no larger"
