"""Element loops of beams in a plane: what kernels/beam.py computes, with 3 unknowns a node.

A node has 4 coordinates: its position x, y in the plane and the director u = d1 in it. The other director of the plane is
J u, u turned by a right angle, the third is the constant normal. The strains that remain are (theory.md 10)

    stretch  sqrt(f . f - shear^2)  or  1/2 f . f,     shear  u x f,     curvature  c u x u',  c = (3 - u . u)/2,  or  f x u'
    (f = phi', x: normal component)

where the second form belongs to strain set (2.1). Residual and tangent as in theory.md 4: mean strains, rows with the mean
director, columns with the spin at the end.

Layout of one group of 8 elements in `tab` (each entry 8 lanes): C 9; per point: weight, (phi_s, dir, dir_s) of every node;
rhoA, rhoI; position masses nn*nn; director masses nn*nn. Reference strains, 3 per point, stand apart, as in kernels/beam.py.
"""
from __future__ import annotations

from .._jit import kernel, one_variant
from .algebra import component0, component1, cross2, dot, perp, square_root, vadd2, vld, vld2, vst, vst2, vzero, vzero2
from .inner import eliminate_inner
from .rows import scatter_rows
from .gather import gather_planar_ends, gather_planar_line
from .work import FROM_START


def planar_point_size(nn: int) -> int:
    """Doubles per quadrature point in `tab`."""
    return 8 * (1 + 3 * nn)


def planar_group_size(nn: int, nq: int) -> int:
    """Doubles per group in `tab`."""
    return 8 * (9 + 2 + 2 * nn * nn) + nq * planar_point_size(nn)


def planar_scratch_size(nn: int, nq: int) -> int:
    """Doubles of scratch that a group needs."""
    return 8 * (nn * (8 + 4 + 4 + 3 + 10) + nn * nn * 9 + nq * (8 + 10 * nn))


