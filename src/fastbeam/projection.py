"""The consistent velocities nearest to given ones in the kinetic energy."""
from __future__ import annotations

from typing import Any

import numpy as np

from .connections import ARM, POSITION, Connections
from .numbering import NodeList
from .scene import RigidBody, Scene
from .tables import Elements

Array = np.ndarray
Line = tuple[Array, Array, Array, int]
# share of its own inertia, or of that around it, that holds every unknown to its value in one solution; the next takes it back
HOLD = 1e-8
SOLUTIONS = 30


def project(scene: Scene, nodes: NodeList, joints: Connections, elements: list[Elements], v: Array, omega: Array,
            lines: list[Line]) -> tuple[Array, Array, tuple[float, float]]:
    """Velocities and spins [N, 3] that all connections, supports and sliders allow, and the kinetic energy before and after, J.

    Weighed by the masses alone; what has no inertia changes as little as it may.
    """
    mass = mass_matrix(scene, nodes, elements)
    matrix, right = _constraints(scene, nodes, joints, lines)
    given = np.concatenate((v, omega), axis=1).reshape(-1)
    x = nearest(mass, matrix, right, given)
    found = x.reshape(-1, 6)
    energies = 0.5 * float(given @ (mass @ given)), 0.5 * float(x @ (mass @ x))
    return found[:, :3].copy(), found[:, 3:].copy(), energies


def nearest(mass: Any, matrix: Any, right: Array, given: Array) -> Array:
    """The x with matrix x = right that is nearest to `given` in the norm of a singular mass matrix, and among these near to it in
    its other components.

    Every unknown is measured by its own inertia, one without by that of what it hangs together with: parts that nothing joins do
    not know of each other. The matrix of the multipliers is made regular by a small share of that, which repeated solutions take
    out again (proximal point iteration), so that the result is exact, also where constraints say the same twice.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu
    n, m = given.size, right.size
    diagonal = mass.diagonal()
    graph = abs(mass) + abs(matrix).T @ abs(matrix)
    _, piece = connected_components(graph, directed=False)
    scale = diagonal.copy()
    spin = np.arange(n) % 6 >= 3
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
    held = exact + sparse.diags(np.concatenate((np.full(n, HOLD), np.full(m, -HOLD))))
    factors = splu(held.tocsc())
    start = given * np.sqrt(scale)
    goal = np.concatenate((weight @ start, right / size))
    solution = np.concatenate((start, np.zeros(m)))
    best = np.inf
    for _ in range(SOLUTIONS):
        rest = goal - exact @ solution
        left = float(np.max(np.abs(rest), initial=0.0))
        if not left < 0.5 * best:
            break
        best, kept = left, solution
        solution = solution + factors.solve(rest)
    return kept[:n] / np.sqrt(scale)


def _constraints(scene: Scene, nodes: NodeList, joints: Connections, lines: list[Line]) -> tuple[Any, Array]:
    """Rows of all constraints on (v, omega) of all nodes, sparse [m, 6 N], and their right-hand sides [m]."""
    from scipy import sparse
    rows: list[Array] = []
    columns: list[Array] = []
    data: list[Array] = []
    right: list[float] = []

    def skew(x: Array) -> Array:
        return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])

    def add(parts: list[tuple[int, int, Array]], value: Array) -> None:
        """sum of matrices [m, 3] on (node, 0 = v or 1 = omega) equals value [m]."""
        m = len(value)
        for node, which, matrix in parts:
            i, j = np.nonzero(np.ones((m, 3)))
            rows.append(len(right) + i)
            columns.append(6 * node + 3 * which + j)
            data.append(matrix[i, j])
        right.extend(float(x) for x in value)

    eye = np.eye(3)
    for k, entries in joints.entries.items():
        parts = [(k, 0, -eye)]
        for kind, target, offset, _ in entries:
            if kind == POSITION:
                parts.append((target, 0, eye))
            elif kind == ARM:
                parts.append((target, 1, -skew(offset @ nodes.directors[target])))
            elif target != k:
                add([(k, 1, -eye), (target, 1, eye)], np.zeros(3))
        add(parts, np.zeros(3))
    for k in np.flatnonzero(joints.held).tolist():
        if joints.held[k] & 7 and k not in joints.entries:
            add([(k, 0, eye)], np.zeros(3))
        if joints.held[k] & 56 and joints.spin_root[k] == k:
            add([(k, 1, eye)], np.zeros(3))
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        tangent = slopes @ nodes.phi[number]
        if slider.rate is None:
            # any speed along the tangent: two rows across it
            _, _, across = np.linalg.svd(tangent[None] / np.linalg.norm(tangent))
            lead, value = across[1:], np.zeros(2)
        else:
            lead, value = eye, slider.rate * tangent
        add([(point, 0, lead), *((int(k), 0, -x * lead) for k, x in zip(number, values))], value)
    where = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_matrix((np.concatenate(data), where), shape=(len(right), 6 * len(nodes))), np.array(right)


def mass_matrix(scene: Scene, nodes: NodeList, elements: list[Elements]) -> Any:
    """Reduced mass matrix on (v, omega) of all nodes, sparse [6 N, 6 N]."""
    from scipy import sparse
    n = len(nodes)
    d = nodes.directors

    def skew(x: Array) -> Array:
        """[..., 3] -> [..., 3, 3]"""
        o = np.zeros(x.shape[:-1])
        return np.stack((np.stack((o, -x[..., 2], x[..., 1]), -1), np.stack((x[..., 2], o, -x[..., 0]), -1),
                         np.stack((-x[..., 1], x[..., 0], o), -1)), -2)

    rows, columns, data = [], [], []
    for part in elements:
        a, b = np.broadcast_arrays(part.nodes[:, :, None], part.nodes[:, None, :])
        a, b = a.reshape(-1), b.reshape(-1)
        density = np.repeat(part.inertia[part.section], part.nodes.shape[1]**2, axis=0)
        block = np.zeros((a.size, 6, 6))
        block[:, :3, :3] = (density[:, 0] * part.mass_phi.reshape(-1))[:, None, None] * np.eye(3)
        for k in (1, 2):
            sa, sb = skew(d[a, k]), skew(d[b, k])
            block[:, 3:, 3:] += (density[:, k] * part.mass_dir.reshape(-1))[:, None, None] * np.einsum("mki,mkj->mij", sa, sb)
        i, j = np.nonzero(np.ones((6, 6)))
        rows.append((6 * a[:, None] + i).reshape(-1))
        columns.append((6 * b[:, None] + j).reshape(-1))
        data.append(block[:, i, j].reshape(-1))
    for part in [*scene.bodies, *scene.masses]:
        k = nodes.start(part)
        block = np.zeros((6, 6))
        block[:3, :3] = part.mass * np.eye(3)
        if isinstance(part, RigidBody):
            block[3:, 3:] = d[k].T @ part.inertia @ d[k]
        i, j = np.nonzero(np.ones((6, 6)))
        rows.append(6 * k + i)
        columns.append(6 * k + j)
        data.append(block[i, j])
    for net in scene.nets:
        if net.masses is not None:
            at = 6 * (nodes.start(net) + net.junction)[:, None] + np.arange(3)
            rows.append(at.reshape(-1))
            columns.append(at.reshape(-1))
            data.append(np.repeat(net.masses, 3))
    return sparse.csr_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(6 * n, 6 * n))
