"""Start and assembly of a step whose nodes have 3 unknowns: position in a plane and turn about its normal (theory.md 10)."""
from __future__ import annotations

from .._jit import kernel, written_in
from .nodes import apply_held, extrapolation
from .planar_beam import planar_groups
from .planar_nodes import add_planar_bodies, apply_planar_ties, planar_predict, planar_spread, tie_planar_increments
from .planar_slider import add_planar_sliders, predict_planar_sliders
from .work import clear, keep, start_line


@written_in
def planar_start(ties, curves, sliders, contact, spinless, state, work, h):
    """First guess of everything."""
    c = extrapolation(work.past, h)
    planar_predict(state.q, state.v, h, c, work.past, spinless, 0, spinless.shape[0], work.theta, work.dphi)
    start_line(work)
    if ties is not None:
        tie_planar_increments(ties, state.q, work.theta, work.dphi, work.line.off)
    if sliders is not None:
        predict_planar_sliders(curves, sliders, contact, state.q, state.v, state.s, h, c, work.past, work.s_end, state.force)


@written_in
def add_planar_elements(simo, green, inner, q, dphi, v, h, rate, work, size):
    """Residual and tangent of all beams."""
    if simo is not None:
        planar_groups(simo, 0, simo.meta.shape[0], inner, q, dphi, v, work.line, h, rate, None, work.r, work.blocks, work.scratch,
                      size)
    if green is not None:
        planar_groups(green, 0, green.meta.shape[0], inner, q, dphi, v, work.line, h, rate, 1, work.r, work.blocks, work.scratch,
                      size)


@written_in
def planar_assemble(simo, green, inner, bodies, ties, held, curves, sliders, contact, row_of, state, work, h, size):
    """Residual and tangent of the conserving step."""
    clear(inner, work)
    planar_spread(state.q, state.v, work.dphi, work.theta, h, 0, state.q.shape[0] // 4, work.q_mid, work.q_end, work.u)
    rate = 2.0 / (h * h)
    if sliders is not None:
        add_planar_sliders(curves, sliders, contact, ties, row_of, state.q, work.q_mid, work.q_end, work.theta, state.s,
                           work.s_end, state.force, work.r)
    add_planar_elements(simo, green, inner, state.q, work.dphi, state.v, h, rate, work, size)
    if bodies is not None:
        add_planar_bodies(bodies, work.q_mid, work.q_end, work.u, rate, work.r, work.blocks)
    if ties is not None:
        apply_planar_ties(ties, 0, ties.slave.shape[0], 0, ties.moves.shape[0], work.q_mid, work.q_end, work.r, work.blocks,
                          work.scratch)
    if held is not None:
        apply_held(held, work.r, work.blocks, size)


@kernel
def planar_static(simo, green, inner, ties, held, state, work, size):
    """Residual f_int - f_ext and half the static tangent at the present configuration: a step of equal ends."""
    keep(state.q, work.q_mid)
    keep(state.q, work.q_end)
    clear(inner, work)
    add_planar_elements(simo, green, inner, state.q, None, None, None, None, work, size)
    if ties is not None:
        apply_planar_ties(ties, 0, ties.slave.shape[0], 0, ties.moves.shape[0], work.q_mid, work.q_end, work.r, work.blocks,
                          work.scratch)
    if held is not None:
        apply_held(held, work.r, work.blocks, size)
