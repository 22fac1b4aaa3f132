"""The first motions one at a time, each only after the operator has allowed it, and none once a key is pressed."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable

import numpy as np

from lwrprobe.contracts import Done, Goal, Motion, SafetyStop, VelocityCommand

_HOLD = 0.1  # s, until the next look


class TypedLines:
    """Lines from standard input, one a call, without ever waiting for one."""

    def __init__(self) -> None:
        self._begun = b""
        self._ended = False

    def __call__(self) -> str | None:
        """The next line without its end, None when there is none; the end of input means no."""
        # Not readline: its buffer would hide a second line, typed to stop, from select.
        while b"\n" not in self._begun and not self._ended:
            try:
                ready, _, _ = select.select([sys.stdin], [], [], 0.0)
                if not ready:
                    return None
                typed = os.read(sys.stdin.fileno(), 4096)
            except (OSError, ValueError):
                typed = b""
            self._begun += typed
            self._ended = not typed
        if b"\n" not in self._begun:
            return "q"
        line, _, self._begun = self._begun.partition(b"\n")
        return line.decode("utf-8", "replace").strip()


class Confirm:
    """Stands between strategy and arm for the first motions.

    Until Enter is pressed the tip holds its place, while the loop and all guards go on. During a motion any line ends
    the run: the operator keeps a finger on Enter.

    Parameters
    ----------
    motions : how many are asked for; a goal is one, and so is a velocity until its reason changes
    message : shows a sentence
    typed : the line typed since the last call, None for none; standard input when left out
    """

    def __init__(
        self, motions: int, message: Callable[[str], None], typed: Callable[[], str | None] | None = None
    ) -> None:
        self.left = motions
        self._message, self._typed = message, typed or TypedLines()
        self._asked: tuple | None = None
        self._allowed: tuple | None = None

    def filter(self, motion: Motion) -> Motion:
        """The motion when it is allowed, else one that holds the tip where it is.

        Raises SafetyStop when the operator says no, or presses a key while the arm moves.
        """
        if isinstance(motion, Done):
            return motion
        kind = _kind(motion)
        if kind == self._allowed:
            self.watch()
            return motion
        if self.left <= 0:
            return motion
        if self.ask(kind, _described(motion)):
            return motion
        return VelocityCommand(np.zeros(3), _HOLD, "waiting for the operator")

    def ask(self, kind: tuple, what: str) -> bool:
        """Whether the operator has allowed it; asks once and never waits. Raises SafetyStop on a no."""
        if kind != self._asked:
            self._asked = kind
            self._message(f"next: {what}. Enter = go, and Enter again = stop; q = end here ({self.left} to confirm)")
        answer = self._typed()
        if answer is None:
            return False
        if answer:
            raise SafetyStop(f"the operator said {answer!r} to: {what}")
        self._allowed = kind
        self.left -= 1
        return True

    def watch(self) -> None:
        """Raises SafetyStop when a key is pressed while one of the first motions is under way."""
        if self._allowed is not None and self._typed() is not None:
            raise SafetyStop("the operator stopped the motion")


def _kind(motion: Goal | VelocityCommand) -> tuple:
    if isinstance(motion, Goal):
        return ("goal", *np.round(motion.pose[:3], 5).ravel().tolist())
    return ("velocity", motion.reason)


def _described(motion: Goal | VelocityCommand) -> str:
    why = f" ({motion.reason})" if motion.reason else ""
    if isinstance(motion, Goal):
        x, y, z = motion.pose[:3, 3]
        return f"straight to x {x:.3f}, y {y:.3f}, z {z:.3f} m at up to {motion.speed:.3f} m/s{why}"
    x, y, z = 1e3 * motion.velocity
    return f"on and on with {x:.1f}, {y:.1f}, {z:.1f} mm/s to begin with{why}"
