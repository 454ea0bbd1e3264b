"""One step and the compiled time loop: the conserving step (theory.md 4 to 6), the methods it is compared with (7), statics (8).

The loop is compiled once: terms, method, kind of nodes, contact and solver are called through a table (jit/calls.py).

Arrays: q [12 N], in a plane [4 N]; weights [substeps]; sizes_out [MORE_ITERATIONS max_iterations]; counts_out [4], [5]
or [5 + n_steps]; mean_force_out [2, F]; factors [K], f_ext_out [8 (rows + 1)]; out [1].
"""
from __future__ import annotations

import numpy as np

from fastbeam.kernels.algebra.dimensions import Plane, Space
from fastbeam.kernels.beams.nodes import extrapolation, remember
from fastbeam.kernels.contact.coulomb import begin_fallback, begin_round, cycles
from fastbeam.kernels.entries.dense import Contact, ContactAtRest, ContactInMatrix, ContactOfCarriers
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.records import in_memory
from fastbeam.kernels.linalg.border import fill_panel, fill_residual, solve_border, take_solution
from fastbeam.kernels.linalg.chain import Elimination, OneSide, RightSides, back_substitute, factor
from fastbeam.kernels.linalg.pardiso import PardisoTables, solve_sparse
from fastbeam.kernels.linalg.pardiso import begin_step as begin_pardiso_step
from fastbeam.kernels.state import (
    FALLBACK,
    MORE_ITERATIONS,
    clear_equations,
    copy,
    follow_increment,
    keep_arrays,
    restore_arrays,
    start_increment,
)
from fastbeam.kernels.terms import (
    AtRest,
    Equilibrium,
    Loads,
    NoContact,
    SolverOutside,
    accept,
    account,
    advance_nodes,
    assemble,
    axes_of,
    begin_contact,
    begin_solver,
    begin_step,
    carry_columns,
    clear,
    clear_increments,
    close,
    complete_columns,
    fill,
    first_guess,
    follow_nodes,
    inner_share,
    is_regular,
    is_settled,
    move_nodes,
    node_share,
    potential_energy,
    predict_nodes,
    push_increments,
    put_loads,
    recover,
    restore,
    save,
    scale_residual,
    scale_solutions,
    solve,
    spread_nodes,
    take_increments,
    take_unknowns,
    within_limits,
)

OK, NOT_CONVERGED, SINGULAR, BORDER_SINGULAR, NOT_FINITE, SLIDER_END = 0, 1, 2, 3, 4, 5
# slip directions of friction cycle: the step begins again with their fallback (contact/coulomb.py)
CYCLES = 6
# increments below these may be round-off: if they do not shrink; if they are far longer than expected
SMALL_INCREMENT, SMALLEST_INCREMENT = 1e-9, 1e-11
# increment, in sizes of the scene, that counts as divergence of a step in time
LARGEST_IN_TIME = 1e6


# --- defaults of methods, and statics -----------------------------------------------------------------------------------
@begin_step.register(object)
@kernel
def begin_in_time(method, terms, system, h):
    c = extrapolation(system.work.past, h)
    predict_nodes.call(system.dofs, system.state, system.work, system.spinless, h, c, 0, system.row_of.shape[0])
    start_increment(system.work)
    begin_contact.call(system.contact)
    first_guess.each(terms, system, h, c)


@axes_of.register(Space)
@kernel
def three_axes(dofs):
    return 3


@axes_of.register(Plane)
@kernel
def two_axes(dofs):
    return 2


@begin_contact.register(NoContact)
@kernel
def begin_without_contact(contact):
    pass


@begin_contact.register(Contact)
@begin_contact.register(FactoredContact)
@kernel
def begin_with_contact(contact):
    contact.augmented[2] = 1.0


@begin_step.register(Equilibrium)
@begin_step.register(AtRest)
@kernel
def begin_at_rest(method, terms, system, h):
    system.work.increment.control[0] = 0.0


@save.register(object)
@restore.register(object)
@kernel
def keep_nothing(method):
    pass


@scale_residual.register(object)
@clear_increments.register(object)
@take_increments.register(object)
@kernel
def do_nothing(method, system):
    pass


@node_share.register(object)
@inner_share.register(object)
@kernel
def whole_increment(method):
    return -1.0


@node_share.register(Equilibrium)
@inner_share.register(Equilibrium)
@kernel
def half_increment(method):
    """Return -1/2, because half the tangent is formed."""
    return -0.5


