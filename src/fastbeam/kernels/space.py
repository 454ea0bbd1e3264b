"""Start and assembly of a step whose nodes have 6 unknowns: position and spin in space."""
from __future__ import annotations

from .._jit import kernel
from .alpha import add_body_rates, add_plain_sliders, spread_end
from .beam import element_groups
from .nodes import add_bodies, apply_held, extrapolation, predict, spread
from .slider import add_sliders, predict_sliders
from .ties import apply_ties, tie_coordinates, tie_increments
from .work import clear, copy, halve, keep, start_line


@kernel
def space_start(ties, curves, sliders, contact, spinless, state, work, h):
    """First guess of everything."""
    c = extrapolation(work.past, h)
    predict(state.q, state.v, h, c, work.past, spinless, 0, spinless.shape[0], work.theta, work.dphi)
    start_line(work)
    if ties is not None:
        tie_increments(ties, state.q, work.theta, work.dphi, work.line.off)
    if sliders is not None:
        predict_sliders(curves, sliders, contact, state.q, state.v, state.s, h, c, work.past, work.s_end, state.force)


@kernel
def add_elements(simo, green, inner, q, dphi, v, u, h, rate, spin_rate, middle, work, size):
    """Residual and tangent of all beams; what acts on inner nodes has to stand in the residual already."""
    if simo is not None:
        element_groups(simo, 0, simo.meta.shape[0], inner, q, dphi, v, u, work.line, h, rate, spin_rate, None, middle, work.r,
                       work.blocks, work.scratch, size)
    if green is not None:
        element_groups(green, 0, green.meta.shape[0], inner, q, dphi, v, u, work.line, h, rate, spin_rate, 1, middle, work.r,
                       work.blocks, work.scratch, size)


@kernel
def space_assemble(simo, green, inner, bodies, ties, held, curves, sliders, contact, middle, alpha, row_of, state, work, h, size):
    """Residual and tangent of one Newton iteration at the present dphi, theta, s_end, force. `middle` and `alpha` are None for
    the conserving step; with `middle` it is the implicit midpoint rule, with `alpha` half the equations of generalised alpha."""
    clear(inner, work)
    if alpha is not None:
        spread_end(alpha, state.q, work.dphi, work.theta, h, work.q_mid, work.q_end, work.u)
        if ties is not None:
            tie_coordinates(ties, work.u)
        if sliders is not None:
            add_plain_sliders(curves, sliders, contact, ties, row_of, work.q_mid, work.q_end, state.s, work.s_end, state.force,
                              0.5, work.r)
        add_elements(simo, green, inner, state.q, work.dphi, None, work.u, h, 0.5 * alpha.factor[1], alpha.spin_rate, None, work,
                     size)
        if bodies is not None:
            add_bodies(bodies, work.q_mid, work.q_end, work.u, None, work.r, work.blocks)
            for k in range(bodies.node.shape[0]):
                add_body_rates(alpha, bodies, k, work.q_end, work.theta, work.blocks)
    else:
        spread(state.q, state.v, work.dphi, work.theta, h, 0, state.q.shape[0] // 12, work.q_mid, work.q_end, work.u)
        rate = 2.0 / (h * h)
        if sliders is not None:
            if middle is not None:
                add_plain_sliders(curves, sliders, contact, ties, row_of, work.q_mid, work.q_end, state.s, work.s_end,
                                  state.force, 1.0, work.r)
            else:
                add_sliders(curves, sliders, contact, ties, row_of, state.q, work.q_mid, work.q_end, work.theta, state.s,
                            work.s_end, state.force, work.r)
        add_elements(simo, green, inner, state.q, work.dphi, state.v, None, h, rate, None, middle, work, size)
        if bodies is not None:
            add_bodies(bodies, work.q_mid, work.q_end, work.u, rate, work.r, work.blocks)
    if ties is not None:
        apply_ties(ties, 0, ties.slave.shape[0], 0, ties.moves.shape[0], work.q_mid, work.q_end, work.r, work.blocks,
                   work.scratch)
    if alpha is not None:
        halve(work.r)
        if inner is not None:
            halve(inner.rhs)
    if held is not None:
        apply_held(held, work.r, work.blocks, size)


@kernel
def assemble_rest(simo, green, bodies, ties, held, state, work, size):
    """Residual at the present configuration for the second rates in work.u, without contact forces."""
    copy(state.q, work.q_mid)
    copy(state.q, work.q_end)
    work.line.use[0] = 0.0
    clear(None, work)
    add_elements(simo, green, None, state.q, None, None, work.u, 0.0, 0.0, None, None, work, size)
    if bodies is not None:
        add_bodies(bodies, work.q_mid, work.q_end, work.u, 0.0, work.r, work.blocks)
    if ties is not None:
        apply_ties(ties, 0, ties.slave.shape[0], 0, ties.moves.shape[0], work.q_mid, work.q_end, work.r, work.blocks,
                   work.scratch)
    if held is not None:
        apply_held(held, work.r, work.blocks, size)


@kernel
def space_static(simo, green, inner, ties, held, state, work, size):
    """Residual f_int - f_ext and half the static tangent at the present configuration (theory.md 8): a step of equal ends."""
    keep(state.q, work.q_mid)
    keep(state.q, work.q_end)
    clear(inner, work)
    add_elements(simo, green, inner, state.q, None, None, None, None, None, None, None, work, size)
    if ties is not None:
        apply_ties(ties, 0, ties.slave.shape[0], 0, ties.moves.shape[0], work.q_mid, work.q_end, work.r, work.blocks,
                   work.scratch)
    if held is not None:
        apply_held(held, work.r, work.blocks, size)
