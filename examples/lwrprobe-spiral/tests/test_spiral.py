"""The spiral on its own: options refused, and the whole way on a simulated sphere."""

import pytest
from lwrprobe_spiral import SpiralConfig

from lwrprobe.contracts import InputError
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.scene import load_scene


def test_a_bad_pitch_is_refused():
    with pytest.raises(InputError, match=r"strategy\.pitch"):
        SpiralConfig(pitch=-1.0)


def test_the_spiral_reaches_its_end_on_a_sphere():
    scene = load_scene("sphere", ["strategy.name='spiral'", "strategy.radius=0.012", "truth.profile=ideal"])
    summary = explore(scene)
    assert summary["status"] == "done", summary["reason"]
    assert summary["contacts"] > 100
    assert summary["link_collisions"] == 0
    assert summary["surface_error_mm"]["median"] < 0.3
