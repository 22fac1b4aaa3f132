"""What is first touched along the stick is pressed, whatever the strategy; `active` begins there, and goes outwards."""

from dataclasses import replace

import numpy as np
import pytest
from fake_surface import FakeSurface, box

from lwrprobe.contracts import Area
from lwrprobe_strategies.active import Active
from lwrprobe_strategies.grid_version import GridVersion
from lwrprobe_strategies.orientation_change import OrientationChange
from lwrprobe_strategies.skills.presses import PRESSED, PRESSES
from lwrprobe_strategies.surface_contour import SurfaceContour
from strategy_task import task

AREA = Area(np.array([-0.05, -0.045, 0.006]), np.array([0.05, 0.045, 0.06]))
TASK = replace(task(approach=0.03, area=AREA), free_speed=0.2, start=np.array([0.0, -0.045, 0.06]))


def begin(distance, seconds=12.0, kind=Active):
    """The places (n, 3) m of the first contacts, the force along the stick with each, and the surface."""
    strategy, surface = kind(), FakeSurface(distance, TASK, TASK.start, stiffness=2000.0)
    strategy.start(TASK)
    seen, places, forces = surface.look(), [], []
    while seen.time < seconds:
        seen = surface.obey(strategy.step(seen))
        if seen.contact is not None:
            places.append(seen.pose[:3, 3].copy())
            forces.append(float(seen.force[2]))
    return np.array(places), np.array(forces), surface


def presses(forces):
    high = forces > 0.95 * PRESSED * TASK.force_target
    return np.count_nonzero(np.diff(high.astype(int)) == 1)


def test_it_comes_down_in_the_middle_presses_and_goes_outwards():
    places, forces, surface = begin(box((0.03, 0.02), 0.045))
    assert places[0] == pytest.approx([0.0, 0.0, 0.05], abs=1e-3)
    assert presses(forces) == PRESSES
    assert places[-1, 1] > 0.018
    assert np.abs(places[:, 0]).max() < 1e-3
    assert surface.peak <= TASK.force_limit


@pytest.mark.parametrize("kind", [GridVersion, SurfaceContour, OrientationChange])
def test_a_raster_presses_where_its_first_line_comes_up_on_the_top_and_never_again(kind):
    places, forces, surface = begin(box((0.03, 0.02), 0.045), 60.0, kind)
    assert presses(forces) == PRESSES
    pressed = places[forces > 0.95 * PRESSED * TASK.force_target]
    assert pressed[:, 1].max() < -0.019, "at the edge that the line comes over"
    assert pressed[:, 2].min() > 0.045
    assert np.ptp(places[:, 0]) > 0.02, "lines beside it were driven meanwhile"
    assert surface.peak <= TASK.force_limit


@pytest.mark.parametrize("kind", [Active, GridVersion])
def test_a_slope_is_not_pressed(kind):
    lean = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    places, forces, _ = begin(lambda p: float((p - [0.0, 0.0, 0.04]) @ lean), 6.0, kind)
    assert len(places) > 100
    assert presses(forces) == 0
