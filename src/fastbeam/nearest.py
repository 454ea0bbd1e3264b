"""Least changes that meet linear constraints."""
from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray
# share of its inertia with which every unknown is held to its value in one solution (proximal point iteration)
HOLD = 1e-8
# such a share for multipliers, so small that constraints which are almost dependent still count as two
GIVE = 1e-14
SOLUTIONS = 30


def nearest(mass: Any, matrix: Any, right: Array, given: Array, spin: Array) -> Array:
    """As `nearest_by`, without the multipliers."""
    return nearest_by(mass, matrix, right, given, spin)[0]


def nearest_by(mass: Any, matrix: Any, right: Array, given: Array, spin: Array,
               momentum: Array | None = None, hold: float = HOLD) -> tuple[Array, Array]:
    """The x with matrix x = right that is nearest to `given` in the norm of a singular mass matrix, and among these near to it in
    its other components; with a momentum, nearest to what `given` is once that has been added to its own.

    spin: which unknowns are spins; hold: the share of its inertia with which an unknown is held in one solution.

    Every unknown is measured by its own inertia, one without by that of what it hangs together with: parts that nothing joins do
    not know of each other. The matrix of the multipliers is made regular by a small share of that, which repeated solutions take
    out again (proximal point iteration), so that the result is exact, also where constraints say the same twice. Also returned
    are the multipliers l of the constraints, with which mass (x - given) = momentum + matrix^T l.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu
    n, m = given.size, right.size
    diagonal = mass.diagonal()
    graph = abs(mass) + abs(matrix).T @ abs(matrix)
    _, piece = connected_components(graph, directed=False)
    scale = diagonal.copy()
    for kind in (spin, ~spin):
        heavy = kind & (diagonal > 0.0)
        many = np.bincount(piece[heavy], minlength=piece.max() + 1)
        with np.errstate(divide="ignore"):
            mean = np.exp(np.bincount(piece[heavy], np.log(diagonal[heavy]), minlength=many.size) / np.maximum(many, 1))
        light = kind & ~(diagonal > 0.0)
        scale[light] = mean[piece[light]]
    unit = sparse.diags(1.0 / np.sqrt(scale))
    rows = matrix @ unit
    size = np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).reshape(-1))
    rows = sparse.diags(1.0 / size) @ rows
    weight = unit @ mass @ unit
    exact = sparse.bmat([[weight, rows.T], [rows, None]]).tocsr()
    held = exact + sparse.diags(np.concatenate((np.full(n, hold), np.full(m, -GIVE))))
    factors = splu(held.tocsc())
    start = given * np.sqrt(scale)
    pull = weight @ start if momentum is None else weight @ start + unit @ momentum
    goal = np.concatenate((pull, right / size))
    solution = np.concatenate((start, np.zeros(m)))
    best, kept = np.inf, solution
    for _ in range(SOLUTIONS):
        rest = goal - exact @ solution
        left = float(np.max(np.abs(rest), initial=0.0))
        if not left < 0.5 * best:
            break
        best, kept = left, solution
        solution = solution + factors.solve(rest)
    return kept[:n] / np.sqrt(scale), -kept[n:] / size
