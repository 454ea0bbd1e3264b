"""Rows of numbers (coordinates or unknowns of nodes) between memory and lanes, eight rows at a time, transposed in registers.

Most functions are, like vectors.py, lowered straight to LLVM; loads and stores are unchecked, offsets count doubles.

Arrays: of any length: source, target, x [*].
"""
from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from fastbeam.kernels.algebra.vectors import _DOUBLE, _I32, _I64, _VECTOR, LANES, _add, _data, _int, _pointer, vec, vld, vst
from fastbeam.kernels.jit.decorators import kernel


def _make_flush(columns):
    kind, name = (_VECTOR, "v8f64") if columns == LANES else (_DOUBLE, "f64")

    def constant(x):
        return ir.Constant(kind, [x] * LANES if columns == LANES else x)

    @intrinsic
    def flush(tc, array, offset, stride, dofs):
        def codegen(ctx, b, sig, args):
            o, step = _int(ctx, b, args[1], sig.args[1]), _int(ctx, b, args[2], sig.args[2])
            data = _data(ctx, b, sig.args[0], args[0])
            absolute = cgutils.get_or_insert_function(b.module, ir.FunctionType(kind, [kind]), f"llvm.fabs.{name}")
            for _ in range(dofs.count):
                p = b.bitcast(b.gep(data, [o]), kind.as_pointer())
                x = b.load(p, align=8)
                tiny = b.fcmp_ordered("<", b.call(absolute, [x]), constant(1e-150))
                b.store(b.select(tiny, constant(0.0), x), p, align=8)
                o = b.add(o, step)
            return ctx.get_dummy_value()
        return types.void(array, offset, stride, dofs), codegen
    return flush


# Zero for entries below 1e-150 in as many rows of 8 numbers, or of one, as the tuple `dofs` has numbers. Columns that decay along
# a chain would end in denormal numbers, which the processor handles many times slower; NaN stays.
flush_rows, flush_column = _make_flush(LANES), _make_flush(1)


def _shuffle(b, x, y, mask):
    return b.shuffle_vector(x, y, ir.Constant(ir.VectorType(_I32, len(mask)), list(mask)))


def _transpose(b, rows, width):
    """Transpose rows of `width` numbers, as many in blocks of that width, block by block."""
    rows = list(rows)
    n = rows[0].type.count
    step = width // 2
    while step:
        new = [None] * len(rows)
        for i in range(len(rows)):
            if not i & step:
                x, y = rows[i], rows[i + step]
                new[i] = _shuffle(b, x, y, [j if not j & step else n + j - step for j in range(n)])
                new[i + step] = _shuffle(b, x, y, [j + step if not j & step else n + j for j in range(n)])
        rows = new
        step //= 2
    return rows


def _make_rows(accumulate):
    @intrinsic
    def rows(tc, source, offset, index, index_offset, scale, shift, target, dofs):
        def codegen(ctx, b, sig, args):
            src, o, idx, io, scale_, shift_, dst, _ = args
            t_src, t_o, t_idx, t_io, t_scale, t_shift, t_dst, t_size = sig.args
            o, io = _int(ctx, b, o, t_o), _int(ctx, b, io, t_io)
            scale_, shift_ = _int(ctx, b, scale_, t_scale), _int(ctx, b, shift_, t_shift)
            p = _pointer(ctx, b, t_src, src, o, vec)
            rows = [b.load(b.gep(p, [ir.Constant(_I64, c)]), align=8) for c in range(t_size.count)]
            rows += [ir.Constant(_VECTOR, [0.0] * LANES)] * (LANES - t_size.count)
            rows = _transpose(b, rows, LANES)
            indices = _data(ctx, b, t_idx, idx)
            for lane in range(8):
                k = b.load(b.gep(indices, [b.add(io, ir.Constant(_I64, lane))]))
                q = _pointer(ctx, b, t_dst, dst, b.add(b.mul(k, scale_), shift_), vec)
                b.store(_add(b, b.load(q, align=8), rows[lane]) if accumulate else rows[lane], q, align=8)
            return ctx.get_dummy_value()
        return types.void(source, offset, index, index_offset, scale, shift, target, dofs), codegen
    return rows


# n lane columns to 8 rows, n the length of the tuple `dofs`: for lane l, target[index[index_offset + l]*scale + shift + c] takes
# source[offset + 8 c + l], c < n. An 8 x 8 transposition in registers; rows are padded to 8 doubles. The first adds and leaves
# the pads as they are, the second overwrites and puts zeros there.
scatter_rows, put_rows = _make_rows(True), _make_rows(False)


