"""Sliders of the methods that the conserving step is compared with, theory.md (7.1): without a frame."""
from __future__ import annotations

from fastbeam.kernels.algebra.dimensions import add_to, position, vector, zero_vector
from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.contact.curves import add_basis, find_element, node_of, nodes_of, nodes_under, slot
from fastbeam.kernels.contact.slider import Sliding, put_residual
from fastbeam.kernels.entries.dense import Weights, put_corner, put_translation
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Midpoint, assemble


@kernel
def add_collocated_slider(term, system, k, share):
    """Add a slider of the compared methods, theory.md (7.1): force and sliding direction at one instant, the gap at the end of
    the step. With share = 1 the instant is the middle of the step; with share = 1/2, the share of the tangent that the node
    matrix then holds, it is the end, and q_mid = q_end. The border is that of the conserving step without the frame."""
    curves, state, work, contact, dofs = term.curves, system.state, system.work, system.contact, system.dofs
    near = 0.5 / share    # derivative of s and q at that instant by those at the end of the step
    c = term.sliders.curve[k]
    nodes = nodes_of.call(curves, c)
    e0 = find_element.call(curves, c, state.s[k], contact.element[k])
    e1 = find_element.call(curves, c, work.s_end[k], e0)
    si = state.s[k] + near * (work.s_end[k] - state.s[k])
    ei = find_element.call(curves, c, si, e0)
    lo, hi = nodes_under.call(curves, c, ei, e1)
    basis = contact.basis
    for j in range(5):
        for a in range(lo, hi):
            basis[j, slot.call(nodes, a)] = 0.0
    add_basis.call(curves, c, ei, si, 0, 1.0, 1.0, contact.legendre, basis, 0)
    add_basis.call(curves, c, ei, si, 1, 0.0, 1.0, contact.legendre, basis, 1)
    add_basis.call(curves, c, e1, work.s_end[k], 0, 1.0, 1.0, contact.legendre, basis, 3)
    f = vector(state.force, contact.first_force[k], 1, dofs)
    contact.entries[k] = 0
    end = zero_vector(dofs); end_s = zero_vector(dofs); tangent = zero_vector(dofs); bend = zero_vector(dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        x = position(work.q_end, node, dofs)
        end += basis[3, i] * x; end_s += basis[4, i] * x
        x = position(work.q_mid, node, dofs)
        tangent += basis[1, i] * x; bend += basis[2, i] * x
        add_to(work.r, 8 * system.row_of[node], 1, basis[0, i] * f)
        weights = Weights(share * basis[0, i], basis[3, i], 0.5 * basis[1, i], near * basis[1, i])
        put_translation.call(term.ties, contact, k, node, system.row_of[node], work, weights, f, f, dofs)
    point = term.sliders.point[k]
    add_to(work.r, 8 * system.row_of[point], 1, -1.0 * f)
    put_translation.call(term.ties, contact, k, point, system.row_of[point], work, Weights(-share, -1.0, 0.0, 0.0), f,
                         zero_vector(dofs), dofs)
    put_corner.call(contact, k, end_s, zero_vector(dofs), tangent, near * dot(f, bend), dofs)
    put_residual(contact, k, position(work.q_end, point, dofs) - end, dot(f, tangent), dofs)


@assemble.register(Sliding, Midpoint)
@kernel
def assemble_sliding_midpoint(term, method, system, h):
    for k in range(term.sliders.curve.shape[0]):
        add_collocated_slider(term, system, k, 1.0)


@assemble.register(Sliding, Alpha)
@kernel
def assemble_sliding_at_end(term, method, system, h):
    for k in range(term.sliders.curve.shape[0]):
        add_collocated_slider(term, system, k, 0.5)
