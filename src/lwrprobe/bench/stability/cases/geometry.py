"""Edges, corners, slots, thin and small things, moving things: the explorer on shapes that mislead it."""

from __future__ import annotations

import numpy as np

from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.bench.stability.runs import LINES_ONLY, Run, explored, strip
from lwrprobe.contracts import LwrprobeError


def _sharp_edge(quick: bool) -> list[Finding]:
    """The apex has to be touched, and nothing beside it stored."""
    found = []
    for degrees in (15,) if quick else (5, 15, 30):
        run = strip("wedge_15deg", _wedge(degrees))
        lost = 1e3 * (0.06 - run.points[:, 2].max())
        both = run.normals[:, 1].min() < -0.7 and run.normals[:, 1].max() > 0.7
        off = 1e3 * float(np.percentile(np.abs(run.distance), 95))
        text = f"{run.describe()}; apex missed by {lost:.2f} mm, points off by {off:.2f} mm (95 %)"
        text += "" if both else "; only one side touched"
        setting = f"wedge {degrees} deg"
        found.append(within(setting, text, max(lost, off), 0.5, "mm", also=both and run.within_limit))
    return found


def _wedge(degrees: int) -> list[str]:
    roll = 90.0 - 0.5 * degrees
    at = "object.0.children.{}.at={{ xyz = [0.0, 0.0, 0.06], rpy_deg = [{}, 0.0, 0.0] }}"
    return [at.format(1, roll), at.format(2, -roll)]


def _cliff(quick: bool) -> list[Finding]:
    run = strip("cliff")
    levels = [
        z for z in (0.050, 0.048, 0.038) if ((np.abs(run.points[:, 2] - z) < 4e-4) & (run.normals[:, 2] > 0.9)).any()
    ]
    text = f"{run.describe()}; steps touched at {', '.join(f'{1e3 * z:g}' for z in levels)} mm"
    limit = run.scene.contact.limit
    return [within("2, 10 and 38 mm down", text, run.summary["peak_force_n"], limit, "N", also=len(levels) == 3)]


def _inner_corner(quick: bool) -> list[Finding]:
    """Two contacts at once give a resultant between the walls; what is stored must lie on a wall all the same."""
    found = []
    for degrees in (90,) if quick else (90, 60, 30):
        run = strip("block", [_groove(degrees)], top=0.058)
        wrong = float((np.abs(run.distance) > 5e-4).mean()) if len(run.distance) else 1.0
        worst = 1e3 * float(np.abs(run.distance).max(initial=0.0))
        text = f"{run.describe()}; {100 * wrong:.2f} % of the points more than 0.5 mm off, the worst {worst:.2f} mm"
        setting = f"groove of {degrees} deg"
        found.append(within(setting, text, 100 * wrong, 2.0, "% off", also=run.within_limit and _done(run)))
    return found


def _groove(degrees: int) -> str:
    """A block with a V-shaped groove along x, its bottom at z = 30 mm."""
    roll = 90.0 + 0.5 * degrees
    walls = ", ".join(
        f"{{ shape = 'half_space', at = {{ xyz = [0.0, 0.0, 0.03], rpy_deg = [{r}, 0.0, 0.0] }} }}"
        for r in (roll, -roll)
    )
    lid = "{ shape = 'box', size = [0.2, 0.2, 0.1], at = { xyz = [0.0, 0.0, 0.08] } }"
    block = "{ shape = 'box', size = [0.1, 0.05, 0.05], at = { xyz = [0.0, 0.0, 0.025] } }"
    groove = f"{{ shape = 'intersection', children = [{lid}, {walls}] }}"
    return f"object=[{{ shape = 'difference', children = [{block}, {groove}] }}]"


def _narrow_slot(quick: bool) -> list[Finding]:
    run = strip("slot_8mm")
    inside = (np.abs(run.points[:, 1]) < 3.5e-3) & (run.points[:, 2] < 0.0485)
    text = f"{run.describe()}; {int(inside.sum())} points claimed inside of the slot"
    claimed = within("slot 8 mm", text, float(inside.sum()), 0.0, "points", also=_done(run))
    gaps = [zone for zone in run.summary["bridged"] if zone["kind"] == "gap"]
    if len(gaps) != 1:
        return [claimed, Finding("slot 8 mm", f"{len(gaps)} gaps reported as bridged", held=False)]
    text = f"one gap of {gaps[0]['width_mm']:.2f} mm reported as bridged, off by"
    return [claimed, within("slot 8 mm", text, abs(gaps[0]["width_mm"] - 8.0), 0.5, "mm")]


