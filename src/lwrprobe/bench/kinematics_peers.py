"""The installed kinematics libraries behind one face, each set up as its own documentation has it for speed.

A peer is asked for 1e-6 m and 1e-6 rad unless its name says `default`. What it answers is rated elsewhere.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.kinematics import IKSolver, Robot, to_roboticstoolbox

Array = np.ndarray
Solve = Callable[[Array, Array], Array | None]
"""(pose (4, 4), seed (n,)) -> joint values that the library calls a solution, or None."""


@dataclass(slots=True)
class Peer:
    """One way to ask one library. What it cannot do is None.

    Attributes
    ----------
    package : distribution name
    forward, jacobian : (q, out) -> None
    batch : (qs) -> tips
    track, cold : see `Solve`; from a start nearby, and from anywhere
    knob : setting -> `track` at that setting, for the work-precision figure, over `settings`
    """

    name: str
    package: str
    forward: Callable[[Array, Array], None] | None = None
    jacobian: Callable[[Array, Array], None] | None = None
    batch: Callable[[Array], object] | None = None
    track: Solve | None = None
    cold: Solve | None = None
    knob: Callable[[float], Solve] | None = None
    settings: tuple[float, ...] = field(default=())


def installed_peers(robot: Robot) -> tuple[list[Peer], list[str]]:
    """All that can be imported, and a sentence for each library that cannot."""
    peers, missing = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(urdf_text(robot), encoding="utf-8")
        for make in (_roboticstoolbox, _pinocchio, _ssik, _optik, _eaik, _trac_ik, _mink):
            try:
                peers += make(robot, file)
            except ImportError as error:
                missing.append(f"not installed, so not measured: {error.name or error}")
    return peers, missing


def lwrprobe_peer(robot: Robot) -> Peer:
    """Our own fast paths in the same form."""
    solver, q = IKSolver(robot), np.empty(robot.n)

    def solve(call: Callable[[Array, Array, Array], int]) -> Solve:
        return lambda pose, seed: q if call(pose, seed, q) == 0 else None

    def at(tolerance: float) -> Solve:
        return solve(IKSolver(robot, tolerance=tolerance, rotation_tolerance=tolerance).track)

    return Peer(
        name="lwrprobe",
        package="lwrprobe",
        forward=robot.fk_into,
        jacobian=robot.jacobian_into,
        batch=robot.fk_batch,
        track=solve(solver.track),
        cold=solve(solver.reach),
        knob=at,
        settings=(1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    )


def _roboticstoolbox(robot: Robot, file: Path) -> list[Peer]:
    model = to_roboticstoolbox(robot)
    chain = model.ets()

    def at(tolerance: float) -> Solve:
        def solve(pose: Array, seed: Array) -> Array | None:
            answer = chain.ik_LM(pose, seed, ilimit=30, slimit=100, tol=tolerance, k=1.0, method="chan")
            return answer.q if answer.success else None

        return solve

    def forward(q: Array, out: Array) -> None:
        out[:] = chain.eval(q)

    def jacobian(q: Array, out: Array) -> None:
        out[:] = chain.jacob0(q)

    def slow_forward(q: Array, out: Array) -> None:
        out[:] = model.fkine(q).A

    package = "roboticstoolbox-python"
    exact = at(1e-13)
    settings = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13, 1e-16, 1e-20)
    return [
        Peer("rtb LM chan", package, forward, jacobian, chain.eval, exact, exact, at, settings),
        Peer("rtb default", package, track=at(1e-6), cold=at(1e-6)),
        Peer("rtb DHRobot", package, slow_forward),
    ]


def _pinocchio(robot: Robot, file: Path) -> list[Peer]:
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(file))
    data, tip = model.createData(), model.getFrameId("tip")

    def forward(q: Array, out: Array) -> None:
        pin.forwardKinematics(model, data, q)
        out[:] = pin.updateFramePlacement(model, data, tip).homogeneous

    def jacobian(q: Array, out: Array) -> None:
        out[:] = pin.computeFrameJacobian(model, data, q, tip, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)

    return [Peer("pin", "pin", forward, jacobian)]


def _ssik(robot: Robot, file: Path) -> list[Peer]:
    import ssik  # noqa: F401 - the artifact needs it

    artifact = file.with_name("arm_ik.py")
    command = [sys.executable, "-m", "ssik.cli", "build", str(file), "--base", "base", "--ee", "tip"]
    subprocess.run([*command, "--out", str(artifact), "--no-validate"], check=True, capture_output=True)
    built: dict = {"__name__": "arm_ik", "__file__": str(artifact)}
    exec(compile(artifact.read_text(encoding="utf-8"), str(artifact), "exec"), built)

    def solve(pose: Array, seed: Array) -> Array | None:
        found = built["solve"](pose, max_solutions=1, q_seed=seed)
        return found[0].q if found else None

    def forward(q: Array, out: Array) -> None:
        out[:] = built["fk"](q)

    return [Peer("ssik", "ssik", forward, track=solve, cold=solve, knob=lambda _: solve, settings=(1.0,))]


def _optik(robot: Robot, file: Path) -> list[Peer]:
    import optik

    arm = optik.Robot.from_urdf_file(str(file), "base", "tip")

    def with_config(**settings: Any) -> Solve:
        config = optik.SolverConfig(solution_mode="speed", max_time=0.1, **settings)

        def solve(pose: Array, seed: Array) -> Array | None:
            answer = arm.ik(config, pose, seed)
            return None if answer is None else np.array(answer[0])

        return solve

    def at(tolerance: float) -> Solve:
        return with_config(tol_f=tolerance, tol_df=-1.0, tol_dx=-1.0)

    def forward(q: Array, out: Array) -> None:
        out[:] = arm.fk(q)

    def jacobian(q: Array, out: Array) -> None:
        out[:] = arm.joint_jacobian(q)

    exact, settings = at(1e-14), (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16)
    return [
        Peer("optik", "optik-py", forward, jacobian, None, exact, exact, at, settings),
        Peer("optik default", "optik-py", track=with_config(), cold=with_config()),
    ]


def _eaik(robot: Robot, file: Path) -> list[Peer]:
    """Six axes only: the third joint is locked at one of a comb of angles, the one nearest to the seed's first."""
    from eaik.IK_DH import DhRobot

    comb = np.linspace(robot.lower[2], robot.upper[2], 24)
    d = robot.d.copy()
    d[-1] += robot.tool[2, 3]
    arms = [DhRobot(robot.alpha, robot.a, d, fixed_axes=[(2, angle)]) for angle in comb]

    def solve(pose: Array, seed: Array) -> Array | None:
        for k in np.argsort(np.abs(comb - seed[2])):
            found = arms[k].IK(pose)
            exact = [q for q, rough in zip(found.Q, found.is_LS) if not rough]
            inside = [q for q in exact if ((q >= robot.lower) & (q <= robot.upper)).all()]
            if inside:
                return min(inside, key=lambda q: np.abs(q - seed).max())
        return None

    return [Peer("EAIK", "EAIK", track=solve, cold=solve, knob=lambda _: solve, settings=(1.0,))]


