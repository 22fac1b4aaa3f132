"""Follow a contour: slide along a surface at the wanted force (Rau 2017, section 4.2.5, phase 1, figure 4.8)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lwrprobe.contracts import Confidence, Doubt, VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Jammed, Lost, Outcome, Overload
from lwrprobe_strategies.planning.contact_memory import POINT
from lwrprobe_strategies.planning.corner_watch import CornerWatch
from lwrprobe_strategies.planning.lines import DOWN, Z
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.inner_edge import InnerEdge
from lwrprobe_strategies.skills.release import release
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

PRESSED, HELD_BACK = 1.25, 0.5
"""Times the wanted force along the stick, from which on the tip goes along it more slowly, and how much more until it
goes no farther: there the probe is stiff, and a normal that is wrong by ten degrees leads into the surface faster than
the force law leads off it."""

MISLED = 0.4
"""Sine of the angle by which an imprecise normal may lead the sphere into the surface. Slower than that allows it would
stay stuck where the normal is imprecise because it sticks."""


@skill(Overload, CollisionThreat, Blocked, Jammed)
def follow_contour(tip: Tip, frame: TrackingFrame, until: Callable[[], Outcome | None]) -> Procedure:
    """Slide along what is touched, in the plane of the frame. An overlarge force is released, and the contour goes on.

    Parameters
    ----------
    frame : in which plane, and where the line ends
    until : called with every sample; the outcome with which the contour ends, None = go on

    Returns
    -------
    What `until` says, Ended.LINE_END, Ended.CEILING, Ended.SHAFT_CONTACT where a level contour has led the stick
    against something, or Lost with the point touched last
    """
    edge, corner = InnerEdge(tip.task.force_target), CornerWatch()
    binormal = frame.binormal
    while True:
        seen, here = tip.seen, tip.here
        met = edge.normal(seen)
        normal = tip.normal() if met is None else met
        contact = seen.contact
        if contact is not None and (tip.reliable or contact.confidence is not Confidence.NONE):
            tip.memory.add(here, contact.point, contact.normal, frame.grid_x)
        overload = False
        try:
            careful = frame.level and corner.rounds(here, tip.control.normal)
            motion = slide(tip, frame, normal, follow_contour.name, careful)
            yield motion
        except Overload:
            overload = True
        finally:
            if not tip.stick_touches:
                edge.watch(tip.seen, tip.control, binormal)
        if overload:
            released = yield from release(tip, frame)
            if released is not Ended.RELEASED:
                return released
            continue
        if frame.level and tip.stick_touches:
            return Ended.SHAFT_CONTACT
        if frame.past_end(tip.here):
            return Ended.LINE_END
        if frame.at_ceiling(tip.here) and leaves_upwards(tip, frame, motion):
            return Ended.CEILING
        outcome = until()
        if outcome is not None:
            return outcome
        if tip.seen.contact is None:
            return Lost(last_touched(tip, here, normal, met is not None))


def last_touched(tip: Tip, here: np.ndarray, normal: np.ndarray, met: bool) -> np.ndarray:
    """(3,) m, on the surface that the sphere at a place `here` (3,) touched with its normal (3,) before it was lost.

    A surface that was `met` beside another one, and is lost before it was touched alone, may have been none: then it is
    the contact before that.
    """
    radius = tip.task.probe.radius
    if met and len(tip.memory):
        before = tip.memory.contacts()[-1, POINT]
        if np.abs(before - here).max() < 2.0 * radius:
            return before.copy()
    return here - radius * normal


def leaves_upwards(tip: Tip, frame: TrackingFrame, motion: VelocityCommand) -> bool:
    """Whether the surface leads up, and what is left of the motion at the area's ceiling does not lead onward."""
    tangent = tip.control.tangent(frame.binormal)
    return tangent[Z] > 0.0 and float(motion.velocity @ tangent) <= 0.0


def slide(tip: Tip, frame: TrackingFrame, normal: np.ndarray, reason: str, careful: bool = False) -> VelocityCommand:
    """Along the tangent, and along the normal (3,) by the force law; with care where the stick may be met."""
    seen, binormal = tip.seen, frame.binormal
    speed = sliding_speed(tip, frame, np.array(tip.control.tangent(binormal)), careful)
    force = max(float(seen.force.dot(normal)), 0.0)
    velocity = tip.control.velocity(normal, force, binormal, speed, seen.pose[:3, :3], tip.period)
    velocity = frame.guided(tip.here, velocity, tip.control.normal)
    return VelocityCommand(held_back(tip, velocity), reason=reason, pose=tip.turn())


def sliding_speed(tip: Tip, frame: TrackingFrame, onward: np.ndarray, careful: bool) -> float:
    """m/s along the tangent `onward` (3,) unit; with care where the stick may be met."""
    speed, contact = tip.task.contour_speed, tip.seen.contact
    if not tip.reliable:
        # The stick may be what touches, and above the sphere nothing is known then.
        slow = tip.control.approach_speed(DOWN, tip.seen.pose[:3, :3])
        imprecise = (
            contact is not None and contact.reason is Doubt.IMPRECISE and contact.confidence > Confidence.DOUBTFUL
        )
        speed = min(speed, slow / MISLED if imprecise else slow)
    if frame.level:
        speed = min(speed, tip.level_limit(onward))
    if careful:
        speed = min(speed, tip.control.stick_speed(tip.overhangs.reach(tip.here)))
    speed = min(speed, tip.climb_limit(onward))
    return min(speed, tip.stick_limit(onward)) if tip.stick_may_meet else speed


def held_back(tip: Tip, velocity: np.ndarray) -> np.ndarray:
    """(3,) m/s, of which what leads along the stick is slower the more the tip presses along it.

    It begins at what a first touch allows: a loop that reacts late is held back earlier.
    """
    held, wanted = tip.seen.pose[:3, :3], tip.task.force_target
    ahead = held[:, Z]
    inwards, over = float(velocity @ ahead), -float(tip.seen.force @ ahead) / wanted - PRESSED
    if inwards <= 0.0 or over <= 0.0:
        return velocity
    most = tip.control.approach_speed(ahead, held) * max(1.0 - over / HELD_BACK, 0.0)
    return velocity - max(inwards - most, 0.0) * ahead
