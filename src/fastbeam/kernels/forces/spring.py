"""Linear springs between two points.

    U = 1/2 k (l - L)^2,   l = |x_b - x_a|

The conserving step takes the discrete gradient (U_n+1 - U_n)/(l_n+1^2 - l_n^2) times the derivative of l^2 at the mean shape,
for this energy k (1 - 2 L/(l_n + l_n+1)) (r_n + r_n+1)/2 with r = x_b - x_a: energy and both momenta are kept (Gonzalez 1996).
All other methods evaluate k (1 - L/l) r at one shape.

Arrays: q [12 N], in a plane [4 N]; out [1].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.entries.pairs import add_pair, difference
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Conserving, assemble, potential_energy


class Springs(NamedTuple):
    """Springs between nodes a and b, L of them."""

    node: np.ndarray       # int64 [L, 2]
    row: np.ndarray        # int64 [L, 2]
    block: np.ndarray      # int64 [L, 4]: a-a, a-b, b-a, b-b
    stiffness: np.ndarray  # float64 [L], N/m
    length: np.ndarray     # float64 [L]: without force, m


@assemble.register(Springs, Conserving)
@kernel
def assemble_springs(springs, method, system, h):
    work, dofs = system.work, system.dofs
    for k in range(springs.stiffness.shape[0]):
        start = difference(springs, k, system.state.q, dofs)
        end = difference(springs, k, work.q_end, dofs)
        mean = difference(springs, k, work.q_mid, dofs)
        c = springs.stiffness[k]
        rest = springs.length[k]
        share = 0.0
        if rest > 0.0:
            after = dot(end, end)**0.5
            both = dot(start, start)**0.5 + after
            share = 2.0 * rest / both
            add_pair(springs, k, 0.0 * mean, 0.0, (c * share / (both * after)) * mean, end, work, dofs)
        add_pair(springs, k, (c * (1.0 - share)) * mean, 0.5 * c * (1.0 - share), 0.0 * mean, end, work, dofs)


@assemble.register(Springs)
@kernel
def assemble_springs_at_once(springs, method, system, h):
    """Add the force at one shape and half its derivative."""
    work, dofs = system.work, system.dofs
    for k in range(springs.stiffness.shape[0]):
        r = difference(springs, k, work.q_mid, dofs)
        c = springs.stiffness[k]
        rest = springs.length[k]
        share = 0.0
        if rest > 0.0:
            square = dot(r, r)
            share = rest / square**0.5
            add_pair(springs, k, 0.0 * r, 0.0, (0.5 * c * share / square) * r, r, work, dofs)
        add_pair(springs, k, (c * (1.0 - share)) * r, 0.5 * c * (1.0 - share), 0.0 * r, r, work, dofs)


@potential_energy.register(Springs)
@kernel
def energy_of_springs(springs, q, dofs, out):
    for k in range(springs.stiffness.shape[0]):
        r = difference(springs, k, q, dofs)
        out[0] += 0.5 * springs.stiffness[k] * (dot(r, r)**0.5 - springs.length[k])**2
