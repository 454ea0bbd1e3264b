"""Packs beams into the lane tables of the element kernels: groups of 8 elements, each constant next to where it is used."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .basis import Basis, CurveBasis
from .kernels.beam import ElementTables, group_table_size
from .kernels.inner import Inner, store_size
from .kernels.slider import Curves
from .scene import Beam

Array = np.ndarray


def reference_strains(beam: Beam, phi: Array, d: Array) -> Array:
    """Quadratic part of the six strains in the reference configuration, [n_elements, nq, 6]; what the kernels subtract, so that
    any initial shape is free of stress (theory.md 2)."""
    basis = beam.basis
    nodes = basis.element_nodes
    f = np.einsum("egn,enc->egc", basis.phi_s, phi[nodes])
    d_g = np.einsum("egn,enkc->egkc", basis.dir, d[nodes])
    k_g = np.einsum("egn,enkc->egkc", basis.dir_s, d[nodes])
    d1, d2, d3 = d_g[:, :, 0], d_g[:, :, 1], d_g[:, :, 2]
    k1, k2, k3 = k_g[:, :, 0], k_g[:, :, 1], k_g[:, :, 2]

    def dot(a: Array, b: Array) -> Array:
        return np.einsum("egc,egc->eg", a, b)

    twist = 0.5 * (dot(k2, d3) - dot(k3, d2))
    if beam.strain == "simo_reissner":
        e = [dot(f, d1), dot(f, d2), dot(f, d3), twist, 0.5 * (dot(k3, d1) - dot(k1, d3)), 0.5 * (dot(k1, d2) - dot(k2, d1))]
    else:
        e = [0.5 * dot(f, f), dot(f, d2), dot(f, d3), twist, dot(f, k3), -dot(f, k2)]
    return np.stack(e, axis=-1)


@dataclass
class ElementPacker:
    """Collects the elements of one strain set."""

    meta: list[Array] = field(default_factory=list)
    tab: list[Array] = field(default_factory=list)
    nodes: list[Array] = field(default_factory=list)
    n_tab: int = 0
    n_nodes: int = 0
    n_blocks: int = 0

    def add(self, beam: Beam, first: int, phi: Array, d: Array) -> None:
        """Append all elements of a beam whose nodes start at `first`; phi [n, 3], d [n, 3, 3]: its reference nodes."""
        basis: Basis = beam.basis
        ne, nq, nn = basis.phi_s.shape
        groups = -(-ne // 8)
        # idle lanes of the last group repeat its last element
        lane = np.minimum(np.arange(8 * groups), ne - 1)
        section = beam.section
        e0 = reference_strains(beam, phi, d)
        rho_a, rho_i2, rho_i3 = section.inertia
        shapes = np.stack((basis.phi_s, basis.dir, basis.dir_s), axis=-1).reshape(ne, nq, -1)
        per_point = np.concatenate((basis.weight[:, :, None], shapes, e0), axis=2)
        inertia = np.broadcast_to([rho_a, rho_i2, rho_i3], (ne, 3))
        stiffness = np.broadcast_to(section.C.reshape(-1), (ne, 36))
        flat = np.concatenate((stiffness, per_point.reshape(ne, -1), inertia, basis.mass_phi.reshape(ne, -1),
                               basis.mass_dir.reshape(ne, -1)), axis=1)
        lanes = flat[lane].reshape(groups, 8, -1).transpose(0, 2, 1).reshape(groups, -1)
        size = group_table_size(nn, nq)
        assert lanes.shape[1] == size
        k = np.arange(groups)
        self.meta.append(np.stack((np.full(groups, nn), np.full(groups, nq), self.n_tab + size * k, self.n_nodes + 8 * nn * k,
                                   self.n_blocks + 8 * nn * nn * k, np.full(groups, int(not section.is_diagonal)),
                                   np.full(groups, -1)), axis=1))
        self.tab.append(lanes.reshape(-1))
        nodes = (first + basis.element_nodes)[lane].reshape(groups, 8, nn)
        idle = (np.arange(8 * groups) >= ne).reshape(groups, 8)
        self.nodes.append(np.stack((nodes, np.where(idle[:, :, None], -1, nodes)), axis=-1).transpose(0, 2, 1, 3).reshape(-1, 2))
        self.n_tab += groups * size
        self.n_nodes += 8 * nn * groups
        self.n_blocks += 8 * nn * nn * groups

    def lanes(self) -> Any:
        """(meta [groups, 7], nodes [groups, nn, 8] with -1 in idle lanes) of every beam."""
        for meta, nodes in zip(self.meta, self.nodes):
            yield meta, nodes[:, 1].reshape(len(meta), -1, 8)

    def eliminate(self, eligible: Array, offset: int) -> int:
        """Have the inner nodes of groups eliminated where all of them are eligible, bool [N + 1]; `offset`: where their factors
        begin. Returns where they end."""
        for meta, live in self.lanes():
            nn = live.shape[1]
            if nn < 3:
                continue
            for k in np.flatnonzero(eligible[live[:, 1:-1]].all(axis=(1, 2))):
                meta[k, 6] = offset
                offset += store_size(nn)
        return offset

    def pairs(self) -> Array:
        """Coupled nodes of all element pairs in the order of the block map, [*, 2]; -1 for idle lanes and eliminated nodes."""
        out = []
        for meta, live in self.lanes():
            nn = live.shape[1]
            live = live.copy()
            live[meta[:, 6] >= 0, 1:-1] = -1
            a = np.broadcast_to(live[:, :, None, :], (live.shape[0], nn, nn, 8))
            b = np.broadcast_to(live[:, None, :, :], a.shape)
            pair = np.stack((a.reshape(-1), b.reshape(-1)), axis=1)
            out.append(np.where(pair.min(axis=1, keepdims=True) < 0, -1, pair))
        return np.concatenate(out)

    def tables(self, row_of: Array, blocks: Array) -> ElementTables | None:
        """The finished tables; blocks: block of every pair (idle ones already set), in the order of `pairs`."""
        if not self.meta:
            return None
        nodes = np.concatenate(self.nodes)
        rows = np.where(nodes[:, 1] < 0, row_of.size, row_of[nodes[:, 0]])
        return ElementTables(np.ascontiguousarray(np.concatenate(self.meta)).astype(np.int64), np.concatenate(self.tab),
                             np.ascontiguousarray(nodes[:, 0]).astype(np.int64), rows.astype(np.int64), blocks.astype(np.int64))


def pack_inner(packers: list[ElementPacker], row_of: Array, n_end: int, size: int) -> Inner | None:
    """Index lists of the eliminated nodes; rows from n_end on are theirs."""
    if not size:
        return None
    where, rows = [], []
    n_rows = 0
    for packer in packers:
        for meta, live in packer.lanes():
            nn = live.shape[1]
            group, lane = np.nonzero((meta[:, 6] >= 0)[:, None] & (live[:, 0] >= 0))
            e = np.arange(group.size)
            where.append(np.stack((meta[group, 6] + lane, np.full(group.size, nn - 2), n_rows + nn * e), axis=1))
            rows.append(row_of[live[group, :, lane]].reshape(-1))
            n_rows += nn * group.size
    place, all_rows = np.concatenate(where).astype(np.int64), np.concatenate(rows).astype(np.int64)
    element = np.zeros(row_of.size - n_end, np.int64)
    for e, (_, m, o) in enumerate(place.tolist()):
        element[all_rows[o + 1:o + 1 + m] - n_end] = e
    return Inner(np.zeros(size), np.zeros(8 * (row_of.size + 1)), place, all_rows, element, np.zeros(len(place), np.int64),
                 np.zeros(len(place), np.int64), np.array([n_end]), np.ones(1))


def pack_curves(items: list[tuple[int, Beam, CurveBasis]]) -> Curves:
    """Tables of the curves (first node, beam, curve)."""
    meta, shape, ends, first, count, coef = [], [], [], [], [], []
    n_ends = n_first = n_coef = 0
    degree = 1
    for base, beam, curve in items:
        ne, width, n = curve.coef.shape
        meta.append((base, ne, n_ends, n_first, n_coef))
        shape.append((width, n, beam.n_nodes))
        degree = max(degree, n - 1)
        ends.append(curve.element_ends)
        first.append(curve.first_node)
        count.append(curve.n_nodes_of)
        coef.append(curve.coef.reshape(-1))
        n_ends += ne + 1
        n_first += ne
        n_coef += curve.coef.size
    # the rule integrates derivatives of degree p - 1 and, with the factor x, of p - 1 again: exact to degree p
    x, w = np.polynomial.legendre.leggauss(degree // 2 + 1)
    return Curves(np.array(meta, np.int64), np.array(shape, np.int64), np.concatenate(ends),
                  np.concatenate(first).astype(np.int64), np.concatenate(count).astype(np.int64), np.concatenate(coef),
                  0.5 * (x + 1.0), 0.5 * w)
