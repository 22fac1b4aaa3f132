"""The waves of the joints' gears, learnt from a run's contacts after it, and taken off their places.

Between motor and link of a harmonic drive lies a wave of the joint value with a known number of periods a turn. On a
smooth surface it makes the sphere seem to go up and down while it is led along: its centre's height over a short,
smooth piece of the path is a parabola and the wave's share along the normal, `n . J (a sin kq + b cos kq)`, with the
same a and b in all pieces. They are found in least squares, with what the scene states of their size as prior. Only
joints whose wave is sure are corrected, and surer than waves of other lengths, which no gear has; the others, such as
those that hardly turned, are left as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import cos, degrees, hypot, radians, sqrt

import numpy as np

from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene

LENGTH = 0.012
"""m of path in one piece: the quickest joint makes more than a wave on it, and a parabola takes up little of that."""
FEWEST = 15
"""Contacts in one piece."""
GAP, PERIODS = 0.05, 2.5
"""s, and times between most contacts, from the longer of which on the path between two of them is not known."""
BENT = cos(radians(12.0))
"""Cosine between a normal and the mean one of its piece, below which the piece is not smooth: an edge, say."""
NOISE = 1.5e-5
"""m, height of a centre over the true surface for other reasons than waves: bending, the zero's wandering, play."""
ALIKE = 1.5e-3
"""m of path on which heights have one and the same error, however slowly it is travelled."""
SURE = 5.0
"""Standard deviations from zero, from which on a wave is one. Heights have other causes that repeat with the joints."""
OTHERS = (0.6, 0.7, 0.8, 1.2, 1.35, 1.5)
"""Times the number of waves a turn, at which no gear has one."""
CLEARER = 1.2
"""Times as many standard deviations as at any of those: a bend of the surface looks like a wave of every length."""
ROUNDS = 3
"""Of the weights, by which pieces that are not smooth count less."""
LARGEST = 3.0
"""Times the stated amplitude, above which what was found is no wave: the same shape of many pieces, at an edge that is
met at the same joint values again and again, say."""
NOTHING = 1e-12
"""rad, of a wave that is not asked for."""

Piece = tuple[np.ndarray, np.ndarray, float]
"""Shares (m, 2 n) m/rad of the waves and heights (m,) m, both without their parabola; heights that are independent."""


@dataclass(slots=True, frozen=True)
class Touches:
    """m contacts in the order of their times (m,) s.

    Attributes
    ----------
    centres, normals : (m, 3) m and unit, world frame: of the sphere where it touches without a force
    joints : (m, n) rad
    linear : (m, 3, n) m/rad, Jacobians of the sphere's centre
    """

    times: np.ndarray
    centres: np.ndarray
    normals: np.ndarray
    joints: np.ndarray
    linear: np.ndarray


@dataclass(slots=True, frozen=True)
class GearWaves:
    """Waves of n joints: the link is at `q + sine sin(k q) + cosine cos(k q)`, q the motor's position.

    Attributes
    ----------
    waves : k, rad of the wave to one of the joint
    sine, cosine : (n,) rad, zero for a joint that is not sure
    error : (n,) rad, standard deviation of the joint value that remains through its wave
    """

    waves: float
    sine: np.ndarray
    cosine: np.ndarray
    error: np.ndarray

    def at(self, joints: np.ndarray) -> np.ndarray:
        """(m, n) rad, link less motor at motor positions (m, n)."""
        angle = self.waves * joints
        return self.sine * np.sin(angle) + self.cosine * np.cos(angle)

    def report(self) -> dict[str, list[float]]:
        """For the summary: amplitude and what remains, degrees, joint by joint."""
        return {
            "amplitude_deg": [round(degrees(hypot(s, c)), 6) for s, c in zip(self.sine, self.cosine)],
            "error_deg": [round(degrees(e), 6) for e in self.error],
        }


def take_waves_off(recorder: Recorder, scene: Scene, robot: Robot) -> GearWaves | None:
    """Move the contacts that follow the run to where they were without the waves; on disk they stay as measured.

    None where nothing is sure, where `arm.gear_waves` or `uncertainty.gear_ripple_deg` is zero, and where some contacts
    belong to an earlier part of the run, of which the joints are not known.
    """
    stated = radians(scene.uncertainty.sigma("gear_ripple_deg"))
    states = recorder.arm_states()
    if states is None or stated <= 0.0 or scene.arm.gear_waves <= 0.0:
        return None
    joints, _ = states
    linear = robot.jacobian_batch(joints)[:, :3]
    centres = recorder.points() + scene.probe.radius * recorder.normals()
    times = np.array([contact.time for contact in recorder.contacts])
    found = learn(Touches(times, centres, recorder.normals(), joints, linear), scene.arm.gear_waves, stated)
    if not (found.sine.any() or found.cosine.any()):
        return None
    recorder.shift(np.einsum("nij,nj->ni", linear, found.at(joints)))
    return found


