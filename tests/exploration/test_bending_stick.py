"""While the force changes the stick bends: the sphere then moves otherwise than the joints say."""

import pytest

from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.scene import load_scene


@pytest.mark.slow
def test_a_first_press_on_a_wall_with_an_unknown_sensor_error_gives_no_slanted_normal(tmp_path):
    """The torque is not to be relied on yet, so that the path decides: it has to be the sphere's path."""
    drawn = ["truth.profile=lab", "uncertainty.profile=lab", "run.seed=2"]
    summary = explore(load_scene("block", [*drawn, "contact.target=1.0", "run.time_limit=28.0"]), tmp_path)
    assert summary["reason"] == "time limit of 28 s of robot time"  # and not a moved object
    assert summary["contacts"] > 300
    assert summary["normal_error_deg"]["median"] < 4.0
    assert summary["rejected_share"] < 0.1
