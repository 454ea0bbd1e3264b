"""Arrays that a run of a model writes, allocated once."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import Inner
from fastbeam.kernels.contact.curves import NODES_OF_CURVE
from fastbeam.kernels.contact.moving_elements import moved
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.kernels.entries.dense import Contact, ContactAtRest, ContactInMatrix, ContactInRows, ContactOfCarriers
from fastbeam.kernels.entries.factored import FRAME, FactoredContact
from fastbeam.kernels.forces.user_force import FACTOR, SIZE
from fastbeam.kernels.layout import LIST, POINTS, REFERENCE, layout_of
from fastbeam.kernels.linalg.constraints import Constraints
from fastbeam.kernels.linalg.substructures import Substructures, place_stores
from fastbeam.kernels.state import CONTROLS, LastIncrement, Work, aligned
from fastbeam.kernels.terms import NoTies
from fastbeam.model.model import Model

Array = np.ndarray
# operations of a dense border for each node from which on a sparse matrix is faster, and doubles of it at most
SLOW, LARGEST_BORDER = 1.5e5, 250_000_000
# more than a constraint has
MOST_ENTRIES = 2**30


class ReferenceStrains:
    """Reference strains of one run, in the order of the tables of every form of its model; beams: sequence of (slice, float),
    beams whose prestrains change: nodes, and the change at factor 1."""

    def __init__(self, beams: Sequence[tuple[slice, float]] = ()) -> None:
        self.beams = beams
        self._factors = np.zeros(len(beams))
        self._arrays: dict[Model, Array] = {}
        # number of a beam, an array, where its axial strains are there, and these at factor 0
        self._parts: list[tuple[int, Array, Any, Array]] = []
        # whether elements of some of the beams move
        self.of_moving = False

    def of(self, model: Model) -> Array:
        """Return the strains as the tables of a model have them, float64 [*]: those of the model where nothing changes them, else
        an array that `put` changes."""
        if not self.beams:
            return model.reference_strains
        if model not in self._arrays:
            own = self._arrays[model] = aligned(model.reference_strains.size)
            own[:] = model.reference_strains
            for k, (span, _) in enumerate(self.beams):
                for at in (_axial_strains(x, span, len(model.dofs)) for x in (model.simo, model.green) if x is not None):
                    self._parts.append((k, own, at, own[at]))
            self.put(self._factors)
        return self._arrays[model]

    def watch(self, sections: Sequence[Any]) -> None:
        """Let the reference strains of these `resultants.Sections`, or None, change as well."""
        for section in sections:
            for k, (span, _) in enumerate(self.beams):
                if section is not None and section.span == span:
                    self._parts.append((k, section.reference, (..., 0), section.reference[..., 0].copy()))
        self.put(self._factors)

    def own(self, model: Model) -> Model:
        """Return a model for runs with these strains: where they are of moving elements, with arrays of its own, which `put`
        changes, in all its forms."""
        moving = model.moving
        self.of_moving = moving is not None and any(moving.has(span.start) for span, _ in self.beams)
        return self._owning(model) if self.of_moving else model

    def _owning(self, model: Model) -> Model:
        moving, given = model.moving.with_own_strains(), model.uneliminated
        for k, (span, _) in enumerate(self.beams):
            self._parts += [(k, array, at, array[at].copy()) for array, at in moving.axial_strains(span.start)]
        plane = None if model.plane is None else replace(model.plane, model=self._owning(model.plane.model))
        features = tuple(moving if x is model.moving else x for x in model.features)
        return replace(model, features=features, plane=plane,
                       uneliminated=given and cache(lambda planar: self._owning(given(planar=planar))))

    def put(self, factors: float | Array) -> None:
        """Set the prestrains of all beams by one factor, or by one of each [B]."""
        self._factors[:] = factors
        for k, array, at, first in self._parts:
            array[at] = first - self._factors[k] * self.beams[k][1]


def _axial_strains(tables: ElementTables, span: slice, strains: int) -> Array:
    """Return where the axial strains of a beam with these nodes stand among the reference strains, so many at every point."""
    first = tables.nodes[tables.meta[:, LIST, None] + np.arange(8)]
    group, lane = np.nonzero((first >= span.start) & (first < span.stop))
    points = tables.meta[group, POINTS]
    point = np.arange(points.sum()) - np.repeat(np.cumsum(points) - points, points)
    return np.asarray(np.repeat(tables.meta[group, REFERENCE] + lane, points) + 8 * strains * point)


def work_of(model: Model, keep: bool = True, rates: bool = False, strains: ReferenceStrains | None = None,
            in_matrix: bool = False) -> Work:
    """Allocate the work arrays of one run; keep: with room for the state before a step; rates: for a method with its own rates
    (generalised alpha); strains: those of the run, default those of the model; in_matrix: for constraints in a sparse matrix."""
    n, s, size = model.n_nodes, model.n_sliders, len(model.dofs)
    kept = int(keep)
    q = model.q0.size
    # terms other than beams read the coordinates from these arrays
    moved = q * (rates or bool(model.links) or any(
        x is not None for x in (model.sliders, model.ties, model.bodies, model.dragged, model.added, model.motions)))
    second = model.bodies is not None or model.moving is not None
    border = model.border * model.n_bordered
    # arrays for a dense border only
    dense = 0 if model.by_rows or in_matrix else border
    width = 1 if in_matrix else model.width
    panel = 0 if model.by_rows else size * model.panel_rows * width
    # zeros mean no rates of a step before, rest, no loads, and no slave nodes
    theta = _padded((size - model.dim) * n)
    return Work(dphi=_padded(model.dim * n), theta=theta, q_mid=empty(moved), q_end=empty(moved),
                u=np.zeros(q * (rates or second)), s_end=empty(s), f_ext=aligned(8 * (n + 1)),
                r=aligned_empty(8 * (n + 1)),
                blocks=aligned_empty(8 * size * (model.n_blocks + 1)), pivots=np.zeros(size * model.pattern.n, np.int64),
                panel=aligned_empty(panel), border_rows=aligned_empty((1 - model.by_rows) * (dense + 1) * width),
                schur=empty((dense, dense)), y=empty(border),
                scratch=scratch_of(model), keep_q=empty(kept * q), keep_v=empty(kept * q), keep_s=empty(kept * s),
                keep_force=empty(kept * model.n_forces),
                keep_history=empty(kept * model.history_size), keep_dphi=empty(kept * model.dim * n),
                keep_theta=empty(kept * theta.size),
                past=np.zeros(model.past_size),
                keep_past=empty(kept * model.past_size),
                increment=LastIncrement(np.array([0.0, model.softest, -1.0, *np.zeros(CONTROLS - 3)]), theta,
                                        aligned_empty(8 * (n + 1)), NoTies() if model.ties is None else _padded(model.dim * n)),
                reference_strains=model.reference_strains if strains is None else strains.of(model))


def border_is_slow(model: Model) -> bool:
    """Return whether the dense border of constraints, in the plane of the scene where there is one, takes longer than a sparse
    matrix of all nodes and constraints, or much memory."""
    core = model if model.plane is None else model.plane.model
    return not core.by_rows and (core.columns**3 > SLOW * core.n_nodes or core.border_size > LARGEST_BORDER)


def scratch_of(model: Model) -> Array:
    """Allocate the scratch of one thread."""
    return aligned_empty(model.scratch_size)


def entries_of(model: Model, bounded: bool = True) -> int:
    """Return the largest number of entries of a constraint: every node of a slider's beam and its point, or both ends of a joint;
    fewer at first where constraints are rows (unless not `bounded`), with room that grows on demand."""
    # a slave node passes each entry on to all its master nodes
    widest = 1 if model.ties is None else int(np.max(np.diff(model.ties.start)))
    # and one more for the spin of each end of a joint
    joined = _most_joined(model)
    ends = joined * (widest + 1)
    if model.curves is None:
        return joined * _widest_tie(model) if model.by_rows and bounded else ends
    # one more for the spin of the holder of a sleeve
    most = int(model.curves.shape[:, NODES_OF_CURVE].max()) + (model.sleeves is not None)
    if model.by_rows and bounded:
        most = min(most, int(model.curves.count.max()))
        most += _around(model)
        return max(ends, most + 1 + (widest > 1) * (most + 4 * widest))
    # and one more for the spin of every node
    most += _around(model)
    return max(ends, (most + 1) * widest + most)


def _around(model: Model) -> int:
    """Return the most nodes of a beam that the sliding equation of a slider depends on besides those under it, and one more."""
    return 0 if model.moving is None else model.moving.following.nodes.shape[1] + 1


def _most_joined(model: Model) -> int:
    """Return the largest number of nodes that a joint with multipliers, or a coupling of joints, has."""
    return max((len(link.node) for link in model.kept), default=0)


def _widest_tie(model: Model) -> int:
    """Return the largest number of rows that receive the forces on one node."""
    ties, rows = model.ties, model.n_rows
    if ties is None:
        return 1
    node = np.repeat(np.arange(ties.start.size - 1), np.diff(ties.start))
    return int(np.max(np.bincount(np.unique(node * rows + ties.target_row) // rows)))


class Capacity(NamedTuple):
    """Capacity for constraints as rows of the block matrix."""

    entries: int      # entries of each constraint
    scale: float      # factor on all other sizes
    buffer: int       # doubles for the columns and lines of one element, where `scale` is not enough
    targets: int      # products of blocks, where `scale` is not enough


# capacities that runs of a model came to need: the next run begins with them
_NEEDED: WeakKeyDictionary[Model, Capacity] = WeakKeyDictionary()


def capacity_of(model: Model) -> Capacity:
    """Return the capacity with which a run begins."""
    return _NEEDED.get(model) or Capacity(entries_of(model), 1.0, 0, 0)


def larger_capacity(model: Model, capacity: Capacity, contact: Contact | FactoredContact, rows: Constraints) -> Capacity:
    """Increase the capacity that was too small, and keep it for the next run."""
    needed = int(rows.touched.counts[2])
    # products of the fill, if all of the fill was found
    columns = np.diff(rows.order.start.astype(np.int64))
    targets = int(np.sum(columns**2)) if rows.order.counts[0] == np.sum(columns) and columns.min() >= 0 else 0
    if contact.full[0]:
        capacity = capacity._replace(entries=capacity.entries + max(2, capacity.entries // 4))
    elif needed > rows.buffer.size:
        capacity = capacity._replace(buffer=needed)
    elif targets > rows.order.target.size:
        capacity = capacity._replace(targets=targets + targets // 4)
    else:
        capacity = capacity._replace(scale=1.5 * capacity.scale)
    _NEEDED[model] = capacity
    return capacity


def factored_contact_of(model: Model, entries: int) -> FactoredContact:
    """Allocate the work arrays of constraints that are all sliders as rows of the block matrix, without sleeves, for the
    conserving step."""
    n, shape = model.n_sliders, model.curves.shape
    numbers = 8 if model.ties is None else 16
    return FactoredContact(basis=empty((5, shape[:, 2].max())), legendre=empty((3, shape[:, 1].max())),
                           entries=np.zeros(n, np.int32), row=np.zeros((n, entries), np.int32),
                           share=aligned_empty(n * entries * numbers).reshape(n, entries, numbers),
                           frame=aligned_empty(n * FRAME).reshape(n, FRAME), residual=aligned_empty(8 * n).reshape(n, 8),
                           element=np.zeros(n, np.int64), forces=model.forces, first=np.cumsum(model.unknowns) - model.unknowns,
                           first_force=model.first_force, compliance=empty(n), softness=model.softness,
                           remaining=empty(n), full=np.zeros(1, np.int64), augmented=empty(4),
                           pair=np.zeros((0, 2), np.int64), strong=np.full(n, MOST_ENTRIES))


def entries_at_rest(model: Model) -> int:
    """Return the largest number of entries of a constraint in statics, where a slider stands in one element."""
    widest = 1 if model.ties is None else int(np.max(np.diff(model.ties.start)))
    ends = _most_joined(model) * (widest + 1)
    if model.curves is None:
        return ends
    # the point, or the spin of the holder of a sleeve
    nodes = int(model.curves.count.max()) + _around(model)
    return max(ends, (nodes + 1) * widest + nodes + 1)


def contact_of(model: Model, entries: int | None = None, at_rest: bool = False, in_matrix: bool = False) -> Contact | None:
    """Allocate the work arrays of the constraints, with room for so many entries (default: `entries_of`); at_rest: in statics;
    in_matrix: for constraints in a sparse matrix."""
    n, row = model.n_constraints, 8 * len(model.dofs)
    if not n:
        return None
    _, degree, nodes = (0, 0, 0) if model.curves is None else model.curves.shape.max(axis=0)
    entries = entries or (entries_at_rest(model) if at_rest else entries_of(model) if model.n_bordered else 0)
    first = np.cumsum(model.unknowns) - model.unknowns if model.by_rows else np.where(
        model.carried, -1, model.border * (np.cumsum(~model.carried) - 1))
    kind = ContactInRows if model.by_rows else Contact if model.n_bordered else ContactOfCarriers
    kind = ContactAtRest if at_rest else ContactInMatrix if in_matrix else kind
    columns, lines = map(aligned_empty, [n * row * entries] * 2)
    # the identity behind the forces of joints, with zeros on the right
    corner = aligned(64 * n).reshape(n, 64)
    corner[:, ::9] = model.forces[:, None] <= np.arange(8)
    return kind(basis=empty((5, nodes)), legendre=empty((3, degree)), entries=np.zeros(n, np.int64),
                row=np.zeros((n, entries), np.int64), column=columns.reshape(n, -1), line=lines.reshape(n, -1),
                corner=corner, residual=np.zeros((n, 8)),
                element=np.zeros(n, np.int64), forces=model.forces, first=first,
                first_force=model.first_force, compliance=empty(n), softness=model.softness,
                remaining=empty(n),
                full=np.zeros(1, np.int64), augmented=empty(4), pair=model.coupled,
                cross=np.zeros((len(model.coupled), 2, 8)), strong=np.full(n, MOST_ENTRIES), before=empty(n))


def inner_of(model: Model) -> Inner | None:
    """Return the eliminated nodes with work arrays of one run."""
    if model.inner is None:
        return None
    inner = model.inner
    rhs = aligned_empty(inner.rhs.size) if isinstance(inner.rhs, np.ndarray) else inner.rhs
    return inner._replace(store=aligned_empty(inner.store.size), rhs=rhs,
                          mark=np.zeros_like(inner.mark), found=np.zeros_like(inner.found), state=np.ones(1))


def condensed_of(model: Model) -> Substructures | None:
    """Return the condensed beams with work arrays of one run."""
    if model.substructures is None:
        return None
    placed = place_stores(model.substructures, len(model.dofs))
    return placed._replace(store=aligned_empty(placed.store.size), ends=aligned_empty(placed.ends.size))


def _padded(n: int) -> Array:
    """Return n zeros with room for a row of 8 behind the last, so that short rows may be read as long ones."""
    return np.zeros(n + 8)[:n]


def law_work() -> Array:
    """Allocate the work array of user forces in one run."""
    work = np.zeros(SIZE)
    work[FACTOR] = 1.0
    return work


def scratch_of_moving(nodes: int, points: int, mass_points: int) -> Array:
    """Allocate the work array of a group of elements that move."""
    return aligned(moved.py_func(layout_of(SPACE, nodes, points), mass_points, SPACE).doubles)
