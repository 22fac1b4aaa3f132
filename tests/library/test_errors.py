"""Errors go through a process's border, as from the worker of a sweep, and say the same on the other side."""

import errno
import pickle

import pytest

from lwrprobe.errors import InputError, MissingExtraError, MotionInterrupted, StorageError, UnknownNameError


@pytest.mark.parametrize(
    "error",
    [
        InputError("probe.radius", -1.0, "a positive length"),
        UnknownNameError("scene", "blok", ["block"]),
        MissingExtraError("a film .mp4", "imageio-ffmpeg", "film"),
        StorageError("run", OSError(errno.ENOSPC, "No space left on device")),
        MotionInterrupted("the brakes are on", unasked=False),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_is_the_same_in_another_process(error):
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert set(vars(back)) == set(vars(error))
