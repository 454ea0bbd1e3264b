"""Newton iterations of scenes with beams, or pieces of them, condensed to their ends, on several threads (theory.md 9).

Threads take chunks of beams, nodes, blocks and rows. Every chunk writes what belongs to it, sums have a fixed order, and the
largest increment is that of all chunks: results do not depend on the number of threads. Compiled code runs without Python's lock.
"""
from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from .arguments import count
from .errors import SceneError
from .iteration import Iteration, Owner
from .kernels import beam, border, nodes, planar_beam, planar_nodes, planar_slider, slider, step, ties
from .kernels import substructures as beams
from .kernels.beam import ElementTables
from .kernels.inner import clear_rhs
from .kernels.nodes import apply_held, extrapolation
from .kernels.work import Work, follow_line, start_line

Array = np.ndarray
Chunk = tuple[int, int]
# chunks of beams at most, and of what takes a few microseconds a chunk. On any number of threads the same: at the end of a chunk
# loops go through numbers one by one and not by eights, which may round in another way
MOST_CHUNKS, FEW_CHUNKS = 64, 16
# elements from which on one more thread pays
ELEMENTS_A_THREAD = 2000


def thread_count(threads: int | None, elements: int) -> int:
    """Threads of a run with so many elements in condensed beams: as asked for, else FASTBEAM_THREADS, else all processors that
    this process may use and that have enough to do.

    Raises
    ------
    SceneError
        Not a whole number >= 1.
    """
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
    """first .. first + n cut into equal parts of at least so many, `most` of them at most."""
    parts = max(1, min(most, n // least)) if n else 0
    edges = [first + n * k // max(parts, 1) for k in range(parts + 1)]
    return list(zip(edges[:-1], edges[1:]))


class Step(NamedTuple):
    """What the element loops take of a step, see `beam.element_groups`; statics has only q and line."""

    q: Array
    dphi: Array | None
    v: Array | None
    line: Any
    h: float | None
    rate: float | None


class Team:
    """A number of threads, the calling one among them."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads - 1, "fastbeam") if threads > 1 else None

    def each(self, work: Callable[[int, Any], Any], items: Sequence[Any]) -> list[Any]:
        """work(thread, item) for all items, in any order; the results in that of the items."""
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


class _Space:
    """Kernels of nodes in space."""

    predict, advance = nodes.predict, nodes.advance
    tie_increments, apply_ties, push_tied = ties.tie_increments, ties.apply_ties, ties.push_tied_columns
    predict_sliders, add_sliders, add_bodies = slider.predict_sliders, slider.add_sliders, nodes.add_bodies

    @staticmethod
    def add_elements(tables: ElementTables, inner: Any, step: Step, work: Work, green: int | None, size: Any) -> None:
        """Elements that are not in condensed beams."""
        q, dphi, v, line, h, rate = step
        beam.element_groups(tables, 0, len(tables.meta), inner, q, dphi, v, None, line, h, rate, None, green, None, work.r,
                            work.blocks, work.scratch, size)


class _Plane:
    """The same in a plane."""

    predict, advance = planar_nodes.planar_predict, planar_nodes.planar_advance
    tie_increments, apply_ties, push_tied = (planar_nodes.tie_planar_increments, planar_nodes.apply_planar_ties,
                                             planar_nodes.planar_push)
    predict_sliders, add_sliders, add_bodies = (planar_slider.predict_planar_sliders, planar_slider.add_planar_sliders,
                                                planar_nodes.add_planar_bodies)

    @staticmethod
    def add_elements(tables: ElementTables, inner: Any, step: Step, work: Work, green: int | None, size: Any) -> None:
        """Elements that are not in condensed beams."""
        planar_beam.planar_groups(tables, 0, len(tables.meta), inner, *step, green, work.r, work.blocks, work.scratch, size)


class CondensedIteration(Iteration):
    """Of a model with condensed beams; the rest of its elements, bodies and sliders are one more chunk.

    Parameters
    ----------
    owner : Stepper
    threads : int
    """

    def __init__(self, owner: Owner, threads: int) -> None:
        super().__init__(owner)
        self.team = Team(threads)
        model = owner.core
        subs = model.substructure_work()
        assert subs is not None
        self.subs = subs
        self.kernels: Any = _Space if owner.kind[1] is None else _Plane
        self._scratch = [model.scratch() for _ in range(threads)]
        parts = model.groups_of_beams()
        self._rest: list[tuple[ElementTables, int | None]] = []
        self._groups: list[tuple[ElementTables, int | None, Chunk]] = []
        done = 0
        for tables, groups, green in ((model.simo, parts[0], None), (model.green, parts[1], 1)):
            n = 0 if tables is None else len(tables.meta) - int(groups[:, 1].sum())
            if tables is not None and n:
                self._rest.append((tables._replace(meta=tables.meta[:n]), green))
            self._groups += [(tables, green, chunk) for chunk in chunks(len(groups), 2, done, MOST_CHUNKS)]
            done += len(groups)
        self._nodes = chunks(model.n_nodes, 1024)
        inside = np.zeros(model.n_nodes + 1, np.int64)
        for tables, groups in zip((model.simo, model.green), parts):
            for count, nn in np.unique(groups[:, 1:3], axis=0).tolist():
                first = groups[(groups[:, 1] == count) & (groups[:, 2] == nn), 0, None]
                inside[tables.nodes[tables.meta[first, 3] + np.arange(8)] + 1] += 1
                inside[tables.nodes[tables.meta[first + count - 1, 3] + 8 * (nn - 1) + np.arange(8)]] -= 1
        # all nodes but those between the ends of condensed beams
        self._others = np.flatnonzero(np.cumsum(inside)[:-1] == 0)
        self._some = chunks(self._others.size, 1024)
        self._rows = chunks(int(subs.counts[0]), 1024)
        self._blocks = chunks(model.n_blocks + 1, 512)
        self._terms = [(beams.add_end_blocks, owner.work.blocks, chunk) for chunk in chunks(subs.block_start.size - 1, 512)]
        self._terms += [(beams.add_end_rows, owner.work.r, chunk) for chunk in chunks(subs.row_start.size - 1, 512)]
        self._moves: list[Chunk] = []
        if model.ties is not None:
            # what adds to one block stays together
            target = model.ties.moves[:, 3]
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
                   (work.dphi, work.keep_dphi), (work.theta, work.keep_theta), (work.past, work.keep_past))

    def restore(self) -> None:
        state, work = self.owner.core_state, self.owner.work
        self._copy((work.keep_q, state.q), (work.keep_v, state.v), (work.keep_s, state.s), (work.keep_force, state.force),
                   (work.keep_dphi, work.dphi), (work.keep_theta, work.theta), (work.keep_past, work.past))

    def start(self, h: float) -> None:
        s, m = self.owner, self.owner.core
        state, work = s.core_state, s.work
        c = extrapolation(work.past, h)
        self.team.each(lambda _, x: self.kernels.predict(state.q, state.v, h, c, work.past, m.spinless, *x, work.theta,
                                                         work.dphi), self._nodes)
        start_line(work)
        if m.ties is not None:
            self.kernels.tie_increments(m.ties, state.q, work.theta, work.dphi, work.line.off)
        if s.contact is not None:
            s.contact.augmented[2] = 1.0
            self.kernels.predict_sliders(m.curves, m.sliders, s.contact, state.q, state.v, state.s, h, c, work.past, work.s_end,
                                         state.force)

    def finish(self, h: float) -> None:
        state, work = self.owner.core_state, self.owner.work
        work.past[-1] = work.line.use[2]
        nodes.remember(state.s, work.s_end, state.force, h, work.past)
        self._advance(state.v, h)
        state.s[:] = work.s_end

    def _advance(self, v: Array | None, h: float | None) -> None:
        """Accept the increments; in statics v and h are None."""
        q, work = self.owner.core_state.q, self.owner.work
        self.team.each(lambda thread, x: self.kernels.advance(q, v, work.dphi, work.theta, h, *x, self._scratch[thread]),
                       self._nodes)

    # --- the system of equations --------------------------------------------------------------------------------------
    def assemble(self, h: float) -> None:
        s, m = self.owner, self.owner.core
        state, work = s.core_state, s.work
        now = Step(state.q, work.dphi, state.v, work.line, h, 2.0 / (h * h))

        def add_rest() -> None:
            # what acts on inner nodes stands in the residual before they are eliminated
            if s.contact is not None:
                self.kernels.add_sliders(m.curves, m.sliders, s.contact, m.ties, m.pattern.row_of, state.q, work.q_mid,
                                         work.q_end, work.theta, state.s, work.s_end, state.force, work.r)
            self._add_elements(now)
            if m.bodies is not None:
                self.kernels.add_bodies(m.bodies, work.q_mid, work.q_end, work.u, now.rate, work.r, work.blocks)

        self._assemble(add_rest, now, m.held)

    def _add_elements(self, now: Step) -> None:
        for tables, green in self._rest:
            self.kernels.add_elements(tables, self.owner.inner, now, self.owner.work, green, self.owner.core.size)

    def assemble_static(self) -> None:
        now = Step(self.owner.core_state.q, None, None, self.owner.work.line, None, None)
        self._assemble(lambda: self._add_elements(now), now, self.owner.core.static_held)

    def _assemble(self, add_rest: Callable[[], None], now: Step, held: Any) -> None:
        s, m = self.owner, self.owner.core
        state, work, n = s.core_state, s.work, 8 * len(m.size)
        if s.inner is not None:
            s.inner.state[0] = 1.0
            clear_rhs(s.inner.rhs)

        def begin(_: int, x: tuple[str, Chunk]) -> None:
            kind, (a, b) = x
            if kind == "others":
                beams.spread_nodes(self._others, a, b, *s.kind[:2], state, work, now.h)
            elif kind == "rows":
                np.negative(work.f_ext[8 * a:8 * b], out=work.r[8 * a:8 * b])
            else:
                work.blocks[n * a:n * b] = 0.0

        kinds = ("others", self._some if work.q_mid.size else []), ("rows", self._rows), ("blocks", self._blocks)
        self.team.each(begin, [(kind, x) for kind, some in kinds for x in some])
        work.r[8 * m.n_nodes:] = 0.0

        def condense(thread: int, x: tuple[ElementTables, int | None, Chunk] | None) -> None:
            if x is None:
                add_rest()
                return
            tables, green, some = x
            beams.condense(self.subs, tables, *some, *s.kind[:2], *now, green, work.f_ext, self._scratch[thread], m.size)

        self.team.each(condense, [None, *self._groups])
        self.team.each(lambda _, x: x[0](self.subs, *x[2], x[1], m.size), self._terms)
        if m.ties is not None:
            apply, t = self.kernels.apply_ties, m.ties
            apply(t, 0, t.slave.size, 0, 0, work.q_mid, work.q_end, work.r, work.blocks, work.scratch)
            self.team.each(lambda thread, x: apply(t, 0, 0, *x, work.q_mid, work.q_end, work.r, work.blocks,
                                                   self._scratch[thread]), self._moves)
        if held is not None:
            apply_held(held, work.r, work.blocks, m.size)

    @property
    def is_regular(self) -> bool:
        return super().is_regular and bool(self.subs.state.all())

    def solve_panel(self) -> bool:
        s, m = self.owner, self.owner.core
        if not s.linear.is_compiled:
            return super().solve_panel()
        if s.linear.pardiso is not None:
            return s.linear.pardiso.solve(s.work.blocks, s.work.panel, m.width, m.size, self.team.each)
        return bool(step.solve_nodes(s.contact, None, m.pattern.plan, None, s.work, m.width, m.size))

    # --- increments ---------------------------------------------------------------------------------------------------
    def _take(self, factor: float) -> None:
        """Increments of all rows but those of the interior of beams, in a scene without sliders; factor: increment per solution
        of the equations."""
        s, m = self.owner, self.owner.core
        if s.inner is not None:
            step.take_rows(*s.kind[:2], m.simo, m.green, s.inner, m.ties, factor, factor, m.width, s.work, m.size)
            return
        border.take_solution(s.work.panel, m.width, factor, s.work.line.x, m.size)
        self._push_ties()

    def _push_ties(self) -> None:
        """Rows of increments of tied nodes from those of their targets."""
        if self.owner.core.ties is not None:
            self.kernels.push_tied(self.owner.core.ties, self.owner.work.q_end, self.owner.work.line.x, 8, 1, 1)

    def _move(self, factor: float) -> float:
        """Recover the interior of the beams and add the increments of all nodes; factor: increment per solution of the equations.
        Returns their size."""
        s, m = self.owner, self.owner.core
        work, row_of = s.work, m.pattern.row_of
        moved = *s.kind[:2], row_of, work

        def recover(thread: int, x: tuple[ElementTables, int | None, Chunk]) -> tuple[float, float]:
            return beams.recover(self.subs, x[0], *x[2], factor, *moved, self._scratch[thread], m.size)

        found = self.team.each(recover, self._groups)
        found += self.team.each(lambda _, x: beams.move_listed(self._others, *x, *moved), self._some)
        # NaN stays the largest
        move, spin = (float(x) for x in np.max(found, axis=0))
        if m.ties is not None:
            self.kernels.tie_increments(m.ties, s.core_state.q, work.theta, work.dphi, work.line.off)
        follow_line(work.line, move / m.length + spin)
        return move / m.length + spin

    def update(self) -> float:
        s, m = self.owner, self.owner.core
        state, work = s.core_state, s.work
        slide = 0.0
        if s.contact is None:
            self._take(-1.0)
        else:
            if s.inner is not None:
                step.complete_panel(*s.kind[:2], s.inner, m.ties, m.width, work, m.size)
            singular = border.solve_border(s.contact, state.force, work.panel, m.width, work.rows, work.schur, work.y,
                                           work.line.x, m.size)
            if singular >= 0:
                return -1.0 - singular
            self._push_ties()
            found = work.y.reshape(m.n_sliders, m.border)
            state.force[:] += found[:, :m.dim].reshape(-1)
            work.s_end[:] += found[:, m.dim]
            slide = float(np.max(np.abs(found[:, m.dim])))
        return self._move(-1.0) + slide / m.length

    def update_static(self) -> float:
        self._take(-0.5)
        work = self.owner.work
        work.theta[:] = 0.0
        work.dphi[:] = 0.0
        moved = self._move(-0.5)
        self._advance(None, None)
        return moved