def _wide_slot(quick: bool) -> list[Finding]:
    """Chatter would show in time, against the same strip of a plain block, and in the force."""
    plain = strip("block").summary["sim_time_s"]
    run = strip("slot_12mm", ["object.0.children.1.size=[0.12, 0.0102, 0.06]"])
    depth = 1e3 * (0.05 - run.points[np.abs(run.points[:, 1]) < 5.2e-3, 2].min(initial=0.05))
    times = run.summary["sim_time_s"] / plain
    text = f"{run.describe()}; {times:.2f} times as long as without the slot, measured {depth:.1f} mm deep"
    also = run.within_limit and _done(run)
    return [within("slot 10.2 mm", text, times, 3.0, "times", also=also)]


def _overhang(quick: bool) -> list[Finding]:
    """Where the stick touches first, nothing may be stored as a contact of the sphere."""
    run = strip("overhang")
    wrong = float((np.abs(run.distance) > 1e-3).mean())
    text = f"{run.describe()}; {100 * wrong:.2f} % of the points more than 1 mm off the surface"
    return [within("T-shape", text, 100 * wrong, 0.5, "% off", also=run.within_limit and _done(run))]


def _tiny(quick: bool) -> list[Finding]:
    ball = "{ shape = 'sphere', radius = 0.0015, at = { xyz = [0.0, 0.0, 0.0035] } }"
    wire = "{ shape = 'cylinder', radius = 0.0005, length = 0.03, at = { xyz = [0.0, 0.0, 0.015] } }"
    found = []
    for name, shape, size in (("ball of 3 mm", ball, 3.0), ("wire of 1 mm", wire, 1.0)):
        top = 0.013 if size == 3.0 else 0.038
        area = ["area.lower=[-0.012, -0.02, 0.006]", f"area.upper=[0.012, 0.02, {top}]"]
        settings = [f"object=[{shape}]", *area, "strategy.step=0.003", "strategy.find_ends=false"]
        try:
            run = explored("block", settings)
        except LwrprobeError as error:
            found.append(Finding(name, f"raised {type(error).__name__}: {error}", held=False))
            continue
        if not len(run.points):
            found.append(Finding(name, f"{run.ended}: not found", held=False))
            continue
        width = 1e3 * float(np.ptp(run.points[:, :2], axis=0).max())
        text = f"{run.describe()}; width measured {width:.2f} mm for {size:g} mm"
        found.append(within(name, text, abs(width - size), 0.5, "mm", also=run.within_limit))
    return found


def _thin_plate(quick: bool) -> list[Finding]:
    """The plate's faces are a quarter of a voxel apart."""
    run = strip("thin_plate")
    sides = [run.normals[:, 1] * sign > 0.9 for sign in (1.0, -1.0)]
    if not all(side.any() for side in sides):
        return [Finding("0.5 mm", f"{run.describe()}; one face only", held=False)]
    y = [float(np.median(run.points[side, 1])) for side in sides]
    text = f"{run.describe()}; faces measured {1e3 * (y[0] - y[1]):.3f} mm apart"
    return [within("0.5 mm", text, 1e3 * abs(y[0] - y[1] - 5e-4), 0.15, "mm", also=run.within_limit and _done(run))]


def _at_the_border(quick: bool) -> list[Finding]:
    """Half of the block is outside of the area: explored is what is inside, and the rest is said to be open."""
    run = explored(
        "block",
        ["area.lower=[-0.006, -0.06, 0.006]", "area.upper=[0.006, 0.0, 0.058]", "strategy.step=0.012", *LINES_ONLY],
    )
    beyond = 1e3 * float(max(run.path[:, 1].max(initial=0.0), 0.0))
    text = f"{run.describe()}; path beyond the border {beyond:.2f} mm"
    bounded = within("y < 0 of the block", text, beyond, 0.5, "mm", also=_done(run))
    sides = [side["side"] for side in run.summary["open_borders"]]
    words = f"open borders reported: {', '.join(sides) or 'none'}; the block is cut at -x, +x, +y"
    return [bounded, Finding("y < 0 of the block", words, sorted(sides) == ["+x", "+y", "-x"])]


