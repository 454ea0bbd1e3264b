"""Discrete adjoint of conserving steps, backward through a run (theory.md (13.9) to (13.11)).

The tangent of a step is that of its Newton iteration, assembled again at its end, factored, and solved transposed. Derivatives by
the start of a step come from the tangent of the same step backward in time, from its end by -h.

Arrays: q, rates, rates_out, y [12 N], in a plane [4 N]; row_of [N]; x, shape_out, rows_out, y_out [8 (rows + 1)]; rows, columns
[blocks]; blocks [8 n (blocks + 1)]; pivots [n rows].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.adjoint.adjoint_border import (
    add_transposed,
    begin_border,
    drop_held,
    end_border,
    equations_product,
    put_slides,
    solve_step,
)
from fastbeam.kernels.adjoint.adjoint_sliders import add_slides, add_start, add_turning, put_branch, put_start
from fastbeam.kernels.adjoint.section_gradients import add_sections
from fastbeam.kernels.algebra.dimensions import Plane, Space, coordinates, dim
from fastbeam.kernels.algebra.vectors import add2, add3, cross, cross2, ld2, ld3, perp, st2, st3
from fastbeam.kernels.beams.planar_nodes import PlanarTies, turned
from fastbeam.kernels.beams.ties import Ties, tie_coordinates
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.jit.records import in_memory
from fastbeam.kernels.layout import ARM, POSITION
from fastbeam.kernels.loop import assemble_step, put_loads
from fastbeam.kernels.state import copy
from fastbeam.kernels.terms import LoadVectors, NoTies


class Steps(NamedTuple):
    """n steps of a run that follow each other; a node has C coordinates, d of them of its position, and n_spin of a spin."""

    q: np.ndarray        # float64 [n + 1, C N]
    v: np.ndarray        # float64 [n + 1, C N]
    dphi: np.ndarray     # float64 [n, d N]
    theta: np.ndarray    # float64 [n, n_spin N]
    s: np.ndarray        # float64 [n + 1, S]
    force: np.ndarray    # float64 [n, F]: of all constraints
    gravity: np.ndarray  # float64 [n, d]: mean gravity over every step, m/s^2
    sign: np.ndarray     # int64 [n, S]: slip direction of Coulomb friction, 0 where a slider sticks; S = 0 without slider forces
    rest: np.ndarray     # float64 [n, S]: prescribed increment of s there, m
    values: np.ndarray   # float64 [n + 1, C]: coordinates of joints, counted over turns


class Wanted(NamedTuple):
    """Differentiated number: the weighted sum of coordinates of points and their rates, M entries, each a node of a point."""

    node: np.ndarray     # int64 [M]
    share: np.ndarray    # float64 [M, C/d]: share of a node's vectors in the point
    series: np.ndarray   # int64 [M]: which weights
    is_rate: np.ndarray  # int64 [M]: 1 for velocities
    weight: np.ndarray   # float64 [P, n + 1, d]: of all rows of the run


class Found(NamedTuple):
    """Sums of a backward pass: derivatives by everything but sections."""

    force: np.ndarray    # float64 [d N]: by forces on all nodes
    turn: np.ndarray     # float64 [8 (rows + 1)]: solutions of all nodes by rows, whose spins belong to moments
    load: np.ndarray     # float64 [n, K]: by the factors of load vectors in every step
    weight: np.ndarray   # float64 [n, d]: by gravity in every step
    place: np.ndarray    # float64 [n, P, d]: by forces on observed points in every step
    place_node: np.ndarray   # int64 [M]: nodes of these points
    place_share: np.ndarray  # float64 [M, C/d]
    place_of: np.ndarray     # int64 [M]: which point
    body_node: np.ndarray    # int64 [B]
    body: np.ndarray     # float64 [B]: by their masses
    sliders: Any         # adjoint_sliders.Sliders


class Adjoint(NamedTuple):
    """Adjoint variables, and the constants that their recursion needs."""

    ties: Any                 # ties.Ties, planar_nodes.PlanarTies or NoTies
    border: Any               # adjoint_border.Border or NoBorder
    mass_start: np.ndarray    # int64 [V + 1]: masses of the V vectors of all nodes (position, directors), by rows
    mass_column: np.ndarray   # int64 [*]
    mass: np.ndarray          # float64 [*]
    heavy: np.ndarray         # float64 [N]: mass of a node on which gravity acts
    spin_row: np.ndarray      # int64 [N]: row whose spin a node has
    loads: LoadVectors
    block_row: np.ndarray     # int64 [blocks]
    block_column: np.ndarray  # int64 [blocks]
    kept: np.ndarray          # float64 [8 n (blocks + 1)]: the tangent before its factors
    shapes: np.ndarray        # float64 [8 (rows + 1)]: adjoint of shapes
    rate: np.ndarray          # float64 [C N]: adjoint of velocities
    x: np.ndarray             # float64 [8 (rows + 1)]: solution of a step
    right: np.ndarray         # float64 [8 (rows + 1)]: its right-hand side
    rest: np.ndarray          # float64 [8 (rows + 1)]
    both: np.ndarray          # float64 [8 (rows + 1)]
    middle: np.ndarray        # float64 [C N]
    rates: np.ndarray         # float64 [C N]: adjoint rates of all coordinates in the middle of a step
    inertia: np.ndarray       # float64 [C N]
    forces: np.ndarray        # float64 [C N]


Steps.stays_in_memory = Wanted.stays_in_memory = True  # type: ignore[attr-defined]
Found.stays_in_memory = Adjoint.stays_in_memory = True  # type: ignore[attr-defined]


# --- unknowns of the rows, rates of all coordinates, and the transpose ----------------------------------------------------
@generic
def lift(dofs, row_of, q, x, rates_out):
    """Map unknowns of the rows to rates of the coordinates of all nodes at q, those of tied nodes as if they were free."""


@generic
def lower(dofs, row_of, q, y, rows_out):
    """Add forces on coordinates to those on the unknowns of the rows: the transpose of `lift`."""


@generic
def follow_ties(ties, rates_out):
    """Set rates of tied nodes from those of their masters."""


@generic
def pull_ties(ties, y):
    """Move forces on tied nodes to their masters: the transpose of `follow_ties`."""


@lift.register(Space)
@kernel
def lift_in_space(dofs, row_of, q, x, rates_out):
    for i in range(row_of.shape[0]):
        o = 8 * row_of[i]
        st3(rates_out, 12 * i, 1, ld3(x, o, 1))
        w = ld3(x, o + 3, 1)
        for k in range(12 * i + 3, 12 * i + 12, 3):
            st3(rates_out, k, 1, cross(w, ld3(q, k, 1)))


@lift.register(Plane)
@kernel
def lift_in_plane(dofs, row_of, q, x, rates_out):
    for i in range(row_of.shape[0]):
        o = 8 * row_of[i]
        st2(rates_out, 4 * i, 1, ld2(x, o, 1))
        st2(rates_out, 4 * i + 2, 1, x[o + 2] * perp(ld2(q, 4 * i + 2, 1)))


@lower.register(Space)
@kernel
def lower_in_space(dofs, row_of, q, y, rows_out):
    for i in range(row_of.shape[0]):
        o = 8 * row_of[i]
        add3(rows_out, o, 1, ld3(y, 12 * i, 1))
        m = cross(ld3(q, 12 * i + 3, 1), ld3(y, 12 * i + 3, 1))
        for k in range(12 * i + 6, 12 * i + 12, 3):
            m += cross(ld3(q, k, 1), ld3(y, k, 1))
        add3(rows_out, o + 3, 1, m)


@lower.register(Plane)
@kernel
def lower_in_plane(dofs, row_of, q, y, rows_out):
    for i in range(row_of.shape[0]):
        o = 8 * row_of[i]
        add2(rows_out, o, 1, ld2(y, 4 * i, 1))
        rows_out[o + 2] += cross2(ld2(q, 4 * i + 2, 1), ld2(y, 4 * i + 2, 1))


@follow_ties.register(NoTies)
@pull_ties.register(NoTies)
@kernel
def pass_no_ties(ties, y):
    pass


@follow_ties.register(Ties)
@kernel
def follow_in_space(ties, rates_out):
    tie_coordinates(ties, rates_out)


@follow_ties.register(PlanarTies)
@kernel
def follow_in_plane(ties, rates_out):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        x = 0.0 * ld2(rates_out, 4 * i, 1)
        for e in range(ties.start[i], ties.start[i + 1]):
            t = 4 * ties.target[e]
            if ties.kind[e] == POSITION:
                x += ld2(rates_out, t, 1)
            elif ties.kind[e] == ARM:
                x += turned(ties, e, ld2(rates_out, t + 2, 1))
            elif ties.target[e] != i:
                st2(rates_out, 4 * i + 2, 1, turned(ties, e, ld2(rates_out, t + 2, 1)))
        st2(rates_out, 4 * i, 1, x)


@pull_ties.register(Ties)
@kernel
def pull_in_space(ties, y):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        f = ld3(y, 12 * i, 1)
        st3(y, 12 * i, 1, 0.0 * f)
        for e in range(ties.start[i], ties.start[i + 1]):
            t = 12 * ties.target[e]
            if ties.kind[e] == POSITION:
                add3(y, t, 1, f)
            elif ties.kind[e] == ARM:
                for b in range(3):
                    add3(y, t + 3 + 3 * b, 1, ties.offset[3 * e + b] * f)
            elif ties.target[e] != i:
                for a in range(3):
                    m = ld3(y, 12 * i + 3 + 3 * a, 1)
                    st3(y, 12 * i + 3 + 3 * a, 1, 0.0 * m)
                    for b in range(3):
                        add3(y, t + 3 + 3 * b, 1, ties.rotation[9 * e + 3 * a + b] * m)


@pull_ties.register(PlanarTies)
@kernel
def pull_in_plane(ties, y):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        f = ld2(y, 4 * i, 1)
        st2(y, 4 * i, 1, 0.0 * f)
        for e in range(ties.start[i], ties.start[i + 1]):
            t = 4 * ties.target[e]
            a = ties.factor[2 * e]
            b = ties.factor[2 * e + 1]
            if ties.kind[e] == POSITION:
                add2(y, t, 1, f)
            elif ties.kind[e] == ARM:
                add2(y, t + 2, 1, a * f - b * perp(f))
            elif ties.target[e] != i:
                m = ld2(y, 4 * i + 2, 1)
                st2(y, 4 * i + 2, 1, 0.0 * m)
                add2(y, t + 2, 1, a * m - b * perp(m))


@kernel
def multiply_mass(adjoint, d, rates, y_out):
    """Multiply the mass matrix by rates of all coordinates, d of a vector."""
    for i in range(adjoint.mass_start.shape[0] - 1):
        for c in range(d):
            y_out[d * i + c] = 0.0
        for e in range(adjoint.mass_start[i], adjoint.mass_start[i + 1]):
            m = adjoint.mass[e]
            o = d * adjoint.mass_column[e]
            for c in range(d):
                y_out[d * i + c] += m * rates[o + c]


@kernel
def add_weights(wanted, k, rate, factor, d, y_out):
    """Add factor times the derivatives of the number by coordinates (rate 0) or velocities (1) of row k."""
    for m in range(wanted.node.shape[0]):
        if wanted.is_rate[m] == rate:
            for a in range(wanted.share.shape[1]):
                o = d * (wanted.share.shape[1] * wanted.node[m] + a)
                for c in range(d):
                    y_out[o + c] += factor * wanted.share[m, a] * wanted.weight[wanted.series[m], k, c]


# --- one step backward ----------------------------------------------------------------------------------------------------
@kernel
def put_step(system, border, steps, k, back):
    """Store step k of a run in the work arrays; back: the same step from its end by -h."""
    state, work = system.state, system.work
    sign = -1.0 if back else 1.0
    at = k + 1 if back else k
    for i in range(state.q.shape[0]):
        state.q[i] = steps.q[at, i]
        state.v[i] = steps.v[at, i]
    for i in range(steps.dphi.shape[1]):
        work.dphi[i] = sign * steps.dphi[k, i]
    for i in range(steps.theta.shape[1]):
        work.theta[i] = sign * steps.theta[k, i]
    put_slides.call(border, system, steps, k, at, 2 * k + 1 - at)
    work.increment.control[0] = 0.0


@kernel
def begin_back(terms, system, adjoint, steps, h, k):
    """Assemble the tangent of step k, and the right-hand side of (13.9)."""
    dofs = system.dofs
    put_step(system, adjoint.border, steps, k, False)
    put_branch.each(terms, system, steps, h, k, False)
    put_loads.each(terms, system, k)
    assemble_step(terms, system, h)
    y = adjoint.forces
    for i in range(y.shape[0]):
        y[i] = (2.0 / h) * adjoint.rate[i]
        adjoint.middle[i] = steps.q[k + 1, i]
    pull_ties.call(adjoint.ties, y)
    copy(adjoint.shapes, adjoint.right)
    lower.call(dofs, system.row_of, adjoint.middle, y, adjoint.right)
    drop_held.each(terms, dofs, adjoint.right)
    begin_border.call(adjoint.border, system)
    for i in range(adjoint.right.shape[0] - 8, adjoint.right.shape[0]):
        adjoint.right[i] = 0.0


@kernel
def collect(sums, system, adjoint, steps, found, h, k):
    """Add the contribution of step k to all derivatives, with its adjoint rates. Rows of tied nodes follow from those of their
    masters."""
    d = dim(system.dofs)
    vectors = coordinates(system.dofs) // d
    rates, every = adjoint.rates, adjoint.rest
    add_sections.each(sums, system, rates, steps.gravity, k, h)
    for i in range(adjoint.heavy.shape[0]):
        for c in range(d):
            w = rates[d * vectors * i + c]
            found.force[d * i + c] += w
            found.weight[k, c] += adjoint.heavy[i] * w
            every[8 * system.row_of[i] + c] = w
        for c in range(d, len(system.dofs)):
            every[8 * system.row_of[i] + c] = adjoint.x[8 * adjoint.spin_row[i] + c]
    for i in range(found.turn.shape[0]):
        found.turn[i] += every[i]
    first, vector, row, value = adjoint.loads.first, adjoint.loads.vector, adjoint.loads.row, adjoint.loads.value
    for i in range(first.shape[0]):
        found.load[k, 0] += first[i] * every[i]
    for e in range(row.shape[0]):
        for c in range(8):
            found.load[k, vector[e]] += value[8 * e + c] * every[8 * row[e] + c]
    for m in range(found.place_node.shape[0]):
        for a in range(vectors):
            for c in range(d):
                found.place[k, found.place_of[m], c] += found.place_share[m, a] * rates[
                    d * (vectors * found.place_node[m] + a) + c]
    for b in range(found.body.shape[0]):
        o = d * vectors * found.body_node[b]
        for c in range(d):
            second = (steps.v[k + 1, o + c] - steps.v[k, o + c]) / h
            found.body[b] -= rates[o + c] * (second - steps.gravity[k, c])


@kernel
def end_back(terms, system, sums, adjoint, steps, wanted, found, h, k, row):
    """Add the contribution of step k after its solution, and form the adjoint of its start, which is row `row` of the run."""
    dofs = system.dofs
    d = dim(dofs)
    for i in range(adjoint.middle.shape[0]):
        adjoint.middle[i] = 0.5 * (steps.q[k, i] + steps.q[k + 1, i])
    lift.call(dofs, system.row_of, adjoint.middle, adjoint.x, adjoint.rates)
    follow_ties.call(adjoint.ties, adjoint.rates)
    multiply_mass(adjoint, d, adjoint.rates, adjoint.inertia)
    collect(sums, system, adjoint, steps, found, h, k)
    add_slides.each(terms, adjoint.border, system, found.sliders, h, k)
    put_step(system, adjoint.border, steps, k, True)
    put_branch.each(terms, system, steps, -h, k, True)
    assemble_step(terms, system, -h)
    put_start.each(terms, system, steps, h, k)
    shape, y = adjoint.shapes, adjoint.forces
    for i in range(shape.shape[0]):
        shape[i] = 0.0
    add_transposed(adjoint.block_row, adjoint.block_column, system.work.blocks, -1.0, adjoint.x, shape, dofs)
    end_border.call(adjoint.border, system, adjoint.x, shape)
    add_turning.each(terms, system, adjoint.x, shape)
    for i in range(y.shape[0]):
        y[i] = 4.0 / (h * h) * adjoint.inertia[i] - (2.0 / h) * adjoint.rate[i]
        adjoint.rate[i] = 2.0 / h * adjoint.inertia[i] - adjoint.rate[i]
        adjoint.middle[i] = steps.q[k, i]
    add_weights(wanted, row, 0, 1.0, d, y)
    add_weights(wanted, row, 1, 1.0, d, adjoint.rate)
    add_start.each(terms, adjoint.border, system, adjoint, steps, h, k)
    pull_ties.call(adjoint.ties, y)
    lower.call(dofs, system.row_of, adjoint.middle, y, shape)
    drop_held.each(terms, dofs, shape)


@kernel
def begin_last(terms, system, adjoint, wanted, q, row):
    """Form the adjoint of the last row, of coordinates q."""
    d = dim(system.dofs)
    for i in range(adjoint.rate.shape[0]):
        adjoint.rate[i] = 0.0
        adjoint.forces[i] = 0.0
    for i in range(adjoint.shapes.shape[0]):
        adjoint.shapes[i] = 0.0
    add_weights(wanted, row, 0, 1.0, d, adjoint.forces)
    add_weights(wanted, row, 1, 1.0, d, adjoint.rate)
    pull_ties.call(adjoint.ties, adjoint.forces)
    lower.call(system.dofs, system.row_of, q, adjoint.forces, adjoint.shapes)
    drop_held.each(terms, system.dofs, adjoint.shapes)


@kernel
def half_step_back(all_terms, whole_system, sums, whole_adjoint, all_steps, wanted, found, h, k, row, is_solved):
    """Run `begin_back` before, or `end_back` after, the solution of step k by a solver outside."""
    terms, system = in_memory(all_terms), in_memory(whole_system)
    adjoint, steps = in_memory(whole_adjoint), in_memory(all_steps)
    if is_solved:
        end_back(terms, system, sums, adjoint, steps, in_memory(wanted), in_memory(found), h, k, row + k)
    else:
        begin_back(terms, system, adjoint, steps, h, k)


@kernel
def turn_rows(all_terms, whole_system, x, rows_out):
    """Call `add_turning` of all terms, for a solver outside."""
    add_turning.each(in_memory(all_terms), in_memory(whole_system), x, rows_out)


@kernel
def sum_unbalanced(all_terms, whole_system, whole_adjoint, all_steps, h, x, y, out):
    """Sum the residuals of steps of another scene, times the adjoint solutions x [n, 8 (rows + 1)] of their rows and y [n, m] of
    their constraints, into out [n]."""
    terms, system = in_memory(all_terms), in_memory(whole_system)
    adjoint, steps = in_memory(whole_adjoint), in_memory(all_steps)
    for k in range(out.shape[0]):
        put_step(system, adjoint.border, steps, k, False)
        put_branch.each(terms, system, steps, h, k, False)
        put_loads.each(terms, system, k)
        assemble_step(terms, system, h)
        s = equations_product.call(adjoint.border, system, y[k])
        for i in range(x.shape[1] - 8):
            s += x[k, i] * system.work.r[i]
        out[k] = s


@kernel
def begin_at_end(all_terms, whole_system, adjoint, wanted, q, row):
    begin_last(in_memory(all_terms), in_memory(whole_system), in_memory(adjoint), in_memory(wanted), q, row)


@kernel
def go_back(all_terms, whole_system, plan, sums, whole_adjoint, all_steps, all_wanted, all_found, h, last, first, row):
    """Run steps last - 1 to `first` backward by block elimination; `row`: row of the run at which these steps begin. Return
    `first`, or one more than the step whose equations were not solved."""
    terms, system = in_memory(all_terms), in_memory(whole_system)
    adjoint, steps = in_memory(whole_adjoint), in_memory(all_steps)
    wanted, found = in_memory(all_wanted), in_memory(all_found)
    for k in range(last - 1, first - 1, -1):
        begin_back(terms, system, adjoint, steps, h, k)
        if not solve_step.call(adjoint.border, plan, terms, adjoint, system):
            return k + 1
        end_back(terms, system, sums, adjoint, steps, wanted, found, h, k, row + k)
    return first
