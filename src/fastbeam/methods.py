"""Methods of time integration: the conserving step and the ones it is compared with (theory.md 7)."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .arguments import number
from .errors import ConvergenceError, SceneError
from .kernels import alpha as kernels
from .kernels.alpha import Alpha
from .kernels.beam import point_table_size
from .kernels.work import State
from .model import Model

Array = np.ndarray
METHODS = {"energy_momentum": "energy-momentum conserving", "midpoint": "implicit midpoint", "trapezoidal": "trapezoidal rule",
           "generalized_alpha": "generalized alpha"}
RHO_INF = 0.8


@dataclass(frozen=True)
class Method:
    """One way to step.

    Attributes
    ----------
    name : str
        Key of `METHODS`.
    middle : None or 1
        As in `kernels.step.assemble_step`.
    parameters : None or float64 [4]
        alpha_m, alpha_f, beta, gamma where equilibrium holds at the end of a step.
    rho_inf : None or float
    """

    name: str = "energy_momentum"
    middle: int | None = None
    parameters: Array | None = None
    rho_inf: float | None = None

    @property
    def label(self) -> str:
        """For people."""
        return METHODS[self.name] + ("" if self.rho_inf is None else f", rho_inf = {self.rho_inf:g}")

    @property
    def at_end(self) -> bool:
        """Whether forces belong to the end of a step, not to its middle."""
        return self.parameters is not None


def choose_method(name: str, rho_inf: float | None, order: int, tolerance: float | None) -> Method:
    """The method of these arguments of `simulate`.

    Raises
    ------
    SceneError
        An unknown method, or arguments that do not go with it.
    """
    if not isinstance(name, str) or name not in METHODS:
        raise SceneError(f"method: {name!r} does not exist: choose from {', '.join(map(repr, METHODS))}")
    if rho_inf is not None and name != "generalized_alpha":
        raise SceneError(f"rho_inf: belongs to method='generalized_alpha', not to {name!r}; leave it out")
    if name in ("energy_momentum", "midpoint"):
        return Method(name, 1 if name == "midpoint" else None)
    if order != 2:
        raise SceneError(f"order: method {name!r} has order 2, got order={order!r}; order 4 composes the symmetric steps of "
                         "'energy_momentum' or 'midpoint'")
    if tolerance is not None:
        raise SceneError(f"tolerance: step control is there for 'energy_momentum' and 'midpoint', not for {name!r}; "
                         "leave tolerance out")
    if name == "trapezoidal":
        return Method(name, None, np.array([0.0, 0.0, 0.25, 0.5]))
    rho = RHO_INF if rho_inf is None else number("rho_inf", rho_inf)
    if not 0.0 <= rho <= 1.0:
        raise SceneError(f"rho_inf: must lie in [0, 1] (1 damps nothing, 0 annihilates high frequencies), got {rho:g}")
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + af - am
    return Method(name, None, np.array([am, af, 0.25 * (gamma + 0.5)**2, gamma]), rho)


def empty_rates(method: Method, n_nodes: int) -> Alpha | None:
    """Work arrays of a method, None where it needs none."""
    if method.parameters is None:
        return None
    return Alpha(method.parameters, np.zeros(54 * n_nodes), np.zeros(18 * n_nodes), np.zeros(2), np.eye(3).reshape(-1))


def start_rates(model: Model, alpha: Alpha, state: State, residual: Any) -> None:
    """Consistent accelerations and contact forces of a state: the equations of motion with the second derivative of every
    gap (index 1), written into alpha.rates and state.force.

    Parameters
    ----------
    residual : function of q'' [12 N]
        Rows [6 N] of the nodes' equations, in the order of the nodes, without contact forces.

    Raises
    ------
    ConvergenceError
        Inertia is missing: accelerations are not determined.
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu
    n, s = model.n_nodes, model.n_sliders
    rates = alpha.rates.reshape(9, n, 6)
    q, v = state.q.reshape(n, 4, 3), state.v.reshape(n, 4, 3)
    rates[:] = 0.0
    rates[0, :, :3] = v[:, 0]
    rates[0, :, 3:] = 0.5 * np.cross(q[:, 1:], v[:, 1:]).sum(axis=1)
    spin = _spin_map(model)
    rates[0, :, 3:] = (spin @ rates[0, :, 3:].reshape(-1)).reshape(n, 3)
    tie = _tie_map(model)
    share = _share_map(model)
    free = _free_unknowns(model)
    lift = (tie @ _velocity_map(q) @ share)[:, free]
    bias = np.zeros(12 * n)
    kernels.second_rates(alpha, 0, state.q, bias)
    bias = tie @ bias
    mass = (lift.T @ _mass(model) @ lift).tocsc()
    right = -residual(bias).reshape(-1)[free]
    system: Any = mass
    if s:
        points, tangents, convective = _gap_rates(model, state)
        gap = points @ lift
        along = sparse.csr_matrix((np.concatenate(tangents), np.repeat(np.arange(s), 3), np.arange(3 * s + 1)), shape=(3 * s, s))
        # sliders that hold the same motion twice share its force, as in theory.md (5.5)
        with np.errstate(divide="ignore"):
            soft = sparse.diags(1e-12 * (gap.power(2) @ (1.0 / mass.diagonal())))
        system = sparse.bmat([[mass, -gap.T, None], [gap, soft, -along], [None, along.T, None]]).tocsc()
        right = np.concatenate((right, convective - points @ bias, np.zeros(s)))
    try:
        x = splu(system).solve(right)
    except RuntimeError:
        x = np.full(system.shape[0], np.nan)
    size = np.linalg.norm(right)
    if not np.linalg.norm(system @ x - right) <= 1e-8 * max(size, 1e-300):
        raise ConvergenceError(
            "the accelerations at the start are not determined: generalized alpha and the trapezoidal rule need inertia at every "
            "unknown (section inertia, inertia of every body); use method='energy_momentum' or 'midpoint'",
            step=0, time=0.0, residuals=[], worst="start", state=State(*(y.copy() for y in state)))
    second = lift @ x[:free.size] + bias
    rates[1, :, :3] = second.reshape(n, 4, 3)[:, 0]
    turn = np.zeros(6 * n)
    turn[free] = x[:free.size]
    rates[1, :, 3:] = (spin @ (share @ turn).reshape(n, 6)[:, 3:].reshape(-1)).reshape(n, 3)
    rates[2] = rates[1]
    state.force[:] = x[free.size:free.size + 3 * s]


