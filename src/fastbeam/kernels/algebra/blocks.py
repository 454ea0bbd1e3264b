"""n x n blocks in registers, n = 6 for nodes in space and 3 for nodes in a plane: LU without row exchange, triangular solutions,
products. Written out in LLVM: one call is straight-line code, whatever n is.

`dofs` is a tuple of n numbers: its type carries n. An array holds blocks in lanes (8 blocks, entry r, c at 8 (n r + c)) or by
rows (one block, entry r, c at 8 r + c, rows padded to a register); `row` and `column` are the distances between entries, in
doubles. The diagonal of a factored block holds reciprocal pivots.
"""
from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from fastbeam.kernels.algebra.vectors import (
    _DOUBLE,
    _I32,
    _I64,
    _VECTOR,
    LANES,
    WIDTH,
    _add,
    _data,
    _div,
    _int,
    _mul,
    _splat,
    _sub,
    f8,
)

SIX = (0, 0, 0, 0, 0, 0)
THREE = (0, 0, 0)
TWO = (0, 0)
ONE = (0,)
# numbers of coordinates of a node in space and in a plane
TWELVE, FOUR = (0,) * 12, (0,) * 4
EIGHTEEN = (0,) * 18   # three columns for each of two directors
_TRUE = ir.IntType(1)(1)
# 8 lanes are worked on in parts of as many as a register holds; columns of a product at a time, so that they stay in registers
_PART = ir.VectorType(_DOUBLE, WIDTH)
_PARTS = range(0, LANES, WIDTH)
_AT_A_TIME = 3 if WIDTH == LANES else 2


def _at(b, o, *terms):
    """Return offset o + sum of factor * distance, distances as values or numbers."""
    for factor, distance in terms:
        d = distance if isinstance(distance, ir.Value) else ir.Constant(_I64, distance)
        o = b.add(o, b.mul(d, ir.Constant(_I64, factor)))
    return o


class _Memory:
    """Loads and stores of one array at offsets in doubles."""

    def __init__(self, ctx, b, array_type, array, offset, offset_type):
        self.b = b
        self.data = _data(ctx, b, array_type, array)
        self.offset = _int(ctx, b, offset, offset_type)

    def _pointer(self, kind, terms):
        return self.b.bitcast(self.b.gep(self.data, [_at(self.b, self.offset, *terms)]), kind.as_pointer())

    def vector(self, *terms):
        return self.b.load(self._pointer(_VECTOR, terms), align=8)

    def put_vector(self, x, *terms):
        self.b.store(x, self._pointer(_VECTOR, terms), align=8)

    def lanes(self, first, *terms):
        """Load a part of 8 lanes, from lane `first` on."""
        return self.b.load(self._pointer(_PART, ((first, 1), *terms)), align=8)

    def put_lanes(self, x, first, *terms):
        self.b.store(x, self._pointer(_PART, ((first, 1), *terms)), align=8)

    def number(self, *terms):
        return self.b.load(self._pointer(_DOUBLE, terms), align=8)

    def put_number(self, x, *terms):
        self.b.store(x, self._pointer(_DOUBLE, terms), align=8)


def _lu(b, a, n, one):
    """Factor a list of lists of values in place, reciprocal pivots on the diagonal; return the pivots."""
    pivots = []
    for k in range(n):
        pivots.append(a[k][k])
        a[k][k] = _div(b, one, a[k][k])
        for i in range(k + 1, n):
            a[i][k] = _mul(b, a[i][k], a[k][k])
            for j in range(k + 1, n):
                a[i][j] = _sub(b, a[i][j], _mul(b, a[i][k], a[k][j]))
    return pivots


def _triangular(b, entry, w, n):
    """Solve w <- (LU)^-1 w for values w; entry(i, j) gives a value that multiplies a w."""
    for i in range(n):
        for j in range(i):
            w[i] = _sub(b, w[i], _mul(b, entry(i, j), w[j]))
    for i in reversed(range(n)):
        for j in reversed(range(i + 1, n)):
            w[i] = _sub(b, w[i], _mul(b, entry(i, j), w[j]))
        w[i] = _mul(b, entry(i, i), w[i])


def _absolute(b, x, kind, name):
    return b.call(cgutils.get_or_insert_function(b.module, ir.FunctionType(kind, [kind]), f"llvm.fabs.{name}"), [x])


