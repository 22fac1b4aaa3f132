"""Follow a contour, and seek a contact that was lost around the point touched last."""

from __future__ import annotations

from collections.abc import Callable

from lwrprobe_strategies.outcomes import Ended, Lost, Outcome
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.follow_contour import follow_contour
from lwrprobe_strategies.skills.reapproach import reapproach
from lwrprobe_strategies.skills.skill import Procedure
from lwrprobe_strategies.tip import Tip


def follow_and_regain(
    tip: Tip, frame: TrackingFrame, until: Callable[[], Outcome | None], distance: float
) -> Procedure:
    """Both skills in turn, until one of them ends otherwise; no entry of its own in the trace.

    Parameters
    ----------
    frame, until : as of `follow_contour`
    distance : m of path, after which a lost contact is given up

    Returns
    -------
    What `follow_contour` returns, but never Lost, or how `reapproach` failed
    """
    while True:
        end = yield from follow_contour(tip, frame, until)
        if not isinstance(end, Lost):
            return end
        end = yield from reapproach(tip, frame, end.point, distance)
        if end is not Ended.CONTACT:
            return end
