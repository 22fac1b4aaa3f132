"""How numba compiles a kernel here: callees are kept as LLVM code, only what Python calls becomes machine code.

numba optimises a function together with everything it calls and emits machine code for it, then does both again for
each caller. In a chain of ten kernels the innermost one is optimised and emitted ten times. Here a kernel that is
called by another kernel is lowered to LLVM code and stored; optimisation and emission take place once, in the kernel
that is called from Python. LLVM keeps the order of floating-point operations, so the results are the same bits.

While a kernel is compiled, numba does less over and over: see `_lean`.

This stands on parts of numba that are not public. `SUPPORTED` is False where a version of numba lacks one of them;
`lwrprobe.compiled.kernel` then compiles as `numba.njit` does, which takes about twice as long.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import BuiltinFunctionType, CodeType
from typing import Any, cast

import llvmlite.binding as llvm
import numba

try:
    from llvmlite.binding import ffi
    from numba.core import event
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder, Flags
    from numba.core.compiler_machinery import PassManager
    from numba.core.targetconfig import ConfigStack
    from numba.core.typed_passes import NopythonRewrites
    from numba.core.types import Function, Number
    from numba.core.untyped_passes import InlineClosureLikes

    SUPPORTED = all(
        hasattr(JITCodeLibrary, name)
        for name in ("_optimize_functions", "_optimize_final_module", "_finalize_final_module")
    ) and hasattr(ffi.lib._lock, "_cblist")
except (ImportError, AttributeError):  # another version of numba
    SUPPORTED = False

_ENVIRONMENT = "_ZN08NumbaEnv"
"""Prefix of the global variable that numba sets for each function, whether the function is emitted or not."""

_listeners: list[Callable[[str], None]] = []


@contextmanager
def on_compilation(listener: Callable[[str], None]) -> Iterator[None]:
    """Call `listener` with the qualified name of each kernel that has been compiled, while the block runs."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