@intrinsic
def lu_lanes(tc, a, offset, out, out_offset, smallest, dofs):
    """Factor 8 blocks in lanes; return False if a pivot is below `smallest` times its diagonal entry, or NaN."""
    n = dofs.count

    def codegen(ctx, b, sig, args):
        source = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
        target = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
        limit = _splat(b, ctx.cast(b, args[4], sig.args[4], f8), WIDTH)
        name, zero = f"v{WIDTH}f64", ir.Constant(_PART, [0.0] * WIDTH)
        good = None
        for first in _PARTS:
            x = [[source.lanes(first, (8 * (n * i + j), 1)) for j in range(n)] for i in range(n)]
            before = [x[i][i] for i in range(n)]
            pivots = _lu(b, x, n, ir.Constant(_PART, [1.0] * WIDTH))
            for p, q in zip(pivots, before):
                low = _mul(b, limit, _absolute(b, q, _PART, name))
                fine = b.fcmp_ordered(">=", _absolute(b, p, _PART, name), low)
                fine = b.and_(fine, b.fcmp_ordered(">", _absolute(b, p, _PART, name), zero))
                good = fine if good is None else b.and_(good, fine)
            for i in range(n):
                for j in range(n):
                    target.put_lanes(x[i][j], first, (8 * (n * i + j), 1))
        flags = ir.VectorType(ir.IntType(1), WIDTH)
        every = cgutils.get_or_insert_function(b.module, ir.FunctionType(ir.IntType(1), [flags]),
                                               f"llvm.vector.reduce.and.v{WIDTH}i1")
        return b.call(every, [good])
    return types.boolean(a, offset, out, out_offset, smallest, dofs), codegen


@intrinsic
def solve_lanes(tc, lu, offset, x, x_offset, x_row, out, out_offset, out_row, dofs):
    """Solve out = A^-1 x for 8 factored blocks in lanes and n lanes each, x_row and out_row doubles apart."""
    n = dofs.count

    def codegen(ctx, b, sig, args):
        factors = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
        source = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
        target = _Memory(ctx, b, sig.args[5], args[5], args[6], sig.args[6])
        rows, out_rows = _int(ctx, b, args[4], sig.args[4]), _int(ctx, b, args[7], sig.args[7])
        for first in _PARTS:
            w = [source.lanes(first, (i, rows)) for i in range(n)]
            _triangular(b, lambda i, j: factors.lanes(first, (8 * (n * i + j), 1)), w, n)
            for i in range(n):
                target.put_lanes(w[i], first, (i, out_rows))
        return ctx.get_dummy_value()
    return types.void(lu, offset, x, x_offset, x_row, out, out_offset, out_row, dofs), codegen


@intrinsic
def subtract_lanes(tc, a, offset, x, x_offset, y, y_offset, columns, dofs):
    """Subtract A X from Y for 8 blocks A in lanes; X, Y: n rows of as many lanes as the tuple `columns` has numbers."""
    n, m = dofs.count, columns.count

    def codegen(ctx, b, sig, args):
        matrix = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
        source = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
        target = _Memory(ctx, b, sig.args[4], args[4], args[5], sig.args[5])
        # some columns at a time stay in registers, every entry of A is loaded once for as many products
        for first, c0 in ((first, c0) for first in _PARTS for c0 in range(0, m, _AT_A_TIME)):
            some = range(c0, min(c0 + _AT_A_TIME, m))
            w = {(k, c): source.lanes(first, (8 * (m * k + c), 1)) for c in some for k in range(n)}
            for i in range(n):
                z = {c: target.lanes(first, (8 * (m * i + c), 1)) for c in some}
                for k in range(n):
                    f = matrix.lanes(first, (8 * (n * i + k), 1))
                    for c in some:
                        z[c] = _sub(b, z[c], _mul(b, f, w[k, c]))
                for c in some:
                    target.put_lanes(z[c], first, (8 * (m * i + c), 1))
        return ctx.get_dummy_value()
    return types.void(a, offset, x, x_offset, y, y_offset, columns, dofs), codegen