def _skew(x: Array) -> Array:
    """[m, 3] -> [m, 3, 3]"""
    return np.cross(np.eye(3)[None], x[:, None, :])


def _velocity_map(q: Array) -> Any:
    """(v, spin) of all nodes -> rates of their 12 coordinates, sparse [12 N, 6 N]."""
    from scipy import sparse
    n = len(q)
    block = np.zeros((n, 12, 6))
    block[:, :3, :3] = np.eye(3)
    for k in range(1, 4):
        block[:, 3 * k:3 * k + 3, 3:] = -_skew(q[:, k])
    return sparse.bsr_matrix((block, np.arange(n), np.arange(n + 1)), shape=(12 * n, 6 * n)).tocsr()


def _tie_map(model: Model) -> Any:
    """12 coordinates of all nodes -> the same with those of tied nodes from their targets, sparse [12 N, 12 N]."""
    from scipy import sparse
    n = model.n_nodes
    if model.ties is None:
        return sparse.eye(12 * n, format="csr")
    ties = model.ties
    owner = np.repeat(np.arange(n), np.diff(ties.start))
    free = np.flatnonzero(np.repeat(np.diff(ties.start) == 0, 12))
    rows, columns, values = [free], [free], [np.ones(free.size)]
    # what a tied node takes from a target is never tied itself, so one pass is enough
    for kind, to, of, factor in ((0, [0], [0], np.ones((owner.size, 1, 1))), (1, [0], [3, 6, 9], ties.offset.reshape(-1, 1, 3)),
                                 (2, [3, 6, 9], [3, 6, 9], ties.rotation.reshape(-1, 3, 3))):
        e = np.flatnonzero(ties.kind == kind)
        shape = (e.size, len(to), len(of), 3)
        rows.append(np.broadcast_to((12 * owner[e])[:, None, None, None] + np.array(to)[:, None, None] + np.arange(3), shape))
        columns.append(np.broadcast_to((12 * ties.target[e])[:, None, None, None] + np.array(of)[:, None] + np.arange(3), shape))
        values.append(np.broadcast_to(factor[e][:, :, :, None], shape))
    flat = [np.concatenate([x.reshape(-1) for x in parts]) for parts in (values, rows, columns)]
    return sparse.csr_matrix((flat[0], (flat[1], flat[2])), shape=(12 * n, 12 * n))


def _share_map(model: Model) -> Any:
    """Unknowns of all nodes -> the same with those of nodes that share the row of another from the first on that row, sparse
    [6 N, 6 N]."""
    from scipy import sparse
    n = model.n_nodes
    first, row_of = np.unique(model.pattern.row_of, return_index=True, return_inverse=True)[1:]
    pick = sparse.csr_matrix((np.ones(n), (np.arange(n), first[row_of])), shape=(n, n))
    return sparse.kron(pick, sparse.eye(6), format="csr")


