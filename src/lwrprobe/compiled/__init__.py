"""The decorators for numba kernels.

`pipeline` says how a kernel is compiled, `disk_cache` when it has to be compiled again, and `interrupts` what Ctrl-C
does meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, overload

import numba
from numba.core.options import DefaultOptions

from lwrprobe.compiled import pipeline
from lwrprobe.compiled.disk_cache import make_safe
from lwrprobe.compiled.interrupts import interrupts_held

Body = TypeVar("Body", bound=Callable[..., Any])
"""A kernel keeps the signature of the function that it is made from."""


@overload
def kernel(function: Body, **options: Any) -> Body: ...
@overload
def kernel(function: None = None, **options: Any) -> Callable[[Body], Body]: ...
def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`numba.njit` with the options of this project: cached on disk, no fast-math, no Python errors for arithmetic.

    Kernels take plain float64 / int64 arrays and scalars, check nothing, raise nothing, and return a status where
    they can fail. One whose name begins with an underscore is called by kernels alone, not from Python.
    """

    def wrap(body: Callable[..., Any]) -> Any:
        # Nothing here passes a kernel on as a C function.
        chosen = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True, **options}
        if hasattr(DefaultOptions, "_nrt"):
            # Set for each kernel: otherwise it takes the value of whichever caller compiled it first.
            chosen.setdefault("_nrt", True)
        else:  # private to numba; without it all kernels work, only slower
            chosen.pop("_nrt", None)
        private = body.__name__.startswith("_")
        if not pipeline.SUPPORTED:
            return _dispatcher(body, no_cpython_wrapper=private, **chosen)
        inner = _dispatcher(
            body if private else _renamed(body, ".inner"),
            no_cpython_wrapper=True,
            pipeline_class=pipeline.InnerCompiler,
            **chosen,
        )
        made = inner if private else _dispatcher(body, pipeline_class=pipeline.EntryCompiler, **chosen)
        if hasattr(made, "get_call_template"):  # a plain function while numba is switched off
            pipeline.prefer_inner(made, inner)
        return made

    return wrap if function is None else wrap(function)


def _dispatcher(body: Callable[..., Any], **options: Any) -> Any:
    made = numba.njit(**options)(body)
    make_safe(made)
    if hasattr(made, "compile"):  # a plain function while numba is switched off
        made.compile = interrupts_held()(made.compile)
    return made


def _renamed(body: Callable[..., Any], suffix: str) -> Any:
    """The same function under another qualified name, so that its cache files and symbols have another name."""
    assert isinstance(body, FunctionType)
    copy = FunctionType(body.__code__, body.__globals__, body.__name__, body.__defaults__, body.__closure__)
    copy.__module__, copy.__qualname__ = body.__module__, body.__qualname__ + suffix
    return copy


@overload
def allocation_free_kernel(function: Body, **options: Any) -> Body: ...
@overload
def allocation_free_kernel(function: None = None, **options: Any) -> Callable[[Body], Body]: ...
def allocation_free_kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """A `kernel` that makes no array. References to the arrays it is given, and to their views, are not counted.

    Counting costs two atomic operations for each view, and some 0.1 us for each array in a call from Python. In a
    kernel that cuts one array of state into many views this takes as long as the arithmetic. A kernel that makes an
    array does not compile with this decorator. A `kernel` must not take an array as a result from such a kernel: it
    would release a reference that was never taken.
    """
    return kernel(_nrt=False, **options) if function is None else kernel(function, _nrt=False, **options)


def entry(function: Any, *examples: Any) -> Callable:
    """A kernel's machine code for arguments like the examples: a call skips the look-up of types, 0.1 us an array.

    Numbers are converted as Python does, but an array of another type or dimension ends the process. Use it only for
    calls whose arrays are right by construction.
    """
    compiled = getattr(function, "compile", None)  # there is none while numba is switched off
    return function if compiled is None else compiled(tuple(numba.typeof(example) for example in examples))
