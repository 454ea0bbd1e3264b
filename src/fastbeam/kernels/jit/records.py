"""Named tuples and tuples of terms in memory, passed to compiled code as one word, whatever they hold.

A scene hands 300 arrays to compiled code, and each call from Python would unpack seven words of every one. `Record` writes them
once, as compiled code keeps them, and from then on only their address is passed. Kernels take `Record`s, or write values that
they are given to memory (`in_memory`).
"""
from __future__ import annotations

import hashlib
import struct
from ctypes import addressof, c_char
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, intrinsic, lower_getattr_generic, models, register_model, unbox


class RecordType(types.Type):  # type: ignore[misc]
    """Type of the address of a named tuple, or of a tuple of terms."""

    def __init__(self, of: Any) -> None:
        self.of = of
        # the name stands in that of every function that takes a record, and names of all its arrays take kilobytes
        kind = self.instance_class.__name__ if self.instance_class else "tuple"
        super().__init__(f"record({kind} {hashlib.blake2b(str(of).encode(), digest_size=16).hexdigest()})")

    def __hash__(self) -> int:
        return hash(self.name)

    @property
    def key(self) -> Any:
        """Key that distinguishes the type from others."""
        return self.of

    @property
    def instance_class(self) -> Any:
        """Class of the named tuple, None of a plain tuple."""
        return getattr(self.of, "instance_class", None)


@register_model(RecordType)
class _RecordModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: RecordType) -> None:
        super().__init__(manager, kind, manager[kind.of].get_value_type().as_pointer())


# --- in compiled code ---------------------------------------------------------------------------------------------------
@intrinsic
def in_memory(typingctx, x):  # type: ignore[no-untyped-def]
    """Put a named tuple or a tuple of terms into memory, from now on passed as one word. Its arrays may change, itself must not.
    A record, and a word that stands for terms, stay as they are."""
    if not isinstance(x, types.BaseTuple):
        return x(x), lambda context, builder, signature, values: values[0]

    def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = cgutils.alloca_once(builder, values[0].type)
        builder.store(values[0], place)
        return place
    return RecordType(x)(x), codegen


def item_type(kind: Any) -> Any:
    """Return the type of an item taken out of memory: large records (`stays_in_memory`) as addresses; terms and tables as values,
    so that loops over elements keep the addresses of their arrays in registers."""
    return RecordType(kind) if getattr(getattr(kind, "instance_class", None), "stays_in_memory", False) else kind


def item_types(terms: Any) -> list[Any]:
    """Return types of the items of a tuple of terms, in memory or not."""
    return [item_type(x) for x in terms.of] if isinstance(terms, RecordType) else list(terms)


def item(builder: Any, kind: Any, value: Any, i: int) -> Any:
    """Return item i of a tuple, in memory or not."""
    if not isinstance(kind, RecordType):
        return builder.extract_value(value, i)
    place = builder.gep(value, [ir.IntType(32)(0), ir.IntType(32)(i)], inbounds=True)
    if isinstance(item_type(kind.of[i]), RecordType):
        return place
    return _load(builder, place, place.type.pointee)


def _load(builder: Any, place: Any, kind: Any) -> Any:
    """Load a value, number by number. Nothing writes to it while a kernel runs, so loads may leave loops. LLVM does not know that
    of loads of whole structures, which makes kernels slower by 6 to 10 percent."""
    if not isinstance(kind, (ir.LiteralStructType, ir.ArrayType)):
        value = builder.load(place)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    out = ir.Constant(kind, ir.Undefined)
    zero = ir.IntType(32)(0)
    for i in range(len(kind.elements) if isinstance(kind, ir.LiteralStructType) else kind.count):
        part = kind.elements[i] if isinstance(kind, ir.LiteralStructType) else kind.element
        inside = builder.gep(place, [zero, ir.IntType(32)(i)], inbounds=True)
        out = builder.insert_value(out, _load(builder, inside, part), i)
    return out


@infer_getattr
class _RecordAttributes(AttributeTemplate):  # type: ignore[misc]
    key = RecordType

    def generic_resolve(self, kind: RecordType, name: str) -> Any:
        return item_type(kind.of.types[_place(kind, name)])


