"""Floating point operations of the kernels, counted by running their own source on numbers that count instead of calculating.

A kernel is compiled from a plain function of Python; `twin` gives that function with everything that it calls replaced: kernels
by their twins, operations on registers by counters. Divisions, multiplications and additions count as one each, so that a fused
multiply-add is two; additions to zero count as well. What works on 8 elements at a time is counted once, that is for one of them.

The block elimination does not run on lanes and has formulas, which tests/project/test_perf_scaling.py compares with a twin.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic

from perf.places import module, private

GenericFunction = private("_generic", "GenericFunction")
beam = module("kernels.beam")
blocks = module("kernels.blocks")
nodes = module("kernels.nodes")
substructures = module("kernels.substructures")
NoInner, Short, eliminate_inner = private("kernels.inner", "NoInner", "Short", "eliminate_inner")
layout_of = private("kernels.layout", "layout_of")
OverStep = private("kernels.motions", "OverStep")
SIMO_REISSNER = private("kernels.strain_sets", "SIMO_REISSNER")
Conserving = private("kernels.terms", "Conserving")
Work = private("kernels.work", "Work")
Stepper = private("newton", "Stepper")
condensed_of, inner_of, work_of = private("workspace", "condensed_of", "inner_of", "work_of")


PADDED = 8  # columns of a block and of the panel of right-hand sides as they are stored


class Tally:
    """Operations so far; `number` makes values that add to it."""

    def __init__(self) -> None:
        self.operations = 0

    def number(self, n: int = 1) -> Number:
        """A value of n components."""
        return Number(self, n)

    # the builder of LLVM code that `blocks` writes formulas with
    def fadd(self, x: Any, y: Any, flags: Any = ()) -> Any:
        """One operation of any kind."""
        self.operations += 1
        return x

    fsub = fmul = fdiv = fadd


class Number:
    """Some components without values; operations are added to the tally."""

    def __init__(self, tally: Tally, n: int) -> None:
        self.tally, self.n = tally, n

    def _with(self, other: Any) -> Number:
        n = max(self.n, getattr(other, "n", 1))
        self.tally.operations += n
        return Number(self.tally, n)

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _with

    def __abs__(self) -> Number:
        return self

    def __gt__(self, other: Any) -> bool:
        return False

    def sqrt(self) -> Number:
        """What numpy.sqrt calls."""
        self.tally.operations += 1
        return self


class Choice:
    """Stands for a generic function: the counting twin of what it chooses."""

    def __init__(self, function: GenericFunction, of: Callable[[Dispatcher], Callable[..., Any]]) -> None:
        self._function, self._of = function, of

    def call(self, *arguments: Any) -> Any:
        """Count what the call does."""
        return self._of(self._function.implementation(*arguments))(*arguments)


class Numbers:
    """An array of so many of them."""

    def __init__(self, tally: Tally, size: int) -> None:
        self.tally, self.shape = tally, (size,)

    def __getitem__(self, key: Any) -> Number:
        return Number(self.tally, 1)

    def __setitem__(self, key: Any, value: Any) -> None:
        pass


def lu(n: int) -> int:
    """Operations of the factors of a block n x n."""
    tally = Tally()
    blocks._lu(tally, [[None] * n for _ in range(n)], n, None)
    return tally.operations


def triangular(n: int) -> int:
    """Of both triangular solutions, for one column."""
    tally = Tally()
    blocks._triangular(tally, lambda i, j: None, [None] * n, n)
    return tally.operations


def product(n: int) -> int:
    """Of y -= A x for one column."""
    return 2 * n * n


def _registers(tally: Tally) -> dict[str, Callable[..., Any]]:
    """What stands for the operations of kernels/algebra.py and kernels/blocks.py, by name."""
    def value(n: int, operations: int = 0) -> Callable[..., Number]:
        def work(*arguments: Any) -> Number:
            tally.operations += operations
            return tally.number(n)
        return work

    def nothing(*arguments: Any) -> None:
        return None

    def adds(n: int) -> Callable[..., None]:
        def work(*arguments: Any) -> None:
            tally.operations += n
        return work

    def of_size(operations: Callable[[int], int], result: Any = None) -> Callable[..., Any]:
        def work(*arguments: Any) -> Any:
            tally.operations += operations(len(arguments[-1]))
            return result
        return work

    def dot(u: Number, v: Number) -> Number:
        tally.operations += 2 * u.n - 1
        return tally.number()

    def subtract_lanes(*arguments: Any) -> None:
        tally.operations += product(len(arguments[-1])) * len(arguments[-2])

    return {
        "vld": value(1), "vld2": value(2), "vld3": value(3), "vldm": value(9), "ld2": value(2), "ld3": value(3),
        "address": lambda array, offset: array, "triple": value(3), "dim": lambda size: len(size) // 2,
        "coordinates": lambda size: 12 if len(size) == 6 else 4, "vector_lanes": value(3),
        "zero_moment": value(3), "zero_dyad": value(9), "put_lanes": nothing, "moment": value(3, 9),
        "dyad": value(9, 9), "add_turned": adds(2 + 3 + 9 + 9),
        "vzero": value(1), "vzero2": value(2), "vzero3": value(3), "vzerom": value(9),
        "zero2": value(2), "zero3": value(3),
        "zerom": value(9), "vst": nothing, "vst2": nothing, "vst3": nothing, "vstm": nothing, "vst_matrix": nothing,
        "st2": nothing, "st3": nothing, "vadd3": adds(3), "vadd_matrix": adds(9), "add3": adds(3), "add_matrix": adds(9),
        "dot": dot, "root": value(1, 1), "square_root": value(1, 1), "cross": value(3, 9), "outer": value(9, 9),
        "add_iso": value(9, 3), "add_skew": value(9, 6),
        "gather_lanes": nothing, "put_first": nothing, "put_rows": nothing, "flush_rows": nothing,
        "flush_column": nothing, "scatter_rows": of_size(lambda n: n), "lu_lanes": of_size(lu, True),
        "lu_rows": of_size(lu, True), "lu_two": of_size(lambda n: 2 * lu(n), True), "solve_lanes": of_size(triangular),
        "subtract_lanes": subtract_lanes, "solve_rows": of_size(lambda n: PADDED * triangular(n)),
        "subtract_rows": of_size(lambda n: PADDED * product(n)), "solve_column": of_size(triangular),
        "subtract_column": of_size(product),
        # the sum that the right-hand side begins with is that of an earlier product
        "solve_rows_with_column": of_size(lambda n: n + PADDED * triangular(n))}


def _unknown(name: str) -> Callable[..., Any]:
    def work(*arguments: Any) -> Any:
        raise LookupError(f"operation {name!r} has no counter in perf/limits/counting.py")
    return work


def _nothing(*arguments: Any) -> tuple[float, float]:
    return 0.0, 0.0


class Nothing:
    """Stands for a generic function that counts as nothing."""

    call = staticmethod(_nothing)


def twin(kernel: Dispatcher, tally: Tally, without: Sequence[str] = ()) -> Callable[..., Any]:
    """The Python function of a kernel that counts, `without` some kernels that it calls, which count as nothing and return two
    zeros; it raises LookupError where it meets an operation that has no counter."""
    counters = _registers(tally)
    known: dict[int, Callable[..., Any]] = {}

    def of(dispatcher: Dispatcher) -> Callable[..., Any]:
        if id(dispatcher) not in known:
            source = dispatcher.py_func
            # a part of a group that is as wide as the group
            names = {**source.__globals__, "WIDTH": 8}
            for name in source.__code__.co_names:
                if isinstance(names.get(name), Dispatcher):
                    names[name] = _nothing if name in without else of(names[name])
                elif isinstance(names.get(name), _Intrinsic):
                    names[name] = counters.get(name, _unknown(name))
                elif isinstance(names.get(name), GenericFunction):
                    names[name] = Nothing() if name in without else Choice(names[name], of)
            known[id(dispatcher)] = FunctionType(source.__code__, names, source.__name__, source.__defaults__)
        return known[id(dispatcher)]

    return of(kernel)


def count(kernel: Dispatcher, *arguments: Any, without: Sequence[str] = ()) -> int:
    """Operations of one call; a slice stands for an array of so many numbers."""
    tally = Tally()
    twin(kernel, tally, without)(*(Numbers(tally, a.stop) if isinstance(a, slice) else a for a in arguments))
    return tally.operations


def _motion(model: Any, work: Work, mixed: bool) -> OverStep:
    increment = work.increment._replace(control=np.array([float(mixed), 0.0, 0.0]))
    return OverStep(Conserving(), model.q0, work.dphi, model.v0, increment, work.reference_strains, 1.0, 1.0)


def _elements(model: Any, mixed: bool, assembled: bool) -> int:
    """Of an element of the first group of a model in space, with its inner nodes where they are eliminated and `assembled`."""
    work, tables = work_of(model), model.simo
    motion = _motion(model, work, mixed)
    if not assembled:
        at = layout_of(model.dofs, *tables.meta[0, :2])
        return count(beam.evaluate_group, tables, 0, at, SIMO_REISSNER, motion, work.scratch, model.dofs)
    inner = NoInner() if model.inner is None else inner_of(model)
    return count(beam.element_groups, tables, 0, 1, inner, SIMO_REISSNER, motion, work.r, work.blocks, work.scratch, model.dofs)


def element_kernel(model: Any, mixed: float) -> float:
    """Of residual and tangent of an element before anything is eliminated or added up; `mixed`: share of the iterations in which
    the tangent takes other stresses than the present ones (theory.md (4.6))."""
    plain, more = (_elements(model, use, False) for use in (False, True))
    return plain + mixed * (more - plain)


def after_kernel(model: Any) -> int:
    """Of an element: elimination of inner nodes, and adding up what is left."""
    return _elements(model, False, True) - _elements(model, False, False)


def inner_elimination(model: Any) -> int:
    """The first part of `after_kernel`."""
    work, tables = work_of(model), model.simo
    nn = int(tables.meta[0, 0])
    if model.inner is None:
        return 0
    inner = inner_of(model)
    assert inner is not None
    return count(eliminate_inner, Short(work.r), inner.store, 0, tables, 0, nn, work.scratch, 0, 0, 0, model.dofs)


def inner_elimination_formula(nn: int, n: int = 6) -> int:
    """The same by a formula, for an element of nn nodes."""
    out = 0
    for others in range(nn - 1, 1, -1):
        columns = others * n + 1
        # residual of the node to its row and back, factors, D^-1 of the others' columns and of y, products of all with all
        out += n + lu(n) + columns * triangular(n) + others * columns * product(n)
    return out


def inner_recovery(nn: int, n: int = 6) -> int:
    """Of the increments of the inner nodes of an element."""
    return sum(n + others * product(n) for others in range(nn - 1, 1, -1))


def elimination(plan: Any, n: int, columns: int | None = None, right: int = 1) -> int:
    """Of factors and solution of all blocks of a plan; `columns` of a block (default: n) and `right`-hand sides as they count, 8
    of each for what is really done."""
    columns = n if columns is None else columns
    m = np.diff(plan.start)
    rows, upper, pairs = m.size, int(m.sum()), int((m * m).sum())
    factor = rows * (lu(n) + right * triangular(n)) + upper * (columns * triangular(n) + right * product(n))
    # back substitution: all rows but the last, which has none to its right
    return factor + pairs * columns * product(n) + upper * right * product(n)


def node_loops(model: Any) -> int:
    """Of a node of a model in space in every iteration: the increments."""
    return count(nodes.update_nodes, np.zeros(1, np.int64), slice(8), 0, 1, slice(3), slice(3), slice(8))


def _kinds_of_beams(stepper: Stepper) -> Iterator[tuple[int, float]]:
    """(a group, beams like its own) of every kind of condensed beams: groups that are equal cost the same."""
    subs = stepper.core.substructures
    assert subs is not None and stepper.core.simo is not None
    _, first, times = np.unique(subs.group[:, 1:3], axis=0, return_index=True, return_counts=True)
    yield from zip(first.tolist(), (8.0 * times).tolist())


def condensed_beams(stepper: Stepper, mixed: float) -> float:
    """Of all condensed beams in one iteration without loops over nodes: elements, elimination, recovery of the interior."""
    model, work, subs = stepper.core, work_of(stepper.core), condensed_of(stepper.core)
    out = recovery_of_beams(stepper)
    for g, beams in _kinds_of_beams(stepper):
        plain, more = (count(substructures.condense, subs, model.simo, SIMO_REISSNER, g, g + 1, _motion(model, work, use),
                             work.f_ext, work.scratch, model.dofs)
                       for use in (False, True))
        out += beams * (plain + mixed * (more - plain))
    return out


def recovery_of_beams(stepper: Stepper) -> float:
    """The last part of `condensed_beams`."""
    model, work, subs = stepper.core, work_of(stepper.core), condensed_of(stepper.core)
    return sum(beams * count(substructures.recover, subs, model.simo, g, g + 1, -1.0, model.pattern.row_of, work, work.scratch,
                             model.dofs, without=("move_nodes",))
               for g, beams in _kinds_of_beams(stepper))
