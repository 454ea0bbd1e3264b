"""Mass of the fluid that nodes carry along (theory.md (4.34)): residual, tangent and momenta, in space and in a plane.

Arrays: blocks_out [8 n (blocks + 1)].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import (
    Plane,
    Space,
    add_cross,
    add_outer,
    add_stiffness,
    add_to,
    add_turn,
    cayley_vector,
    coordinates,
    cross_product,
    dim,
    on_spin,
    spin_cross,
    vector,
)
from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import Conserving, account, assemble, spread_nodes


class AddedMass(NamedTuple):
    """Table of A nodes with added mass, coefficients of whole nodes."""

    node: np.ndarray     # int64 [A]
    row: np.ndarray      # int64 [A]
    block: np.ndarray    # int64 [A]: diagonal block
    normal: np.ndarray   # float64 [A]: mass across d1, kg
    along: np.ndarray    # float64 [A]: mass along d1 less that across, kg
    place: np.ndarray    # int64 [A]: offset in `State.history` of the momentum along d1 of the mass `along`


class Flow(NamedTuple):
    """Velocity and momentum of a node in a step."""

    velocity: Any     # mean
    before: Any       # d1 at the start
    axis: Any         # d1 at the end
    change: Any       # change of d1
    direction: Any    # direction along which the mean velocity counts
    start: float      # momentum along d1 at the start
    end: float        # momentum along d1 at the end


@kernel
def flow(added, k, system, h):
    """Return the `Flow` of node k in a step, with the momentum along d1 at its end."""
    work, dofs = system.work, system.dofs
    n, d = added.node[k], dim(dofs)
    velocity = (1.0 / h) * vector(work.dphi, d * n, 1, dofs)
    o = coordinates(dofs) * n + d
    mid, axis = vector(work.q_mid, o, 1, dofs), vector(work.q_end, o, 1, dofs)
    change = 2.0 * (axis - mid)
    direction = mid - 0.25 * spin_cross.call(cayley_vector(work.theta, n, dofs), change)
    start = system.state.history[added.place[k]]
    end = start + 2.0 * (added.along[k] * dot(velocity, direction) - start)
    return Flow(velocity, axis - change, axis, change, direction, start, end)


@generic
def add_turned_force(dofs, blocks_out, o, factor, velocity, axis):
    """Add factor times the derivative of velocity x (spin x axis) by the spin."""


@add_turned_force.register(Space)
@kernel
def add_turned_force_in_space(dofs, blocks_out, o, factor, velocity, axis):
    add_stiffness(blocks_out, o, factor * dot(velocity, axis), -factor * axis, velocity)


@add_turned_force.register(Plane)
@kernel
def add_turned_force_in_plane(dofs, blocks_out, o, factor, velocity, axis):
    blocks_out[o] += factor * dot(velocity, axis)


@assemble.register(AddedMass, Conserving)
@kernel
def assemble_added(added, method, system, h):
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    for k in range(added.node.shape[0]):
        x = flow(added, k, system, h)
        n, r = added.node[k], 8 * added.row[k]
        isotropic = 2.0 * added.normal[k] / h
        add_to(work.r, r, 1, isotropic * (x.velocity - vector(system.state.v, coordinates(dofs) * n, 1, dofs))
               + (1.0 / h) * (x.end * x.axis - x.start * x.before))
        mean = 0.5 * (x.end * x.axis + x.start * x.before)
        add_to(work.r, r + d, 1, cross_product.call(x.velocity, mean))
        # derivatives of the momentum at the end by position and by spin
        theta = cayley_vector(work.theta, n, dofs)
        by_position = (2.0 * added.along[k] / h) * x.direction
        by_spin = (2.0 * added.along[k]) * (
            cross_product.call(x.axis, 0.5 * x.velocity + 0.25 * spin_cross.call(theta, x.velocity))
            - 0.25 * on_spin.call(theta, cross_product.call(x.change, x.velocity)))
        o = 8 * len(dofs) * added.block[k]
        add_stiffness(work.blocks, o, isotropic / h, (1.0 / h) * x.axis, by_position)
        add_outer(work.blocks, o + d, 1.0 / h, x.axis, by_spin)
        add_turn(work.blocks, o + d, x.end / h, x.axis)
        over = cross_product.call(x.velocity, x.axis)
        add_cross(work.blocks, o + 8 * d, -1.0 / h, mean)
        add_outer(work.blocks, o + 8 * d, 0.5, over, by_position)
        add_outer(work.blocks, o + 9 * d, 0.5, over, by_spin)
        add_turned_force.call(dofs, work.blocks, o + 9 * d, 0.5 * x.end, x.velocity, x.axis)


@account.register(AddedMass)
@kernel
def account_added(added, system, h):
    for k in range(added.node.shape[0]):
        # update d1 to the last increments
        n = added.node[k]
        spread_nodes.call(system.dofs, system.method, system.state, system.work, h, n, n + 1)
        system.state.history[added.place[k]] = flow(added, k, system, h).end
