"""Contact estimation: point and normal error of every estimator against friction, force, noise and compute time.

The wrenches are made here: a sphere slides over planes, a cylinder, a ball and an edge, or presses without sliding;
contact force with Coulomb friction, weight of the tip, the sensor's bias, white noise and quantisation. They go through
the conditioner, as in a run. No installable peer estimates a contact from a wrench; the thesis's own method,
`force_direction`, is the one to beat.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.bench.timing import interleave
from lwrprobe.contact import (
    ESTIMATORS,
    RELIABLE_FROM,
    Deflection,
    Payload,
    Wrench,
    WrenchConditioner,
    identify_payload,
    make_estimator,
)
from lwrprobe.contracts import Probe, WrenchSample
from lwrprobe.evaluation.machine import machine, versions

RATE = 125.0
SPEED = 0.02  # m/s along the surface
BIAS = np.array([0.12, -0.08, 0.25, 1e-3, -2e-3, 5e-4])
FRICTIONS = (0.0, 0.3, 0.6)
FORCES = (0.3, 0.5, 1.0, 2.0, 5.0)
NOISES = (0.0, 0.25, 0.5, 1.0, 2.0)
X, Y, Z = np.eye(3)


@dataclass(slots=True, frozen=True)
class Track:
    """True path of the sphere: centres, normals and velocities, (n, 3) each, world frame, one row a sample."""

    name: str
    centres: np.ndarray
    normals: np.ndarray
    velocities: np.ndarray


@dataclass(slots=True, frozen=True)
class Condition:
    """What a measurement was made under.

    Attributes
    ----------
    force : N, magnitude of the whole contact force; friction : coefficient
    noise : resolution steps, standard deviation of each axis
    speed_noise : m/s on each axis of the velocity handed to the estimators
    lever_error : m by which the sphere sits beside where the estimators have it
    drift : N by which the force's zero has wandered since the bias was taken
    """

    force: float = 1.0
    friction: float = 0.3
    noise: float = 1.0
    speed_noise: float = 3e-4
    lever_error: float = 0.0
    drift: float = 0.0


@dataclass(slots=True)
class Errors:
    """Errors of one estimator: point [mm], normal [deg], and the confidence, (n,) each."""

    point: np.ndarray
    normal: np.ndarray
    confidence: np.ndarray

    def row(self) -> list[float]:
        """Median and 95th percentile of both over all that is not refused outright, and the share that is trusted."""
        given = self.confidence > 0.0
        spread = [np.percentile(e[given], q) for e in (self.point, self.normal) for q in (50, 95)]
        return [*map(float, spread), float(np.mean(self.confidence >= RELIABLE_FROM))]


FAULTS = {
    "speed without noise": Condition(speed_noise=0.0),
    "speed noise 1 mm/s": Condition(speed_noise=1e-3),
    "speed noise 3 mm/s": Condition(speed_noise=3e-3),
    "sphere 0.1 mm off": Condition(lever_error=1e-4),
    "sphere 0.3 mm off": Condition(lever_error=3e-4),
    "zero 3 mN off": Condition(drift=0.003),
    "zero 10 mN off": Condition(drift=0.01),
    "zero 20 mN off": Condition(drift=0.02),
}


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench contact`; option `seed`."""
    rng = np.random.default_rng(Options("contact", options, "seed").count("seed", 7))
    probe = Probe(mass=0.01, centre_of_mass=np.array([0.0, 0.0, 0.03]))
    rounds = 1 if quick else 4
    report = BenchReport("contact", "Contact estimation: where the sphere is touched", machine=_machine())

    tracks = _tracks(probe)
    by_friction = {mu: _errors(tracks, probe, Condition(friction=mu), rng, rounds) for mu in FRICTIONS}
    by_force = {f: _errors(tracks, probe, Condition(force=f), rng, rounds) for f in FORCES}
    by_noise = {c: _errors(tracks, probe, Condition(noise=c), rng, rounds) for c in NOISES}
    by_fault = {name: _errors(tracks, probe, fault, rng, rounds) for name, fault in FAULTS.items()}
    by_track = {t.name: _errors([t], probe, Condition(), rng, rounds) for t in tracks}
    report.tables += [
        _error_table("Sliding at 1 N, against friction", "friction", by_friction),
        _error_table("Sliding, friction 0.3, against force", "force N", by_force),
        _error_table("Sliding at 1 N, friction 0.3, against noise (resolution steps)", "noise", by_noise),
        _error_table("Sliding at 1 N, friction 0.3, by surface", "surface", by_track),
        _error_table("Sliding at 1 N, friction 0.3, with errors beyond noise", "besides noise", by_fault),
        _pressing_table(probe, rng, 40 if quick else 200),
    ]
    seconds, timing = _timing(probe, 2000 if quick else 10000)
    gravity, weighing = _gravity(rng)
    bending, bent = _deflection(rng, rounds)
    report.tables += [timing, weighing, bending]
    report.verdicts = [*_error_verdicts(by_friction), *_other_verdicts(seconds, gravity, bent)]
    report.figures = {
        "error": lambda figure: _draw_errors(figure, by_friction, by_force, by_noise),
        "work": lambda figure: _draw_work(figure, by_friction, seconds),
    }
    report.notes = _notes()
    return report


