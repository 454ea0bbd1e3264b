"""Damping matrix about a state of rest (theory.md 14): damped sections, linear drag, dampers in joints, springs and bushings,
user laws. Also the material stiffness, a share of which dissipates energy by a loss factor."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.contact.slider_forces import CONTROL
from fastbeam.kernels.forces.bushing import Bushings
from fastbeam.kernels.forces.force_element import ForceElements
from fastbeam.kernels.forces.line_force import LineForces
from fastbeam.kernels.forces.spring_laws import SpringLaws
from fastbeam.kernels.forces.user_force import UserForces
from fastbeam.kernels.layout import VISCOSITY, layout_of
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.failed_laws import ask
from fastbeam.model.model import Model
from fastbeam.model.tables import strains_by_nodes

Array = np.ndarray
# rates of the differences of laws, in sizes of the scene a second, and rad/s
RATE = 1e-6


def damping_map(model: Model, q: Array, t: float, factor: float) -> Any:
    """Assemble the damping matrix for the rates of all coordinates at a state of rest, sparse [12 N, 12 N].

    model: Model in space.
    q: float64 [N, 4, 3].
    t, factor: time, s, of the laws, and load factor of those that grow with it.
    Raises SceneError: drag in moving air, under which nothing is at rest.
    """
    damped = () if model.damped is None else model.damped.strains
    links = _of_joints(model, q) + _of_springs(model, q) + _of_bushings(model, q) + _of_laws(model, q, t, factor)
    links = links + _of_lines(model, q, t) + _of_elements(model, q, t)
    return (_of_sections(model, q, damped, VISCOSITY) + _of_drag(model) + links).tocsr()


def material_map(model: Model, q: Array) -> Any:
    """Assemble the material stiffness of all beams, sparse [12 N, 12 N]: the tangent without the part of the present stresses."""
    return _of_sections(model, q, ("simo_reissner", "green_lagrange"), 0)


def _of_sections(model: Model, q: Array, sets: tuple[str, ...], first: int) -> Any:
    """Assemble int E_q^T X E_q ds, the 6 x 6 matrix X at offset `first` from C in the tables of these strain sets."""
    n = 12 * model.n_nodes
    parts = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for name, tables in (("simo_reissner", model.simo), ("green_lagrange", model.green)):
        for nn, nq, co, no, *_ in tables.meta.tolist() if tables is not None and name in sets else ():
            live = np.flatnonzero(tables.rows[no:no + 8] != model.n_nodes)
            matrix = tables.tab[co + first:co + first + 288].reshape(6, 6, 8)[:, :, live]
            if not matrix.any():
                continue
            at = tables.nodes[no:no + 8 * nn].reshape(nn, 8)[:, live]
            place = layout_of(SPACE, nn, nq)
            point = tables.tab[co + place.point:co + place.inertia].reshape(nq, -1, 8)[:, :, live]
            shapes = [np.moveaxis(point[:, 1 + k::3], 2, 0) for k in range(3)]
            lead = strains_by_nodes(name, q[at.T], *shapes)
            weighed = np.moveaxis(point[:, 0], 1, 0)[:, :, None, None] * np.einsum("ijl,lgjm->lgim", matrix, lead)
            blocks = np.einsum("lgim,lgin->lmn", lead, weighed, optimize=True)
            unknown = (12 * at.T[:, :, None] + np.arange(12)).reshape(live.size, -1)
            rows, columns = np.broadcast_arrays(unknown[:, :, None], unknown[:, None])
            parts.append((rows.reshape(-1), columns.reshape(-1), blocks.reshape(-1)))
    rows, columns, values = (np.concatenate(x) for x in zip(*parts))
    return sparse.csr_matrix((values, (rows, columns)), shape=(n, n))


def _of_drag(model: Model) -> Any:
    """Assemble linear drag; drag by the square of a velocity has no linear part at rest."""
    diagonal = np.zeros((model.n_nodes, 4, 3))
    drag = model.dragged
    require(Analysis.DAMPED, model)
    if drag is not None:
        np.add.at(diagonal[:, 0], drag.node, drag.coefficient[:, 2:])
    return sparse.diags(diagonal.reshape(-1), format="csr")


def _of_joints(model: Model, q: Array) -> Any:
    """Assemble the dampers and controllers on the distances and angles that joints leave free."""
    n = 12 * model.n_nodes
    motions = model.motions
    if motions is None:
        return sparse.csr_matrix((n, n))
    damping = motions.every.damping.copy()
    # damping of controllers below their largest force
    kind, _, by_rate, _ = motions.holds.gains.T
    damping[motions.holds.driven] += np.where(kind == CONTROL, by_rate, 0.0)
    damped = np.flatnonzero(damping)
    rates = np.zeros((damped.size, model.n_nodes, 4, 3))
    for row, k in enumerate(damped.tolist()):
        pair = motions.node[k].tolist()
        rates[row, pair] += motions.laws[k].lead(q[pair])[0]
    lead = sparse.csr_matrix(rates.reshape(len(rates), n))
    return lead.T @ sparse.diags(damping[damped]) @ lead


def _of_springs(model: Model, q: Array) -> Any:
    """Assemble the dampers along the line of two points, one-sided dampers where they act."""
    n = 12 * model.n_nodes
    total = sparse.csr_matrix((n, n))
    for table in model.links:
        if not isinstance(table, SpringLaws):
            continue
        a, b = table.node.T
        edge = q[b, 0] - q[a, 0]
        length = np.linalg.norm(edge, axis=1)
        acts = (table.damping > 0.0) & (table.side * (length - table.length) >= 0.0) & (length > 0.0)
        direction = (edge / np.where(length > 0.0, length, 1.0)[:, None])[acts]
        k, c = np.arange(int(acts.sum()))[:, None], np.arange(3)
        rows = np.tile(np.repeat(k, 3), 2)
        columns = np.concatenate(((12 * b[acts][:, None] + c).reshape(-1), (12 * a[acts][:, None] + c).reshape(-1)))
        lead = sparse.csr_matrix((np.concatenate((direction.reshape(-1), -direction.reshape(-1))), (rows, columns)),
                                 shape=(k.size, n))
        total = total + lead.T @ sparse.diags(table.damping[acts]) @ lead
    return total


def _of_links(model: Model, kind: type, blocks: Callable[[Any], Iterable[tuple[Array, Array]]]) -> Any:
    """Assemble the damping of the links of one kind; blocks: yields coordinates [m] and matrices [m, m] from a table of them."""
    n = 12 * model.n_nodes
    total = sparse.csr_matrix((n, n))
    for table in model.links:
        for at, block in blocks(table) if isinstance(table, kind) else ():
            rows, columns = np.broadcast_arrays(at[:, None], at)
            total = total + sparse.csr_matrix((block.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(n, n))
    return total


def _coordinates(*nodes: int) -> Array:
    """Return the numbers of the coordinates of some nodes, [12 m]."""
    return np.asarray((12 * np.array(nodes)[:, None] + np.arange(12)).reshape(-1))


def _of_lines(model: Model, q: Array, t: float) -> Any:
    """Assemble the derivative of line forces by the rate of the length: central differences."""
    def blocks(table: LineForces) -> Iterator[tuple[Array, Array]]:
        for k, (a, b) in enumerate(table.node.tolist()):
            edge = q[b, 0] - q[a, 0]
            length = float(np.linalg.norm(edge))
            size = RATE * length
            ahead, back = (ask(model, table, k, t, np.array([length, rate]), 1)[0] for rate in (size, -size))
            lead = np.concatenate((edge, -edge)) / length
            yield _coordinates(b, a).reshape(2, 12)[:, :3].reshape(-1), (ahead - back) / (2.0 * size) * np.outer(lead, lead)

    return _of_links(model, LineForces, blocks)


def _of_bushings(model: Model, q: Array) -> Any:
    """Assemble the dampers of displacements along the axes of the first node and of products of the axes of both, theory.md
    (4.21)."""
    def blocks(table: Bushings) -> Iterator[tuple[Array, Array]]:
        turn = table.axes.reshape(-1, 2, 3, 3)
        for k, (a, b) in enumerate(table.node.tolist()):
            shifts, products = _relative(turn[k], q, a, b)
            viscosity, drag = (x.reshape(-1, 3, 3)[k] for x in (table.viscosity, table.drag))
            yield _coordinates(a, b), shifts.T @ viscosity @ shifts + np.einsum("ijm,il,ljn->mn", products, drag, products)

    return _of_links(model, Bushings, blocks)


def _relative(turn: Array, q: Array, a: int, b: int) -> tuple[Array, Array]:
    """Return the derivatives by the coordinates of nodes a and b of the displacement along the axes of a, [3, 24], and of the
    products of the axes of both, [3, 3, 24]; turn [2, 3, 3]: axes in the triads of the nodes."""
    own, other = (x @ q[node, 1:] for x, node in zip(turn, (a, b)))
    shifts, products = np.zeros((3, 2, 4, 3)), np.zeros((3, 3, 2, 4, 3))
    shifts[:, 1, 0], shifts[:, 0, 0] = own, -own
    shifts[:, 0, 1:] = turn[0][:, :, None] * (q[b, 0] - q[a, 0])
    products[:, :, 0, 1:] = turn[0][:, None, :, None] * other[None, :, None]
    products[:, :, 1, 1:] = turn[1][None, :, :, None] * own[:, None, None]
    return shifts.reshape(3, 24), products.reshape(3, 3, 24)


def _by_rates(model: Model, table: Any, k: int, t: float, given: Array, share: float = 1.0) -> Array:
    """Return minus a share of the derivative [6, 6] of a law by velocity and spin: central differences; given: its arguments at
    rest."""
    out = np.zeros((6, 6))
    for c in range(6):
        size = RATE * (model.length if c < 3 else 1.0)
        ends = []
        for sign in (1.0, -1.0):
            moved = given.copy()
            moved[12 + c] = sign * size
            ends.append(ask(model, table, k, t, moved, 6))
        out[:, c] = -share * (ends[0] - ends[1]) / (2.0 * size)
    return out


def _of_laws(model: Model, q: Array, t: float, factor: float) -> Any:
    """Assemble minus the derivative of forces and moments by user laws, by velocity and spin."""
    def blocks(table: UserForces) -> Iterator[tuple[Array, Array]]:
        for k, node in enumerate(table.node.tolist()):
            # rates of coordinates -> velocity and spin
            motion = np.zeros((6, 12))
            motion[:3, :3] = np.eye(3)
            for i in range(3):
                motion[3:, 3 * i + 3:3 * i + 6] = 0.5 * np.cross(q[node, 1 + i], np.eye(3)).T
            given = np.concatenate((q[node].reshape(-1), np.zeros(6)))
            block = _by_rates(model, table, k, t, given, (factor if table.grows[k] else 1.0) * table.share[k])
            yield _coordinates(node), motion.T @ block @ motion

    return _of_links(model, UserForces, blocks)


def _of_elements(model: Model, q: Array, t: float) -> Any:
    """Assemble minus the derivative of force elements by the rates of position and rotation in the axes of the first node:
    central differences, on the 24 coordinates of both nodes."""
    def blocks(table: ForceElements) -> Iterator[tuple[Array, Array]]:
        turn = table.axes.reshape(-1, 2, 3, 3)
        for k, (a, b) in enumerate(table.node.tolist()):
            own, other = (x @ q[node, 1:] for x, node in zip(turn[k], (a, b)))
            c, (shifts, products) = own @ other.T, _relative(turn[k], q, a, b)
            spin = np.einsum("ilm,jl->ijm", products, c)
            lead = np.concatenate((shifts, [0.5 * (spin[(i + 2) % 3, (i + 1) % 3] - spin[(i + 1) % 3, (i + 2) % 3])
                                            for i in range(3)]))
            given = np.concatenate((own @ (q[b, 0] - q[a, 0]), c.reshape(-1), np.zeros(6)))
            yield _coordinates(a, b), lead.T @ _by_rates(model, table, k, t, given) @ lead

    return _of_links(model, ForceElements, blocks)
