"""Energies and momenta of a state; run only when somebody asks for them.

Arrays: q, v, p, p_out [12 N]; s, gap_out [S]; tab [*] as `ElementTables.tab`; reference [*] as `Work.reference_strains`; e, work
[6]; of_elements [24 groups]; out [9]. Of m rows: q_rows, v_rows, p_rows, p_rows_out [m, 12 N]; motion_out [m, 9]; energy_out [m].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.dimensions import SPACE, put
from fastbeam.kernels.algebra.vectors import add3, cross, dot, ld3, zero3
from fastbeam.kernels.beams.strain_measures import strains_of_state
from fastbeam.kernels.contact.curves import find_element, point_on_curve
from fastbeam.kernels.contact.slider import motion_along
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.layout import CONSTANTS, LIST, NODE_TABLE, NODES, POINTS, REFERENCE, layout


@kernel
def element_momenta(tables, n_rows, v, p_out):
    """Add M v of all beam elements to p; v, p [12 N]."""
    meta = tables.meta
    tab = tables.tab
    for k in range(meta.shape[0]):
        at = layout(SPACE, meta[k, NODES], meta[k, POINTS])
        no = meta[k, LIST]
        for lane in range(8):
            if tables.rows[no + lane] == n_rows:
                continue
            o = meta[k, CONSTANTS] + lane
            rho = tab[o + at.inertia]; j2 = tab[o + at.inertia + 8]; j3 = tab[o + at.inertia + 16]
            for a in range(at.nn):
                pa = 12 * tables.nodes[no + 8 * a + lane]
                for b in range(at.nn):
                    vb = 12 * tables.nodes[no + 8 * b + lane]
                    m = tab[o + at.masses + 8 * (at.nn * a + b)] * rho
                    md = tab[o + at.director_masses + 8 * (at.nn * a + b)]
                    add3(p_out, pa, 1, m * ld3(v, vb, 1))
                    add3(p_out, pa + 6, 1, (md * j2) * ld3(v, vb + 6, 1))
                    add3(p_out, pa + 9, 1, (md * j3) * ld3(v, vb + 9, 1))


@kernel
def body_momenta(bodies, v, p_out):
    """Add M v of point masses and rigid bodies to p."""
    for k in range(bodies.node.shape[0]):
        o = 12 * bodies.node[k]
        for a in range(4):
            for b in range(4):
                add3(p_out, o + 3 * a, 1, bodies.inertia[16 * k + 4 * a + b] * ld3(v, o + 3 * b, 1))


@kernel
def motion(q, v, p, out):
    """Form kinetic energy, linear and angular momentum from p = M v in out[0], out[1:4], out[4:7]; theory.md (4.3). out[7],
    out[8]: sums of the sizes of the contributions to both momenta, the scale of their round-off."""
    for i in range(9):
        out[i] = 0.0
    for i in range(q.shape[0] // 12):
        for k in range(0, 12, 3):
            pk = ld3(p, 12 * i + k, 1)
            out[0] += 0.5 * dot(ld3(v, 12 * i + k, 1), pk)
            if k == 0:
                add3(out, 1, 1, pk)
                out[7] += dot(pk, pk)**0.5
            x = cross(ld3(q, 12 * i + k, 1), pk)
            add3(out, 4, 1, x)
            out[8] += dot(x, x)**0.5


@kernel
def shape_at_point(tables, no, lane, to, nn, q):
    """Return phi', the directors and their derivatives at a point of one element."""
    tab = tables.tab
    f = zero3(); d1 = zero3(); d2 = zero3(); d3 = zero3(); k1 = zero3(); k2 = zero3(); k3 = zero3()
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        o = 12 * tables.nodes[no + 8 * a + lane]
        f += tab[t] * ld3(q, o, 1)
        x = ld3(q, o + 3, 1); d1 += tab[t + 8] * x; k1 += tab[t + 16] * x
        x = ld3(q, o + 6, 1); d2 += tab[t + 8] * x; k2 += tab[t + 16] * x
        x = ld3(q, o + 9, 1); d3 += tab[t + 8] * x; k3 += tab[t + 16] * x
    return f, (d1, d2, d3), (k1, k2, k3)


