"""Strains and stresses at the quadrature points of a part of a group of 8 elements, and those that the tangent uses (theory.md
(4.6)). Loads, stores and zeros are those of `algebra.WIDTH` lanes; offsets are those of the first of them."""
from __future__ import annotations

from .._jit import kernel
from .algebra import dot
from .algebra import pld as vld
from .algebra import pld3 as vld3
from .algebra import pst as vst
from .algebra import pst3 as vst3
from .algebra import pzero as vzero
from .algebra import pzero3 as vzero3

Q_LANES = 24 * 8     # two sets of coordinates of a node


@kernel
def interpolate(tab, to, nn, scratch, qo, zo):
    """z = (phi', d1, d2, d3, d1', d2', d3') at one point; qo: first of nn nodes of 24 lanes each, zo: output."""
    f = vzero3(); d1 = vzero3(); d2 = vzero3(); d3 = vzero3(); k1 = vzero3(); k2 = vzero3(); k3 = vzero3()
    for a in range(nn):
        t = to + 8 + 24 * a
        q = qo + Q_LANES * a
        dp = vld(tab, t, 0); n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        f += dp * vld3(scratch, q, 8)
        x = vld3(scratch, q + 24, 8); d1 += n * x; k1 += dn * x
        x = vld3(scratch, q + 48, 8); d2 += n * x; k2 += dn * x
        x = vld3(scratch, q + 72, 8); d3 += n * x; k3 += dn * x
    vst3(scratch, zo, 8, f); vst3(scratch, zo + 24, 8, d1); vst3(scratch, zo + 48, 8, d2); vst3(scratch, zo + 72, 8, d3)
    vst3(scratch, zo + 96, 8, k1); vst3(scratch, zo + 120, 8, k2); vst3(scratch, zo + 144, 8, k3)


@kernel
def quadratic_strains(scratch, z, green, eo, add):
    """The homogeneous quadratic part of the six strains of z, theory.md (2.1), (2.2); added to what stands there if `add`."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    e4 = 0.5 * (dot(k2, d3) - dot(k3, d2))
    if green is None:
        e1 = dot(f, d1)
        e5 = 0.5 * (dot(k3, d1) - dot(k1, d3))
        e6 = 0.5 * (dot(k1, d2) - dot(k2, d1))
    else:
        e1 = 0.5 * dot(f, f)
        e5 = dot(f, k3)
        e6 = -1.0 * dot(f, k2)
    e2 = dot(f, d2)
    e3 = dot(f, d3)
    if add:
        e1 += vld(scratch, eo, 0); e2 += vld(scratch, eo + 8, 0); e3 += vld(scratch, eo + 16, 0)
        e4 += vld(scratch, eo + 24, 0); e5 += vld(scratch, eo + 32, 0); e6 += vld(scratch, eo + 40, 0)
    vst(scratch, eo, 0, e1); vst(scratch, eo + 8, 0, e2); vst(scratch, eo + 16, 0, e3)
    vst(scratch, eo + 24, 0, e4); vst(scratch, eo + 32, 0, e5); vst(scratch, eo + 40, 0, e6)


@kernel
def mean_strains(tab, e0, scratch, zm, ze, green, middle, eo, room):
    """(E_n + E_n+1)/2 - E0: E quadratic gives E(z_mid) + E(z_end - z_mid). `middle`: only E(z_mid). e0: where E0 stands."""
    quadratic_strains(scratch, zm, green, eo, False)
    if middle is None:
        for i in range(0, 168, 8):
            vst(scratch, room + i, 0, vld(scratch, ze + i, 0) - vld(scratch, zm + i, 0))
        quadratic_strains(scratch, room, green, eo, True)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) - vld(tab, e0 + i, 0))


@kernel
def unused_strains(scratch, zm, ze, zl, zs, dphi, spin_rate, green, middle, eo, room):
    """What the mean strains, linear in the last increment, lack to those of the present shape: what the tangent must not use,
    theory.md (4.6). zl: the shape to which the last increment leads in a straight line, zs: that increment."""
    if middle is not None:
        for i in range(0, 168, 8):
            vst(scratch, zl + i, 0, vld(scratch, zm + i, 0) + 0.5 * (vld(scratch, zl + i, 0) - vld(scratch, ze + i, 0)))
            vst(scratch, zs + i, 0, 0.5 * vld(scratch, zs + i, 0))
    quadratic_strains(scratch, zs, green, eo, False)
    quadratic_strains(scratch, zm if middle is not None else ze, green, eo, True)
    quadratic_strains(scratch, zl, green, room, False)
    # the start of a conserving step stays as it is
    share = 0.5
    if middle is not None or dphi is None or spin_rate is not None:
        share = 1.0
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, share * (vld(scratch, room + i, 0) - vld(scratch, eo + i, 0)))


@kernel
def stresses(tab, co, to, coupled, scratch, eo, so):
    """weight times C times the strains at `eo` into the six lanes at `so`."""
    w = vld(tab, to, 0)
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        s = vzero()
        for j in range(j0, j1):
            s += vld(tab, co + 48 * i + 8 * j, 0) * vld(scratch, eo + 8 * j, 0)
        vst(scratch, so + 8 * i, 0, w * s)
