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
# doubles of a quadrature point in scratch: six stresses that multiply derivatives of quadratic forms, that of the directors'
# lengths, and the three moments, theory.md (4.7)
STRESSES = 10 * 8
# what derivatives of the strains (2.2) need of one shape: shears, 1 / stretch, the forms of twist and curvatures, the factor c;
# then the same of the end of the step, and its stretch
SHAPE = 7 * 8
SHAPES = 2 * SHAPE + 8


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
def quadratic_forms(scratch, z, green, eo):
    """The quadratic forms of z that strains are made of, theory.md (2.1), (2.4): phi'.phi'/2, two shears, twist, two curvatures;
    of strain set (2.2) a seventh, c - 7/4."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    vst(scratch, eo, 0, 0.5 * dot(f, f)); vst(scratch, eo + 8, 0, dot(f, d2)); vst(scratch, eo + 16, 0, dot(f, d3))
    vst(scratch, eo + 24, 0, 0.5 * (dot(k2, d3) - dot(k3, d2)))
    if green is None:
        vst(scratch, eo + 32, 0, 0.5 * (dot(k3, d1) - dot(k1, d3)))
        vst(scratch, eo + 40, 0, 0.5 * (dot(k1, d2) - dot(k2, d1)))
        vst(scratch, eo + 48, 0, -0.25 * (dot(d1, d1) + dot(d2, d2) + dot(d3, d3)))
    else:
        vst(scratch, eo + 32, 0, dot(f, k3)); vst(scratch, eo + 40, 0, -1.0 * dot(f, k2))


@kernel
def stretch(scratch, eo):
    """Length of phi' without its part in the section, from the forms at eo; theory.md (2.2)."""
    g2 = vld(scratch, eo + 8, 0); g3 = vld(scratch, eo + 16, 0)
    return square_root(2.0 * vld(scratch, eo, 0) - g2 * g2 - g3 * g3)


@kernel
def put_shape(scratch, eo, over_stretch, ao):
    """What derivatives of the strains (2.2) need, from the forms at eo."""
    vst(scratch, ao, 0, vld(scratch, eo + 8, 0)); vst(scratch, ao + 8, 0, vld(scratch, eo + 16, 0))
    vst(scratch, ao + 16, 0, over_stretch)
    for i in range(24, 48, 8):
        vst(scratch, ao + i, 0, vld(scratch, eo + i, 0))
    vst(scratch, ao + 48, 0, 1.75 + vld(scratch, eo + 48, 0))


@kernel
def mean_strains(tab, e0, scratch, zm, ze, green, middle, eo, room, ao):
    """(E_n + E_n+1)/2 - E0, from the shapes in the middle and at the end of the step. `middle`: only E(z_mid). e0: where E0
    stands; ao: room for SHAPES."""
    end = room
    if middle is None:
        for i in range(0, 168, 8):
            vst(scratch, room + i, 0, 2.0 * vld(scratch, zm + i, 0) - vld(scratch, ze + i, 0))
        quadratic_forms(scratch, room, green, eo)
        quadratic_forms(scratch, ze, green, end)
    else:
        quadratic_forms(scratch, zm, green, eo)
        end = eo
    if green is None:
        r_end = stretch(scratch, end)
        r = 0.5 * (stretch(scratch, eo) + r_end)
        over = 1.0 / (r * r_end)
        c = 1.75 + vld(scratch, eo + 48, 0)
        c_end = 1.75 + vld(scratch, end + 48, 0)
        put_shape(scratch, end, r * over, ao + SHAPE)
        vst(scratch, ao + 2 * SHAPE, 0, r_end)
        mean_c = 0.5 * (c + c_end)
        vst(scratch, ao + 16, 0, r_end * over); vst(scratch, ao + 48, 0, mean_c)
        vst(scratch, eo, 0, r)
        for i in range(8, 24, 8):
            g = 0.5 * (vld(scratch, eo + i, 0) + vld(scratch, end + i, 0))
            vst(scratch, eo + i, 0, g); vst(scratch, ao + i - 8, 0, g)
        for i in range(24, 48, 8):
            k = vld(scratch, eo + i, 0); k_end = vld(scratch, end + i, 0)
            vst(scratch, eo + i, 0, 0.5 * (c * k + c_end * k_end)); vst(scratch, ao + i, 0, 0.5 * (k + k_end))
    else:
        for i in range(0, 48, 8):
            vst(scratch, eo + i, 0, 0.5 * (vld(scratch, eo + i, 0) + vld(scratch, end + i, 0)))
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) - vld(tab, e0 + i, 0))


