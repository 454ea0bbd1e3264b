"""The two kinds of nodes, in space and in a plane, and operations of kinematics that depend on the kind.

A node has 6 unknowns in space (position, spin) and 12 coordinates (position, three directors), in a plane 3 and 4. `dofs` is the
tuple of as many zeros as a node has unknowns; the class of this tuple, `Space` or `Plane`, decides at compile time what an
operation does. Forces and positions are vectors of 3 or 2 numbers; spins, Cayley vectors and moments are vectors in space and
numbers in a plane.
"""
from __future__ import annotations

from typing import NamedTuple

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from fastbeam.kernels.algebra.vectors import (
    _DOUBLE,
    _I64,
    M3,
    V2,
    V3,
    _add,
    _int,
    _lane_ir,
    _mul,
    _pack,
    _parts,
    _pointer,
    _sub,
    cross,
    cross2,
    dot,
    f8,
    native,
    perp,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic


class Space(NamedTuple):
    """`dofs` of nodes in space."""

    x: int = 0
    y: int = 0
    z: int = 0
    spin_x: int = 0
    spin_y: int = 0
    spin_z: int = 0


class Plane(NamedTuple):
    """`dofs` of nodes in a plane."""

    x: int = 0
    y: int = 0
    spin: int = 0


SPACE, PLANE = Space(), Plane()


def _dim(dofs):
    return {6: 3, 3: 2}[dofs.count]


def _coordinates(dofs):
    return {6: 12, 3: 4}[dofs.count]


def _vector_type(dofs):
    return V3[f8] if _dim(dofs) == 3 else V2[f8]


def _spin_type(dofs):
    return V3[f8] if _dim(dofs) == 3 else f8


@intrinsic
def dim(tc, dofs):
    """Return the number of components of a position."""
    d = _dim(dofs)
    return types.intp(dofs), lambda ctx, b, sig, args: ir.Constant(_I64, d)


@intrinsic
def coordinates(tc, dofs):
    """Return the number of coordinates of a node."""
    n = _coordinates(dofs)
    return types.intp(dofs), lambda ctx, b, sig, args: ir.Constant(_I64, n)


# --- loads and stores ---------------------------------------------------------------------------------------------------
def _loaded(ctx, b, array_type, array, offset, step, n):
    xs = []
    for _ in range(n):
        xs.append(b.load(_pointer(ctx, b, array_type, array, offset, f8), align=8))
        offset = b.add(offset, step)
    return xs[0] if n == 1 else _pack(b, f8, xs)


@intrinsic
def vector(tc, array, offset, stride, dofs):
    """Return a vector of 3 numbers, 2 in a plane, from an offset on; stride: doubles from one to the next."""
    d = _dim(dofs)

    def codegen(ctx, b, sig, args):
        return _loaded(ctx, b, sig.args[0], args[0], _int(ctx, b, args[1], sig.args[1]), _int(ctx, b, args[2], sig.args[2]), d)
    return _vector_type(dofs)(array, offset, stride, dofs), codegen


@intrinsic
def position(tc, q, node, dofs):
    """Return the position of a node among the coordinates of all."""
    d, n = _dim(dofs), _coordinates(dofs)

    def codegen(ctx, b, sig, args):
        o = b.mul(_int(ctx, b, args[1], sig.args[1]), ir.Constant(_I64, n))
        return _loaded(ctx, b, sig.args[0], args[0], o, ir.Constant(_I64, 1), d)
    return _vector_type(dofs)(q, node, dofs), codegen


@intrinsic
def spin(tc, array, offset, dofs):
    """Return a spin, Cayley vector or moment of 3 numbers, in a plane a number, from an offset on."""
    n = 3 if _dim(dofs) == 3 else 1

    def codegen(ctx, b, sig, args):
        return _loaded(ctx, b, sig.args[0], args[0], _int(ctx, b, args[1], sig.args[1]), ir.Constant(_I64, 1), n)
    return _spin_type(dofs)(array, offset, dofs), codegen


@intrinsic
def cayley_vector(tc, theta, node, dofs):
    """Return the Cayley vector of a node, in a plane a number."""
    n = 3 if _dim(dofs) == 3 else 1

    def codegen(ctx, b, sig, args):
        o = b.mul(_int(ctx, b, args[1], sig.args[1]), ir.Constant(_I64, n))
        return _loaded(ctx, b, sig.args[0], args[0], o, ir.Constant(_I64, 1), n)
    return _spin_type(dofs)(theta, node, dofs), codegen


def _zeros(n):
    one = ir.Constant(_DOUBLE, 0.0)
    return one if n == 1 else ir.Constant.literal_struct([one] * n)


@intrinsic
def zero_vector(tc, dofs):
    """Return the vector 0."""
    d = _dim(dofs)
    return _vector_type(dofs)(dofs), lambda ctx, b, sig, args: _zeros(d)


@intrinsic
def zero_spin(tc, dofs):
    """Return the spin 0."""
    n = 3 if _dim(dofs) == 3 else 1
    return _spin_type(dofs)(dofs), lambda ctx, b, sig, args: _zeros(n)


def _make_put(accumulate):
    def put(tc, array, offset, stride, x):
        n = getattr(x, "n", 1)

        def codegen(ctx, b, sig, args):
            o, step = _int(ctx, b, args[1], sig.args[1]), _int(ctx, b, args[2], sig.args[2])
            for y in ([args[3]] if n == 1 else _parts(b, args[3], n)):
                p = _pointer(ctx, b, sig.args[0], args[0], o, f8)
                b.store(_add(b, b.load(p, align=8), y) if accumulate else y, p, align=8)
                o = b.add(o, step)
            return ctx.get_dummy_value()
        return types.void(array, offset, stride, x), codegen
    put.__doc__ = ("Add" if accumulate else "Store") + " a vector or a number; stride: doubles from one component to the next."
    return intrinsic(put)


put, add_to = _make_put(False), _make_put(True)


@intrinsic
def put_cross_matrix(tc, a, offset, factor, x):
    """Store at a[offset + 8 i + j] factor times the derivative of component i of x cross y by y_j; in a plane there is one
    row."""
    n = x.n

    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        f = ctx.cast(b, args[2], sig.args[2], f8)
        xs = [_mul(b, f, y) for y in _parts(b, args[3], n)]
        zero = ir.Constant(_DOUBLE, 0.0)
        minus = [_sub(b, zero, y) for y in xs]
        rows = [[minus[1], xs[0]]]
        if n == 3:
            rows = [[zero, minus[2], xs[1]], [xs[2], zero, minus[0]], [minus[1], xs[0], zero]]
        for i, row in enumerate(rows):
            for j, y in enumerate(row):
                b.store(y, _pointer(ctx, b, sig.args[0], args[0], b.add(o, ir.Constant(_I64, 8 * i + j)), f8), align=8)
        return ctx.get_dummy_value()
    return types.void(a, offset, factor, x), codegen


def _make_cross(turn):
    def add(tc, a, offset, factor, x):
        n = x.n

        def codegen(ctx, b, sig, args):
            o = _int(ctx, b, args[1], sig.args[1])
            f = ctx.cast(b, args[2], sig.args[2], f8)
            xs = [_mul(b, f, y) for y in _parts(b, args[3], n)]
            minus = [_sub(b, ir.Constant(_DOUBLE, 0.0), y) for y in xs]
            if n == 2:
                entries = [((0, 0), minus[1]), ((1, 0) if turn else (0, 1), xs[0])]
            else:
                # the matrix of x cross, and of a spin its transpose
                entries = [((j, i) if turn else (i, j), y) for i, j, y in ((0, 1, minus[2]), (0, 2, xs[1]), (1, 0, xs[2]),
                                                                           (1, 2, minus[0]), (2, 0, minus[1]), (2, 1, xs[0]))]
            for (i, j), y in entries:
                p = _pointer(ctx, b, sig.args[0], args[0], b.add(o, ir.Constant(_I64, 8 * i + j)), f8)
                b.store(_add(b, b.load(p, align=8), y), p, align=8)
            return ctx.get_dummy_value()
        return types.void(a, offset, factor, x), codegen
    add.__doc__ = ("a[offset + 8 i + j] += factor times the derivative of component i of "
                   + ("spin cross x by component j of the spin." if turn else "x cross y by y_j; in a plane there is one row."))
    return intrinsic(add)


add_cross, add_turn = _make_cross(False), _make_cross(True)


@intrinsic
def add_stiffness(tc, a, offset, factor, x, y):
    """Add factor (i == j) + x_i y_j to a[offset + 8 i + j]."""
    n = x.n

    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        f = ctx.cast(b, args[2], sig.args[2], f8)
        xs, ys = _parts(b, args[3], n), _parts(b, args[4], n)
        for i in range(n):
            for j in range(n):
                p = _pointer(ctx, b, sig.args[0], args[0], b.add(o, ir.Constant(_I64, 8 * i + j)), f8)
                z = _add(b, b.load(p, align=8), _mul(b, xs[i], ys[j]))
                b.store(_add(b, z, f) if i == j else z, p, align=8)
        return ctx.get_dummy_value()
    return types.void(a, offset, factor, x, y), codegen


@intrinsic
def add_outer(tc, a, offset, factor, x, y):
    """Add factor x_i y_j to a[offset + 8 i + j]; x and y are vectors or, as spins in a plane, numbers."""
    n, m = getattr(x, "n", 1), getattr(y, "n", 1)

    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        f = ctx.cast(b, args[2], sig.args[2], f8)
        xs, ys = ([z] if k == 1 else _parts(b, z, k) for z, k in ((args[3], n), (args[4], m)))
        for i, z in enumerate([_mul(b, f, z) for z in xs]):
            for j in range(m):
                p = _pointer(ctx, b, sig.args[0], args[0], b.add(o, ir.Constant(_I64, 8 * i + j)), f8)
                b.store(_add(b, b.load(p, align=8), _mul(b, z, ys[j])), p, align=8)
        return ctx.get_dummy_value()
    return types.void(a, offset, factor, x, y), codegen


# --- elements in lanes: as many as a register holds, components 8 doubles apart -------------------------------------------
@intrinsic
def vector_lanes(tc, array, offset, dofs):
    """Return a vector in lanes from an offset on."""
    d = _dim(dofs)

    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        return _pack(b, native, [b.load(_pointer(ctx, b, sig.args[0], args[0], b.add(o, ir.Constant(_I64, 8 * i)), native),
                                        align=8)
                                 for i in range(d)])
    return {2: V2, 3: V3}[d][native](array, offset, dofs), codegen


def _zero_lanes():
    return ir.Constant(_lane_ir(native), [0.0] * native.lanes)


@intrinsic
def zero_lanes(tc, dofs):
    """Return the vector 0 in lanes."""
    d = _dim(dofs)
    return {2: V2, 3: V3}[d][native](dofs), lambda ctx, b, sig, args: _pack(b, native, [_zero_lanes()] * d)


@intrinsic
def zero_moment(tc, dofs):
    """Return the moment 0 in lanes."""
    return (V3[native] if _dim(dofs) == 3 else native)(dofs), lambda ctx, b, sig, args: (
        _pack(b, native, [_zero_lanes()] * 3) if _dim(dofs) == 3 else _zero_lanes())


@intrinsic
def zero_dyad(tc, dofs):
    """Return the dyad 0 in lanes."""
    return (M3[native] if _dim(dofs) == 3 else native)(dofs), lambda ctx, b, sig, args: (
        _pack(b, native, [_zero_lanes()] * 9) if _dim(dofs) == 3 else _zero_lanes())


def _make_put_lanes(accumulate):
    def put_lanes(tc, array, offset, x):
        n = getattr(x, "n", 1)

        def codegen(ctx, b, sig, args):
            o = _int(ctx, b, args[1], sig.args[1])
            for i, y in enumerate([args[2]] if n == 1 else _parts(b, args[2], n)):
                p = _pointer(ctx, b, sig.args[0], args[0], b.add(o, ir.Constant(_I64, 8 * i)), native)
                b.store(_add(b, b.load(p, align=8), y) if accumulate else y, p, align=8)
            return ctx.get_dummy_value()
        return types.void(array, offset, x), codegen
    put_lanes.__doc__ = ("Add" if accumulate else "Store") + " a vector or a number in lanes."
    return intrinsic(put_lanes)


put_lanes, add_lanes = _make_put_lanes(False), _make_put_lanes(True)


@intrinsic
def moment(tc, x, y):
    """Return x cross y in lanes: a vector, in a plane its component along the normal."""
    def codegen(ctx, b, sig, args):
        u, v = _parts(b, args[0], x.n), _parts(b, args[1], x.n)
        z = [_sub(b, _mul(b, u[i], v[j]), _mul(b, u[j], v[i])) for i, j in ([(0, 1)] if x.n == 2 else [(1, 2), (2, 0), (0, 1)])]
        return z[0] if x.n == 2 else _pack(b, native, z)
    return (native if x.n == 2 else x)(x, y), codegen


@intrinsic
def dyad(tc, x, y):
    """Return x y^T in lanes; in a plane its trace x . y, which is all that moments about the normal need."""
    def codegen(ctx, b, sig, args):
        u, v = _parts(b, args[0], x.n), _parts(b, args[1], x.n)
        if x.n == 2:
            return _add(b, _mul(b, u[0], v[0]), _mul(b, u[1], v[1]))
        return _pack(b, native, [_mul(b, p, q) for p in u for q in v])
    return (native if x.n == 2 else M3[native])(x, y), codegen


@intrinsic
def add_turned(tc, array, offset, k, dofs):
    """Add 1/2 (k - tr(k) I), k a sum of dyads d f^T, to the rotation-rotation part of a block of the tangent: the derivative of
    the moment of forces f on directors d by their spin, theory.md (4.2)."""
    n, d = dofs.count, _dim(dofs)

    def codegen(ctx, b, sig, args):
        o = _int(ctx, b, args[1], sig.args[1])
        half = ir.Constant(_lane_ir(native), [0.5] * native.lanes)
        if d == 2:
            xs = [_sub(b, _zero_lanes(), _mul(b, half, args[2]))]
        else:
            xs = _parts(b, args[2], 9)
            trace = _add(b, _add(b, xs[0], xs[4]), xs[8])
            xs = [_mul(b, half, _sub(b, x, trace) if i in (0, 4, 8) else x) for i, x in enumerate(xs)]
        m = 3 if d == 3 else 1
        for i, x in enumerate(xs):
            at = ir.Constant(_I64, 8 * (n * (d + i // m) + d + i % m))
            p = _pointer(ctx, b, sig.args[0], args[0], b.add(o, at), native)
            b.store(_add(b, b.load(p, align=8), x), p, align=8)
        return ctx.get_dummy_value()
    return types.void(array, offset, k, dofs), codegen


# --- products -----------------------------------------------------------------------------------------------------------
@generic
def cross_product(x, y):
    """Return x cross y of two vectors: a vector, in a plane its component along the normal."""


@generic
def spin_cross(spin, x):
    """Return spin cross x of a spin and a vector: a vector."""


@generic
def on_spin(theta, y):
    """Return a covector y of changes of the Cayley vector theta as a covector of the spins that cause them, theory.md (4.2):
    changes are (I - 1/2 theta^ + 1/4 theta theta^T) spin."""


cross_product.register(V3[f8])(cross)
cross_product.register(V2[f8])(cross2)
spin_cross.register(V3[f8])(cross)


@spin_cross.register(f8)
@kernel
def _spin_cross_in_plane(spin, x):
    return spin * perp(x)


@on_spin.register(V3[f8])
@kernel
def _on_spin_in_space(theta, y):
    return y + 0.5 * cross(theta, y) + (0.25 * dot(theta, y)) * theta


@on_spin.register(f8)
@kernel
def _on_spin_in_plane(theta, y):
    return y * (1.0 + 0.25 * theta * theta)
