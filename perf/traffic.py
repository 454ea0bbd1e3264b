"""Bytes that the passes of a step read and write, counted from the arrays themselves; and what a run keeps in memory.

A pass is a loop over arrays that a cache would not hold in a large scene: every array that it reads counts once, every array that
it writes counts once, as in the triad of perf/ceilings.py. What stays in a cache within a pass (the scratch of an element group,
the block that two rows share) does not count. Chains and nets of welded beams in space or in a plane; no sliders, bodies or ties.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.newton import Outcome, Stepper

NUMBER = 8  # bytes


@dataclass(frozen=True)
class Pass:
    """One pass: arrays, or numbers of bytes, that it reads and writes, `often` in a Newton iteration; part: 'elements',
    'elimination' or 'nodes'."""

    name: str
    part: str
    reads: tuple[Any, ...]
    writes: tuple[Any, ...]
    often: float = 1.0

    @property
    def read(self) -> int:
        """Bytes."""
        return nbytes(self.reads)

    @property
    def written(self) -> int:
        """Bytes."""
        return nbytes(self.writes)

    @property
    def moved(self) -> float:
        """Bytes of an iteration."""
        return self.often * (self.read + self.written)


def nbytes(*parts: Any) -> int:
    """Bytes of arrays, of tuples of arrays, and of what is a number of bytes already."""
    total = 0
    for x in parts:
        if isinstance(x, np.ndarray):
            total += x.nbytes
        elif isinstance(x, tuple):
            total += nbytes(*x)
        elif x is not None:
            total += int(x)
    return total


def mixed_share(stepper: Stepper, outcome: Outcome) -> float:
    """Share of the iterations of the last step whose tangent used other stresses than the present ones (theory.md (4.6)): those
    after an increment, or in the first iteration after a first guess like that of this step, that was too long for them."""
    sizes = outcome.sizes[outcome.sizes > 0.0]
    limit = stepper.work.line.use[1]
    return float(np.mean(np.concatenate((sizes[:1], sizes[:-1])) > limit)) if sizes.size else 0.0


def passes(stepper: Stepper, iterations: float, mixed: float) -> list[Pass]:
    """All passes of a run with so many iterations a step, `mixed` of them with stresses of their own.

    Raises
    ------
    ValueError
        The scene has parts that are not counted.
    """
    m, s, w = stepper.core, stepper.core_state, stepper.work
    if m.sliders is not None or m.bodies is not None or m.ties is not None or stepper.alpha is not None:
        raise ValueError("bytes are counted for the conserving step of beams alone, without sliders, bodies or ties")
    subs = None if m.substructures is None else stepper.parts.subs  # type: ignore[attr-defined]
    line = (w.line.q_last, w.line.q_line)
    tables = (m.simo, m.green)
    row = 8 * NUMBER
    n = len(m.size)
    step = 1.0 / iterations
    out = [Pass("remember the state", "nodes", (s.q, s.v, w.past), (w.keep_q, w.keep_v, w.keep_past), step),
           Pass("first guess", "nodes", (s.q, w.past, m.spinless), (w.theta, w.dq), step),
           Pass("keep the rates", "nodes", (w.theta, w.dq, w.past.nbytes // 2), (w.past,), step),
           Pass("accept", "nodes", (s.q, s.v, w.dq), (s.q, s.v), step)]
    if mixed > 0.0:
        out.append(Pass("start the line", "nodes", (s.q,), line, step))
    inner = stepper.inner
    rhs = None if inner is None else inner.rhs
    out += [Pass("clear", "nodes", (w.f_ext,), (w.r, w.blocks, rhs)),
            Pass("both ends of the step", "nodes", (s.q, s.v, w.dq), (w.q_mid, w.q_end, w.u))]
    read = (tables, w.q_mid, w.q_end, w.u, mixed * nbytes(line))
    if subs is None:
        store = None if inner is None else inner.store
        out.append(Pass("elements", "elements", (*read, w.r, w.blocks, rhs), (w.r, w.blocks, rhs, store)))
    else:
        interior = row * (m.n_rows - m.panel_rows)
        ends = row * (subs.row_start.size - 1)
        lists = (subs.block_start, subs.block_term, subs.row_start, subs.row_term)
        out += [Pass("elements, condensed", "elements", (*read, interior), (subs.store, subs.ends, interior)),
                Pass("add up the ends", "elements", (subs.ends, lists, w.blocks, ends), (w.blocks, ends))]
    if m.held is not None:
        touched = n * row * m.held.block.size
        out.append(Pass("supports", "nodes", (m.held, touched), (touched,)))
    out += _solution(stepper)
    if subs is None:
        out += [Pass("sign of the solution", "nodes", (w.panel,), (w.panel,)),
                Pass("increments", "nodes", (m.pattern.row_of, w.panel, s.q, w.theta, w.dq), (line, w.theta, w.dq))]
    else:
        rows = tuple((t.rows, t.meta) for t in tables if t is not None)
        out += [Pass("solution of the ends", "elimination", (w.panel,), (row * m.panel_rows,)),
                Pass("recover the beams", "elimination", (subs.store, rows, subs.x), (subs.x,)),
                Pass("increments", "nodes", (m.pattern.row_of, subs.x, s.q, w.theta, w.dq), (line, w.theta, w.dq))]
    return out


def _solution(stepper: Stepper) -> Iterator[Pass]:
    """From residual and blocks to the solutions of all rows of the panel."""
    m, w, inner = stepper.core, stepper.work, stepper.inner
    n = len(m.size)
    # a line of the panel holds one unknown: who needs one column moves them all
    ends = n * m.pattern.n * m.width * NUMBER
    rest = w.panel.nbytes - ends
    yield Pass("clear the right-hand sides", "elimination", (), (w.panel,))
    yield Pass("residual to right-hand sides", "elimination", (8 * NUMBER * m.panel_rows, w.panel), (w.panel,))
    if inner is not None:
        y = 8 * NUMBER * (m.panel_rows - m.pattern.n)
        yield Pass("clear those of inner nodes", "elimination", (rest,), (rest,))
        yield Pass("inner nodes to right-hand sides", "elimination", (y, rest), (rest,))
    blocks = 8 * n * NUMBER * m.pattern.keys.size
    if m.pattern.plan is not None:
        plan = m.pattern.plan
        upper = 8 * n * NUMBER * plan.upper.size
        yield Pass("factors", "elimination", (plan, blocks, ends), (blocks, w.pivots, ends))
        yield Pass("back substitution", "elimination", (plan.start, plan.column, plan.upper, upper, ends), (ends,))
    elif stepper.linear.tables is not None:
        t = stepper.linear.tables
        structure, factors = (t.indptr, t.indices), pardiso_bytes(stepper)
        yield Pass("matrix to PARDISO", "elimination", (blocks, ends), (t.data, t.b))
        yield Pass("PARDISO's factors", "elimination", (t.data, structure), (factors,))
        yield Pass("PARDISO's solution", "elimination", (factors, t.b), (t.x,))
        yield Pass("its residual", "elimination", (t.data, structure, t.x, t.b), (t.r,))
        yield Pass("solution from PARDISO", "elimination", (t.x, ends), (ends,))
    if inner is not None:
        upper = _upper_of_inner(stepper)
        yield Pass("recover the inner nodes", "elimination", (inner.where, inner.rows, upper, w.panel), (rest,))


def _upper_of_inner(stepper: Stepper) -> int:
    """Bytes of the factors of inner nodes that the recovery reads."""
    n, total = len(stepper.core.size), 0
    for tables in (stepper.core.simo, stepper.core.green):
        if tables is not None:
            for nn, times in zip(*np.unique(tables.meta[tables.meta[:, 6] >= 0, 0], return_counts=True)):
                total += int(times) * sum(8 * n * n * others for others in range(int(nn) - 1, 1, -1))
    return NUMBER * total


def pardiso_bytes(stepper: Stepper) -> int:
    """Bytes of PARDISO's factors by its own account, after a factorisation."""
    return 0 if stepper.linear.tables is None else 1024 * int(stepper.linear.tables.iparm[16])


