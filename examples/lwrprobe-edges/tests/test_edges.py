"""The edge strategy on its own: options refused, and once around the upper edge of a simulated block."""

import csv

import numpy as np
import pytest
from lwrprobe_edges import EdgesConfig

from lwrprobe.contracts import InputError
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.scene import load_scene


def test_a_bad_distance_is_refused():
    with pytest.raises(InputError, match=r"strategy\.closed"):
        EdgesConfig(closed=-1.0)


def test_the_upper_edge_of_a_block_is_followed_once_around(tmp_path):
    scene = load_scene("block", ["strategy.name='edges'", "truth.profile=ideal"])
    summary = explore(scene, tmp_path)
    assert summary["status"] == "done", summary["reason"]
    assert summary["link_collisions"] == 0
    points = np.genfromtxt(tmp_path / "contacts.csv", delimiter=",", names=True)
    around = points[points["time"] > 4.0]
    assert np.ptp(around["x"]) == pytest.approx(0.1, abs=1e-3), "the block is 100 mm by 50 mm"
    assert np.ptp(around["y"]) == pytest.approx(0.05, abs=1e-3)
    assert np.median(abs(around["z"] - 0.05)) < 5e-4, "its upper edge is 50 mm high"
    with open(tmp_path / "states.csv") as rows:
        skills = {row["state"] for row in csv.DictReader(rows)}
    assert {"transit", "guarded move", "find edge", "follow contour"} <= skills
