"""Strains and stresses at the quadrature points of a part of a group of 8 elements, and those that the tangent uses (theory.md
(4.6)). Loads, stores and zeros are those of `algebra.WIDTH` lanes; offsets are those of the first of them."""
from __future__ import annotations

from .._jit import kernel
from .algebra import dot, square_root
from .algebra import pld as vld
from .algebra import pld3 as vld3
from .algebra import pst as vst
from .algebra import pst3 as vst3
from .algebra import pzero as vzero
from .algebra import pzero3 as vzero3

Q_LANES = 24 * 8     # two sets of coordinates of a node
AXIAL_LANES = 7      # see `put_stretch`


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
def quadratic_forms(scratch, z, green, eo, add):
    """The six quadratic forms of z that the strains are made of, theory.md (2.1), (2.4); added to what stands there if `add`."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    e1 = 0.5 * dot(f, f)
    e4 = 0.5 * (dot(k2, d3) - dot(k3, d2))
    if green is None:
        e5 = 0.5 * (dot(k3, d1) - dot(k1, d3))
        e6 = 0.5 * (dot(k1, d2) - dot(k2, d1))
    else:
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
def stretch(form, shear2, shear3):
    """Length of the axis per arc length without what shear adds to it, theory.md (2.2)."""
    return square_root(2.0 * form - shear2 * shear2 - shear3 * shear3)


@kernel
def put_stretch(scratch, ze, middle, eo, ao):
    """The mean stretch of both ends of the step in place of the mean of f.f/2 at eo. Into AXIAL_LANES lanes at ao what its
    derivatives need: the mean shears and 1 / mean stretch, then shears, 1 / stretch and stretch at the end."""
    form = vld(scratch, eo, 0); g2 = vld(scratch, eo + 8, 0); g3 = vld(scratch, eo + 16, 0)
    if middle is None:
        f = vld3(scratch, ze, 8)
        form_end = 0.5 * dot(f, f)
        g2_end = dot(f, vld3(scratch, ze + 48, 8)); g3_end = dot(f, vld3(scratch, ze + 72, 8))
        end = stretch(form_end, g2_end, g3_end)
        # a quadratic form at the start is twice its mean less that at the end
        mean = 0.5 * (end + stretch(2.0 * form - form_end, 2.0 * g2 - g2_end, 2.0 * g3 - g3_end))
    else:
        g2_end = g2; g3_end = g3
        end = stretch(form, g2, g3)
        mean = end
    vst(scratch, eo, 0, mean)
    vst(scratch, ao, 0, g2); vst(scratch, ao + 8, 0, g3); vst(scratch, ao + 16, 0, 1.0 / mean)
    vst(scratch, ao + 24, 0, g2_end); vst(scratch, ao + 32, 0, g3_end); vst(scratch, ao + 40, 0, 1.0 / end)
    vst(scratch, ao + 48, 0, end)


@kernel
def mean_strains(tab, e0, scratch, zm, ze, green, middle, eo, room, ao):
    """(E_n + E_n+1)/2 - E0. The mean of a quadratic form is that of z_mid and that of z_end - z_mid. `middle`: only E(z_mid).
    e0: where E0 stands; ao: see `put_stretch`."""
    quadratic_forms(scratch, zm, green, eo, False)
    if middle is None:
        for i in range(0, 168, 8):
            vst(scratch, room + i, 0, vld(scratch, ze + i, 0) - vld(scratch, zm + i, 0))
        quadratic_forms(scratch, room, green, eo, True)
    if green is None:
        put_stretch(scratch, ze, middle, eo, ao)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) - vld(tab, e0 + i, 0))


@kernel
def linear_stretch(scratch, zl, zs):
    """The stretch at zl, extrapolated in a straight line from zl - zs with its derivative there."""
    fl = vld3(scratch, zl, 8); fs = vld3(scratch, zs, 8); f = fl - fs
    l2 = vld3(scratch, zl + 48, 8); s2 = vld3(scratch, zs + 48, 8)
    l3 = vld3(scratch, zl + 72, 8); s3 = vld3(scratch, zs + 72, 8)
    form = 0.5 * dot(f, f); g2 = dot(f, l2 - s2); g3 = dot(f, l3 - s3)
    # r + (dQ - g2 dg2 - g3 dg3)/r, where Q + dQ of a quadratic form is Q(zl) - Q(zs)
    along = form + 0.5 * (dot(fl, fl) - dot(fs, fs)) - g2 * (dot(fl, l2) - dot(fs, s2)) - g3 * (dot(fl, l3) - dot(fs, s3))
    return along / stretch(form, g2, g3)


@kernel
def unused_strains(scratch, zm, ze, zl, zs, dphi, spin_rate, green, middle, eo, room, ao):
    """What the mean strains, linear in the last increment, lack to those of the present shape: what the tangent must not use,
    theory.md (4.6). zl: the shape to which the last increment leads in a straight line, zs: that increment."""
    if middle is not None:
        for i in range(0, 168, 8):
            vst(scratch, zl + i, 0, vld(scratch, zm + i, 0) + 0.5 * (vld(scratch, zl + i, 0) - vld(scratch, ze + i, 0)))
            vst(scratch, zs + i, 0, 0.5 * vld(scratch, zs + i, 0))
    quadratic_forms(scratch, zs, green, eo, False)
    quadratic_forms(scratch, zm if middle is not None else ze, green, eo, True)
    quadratic_forms(scratch, zl, green, room, False)
    if green is None:
        vst(scratch, room, 0, linear_stretch(scratch, zl, zs))
        vst(scratch, eo, 0, vld(scratch, ao + 48, 0))
    # the start of a conserving step stays as it is
    share = 0.5
    if middle is not None or dphi is None or spin_rate is not None:
        share = 1.0
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, share * (vld(scratch, room + i, 0) - vld(scratch, eo + i, 0)))


@kernel
def stresses(tab, co, to, coupled, scratch, eo, so, green, ao):
    """weight times C times the strains at `eo` into the six lanes at `so`; of strain set (2.2) what then multiplies the derivatives
    of the quadratic forms, theory.md (4.7)."""
    w = vld(tab, to, 0)
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        s = vzero()
        for j in range(j0, j1):
            s += vld(tab, co + 48 * i + 8 * j, 0) * vld(scratch, eo + 8 * j, 0)
        vst(scratch, so + 8 * i, 0, w * s)
    if green is None:
        n = vld(scratch, so, 0) * vld(scratch, ao + 16, 0)
        vst(scratch, so, 0, n)
        vst(scratch, so + 8, 0, vld(scratch, so + 8, 0) - n * vld(scratch, ao, 0))
        vst(scratch, so + 16, 0, vld(scratch, so + 16, 0) - n * vld(scratch, ao + 8, 0))
