"""Lane tables of the element kernels: groups of 8 elements, each constant next to where it is used."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import Inner, NoColumns, store_size
from fastbeam.kernels.contact.curves import FIRST_NODE, Curves, Paths
from fastbeam.kernels.layout import CONSTANTS, FACTORS, PARAMETERS, REFERENCE, layout_of
from fastbeam.kernels.linalg.substructures import Substructures, place_stores
from fastbeam.kernels.state import aligned
from fastbeam.model.forces.nonlinear_sections import parameters_of
from fastbeam.scene import Beam, Net
from fastbeam.scene.interpolation.basis import build_basis

Array = np.ndarray
# elements whose tables are made at a time
CHUNK = 32768


@dataclass(frozen=True)
class Elements:
    """Constants of E elements with nn nodes and nq points each, of a beam or a net; arrays may be broadcast views."""

    strain: str
    nodes: Array  # int [E, nn]: global numbers
    # weight, phi_s, dir, dir_s, [E, nq], [E, nq, nn]: as in `basis.Basis`
    weight: Array
    phi_s: Array
    dir: Array
    dir_s: Array
    # mass_phi, mass_dir, [E, nn, nn]
    mass_phi: Array
    mass_dir: Array
    # stiffness, viscosity, inertia, [*, 6, 6], [*, 6, 6], [*, 3]: matrices of every section: C; D; rhoA, rhoI2, rhoI3
    stiffness: Array
    viscosity: Array
    inertia: Array
    section: Array  # int [E]: number of the section of an element
    coupled: Array  # bool [E]
    # phi, directors, float64 [N, 3], [N, 3, 3]: reference positions and triads of all nodes of the scene
    phi: Array
    directors: Array
    # float64 [*, 6], optional: strains in the reference, one row for the beam or for every element; None: free of stress
    start_strain: Array | None = None
    # float64 [*, 6 * PARAMETERS], optional: numbers of the laws of every section; None: all are linear
    parameters: Array | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Nodes and points of an element."""
        return self.phi_s.shape[2], self.phi_s.shape[1]

    def softest(self, length: float) -> float:
        """Return the smallest EI / (EA length^2) of all elements, EA the stiffest of extension and shear, EI the softest of
        torsion and bending."""
        stiff = self.stiffness[np.unique(self.section)][:, np.arange(6), np.arange(6)]
        long, bend = stiff[:, :3].max(axis=1), stiff[:, 3:]
        bend = np.where(bend > 0.0, bend, np.inf).min(axis=1)
        return float(np.min(bend / (long * length**2)))

    @cached_property
    def reference_strains(self) -> Array:
        """Strains in the reference configuration, without the constant 1 or 1/2 of the first: [E, nq, 6]. The kernels subtract
        them, so that any initial shape is free of stress (theory.md 2), or has the stress of a prestrain."""
        every = np.arange(len(self.nodes))
        parts = [_reference_strains(self, every[k:k + CHUNK], self.phi, self.directors) for k in range(0, every.size, CHUNK)]
        found = parts[0] if len(parts) == 1 else np.concatenate(parts)
        # theory.md (2.8)
        return found if self.start_strain is None else found - self.start_strain[:, None]


def elements_of(part: Beam | Net, first: int, phi: Array, directors: Array) -> Elements:
    """Return the elements of a beam or net whose nodes start at `first`, from the reference of all nodes."""
    if isinstance(part, Net):
        # equal elements on every beam: those of an element of length 1, scaled
        unit = build_basis("lagrange", part.degree, 1, 1.0)
        h = np.repeat(part.lengths / part.elements, part.elements)[:, None, None]
        section_of = np.repeat(part.section_of, part.elements)
        return Elements(part.strain, first + part.element_start[:, None] + np.arange(part.degree + 1), unit.weight * h[:, 0],
                        unit.phi_s / h, np.broadcast_to(unit.dir, (len(h), *unit.dir.shape[1:])), unit.dir_s / h,
                        unit.mass_phi * h, unit.mass_dir * h, np.array([s.C for s in part.sections]),
                        np.array([s.D for s in part.sections]), np.array([s.inertia for s in part.sections]), section_of,
                        np.array([s.couples for s in part.sections])[section_of], phi, directors,
                        np.repeat(part.start_strains, part.elements, axis=0) if part.is_strained else None,
                        parameters_of(part.sections))
    basis, section = part.basis, part.section
    none = np.zeros(basis.n_elements, np.int64)
    coupled = np.full(basis.n_elements, section.couples)
    return Elements(part.strain, first + basis.element_nodes, basis.weight, basis.phi_s, basis.dir, basis.dir_s, basis.mass_phi,
                    basis.mass_dir, section.C[None], section.D[None], np.array([section.inertia]), none, coupled, phi, directors,
                    part.start_strain[None] if part.prestrain or part.prestress else None, parameters_of([section]))