def kept(stepper: Stepper) -> dict[str, int]:
    """Bytes of all arrays of a run by kind: tables of the model, state, work arrays, matrix and factors (those of PARDISO, too).
    What the model keeps of arrays that only a run fills is never touched and does not count."""
    m, w = stepper.core, stepper.work
    inner, subs = m.inner, m.substructures
    tables = nbytes(m.simo, m.green, m.held, m.spinless, m.loads, m.gravity_weight, m.constant_load, m.pattern.row_of,
                    m.pattern.keys, m.pattern.plan, m.q0, m.v0, m.spin_root)
    if m.static_held is not m.held:
        tables += nbytes(m.static_held)
    if inner is not None:
        tables += nbytes(inner.where, inner.rows, inner.element)
    factors = nbytes(w.blocks, w.pivots)
    if stepper.inner is not None:
        factors += nbytes(stepper.inner.store, stepper.inner.rhs, stepper.inner.mark, stepper.inner.found)
    work = nbytes(*(x for name, x in zip(w._fields, w) if name not in ("blocks", "pivots")))
    if subs is not None:
        own = stepper.parts.subs  # type: ignore[attr-defined]
        tables += nbytes(subs.group, subs.beam, subs.block_start, subs.block_term, subs.row_start, subs.row_term)
        factors += nbytes(own.store, own.ends)
        work += own.x.nbytes
    if stepper.linear.tables is not None:
        factors += nbytes(stepper.linear.tables, pardiso_bytes(stepper))
    return {"tables": tables, "state": nbytes(stepper.core_state), "work": work, "factors": factors}
