"""Pictures: what is nearer hides what is behind, colours are those asked for, the preview shows all three."""

import io

import numpy as np
import pytest
from PIL import Image

from lwrprobe.contracts import TriangleMesh
from lwrprobe.evaluation.preview import preview
from lwrprobe.evaluation.ramps import DEVIATION, ERROR, HEIGHT
from lwrprobe.evaluation.render import Sight, View, png, render_points
from lwrprobe.scene import load_scene

ABOVE = View(0.0, np.pi / 2, np.zeros(3), np.ones(3), 60, 60)
SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])


def test_the_nearer_of_two_squares_is_seen_whatever_their_order():
    low, high = SQUARE, 0.5 * SQUARE + [0.0, 0.0, 1.0]
    for first, second in ((low, high), (high, low)):
        mesh = TriangleMesh(np.concatenate([first, second]), np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))
        red = mesh.vertices[:, 2:] > 0.5
        seen = Sight(mesh, ABOVE).paint(np.where(red, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
        share = (seen[..., 0] > 100).sum() / (seen[..., 3] > 100).sum()
        assert share == pytest.approx(0.25, abs=0.03)
        assert (seen[..., 2] > 100).sum() == pytest.approx(3 * (seen[..., 0] > 100).sum(), rel=0.1)


def test_a_mesh_painted_twice_has_one_outline_and_two_colours():
    sight = Sight(TriangleMesh(SQUARE, np.array([[0, 1, 2], [0, 2, 3]])), ABOVE)
    green, white = sight.paint(np.tile([0.0, 1.0, 0.0], (4, 1))), sight.paint(np.ones((4, 3)))
    assert (green[..., 3] == white[..., 3]).all()
    assert green[30, 30, 0] == 0
    assert white[30, 30, 0] == white[30, 30, 1] == green[30, 30, 1] > 100
    assert not white[0, 0, 3]


def test_points_are_balls_of_their_size_in_their_colours():
    seen = render_points(np.array([[0.5, 0.5, 0.5]]), np.array([[0.0, 0.0, 1.0]]), ABOVE, 0.2)
    drawn = seen[..., 3] > 127
    assert drawn.sum() == pytest.approx(np.pi * (0.2 * 0.92 * 60) ** 2, rel=0.05)
    assert seen[30, 30, 2] == 255
    assert not seen[drawn][:, :2].any()
    assert np.asarray(Image.open(io.BytesIO(png(seen)))).tolist() == seen.tolist()


@pytest.mark.parametrize("ramp", [HEIGHT, ERROR, DEVIATION])
def test_a_ramp_meets_its_stops_and_saturates(ramp):
    at = np.linspace(0.0, 1.0, len(ramp.stops))
    found = np.round(255.0 * ramp.colours(at)).astype(int)
    assert ["#" + "".join(f"{v:02x}" for v in row) for row in found] == list(ramp.stops)
    assert (ramp.colours(np.array([-1.0, 2.0])) == ramp.rgb()[[0, -1]]).all()
    assert all(stop in ramp.css() for stop in ramp.stops)


@pytest.mark.slow
def test_the_preview_shows_what_there_is_and_says_where_there_is_nothing(tmp_path):
    solid = load_scene("block").solid()
    points, _ = solid.sample_surface(500, 1)
    whole, bare = tmp_path / "whole.png", tmp_path / "bare.png"
    whole.write_bytes(preview("a block", points, solid.mesh(), solid.mesh(), ["500 contacts"]))
    bare.write_bytes(preview("nothing", np.empty((0, 3)), None, None, []))
    full, empty = (np.asarray(Image.open(path)).astype(int) for path in (whole, bare))
    assert full.shape == empty.shape
    for i, panel in enumerate(np.array_split(full, 3, axis=1)):
        strong = np.ptp(panel, axis=2) > 30  # the frame and the words are nearly grey
        assert strong.sum() > (1000, 20_000, 20_000)[i]
        warm = panel[strong][:, 0].mean() > panel[strong][:, 2].mean()
        assert warm == (i == 1) or i == 0
    assert (np.ptp(empty, axis=2) > 30).sum() == 0
    assert (empty < 200).any()
