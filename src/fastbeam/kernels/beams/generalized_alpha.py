"""Generalised alpha and its special case, the trapezoidal rule, on the nodes: theory.md 7.

Equilibrium holds at the end of the step, so the element kernel runs with both configurations equal and returns half the
tangent of these equations; residual and border columns are halved with it. A node turns by a rotation vector psi,
d_n+1 = exp(psi) d_n; its Cayley vector 2 tan(|psi|/2) psi/|psi| lets the conserving step and this one share all updates.

Arrays: q, q_end, q_mid_out, q_end_out, u_out, v_out [12 N]; dphi, theta [3 N]; blocks_out [48 (blocks + 1)], blocks of 6 rows of
8; scratch [*].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.cayley import director_increment
from fastbeam.kernels.algebra.dimensions import Space
from fastbeam.kernels.algebra.vectors import add3, cross, dot, ld3, st3
from fastbeam.kernels.beams.nodes import Bodies, add_bodies, turn_of
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.state import halve
from fastbeam.kernels.terms import advance_nodes, assemble, inner_share, restore, save, scale_residual, spread_nodes

NOW, END, KEPT = 0, 3, 6     # first of three rows of `rates`: velocity, its rate, the method's acceleration


class Alpha(NamedTuple):
    """Data that these methods carry from step to step besides the state."""

    parameters: np.ndarray   # float64 [4]: alpha_m, alpha_f, beta, gamma
    rates: np.ndarray        # float64 [9 * 6 N]: velocity and spin, their rates, the method's acceleration: now, end, kept
    spin_rate: np.ndarray    # float64 [18 N]: half the derivative of d_2'', d_3'' by the spin, three columns each
    factor: np.ndarray       # float64 [2]: d(velocity)/d(displacement), d(acceleration)/d(displacement) of the present step
    units: np.ndarray        # float64 [9]: the three unit vectors


@kernel
def rotation_vector(t):
    """Return psi of a Cayley vector."""
    x = 0.5 * np.sqrt(dot(t, t))
    c = np.arctan(x) / x if x > 1e-3 else 1.0 - x * x / 3.0 + x**4 / 5.0
    return c * t


@kernel
def turn_rate(psi, w):
    """Return d psi for a spin w of the end: (I - 1/2 psi^ + c psi^ psi^) w."""
    n = dot(psi, psi)
    c = 1.0 / 12.0 + n / 720.0
    if n > 1e-3:
        x = 0.5 * np.sqrt(n)
        c = (1.0 - x / np.tan(x)) / n
    y = cross(psi, w)
    return w - 0.5 * y + c * cross(psi, y)


@kernel
def director_rate(alpha, i, d, psi, unit):
    """Return half the derivative of d'' = w' x d + w x (w x d) by the spin `unit` of the end."""
    m = alpha.rates.shape[0] // 9
    w = ld3(alpha.rates, END * m + 6 * i + 3, 1)
    dw = ld3(alpha.rates, (END + 1) * m + 6 * i + 3, 1)
    turn = turn_rate(psi, unit)
    moved = cross(unit, d)
    x = cross(alpha.factor[1] * turn, d) + cross(dw, moved)
    x += cross(alpha.factor[0] * turn, cross(w, d)) + cross(w, cross(alpha.factor[0] * turn, d) + cross(w, moved))
    return 0.5 * x


@kernel
def end_rate(alpha, o, move, h):
    """Form velocity, its rate and the method's acceleration at the end for the displacement `move` of the step."""
    am = alpha.parameters[0]
    af = alpha.parameters[1]
    beta = alpha.parameters[2]
    gamma = alpha.parameters[3]
    m = alpha.rates.shape[0] // 9
    v = ld3(alpha.rates, NOW * m + o, 1)
    dv = ld3(alpha.rates, (NOW + 1) * m + o, 1)
    a = ld3(alpha.rates, (NOW + 2) * m + o, 1)
    a_end = (1.0 / (beta * h * h)) * (move - h * v) - ((0.5 - beta) / beta) * a
    st3(alpha.rates, END * m + o, 1, v + (h * (1.0 - gamma)) * a + (h * gamma) * a_end)
    st3(alpha.rates, (END + 1) * m + o, 1, (1.0 / (1.0 - af)) * ((1.0 - am) * a_end + am * a - af * dv))
    st3(alpha.rates, (END + 2) * m + o, 1, a_end)


