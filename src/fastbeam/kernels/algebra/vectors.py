"""Small algebra inside compiled code: values that LLVM keeps in registers.

`Vec` is 8 doubles (one per element of a group) or as many of them as a register of the processor holds, `V2`, `V3` are vectors
and `M3` is a 3 x 3 matrix whose entries are lanes; a lane is a float64 or a Vec. The operators are lowered straight to LLVM, one
statement a formula, so the same source is readable as theory, runs one element or eight at a time, and leaves numba's front end
few statements to type. Loads and stores are unchecked: offsets count doubles from the start of a contiguous array.
"""
from __future__ import annotations

import operator

from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

LANES = 8
# lanes that are worked on at a time: a processor without AVX-512 has 16 registers of 4 doubles, which do not hold 8 lanes of a
# matrix
WIDTH = LANES if binding.get_host_cpu_features().get("avx512f") else LANES // 2
_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_I32 = ir.IntType(32)
_I64 = ir.IntType(64)
_FLAGS = ("contract",)


class VecType(types.Type):
    """Vector of 8 doubles, or of WIDTH."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        super().__init__(f"fastbeam.Vec{lanes}")

    @property
    def key(self):
        return self.lanes


vec, native = VecType(LANES), VecType(WIDTH)
f8 = types.float64
_KINDS = tuple(dict.fromkeys((vec, native)))


class SmallType(types.Type):
    """n lanes: a vector (n = 2, 3) or a 3 x 3 matrix stored by rows (n = 9)."""

    def __init__(self, lane: types.Type, n: int) -> None:
        self.lane, self.n = lane, n
        super().__init__(f"fastbeam.Small{n}({lane.name})")

    @property
    def key(self):
        return (self.lane, self.n)


V2 = {lane: SmallType(lane, 2) for lane in (*_KINDS, f8)}
V3 = {lane: SmallType(lane, 3) for lane in (*_KINDS, f8)}
M3 = {lane: SmallType(lane, 9) for lane in (*_KINDS, f8)}


def _lane_ir(lane):
    return ir.VectorType(_DOUBLE, lane.lanes) if isinstance(lane, VecType) else _DOUBLE


@register_model(VecType)
class _VecModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _lane_ir(fe_type))


@register_model(SmallType)
class _SmallModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, ir.LiteralStructType([_lane_ir(fe_type.lane)] * fe_type.n))


# ---------------------------------------------------------------------------------------------------- IR helpers
def _splat(b, x, lanes=LANES):
    empty = ir.Constant(ir.VectorType(_DOUBLE, lanes), ir.Undefined)
    return b.shuffle_vector(b.insert_element(empty, x, ir.Constant(_I32, 0)), empty,
                            ir.Constant(ir.VectorType(_I32, lanes), [0] * lanes))


def _as_lane(ctx, b, x, ty, lane):
    """Return x as a value of `lane`: numbers are cast to float64 and repeated where the lane is a Vec."""
    if isinstance(ty, VecType):
        return x
    x = ctx.cast(b, x, ty, f8)
    return _splat(b, x, lane.lanes) if isinstance(lane, VecType) else x


def _parts(b, value, n):
    return [b.extract_value(value, i) for i in range(n)]


def _pack(b, lane, xs):
    out = ir.Constant(ir.LiteralStructType([_lane_ir(lane)] * len(xs)), ir.Undefined)
    for i, x in enumerate(xs):
        out = b.insert_value(out, x, i)
    return out


def _add(b, x, y):
    return b.fadd(x, y, flags=_FLAGS)


def _sub(b, x, y):
    return b.fsub(x, y, flags=_FLAGS)


def _mul(b, x, y):
    return b.fmul(x, y, flags=_FLAGS)


def _div(b, x, y):
    return b.fdiv(x, y, flags=_FLAGS)


def _int(ctx, b, x, ty):
    return ctx.cast(b, x, ty, types.intp)


def _data(ctx, b, array_type, array):
    """Return the address of an array's numbers, taken out of the value: ctx.make_array would write the array to memory first,
    which is half of the code of a load."""
    if isinstance(array_type, types.CPointer):
        return array
    return b.extract_value(array, ctx.data_model_manager[array_type].get_field_position("data"))


def _pointer(ctx, b, array_type, array, offset, lane):
    return b.bitcast(b.gep(_data(ctx, b, array_type, array), [offset]), _lane_ir(lane).as_pointer())


@intrinsic
def address(tc, array, offset):
    """Return the address of an array from an offset on, for loads and stores of this file: one word in place of the seven of an
    array, which every call that is not inlined passes."""
    def codegen(ctx, b, sig, args):
        return b.gep(_data(ctx, b, sig.args[0], args[0]), [_int(ctx, b, args[1], sig.args[1])])
    return types.CPointer(f8)(array, offset), codegen


# ---------------------------------------------------------------------------------------------------- operators
def _register(op, cases, lower):
    infer_global(op)(type("Small_" + op.__name__, (ConcreteTemplate,), {"cases": cases}))
    for case in cases:
        lower_builtin(op, *case.args)(lower)


def _vec_operator(ops, f):
    def lower(ctx, b, sig, args):
        return f(b, *(_as_lane(ctx, b, x, t, sig.return_type) for x, t in zip(args, sig.args)))

    for op in ops:
        _register(op, [signature(v, *pair) for v in _KINDS for pair in ((v, v), (v, f8), (f8, v))], lower)


_vec_operator((operator.add, operator.iadd), _add)
_vec_operator((operator.sub, operator.isub), _sub)
_vec_operator((operator.mul, operator.imul), _mul)
_vec_operator((operator.truediv, operator.itruediv), _div)


def _elementwise(op, f):
    def lower(ctx, b, sig, args):
        r = sig.return_type
        return _pack(b, r.lane, [f(b, x, y) for x, y in zip(_parts(b, args[0], r.n), _parts(b, args[1], r.n))])

    _register(op, [signature(t, t, t) for kind in (V2, V3, M3) for t in kind.values()], lower)


for _op in (operator.add, operator.iadd):
    _elementwise(_op, _add)
for _op in (operator.sub, operator.isub):
    _elementwise(_op, _sub)


def _scale(ctx, b, sig, args):
    r = sig.return_type
    s = _as_lane(ctx, b, args[0], sig.args[0], r.lane)
    return _pack(b, r.lane, [_mul(b, s, x) for x in _parts(b, args[1], r.n)])


_register(operator.mul, [signature(kind[lane], scalar, kind[lane]) for kind in (V2, V3, M3)
                         for lane, scalar in ((f8, f8), *((v, s) for v in _KINDS for s in (v, f8)))], _scale)


# ---------------------------------------------------------------------------------------------------- formulas
@intrinsic
def dot(tc, u, v):
    """Return u . v"""
    def codegen(ctx, b, sig, args):
        x, y = _parts(b, args[0], u.n), _parts(b, args[1], u.n)
        out = _mul(b, x[0], y[0])
        for p, q in zip(x[1:], y[1:]):
            out = _add(b, out, _mul(b, p, q))
        return out
    return u.lane(u, v), codegen


def _make_component(i):
    @intrinsic
    def component(tc, u):
        def codegen(ctx, b, sig, args):
            return b.extract_value(args[0], i)
        return u.lane(u), codegen
    return component


component0, component1, component2 = (_make_component(i) for i in range(3))


@intrinsic
def put_first(tc, array, offset, x):
    """Store a row of 8 with one number and seven zeros."""
    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        row = b.insert_element(ir.Constant(_VECTOR, [0.0] * LANES), ctx.cast(b, args[2], sig.args[2], f8), ir.Constant(_I32, 0))
        b.store(row, _pointer(ctx, b, sig.args[0], args[0], o, vec), align=8)
        return ctx.get_dummy_value()
    return types.void(array, offset, x), codegen


@intrinsic
def cross(tc, u, v):
    """Return u x v"""
    def codegen(ctx, b, sig, args):
        x, y = _parts(b, args[0], 3), _parts(b, args[1], 3)
        return _pack(b, sig.return_type.lane, [
            _sub(b, _mul(b, x[(i + 1) % 3], y[(i + 2) % 3]), _mul(b, x[(i + 2) % 3], y[(i + 1) % 3])) for i in range(3)])
    return u(u, v), codegen


@intrinsic
def cross2(tc, u, v):
    """Return the component of u x v normal to the plane, 2-vectors."""
    def codegen(ctx, b, sig, args):
        x, y = _parts(b, args[0], 2), _parts(b, args[1], 2)
        return _sub(b, _mul(b, x[0], y[1]), _mul(b, x[1], y[0]))
    return u.lane(u, v), codegen


@intrinsic
def perp(tc, u):
    """Return a 2-vector turned by a right angle: normal x u."""
    def codegen(ctx, b, sig, args):
        x, y = _parts(b, args[0], 2)
        zero = ir.Constant(y.type, [0.0] * u.lane.lanes if isinstance(u.lane, VecType) else 0.0)
        return _pack(b, u.lane, [_sub(b, zero, y), x])
    return u(u), codegen


@intrinsic
def outer(tc, u, v):
    """Return u v^T"""
    def codegen(ctx, b, sig, args):
        x, y = _parts(b, args[0], 3), _parts(b, args[1], 3)
        return _pack(b, sig.return_type.lane, [_mul(b, x[i], y[j]) for i in range(3) for j in range(3)])
    return M3[u.lane](u, v), codegen


@intrinsic
def add_iso(tc, m, t):
    """Return m + t I"""
    def codegen(ctx, b, sig, args):
        x = _parts(b, args[0], 9)
        t_ = _as_lane(ctx, b, args[1], sig.args[1], sig.return_type.lane)
        for i in (0, 4, 8):
            x[i] = _add(b, x[i], t_)
        return _pack(b, sig.return_type.lane, x)
    return m(m, t), codegen


@intrinsic
def add_skew(tc, m, z):
    """Return m + skew(z), skew(z) w = z x w"""
    def codegen(ctx, b, sig, args):
        x, z = _parts(b, args[0], 9), _parts(b, args[1], 3)
        for i, f, c in ((1, _sub, 2), (2, _add, 1), (3, _add, 2), (5, _sub, 0), (6, _sub, 1), (7, _add, 0)):
            x[i] = f(b, x[i], z[c])
        return _pack(b, sig.return_type.lane, x)
    return m(m, z), codegen


@intrinsic
def triple(tc, x, y, z):
    """Return three lanes as a vector."""
    return V3[x](x, y, z), lambda ctx, b, sig, args: _pack(b, x, args)


# ---------------------------------------------------------------------------------------------------- memory
def make_load(lane, n):
    result = lane if n == 1 else {2: V2, 3: V3, 9: M3}[n][lane]

    @intrinsic
    def load(tc, array, offset, stride):
        def codegen(ctx, b, sig, args):
            o, step = _int(ctx, b, args[1], sig.args[1]), _int(ctx, b, args[2], sig.args[2])
            xs = []
            for _ in range(n):
                xs.append(b.load(_pointer(ctx, b, sig.args[0], args[0], o, lane), align=8))
                o = b.add(o, step)
            return xs[0] if n == 1 else _pack(b, lane, xs)
        return result(array, offset, stride), codegen
    return load


def make_store(lane, n, accumulate):
    @intrinsic
    def store(tc, array, offset, stride, value):
        def codegen(ctx, b, sig, args):
            o, step = _int(ctx, b, args[1], sig.args[1]), _int(ctx, b, args[2], sig.args[2])
            xs = [_as_lane(ctx, b, args[3], sig.args[3], lane)] if n == 1 else _parts(b, args[3], n)
            for x in xs:
                p = _pointer(ctx, b, sig.args[0], args[0], o, lane)
                if accumulate:
                    x = _add(b, b.load(p, align=8), x)
                b.store(x, p, align=8)
                o = b.add(o, step)
            return ctx.get_dummy_value()
        return types.void(array, offset, stride, value), codegen
    return store


def make_store_matrix(lane, accumulate):
    @intrinsic
    def store(tc, array, offset, row_stride, column_stride, value):
        def codegen(ctx, b, sig, args):
            o, rs, cs = (_int(ctx, b, args[k], sig.args[k]) for k in (1, 2, 3))
            xs = _parts(b, args[4], 9)
            for i in range(3):
                q = o
                for j in range(3):
                    p = _pointer(ctx, b, sig.args[0], args[0], q, lane)
                    x = xs[3 * i + j]
                    if accumulate:
                        x = _add(b, b.load(p, align=8), x)
                    b.store(x, p, align=8)
                    q = b.add(q, cs)
                o = b.add(o, rs)
            return ctx.get_dummy_value()
        return types.void(array, offset, row_stride, column_stride, value), codegen
    return store


def make_zero(lane, n):
    result = lane if n == 1 else {2: V2, 3: V3, 9: M3}[n][lane]

    @intrinsic
    def zero(tc):
        def codegen(ctx, b, sig, args):
            z = ir.Constant(_lane_ir(lane), [0.0] * lane.lanes if isinstance(lane, VecType) else 0.0)
            return z if n == 1 else _pack(b, lane, [z] * n)
        return result(), codegen
    return zero


# 8 lanes: (array, offset, stride[, value]); stride between the components, in doubles
vld, vld3, vldm = make_load(vec, 1), make_load(vec, 3), make_load(vec, 9)
vst, vst3, vstm = make_store(vec, 1, False), make_store(vec, 3, False), make_store(vec, 9, False)
vadd3 = make_store(vec, 3, True)
vst_matrix, vadd_matrix = make_store_matrix(vec, False), make_store_matrix(vec, True)
vzero, vzero3, vzerom = make_zero(vec, 1), make_zero(vec, 3), make_zero(vec, 9)
vld2, vst2, vadd2, vzero2 = make_load(vec, 2), make_store(vec, 2, False), make_store(vec, 2, True), make_zero(vec, 2)
# one lane
ld1, st1 = make_load(f8, 1), make_store(f8, 1, False)
ld2, st2, add2, zero2 = make_load(f8, 2), make_store(f8, 2, False), make_store(f8, 2, True), make_zero(f8, 2)
ld3, st3, add3 = make_load(f8, 3), make_store(f8, 3, False), make_store(f8, 3, True)
add_matrix = make_store_matrix(f8, True)
zero3, zerom = make_zero(f8, 3), make_zero(f8, 9)


@intrinsic
def total(tc, x):
    """Sum of the 8 numbers of a vector."""
    def codegen(ctx, b, sig, args):
        x, n = args[0], LANES
        while n > 1:
            n //= 2
            halves = [b.shuffle_vector(x, ir.Constant(x.type, ir.Undefined), ir.Constant(ir.VectorType(_I32, n), list(some)))
                      for some in (range(n), range(n, 2 * n))]
            x = _add(b, *halves)
        return b.extract_element(x, ir.Constant(_I32, 0))
    return f8(vec), codegen


@intrinsic
def largest_of_row(tc, array, offset):
    """Return the largest absolute value of 8 entries; NaN is skipped."""
    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        x = b.load(_pointer(ctx, b, sig.args[0], args[0], o, vec), align=8)
        absolute = cgutils.get_or_insert_function(b.module, ir.FunctionType(_VECTOR, [_VECTOR]), "llvm.fabs.v8f64")
        largest = cgutils.get_or_insert_function(b.module, ir.FunctionType(_DOUBLE, [_VECTOR]), "llvm.vector.reduce.fmax.v8f64")
        return b.call(largest, [b.call(absolute, [x])])
    return f8(array, offset), codegen


@intrinsic
def largest(tc, x, y):
    """Return the larger of two sizes, lane by lane; x if it is NaN, and y if that is."""
    def codegen(ctx, b, sig, args):
        absolute = cgutils.get_or_insert_function(b.module, ir.FunctionType(_VECTOR, [_VECTOR]), "llvm.fabs.v8f64")
        magnitude = b.call(absolute, [args[0]])
        takes = b.or_(b.fcmp_ordered(">", magnitude, args[1]), b.fcmp_unordered("uno", magnitude, magnitude))
        return b.select(takes, magnitude, args[1])
    return vec(x, y), codegen


@intrinsic
def smaller(tc, x, y):
    """Return the smaller of two numbers, lane by lane; y if one of them is NaN."""
    def codegen(ctx, b, sig, args):
        return b.select(b.fcmp_ordered("<", *args), *args)
    return x(x, y), codegen


@intrinsic
def square_root(tc, x):
    """Return square roots lane by lane, NaN where a number is negative."""
    def codegen(ctx, b, sig, args):
        lanes = _lane_ir(x)
        name = f"llvm.sqrt.v{x.lanes}f64"
        return b.call(cgutils.get_or_insert_function(b.module, ir.FunctionType(lanes, [lanes]), name), [args[0]])
    return x(x), codegen


@intrinsic
def root(tc, x):
    """Return square roots lane by lane, zero where a number is negative."""
    def codegen(ctx, b, sig, args):
        positive = b.select(b.fcmp_ordered(">", args[0], ir.Constant(_VECTOR, [0.0] * LANES)), args[0],
                            ir.Constant(_VECTOR, [0.0] * LANES))
        square_root = cgutils.get_or_insert_function(b.module, ir.FunctionType(_VECTOR, [_VECTOR]), "llvm.sqrt.v8f64")
        return b.call(square_root, [positive])
    return vec(x), codegen


@intrinsic
def call_law(tc, address, t, given, parameters, found, failed):
    """Call the function (double t, double *given, double *parameters, double *found, double *failed) at an address with addresses
    of arrays."""
    def codegen(ctx, b, sig, args):
        pointer = _DOUBLE.as_pointer()
        function = ir.FunctionType(ir.VoidType(), [_DOUBLE, pointer, pointer, pointer, pointer])
        b.call(b.inttoptr(args[0], function.as_pointer()), [args[1], *(b.inttoptr(x, pointer) for x in args[2:])])
        return ctx.get_dummy_value()
    return types.void(types.int64, types.float64, types.int64, types.int64, types.int64, types.int64), codegen


@intrinsic
def fetch(tc, array, offset):
    """Ask memory for the cache line of a number before it is needed; offset counts the numbers of the array."""
    def codegen(ctx, b, sig, args):
        byte = ir.IntType(8).as_pointer()
        p = b.bitcast(b.gep(_data(ctx, b, sig.args[0], args[0]), [_int(ctx, b, args[1], sig.args[1])]), byte)
        function = b.module.declare_intrinsic("llvm.prefetch", [byte], ir.FunctionType(ir.VoidType(), [byte, _I32, _I32, _I32]))
        b.call(function, [p, ir.Constant(_I32, 0), ir.Constant(_I32, 3), ir.Constant(_I32, 1)])
        return ctx.get_dummy_value()
    return types.void(array, offset), codegen