def _spin_map(model: Model) -> Any:
    """Spins of all nodes -> the same with those of rigidly tied nodes from their roots, sparse [3 N, 3 N]."""
    from scipy import sparse
    n = model.n_nodes
    pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.spin_root)), shape=(n, n))
    return sparse.kron(pick, sparse.eye(3), format="csr")


def _free_unknowns(model: Model) -> Array:
    """Numbers 6 node + c of the unknowns that are free; of nodes that share a row those of the first."""
    free = (model.held_mask[:, None] >> np.arange(6)) & 1 == 0
    first = np.unique(model.pattern.row_of, return_index=True)[1]
    free[np.setdiff1d(np.arange(model.n_nodes), first)] = False
    return np.flatnonzero(free.reshape(-1))


def _mass(model: Model) -> Any:
    """Mass matrix on the 12 coordinates of all nodes, sparse [12 N, 12 N]."""
    from scipy import sparse
    n = model.n_nodes
    # [4 N, 4 N] over (phi, d1, d2, d3) of the nodes, the same in all three directions
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]

    def put(i: Array, j: Array, x: Array) -> None:
        rows.append(np.ravel(i)); columns.append(np.ravel(j)); values.append(np.ravel(x))

    for tables in (model.simo, model.green):
        for nn, nq, co, no, *_ in () if tables is None else tables.meta:
            at = tables.nodes[no:no + 8 * nn].reshape(nn, 8)
            live = tables.rows[no:no + 8] != n
            mo = co + 288 + nq * point_table_size(nn)
            rho, j2, j3 = tables.tab[mo:mo + 24].reshape(3, 8)
            m = tables.tab[mo + 24:mo + 24 + 16 * nn * nn].reshape(2, nn, nn, 8)
            a, b = np.broadcast_arrays(at[:, None, live], at[None, :, live])
            for k, x in ((0, rho * m[0]), (2, j2 * m[1]), (3, j3 * m[1])):
                put(4 * a + k, 4 * b + k, x[:, :, live])
    if model.bodies is not None:
        k = np.arange(4)
        i = 4 * model.bodies.node[:, None, None] + k[:, None]
        j = 4 * model.bodies.node[:, None, None] + k
        put(*np.broadcast_arrays(i, j), model.bodies.inertia.reshape(-1, 4, 4))
    small = sparse.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(4 * n, 4 * n))
    return sparse.kron(small, sparse.eye(3), format="csr")


def _gap_rates(model: Model, state: State) -> tuple[Any, list[Array], Array]:
    """Gaps as a matrix on the 12 coordinates [3 S, 12 N], tangents [3] of the curves, and what the second derivative of a gap has
    besides accelerations: 2 ds/dt N' phi' + (ds/dt)^2 N'' phi."""
    from scipy import sparse
    n, s = model.n_nodes, model.n_sliders
    curves, sliders = model.curves, model.sliders
    assert curves is not None and sliders is not None
    x, v = state.q.reshape(n, 4, 3)[:, 0], state.v.reshape(n, 4, 3)[:, 0]
    matrix = sparse.lil_matrix((3 * s, 12 * n))
    contact = model.contact()
    tangents, convective = [], np.zeros((s, 3))
    for k in range(s):
        c, point = int(sliders.curve[k]), int(sliders.point[k])
        e = int(kernels.find_element(curves, c, state.s[k], 0))
        p = int(curves.meta[c, 3]) + e
        local = int(curves.first[p]) + np.arange(int(curves.count[p]))
        contact.basis[:3, local] = 0.0
        for slot, factor in ((0, 1.0), (1, 0.0)):
            kernels.add_basis(curves, c, e, state.s[k], slot, factor, 1.0, contact.legendre, contact.basis, slot)
        shape = contact.basis[:3, local]
        number = int(curves.meta[c, 0]) + local
        tangent = shape[1] @ x[number]
        rate = float((v[point] - shape[0] @ v[number]) @ tangent / (tangent @ tangent))
        tangents.append(tangent)
        convective[k] = 2.0 * rate * (shape[1] @ v[number]) + rate**2 * (shape[2] @ x[number])
        for i in range(3):
            matrix[3 * k + i, 12 * number + i] = -shape[0]
            matrix[3 * k + i, 12 * point + i] = 1.0
    return matrix.tocsr(), tangents, convective.reshape(-1)