def learn(touches: Touches, waves: float, stated: float) -> GearWaves:
    """The waves from touches; `waves` is their number a turn, `stated` rad the amplitude that is expected."""
    n = touches.joints.shape[1]
    pieces = list(_pieces(touches, waves))
    asked = np.ones(n, dtype=bool)
    found, covariance = _solved(pieces, np.tile(asked, 2), stated)
    while (np.hypot(found[:n], found[n:]) > LARGEST * stated).any():
        asked[np.argmax(np.hypot(found[:n], found[n:]))] = False
        found, covariance = _solved(pieces, np.tile(asked, 2), stated)
    sure = np.where(asked, _sureness(found, covariance), 0.0)
    if (sure >= SURE).any():
        every = np.ones(2 * n, dtype=bool)
        others = [_sureness(*_solved(list(_pieces(touches, times * waves)), every, stated)) for times in OTHERS]
        sure[sure < CLEARER * np.max(others, axis=0)] = 0.0
    # What the links do more than the motors is not in the measured height.
    sine, cosine, error = -found[:n], -found[n:], np.full(n, stated / sqrt(2.0))
    sine[sure < SURE], cosine[sure < SURE] = 0.0, 0.0
    for j in np.flatnonzero(sure >= SURE):
        error[j] = sqrt(0.5 * (covariance[j, j] + covariance[n + j, n + j]))
    return GearWaves(waves, sine, cosine, error)


def _sureness(found: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(n,) standard deviations that each joint's wave is from zero."""
    n = len(found) // 2
    pairs = [[j, n + j] for j in range(n)]
    return np.array(
        [sqrt(found[pair] @ np.linalg.solve(covariance[np.ix_(pair, pair)], found[pair])) for pair in pairs]
    )


def _solved(pieces: list[Piece], asked: np.ndarray, stated: float) -> tuple[np.ndarray, np.ndarray]:
    """Shares (2 n,) rad of sine and cosine in the heights and their covariance; zero where they are not asked for."""
    prior = np.diag(np.where(asked, 2.0 / stated**2, 1.0 / NOTHING**2))
    found, information = np.zeros(len(asked)), prior
    for _ in range(ROUNDS):
        information, sums = prior.copy(), np.zeros(len(asked))
        for shares, heights, independent in pieces:
            left = heights - shares @ found
            spread = max(sqrt(float((left**2).mean())), NOISE)
            weight = (NOISE / spread) ** 2 / spread**2 * independent / len(heights)
            information += weight * shares.T @ shares
            sums += weight * shares.T @ heights
        found = np.linalg.solve(information, sums)
    return found, np.linalg.inv(information)


def _pieces(touches: Touches, waves: float) -> Iterator[Piece]:
    """The smooth pieces of the path, each without its parabola."""
    centres, normals = touches.centres, touches.normals
    apart = np.diff(touches.times)
    gap = max(GAP, PERIODS * float(np.median(apart))) if len(apart) else GAP
    for run in np.split(np.arange(len(centres)), np.flatnonzero(apart > gap) + 1):
        travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres[run], axis=0), axis=1))])
        count = round(float(travel[-1]) / LENGTH)
        if count < 1:
            continue
        ends = np.searchsorted(travel, np.linspace(0.0, travel[-1], count + 1))
        for begin, end in pairwise(ends.tolist()):
            piece, along = run[begin:end], travel[begin:end]
            if len(piece) < FEWEST or along[-1] <= along[0]:
                continue
            normal = normals[piece].mean(axis=0)
            normal /= np.linalg.norm(normal)
            if (normals[piece] @ normal).min() < BENT:
                continue
            lift = np.einsum("mij,i->mj", touches.linear[piece], normal)
            angle = waves * touches.joints[piece]
            shares = np.concatenate([lift * np.sin(angle), lift * np.cos(angle)], axis=1)
            heights = centres[piece] @ normal
            length = along[-1] - along[0]
            basis, _ = np.linalg.qr(np.vander((along - along[0]) / length, 3))
            independent = min(length / ALIKE, float(len(piece)))
            yield shares - basis @ (basis.T @ shares), heights - basis @ (basis.T @ heights), independent
