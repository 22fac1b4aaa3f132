"""The page of the built-in scenes: a picture of each, and in the repository as the command makes it."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from lwrprobe.cli.app import app
from lwrprobe.contracts import InputError
from lwrprobe.evaluation.scene_picture import BOX, OBJECT, TABLE, draw_scene
from lwrprobe.scene import load_scene, scene_names

pytestmark = pytest.mark.slow

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"


def hues(picture):
    """Share of the pixels that have the hue of object, table and frame, whatever the light."""
    bright = picture[..., :3] / np.maximum(picture[..., :3].max(axis=2, keepdims=True), 1e-9)
    near = [np.abs(bright - np.array(colour) / max(colour)).max(axis=2) < 0.06 for colour in (OBJECT, TABLE, BOX)]
    return [float(mask.mean()) for mask in near]


def test_a_picture_shows_object_table_and_frame(tmp_path):
    there, table, frame = hues(imread(draw_scene(tmp_path / "block.png", load_scene("block"))))
    assert there > 0.1
    assert table > 0.1
    assert frame > 0.005
    nothing, table, _ = hues(imread(draw_scene(tmp_path / "empty.png", load_scene("empty"))))
    assert nothing == 0.0
    assert table > 0.1
    bare = load_scene("empty", ["table.present=false"])
    assert hues(imread(draw_scene(tmp_path / "deep" / "bare.png", bare)))[1] < 0.01


def test_the_page_in_the_repository_is_the_one_the_command_makes(tmp_path):
    done = CliRunner().invoke(app, ["list", "scenes", "--pictures", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "scenes.md").read_text() == (DOCS / "scenes.md").read_text()
    for name in scene_names():
        made, kept = (imread(folder / "scenes" / f"{name}.png")[..., :3] for folder in (tmp_path, DOCS))
        assert made.shape == kept.shape
        assert np.abs(made - kept).mean() < 0.01, name
    assert sum(file.stat().st_size for file in (DOCS / "scenes").glob("*.png")) < 1_000_000


def test_what_is_no_scene_has_no_picture(tmp_path):
    done = CliRunner().invoke(app, ["list", "robots", "--pictures", str(tmp_path)])
    assert isinstance(done.exception, InputError)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="nothing else can be drawn"):
        raise done.exception
