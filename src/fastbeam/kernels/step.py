"""One step and the compiled time loop: the conserving step, theory.md 4 to 6, and the methods it is compared with, theory.md 7.

Every part that a scene lacks arrives as None; the branches on it are pruned before typing, so no code is compiled for it. So do
`space` and `plane`: nodes in space have 6 unknowns and 12 coordinates, those of a planar scene 3 and 4 (kernels/planar.py); one
of the two is the tuple `size` of as many numbers as a node has unknowns, the other None.
"""
from __future__ import annotations

import numpy as np

from .._jit import ABSENT, beside, kernel, written_in
from .alpha import KEPT, NOW, finish_alpha, keep_rates, spread_end
from .beam import element_groups
from .border import clear_held, fill_panel, gaps_are_closed, solve_border, take_solution
from .chain import back_substitute, factor
from .inner import eliminate_columns, put_inner_rhs, recover_inner, recover_rows
from .nodes import advance, remember, update_nodes
from .planar import planar_assemble, planar_static, planar_start
from .planar_beam import planar_groups
from .planar_nodes import planar_advance, planar_pull, planar_push, planar_update, tie_planar_increments
from .planar_slider import add_planar_sliders
from .slider import add_sliders, border_of, dim_of
from .space import space_assemble, space_start, space_static
from .sparse import begin_step, solve_sparse
from .ties import pull_tied_columns, push_tied_columns, tie_coordinates, tie_increments
from .work import copy, follow_line, keep

OK, NOT_CONVERGED, SINGULAR, BORDER_SINGULAR, NOT_FINITE, SLIDER_END = 0, 1, 2, 3, 4, 5
END_SLACK = 1e-12
# increments below these may be round-off: where they do not shrink; where they are far longer than foretold
SMALL_INCREMENT, SMALLEST_INCREMENT = 1e-9, 1e-11


@written_in
def start_step(space, plane, ties, curves, sliders, contact, spinless, state, work, h):
    """First guess of everything."""
    if contact is not None:
        contact.augmented[2] = 1.0
    if space is not None:
        space_start(ties, curves, sliders, contact, spinless, state, work, h)
    if plane is not None:
        planar_start(ties, curves, sliders, contact, spinless, state, work, h)


@written_in
def assemble_step(space, plane, simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, row_of, state,
                  work, h):
    """Residual and tangent of one Newton iteration at the present dphi, theta, s_end, force. `middle` and `alpha` are None for
    the conserving step; with `middle` it is the implicit midpoint rule, with `alpha` half the equations of generalised alpha;
    both in space only."""
    if space is not None:
        space_assemble(simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, row_of, state, work, h,
                       space)
    if plane is not None:
        planar_assemble(simo, green, inner, bodies, ties, held, curves, sliders, contact, row_of, state, work, h, plane)


@written_in
def prepare_panel(space, plane, inner, ties, contact, held, width, work, size):
    """Right-hand sides: the residual of the end nodes; with sliders their borders too, for all nodes."""
    fill_panel(contact, work.r, width, work.panel, size)
    if contact is not None:
        if inner is not None:
            for i in range(len(size) * inner.first[0] * width, work.panel.shape[0], width):
                work.panel[i] = 0.0
            eliminate_columns(inner, contact, work.panel, width, size)
            if ties is not None:
                if space is not None:
                    pull_tied_columns(ties, work.q_mid, work.panel, width)
                if plane is not None:
                    planar_pull(ties, work.q_mid, work.panel, width)
            put_inner_rhs(inner, work.panel, width, size)
        if held is not None:
            clear_held(held, width, work.panel, size)


@written_in
def push_ties(space, plane, ties, q_end, x, pitch, width, columns):
    """Rows of tied nodes from those of their targets."""
    if ties is not None:
        if space is not None:
            push_tied_columns(ties, q_end, x, pitch, width, columns)
        if plane is not None:
            planar_push(ties, q_end, x, pitch, width, columns)


@written_in
def complete_panel(space, plane, inner, ties, width, work, size):
    """Solutions of inner nodes from those of the end nodes, all columns."""
    if inner is not None:
        push_ties(space, plane, ties, work.q_end, work.panel, len(size) * width, width, width)
        recover_inner(inner, work.panel, width, size)


@written_in
def take_rows(space, plane, simo, green, inner, ties, factor, of_inner, width, work, size):
    """Increments of all rows from the solved column of the panel, in a scene without sliders: `factor` per solution, and so many
    of what was stored of inner nodes."""
    take_solution(work.panel, width, factor, work.line.x, size)
    push_ties(space, plane, ties, work.q_end, work.line.x, 8, 1, 1)
    if inner is not None:
        if simo is not None:
            recover_rows(simo, inner, of_inner, work.line.x, work.scratch, size)
        if green is not None:
            recover_rows(green, inner, of_inner, work.line.x, work.scratch, size)