@kernel
def planar_point(tab, co, to, e0, nn, scratch, fo, lo, mixed, gathered, v, po, green):
    """One quadrature point: internal forces on the coordinates of every node (fo), those on the directors that the tangent adds
    (behind line and step of the nodes at lo), and from po on what node pairs share: stresses of the tangent times weight 4, TT 4,
    then per node three rotation rows of the midpoint, what multiplies them, the columns rotation-translation 2 and
    translation-rotation 2. Rows are derivatives of quadratic forms, theory.md (4.8); of set (2.1) they are the strains."""
    f = vzero2(); u = vzero2(); k = vzero2(); fe = vzero2(); ue = vzero2(); ke = vzero2()
    for a in range(nn):
        t = to + 8 + 24 * a
        q = 64 * a
        dp = vld(tab, t, 0); n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        x = vld2(scratch, q + 16, 8); y = vld2(scratch, q + 48, 8)
        f += dp * vld2(scratch, q, 8); u += n * x; k += dn * x
        fe += dp * vld2(scratch, q + 32, 8); ue += n * y; ke += dn * y
    # shape at the start of the step
    f0 = 2.0 * f - fe; u0 = 2.0 * u - ue; k0 = 2.0 * k - ke
    g0 = cross2(u0, f0); ge = cross2(ue, fe)
    g = 0.5 * (g0 + ge)
    if green is None:
        r_end = square_root(dot(fe, fe) - ge * ge)
        r0 = square_root(dot(f0, f0) - g0 * g0)
        e = 0.5 * (r0 + r_end)
        over = 1.0 / (e * r_end)
        over_end = e * over
        over = r_end * over
        a0 = 1.5 - 0.5 * dot(u0, u0); ae = 1.5 - 0.5 * dot(ue, ue)
        c0 = cross2(u0, k0); ce = cross2(ue, ke)
        am = 0.5 * (a0 + ae)
        cm = 0.5 * (c0 + ce)
        gm = g
        c = 0.5 * (a0 * c0 + ae * ce)
    else:
        e = 0.25 * (dot(f0, f0) + dot(fe, fe))
        c = 0.5 * (cross2(f0, k0) + cross2(fe, ke))
    w = vld(tab, to, 0)
    e -= vld(tab, e0, 0); g -= vld(tab, e0 + 8, 0); c -= vld(tab, e0 + 16, 0)
    c00 = w * vld(tab, co, 0); c01 = w * vld(tab, co + 8, 0); c02 = w * vld(tab, co + 16, 0)
    c11 = w * vld(tab, co + 32, 0); c12 = w * vld(tab, co + 40, 0); c22 = w * vld(tab, co + 64, 0)
    s1 = c00 * e + c01 * g + c02 * c
    s2 = c01 * e + c11 * g + c12 * c
    s3 = c02 * e + c12 * g + c22 * c
    t1 = s1; t2 = s2; t3 = s3
    if mixed:
        # what the mean strains, linear in the last increment, lack to them, theory.md (4.6)
        if gathered:
            # shape before the last increment, and that increment
            fb = vzero2(); ub = vzero2(); kb = vzero2(); fx = vzero2(); ux = vzero2(); kx = vzero2()
            for a in range(nn):
                t = to + 8 + 24 * a
                q = lo + 80 * a
                dp = vld(tab, t, 0); n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
                x = vld2(scratch, q + 16, 8); y = vld2(scratch, q + 48, 8)
                fb += dp * vld2(scratch, q, 8); ub += n * x; kb += dn * x
                fx += dp * vld2(scratch, q + 32, 8); ux += n * y; kx += dn * y
            gb = cross2(ub, fb)
            g = gb + cross2(ux, fb) + cross2(ub, fx)
            if green is None:
                e = (dot(fb, fb + fx) - gb * g) / square_root(dot(fb, fb) - gb * gb)
                cb = cross2(ub, kb); ab = 1.5 - 0.5 * dot(ub, ub)
                c = ab * (cb + cross2(ux, kb) + cross2(ub, kx)) - dot(ub, ux) * cb
            else:
                e = 0.5 * dot(fb, fb) + dot(fb, fx)
                c = cross2(fb, kb) + cross2(fx, kb) + cross2(fb, kx)
        else:
            g = g0
            if green is None:
                e = r0
                c = a0 * c0
            else:
                e = 0.5 * dot(f0, f0)
                c = cross2(f0, k0)
        g -= ge
        if green is None:
            e -= r_end
            c -= ae * ce
        else:
            e -= 0.5 * dot(fe, fe)
            c -= cross2(fe, ke)
        share = 1.0
        if v is not None:
            share = 0.5    # the start of the step stays as it is
        m1 = share * (c00 * e + c01 * g + c02 * c)
        m2 = share * (c01 * e + c11 * g + c12 * c)
        m3 = share * (c02 * e + c12 * g + c22 * c)
        t1 = s1 + m1; t2 = s2 + m2; t3 = s3 + m3
        if green is None:
            m1 = over * m1
            m2 -= gm * m1
            x = vzero2() - m2 * perp(f) - am * (m3 * perp(k)) - (m3 * cm) * u
            y = am * (m3 * perp(u))
        else:
            x = vzero2() - m2 * perp(f)
            y = m3 * perp(f)
        for a in range(nn):
            t = to + 8 + 24 * a
            vadd2(scratch, lo + 80 * a + 64, 8, vld(tab, t + 8, 0) * x + vld(tab, t + 16, 0) * y)
    # forces; stresses of the tangent for the pairs; stiffness times the rows of the positions at the end, ct
    n2 = perp(u); n2e = perp(ue)
    if green is None:
        # what multiplies the derivatives of the quadratic forms, theory.md (4.7)
        s1 = over * s1
        s2 -= gm * s1
        x0 = s1 * f + s2 * n2
        x1 = vzero2() - s2 * perp(f) - am * (s3 * perp(k)) - (s3 * cm) * u
        y1 = am * (s3 * n2)
        n = over * t1
        half_m = 0.5 * t3
        vst(scratch, po, 0, n); vst(scratch, po + 8, 0, t2 - gm * n); vst(scratch, po + 16, 0, am * t3)
        vst(scratch, po + 24, 0, vzero() - cm * t3)
        # half the stiffness, less the axial stress over the stretch, (4.8); strains at the end
        c00 = 0.5 * (c00 - n); c11 = 0.5 * (c11 - n); c01 = 0.5 * c01; c02 = 0.5 * c02; c12 = 0.5 * c12; c22 = 0.5 * c22
        x = over_end * (fe - ge * n2e)
        v1 = over * (c00 * x + c01 * n2e)
        v2 = c01 * x + c11 * n2e - gm * v1
        v3 = c02 * x + c12 * n2e
        tt0 = component0(v1) * f + component0(v2) * n2
        tt1 = component1(v1) * f + component1(v2) * n2
        v4 = cm * v3
        v3 = am * v3
    else:
        vst(scratch, po, 0, t1); vst(scratch, po + 8, 0, t2); vst(scratch, po + 16, 0, t3)
        n3 = vzero2() - perp(k); n3e = vzero2() - perp(ke)
        x0 = s1 * f + s2 * n2 + s3 * n3
        x1 = vzero2() - s2 * perp(f)
        y1 = s3 * perp(f)
        v1 = 0.5 * (c00 * fe + c01 * n2e + c02 * n3e)
        v2 = 0.5 * (c01 * fe + c11 * n2e + c12 * n3e)
        v3 = 0.5 * (c02 * fe + c12 * n2e + c22 * n3e)
        tt0 = component0(v1) * f + component0(v2) * n2 + component0(v3) * n3
        tt1 = component1(v1) * f + component1(v2) * n2 + component1(v3) * n3
    vst2(scratch, po + 32, 8, tt0); vst2(scratch, po + 48, 8, tt1)
    for a in range(nn):
        t = to + 8 + 24 * a
        q = 64 * a
        n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        o = fo + 32 * a
        vadd2(scratch, o, 8, vld(tab, t, 0) * x0)
        vadd2(scratch, o + 16, 8, n * x1 + dn * y1)
        # rotation rows: a node's director moves with J u
        z = perp(vld2(scratch, q + 16, 8)); ze = perp(vld2(scratch, q + 48, 8))
        b = po + 64 + 80 * a
        if green is None:
            # of shear, of the form of the curvature, of its factor; strains at the end; back to the forms in the middle
            r1 = n * cross2(z, f)
            r2 = n * cross2(z, k) + dn * cross2(u, z)
            r3 = vzero() - n * dot(u, z)
            q2 = n * cross2(ze, fe)
            qk = n * cross2(ze, ke) + dn * cross2(ue, ze)
            qa = vzero() - n * dot(ue, ze)
            q1 = vzero() - (over_end * ge) * q2
            q3 = ae * qk + ce * qa
            p0 = over * (c00 * q1 + c01 * q2 + c02 * q3)
            p1 = c01 * q1 + c11 * q2 + c12 * q3 - gm * p0
            p3 = c02 * q1 + c12 * q2 + c22 * q3
            p2 = am * p3 + half_m * qa
            p3 = cm * p3 + half_m * qk
            vst2(scratch, b + 48, 8, r1 * v2 + r2 * v3 + r3 * v4)
            vst2(scratch, b + 64, 8, p0 * f + p1 * n2)
        else:
            r1 = n * cross2(z, f)
            r2 = dn * cross2(f, z)
            r3 = vzero()
            q2 = n * cross2(ze, fe)
            q3 = dn * cross2(fe, ze)
            p0 = 0.5 * (c01 * q2 + c02 * q3)
            p1 = 0.5 * (c11 * q2 + c12 * q3)
            p2 = 0.5 * (c12 * q2 + c22 * q3)
            p3 = vzero()
            vst2(scratch, b + 48, 8, r1 * v2 + r2 * v3)
            vst2(scratch, b + 64, 8, p0 * f + p1 * n2 + p2 * n3)
        vst(scratch, b, 0, r1); vst(scratch, b + 8, 0, r2); vst(scratch, b + 16, 0, r3)
        vst(scratch, b + 24, 0, p1); vst(scratch, b + 32, 0, p2); vst(scratch, b + 40, 0, p3)


