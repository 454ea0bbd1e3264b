"""Element loops of geometrically exact beams: residual and tangent of the conserving step, eight elements at a time.

What follows the transposition into lanes goes through a group in parts of `algebra.WIDTH` lanes, as many as a register holds, so
loads, stores and zeros in this file are those of a part.

Unknowns per node are the position increment and the spin increment at the end of the step: a director at t_n+1 varies
by  delta d_i = delta_phi x d_i,n+1  and the equations are projected with the directors of the midpoint, theory.md (4.2).
With both ends equal the same kernel is statics; its tangent is then half the static one.

Layout of one group of 8 elements in `tab` (each entry 8 lanes): C 36; per point: weight, (phi_s, dir, dir_s) of every node;
rhoA, rhoI2, rhoI3; position masses nn*nn; director masses nn*nn. Groups that are equal share it. Reference strains, 6 per point,
stand apart.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel, one_variant, written_in
from .algebra import WIDTH, add_iso, add_skew, cross, dot, outer
from .algebra import padd3 as vadd3
from .algebra import padd_matrix as vadd_matrix
from .algebra import pld as vld
from .algebra import pld3 as vld3
from .algebra import pldm as vldm
from .algebra import pst as vst
from .algebra import pst3 as vst3
from .algebra import pst_matrix as vst_matrix
from .algebra import pzero as vzero
from .algebra import pzero3 as vzero3
from .algebra import pzerom as vzerom
from .inner import eliminate_inner
from .point import add_forces, green_point_stiffness, point_stiffness
from .rows import gather_lanes, scatter_rows
from .gather import gather_ends, gather_line
from .strains import Q_LANES, SHAPES, STRESSES, interpolate, mean_strains, stresses, unused_strains
from .work import FROM_START

EIGHTEEN = (0,) * 18   # three columns for each of two directors, as `blocks.SIX`


class ElementTables(NamedTuple):
    """Constant tables of all elements with one strain set; G groups of 8 lanes."""

    meta: np.ndarray     # int64 [G, 8]: nodes nn, points nq, offset in tab, in nodes, in blocks, 1 where C is coupled, offset of
    #                      the factors of inner nodes or -1, of the reference strains in tab
    tab: np.ndarray      # float64 [*], see the module docstring
    nodes: np.ndarray    # int64 [*]: per group nn x 8 node numbers; idle lanes repeat the last element
    rows: np.ndarray     # int64 [*]: per group nn x 8 rows of the residual; idle lanes point to the row behind the last
    blocks: np.ndarray   # int64 [*]: per group nn x nn x 8 blocks of the tangent; idle lanes to the block behind the last


def point_table_size(nn: int) -> int:
    """Doubles per quadrature point in `tab`."""
    return 8 * (1 + 3 * nn)


def group_table_size(nn: int, nq: int) -> int:
    """Doubles per group in `tab`."""
    return 8 * (36 + 3 + 2 * nn * nn) + nq * point_table_size(nn)


def scratch_size(nn: int, nq: int) -> int:
    """Doubles of scratch that a group needs."""
    return 8 * (nn * (24 + 12 + 12 + 6) + nn * nn * 36 + nn * (18 + 24 + 12)) + nq * point_scratch_size(nn)


@one_variant
def point_scratch_size(nn):
    """Doubles of scratch of a point: stresses, matrix of the positions, rows and matrices of every node, what derivatives of the
    strains need."""
    return STRESSES + 8 * (9 + 54 * nn) + SHAPES


@kernel
def pair_stiffness(tab, pt, ps, nn, nq, a, b, to0, so0, po0, mo, rate, scratch, qa, qb, green, ko):
    """The 6 x 6 block of nodes a, b: material part from the shared matrices, geometric part from the stresses, `rate` (2/h^2 or
    None) times the projected mass, theory.md (4.1), (4.2); qa, qb: mid coordinates of a and end coordinates of b."""
    # a pass over the points for each quarter: more than 12 accumulators of 8 lanes and their factors do not stay in registers
    a2 = vld3(scratch, qa + 48, 8); a3 = vld3(scratch, qa + 72, 8)
    b2 = vld3(scratch, qb + 48, 8); b3 = vld3(scratch, qb + 72, 8)
    # rotation against position
    krt = vzerom()
    g2 = vzero(); g3 = vzero(); e7 = vzero()
    for g in range(nq):
        t = to0 + pt * g + 8
        so = so0 + ps * g
        na = vld(tab, t + 24 * a + 8, 0); pb = vld(tab, t + 24 * b, 0)
        krt += pb * vldm(scratch, po0 + ps * g + 360 + 432 * a, 8)
        pn = na * pb
        g2 += pn * vld(scratch, so + 8, 0); g3 += pn * vld(scratch, so + 16, 0)
        if green is None:
            e7 += (na * vld(tab, t + 24 * b + 8, 0)) * vld(scratch, so + 48, 0)
        else:
            dp = vld(tab, t + 24 * a + 16, 0) * pb
            g2 -= dp * vld(scratch, so + 40, 0); g3 += dp * vld(scratch, so + 32, 0)
    u = g2 * a2 + g3 * a3
    vst_matrix(scratch, ko + 144, 48, 8, add_skew(krt, 0.5 * u))
    krr = vzerom()
    e4 = vzero(); e5 = vzero(); e6 = vzero()
    for g in range(nq):
        t = to0 + pt * g + 8
        so = so0 + ps * g
        ba = po0 + ps * g + 72 + 432 * a
        bb = po0 + ps * g + 216 + 432 * b
        for i in range(6):
            krr += outer(vld3(scratch, ba + 24 * i, 8), vld3(scratch, bb + 24 * i, 8))
        twist = vld(tab, t + 24 * a + 16, 0) * vld(tab, t + 24 * b + 8, 0)
        twist -= vld(tab, t + 24 * a + 8, 0) * vld(tab, t + 24 * b + 16, 0)
        e4 += vld(scratch, so + 24, 0) * twist
        if green is None:
            e5 += vld(scratch, so + 32, 0) * twist
            e6 += vld(scratch, so + 40, 0) * twist
    # directors against directors: sum b_i w_i^T - (sum b_i . w_i) I, the stresses skew, the inertia diagonal
    q4 = 0.25 * e4
    q2 = 0.5 * e7; q3 = q2
    if rate is not None:
        md = rate * vld(tab, mo + 24 + 8 * (nn * nn + nn * a + b), 0)
        q2 += md * vld(tab, mo + 8, 0)
        q3 += md * vld(tab, mo + 16, 0)
    w2 = q4 * a3 - q2 * a2
    w3 = vzero3() - q4 * a2 - q3 * a3
    iso = vzero()
    if green is None:
        a1 = vld3(scratch, qa + 24, 8); b1 = vld3(scratch, qb + 24, 8)
        q5 = 0.25 * e5; q6 = 0.25 * e6
        w1 = q6 * a2 - q5 * a3 - (0.5 * e7) * a1
        w2 -= q6 * a1
        w3 += q5 * a1
        krr += outer(b1, w1)
        iso = dot(b1, w1)
    krr += outer(b2, w2)
    krr += outer(b3, w3)
    iso += dot(b2, w2) + dot(b3, w3)
    vst_matrix(scratch, ko + 168, 48, 8, add_iso(krr, -1.0 * iso))
    # position against rotation, with the sums of stress times basis products
    ktr = vzerom()
    h2 = vzero(); h3 = vzero()
    for g in range(nq):
        t = to0 + pt * g + 8
        so = so0 + ps * g
        pa = vld(tab, t + 24 * a, 0); nb = vld(tab, t + 24 * b + 8, 0)
        ktr += pa * vldm(scratch, po0 + ps * g + 432 + 432 * b, 8)
        pn = pa * nb
        h2 += pn * vld(scratch, so + 8, 0); h3 += pn * vld(scratch, so + 16, 0)
        if green is not None:
            pd = pa * vld(tab, t + 24 * b + 16, 0)
            h2 -= pd * vld(scratch, so + 40, 0); h3 += pd * vld(scratch, so + 32, 0)
    v = h2 * b2 + h3 * b3
    vst_matrix(scratch, ko + 24, 48, 8, add_skew(ktr, -0.5 * v))
    # position against position
    ktt = vzerom()
    for g in range(nq):
        t = to0 + pt * g + 8
        ktt += (vld(tab, t + 24 * a, 0) * vld(tab, t + 24 * b, 0)) * vldm(scratch, po0 + ps * g, 8)
    if rate is not None:
        ktt = add_iso(ktt, rate * vld(tab, mo + 24 + 8 * (nn * a + b), 0) * vld(tab, mo, 0))
    vst_matrix(scratch, ko, 48, 8, ktt)


@kernel
def add_pair_spin_rates(tab, mo, nn, a, b, rate, scratch, qa, rb, ko):
    """The same for generalised alpha: `rate` on the positions, on the directors the derivatives of d'' by the spin of b, six
    vectors from rb on (theory.md 7)."""
    m = rate * vld(tab, mo + 24 + 8 * (nn * a + b), 0)
    md = vld(tab, mo + 24 + 8 * (nn * nn + nn * a + b), 0)
    j2 = md * vld(tab, mo + 8, 0); j3 = md * vld(tab, mo + 16, 0)
    vadd_matrix(scratch, ko, 48, 8, add_iso(vzerom(), m * vld(tab, mo, 0)))
    a2 = j2 * vld3(scratch, qa + 48, 8); a3 = j3 * vld3(scratch, qa + 72, 8)
    for c in range(3):
        vadd3(scratch, ko + 168 + 8 * c, 48,
              cross(a2, vld3(scratch, rb + 24 * c, 8)) + cross(a3, vld3(scratch, rb + 72 + 24 * c, 8)))


@kernel
def add_inertia_forces(tab, mo, nn, scratch, uo, fo):
    """M u on the 12 coordinates of every node; u = 2/h^2 (q_n+1 - q_n - h v_n)."""
    rho = vld(tab, mo, 0); j2 = vld(tab, mo + 8, 0); j3 = vld(tab, mo + 16, 0)
    for a in range(nn):
        p = vzero3(); d2 = vzero3(); d3 = vzero3()
        for b in range(nn):
            m = vld(tab, mo + 24 + 8 * (nn * a + b), 0)
            md = vld(tab, mo + 24 + 8 * (nn * nn + nn * a + b), 0)
            u = uo + 96 * b
            p += m * vld3(scratch, u, 8)
            d2 += md * vld3(scratch, u + 48, 8)
            d3 += md * vld3(scratch, u + 72, 8)
        o = fo + 96 * a
        vadd3(scratch, o, 8, rho * p)
        vadd3(scratch, o + 48, 8, j2 * d2)
        vadd3(scratch, o + 72, 8, j3 * d3)


@kernel
def project_node(scratch, q, fo, go, ro, ko):
    """Residual rows of a node: (f_phi, sum d_i,mid x f_i), and the part of the tangent that comes from moving d_i,mid; go: what
    the tangent adds to the forces f."""
    vst3(scratch, ro, 8, vld3(scratch, fo, 8))
    moment = vzero3()
    k = vzerom()
    iso = vzero()
    for i in range(1, 4):
        f = vld3(scratch, fo + 24 * i, 8)
        moment += cross(vld3(scratch, q + 24 * i, 8), f)
        d = vld3(scratch, q + 96 + 24 * i, 8)
        f += vld3(scratch, go + 24 * i, 8)
        k += outer(d, f)
        iso -= dot(d, f)
    vst3(scratch, ro + 24, 8, moment)
    half = 0.5 * add_iso(k, iso)
    vadd_matrix(scratch, ko + 168, 48, 8, half)


@written_in
def evaluate(tab, co, to0, mo, eo0, nn, nq, coupled, mixed, gathered, dphi, v, u, rate, spin_rate, green, middle, scratch, qo, uo,
             fo, ro, ko, so0, vo, lo, go):
    """Residual and tangent of a part of a group, whose coordinates stand in scratch. Offsets of its first lane: in tab C, points,
    inertia, reference strains; in scratch coordinates, second rates, forces, residual, tangent, points, spin rates, the last
    increment, forces of the tangent."""
    pt = 8 * (1 + 3 * nn)
    ps = point_scratch_size(nn)
    for i in range(fo, fo + 96 * nn, 8):
        vst(scratch, i, 0, 0.0)
    if v is not None or u is not None:
        add_inertia_forces(tab, mo, nn, scratch, uo, fo)
    for i in range(go, go + 96 * nn, 8):
        vst(scratch, i, 0, 0.0)
    for g in range(nq):
        to = to0 + pt * g
        so = so0 + ps * g
        po = so + STRESSES
        ao = so + ps - SHAPES
        zm = ko            # the tangent room is free until the pair loop
        ze = zm + 168
        eo = zm + 336
        interpolate(tab, to, nn, scratch, qo, zm)
        interpolate(tab, to, nn, scratch, qo + 96, ze)
        room = zm + 728
        mean_strains(tab, eo0 + 48 * g, scratch, zm, ze, green, middle, eo, room, ao)
        stresses(tab, co, to, coupled, scratch, eo, so, green, ao)
        add_forces(tab, to, nn, scratch, zm, so, green, 1, fo)
        if mixed:
            zb = zm + 392
            zx = zm + 560
            if gathered:
                interpolate(tab, to, nn, scratch, lo, zb)
                interpolate(tab, to, nn, scratch, lo + 96, zx)
            unused_strains(tab, eo0 + 48 * g, scratch, zm, ze, gathered, zb, zx, dphi, spin_rate, green, middle, eo, room, ao)
            stresses(tab, co, to, coupled, scratch, eo, room, green, ao)
            add_forces(tab, to, nn, scratch, zm, room, green, None, go)
            for i in range(0, STRESSES if green is None else 48, 8):
                vst(scratch, so + i, 0, vld(scratch, so + i, 0) + vld(scratch, room + i, 0))
        if green is None:
            point_stiffness(tab, co, to, nn, coupled, scratch, zm, ze if middle is None else zm, qo, so, po, ao)
        else:
            green_point_stiffness(tab, co, to, nn, coupled, scratch, zm, ze if middle is None else zm, qo, so, po)
    for a in range(nn):
        for b in range(nn):
            kab = ko + 288 * (nn * a + b)
            if spin_rate is not None:
                pair_stiffness(tab, pt, ps, nn, nq, a, b, to0, so0, so0 + STRESSES, mo, None, scratch, qo + Q_LANES * a,
                               qo + Q_LANES * b + 96, green, kab)
                add_pair_spin_rates(tab, mo, nn, a, b, rate, scratch, qo + Q_LANES * a, vo + 144 * b, kab)
            else:
                pair_stiffness(tab, pt, ps, nn, nq, a, b, to0, so0, so0 + STRESSES, mo, rate, scratch, qo + Q_LANES * a,
                               qo + Q_LANES * b + 96, green, kab)
        project_node(scratch, qo + Q_LANES * a, fo + 96 * a, go + 96 * a, ro + 48 * a, ko + 288 * (nn * a + a))


@one_variant
def element_groups(tables, first, last, inner, q, dphi, v, u, line, h, rate, spin_rate, green, middle, r_out, blocks_out, scratch,
                   size):
    """Add residual rows and tangent blocks of the groups from `first` to before `last`; without r_out and blocks_out (None) they
    stay in `scratch`: rows from 384 nn on, blocks from 432 nn on.

    q, dphi, v: [12 N], [3 N], [12 N], coordinates at the start of the step of size h, increments of positions, and velocities;
    statics has only q.
    u: None, else second rates of the coordinates instead of those of the conserving step. line: the last increment (work.Line);
    where it says so, the tangent takes the stresses to which that led in a straight line, theory.md (4.6), else the present ones.
    rate: 2/h^2, None in statics. spin_rate: None or [18 N], derivatives of the second rates of d2, d3 by the spins (generalised
    alpha). green: None for strain set (2.2), else (2.1); branches on what is
    None are pruned, so the default set compiles less. middle: None, else stresses come from the strains of q_mid (implicit
    midpoint). inner: None, else inner nodes are eliminated where the tables say so.
    r_out [8 rows], blocks_out [48 blocks]: rows padded to 8 doubles.
    """
    meta = tables.meta
    tab = tables.tab
    mixed = line.use[0] != 0.0
    # before the first increment of a step the line is at its start, which the middle and the end tell
    gathered = line.use[0] != FROM_START
    if spin_rate is not None:
        gathered = True
    for k in range(first, last):
        nn = meta[k, 0]
        nq = meta[k, 1]
        co = meta[k, 2]
        no = meta[k, 3]
        bo = meta[k, 4]
        coupled = meta[k, 5] != 0
        eo0 = meta[k, 7]
        to0 = co + 288
        mo = to0 + nq * 8 * (1 + 3 * nn)
        # scratch: coordinates, inertia, forces, residual, tangent, then the points
        uo = Q_LANES * nn
        fo = uo + 96 * nn
        ro = fo + 96 * nn
        ko = ro + 48 * nn
        so0 = ko + 288 * nn * nn
        ps = point_scratch_size(nn)
        for a in range(nn):
            gather_ends(tables, no + 8 * a, q, dphi, line, v, u, spin_rate, h, scratch, Q_LANES * a, uo + 96 * a)
        vo = so0 + nq * ps
        lo = vo + 144 * nn
        go = lo + Q_LANES * nn
        if mixed and gathered:
            for a in range(nn):
                gather_line(tables, no + 8 * a, q, spin_rate, line, line.off, scratch, Q_LANES * a + 96, lo + Q_LANES * a)
        if spin_rate is not None:
            for a in range(nn):
                gather_lanes(spin_rate, tables.nodes, no + 8 * a, 18, scratch, vo + 144 * a, EIGHTEEN)
        for lane in range(0, 8, WIDTH):
            evaluate(tab, co + lane, to0 + lane, mo + lane, eo0 + lane, nn, nq, coupled, mixed, gathered, dphi, v, u, rate,
                     spin_rate, green, middle, scratch, lane, uo + lane, fo + lane, ro + lane, ko + lane, so0 + lane, vo + lane,
                     lo + lane, go + lane)
        if blocks_out is not None:
            every = 1
            if inner is not None:
                if meta[k, 6] >= 0:
                    if not eliminate_inner(inner.store, meta[k, 6], nn, tables, no, scratch, ro, ko, r_out, None, inner.rhs, None,
                                           0, size):
                        inner.state[0] = 0.0
                    every = nn - 1
            for a in range(0, nn, every):
                scatter_rows(scratch, ro + 48 * a, tables.rows, no + 8 * a, 8, 0, r_out, size)
                for b in range(0, nn, every):
                    for i in range(6):
                        scatter_rows(scratch, ko + 288 * (nn * a + b) + 48 * i, tables.blocks, bo + 8 * (nn * a + b), 48, 8 * i,
                                     blocks_out, size)
