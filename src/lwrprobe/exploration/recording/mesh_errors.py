"""Expected errors of a mesh's vertices, from those of the contacts."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from lwrprobe.contracts import Reconstruction
from lwrprobe.exploration.recording.error_budget import ErrorBudget

MEAN = sqrt(2.0 / pi)
"""Mean size of a normal number of standard deviation 1."""


def expect_mesh_errors(budget: ErrorBudget, surface: Reconstruction, lowest: float | None = None) -> dict[str, float]:
    """Add the errors of the contacts to the expected errors of a mesh's vertices; mean and p95 [mm] for the summary.

    What the reconstructor expects is the noise of the contacts, what lies between them and how far the mesh goes on
    beyond them. The nearest contact adds the rest. `mean` and `p95` leave out vertices that no sphere could have
    touched. `whole_mean` and `whole_p95` have all above `lowest` m, the lowest height of the sphere's centre.
    """
    mesh = surface.mesh
    own = mesh.vertex_error if mesh.vertex_error is not None else np.zeros(len(mesh.vertices))
    absolute, aligned = (np.hypot(own, MEAN * budget.near(mesh.vertices, kind)) for kind in (False, True))
    mesh.vertex_error, mesh.vertex_error_aligned = absolute, aligned
    every = np.ones(len(own), dtype=bool)
    touchable = every if surface.unreachable is None else np.logical_not(surface.unreachable)
    above = every if lowest is None else mesh.vertices[:, 2] >= lowest
    found = {}
    for prefix, errors in (("", absolute), ("aligned_", aligned)):
        for part, which in (("", touchable), ("whole_", above)):
            mine = 1e3 * (errors[which] if which.any() else errors)
            found[f"{prefix}{part}mean"] = round(float(mine.mean()), 4)
            found[f"{prefix}{part}p95"] = round(float(np.percentile(mine, 95.0)), 4)
    return found
