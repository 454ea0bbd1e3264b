"""Forces by functions of the user's own, called through their addresses: another function compiles no kernel again.

The law is evaluated in the middle of the step: time, means of both ends of position and directors, mean velocity and spin; force
and moment are constant over the step, theory.md (4.4). In statics it is evaluated at the present shape; where it grows with the
load factor, this is in the shares of the nodes (`terms.Growing`).

Arrays: q0, q1 [12 N]; w [SIZE], as of `UserForces`.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import add3, call_law, cross, dot, ld3, st3, triple, zero3
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import account, assemble, known, put_loads, spread_nodes

# places in the work array: time, load factor in statics, arguments of a law, force and moment, rates; then data of differences:
# triads, coordinates, force and moment; for force elements the forces on both nodes, twice, and rates of rotation;
# derivatives of the six results of a law by its 18 arguments, and the arguments at which they are taken
TIME, FACTOR, GIVEN, FOUND, BASE, KEPT, WRENCH, OTHER, RATES, SLOPES, ORIGIN = 0, 1, 2, 20, 26, 32, 64, 76, 88, 97, 205
# arguments of code that takes differences: those of the law; 1/h and increments of positions and turns; changes of nine
# components of directors and three of the spin by three turns, [3, 12]; room for 24 numbers, force and moment
DIFFERENCE, STEPS, TURNS, BEFORE = 229, 247, 250, 310
# first law that failed, by returning NaN: address of its parameters, 0 if none has failed; time; its arguments
FAILED, SIZE = 316, 336
# increments of central differences and of one-sided ones, of positions relative to the size of the scene, and of turns
INCREMENT, ONE_SIDED = 1e-6, 1e-7


class Laws(NamedTuple):
    """Addresses of compiled functions (double t, double *given, double *parameters, double *found, double *failed)."""

    address: np.ndarray    # int64 [K]
    slopes: np.ndarray     # int64 [K]: of their derivatives, 0 where these are taken by differences


class UserForces(NamedTuple):
    """K nodes with a law each."""

    node: np.ndarray       # int64 [K]
    row: np.ndarray        # int64 [K]
    block: np.ndarray      # int64 [K]: diagonal block
    share: np.ndarray      # float64 [K]: 1, along beams the length that belongs to the node, m
    grows: np.ndarray      # int64 [K]: 1 where it grows with the load factor in statics
    along: np.ndarray      # int64 [K]: 1 along beams, 0 at nodes
    first: np.ndarray      # int64 [K]: first of its parameters; each part has a place there, which tells whose law failed
    parameters: np.ndarray  # float64 [*]
    place: np.ndarray      # int64 [1]: where the work stands in the history
    laws: Laws
    differences: np.ndarray  # int64 [K]: address of code that takes differences, 0 where the derivative is given
    work: np.ndarray       # float64 [SIZE]: of one run


# an address for kernels, not some eighty words
UserForces.stays_in_memory = True  # type: ignore[attr-defined]


class UserForceTimes(NamedTuple):
    """Times in the middle of every substep, in the tuple of terms ahead of the forces."""

    work: np.ndarray       # float64 [SIZE]
    middle: np.ndarray     # float64 [substeps], s


@put_loads.register(UserForceTimes)
@kernel
def put_time(term, system, k):
    term.work[TIME] = term.middle[k]


@kernel
def evaluate(term, k, q0, q1, h):
    """Evaluate force and moment of node k in the work array."""
    w, o = term.work, 12 * term.node[k]
    over = 1.0 / h if h != 0.0 else 0.0
    st3(w, GIVEN, 1, 0.5 * (ld3(q0, o, 1) + ld3(q1, o, 1)))
    st3(w, GIVEN + 12, 1, over * (ld3(q1, o, 1) - ld3(q0, o, 1)))
    spin = zero3()
    for i in range(3, 12, 3):
        mean, rate = 0.5 * (ld3(q0, o + i, 1) + ld3(q1, o + i, 1)), over * (ld3(q1, o + i, 1) - ld3(q0, o + i, 1))
        st3(w, GIVEN + i, 1, mean)
        spin += 0.5 * cross(mean, rate)
    st3(w, GIVEN + 15, 1, spin)
    st3(w, FOUND, 1, zero3())
    st3(w, FOUND + 3, 1, zero3())
    base = w.ctypes.data
    call_law(term.laws.address[k], w[TIME], base + 8 * GIVEN, term.parameters.ctypes.data + 8 * term.first[k], base + 8 * FOUND,
             base + 8 * FAILED)


@assemble.register(UserForces)
@kernel
def assemble_user_forces(term, method, system, h):
    work, w = system.work, term.work
    for k in range(term.node.shape[0]):
        factor = term.share[k]
        evaluate(term, k, system.state.q, work.q_end, h)
        for i in range(6):
            work.r[8 * term.row[k] + i] -= factor * w[FOUND + i]
        if term.differences[k] != 0:
            add_differences(term, k, factor, system, h)
        else:
            add_slopes(term, k, factor, system, h)


@kernel
def find_slopes(term, k):
    """Form the derivative of law k by its arguments, [6, 18], in the work array."""
    w = term.work
    for i in range(108):
        w[SLOPES + i] = 0.0
    base = w.ctypes.data
    call_law(term.laws.slopes[k], w[TIME], base + 8 * GIVEN, term.parameters.ctypes.data + 8 * term.first[k], base + 8 * SLOPES,
             base + 8 * FAILED)


@kernel
def add_slopes(term, k, factor, system, h):
    """Add the derivative by the end of the step, from that of the law: position and directors enter as means of both ends. A turn
    e of the end changes directors d there by e x d, and the spin, half the sum of D x r with their means D and rates r."""
    work, w = system.work, term.work
    q0, q1, o = system.state.q, work.q_end, 12 * term.node[k]
    over = 1.0 / h if h != 0.0 else 0.0
    find_slopes(term, k)
    for i in range(6):
        s, to = SLOPES + 18 * i, 48 * term.block[k] + 8 * i
        add3(work.blocks, to, 1, -factor * (0.5 * ld3(w, s, 1) + over * ld3(w, s + 12, 1)))
        by_spin = ld3(w, s + 15, 1)
        turn = zero3()
        for d in range(3, 12, 3):
            turn += 0.5 * cross(ld3(q1, o + d, 1), ld3(w, s + d, 1))
        if dot(by_spin, by_spin) != 0.0:
            for d in range(3, 12, 3):
                rate = over * (ld3(q1, o + d, 1) - ld3(q0, o + d, 1))
                arm = 0.25 * cross(rate, by_spin) + (0.5 * over) * cross(by_spin, ld3(w, GIVEN + d, 1))
                turn += cross(ld3(q1, o + d, 1), arm)
        add3(work.blocks, to + 3, 1, -factor * turn)


@kernel
def turned(w, q0, q1, o, d, over, c):
    """Return changes of the mean of director d, and of the spin, by turn c of the end of the step."""
    unit = triple(1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
    change = cross(unit, ld3(q1, o + d, 1))
    rate = over * (ld3(q1, o + d, 1) - ld3(q0, o + d, 1))
    return 0.5 * change, 0.25 * cross(change, rate) + (0.5 * over) * cross(ld3(w, GIVEN + d, 1), change)


@kernel
def add_differences(term, k, factor, system, h):
    """Add the derivative by the end of the step, by differences. In time, where inertia is the larger part of a tangent, they are
    one-sided, which takes half as many evaluations."""
    work, w = system.work, term.work
    q0, q1, o = system.state.q, work.q_end, 12 * term.node[k]
    over = 1.0 / h if h != 0.0 else 0.0
    for i in range(18):
        w[DIFFERENCE + i] = w[GIVEN + i]
    for i in range(6):
        w[BEFORE + i] = w[FOUND + i]
    size = ONE_SIDED if h != 0.0 else INCREMENT
    w[STEPS] = over
    w[STEPS + 1] = size * system.length
    w[STEPS + 2] = size
    for c in range(3):
        spin = zero3()
        for d in range(3, 12, 3):
            mean, more = turned(w, q0, q1, o, d, over, c)
            st3(w, TURNS + 12 * c + d - 3, 1, mean)
            spin += more
        st3(w, TURNS + 12 * c + 9, 1, spin)
    base = w.ctypes.data
    call_law(term.differences[k], w[TIME], base + 8 * DIFFERENCE, term.parameters.ctypes.data + 8 * term.first[k],
             base + 8 * SLOPES, base + 8 * FAILED)
    for i in range(6):
        for c in range(6):
            work.blocks[48 * term.block[k] + 8 * i + c] -= factor * w[SLOPES + 6 * i + c]


@account.register(UserForces)
@kernel
def account_user_forces(term, system, h):
    """Record the work F . Dphi + M . theta."""
    work, w = system.work, term.work
    for k in range(term.node.shape[0]):
        n = term.node[k]
        # coordinates at the end are still those before the last increment
        spread_nodes.call(system.dofs, system.method, system.state, work, h, n, n + 1)
        evaluate(term, k, system.state.q, work.q_end, h)
        total = 0.0
        for i in range(3):
            total += w[FOUND + i] * work.dphi[3 * n + i] + w[FOUND + 3 + i] * work.theta[3 * n + i]
        system.state.history[term.place[0]] += known(term.share[k] * total)