def _reference_strains(elements: Elements, some: Array, phi: Array, d: Array) -> Array:
    nodes = elements.nodes[some]
    return strains_of(elements.strain, np.einsum("egn,enc->egc", elements.phi_s[some], phi[nodes]),
                      np.einsum("egn,enkc->egkc", elements.dir[some], d[nodes]),
                      np.einsum("egn,enkc->egkc", elements.dir_s[some], d[nodes]))


def strains_of(name: str, f: Array, d: Array, k: Array) -> Array:
    """Evaluate the six strains of a strain set, without the constant 1 or 1/2 of the first, [..., 6], from phi' [..., 3],
    directors and their derivatives [..., 3, 3]; theory.md (2.1), (2.2)."""
    d1, d2, d3 = (d[..., i, :] for i in range(3))
    k1, k2, k3 = (k[..., i, :] for i in range(3))
    shear2, shear3, twist = _dot(f, d2), _dot(f, d3), 0.5 * (_dot(k2, d3) - _dot(k3, d2))
    if name == "simo_reissner":
        c = 1.75 - 0.25 * (_dot(d1, d1) + _dot(d2, d2) + _dot(d3, d3))
        e = [np.sqrt(_dot(f, f) - shear2**2 - shear3**2), shear2, shear3, c * twist, 0.5 * c * (_dot(k3, d1) - _dot(k1, d3)),
             0.5 * c * (_dot(k1, d2) - _dot(k2, d1))]
    else:
        e = [0.5 * _dot(f, f), shear2, shear3, twist, _dot(f, k3), -_dot(f, k2)]
    return np.stack(e, axis=-1)


def strain_gradient(name: str, f: Array, d: Array, k: Array) -> Array:
    """Return the derivatives of `strains_of` by phi', by the three directors and by their derivatives, [..., 6, 7, 3]."""
    out = np.zeros((*f.shape[:-1], 6, 7, 3), np.result_type(f, d, k))
    d1, d2, d3 = (d[..., i, :] for i in range(3))
    k1, k2, k3 = (k[..., i, :] for i in range(3))
    out[..., 1, 0, :], out[..., 1, 2, :] = d2, f
    out[..., 2, 0, :], out[..., 2, 3, :] = d3, f
    out[..., 3, 2, :], out[..., 3, 3, :], out[..., 3, 5, :], out[..., 3, 6, :] = -0.5 * k3, 0.5 * k2, 0.5 * d3, -0.5 * d2
    if name == "simo_reissner":
        shear = [_dot(f, x)[..., None] for x in (d2, d3)]
        stretch = np.sqrt(_dot(f, f)[..., None] - shear[0]**2 - shear[1]**2)
        out[..., 0, 0, :] = (f - shear[0] * d2 - shear[1] * d3) / stretch
        out[..., 0, 2, :], out[..., 0, 3, :] = -shear[0] * f / stretch, -shear[1] * f / stretch
        out[..., 4, 1, :], out[..., 4, 3, :], out[..., 4, 4, :], out[..., 4, 6, :] = 0.5 * k3, -0.5 * k1, -0.5 * d3, 0.5 * d1
        out[..., 5, 1, :], out[..., 5, 2, :], out[..., 5, 4, :], out[..., 5, 5, :] = -0.5 * k2, 0.5 * k1, 0.5 * d2, -0.5 * d1
        c = 1.75 - 0.25 * (_dot(d1, d1) + _dot(d2, d2) + _dot(d3, d3))[..., None, None, None]
        form = 0.5 * np.stack((_dot(k2, d3) - _dot(k3, d2), _dot(k3, d1) - _dot(k1, d3), _dot(k1, d2) - _dot(k2, d1)), axis=-1)
        out[..., 3:, :, :] *= c
        out[..., 3:, 1:4, :] -= 0.5 * form[..., :, None, None] * d[..., None, :, :]
    else:
        out[..., 0, 0, :] = f
        out[..., 4, 0, :], out[..., 4, 6, :] = k3, f
        out[..., 5, 0, :], out[..., 5, 5, :] = -k2, -f
    return out


