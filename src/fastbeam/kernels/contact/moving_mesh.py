"""Conserving step of beams whose elements move with their contacts (theory.md 5.12).

The history keeps momenta of points of the elements. Their means over a step follow from mean rates; forces on nodes and places of
contacts change their sums. That conserves energy and both momenta.

Arrays: q, q_mid, q_end, v [12 N]; raw [84 n], with n nodes an element; rows [42 n]; k [6 n + 2, 6 n + 2]; history [*]; p, p_out
[12 N]; out [9], of `potential_energy` [1]; counts_out [5].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.vectors import add3, cross, dot, ld3, zero3
from fastbeam.kernels.contact.moving_beam import (
    MovingBeam,
    add_inertia,
    add_shape_stiffness,
    clear_element,
    density_place,
    energy_at,
    mean_density,
    put_forms,
    put_scales,
    put_slopes,
    put_stresses,
    size_of,
    strains_at,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Conserving, account, assemble, potential_energy, spread_nodes, within_limits


@kernel
def put_rows(beam, e, q, raw, first, rows, at):
    """Transform derivatives by coordinates, in raw from `first` on, to derivatives by unknowns, in rows from `at` on: vectors,
    and sums of directors cross vectors."""
    for a in range(beam.node.shape[1]):
        moment = zero3()
        for d in range(3, 12, 3):
            moment += cross(ld3(q, 12 * beam.node[e, a] + d, 1), ld3(raw, first + 12 * a + d, 1))
        force = ld3(raw, first + 12 * a, 1)
        for c in range(6):
            rows[at + 6 * a + c] = 0.0
        add3(rows, at + 6 * a, 1, force)
        add3(rows, at + 6 * a + 3, 1, moment)


@kernel
def add_along(w, c, weight, way0, way1):
    """Add the contribution of one point with stored energy to forces on the places at both ends, which change the length of the
    element, and to their derivatives. c: weight times its mean; way0, way1: derivatives of the length by the places."""
    ways = (way0, way1)
    n = w.column.shape[0] // 2
    value = 0.0
    bend = 0.0
    for i in range(7):
        mean = 0.5 * (w.form[0, i] + w.form[1, i])
        value += c * w.stress[i] * mean * w.scale[2, i]
        bend += w.stress[i] * mean * (0.5 * weight * w.scale[2, i] + c * w.scale[3, i])
    for j in range(7):
        both = 0.5 * (w.scale[0, j] + w.scale[1, j])
        # stress on form j by h1, and the length's force by form j
        turn = w.stress[j] * (0.5 * weight * both + 0.5 * c * w.scale[4, j])
        pull = 0.5 * c * w.stress[j] * w.scale[2, j] / w.scale[1, j]
        for i in range(7):
            turn += c * both * w.d[j, i] * w.form[1, i] * w.scale[4, i]
            pull += c * 0.5 * (w.form[0, i] + w.form[1, i]) * w.scale[2, i] * w.d[i, j]
        for k in range(6):
            pull += 0.5 * weight * w.strain[2, k] * w.g[1, k, j]
        # the last form has no size of its own
        bend += (pull - 0.5 * c * w.stress[j] * w.scale[2, j] / w.scale[1, j]) * w.form[1, j] * w.scale[4, j]
        for side in range(2):
            for i in range(n):
                w.column[n * side + i] += ways[side] * turn * w.left[n * j + i]
                w.line[n * side + i] += ways[side] * pull * w.scale[1, j] * w.right[n * j + i]
    for side in range(2):
        w.force[n + side] += ways[side] * value
        for other in range(2):
            w.corner[side, other] += ways[side] * ways[other] * bend


@kernel
def add_strains(beam, e, g, state, work):
    """Add one point of the stored energy."""
    w = beam.scratch
    n = beam.node.shape[1]
    h0 = size_of(beam, e, state.q, state.v)
    h1 = size_of(beam, e, work.q_end, state.v)
    put_scales(w, h0, h1)
    put_forms(beam, e, g, state.q, 0, 0, w.left)
    put_forms(beam, e, g, work.q_end, 1, 1, w.right)
    put_forms(beam, e, g, work.q_mid, -1, 1, w.left)
    r0, c0 = strains_at(w, 0, beam.reference)
    r1, c1 = strains_at(w, 1, beam.reference)
    put_slopes(w, 0, 0.5 * (r0 + r1), 0.5 * (c0 + c1), 0, 1)
    put_slopes(w, 1, r1, c1, 1, 1)
    put_stresses(w, beam.stiffness)
    weight = beam.weight[g]
    c = weight * 0.5 * (h0 + h1)
    add_shape_stiffness(beam, g, c)
    df = beam.share[e, 1] - beam.share[e, 0]
    # the energy of the length itself, then C E at the end in place of the mean stress
    stored = 0.25 * weight * (energy_at(w, 0, beam.stiffness) + energy_at(w, 1, beam.stiffness))
    w.force[12 * n] -= df * stored
    w.force[12 * n + 1] += df * stored
    for i in range(6):
        x = 0.0
        for j in range(6):
            x += beam.stiffness[i, j] * w.strain[1, j]
        w.strain[2, i] = x
    add_along(w, c, weight, -df, df)
    for i in range(7):
        both = c * 0.5 * (w.scale[0, i] + w.scale[1, i])
        for j in range(12 * n):
            w.force[j] += both * w.stress[i] * w.left[12 * n * i + j]
        put_rows(beam, e, work.q_mid, w.left, 12 * n * i, w.rows, 6 * n * i)
        put_rows(beam, e, work.q_end, w.right, 12 * n * i, w.lines, 6 * n * i)
    for i in range(7):
        both = c * 0.5 * (w.scale[0, i] + w.scale[1, i])
        for b in range(6 * n):
            x = 0.0
            for j in range(7):
                x += w.d[i, j] * w.scale[1, j] * w.lines[6 * n * j + b]
            for a in range(6 * n):
                w.k[a, b] += both * x * w.rows[6 * n * i + a]


@kernel
def add_weight(beam, e, state, work):
    """Add the weight: its force on nodes is a share of the length."""
    w = beam.scratch
    n = beam.node.shape[1]
    h = 0.5 * (size_of(beam, e, state.q, state.v) + size_of(beam, e, work.q_end, state.v))
    df = beam.share[e, 1] - beam.share[e, 0]
    # the row of a place in the load vectors has the mean factor of gravity over the step
    force = work.f_ext[8 * beam.place_rows[0] + 1] * ld3(beam.weighs, 0, 1)
    for g in range(beam.mass_point.shape[1]):
        for a in range(n):
            m = beam.mass_point[1, g] * beam.mass_shape[0, g, a]
            height = m * dot(force, ld3(work.q_mid, 12 * beam.node[e, a], 1))
            add3(w.force, 12 * a, 1, (-m * h) * force)
            for side in range(2):
                way = df if side == 1 else -df
                w.force[12 * n + side] -= way * height
                add3(w.column, 12 * (n * side + a), 1, (-0.5 * m * way) * force)
                add3(w.line, 12 * (n * side + a), 1, (-0.5 * m * way) * force)


@kernel
def height_of(beam, q, v):
    """Return the work of the full weight on its way from the origin: sum of h m phi . rhoA g."""
    out = 0.0
    for e in range(beam.node.shape[0]):
        h = size_of(beam, e, q, v)
        for g in range(beam.mass_point.shape[1]):
            for a in range(beam.node.shape[1]):
                m = h * beam.mass_point[1, g] * beam.mass_shape[0, g, a]
                out += m * dot(ld3(beam.weighs, 0, 1), ld3(q, 12 * beam.node[e, a], 1))
    return out


@kernel
def add_iso(beam, e, work):
    """Add multiples of the identity between fields to the tangent of the unknowns."""
    w = beam.scratch
    n = beam.node.shape[1]
    for a in range(n):
        for b in range(n):
            for i in range(4):
                x = 12 * beam.node[e, a] + 3 * i
                for j in range(4):
                    s = w.iso[4 * a + i, 4 * b + j]
                    if s == 0.0:
                        continue
                    y = 12 * beam.node[e, b] + 3 * j
                    row = 6 * a + (3 if i > 0 else 0)
                    column = 6 * b + (3 if j > 0 else 0)
                    if i > 0 and j > 0:
                        put_spins(w.k, row, column, s, work.q_mid, x, work.q_end, y)
                    elif i > 0:
                        put_cross(w.k, row, column, s, work.q_mid, x)
                    elif j > 0:
                        put_cross(w.k, row, column, -s, work.q_end, y)
                    else:
                        for c in range(3):
                            w.k[row + c, column + c] += s


@kernel
def put_spins(k, row, column, s, q_mid, x, q_end, y):
    """Store s times the derivative of x cross (spin cross y) by the spin, of vectors at offsets x and y."""
    both = 0.0
    for c in range(3):
        both += q_mid[x + c] * q_end[y + c]
    for c in range(3):
        k[row + c, column + c] += s * both
        for d in range(3):
            k[row + c, column + d] -= s * q_end[y + c] * q_mid[x + d]


@kernel
def put_cross(k, row, column, s, q, x):
    """Store s times the matrix of the cross product with the vector at offset x."""
    for c in range(3):
        c1 = (c + 1) % 3
        c2 = (c + 2) % 3
        k[row + c, column + c1] -= s * q[x + c2]
        k[row + c, column + c2] += s * q[x + c1]


@kernel
def add_turn(beam, e, a, work, raw, first):
    """Add the change of the moment of forces on the directors of node a, in raw from `first` on, as the directors turn."""
    blocks = work.blocks
    o = 48 * beam.block[e, a, a] + 27
    for i in range(3, 12, 3):
        d = 12 * beam.node[e, a] + i
        s = 0.0
        for c in range(3):
            s += 0.5 * raw[first + i + c] * work.q_end[d + c]
        for c in range(3):
            blocks[o + 9 * c] -= s
            for k in range(3):
                blocks[o + 8 * c + k] += 0.5 * work.q_end[d + c] * raw[first + i + k]


@kernel
def scatter(beam, e, work):
    """Add element arrays to residual and tangent of the scene."""
    w = beam.scratch
    n = beam.node.shape[1]
    put_rows(beam, e, work.q_mid, w.force, 0, w.rows, 0)
    for a in range(n):
        for c in range(6):
            work.r[8 * beam.row[e, a] + c] += w.rows[6 * a + c]
        add_turn(beam, e, a, work, w.force, 12 * a)
        for b in range(n):
            o = 48 * beam.block[e, a, b]
            for c in range(6):
                for d in range(6):
                    work.blocks[o + 8 * c + d] += w.k[6 * a + c, 6 * b + d]
    for side in range(2):
        if beam.slot[e, side] < 0:
            continue
        work.r[8 * beam.row[e, n + side]] += w.force[12 * n + side]
        put_rows(beam, e, work.q_mid, w.column, 12 * n * side, w.rows, 0)
        put_rows(beam, e, work.q_end, w.line, 12 * n * side, w.rows, 6 * n)
        for a in range(n):
            for c in range(6):
                work.blocks[48 * beam.block[e, a, n + side] + 8 * c] += w.rows[6 * a + c]
                work.blocks[48 * beam.block[e, n + side, a] + c] += w.rows[6 * n + 6 * a + c]
        for other in range(2):
            if beam.slot[e, other] >= 0:
                work.blocks[48 * beam.block[e, n + side, n + other]] += w.corner[side, other]


@kernel
def stiffen_contacts(beam, work):
    """Make the tangent regular at nodes that multipliers join to points. A node of a straight beam that moves along it with its
    place changes no energy, and only the joint fixes both. A spring between node and point, as stiff as the beam there, acts to
    the end of the step, where the gap vanishes. It multiplies the gap, so the solution of the equations stays."""
    for j in range(beam.held.shape[0]):
        o = 48 * beam.held_block[j, 0]
        other = 48 * beam.held_block[j, 1]
        stiff = 0.0
        for c in range(3):
            stiff = max(stiff, abs(work.blocks[o + 9 * c]))
        for c in range(3):
            gap = work.q_end[12 * beam.held[j, 0] + c] - work.q_end[12 * beam.held[j, 1] + c]
            work.r[8 * beam.held_row[j] + c] += stiff * gap
            work.blocks[o + 9 * c] += stiff
            work.blocks[other + 9 * c] -= stiff


@assemble.register(MovingBeam, Conserving)
@kernel
def assemble_moving(beam, method, system, h):
    state, work = system.state, system.work
    w = beam.scratch
    for e in range(beam.node.shape[0]):
        clear_element(w)
        for i in range(w.k.shape[0]):
            for j in range(w.k.shape[1]):
                w.k[i, j] = 0.0
        for g in range(beam.mass_point.shape[1]):
            for k in range(4):
                if beam.rho[k] != 0.0:
                    add_inertia(beam, e, g, k, state, work, h)
        for g in range(beam.weight.shape[0]):
            add_strains(beam, e, g, state, work)
        add_weight(beam, e, state, work)
        add_iso(beam, e, work)
        scatter(beam, e, work)
    stiffen_contacts(beam, work)


@account.register(MovingBeam)
@kernel
def account_moving(beam, system, h):
    """Update momenta to the end of the step, twice their means less those at its start, and the work of the weight."""
    state, work = system.state, system.work
    first = beam.place[1]
    spread_nodes.call(system.dofs, system.method, state, work, h, first, first + beam.place[2])
    for j in range(beam.places.shape[0]):
        k = beam.places[j]
        spread_nodes.call(system.dofs, system.method, state, work, h, k, k + 1)
    for e in range(beam.node.shape[0]):
        for g in range(beam.mass_point.shape[1]):
            for k in range(4):
                if beam.rho[k] != 0.0:
                    at = density_place(beam, e, g, k)
                    m1 = 2.0 * mean_density(beam, e, g, k, state, work, h) - ld3(state.history, at, 1)
                    for c in range(3):
                        state.history[at + c] = 0.0
                    add3(state.history, at, 1, m1)
    way = height_of(beam, work.q_end, state.v) - height_of(beam, state.q, state.v)
    state.history[density_place(beam, beam.node.shape[0], 0, 0)] += work.f_ext[8 * beam.place_rows[0] + 1] * way


@within_limits.register(MovingBeam)
@kernel
def contacts_keep_distance(beam, system, counts_out):
    """Return whether contacts are at least `length[1]` from each other and from both ends of the beam."""
    q = system.state.q
    before = 0.0
    for j in range(beam.places.shape[0] + 1):
        s = beam.length[0]
        if j < beam.places.shape[0]:
            s = q[12 * beam.places[j]]
        if not s - before >= beam.length[1]:
            counts_out[3] = beam.place[3] + j
            return False
        before = s
    return True


@kernel
def motion_of(beam, q, history, p_out):
    """Return T, and add momenta of nodes to p_out [12 N]."""
    out = 0.0
    for e in range(beam.node.shape[0]):
        h = size_of(beam, e, q, q)
        for g in range(beam.mass_point.shape[1]):
            for k in range(4):
                c = beam.mass_point[1, g] * beam.rho[k]
                m = ld3(history, density_place(beam, e, g, k), 1)
                out += 0.5 * c * dot(m, m) / h
                for a in range(beam.node.shape[1]):
                    add3(p_out, 12 * beam.node[e, a] + 3 * k, 1, (c * beam.mass_shape[0, g, a]) * m)
    return out


@potential_energy.register(MovingBeam)
@kernel
def energy_of_moving(beam, q, dofs, out):
    """Add the stored energy without that of the weight, which is another column."""
    w = beam.scratch
    for e in range(beam.node.shape[0]):
        h = size_of(beam, e, q, q)
        for g in range(beam.weight.shape[0]):
            put_scales(w, h, h)
            put_forms(beam, e, g, q, 0, 0, w.left)
            strains_at(w, 0, beam.reference)
            out[0] += 0.5 * h * beam.weight[g] * energy_at(w, 0, beam.stiffness)


@kernel
def momentum_sums(q, p, out):
    """Add linear and angular momentum of nodes with momenta p [12 N] to out[1:4] and out[4:7], their sizes to out[7], out[8]."""
    for i in range(q.shape[0] // 12):
        for k in range(0, 12, 3):
            pk = ld3(p, 12 * i + k, 1)
            if k == 0:
                add3(out, 1, 1, pk)
                out[7] += dot(pk, pk)**0.5
            x = cross(ld3(q, 12 * i + k, 1), pk)
            add3(out, 4, 1, x)
            out[8] += dot(x, x)**0.5