def _gather(b, pointers, n, target, padded):
    """Gather numbers c = 0..n-1 of 8 rows, whose addresses are given, in lanes to target + 8 c, by transpositions in registers:
    one by one they take three times as long. padded: whether up to 8 numbers of a shorter row may be read."""
    done = 0
    while done < n:
        left = n - done
        # the first step of a transposition of 8 is free where rows are loaded by halves
        width = 4 if left >= 4 or padded and n < LANES else 1
        kind = (ir.VectorType(_DOUBLE, width) if width > 1 else _DOUBLE).as_pointer()
        rows = [b.load(b.bitcast(b.gep(p, [ir.Constant(_I64, done)]), kind), align=8) for p in pointers]
        if width == 1:
            row = ir.Constant(_VECTOR, ir.Undefined)
            for lane in range(LANES):
                row = b.insert_element(row, rows[lane], ir.Constant(_I32, lane))
            rows = [row]
        else:
            rows = _transpose(b, [_shuffle(b, rows[k], rows[k + 4], range(8)) for k in range(4)], 4)
        for row in rows[:left]:
            b.store(row, b.gep(target, [ir.Constant(_I64, done)]), align=8)
            done += 1


def _rows_of_lanes(ctx, b, array_type, array, index, io, scale):
    """Return the addresses of the rows of 8 lanes."""
    data = _data(ctx, b, array_type, array)
    return [b.gep(data, [b.mul(b.load(b.gep(index, [b.add(io, ir.Constant(_I64, lane))])), scale)]) for lane in range(LANES)]


@intrinsic
def gather_lanes(tc, source, index, index_offset, scale, target, offset, dofs):
    """Gather target[offset + 8 c + l] = source[index[index_offset + l]*scale + c] for the lanes l = 0..7 and c = 0..n-1, n the
    length of the tuple `dofs`. Rows of less than 8 numbers (but 4) are read as longer ones: behind the last row of an array there
    has to be room for 3 numbers."""
    def codegen(ctx, b, sig, args):
        src, idx, io, scale_, dst, o, _ = args
        t_src, t_idx, t_io, t_scale, t_dst, t_o, t_size = sig.args
        io, scale_, o = (_int(ctx, b, x, t) for x, t in ((io, t_io), (scale_, t_scale), (o, t_o)))
        rows = _rows_of_lanes(ctx, b, t_src, src, _data(ctx, b, t_idx, idx), io, scale_)
        _gather(b, rows, t_size.count, _pointer(ctx, b, t_dst, dst, o, vec), True)
        return ctx.get_dummy_value()
    return types.void(source, index, index_offset, scale, target, offset, dofs), codegen


@intrinsic
def load_rows(tc, source, first, distance, target, offset, dofs):
    """Run `gather_lanes` for 8 rows that begin at `first` and follow each other at `distance` doubles."""
    def codegen(ctx, b, sig, args):
        first_, distance_, o = (_int(ctx, b, args[k], sig.args[k]) for k in (1, 2, 4))
        begin = b.gep(_data(ctx, b, sig.args[0], args[0]), [first_])
        rows = [b.gep(begin, [b.mul(distance_, ir.Constant(_I64, lane))]) for lane in range(LANES)]
        _gather(b, rows, sig.args[5].count, _pointer(ctx, b, sig.args[3], args[3], o, vec), False)
        return ctx.get_dummy_value()
    return types.void(source, first, distance, target, offset, dofs), codegen


@intrinsic
def store_rows(tc, source, offset, target, first, distance, dofs):
    """Store n numbers in lanes in 8 rows, the reverse of `load_rows`."""
    def codegen(ctx, b, sig, args):
        o, first_, distance_ = (_int(ctx, b, args[k], sig.args[k]) for k in (1, 3, 4))
        p = _pointer(ctx, b, sig.args[0], args[0], o, vec)
        begin = b.gep(_data(ctx, b, sig.args[2], args[2]), [first_])
        rows = [b.gep(begin, [b.mul(distance_, ir.Constant(_I64, lane))]) for lane in range(LANES)]
        n, done = sig.args[5].count, 0
        while done < n:
            width = 4 if n - done >= 4 else 1
            lanes = [b.load(b.gep(p, [ir.Constant(_I64, done + k)]), align=8) for k in range(width)]
            if width == 4:
                lanes = _transpose(b, lanes, 4)
                parts = [_shuffle(b, lanes[k % 4], lanes[k % 4], range(k // 4 * 4, k // 4 * 4 + 4)) for k in range(LANES)]
            else:
                parts = [b.extract_element(lanes[0], ir.Constant(_I32, k)) for k in range(LANES)]
            for row, part in zip(rows, parts):
                b.store(part, b.bitcast(b.gep(row, [ir.Constant(_I64, done)]), part.type.as_pointer()), align=8)
            done += width
        return ctx.get_dummy_value()
    return types.void(source, offset, target, first, distance, dofs), codegen


@kernel
def copy_lanes(source, offset, count, target, to):
    """Copy `count` doubles, a multiple of 8."""
    for i in range(0, count, 8):
        vst(target, to + i, 0, vld(source, offset + i, 0))


@kernel
def clear_lanes(x, offset, count):
    """Set `count` doubles, a multiple of 8, to zero."""
    for i in range(offset, offset + count, 8):
        vst(x, i, 0, 0.0)
