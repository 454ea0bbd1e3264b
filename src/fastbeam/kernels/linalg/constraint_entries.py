"""Entries of constraints in the blocks of constraint_solve.py; entries on inner nodes are carried to ends of elements.

A constraint with columns C and lines L on the inner nodes of an element, which were eliminated in the element loop
(inner_nodes.py), leaves at the other nodes j, and between constraints k, l,

    C_i <- K_ii^-1 C_i,   C_j -= K_ji C_i,   L_j -= L_i U_ij,   D_kl -= L_ki C_il,   r_k -= L_ki y_i

Arrays: store [*] as `Factors.store`; buffer [*], columns and lines of the constraints of one element, rows of 8; r, rhs, x_out [8
(rows + 1)]; y [7 S], unknowns of all constraints; q_mid, q_end [12 N], in a plane [4 N]; scratch [*].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.blocks import ONE, solve_column, solve_rows, subtract_column, subtract_lanes, subtract_rows
from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.algebra.lanes import gather_lanes, put_rows
from fastbeam.kernels.algebra.vectors import cross, cross2, ld2, ld3, st2, st3, vld, vst
from fastbeam.kernels.beams.inner_nodes import INNER_NODES, PLACE, ROWS
from fastbeam.kernels.beams.planar_nodes import PlanarTies, planar_arm
from fastbeam.kernels.beams.ties import Ties, tie_arm
from fastbeam.kernels.entries.dense import (
    Contact,
    add_column,
    add_column_times,
    add_line,
    add_line_rows,
    add_transposed,
    put_own_block,
)
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import ARM, FACTORS, LIST, NODES, POSITION, TRIAD
from fastbeam.kernels.linalg.constraint_blocks import subtract_on_slider
from fastbeam.kernels.linalg.constraint_rows import BEFORE, CONSTRAINT, ELEMENT, FIRST_ENTRY, JOBS, PLACE_OF_END, PLACE_OF_START
from fastbeam.kernels.linalg.constraint_solve import FAR, RIGHT, fetch_rows
from fastbeam.kernels.terms import NoTies


@kernel
def add_rows(store, to, column, at, n):
    """Add n rows of 8 in column [*] from `at` on to a block."""
    for c in range(0, 8 * n, 8):
        vst(store, to + c, 0, vld(store, to + c, 0) + vld(column, at + c, 0))


@inlined
def start_blocks(contact, couplings, order, factors, r, dofs):
    """Store right-hand sides, own blocks of constraints, and zeros."""
    n = len(dofs)
    store = factors.store
    nodes = order.rank.shape[0]
    for i in range(couplings.end[0], order.counts[1], 8):
        vst(store, i, 0, 0.0)
    for i in range(nodes):
        d = couplings.diagonal[i] + RIGHT
        for c in range(n):
            store[d + 8 * c] = -r[8 * i + c]
    for k in range(couplings.unknowns.shape[0]):
        d = order.diagonal[order.position[nodes + k]]
        put_own_block.call(contact, k, store, d, couplings.unknowns[k], dofs)
        for a in range(couplings.unknowns[k]):
            store[d + 8 * a + RIGHT] = -contact.residual[k, a]
            factors.own[7 * k + a] = 0.0
    factors.failed[1] = -1


@inlined
def put_entries(contact, couplings, touched, order, factors, dofs):
    """Store entries on rows that the solver sees."""
    constraints = couplings.unknowns.shape[0]
    ahead = 2 if order.counts[1] > FAR else constraints
    for k in range(constraints):
        if k + ahead < constraints:
            for t in range(touched.start[k + ahead], touched.start[k + ahead + 1]):
                fetch_rows(factors.store, touched.column[t], len(dofs))
                fetch_rows(factors.store, touched.line[t], couplings.unknowns[k + ahead])
        for m in range(contact.entries[k]):
            t = touched.entry[k, m]
            if t >= 0:
                add_column.call(contact, k, m, factors.store, touched.column[t], dofs)
                add_line_rows.call(contact, k, m, factors.store, touched.line[t], couplings.unknowns[k], dofs)
    couple_moments.call(contact, couplings, touched, factors, dofs)


@generic
def couple_moments(contact, couplings, touched, factors, dofs):
    """Add derivatives of the sliding equations of sleeves by the moments, and of the equations of the moments by s."""


@couple_moments.register(FactoredContact)
@kernel
def couple_no_moments(contact, couplings, touched, factors, dofs):
    pass


@couple_moments.register(Contact)
@kernel
def couple_all_moments(contact, couplings, touched, factors, dofs):
    d = dim(dofs)
    for o in range(contact.pair.shape[0]):
        for a in range(couplings.unknowns[contact.pair[o, 1]]):
            factors.store[touched.cross[o, 0] + 8 * d + a] += contact.cross[o, 0, a]
            factors.store[touched.cross[o, 1] + 8 * a + d] += contact.cross[o, 1, a]


@inlined
def gather_job(contact, inner, touched, j, buffer, at, dofs):
    """Gather columns and lines of one job by the nodes of its element, columns of all nodes first."""
    n = len(dofs)
    e = touched.job[j, ELEMENT]
    k = touched.job[j, CONSTRAINT]
    nodes = inner.where[e, INNER_NODES] + 2
    for c in range(at, at + 16 * n * nodes, 8):
        vst(buffer, c, 0, 0.0)
    m = touched.job[j, FIRST_ENTRY]
    while m >= 0:
        i = 1
        while inner.rows[inner.where[e, ROWS] + i] != contact.row[k, m]:
            i += 1
        add_column.call(contact, k, m, buffer, at + 8 * n * i, dofs)
        add_line.call(contact, k, m, buffer, at + 8 * n * (nodes + i), dofs)
        m = touched.after[k, m]


@inlined
def carry_inside(couplings, touched, order, factors, f, i, nodes, y, rhs, buffer, pair, dofs):
    """Subtract L_ki C_il from D_kl and L_ki y_i from r_k for inner node i of the element, whose columns are solved; y: offset of
    y_i in rhs."""
    n = len(dofs)
    store = factors.store
    stride = 16 * n * nodes
    a = 0
    p = touched.last_job[touched.found[f, ELEMENT]]
    while p >= 0:
        k = touched.job[p, CONSTRAINT]
        m = couplings.unknowns[k]
        line = stride * a + 8 * n * (nodes + i)
        for b in range(touched.found[f, JOBS]):
            d = touched.pair[pair + touched.found[f, JOBS] * a + b]
            column = stride * b + 8 * n * i
            forces = couplings.forces[k] if a == b else 0
            for u in range(forces):
                factors.own[7 * k + u] += store[d + 9 * u]
            if m == 2 * dim(dofs) + 1:
                subtract_on_slider(buffer, line, 1, 8, buffer, column, 8, store, d, 8, dofs)
            else:
                for u in range(m):
                    z = vld(store, d + 8 * u, 0)
                    for c in range(n):
                        z -= buffer[line + 8 * c + u] * vld(buffer, column + 8 * c, 0)
                    vst(store, d + 8 * u, 0, z)
            for u in range(forces):
                factors.own[7 * k + u] -= store[d + 9 * u]
        d = touched.pair[pair + touched.found[f, JOBS] * a + a]
        for u in range(m):
            z = store[d + 8 * u + RIGHT]
            for c in range(n):
                z += buffer[line + 8 * c + u] * rhs[y + c]
            store[d + 8 * u + RIGHT] = z
        a += 1
        p = touched.job[p, BEFORE]


@inlined
def carry_jobs(inner, couplings, touched, order, factors, f, buffer, pair, dofs):
    """Eliminate the inner nodes of one element from the columns and lines of its constraints, side by side in buffer."""
    n = len(dofs)
    block = 8 * n * n
    e = touched.found[f, ELEMENT]
    d = inner.where[e, PLACE]
    count = inner.where[e, INNER_NODES]
    nodes = count + 2
    for i in range(1, count + 1):
        others = count + 2 - i
        for b in range(touched.found[f, JOBS]):
            at = 16 * n * nodes * b
            solve_rows(inner.store, d, 8 * n, 8, buffer, at + 8 * n * i, 8, dofs)
        y = 8 * inner.rows[inner.where[e, ROWS] + i]
        carry_inside(couplings, touched, order, factors, f, i, nodes, y, inner.rhs, buffer, pair, dofs)
        for b in range(touched.found[f, JOBS]):
            at = 16 * n * nodes * b
            line = at + 8 * n * nodes
            for m in range(others):
                j = i + 1 + m if m < others - 1 else 0
                u = d + block * (1 + 2 * m)
                subtract_rows(inner.store, u + block, 8 * n, 8, buffer, at + 8 * n * i, 8, buffer, at + 8 * n * j, 8, dofs)
                # the transpose of U_ij
                subtract_rows(inner.store, u, 8, 8 * n, buffer, line + 8 * n * i, 8, buffer, line + 8 * n * j, 8, dofs)
        d += block * (1 + 2 * others)


@generic
def pass_on(ties, e, q_mid, q_end, buffer, column, line, m, store, to_column, to_line):
    """Add the m columns and lines of a tied node, in buffer, to blocks of the target of entry e of its ties: the transposed map
    of the tie, a force on the position or with the moment of an arm."""


@pass_on.register(Ties)
@kernel
def pass_on_in_space(ties, e, q_mid, q_end, buffer, column, line, m, store, to_column, to_line):
    for a in range(m):
        f = ld3(buffer, column + a, 8)
        g = ld3(buffer, line + a, 8)
        o = 0
        if ties.kind[e] == ARM:
            f = cross(tie_arm(ties, e, q_mid), f)
            g = cross(tie_arm(ties, e, q_end), g)
            o = 3
        elif ties.kind[e] == TRIAD:
            f = ld3(buffer, column + 24 + a, 8)
            g = ld3(buffer, line + 24 + a, 8)
            o = 3
        st3(store, to_column + 8 * o + a, 8, ld3(store, to_column + 8 * o + a, 8) + f)
        st3(store, to_line + 8 * a + o, 1, ld3(store, to_line + 8 * a + o, 1) + g)


@pass_on.register(PlanarTies)
@kernel
def pass_on_in_plane(ties, e, q_mid, q_end, buffer, column, line, m, store, to_column, to_line):
    for a in range(m):
        f = ld2(buffer, column + a, 8)
        g = ld2(buffer, line + a, 8)
        if ties.kind[e] == POSITION:
            st2(store, to_column + a, 8, ld2(store, to_column + a, 8) + f)
            st2(store, to_line + 8 * a, 1, ld2(store, to_line + 8 * a, 1) + g)
        elif ties.kind[e] == ARM:
            store[to_column + 16 + a] += cross2(planar_arm(ties, e, q_mid), f)
            store[to_line + 8 * a + 2] += cross2(planar_arm(ties, e, q_end), g)
        else:
            store[to_column + 16 + a] += buffer[column + 16 + a]
            store[to_line + 8 * a + 2] += buffer[line + 16 + a]


@generic
def put_end(ties, couplings, touched, factors, j, t, column, line, buffer, q_mid, q_end, dofs):
    """Add columns and lines of job j at an end of its element, place t, to the blocks; a tied node passes them on."""


@put_end.register(NoTies)
@kernel
def put_free_end(ties, couplings, touched, factors, j, t, column, line, buffer, q_mid, q_end, dofs):
    n = len(dofs)
    add_rows(factors.store, touched.column[t], buffer, column, n)
    add_transposed(factors.store, touched.line[t], buffer, line, n, couplings.unknowns[touched.job[j, CONSTRAINT]])


@put_end.register(Ties)
@put_end.register(PlanarTies)
@kernel
def put_tied_end(ties, couplings, touched, factors, j, t, column, line, buffer, q_mid, q_end, dofs):
    n = len(dofs)
    k = touched.job[j, CONSTRAINT]
    m = couplings.unknowns[k]
    add_rows(factors.store, touched.column[t], buffer, column, n)
    add_transposed(factors.store, touched.line[t], buffer, line, n, m)
    node = couplings.tied[touched.row[t]]
    if node >= 0:
        for e in range(ties.start[node], ties.start[node + 1]):
            if ties.target[e] != node:
                to = touched.start[k]
                while touched.row[to] != ties.target_row[e]:
                    to += 1
                pass_on.call(ties, e, q_mid, q_end, buffer, column, line, m, factors.store, touched.column[to], touched.line[to])


@inlined
def fetch_jobs(inner, couplings, touched, factors, f, n):
    """Prefetch the blocks of the jobs of element f."""
    e = touched.found[f, ELEMENT]
    rows = 0
    for others in range(2, inner.where[e, INNER_NODES] + 2):
        rows += n * n * (1 + 2 * others)
    fetch_rows(inner.store, inner.where[e, PLACE], rows)
    j = touched.last_job[e]
    while j >= 0:
        for c in range(4, 6):
            t = touched.job[j, c]
            fetch_rows(factors.store, touched.column[t], n)
            fetch_rows(factors.store, touched.line[t], couplings.unknowns[touched.job[j, CONSTRAINT]])
        j = touched.job[j, BEFORE]


@kernel
def carry(contact, inner, ties, couplings, touched, order, factors, buffer, q_mid, q_end, dofs):
    """Carry entries on inner nodes to the ends, element by element."""
    n = len(dofs)
    pair = 0
    for f in range(touched.counts[0]):
        if order.counts[1] > FAR and f + 1 < touched.counts[0]:
            fetch_jobs(inner, couplings, touched, factors, f + 1, n)
        nodes = inner.where[touched.found[f, ELEMENT], INNER_NODES] + 2
        last = touched.last_job[touched.found[f, ELEMENT]]
        at = 0
        j = last
        while j >= 0:
            gather_job(contact, inner, touched, j, buffer, at, dofs)
            at += 16 * n * nodes
            j = touched.job[j, BEFORE]
        carry_jobs(inner, couplings, touched, order, factors, f, buffer, pair, dofs)
        pair += touched.found[f, JOBS] * touched.found[f, JOBS]
        at = 0
        j = last
        while j >= 0:
            line = at + 8 * n * nodes
            put_end.call(ties, couplings, touched, factors, j, touched.job[j, PLACE_OF_START], at, line, buffer, q_mid, q_end,
                         dofs)
            put_end.call(ties, couplings, touched, factors, j, touched.job[j, PLACE_OF_END], line - 8 * n,
                    line + 8 * n * (nodes - 1), buffer, q_mid, q_end, dofs)
            at += 16 * n * nodes
            j = touched.job[j, BEFORE]


@inlined
def clear_held_columns(held, touched, factors, n):
    """Set the columns on prescribed unknowns to zero."""
    for k in range(held.row.shape[0]):
        row = held.row[k]
        if row < n:
            for u in range(touched.user_start[row], touched.user_start[row + 1]):
                o = touched.column[touched.user[u]]
                for c in range(6):
                    if (held.mask[k] >> c) & 1:
                        vst(factors.store, o + 8 * c, 0, 0.0)


@kernel
def start_inner(inner, x_out, dofs):
    """Store -y of the inner nodes in their rows."""
    n = len(dofs)
    for i in range(inner.first[0], inner.first[0] + inner.element.shape[0]):
        for c in range(n):
            x_out[8 * i + c] = -inner.rhs[8 * i + c]


@separate
def add_inner(contact, inner, touched, couplings, y, buffer, x_out, dofs):
    """Subtract the contribution of the solved unknowns y of constraints from the rows of inner nodes: K_ii^-1 C_i y, and the part
    passed on from inner nodes before them."""
    n = len(dofs)
    block = 8 * n * n
    for f in range(touched.counts[0]):
        e = touched.found[f, ELEMENT]
        count = inner.where[e, INNER_NODES]
        rows = inner.where[e, ROWS]
        for c in range(8 * (count + 2)):
            buffer[c] = 0.0
        j = touched.last_job[e]
        while j >= 0:
            k = touched.job[j, CONSTRAINT]
            m = touched.job[j, FIRST_ENTRY]
            while m >= 0:
                i = 1
                while inner.rows[rows + i] != contact.row[k, m]:
                    i += 1
                add_column_times.call(contact, k, m, y, couplings.first[k], couplings.unknowns[k], buffer, 8 * i, dofs)
                m = touched.after[k, m]
            j = touched.job[j, BEFORE]
        d = inner.where[e, PLACE]
        for i in range(1, count + 1):
            others = count + 2 - i
            solve_column(inner.store, d, 8 * n, 8, buffer, 8 * i, 1, dofs)
            for m in range(others - 2):
                low = d + 2 * block * (m + 1)
                subtract_column(inner.store, low, 8 * n, 8, buffer, 8 * i, 1, buffer, 8 * (i + 1 + m), 1, dofs)
            for c in range(n):
                x_out[8 * inner.rows[rows + i] + c] -= buffer[8 * i + c]
            d += block * (1 + 2 * others)


@separate
def recover_inner_rows(tables, inner, x_out, scratch, dofs):
    """Recover increments of all inner nodes of elements with one strain set, from those of the end nodes and the numbers that
    `start_inner` and `add_inner` left in their rows."""
    n = len(dofs)
    block = 8 * n * n
    for k in range(tables.meta.shape[0]):
        if tables.meta[k, FACTORS] >= 0:
            nn = tables.meta[k, NODES]
            no = tables.meta[k, LIST]
            gather_lanes(x_out, tables.rows, no, 8, scratch, 0, dofs)
            gather_lanes(x_out, tables.rows, no + 8 * (nn - 1), 8, scratch, 8 * n * (nn - 1), dofs)
            end = tables.meta[k, FACTORS]
            for i in range(1, nn - 1):
                end += block * (1 + 2 * (nn - i))
            for i in range(nn - 2, 0, -1):
                end -= block * (1 + 2 * (nn - i))
                xi = 8 * n * i
                gather_lanes(x_out, tables.rows, no + 8 * i, 8, scratch, xi, dofs)
                for m in range(nn - i):
                    a = i + 1 + m if m < nn - 1 - i else 0
                    subtract_lanes(inner.store, end + block * (1 + 2 * m), scratch, 8 * n * a, scratch, xi, ONE, dofs)
                put_rows(scratch, xi, tables.rows, no + 8 * i, 8, 0, x_out, dofs)
