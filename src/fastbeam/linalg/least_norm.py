"""Least changes that meet linear constraints."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.linalg.factors import Limits, lu, norms_of_rows, refined

Array = np.ndarray
# share of its inertia with which every unknown is held to its value in one solution (proximal point iteration)
HOLD = 1e-8
# such a share for multipliers, so small that almost dependent constraints still count as two
GIVE = 1e-14
# such a share if rigid motions cannot meet all constraints: their error stays, as small as possible
SHARED = 1e-8
# share of the terms of single nodes in a constraint, below which a rigid motion does not change it
UNMOVED = 1e-9
# limits of solutions: refined as long as that helps
LIMITS = Limits(0.0, 0.0, 0.0, 0.0, 30, 30)
# share of the kinetic energy that was given: rigid motions that leave less are no answer, supports stop the parts. A load
# thrown along a rope whose far end stands keeps sin(x)^2 of it, x the angle between both: 6 degrees, as of directions from typed
# coordinates and nets that sag, are none of a load that swings. Either way the event `projected` tells energies before and after
STOPPED = 0.01


def nearest(mass: Any, matrix: Any, right: Array, given: Array, spin: Array) -> Array:
    """Return the x of `nearest_by`, without the multipliers."""
    return nearest_by(mass, matrix, right, given, spin)[0]


def middles(places: Array, part: Array) -> tuple[Array, Array]:
    """Return means of the places [N, 3] of the nodes of every part [P, 3], and for every node the number of its part among these
    [N]."""
    _, number = np.unique(part, return_inverse=True)
    count = np.bincount(number)
    return np.stack([np.bincount(number, x) / count for x in places.T], axis=1), number


def rigid_motions(places: Array, part: Array) -> Any:
    """Return the map from velocities at their middles and spins of parts to (v, spin) of all nodes, sparse [6 N, 6 P]; places [N,
    3], and for every node the number of its part [N]."""
    n = len(part)
    middle, number = middles(places, part)
    block = np.zeros((n, 6, 6))
    block[:, :3, :3] = block[:, 3:, 3:] = np.eye(3)
    block[:, :3, 3:] = np.cross((places - middle[number])[:, None], np.eye(3))
    return sparse.bsr_matrix((block, number, np.arange(n + 1)), shape=(6 * n, 6 * len(middle))).tocsr()


def rigid_share(mass: Any, matrix: Any, right: Array, rigid: Any) -> Array:
    """Return the part of the least x with matrix x = right that rigid motions of parts can do, [6 P]: factors of the columns of
    `rigid`, the least in the norm of the mass matrix among those with the least error of these equations."""
    rows = (matrix @ rigid).tocsr()
    size = [np.sqrt(np.asarray(x.multiply(x).sum(axis=1)).reshape(-1)) for x in (rows, abs(matrix) @ abs(rigid))]
    moved = np.flatnonzero(size[0] > UNMOVED * size[1])
    of_parts = np.arange(rigid.shape[1])
    return nearest_by((rigid.T @ mass @ rigid).tocsr(), rows[moved], right[moved], np.zeros(of_parts.size), of_parts % 6 >= 3,
                      give=SHARED)[0]


def rigid_change(mass: Any, matrix: Any, right: Array, given: Array, rigid: Any) -> Array:
    """Return velocities and spins [6 N] by which rigid motions of the parts bring `given` as near as they can to matrix x =
    right, as of `rigid_share`. They are zero in groups of unknowns that would lose almost all kinetic energy: a load on a rope
    whose other end is clamped goes on, and the rope bends."""
    change = rigid @ rigid_share(mass, matrix, right - matrix @ given, rigid)
    # all directions of a node belong to one group, however the scene lies in space
    _, piece = pieces(mass + sparse.kron(sparse.eye(given.size // 6), np.ones((6, 6))), matrix)
    was_given = abs(rigid) @ (abs(rigid).T @ (given != 0.0)) > 0.0
    left = np.where(was_given, given + change, 0.0)
    before, after = (np.bincount(piece, x * (mass @ x)) for x in (given, left))
    return np.where((after < STOPPED * before)[piece], 0.0, change)


def pieces(mass: Any, matrix: Any) -> tuple[int, Array]:
    """Count the groups of unknowns that masses and constraints join; return the number and the group of every unknown [n]."""
    count, piece = sparse.csgraph.connected_components(abs(mass) + abs(matrix).T @ abs(matrix), directed=False)
    return int(count), piece


def nearest_by(mass: Any, matrix: Any, right: Array, given: Array, spin: Array, momentum: Array | None = None,
               hold: float = HOLD, give: float = GIVE) -> tuple[Array, Array]:
    """Find the x with matrix x = right that is nearest to `given` in the norm of a singular mass matrix, and among these near to
    it in its other components; with a momentum, nearest to `given` after that momentum has been added.

    spin: which unknowns are spins; hold, give: shares as of HOLD and GIVE in one solution.

    Every unknown is measured by its own inertia, one without inertia by that of its group: unconnected parts do not influence
    each other. The matrix of the multipliers is made regular by a small share of that, which repeated solutions take out again
    (proximal point iteration), so that the result is exact, also for dependent constraints. Also returned are the multipliers l
    of the constraints, with which mass (x - given) = momentum + matrix^T l.
    """
    n, m = given.size, right.size
    diagonal = mass.diagonal()
    _, piece = pieces(mass, matrix)
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
    regularised = exact + sparse.diags(np.concatenate((np.full(n, hold), np.full(m, -give))))
    factors = lu(regularised)
    assert factors is not None, "what is held is regular"
    start = np.concatenate((given * np.sqrt(scale), np.zeros(m)))
    pull = weight @ start[:n] if momentum is None else weight @ start[:n] + unit @ momentum
    goal = np.concatenate((pull, right / size))
    off = goal - exact @ start

    def rest_of(x: Array, b: Array, rest_out: Array) -> Array:
        return norms_of_rows(np.subtract(b, exact @ x, out=rest_out))

    solution = start + refined(factors.solve, rest_of, off, LIMITS)[0]
    return solution[:n] / np.sqrt(scale), -solution[n:] / size
