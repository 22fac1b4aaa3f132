"""The same runs in two simulated worlds: the plug-in `sim`, and MuJoCo's arm, stick, contacts and friction.

MuJoCo is tried twice: with links that weigh next to nothing, where the two worlds should agree, and with the arm's own
mass, which `sim` does not model and the force law allows for. Options (`--set`): `scenes`, a comma-separated list;
`strategy`; `profile` of the table `[truth]`.
"""

from __future__ import annotations

from lwrprobe.bench.criterion import Criterion
from lwrprobe.bench.options import Options
from lwrprobe.bench.reality import FIGURES, TRUTH_PROFILES, explored
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import MissingExtraError, UnknownNameError
from lwrprobe.evaluation.machine import machine, versions

SCENES = ("block", "cylinder_vertical", "cylinder_horizontal", "stacked_blocks")
SEED = 7
LIGHT = 1.0
"""kg, of an arm whose inertia is of no account."""
_MUJOCO = ("arm.driver=mujoco", "sensor.driver=mujoco")
WORLDS = {
    "sim": (),
    f"mujoco, arm of {LIGHT:g} kg": (*_MUJOCO, f"drivers.mujoco.arm_mass={LIGHT}"),
    "mujoco, arm of 16 kg": (*_MUJOCO, "drivers.mujoco.arm_mass=16"),
}
REASONS = (
    (
        "robot time with the arm of 16 kg",
        "a moving mass m that meets a surface of stiffness k at speed v presses with up to v sqrt(m k); the force law "
        "knows the mass and approaches more slowly; `sim` moves the arm without inertia",
    ),
    ("contact error", "MuJoCo's stick turns where it bends, `sim` shifts the sphere alone"),
    ("force at rest after a slide", "MuJoCo's friction has no elastic part, `sim` has (Mindlin 1949)"),
    (
        "contact on a stiff object",
        "steps of 0.1 ms resolve contacts of up to 1.2e5 N/m, and a stiffer one is taken as that; in series with arm "
        "and stick that is a fifth of what gives way",
    ),
)


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench physics`."""
    try:
        import mujoco  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("bench physics", "mujoco", "mujoco") from error
    asked = Options("physics", options, "scenes", "strategy", "profile")
    scenes = asked.words("scenes", SCENES[:1] if quick else SCENES)
    strategy, profile = asked.text("strategy", "grid_version"), asked.text("profile", "lab")
    if profile not in TRUTH_PROFILES:
        raise UnknownNameError("bench physics: profile", profile, TRUTH_PROFILES)
    report = BenchReport("physics", "Two simulated worlds")
    report.machine = machine() | versions("numpy", "numba", "mujoco")
    found = []
    for scene in scenes:
        for world, settings in WORLDS.items():
            common = (f'strategy.name="{strategy}"', f"run.seed={SEED}", f"truth.profile={profile}")
            found.append({"scene": scene, "world": world} | explored(scene, [*common, *settings]))
    names = {"scene": "scene", "world": "world", **FIGURES, "robot time s": "time", "reason": "reason"}
    report.records(f"{strategy}, seed {SEED}, {profile}", names, found)
    report.table("Why the worlds differ", "what | reason", [list(reason) for reason in REASONS])
    for world in list(WORLDS)[1:]:
        runs = [item for item in found if item["world"] == world]
        report.verdicts += [
            Criterion(f"status done: {world}", "status", lambda v: v == "done").verdict(runs),
            Criterion(f"true peak force <= 3 N: {world}", "peak", lambda v: v <= 3.0).verdict(runs),
        ]
    report.data["runs"] = found
    return report
