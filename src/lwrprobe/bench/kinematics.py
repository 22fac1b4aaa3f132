"""Kinematics side by side with every installed peer, on the LWR 4+ with a tool of 0.25 m.

Poses come from joint values drawn evenly within the limits, so that each has a solution. A success is an answer within
1e-6 m, 1e-6 rad (by our own forward kinematics) and the joint limits; a jump, a success that moves a joint by more than
0.5 rad from its start; a false success, an answer that a library calls a solution and that misses.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from lwrprobe.bench.kinematics_peers import Array, Peer, Solve, installed_peers, lwrprobe_peer
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport
from lwrprobe.bench.timing import first_use, interleave, load_before, take_turns
from lwrprobe.contracts import InputError
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.kinematics import IKSolver, IKStatus, Robot, chain_kernels, lwr4

TOLERANCE = 1e-6
JUMP = 0.5
NEAR = 0.05
BEYOND = 0.05
BLOCK = 50
ROUNDS = 7


Key = TypeVar("Key")


@dataclass(slots=True)
class Outcome:
    """What one solver made of a set of targets, one row a target.

    `seconds` are those of one call. `work` is the median over several rounds, in each of which every target is asked
    once: what the target costs, without the pauses of the machine that hit one call or another.
    """

    seconds: Array
    work: Array
    answered: Array
    success: Array
    jump: Array
    residual: Array

    @classmethod
    def empty(cls, count: int) -> Outcome:
        """Of so many targets, to be filled in."""
        answered, success, jump = np.zeros((3, count), bool)
        return cls(np.empty(count), np.empty(count), answered, success, jump, np.empty(count))

    @property
    def false(self) -> Array:
        """Answers called a solution that are none."""
        return self.answered & ~self.success

    def row(self) -> list[float]:
        """Median, p99 and p99 of the work in us, then per cent of successes, jumps and false successes."""
        shares = (100.0 * share.mean() for share in (self.success, self.jump, self.false))
        slow = [1e6 * np.quantile(seconds, 0.99) for seconds in (self.seconds, self.work)]
        return [1e6 * np.median(self.seconds), *slow, *shares]


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench kinematics`; options `targets`: poses for every solver, `cold`: poses for lwrprobe alone."""
    asked = Options("kinematics", options, "targets", "cold")
    count, cold = asked.count("targets", 200 if quick else 2000), asked.count("cold", 5000 if quick else 100_000)
    robot = lwr4(tool=_shift(0.25))
    peers, missing = installed_peers(robot)
    peers.insert(0, lwrprobe_peer(robot))
    report = BenchReport("kinematics", "Kinematics against the best peers (LWR 4+, tool 0.25 m)", notes=missing)
    report.machine = machine() | load_before() | versions("lwrprobe", "numba", *sorted({p.package for p in peers}))
    with _silence():
        _forward(report, robot, peers, quick)
        _solving(report, robot, peers, count, cold, 3 if quick else ROUNDS)
        _hard_cases(report, robot, peers, 25 if quick else 200)
        _out_of_reach(report, robot, peers, min(count, 300))
        _invalid(report, robot, peers)
        _work_precision(report, robot, peers, 40 if quick else 300)
    if not quick:
        _compile_time(report)
    return report


@contextmanager
def _silence() -> Iterator[None]:
    """Some peers write to the terminal from compiled code at every failure."""
    kept = [os.dup(1), os.dup(2)]
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 1), os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept[0], 1), os.dup2(kept[1], 2)
        for descriptor in (*kept, sink):
            os.close(descriptor)


