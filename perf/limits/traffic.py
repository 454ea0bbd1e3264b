"""Bytes that the passes of a step read and write, counted from the arrays themselves; and what a run keeps in memory.

A pass is a loop over arrays that a cache would not hold in a large scene: every array that it reads counts once, every array that
it writes counts once, as in the triad of ceilings.py. What stays in a cache within a pass (the scratch of an element group,
the block that two rows share) does not count. Chains and nets of welded beams in space or in a plane; no sliders, bodies or ties.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from perf.places import private

Stepper = private("newton", "Stepper")
Outcome = private("outcome", "Outcome")
NUMBER = 8  # bytes


@dataclass(frozen=True)
class Pass:
    """One pass: arrays, or numbers of bytes, that it reads and writes, `often` in a Newton iteration; part: 'elements',
    'elimination', 'nodes', or 'step' for what begins and ends a step."""

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


def residual(stepper: Stepper) -> np.ndarray:
    """The rows of the residual that stand in memory: all but those of the interior of condensed beams."""
    subs, r = stepper.core.substructures, stepper.work.r
    return r if subs is None else r[:8 * int(subs.counts[0])]


def mixed_share(stepper: Stepper, outcome: Outcome) -> float:
    """Share of the iterations of the last step whose tangent used other stresses than the present ones (theory.md (4.6)): those
    after an increment, or in the first iteration after a first guess like that of this step, that was too long for them."""
    sizes = outcome.sizes[outcome.sizes > 0.0]
    limit = stepper.work.increment.control[1]
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
    tables = (m.simo, m.green, w.reference_strains)
    row = 8 * NUMBER
    step = 1.0 / iterations
    out = [Pass("first guess", "step", (w.past, w.theta, w.dphi), (w.theta, w.dphi, w.past), step),
           Pass("accept", "step", (s.q, s.v, w.dphi, w.theta), (s.q, s.v), step)]
    if w.keep_q.size:
        out.append(Pass("remember the state", "step", (s.q, s.v, w.dphi, w.theta, w.past),
                        (w.keep_q, w.keep_v, w.keep_dphi, w.keep_theta, w.keep_past), step))
    r = residual(stepper)
    out.append(Pass("clear", "nodes", (r.nbytes,), (r, w.blocks)))
    step_of = (s.q, s.v, w.dphi, w.theta)
    followed = mixed * nbytes(w.increment.x)
    inner = stepper.inner
    store = None if inner is None else inner.store
    indices = tuple((t.rows, t.meta) for t in (m.simo, m.green) if t is not None)
    if m.substructures is None:
        out.append(Pass("elements", "elements", (tables, step_of, followed, w.r, w.blocks), (w.r, w.blocks, store)))
    else:
        subs = stepper.parts.subs  # type: ignore[attr-defined]
        interior = row * int(np.sum((subs.group[:, 1] * (subs.group[:, 2] - 1) - 1) * 8))
        ends = row * (subs.row_start.size - 1)
        lists = (subs.block_start, subs.block_term, subs.row_start, subs.row_term)
        out += [Pass("elements, condensed", "elements", (tables, step_of, followed, interior),
                     (subs.store, subs.ends, interior, store)),
                Pass("add up the ends", "elements", (subs.ends, lists, w.blocks, ends), (w.blocks, ends))]
    if m.held is not None:
        touched = len(m.dofs) * row * m.held.block.size
        out.append(Pass("supports", "nodes", (m.held, touched), (touched,)))
    out += _solution(stepper)
    out.append(Pass("solution to rows", "elimination", (w.panel,), (w.increment.x[:8 * m.panel_rows],)))
    if inner is not None:
        out.append(Pass("recover the inner nodes", "elimination", (store, indices, w.increment.x), (row * inner.element.size,)))
    increments = (m.pattern.row_of, w.theta, w.dphi), (w.theta, w.dphi)
    if m.substructures is None:
        out.append(Pass("increments", "nodes", (*increments[0], w.increment.x), increments[1]))
    else:
        out.append(Pass("recover the beams, increments", "elimination", (*increments[0], subs.store, indices),
                        (*increments[1], w.increment.x)))
    return out


def _solution(stepper: Stepper) -> Iterator[Pass]:
    """From residual and blocks to the solutions of all rows of the panel."""
    m, w = stepper.core, stepper.work
    n = len(m.dofs)
    yield Pass("clear the right-hand sides", "elimination", (), (w.panel,))
    # a line of the panel holds one unknown: who needs one column moves them all
    yield Pass("residual to right-hand sides", "elimination", (8 * NUMBER * m.panel_rows, w.panel), (w.panel,))
    blocks = 8 * n * NUMBER * m.pattern.keys.size
    if m.pattern.plan is not None:
        plan = m.pattern.plan
        upper = 8 * n * NUMBER * plan.upper.size
        yield Pass("factors", "elimination", (plan, blocks, w.panel), (blocks, w.pivots, w.panel))
        yield Pass("back substitution", "elimination", (plan.start, plan.column, plan.upper, upper, w.panel), (w.panel,))
    elif stepper.linear.tables is not None:
        t = stepper.linear.tables
        structure, factors, fresh = (t.indptr, t.indices), pardiso_bytes(stepper), factored_share(stepper)
        yield Pass("matrix to PARDISO", "elimination", (blocks, w.panel), (t.data, t.b))
        yield Pass("PARDISO's factors", "elimination", (t.data, structure), (factors,), fresh)
        yield Pass("PARDISO's solution", "elimination", (factors, t.b), (t.x,), fresh)
        # one at least
        yield Pass("correction with earlier factors", "elimination", (factors, t.r, t.x), (t.y, t.x), 1.0 - fresh)
        yield Pass("its residual", "elimination", (t.data, structure, t.x, t.b), (t.r,))
        yield Pass("solution from PARDISO", "elimination", (t.x, w.panel), (w.panel,))


def factored_share(stepper: Stepper) -> float:
    """Share of the solutions of a run for which PARDISO made factors; others took those of an earlier iteration of their step."""
    made, _, again = (float(x) for x in stepper.linear.tables.counts[:3])
    return made / (made + again) if made else 1.0


def pardiso_bytes(stepper: Stepper) -> int:
    """Bytes of PARDISO's factors by its own account, after a factorisation."""
    return 0 if stepper.linear.pardiso is None else stepper.linear.pardiso.factor_bytes