# True courses


def _tracks(probe: Probe) -> list[Track]:
    r = probe.radius
    slant = (Z - Y) / np.sqrt(2.0)
    return [
        _plane("top, across", r, Z, Y),
        _plane("side, downwards", r, -Y, -Z),
        _plane("side, along", r, -Y, X),
        _plane("slope, upwards", r, slant, (Y + Z) / np.sqrt(2.0)),
        _turning("cylinder r 24", r + 0.024, Z, Y, 2.2),
        _turning("ball r 12", r + 0.012, Z, (X + Y) / np.sqrt(2.0), 2.2),
        _edge("edge, right angle", r),
    ]


def _plane(name: str, radius: float, normal: np.ndarray, along: np.ndarray, count: int = 150) -> Track:
    displacement = np.arange(count) * SPEED / RATE
    centres = radius * normal + displacement[:, None] * along
    return Track(name, centres, np.tile(normal, (count, 1)), np.tile(SPEED * along, (count, 1)))


def _turning(name: str, reach: float, top: np.ndarray, along: np.ndarray, sweep: float) -> Track:
    angle = np.arange(-0.5 * sweep, 0.5 * sweep, SPEED / RATE / reach)[:, None]
    normals = np.cos(angle) * top + np.sin(angle) * along
    return Track(name, reach * normals, normals, SPEED * (np.cos(angle) * along - np.sin(angle) * top))


def _edge(name: str, radius: float) -> Track:
    over = _turning(name, radius, (Z + Y) / np.sqrt(2.0), (Y - Z) / np.sqrt(2.0), 0.5 * np.pi)
    before, after = _plane(name, radius, Z, Y, 60), _plane(name, radius, Y, -Z, 60)
    ahead = before.centres - 60 * SPEED / RATE * Y
    parts = [
        (ahead, before.normals, before.velocities),
        (over.centres, over.normals, over.velocities),
        (after.centres, after.normals, after.velocities),
    ]
    return Track(name, *(np.concatenate(column) for column in zip(*parts)))


# What a sensor makes of them


def _rotation(rng: np.random.Generator, tilt: float = 0.5) -> np.ndarray:
    """(3, 3) of a probe that points down, leaning to a random side by up to `tilt` rad and turned about its axis."""
    lean, side, spin = rng.uniform(0.0, tilt), *rng.uniform(0.0, 2.0 * np.pi, size=2)
    axis = np.array([np.cos(side), np.sin(side), 0.0])
    return _turn(axis, lean) @ np.diag([1.0, -1.0, -1.0]) @ _turn(Z, spin)


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def _readings(
    probe: Probe,
    rotation: np.ndarray,
    normals: np.ndarray,
    forces: np.ndarray,
    condition: Condition,
    rng: np.random.Generator,
) -> np.ndarray:
    """(n, 6) raw readings of contact forces (n, 3) in the world that act where the normals say."""
    force = forces @ rotation
    off = condition.lever_error * _unit(rng) + np.array([0.0, 0.0, probe.sensor_distance])
    torque = np.cross(off + probe.compliance * force - probe.radius * (normals @ rotation), force)
    zero = BIAS + np.concatenate([condition.drift * _unit(rng), np.zeros(3)])
    values = np.hstack([force, torque]) + zero + Payload.of(probe).weight(rotation)
    return _measured(probe, values, condition.noise, rng)


def _unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _measured(probe: Probe, values: np.ndarray, counts: float, rng: np.random.Generator) -> np.ndarray:
    step = np.repeat([probe.force_resolution, probe.torque_resolution], 3)
    return np.round(values / step + counts * rng.normal(size=values.shape)) * step if counts else values


