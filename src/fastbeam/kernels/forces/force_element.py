"""Forces and moments between two triads by functions of the user's own, theory.md (4.33).

The law is given means over the step of the products u_i = r . D_i and c_ij = D_i . E_j of forces/bushing.py, their differences
over the step as velocity and spin, and gives force and moment in the axes D_i, whose means turn them into space. The force acts
at the point of b on both sides, so that momenta stay; what it takes from the energy is accounted. In statics it acts in full at
every load factor, as springs and bushings do.

Arrays: q0, q1 [12 N]; turn [21 + 6], coordinates of a node before, of its triad first.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_to, position, zero_vector
from fastbeam.kernels.algebra.vectors import call_law, cross, dot
from fastbeam.kernels.forces.user_force import (
    FAILED,
    FOUND,
    GIVEN,
    INCREMENT,
    KEPT,
    ORIGIN,
    OTHER,
    RATES,
    SLOPES,
    TIME,
    WRENCH,
    Laws,
    find_slopes,
    known,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.joints.conditions import direction
from fastbeam.kernels.terms import account, assemble, spread_nodes


class ForceElements(NamedTuple):
    """L force elements between nodes a and b."""

    node: np.ndarray       # int64 [L, 2]
    row: np.ndarray        # int64 [L, 2]
    block: np.ndarray      # int64 [L, 4]: a-a, a-b, b-a, b-b
    place: np.ndarray      # int64 [L]: offset of its work in the history
    axes: np.ndarray       # float64 [18 L]: as of `JointConditions`
    first: np.ndarray      # int64 [L]: first of its parameters
    parameters: np.ndarray  # float64 [*]
    laws: Laws
    work: np.ndarray       # float64 [SIZE]: of one run, as of user forces


@kernel
def give_both(term, k, q0, q1, h, dofs):
    """Store position and rotation of b in the axes of a and their rates in the work array."""
    w = term.work
    over = 1.0 / h if h != 0.0 else 0.0
    a, b = term.node[k, 0], term.node[k, 1]
    r0, r1 = position(q0, b, dofs) - position(q0, a, dofs), position(q1, b, dofs) - position(q1, a, dofs)
    for i in range(3):
        before, after = direction.call(dofs, term, k, 0, i, q0), direction.call(dofs, term, k, 0, i, q1)
        w[GIVEN + i] = 0.5 * (dot(r0, before) + dot(r1, after))
        w[GIVEN + 12 + i] = over * (dot(r1, after) - dot(r0, before))
        for j in range(3):
            c0 = dot(before, direction.call(dofs, term, k, 1, j, q0))
            c1 = dot(after, direction.call(dofs, term, k, 1, j, q1))
            w[GIVEN + 3 + 3 * i + j] = 0.5 * (c0 + c1)
            w[RATES + 3 * i + j] = over * (c1 - c0)
    for i in range(3):
        j, l = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3)
        w[GIVEN + 15 + i] = 0.0
        for m in range(3):
            w[GIVEN + 15 + i] += 0.5 * (w[RATES + l + m] * w[GIVEN + 3 + j + m] - w[RATES + j + m] * w[GIVEN + 3 + l + m])


@kernel
def evaluate_both(term, k, q0, q1, h, dofs, is_linear):
    """Evaluate force and moment on a, then on b, in space, in the work array; by the law, or by its linear form about the
    origin."""
    w = term.work
    give_both(term, k, q0, q1, h, dofs)
    for i in range(12):
        w[WRENCH + i] = 0.0
    if is_linear:
        for i in range(6):
            w[FOUND + i] = w[ORIGIN + 18 + i]
            for j in range(18):
                w[FOUND + i] += w[SLOPES + 18 * i + j] * (w[GIVEN + j] - w[ORIGIN + j])
    else:
        for i in range(6):
            w[FOUND + i] = 0.0
        base = w.ctypes.data
        call_law(term.laws.address[k], w[TIME], base + 8 * GIVEN, term.parameters.ctypes.data + 8 * term.first[k],
                 base + 8 * FOUND, base + 8 * FAILED)
    force, moment = zero_vector(dofs), zero_vector(dofs)
    for i in range(3):
        axis = 0.5 * (direction.call(dofs, term, k, 0, i, q0) + direction.call(dofs, term, k, 0, i, q1))
        force += w[FOUND + i] * axis
        moment += w[FOUND + 3 + i] * axis
    a, b = term.node[k, 0], term.node[k, 1]
    arm = 0.5 * ((position(q0, b, dofs) - position(q0, a, dofs)) + (position(q1, b, dofs) - position(q1, a, dofs)))
    add_to(w, WRENCH, 1, -1.0 * force)
    add_to(w, WRENCH + 3, 1, -1.0 * (moment + cross(arm, force)))
    add_to(w, WRENCH + 6, 1, force)
    add_to(w, WRENCH + 9, 1, moment)


@kernel
def displace(q1, o, c, size, turn):
    """Add an increment to unknown c of the node whose coordinates start at o; turn: coordinates before [9]."""
    if c < 3:
        q1[o + c] += size
    else:
        for a in range(3):
            i = o + 3 + 3 * a
            for j in range(3):
                up = turn[3 * a + (j + 2) % 3] if (c - 3) == (j + 1) % 3 else 0.0
                down = turn[3 * a + (j + 1) % 3] if (c - 3) == (j + 2) % 3 else 0.0
                q1[i + j] = turn[3 * a + j] + size * (up - down)


@kernel
def add_differences(term, k, side, system, h):
    """Add the derivative by the end of the step of one node, by central differences; of the law in its linear form where its
    derivative is given."""
    work, w = system.work, term.work
    is_linear = term.laws.slopes[k] != 0
    q0, q1, o, turn = system.state.q, work.q_end, 12 * term.node[k, side], term.work[KEPT:]
    for j in range(12):
        turn[9 + j] = q1[o + j]
    for j in range(9):
        turn[j] = q1[o + 3 + j]
    for c in range(6):
        size = INCREMENT * (system.length if c < 3 else 1.0)
        displace(q1, o, c, size, turn)
        evaluate_both(term, k, q0, q1, h, system.dofs, is_linear)
        for i in range(12):
            w[OTHER + i] = w[WRENCH + i]
        for j in range(12):
            q1[o + j] = turn[9 + j]
        displace(q1, o, c, -size, turn)
        evaluate_both(term, k, q0, q1, h, system.dofs, is_linear)
        for j in range(12):
            q1[o + j] = turn[9 + j]
        for i in range(12):
            change = (w[OTHER + i] - w[WRENCH + i]) / (2.0 * size)
            work.blocks[48 * term.block[k, 2 * (i // 6) + side] + 8 * (i % 6) + c] -= change


@assemble.register(ForceElements)
@kernel
def assemble_force_elements(term, method, system, h):
    work, w = system.work, term.work
    for k in range(term.place.shape[0]):
        evaluate_both(term, k, system.state.q, work.q_end, h, system.dofs, False)
        for i in range(12):
            work.r[8 * term.row[k, i // 6] + i % 6] -= w[WRENCH + i]
        if term.laws.slopes[k] != 0:
            find_slopes(term, k)
            # arguments and results stand side by side
            for i in range(24):
                w[ORIGIN + i] = w[GIVEN + i]
        for side in range(2):
            add_differences(term, k, side, system, h)


@account.register(ForceElements)
@kernel
def account_force_elements(term, system, h):
    """Record the work: minus F . Dphi + M . theta of both nodes."""
    state, work, w = system.state, system.work, term.work
    for k in range(term.place.shape[0]):
        for side in range(2):
            # update the nodes to the last increment
            n = term.node[k, side]
            spread_nodes.call(system.dofs, system.method, state, work, h, n, n + 1)
        evaluate_both(term, k, state.q, work.q_end, h, system.dofs, False)
        total = 0.0
        for side in range(2):
            n = term.node[k, side]
            for i in range(3):
                total += w[WRENCH + 6 * side + i] * work.dphi[3 * n + i] + w[WRENCH + 6 * side + 3 + i] * work.theta[3 * n + i]
        state.history[term.place[k]] -= known(total)