@kernel
def spread_end(alpha, q, dphi, theta, h, q_mid_out, q_end_out, u_out):
    """Form coordinates at the end (twice), their second time derivatives u, and the derivatives of those by the spins."""
    am = alpha.parameters[0]
    af = alpha.parameters[1]
    beta = alpha.parameters[2]
    alpha.factor[0] = alpha.parameters[3] / (beta * h)
    alpha.factor[1] = (1.0 - am) / ((1.0 - af) * beta * h * h)
    for i in range(q.shape[0] // 12):
        t, factor = turn_of(theta, i)
        for k in range(12 * i, 12 * i + 12, 3):
            x = ld3(q, k, 1)
            x += director_increment(factor, t, x) if k > 12 * i else ld3(dphi, 3 * i, 1)
            st3(q_end_out, k, 1, x)
            st3(q_mid_out, k, 1, x)
        psi = rotation_vector(t)
        end_rate(alpha, 6 * i, ld3(dphi, 3 * i, 1), h)
        end_rate(alpha, 6 * i + 3, psi, h)
        for k in range(2):
            d = ld3(q_end_out, 12 * i + 6 + 3 * k, 1)
            for c in range(3):
                st3(alpha.spin_rate, 18 * i + 9 * k + 3 * c, 1, director_rate(alpha, i, d, psi, ld3(alpha.units, 3 * c, 1)))
    second_rates(alpha, END, q_end_out, u_out)


@kernel
def second_rates(alpha, row, q, u_out):
    """Form q'' from the rates in rows `row` and `row` + 1."""
    m = alpha.rates.shape[0] // 9
    for i in range(q.shape[0] // 12):
        st3(u_out, 12 * i, 1, ld3(alpha.rates, (row + 1) * m + 6 * i, 1))
        w = ld3(alpha.rates, row * m + 6 * i + 3, 1)
        dw = ld3(alpha.rates, (row + 1) * m + 6 * i + 3, 1)
        for k in range(3, 12, 3):
            d = ld3(q, 12 * i + k, 1)
            st3(u_out, 12 * i + k, 1, cross(dw, d) + cross(w, cross(w, d)))


@kernel
def add_body_rates(alpha, bodies, k, q_end, theta, blocks_out):
    """Add the tangent of the inertia of one body."""
    i = bodies.node[k]
    psi = rotation_vector(ld3(theta, 3 * i, 1))
    ko = 48 * bodies.block[k]
    half = 0.5 * alpha.factor[1]
    for b in range(4):
        for c in range(3):
            unit = ld3(alpha.units, 3 * c, 1)
            for a in range(4):
                m = bodies.inertia[16 * k + 4 * a + b]
                if m != 0.0:
                    x = half * unit
                    if b > 0:
                        x = director_rate(alpha, i, ld3(q_end, 12 * i + 3 * b, 1), psi, unit)
                    column = c if b == 0 else 3 + c
                    if a == 0:
                        add3(blocks_out, ko + column, 8, m * x)
                    else:
                        add3(blocks_out, ko + 24 + column, 8, m * cross(ld3(q_end, 12 * i + 3 * a, 1), x))


@kernel
def keep_rates(alpha, source, target):
    """Copy three rows of the rates."""
    m = alpha.rates.shape[0] // 9
    for k in range(3 * m):
        alpha.rates[target * m + k] = alpha.rates[source * m + k]


@kernel
def finish_alpha(alpha, q_end, q, v_out):
    """Accept a converged step: rows END become rows NOW, velocities of the 12 coordinates from the spins."""
    m = alpha.rates.shape[0] // 9
    keep_rates(alpha, END, NOW)
    for k in range(q.shape[0]):
        q[k] = q_end[k]
    for i in range(q.shape[0] // 12):
        st3(v_out, 12 * i, 1, ld3(alpha.rates, NOW * m + 6 * i, 1))
        w = ld3(alpha.rates, NOW * m + 6 * i + 3, 1)
        for k in range(3, 12, 3):
            st3(v_out, 12 * i + k, 1, cross(w, ld3(q, 12 * i + k, 1)))


# --- as a method of a step ----------------------------------------------------------------------------------------------
@save.register(Alpha)
@kernel
def save_rates(alpha):
    keep_rates(alpha, NOW, KEPT)


@restore.register(Alpha)
@kernel
def restore_rates(alpha):
    keep_rates(alpha, KEPT, NOW)


@spread_nodes.register(Space, Alpha)
@kernel
def spread_to_end(dofs, alpha, state, work, h, first, last):
    """Update all nodes, whatever `first` and `last` are."""
    spread_end(alpha, state.q, work.dphi, work.theta, h, work.q_mid, work.q_end, work.u)


@advance_nodes.register(Space, Alpha)
@kernel
def advance_alpha(dofs, alpha, state, work, h, first, last, scratch):
    """Advance all nodes, whatever `first` and `last` are."""
    spread_end(alpha, state.q, work.dphi, work.theta, h, work.q_mid, work.q_end, work.u)
    finish_alpha(alpha, work.q_end, state.q, state.v)


@scale_residual.register(Alpha)
@kernel
def halve_residual(alpha, system):
    """Halve the residual, because the element loop returns half the tangent; solutions stored of inner nodes are whole ones."""
    halve(system.work.r)


@inner_share.register(Alpha)
@kernel
def half_of_inner(alpha):
    return -0.5


@assemble.register(Bodies, Alpha)
@kernel
def assemble_bodies_alpha(bodies, alpha, system, h):
    work = system.work
    add_bodies(bodies, work.q_mid, work.q_end, work.u, 0.0, work.r, work.blocks)
    for k in range(bodies.node.shape[0]):
        add_body_rates(alpha, bodies, k, work.q_end, work.theta, work.blocks)
