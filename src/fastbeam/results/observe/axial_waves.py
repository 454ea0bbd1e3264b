"""Waves along beams that impacts on rigid stops send out (theory.md 5.6): what a step has to resolve."""
from __future__ import annotations

import math

import numpy as np

from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.layout import CONSTANTS, LIST, NODES, POINTS, layout_of
from fastbeam.kernels.state import State
from fastbeam.model.mapping import shapes_at
from fastbeam.model.maps import tie_map
from fastbeam.model.model import Model

Array = np.ndarray


def braking_time(model: Model, state: State, k: int) -> float:
    """Return the time in which a wave along the beam takes the momentum of the body that slider k
    carries, m / sqrt(EA rhoA), s; infinite without a body or a beam, or where supports hold either."""
    is_free = model.fixed_in(state) & 7 != 7
    if model.moving is not None and k in model.moving.sliders:
        table, point = model.moving.table_of(k), int(model.sliders.point[k])
        mass = _mass(model, point, is_free)
        return mass / math.sqrt(table.stiffness[0, 0] * table.rho[0]) if mass > 0.0 and table.rho[0] > 0.0 else math.inf
    if model.sliders is None:
        return math.inf
    nodes = shapes_at(model, k, float(state.s[k]))[0]
    nodes = nodes[is_free[nodes]]
    mass = _mass(model, int(model.sliders.point[k]), is_free)
    resistance = _resistance(model, nodes) if mass > 0.0 and nodes.size else 0.0
    return mass / resistance if resistance > 0.0 else math.inf


def _mass(model: Model, node: int, is_free: Array) -> float:
    """Return the mass of the bodies that carry a node, kg; 0 without bodies, or where a support holds one."""
    carriers = np.unique(tie_map(model)[12 * node].indices // 12)
    if model.bodies is None or not is_free[carriers].all():
        return 0.0
    of = np.isin(model.bodies.node, carriers)
    return float(np.sum(model.bodies.inertia.reshape(-1, 16)[of, 0]))


def _resistance(model: Model, nodes: Array) -> float:
    """Return sqrt(EA rhoA) of the stiffest element at some nodes, kg/s; 0 without."""
    found, lanes = 0.0, np.arange(8)
    for tables in (model.simo, model.green):
        shapes = np.zeros((0, 2), int) if tables is None else np.unique(tables.meta[:, [NODES, POINTS]], axis=0)
        for nn, points in shapes.tolist():
            meta = tables.meta[np.all(tables.meta[:, [NODES, POINTS]] == (nn, points), axis=1)]
            at = meta[:, LIST][:, None, None] + 8 * np.arange(nn)[:, None] + lanes
            here = np.isin(tables.nodes[at], nodes).any(axis=1) & (tables.rows[at[:, 0]] != model.n_nodes)
            stiff = meta[:, CONSTANTS][:, None] + lanes
            dense = stiff + layout_of(SPACE, nn, points).inertia
            found = max(found, float(np.max(tables.tab[stiff][here] * tables.tab[dense][here], initial=0.0)))
    return math.sqrt(found)
