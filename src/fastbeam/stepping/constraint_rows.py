"""Arrays for the rows of constraints in the block matrix (theory.md 9): couplings of the nodes, and room for their
elimination."""
from __future__ import annotations

from collections import defaultdict
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from fastbeam.kernels.beams.inner_nodes import INNER_NODES, ROWS, Inner, NoInner
from fastbeam.kernels.beams.nodes import NoHeld
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.kernels.linalg.constraint_rows import Couplings, Order, Touched
from fastbeam.kernels.linalg.constraint_solve import Factors
from fastbeam.kernels.linalg.constraints import Constraints
from fastbeam.kernels.terms import NoTies
from fastbeam.linalg.joint_ordering import Joint, places_of
from fastbeam.linalg.pattern import Pattern
from fastbeam.model.mapping import nodes_of_curve
from fastbeam.model.model import Model

Array = np.ndarray
# places of models that still exist
_PLACES: WeakKeyDictionary[Model, Array | None] = WeakKeyDictionary()


def couplings_of(pattern: Pattern, size: int, end: int, held: Array, tied: Array, late: list[Array], unknowns: Array,
                 forces: Array, in_force: Array, pairs: Array | None = None, places: Array | None = None) -> Couplings:
    """Form the couplings of the rows of a pattern.

    size, end: unknowns of a node; where the assembled blocks end, in doubles.
    held, tied: int [n], mask of held unknowns of every row; the tied node that has the row, or -1.
    late: rows that every constraint need not wait for.
    unknowns, forces, in_force: int [S], numbers of unknowns of every constraint, of forces among them, and of equations in the
        unit of a force behind those of the gaps.
    pairs: int [O, 2], constraints that are coupled by own unknowns.
    places: int32 [n + S], place of every row in the elimination; else it is found in a run.
    """
    n, block = pattern.n, 8 * size
    low, high = pattern.coupled[:, 0], pattern.coupled[:, 1]
    row, near = np.concatenate((low, high)), np.concatenate((high, low))
    order = np.lexsort((near, row))
    row, near = row[order], near[order]

    def where(i: Array, j: Array) -> Array:
        return block * np.searchsorted(pattern.keys, i * n + j)

    every = np.arange(n)
    partner = np.full(unknowns.size, -1, np.int32)
    if pairs is not None:
        partner[pairs[:, 0]], partner[pairs[:, 1]] = pairs[:, 1], pairs[:, 0]
    tables = (np.searchsorted(row, np.arange(n + 1)), near, where(row, near), where(near, row), where(every, every), held, tied)
    return Couplings(*(x.astype(np.int32) for x in tables), _starts(np.array([len(x) for x in late], np.int64)),
                     np.concatenate([np.zeros(0, np.int64), *late]).astype(np.int32),
                     *(x.astype(np.int32) for x in (unknowns, forces, in_force)), _starts(unknowns)[:-1].copy(),
                     _starts(forces)[:-1].copy(), np.array([end]), partner, np.array([int(pattern.beats_breadth_first)]),
                     np.zeros(0, np.int32) if places is None else places)


def _starts(counts: Array) -> Array:
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)


