"""Drag of nodes in still or moving air (theory.md (4.12)): force, tangent and energy loss, in space and in a plane. In statics,
with h = 0, only the air moves.

Arrays: blocks_out [8 n (blocks + 1)].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import Plane, Space, add_outer, add_stiffness, add_to, coordinates, dim, vector
from fastbeam.kernels.algebra.vectors import (
    add_matrix,
    add_skew,
    call_law,
    component0,
    component1,
    cross,
    cross2,
    dot,
    ld3,
    outer,
    perp,
)
from fastbeam.kernels.forces.user_force import BASE, FAILED, FOUND, GIVEN, INCREMENT, RATES, TIME, Laws
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import Conserving, Equilibrium, account, assemble, known, put_loads, spread_nodes


class NoWind(NamedTuple):
    """Placeholder for air with the same velocity everywhere."""


class Wind(NamedTuple):
    """User functions for the velocity of the air."""

    laws: Laws              # law of every node; 0: the velocity in `Drag.air`
    first: np.ndarray       # int64 [D]: first of its parameters
    parameters: np.ndarray  # float64 [*]
    work: np.ndarray        # float64 [SIZE]: of one run, as of user forces


class Drag(NamedTuple):
    """D nodes with drag: coefficients of whole nodes, those per length times a length."""

    node: np.ndarray        # int64 [D]
    row: np.ndarray         # int64 [D]
    block: np.ndarray       # int64 [D]: diagonal block
    normal: np.ndarray      # float64 [D]: force over square of the velocity across d1, N s^2/m^2, or of all of it
    tangential: np.ndarray  # float64 [D]: force over square of the velocity along d1, N s^2/m^2
    linear: np.ndarray      # float64 [D]: force over velocity, N s/m
    slender: np.ndarray     # int64 [D]: 1 where d1 counts
    air: np.ndarray         # float64 [3 D], in a plane [2 D]: velocity of the air, m/s
    place: np.ndarray       # int64 [D]: offset of the energy in `State.history`
    wind: Any               # Wind or NoWind


class AirSchedule(NamedTuple):
    """Velocity of the air as a function of time."""

    air: np.ndarray      # float64 [3 D], in a plane [2 D]: `Drag.air` of this run
    given: np.ndarray    # float64 [3 D], in a plane [2 D]: that of the scene
    part: np.ndarray     # int64 [D]: column of factors
    factors: np.ndarray  # float64 [substeps, drags]: means over every substep


class Flow(NamedTuple):
    """Flow of air past a node in a step."""

    direction: Any    # d1 in the middle of the step as a unit vector, or zero
    short: float      # length of d1 there
    along: float      # velocity against the air along d1
    across: Any       # velocity against the air across d1
    speed: float      # size of `across`


@put_loads.register(AirSchedule)
@kernel
def put_air(air, system, k):
    d = air.air.shape[0] // air.part.shape[0]
    for i in range(air.air.shape[0]):
        air.air[i] = air.factors[k, air.part[i // d]] * air.given[i]


@generic
def air_at(wind, drag, k, system):
    """Return the velocity of the air at node k in the middle of the step."""


@air_at.register(NoWind)
@kernel
def air_everywhere(wind, drag, k, system):
    return vector(drag.air, dim(system.dofs) * k, 1, system.dofs)


@air_at.register(Wind)
@kernel
def air_here(wind, drag, k, system):
    w = wind.work
    o = 12 * drag.node[k]
    for i in range(3):
        w[GIVEN + i] = system.work.q_mid[o + i]
        w[FOUND + i] = drag.air[3 * k + i]
    blow(wind, k)
    return ld3(w, FOUND, 1)


@kernel
def blow(wind, k):
    """Return the velocity at the place in the work array; without a function the velocity stored there."""
    w = wind.work
    if wind.laws.address[k] != 0:
        base = w.ctypes.data
        call_law(wind.laws.address[k], w[TIME], base + 8 * GIVEN, wind.parameters.ctypes.data + 8 * wind.first[k],
                 base + 8 * FOUND, base + 8 * FAILED)


@generic
def add_gradient(wind, drag, k, x, across, mixed, over, system):
    """Add to the block of a node the derivative of its drag by its position, due to the gradient of the air velocity."""


@add_gradient.register(NoWind)
@kernel
def add_no_gradient(wind, drag, k, x, across, mixed, over, system):
    pass


@add_gradient.register(Wind)
@kernel
def add_gradient_of_wind(wind, drag, k, x, across, mixed, over, system):
    """Add the gradient by central differences; half a change of the end of the step is in its middle."""
    w = wind.work
    o = 12 * drag.node[k]
    size = INCREMENT * system.length
    if wind.laws.address[k] != 0:
        for c in range(3):
            for i in range(3):
                w[GIVEN + i] = system.work.q_mid[o + i]
                w[FOUND + i] = 0.0
                w[BASE + i] = 1.0 if i == c else 0.0
            w[GIVEN + c] += size
            blow(wind, k)
            for i in range(3):
                w[RATES + i] = w[FOUND + i]
                w[FOUND + i] = 0.0
            w[GIVEN + c] -= 2.0 * size
            blow(wind, k)
            change = (0.25 / size) * (ld3(w, RATES, 1) - ld3(w, FOUND, 1))
            column = ((across + drag.linear[k]) * change + (over * dot(x.across, change)) * x.across
                      + (mixed * dot(x.direction, change)) * x.direction)
            add_outer(system.work.blocks, 48 * drag.block[k], -1.0, column, ld3(w, BASE, 1))


@kernel
def per_step(h):
    """Return 1/h, 0 in statics."""
    return 1.0 / h if h != 0.0 else 0.0


@kernel
def flow(drag, k, system, h):
    """Return the mean velocity of the step against the air, split by the direction of the beam."""
    work, dofs = system.work, system.dofs
    n = drag.node[k]
    d = dim(dofs)
    relative = per_step(h) * vector(work.dphi, d * n, 1, dofs) - air_at.call(drag.wind, drag, k, system)
    axis = vector(work.q_mid, coordinates(dofs) * n + d, 1, dofs)
    short = dot(axis, axis)**0.5
    axis = (drag.slender[k] / short) * axis
    along = dot(relative, axis)
    across = relative - along * axis
    return Flow(axis, short, along, across, dot(across, across)**0.5)


@kernel
def resistance(drag, k, x):
    """Return minus the force on the node."""
    return ((drag.normal[k] * x.speed + drag.linear[k]) * x.across
            + (drag.tangential[k] * abs(x.along) * x.along + drag.linear[k] * x.along) * x.direction)


@generic
def add_spin_columns(dofs, blocks_out, o, x, y, c, axis, direction):
    """Add x (y . Dd) + c (Dd - direction (direction . Dd)) for the change Dd of d1, `axis` at the end of the step, with a
    spin."""


@add_spin_columns.register(Space)
@kernel
def add_spin_columns_in_space(dofs, blocks_out, o, x, y, c, axis, direction):
    columns = outer(x, cross(axis, y)) - outer(c * direction, cross(axis, direction))
    add_matrix(blocks_out, o, 8, 1, add_skew(columns, -c * axis))


@add_spin_columns.register(Plane)
@kernel
def add_spin_columns_in_plane(dofs, blocks_out, o, x, y, c, axis, direction):
    column = cross2(axis, y) * x + c * perp(axis) - (c * cross2(axis, direction)) * direction
    blocks_out[o] += component0(column)
    blocks_out[o + 8] += component1(column)


@assemble.register(Drag, Conserving)
@assemble.register(Drag, Equilibrium)
@kernel
def assemble_drag(drag, method, system, h):
    work, dofs = system.work, system.dofs
    d, rate = dim(dofs), per_step(h)
    for k in range(drag.node.shape[0]):
        x = flow(drag, k, system, h)
        add_to(work.r, 8 * drag.row[k], 1, resistance(drag, k, x))
        o = 8 * len(dofs) * drag.block[k]
        across = drag.normal[k] * x.speed
        along = drag.tangential[k] * abs(x.along)
        over = drag.normal[k] / x.speed if x.speed > 0.0 else 0.0
        # derivatives by the velocity
        add_stiffness(work.blocks, o, rate * (across + drag.linear[k]), (rate * over) * x.across, x.across)
        mixed = drag.slender[k] * (2.0 * along - across)
        add_gradient.call(drag.wind, drag, k, x, across, mixed, over, system)
        if drag.slender[k] != 0:
            add_stiffness(work.blocks, o, 0.0, (rate * mixed) * x.direction, x.direction)
            # derivatives by the direction, half of which is at the end of the step; statics forms half the tangent
            share = 0.5 / x.short
            axis = vector(work.q_end, coordinates(dofs) * drag.node[k] + d, 1, dofs)
            add_spin_columns.call(dofs, work.blocks, o + d, share * (mixed * x.direction - (over * x.along) * x.across), x.across,
                                  share * (along - across) * x.along, axis, x.direction)


@account.register(Drag)
@kernel
def account_drag(drag, system, h):
    dofs, history = system.dofs, system.state.history
    d = dim(dofs)
    for k in range(drag.node.shape[0]):
        # update d1 to the last increments
        n = drag.node[k]
        spread_nodes.call(dofs, system.method, system.state, system.work, h, n, n + 1)
        x = flow(drag, k, system, h)
        history[drag.place[k]] += known(dot(resistance(drag, k, x), vector(system.work.dphi, d * n, 1, dofs)))