def _place(kind: RecordType, name: str) -> int:
    """Return the index of an attribute among the fields; some fields stand for several attributes."""
    return int(kind.of.fields.index(getattr(kind.instance_class, "stands_for", {}).get(name, name)))


@lower_getattr_generic(RecordType)
def _record_attribute(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    i = _place(kind, name)
    # kernels that count references count one more
    return impl_ret_borrowed(context, builder, item_type(kind.of[i]), item(builder, kind, value, i))


# --- from Python --------------------------------------------------------------------------------------------------------
class Record:
    """Named tuple or tuple of terms as compiled code keeps it. Its arrays may change, itself must not; they live as long as this
    object; of: arrays, numbers, None, and tuples of these."""

    __slots__ = "of", "address", "_numba_type_", "_memory"

    def __init__(self, of: Any) -> None:
        self.of = of
        words: list[Any] = []
        told: list[Any] = []
        _put_words(of, words, told)
        key = tuple(told)
        if key not in _KNOWN:
            kind = typeof(of)
            _KNOWN[key] = RecordType(kind), _layout(kind)
        self._numba_type_, layout = _KNOWN[key]
        self._memory = np.empty(max(1, -(-layout.size // 8)))
        layout.pack_into(self._memory, 0, *words)
        self.address = self._memory.ctypes.data


def same_record(x: Any, y: Any) -> bool:
    """Return whether records of two tuples are equal: they hold the same arrays and numbers."""
    if x is y:
        return True
    if isinstance(x, tuple):
        return type(x) is type(y) and len(x) == len(y) and all(map(same_record, x, y))
    return type(x) is type(y) and isinstance(x, (int, float)) and x == y


# types and layouts by the properties of `_put_words`: numba takes a millisecond to type 300 arrays
_KNOWN: dict[tuple[Any, ...], tuple[RecordType, struct.Struct]] = {}
# flags of arrays that are part of their types: contiguous by rows or by columns, writeable
TYPED = 0x403
# contiguous by rows, and writeable
CONTIGUOUS = 0x401


def _put_words(of: tuple[Any, ...], words: list[Any], told: list[Any]) -> None:
    """Append the numbers of a tuple in the order of its memory to `words`, and properties that decide its type to `told`."""
    told += type(of), len(of)
    for x in of:
        if isinstance(x, np.ndarray):
            flags = x.flags.num
            # from_buffer takes a fifth of the time of the array interface
            first = (addressof(c_char.from_buffer(x)) if x.size and flags & CONTIGUOUS == CONTIGUOUS
                     else x.__array_interface__["data"][0])
            # laid out as numba's arrays, without reference counts
            told += x.dtype, x.ndim, flags & TYPED
            words += 0, 0, x.size, x.itemsize, first, *x.shape, *x.strides
        elif isinstance(x, tuple):
            _put_words(x, words, told)
        else:
            told.append(type(x))
            words.append(0 if x is None else x)


@cache
def _layout(kind: Any) -> struct.Struct:
    """Return the layout of a value of a numba type: as C would have its structure."""
    letters, size, _ = _letters(kind, 0)
    return struct.Struct(f"={letters}{'x' * (-size % 8)}")


def _letters(kind: Any, at: int) -> tuple[str, int, int]:
    """Return (letters of `struct`, offset of its end, alignment) of a type that begins at `at`."""
    if isinstance(kind, types.BaseTuple):
        align = max((_letters(x, 0)[2] for x in kind), default=1)
        begin = at + -at % align
        out, at = "x" * (begin - at), begin
        for x in kind:
            more, at, _ = _letters(x, at)
            out += more
        return out + "x" * (-at % align), at + -at % align, align
    letters = "q" * (5 + 2 * kind.ndim) if isinstance(kind, types.Array) else _LETTERS[kind]
    align = struct.calcsize(f"={letters[0]}")
    return "x" * (-at % align) + letters, at + -at % align + struct.calcsize(f"={letters}"), align


_LETTERS = {types.int64: "q", types.float64: "d", types.boolean: "?", types.none: "q"}


@unbox(RecordType)
def _unbox(kind: Any, found: Any, c: Any) -> Any:
    word = c.pyapi.object_getattr_string(found, "address")
    address = c.pyapi.long_as_voidptr(word)
    c.pyapi.decref(word)
    return NativeValue(c.builder.bitcast(address, c.context.get_value_type(kind)))
