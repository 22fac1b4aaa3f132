"""How far object, arm and stick gave way under the contacts of a run, learnt after it from all its touches.

During a run contacts are corrected with one compliance along the normal, with what was known of it by then. Slopes of
depth over force between neighbouring samples make it too small: what changes the force while the sphere slides, gears
and the surface's slope, is a change of depth that the joints do not show. A touch from free space goes through the
whole force. From the side it contains the stick's give, whose error all such touches share; that sum is known better
than its parts, and it is what moves contacts on walls.

The object gives way along the normal; the arm by its joints, all alike, `J J' f`, which is another direction than
the force's and at a wall twice as much as along the stick.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite, sqrt

import numpy as np

from lwrprobe.contact import TouchRise
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.exploration.stages.touch_law import arm_stiffness
from lwrprobe.scene import Scene

SOFTEST = 0.5
"""Largest share of a stiffness that one standard deviation takes away; a wider belief says nothing of a stick."""
AFTER = 0.5
"""s after a rise in which its first contact was recorded; that one knows the normal."""
ALONG = 2e-4
"""m of path along the surface, up to which a rise counts: then a wrong normal adds to its depth."""
NORMAL = 0.04
"""rad, standard deviation of that normal."""
SPAN = 0.2
"""N, by which the force of a rise changes at least."""
FEWEST = 4
"""Samples of a rise that count, at least."""
ALIKE = 1e-5
"""m/N, standard deviation common to all rises, by the time between force and place while the speed changes."""
SINGLE = 1e-5
"""m/N, of a rise at least: play and waves of the gears."""
PRESSED = 0.35
"""Standard deviation of the compliance that presses show over its value: they make it too small."""
ROUNDS, FAR = 4, 2.0
"""Of the weights; standard deviations from which on a rise counts less."""
STIFFEST = 1e7
"""N/m, of an object."""


@dataclass(slots=True, frozen=True)
class Give:
    """What gave way, and how well it is known.

    Attributes
    ----------
    object : m/N along the normal
    stick, arm : shares by which both gave way more than stated
    errors : (3, 3), rows are independent causes of one standard deviation, columns stick, arm and object
    bends, arms, dents : (n, 3) m at each contact: of the stick and the arm as stated, and by an object of 1 m/N
    rises : touches that it was learnt from
    """

    object: float
    stick: float
    arm: float
    errors: np.ndarray
    bends: np.ndarray
    arms: np.ndarray
    dents: np.ndarray
    rises: int

    def shifts(self, causes: np.ndarray) -> np.ndarray:
        """(n, k, 3) m by `causes` (k, 3): shares of stick and arm, m/N of the object."""
        return np.einsum("kc,cni->nki", causes, np.stack([self.bends, self.arms, self.dents]))

    def report(self) -> dict[str, float]:
        """For the summary."""
        sigma = np.sqrt((self.errors**2).sum(axis=0))
        return {
            "object_um_n": round(1e6 * self.object, 3),
            "object_error_um_n": round(1e6 * float(sigma[2]), 3),
            "stick_percent": round(100.0 * self.stick, 3),
            "arm_percent": round(100.0 * self.arm, 3),
            "touches": self.rises,
        }


def take_give_off(recorder: Recorder, scene: Scene, pipeline: Pipeline, start: np.ndarray) -> Give | None:
    """Move the contacts that follow the run to where the surface is without force; on disk they stay as measured.

    `start` (n,) rad: joint values where the stiffness of the arm is stated. None without contacts, and where some
    belong to an earlier part of the run, of which neither force nor joints are known.
    """
    states = recorder.arm_states()
    if states is None:
        return None
    normals, points = recorder.normals(), recorder.points()
    forces = np.array([contact.force for contact in recorder.contacts])
    centres = np.array([contact.centre for contact in recorder.contacts])
    times = np.array([contact.time for contact in recorder.contacts])
    joints, _ = states
    rotations, linear = pipeline.robot.fk_batch(joints)[:, :3, :3], pipeline.robot.jacobian_batch(joints)[:, :3]
    stick = pipeline.probe.compliance * float(scene.contact.deflection)
    soft = np.einsum("nij,j,nkj->nik", rotations, stick, rotations)
    arm = joint_compliance(scene, pipeline, start) * linear @ linear.transpose(0, 2, 1)
    rises = pipeline.force.rises.found
    after = np.searchsorted(times, [rise.time for rise in rises])
    slopes = [
        rise_slopes(rise, normals[k], soft[k], arm[k])
        for rise, k in zip(rises, after)
        if k < len(times) and times[k] - rise.time < AFTER
    ]
    rows = np.array([slope for slope in slopes if slope is not None]).reshape(-1, 4)
    found = learn(scene, rows, 1.0 / arm_stiffness(scene), pipeline.force.stiffness.pressed)
    push = np.maximum(np.einsum("ni,ni->n", normals, forces), 0.0)
    bends, arms = (np.einsum("nij,nj->ni", matrix, forces) for matrix in (soft, arm))
    give = Give(*found, bends, arms, push[:, None] * normals, len(rows))
    moved = give.shifts(np.array([[give.stick, 1.0 + give.arm, give.object]]))[:, 0]
    recorder.shift(centres - scene.probe.radius * normals + moved - points)
    return give


def joint_compliance(scene: Scene, pipeline: Pipeline, start: np.ndarray) -> float:
    """rad/(N m) of each joint, all alike, with which the arm gives way along the stick at `start` (n,) as stated."""
    lever = pipeline.robot.fk_batch(start[None])[0, :3, 2] @ pipeline.robot.jacobian(start)[:3]
    return float(1.0 / arm_stiffness(scene) / (lever @ lever))


def rise_slopes(
    rise: TouchRise, normal: np.ndarray, soft: np.ndarray, arm: np.ndarray
) -> tuple[float, float, float, float] | None:
    """Four of m/N along the normal: left by stick and arm as stated, of the stick, of the arm, standard deviation.

    None for a rise that says too little. `soft` and `arm` (3, 3) m/N are the stated compliances of both.
    """
    moved = rise.places - rise.places[0]
    depths = -moved @ normal
    aside = np.linalg.norm(moved + np.outer(depths, normal), axis=1)
    near = aside <= ALONG
    forces = rise.forces @ normal
    if near.sum() < FEWEST or np.ptp(forces[near]) < SPAN:
        return None
    force = forces[near] - forces[near].mean()
    square = float(force @ force)
    whole, own, joints = (
        float(force @ depth / square)
        for depth in (depths[near], rise.forces[near] @ soft @ normal, rise.forces[near] @ arm @ normal)
    )
    left = depths[near] - depths[near].mean() - whole * force
    spread = sqrt(float(left @ left) / max(len(left) - 2, 1) / square)
    slid = NORMAL * float(np.ptp(aside[near]) / np.ptp(forces[near]))
    return whole - own - joints, own, joints, hypot(spread, slid, SINGLE)


def learn(
    scene: Scene, rows: np.ndarray, along: float, pressed: tuple[float, float]
) -> tuple[float, float, float, np.ndarray]:
    """m/N of the object, shares of stick and arm, and `Give.errors`, from slopes (n, 4) of `rise_slopes`.

    An object's stiffness has any order of magnitude, up to where its square has the mean that is stated. `along` m/N is
    the arm's compliance along the stick, `pressed` what presses show of both together, and its standard deviation.
    """
    table = scene.uncertainty
    stated = 1e-6 * table.sigma("object_compliance_um_n")
    prior = np.diag([softer(0.01 * table.sigma(f"{name}_stiffness_percent")) ** 2 for name in ("stick", "arm")])
    value, sigma = pressed
    if isfinite(sigma):
        rows = np.vstack([rows, [value - along, 0.0, along, hypot(sigma, PRESSED * value)]])
    if len(rows) == 0 or stated <= 0.0:
        errors = np.diag([*np.sqrt(np.diag(prior)), stated])
        return 1.0 / scene.contact.object_stiffness, 0.0, 0.0, errors
    left, shares, sigmas = rows[:, 0], rows[:, 1:3], rows[:, 3].copy()
    for _ in range(ROUNDS):
        weight = np.linalg.inv(shares @ prior @ shares.T + ALIKE**2 + np.diag(sigmas**2))
        tight = float(weight.sum()) ** -0.5
        compliance, spread = _of_any_size(float(weight.sum(axis=0) @ left) * tight**2, tight, stated)
        gain = prior @ shares.T @ weight
        stick, arm = gain @ (left - compliance)
        off = np.abs(left - compliance - shares @ (stick, arm)) / np.hypot(rows[:, 3], ALIKE)
        scale = max(1.0, 1.4826 * float(np.median(off)))
        sigmas = rows[:, 3] * scale * np.sqrt(np.maximum(1.0, off / (FAR * scale)))
    errors = np.zeros((3, 3))
    rest = prior - gain @ shares @ prior
    errors[:2, :2] = np.linalg.cholesky(rest + 1e-12 * np.eye(2)).T
    errors[2] = *(-spread * gain.sum(axis=1)), spread  # what the object takes, stick and arm do not
    return compliance, float(stick), float(arm), errors


def _of_any_size(mean: float, sigma: float, stated: float) -> tuple[float, float]:
    """m/N, mean and standard deviation of a compliance measured as normal numbers, of which all orders are alike."""
    largest = stated
    for _ in range(20):  # the mean square of numbers whose logarithm is even up to the largest
        largest = stated * sqrt(2.0 * max(np.log(largest * STIFFEST), 1.0))
    sizes = np.geomspace(1.0 / STIFFEST, max(largest, mean + 4.0 * sigma), 2000)
    fits = -0.5 * ((sizes - mean) / sigma) ** 2
    chance = np.exp(fits - fits.max())
    chance /= chance.sum()
    middle = float(chance @ sizes)
    return middle, sqrt(float(chance @ (sizes - middle) ** 2))


def softer(share: float) -> float:
    """Share by which something gives way more that is softer by `share`: a fifth less stiff is a quarter more."""
    share = min(share, SOFTEST)
    return share / (1.0 - share)