@written_in
def move_nodes(space, plane, ties, row_of, state, work):
    """Add the rows of increments to all nodes. Returns the largest of positions and of spins."""
    move = 0.0
    spin = 0.0
    if space is not None:
        move, spin = update_nodes(row_of, work.line.x, 0, row_of.shape[0], work.theta, work.dphi, work.scratch)
        if ties is not None:
            tie_increments(ties, state.q, work.theta, work.dphi, work.line.off)
    if plane is not None:
        move, spin = planar_update(row_of, work.line.x, 0, row_of.shape[0], work.theta, work.dphi)
        if ties is not None:
            tie_planar_increments(ties, state.q, work.theta, work.dphi, work.line.off)
    return move, spin


@written_in
def update_step(space, plane, simo, green, inner, ties, contact, alpha, row_of, state, work, width, length, size):
    """Close the linear system (the panel holds the solved columns) and add the increments. Returns the size of the
    increment relative to `length`, or -1 - k where slider k makes the border singular."""
    slide = 0.0
    if contact is not None:
        complete_panel(space, plane, inner, ties, width, work, size)
        singular = solve_border(contact, state.force, work.panel, width, work.rows, work.schur, work.y, work.line.x, size)
        if singular >= 0:
            return -1.0 - singular
        push_ties(space, plane, ties, work.q_end, work.line.x, 8, 1, 1)
        d = dim_of(len(size))
        border = border_of(len(size))
        for k in range(state.s.shape[0]):
            for c in range(d):
                state.force[d * k + c] += work.y[border * k + c]
            z = work.y[border * k + d]
            work.s_end[k] += z
            if abs(z) > slide or z != z:
                slide = abs(z)
    else:
        # half the equations of generalised alpha are solved, inner nodes store the whole ones
        take_rows(space, plane, simo, green, inner, ties, -1.0, -1.0 if alpha is None else -0.5, width, work, size)
    move, spin = move_nodes(space, plane, ties, row_of, state, work)
    follow_line(work.line, move / length + spin)
    return move / length + spin + slide / length


@kernel
def next_increment(size, before):
    """What Newton's method leaves for the next iteration, which squares the increment: about size (size/before)^2."""
    return size * (size / before)**2 if size < before < np.inf else np.inf


@kernel
def has_converged(size, before, expected):
    """Round-off level reached, or certain to be reached. The next increment has to lie below 1e-20 and not 1e-16, because
    residual forces are increments times stiffness and the energy keeps their work.

    expected: `next_increment` of the iteration before. A very small increment that is far longer is round-off, and so would the
    next be, whatever Newton's method leaves."""
    if size <= 1e-15:
        return True
    left = min(size, 100.0 * expected) if size <= SMALLEST_INCREMENT else size
    if next_increment(left, before) <= 1e-20:
        return True
    return size <= SMALL_INCREMENT and size > 0.1 * before


@written_in
def solve_chain(plan, work, width, size):
    """By block elimination; width: None where there is nothing but the residual."""
    # NaN fails the comparison too
    good = factor(plan, work.blocks, work.pivots, work.panel, width, size) > 1e-14
    if good:
        back_substitute(plan, work.blocks, work.panel, width, size)
    return good


@written_in
def solve_nodes(contact, inner, plan, pardiso, work, width, size):
    """Solve the panel with the node matrix, by block elimination or by PARDISO; False where it is singular."""
    if inner is not None:
        if inner.state[0] == 0.0:
            return False
    if plan is not None:
        if contact is not None:
            return solve_chain(plan, work, width, size)
        return solve_chain(plan, work, None, size)
    if pardiso is not None:
        return solve_sparse(pardiso, work.blocks, work.panel, width, size)
    return False


@kernel
def keep_state(alpha, state, work):
    if alpha is not None:
        keep_rates(alpha, NOW, KEPT)
    keep(state.q, work.keep_q)
    keep(state.v, work.keep_v)
    keep(state.s, work.keep_s)
    keep(state.force, work.keep_force)
    keep(work.dphi, work.keep_dphi)
    keep(work.theta, work.keep_theta)
    keep(work.past, work.keep_past)


