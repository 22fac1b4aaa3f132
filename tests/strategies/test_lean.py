"""Leaning: no further than the body behind the stick needs to stay behind the sphere."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.lean import UP, LeanPlanner, extent, turned
from strategy_task import DOWN, task

PROBE = load_scene("block").probe.as_probe()


def corners(link):
    """Points of a link's surface in the tip's frame: a box's corners, a cylinder's two rims."""
    if link.kind == "box":
        local = np.array(list(itertools.product(*[(-0.5 * e, 0.5 * e) for e in link.size])))
    else:
        turn = np.linspace(0.0, 2.0 * np.pi, 721)
        rim = link.size[0] * np.column_stack([np.cos(turn), np.sin(turn)])
        local = np.vstack([np.column_stack([rim, np.full(len(rim), s * 0.5 * link.size[1])]) for s in (-1.0, 1.0)])
    return local @ link.pose[:3, :3].T + link.pose[:3, 3]


@pytest.mark.parametrize("seed", range(5))
def test_how_far_a_link_reaches(seed):
    random = np.random.default_rng(seed)
    direction = random.normal(size=3)
    direction /= np.linalg.norm(direction)
    axis = np.array([np.cos(seed), np.sin(seed), 0.0])
    rotation = turned(UP, axis, random.uniform(0.0, 0.7)) @ DOWN
    for link in PROBE.links:
        farthest = (corners(link) @ rotation.T @ direction).max()
        assert extent(link, rotation, direction) == pytest.approx(farthest, abs=2e-6)


def leaning(towards, max_deg=40.0, **limits):
    t = replace(task(links=PROBE.links), **limits)
    return LeanPlanner(t, DOWN, np.radians(max_deg)).lean(np.array(towards), [], [np.zeros(3)]), t


@pytest.mark.parametrize("towards", [(0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.6, 0.8, 0.0)])
def test_the_least_lean_that_shelters_the_body_is_taken(towards):
    rotation, t = leaning(towards)
    angle = np.degrees(np.arccos(rotation[:, 2] @ DOWN[:, 2]))
    assert 5.0 < angle < 25.0
    body = [link for link in t.probe.links if link.name != "stick"]

    def foremost(turn):
        return max((corners(link) @ turn.T @ -np.array(towards)).max() for link in body)

    front = t.probe.radius - t.clearance_threshold
    assert foremost(rotation) < front, "behind the sphere, with the clearance between"
    less = turned(UP, np.array(towards), np.radians(angle - 2.5)) @ DOWN
    assert foremost(less) > front - 0.002, "and hardly further than that"


def test_leaning_no_further_than_is_allowed_and_not_where_the_arm_does_not_reach():
    rotation, _ = leaning((0.0, -1.0, 0.0), 6.0)
    assert np.degrees(np.arccos(rotation[:, 2] @ DOWN[:, 2])) == pytest.approx(6.0)
    assert leaning((0.0, -1.0, 0.0), reachable=lambda poses: False)[0] is None
    assert leaning((0.0, 0.0, 0.0))[0] is None