def strains_by_nodes(name: str, x: Array, phi_s: Array, shape: Array, slope: Array) -> Array:
    """Return the derivatives of the strains at g points by the coordinates of nn nodes, [l, g, 6, 12 nn]; x [l, nn, 4, 3], shapes
    [l, g, nn]."""
    f = np.einsum("lga,lac->lgc", phi_s, x[:, :, 0])
    d, k = (np.einsum("lga,laic->lgic", y, x[:, :, 1:]) for y in (shape, slope))
    gradient = strain_gradient(name, f, d, k)
    lead = np.empty((*phi_s.shape[:2], 6, phi_s.shape[2], 4, 3), gradient.dtype)
    lead[..., 0, :] = np.einsum("lga,lgic->lgiac", phi_s, gradient[:, :, :, 0])
    lead[..., 1:, :] = (np.einsum("lga,lgikc->lgiakc", shape, gradient[:, :, :, 1:4])
                        + np.einsum("lga,lgikc->lgiakc", slope, gradient[:, :, :, 4:]))
    return lead.reshape(*lead.shape[:3], -1)


def node_lengths(nodes: Array, mass_phi: Array, n: int) -> Array:
    """Return the tributary lengths of nodes, the integrals of their shape functions, float64 [n], m; nodes [E, nn] and mass_phi
    [E, nn, nn] of elements."""
    return np.bincount(nodes.reshape(-1), mass_phi.sum(axis=2).reshape(-1), minlength=n)


