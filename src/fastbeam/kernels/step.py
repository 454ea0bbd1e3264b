"""One step and the compiled time loop: the conserving step, theory.md 4 to 6, and the methods it is compared with, theory.md 7.

Every part that a scene lacks arrives as None; the branches on it are pruned before typing, so no code is compiled for it.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .alpha import END, KEPT, NOW, add_body_rates, add_plain_sliders, finish_alpha, keep_rates, spread_end
from .beam import element_groups
from .chain import factor, solve
from .inner import eliminate_columns, pull_tied_columns, push_tied_columns, put_inner_rhs, recover_inner
from .nodes import (add_bodies, advance, apply_held, apply_ties, extrapolation, predict, remember, spread, tie_coordinates,
                    update_nodes)
from .slider import add_sliders, clear_held, fill_panel, gaps_are_closed, predict_sliders, solve_border
from .sparse import solve_sparse

OK, NOT_CONVERGED, SINGULAR, BORDER_SINGULAR, NOT_FINITE, SLIDER_END = 0, 1, 2, 3, 4, 5
END_SLACK = 1e-12


class Work(NamedTuple):
    """Everything a step writes besides the state."""

    dq: np.ndarray        # float64 [12 N]
    theta: np.ndarray     # float64 [3 N]
    q_mid: np.ndarray     # float64 [12 N]
    q_end: np.ndarray     # float64 [12 N]
    u: np.ndarray         # float64 [12 N]
    s_end: np.ndarray     # float64 [S]
    f_ext: np.ndarray     # float64 [8 (rows + 1)]
    r: np.ndarray         # float64 [8 (rows + 1)]
    blocks: np.ndarray    # float64 [48 (blocks + 1)]
    pivots: np.ndarray    # int64 [6 rows]
    panel: np.ndarray     # float64 [rows, 6, width] flat
    schur: np.ndarray     # float64 [7 S, 7 S]
    y: np.ndarray         # float64 [7 S]
    scratch: np.ndarray   # float64
    keep_q: np.ndarray    # float64 [12 N]: state before the step
    keep_v: np.ndarray    # float64 [12 N]
    keep_s: np.ndarray    # float64 [S]
    keep_force: np.ndarray  # float64 [3 S]
    past: np.ndarray      # float64 [3 + 2 (6 N + 4 S)]: mean rates of the last two steps, nodes.remember
    keep_past: np.ndarray


class State(NamedTuple):
    """What a step changes; `force` is the contact force of the last step, also the first guess of the next."""

    q: np.ndarray         # float64 [12 N]
    v: np.ndarray         # float64 [12 N]
    s: np.ndarray         # float64 [S]
    force: np.ndarray     # float64 [3 S]


@kernel
def copy(x, y_out):
    for i in range(x.shape[0]):
        y_out[i] = x[i]


@kernel
def clear(inner, work):
    """Start a residual with the loads and a tangent with zeros."""
    if inner is not None:
        inner.state[0] = 1.0
        for i in range(inner.rhs.shape[0]):
            inner.rhs[i] = 0.0
    for i in range(work.r.shape[0]):
        work.r[i] = -work.f_ext[i]
    for i in range(work.blocks.shape[0]):
        work.blocks[i] = 0.0


@kernel
def start_step(ties, curves, sliders, contact, spinless, state, work, h):
    """First guess of everything."""
    c = extrapolation(work.past, h)
    predict(state.q, state.v, h, c, work.past, spinless, work.theta, work.dq)
    if ties is not None:
        tie_coordinates(ties, work.dq)
    if sliders is not None:
        contact.augmented[2] = 1.0
        predict_sliders(curves, sliders, contact, state.q, state.v, state.s, h, c, work.past, work.s_end, state.force)


@kernel
def add_elements(simo, green, inner, rate, spin_rate, middle, work):
    """Residual and tangent of all beams; what acts on inner nodes has to stand in the residual already."""
    if simo is not None:
        element_groups(simo, inner, work.q_mid, work.q_end, work.u, rate, spin_rate, None, middle, work.r, work.blocks,
                       work.scratch)
    if green is not None:
        element_groups(green, inner, work.q_mid, work.q_end, work.u, rate, spin_rate, 1, middle, work.r, work.blocks,
                       work.scratch)


@kernel
def assemble_step(simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, row_of, state, work, h):
    """Residual and tangent of one Newton iteration at the present dq, theta, s_end, force. `middle` and `alpha` are None for
    the conserving step; with `middle` it is the implicit midpoint rule, with `alpha` half the equations of generalised alpha."""
    clear(inner, work)
    if alpha is not None:
        spread_end(alpha, state.q, work.dq, work.theta, h, work.q_mid, work.q_end, work.u)
        if ties is not None:
            tie_coordinates(ties, work.u)
        if sliders is not None:
            add_plain_sliders(curves, sliders, contact, ties, row_of, work.q_mid, work.q_end, state.s, work.s_end, state.force,
                              0.5, work.r)
        add_elements(simo, green, inner, 0.5 * alpha.factor[1], alpha.spin_rate, None, work)
        if bodies is not None:
            add_bodies(bodies, work.q_mid, work.q_end, work.u, None, work.r, work.blocks)
            for k in range(bodies.node.shape[0]):
                add_body_rates(alpha, bodies, k, work.q_end, work.theta, work.blocks)
    else:
        spread(state.q, state.v, work.dq, h, work.q_mid, work.q_end, work.u)
        rate = 2.0 / (h * h)
        if sliders is not None:
            if middle is not None:
                add_plain_sliders(curves, sliders, contact, ties, row_of, work.q_mid, work.q_end, state.s, work.s_end,
                                  state.force, 1.0, work.r)
            else:
                add_sliders(curves, sliders, contact, ties, row_of, state.q, work.q_mid, work.q_end, work.theta, state.s,
                            work.s_end, state.force, work.r)
        add_elements(simo, green, inner, rate, None, middle, work)
        if bodies is not None:
            add_bodies(bodies, work.q_mid, work.q_end, work.u, rate, work.r, work.blocks)
    if ties is not None:
        apply_ties(ties, work.q_mid, work.q_end, work.r, work.blocks, work.scratch)
    if alpha is not None:
        for i in range(work.r.shape[0]):
            work.r[i] *= 0.5
        if inner is not None:
            for i in range(inner.rhs.shape[0]):
                inner.rhs[i] *= 0.5
    if held is not None:
        apply_held(held, work.r, work.blocks)


@kernel
def prepare_panel(inner, ties, contact, held, n_rows, width, work):
    """Right-hand sides of the end nodes: residual and borders."""
    fill_panel(contact, work.r, n_rows, width, work.panel)
    if inner is not None:
        for i in range(6 * inner.first[0] * width, 6 * n_rows * width, width):
            work.panel[i] = 0.0
        if contact is not None:
            eliminate_columns(inner, contact, work.panel, width)
            if ties is not None:
                pull_tied_columns(ties, work.q_mid, work.panel, width)
        put_inner_rhs(inner, n_rows, work.panel, width)
    if contact is not None:
        if held is not None:
            clear_held(held, width, work.panel)


@kernel
def complete_panel(inner, ties, width, work):
    """Solutions of inner nodes from those of the end nodes."""
    if inner is not None:
        if ties is not None:
            push_tied_columns(ties, work.q_end, work.panel, width)
        recover_inner(inner, work.panel, width)


@kernel
def update_step(inner, ties, contact, row_of, state, work, width, length):
    """Close the linear system (the panel holds the solved columns) and add the increments. Returns the size of the
    increment relative to `length`, or -1 - k where slider k makes the border singular."""
    slide = 0.0
    complete_panel(inner, ties, width, work)
    if contact is not None:
        singular = solve_border(contact, state.force, work.panel, row_of.shape[0], width, work.schur, work.y)
        if singular >= 0:
            return -1.0 - singular
        for k in range(state.s.shape[0]):
            for c in range(3):
                state.force[3 * k + c] += work.y[7 * k + c]
            work.s_end[k] += work.y[7 * k + 3]
            if abs(work.y[7 * k + 3]) > slide or work.y[7 * k + 3] != work.y[7 * k + 3]:
                slide = abs(work.y[7 * k + 3])
    else:
        for i in range(6 * row_of.shape[0]):
            work.panel[i * width] = -work.panel[i * width]
    move, spin = update_nodes(row_of, work.panel, width, state.q, work.theta, work.dq)
    if ties is not None:
        tie_coordinates(ties, work.dq)
        for k in range(ties.slave.shape[0]):
            i = ties.slave[k]
            for e in range(ties.start[i], ties.start[i + 1]):
                if ties.kind[e] == 2:
                    for c in range(3):
                        work.theta[3 * i + c] = work.theta[3 * ties.target[e] + c]
    return move / length + spin + slide / length


@kernel
def has_converged(size, before, floor):
    """Round-off level reached, or certain to be reached: Newton squares the increment, so the next would be about
    size (size/before)^2. That has to lie below 1e-20 and not 1e-16, because residual forces are increments times stiffness and
    the energy keeps their work. `floor` is where increments of round-off size end the iteration."""
    if size <= 1e-15:
        return True
    if size < before and before < np.inf:
        if size * (size / before)**2 <= 1e-20:
            return True
    return size <= floor and size > 0.1 * before


@kernel
def solve_nodes(inner, plan, pardiso, work, width):
    """Solve the panel with the node matrix, by block elimination or by PARDISO; False where it is singular."""
    if inner is not None:
        if inner.state[0] == 0.0:
            return False
    if plan is not None:
        # NaN fails the comparison too
        if not factor(plan, work.blocks, work.pivots) > 1e-14:
            return False
        solve(plan, work.blocks, work.pivots, work.panel, width)
        return True
    if pardiso is not None:
        return solve_sparse(pardiso, work.blocks, work.panel, width)
    return False


@kernel
def keep_state(alpha, state, work):
    if alpha is not None:
        keep_rates(alpha, NOW, KEPT)
    copy(state.q, work.keep_q)
    copy(state.v, work.keep_v)
    copy(state.s, work.keep_s)
    copy(state.force, work.keep_force)
    copy(work.past, work.keep_past)


@kernel
def restore_state(alpha, state, work):
    if alpha is not None:
        keep_rates(alpha, KEPT, NOW)
    copy(work.keep_q, state.q)
    copy(work.keep_v, state.v)
    copy(work.keep_s, state.s)
    copy(work.keep_force, state.force)
    copy(work.keep_past, work.past)


@kernel
def slider_outside(state, lengths):
    """The first slider beyond the end of its beam, or -1; the last digits of one that rests there do not count."""
    for k in range(state.s.shape[0]):
        slack = END_SLACK * lengths[k]
        if not (state.s[k] >= -slack and state.s[k] <= lengths[k] + slack):
            return k
    return -1


@kernel
def finish_step(ties, alpha, state, work, h):
    """Accept a converged step."""
    remember(work.theta, work.dq, state.s, work.s_end, state.force, h, work.past)
    if alpha is not None:
        spread_end(alpha, state.q, work.dq, work.theta, h, work.q_mid, work.q_end, work.u)
        finish_alpha(alpha, state.q, work.dq, state.v)
        if ties is not None:
            tie_coordinates(ties, state.v)
    else:
        advance(state.q, state.v, work.dq, h)
    copy(work.s_end, state.s)


@kernel
def external_forces(vectors, factors, f_ext_out):
    """Sum of load vectors [K, n] times their mean factors over the step [K]."""
    for i in range(f_ext_out.shape[0]):
        x = 0.0
        for k in range(factors.shape[0]):
            x += factors[k] * vectors[k, i]
        f_ext_out[i] = x


@kernel
def run(simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, plan, pardiso, row_of, spinless, loads,
        factors, state, work, weights, h, n_steps, width, length, max_iterations, lengths, counts_out, sizes_out, mean_force_out):
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
            start_step(ties, curves, sliders, contact, spinless, state, work, hm)
            status = NOT_CONVERGED
            before = np.inf
            for it in range(sizes_out.shape[0]):
                sizes_out[it] = 0.0
            for it in range(max_iterations):
                counts_out[2] += 1
                assemble_step(simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, row_of, state,
                              work, hm)
                prepare_panel(inner, ties, contact, held, row_of.shape[0], width, work)
                if not solve_nodes(inner, plan, pardiso, work, width):
                    status = SINGULAR
                    break
                size = update_step(inner, ties, contact, row_of, state, work, width, length)
                sizes_out[it] = size
                if size < 0.0:
                    status = BORDER_SINGULAR
                    break
                if not size < 1e6:
                    status = NOT_FINITE
                    break
                if has_converged(size, before, 1e-9) and gaps_are_closed(contact, sliders, state.q, length):
                    status = OK
                    break
                before = size
            if status != OK:
                break
            finish_step(ties, alpha, state, work, hm)
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


@kernel
def assemble_rest(simo, green, bodies, ties, held, row_of, state, work):
    """Residual at the present configuration for the second rates in work.u, without contact forces."""
    copy(state.q, work.q_mid)
    copy(state.q, work.q_end)
    clear(None, work)
    add_elements(simo, green, None, 0.0, None, None, work)
    if bodies is not None:
        add_bodies(bodies, work.q_mid, work.q_end, work.u, 0.0, work.r, work.blocks)
    if ties is not None:
        apply_ties(ties, work.q_mid, work.q_end, work.r, work.blocks, work.scratch)
    if held is not None:
        apply_held(held, work.r, work.blocks)


@kernel
def assemble_static(simo, green, inner, ties, held, row_of, state, work):
    """Residual f_int - f_ext and half the static tangent at the present configuration (theory.md 8): a step of equal ends."""
    copy(state.q, work.q_mid)
    copy(state.q, work.q_end)
    clear(inner, work)
    if simo is not None:
        element_groups(simo, inner, work.q_mid, work.q_end, None, None, None, None, None, work.r, work.blocks, work.scratch)
    if green is not None:
        element_groups(green, inner, work.q_mid, work.q_end, None, None, None, 1, None, work.r, work.blocks, work.scratch)
    if ties is not None:
        apply_ties(ties, work.q_mid, work.q_end, work.r, work.blocks, work.scratch)
    if held is not None:
        apply_held(held, work.r, work.blocks)


@kernel
def update_static(inner, ties, row_of, state, work, width, length):
    """Move by the solved panel (column 0 holds K_half^-1 r): multiplicative update of the triads. Returns its size."""
    for i in range(work.theta.shape[0]):
        work.theta[i] = 0.0
    for i in range(work.dq.shape[0]):
        work.dq[i] = 0.0
    complete_panel(inner, ties, width, work)
    for i in range(6 * row_of.shape[0]):
        work.panel[i * width] *= -0.5
    move, spin = update_nodes(row_of, work.panel, width, state.q, work.theta, work.dq)
    if ties is not None:
        tie_coordinates(ties, work.dq)
    for k in range(work.dq.shape[0]):
        state.q[k] += work.dq[k]
    return move / length + spin


@kernel
def solve_static_step(simo, green, inner, ties, held, plan, pardiso, row_of, state, work, width, length, max_iterations, largest,
                      sizes_out):
    """Newton iteration to equilibrium. Returns (status, iterations); an increment beyond `largest` ends it."""
    before = np.inf
    for it in range(max_iterations):
        assemble_static(simo, green, inner, ties, held, row_of, state, work)
        prepare_panel(inner, ties, None, held, row_of.shape[0], width, work)
        if not solve_nodes(inner, plan, pardiso, work, width):
            return SINGULAR, it + 1
        size = update_static(inner, ties, row_of, state, work, width, length)
        sizes_out[it] = size
        if not size < largest:
            return NOT_FINITE, it + 1
        if has_converged(size, before, 1e-9):
            return OK, it + 1
        before = size
    return NOT_CONVERGED, max_iterations
