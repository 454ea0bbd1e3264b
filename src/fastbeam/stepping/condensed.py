"""Newton iterations of scenes with beams, or pieces of them, condensed to their ends, on several threads (theory.md 9).

Threads take chunks of beams, nodes, blocks and rows. Every chunk writes what belongs to it, sums have a fixed order, and the
largest increment is that of all chunks: results do not depend on the number of threads. Compiled code runs without Python's lock.
"""
from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import count
from fastbeam.interface.errors import SceneError
from fastbeam.kernels import loop as step
from fastbeam.kernels.beams import nodes
from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import Inner, NoInner
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.beams.moving_supports import MovedRows
from fastbeam.kernels.beams.nodes import Bodies, Held, extrapolation
from fastbeam.kernels.beams.planar_nodes import PlanarBodies, PlanarTies
from fastbeam.kernels.beams.ties import COLUMN_ENTRY, ROW_ENTRY, TARGET, Ties
from fastbeam.kernels.call_tables import ASSEMBLY, Calls, SystemRecord, Table
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.kernels.layout import LIST
from fastbeam.kernels.linalg import substructures as beams
from fastbeam.kernels.linalg.substructures import ELEMENTS, FIRST_GROUP, NODES_EACH
from fastbeam.kernels.state import follow_increment, start_increment
from fastbeam.kernels.terms import Equilibrium, advance_nodes, apply_ties, assemble, predict_nodes
from fastbeam.model.workspace import condensed_of, scratch_of
from fastbeam.stepping.carriers import Group, Shared, Workspace
from fastbeam.stepping.iteration import Iteration

if TYPE_CHECKING:
    from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
Chunk = tuple[int, int]
# chunks of beams at most, and of what takes a few microseconds a chunk. On any number of threads the same: at the end of a chunk
# loops go through numbers one by one and not by eights, which may round in another way
MOST_CHUNKS, FEW_CHUNKS = 64, 16
# nodes of elements in a chunk of beams at least: a call of compiled code with all its arrays takes 6 us, such a chunk 80
NODES_A_CHUNK = 64
# elements from which on one more thread pays
ELEMENTS_A_THREAD = 2000


