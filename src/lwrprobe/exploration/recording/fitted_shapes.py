"""Simple shapes that the contacts support, with dimensions and their standard deviations."""

from __future__ import annotations

from math import hypot

from lwrprobe.contracts import LwrprobeError, TouchRecord
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.reconstruction.fits import fit


def fitted_shapes(budget: ErrorBudget, record: TouchRecord, table_height: float) -> list[dict[str, object]]:
    """Simple shapes with dimensions and their standard deviations [mm], for the summary; none where none fits.

    Heights count from the table, whose own height is uncertain by `table_height` m.
    """
    try:
        fits = fit(record, budget.shifts)
    except LwrprobeError:
        return []
    rows: list[dict[str, object]] = []
    for found in fits:
        sigma = dict(found.uncertainty)
        if "height" in sigma:
            sigma["height"] = hypot(sigma["height"], table_height)
        sizes = (found.dimensions, sigma, found.uncertainty_aligned)
        names = ("size_mm", "sigma_mm", "sigma_aligned_mm")
        row = {key: {name: round(1e3 * v, 4) for name, v in part.items()} for key, part in zip(names, sizes)}
        about = {"shape": found.kind, "warranted": found.warranted, "why_not": found.why_not}
        rows.append({**about, "share": round(found.share, 4), "rms_mm": round(1e3 * found.rms, 4), **row})
    return rows
