"""Calls through tables of addresses: questions of a loop to the terms of a scene, without being compiled for them.

Machine code that is compiled for a tuple of terms exists once for every kind of scene. A loop that takes a table is compiled
once. `f.each(terms, ...)`, where `terms` is of type `CALLS`, calls all entries of a list in memory. `f.call(x, ...)`, where x is
`Unknown`, calls the only entry of such a list. Entries (kernels/questions.py) are compiled for the types of one term and of the
part of the system that they read, whatever else a scene has.

A table is an array of words: the address of the system, then for every question the begin of its list and the number of its
entries; an entry is the address of machine code and that of the term. An entry takes the term, the system, and further arguments.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.extending import NativeValue, intrinsic, models, register_model, unbox

from fastbeam.kernels.jit.records import RecordType, _load, item_type

_I64, _BYTES = ir.IntType(64), ir.IntType(8).as_pointer()


class CallsType(types.Type):  # type: ignore[misc]
    """Type of the address of a table, which stands for all terms."""

    def __init__(self) -> None:
        super().__init__("fastbeam.calls")


CALLS = CallsType()
# types of arguments and results of entries, and of the term in questions to the scene
NUMBER, INTEGER, TRUTH, PAIR, COUNTS, NOTHING = (types.float64, types.int64, types.boolean, types.UniTuple(types.float64, 2),
                                                 types.Array(types.int64, 1, "C"), types.void)
NO_TERM: Any = types.voidptr
type_of = typeof


@register_model(CallsType)
class _CallsModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _I64)


@unbox(CallsType)
def _unbox(kind: Any, found: Any, c: Any) -> Any:
    word = c.pyapi.object_getattr_string(found, "address")
    value = c.pyapi.long_as_longlong(word)
    c.pyapi.decref(word)
    return NativeValue(value)


class Unknown(NamedTuple):
    """Placeholder for a value of unknown type, with the table of calls that know it."""

    calls: int


@intrinsic
def contents(typingctx, record):  # type: ignore[no-untyped-def]
    """Return the value in memory, as a term is handed to its implementation."""
    if isinstance(item_type(record.of), RecordType):
        return record(record), lambda context, builder, signature, values: values[0]

    def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _load(builder, values[0], values[0].type.pointee)
    return record.of(record), codegen


class Question:
    """Generic function as tables have it.

    names: its arguments.
    given: types of the arguments that entries take besides term and system.
    contact: whether every entry may read `System.contact`.
    """

    all: list[Question] = []

    def __init__(self, of: Any, names: list[str], given: dict[str, Any], returns: Any, contact: bool, entry: Any) -> None:
        self.of, self.names, self.given, self.returns, self.entry = of, names, given, returns, entry
        self.contact = contact
        self.number = len(Question.all)
        Question.all.append(self)

    def ask(self, arguments: tuple[Any, ...], way: str) -> tuple[Any, Callable[..., Any]]:
        """Return signature and code of a call; way: 'each', 'backward', 'all', or 'one' if the first argument is `Unknown`."""
        kinds = tuple(self.given.values())
        places = [self.names.index(name) for name in self.given]
        outer = self.returns if way == "one" else types.boolean if way == "all" else types.void

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            base = builder.extract_value(values[0], 0) if way == "one" else values[0]
            table = builder.inttoptr(base, _I64.as_pointer())
            given = [context.cast(builder, values[i], signature.args[i], kind) for i, kind in zip(places, kinds)]
            call = _caller(context, builder, table, self.returns, kinds, given)
            first, count = (builder.load(builder.gep(table, [_I64(1 + 2 * self.number + k)])) for k in (0, 1))
            if way == "one":
                return call(first)
            out = cgutils.alloca_once_value(builder, ir.Constant(ir.IntType(1), 1))
            with cgutils.for_range(builder, count) as loop:
                k = builder.sub(builder.sub(count, _I64(1)), loop.index) if way == "backward" else loop.index
                found = call(builder.add(first, builder.mul(k, _I64(2))))
                if way == "all":
                    builder.store(builder.and_(builder.load(out), found), out)
            return builder.load(out) if way == "all" else context.get_dummy_value()
        return outer(*arguments), codegen


def _caller(context: Any, builder: Any, table: Any, returns: Any, kinds: tuple[Any, ...], given: list[Any]) -> Callable[..., Any]:
    """Return a function that emits the call of the entry at a place of a table, as numba calls functions: with addresses of the
    result and of an exception, which kernels do not raise."""
    arguments = (types.voidptr, types.voidptr, *kinds)
    of = context.call_conv.get_function_type(returns, arguments)
    result = cgutils.alloca_once(builder, of.args[0].pointee)
    nobody = cgutils.alloca_once_value(builder, ir.Constant(of.args[1].pointee, None))
    system = builder.inttoptr(builder.load(table), _BYTES)
    pack = context.get_arg_packer(arguments)

    def word(at: Any) -> Any:
        return builder.load(builder.gep(table, [at]))

    def call(at: Any) -> Any:
        code = word(at)
        if returns == types.void:
            # address 0: the entry does nothing
            with builder.if_then(builder.icmp_unsigned("!=", code, _I64(0)), likely=True):
                go(code, at)
            return context.get_dummy_value()
        go(code, at)
        return context.get_returned_value(builder, returns, builder.load(result))

    def go(code: Any, at: Any) -> None:
        term = builder.inttoptr(word(builder.add(at, _I64(1))), _BYTES)
        words = pack.as_arguments(builder, [term, system, *given])
        builder.call(builder.inttoptr(code, of.as_pointer()), [result, nobody, *words])
    return call