def _trac_ik(robot: Robot, file: Path) -> list[Peer]:
    from trac_ik import TracIK

    text = file.read_text(encoding="utf-8")
    kept = Path(tempfile.mkdtemp()) / "arm.urdf"
    kept.write_text(text, encoding="utf-8")

    def at(tolerance: float) -> Solve:
        arm = TracIK("base", "tip", str(kept), timeout=0.02, epsilon=tolerance, solver_type="Speed")
        return lambda pose, seed: arm.ik(pose[:3, 3], pose[:3, :3], seed)

    exact = at(1e-7)
    return [
        Peer("TRAC-IK", "pytracik", track=exact, cold=exact, knob=at, settings=(1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8))
    ]


def _mink(robot: Robot, file: Path) -> list[Peer]:
    import mink
    import mujoco

    model = mujoco.MjModel.from_xml_string(file.read_text(encoding="utf-8"))
    configuration = mink.Configuration(model)
    task = mink.FrameTask("tip", "body", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-6)
    limits = [mink.ConfigurationLimit(model)]

    def at(tolerance: float, iterations: int = 100) -> Solve:
        def solve(pose: Array, seed: Array) -> Array | None:
            configuration.update(seed)
            task.set_target(mink.SE3.from_matrix(pose))
            for _ in range(iterations):
                error = task.compute_error(configuration)
                if max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < tolerance:
                    return configuration.q.copy()
                step = mink.solve_ik(configuration, [task], 1.0, solver="daqp", damping=1e-9, limits=limits)
                configuration.integrate_inplace(step, 1.0)
            return None

        return solve

    exact, settings = at(5e-7), (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
    return [Peer("mink", "mink", track=exact, cold=exact, knob=at, settings=settings)]


def urdf_text(robot: Robot) -> str:
    """A standard DH robot of revolute joints, with its tool, as URDF; full digits, for readers of any kind."""
    weight = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts = ['<mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>']
    parent, placement = "base", robot.base
    for i in range(robot.n):
        limit = f'lower="{robot.lower[i]:.17g}" upper="{robot.upper[i]:.17g}" velocity="{robot.speed[i]:.17g}"'
        parts.append(f'<link name="link{i}">{weight}</link><joint name="joint{i}" type="revolute">')
        parts.append(f'<parent link="{parent}"/><child link="link{i}"/>{_origin(placement)}')
        parts.append(f'<axis xyz="0 0 1"/><limit {limit} effort="1"/></joint>')
        c, s = np.cos(robot.alpha[i]), np.sin(robot.alpha[i])
        parent = f"link{i}"
        placement = np.array(
            [[1.0, 0.0, 0.0, robot.a[i]], [0.0, c, -s, 0.0], [0.0, s, c, robot.d[i]], [0.0, 0.0, 0.0, 1.0]]
        )
    parts.append('<link name="tip"/><joint name="tool" type="fixed">')
    parts.append(f'<parent link="{parent}"/><child link="tip"/>{_origin(placement @ robot.tool)}</joint>')
    return f'<robot name="{robot.name}">{"".join(parts)}</robot>'


def _origin(pose: Array) -> str:
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
    place, turn = (" ".join(f"{x:.17g}" for x in values) for values in (pose[:3, 3], angles))
    return f'<origin xyz="{place}" rpy="{turn}"/>'
