"""Parts, kernels that other kernels call, and the compilation of one call from Python to machine code.

By default numba optimises a kernel, turns it into machine code, and does both again, with all that it calls, in every caller:
code that lies five levels deep goes five times through LLVM. Here a kernel that kernels call is a `Part`: its code stays as
LLVM's passes over single functions leave it, is kept on disk like that, and is optimised and turned into machine code once, in
the kernel that Python calls.
"""
from __future__ import annotations

import gc
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numba.np.linalg as _linalg
from llvmlite import binding
from llvmlite.binding import ffi

# at its start numba looks for SciPy's BLAS, which takes a tenth of a second to import; kernels call no BLAS, and other code that
# does finds it later
_look = _linalg.ensure_blas
_linalg.ensure_blas = lambda: None
import numba.np.arraymath  # noqa: E402, F401

_linalg.ensure_blas = _look

from numba import version_info  # noqa: E402
from numba.core import compiler, sigutils, types, typing
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock

from fastbeam.kernels.jit import background as _background
from fastbeam.kernels.jit import separate as _separate
from fastbeam.kernels.jit.separate import WholeCache as WholeCache
from fastbeam.kernels.jit.sources import classes_of, is_outside

# s; compilation that takes no longer shows nothing on a terminal, elsewhere five times as long
QUIET_TIME = 1.0
# kernels that take long: their purpose in words, and how many parts they had in common scenes, between 80 and 110
STAGES = {"run": ("the time steps", 95), "solve_equilibrium": ("equilibria", 107), "assemble_all": ("the equations", 63)}
# time that machine code of a whole kernel takes, as a share of that of its parts
MACHINE_CODE = 0.2
# versions of numba before these have another interface to the passes of LLVM
PASS_BUILDERS = version_info.short >= (0, 62)


class _CodeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Library of a kernel that becomes machine code: all linked code is optimised together, once. Kernels keep no reference
    counts, so the passes that pair these are left out; calls: kernels with machine code of their own that it calls."""

    calls: list[Any] = []

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        if PASS_BUILDERS:
            passes, builder = self._codegen._module_pass_manager()
            passes.run(self._final_module, builder)
            ffi.lib.LLVMPY_DisposeNewModulePassManger(passes)
        else:
            super()._optimize_final_module()
        self.calls = _separate.called_in(self._final_module)

    def serialize_using_object_code(self) -> tuple[str, str, tuple[Any, bytes]]:
        """Return machine code, with the names that it defines in place of the LLVM code that numba keeps for callers: kernels
        call the part. To read that code took a twentieth of the time of a warm start."""
        self._ensure_finalized()
        module = self._final_module
        lines = [f'define void @"{x.name}"() {{ ret void }}' for x in module.functions if not x.is_declaration]
        lines += [f'@"{x.name}" = global i8 0' for x in module.global_variables if not x.is_declaration]
        return self.name, "object", (self._get_compiled_object(), binding.parse_assembly("\n".join(lines)).as_bitcode())


class _WholeLibrary(_CodeLibrary):
    """Library of a kernel that Python calls."""

    def _optimize_final_module(self) -> None:
        PROGRESS.machine_code()
        super()._optimize_final_module()


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Library of a kernel that kernels call: simplified one function at a time, and linked."""

    def _optimize_functions(self, ll_module: Any) -> None:
        if not PASS_BUILDERS:
            super()._optimize_functions(ll_module)
            return
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)
                # llvmlite does not free the passes: 32 MB for each kind of scene
                ffi.lib.LLVMPY_DisposeNewFunctionPassManger(passes)

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._set_module(self._final_module)
        self.calls = _separate.called_in(self._final_module)

    def _set_module(self, module: Any) -> None:
        """Set the code of the library; several kernels that bring the same part along may be linked."""
        for function in module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = "linkonce_odr"
        self._final_module = self._shared_module = module
        self._finalize_dynamic_globals()
        self._finalized = True


_KNOWN: dict[Any, Any] = {}
_look_up = types.BaseFunction.get_call_type


def _remember(self: Any, context: Any, arguments: Any, keywords: Any) -> Any:
    """Return the signature of a call of an operator or function of numba. Types that are equal are one object, which the key
    keeps alive with the implementations that it has found."""
    if keywords:
        return _look_up(self, context, arguments, keywords)
    key = self, arguments
    if key not in _KNOWN:
        _KNOWN[key] = _look_up(self, context, arguments, keywords)
    return _KNOWN[key]


@contextmanager
def memoized_typing() -> Iterator[None]:
    """Compile without the garbage collector, which takes a seventh of the time and finds little, and with signatures of operators
    remembered: numba tries all their overloads anew at every call with the same types, which takes a tenth of the time."""
    before = gc.isenabled()
    gc.disable()
    types.BaseFunction.get_call_type, looked_up = _remember, types.BaseFunction.get_call_type
    try:
        yield
    finally:
        types.BaseFunction.get_call_type = looked_up
        if before:
            gc.enable()


