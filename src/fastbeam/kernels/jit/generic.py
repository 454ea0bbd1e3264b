"""Generic functions of compiled code: the types of their arguments choose the implementation when a kernel is compiled, for one
value or for every term of a tuple in turn.

    @generic
    def assemble(term, system, h):
        "Residual and tangent of a term."

    @assemble.register(Bodies)
    @kernel
    def assemble_bodies(bodies, system, h): ...

    @kernel
    def run(terms, system, h):
        assemble.each(terms, system, h)

A call is lowered to a direct call of the implementation: nothing of it passes numba's front end, and a term without an
implementation costs nothing. Implementations are found by the classes of named tuples along their base classes, as with
functools.singledispatch; `register(A, B)` looks at the first two arguments.
"""
from __future__ import annotations

import inspect
from functools import cached_property
from typing import Any, Callable

from numba.core import types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model, typeof_impl

from fastbeam.kernels.jit import sources as _outside
from fastbeam.kernels.jit.calls import CALLS, Question, Unknown
from fastbeam.kernels.jit.records import item, item_types


class GenericFunction:
    """Function with an implementation for each of several types of its first arguments.

    In kernels: `f.call(x, ...)` for one value; `f.each(terms, ...)` and `f.each_backward(terms, ...)` for all terms of a tuple,
    first to last and last to first, which return nothing; `f.all(terms, ...)`: whether all implementations return True.
    """

    def __init__(self, stub: Callable[..., Any]) -> None:
        self.name, self.module = stub.__name__, stub.__module__
        self.__doc__ = stub.__doc__
        self.implementations: dict[tuple[Any, ...], Any] = {}
        # classes from outside that kernels were compiled for
        self._asked: set[type] = set()
        self._stub = stub
        # the question in tables of calls
        self.question: Question | None = None
        self._by_classes: dict[tuple[type, ...], Any] = {}

    # made on first use, as most are never used: a hundred functions take a twentieth of the time of a start
    @cached_property
    def call(self) -> Any:
        """Implementation for the first arguments."""
        return self._intrinsic(self._one)

    @cached_property
    def each(self) -> Any:
        """Implementations of all terms of a tuple, first to last."""
        return self._intrinsic(self._forward)

    @cached_property
    def each_backward(self) -> Any:
        """Implementations of all terms of a tuple, last to first."""
        return self._intrinsic(self._backward)

    @cached_property
    def all(self) -> Any:
        """True where the implementations of all terms return True."""
        return self._intrinsic(self._every)

    def register(self, *classes: Any) -> Callable[[Any], Any]:
        """Register a kernel, as a decorator, as the implementation for first arguments of these classes.

        Raises
        ------
        TypeError
            From outside this package: what is registered is no kernel, none of the classes is from outside, there is an
            implementation for them already, or kernels were compiled without it.
        """
        def note(function: Any) -> Any:
            _outside.note(self.name, classes, function)
            for x in filter(_outside.is_term, classes):
                if classes in self.implementations:
                    raise TypeError(f"{self.name}.register: there is an implementation for {x.__name__} already")
                if x in self._asked:
                    raise TypeError(f"{self.name}.register: kernels for {x.__name__} have been compiled without it; register "
                                    "all implementations before the first run")
            self.implementations[classes] = function
            self._by_classes.clear()
            return function
        return note

    def entry(self, *, returns: Any = types.void, contact: bool = False, **given: Any) -> Callable[[Any], Any]:
        """Register the entry for tables (`calls.py`), as a decorator: a kernel (term, system, further arguments of these numba
        types); contact: whether every implementation may read `System.contact`."""
        def note(function: Any) -> Any:
            names = list(inspect.signature(self._stub).parameters)
            self.question = Question(self, names, given, returns, contact, function)
            return function
        return note

    def of_classes(self, *of: type) -> Any:
        """Return the implementation for first arguments of these classes, or None."""
        if of not in self._by_classes:
            self._asked.update(filter(_outside.is_term, of))
            self._by_classes[of] = self._nearest([x.__mro__ for x in of[:self._depth]])
        return self._by_classes[of]

    def find(self, arguments: tuple[Any, ...]) -> Any:
        """Return the implementation for arguments of these numba types, or None: the one registered for the nearest class of the
        first argument, among those the nearest of the second."""
        of = (getattr(x, "instance_class", None) for x in arguments[:2])
        self._asked.update(x for x in of if _outside.is_term(x))
        return self._nearest([_ancestors(x) for x in arguments[:self._depth]])

    def covers(self, *of: type) -> bool:
        """Return whether there is an implementation for first arguments of these classes, whatever the other arguments are."""
        return self.of_classes(*of) is not None

    def implementation(self, *arguments: Any) -> Any:
        """Return the implementation for these values. Raises TypeError: there is none."""
        some = tuple(type(x) for x in arguments[:self._depth])
        function = self.of_classes(*some)
        if function is None:
            raise TypeError(f"{self.name}: there is no implementation for {', '.join(x.__name__ for x in some)}")
        return function

    def __call__(self, *arguments: Any) -> Any:
        """Call the implementation from Python."""
        return self.implementation(*arguments)(*arguments)

    @property
    def _depth(self) -> int:
        """Number of arguments that decide."""
        return max(map(len, self.implementations), default=0)

    def _nearest(self, ancestors: list[Any]) -> Any:
        found = []
        far = max(map(len, ancestors), default=0)
        for classes, function in self.implementations.items():
            if len(classes) <= len(ancestors) and all(c in line for c, line in zip(classes, ancestors)):
                places = [line.index(c) for c, line in zip(classes, ancestors)]
                found.append((places + [far] * (len(ancestors) - len(places)), function))
        return min(found, key=lambda x: x[0])[1] if found else None

    def _intrinsic(self, build: Callable[..., Any]) -> Any:
        def definition(typingctx, *arguments):  # type: ignore[no-untyped-def]
            return build(typingctx, arguments)
        definition.__name__ = self.name
        definition.__qualname__ = f"{self.module}.{self.name}"
        names = "typingctx", *inspect.signature(self._stub).parameters
        definition.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [inspect.Parameter(x, inspect.Parameter.POSITIONAL_OR_KEYWORD) for x in names])
        return intrinsic(definition)

    def _one(self, typingctx: Any, arguments: tuple[Any, ...]) -> Any:
        if getattr(arguments[0], "instance_class", None) is Unknown:
            return self._ask(arguments, "one")
        function = self.find(arguments)
        if function is None:
            return None
        kind, found = _typed(typingctx, function, arguments)

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return _call(context, builder, kind, found, signature.args, values)
        return found.return_type(*arguments), codegen

    def _typed_calls(self, typingctx: Any, arguments: tuple[Any, ...]) -> list[Any]:
        terms, *others = arguments
        out = []
        for i, term in enumerate(item_types(terms)):
            function = self.find((term, *others))
            if function is not None:
                out.append((i, term, *_typed(typingctx, function, (term, *others))))
        return out

    def _ask(self, arguments: tuple[Any, ...], way: str) -> Any:
        if self.question is None:
            raise TypeError(f"{self.name} has no entry that tables could call")
        return self.question.ask(arguments, way)

    def _forward(self, typingctx: Any, arguments: tuple[Any, ...]) -> Any:
        return self._ask(arguments, "each") if arguments[0] == CALLS else self._walk(typingctx, arguments, 1)

    def _backward(self, typingctx: Any, arguments: tuple[Any, ...]) -> Any:
        return self._ask(arguments, "backward") if arguments[0] == CALLS else self._walk(typingctx, arguments, -1)

    def _walk(self, typingctx: Any, arguments: tuple[Any, ...], step: int) -> Any:
        calls = self._typed_calls(typingctx, arguments)[::step]

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            for i, term, kind, found in calls:
                _call(context, builder, kind, found, (term, *signature.args[1:]),
                      [item(builder, signature.args[0], values[0], i), *values[1:]])
            return context.get_dummy_value()
        return types.void(*arguments), codegen

    def _every(self, typingctx: Any, arguments: tuple[Any, ...]) -> Any:
        if arguments[0] == CALLS:
            return self._ask(arguments, "all")
        calls = self._typed_calls(typingctx, arguments)

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            out = context.get_constant(types.boolean, True)
            for i, term, kind, found in calls:
                one = _call(context, builder, kind, found, (term, *signature.args[1:]),
                            [item(builder, signature.args[0], values[0], i), *values[1:]])
                out = builder.and_(out, context.cast(builder, one, found.return_type, types.boolean))
            return out
        return types.boolean(*arguments), codegen