def with_capacity(couplings: Couplings, entries: int, elements: int, size: int, scale: float = 1.0,
                  others: tuple[Any, ...] = (NoInner(), NoTies(), NoHeld()), fill: int = 0,
                  targets: int = 0, pairs: int = 0) -> Constraints:
    """Allocate everything that is found from so many entries a constraint at most, with room that grows with `scale`; `elements`:
    with eliminated inner nodes; others: the last three of `Constraints`; fill: doubles of fill between nodes; targets: products
    of blocks at least; pairs: constraints that are coupled by own unknowns."""
    n, s = couplings.diagonal.size, couplings.unknowns.size
    rows = n + s

    def integers(*shape: int) -> Array:
        return np.zeros(shape, np.int32)

    touched = int(scale * s * (min(entries, 8) + 2)) + 16
    columns = int(scale * (couplings.near.size // 2 + 4 * s)) + rows
    touching = Touched(integers(s), integers(s, entries), integers(s), integers(s, entries), integers(s, entries),
                       integers(s + 1), integers(touched), integers(touched), integers(touched), integers(touched),
                       integers(n + 1), integers(touched), integers(s), integers(s + 1),
                       integers(int(scale * s * min(entries, 3)) + 16, 6), integers(elements),
                       integers(elements, 2), integers(int(scale * 9 * s)), integers(pairs, 2),
                       integers(n), integers(n), integers(4))
    targets = max(2 * columns, targets)
    order = Order(integers(n), integers(rows), integers(rows), integers(rows), integers(rows), integers(rows + 1),
                  integers(columns), integers(columns), integers(columns), integers(rows + 1), integers(targets),
                  integers(6, rows + 1), integers(2))
    # of a constraint its own block and two for each of some rows that it touches or is coupled with by fill
    some = 1.1 * min(max(entries, 4), 6)
    total = int(couplings.end[0]) + int(scale * 8 * np.sum(couplings.unknowns + some * (size + couplings.unknowns))) + 256 + fill
    factors = Factors(aligned_empty(total), empty(8 * rows), np.zeros(8 * rows, np.int8), empty(7 * s), empty(8),
                      np.zeros(2, np.int64))
    return Constraints(couplings, touching, order, factors, aligned_empty(int(scale * 64 * size)), *others)


def constraints_of(model: Model, inner: Inner | None, entries: int, scale: float, targets: int = 0) -> Constraints:
    """Allocate the rows of the constraints of a model; inner: with the work arrays of a run; other arguments: see
    `with_capacity`."""
    n, s = model.pattern.n, model.n_sliders
    held, tied = np.zeros(n, np.int64), np.full(n, -1)
    if model.held is not None:
        held[model.held.row[model.held.row < n]] = model.held.mask[model.held.row < n]
    if model.ties is not None:
        seen = model.ties.row < n
        tied[model.ties.row[seen]] = model.ties.slave[seen]
    on_curve: dict[int, Array] = {}
    late = []
    sliders = [] if model.sliders is None else zip(model.sliders.curve.tolist(), model.sliders.point.tolist())
    for c, point in sliders:
        if c not in on_curve:
            on_curve[c] = np.zeros(model.n_nodes + 1, bool)
            for node in nodes_of_curve(model.curves, c).tolist():
                on_curve[c][_rows_with_masters(model, node)] = True
        rows = _rows_with_masters(model, point)
        late.append(rows[~on_curve[c][rows]])
    # a joint waits for both of its ends
    late += [np.zeros(0, np.int64)] * len(model.kept)
    # the moments of a sleeve wait for what its slider waits for
    late += [late[k] for k in model.sleeve_pairs[:, 0]]
    in_force = (np.arange(model.n_constraints) < s).astype(np.int64)
    couplings = couplings_of(model.pattern, len(model.dofs), 8 * len(model.dofs) * (model.n_blocks + 1), held, tied, late,
                             model.unknowns, model.forces, in_force, model.sleeve_pairs, _places(model, inner))
    elements = 0 if inner is None else inner.mark.size
    others = (NoInner() if inner is None else inner, NoTies() if model.ties is None else model.ties,
              NoHeld() if model.held is None else model.held)
    return with_capacity(couplings, entries, elements, len(model.dofs), scale, others, targets=targets, pairs=len(model.coupled))


def _places(model: Model, inner: Inner | None) -> Array | None:
    """Return the place of every row in the elimination of a model whose constraints are joints, which always touch the same
    rows."""
    if model.n_sliders or not model.kept:
        return None
    if model not in _PLACES:
        _PLACES[model] = _find_places(model, inner)
    return _PLACES[model]


def _find_places(model: Model, inner: Inner | None) -> Array | None:
    n = model.pattern.n
    whole = (1 << len(model.dofs)) - 1
    mask = np.zeros(model.n_nodes + 1, np.int64)
    if model.held is not None:
        mask[model.held.row] = model.held.mask
    held = mask == whole
    # triads of point masses stand still, and no joint turns them
    mask[model.pattern.row_of[model.numbers.rank == 9]] &= (1 << model.dim) - 1
    grounded = mask > 0
    if model.released is not None:
        held[model.released.row] = False
        grounded[model.released.row] = True
    of_rows = defaultdict(list)
    for k, link in enumerate(model.kept):
        rows = set()
        for row in (r for node in link.node for r in _carriers_of(model, node)):
            if row < n:
                rows.add(row)
            elif inner is not None:
                e = inner.element[row - inner.first[0]]
                first = inner.where[e, ROWS]
                rows.update((int(inner.rows[first]), int(inner.rows[first + inner.where[e, INNER_NODES] + 1])))
        of_rows[tuple(sorted(rows))].append(k)
    joints = [Joint(k, tuple(r for r in rows if not held[r]), tuple(r for r in rows if held[r])) for rows, k in of_rows.items()]
    return places_of(n, model.pattern.coupled, joints, grounded[:n], model.pattern.beats_breadth_first)


def _carriers_of(model: Model, node: int) -> list[int]:
    """Return the row of a node, or those of the nodes that it is tied to."""
    rows = _rows_with_masters(model, node).tolist()
    return rows[1:] or rows


def _rows_with_masters(model: Model, node: int) -> Array:
    """Return rows of a node and of those that it is tied to."""
    row = model.pattern.row_of[node:node + 1]
    if model.ties is None:
        return row
    return np.concatenate((row, model.ties.target_row[model.ties.start[node]:model.ties.start[node + 1]]))
