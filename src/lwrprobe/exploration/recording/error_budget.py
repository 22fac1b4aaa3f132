"""How far each contact may be off: what `[uncertainty]`, noise and the touches themselves leave open.

A number that is the same for all contacts of a run, such as the probe's length, moves each of them by a vector: that
is a shared cause. The other causes differ from contact to contact. Two questions have two answers: how far a contact
may be from its true place, and how far it may be from it after the rigid motion that aligns all contacts with the true
ones. That motion takes away what shared causes move all contacts by together, the robot's base first of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

BAND = 7.815
"""Squared radius of the 95 % region of three normal numbers in standard deviations."""
COLUMNS = "time,sigma_random_mm,sigma_mm,xx_mm2,xy_mm2,xz_mm2,yy_mm2,yz_mm2,zz_mm2,sigma_aligned_mm"


@dataclass(slots=True, frozen=True)
class ErrorBudget:
    """Errors of the contacts of a run, one standard deviation each.

    Attributes
    ----------
    points, normals : (n, 3) m and unit, world frame
    random : (n, 3, 3) m^2, covariance of what differs from contact to contact
    shared : (n, k, 3) m, shift of each contact by one standard deviation of each of k numbers common to all contacts
    aligned : (n, k, 3) m, the same less the rigid motion that makes each shift smallest in least squares
    causes, causes_aligned : mm along the normal by name, root mean square over the contacts
    """

    points: np.ndarray
    normals: np.ndarray
    random: np.ndarray
    shared: np.ndarray
    aligned: np.ndarray
    causes: dict[str, float]
    causes_aligned: dict[str, float]

    @classmethod
    def of(
        cls, points: np.ndarray, normals: np.ndarray, random: dict[str, np.ndarray], shared: dict[str, np.ndarray]
    ) -> ErrorBudget:
        """From causes by name: `random` (n, 3, 3) m^2 each, `shared` (n, any, 3) m each."""
        rows = np.concatenate([np.empty((len(points), 0, 3)), *shared.values()], axis=1)
        left = without_rigid_motion(points, rows)
        squares = {name: _along(normals, covariance) for name, covariance in random.items()}
        aligned, begin = dict(squares), 0
        for name, part in shared.items():
            mine = slice(begin, begin + part.shape[1])
            begin = mine.stop
            squares[name] = _squares_along(normals, part)
            aligned[name] = _squares_along(normals, left[:, mine])
        nothing = np.zeros((len(points), 3, 3))
        return cls(
            points, normals, sum(random.values(), nothing), rows, left,
            *({name: 1e3 * sqrt(float(v.mean())) for name, v in each.items()} for each in (squares, aligned)),
        )  # fmt: skip

    def covariance(self, aligned: bool = False) -> np.ndarray:
        """(n, 3, 3) m^2 of all causes, as they are or after alignment."""
        rows = self.aligned if aligned else self.shared
        return self.random + rows.transpose(0, 2, 1) @ rows

    def along_normal(self, aligned: bool = False) -> np.ndarray:
        """(n,) m, standard deviation along the normal of all causes."""
        rows = self.aligned if aligned else self.shared
        return np.sqrt(_along(self.normals, self.random) + _squares_along(self.normals, rows))

    def near(self, places: np.ndarray, aligned: bool = False) -> np.ndarray:
        """(m,) m, standard deviation along the normal of the contact nearest to each of (m, 3) m."""
        return self.along_normal(aligned)[self._nearest(places)]

    def shifts(self, places: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m, k) m along normals (m, 3) of places (m, 3) m: the shared causes, as they are and after alignment."""
        at = self._nearest(places)
        along, left = (np.einsum("nki,ni->nk", rows[at], normals) for rows in (self.shared, self.aligned))
        return along, left

    def _nearest(self, places: np.ndarray) -> np.ndarray:
        return np.asarray(cKDTree(self.points).query(places)[1])

    def claims_within_95(self, errors: np.ndarray, which: np.ndarray, aligned: bool = False) -> float | None:
        """Share of errors (k, 3) m of the contacts marked in (n,) bool inside the 95 % region; None without any.

        With `aligned` the errors are those left after the alignment.
        """
        if not which.any():
            return None
        return round(float((self.squares(errors, which, aligned) <= BAND).mean()), 4)

    def squares(self, errors: np.ndarray, which: np.ndarray, aligned: bool = False) -> np.ndarray:
        """(k,) squares of such errors in standard deviations: with three degrees of freedom if the budget is right."""
        whole = self.covariance(aligned)[which]
        return np.einsum("ni,ni->n", errors, np.linalg.solve(whole, errors[:, :, None])[:, :, 0])

    def write(self, path: Path, times: Sequence[float]) -> None:
        """One row a contact: its time [s], standard deviations along the normal, covariance of all causes."""
        random = np.sqrt(_along(self.normals, self.random))
        covariance = 1e6 * self.covariance()
        columns = [times, 1e3 * random, 1e3 * self.along_normal()]
        columns += [covariance[:, i, j] for i in range(3) for j in range(i, 3)]
        columns += [1e3 * self.along_normal(aligned=True)]
        np.savetxt(path, np.column_stack(columns), ["%.6f"] + ["%.6g"] * 9, ",", header=COLUMNS, comments="")

    def report(self) -> dict[str, object]:
        """For the summary: lengths in mm along the normal, one standard deviation."""

        def mean(values: np.ndarray) -> float:
            return round(1e3 * sqrt(float((values**2).mean())), 4)

        return {
            "causes_mm": {name: round(value, 4) for name, value in self.causes.items()},
            "causes_aligned_mm": {name: round(value, 4) for name, value in self.causes_aligned.items()},
            "random_mm": mean(np.sqrt(_along(self.normals, self.random))),
            "whole_mm": mean(self.along_normal()),
            "shape_mm": mean(self.along_normal(aligned=True)),
        }


def without_rigid_motion(points: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """(n, k, 3) m: each of k fields of shifts of points (n, 3) m less the small rigid motion nearest to it.

    Points on a line, or fewer than three, leave directions open; those shift nothing.
    """
    away = points - points.mean(axis=0)
    motions = np.zeros((len(points), 6, 3))
    motions[:, :3] = np.eye(3)
    motions[:, 3:] = np.cross(np.eye(3), away[:, None]) / max(float(np.abs(away).max()), 1e-9)
    share = np.linalg.pinv(np.einsum("nai,nbi->ab", motions, motions), rcond=1e-9, hermitian=True)
    found = share @ np.einsum("nai,nki->ak", motions, shifts)
    return shifts - np.einsum("nai,ak->nki", motions, found)


def _along(normals: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(n,) m^2, variance along the normal; rounding must not make it negative."""
    return np.maximum(np.einsum("ni,nij,nj->n", normals, covariance, normals), 0.0)


def _squares_along(normals: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(n,) m^2, the same of shifts (n, k, 3)."""
    return (np.einsum("nki,ni->nk", rows, normals) ** 2).sum(axis=1)
