"""Ropes of variable length that a drum pays out or reels in, theory.md (4.24) to (4.28).

A rope is a row of straight segments of equal unstressed length L/N; L is a coordinate of the scene, the x coordinate of the node
of the drum, and rope flows through the nodes between the segments. With k = N - j - x at the place x of segment j, from its upper
to its lower node, and s = (x_b - x_a)/L the velocity of the rope there is

    w = (1 - x) v_a + x v_b + k V s,        V = dL/dt,

and T = sum of 1/2 m w^2 with m = mu L. What is on the drum has the mass rho (total - L), moves with the drum and, along its
circumference, with V. The step keeps T + U exactly: with p = m w

    D(p)/h on the nodes, by 1 - x and x,  -+ k mean(1/L) c on the upper and lower node,  c = (V_0 p_1 + V_1 p_0)/2
    D(p.k s)/h + k c.mean(r)/(L_0 L_1) - mu w_0.w_1/2 on L

Arrays: q, q0, q1, v [12 N]; out [9], of energies [1].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_stiffness
from fastbeam.kernels.algebra.vectors import add3, cross, dot, ld3
from fastbeam.kernels.forces.user_force import FACTOR
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Conserving, Equilibrium, assemble, is_regular, potential_energy

# places of the two Gauss points in a segment
GAUSS = 0.5 / 3.0**0.5


class Winches(NamedTuple):
    """W winches with G segments of rope in all."""

    node: np.ndarray       # int64 [G, 3]: upper and lower end, drum
    row: np.ndarray        # int64 [G, 3]
    block: np.ndarray      # int64 [G, 9]: of all pairs of these
    below: np.ndarray      # float64 [G]: number of segments from this one to the load
    segments: np.ndarray   # float64 [G]: number of segments of its rope
    length: np.ndarray     # float64 [G]: free length at t = 0, m
    origin: np.ndarray     # float64 [G]: coordinate of the drum at t = 0, m
    stiffness: np.ndarray  # float64 [G]: EA, N
    mass: np.ndarray       # float64 [G]: kg/m
    first: np.ndarray      # int64 [W]: the segment at the drum
    total: np.ndarray      # float64 [W]: all rope, m; infinite where the drum has no rope of its own
    stored: np.ndarray     # float64 [W]: kg/m of the rope on the drum
    inertia: np.ndarray    # float64 [W]: moment of inertia of the drum over the square of its radius, kg
    gravity: np.ndarray    # float64 [3]
    work: np.ndarray       # float64 [*]: of one run, as of user forces: the load factor


class Step(NamedTuple):
    """Segment of rope at the start and the end of a step."""

    r0: Any      # vector from the upper to the lower node at the start
    r1: Any
    x: Any       # upper node in the middle
    l0: float    # free length of the whole rope
    l1: float
    rate0: float
    rate1: float
    upper0: Any  # velocities of both nodes
    upper1: Any
    lower0: Any
    lower1: Any
    over: float  # 1/h


class Pull(NamedTuple):
    """Elastic force: `share` times the mean of r, the force `along` on the length, and their derivatives by the end."""

    share: float
    lead: float      # derivative of share along r at the end
    by_length: float  # derivative of share by L
    along: float
    along_lead: float  # derivative of along, along r at the end
    along_by_length: float


@kernel
def free_length(rope, k, q):
    """Return the free length of the rope of segment k, m."""
    return rope.length[k] + (q[12 * rope.node[k, 2]] - rope.origin[k])


@kernel
def mean_stretch(e0, e1):
    """Return the mean of max(e, 0) from e0 to e1, and its derivative by e1."""
    if e0 >= 0.0 and e1 >= 0.0:
        return 0.5 * (e0 + e1), 0.5
    if e0 <= 0.0 and e1 <= 0.0:
        return 0.0, 0.0
    way = abs(e1 - e0)
    e = max(e0, e1)
    mean = 0.5 * e * e / way
    return mean, mean / way if e0 > e1 else (e - mean) / way


@kernel
def pull_of(rope, k, step):
    """Return the discrete gradient of EA max(e, 0)^2/(2 y) in e = l - y and y = L/N: on the length l it is the mean of the force
    over the elongations of the step, however far l and y have gone together."""
    n, ea = rope.segments[k], rope.stiffness[k]
    a, b = dot(step.r0, step.r0)**0.5, dot(step.r1, step.r1)**0.5
    y0, y1 = step.l0 / n, step.l1 / n
    e0, e1 = a - y0, b - y1
    mean, slope = mean_stretch(e0, e1)
    both = a + b
    inverse = 0.5 * ea * (1.0 / y0 + 1.0 / y1)
    product = ea / (y0 * y1)
    tension, by_end = inverse * mean, inverse * slope
    by_rest = -0.5 * ea * mean / (y1 * y1) - by_end
    e0, e1 = max(e0, 0.0), max(e1, 0.0)
    stored = 0.25 * product * (e0 * e0 + e1 * e1)
    share = 2.0 * tension / both
    return Pull(share, (2.0 * by_end - share) / (both * b), 2.0 * by_rest / (both * n), -(tension + stored) / n,
                -(by_end + 0.5 * product * e1) / (n * b), (0.5 * product * e1 + stored / y1 - by_rest) / (n * n))


@kernel
def add_pull(rope, k, step, work):
    """Add elastic forces of a segment."""
    pull = pull_of(rope, k, step)
    mean = 0.5 * (step.r0 + step.r1)
    add3(work.r, 8 * rope.row[k, 1], 1, pull.share * mean)
    add3(work.r, 8 * rope.row[k, 0], 1, -pull.share * mean)
    work.r[8 * rope.row[k, 2]] += pull.along
    for i in range(2):
        side = 1.0 if i == 1 else -1.0
        for j in range(2):
            sign = 1.0 if i == j else -1.0
            add_stiffness(work.blocks, 48 * rope.block[k, 3 * i + j], 0.5 * sign * pull.share, (sign * pull.lead) * mean, step.r1)
        add3(work.blocks, 48 * rope.block[k, 3 * i + 2], 8, (side * pull.by_length) * mean)
        add3(work.blocks, 48 * rope.block[k, 6 + i], 1, (side * pull.along_lead) * step.r1)
    work.blocks[48 * rope.block[k, 8]] += pull.along_by_length


@kernel
def add_weight(rope, k, x, step, work):
    """Add the weight of the half of a segment at the place x in it."""
    mu = 0.5 * rope.mass[k] / rope.segments[k]
    g = rope.work[FACTOR] * ld3(rope.gravity, 0, 1)
    place = step.x + (0.5 * x) * (step.r0 + step.r1)
    for i in range(2):
        share = mu * (x if i == 1 else 1.0 - x)
        add3(work.r, 8 * rope.row[k, i], 1, (-0.5 * share * (step.l0 + step.l1)) * g)
        add3(work.blocks, 48 * rope.block[k, 3 * i + 2], 8, (-0.5 * share) * g)
        add3(work.blocks, 48 * rope.block[k, 6 + i], 1, (-0.5 * share) * g)
    work.r[8 * rope.row[k, 2]] -= mu * dot(g, place)


@kernel
def add_flow(rope, k, x, step, work):
    """Add the inertia of the half of a segment at the place x in it."""
    mu = 0.5 * rope.mass[k] / rope.segments[k]
    kappa = rope.below[k] - x
    over, l0, l1 = step.over, step.l0, step.l1
    s0, s1 = (1.0 / l0) * step.r0, (1.0 / l1) * step.r1
    w0 = (1.0 - x) * step.upper0 + x * step.lower0 + (kappa * step.rate0) * s0
    w1 = (1.0 - x) * step.upper1 + x * step.lower1 + (kappa * step.rate1) * s1
    p0, p1 = (mu * l0) * w0, (mu * l1) * w1
    c = (0.5 * step.rate0) * p1 + (0.5 * step.rate1) * p0
    mean = 0.5 * (step.r0 + step.r1)
    inverse = 0.5 * (1.0 / l0 + 1.0 / l1)
    product = kappa / (l0 * l1)
    work.r[8 * rope.row[k, 2]] += (mu * kappa * over * (dot(w1, step.r1) - dot(w0, step.r0)) + product * dot(c, mean)
                                   - 0.5 * mu * dot(w0, w1))
    # derivatives of w_1 by both nodes and L
    along = kappa * step.rate1 / l1
    by_length = (kappa * 2.0 * over) * s1 - along * s1
    momentum_by_length = (mu * l1) * by_length + mu * w1
    turn = kappa * inverse * 0.5 * step.rate0
    force_by_length = turn * momentum_by_length + (kappa * inverse * over) * p0 - (0.5 * kappa / (l1 * l1)) * c
    y = (mu * kappa * over) * step.r1 + (0.5 * product * step.rate0 * mu * l1) * mean - (0.5 * mu) * w0
    z = (mu * kappa * over) * w1 + (0.5 * product) * c
    for i in range(2):
        side = 1.0 if i == 1 else -1.0
        share = x if i == 1 else 1.0 - x
        add3(work.r, 8 * rope.row[k, i], 1, (share * over) * (p1 - p0) - (side * kappa * inverse) * c)
        for j in range(2):
            by_node = 2.0 * over * (x if j == 1 else 1.0 - x) + (along if j == 1 else -along)
            iso = mu * l1 * by_node * (share * over - side * turn)
            add_stiffness(work.blocks, 48 * rope.block[k, 3 * i + j], iso, 0.0 * mean, mean)
        add3(work.blocks, 48 * rope.block[k, 3 * i + 2], 8, (share * over) * momentum_by_length - side * force_by_length)
        by_node = 2.0 * over * share + side * along
        add3(work.blocks, 48 * rope.block[k, 6 + i], 1, by_node * y + side * z)
    work.blocks[48 * rope.block[k, 8]] += (dot(by_length, y) - product / l1 * dot(c, mean)
                                           + product * (0.5 * step.rate0 * mu * dot(w1, mean) + over * dot(p0, mean)))


@kernel
def step_of(rope, k, q0, q1, system, over):
    """Return segment k from coordinates q0 to q1; over: 1/h, 0 in statics."""
    a, b, drum = rope.node[k, 0], rope.node[k, 1], rope.node[k, 2]
    v, dphi = system.state.v, system.work.dphi
    xa0, xa1 = ld3(q0, 12 * a, 1), ld3(q1, 12 * a, 1)
    va, vb = ld3(v, 12 * a, 1), ld3(v, 12 * b, 1)
    return Step(ld3(q0, 12 * b, 1) - xa0, ld3(q1, 12 * b, 1) - xa1, 0.5 * (xa0 + xa1), free_length(rope, k, q0),
                free_length(rope, k, q1), v[12 * drum], 2.0 * over * dphi[3 * drum] - v[12 * drum],
                va, (2.0 * over) * ld3(dphi, 3 * a, 1) - va, vb, (2.0 * over) * ld3(dphi, 3 * b, 1) - vb, over)


@kernel
def add_store(rope, i, step, work):
    """Add inertia and weight of the rope on the drum, which moves with it, and inertia of the drum itself."""
    k = rope.first[i]
    rho, over = rope.stored[i], step.over
    drum, column, line, corner = 8 * rope.row[k, 2], 48 * rope.block[k, 2], 48 * rope.block[k, 6], 48 * rope.block[k, 8]
    m0 = m1 = 0.0
    if rho > 0.0:
        m0, m1 = rho * (rope.total[i] - step.l0), rho * (rope.total[i] - step.l1)
        g = rope.work[FACTOR] * ld3(rope.gravity, 0, 1)
        add3(work.r, 8 * rope.row[k, 0], 1, over * (m1 * step.upper1 - m0 * step.upper0) - (0.5 * (m0 + m1)) * g)
        work.r[drum] += 0.5 * rho * (dot(step.upper0, step.upper1) + step.rate0 * step.rate1) + rho * dot(g, step.x)
        add_stiffness(work.blocks, 48 * rope.block[k, 0], 2.0 * over * over * m1, 0.0 * g, g)
        add3(work.blocks, column, 8, (-rho * over) * step.upper1 + (0.5 * rho) * g)
        add3(work.blocks, line, 1, (rho * over) * step.upper0 + (0.5 * rho) * g)
    n0, n1 = m0 + rope.inertia[i], m1 + rope.inertia[i]
    work.r[drum] += over * (n1 * step.rate1 - n0 * step.rate0)
    work.blocks[corner] += 2.0 * over * over * n1 + rho * over * (step.rate0 - step.rate1)


@kernel
def add_ropes(rope, q0, q1, system, over):
    """Add all forces over a step of size 1/over; 0: statics."""
    work = system.work
    for k in range(rope.below.shape[0]):
        step = step_of(rope, k, q0, q1, system, over)
        add_pull(rope, k, step, work)
        for half in range(2):
            x = 0.5 - GAUSS if half == 0 else 0.5 + GAUSS
            add_weight(rope, k, x, step, work)
            if over > 0.0 or over < 0.0:
                add_flow(rope, k, x, step, work)
    for i in range(rope.first.shape[0]):
        add_store(rope, i, step_of(rope, rope.first[i], q0, q1, system, over), work)


@assemble.register(Winches, Conserving)
@kernel
def assemble_ropes(rope, method, system, h):
    add_ropes(rope, system.state.q, system.work.q_end, system, 1.0 / h)


@assemble.register(Winches, Equilibrium)
@kernel
def assemble_ropes_at_rest(rope, method, system, h):
    """Add forces with both ends of the step in one shape: the derivative by one of them is half of that of the force."""
    add_ropes(rope, system.work.q_mid, system.work.q_mid, system, 0.0)


@is_regular.register(Winches)
@kernel
def lengths_are_possible(rope, system):
    """Return whether the free length of each rope at the end is above zero, and not above all rope."""
    good = True
    for i in range(rope.first.shape[0]):
        k = rope.first[i]
        middle, start = free_length(rope, k, system.work.q_mid), free_length(rope, k, system.state.q)
        end = 2.0 * middle - start
        good = good and end > 0.0 and end <= rope.total[i]
    return good


# --- read at rows -------------------------------------------------------------------------------------------------------
@potential_energy.register(Winches)
@kernel
def energy_of_ropes(rope, q, dofs, out):
    """Add the elastic energy, without the weight."""
    for k in range(rope.below.shape[0]):
        r = ld3(q, 12 * rope.node[k, 1], 1) - ld3(q, 12 * rope.node[k, 0], 1)
        rest = free_length(rope, k, q) / rope.segments[k]
        e = max(dot(r, r)**0.5 - rest, 0.0)
        out[0] += 0.5 * rope.stiffness[k] * e * e / rest


@kernel
def add_momentum(p, x, out):
    """Add the linear momentum p at x to the momenta."""
    add3(out, 1, 1, p)
    out[7] += dot(p, p)**0.5
    turn = cross(x, p)
    add3(out, 4, 1, turn)
    out[8] += dot(turn, turn)**0.5


@kernel
def motion_of_ropes(rope, q, v, out):
    """Add kinetic energy and momenta to out, at the columns of `energies`."""
    for k in range(rope.below.shape[0]):
        a, b, drum = 12 * rope.node[k, 0], 12 * rope.node[k, 1], 12 * rope.node[k, 2]
        length = free_length(rope, k, q)
        r = ld3(q, b, 1) - ld3(q, a, 1)
        for half in range(2):
            x = 0.5 - GAUSS if half == 0 else 0.5 + GAUSS
            w = (1.0 - x) * ld3(v, a, 1) + x * ld3(v, b, 1) + ((rope.below[k] - x) * v[drum] / length) * r
            p = (0.5 * rope.mass[k] * length / rope.segments[k]) * w
            out[0] += 0.5 * dot(p, w)
            add_momentum(p, ld3(q, a, 1) + x * r, out)
    for i in range(rope.first.shape[0]):
        k = rope.first[i]
        a, drum = 12 * rope.node[k, 0], 12 * rope.node[k, 2]
        m = rope.stored[i] * (rope.total[i] - free_length(rope, k, q)) if rope.stored[i] > 0.0 else 0.0
        w = ld3(v, a, 1)
        out[0] += 0.5 * m * dot(w, w) + 0.5 * (m + rope.inertia[i]) * v[drum] * v[drum]
        add_momentum(m * w, ld3(q, a, 1), out)


@kernel
def weight_of_ropes(rope, q, out):
    """Add the energy of all rope in the gravity of the scene to out[0]."""
    g = ld3(rope.gravity, 0, 1)
    for k in range(rope.below.shape[0]):
        mass = rope.mass[k] * free_length(rope, k, q) / rope.segments[k]
        out[0] -= 0.5 * mass * dot(g, ld3(q, 12 * rope.node[k, 0], 1) + ld3(q, 12 * rope.node[k, 1], 1))
    for i in range(rope.first.shape[0]):
        k = rope.first[i]
        if rope.stored[i] > 0.0:
            mass = rope.stored[i] * (rope.total[i] - free_length(rope, k, q))
            out[0] -= mass * dot(g, ld3(q, 12 * rope.node[k, 0], 1))
