"""Trajectories: time of a step and of a re-plan beside bare Ruckig, and what is held at every tick.

Bare Ruckig is used the way its documentation shows: `update` and `pass_to_input` once a cycle, a new
`target_position` for a new goal, 7 joints. Limits are compared with norms of the Cartesian vectors and with each
joint's value, jerks are differences of the accelerations of successive ticks.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol

import numpy as np
import ruckig

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport
from lwrprobe.bench.timing import first_use, load_before
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.kinematics import IKSolver, lwr4
from lwrprobe.trajectory import (
    CartesianLimits,
    CartesianTrajectory,
    JointTrajectory,
    SpeedGovernor,
    TrajectoryStatus,
    bow,
)

LIMITS = CartesianLimits(0.25, 2.0, 40.0, 1.0, 5.0, 100.0)
FAST_TURN = CartesianLimits(0.25, 2.0, 40.0, 1.5, 10.0, 200.0)
ACCELERATION, JERK = 5.0, 100.0
"""1/s and 1/s^2: of each joint, times its speed limit."""
STEPS = 50
"""Steps timed together, so that the clock does not weigh."""
TOLERANCE = 1e-9
"""Share of a limit that rounding may add."""
NAMES = ("speed", "acceleration", "turn rate", "turn acceleration", "jerk", "turn jerk")


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench trajectory`; options `replans`, goals near and at the goal before, and `seed`."""
    asked = Options("trajectory", options, "replans", "seed")
    replans, rng = asked.count("replans", 10_000 if quick else 100_000), np.random.default_rng(asked.count("seed", 7))
    report = BenchReport("trajectory", "Trajectories: held limits, and time beside bare Ruckig")
    report.machine = machine() | load_before() | versions("ruckig", "numpy", "numba")
    _times(report, rng, 300 if quick else 3000)
    _around_goals(report, rng, replans)
    _cycles(report, rng, 20 if quick else 200)
    _ends(report, rng, 2000 if quick else 20_000)
    _corners(report)
    _governed(report, rng, 5 if quick else 40)
    _bows(report, rng, 100 if quick else 1000)
    if not quick:
        _first_use(report)
    return report


class Generator(Protocol):
    """What is timed: one step of a trajectory."""

    def step(self) -> object: ...


class BareRuckig:
    """Ruckig's own online loop for the joints of the LWR 4+."""

    def __init__(self, cycle: float = 1e-3) -> None:
        self.otg, self.given, self.out = ruckig.Ruckig(7, cycle), _joint_limits(), ruckig.OutputParameter(7)

    def set_goal(self, q: np.ndarray) -> None:
        self.given.target_position = q.tolist()

    def step(self) -> list[float]:
        self.otg.update(self.given, self.out)
        self.out.pass_to_input(self.given)
        return self.out.new_position


def _joint_limits() -> ruckig.InputParameter:
    given, speed = ruckig.InputParameter(7), lwr4().speed
    given.max_velocity = speed.tolist()
    given.max_acceleration, given.max_jerk = (ACCELERATION * speed).tolist(), (JERK * speed).tolist()
    return given


def _arm(cycle: float = 1e-3) -> JointTrajectory:
    robot = lwr4()
    return JointTrajectory(cycle, robot.lower, robot.upper, robot.speed, ACCELERATION * robot.speed, JERK * robot.speed)


def _pose(x: np.ndarray, turn: np.ndarray | None = None) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, 3] = x
    if turn is not None:
        pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    return pose


# Time


def _times(report: BenchReport, rng: np.random.Generator, rounds: int) -> None:
    robot = lwr4()
    goals = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper, (64, 7))
    bare, arm, tip = BareRuckig(), _arm(), CartesianTrajectory(1e-3, LIMITS)
    gc.disable()
    try:
        steps = _step_times(bare, arm, tip, goals, rounds)
        plans = _plan_times(bare, arm, goals, rounds)
    finally:
        gc.enable()
    rows = []
    for kind, seconds in (("step", steps), ("re-plan and step", plans)):
        base = np.median(seconds["bare Ruckig, 7 joints"])
        for name, s in seconds.items():
            median = float(np.median(s))
            rows.append([kind, name, 1e6 * median, 1e6 * float(np.quantile(s, 0.99)), median / base])
    columns = ["what", "generator", "median [us]", "p99 [us]", "times bare Ruckig"]
    report.table("Time of one call from Python", columns, rows)
    for kind, seconds, largest in (("step", steps, 3e-6), ("re-plan", plans, 25e-6)):
        slowest = max(float(np.median(s)) for name, s in seconds.items() if "bare" not in name)
        text = f"{1e6 * slowest:.3g} us, the slowest of lwrprobe"
        report.require(f"guarded {kind} <= {1e6 * largest:.0f} us", text, slowest <= largest)
    report.notes.append(
        f"A step of bare Ruckig is `update` with `pass_to_input`; steps are timed {STEPS} at a time, a re-plan "
        "together with the step that follows, since bare Ruckig plans in it. lwrprobe checks the goal, plans, reads "
        "the plan out and checks it against limits and target."
    )