@kernel
def planar_pair(tab, pt, ps, nn, nq, a, b, to0, po0, mo, rate, scratch, green, ko):
    """The 3 x 3 block of nodes a, b."""
    t00 = vzero(); t10 = vzero(); t01 = vzero(); t11 = vzero()
    rr = vzero(); rt = vzero2(); tr = vzero2()
    h2 = vzero(); g2 = vzero(); e3 = vzero(); e4 = vzero()
    for g in range(nq):
        t = to0 + pt * g + 8
        po = po0 + ps * g
        ba = po + 64 + 80 * a
        bb = po + 64 + 80 * b
        pa = vld(tab, t + 24 * a, 0); na = vld(tab, t + 24 * a + 8, 0); da = vld(tab, t + 24 * a + 16, 0)
        pb = vld(tab, t + 24 * b, 0); nb = vld(tab, t + 24 * b + 8, 0); db = vld(tab, t + 24 * b + 16, 0)
        pp = pa * pb
        t00 += pp * vld(scratch, po + 32, 0); t10 += pp * vld(scratch, po + 40, 0)
        t01 += pp * vld(scratch, po + 48, 0); t11 += pp * vld(scratch, po + 56, 0)
        rt += pb * vld2(scratch, ba + 48, 8)
        tr += pa * vld2(scratch, bb + 64, 8)
        rr += vld(scratch, ba, 0) * vld(scratch, bb + 24, 0)
        rr += vld(scratch, ba + 8, 0) * vld(scratch, bb + 32, 0)
        rr += vld(scratch, ba + 16, 0) * vld(scratch, bb + 40, 0)
        s1 = vld(scratch, po, 0); s2 = vld(scratch, po + 8, 0); s3 = vld(scratch, po + 16, 0)
        iso = (0.5 * pp) * s1
        t00 += iso; t11 += iso
        if green is None:
            h2 += (pa * nb) * s2
            g2 += (na * pb) * s2
            e3 += (na * db - da * nb) * s3
            e4 += (na * nb) * vld(scratch, po + 24, 0)
        else:
            h2 += pa * (nb * s2 - db * s3)
            g2 += pb * (na * s2 - da * s3)
    ua = vld2(scratch, 64 * a + 16, 8)
    ub = vld2(scratch, 64 * b + 48, 8)
    tr -= (0.5 * h2) * ub
    rt -= (0.5 * g2) * ua
    if green is None:
        rr += (0.5 * e3) * cross2(ua, ub) + (0.5 * e4) * dot(ua, ub)
    if rate is not None:
        m = rate * vld(tab, mo + 16 + 8 * (nn * a + b), 0) * vld(tab, mo, 0)
        md = rate * vld(tab, mo + 16 + 8 * (nn * nn + nn * a + b), 0) * vld(tab, mo + 8, 0)
        t00 += m; t11 += m
        rr += md * dot(ua, ub)
    vst(scratch, ko, 0, t00); vst(scratch, ko + 8, 0, t01); vst2(scratch, ko + 16, 24, tr)
    vst(scratch, ko + 24, 0, t10); vst(scratch, ko + 32, 0, t11)
    vst2(scratch, ko + 48, 8, rt); vst(scratch, ko + 64, 0, rr)