class _Progress:
    """Display of progress while a kernel is compiled with all its parts: on a terminal one line that is kept up to date, else,
    after the announcement of a first use, a line at the end of the first kernel that took long.

    For kernels in `STAGES` the line says their purpose, an estimate of the number of parts, and of the time left.
    """

    def __init__(self) -> None:
        self.announced = False
        self.count = 0
        self._name = ""
        self._begin = 0.0
        # characters of the line on the terminal
        self._shown = 0

    def of(self, name: str) -> _Progress:
        """Return the display, as a context while the kernel of this name is compiled."""
        self._name = name
        return self

    def __enter__(self) -> None:
        self.count, self._begin, self._shown = 0, time.perf_counter(), 0

    def __exit__(self, *failed: object) -> None:
        if self._shown or (self.announced and self._seconds() > 5.0 * QUIET_TIME):
            self._write(self._done(), "\n")
            self.announced = False
        self._name = ""

    def step(self) -> None:
        """Count one more part that is ready."""
        self.count += 1
        self._show(self._parts())

    def machine_code(self) -> None:
        """Show that all parts are ready: they are optimised together and become machine code."""
        if self._name in STAGES:
            self._show(f"compiling {STAGES[self._name][0]}: machine code of {self.count} kernels"
                       f"{_about(MACHINE_CODE * self._seconds())}")

    def _parts(self) -> str:
        purpose, many = STAGES.get(self._name, ("", 0))
        if self.count >= many:
            return self._done()
        left = self._seconds() * ((1.0 + MACHINE_CODE) * many / self.count - 1.0)
        return f"compiling {purpose}: {self.count} of about {many} kernels{_about(left)}"

    def _done(self) -> str:
        purpose = f" for {STAGES[self._name][0]}" if self._name in STAGES else ""
        return f"compiling kernels{purpose}, {self.count} in {self._seconds():.0f} s"

    def _seconds(self) -> float:
        return time.perf_counter() - self._begin

    def _show(self, text: str) -> None:
        if (self._seconds() > QUIET_TIME and os.environ.get("FASTBEAM_PROGRESS") != "0" and sys.stderr is not None
                and sys.stderr.isatty()):
            self._write(text, "")

    def _write(self, text: str, after: str) -> None:
        # blanks over the rest of a longer line
        sys.stderr.write(("\r" if self._shown or not after else "") + f"fastbeam: {text}".ljust(self._shown) + after)
        sys.stderr.flush()
        self._shown = len(text) + 10


def _about(seconds: float) -> str:
    """Return ', about so many s left', rounded so that it does not flicker; nothing below a second."""
    return f", about {seconds:.0f} s left" if 1.0 <= seconds < 600.0 else ""


PROGRESS = _Progress()


# passes of numba for features that kernels do not use: `with`, closures, lists of literals, inlining of Python, expressions
# of whole arrays, exceptions, parallel loops
LEFT_OUT = {"WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction", "InlineInlinables",
            "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass", "NopythonRewrites",
            "DumpParforDiagnostics"}


class _ShortCompiler(compiler.Compiler):  # type: ignore[misc]
    """Numba's compiler without passes that have nothing to do in kernels, and without the analysis that follows each of them."""

    def define_pipelines(self) -> list[Any]:
        out = []
        for full in super().define_pipelines():
            short = compiler.PassManager(full.pipeline_name)
            pruned = False
            for step, text in full.passes:
                # dead branches are looked for three times, for the sake of passes that are left out
                if step.__name__ not in LEFT_OUT and not (pruned and step.__name__ == "DeadBranchPrune"):
                    short.add_pass(step, text)
                pruned |= step.__name__ == "DeadBranchPrune"
            short.finalize()
            out.append(short)
        return out


