"""Set points row by row: against a naive twin, to what is due, to what is out of reach, to what must not be sent."""

import numpy as np
import pytest

from lwrprobe.contracts import SteppedArm
from lwrprobe.exploration.loop.joint_space import JointSpaceTip
from lwrprobe.exploration.loop.set_points import MAX_ROWS, SetPoints
from lwrprobe.exploration.loop.simulated_time import SimulatedTime
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.exploration.safety.motion_guard import MotionGuard, MotionStop
from lwrprobe.kinematics import IKSolver, IKStatus
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory
from run_alone import run_alone

pytestmark = pytest.mark.slow

CYCLE = 1e-3
LIMITS = CartesianLimits(0.2, 1.0, 20.0, 1.0, 5.0, 100.0)


class Bench:
    """A generator at the start, its solver and its guard."""

    def __init__(self, make=None, **safety):
        scene = load_scene("empty")
        self.robot = robot_of(scene)
        self.pose, self.q = start_posture(scene, self.robot)
        self.solver = IKSolver(self.robot)
        self.guard = MotionGuard(self.robot, CYCLE, scene.safety.model_copy(update=safety), None)
        if make is None:
            self.tip = CartesianTrajectory(CYCLE, LIMITS)
            self.tip.reset(self.pose)
        else:
            self.tip = make(self.robot, self.solver)
            self.tip.reset(self.q)
        self.points = SetPoints(self.tip, self.solver, self.guard)

    def go(self, displacement, speed=0.1):
        goal = self.pose.copy()
        goal[:3, 3] += displacement
        self.tip.set_goal(goal, speed)

    def one_by_one(self, count):
        """(joints, tip velocity) of each cycle as the generator, the solver and the guard say it in turn."""
        rows, q = [], self.q.copy()
        for _ in range(count):
            self.tip.step()
            out = np.empty_like(q)
            assert self.solver.track(self.tip.pose, q, out) == IKStatus.CONVERGED
            self.guard.clamp(q, out)
            self.guard.check(out)
            self.guard.measured[:] = out
            rows.append(np.r_[out, self.tip.velocity])
            q = out
        return np.array(rows)

    def many_at_once(self, sizes):
        rows, q = [], self.q.copy()
        for size in sizes:
            assert self.points.generate(q, 0, size) == size
            rows.append(np.c_[self.points.rows[:size], self.points.velocities[:size]])
            q = self.points.rows[size - 1].copy()
            self.guard.measured[:] = q
        return np.concatenate(rows)


@pytest.mark.parametrize("speed", [0.02, 0.2])
def test_rows_are_those_of_one_cycle_after_the_other(speed):
    """To a goal and to rest there: acceleration, bend of the plan, end of the plan and rest lie within the rows."""
    naive, ours = Bench(), Bench()
    naive.go((0.004, 0.002, -0.003), speed)
    ours.go((0.004, 0.002, -0.003), speed)
    rng = np.random.default_rng(5)
    sizes = rng.integers(1, MAX_ROWS + 1, 40)
    wanted = naive.one_by_one(sizes.sum())
    assert ours.many_at_once(sizes).tobytes() == wanted.tobytes()
    assert ours.tip.arrived
    assert naive.tip.arrived
    assert ours.guard.peaks == naive.guard.peaks


def test_a_velocity_command_that_nobody_renews_stops_within_the_rows():
    naive, ours = Bench(), Bench()
    for bench in (naive, ours):
        bench.tip.set_velocity(np.array([0.03, -0.01, 0.0]), 0.05)
    sizes = [7, 1, 7, MAX_ROWS, MAX_ROWS, 3, *[MAX_ROWS] * 6]
    wanted = naive.one_by_one(sum(sizes))
    assert ours.many_at_once(sizes).tobytes() == wanted.tobytes()
    assert ours.tip.resting


def test_joints_of_a_generator_in_joint_space_are_passed_through():
    def make(robot, solver):
        return JointSpaceTip(CYCLE, robot, solver, LIMITS)

    naive, ours = Bench(make), Bench(make)
    naive.go((0.01, 0.0, 0.0))
    ours.go((0.01, 0.0, 0.0))
    rows = ours.many_at_once([MAX_ROWS, 5])
    for row in rows:
        naive.tip.step()
        assert (row[:7] == naive.tip.q).all()
        assert (row[7:] == naive.tip.velocity).all()


def test_rows_end_with_the_one_that_is_out_of_reach():
    bench = Bench()
    bench.solver = IKSolver(bench.robot, max_jump=2e-5)  # so fast no joint may go
    bench.points = SetPoints(bench.tip, bench.solver, bench.guard)
    bench.go((0.05, 0.0, 0.0))
    q, laid = bench.q.copy(), MAX_ROWS
    while laid == MAX_ROWS:
        laid = bench.points.generate(q, 0, MAX_ROWS)
        q = bench.points.rows[laid - 1].copy()
        bench.guard.measured[:] = q
    assert bench.points.status == IKStatus.JUMP
    assert bench.points.refusal is None
    # the generator stands at that row, and does not know of it
    assert bench.points.velocities[laid - 1].tolist() == bench.tip.velocity.tolist()
    assert not bench.tip.resting


def test_a_row_that_must_not_be_sent_is_not_among_them():
    bench = Bench(tip_speed=0.01)
    bench.go((0.05, 0.0, 0.0))
    q, laid = bench.q.copy(), MAX_ROWS
    while laid == MAX_ROWS:
        laid = bench.points.generate(q, 0, MAX_ROWS)
        if laid:
            q = bench.points.rows[laid - 1].copy()
            bench.guard.measured[:] = q
    assert isinstance(bench.points.refusal, MotionStop)
    assert "tip would move" in str(bench.points.refusal)
    assert np.linalg.norm(bench.points.velocities[:laid], axis=1).max(initial=0.0) < 0.0101
    assert (bench.guard.sent == q).all()


def test_where_the_joints_are_counts_for_the_first_row():
    bench = Bench()
    bench.many_at_once([MAX_ROWS])
    bench.guard.measured[2] += 1.0
    assert bench.points.generate(bench.guard.sent.copy(), 0, 5) == 0
    assert "joint 3 is 1.000 rad away" in str(bench.points.refusal)
    assert bench.points.generate(bench.guard.sent.copy(), 2, 5) == 5


def test_a_run_in_one_go_and_a_run_cycle_by_cycle_leave_the_same_files(tmp_path, monkeypatch):
    """The same contacts to the last byte, and the same way, states and map."""
    settings = ["run.seed=7", "run.time_limit=20.0", "truth.profile=ideal"]
    at_once = run_alone(load_scene("block", settings), tmp_path / "at once")
    offered = []

    def one_by_one(devices, n):
        offered.append(isinstance(devices.arm, SteppedArm))

    monkeypatch.setattr(SimulatedTime, "of", one_by_one)
    by_cycle = run_alone(load_scene("block", settings), tmp_path / "one by one")
    for run in (at_once, by_cycle):
        run.pipeline.voxels.write(run.out / "map.bt")
    for name in ("contacts.csv", "trace.csv", "states.csv", "map.bt"):
        assert (tmp_path / "at once" / name).read_bytes() == (tmp_path / "one by one" / name).read_bytes(), name
    assert offered == [True]
    assert (tmp_path / "at once" / "contacts.csv").stat().st_size > 1000