@intrinsic
def lu_two(tc, a, first, second, low, high, dofs):
    """Factor two blocks of one array by `lu_rows` in one go, which takes hardly longer than one: its operations wait for each
    other. Return False, and change nothing, if either needs exchanges."""
    n = dofs.count
    two = ir.VectorType(_DOUBLE, 2)

    def codegen(ctx, b, sig, args):
        sides = [_Memory(ctx, b, sig.args[0], args[0], args[k], sig.args[k]) for k in (1, 2)]

        def pair(*values):
            out = ir.Constant(two, ir.Undefined)
            for k, value in enumerate(values):
                out = b.insert_element(out, value, ir.Constant(_I32, k))
            return out

        x = [[pair(*(side.number((8 * i + j, 1)) for side in sides)) for j in range(n)] for i in range(n)]
        before = [x[i][i] for i in range(n)]
        pivots = _lu(b, x, n, ir.Constant(two, [1.0, 1.0]))
        least, most = (pair(*[ctx.cast(b, args[k], sig.args[k], f8)] * 2) for k in (3, 4))
        good = ir.Constant(ir.VectorType(ir.IntType(1), 2), [1, 1])
        for p, q in zip(pivots, before):
            size_p, size_q = (_absolute(b, v, two, "v2f64") for v in (p, q))
            good = b.and_(good, b.fcmp_ordered(">=", size_p, _mul(b, least, size_q)))
            good = b.and_(good, b.fcmp_ordered("<=", size_p, _mul(b, most, size_q)))
            good = b.and_(good, b.fcmp_ordered(">", size_p, ir.Constant(two, [0.0, 0.0])))
        both = b.and_(*(b.extract_element(good, ir.Constant(_I32, k)) for k in range(2)))
        with b.if_then(both, likely=True):
            for k, side in enumerate(sides):
                for i in range(n):
                    for j in range(n):
                        side.put_number(b.extract_element(x[i][j], ir.Constant(_I32, k)), (8 * i + j, 1))
        return both
    return types.boolean(a, first, second, low, high, dofs), codegen


@intrinsic
def lu_rows(tc, a, offset, low, high, dofs):
    """Factor one block stored by rows in place. Return False, and change nothing, if a pivot lies outside [low, high] times its
    diagonal entry, or is NaN: then rows have to be exchanged."""
    n = dofs.count

    def codegen(ctx, b, sig, args):
        block = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
        x = [[block.number((8 * i + j, 1)) for j in range(n)] for i in range(n)]
        before = [x[i][i] for i in range(n)]
        pivots = _lu(b, x, n, ir.Constant(_DOUBLE, 1.0))
        least, most = (ctx.cast(b, args[k], sig.args[k], f8) for k in (2, 3))
        good = _TRUE
        for p, q in zip(pivots, before):
            size_p, size_q = (_absolute(b, v, _DOUBLE, "f64") for v in (p, q))
            good = b.and_(good, b.fcmp_ordered(">=", size_p, _mul(b, least, size_q)))
            good = b.and_(good, b.fcmp_ordered("<=", size_p, _mul(b, most, size_q)))
            good = b.and_(good, b.fcmp_ordered(">", size_p, ir.Constant(_DOUBLE, 0.0)))
        with b.if_then(good, likely=True):
            for i in range(n):
                for j in range(n):
                    block.put_number(x[i][j], (8 * i + j, 1))
        return good
    return types.boolean(a, offset, low, high, dofs), codegen


def _make_solve(columns):
    """Make the intrinsic that solves with one factored block for n rows of `columns` numbers, 8 or 1."""
    @intrinsic
    def solve(tc, lu, offset, row, column, x, x_offset, x_row, dofs):
        n = dofs.count

        def codegen(ctx, b, sig, args):
            factors = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
            rows, distance = _int(ctx, b, args[2], sig.args[2]), _int(ctx, b, args[3], sig.args[3])
            panel = _Memory(ctx, b, sig.args[4], args[4], args[5], sig.args[5])
            step = _int(ctx, b, args[6], sig.args[6])
            get, put, repeat = _columns(b, panel, columns)
            w = [get((i, step)) for i in range(n)]
            _triangular(b, lambda i, j: repeat(factors.number((i, rows), (j, distance))), w, n)
            for i in range(n):
                put(w[i], (i, step))
            return ctx.get_dummy_value()
        return types.void(lu, offset, row, column, x, x_offset, x_row, dofs), codegen
    return solve