def thread_count(threads: int | None, elements: int) -> int:
    """Choose the threads of a run with so many elements in condensed beams: as asked for, else FASTBEAM_THREADS, else all
    processors that this process may use and that have enough to do. Raises SceneError: not a whole number >= 1."""
    if threads is not None:
        return count("threads", threads)
    named = os.environ.get("FASTBEAM_THREADS")
    if named:
        if not named.isdigit() or int(named) < 1:
            raise SceneError(f"FASTBEAM_THREADS: must be a whole number >= 1, got {named!r}; unset it, or use threads=...")
        return int(named)
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(processors, elements // ELEMENTS_A_THREAD))


def chunks(n: int, least: int, first: int = 0, most: int = FEW_CHUNKS) -> list[Chunk]:
    """Cut first .. first + n into equal parts of at least `least`, at most `most` of them."""
    parts = max(1, min(most, n // least)) if n else 0
    edges = [first + n * k // max(parts, 1) for k in range(parts + 1)]
    return list(zip(edges[:-1], edges[1:]))


class Team:
    """A number of threads, the calling one among them."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads - 1, "fastbeam") if threads > 1 else None

    def each(self, work: Callable[[int, Any], Any], items: Sequence[Any]) -> list[Any]:
        """Call work(thread, item) for all items, in any order; return the results in that of the items."""
        out: list[Any] = [None] * len(items)
        # taking the next from a list iterator is one operation to Python
        left = iter(list(enumerate(items)))

        def go_on(thread: int, left: Iterator[Any]) -> None:
            for k, item in left:
                out[k] = work(thread, item)

        others = [self._pool.submit(go_on, k, left) for k in range(1, min(self.threads, len(items)))] if self._pool else []
        try:
            go_on(0, left)
        finally:
            for other in others:
                other.result()
        return out


def _fixed_of_solver(held: Held, n: int) -> Held:
    """Return the fixed unknowns in the n rows that the solver sees."""
    seen = held.row < n
    return held._replace(row=held.row[seen], mask=held.mask[seen], diagonal=held.diagonal[seen])


def _bodies_of_solver(bodies: Any, n: int) -> Any:
    """Return the bodies in the n rows that the solver sees."""
    seen = bodies.row < n
    inertia = bodies.inertia.reshape(seen.size, -1)[seen].reshape(-1)
    return bodies._replace(node=bodies.node[seen], row=bodies.row[seen], block=bodies.block[seen], inertia=inertia)


def _ties_of_solver(ties: Any, eliminated: Array) -> Any:
    """Return the tie table without the eliminated nodes."""
    seen = ~np.isin(ties.slave, eliminated)
    moved = np.isin(ties.target, eliminated)
    entry = np.maximum(ties.moves[:, [ROW_ENTRY, COLUMN_ENTRY]], 0)
    moves = ties.moves[~((ties.moves[:, [ROW_ENTRY, COLUMN_ENTRY]] >= 0) & moved[entry]).any(axis=1)]
    return ties._replace(slave=ties.slave[seen], row=ties.row[seen], moves=np.ascontiguousarray(moves))


class CondensedIteration(Iteration):
    """Newton iterations of a model with condensed beams; the rest of its elements, bodies and sliders are one more chunk, and
    each group of carriers is one."""

    def hold(self) -> None:
        if self._carriers:
            self._take_terms()

    def _take_terms(self) -> None:
        """Collect the terms without fixed rows and tied points of carriers, which the panel does not have, and the fixed unknowns
        in rows that the solver sees (reactions are what stands in rows before)."""
        own: list[Any] = list(self.owner.terms)
        if self._carriers:
            n = self.owner.core.pattern.n
            own = [_fixed_of_solver(x, n) if isinstance(x, Held) else self._ties if isinstance(x, (Ties, PlanarTies)) else x
                   for x in own]
            self._panel = Calls(tuple(own))
        self._held = Calls(tuple(x for x in own if isinstance(x, (MovedRows, Held))), ASSEMBLY)

    @property
    def records(self) -> tuple[Table, SystemRecord]:
        terms, system = self.owner.records
        return self._panel.on(system) if self._carriers else (terms, system)

    def __init__(self, owner: Stepper, threads: int) -> None:
        super().__init__(owner)
        self.team = Team(threads)
        model = owner.core
        subs = condensed_of(model)
        assert subs is not None
        self.subs = subs
        self._scratch = [scratch_of(model) for _ in range(threads)]
        parts = model.groups_of_beams()
        rest: list[Any] = []
        self._groups: list[tuple[ElementTables, Any, Chunk]] = []
        done = 0
        self._at_rest = isinstance(owner.system.method, Equilibrium)
        for tables, groups, strains in zip((model.simo, model.green), parts, model.strain_sets(self._at_rest)):
            n = 0 if tables is None else model.others(tables, groups)
            if tables is not None and n:
                inner = NoInner() if owner.inner is None else owner.inner
                rest.append(Beams(strains, tables._replace(meta=tables.meta[:n]), inner))
            least = max(2, NODES_A_CHUNK * len(groups) // max(1, int(np.sum(groups[:, ELEMENTS] * groups[:, NODES_EACH]))))
            self._groups += [(tables, strains, chunk) for chunk in chunks(len(groups), least, done, MOST_CHUNKS)]
            done += len(groups)
        # terms that one chunk assembles, in the order of kernels/terms.py; tied nodes come last
        before = (Sliding, Inner) if model.n_bordered else Inner
        bodies = tuple(x for x in owner.terms if isinstance(x, (Bodies, PlanarBodies)))
        # links, drag, user forces, what joints leave free: all that has no pass of its own
        own_passes = Beams, Inner, Sliding, Bodies, PlanarBodies, Ties, PlanarTies, MovedRows, Held
        others = tuple(x for x in owner.terms if not isinstance(x, own_passes)
                       and assemble.covers(type(x), type(owner.system.method)))
        self._ties = model.ties
        self._carriers: list[Group] = []
        if model.carriers is not None:
            shared = Shared(model)
            self._carriers = [Group(owner, shared, g) for g in range(len(shared.groups))]
            self._spaces = [Workspace(scratch) for scratch in self._scratch]
            bodies = tuple(_bodies_of_solver(x, model.pattern.n) for x in bodies)
            self._ties = None if model.ties is None else _ties_of_solver(model.ties, model.carriers.point)
        self._take_terms()
        self._rest = Calls((*(x for x in owner.terms if isinstance(x, before)), *rest, *bodies, *others), ASSEMBLY)
        self._nodes = chunks(model.n_nodes, 1024)
        inside = np.zeros(model.n_nodes + 1, np.int64)
        for tables, groups in zip((model.simo, model.green), parts):
            for number, nn in np.unique(groups[:, [ELEMENTS, NODES_EACH]], axis=0).tolist():
                first = groups[(groups[:, ELEMENTS] == number) & (groups[:, NODES_EACH] == nn), FIRST_GROUP, None]
                inside[tables.nodes[tables.meta[first, LIST] + np.arange(8)] + 1] += 1
                inside[tables.nodes[tables.meta[first + number - 1, LIST] + 8 * (nn - 1) + np.arange(8)]] -= 1
        # all nodes but those between the ends of condensed beams
        self._others = np.flatnonzero(np.cumsum(inside)[:-1] == 0)
        self._some = chunks(self._others.size, 1024)
        self._rows = chunks(int(subs.counts[0]), 1024)
        self._blocks = chunks(model.n_blocks + 1, 512)
        self._terms = [(beams.add_end_blocks, owner.work.blocks, chunk) for chunk in chunks(subs.block_start.size - 1, 512)]
        self._terms += [(beams.add_end_rows, owner.work.r, chunk) for chunk in chunks(subs.row_start.size - 1, 512)]
        self._moves: list[Chunk] = []
        if self._ties is not None:
            # all contributions to one block belong to one chunk
            target = self._ties.moves[:, TARGET]
            edges = [0, *(int(np.searchsorted(target, target[a])) for a, _ in chunks(target.size, 256)[1:]), target.size]
            self._moves = [(a, b) for a, b in zip(edges[:-1], edges[1:]) if b > a]

    # --- loops over nodes ---------------------------------------------------------------------------------------------
    def _copy(self, *pairs: tuple[Array, Array]) -> None:
        """Copy arrays, each a number of doubles for every node."""
        items = [(source, target, a, b) for source, target in pairs for a, b in chunks(min(source.size, target.size), 16384)]
        self.team.each(lambda _, x: np.copyto(x[1][x[2]:x[3]], x[0][x[2]:x[3]]), items)

    def keep(self) -> None:
        state, work = self.owner.core_state, self.owner.work
        self._copy((state.q, work.keep_q), (state.v, work.keep_v), (state.s, work.keep_s), (state.force, work.keep_force),
                   (state.history, work.keep_history),
                   (work.dphi, work.keep_dphi), (work.theta, work.keep_theta), (work.past, work.keep_past))

    def restore(self) -> None:
        state, work = self.owner.core_state, self.owner.work
        self._copy((work.keep_q, state.q), (work.keep_v, state.v), (work.keep_s, state.s), (work.keep_force, state.force),
                   (work.keep_history, state.history),
                   (work.keep_dphi, work.dphi), (work.keep_theta, work.theta), (work.keep_past, work.past))

    def start(self, h: float) -> None:
        s, m = self.owner, self.owner.core
        if self._at_rest:
            super().start(h)
            return
        state, work = s.core_state, s.work
        c = extrapolation(work.past, h)
        self.team.each(lambda _, x: predict_nodes(m.dofs, state, work, m.spinless, h, c, *x), self._nodes)
        start_increment(work)
        step.guess_some(*s.records, h, c)

    def finish(self, h: float) -> None:
        state, work = self.owner.core_state, self.owner.work
        step.account_all(*self.owner.records, h)
        work.past[-1] = work.increment.control[2]
        nodes.remember(state.s, work.s_end, state.force, self.owner.core.dim, h, work.past)
        self._advance(h)
        state.s[:] = work.s_end

    def _advance(self, h: float) -> None:
        """Accept the increments."""
        system = self.owner.system
        self.team.each(lambda thread, x: advance_nodes(system.dofs, system.method, system.state, system.work, h, *x,
                                                       self._scratch[thread]), self._nodes)

    # --- the system of equations --------------------------------------------------------------------------------------
    def assemble(self, h: float) -> None:
        s, m = self.owner, self.owner.core
        state, work, n, system = s.core_state, s.work, 8 * len(m.dofs), s.system
        shared = s.records[1]
        step.clear_some(*self._rest.on(shared))

        def begin(_: int, x: tuple[str, Chunk]) -> None:
            kind, (a, b) = x
            if kind == "others":
                beams.spread_listed(self._others, a, b, m.dofs, system.method, state, work, h)
            elif kind == "rows":
                np.negative(work.f_ext[8 * a:8 * b], out=work.r[8 * a:8 * b])
            else:
                work.blocks[n * a:n * b] = 0.0

        kinds = ("others", self._some if work.q_mid.size else []), ("rows", self._rows), ("blocks", self._blocks)
        self.team.each(begin, [(kind, x) for kind, some in kinds for x in some])
        work.r[8 * m.n_nodes:] = 0.0

        # arrays of state and work that the kernel needs: every array that is passed takes time
        move = motion.implementation(system.method).py_func(system.method, state, work, h)

        def condense(thread: int, x: tuple[ElementTables, Any, Chunk] | Group | None) -> bool:
            if x is None:
                # loads on inner nodes enter the residual before these are eliminated
                step.assemble_some(*self._rest.on(shared), h)
                return True
            if isinstance(x, Group):
                return x.condense(system, h, self.subs.ends, self._spaces[thread])
            tables, strains, some = x
            beams.condense(self.subs, tables, strains, *some, move, work.f_ext, self._scratch[thread], m.dofs)
            return True

        self._good = all(self.team.each(condense, [None, *self._carriers, *self._groups]))
        for group in self._carriers:
            s.contact.residual[group.constraints] = group.own["residual"]
        self.team.each(lambda _, x: x[0](self.subs, *x[2], x[1], m.dofs), self._terms)
        if self._ties is not None:
            t = self._ties
            apply_ties(t, 0, t.slave.size, 0, 0, work.q_mid, work.q_end, work.r, work.blocks, work.scratch)
            self.team.each(lambda thread, x: apply_ties(t, 0, 0, *x, work.q_mid, work.q_end, work.r, work.blocks,
                                                        self._scratch[thread]), self._moves)
        if self._held.terms:
            step.assemble_some(*self._held.on(shared), h)

    @property
    def is_regular(self) -> bool:
        return super().is_regular and bool(self.subs.state.all()) and (self._good or self._singular >= 0)

    @property
    def _singular(self) -> int:
        """Number of the first slider without a pivot on a carrier, or -1."""
        return min((group.singular for group in self._carriers if group.singular >= 0), default=-1)

    def solve_panel(self) -> bool:
        s, m = self.owner, self.owner.core
        if not self._good:
            # `update` tells which slider it is
            return True
        if not s.linear.is_compiled:
            return super().solve_panel()
        if s.linear.pardiso is not None:
            return s.linear.pardiso.solve(s.work.blocks, s.work.panel, m.width, m.dofs, self.team.each)
        return bool(step.solve_right(*s.records))

    # --- increments ---------------------------------------------------------------------------------------------------
    def update(self) -> float:
        s, m = self.owner, self.owner.core
        work, row_of, system = s.work, m.pattern.row_of, s.system
        if self._at_rest:
            work.theta[:] = 0.0
            work.dphi[:] = 0.0
        if not self._good:
            return -1.0 - self._singular
        singular, slide = step.close_right(*self.records)
        if singular < 0.0:
            return float(singular)
        if self._carriers:
            slides = self.team.each(lambda thread, x: x.recover(system, self._spaces[thread]), self._carriers)
            slide = float(np.max([slide, *slides]))
            s.contact.augmented[2] = 0.0
        # interior of the beams, and the increments of all nodes
        factor = -0.5 if self._at_rest else -1.0

        def recover(thread: int, x: tuple[ElementTables, Any, Chunk]) -> tuple[float, float]:
            return beams.recover(self.subs, x[0], *x[2], factor, row_of, work, self._scratch[thread], m.dofs)

        found = self.team.each(recover, self._groups)
        found += self.team.each(lambda _, x: beams.move_listed(self._others, *x, m.dofs, row_of, work), self._some)
        # NaN stays the largest
        move, spin = (float(x) for x in np.max(found, axis=0))
        step.follow_some(*s.records)
        if self._at_rest:
            self._advance(0.0)
        follow_increment(work.increment, move / m.length + spin)
        return move / m.length + spin + slide / m.length