def _conditioned(
    probe: Probe, rotation: np.ndarray, readings: np.ndarray, counts: float, rng: np.random.Generator
) -> Iterator[Wrench]:
    """The readings through a conditioner that has taken its bias from half a second of free space."""
    conditioner = WrenchConditioner(probe, RATE)
    free = _measured(probe, np.tile(BIAS + Payload.of(probe).weight(rotation), (62, 1)), counts, rng)
    conditioner.take_bias([WrenchSample(0.0, v[:3], v[3:]) for v in free], rotation)
    for k, v in enumerate(readings):
        yield conditioner.condition(WrenchSample(k / RATE, v[:3], v[3:], k), rotation)


# Errors


def _errors(
    tracks: list[Track], probe: Probe, condition: Condition, rng: np.random.Generator, rounds: int
) -> dict[str, Errors]:
    """Errors of every estimator over all tracks, each `rounds` times with other noise and another posture."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ESTIMATORS}
    for _ in range(rounds):
        for track in tracks:
            rotation = _rotation(rng)
            forces = _sliding_forces(track, condition)
            readings = _readings(probe, rotation, track.normals, forces, condition, rng)
            wrenches = list(_conditioned(probe, rotation, readings, condition.noise, rng))
            velocities = track.velocities + condition.speed_noise * rng.normal(size=track.velocities.shape)
            for name, rows in parts.items():
                rows.append(_follow(name, probe, track, wrenches, rotation, velocities))
    return {name: Errors(*np.concatenate(rows).T) for name, rows in parts.items()}


def _sliding_forces(track: Track, condition: Condition) -> np.ndarray:
    """(n, 3) on the sphere: along the normal, and friction against the motion."""
    mu = condition.friction
    return condition.force * (track.normals - mu * track.velocities / SPEED) / np.hypot(1.0, mu)


def _follow(
    name: str, probe: Probe, track: Track, wrenches: list[Wrench], rotation: np.ndarray, velocities: np.ndarray
) -> np.ndarray:
    """(n, 3) point error [mm], normal error [deg], confidence."""
    estimator = make_estimator(name, probe)
    rows = np.empty((len(wrenches), 3))
    for k, wrench in enumerate(wrenches):
        contact = estimator.estimate(wrench, track.centres[k], rotation, velocities[k])
        truth = track.centres[k] - probe.radius * track.normals[k]
        rows[k] = (
            1e3 * np.linalg.norm(contact.point - truth),
            _degrees(contact.normal, track.normals[k]),
            contact.confidence_score,
        )
    return rows


def _degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _error_table(title: str, key: str, results: dict) -> Table:
    columns = [key, "estimator", "point mm", "point mm p95", "normal deg", "normal deg p95", "trusted"]
    rows = [[value, name, *e.row()] for value, errors in results.items() for name, e in errors.items()]
    return Table(title, columns, rows)


def _pressing_table(probe: Probe, rng: np.random.Generator, touches: int) -> Table:
    """Touches without sliding, friction anywhere within a cone of 0.5: the error after so many samples."""
    after = (1, 5, 25)
    rows = []
    for force in (0.3, 1.0, 2.0):
        errors: dict[str, list[np.ndarray]] = {name: [] for name in ESTIMATORS}
        for _ in range(touches):
            normal = _unit(rng)
            normal[2] = abs(normal[2])
            side = np.cross(normal, rng.normal(size=3))
            pushed = normal + rng.uniform(0.0, 0.5) * side / np.linalg.norm(side)
            forces = np.tile(force * pushed / np.linalg.norm(pushed), (25, 1))
            normals, rotation = np.tile(normal, (25, 1)), _rotation(rng)
            still = Track("press", np.tile(probe.radius * normal, (25, 1)), normals, np.zeros((25, 3)))
            readings = _readings(probe, rotation, normals, forces, Condition(), rng)
            wrenches = list(_conditioned(probe, rotation, readings, 1.0, rng))
            velocities = 1e-4 * rng.normal(size=(25, 3))
            for name, found in errors.items():
                found.append(_follow(name, probe, still, wrenches, rotation, velocities)[:, 0])
        for name, found in errors.items():
            middle = np.median(found, axis=0)
            rows.append([force, name, *(float(middle[n - 1]) for n in after)])
    columns = ["force N", "estimator", *(f"after {n}" for n in after)]
    return Table("Pressing without sliding: median point error mm after so many samples", columns, rows)


# Time, gravity, deflection


def _timing(probe: Probe, rounds: int) -> tuple[dict[str, float], Table]:
    """Median seconds a sample of the conditioner and of each estimator, called in turns."""
    rng = np.random.default_rng(0)
    track, rotation = _tracks(probe)[0], np.diag([1.0, -1.0, -1.0])
    readings = _readings(probe, rotation, track.normals, _sliding_forces(track, Condition()), Condition(), rng)
    wrenches = list(_conditioned(probe, rotation, readings, 1.0, rng))
    conditioner, clock = WrenchConditioner(probe, RATE), iter(range(10**9))

    def condition() -> Wrench:
        k = next(clock)
        v = readings[k % len(readings)]
        return conditioner.condition(WrenchSample(k / RATE, v[:3], v[3:], k), rotation)

    def estimate(name: str) -> Callable[[], object]:
        estimator, clock = make_estimator(name, probe), iter(range(10**9))

        def call() -> object:
            k = next(clock)
            i = k % len(wrenches)
            wrench = wrenches[i]
            wrench.time = k / RATE
            return estimator.estimate(wrench, track.centres[i], rotation, track.velocities[i])

        return call

    calls = {"condition": condition} | {name: estimate(name) for name in ESTIMATORS}
    taken = interleave(calls, rounds)
    rows = [[name, *(float(1e6 * np.percentile(s, q)) for q in (50, 99))] for name, s in taken.items()]
    both = taken["condition"] + taken["fused"]
    rows.append(["condition + fused", float(1e6 * np.median(both)), float(1e6 * np.percentile(both, 99))])
    medians = {name: float(np.median(s)) for name, s in taken.items()}
    return medians, Table("Time a sample, from Python", ["stage", "us", "us p99"], rows)


def _gravity(rng: np.random.Generator) -> tuple[float, Table]:
    """Residual force [N] after a 45 degree turn with a 10 g tip: payload identified from five poses, and not at all."""
    truth = Payload(0.010, np.array([0.0, 0.0, 0.035]), BIAS)
    probe = Probe()
    poses = [np.diag([1.0, -1.0, -1.0])]
    poses += [_turn(axis, angle) @ poses[0] for axis in (X, Y) for angle in (-0.5, 0.5)]

    def rest(rotation: np.ndarray, count: int) -> list[WrenchSample]:
        values = _measured(probe, np.tile(truth.bias + truth.weight(rotation), (count, 1)), 1.0, rng)
        return [WrenchSample(k / RATE, v[:3], v[3:], k) for k, v in enumerate(values)]

    samples = [s for pose in poses for s in rest(pose, 25)]
    found = identify_payload(samples, [pose for pose in poses for _ in range(25)])
    plain = WrenchConditioner(probe, RATE)
    plain.take_bias(rest(poses[0], 62), poses[0])
    identified = WrenchConditioner(probe, RATE, payload=found)
    turned = _turn(X, np.pi / 4.0) @ poses[0]
    rows, residuals = [], []
    for name, conditioner in (("bias only", plain), ("payload identified", identified)):
        forces = [conditioner.condition(s, turned).force for s in rest(turned, 125)]
        residuals.append(float(np.linalg.norm(np.mean(forces, axis=0))))
        rows.append([name, 1e3 * residuals[-1]])
    rows.append(["mass found, g", 1e3 * found.mass])
    title = "Weight of a 10 g tip after a 45 degree turn: mean residual force"
    return residuals[1], Table(title, ["compensation", "mN"], rows)


def _deflection(rng: np.random.Generator, rounds: int) -> tuple[Table, float]:
    """Point error at 1 N, friction 0.3, with a stick of 2.5e3 N/m across: centres with and without deflection."""
    probe = Probe(compliance=np.array([1 / 2.5e3, 1 / 2.5e3, 1 / 1.3e6]))
    deflection, condition, rows, best = Deflection(probe), Condition(), [], 0.0
    faces = [t for t in _tracks(probe) if t.name.startswith(("top", "side"))]
    for compensated in (False, True):
        errors = []
        for track in faces * rounds:
            rotation = np.diag([1.0, -1.0, -1.0])
            forces = _sliding_forces(track, condition)
            readings = _readings(probe, rotation, track.normals, forces, condition, rng)
            estimator = make_estimator("fused", probe)
            velocities = track.velocities + condition.speed_noise * rng.normal(size=track.velocities.shape)
            for k, wrench in enumerate(_conditioned(probe, rotation, readings, 1.0, rng)):
                centre = track.centres[k] - deflection.shift(rotation, forces[k])  # what the joints say
                if compensated:
                    centre = deflection.centre(centre, rotation, wrench.world_force)
                contact = estimator.estimate(wrench, centre, rotation, velocities[k])
                truth = track.centres[k] - probe.radius * track.normals[k]
                errors.append(1e3 * np.linalg.norm(contact.point - truth))
        best = float(np.median(errors))
        rows.append(["compensated" if compensated else "as the joints say", best, float(np.percentile(errors, 95))])
    title = "Stick of 2.5e3 N/m across, block's faces, 1 N, friction 0.3: point error of fused"
    return Table(title, ["centre", "mm", "mm p95"], rows), best


# Verdicts and pictures


def _error_verdicts(by_friction: dict[float, dict[str, Errors]]) -> list[Verdict]:
    fused = {mu: e["fused"].row() for mu, e in by_friction.items()}
    source = {mu: e["force_direction"].row() for mu, e in by_friction.items()}

    def listed(rows: dict[float, list[float]], column: int, unit: str) -> str:
        return ", ".join(f"{row[column]:.3g}" for row in rows.values()) + f" {unit}"

    expected = (0.02, 1.45, 2.67)
    near = all(abs(row[0] - e) <= 0.05 for row, e in zip(source.values(), expected))
    return [
        Verdict(
            "fused at 1 N, nano17 noise, friction 0, 0.3, 0.6: median point error <= 0.10 mm",
            listed(fused, 0, "mm"),
            all(row[0] <= 0.10 for row in fused.values()),
        ),
        Verdict(
            "the same: median normal error <= 1.0 deg",
            listed(fused, 2, "deg"),
            all(row[2] <= 1.0 for row in fused.values()),
        ),
        Verdict("force_direction on the same samples: 0.02, 1.45, 2.67 mm", listed(source, 0, "mm"), near),
    ]


def _other_verdicts(seconds: dict[str, float], gravity: float, bent: float) -> list[Verdict]:
    each = 1e6 * (seconds["condition"] + seconds["fused"])
    return [
        Verdict("conditioning and fused estimate <= 20 us a sample", f"{each:.3g} us", each <= 20.0),
        Verdict("10 g tip, 45 deg turn: residual <= 15 mN", f"{1e3 * gravity:.2g} mN", gravity <= 0.015),
        Verdict("stick of 2.5e3 N/m: median point error <= 0.10 mm", f"{bent:.3g} mm", bent <= 0.10),
    ]


def _draw_errors(figure: Any, by_friction: dict, by_force: dict, by_noise: dict) -> None:
    panels = figure.subplots(1, 3, sharey=True)
    for axes, results, label in zip(
        panels,
        (by_friction, by_force, by_noise),
        ("friction (1 N)", "force N (friction 0.3)", "noise, steps (1 N, 0.3)"),
    ):
        for name in ESTIMATORS:
            axes.plot(list(results), [e[name].row()[0] for e in results.values()], "o-", label=name)
        axes.axhline(0.10, color="grey", linewidth=0.8, linestyle="--")
        axes.set(xlabel=label, yscale="log", ylim=(5e-3, 5.0))
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("median point error, mm")
    panels[0].legend()


def _draw_work(figure: Any, by_friction: dict, seconds: dict[str, float]) -> None:
    axes = figure.subplots()
    for name in ESTIMATORS:
        errors = [e[name].row()[0] for e in by_friction.values()]
        axes.plot([1e6 * seconds[name]] * len(errors), errors, "o-", label=name)
        for mu, error in zip(by_friction, errors):
            axes.annotate(f" {mu:g}", (1e6 * seconds[name], error), fontsize=8)
    axes.set(xlabel="us a sample, from Python", ylabel="median point error at 1 N, mm", yscale="log")
    axes.set(xlim=(0.0, 1.3e6 * max(seconds.values())), title="labels: friction")
    axes.grid(alpha=0.3)
    axes.legend()


def _notes() -> list[str]:
    return [
        "Noise: white, one resolution step (1/320 N, 1/64 N mm) as standard deviation on each axis, then quantised to "
        "that step; near the upper bound of what records of five real nano17 at 125 Hz allow (see WrenchNoise).",
        "Force is the magnitude of the whole contact force, friction included.",
        f"The probe leans up to 0.5 rad to a random side and moves at {1e3 * SPEED:g} mm/s; unless said otherwise the "
        f"velocity given to the estimators carries {1e3 * Condition().speed_noise:g} mm/s of noise on each axis. "
        "Centres are exact.",
        "No installable peer estimates contacts from a wrench; force_direction is the thesis's method.",
    ]


def _machine() -> dict[str, str]:
    return machine() | versions("numpy", "numba")
