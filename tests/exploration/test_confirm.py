"""Confirmed motions: none before a yes, none after a key, and the loop continues meanwhile."""

import os

import numpy as np
import pytest

from lwrprobe.contracts import Done, Goal, SafetyStop, VelocityCommand
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.exploration.safety.confirm import Confirm, TypedLines
from lwrprobe.scene import load_scene


class Operator:
    """Types what is put into `lines`, one a look; None is silence."""

    def __init__(self, *lines):
        self.lines = list(lines)
        self.messages = []

    def typed(self):
        return self.lines.pop(0) if self.lines else None

    def confirm(self, motions):
        return Confirm(motions, self.messages.append, self.typed)


def goal(x):
    pose = np.eye(4)
    pose[0, 3] = x
    return Goal(pose, 0.1)


def test_each_goal_waits_for_its_yes_and_is_asked_for_once():
    operator = Operator(None, None, "", None, None, None, "")
    confirm = operator.confirm(2)
    first, second = goal(0.1), goal(0.2)
    assert [confirm.filter(first) is first for _ in range(4)] == [False, False, True, True]
    assert [confirm.filter(second) is second for _ in range(3)] == [False, False, True]
    assert len(operator.messages) == 2
    assert "x 0.100" in operator.messages[0]
    third = goal(0.3)
    assert confirm.filter(third) is third, "only the first two are asked for"


def test_what_holds_the_tip_does_not_move_it():
    held = Operator().confirm(1).filter(goal(0.1))
    assert isinstance(held, VelocityCommand)
    assert not held.velocity.any()


def test_a_velocity_command_is_one_motion_whatever_its_velocity():
    confirm = Operator("").confirm(1)
    for k in range(5):
        command = VelocityCommand(np.array([0.001 * k, 0.0, 0.0]), reason="contour")
        assert confirm.filter(command) is command


@pytest.mark.parametrize("lines", [("q",), ("", "")])
def test_no_and_a_key_in_motion_end_the_run(lines):
    confirm = Operator(*lines).confirm(3)
    wanted = goal(0.1)
    for _ in lines[1:]:
        assert confirm.filter(wanted) is wanted
    with pytest.raises(SafetyStop, match="the operator"):
        confirm.filter(wanted)


def test_done_is_never_held():
    done = Done("all touched")
    assert Operator().confirm(3).filter(done) is done


@pytest.mark.slow
def test_refused_first_motion_leaves_the_tip_at_its_start(tmp_path):
    operator = Operator(*[None] * 40, "q")
    scene = load_scene("block", ["run.time_limit=30.0", "truth.profile=ideal"])
    summary = explore(scene, tmp_path, confirm=operator.confirm(5))
    assert summary["status"] == "ended early"
    assert "the operator said 'q'" in summary["reason"]
    assert operator.messages
    assert summary["path_length_m"] < 1e-3
    assert summary["contacts"] == 0


def test_typed_lines_come_one_at_a_time_and_the_end_of_input_means_no(monkeypatch):
    reading, writing = os.pipe()
    with os.fdopen(reading) as end:
        monkeypatch.setattr("sys.stdin", end)
        typed = TypedLines()
        assert typed() is None
        os.write(writing, b"\n\nq\nhal")
        assert [typed() for _ in range(4)] == ["", "", "q", None]
        os.write(writing, b"t\n")
        assert typed() == "halt"
        os.close(writing)
        assert typed() == "q"
        assert typed() == "q"
