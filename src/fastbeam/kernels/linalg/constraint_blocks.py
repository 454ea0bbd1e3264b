"""Blocks of sliders and of moments of sleeves written out in LLVM like those of nodes in blocks.py: m = 7 unknowns of a slider,
6 of the moments, beside n = 6 of a node in space, 5 and 2 beside 3 in a plane.

Blocks are rows of 8 doubles of one array; the last column of a diagonal block has the right-hand side. `dofs` is the tuple of n
numbers.
"""
from __future__ import annotations

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from fastbeam.kernels.algebra.blocks import _absolute, _columns, _Memory, _triangular
from fastbeam.kernels.algebra.vectors import _DOUBLE, _I32, _I64, _VECTOR, LANES, _add, _div, _int, _mul, _splat, _sub, f8

_NODE, _SLIDER, _MOMENTS = (lambda n: n), (lambda n: 7 if n == 6 else 5), (lambda n: 6 if n == 6 else 2)
# forces of a constraint, and whether the equation behind theirs is in the unit of a force
_POINT, _SECTION = (lambda n: 3 if n == 6 else 2, True), (lambda n: 3 if n == 6 else 1, False)
_FLAGS_OF_ROW = ir.VectorType(ir.IntType(1), LANES)


def _make_subtract(height, width, columns):
    """Make the intrinsic Y -= A X for a block A of a slider, or between one and a node, `row` and `column` the distances between
    its entries; rows of X, Y have `columns` numbers, 8 or 1."""
    @intrinsic
    def subtract(tc, a, offset, row, column, x, x_offset, x_row, y, y_offset, y_row, dofs):
        n, m = height(dofs.count), width(dofs.count)

        def codegen(ctx, b, sig, args):
            matrix = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
            rows, distance = _int(ctx, b, args[2], sig.args[2]), _int(ctx, b, args[3], sig.args[3])
            source = _Memory(ctx, b, sig.args[4], args[4], args[5], sig.args[5])
            target = _Memory(ctx, b, sig.args[7], args[7], args[8], sig.args[8])
            x_step, y_step = _int(ctx, b, args[6], sig.args[6]), _int(ctx, b, args[9], sig.args[9])
            w = [_columns(b, source, columns)[0]((k, x_step)) for k in range(m)]
            get, put, repeat = _columns(b, target, columns)
            half = (m + 1) // 2
            for i in range(n):
                # two sums of half the length: the latency of a chain of products counts
                f = [repeat(matrix.number((i, rows), (k, distance))) for k in range(m)]
                z = get((i, y_step))
                for k in range(half):
                    z = _sub(b, z, _mul(b, f[k], w[k]))
                t = _mul(b, f[half], w[half])
                for k in range(half + 1, m):
                    t = _add(b, t, _mul(b, f[k], w[k]))
                put(_sub(b, z, t), (i, y_step))
            return ctx.get_dummy_value()
        return types.void(a, offset, row, column, x, x_offset, x_row, y, y_offset, y_row, dofs), codegen
    return subtract


# named by the rows of Y, then the rows of X
subtract_on_slider, subtract_slider_on_node, subtract_slider_on_slider = (
    _make_subtract(height, width, LANES) for height, width in ((_SLIDER, _NODE), (_NODE, _SLIDER), (_SLIDER, _SLIDER)))
column_on_slider, column_slider_on_node, column_slider_on_slider = (
    _make_subtract(height, width, 1) for height, width in ((_SLIDER, _NODE), (_NODE, _SLIDER), (_SLIDER, _SLIDER)))


def _some(lanes):
    """Return a mask of some lanes."""
    return ir.Constant(_FLAGS_OF_ROW, [int(k in lanes) for k in range(LANES)])


def _repeat(b, row, k):
    """Return lane k of a row in all lanes."""
    return b.shuffle_vector(row, ir.Constant(row.type, ir.Undefined), ir.Constant(ir.VectorType(_I32, LANES), [k] * LANES))