def _make_subtract(columns):
    """Make the intrinsic that subtracts A X for n rows of `columns` numbers, 8 or 1."""
    @intrinsic
    def subtract(tc, a, offset, row, column, x, x_offset, x_row, y, y_offset, y_row, dofs):
        n = dofs.count

        def codegen(ctx, b, sig, args):
            matrix = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
            rows, distance = _int(ctx, b, args[2], sig.args[2]), _int(ctx, b, args[3], sig.args[3])
            source = _Memory(ctx, b, sig.args[4], args[4], args[5], sig.args[5])
            target = _Memory(ctx, b, sig.args[7], args[7], args[8], sig.args[8])
            x_step, y_step = _int(ctx, b, args[6], sig.args[6]), _int(ctx, b, args[9], sig.args[9])
            w = [_columns(b, source, columns)[0]((k, x_step)) for k in range(n)]
            get, put, repeat = _columns(b, target, columns)
            half = (n + 1) // 2
            out = []
            for i in range(n):
                # two sums of half the length: the latency of a chain of products counts
                f = [repeat(matrix.number((i, rows), (k, distance))) for k in range(n)]
                z = get((i, y_step))
                for k in range(half):
                    z = _sub(b, z, _mul(b, f[k], w[k]))
                t = _mul(b, f[half], w[half])
                for k in range(half + 1, n):
                    t = _add(b, t, _mul(b, f[k], w[k]))
                out.append(_sub(b, z, t))
            for i in range(n):
                put(out[i], (i, y_step))
            return ctx.get_dummy_value()
        return types.void(a, offset, row, column, x, x_offset, x_row, y, y_offset, y_row, dofs), codegen
    return subtract


def _columns(b, memory, columns):
    """Return functions that load and store rows of `columns` numbers, and one that makes a number a factor of such a row."""
    if columns == 1:
        return memory.number, memory.put_number, lambda x: x
    return memory.vector, memory.put_vector, lambda x: _splat(b, x)


@intrinsic
def solve_rows_with_column(tc, lu, offset, x, x_offset, column, column_offset, dofs):
    """Run `solve_rows` for a block at 8 doubles a row, with one more right-hand side in the first column behind its n: the
    numbers there beside the factors, plus n numbers of `column`; below 1e-150 it is zero, as in `lanes.flush_rows`."""
    n = dofs.count

    def codegen(ctx, b, sig, args):
        factors = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
        panel = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
        right = _Memory(ctx, b, sig.args[4], args[4], args[5], sig.args[5])
        w = []
        for i in range(n):
            y = _add(b, right.number((i, 1)), factors.number((8 * i + n, 1)))
            tiny = b.fcmp_ordered("<", _absolute(b, y, _DOUBLE, "f64"), ir.Constant(_DOUBLE, 1e-150))
            y = b.select(tiny, ir.Constant(_DOUBLE, 0.0), y)
            w.append(b.insert_element(panel.vector((8 * i, 1)), y, ir.Constant(_I32, n)))
        _triangular(b, lambda i, j: _splat(b, factors.number((8 * i + j, 1))), w, n)
        for i in range(n):
            panel.put_vector(w[i], (8 * i, 1))
        return ctx.get_dummy_value()
    return types.void(lu, offset, x, x_offset, column, column_offset, dofs), codegen


@intrinsic
def solve_rows_with_last(tc, lu, offset, x, x_offset, dofs):
    """Run `solve_rows` for a block at 8 doubles a row on x, whose last column first takes the last column of the factors' rows;
    there, below 1e-150 it is zero."""
    n = dofs.count

    def codegen(ctx, b, sig, args):
        factors = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
        panel = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
        w = []
        for i in range(n):
            y = factors.number((8 * i + LANES - 1, 1))
            tiny = b.fcmp_ordered("<", _absolute(b, y, _DOUBLE, "f64"), ir.Constant(_DOUBLE, 1e-150))
            y = b.select(tiny, ir.Constant(_DOUBLE, 0.0), y)
            w.append(b.insert_element(panel.vector((8 * i, 1)), y, ir.Constant(_I32, LANES - 1)))
        _triangular(b, lambda i, j: _splat(b, factors.number((8 * i + j, 1))), w, n)
        for i in range(n):
            panel.put_vector(w[i], (8 * i, 1))
        return ctx.get_dummy_value()
    return types.void(lu, offset, x, x_offset, dofs), codegen


# X <- A^-1 X for one factored block and n rows of 8 numbers, or of one, x_row doubles apart
solve_rows, solve_column = _make_solve(LANES), _make_solve(1)
# Y -= A X for one block and n rows of 8 numbers, or of one, of X and Y
subtract_rows, subtract_column = _make_subtract(LANES), _make_subtract(1)

__all__ = ["FOUR", "ONE", "SIX", "THREE", "TWELVE", "TWO", "lu_lanes", "lu_rows", "lu_two", "solve_column", "solve_lanes",
           "solve_rows", "solve_rows_with_column", "solve_rows_with_last", "subtract_column", "subtract_lanes", "subtract_rows"]