@kernel
def restore_state(alpha, state, work):
    if alpha is not None:
        keep_rates(alpha, KEPT, NOW)
    copy(work.keep_q, state.q)
    copy(work.keep_v, state.v)
    copy(work.keep_s, state.s)
    copy(work.keep_force, state.force)
    copy(work.keep_dphi, work.dphi)
    copy(work.keep_theta, work.theta)
    copy(work.keep_past, work.past)


@kernel
def slider_outside(state, lengths):
    """The first slider beyond the end of its beam, or -1; the last digits of one that rests there do not count."""
    for k in range(state.s.shape[0]):
        slack = END_SLACK * lengths[k]
        if not (state.s[k] >= -slack and state.s[k] <= lengths[k] + slack):
            return k
    return -1


@written_in
def finish_step(space, plane, ties, alpha, state, work, h):
    """Accept a converged step."""
    work.past[work.past.shape[0] - 1] = work.line.use[2]
    remember(state.s, work.s_end, state.force, h, work.past)
    if alpha is not None:
        spread_end(alpha, state.q, work.dphi, work.theta, h, work.q_mid, work.q_end, work.u)
        finish_alpha(alpha, work.q_end, state.q, state.v)
        if ties is not None:
            tie_coordinates(ties, state.v)
    else:
        move_on(space, plane, state.q, state.v, work, h)
    copy(work.s_end, state.s)