def _nothing_there(quick: bool) -> list[Finding]:
    run = explored("empty", [])
    good = _done(run) and run.summary["contacts"] == 0 and "no contact" in run.summary["reason"]
    return [Finding("empty area", run.describe(), good)]


def _tilted_table(quick: bool) -> list[Finding]:
    run = strip("tilted_table")
    of_table = float((np.abs(run.distance) > 1e-3).mean())
    text = f"{run.describe()}; {100 * of_table:.1f} % of the contacts are the table's and stay among the object's"
    scraping = within(
        "3 deg", run.describe(), run.summary["peak_force_n"], run.scene.contact.limit, "N", also=_done(run)
    )
    return [scraping, within("3 deg", text, 100 * of_table, 1.0, "%")]


def _moving_object(quick: bool) -> list[Finding]:
    """What was touched before the object moved must not be merged with what was touched after."""
    found = []
    for mass in (0.05, 0.5) if quick else (0.05, 0.2, 0.5):
        run = strip("block", ["object.0.movable=true", f"object.0.mass={mass}"])
        setting = f"{1e3 * mass:g} g, foot friction 0.4"
        noticed = "moved" in run.summary["reason"]
        off = 1e3 * float(np.abs(run.distance).max(initial=0.0))
        if mass < 0.5:
            text = f"{run.describe()}; stored contact farthest off the first place"
            found.append(within(setting, text, off, 1.0, "mm", also=noticed and run.within_limit))
        else:
            text = f"{run.describe()}; it stood still; contact farthest off"
            found.append(within(setting, text, off, 0.5, "mm", also=_done(run)))
    return found


def _tipping_object(quick: bool) -> list[Finding]:
    """A thin tall thing goes over at the first touch; the run has to come to an end by itself, without a blow."""
    slab = "{ shape = 'box', size = [0.06, 0.006, 0.06], at = { xyz = [0.0, 0.0, 0.03] }, movable = true, mass = 0.02 }"
    run = strip("block", [f"object=[{slab}]", "drivers.sim.foot_friction=1.0"], top=0.068)
    ended = _done(run) or "moved" in run.summary["reason"]
    return [within("slab of 6 mm, 20 g", run.describe(), run.summary["peak_force_n"], run.scene.contact.limit, "N",
                   also=ended)]  # fmt: skip


def _tall_object(quick: bool) -> list[Finding]:
    """Holder and sensor come near the side of what is taller than the stick."""
    found = []
    for strategy in ("grid_version",) if quick else ("grid_version", "surface_contour", "orientation_change"):
        run = strip("stacked_blocks", [f"strategy.name='{strategy}'"])
        hits = run.summary["link_collisions"]
        least = run.summary["min_clearance_m"]
        text = f"{run.describe()}; {hits} collisions, nearest {1e3 * (least or 0.0):.2f} mm"
        found.append(within(strategy, text, float(hits), 0.0, "collisions", also=run.within_limit and _done(run)))
    return found


def _done(run: Run) -> bool:
    return run.summary["status"] == "done"


CASES = (
    Case(12, "very sharp edge", "apex within 0.5 mm, both sides, force below the limit", _sharp_edge),
    Case(13, "step down", "all steps touched, force below the limit", _cliff),
    Case(14, "inner edge, two contacts at once", "at most 2 % of the points off a wall", _inner_corner),
    Case(15, "slot narrower than the probe", "no surface claimed inside; bridged, width right", _narrow_slot),
    Case(16, "slot just wider than the probe", "no chatter, no jam", _wide_slot),
    Case(17, "overhang", "stick contact is not stored", _overhang),
    Case(18, "smaller than the probe", "found, size right", _tiny),
    Case(19, "thin wall from both sides", "two faces, kept apart", _thin_plate),
    Case(20, "object at the border of the area", "stays inside, open side marked", _at_the_border),
    Case(21, "empty area", "finishes and says so", _nothing_there),
    Case(22, "tilted table", "no scraping; table removed from the cloud", _tilted_table),
    Case(23, "moving object", "shift noticed, never merged silently", _moving_object),
    Case(24, "tipping object", "ends by itself, no blow", _tipping_object),
    Case(28, "holder near a tall object", "no collision", _tall_object),
)