@kernel
def energy_at_point(tab, co, reference, e0, e):
    """Return (E - E0) C (E - E0) and the axial force for strains e, from which E0 is subtracted in place."""
    for i in range(6):
        e[i] -= reference[e0 + 8 * i]
    energy = 0.0
    force = 0.0
    for i in range(6):
        stress = 0.0
        for j in range(6):
            stress += tab[co + 48 * i + 8 * j] * e[j]
        energy += e[i] * stress
        if i == 0:
            force = stress
    return energy, force


@kernel
def strain_energy(tables, reference, n_rows, q, strains, work, of_elements):
    """Return 1/2 int (E - E0) C (E - E0) ds of all elements; work: 6 numbers. of_elements: empty, or [groups, 8, 3] flat, for the
    mean axial force of every element, the smallest square of the length of its directors, and the smallest phi'.d1; see
    `resolution`."""
    meta = tables.meta
    tab = tables.tab
    total = 0.0
    for k in range(meta.shape[0]):
        at = layout(SPACE, meta[k, NODES], meta[k, POINTS])
        no = meta[k, LIST]
        for lane in range(8):
            if tables.rows[no + lane] == n_rows:
                continue
            force = 0.0
            length = 0.0
            shortest = 1.0
            along = 1.0
            co = meta[k, CONSTANTS] + lane
            for g in range(at.nq):
                to = co + at.point + at.point_size * g
                f, d, curvature = shape_at_point(tables, no, lane, to, at.nn, q)
                shortest = min(shortest, 0.5 * (dot(d[0], d[0]) + dot(d[1], d[1]) + dot(d[2], d[2]) - 1.0))
                along = min(along, dot(f, d[0]))
                strains_of_state.call(strains, f, d, curvature, work)
                energy, axial = energy_at_point(tab, co, reference, meta[k, REFERENCE] + 48 * g + lane, work)
                force += tab[to] * axial
                length += tab[to]
                total += 0.5 * tab[to] * energy
            if of_elements.shape[0] > 0:
                o = 24 * k + 3 * lane
                of_elements[o] = force / length
                of_elements[o + 1] = shortest
                of_elements[o + 2] = along
    return total


@kernel
def slider_points(curves, sliders, contact, q, s, gap_out):
    """Form the distance of every sliding point from its curve at s."""
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        e = find_element.call(curves, c, s[k], contact.element[k])
        gap = ld3(q, 12 * sliders.point[k], 1) - point_on_curve(curves, c, s[k], q, e, contact, 0, SPACE)
        gap_out[k] = dot(gap, gap)**0.5


@kernel
def slider_motion(curves, sliders, contact, q, v, s, tangent_out, rate_out):
    """Form the derivative by s of the curve under every slider, tangent_out [3 S], and ds/dt, rate_out [S] (theory.md 5.4)."""
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        e = find_element.call(curves, c, s[k], contact.element[k])
        tangent, relative = motion_along(curves, sliders, contact, q, v, s[k], k, e, SPACE)
        put(tangent_out, 3 * k, 1, tangent)
        rate_out[k] = dot(relative, tangent) / dot(tangent, tangent)


# --- of many states -----------------------------------------------------------------------------------------------------
@kernel
def element_momenta_of_rows(tables, n_rows, v_rows, p_rows_out):
    for r in range(v_rows.shape[0]):
        element_momenta(tables, n_rows, v_rows[r], p_rows_out[r])


@kernel
def body_momenta_of_rows(bodies, v_rows, p_rows_out):
    for r in range(v_rows.shape[0]):
        body_momenta(bodies, v_rows[r], p_rows_out[r])


@kernel
def motion_of_rows(q_rows, v_rows, p_rows, motion_out):
    for r in range(q_rows.shape[0]):
        motion(q_rows[r], v_rows[r], p_rows[r], motion_out[r])


@kernel
def strain_energy_of_rows(tables, reference, n_rows, q_rows, strains, work, of_elements, energy_out):
    """Add the strain energy of rows to energy_out."""
    for r in range(q_rows.shape[0]):
        energy_out[r] += strain_energy(tables, reference, n_rows, q_rows[r], strains, work, of_elements)