def group_tables(elements: Elements, lane: Array, size: tuple[int, ...], stiffness: Array, inertia: Array) -> Array:
    """Pack the constants of groups of 8 elements, except their reference strains, as in kernels/layout.py: [groups, doubles].

    lane: int [8 groups], elements of the lanes.
    size: `dimensions.SPACE` or `PLANE`.
    stiffness, inertia: float64 [groups, 36, 8], [groups, 3, 8], in a plane [groups, 9, 8], [groups, 2, 8].
    """
    nn, nq = elements.shape
    groups = lane.size // 8

    def lanes(x: Array) -> Array:
        return x[lane].reshape(groups, 8, *x.shape[1:])

    at = layout_of(size, nn, nq)
    tab = np.empty((groups, at.table_size // 8, 8))
    tab[:, :at.point // 8] = stiffness
    points = tab[:, at.point // 8:at.inertia // 8].reshape(groups, nq, at.point_size // 8, 8)
    points[:, :, 0] = lanes(elements.weight).transpose(0, 2, 1)
    for k, shape in enumerate((elements.phi_s, elements.dir, elements.dir_s)):
        points[:, :, 1 + k::3] = lanes(shape).transpose(0, 2, 3, 1)
    tab[:, at.inertia // 8:at.masses // 8] = inertia
    for mass, first in ((elements.mass_phi, at.masses // 8), (elements.mass_dir, at.director_masses // 8)):
        tab[:, first:first + nn * nn] = lanes(mass.reshape(len(mass), -1)).transpose(0, 2, 1)
    return tab.reshape(groups, -1)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...c,...c->...", a, b)


class TablePool:
    """Array of the tables of all groups; tables that are equal to the last bit are stored once, and stay in the cache."""

    def __init__(self) -> None:
        self._parts: list[Array] = []
        self._size = 0

    def append(self, rows: Array) -> Array:
        """Add rows [groups, m]; returns the offset of each."""
        at = self._size + rows.shape[1] * np.arange(len(rows))
        self._parts.append(rows.reshape(-1))
        self._size += rows.size
        return at

    def share(self, rows: Array) -> Array:
        """Add rows, equal ones only once; rows of one call are compared."""
        words = np.ascontiguousarray(rows).view(np.uint64)
        # rows are compared by a quick hash; different rows with the same hash are found and not shared
        key = words @ (0x9E3779B97F4A7C15 * np.arange(1, 2 * words.shape[1], 2, dtype=np.uint64))
        _, first, which = np.unique(key, return_index=True, return_inverse=True)
        first = first[which.reshape(-1)]
        differs = (words != words[first]).any(axis=1)
        first[differs] = np.flatnonzero(differs)
        own = np.unique(first)
        return self.append(rows[own])[np.searchsorted(own, first)]

    def constants(self, rows: Array, ahead: Sequence[Array]) -> Array:
        """Add shared rows of constants; returns the offset of C of each group; ahead: [groups, *, 8] each, stand ahead of C."""
        parts = [x.reshape(len(rows), -1) for x in ahead]
        return self.share(np.concatenate((*parts, rows), axis=1) if parts else rows) + sum(x.shape[1] for x in parts)

    def array(self) -> Array:
        """Return all tables as one array."""
        out = aligned(self._size)
        return np.concatenate(self._parts, out=out) if self._parts else out


@dataclass
class ElementPacker:
    """Collector of the elements of one strain set in groups of 8; `tables` packs their constants at the end."""

    # list of int arrays [groups, 8]: columns as in kernels/layout.py for every `add`; without constants and reference strains
    meta: list[Array] = field(default_factory=list)
    # list of int arrays [*, 2]: nodes of the lanes, and again with -1 in idle lanes
    nodes: list[Array] = field(default_factory=list)
    beam: list[int] = field(default_factory=list)  # argument `beam` of every `add`
    parts: list[tuple[Elements, Array]] = field(default_factory=list)  # list of (Elements, int [8 groups]): elements of the lanes
    n_nodes: int = 0
    n_blocks: int = 0

    def add(self, elements: Elements, some: Array | None = None, beam: int = 0) -> None:
        """Append elements. some: int [S], numbers of the elements in their order, all by default; beam: number of elements of
        each condensed beam: lane l of so many groups has those of beam l; -1 - g for elements of group g of condensed beams with
        sliders."""
        nn, nq = elements.shape
        some = np.arange(len(elements.nodes)) if some is None else some
        if not some.size:
            return
        groups = -(-some.size // 8)
        # idle lanes of the last group repeat its last element
        lane = some[np.minimum(np.arange(8 * groups), some.size - 1)]
        k = np.arange(groups)
        coupled = elements.coupled[lane].reshape(groups, 8).any(axis=1)
        self.meta.append(np.stack((np.full(groups, nn), np.full(groups, nq), 0 * k, self.n_nodes + 8 * nn * k,
                                   0 * k if beam else self.n_blocks + 8 * nn * nn * k, coupled.astype(np.int64),
                                   np.full(groups, -1), 0 * k), axis=1))
        nodes = elements.nodes[lane].reshape(groups, 8, nn)
        idle = (np.arange(8 * groups) >= some.size).reshape(groups, 8)
        self.nodes.append(np.stack((nodes, np.where(idle[:, :, None], -1, nodes)), axis=-1).transpose(0, 2, 1, 3).reshape(-1, 2))
        self.n_nodes += 8 * nn * groups
        self.n_blocks += 0 if beam else 8 * nn * nn * groups
        self.beam.append(beam)
        self.parts.append((elements, lane))

    @property
    def is_damped(self) -> bool:
        """True if a section has damping; then all tables have a place for it."""
        return any(elements.viscosity.any() for elements, _ in self.parts)

    @property
    def is_nonlinear(self) -> bool:
        """True if a section has a law; then all tables have a place for its numbers."""
        return any(elements.parameters is not None for elements, _ in self.parts)

    def lanes(self) -> Any:
        """Yield (meta [groups, 8], nodes [groups, nn, 8] with -1 in idle lanes) of every beam or net that is not condensed."""
        for meta, nodes, beam in zip(self.meta, self.nodes, self.beam):
            if not beam:
                yield meta, nodes[:, 1].reshape(len(meta), -1, 8)

    def condensed(self) -> Any:
        """Yield (elements of a beam, nodes [groups of beams, elements, nn, 8]) of condensed beams, in the order of their groups,
        which follow the others in the tables."""
        for meta, nodes, beam in zip(self.meta, self.nodes, self.beam):
            if beam > 0:
                yield beam, nodes[:, 0].reshape(len(meta) // beam, beam, -1, 8)

    def carried(self) -> list[tuple[int, int, int]]:
        """Return (group of condensed beams with sliders, first group of elements, number) of their elements, which come last in
        the tables."""
        at = sum(len(meta) for meta, beam in zip(self.meta, self.beam) if beam >= 0)
        out = []
        for meta, beam in zip(self.meta, self.beam):
            if beam < 0:
                out.append((-1 - beam, at, len(meta)))
                at += len(meta)
        return out

    def eliminate(self, eligible: Array, offset: int, columns: bool) -> int:
        """Mark groups for elimination of their inner nodes where all of these are eligible, bool [N + 1]; `offset`: begin of
        their factors, columns: True with constraint columns. Returns the end of the factors."""
        for meta, live in self.lanes():
            nn = live.shape[1]
            if nn < 3:
                continue
            chosen = np.flatnonzero(eligible[live[:, 1:-1]].all(axis=(1, 2)))
            doubles = store_size(nn, columns)
            meta[chosen, FACTORS] = offset + doubles * np.arange(chosen.size)
            offset += doubles * chosen.size
        return offset

    def pairs(self, row_root: Array) -> Array:
        """Return the coupled nodes i, j of all element pairs in the order of the block map, as i N + j [*]; -1 for idle lanes and
        eliminated nodes. row_root: int [N], the node whose row a node shares."""
        n = row_root.size
        root = np.append(row_root, -1)
        out = []
        for meta, live in self.lanes():
            live = root[live]
            live[meta[:, FACTORS] >= 0, 1:-1] = -1
            a, b = live[:, :, None, :], live[:, None, :, :]
            out.append(np.where((a < 0) | (b < 0), -1, a * n + b).reshape(-1))
        return np.concatenate([np.zeros(0, np.int64), *out])

    @property
    def order(self) -> list[int]:
        """Numbers of the calls of `add` in the order of the tables: condensed beams follow the others, those with sliders are
        last."""
        return [k for kind in (0, 1, -1) for k, beam in enumerate(self.beam) if np.sign(beam) == kind]

    def tables(self, row_of: Array, blocks: Array, strains: TablePool) -> ElementTables | None:
        """Pack the tables; blocks: block of every pair (idle ones already set), in the order of `pairs`; strains: takes the
        reference strains."""
        if not self.meta:
            return None
        pool = TablePool()
        for meta, (elements, every) in zip(self.meta, self.parts):
            for begin in range(0, every.size, CHUNK):
                lane = every[begin:begin + CHUNK]
                groups, some = lane.size // 8, slice(begin // 8, (begin + lane.size) // 8)
                section = elements.section[lane].reshape(groups, 8)
                constants = group_tables(elements, lane, SPACE, elements.stiffness.reshape(-1, 36)[section].transpose(0, 2, 1),
                                         elements.inertia[section].transpose(0, 2, 1))
                ahead = []
                if self.is_nonlinear:
                    of = np.zeros((1, 6 * PARAMETERS)) if elements.parameters is None else elements.parameters
                    ahead.append(np.broadcast_to(of, (len(elements.stiffness), 6 * PARAMETERS))[section].transpose(0, 2, 1))
                if self.is_damped:
                    ahead.append(elements.viscosity.reshape(-1, 36)[section].transpose(0, 2, 1))
                meta[some, CONSTANTS] = pool.constants(constants, ahead)
                own = elements.reference_strains[lane].reshape(groups, 8, -1)
                meta[some, REFERENCE] = strains.append(own.transpose(0, 2, 1).reshape(groups, -1))
        nodes = np.concatenate(self.nodes)
        rows = np.where(nodes[:, 1] < 0, row_of.size, row_of[nodes[:, 0]])
        meta = np.concatenate([self.meta[k] for k in self.order])
        return ElementTables(np.ascontiguousarray(meta).astype(np.int64), pool.array(),
                             np.ascontiguousarray(nodes[:, 0]).astype(np.int64), rows.astype(np.int64), blocks.astype(np.int64))


def pack_inner(packers: list[ElementPacker], row_of: Array, n_end: int, n_rows: int, size: int, columns: bool) -> Inner | None:
    """Build the index lists of the eliminated nodes, whose rows are n_end to n_rows. columns: True with constraint columns."""
    if not size:
        return None
    where, rows = [], []
    element = np.zeros(n_rows - n_end, np.int64)
    n_places = n_listed = 0
    for packer in packers:
        for meta, live in packer.lanes():
            nn = live.shape[1]
            group, lane = np.nonzero((meta[:, FACTORS] >= 0)[:, None] & (live[:, 0] >= 0))
            e = np.arange(group.size)
            where.append(np.stack((meta[group, FACTORS] + lane, np.full(group.size, nn - 2), n_listed + nn * e), axis=1))
            listed = row_of[live[group, :, lane]]
            if group.size:
                element[listed[:, 1:-1] - n_end] = (n_places + e)[:, None]
            rows.append(listed.reshape(-1))
            n_places += group.size
            n_listed += nn * group.size
    rhs = np.zeros(8 * (row_of.size + 1)) if columns else NoColumns()
    return Inner(np.zeros(size), rhs, np.concatenate(where).astype(np.int64),
                 np.concatenate(rows).astype(np.int64), element, np.zeros(n_places, np.int64), np.zeros(n_places, np.int64),
                 np.array([n_end]), np.ones(1))


def condensed_ends(packers: list[ElementPacker]) -> Array:
    """Return the first and the last node of all condensed beams, int [B, 2]."""
    out = [np.stack((live[:, 0, 0], live[:, -1, -1]), axis=-1).reshape(-1, 2) for p in packers for _, live in p.condensed()]
    return np.concatenate([np.zeros((0, 2), np.int64), *out])


def pack_substructures(packers: list[ElementPacker], rows: Array, blocks: Array, n_blocks: int, n_end: int,
                       first: int) -> Substructures | None:
    """Build the tables of the condensed beams, for 6 unknowns a node.

    rows, blocks: int [B, 2], [B, 4], rows and blocks of their ends, beams with sliders last: start and end; start-start,
        start-end, end-start, end-end.
    n_blocks, n_end: blocks of the tangent; rows that ends may have.
    first: first row of their interior nodes.
    """
    if not len(rows):
        return None
    group = [np.zeros((0, 4), np.int64)]
    for p in packers:
        at = sum(len(meta) for meta, _ in p.lanes())
        for count, live in p.condensed():
            g = np.arange(len(live))
            group.append(np.stack((at + count * g, np.full(g.size, count), np.full(g.size, live.shape[2]), 0 * g), axis=1))
            at += count * g.size
    counts = [sum(len(live) for _, live in p.condensed()) for p in packers]

    def terms(keys: Array, n: int) -> tuple[Array, Array]:
        order = np.argsort(keys.reshape(-1), kind="stable")
        return np.searchsorted(keys.reshape(-1)[order], np.arange(n + 1)), order

    block_start, block_term = terms(blocks, n_blocks)
    row_start, row_term = terms(rows, n_end)
    empty = np.zeros(0)
    return place_stores(Substructures(np.concatenate(group), np.arange(len(rows)), block_start, block_term, row_start, row_term,
                                      np.array([first, *counts]), empty, empty, empty), 6)


def pack_curves(tracks: list[Any]) -> Curves:
    """Build the tables of the curves of beams (tracks.py)."""
    curves = [track.basis for track in tracks]
    sizes = np.array([(x.element_ends.size, x.first_node.size, x.coef.size) for x in curves])
    begins = (np.cumsum(sizes, axis=0) - sizes).tolist()
    meta = [(track.nodes[0], len(x.coef), *at) for track, x, at in zip(tracks, curves, begins)]
    shape = [(*x.coef.shape[1:], track.nodes.size) for track, x in zip(tracks, curves)]
    degree = max(1, *(x.coef.shape[2] - 1 for x in curves))
    ends, first, count = ([getattr(x, name) for x in curves] for name in ("element_ends", "first_node", "n_nodes_of"))
    coef = [x.coef.reshape(-1) for x in curves]
    # the rule integrates derivatives of degree p - 1 and, with the factor x, of p - 1 again: exact to degree p
    x, w = np.polynomial.legendre.leggauss(degree // 2 + 1)
    return Curves(np.array(meta, np.int64), np.array(shape, np.int64), np.concatenate(ends),
                  np.concatenate(first).astype(np.int64), np.concatenate(count).astype(np.int64), np.concatenate(coef),
                  0.5 * (x + 1.0), 0.5 * w)


def pack_paths(tracks: list[Any]) -> Paths:
    """Build the tables of curves of which some are paths."""
    curves = pack_curves(tracks)
    sizes = [track.nodes.size for track in tracks]
    curves.meta[:, FIRST_NODE] = np.cumsum(sizes) - sizes
    return Paths(*curves, np.concatenate([track.nodes for track in tracks]).astype(np.int64),
                 np.array([track.period for track in tracks]))