@contextmanager
def collector_paused() -> Iterator[None]:
    """No garbage collection in the block.

    The types and IR that numba makes are many and live long: the garbage collector took a tenth of the time. Around a
    single kernel the pause saves a part of that alone: the collection after it looks through all that was made.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def prefer_inner(dispatcher: Any, inner: Any) -> None:
    """Calls of `dispatcher` by kernels use `inner`, compiled for the types of the arguments and not for their values.

    numba makes a specialisation for each integer literal; LLVM propagates the constants in any case.
    """
    resolve = inner.get_call_template
    unliteral = numba.types.unliteral

    def get_call_template(args: Any, keywords: Any) -> Any:
        return resolve([unliteral(arg) for arg in args], {name: unliteral(arg) for name, arg in keywords.items()})

    dispatcher.get_call_template = get_call_template
    dispatcher.get_overload = inner.get_overload


if SUPPORTED:

    class _Library(JITCodeLibrary):
        counts_references = True

    class _InnerLibrary(_Library):
        """LLVM code of a kernel that kernels call. It is not optimised as a whole, and no machine code is made."""

        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            self._own: list[str] = []

        def add_ir_module(self, ir_module: Any) -> None:
            module = _parsed(ir_module)
            module.data_layout = self._codegen._data_layout
            passes, builder = _function_passes(self._codegen)
            for function in ir_module.functions:
                if not function.is_declaration:
                    passes.run(module.get_function(function.name), builder)
                    self._own.append(function.name)
            self._final_module.link_in(module)

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            module = self._final_module
            for name in self._own:
                function = module.get_function(name)
                if function.linkage == llvm.Linkage.external:
                    function.linkage = "linkonce_odr"  # each caller gets its own copy
            self._shared_module = module
            # numba sets the environments of a loaded library by address, so these variables alone are emitted.
            names = [v.name for v in module.global_variables if v.name.startswith(_ENVIRONMENT)]
            text = [str(self._codegen._create_empty_module(self.name))]
            text += [f'@"{name}" = common global i8* null' for name in names]
            self._final_module = llvm.parse_assembly("\n".join(text))
            super()._finalize_final_module()

    class _EntryLibrary(_Library):
        """Machine code of a kernel that Python calls, optimised once together with all its callees."""

        def add_ir_module(self, ir_module: Any) -> None:
            module = _parsed(ir_module)
            # The optimisation of the module contains that of its functions.
            module.data_layout = self._codegen._data_layout
            self._final_module.link_in(module)

        def _optimize_final_module(self) -> None:
            if self.counts_references:
                super()._optimize_final_module()
            else:  # numba's first round of passes brings the counting of references together
                passes, builder = self._codegen._module_pass_manager()
                passes.run(self._final_module, builder)

    def _parsed(ir_module: Any) -> Any:
        module = llvm.parse_assembly(str(ir_module).encode("utf-8").decode("latin1"))  # as numba writes other letters
        module.name = ir_module.name
        return module

    @cache
    def _function_passes(codegen: Any) -> tuple[Any, Any]:
        return codegen._function_pass_manager()

    class _Flags(Flags):
        """Compiler options that are hashed once. numba looks them up with every operation that it types."""

        __slots__ = ("_hash", "_snapshot")

        def __init__(self, copy_from: Any = None) -> None:
            super().__init__(copy_from)
            self._snapshot = super().values()
            self._hash = super().__hash__()

        def __hash__(self) -> int:
            return self._hash

        def __eq__(self, other: object) -> bool:
            return self is other or super().__eq__(other)

        def values(self) -> dict[str, Any]:
            return self._snapshot if hasattr(self, "_snapshot") else super().values()

    _flags: dict[str, _Flags] = {}

    class _Passes(PassManager):
        def run(self, state: Any) -> None:
            flags = _flags.setdefault(state.flags.summary(), _Flags(state.flags))
            with collector_paused(), _lean(state), ConfigStack().enter(flags):
                super().run(state)
                for listener in _listeners:
                    listener(state.func_id.func_qualname)

    @contextmanager
    def _lean(state: Any) -> Iterator[None]:
        """Leave out what numba does over and over. Its lock keeps other compilations out meanwhile."""
        typing = state.typingctx
        if "resolve_function_type" in vars(typing):  # a kernel is compiled because another one calls it
            yield
            return
        lock, default = ffi.lib._lock, cast(Any, Compiler)
        callbacks, define = lock._cblist, default.define_pipelines
        try:
            if all(isinstance(listener, event.TimingListener) for listener in event._registered["numba:llvm_lock"]):
                lock._cblist = []  # events with each call of LLVM
            default.define_pipelines = _define_inner
            typing.resolve_function_type = _remembering(typing)
            yield
        finally:
            vars(typing).pop("resolve_function_type", None)
            default.define_pipelines, lock._cblist = define, callbacks

    class _Compiler(CompilerBase):
        library: type[_Library]

        def define_pipelines(self) -> list[PassManager]:
            state = self.state
            if state.library is None:
                state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
                state.library.enable_object_caching()
            passes = _Passes("nopython")
            passes.passes = DefaultPassBuilder.define_nopython_pipeline(state).passes
            if not any(isinstance(constant, CodeType) for constant in state.func_id.code.co_consts):
                # No closure and no comprehension: the search for them took 2 % of the time.
                passes.passes = [entry for entry in passes.passes if entry[0] is not InlineClosureLikes]
            if not state.flags.nrt:  # no array is made: no expression of arrays is there to be fused
                passes.passes = [entry for entry in passes.passes if entry[0] is not NopythonRewrites]
                state.library.counts_references = False
            passes.finalize()
            return [passes]

    _BUILT_IN = Function, BuiltinFunctionType
    _scalar_calls: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    def _remembering(context: Any) -> Callable[[Any, Any, Any], Any]:
        """The typing of calls, which is repeated often, with that of functions of numbers looked up once."""
        resolve = type(context).resolve_function_type

        def resolve_function_type(function: Any, args: Any, keywords: Any) -> Any:
            if keywords or not isinstance(function, _BUILT_IN) or not all(isinstance(arg, Number) for arg in args):
                return resolve(context, function, args, keywords)
            key = (id(function), *args)
            found = _scalar_calls.get(key)
            if found is None:
                found = _scalar_calls[key] = function, resolve(context, function, args, keywords)
            return found[1]

        return resolve_function_type

    def _define_inner(self: Any) -> list[PassManager]:
        """numba's own functions that kernels call are kept as LLVM code, too."""
        state = self.state
        if state.flags.no_cpython_wrapper and state.func_id.modname.startswith("numba."):
            state.library = _InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
        return _define(self)

    _define = Compiler.define_pipelines

    class InnerCompiler(_Compiler):
        """Compiles a kernel for its callers."""

        library = _InnerLibrary

    class EntryCompiler(_Compiler):
        """Compiles a kernel for calls from Python."""

        library = _EntryLibrary
