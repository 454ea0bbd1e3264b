"""Springs between two points with any law of their elongation, slack ones and dampers, theory.md (4.18), (4.19).

The force f(e) of the elongation e = l - L is a polynomial of degree 3 at most in each of a few pieces. The conserving step takes
the mean of f over the elongations of the step,

    D = 1/(e_n+1 - e_n) int f de = int_0^1 f(e_n + t (e_n+1 - e_n)) dt,

exact by two points of Gauss in each piece, without a division by the elongation. With a damper c Dl/h it acts along the mean r =
x_b - x_a as the force 2 (D + c Dl/h)/(l_n + l_n+1) (r_n + r_n+1)/2, whose work is the change of the energy and c Dl^2/h.

Arrays: q [12 N], in a plane [4 N]; out [1].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.entries.pairs import add_pair, difference
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Conserving, account, assemble, potential_energy, spread_nodes

# places of Gauss points of the interval 0 to 1: 1/2 -+ this
GAUSS = 0.5 / 3.0**0.5


class SpringLaws(NamedTuple):
    """L springs between nodes a and b, P pieces of their laws in all."""

    node: np.ndarray      # int64 [L, 2]
    row: np.ndarray       # int64 [L, 2]
    block: np.ndarray     # int64 [L, 4]: a-a, a-b, b-a, b-b
    length: np.ndarray    # float64 [L]: length without elongation, m
    damping: np.ndarray   # float64 [L], N s/m
    side: np.ndarray      # int64 [L]: 1: damps while longer than `length`, -1: shorter, 0: always
    place: np.ndarray     # int64 [L]: offset of the loss in the history, -1: no damping
    first: np.ndarray     # int64 [L + 1]: pieces of every spring
    begin: np.ndarray     # float64 [P]: elongation where a piece begins, -inf for the first of a spring, m
    origin: np.ndarray    # float64 [P]: elongation from which its polynomial counts, m
    energy: np.ndarray    # float64 [P]: energy at the origin of the piece, J
    force: np.ndarray     # float64 [4 P]: coefficients of the force, N, N/m, ...


@kernel
def piece_at(laws, k, e):
    """Return the piece of spring k that elongation e lies in."""
    lo = laws.first[k]
    hi = laws.first[k + 1] - 1
    while lo < hi:
        middle = (lo + hi + 1) // 2
        if laws.begin[middle] <= e:
            lo = middle
        else:
            hi = middle - 1
    return lo


@kernel
def force_in(laws, j, e):
    """Return force and stiffness at elongation e by the polynomial of piece j."""
    x = e - laws.origin[j]
    c1, c2, c3 = laws.force[4 * j + 1], laws.force[4 * j + 2], laws.force[4 * j + 3]
    return laws.force[4 * j] + x * (c1 + x * (c2 + x * c3)), c1 + x * (2.0 * c2 + x * 3.0 * c3)


@kernel
def share_of(laws, j, e0, way, t0, t1):
    """Return the contribution of piece j to (int f dt, int t f' dt) from t0 to t1, with e = e0 + t way."""
    middle, half = 0.5 * (t0 + t1), GAUSS * (t1 - t0)
    ta, tb = middle - half, middle + half
    fa, ka = force_in(laws, j, e0 + ta * way)
    fb, kb = force_in(laws, j, e0 + tb * way)
    weight = 0.5 * (t1 - t0)
    return weight * (fa + fb), weight * (ta * ka + tb * kb)


@kernel
def mean_force(laws, k, e0, e1):
    """Return the mean of the force over the elongations from e0 to e1, and its derivative by e1."""
    way = e1 - e0
    j = piece_at(laws, k, e0)
    last = piece_at(laws, k, e1)
    force = 0.0
    slope = 0.0
    t = 0.0
    while j != last:
        # the border of the next piece lies between e0 and e1, so that e1 - e0 is not zero
        border = laws.begin[j + 1] if last > j else laws.begin[j]
        until = min(max((border - e0) / way, t), 1.0)
        df, dk = share_of(laws, j, e0, way, t, until)
        force += df
        slope += dk
        t = until
        j += 1 if last > j else -1
    df, dk = share_of(laws, j, e0, way, t, 1.0)
    return force + df, slope + dk


@kernel
def damped_way(laws, k, e0, e1):
    """Return the part of the elongation from e0 to e1 on which the damper of spring k acts, m, this as a share, and its
    derivative by e1."""
    s = laws.side[k]
    before, after = s * e0 >= 0.0, s * e1 >= 0.0
    if before and after:
        return e1 - e0, 1.0, 1.0
    if before:
        return -e0, -e0 / (e1 - e0), 0.0
    if after:
        return e1, e1 / (e1 - e0), 1.0
    return 0.0, 0.0, 0.0


@kernel
def damping_force(laws, k, e0, e1, h):
    """Return the mean force of the damper over a step, and its derivative by e1."""
    if laws.damping[k] == 0.0:
        return 0.0, 0.0
    c = laws.damping[k] / h
    way, share, moves = damped_way(laws, k, e0, e1)
    return c * way * share, c * share * (2.0 * moves - share)


@assemble.register(SpringLaws, Conserving)
@kernel
def assemble_laws(laws, method, system, h):
    work, dofs = system.work, system.dofs
    for k in range(laws.length.shape[0]):
        start = difference(laws, k, system.state.q, dofs)
        end = difference(laws, k, work.q_end, dofs)
        mean = difference(laws, k, work.q_mid, dofs)
        before, after = dot(start, start)**0.5, dot(end, end)**0.5
        e0, e1 = before - laws.length[k], after - laws.length[k]
        force, slope = mean_force(laws, k, e0, e1)
        viscous, steeper = damping_force(laws, k, e0, e1, h)
        both = before + after
        if both > 0.0:
            share = 2.0 * (force + viscous) / both
            lead = (2.0 * (slope + steeper) - share) / both
            lead = lead / after if after > 0.0 else 0.0
            add_pair(laws, k, 0.0 * mean, 0.0, lead * mean, end, work, dofs)
        else:
            # both ends in one point: use the limit of short lengths
            share = 2.0 * (slope + steeper)
        add_pair(laws, k, share * mean, 0.5 * share, 0.0 * mean, end, work, dofs)


@assemble.register(SpringLaws)
@kernel
def assemble_laws_at_once(laws, method, system, h):
    """Add the force at one shape and half its derivative; no dampers."""
    work, dofs = system.work, system.dofs
    for k in range(laws.length.shape[0]):
        r = difference(laws, k, work.q_mid, dofs)
        square = dot(r, r)
        l = square**0.5
        e = l - laws.length[k]
        force, slope = force_in(laws, piece_at(laws, k, e), e)
        share = force / l if l > 0.0 else slope
        if l > 0.0:
            add_pair(laws, k, 0.0 * r, 0.0, (0.5 * (slope - share) / square) * r, r, work, dofs)
        add_pair(laws, k, share * r, 0.5 * share, 0.0 * r, r, work, dofs)


@account.register(SpringLaws)
@kernel
def account_laws(laws, system, h):
    """Record the loss by dampers."""
    state, work, dofs = system.state, system.work, system.dofs
    for k in range(laws.length.shape[0]):
        if laws.place[k] >= 0:
            for side in range(2):
                # update the nodes to the last increment
                node = laws.node[k, side]
                spread_nodes.call(dofs, system.method, state, work, h, node, node + 1)
            start = difference(laws, k, state.q, dofs)
            end = difference(laws, k, work.q_end, dofs)
            e0, e1 = dot(start, start)**0.5 - laws.length[k], dot(end, end)**0.5 - laws.length[k]
            way = damped_way(laws, k, e0, e1)[0]
            state.history[laws.place[k]] += laws.damping[k] * way * way / h


@potential_energy.register(SpringLaws)
@kernel
def energy_of_laws(laws, q, dofs, out):
    for k in range(laws.length.shape[0]):
        r = difference(laws, k, q, dofs)
        e = dot(r, r)**0.5 - laws.length[k]
        j = piece_at(laws, k, e)
        x = e - laws.origin[j]
        c1, c2, c3 = laws.force[4 * j + 1], laws.force[4 * j + 2], laws.force[4 * j + 3]
        out[0] += laws.energy[j] + x * (laws.force[4 * j] + x * (c1 / 2.0 + x * (c2 / 3.0 + x * c3 / 4.0)))
