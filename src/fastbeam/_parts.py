"""Kernels that other kernels call, and how all that belongs to one call from Python becomes machine code.

Left to itself numba optimises a kernel, turns it into machine code, and does both again, with all that it calls, in every
caller: code that lies five levels deep goes five times through LLVM. Here a kernel that kernels call is a `Part`: its code stays
as LLVM's passes over single functions leave it, is kept on disk like that, and is optimised and turned into machine code once,
in the kernel that Python calls.
"""
from __future__ import annotations

from collections import Counter
from typing import Any

from llvmlite import binding
from numba.core import compiler, sigutils, types, typing
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """Code without reference counts, so that the passes that pair these are left out."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class _WholeLibrary(_Library):
    """Of a kernel that Python calls: what it links is optimised together, once."""

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class _PartLibrary(_Library):
    """Of a kernel that kernels call: simplified one function at a time, and linked."""

    def _optimize_functions(self, ll_module: Any) -> None:
        super()._optimize_functions(ll_module)
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._set_module(self._final_module)

    def _set_module(self, module: Any) -> None:
        """Code from now on; several kernels that bring the same part along may be linked."""
        for function in module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = "linkonce_odr"
        self._final_module = self._shared_module = module
        self._finalize_dynamic_globals()
        self._finalized = True


class WholeCompiler(compiler.Compiler):  # type: ignore[misc]
    """Numba's compiler for a kernel that Python calls."""

    def compile_extra(self, function: Any) -> Any:
        self.state.library = _WholeLibrary(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


class _Compiled:
    """One part for one set of argument types."""

    def __init__(self, library: _PartLibrary, fndesc: Any, signature: Any) -> None:
        self.library, self.fndesc, self.signature = library, fndesc, signature
        # as cached results of numba have it
        self.codegen = library.codegen


class _PartCacheImpl(CompileResultCacheImpl):  # type: ignore[misc]
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Beside the entries of the same function as Python calls it."""
        return str(super().get_filename_base(fullname, abiflags)) + "-part"

    def reduce(self, found: _Compiled) -> Any:
        # these are not needed any more, and large
        found.fndesc.typemap = found.fndesc.calltypes = None
        found.library._ensure_finalized()
        return found.library.name, found.library._final_module.as_bitcode(), found.fndesc, found.signature

    def rebuild(self, target_context: Any, reduced: Any) -> _Compiled:
        name, bitcode, fndesc, signature = reduced
        library = _PartLibrary(target_context.codegen(), name)
        library._set_module(binding.parse_bitcode(bitcode))
        return _Compiled(library, fndesc, signature)

    def check_cachable(self, found: _Compiled) -> bool:
        return not found.library.has_dynamic_globals


class _PartCache(FunctionCache):  # type: ignore[misc]
    _impl_class = _PartCacheImpl


class Part:
    """A kernel as other kernels call it.

    Parameters
    ----------
    dispatcher : numba dispatcher
        The kernel; from now on calls from kernels go through this object.
    """

    def __init__(self, dispatcher: Any) -> None:
        self.dispatcher = dispatcher
        self.cache = _PartCache(dispatcher.py_func)
        self.loaded: Counter[Any] = Counter()
        self.missed: Counter[Any] = Counter()
        self._known: dict[Any, _Compiled] = {}
        dispatcher.part = self
        dispatcher.get_call_template, dispatcher.get_overload = self._call_template, self._overload

    def compile(self, arguments: tuple[Any, ...]) -> _Compiled:
        """For argument types: from this process, from the disk, or compiled."""
        with global_compiler_lock:
            found = self._known.get(arguments)
            if found is None:
                context = self.dispatcher.targetctx
                found = self.cache.load_overload(arguments, context)
                if found is None:
                    self.missed[arguments] += 1
                    found = self._compile(arguments)
                    self.cache.save_overload(arguments, found)
                else:
                    self.loaded[arguments] += 1
                context.insert_user_function(found, found.fndesc, [found.library])
                self._known[arguments] = found
            return found

    def _compile(self, arguments: tuple[Any, ...]) -> _Compiled:
        of = self.dispatcher
        flags = compiler.Flags()
        of.targetdescr.options.parse_as_flags(flags, of.targetoptions)
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        library = _PartLibrary(of.targetctx.codegen(), of.py_func.__qualname__)
        done = compiler.compile_extra(of.typingctx, of.targetctx, of.py_func, arguments, None, flags, {}, library=library)
        library._ensure_finalized()
        return _Compiled(library, done.fndesc, done.signature)

    def _call_template(self, arguments: Any, keywords: Any) -> Any:
        """What numba asks for when it meets a call; numbers in the source of the caller do not make a type of their own."""
        signature, arguments = self.dispatcher.fold_argument_types(arguments, keywords)
        arguments = tuple(types.unliteral(argument) for argument in arguments)
        name = self.dispatcher.py_func.__name__
        found = self.compile(arguments)
        template = typing.make_concrete_template(f"CallTemplate({name})", key=name, signatures=[found.signature])
        return template, signature, arguments, {}

    def _overload(self, signature: Any) -> _Compiled:
        return self._known[tuple(sigutils.normalize_signature(signature)[0])]