@written_in
def move_on(space, plane, q, v, work, h):
    """Accept the increments of all nodes; in statics v and h are None."""
    if space is not None:
        advance(q, v, work.dphi, work.theta, h, 0, q.shape[0] // 12, work.scratch)
    if plane is not None:
        planar_advance(q, v, work.dphi, work.theta, h, 0, q.shape[0] // 4, work.scratch)


@kernel
def external_forces(vectors, factors, f_ext_out):
    """Sum of load vectors [K, n] times their mean factors over the step [K]."""
    for i in range(f_ext_out.shape[0]):
        x = 0.0
        for k in range(factors.shape[0]):
            x += factors[k] * vectors[k, i]
        f_ext_out[i] = x


@kernel
def run(space, plane, size, simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, plan, pardiso,
        row_of, spinless, loads, factors, state, work, weights, h, n_steps, width, length, max_iterations, lengths, counts_out,
        sizes_out, mean_force_out):
    """`n_steps` steps of size h, each composed of substeps `weights` h (one: order 2; five: order 4, theory.md 6), each a Newton
    iteration on the equations of `assemble_step`.

    loads: None or [K, n] vectors with `factors` [n_steps * n_weights, K]. lengths: arc length where each slider's beam
    ends. mean_force_out [2, 3 S]: mean contact force of the first and of the last step.
    counts_out: status, steps done, Newton iterations, slider of an event.
    On a failure the state is the last good one. One function and not several: every level of calls is compiled again with all
    below it.
    """
    counts_out[0] = OK
    counts_out[1] = 0
    counts_out[2] = 0
    counts_out[3] = -1
    for n in range(n_steps):
        keep_state(alpha, state, work)
        for k in range(mean_force_out.shape[1]):
            mean_force_out[1, k] = 0.0
        status = OK
        for m in range(weights.shape[0]):
            hm = weights[m] * h
            if loads is not None:
                external_forces(loads, factors[n * weights.shape[0] + m], work.f_ext)
            start_step(space, plane, ties, curves, sliders, contact, spinless, state, work, hm)
            begin_step(pardiso)
            status = NOT_CONVERGED
            before = expected = np.inf
            for it in range(sizes_out.shape[0]):
                sizes_out[it] = 0.0
            for it in range(max_iterations):
                counts_out[2] += 1
                assemble_step(space, plane, simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha,
                              row_of, state, work, hm)
                prepare_panel(space, plane, inner, ties, contact, held, width, work, size)
                if not solve_nodes(contact, inner, plan, pardiso, work, width, size):
                    status = SINGULAR
                    break
                moved = update_step(space, plane, simo, green, inner, ties, contact, alpha, row_of, state, work, width, length,
                                    size)
                sizes_out[it] = moved
                if moved < 0.0:
                    status = BORDER_SINGULAR
                    break
                if not moved < 1e6:
                    status = NOT_FINITE
                    break
                if has_converged(moved, before, expected) and gaps_are_closed(contact, sliders, state.q, length, size):
                    status = OK
                    break
                expected = next_increment(moved, before)
                before = moved
            if status != OK:
                break
            finish_step(space, plane, ties, alpha, state, work, hm)
            for k in range(mean_force_out.shape[1]):
                mean_force_out[1, k] += weights[m] * state.force[k]
        if sliders is not None:
            if status == OK:
                counts_out[3] = slider_outside(state, lengths)
                if counts_out[3] >= 0:
                    status = SLIDER_END
        if status != OK:
            counts_out[0] = status
            restore_state(alpha, state, work)
            return
        counts_out[1] = n + 1
        if n == 0:
            for k in range(mean_force_out.shape[1]):
                mean_force_out[0, k] = mean_force_out[1, k]


def _beside_run(space, plane, size, simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, plan,
                pardiso, row_of, spinless, loads, factors, state, work, weights, h, n_steps, width, *others):
    """Parts of `run` that together take as long to compile as the others, in the order of their calls, and the types that they
    are called with, from the types of its arguments."""
    def of(record, *names):
        return [record.types[record.fields.index(name)] for name in names]

    integer = n_steps
    r, blocks, panel, scratch, line = of(work, "r", "blocks", "panel", "scratch", "line")
    (x,) = of(line, "x")
    jobs = []
    if contact is not ABSENT and alpha is ABSENT and middle is ABSENT:
        add = add_sliders if plane is ABSENT else add_planar_sliders
        jobs.append((add, (curves, sliders, contact, ties, row_of, *of(state, "q"), *of(work, "q_mid", "q_end", "theta"),
                           *of(state, "s"), *of(work, "s_end"), *of(state, "force"), r)))
    for tables, green_strain in ((simo, ABSENT), (green, integer)):
        if tables is not ABSENT:
            common = (tables, integer, integer, inner, *of(state, "q"), *of(work, "dphi"))
            (v,) = of(state, "v")
            if plane is not ABSENT:
                jobs.append((planar_groups, (*common, v, line, h, h, green_strain, r, blocks, scratch, size)))
            elif alpha is ABSENT:
                jobs.append((element_groups, (*common, v, ABSENT, line, h, h, ABSENT, green_strain, middle, r, blocks, scratch,
                                              size)))
            else:
                jobs.append((element_groups, (*common, ABSENT, *of(work, "u"), line, h, h, *of(alpha, "spin_rate"), green_strain,
                                              middle, r, blocks, scratch, size)))
    if plan is not ABSENT:
        jobs.append((factor, (plan, blocks, *of(work, "pivots"), panel, ABSENT if contact is ABSENT else width, size)))
    if contact is not ABSENT:
        jobs.append((solve_border, (contact, *of(state, "force"), panel, width, *of(work, "rows", "schur", "y"), x, size)))
    if inner is not ABSENT:
        jobs += [(recover_rows, (tables, inner, h, x, scratch, size)) for tables in (simo, green)
                 if tables is not ABSENT]
    return jobs


beside(run, _beside_run)


@kernel
def assemble_static(space, plane, simo, green, inner, ties, held, state, work):
    """Residual and half the static tangent at the present configuration."""
    if space is not None:
        space_static(simo, green, inner, ties, held, state, work, space)
    if plane is not None:
        planar_static(simo, green, inner, ties, held, state, work, plane)


@kernel
def update_static(space, plane, simo, green, inner, ties, row_of, state, work, width, length, size):
    """Move by the solved panel (column 0 holds K_half^-1 r): multiplicative update of the triads. Returns its size."""
    for i in range(work.theta.shape[0]):
        work.theta[i] = 0.0
    for i in range(work.dphi.shape[0]):
        work.dphi[i] = 0.0
    take_rows(space, plane, simo, green, inner, ties, -0.5, -0.5, width, work, size)
    move, spin = move_nodes(space, plane, ties, row_of, state, work)
    move_on(space, plane, state.q, None, work, None)
    follow_line(work.line, move / length + spin)
    return move / length + spin


@kernel
def solve_static_step(space, plane, size, simo, green, inner, ties, held, plan, pardiso, row_of, state, work, width, length,
                      max_iterations, largest, sizes_out):
    """Newton iteration to equilibrium. Returns (status, iterations); an increment beyond `largest` ends it."""
    work.line.use[0] = 0.0
    begin_step(pardiso)
    before = expected = np.inf
    for it in range(max_iterations):
        assemble_static(space, plane, simo, green, inner, ties, held, state, work)
        prepare_panel(space, plane, inner, ties, None, held, width, work, size)
        if not solve_nodes(None, inner, plan, pardiso, work, width, size):
            return SINGULAR, it + 1
        moved = update_static(space, plane, simo, green, inner, ties, row_of, state, work, width, length, size)
        sizes_out[it] = moved
        if not moved < largest:
            return NOT_FINITE, it + 1
        if has_converged(moved, before, expected):
            return OK, it + 1
        expected = next_increment(moved, before)
        before = moved
    return NOT_CONVERGED, max_iterations
