"""What a run must not leave unsaid: sentences for the user of its result."""

from __future__ import annotations

from lwrprobe.evaluation.summary import Summary

REJECTED = 0.10
"""Share of the touches that may be rejected without a word."""
NOISY = 1.5
"""Times the stated noise that the sensor may have at rest. Readings of 0.5 s or more tell it to a few percent."""
DISAGREE = 1.5
"""Times two standard deviations: of nine numbers of a sensor that is as stated, one passes two in a fifth of all runs,
and three in a hundredth."""
LOST = 0.01
"""The same of the wrench samples that never came."""
LATE = 0.01
"""The same of the set points that came too late for their cycle."""

ANOTHER_WORLD = (
    "the emulated devices stand in another world than this scene's: start them with the same scene, --seed and --set"
)
"""Pages and evaluations that are made of the run folder later would show the scene's."""


def run_warnings(summary: Summary, limit: float) -> list[str]:
    """Sentences on a summary that is otherwise complete; `limit` is the force limit [N]."""
    found = []
    if summary.status == "done" and summary.contacts == 0:
        found.append("nothing was touched: the area is empty, or the object stands outside of it")
    share = summary.rejected_share
    if share is not None and share > REJECTED:
        found.append(f"{share:.1%} of the touches were rejected as not certain enough; at most {REJECTED:.0%} is usual")
    noise = summary.noise_at_rest or {}
    if noise.get("over_stated", 1.0) > NOISY:
        found.append(
            f"the sensor is {noise['over_stated']:.1f} times as noisy at rest as [probe] states: its contacts are less "
            "certain; check its cables, supply and what vibrates near it"
        )
    torque = summary.torque or {}
    if torque.get("over_expected", 1.0) > DISAGREE:
        found.append(
            f"torque and force disagree by {torque['disagreement']:.1%}, more than [uncertainty] states: run lwrprobe "
            "calibrate, or state a larger uncertainty"
        )
    slope = (summary.stillness or {}).get("torque_disagreement", 0.0)
    if slope > 0.0:
        found.append(f"torque and force disagree by {slope:.0%} on the way of the sphere: calibrate the sensor")
    found += summary.force_control.get("warnings", [])
    peak = summary.true_peak_force_n
    if peak is not None and peak > limit:
        found.append(f"the probe pressed with up to {peak:.2f} N, the limit is {limit:g} N")
    if summary.link_collisions:
        times = "once" if summary.link_collisions == 1 else f"{summary.link_collisions} times"
        found.append(f"a link behind the stick hit something {times}; the force of that is not known")
    counters = summary.wrench_counters
    lost, came = counters.get("lost", 0), counters.get("samples", 0)
    if lost > LOST * (lost + came):
        found.append(f"{lost / (lost + came):.1%} of the wrench samples were lost")
    for name, counts in summary.devices.items():
        late, cycles = counts.get("late_set_points", 0), counts.get("received", 0)
        if late > LATE * cycles:
            found.append(f"{late / cycles:.1%} of the set points for {name} came too late; `lwrprobe doctor` says why")
    if summary.reentries:
        times = "once" if summary.reentries == 1 else f"{summary.reentries} times"
        found.append(f"the arm stopped by itself and was set in motion again {times}; `interruptions` says why")
    if summary.area_raised_mm:
        by = summary.area_raised_mm
        found.append(f"the object reaches higher than the area: the area's upper end was raised by {by:g} mm")
    if summary.unreachable_area:
        found.append(summary.unreachable_area)
    return found