def generic(stub: Callable[..., Any]) -> GenericFunction:
    """Make a generic function with the name, arguments and docstring of an empty function."""
    return GenericFunction(stub)


# --- generic functions as numba sees them --------------------------------------------------------------------------------
class _FunctionType(types.Dummy):  # type: ignore[misc]
    """Type by which kernels can write `assemble.each(...)`."""

    def __init__(self, function: GenericFunction) -> None:
        self.function = function
        super().__init__(f"generic({function.module}.{function.name})")


register_model(_FunctionType)(models.OpaqueModel)


@typeof_impl.register(GenericFunction)
def _typeof(function: GenericFunction, c: Any) -> _FunctionType:
    return _FunctionType(function)


@infer_getattr
class _FunctionAttributes(AttributeTemplate):  # type: ignore[misc]
    key = _FunctionType

    def generic_resolve(self, kind: _FunctionType, name: str) -> Any:
        known = name in vars(kind.function)
        function = getattr(kind.function, name)
        if not known:
            self.context.refresh()
        return self.context.resolve_value_type(function)


@lower_getattr_generic(_FunctionType)
def _function_attribute(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    return context.get_dummy_value()


def _ancestors(kind: Any) -> tuple[Any, ...]:
    """Return the classes that a numba type counts as: the class of a named tuple and its base classes; else the type itself and
    its class."""
    of = getattr(kind, "instance_class", None)
    return (kind, *type(kind).__mro__) if of is None else tuple(of.__mro__)


def _typed(typingctx: Any, function: Any, arguments: tuple[Any, ...]) -> Any:
    kind = typingctx.resolve_value_type(function)
    return kind, kind.get_call_type(typingctx, arguments, {})


def _call(context: Any, builder: Any, kind: Any, found: Any, given: Any, values: Any) -> Any:
    function = context.get_function(kind, found)
    return function(builder, [context.cast(builder, x, a, b) for x, a, b in zip(values, given, found.args)])