def _step_times(
    bare: BareRuckig, arm: JointTrajectory, tip: CartesianTrajectory, goals: np.ndarray, rounds: int
) -> dict[str, np.ndarray]:
    far = (_pose(np.array((0.4, 0.1, -0.2)), np.array((0.3, 0.2, -0.4))), _pose(np.zeros(3)))
    renewals: dict[str, tuple[Generator, Callable[[int], object]]] = {
        "bare Ruckig, 7 joints": (bare, lambda n: bare.set_goal(goals[n % 64])),
        "JointTrajectory, 7 joints": (arm, lambda n: arm.set_goal(goals[n % 64])),
        "CartesianTrajectory": (tip, lambda n: tip.set_goal(far[n % 2], 0.25)),
    }
    seconds = {name: np.empty(rounds) for name in renewals}
    for n in range(rounds):
        for name, (generator, renew) in renewals.items():
            if n % 5 == 0:
                renew(n // 5)
                generator.step()  # bare Ruckig plans here, and is not timed
            seconds[name][n] = _taken(generator, STEPS) / STEPS
    return seconds


def _taken(generator: Generator, steps: int, renew: Callable[[], object] = lambda: None) -> float:
    """s of so many steps, after a renewal."""
    begin = time.perf_counter()
    renew()
    for _ in range(steps):
        generator.step()
    return time.perf_counter() - begin


def _plan_times(bare: BareRuckig, arm: JointTrajectory, goals: np.ndarray, rounds: int) -> dict[str, np.ndarray]:
    straight, bent, commanded = (CartesianTrajectory(1e-3, LIMITS) for _ in range(3))
    speeds = (0.25, 0.2)

    def go_straight(n: int) -> None:
        if straight.arrived:
            straight.reset(np.eye(4))
        straight.set_goal(_FAR, speeds[n % 2])

    def turn(n: int) -> None:
        bent.set_goal(_WAYS[n % len(_WAYS)], 0.25)

    def command(n: int) -> None:
        commanded.set_velocity(np.array((0.05, 0.02 * np.sin(0.01 * n), 0.02 * np.cos(0.01 * n))), 0.05)

    candidates: dict[str, tuple[Generator, Callable[[int], object]]] = {
        "bare Ruckig, 7 joints": (bare, lambda n: bare.set_goal(goals[n % 64])),
        "JointTrajectory, 7 joints": (arm, lambda n: arm.set_goal(goals[n % 64])),
        "CartesianTrajectory, straight": (straight, go_straight),
        "CartesianTrajectory, goal turns": (bent, turn),
        "CartesianTrajectory, velocity turns": (commanded, command),
    }
    seconds = {name: np.empty(rounds) for name in candidates}
    for n in range(rounds):
        for name, (generator, renew) in candidates.items():
            seconds[name][n] = _taken(generator, 1, partial(renew, n))
            _taken(generator, 20)
    return seconds


_FAR = _pose(np.array((3.0, 1.0, -0.5)), np.array((0.3, 0.2, -0.4)))
_WAYS = [
    _pose(0.5 * np.array((np.cos(a), np.sin(a), 0.2)), np.array((0.3 * np.cos(a), 0.2, 0.3 * np.sin(a))))
    for a in np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
]


# What is held


class Watch:
    """Steps a Cartesian generator and keeps the largest share of each limit (on norms) that was used."""

    def __init__(self, tip: CartesianTrajectory) -> None:
        limits = tip.limits
        self.tip = tip
        motion_limits = limits.speed, limits.acceleration, limits.turn_rate, limits.turn_acceleration
        self.allowed = np.array((*motion_limits, limits.jerk, limits.turn_jerk))
        self.worst = np.zeros(6)
        self.over = 0
        self.motion = self.read()

    def read(self) -> np.ndarray:
        tip = self.tip
        return np.array((tip.velocity, tip.acceleration, tip.angular_velocity, tip.angular_acceleration))

    def step(self, elapsed: float | None = None) -> int:
        status = self.tip.step(elapsed)
        motion = self.read()
        jerks = (motion[1::2] - self.motion[1::2]) / (self.tip.cycle if elapsed is None else elapsed)
        used = np.sqrt((np.concatenate((motion, jerks)) ** 2).sum(axis=1)) / self.allowed
        self.over += int((used > 1.0 + TOLERANCE).sum())
        self.worst = np.maximum(self.worst, used)
        self.motion = motion
        return status


def _around_goals(report: BenchReport, rng: np.random.Generator, replans: int) -> None:
    """Goals at a hair's breadth from where the generator is or was going, most of them before it arrives."""
    seed = int(rng.integers(2**31))
    bare = _bare_around_goals(np.random.default_rng(seed), replans // 2)
    joint = _joints_around_goals(np.random.default_rng(seed), replans // 2)
    tip = _tip_around_goals(rng, replans - replans // 2)
    columns = "generator | re-plans | exceptions | plans refused | limit violations | goals missed"
    rows: list[list[Any]] = [["bare Ruckig, 7 joints", *bare]]
    rows += [["JointTrajectory, 7 joints", *joint], ["CartesianTrajectory", *tip]]
    report.table("Re-plans at and around goals", columns, rows)
    own = [joint[k] + tip[k] for k in range(5)]
    text = f"{own[1]} exceptions, {own[3]} violations in {own[0]}"
    requirement = f"0 exceptions and 0 limit violations in {replans} re-plans at and around goals"
    report.require(requirement, text, own[1] == own[3] == 0)
    report.require("every goal that was waited for is met exactly", f"{own[4]} missed", own[4] == 0)
    report.notes.append(
        "Around goals, bare Ruckig is asked at its own last position and, after an exception, started anew at rest; a "
        "goal of its counts as missed when it is more than 1e-9 rad off after 0.4 s, one of JointTrajectory's when it "
        "is not equal then, one of CartesianTrajectory's when it is not equal after twice the time that the path takes "
        "at the speed asked for, and a second."
    )


def _near_goals(rng: np.random.Generator, replans: int) -> Iterator[tuple[bool, np.ndarray, int]]:
    """For each re-plan: whether near the present place or the goal before, by how much, and how many steps to wait."""
    for n in range(replans):
        size = 10.0 ** rng.uniform(-17.0, -2.0)
        yield rng.random() < 0.7, size * rng.normal(size=7), int(rng.integers(0, 8)) if n % 50 else 400


def _joints_around_goals(rng: np.random.Generator, replans: int) -> list[int]:
    robot, arm = lwr4(), _arm()
    allowed = np.stack((robot.speed, ACCELERATION * robot.speed, JERK * robot.speed * arm.cycle)) * (1.0 + TOLERANCE)
    goal = np.zeros(7)
    raised = over = missed = 0
    for here, change, patience in _near_goals(rng, replans):
        goal = np.clip((arm.q if here else goal) + change, robot.lower, robot.upper)
        try:
            arm.set_goal(goal)
            for _ in range(patience):
                before = arm.qdd.copy()
                arm.step()
                over += int((np.abs(np.stack((arm.qd, arm.qdd, arm.qdd - before))) > allowed).sum())
        except Exception:
            raised += 1
        missed += patience == 400 and not np.array_equal(arm.q, goal)
    return [replans, raised, arm.failures, over, missed]


def _bare_around_goals(rng: np.random.Generator, replans: int) -> list[int | None]:
    robot, bare = lwr4(), BareRuckig()
    q, goal = np.zeros(7), np.zeros(7)
    raised = missed = 0
    for here, change, patience in _near_goals(rng, replans):
        goal = np.clip((q if here else goal) + change, robot.lower, robot.upper)
        bare.set_goal(goal)
        for _ in range(max(patience, 1)):
            try:
                q = np.array(bare.step())
            except Exception:
                raised += 1
                bare = BareRuckig()
                bare.given.current_position = q.tolist()
                bare.set_goal(goal)
        missed += patience == 400 and float(np.abs(q - goal).max()) > 1e-9
    return [replans, raised, None, None, missed]


def _tip_around_goals(rng: np.random.Generator, replans: int) -> list[int]:
    watch = Watch(CartesianTrajectory(1e-3, LIMITS))
    tip = watch.tip
    goal, raised, missed = np.eye(4), 0, 0
    for n in range(replans):
        near = tip.pose if rng.random() < 0.7 else goal
        size, angle = 10.0 ** rng.uniform(-17.0, -2.0, 2) * (rng.random(2) < 0.6)
        goal = _pose(np.zeros(3), angle * rng.normal(size=3)) @ near
        goal[:3, 3] = near[:3, 3] + size * rng.normal(size=3)
        waits, hurry, speed = n % 50 == 0, int(rng.integers(0, 8)), float(rng.choice((0.25, 0.05, 0.01)))
        patience = _long_enough(tip, goal, speed) if waits else hurry
        try:
            tip.set_goal(goal, speed)
            for _ in range(patience):
                if tip.arrived:
                    break
                watch.step()
        except Exception:
            raised += 1
        missed += waits and not (tip.arrived and np.abs(tip.pose - goal).max() < 1e-14)
    return [replans, raised, tip.failures, watch.over, missed]


def _long_enough(tip: CartesianTrajectory, goal: np.ndarray, speed: float) -> int:
    """Ticks within which a goal is to be met, from any motion: twice the way, with the way of a full stop, at the speed
    asked for, and a second for turning and for changes of speed. At 0.01 m/s that is several seconds."""
    limits = tip.limits
    to_rest = limits.speed * (limits.speed / limits.acceleration + limits.acceleration / limits.jerk) / 2.0
    distance = float(np.linalg.norm(goal[:3, 3] - tip.pose[:3, 3])) + to_rest
    return int((2.0 * distance / speed + 1.0) / tip.cycle)


def _cycles(report: BenchReport, rng: np.random.Generator, moves: int) -> None:
    """Goals, velocities and stops at random moments, over all cycles; then a last goal."""
    rows, over, missed = [], 0, 0
    for name, cycle in (("0.1 ms", 1e-4), ("1 ms", 1e-3), ("4 ms", 4e-3), ("20 ms", 0.02), ("0.1 .. 20 ms", None)):
        watch = Watch(CartesianTrajectory(cycle or 1e-3, LIMITS))
        for _ in range(moves):
            _random_aim(watch.tip, rng)
            for _ in range(int(rng.exponential(60))):
                watch.step(cycle or 10.0 ** rng.uniform(-4.0, np.log10(0.02)))
        goal = _pose(np.array((0.05, -0.1, 0.02)), np.array((0.2, 0.4, -0.1)))
        watch.tip.set_goal(goal, 0.25)
        ticks = 0
        while not watch.tip.arrived and ticks < 100_000:
            watch.step(cycle or 10.0 ** rng.uniform(-4.0, np.log10(0.02)))
            ticks += 1
        error = float(np.abs(watch.tip.pose - goal).max())
        rows.append([name, *(float(x - 1.0) for x in watch.worst), error])
        over += watch.over
        missed += error > 1e-15
    columns = ["cycle", *NAMES, "error at the end"]
    report.table("Largest use of each limit less 1, goals, velocities and stops at random moments", columns, rows)
    report.require("limits held at every tick, cycle 0.1 to 20 ms and irregular", f"{over} over", over == 0)
    report.require("ends exactly on the goal at every cycle", f"{missed} missed", missed == 0)


def _random_aim(tip: CartesianTrajectory, rng: np.random.Generator) -> None:
    kind = rng.random()
    if kind < 0.3:
        direction = rng.normal(size=3)
        tip.set_velocity(0.25 * rng.random() * direction / np.linalg.norm(direction), rng.uniform(1e-3, 0.2))
    elif kind < 0.4:
        tip.stop()
    else:
        tip.set_goal(_pose(rng.uniform(-0.15, 0.15, 3), rng.normal(size=3)), float(rng.choice((0.25, 0.1))))


def _ends(report: BenchReport, rng: np.random.Generator, count: int) -> None:
    """Where a plan ends, bare and guarded, against the time of planning it: from motion, all joints in time."""
    robot = lwr4()
    given, trajectory, otg = _joint_limits(), ruckig.Trajectory(7), ruckig.Ruckig(7)
    arm = _arm()
    errors, seconds = np.empty((2, count)), np.empty((2, count))
    for n in range(count):
        q, goal = rng.uniform(0.4 * robot.lower, 0.4 * robot.upper, (2, 7))
        qd = rng.uniform(-0.3, 0.3, 7) * robot.speed
        given.current_position, given.current_velocity, given.target_position = q.tolist(), qd.tolist(), goal.tolist()
        begin = time.perf_counter()
        otg.calculate(given, trajectory)
        seconds[0, n] = time.perf_counter() - begin
        errors[0, n] = max(abs(_end_of(*p) - x) for *p, x in zip(trajectory.profiles[0], qd, goal - q))
        arm.reset(q, qd)
        begin = time.perf_counter()
        arm.set_goal(goal)
        seconds[1, n] = time.perf_counter() - begin
        errors[1, n] = _last_gap(arm, goal)
    rows = [
        [name, 1e6 * float(np.median(s)), float(np.median(e)), float(np.quantile(e, 0.99)), float(e.max())]
        for name, s, e in zip(("bare Ruckig", "JointTrajectory"), seconds, errors)
    ]
    columns = ["generator", "plan [us]", "median [rad]", "p99 [rad]", "largest [rad]"]
    report.table("Distance between a plan's end and its goal, 7 joints from motion", columns, rows)
    worst = errors[1].max()
    requirement = "plans end within 1e-11 rad of the goal before they are snapped to it"
    report.require(requirement, f"{worst:.2g} rad", worst <= 1e-11)

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        for name, s, e, mark in zip(("bare Ruckig", "JointTrajectory (guarded)"), seconds, errors, ".x"):
            axes.loglog(1e6 * s[:3000], np.maximum(e[:3000], 1e-17), mark, ms=4, alpha=0.4, label=name)
        axes.set(xlabel="time of planning [us]", ylabel="end of the plan beside its goal [rad]")
        axes.set_title("Error against run time: 7 joints from motion, ending together")
        axes.grid(True, which="major", alpha=0.3)
        axes.legend()

    report.figures["work"] = draw


def _end_of(profile: Any, velocity: float) -> float:
    """Position at the end of a Ruckig profile, integrated piece by piece from a start at 0 without acceleration."""
    x, v, a = 0.0, velocity, 0.0
    for h, j in zip(profile.brake.t + profile.t, profile.brake.j + profile.j):
        x += h * (v + h * (a / 2.0 + h * j / 6.0))
        v += h * (a + h * j / 2.0)
        a += h * j
    return x


def _last_gap(arm: JointTrajectory, goal: np.ndarray) -> float:
    """Distance from the goal a microsecond before the end; the plan itself covers 1e-16 rad in that time."""
    arm.step(arm.remaining - 1e-6)
    return float(np.abs(goal - arm.q).max())


def _corners(report: BenchReport) -> None:
    """A new goal 0.1 m away, at an angle, in the middle of a move at full speed."""
    rows = []
    for angle in (0, 15, 30, 45, 60, 90, 120, 150, 180):
        through, stopped = _corner(angle, False), _corner(angle, True)
        rows.append([angle, 1e3 * through, 1e3 * stopped, stopped / through])
    columns = ["angle [deg]", "re-planned in motion [ms]", "stop, then go [ms]", "gain"]
    report.table("A corner at 0.25 m/s: time to the new goal", columns, rows)
    held, gains = all(row[1] < row[2] for row in rows), [row[3] for row in rows]
    report.require("a corner is never slower than stop and go", f"gain {max(gains):.2f} .. {min(gains):.2f}", held)


def _corner(angle: float, stop_first: bool) -> float:
    """s until the new goal is met."""
    tip = CartesianTrajectory(1e-3, LIMITS)
    tip.set_goal(_pose(np.array((0.2, 0.0, 0.0))), 0.25)
    while tip.pose[0, 3] < 0.1:
        tip.step()
    corner, ticks = tip.pose[:3, 3].copy(), 0
    if stop_first:
        tip.stop()
        while tip.status != TrajectoryStatus.RESTING:
            tip.step()
            ticks += 1
    displacement = 0.1 * np.array((np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0))
    tip.set_goal(_pose(corner + displacement), 0.25)
    while not tip.arrived:
        tip.step()
        ticks += 1
    return ticks * tip.cycle


def _governed(report: BenchReport, rng: np.random.Generator, wanted: int) -> None:
    """Straight moves that pass near singularities of the LWR 4+, with and without the speed governor."""
    robot = lwr4()
    cases: list[tuple[float, float, float, float]] = []
    watched: list[np.ndarray] = []
    while len(cases) < wanted:
        q = rng.uniform(0.6 * robot.lower, 0.6 * robot.upper)
        q[5] = rng.uniform(-0.15, 0.15)
        displacement, turn = 0.2 * _direction(rng), 0.3 * rng.normal(size=3)
        free = _follow(q, displacement, turn, False)
        if free is None or free[0] < 1.2:
            continue
        governed = _follow(q, displacement, turn, True)
        if governed is not None:
            cases.append((free[0], governed[0], free[1], governed[1]))
            watched.append(governed[2])
    free, governed, short, long = np.array(cases).T
    cost = np.concatenate(watched)
    rows: list[list[Any]] = [
        ["without", *_spread(free), float(np.median(short)), None],
        ["with", *_spread(governed), float(np.median(long)), 1e6 * float(cost.mean())],
    ]
    columns = ["governor", "joint speed / limit, median", "largest", "duration, median [s]", "cost a cycle [us]"]
    title = f"{wanted} straight moves near singularities that need more than a joint has"
    report.table(title, columns, rows)
    text = f"largest share {governed.max():.3f}, without {free.max():.3g}"
    report.require("governed joints keep their speed limits", text, governed.max() <= 1.0)


def _spread(values: np.ndarray) -> list[float]:
    return [float(np.median(values)), float(values.max())]


def _direction(rng: np.random.Generator) -> np.ndarray:
    displacement = rng.normal(size=3)
    return displacement / np.linalg.norm(displacement)


def _follow(
    q: np.ndarray, displacement: np.ndarray, turn: np.ndarray, governed: bool
) -> tuple[float, float, np.ndarray] | None:
    """(largest joint share, duration, seconds of each look) of a move; None where the line leaves the workspace."""
    robot = lwr4()
    solver, tip = IKSolver(robot), CartesianTrajectory(1e-3, FAST_TURN)
    start, out = np.empty((4, 4)), np.empty(7)
    robot.fk_into(q, start)
    tip.reset(start)
    goal = _pose(np.zeros(3), turn) @ start
    goal[:3, 3] = start[:3, 3] + displacement
    governor = SpeedGovernor(tip, solver.track_all, robot.speed)
    tip.set_goal(goal, 0.25)
    largest, ticks, looks, q = 0.0, 0, [], q.copy()
    while not tip.arrived and ticks < 20_000:
        tip.step()
        if solver.track(tip.pose, q, out) != 0:
            return None
        largest = max(largest, robot.speed_use(q, out, tip.cycle))
        q[:] = out
        if governed:
            begin = time.perf_counter()
            governor.watch(q)
            looks.append(time.perf_counter() - begin)
        ticks += 1
    return largest, ticks * tip.cycle, np.array(looks)


def _bows(report: BenchReport, rng: np.random.Generator, count: int) -> None:
    """Joint-space moves between poses that a straight tip move of that length also joins."""
    robot = lwr4()
    solver, start, goal = IKSolver(robot), np.empty((4, 4)), np.empty((4, 4))
    lengths, bows = np.empty(count), np.empty(count)
    n = 0
    while n < count:
        q = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper)
        robot.fk_into(q, start)
        goal[:] = start
        goal[:3, 3] += 10.0 ** rng.uniform(-2.0, -0.3) * _direction(rng)
        end = np.empty(7)
        if solver.track(goal, q, end) == 0:
            found = bow(robot, q, end, samples=51)
            lengths[n], bows[n] = found.length, found.distance
            n += 1
    rows = []
    for low, high in ((0.01, 0.03), (0.03, 0.1), (0.1, 0.2), (0.2, 0.51)):
        some = bows[(lengths >= low) & (lengths < high)]
        if some.size:
            rows.append([f"{1e3 * low:.0f} .. {1e3 * high:.0f}", *(1e3 * value for value in _spread(some))])
    columns = ["length of the move [mm]", "bow, median [mm]", "largest [mm]"]
    report.table("Bow of joint-space moves (same orientation at both ends) on the LWR 4+", columns, rows)
    report.notes.append(
        "A straight Cartesian move has no bow: its path is one axis, to rounding (a test holds 1e-15 m)."
    )


def _first_use(report: BenchReport) -> None:
    title = "First use of all trajectory kernels in a fresh process"
    report.table(title, ["", "wall [s]", "CPU [s]"], first_use("trajectory"))