@clear_increments.register(Equilibrium)
@kernel
def clear_static_increments(method, system):
    work = system.work
    for i in range(work.theta.shape[0]):
        work.theta[i] = 0.0
    for i in range(work.dphi.shape[0]):
        work.dphi[i] = 0.0


@take_increments.register(Equilibrium)
@kernel
def take_static_increments(method, system):
    """Move positions, and rotate triads."""
    work = system.work
    advance_nodes.call(system.dofs, method, system.state, work, 0.0, 0, system.row_of.shape[0], work.scratch)


@put_loads.register(Loads)
@kernel
def put_mean_loads(loads, system, k):
    external_forces(loads.vectors, loads.factors[k], system.work.f_ext)


# --- the system of equations --------------------------------------------------------------------------------------------
@kernel
def assemble_step(terms, system, h):
    """Assemble residual and tangent of one Newton iteration at the present dphi, theta, s_end, force."""
    method = system.method
    begin_round(system.work.increment)
    clear_equations(system.work)
    spread_nodes.call(system.dofs, method, system.state, system.work, h, 0, system.row_of.shape[0])
    clear.each(terms, method, system)
    assemble.each(terms, method, system, h)
    scale_residual.call(method, system)
    scale_solutions.each(terms, method, system)


@fill.register(NoContact)
@fill.register(ContactAtRest)
@fill.register(ContactInMatrix)
@fill.register(ContactOfCarriers)
@kernel
def fill_without_border(contact, terms, system):
    fill_residual(system.work.r, system.work.panel, system.dofs)


@fill.register(Contact)
@kernel
def fill_bordered(contact, terms, system):
    fill_panel(contact, system.work.r, system.width, system.work.panel, system.dofs)
    carry_columns.each(terms, system)


@begin_solver.register(object)
@kernel
def begin_with_nothing(solver):
    pass


@begin_solver.register(PardisoTables)
@kernel
def begin_pardiso(solver):
    begin_pardiso_step(solver)


@kernel
def eliminate(plan, work, sides, dofs):
    """Solve by block elimination; return False if a pivot is too small."""
    # NaN fails the comparison too
    good = factor(plan, work.blocks, work.pivots, sides, dofs) > 1e-14
    if good:
        back_substitute(plan, work.blocks, sides, dofs)
    return good


@solve.register(Elimination, NoContact)
@solve.register(Elimination, ContactOfCarriers)
@kernel
def eliminate_residual(plan, contact, system):
    return eliminate(plan, system.work, OneSide(system.work.panel), system.dofs)


@solve.register(Elimination, Contact)
@kernel
def eliminate_bordered(plan, contact, system):
    return eliminate(plan, system.work, RightSides(system.work.panel, system.width), system.dofs)


@solve.register(PardisoTables)
@kernel
def solve_by_pardiso(pardiso, contact, system):
    return solve_sparse(pardiso, system.work.blocks, system.work.panel, system.width, system.dofs)


@solve.register(SolverOutside)
@kernel
def solve_nothing(solver, contact, system):
    return False


@close.register(NoContact)
@close.register(ContactAtRest)
@close.register(ContactOfCarriers)
@kernel
def close_residual(contact, terms, system):
    method, work = system.method, system.work
    take_solution(work.panel, system.width, node_share.call(method), work.increment.x, system.dofs)
    push_increments.each(terms, system)
    recover.each_backward(terms, system, inner_share.call(method))
    return 0.0, 0.0


@close.register(Contact)
@kernel
def close_bordered(contact, terms, system):
    work = system.work
    complete_columns.each_backward(terms, system)
    singular = solve_border(contact, system.state.force, work.panel, system.width, work.border_rows, work.schur, work.y,
                            work.increment.x, system.dofs)
    if singular >= 0:
        return -1.0 - singular, 0.0
    push_increments.each(terms, system)
    contact.augmented[3] = 0.0
    take_unknowns.each(terms, system)
    return 0.0, contact.augmented[3]


@close.register(ContactInMatrix)
@kernel
def close_in_matrix(contact, terms, system):
    work = system.work
    take_solution(work.panel, system.width, 1.0, work.increment.x, system.dofs)
    push_increments.each(terms, system)
    contact.augmented[3] = 0.0
    take_unknowns.each(terms, system)
    return 0.0, contact.augmented[3]


@kernel
def update_step(terms, system):
    """Add the increments of the solved panel. Return their size relative to that of the scene; -1 - k: slider k makes the border
    singular."""
    clear_increments.call(system.method, system)
    singular, slide = close.call(system.contact, terms, system)
    if singular < 0.0:
        return singular
    move, spin = move_nodes.call(system.dofs, system.row_of, system.work, 0, system.row_of.shape[0], system.work.scratch)
    follow_nodes.each(terms, system)
    take_increments.call(system.method, system)
    follow_increment(system.work.increment, move / system.length + spin)
    return move / system.length + spin + slide / system.length


