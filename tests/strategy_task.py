"""A task for strategies that are looked at without a robot."""

import numpy as np

from lwrprobe.contracts import Area, Probe, Task

DOWN = np.diag([1.0, -1.0, -1.0])
AREA = Area(np.array([-0.1, -0.1, 0.006]), np.array([0.1, 0.1, 0.06]))


def task(
    approach=1.0,
    stiffness=2e4,
    lateral=1.0 / 2500.0,
    axial=1.0 / 1.3e6,
    links=(),
    area=AREA,
    reachable=lambda poses: True,
    headroom=0.0,
):
    return Task(
        area=area,
        probe=Probe(compliance=np.array([lateral, lateral, axial]), links=links),
        orientation=DOWN,
        start=np.array([0.0, -0.1, 0.06]),
        free_speed=1.0,
        approach_speed=approach,
        contour_speed=0.02,
        acceleration=2.0,
        force_threshold=0.2,
        force_target=0.8,
        force_limit=3.0,
        clearance_threshold=0.003,
        stiffness=stiffness,
        delay=0.015,
        reachable=reachable,
        headroom=headroom,
    )