@kernel
def form_changes(scratch, z, x, green, eo):
    """Derivatives of the forms of `quadratic_forms` at z along x."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    g = vld3(scratch, x, 8); x1 = vld3(scratch, x + 24, 8); x2 = vld3(scratch, x + 48, 8); x3 = vld3(scratch, x + 72, 8)
    y1 = vld3(scratch, x + 96, 8); y2 = vld3(scratch, x + 120, 8); y3 = vld3(scratch, x + 144, 8)
    vst(scratch, eo, 0, dot(f, g))
    vst(scratch, eo + 8, 0, dot(f, x2) + dot(g, d2)); vst(scratch, eo + 16, 0, dot(f, x3) + dot(g, d3))
    vst(scratch, eo + 24, 0, 0.5 * (dot(y2, d3) + dot(k2, x3) - dot(y3, d2) - dot(k3, x2)))
    if green is None:
        vst(scratch, eo + 32, 0, 0.5 * (dot(y3, d1) + dot(k3, x1) - dot(y1, d3) - dot(k1, x3)))
        vst(scratch, eo + 40, 0, 0.5 * (dot(y1, d2) + dot(k1, x2) - dot(y2, d1) - dot(k2, x1)))
        vst(scratch, eo + 48, 0, -0.5 * (dot(d1, x1) + dot(d2, x2) + dot(d3, x3)))
    else:
        vst(scratch, eo + 32, 0, dot(f, y3) + dot(g, k3)); vst(scratch, eo + 40, 0, -1.0 * (dot(f, y2) + dot(g, k2)))


@kernel
def extrapolated_strains(scratch, z, x, green, eo, room):
    """The strains at z and their change along x in a straight line, into six lanes at eo."""
    quadratic_forms(scratch, z, green, eo)
    form_changes(scratch, z, x, green, room)
    if green is None:
        # r + (dQ - g2 dg2 - g3 dg3)/r
        r = stretch(scratch, eo)
        g2 = vld(scratch, eo + 8, 0); g3 = vld(scratch, eo + 16, 0)
        dr = vld(scratch, room, 0) - g2 * vld(scratch, room + 8, 0) - g3 * vld(scratch, room + 16, 0)
        vst(scratch, eo, 0, r + dr / r)
        for i in range(8, 24, 8):
            vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) + vld(scratch, room + i, 0))
        c = 1.75 + vld(scratch, eo + 48, 0)
        dc = vld(scratch, room + 48, 0)
        for i in range(24, 48, 8):
            vst(scratch, eo + i, 0, (c + dc) * vld(scratch, eo + i, 0) + c * vld(scratch, room + i, 0))
    else:
        for i in range(0, 48, 8):
            vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) + vld(scratch, room + i, 0))


@kernel
def unused_strains(tab, e0, scratch, zm, ze, gathered, zb, zx, dphi, spin_rate, green, middle, eo, room, ao):
    """What the mean strains at eo, linear in the last increment, lack to those of the present shape: what the tangent must not
    use, theory.md (4.6); in their place. zb: the shape before that increment, zx: the increment; unless `gathered` none was
    made, and the shape before is that of the start."""
    if green is None:
        end = ao + SHAPE
        c = vld(scratch, end + 48, 0)
        vst(scratch, room, 0, vld(scratch, ao + 2 * SHAPE, 0))
        vst(scratch, room + 8, 0, vld(scratch, end, 0)); vst(scratch, room + 16, 0, vld(scratch, end + 8, 0))
        for i in range(24, 48, 8):
            vst(scratch, room + i, 0, c * vld(scratch, end + i, 0))
    else:
        quadratic_forms(scratch, zm if middle is not None else ze, green, room)
    # the start of a conserving step stays as it is
    share = 0.5
    if middle is not None or dphi is None or spin_rate is not None:
        share = 1.0
    if middle is not None:
        for i in range(0, 168, 8):
            if not gathered:
                vst(scratch, zb + i, 0, 2.0 * vld(scratch, zm + i, 0) - vld(scratch, ze + i, 0)); vst(scratch, zx + i, 0, 0.0)
            # of the shape in the middle
            vst(scratch, zb + i, 0, vld(scratch, zm + i, 0) + 0.5 * (vld(scratch, zb + i, 0) - vld(scratch, ze + i, 0)))
            vst(scratch, zx + i, 0, 0.5 * vld(scratch, zx + i, 0))
    if gathered or middle is not None:
        extrapolated_strains(scratch, zb, zx, green, eo, room + 56)
    else:
        # the start, from the mean and the end
        for i in range(0, 48, 8):
            mean = vld(scratch, eo + i, 0) + vld(tab, e0 + i, 0)
            vst(scratch, eo + i, 0, 2.0 * mean - vld(scratch, room + i, 0))
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, share * (vld(scratch, eo + i, 0) - vld(scratch, room + i, 0)))


@kernel
def stresses(tab, co, to, coupled, scratch, eo, so, green, ao):
    """weight times C times the strains at `eo` into the lanes at `so`; of strain set (2.2) what then multiplies the derivatives
    of the quadratic forms, theory.md (4.7), and the moments behind. ao: SHAPES."""
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
        c = vld(scratch, ao + 48, 0)
        x = vzero()
        for i in range(24, 48, 8):
            m = vld(scratch, so + i, 0)
            x += m * vld(scratch, ao + i, 0)
            vst(scratch, so + i, 0, c * m); vst(scratch, so + 32 + i, 0, m)
        vst(scratch, so + 48, 0, -0.5 * x)
