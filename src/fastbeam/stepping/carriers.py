"""Carriers in a run: groups of beams with sliders as systems of their own, each eliminated by one thread (theory.md 9)."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import NoInner
from fastbeam.kernels.beams.nodes import Held
from fastbeam.kernels.contact.coulomb import part_of
from fastbeam.kernels.contact.sleeve import NoTwist, Sleeves
from fastbeam.kernels.contact.slider import NoSleeves, Sliders, Sliding, no_following
from fastbeam.kernels.contact.slider_forces import Along
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.kernels.entries.dense import ContactInRows
from fastbeam.kernels.jit.records import Record
from fastbeam.kernels.layout import BLOCKS, LIST, NODES
from fastbeam.kernels.linalg import carriers as kernels
from fastbeam.kernels.linalg.carriers import GroupRows
from fastbeam.kernels.linalg.constraints import Constraints
from fastbeam.kernels.terms import Equilibrium, NoTies, System
from fastbeam.linalg.pattern import Pattern, ascending
from fastbeam.model.model import Model
from fastbeam.model.workspace import MOST_ENTRIES
from fastbeam.stepping.constraint_rows import couplings_of, with_capacity

if TYPE_CHECKING:
    from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# fields of `Along` that the start of a step and the end of an iteration set, and those that an iteration sets
BEFORE = "given", "held", "offset", "drive_side", "rub_side"
BEHIND = "asked", "needed", "under", "taken", "shapes", "drive_side", "rub_side"


def local_elements(tables: ElementTables, first: int, count: int, row_of: Array, idle: int) -> tuple[ElementTables, Array]:
    """Form groups of elements with rows of their own, `idle` in idle lanes; their blocks are missing. Return them with coupled
    rows of all pairs of their nodes, int [*, 2]."""
    meta = tables.meta[first:first + count].copy()
    at = [m[3] + np.arange(8 * m[0]) for m in meta]
    nodes, seen = tables.nodes[np.concatenate(at)], tables.rows[np.concatenate(at)]
    rows = np.where(seen == row_of.size, idle, row_of[nodes])
    width = meta[:, NODES]
    meta[:, LIST] = 8 * (np.cumsum(width) - width)
    meta[:, BLOCKS] = 8 * (np.cumsum(width**2) - width**2)
    pairs = []
    for begin, nn in zip(meta[:, LIST].tolist(), width.tolist()):
        own = rows[begin:begin + 8 * nn].reshape(nn, 8)
        pairs.append(np.stack(np.broadcast_arrays(own[:, None], own[None]), axis=-1).reshape(-1, 2))
    return ElementTables(meta, tables.tab, nodes, rows, np.zeros(0, np.int64)), np.concatenate(pairs)


class Shared:
    """Tables that all groups share: rows of all nodes within their group, and ties without those of nodes of beams."""

    def __init__(self, model: Model) -> None:
        c = model.carriers
        assert c is not None
        self.row_of = np.full(model.n_nodes, -1)
        self.groups = []
        for g in range(int(c.group[-1]) + 1):
            some = np.flatnonzero(c.group == g)
            inside = [_both_ends(np.arange(c.ends[k, 0] + 1, c.ends[k, 1])) for k in some.tolist()]
            points = c.point[c.point_start[some[0]]:c.point_start[some[-1] + 1]]
            nodes = np.concatenate((points, *inside, c.ends[some].reshape(-1)))
            self.row_of[nodes] = np.arange(nodes.size)
            self.groups.append((some, nodes))
        # moments act on nodes of beams themselves; what slides turns with its body
        self.spin_root = np.arange(model.n_nodes)
        self.spin_root[c.point] = model.spin_root[c.point]
        self.ties: Any = None
        if model.ties is not None:
            t = model.ties
            mine = np.zeros(model.n_nodes, bool)
            mine[c.point] = True
            count = np.diff(t.start)
            keep = np.repeat(mine, count)
            of_entry = {name: getattr(t, name).reshape(t.kind.size, -1)[keep].reshape(-1) for name in t._fields
                        if name not in ("slave", "row", "start", "moves")}
            of_entry["target_row"] = self.row_of[of_entry["target"]]
            self.ties = t._replace(start=np.concatenate(([0], np.cumsum(np.where(mine, count, 0)))),
                                   moves=np.zeros((0, 4), np.int64), **of_entry)


def _sleeves_on(every: Any, sliders: Array) -> tuple[Any, Array, Array]:
    """Return the table of the sleeves among some sliders, which of these they are, and their constraints of moments, int64 [*];
    every: the sleeves of the scene."""
    of = every.of_slider[sliders] if isinstance(every, Sleeves) else np.full(sliders.size, -1)
    on = np.flatnonzero(of >= 0)
    if not on.size:
        return NoSleeves(), on, on
    rows = {name: getattr(every, name).reshape(every.keyed.size, -1)[of[on]].reshape(-1) for name in ("keyed", "axes", "edges")}
    of_slider = np.where(of >= 0, np.cumsum(of >= 0) - 1, -1)
    own = every._replace(of_slider=of_slider, first=np.array([sliders.size]), twist=NoTwist(), **rows)
    return own, on, every.first[0] + of[on]


class AlongGroup:
    """Forces along the beams on the sliders of one group: copies of their rows of those of the scene; sliders: int64 [*]."""

    def __init__(self, whole: Along, sliders: Array) -> None:
        self.whole, self.sliders = whole, sliders
        # the clock is that of the scene
        rows = {name: getattr(whole, name)[sliders] for name in Along._fields if name not in ("clock", "coulomb")}
        self.part = whole._replace(coulomb=part_of(whole.coulomb, sliders), **rows)

    def take(self) -> None:
        """Copy rows of the scene as they are at the start of an iteration."""
        for name in BEFORE:
            getattr(self.part, name)[:] = getattr(self.whole, name)[self.sliders]
        for own, all_of in zip(self.part.coulomb, self.whole.coulomb):
            own[:] = all_of[self.sliders]

    def give(self) -> None:
        """Write what an iteration has changed back to the scene."""
        for name in BEHIND:
            getattr(self.whole, name)[self.sliders] = getattr(self.part, name)
        for own, all_of in zip(self.part.coulomb, self.whole.coulomb):
            all_of[self.sliders] = own


class Workspace:
    """Arrays of one thread, as long as the largest group needs them."""

    def __init__(self, scratch: Array) -> None:
        self.scratch = scratch
        self._arrays: dict[str, Array] = {}

    def array(self, name: str, *shape: int, kind: Any = float) -> Array:
        """Return an array of this shape with any numbers."""
        n = int(np.prod(shape))
        if name not in self._arrays or self._arrays[name].size < n:
            self._arrays[name] = aligned_empty(n).view(kind)
        return self._arrays[name][:n].reshape(shape)


def _both_ends(nodes: Array) -> Array:
    """Order nodes from both ends in turn: two at a time that do not wait for each other."""
    out = np.empty_like(nodes)
    out[::2], out[1::2] = nodes[:(nodes.size + 1) // 2], nodes[(nodes.size + 1) // 2:][::-1]
    return out


def _elements_of(model: Model, g: int, row_of: Array, n: int, sets: Any) -> tuple[list[Beams], Array]:
    """Form the elements of group g, whose nodes have n rows row_of, and the keys of the blocks of all coupled rows, ascending.
    sets: of strains."""
    parts, pairs = [], [np.stack((np.arange(n), np.arange(n)), axis=1)]
    assert model.carriers is not None
    every = model.carriers.tables
    for _, green, first, count in every[every[:, 0] == g].tolist():
        tables, couples = local_elements(model.green if green else model.simo, first, count, row_of, n)
        parts.append((tables, couples, sets[green]))
        pairs.append(couples[(couples < n).all(axis=1)])
    keys = ascending(np.concatenate([x[:, 0] * n + x[:, 1] for x in pairs]))
    elements = []
    for tables, couples, strains in parts:
        place = np.searchsorted(keys, np.minimum(couples[:, 0] * n + couples[:, 1], n * n))
        live = (couples < n).all(axis=1)
        elements.append(Beams(strains, tables._replace(blocks=np.where(live, place, keys.size)), NoInner()))
    return elements, keys


class Group:
    """One group of carriers."""

    def __init__(self, owner: Stepper, shared: Shared, g: int) -> None:
        model = owner.core
        c = model.carriers
        assert c is not None and model.bodies is not None and model.sliders is not None and model.substructures is not None
        self.owner, self.shared = owner, shared
        some, nodes = shared.groups[g]
        row_of = shared.row_of
        n = nodes.size
        self.sliders = c.slider[c.slider_start[some[0]]:c.slider_start[some[-1] + 1]]
        beam_of = np.repeat(np.arange(some.size), np.diff(c.slider_start)[some])
        sliding = next(term for term in owner.terms if isinstance(term, Sliding))
        sleeves, on, moments = _sleeves_on(sliding.sleeves, self.sliders)
        self.constraints = np.concatenate((self.sliders, moments))
        self.group_rows = GroupRows(model.pattern.row_of[nodes], model.substructures.beam.size - c.group.size + some, np.zeros(0),
                                    np.zeros(0, np.int32), np.zeros(1, np.int64))
        sets = model.strain_sets(isinstance(owner.system.method, Equilibrium))
        elements, keys = _elements_of(model, g, row_of, n, sets)
        block = np.append(np.searchsorted(keys, np.arange(n) * (n + 1)), keys.size)
        # what slides
        mine = np.zeros(model.n_nodes, bool)
        mine[c.point[c.point_start[some[0]]:c.point_start[some[-1] + 1]]] = True
        bodies = np.flatnonzero(mine[model.bodies.node])
        per_body = model.bodies.inertia.size // model.bodies.node.size
        node = model.bodies.node[bodies]
        self.bodies = model.bodies._replace(node=node, row=row_of[node], block=block[row_of[node]],
                                            inertia=model.bodies.inertia.reshape(-1, per_body)[bodies].reshape(-1))
        mask = model.fixed_mask[nodes]
        mask[n - 2 * some.size:] = 0
        rows = np.flatnonzero(mask)
        self.held = Held(rows, mask[rows], block[rows], block[rows], mask[rows], mask[rows])
        self.ties: Any = NoTies()
        if shared.ties is not None:
            t = shared.ties
            slave = model.ties.slave[mine[model.ties.slave]]
            self.ties = t._replace(slave=slave, row=row_of[slave], diagonal=block[np.minimum(t.target_row, n)])
        self._couple(keys, mask, beam_of, on)
        known, along = model.sliders, sliding.along
        self.along = AlongGroup(along, self.sliders) if isinstance(along, Along) else None
        limits = model.put_limits(np.zeros((model.n_sliders, 3)), model.s0)[self.sliders]
        sliders = Sliders(known.curve[self.sliders], known.point[self.sliders], shared.spin_root, no_following(self.sliders.size))
        sliding = Sliding(model.curves, sliders, self.ties, limits, along if self.along is None else self.along.part, sleeves)
        ties = () if isinstance(self.ties, NoTies) else (self.ties,)
        of_moments = (sleeves,) if on.size else ()
        self.terms = Record((sliding, *of_moments, *elements, self.bodies, *ties, self.held))
        self._allocate()

    def _couple(self, keys: Array, mask: Array, beam_of: Array, on: Array) -> None:
        """Make the rows of the constraints and the arrays of their equations. keys: of the blocks; mask: what is held of every
        row; beam_of: carrier of every slider; on: those that are sleeves."""
        model, n, carriers = self.owner.core, mask.size, self.group_rows.beam.size
        size = len(model.dofs)
        # they wait for all but the ends; moments of sleeves are those of their sliders
        ends = n - 2 * carriers + 2 * beam_of[:, None] + np.arange(2)
        unknowns, forces = model.unknowns[self.constraints], model.forces[self.constraints]
        pairs = np.stack((on, self.sliders.size + np.arange(on.size)), axis=1)
        pattern = Pattern(np.arange(n), keys, None, n, np.stack((keys // n, keys % n), axis=1)[keys // n < keys % n])
        self.couplings = couplings_of(pattern, size, 8 * size * (keys.size + 1), mask, np.full(n, -1),
                                      [*ends, *ends[on]], unknowns, forces,
                                      (np.arange(unknowns.size) < self.sliders.size).astype(np.int64), pairs)
        assert model.curves is not None
        self.capacity = 1.0
        # a point of a body is passed on twice
        self.entries = int(model.curves.count.max()) + (1 if model.ties is None else 2)
        s = self.constraints.size
        # where their forces stand in the state
        self.places = np.concatenate([k + np.arange(m) for k, m in zip(model.first_force[self.constraints], forces)])
        self.s, self.s_end, self.force = empty(beam_of.size), empty(beam_of.size), empty(self.places.size)
        integers = {name: np.zeros(s, np.int64) for name in ("entries", "element")}
        self.own: dict[str, Array] = dict(
            integers, residual=empty((s, 8)), forces=forces, first=self.couplings.first,
            first_force=self.couplings.first_force, compliance=empty(s), softness=np.ones(s), remaining=empty(s),
            full=np.zeros(1, np.int64), augmented=empty(4), pair=pairs, cross=empty((on.size, 2, 8)),
            strong=np.full(s, MOST_ENTRIES))

    def _allocate(self) -> None:
        """Allocate room for so many entries of a slider, and everything else by scale."""
        size = len(self.owner.core.dofs)
        carriers, nodes = self.group_rows.beam.size, self.couplings.diagonal.size
        rows = with_capacity(self.couplings, self.entries, 0, size, self.capacity, fill=16 * size * (nodes - 2 * carriers),
                             pairs=len(self.own["pair"]))
        rows.order.rank[:] = np.arange(nodes)
        # blocks are work of a thread
        self._store = rows.factors.store.size
        none = np.zeros(0)
        self.rows: Constraints = rows._replace(buffer=none, factors=rows.factors._replace(
            store=none, x=none, pivots=none.astype(np.int8), own=none))
        order = rows.order
        self.short = order._replace(order=order.order[:order.order.size - 2 * carriers])
        place = np.zeros(order.column.size, np.int32)
        self.group_rows = self.group_rows._replace(place=place)
        self.kept = self.short._replace(upper=place)

    def _contact(self, space: Workspace) -> ContactInRows:
        """Work of the sliders, most of it that of a thread."""
        s, entries, row, shape = self.constraints.size, self.entries, 8 * len(self.owner.core.dofs), self.owner.core.curves.shape
        return ContactInRows(
            basis=space.array("basis", 5, int(shape[:, 2].max())), legendre=space.array("legendre", 3, int(shape[:, 1].max())),
            row=space.array("row", s, entries, kind=np.int64), column=space.array("column", s, row * entries),
            line=space.array("line", s, row * entries), corner=space.array("corner", s, 64), **self.own)

    def _system(self, system: System, space: Workspace) -> System:
        work, n, s = system.work, self.couplings.diagonal.size, self.constraints.size
        rows = n + s
        factors = self.rows.factors._replace(store=space.array("store", self._store), x=space.array("x", 8 * rows),
                                             pivots=space.array("pivots", 8 * rows, kind=np.int8), own=space.array("own", 7 * s))
        return system._replace(
            contact=self._contact(space), solver=self.rows._replace(factors=factors), row_of=self.shared.row_of, width=1,
            state=system.state._replace(s=self.s, force=self.force),
            work=work._replace(s_end=self.s_end, r=space.array("r", 8 * (n + 1)), blocks=factors.store[:self.couplings.end[0]],
                               y=space.array("y", 7 * s), scratch=space.scratch,
                               increment=work.increment._replace(x=space.array("increment", 8 * (n + 1)))))

    @property
    def singular(self) -> int:
        """Number of a slider without a pivot, or -1."""
        k = int(self.rows.factors.failed[1])
        return -1 if k < 0 else int(self.constraints[k])

    def condense(self, system: System, h: float, ends: Array, space: Workspace) -> bool:
        """Assemble and eliminate; more room where there is too little. Returns False where a pivot counts as zero."""
        state, own = system.state, self.own
        self.s[:], self.s_end[:] = state.s[self.sliders], system.work.s_end[self.sliders]
        self.force[:] = state.force[self.places]
        while True:
            own["augmented"][:3] = system.contact.augmented[:3]
            own["full"][0] = 0
            if self.along is not None:
                self.along.take()
            good = bool(kernels.condense_carriers(self.terms, self._system(system, space), self.short, self.held, self.group_rows,
                                                  h, system.work.increment.x, ends))
            if not self.rows.factors.failed[0]:
                if self.along is not None:
                    self.along.give()
                return good
            if self.group_rows.end[0] > self.group_rows.kept.size:
                self.group_rows = self.group_rows._replace(kept=aligned_empty(int(self.group_rows.end[0])))
                continue
            if own["full"][0]:
                self.entries += max(2, self.entries // 4)
            else:
                self.capacity *= 1.25
            self._allocate()

    def recover(self, system: System, space: Workspace) -> float:
        """Recover the increments of everything in the group, sliders too. Returns the largest of a place on a beam."""
        state, own = system.state, self.own
        local = self._system(system, space)
        rows = local.solver
        local = local._replace(solver=rows._replace(factors=rows.factors._replace(store=self.group_rows.kept)))
        kernels.recover_carriers(self.terms, local, self.kept, self.group_rows, system.work.increment.x)
        system.work.s_end[self.sliders] = self.s_end
        state.force[self.places] = self.force
        system.contact.remaining[self.constraints] = own["remaining"]
        return float(own["augmented"][3])
