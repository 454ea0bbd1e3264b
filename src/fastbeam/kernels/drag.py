"""Drag of nodes in still or moving air (theory.md (4.12)): force, tangent and energy taken, in space and in a plane.

Arrays: blocks_out [8 n (blocks + 1)].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._generic import generic
from .._jit import kernel
from .algebra import add_matrix, add_skew, component0, component1, cross, cross2, dot, outer, perp
from .kinds import Plane, Space, add_stiffness, add_to, coordinates, dim, vector
from .terms import Conserving, account, assemble, put_loads, spread_nodes


class Drag(NamedTuple):
    """D nodes with drag: coefficients of whole nodes, those per length times a length."""

    node: np.ndarray        # int64 [D]
    row: np.ndarray         # int64 [D]
    block: np.ndarray       # int64 [D]: diagonal block
    normal: np.ndarray      # float64 [D]: force over square of the velocity across d1, N s^2/m^2, or of all of it
    tangential: np.ndarray  # float64 [D]: the same along d1
    linear: np.ndarray      # float64 [D]: force over velocity, N s/m
    slender: np.ndarray     # int64 [D]: 1 where d1 counts
    air: np.ndarray         # float64 [3 D], in a plane [2 D]: velocity of the air, m/s
    place: np.ndarray       # int64 [D]: where the energy stands in `State.history`


class AirSchedule(NamedTuple):
    """Air whose velocity changes in time."""

    air: np.ndarray      # float64 [3 D], in a plane [2 D]: as in `Drag`, of this run
    given: np.ndarray    # float64 [3 D], in a plane [2 D]: that of the scene
    part: np.ndarray     # int64 [D]: column of factors
    factors: np.ndarray  # float64 [substeps, drags]: means over every substep


class Flow(NamedTuple):
    """What the air does to a node in a step."""

    direction: Any    # d1 in the middle of the step as a unit vector, or zero
    short: float      # length of d1 there
    along: float      # velocity against the air along it
    across: Any       # and across
    speed: float      # size of that


@put_loads.register(AirSchedule)
@kernel
def put_air(air, system, k):
    d = air.air.shape[0] // air.part.shape[0]
    for i in range(air.air.shape[0]):
        air.air[i] = air.factors[k, air.part[i // d]] * air.given[i]


@kernel
def flow(drag, k, system, h):
    """Mean velocity of the step against the air, split by the direction of the beam."""
    work, dofs = system.work, system.dofs
    n = drag.node[k]
    d = dim(dofs)
    relative = (1.0 / h) * vector(work.dphi, d * n, 1, dofs) - vector(drag.air, d * k, 1, dofs)
    axis = vector(work.q_mid, coordinates(dofs) * n + d, 1, dofs)
    short = dot(axis, axis)**0.5
    axis = (drag.slender[k] / short) * axis
    along = dot(relative, axis)
    across = relative - along * axis
    return Flow(axis, short, along, across, dot(across, across)**0.5)


@kernel
def resistance(drag, k, x):
    """Minus the force on the node."""
    return ((drag.normal[k] * x.speed + drag.linear[k]) * x.across
            + (drag.tangential[k] * abs(x.along) * x.along + drag.linear[k] * x.along) * x.direction)


@generic
def add_spin_columns(dofs, blocks_out, o, x, y, c, axis, direction):
    """x (y . Dd) + c (Dd - direction (direction . Dd)) for the change Dd of d1, `axis` at the end of the step, with a spin."""


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
@kernel
def assemble_drag(drag, method, system, h):
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    for k in range(drag.node.shape[0]):
        x = flow(drag, k, system, h)
        add_to(work.r, 8 * drag.row[k], 1, resistance(drag, k, x))
        o = 8 * len(dofs) * drag.block[k]
        across = drag.normal[k] * x.speed
        along = drag.tangential[k] * abs(x.along)
        over = drag.normal[k] / x.speed if x.speed > 0.0 else 0.0
        # by the velocity
        add_stiffness(work.blocks, o, (across + drag.linear[k]) / h, (over / h) * x.across, x.across)
        if drag.slender[k] != 0:
            mixed = 2.0 * along - across
            add_stiffness(work.blocks, o, 0.0, (mixed / h) * x.direction, x.direction)
            # by the direction; only half of it is at the end of the step
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
        # where the last increments led d1
        n = drag.node[k]
        spread_nodes.call(dofs, system.method, system.state, system.work, h, n, n + 1)
        x = flow(drag, k, system, h)
        history[drag.place[k]] += dot(resistance(drag, k, x), vector(system.work.dphi, d * n, 1, dofs))