@one_variant
def planar_groups(tables, first, last, inner, q, dphi, v, line, h, rate, green, r_out, blocks_out, scratch, size):
    """Add residual rows and tangent blocks of the groups from `first` to before `last`; or leave them in `scratch`, rows
    from 128 nn on, blocks from 152 nn on.

    q, dphi, v: [4 N], [2 N], [4 N], the latter two None in statics; line: see `beam.element_groups`. rate: 2/h^2, None
    in statics. green: None for strain set (2.2), else (2.1). inner: None, else inner nodes are eliminated where the tables
    say so. r_out [8 rows], blocks_out [24 blocks].
    """
    meta = tables.meta
    tab = tables.tab
    mixed = line.use[0] != 0.0
    gathered = line.use[0] != FROM_START
    for k in range(first, last):
        nn = meta[k, 0]
        nq = meta[k, 1]
        co = meta[k, 2]
        no = meta[k, 3]
        bo = meta[k, 4]
        pt = 8 * (1 + 3 * nn)
        eo0 = meta[k, 7]
        to0 = co + 72
        mo = to0 + nq * pt
        # scratch: coordinates of the midpoint and the end, inertia, forces, residual, tangent, then the points
        uo = 64 * nn
        fo = uo + 32 * nn
        ro = fo + 32 * nn
        ko = ro + 24 * nn
        po0 = ko + 72 * nn * nn
        ps = 8 * (8 + 10 * nn)
        lo = po0 + nq * ps
        for a in range(nn):
            gather_planar_ends(tables, no + 8 * a, q, dphi, line, v, h, scratch, 64 * a, uo + 32 * a)
            vst2(scratch, lo + 80 * a + 64, 8, vzero2())
        if mixed and gathered:
            for a in range(nn):
                gather_planar_line(tables, no + 8 * a, line, line.off, scratch, 64 * a + 32, lo + 80 * a)
        for i in range(fo, ro, 8):
            vst(scratch, i, 0, 0.0)
        if v is not None:
            rho = vld(tab, mo, 0); j = vld(tab, mo + 8, 0)
            for a in range(nn):
                p = vzero2(); d = vzero2()
                for b in range(nn):
                    p += vld(tab, mo + 16 + 8 * (nn * a + b), 0) * vld2(scratch, uo + 32 * b, 8)
                    d += vld(tab, mo + 16 + 8 * (nn * nn + nn * a + b), 0) * vld2(scratch, uo + 32 * b + 16, 8)
                vst2(scratch, fo + 32 * a, 8, rho * p)
                vst2(scratch, fo + 32 * a + 16, 8, j * d)
        for g in range(nq):
            planar_point(tab, co, to0 + pt * g, eo0 + 24 * g, nn, scratch, fo, lo, mixed, gathered, v, po0 + ps * g, green)
        for a in range(nn):
            for b in range(nn):
                planar_pair(tab, pt, ps, nn, nq, a, b, to0, po0, mo, rate, scratch, green, ko + 72 * (nn * a + b))
            f = vld2(scratch, fo + 32 * a + 16, 8)
            vst2(scratch, ro + 24 * a, 8, vld2(scratch, fo + 32 * a, 8))
            vst(scratch, ro + 24 * a + 16, 0, cross2(vld2(scratch, 64 * a + 16, 8), f))
            # moving the mean director: J u_end x f / 2
            f += vld2(scratch, lo + 80 * a + 64, 8)
            kaa = ko + 72 * (nn * a + a) + 64
            vst(scratch, kaa, 0, vld(scratch, kaa, 0) - 0.5 * dot(vld2(scratch, 64 * a + 48, 8), f))
        if blocks_out is not None:
            every = 1
            if inner is not None:
                if meta[k, 6] >= 0:
                    if not eliminate_inner(inner.store, meta[k, 6], nn, tables, no, scratch, ro, ko, r_out, None, inner.rhs, None,
                                           0, size):
                        inner.state[0] = 0.0
                    every = nn - 1
            for a in range(0, nn, every):
                scatter_rows(scratch, ro + 24 * a, tables.rows, no + 8 * a, 8, 0, r_out, size)
                for b in range(0, nn, every):
                    for i in range(3):
                        scatter_rows(scratch, ko + 72 * (nn * a + b) + 24 * i, tables.blocks, bo + 8 * (nn * a + b), 24, 8 * i,
                                     blocks_out, size)
