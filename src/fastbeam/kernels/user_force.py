"""Forces by functions of the user's own, called through their addresses: another function compiles no kernel again.

The law is evaluated in the middle of the step: time, means of both ends of position and directors, mean velocity and spin; force
and moment are constant over the step, theory.md (4.4). In statics it is evaluated at the present shape and scaled by the load
factor.

Arrays: q0, q1 [12 N]; turn [9].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .algebra import call_force
from .terms import account, assemble, put_loads, spread_nodes

# places in the work array: time, factor of the loads, what a law is given, force and moment, rates; then what differences keep:
# triads, coordinates, force and moment; of force elements what acts on both nodes, twice, and rates of their rotation; slopes of
# the six numbers that a law finds by the 18 that it is given, and where these are taken
TIME, FACTOR, GIVEN, FOUND, BASE, KEPT, WRENCH, OTHER, RATES, SLOPES, ORIGIN, SIZE = 0, 1, 2, 20, 26, 32, 64, 76, 88, 97, 205, 229
# increments of differences, of positions relative to the size of the scene, and of turns
INCREMENT = 1e-6


class Laws(NamedTuple):
    """Addresses of compiled functions (double t, double *given, double *parameters, double *found)."""

    address: np.ndarray    # int64 [K]
    slopes: np.ndarray     # int64 [K]: of their derivatives, 0 where these are taken by differences


class UserForces(NamedTuple):
    """K nodes with a law each."""

    node: np.ndarray       # int64 [K]
    row: np.ndarray        # int64 [K]
    block: np.ndarray      # int64 [K]: diagonal block
    share: np.ndarray      # float64 [K]: 1, along beams the length that belongs to the node, m
    first: np.ndarray      # int64 [K]: first of its parameters
    parameters: np.ndarray  # float64 [*]
    place: np.ndarray      # int64 [1]: where the work stands in the history
    laws: Laws
    work: np.ndarray       # float64 [SIZE]: of one run


class UserForceTimes(NamedTuple):
    """Times in the middle of every substep, in the tuple of terms ahead of the forces."""

    work: np.ndarray       # float64 [SIZE]
    middle: np.ndarray     # float64 [substeps], s


@put_loads.register(UserForceTimes)
@kernel
def put_time(term, system, k):
    term.work[TIME] = term.middle[k]


@kernel
def give(term, c, k, q0, q1, h):
    """Means and rates of coordinate triple c of node k between both ends."""
    o = 12 * term.node[k] + 3 * c
    over = 1.0 / h if h != 0.0 else 0.0
    for i in range(3):
        term.work[GIVEN + 3 * c + i] = 0.5 * (q0[o + i] + q1[o + i])
        term.work[BASE + i] = over * (q1[o + i] - q0[o + i])


@kernel
def evaluate(term, k, q0, q1, h):
    """Force and moment of node k into the work array."""
    w = term.work
    for i in range(6):
        w[GIVEN + 12 + i] = 0.0
        w[FOUND + i] = 0.0
    give(term, 0, k, q0, q1, h)
    for i in range(3):
        w[GIVEN + 12 + i] = w[BASE + i]
    for c in range(1, 4):
        give(term, c, k, q0, q1, h)
        for i in range(3):
            a = GIVEN + 3 * c + (i + 1) % 3
            b = GIVEN + 3 * c + (i + 2) % 3
            w[GIVEN + 15 + i] += 0.5 * (w[a] * w[BASE + (i + 2) % 3] - w[b] * w[BASE + (i + 1) % 3])
    base = w.ctypes.data
    call_force(term.laws.address[k], w[TIME], base + 8 * GIVEN, term.parameters.ctypes.data + 8 * term.first[k], base + 8 * FOUND)


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


@assemble.register(UserForces)
@kernel
def assemble_user_forces(term, method, system, h):
    work, w = system.work, term.work
    for k in range(term.node.shape[0]):
        factor = term.share[k] * w[FACTOR]
        evaluate(term, k, system.state.q, work.q_end, h)
        for i in range(6):
            work.r[8 * term.row[k] + i] -= factor * w[FOUND + i]
        if term.laws.slopes[k] == 0:
            add_differences(term, k, factor, system, h)
        else:
            add_slopes(term, k, factor, system, h)


@kernel
def find_slopes(term, k):
    """The derivative of law k by what it was given, [6, 18] into the work array."""
    w = term.work
    for i in range(108):
        w[SLOPES + i] = 0.0
    base = w.ctypes.data
    call_force(term.laws.slopes[k], w[TIME], base + 8 * GIVEN, term.parameters.ctypes.data + 8 * term.first[k], base + 8 * SLOPES)


@kernel
def add_slopes(term, k, factor, system, h):
    """The derivative by the end of the step, from that of the law: position and directors enter as means of both ends, the spin
    is half the sum of D_a x (d_a at the end - d_a at the start) / h."""
    work, w = system.work, term.work
    q0, q1, o = system.state.q, work.q_end, 12 * term.node[k]
    over = 1.0 / h if h != 0.0 else 0.0
    find_slopes(term, k)
    for i in range(6):
        s = SLOPES + 18 * i
        to = 48 * term.block[k] + 8 * i
        for c in range(3):
            change = 0.5 * w[s + c] + over * w[s + 12 + c]
            # d_a at the end changes by e_c x d_a, of which components n and m = c + 1, c + 2 are -d_m and d_n
            n, m = (c + 1) % 3, (c + 2) % 3
            turn = 0.0
            for a in range(3):
                p = o + 3 + 3 * a
                x, y = -q1[p + m], q1[p + n]
                turn += 0.5 * (w[s + 3 + 3 * a + n] * x + w[s + 3 + 3 * a + m] * y)
                # of the spin, twice: (e_c x d_a) / 2 x the rate of d_a, and D_a x (e_c x d_a) / h
                r, u, v = over * (q1[p + c] - q0[p + c]), over * (q1[p + n] - q0[p + n]), over * (q1[p + m] - q0[p + m])
                d, e, f = (w[GIVEN + 3 + 3 * a + c], w[GIVEN + 3 + 3 * a + n], w[GIVEN + 3 + 3 * a + m])
                turn += 0.5 * (w[s + 15 + c] * (0.5 * (x * v - y * u) + over * (e * y - f * x))
                               + w[s + 15 + n] * (0.5 * y * r - over * d * y) + w[s + 15 + m] * (over * d * x - 0.5 * x * r))
            work.blocks[to + c] -= factor * change
            work.blocks[to + 3 + c] -= factor * turn


@kernel
def add_differences(term, k, factor, system, h):
    """The derivative by the end of the step, by central differences."""
    work, w = system.work, term.work
    q1, o, turn = work.q_end, 12 * term.node[k], term.work[KEPT:]
    for j in range(12):
        turn[9 + j] = q1[o + j]
    for j in range(9):
        turn[j] = q1[o + 3 + j]
    for c in range(6):
        size = INCREMENT * (system.length if c < 3 else 1.0)
        displace(q1, o, c, size, turn)
        evaluate(term, k, system.state.q, q1, h)
        for i in range(6):
            turn[21 + i] = w[FOUND + i]
        for j in range(12):
            q1[o + j] = turn[9 + j]
        displace(q1, o, c, -size, turn)
        evaluate(term, k, system.state.q, q1, h)
        for j in range(12):
            q1[o + j] = turn[9 + j]
        for i in range(6):
            work.blocks[48 * term.block[k] + 8 * i + c] -= factor * (turn[21 + i] - w[FOUND + i]) / (2.0 * size)


@account.register(UserForces)
@kernel
def account_user_forces(term, system, h):
    """F . Dphi + M . theta."""
    work, w = system.work, term.work
    for k in range(term.node.shape[0]):
        n = term.node[k]
        # coordinates at the end are still those before the last increment
        spread_nodes.call(system.dofs, system.method, system.state, work, h, n, n + 1)
        evaluate(term, k, system.state.q, work.q_end, h)
        total = 0.0
        for i in range(3):
            total += w[FOUND + i] * work.dphi[3 * n + i] + w[FOUND + 3 + i] * work.theta[3 * n + i]
        system.state.history[term.place[0]] += term.share[k] * w[FACTOR] * total