def _forward(report: BenchReport, robot: Robot, peers: list[Peer], quick: bool) -> None:
    rounds, rng = (30 if quick else 200), np.random.default_rng(1)
    qs = rng.uniform(robot.lower, robot.upper, (10_000, robot.n))
    tip, jac = np.empty((4, 4)), np.empty((6, robot.n))
    forward = _per_call({p.name: (p.forward, tip) for p in peers if p.forward}, qs, rounds)
    jacobian = _per_call({p.name: (p.jacobian, jac) for p in peers if p.jacobian}, qs, rounds)
    many = {p.name: (lambda call=p.batch: call(qs)) for p in peers if p.batch}
    batch = {name: np.median(s) / len(qs) for name, s in interleave(many, max(rounds // 10, 5)).items()}
    compiled = _compiled(robot, qs, max(rounds // 10, 5))
    rows = []
    for peer in peers:
        times = [table.get(peer.name) for table in (forward, jacobian, batch)]
        if any(times):
            in_njit = 1e6 * compiled if peer.name == "lwrprobe" else None
            rows.append([peer.name, *(None if t is None else 1e6 * t for t in times), in_njit])
    columns = ["library", "tip [us]", "Jacobian [us]", "tip in a batch of 10 000 [us]", "tip, called in njit [us]"]
    report.table("Forward kinematics and Jacobian, one call from Python into a buffer", columns, rows)
    own, rival, toolbox = "lwrprobe", "pin", "rtb LM chan"
    for what, table in (("tip", forward), ("Jacobian", jacobian)):
        if rival in table:
            text = f"{1e6 * table[own]:.3g} us against {1e6 * table[rival]:.3g} us"
            report.require(f"one {what} not slower than pin's", text, table[own] <= table[rival])
    report.require("a tip in njit <= 0.2 us", f"{1e6 * compiled:.3g} us", compiled <= 0.2e-6)
    if toolbox in batch:
        lead, text = batch[toolbox] / batch[own], f"{1e6 * batch[own]:.3g} us"
        held = batch[own] <= 0.25e-6 and lead >= 5.0
        report.require("a batch <= 0.25 us, 5 times ahead of rtb", f"{text}, {lead:.3g} times", held)


def _per_call(calls: dict[str, tuple[Callable, Array]], qs: Array, rounds: int) -> dict[str, float]:
    """Median seconds of one call; calls are timed in blocks, since the clock itself takes as long as the fastest."""

    def block(call: Callable, out: Array) -> Callable[[], None]:
        def repeat() -> None:
            for q in qs[:BLOCK]:
                call(q, out)

        return repeat

    timed = interleave({name: block(*pair) for name, pair in calls.items()}, rounds)
    return {name: float(np.median(seconds)) / BLOCK for name, seconds in timed.items()}


def _compiled(robot: Robot, qs: Array, rounds: int) -> float:
    """Median seconds of one tip where compiled code asks for one after another."""
    tips = np.empty((len(qs), 4, 4))
    timed = interleave({"tips": lambda: chain_kernels.forward_batch(robot.chain, qs, tips)}, rounds)["tips"]
    return float(np.median(timed)) / len(qs)


def _solving(report: BenchReport, robot: Robot, peers: list[Peer], count: int, cold: int, rounds: int) -> None:
    qs, poses = _targets(robot, count, 2)
    rng = np.random.default_rng(3)
    near = np.clip(qs + rng.uniform(-NEAR, NEAR, qs.shape), robot.lower, robot.upper)
    anywhere = rng.uniform(robot.lower, robot.upper, qs.shape)
    columns = ["library", "median [us]", "p99 [us]", "p99 of work [us]"]
    columns += ["success [%]", "jumps [%]", "false successes [%]"]
    tracked = _outcomes(robot, {p.name: p.track for p in peers if p.track}, poses, near, rounds)
    rows = [[name, *outcome.row()] for name, outcome in tracked.items()]
    report.table(f"Tracking: {count} poses, starts within {NEAR} rad", columns, rows)
    started = _outcomes(robot, {p.name: p.cold for p in peers if p.cold}, poses, anywhere, rounds)
    rows = [[name, *outcome.row()] for name, outcome in started.items()]
    report.table(f"Cold starts: {count} poses, random starts", columns, rows)
    report.notes.append(
        f"p99 is over single calls, which the machine's own pauses (interrupts, another process on the core) hit at "
        f"random. p99 of work is over the targets, each the median of {rounds} rounds through all of them: the slowest "
        "targets, without the pauses; for every library alike. The garbage collector rests meanwhile."
    )
    _solving_verdicts(report, tracked, started, count)
    _many(report, robot, cold)


def _solving_verdicts(
    report: BenchReport, tracked: dict[str, Outcome], started: dict[str, Outcome], count: int
) -> None:
    for what, table, limits, factor in (("tracking", tracked, (6, 15), 4.0), ("a cold start", started, (5, 30), 10.0)):
        median, p99, work, success, jumps, false = table["lwrprobe"].row()
        requirement = f"{what}: median <= {limits[0]} us, p99 of work <= {limits[1]} us"
        measured = f"{median:.3g} us, {work:.3g} us (single calls {p99:.3g} us)"
        report.require(requirement, measured, median <= limits[0] and work <= limits[1])
        done = f"{success:.4g} %, {false:.4g} %"
        report.require(f"{what}: 100 % of {count}, 0 false", done, success == 100.0 and false == 0.0)
        if what == "tracking":
            report.require(f"{what}: no jump", f"{jumps:.4g} %", jumps == 0.0)
        whole = {name: o.row()[0] for name, o in table.items() if name != "lwrprobe" and o.success.all()}
        if whole:
            best = min(whole, key=whole.__getitem__)
            lead = whole[best] / median
            requirement = f"{what}: {factor:g} times faster than the best peer that solves all"
            report.require(requirement, f"{lead:.3g} times ({best})", lead >= factor)


def _many(report: BenchReport, robot: Robot, count: int) -> None:
    qs, poses = _targets(robot, count, 4)
    seeds = np.random.default_rng(5).uniform(robot.lower, robot.upper, qs.shape)
    cold = lwrprobe_peer(robot).cold
    assert cold is not None, "lwrprobe solves from a cold start"
    outcome = _outcomes(robot, {"lwrprobe": cold}, poses, seeds)["lwrprobe"]
    failed, false = int((~outcome.success).sum()), int(outcome.false.sum())
    requirement = f"cold starts: all of {count} random poses, no false success"
    report.require(requirement, f"{failed} failed, {false} false", failed == false == 0)
    worst = 1e6 * outcome.seconds.max()
    report.notes.append(f"slowest of {count} cold starts: {worst:.4g} us (the machine's own pauses included)")


def _targets(robot: Robot, count: int, seed: int) -> tuple[Array, Array]:
    qs = np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, robot.n))
    return qs, robot.fk_batch(qs)


def _outcomes(
    robot: Robot, solvers: dict[Key, Solve], poses: Array, seeds: Array, rounds: int = 1
) -> dict[Key, Outcome]:
    """What the solvers made of the poses, taking turns; the answers of the first round are rated."""
    outcomes = {name: Outcome.empty(len(poses)) for name in solvers}

    def check(name: Key, k: int, q: Any) -> None:
        _rate(robot, outcomes[name], k, q, poses[k], seeds[k])

    careful = {name: _none_for_errors(solve) for name, solve in solvers.items()}
    seconds = take_turns(careful, list(zip(poses, seeds)), BLOCK, rounds, check)
    for name, outcome in outcomes.items():
        outcome.seconds[:], outcome.work[:] = seconds[name][0], np.median(seconds[name], axis=0)
    return outcomes


def _none_for_errors(solve: Solve) -> Solve:
    def answer(pose: Array, seed: Array) -> Array | None:
        try:
            return solve(pose, seed)
        except Exception:
            return None

    return answer


def _rate(robot: Robot, outcome: Outcome, k: int, q: Array | None, pose: Array, seed: Array) -> None:
    outcome.residual[k] = np.nan
    if q is None or len(q) != robot.n or not np.isfinite(q).all():
        return
    q = np.ascontiguousarray(q, dtype=float)
    position, rotation = _errors(robot, q, pose)
    outcome.answered[k] = True
    outcome.residual[k] = max(position, rotation)
    outcome.success[k] = max(position, rotation) <= TOLERANCE and robot.within_limits(q, 1e-9)
    outcome.jump[k] = outcome.success[k] and np.abs(q - seed).max() > JUMP


def _errors(robot: Robot, q: Array, pose: Array) -> tuple[float, float]:
    tip = np.empty((4, 4))
    robot.fk_into(q, tip)
    # rounding of the rotation itself is 1e-15, so that the small angle is the Frobenius distance over sqrt(2)
    return float(np.linalg.norm(tip[:3, 3] - pose[:3, 3])), float(np.linalg.norm((tip - pose)[:3, :3]) / np.sqrt(2.0))


def hard_cases(robot: Robot, count: int, seed: int) -> dict[str, Array]:
    """(count, n) joint values each, at and around the singularities and limits of a seven-joint arm."""
    rng = np.random.default_rng(seed)

    def fixed(**joints: Any) -> Array:
        qs = rng.uniform(robot.lower, robot.upper, (count, robot.n))
        for name, value in joints.items():
            qs[:, int(name[1]) - 1] = value
        return qs

    one = fixed()
    joint = rng.integers(0, robot.n, count)
    one[np.arange(count), joint] = np.where(rng.random(count) < 0.5, robot.lower[joint], robot.upper[joint])
    return {
        "q4 = 0": fixed(q4=0.0),
        "q4 = 1e-6": fixed(q4=1e-6),
        "q6 = 0": fixed(q6=0.0),
        "q2 = 0": fixed(q2=0.0),
        "q2 = q4 = q6 = 0": fixed(q2=0.0, q4=0.0, q6=0.0),
        "q3 = +-90 deg, q6 = 0": fixed(q3=rng.choice([-0.5, 0.5], count) * np.pi, q6=0.0),
        "one joint at its limit": one,
        "all joints at limits": np.where(rng.random((count, robot.n)) < 0.5, robot.lower, robot.upper),
    }


def _hard_cases(report: BenchReport, robot: Robot, peers: list[Peer], count: int) -> None:
    rng = np.random.default_rng(6)
    trackers = {p.name: p.track for p in peers if p.track}
    starters = {p.name: p.cold for p in peers if p.cold}
    rows, kept = [], True
    for case, qs in hard_cases(robot, count, 7).items():
        poses = robot.fk_batch(qs)
        near = np.clip(qs + rng.uniform(-NEAR, NEAR, qs.shape), robot.lower, robot.upper)
        anywhere = rng.uniform(robot.lower, robot.upper, qs.shape)
        for start, solvers, seeds in (("near", trackers, near), ("random", starters, anywhere)):
            outcomes = _outcomes(robot, solvers, poses, seeds)
            rows.append([case, start, *(100.0 * o.success.mean() for o in outcomes.values())])
            kept = kept and bool(outcomes["lwrprobe"].success.all())
    title = f"Hard cases, success in % of {count} poses each"
    report.table(title, ["case", "start", *trackers], rows)
    report.require("100 % in every hard case, near and random", "100 %" if kept else "less", kept)


def _out_of_reach(report: BenchReport, robot: Robot, peers: list[Peer], count: int) -> None:
    """Poses of the straight arm, moved outward by BEYOND along the line from shoulder to wrist."""
    qs, _ = _targets(robot, count, 8)
    qs[:, 3] = 0.0
    nearest = robot.fk_batch(qs)
    poses = nearest.copy()
    for k, q in enumerate(qs):
        wrist = robot.link_frames(q)[-1][:3, 3]
        poses[k, :3, 3] += BEYOND * wrist / np.linalg.norm(wrist)
    seeds = np.random.default_rng(9).uniform(robot.lower, robot.upper, qs.shape)
    rows = []
    for peer in peers:
        if peer.cold and peer.name != "lwrprobe":
            outcome = _outcomes(robot, {peer.name: peer.cold}, poses[:20], seeds)[peer.name]
            called = "called a solution" if outcome.answered.any() else "nothing"
            rows.append([peer.name, 1e6 * np.median(outcome.seconds), called, None])
    own, miss, verdict = _own_out_of_reach(robot, poses, seeds, nearest)
    rows.insert(0, ["lwrprobe", own, f"{verdict} and the nearest pose", miss])
    columns = ["library", "median [us]", "answer", "error of the nearest pose [m]"]
    report.table(f"Targets {BEYOND} m out of reach", columns, rows)
    held = own <= 20.0 and miss <= 1e-6 and verdict == "UNREACHABLE"
    requirement = "out of reach: <= 20 us, UNREACHABLE, nearest pose to 1e-6 m"
    report.require(requirement, f"{own:.3g} us, {verdict}, {miss:.2g} m", held)


def _own_out_of_reach(robot: Robot, poses: Array, seeds: Array, nearest: Array) -> tuple[float, float, str]:
    """Median us, largest error of the nearest pose and of the distance short, and the status they all have."""
    solver, q = IKSolver(robot), np.empty(robot.n)
    seconds, misses, verdict = [], [], set()
    solver.reach(poses[0], seeds[0], q)
    for pose, seed, best in zip(poses, seeds, nearest):
        begin = time.perf_counter()
        status = solver.reach(pose, seed, q)
        seconds.append(time.perf_counter() - begin)
        verdict.add(IKStatus(status).name)
        short = _errors(robot, q, pose)[0]
        misses.append(max(*_errors(robot, q, best), abs(short - BEYOND)))
    return 1e6 * float(np.median(seconds)), float(max(misses)), " or ".join(sorted(verdict))


def _invalid(report: BenchReport, robot: Robot, peers: list[Peer]) -> None:
    q = 0.5 * robot.upper
    pose = robot.fk(q).A
    broken = {name: pose.copy() for name in ("NaN", "infinite", "scaled rotation", "left-handed rotation")}
    broken["NaN"][0, 0] = np.nan
    broken["infinite"][0, 3] = np.inf
    broken["scaled rotation"][:3, :3] *= 1.1
    broken["left-handed rotation"][:3, 0] *= -1.0
    solver = IKSolver(robot)
    rows = [["lwrprobe", *(_reaction(lambda p, s: solver.solve(p, s).q, p, q) for p in broken.values())]]
    rows[0].append(_reaction(lambda p, s: solver.solve(p, s).q, pose, q[:-1]))
    for peer in peers:
        if peer.cold and peer.name != "lwrprobe" and "default" not in peer.name:
            reactions = [_reaction(peer.cold, p, q) for p in broken.values()]
            rows.append([peer.name, *reactions, _reaction(peer.cold, pose, q[:-1])])
    report.table("Invalid input", ["library", *broken, "seed too short"], rows)
    typed = all(cell.startswith("InputError") for cell in rows[0][1:])
    report.require("invalid input: one typed error", "in every case" if typed else "no", typed)


def _reaction(solve: Solve, pose: Array, seed: Array) -> str:
    try:
        q = solve(pose, seed)
    except InputError as error:
        return f"InputError: {error.field}"
    except BaseException as error:
        return type(error).__name__
    if q is None:
        return "no answer"
    return "success reported" if np.isfinite(q).all() else "NaN out"


def _work_precision(report: BenchReport, robot: Robot, peers: list[Peer], count: int) -> None:
    qs, poses = _targets(robot, count, 10)
    seeds = np.clip(qs + np.random.default_rng(11).uniform(-NEAR, NEAR, qs.shape), robot.lower, robot.upper)
    solvers = {(p.name, s): p.knob(s) for p in peers if p.knob for s in p.settings}
    outcomes = _outcomes(robot, solvers, poses, seeds)
    curves: dict[str, list[list[float]]] = {}
    for (name, setting), outcome in outcomes.items():
        if outcome.answered.any():
            found = outcome.residual[outcome.answered]
            point = [setting, 1e6 * np.median(outcome.seconds), np.median(found), found.max(), outcome.answered.mean()]
            curves.setdefault(name, []).append([float(x) for x in point])
    report.data["work_precision"] = curves
    report.data["work_precision_columns"] = ["setting", "median us", "median residual", "largest residual", "answered"]
    report.figures["work-precision"] = lambda figure: _draw(figure, curves)


def _draw(figure: Any, curves: dict[str, list[list[float]]]) -> None:
    left, right = figure.subplots(1, 2, sharey=True, sharex=True)
    for axes, column, title in ((left, 2, "median residual"), (right, 3, "largest residual")):
        for name, points in curves.items():
            xy = np.array(points)
            style = {"lw": 2.5, "color": "black", "zorder": 3} if name == "lwrprobe" else {"lw": 1.2}
            axes.plot(xy[:, 1], np.maximum(xy[:, column], 1e-17), "o-", ms=4, label=name, **style)
        axes.axhline(TOLERANCE, color="0.6", lw=0.8, ls="--")
        axes.set(xscale="log", yscale="log", xlabel="run time, median [us]", title=title)
        axes.grid(alpha=0.3)
    left.set_ylabel("residual of what is called a solution [m, rad]")
    right.legend(fontsize=8)
    figure.suptitle("IK while tracking: error against run time, each solver over its own settings")


def _compile_time(report: BenchReport) -> None:
    rows = first_use("kinematics")
    (_, cold, _), (_, warm, _) = rows
    report.table("First use of all kinematics kernels in a fresh process", ["", "wall [s]", "CPU [s]"], rows)
    report.require("cold compilation < 15 s", f"{cold:.3g} s", cold < 15.0)
    report.require("filled cache < 0.5 s", f"{warm:.3g} s", warm < 0.5)


def _shift(z: float) -> Array:
    out = np.eye(4)
    out[2, 3] = z
    return out