def kept(stepper: Stepper) -> dict[str, int]:
    """Bytes of all arrays of a run by kind: tables of the model, state, work arrays, matrix and factors (those of PARDISO, too).
    What is never touched takes no memory and does not count: arrays of the model that only a run fills, velocities at rest, loads
    where there are none, residuals of the interior of condensed beams. What stands in two places counts once."""
    m, w = stepper.core, stepper.work
    inner, subs = m.inner, m.substructures
    tables = nbytes(m.simo, m.green, m.reference_strains, m.held, m.spinless, m.loads, m.gravity_weight, m.pattern.row_of,
                    m.pattern.keys, m.pattern.plan, m.q0, m.spin_root, *(x for x in (m.constant_load, m.v0) if x.any()))
    if m.static_held is not m.held:
        tables += nbytes(m.static_held)
    if inner is not None:
        tables += nbytes(inner.where, inner.rows, inner.element)
    factors = nbytes(w.blocks, w.pivots)
    if stepper.inner is not None:
        factors += nbytes(stepper.inner.store, stepper.inner.rhs, stepper.inner.mark, stepper.inner.found)
    elsewhere = "blocks", "pivots", "r", "f_ext", "reference_strains"
    work = nbytes(*(x for name, x in zip(w._fields, w) if name not in elsewhere), residual(stepper))
    work -= w.increment.theta.nbytes
    if w.f_ext.any() and not np.shares_memory(w.f_ext, m.loads.first):
        work += w.f_ext.nbytes
    if subs is not None:
        own = stepper.parts.subs  # type: ignore[attr-defined]
        tables += nbytes(subs.group, subs.beam, subs.block_start, subs.block_term, subs.row_start, subs.row_term)
        factors += nbytes(own.store, own.ends)
    if stepper.linear.pardiso is not None:
        factors += nbytes(*stepper.linear.pardiso.arrays, pardiso_bytes(stepper))
    return {"tables": tables, "state": nbytes(stepper.core_state), "work": work, "factors": factors}