def _make_factor(size, kind):
    forces_of, slides = kind

    @intrinsic
    def factor(tc, a, offset, pivots, p, c, soft, first, force, f, dofs):
        """Scale and factor the diagonal block of a constraint of compliance c, theory.md 9. Returns its smallest pivot, 0 where
        there is none.

        `soft` is added to the diagonal of the forces, `first` times force[f:] is taken from their right-hand sides. Columns of
        forces are divided by c, the row of sliding is multiplied by it. Then LU with exchange of rows, reciprocal pivots on the
        diagonal; pivots [m] from p on: the row that stood there. The right-hand side is exchanged too.
        """
        m, d = size(dofs.count), forces_of(dofs.count)

        def codegen(ctx, b, sig, args):
            block = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
            exchanges = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
            forces = _Memory(ctx, b, sig.args[7], args[7], args[8], sig.args[8])
            compliance, more, share = (ctx.cast(b, args[k], sig.args[k], f8) for k in (4, 5, 6))
            one, zeros = ir.Constant(_DOUBLE, 1.0), ir.Constant(_VECTOR, [0.0] * LANES)
            rows = [block.vector((8 * i, 1)) for i in range(m)]
            for i in range(d):
                added = b.insert_element(zeros, more, ir.Constant(_I32, i))
                right = _sub(b, ir.Constant(_DOUBLE, 0.0), _mul(b, share, forces.number((i, 1))))
                rows[i] = _add(b, rows[i], b.insert_element(added, right, ir.Constant(_I32, LANES - 1)))
            units = b.select(_some(range(d)), _splat(b, _div(b, one, compliance)), ir.Constant(_VECTOR, [1.0] * LANES))
            rows = [_mul(b, row, units) for row in rows]
            if slides:
                rows[d] = _mul(b, rows[d], _splat(b, compliance))
            places = [ir.Constant(ir.VectorType(_I64, LANES), [i] * LANES) for i in range(m)]
            least, good = ir.Constant(_DOUBLE, float("inf")), ir.IntType(1)(1)
            for k in range(m):
                for i in range(k + 1, m):
                    sizes = [_absolute(b, _repeat(b, rows[j], k), _VECTOR, f"v{LANES}f64") for j in (k, i)]
                    larger = b.fcmp_ordered(">", sizes[1], sizes[0])
                    for some in (rows, places):
                        some[k], some[i] = b.select(larger, some[i], some[k]), b.select(larger, some[k], some[i])
                pivot = b.extract_element(rows[k], ir.Constant(_I32, k))
                v = _absolute(b, pivot, _DOUBLE, "f64")
                good = b.and_(good, b.fcmp_ordered(">", v, ir.Constant(_DOUBLE, 0.0)))
                least = b.select(b.fcmp_ordered("<", v, least), v, least)
                inverse = _splat(b, _div(b, one, pivot))
                # columns of earlier factors and the right-hand side do not take part
                right_of = b.select(_some(range(k + 1, m)), rows[k], zeros)
                for i in range(k + 1, m):
                    factor = _mul(b, _repeat(b, rows[i], k), inverse)
                    rows[i] = b.select(_some([k]), factor, _sub(b, rows[i], _mul(b, factor, right_of)))
                rows[k] = b.select(_some([k]), inverse, rows[k])
            for i in range(m):
                block.put_vector(rows[i], (8 * i, 1))
                place = b.extract_element(places[i], ir.Constant(_I32, 0))
                to = b.gep(exchanges.data, [b.add(exchanges.offset, ir.Constant(_I64, i))])
                b.store(b.trunc(place, to.type.pointee), to)
            return b.select(good, least, ir.Constant(_DOUBLE, 0.0))
        return types.float64(a, offset, pivots, p, c, soft, first, force, f, dofs), codegen
    return factor


def _make_solve(size, kind, right):
    """Make the intrinsic that solves with a factored constraint for a block; right: the right-hand side beside the factors is the
    last column."""
    forces_of, slides = kind

    @intrinsic
    def solve(tc, a, offset, pivots, p, c, u, dofs):
        m, d = size(dofs.count), forces_of(dofs.count)

        def codegen(ctx, b, sig, args):
            factors = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
            exchanges = _Memory(ctx, b, sig.args[2], args[2], args[3], sig.args[3])
            block = _Memory(ctx, b, sig.args[0], args[0], args[5], sig.args[5])
            compliance = ctx.cast(b, args[4], sig.args[4], f8)
            if slides:
                block.put_vector(_mul(b, block.vector((8 * d, 1)), _splat(b, compliance)), (8 * d, 1))
            w = []
            for i in range(m):
                at = b.load(b.gep(exchanges.data, [b.add(exchanges.offset, ir.Constant(_I64, i))]))
                at = b.sext(at, _I64)
                row = block.vector((8, at))
                if right:
                    row = b.insert_element(row, factors.number((8 * i + LANES - 1, 1)), ir.Constant(_I32, LANES - 1))
                w.append(row)
            _triangular(b, lambda i, j: _splat(b, factors.number((8 * i + j, 1))), w, m)
            inverse = _splat(b, _div(b, ir.Constant(_DOUBLE, 1.0), compliance))
            for i in range(m):
                block.put_vector(_mul(b, w[i], inverse) if i < d else w[i], (8 * i, 1))
            return ctx.get_dummy_value()
        return types.void(a, offset, pivots, p, c, u, dofs), codegen
    return solve


def _make_solve_right(size, kind):
    @intrinsic
    def solve(tc, a, offset, c, dofs):
        """Solve with D for the right-hand side beside the factors of a constraint of compliance c, forces in their own unit."""
        m, d = size(dofs.count), kind[0](dofs.count)

        def codegen(ctx, b, sig, args):
            factors = _Memory(ctx, b, sig.args[0], args[0], args[1], sig.args[1])
            inverse = _div(b, ir.Constant(_DOUBLE, 1.0), ctx.cast(b, args[2], sig.args[2], f8))
            w = [factors.number((8 * i + LANES - 1, 1)) for i in range(m)]
            _triangular(b, lambda i, j: factors.number((8 * i + j, 1)), w, m)
            for i in range(m):
                factors.put_number(_mul(b, w[i], inverse) if i < d else w[i], (8 * i + LANES - 1, 1))
            return ctx.get_dummy_value()
        return types.void(a, offset, c, dofs), codegen
    return solve


factor_slider, factor_moments = _make_factor(_SLIDER, _POINT), _make_factor(_MOMENTS, _SECTION)
# block at u <- D^-1 of it behind the factored diagonal block of a constraint of compliance c, forces in their own unit
solve_behind_slider, solve_behind_slider_with_right = (_make_solve(_SLIDER, _POINT, right) for right in (False, True))
solve_behind_moments, solve_behind_moments_with_right = (_make_solve(_MOMENTS, _SECTION, right) for right in (False, True))
solve_right_of_slider, solve_right_of_moments = _make_solve_right(_SLIDER, _POINT), _make_solve_right(_MOMENTS, _SECTION)


__all__ = ["column_on_slider", "column_slider_on_node", "column_slider_on_slider", "factor_moments", "factor_slider",
           "solve_behind_moments", "solve_behind_moments_with_right", "solve_behind_slider", "solve_behind_slider_with_right",
           "solve_right_of_moments", "solve_right_of_slider", "subtract_on_slider", "subtract_slider_on_node",
           "subtract_slider_on_slider"]
