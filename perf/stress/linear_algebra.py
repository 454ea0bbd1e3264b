"""Corners of the linear algebra: matrices on which solvers without full pivoting fail, singular statics, buckling, mechanisms.

Each has to be recovered from or refused with the reason; a solution that is accepted has to be right.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.optimize import brentq

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.algebra.blocks import SIX
from fastbeam.kernels.linalg import chain
from fastbeam.kernels.linalg.pardiso import REFUSE_AT
from fastbeam.linalg import linear_system as linsolve
from fastbeam.linalg.linear_system import LinearSystem
from fastbeam.linalg.mkl import load_mkl
from fastbeam.linalg.pattern import Pattern, build_pattern
from fastbeam.stepping.stepper import Stepper
from perf.stress.table import Row

Array = np.ndarray
QUIET: dict[str, Any] = {"every": 1, "output": fb.Output(snapshots=0), "progress": False}


# ------------------------------------------------------------------------------------------------------------ bare matrices
def chain_pattern(n: int, eliminated: bool) -> Pattern:
    """n nodes in a row, each coupled to the next."""
    return build_pattern(n, np.stack((np.arange(n - 1), np.arange(1, n)), axis=1), 1, allow_elimination=eliminated)


def hostile(kind: str, n: int, rng: np.random.Generator) -> Callable[[int, int], Array]:
    """Blocks (i, j) of a matrix of n block rows.

    saddle: zero diagonal blocks, regular; saddle nearly: with 1e-18 on them; graded: rows and columns scaled over 24 decades;
    turned: as graded, in a random basis, so that pivots are small differences; singular: one direction has no stiffness at all;
    nearly singular: 1e-17 there; copy: two equal block rows.
    """
    a = {(i, j): rng.standard_normal((6, 6)) for i in range(n) for j in range(n) if abs(i - j) <= 1}
    if kind.startswith("saddle"):
        small = 1e-18 if kind.endswith("nearly") else 0.0
        for i in range(0, n, 2):
            a[i, i] = small * a[i, i]
    if kind in ("graded", "turned"):
        scale = 10.0 ** rng.uniform(-6, 6, (n, 6))
        q = [np.linalg.qr(rng.standard_normal((6, 6)))[0] if kind == "turned" else np.eye(6) for _ in range(n)]
        a = {(i, j): q[i] @ (scale[i][:, None] * block * scale[j]) @ q[j].T for (i, j), block in a.items()}
    if "singular" in kind:
        small = 1e-17 if kind.startswith("nearly") else 0.0
        for i, j in a:
            if i == n // 2:
                a[i, j][3] = small * a[i, j][3]
    if kind == "copy":
        for j in (0, 1, 2):
            if (0, j) in a or (1, j) in a:
                a[1, j] = a.get((0, j), np.zeros((6, 6))).copy()
    return lambda i, j: a[i, j]


def solved(kind: str, solver: str, n: int = 6, seed: int = 0) -> tuple[Array | None, Array, Array]:
    """(solution or None where it was refused, dense matrix, right-hand side) of a hostile matrix by one of the solvers."""
    rng = np.random.default_rng(seed)
    pattern = chain_pattern(n, solver == "chain")
    block = hostile(kind, n, rng)
    node_of = np.argsort(pattern.row_of)
    rows, columns = pattern.rows, pattern.columns
    blocks = np.zeros((rows.size, 6, 8))
    dense = np.zeros((n, 6, n, 6))
    for k, (r, c) in enumerate(zip(rows, columns)):
        blocks[k, :, :6] = dense[r, :, c] = block(int(node_of[r]), int(node_of[c]))
    right = rng.standard_normal(6 * n)
    panel = np.zeros((6 * n, 8))
    panel[:, 0] = right
    halves = solver == "halves"
    with patch.object(linsolve, "HALVES_FROM", 0 if halves else np.inf):
        system = LinearSystem(pattern, 1, "auto" if halves or solver == "chain" else solver, reproducible=halves)
    flat, values = panel.reshape(-1), blocks.reshape(-1).copy()
    if solver == "chain":
        pivots = np.zeros(6 * n, np.int64)
        good = chain.factor(pattern.plan, values, pivots, chain.NoSide(), SIX) > 1e-14
        if good:
            chain.solve(pattern.plan, values, pivots, flat, 8, SIX)
        x = panel[:, 0] if good else None
    elif solver in ("pardiso", "halves"):
        x = panel[:, 0] if system.pardiso.solve(values, flat, 8, SIX, lambda work, items: [work(0, x) for x in items]) else None
    else:
        found = system.superlu.solve(blocks, right[None])
        x = None if found is None else found[0]
    return x, dense.reshape(6 * n, 6 * n), right


def matrices(count: int) -> Iterator[Row]:
    """Every solver on every hostile matrix: the residual of what it accepts, how often it refuses."""
    for solver in ("chain", "pardiso", "halves", "superlu"):
        if solver in ("pardiso", "halves") and load_mkl() is None:
            continue
        for kind in ("plain", "saddle", "saddle nearly", "graded", "turned", "singular", "nearly singular", "copy"):
            worst, refused = 0.0, 0
            for seed in range(count):
                x, a, b = solved(kind, solver, 12 if solver == "halves" else 6, seed)
                if x is None:
                    refused += 1
                    continue
                worst = max(worst, float(np.linalg.norm(a @ x - b) / (np.linalg.norm(b) + np.linalg.norm(a) * np.linalg.norm(x))))
            must = kind == "plain" or (solver == "superlu" and kind.startswith("saddle"))
            # the elimination sees pivots within blocks only and checks no residual: there it is left to Newton to notice
            blind = solver == "chain" and kind == "saddle nearly"
            ok = (blind or worst <= REFUSE_AT) and not (must and refused) and (kind != "singular" or refused == count)
            yield Row(f"{solver}: {count} matrices, {kind}", "shown" if blind else "backward error small, or refused",
                      f"backward error <= {worst:.0e}, refused {refused}", ok)


# ------------------------------------------------------------------------------------------- inner nodes: pivot without exchange
STRETCHED = fb.Section(EA=1e4, GA2=1e3, GA3=1e3, GJ=50.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def bar() -> fb.Scene:
    """Soft in shear: stretched by a quarter its inner nodes have negative pivots in large steps, positive ones in small steps."""
    beam = fb.Beam.straight("bar", (0, 0, 0), (3, 0, 0), section=STRETCHED, elements=3, degree=2)
    return fb.Scene(beam, name="stretched bar")


def stretched(model: Any, speed: float = 0.0) -> Any:
    """The bar stretched by a quarter, its nodes in random motion."""
    state = model.state()
    q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
    q[:, 0] *= 1.25
    rng = np.random.default_rng(1)
    v[:, 0] = speed * rng.standard_normal((len(v), 3))
    spin = speed * rng.standard_normal((len(v), 3))
    v[:, 1:] = np.cross(spin[:, None], q[:, 1:])
    return state


def inner_pivot(model: Any, state: Any, h: float) -> float:
    """The reciprocal of the fifth diagonal entry of U = K_ii^-1 K_ij of the first inner node at the first guess of a step: it
    vanishes with the fifth pivot of K_ii."""
    stepper = Stepper(model, np.ones(1), state)
    kernels.begin(*stepper.records, h)
    kernels.assemble_all(*stepper.records, h)
    return 1.0 / float(stepper.inner.store[:288].reshape(6, 6, 8)[4, 4, 0])


def vanishing_step(model: Any, state: Any) -> tuple[float, float]:
    """Neighbouring step sizes between which that pivot changes its sign."""
    low, high = 5e-3, 1e-2
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return low, high
        low, high = (middle, high) if inner_pivot(model, state, middle) < 0.0 else (low, middle)


def inner_pivots() -> Iterator[Row]:
    """Steps of the size at which a pivot of an inner node vanishes, exactly and nearly; the matrix is regular."""
    model = fb.compile_scene(bar(), planar=False)
    plain = fb.compile_scene(bar(), solver="sparse", eliminate_inner=False, planar=False)
    for speed in (0.0, 1e-6, 1e-3, 0.3):
        start = stretched(model, speed)
        low, high = vanishing_step(model, start)
        off, fallbacks = 0.0, 0
        for h in (low, high, *(low * (1.0 + np.array((1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2))))):
            runs = [fb.simulate(m, t_end=h, step=h, start=fb.Start(start, time=0.0), solver=b, **QUIET)
                    for m, b in ((model, "auto"), (plain, "superlu"))]
            off = max(off, float(np.abs(runs[0].state.q - runs[1].state.q).max()))
            fallbacks += runs[0].info["fallbacks"]
        yield Row(f"inner pivot vanishes at h = {low:.3e} s, speeds of {speed:g} m/s", "the same steps as without elimination",
                  f"off {off:.0e}, {fallbacks} of 9 steps repeated without elimination", off <= 1e-12)


# -------------------------------------------------------------------------------------------------------------------- statics
def column(share: float, circle: bool = True) -> fb.Scene:
    """A clamped column under a share of its critical load along its axis."""
    of = (fb.Section.circle(radius=0.02, E=1e6, rho=1000.0) if circle
          else fb.Section.rectangle(height=0.02, width=0.04, E=1e6, rho=1000.0))
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=of, elements=8)
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("weight", beam.end, force=(0, 0, -share * critical(of))))


def critical(of: fb.Section) -> float:
    """Critical load of a clamped column of length 1 with the strains (2.2), of the weaker bending stiffness:
    P (1 - P/EA + P/GA) = EI pi^2/4."""
    EI, GA = min((of.EI2, of.GA3), (of.EI3, of.GA2))
    euler = EI * np.pi**2 / 4.0
    return float(brentq(lambda p: p * (1.0 - p / of.EA + p / GA) - euler, 0.0, 2.0 * euler))


def buckling() -> Iterator[Row]:
    """Loads around the critical one: the straight equilibrium stays one, and has to be called unstable beyond."""
    for circle, directions in ((True, 2), (False, 1)):
        for share, unstable in ((0.5, 0), (0.99, 0), (1.0 - 1e-6, 0), (1.0, None), (1.0 + 1e-6, directions), (1.01, directions),
                                (2.0, directions)):
            found = fb.solve_static(fb.compile_scene(column(share, circle)))
            count = found.info["unstable_directions"]
            told = [event["text"] for event in found.events]
            right = (unstable is None or count == unstable) and bool(told) == bool(count or found.info["free_directions"])
            yield Row(f"{'round' if circle else 'flat'} column, {share:.7g} of the critical load",
                      f"{'either' if unstable is None else unstable} unstable directions", f"{count}; {' '.join(told)[:50]}",
                      right)


def imperfect() -> Iterator[Row]:
    """With a small load across the load steps may lead to the bent branch, which is stable, or to another one."""
    for push in (1e-4, 1e-2, 5e-2):
        for share in (0.99, 1.0, 1.01, 1.2, 2.0):
            scene = column(share, circle=False)
            across = push * share * critical(scene.beams[0].section)
            found = fb.solve_static(fb.compile_scene(scene.add(fb.Load("push", scene.beams[0].end, force=(0, across, 0)))))
            unstable, height = found.info["unstable_directions"], found.state.q[-10]
            yield Row(f"flat column, {share:g} of the critical load, {push:g} of it across",
                      "stable, or called unstable", f"{unstable} unstable, tip at z = {height:.4f}",
                      bool(found.events) == bool(unstable) and (share < 1.01 or bool(unstable) or height < 0.999))


def mechanisms() -> Iterator[Row]:
    """Hinged chains, free parts and shells of them: refused with a name, before or in the first load step."""
    of = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)

    def rod(name: str, start: tuple[float, ...], end: tuple[float, ...]) -> fb.Beam:
        return fb.Beam.straight(name, start, end, section=of, elements=2)

    a, b, c = rod("a", (0, 0, 0), (1, 0, 0)), rod("b", (1, 0, 0), (2, 0, 0)), rod("c", (2, 0, 0), (3, 0, 0))
    load = fb.Load("load", b.node(3), force=(0, 0, 1e-3))
    cases = {
        "free beam": (a,),
        "beam on one pin": (a, fb.Pin(a.start)),
        "beam on two pins, pushed two ways": (a, fb.Pin(a.start), fb.Pin(a.end), fb.Load("down", a.node(2), force=(0, 0, 1e-3)),
                                              fb.Load("aside", a.node(4), force=(0, 1e-3, 0))),
        "free second part": (a, fb.Clamp(a.start), b),
        "part on a ball joint": (a, fb.Clamp(a.start), b, fb.BallJoint(a.end, b.start), load),
        "chain on two clamps, two joints": (a, b, c, fb.Clamp(a.start), fb.Clamp(c.end), fb.BallJoint(a.end, b.start),
                                            fb.BallJoint(b.end, c.start), load),
        "chain on two pins, two joints": (a, b, c, fb.Pin(a.start), fb.Pin(c.end), fb.BallJoint(a.end, b.start),
                                          fb.BallJoint(b.end, c.start), load),
    }
    for name, parts in cases.items():
        try:
            found = fb.solve_static(fb.compile_scene(fb.Scene(*parts)))
            yield Row(f"statics: {name}", "refused with a name, or an event", "; ".join(e["text"][:100] for e in found.events),
                      found.info["free_directions"] == 1)
        except (fb.SceneError, fb.ConvergenceError) as refused:
            yield Row(f"statics: {name}", "refused with a name, or an event", str(refused)[:110], True)


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    yield from matrices(20 if quick else 200)
    yield from inner_pivots()
    yield from buckling()
    yield from imperfect()
    yield from mechanisms()
