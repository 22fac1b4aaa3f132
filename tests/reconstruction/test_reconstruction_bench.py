"""The bench of reconstructors runs, holds its requirements where it can, and refuses what it does not know."""

import numpy as np
import pytest

from lwrprobe.bench.reconstruction import run
from lwrprobe.bench.sampled_lines import LOWEST, RADIUS, STICK_RADIUS, sample_lines, voxelised
from lwrprobe.contracts import InputError, UnknownNameError
from lwrprobe.scene import load_scene

pytestmark = pytest.mark.slow


def test_sampled_contacts_lie_where_a_sphere_touches():
    solid = load_scene("bridge").solid()
    record = sample_lines(solid, 0.01, 0.25)
    centres = record.points + RADIUS * record.normals
    assert np.percentile(np.abs(solid.signed_distance(record.points)), 99) < 5e-4
    assert np.median(np.abs(solid.signed_distance(centres) - RADIUS)) < 2e-4
    assert centres[:, 2].min() > LOWEST - 6e-4
    assert solid.signed_distance(record.free_path).min() > RADIUS - 1e-5


def test_a_vertical_stick_does_not_get_under_an_overhang():
    solid = load_scene("cylinder_horizontal").solid()
    record = sample_lines(solid, 0.01, 0.25)
    centres = record.points + RADIUS * record.normals
    for height in np.arange(RADIUS, 0.05, 0.0007):
        assert solid.signed_distance(centres + np.array([0.0, 0.0, height])).min() > STICK_RADIUS - 1e-3


def test_voxels_are_centres_with_unit_normals():
    raw = sample_lines(load_scene("block").solid(), 0.015, 0.25)
    cells = voxelised(raw)
    assert len(cells.points) < len(raw.points)
    assert np.abs(np.mod(cells.points, 0.002) - 0.001).max() < 1e-9
    assert np.linalg.norm(cells.normals, axis=1) == pytest.approx(1.0)


@pytest.mark.slow
def test_one_object():
    report = run(True, {"scenes": "bridge"})
    methods = [row[0] for row in report.tables[0].rows]
    assert {"contact_surface", "convex_hull", "concave_hull, 15 mm", "hermite_rbf"} <= set(methods)
    best = min(report.tables[0].rows, key=lambda row: row[2])
    assert best[0] == "contact_surface"
    assert report.as_markdown()
    assert report.data["outcomes"]


def test_unknown_options_are_named():
    with pytest.raises(UnknownNameError, match="scenes"):
        run(True, {"scene": "block"})
    with pytest.raises(InputError, match="commas"):
        run(True, {"phases": "a"})
    with pytest.raises(InputError, match="yes or no"):
        run(True, {"explore": "maybe"})