class WholeCompiler(_ShortCompiler):
    """Compiler for a kernel that Python calls."""

    def define_pipelines(self) -> list[Any]:
        return compiler.Compiler.define_pipelines(self) if is_outside(self.state.func_id.func) else super().define_pipelines()

    def compile_extra(self, function: Any) -> Any:
        self.state.library = _WholeLibrary(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        with memoized_typing(), PROGRESS.of(function.__name__):
            return super().compile_extra(function)


class _Compiled:
    """Part compiled for one set of argument types.

    library : _PartLibrary or JITCodeLibrary
        Library that callers link; the code itself for a kernel with machine code of its own.
    symbol : str
        Symbol by which callers find that code; else empty.
    calls : list
        Kernels with machine code of their own that it calls.
    """

    def __init__(self, library: Any, fndesc: Any, signature: Any, symbol: str, calls: list[Any]) -> None:
        self.library, self.fndesc, self.signature, self.symbol, self.calls = library, fndesc, signature, symbol, calls
        # attribute that cached results of numba have
        self.codegen = library.codegen


class _PartCacheImpl(CompileResultCacheImpl):  # type: ignore[misc]
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Return a name beside the entries of the same function as Python calls it."""
        return str(super().get_filename_base(fullname, abiflags)) + "-part"

    def reduce(self, found: _Compiled) -> Any:
        # these are not needed any more, and large
        found.fndesc.typemap = found.fndesc.calltypes = None
        library = found.library
        code = library.serialize_using_object_code() if found.symbol else library.serialize_using_bitcode()
        return code, found.fndesc, found.signature, found.symbol, found.calls

    def rebuild(self, target_context: Any, reduced: Any) -> _Compiled:
        code, fndesc, signature, symbol, calls = reduced
        _separate.load(calls)
        if symbol:
            return _Compiled(target_context.codegen().unserialize_library(code), fndesc, signature, symbol, calls)
        name, _, bitcode = code
        library = _PartLibrary(target_context.codegen(), name)
        library._set_module(binding.parse_bitcode(bitcode))
        return _Compiled(library, fndesc, signature, symbol, calls)

    def check_cachable(self, found: _Compiled) -> bool:
        return not found.library.has_dynamic_globals


class PartCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of the parts of one kernel."""

    _impl_class = _PartCacheImpl


class Part:
    """Kernel as other kernels call it.

    dispatcher: the kernel; from now on calls from kernels go through this object.
    one_variant: whether numbers in the source of a caller are like any others. Else they are types of their own.
    separate: whether it has machine code of its own (`_separate`). With types of other packages it has not: their code may
        change.
    is_entry: whether tables call it (`calls`): it has machine code of its own whatever its types.
    cache: a cache of kind `PartCache`.
    """

    def __init__(self, dispatcher: Any, one_variant: bool, separate: bool, is_entry: bool, cache: Any) -> None:
        self.dispatcher, self.one_variant, self.separate, self.is_entry = dispatcher, one_variant, separate, is_entry
        self.cache = cache
        self.loaded: Counter[Any] = Counter()
        self.missed: Counter[Any] = Counter()
        self._known: dict[Any, _Compiled] = {}
        dispatcher.part = self
        dispatcher.get_call_template, dispatcher.get_overload = self._call_template, self._overload

    def compile(self, arguments: tuple[Any, ...]) -> _Compiled:
        """Return the code for argument types: from this process, from the disk, or compiled."""
        with global_compiler_lock:
            found = self._known.get(arguments)
            if found is None:
                context = self.dispatcher.targetctx
                _background.wait(self.dispatcher.py_func, arguments)
                found = self.cache.load_overload(arguments, context)
                if found is None:
                    self.missed[arguments] += 1
                    found = self._compile(arguments)
                    self.cache.save_overload(arguments, found)
                else:
                    self.loaded[arguments] += 1
                PROGRESS.step()
                if found.symbol:
                    _separate.define(found.library, found.symbol, self.dispatcher.py_func, arguments)
                context.insert_user_function(found, found.fndesc, [] if found.symbol else [found.library])
                self._known[arguments] = found
            return found

    def address(self, arguments: tuple[Any, ...]) -> int:
        """Return the address of the machine code of an entry."""
        with memoized_typing():
            found = self.compile(arguments)
        return int(found.library.get_pointer_to_function(found.symbol))

    @property
    def signatures(self) -> list[tuple[Any, ...]]:
        """Argument types that are ready in this process."""
        return list(self._known)

    def is_kept(self, arguments: tuple[Any, ...]) -> bool:
        """Return whether this process or the disk has the code for argument types."""
        return arguments in self._known or self.cache.holds(arguments, self.dispatcher.targetctx.codegen())

    def _compile(self, arguments: tuple[Any, ...]) -> _Compiled:
        of = self.dispatcher
        flags = compiler.Flags()
        of.targetdescr.options.parse_as_flags(flags, of.targetoptions)
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        # other packages may use all of numba's language
        way = compiler.Compiler if is_outside(of.py_func) else _ShortCompiler
        separate = self.is_entry or self.separate and not is_outside(of.py_func) and not classes_of(arguments)
        library = (_CodeLibrary if separate else _PartLibrary)(of.targetctx.codegen(), of.py_func.__qualname__)
        if separate:
            library.enable_object_caching()
        done = compiler.compile_extra(of.typingctx, of.targetctx, of.py_func, arguments, None, flags, {}, library=library,
                                      pipeline_class=way)
        symbol = _separate.symbol_of(of.py_func, arguments) if separate else ""
        if separate:
            _separate.rename(library, done.fndesc, symbol)
        library._ensure_finalized()
        return _Compiled(library, done.fndesc, done.signature, symbol, library.calls)

    def _call_template(self, arguments: Any, keywords: Any) -> Any:
        """Return the template that numba asks for at a call."""
        signature, arguments = self.dispatcher.fold_argument_types(arguments, keywords)
        arguments = tuple(types.unliteral(argument) if self.one_variant else argument for argument in arguments)
        name = self.dispatcher.py_func.__name__
        found = self.compile(arguments)
        template = typing.make_concrete_template(f"CallTemplate({name})", key=name, signatures=[found.signature])
        return template, signature, arguments, {}

    def _overload(self, signature: Any) -> _Compiled:
        return self._known[tuple(sigutils.normalize_signature(signature)[0])]
