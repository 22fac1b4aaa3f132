"""The typed errors of the library: one root, one branch for each package that needs its own.

Every error carries a sentence that names the field, the value and what was allowed. The command line
prints that sentence and nothing else; only `LwrprobeError` and its children are ever expected there.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class LwrprobeError(Exception):
    """Root of all errors that lwrprobe raises on purpose."""


class InputError(LwrprobeError, ValueError):
    """A value given by the user is not acceptable.

    Parameters
    ----------
    field : the name of the value, as the user knows it (`"pose"`, `"probe.radius"`)
    value : what was given
    allowed : what would have been accepted, in words
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        self.field = field
        self.value = value
        self.allowed = allowed
        super().__init__(f"{field}: got {_brief(value)}; allowed: {allowed}")

    def __reduce__(self) -> tuple[type, tuple[str, object, str]]:
        return type(self), (self.field, self.value, self.allowed)


class UnknownNameError(InputError):
    """A name is not among the known ones; the message lists them and the nearest match."""

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        self.kind = kind
        self.known = sorted(known)
        near = nearest(name, self.known)
        allowed = ", ".join(self.known) if self.known else f"(no {kind} is known)"
        if near:
            allowed += f" (did you mean {near!r}?)"
        super().__init__(kind, name, allowed)

    def __reduce__(self) -> tuple[type, tuple]:
        return type(self), (self.field, self.value, self.known)


class SceneError(InputError):
    """A scene file cannot be used."""


class FormatError(LwrprobeError, ValueError):
    """A file is not what its ending or header says; the message names the file and the place."""


class MissingExtraError(LwrprobeError, ImportError):
    """An optional library is needed for this and is not installed."""

    def __init__(self, what: str, library: str, extra: str) -> None:
        self.what, self.library, self.extra = what, library, extra
        super().__init__(
            f"{what} needs the library {library!r}, which is not installed; "
            f"get it with: pip install 'lwrprobe[{extra}]'"
        )

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return type(self), (self.what, self.library, self.extra)


class StorageError(LwrprobeError):
    """A file cannot be written: the disk is full, the folder is gone or read-only.

    Parameters
    ----------
    place : file or folder
    error : what the system says
    """

    def __init__(self, place: object, error: OSError) -> None:
        self.place, self.error = place, error
        super().__init__(f"{place}: cannot be written: {error.strerror or error}; what was written so far is kept")

    def __reduce__(self) -> tuple[type, tuple]:
        return type(self), (self.place, self.error)


class PluginError(LwrprobeError):
    """A plug-in failed; the message names the plug-in."""


class DriverError(LwrprobeError):
    """A device, or the line to it, failed."""


class ConnectionLost(DriverError):
    """The device stopped answering, or never answered."""


class DeviceRefused(DriverError):
    """The device answered and refused what was asked."""


class MotionInterrupted(DriverError):
    """The arm has stopped by itself and takes no set points until it is asked to again.

    Parameters
    ----------
    reason : one sentence
    unasked : motion may begin again without the operator; False where somebody, or a limit, has stopped the arm
    """

    def __init__(self, reason: str, unasked: bool) -> None:
        self.reason, self.unasked = reason, unasked
        super().__init__(reason)

    def __reduce__(self) -> tuple[type, tuple[str, bool]]:
        return type(self), (self.reason, self.unasked)


class SafetyStop(LwrprobeError):
    """A guard stopped the arm; the message says which limit and by how much."""


def nearest(name: object, known: Iterable[str]) -> str | None:
    """The known name that was probably meant: spelt alike, or the only one that holds what was typed."""
    typed, known = str(name).lower(), list(known)
    alike = get_close_matches(typed, known, n=1)
    if alike:
        return alike[0]
    holding = [one for one in known if len(typed) > 1 and typed in one.lower()]
    return holding[0] if len(holding) == 1 else None


def _brief(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 120 else text[:117] + "..."