# --- Newton's method ----------------------------------------------------------------------------------------------------
@kernel
def next_increment(size, before):
    """Return the expected size of the next increment of Newton's method, which squares it: about size (size/before)^2; `size`
    itself if it did not shrink, infinity after the first."""
    if not before < np.inf:
        return np.inf
    return size * (size / before)**2 if size < before else size


@kernel
def has_converged(size, before, expected):
    """Return whether the round-off level is reached, or certain to be reached. The next increment has to lie below 1e-20 and not
    1e-16, because residual forces are increments times stiffness and the energy keeps their work.

    expected: `next_increment` of the iteration before. A very small increment that is far longer is round-off, and so would the
    next be, whatever Newton's method leaves."""
    if size <= 1e-15:
        return True
    left = min(size, 100.0 * expected) if size <= SMALLEST_INCREMENT else size
    if next_increment(left, before) <= 1e-20:
        return True
    # increments that shrink by the same share time and again are not round-off; increments that grew the time before are
    stays = size > 0.1 * before and (size > 100.0 * expected or size > 0.5 * before or before <= expected < np.inf)
    return size <= SMALL_INCREMENT and stays


@kernel
def newton(terms, system, h, max_iterations, largest, sizes_out):
    """Iterate by Newton's method from the first guess; return (status, iterations). An increment beyond `largest`, relative to
    the scene, ends it. MORE_ITERATIONS times as many iterations are allowed if slip directions cycle (coulomb.py).

    sizes_out [MORE_ITERATIONS max_iterations]: sizes of the increments; -1 - k: slider k makes the border singular."""
    begin_solver.call(system.solver)
    before = expected = np.inf
    for it in range(sizes_out.shape[0]):
        sizes_out[it] = 0.0
    for it in range(MORE_ITERATIONS * max_iterations):
        if it == max_iterations and system.work.increment.control[FALLBACK] == 0.0:
            return NOT_CONVERGED, it
        assemble_step(terms, system, h)
        fill.call(system.contact, terms, system)
        if not is_regular.all(terms, system) or not solve.call(system.solver, system.contact, system):
            return SINGULAR, it + 1
        moved = update_step(terms, system)
        sizes_out[it] = moved
        if moved < 0.0:
            return BORDER_SINGULAR, it + 1
        if not moved < largest:
            return NOT_FINITE, it + 1
        if has_converged(moved, before, expected) and is_settled.all(terms, system):
            return OK, it + 1
        if cycles(system.work.increment):
            return CYCLES, it + 1
        expected = next_increment(moved, before)
        before = moved
    return NOT_CONVERGED, MORE_ITERATIONS * max_iterations


# --- steps --------------------------------------------------------------------------------------------------------------
@kernel
def keep_state(system):
    """Save the state before a step."""
    save.call(system.method)
    keep_arrays(system.state, system.work)


@kernel
def restore_state(system):
    """Restore the state that `keep_state` saved."""
    restore.call(system.method)
    restore_arrays(system.state, system.work)


@kernel
def begin_again(terms, system, h, k):
    """Begin step k of size h once more with the fallback of friction: slip directions that cycle may have led far from the first
    guess."""
    restore_state(system)
    put_loads.each(terms, system, k)
    begin_step.call(system.method, terms, system, h)
    begin_fallback(system.work.increment)


@kernel
def finish_step(terms, system, h):
    """Accept a converged step."""
    state, work = system.state, system.work
    account.each(terms, system, h)
    work.past[work.past.shape[0] - 1] = work.increment.control[2]
    remember(state.s, work.s_end, state.force, axes_of.call(system.dofs), h, work.past)
    advance_nodes.call(system.dofs, system.method, state, work, h, 0, system.row_of.shape[0], work.scratch)
    accept.each(terms, system.method, system)
    copy(work.s_end, state.s)


@kernel
def external_forces(vectors, factors, f_ext_out):
    """Sum load vectors times their mean factors over the step [K]."""
    first, vector, row, value = vectors.first, vectors.vector, vectors.row, vectors.value
    for i in range(f_ext_out.shape[0]):
        f_ext_out[i] = 0.0
    for i in range(first.shape[0]):
        f_ext_out[i] += factors[0] * first[i]
    for e in range(row.shape[0]):
        factor = factors[vector[e]]
        for c in range(8):
            f_ext_out[8 * row[e] + c] += factor * value[8 * e + c]


