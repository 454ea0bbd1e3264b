"""Shapes of cable nets from the ratios of force to length of their cables (theory.md 16)."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import Anything, Numbers, checked, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.linalg.saddle import Saddle

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray
POINTS = Numbers((None, 3), "finite positions of shape [n, 3], m")
FORCES = Numbers((None, 3), "finite forces of shape [n, 3], N")
# round-off of the balance of a node, next to the forces there
BALANCED = 1e-9


@checked(nodes=POINTS, edges=Anything(), densities=Anything(), pins=Anything(), loads=FORCES)
def force_density(nodes: ArrayLike, edges: ArrayLike, densities: ArrayLike, pins: ArrayLike,
                  loads: ArrayLike | None = None) -> Array:
    """Find the positions of the nodes of a net in equilibrium, where every cable has a given force per length.

    Parameters
    ----------
    nodes : array_like [n, 3]
        Positions, m; those of pins count, the others are found.
    edges : array_like of int [m, 2]
        Nodes of every cable.
    densities : float or array_like [m]
        Force over length, N/m; > 0: tension. Twice as much is half as long, roughly.
    pins : array_like of int
        Nodes that stay where they are.
    loads : array_like [n, 3], optional
        Forces on the nodes, N.

    Returns
    -------
    float64 [n, 3]
        With lengths l of the edges there, the forces of the cables are densities x l: `prestress=` of a `Net`, which is in
        equilibrium with these loads as it is drawn.

    Raises
    ------
    SceneError
        An array has the wrong shape, or nothing determines the place of a node.

    Examples
    --------
    >>> import fastbeam as fb
    >>> fb.force_density([(0, 0, 0), (2, 0, 0), (9, 9, 9)], [(0, 2), (1, 2)], [3.0, 1.0], pins=[0, 1]).tolist()
    [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
    """
    n = len(nodes)
    ends = _numbers_of("edges", edges, n, (None, 2))
    m = len(ends)
    fixed = np.zeros(n, bool)
    fixed[_numbers_of("pins", pins, n, (None,))] = True
    q = numbers(densities)
    if q is not None and q.ndim == 0:
        q = np.full(m, float(q))
    if q is None or q.shape != (m,) or not np.all(np.abs(q) <= 1e60):
        raise SceneError(f"force_density, densities: must be a finite number in N/m or {m} of them, one for every edge, got "
                         f"{shown(densities)}")
    if loads is not None and len(loads) != n:
        raise SceneError(f"force_density, loads: must be forces of all {n} nodes, shape [{n}, 3], got shape {list(loads.shape)}")
    if np.any(ends[:, 0] == ends[:, 1]):
        raise SceneError(f"force_density, edges: edge {int(np.argmax(ends[:, 0] == ends[:, 1]))} joins a node with itself")
    live = q != 0.0
    graph = sparse.coo_matrix((np.ones(int(live.sum())), (ends[live, 0], ends[live, 1])), shape=(n, n))
    part = sparse.csgraph.connected_components(graph, directed=False)[1]
    loose = ~np.isin(part, part[fixed])
    if loose.any():
        raise SceneError(f"force_density: no cables with a density lead from node {int(np.argmax(loose))} to a pin, so its "
                         f"position is not determined ({int(loose.sum())} of {n} nodes)")
    out = np.array(nodes)
    free = np.flatnonzero(~fixed)
    if not free.size:
        return out
    branch = sparse.csr_matrix((np.tile([1.0, -1.0], m), (np.repeat(np.arange(m), 2), ends.reshape(-1))), shape=(m, n))
    matrix = (branch.T @ sparse.diags(q) @ branch).tocsr()
    right = (np.zeros((n, 3)) if loads is None else loads) - matrix[:, fixed] @ out[fixed]
    saddle = Saddle(matrix[free][:, free].tocsr(), np.zeros(free.size, bool))
    for c in range(3):
        x = saddle.solve(right[free, c])
        if x is None or saddle.is_singular or not np.isfinite(x).all():
            raise SceneError("force_density: the shape is not determined, because tension and compression cancel at some nodes; "
                             "change signs or sizes of densities")
        out[free, c] = x
    # as a check of its own
    force = matrix @ out - (0.0 if loads is None else loads)
    size = abs(matrix) @ np.abs(out) + (0.0 if loads is None else np.abs(loads))
    if np.max(np.abs(force[free]) - BALANCED * np.max(size)) > 0.0:
        raise SceneError("force_density: equilibrium is lost in round-off, because densities differ too much in size")
    return out


def _numbers_of(what: str, value: Any, n: int, shape: tuple[int | None, ...]) -> Array:
    """Return node numbers as an array, checked. Raises SceneError."""
    found = numbers(value)
    fits = found is not None and found.size and found.ndim == len(shape)
    fits = fits and all(a in (None, b) for a, b in zip(shape, found.shape))
    if not fits or np.any(found != np.round(found)) or np.any(found < 0) or np.any(found >= n):
        raise SceneError(f"force_density, {what}: must be node numbers from 0 to {n - 1}, shape "
                         f"{'[m, 2]' if len(shape) == 2 else '[k]'}, got {shown(value)}")
    return found.astype(np.int64)
