"""Loads that turn with nodes of a plane, theory.md (4.30): laws of `user_force`, called with u, J u and the normal as directors.

A load is F = (a + b J) u times a function of time, and a moment about the normal, with a and b in the parameters. In the middle
of a step u is the mean of both ends, so that dF/dphi at the end is J F_1 / 2 with F_1 of the u there.

Arrays: q0, q1 [4 N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import call_law
from fastbeam.kernels.forces.user_force import FAILED, FOUND, GIVEN, TIME, Laws
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import account, assemble, known, spread_nodes


class PlanarFollowers(NamedTuple):
    """K nodes with a load each, as in `user_force.UserForces`."""

    node: np.ndarray       # int64 [K]
    row: np.ndarray        # int64 [K]
    block: np.ndarray      # int64 [K]: diagonal block
    share: np.ndarray      # float64 [K]: 1, along beams the length that belongs to the node, m
    grows: np.ndarray      # int64 [K]: 1 where it grows with the load factor in statics
    along: np.ndarray      # int64 [K]: 1 along beams, 0 at nodes
    first: np.ndarray      # int64 [K]: first of its parameters
    parameters: np.ndarray  # float64 [6 K]: a, b, 0, 0, 0, moment
    place: np.ndarray      # int64 [1]: where the work stands in the history
    laws: Laws
    work: np.ndarray       # float64 [SIZE]: of one run


@kernel
def evaluate_in_plane(term, k, q0, q1):
    """Store force and moment of node k in the work array."""
    w = term.work
    o = 4 * term.node[k]
    for i in range(18):
        w[GIVEN + i] = 0.0
    for i in range(6):
        w[FOUND + i] = 0.0
    x = 0.5 * (q0[o + 2] + q1[o + 2])
    y = 0.5 * (q0[o + 3] + q1[o + 3])
    w[GIVEN + 3] = x
    w[GIVEN + 4] = y
    w[GIVEN + 6] = -y
    w[GIVEN + 7] = x
    w[GIVEN + 11] = 1.0
    base = w.ctypes.data
    call_law(term.laws.address[k], w[TIME], base + 8 * GIVEN, term.parameters.ctypes.data + 8 * term.first[k], base + 8 * FOUND,
             base + 8 * FAILED)


@assemble.register(PlanarFollowers)
@kernel
def assemble_planar_followers(term, method, system, h):
    work, w = system.work, term.work
    q1 = work.q_end
    for k in range(term.node.shape[0]):
        factor = term.share[k]
        evaluate_in_plane(term, k, system.state.q, q1)
        r = 8 * term.row[k]
        work.r[r] -= factor * w[FOUND]
        work.r[r + 1] -= factor * w[FOUND + 1]
        work.r[r + 2] -= factor * w[FOUND + 5]
        # rotation from the mean u to that of the end, as a complex number
        o = 4 * term.node[k]
        x, y = w[GIVEN + 3], w[GIVEN + 4]
        size = x * x + y * y
        c = (q1[o + 2] * x + q1[o + 3] * y) / size
        s = (q1[o + 3] * x - q1[o + 2] * y) / size
        b = 24 * term.block[k]
        work.blocks[b + 2] += 0.5 * factor * (s * w[FOUND] + c * w[FOUND + 1])
        work.blocks[b + 10] -= 0.5 * factor * (c * w[FOUND] - s * w[FOUND + 1])


@account.register(PlanarFollowers)
@kernel
def account_planar_followers(term, system, h):
    """Record the work F . Dphi + M theta."""
    work, w = system.work, term.work
    for k in range(term.node.shape[0]):
        n = term.node[k]
        # coordinates at the end are still those before the last increment
        spread_nodes.call(system.dofs, system.method, system.state, work, h, n, n + 1)
        evaluate_in_plane(term, k, system.state.q, work.q_end)
        done = w[FOUND] * work.dphi[2 * n] + w[FOUND + 1] * work.dphi[2 * n + 1] + w[FOUND + 5] * work.theta[n]
        system.state.history[term.place[0]] += known(term.share[k] * done)