@kernel
def run(terms, system, weights, h, n_steps, max_iterations, counts_out, sizes_out, mean_force_out):
    """Run `n_steps` steps of size h, each composed of substeps `weights` h (one: order 2; five: order 4, theory.md 6), each a
    Newton iteration.

    mean_force_out [2, F]: mean forces of all constraints in the first and the last step. counts_out: status, steps done, Newton
    iterations, slider of an event, if there is space iterations before the last step, and before every step. On a failure the
    state is the last good one.
    """
    counts_out[0] = OK
    counts_out[1] = 0
    counts_out[2] = 0
    counts_out[3] = -1
    force = system.state.force
    for n in range(n_steps):
        if counts_out.shape[0] > 4:
            counts_out[4] = counts_out[2]
        if counts_out.shape[0] > 5:
            counts_out[5 + n] = counts_out[2]
        keep_state(system)
        for k in range(mean_force_out.shape[1]):
            mean_force_out[1, k] = 0.0
        status = OK
        for m in range(weights.shape[0]):
            hm = weights[m] * h
            put_loads.each(terms, system, n * weights.shape[0] + m)
            begin_step.call(system.method, terms, system, hm)
            status, iterations = newton(terms, system, hm, max_iterations, LARGEST_IN_TIME, sizes_out)
            counts_out[2] += iterations
            if status == CYCLES:
                begin_fallback(system.work.increment)
                status, iterations = newton(terms, system, hm, max_iterations, LARGEST_IN_TIME, sizes_out)
                counts_out[2] += iterations
                if status != OK and weights.shape[0] == 1:
                    begin_again(terms, system, hm, n)
                    status, iterations = newton(terms, system, hm, max_iterations, LARGEST_IN_TIME, sizes_out)
                    counts_out[2] += iterations
            if status != OK:
                break
            finish_step(terms, system, hm)
            for k in range(mean_force_out.shape[1]):
                mean_force_out[1, k] += weights[m] * force[k]
        if status == OK and not within_limits.all(terms, system, counts_out):
            status = SLIDER_END
        if status != OK:
            counts_out[0] = status
            restore_state(system)
            return
        counts_out[1] = n + 1
        if n == 0:
            for k in range(mean_force_out.shape[1]):
                mean_force_out[0, k] = mean_force_out[1, k]


@kernel
def solve_equilibrium(terms, system, max_iterations, largest, sizes_out):
    """Iterate by Newton's method to an equilibrium under the loads in work.f_ext; return (status, iterations)."""
    begin_step.call(system.method, terms, system, 0.0)
    return newton(terms, system, 0.0, max_iterations, largest, sizes_out)


# --- the parts of an iteration for loops in Python ----------------------------------------------------------------------
@kernel
def keep_now(terms, system):
    keep_state(system)


@kernel
def restore_kept(terms, system):
    restore_state(system)


@kernel
def begin(terms, system, h):
    begin_step.call(system.method, terms, system, h)


@kernel
def assemble_all(terms, system, h):
    assemble_step(terms, system, h)


@kernel
def assemble_some(terms, system, h):
    """Add residual and tangent of these terms."""
    assemble.each(terms, system.method, system, h)


@kernel
def guess_some(terms, system, h, c):
    begin_contact.call(system.contact)
    first_guess.each(terms, system, h, c)


@kernel
def clear_some(terms, system):
    begin_round(system.work.increment)
    clear.each(terms, system.method, system)


@kernel
def follow_some(terms, system):
    follow_nodes.each(terms, system)


@kernel
def fill_right(terms, system):
    fill.call(system.contact, terms, system)


@kernel
def all_regular(terms, system):
    return is_regular.all(terms, system)


@kernel
def all_settled(terms, system):
    return is_settled.all(terms, system)


@kernel
def solve_right(terms, system):
    return solve.call(system.solver, system.contact, system)


@kernel
def close_right(terms, system):
    return close.call(system.contact, terms, system)


@kernel
def update(terms, system):
    return update_step(terms, system)


@kernel
def finish(terms, system, h):
    finish_step(terms, system, h)


@kernel
def energy_of(terms, q, dofs, out):
    potential_energy.each(in_memory(terms), q, dofs, out)


@kernel
def account_all(terms, system, h):
    account.each(terms, system, h)


@kernel
def all_within_limits(terms, system, counts_out):
    return within_limits.all(terms, system, counts_out)
