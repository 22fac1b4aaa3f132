"""The one decorator for numba kernels.

numba's on-disk cache looks at the file of the kernel alone: when a kernel in another file that it calls has
changed, it would go on with the old machine code. `kernel` stamps each cache entry with the state of all kernel files
that the kernel's own file imports, directly or through others, so that a change in any of them recompiles what may
depend on it, and nothing else.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, overload
from zlib import crc32

import numba
from numba.core.options import DefaultOptions

Body = TypeVar("Body", bound=Callable[..., Any])
"""A kernel keeps the signature of the function that it is made from."""


@overload
def kernel(function: Body, **options: Any) -> Body: ...
@overload
def kernel(function: None = None, **options: Any) -> Callable[[Body], Body]: ...
def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`numba.njit` with the options of the house: cached on disk, no fast-math, errors as in Python off.

    Kernels take plain float64 / int64 arrays and scalars, check nothing, raise nothing, and return a status where
    they can fail.
    """

    def wrap(body: Callable) -> Any:
        if body.__name__.startswith("_"):
            # Called by kernels alone: without the way in from Python it compiles faster.
            options.setdefault("no_cpython_wrapper", True)
        # Nobody hands a kernel over as a C function.
        options.setdefault("no_cfunc_wrapper", True)
        if hasattr(DefaultOptions, "_nrt"):
            # Said for each, lest a kernel takes it from whichever called it first and the disk cache keeps that.
            options.setdefault("_nrt", True)
        else:  # private to numba; without it all kernels work, only slower
            options.pop("_nrt", None)
        dispatcher = numba.njit(cache=True, error_model="numpy", **options)(body)
        _stamp(dispatcher)
        return dispatcher

    return wrap if function is None else wrap(function)


@overload
def view_kernel(function: Body, **options: Any) -> Body: ...
@overload
def view_kernel(function: None = None, **options: Any) -> Callable[[Body], Body]: ...
def view_kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`kernel` for one that makes no array: its views of the caller's are not counted.

    To count them costs two atomic operations a view, as much as all else together where kernels cut one array of state
    into many, and some 0.1 us an array in a call from Python. One that makes an array does not compile. A `kernel` must
    not take an array as a result from such a one: it would give back what was never taken.
    """
    return kernel(_nrt=False, **options) if function is None else kernel(function, _nrt=False, **options)


def entry(function: Any, *examples: Any) -> Callable:
    """A kernel's machine code for arguments like the examples: a call saves looking up the types, 0.1 us an array.

    Nothing else is saved. Numbers are converted as Python does, but an array of another type or dimension ends the
    process: only for calls whose arrays are right by construction.
    """
    compiled = getattr(function, "compile", None)  # there is none while numba is switched off
    return function if compiled is None else compiled(tuple(numba.typeof(example) for example in examples))


def _stamp(dispatcher: Any) -> None:
    # The attribute is private to numba; without it the cache still works, only less carefully.
    index = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if index is not None and hasattr(index, "_source_stamp"):
        index._source_stamp = (index._source_stamp, _state_below(dispatcher.py_func.__module__))


@cache
def _state_below(module: str) -> int:
    """Check sum over the kernel files that a module imports. Its imports stand above its first kernel."""
    states = []
    for name in sorted(_imported_kernels(module)):
        file = Path(sys.modules[name].__file__ or "")
        found = file.stat()
        states.append(f"{name} {found.st_mtime_ns} {found.st_size} {_state_below(name)}")
    return crc32("\n".join(states).encode())  # not hash(): that differs from process to process


def _imported_kernels(module: str) -> set[str]:
    names = set()
    for value in vars(sys.modules[module]).values():
        if hasattr(value, "py_func"):
            names.add(value.py_func.__module__)
        elif isinstance(value, type(sys)):
            names.add(value.__name__)
    return {name for name in names if "kernels" in name and name != module}
