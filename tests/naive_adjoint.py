"""The adjoint of a run in NumPy, step by step: sparse matrices in place of kernels, complex steps in place of written-out
derivatives (theory.md (13.9) to (13.11)). In space, for scenes without damping."""
from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fastbeam.gradients.section_gradient import TINY, Lanes, beam_numbers, lanes_of
from fastbeam.kernels import loop as kernels
from fastbeam.model.forces.loads import load_factors, mean_factors
from fastbeam.model.maps import mass_map, tie_map
from fastbeam.model.tables import strains_of
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


class NaiveAdjoint:
    """Gradient of a weighed sum of positions and velocities; weights: of nodes [n + 1, N, 4, 3] each."""

    def __init__(self, run: Any, of_places: Array, of_rates: Array) -> None:
        part = run._stretch
        self.model = model = run.model.uneliminated(planar=False)
        self.stepper = Stepper(model, np.ones(1), backend="superlu")
        self.h, self.t = run._h, run.t
        self.steps = part if run._stepper.plane is None else part.in_space(run._stepper.plane)
        self.of_places, self.of_rates = of_places, of_rates
        n, rows = model.n_nodes, model.pattern.n
        free = np.ones((rows, 6))
        if model.held is not None:
            free[model.held.row] *= 1 - (model.held.mask[:, None] >> np.arange(6) & 1)
        pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.pattern.row_of)), shape=(n, rows))
        self.rows = (sparse.kron(pick, sparse.eye(6)) @ sparse.diags(free.reshape(-1))).tocsr()
        self.ties, self.mass = tie_map(model), mass_map(model)

    def lift(self, q: Array, x: Array) -> Array:
        """Unknowns of the rows -> rates of all coordinates [N, 4, 3] at q [N, 4, 3]."""
        of_node = (self.rows @ x).reshape(-1, 6)
        out = np.empty_like(q)
        out[:, 0] = of_node[:, :3]
        out[:, 1:] = np.cross(of_node[:, None, 3:], q[:, 1:])
        return np.asarray(self.ties @ out.reshape(-1)).reshape(q.shape)

    def lower(self, q: Array, y: Array) -> Array:
        """The transpose: forces on the coordinates [12 N] -> on the unknowns of the rows."""
        own = (self.ties.T @ y.reshape(-1)).reshape(q.shape)
        forces = np.concatenate((own[:, 0], np.cross(q[:, 1:], own[:, 1:]).sum(axis=1)), axis=1)
        return np.asarray(self.rows.T @ forces.reshape(-1))

    def tangent(self, q: Array, v: Array, dphi: Array, theta: Array) -> Any:
        """Derivative of the equations of a step from q, v by the unknowns at its end."""
        state, work = self.stepper.core_state, self.stepper.work
        state.q[:], state.v[:] = q, v
        work.dphi[:dphi.size], work.theta[:theta.size] = dphi, theta
        work.increment.control[0] = 0.0
        kernels.assemble_all(*self.stepper.records, self.h)
        size = self.model.pattern.keys.size
        return self.stepper.linear.superlu.matrix(work.blocks.reshape(-1, 6, 8)[:size])

    def gradient(self) -> dict[str, Array]:
        """By sections, masses, forces, moments, gravity, load factors and initial velocities."""
        model, h, steps = self.model, self.h, self.steps
        last, shape = len(steps.dphi), (model.n_nodes, 4, 3)
        of, parts = beam_numbers(model)
        count = max((x.stop for x in parts.values()), default=0)
        out = {"stiffness": np.zeros((count, 6, 6)), "inertia": np.zeros((count, 3)), "forces": np.zeros((model.n_nodes, 3)),
               "moments": np.zeros((model.n_nodes, 3)), "gravity": np.zeros(3),
               "factors": np.zeros((last, len(model.load_times))),
               "bodies": np.zeros(0 if model.bodies is None else model.bodies.node.size)}
        lanes = lanes_of(model)
        a, b = self.lower(steps.q[last].reshape(shape), self.of_places[last]), self.of_rates[last].reshape(-1)
        for k in range(last - 1, -1, -1):
            start, end = steps.q[k].reshape(shape), steps.q[k + 1].reshape(shape)
            factor = np.ones(1)
            if model.gravity_time is not None:
                factor = mean_factors(model.gravity_time, self.t[k:k + 1], np.full(1, h))
            factors = load_factors(model, self.t[k:k + 1], np.full(1, h))[0]
            kernels.external_forces(model.loads, factors, self.stepper.work.f_ext)
            right = a + 2.0 / h * self.lower(end, b)
            x = splu(self.tangent(steps.q[k], steps.v[k], steps.dphi[k], steps.theta[k])).solve(right, trans="T")
            back = self.tangent(steps.q[k + 1], -steps.v[k + 1], -steps.dphi[k], -steps.theta[k])
            w = self.lift(0.5 * (start + end), x)
            inertia = np.asarray(self.mass @ w.reshape(-1))
            a = (4.0 / h**2 * self.lower(start, inertia) - back.T @ x - 2.0 / h * self.lower(start, b)
                 + self.lower(start, self.of_places[k]))
            b = 2.0 / h * inertia - b + self.of_rates[k].reshape(-1)
            second = (steps.v[k + 1] - steps.v[k]).reshape(shape) / h
            spins = (self.rows @ x).reshape(-1, 6)[model.spin_root, 3:]
            out["forces"] += w[:, 0]
            out["moments"] += spins
            out["gravity"] += factor[0] * (model.gravity_weight @ w[:, 0])
            # every row once: those of nodes that share one have the same rates
            first = np.unique(model.pattern.row_of, return_index=True)[1]
            loads = np.zeros((len(factors), 8 * (model.n_nodes + 1)))
            for vector, one in zip(loads, np.eye(len(factors))):
                kernels.external_forces(model.loads, one, vector)
            loads = loads.reshape(len(factors), -1, 8)[:, model.pattern.row_of[first], :6]
            out["factors"][k] = np.einsum("kni,ni->k", loads, np.concatenate((w[:, 0], spins), axis=1)[first])
            if model.bodies is not None:
                at = model.bodies.node
                out["bodies"] -= np.sum(w[at, 0] * (second[at, 0] - factor[0] * model.gravity), axis=1)
            for group in lanes:
                _add_sections(group, of, start, end, w, second, factor[0] * model.gravity, out)
        at_start = (self.rows @ self.lower(steps.q[0].reshape(shape), b)).reshape(-1, 2, 3)
        return {**out, "velocities": at_start[:, 0], "spins": at_start[:, 1]}


def _add_sections(lanes: Lanes, of: Array, start: Array, end: Array, rates: Array, second: Array, gravity: Array,
                  out: dict[str, Array]) -> None:
    own = of[lanes.nodes[:, 0]]
    w, u = rates[lanes.nodes], second[lanes.nodes]
    strain, change = virtual(lanes, start[lanes.nodes], end[lanes.nodes], w)
    by_c = np.einsum("eg,egi,egj->eij", lanes.weight, change, strain)
    np.add.at(out["stiffness"], own, -0.5 * (by_c + by_c.transpose(0, 2, 1)))
    for column, (k, x, mass) in enumerate(((0, u[:, :, 0] - gravity, lanes.mass), (2, u[:, :, 2], lanes.turning),
                                           (3, u[:, :, 3], lanes.turning))):
        np.add.at(out["inertia"][:, column], own, -np.einsum("enc,emc,enm->e", w[:, :, k], x, mass))


def virtual(lanes: Lanes, start: Array, end: Array, rates: Array) -> tuple[Array, Array]:
    """Mean strains of a step less those of the reference, and the changes of strains that the mean stresses do work on, theory.md
    (4.7), along rates of the coordinates in its middle; coordinates [E, nn, 4, 3], both results [E, nq, 6]."""
    def at_points(x: Array) -> tuple[Array, Array, Array]:
        f = np.einsum("egn,enc->egc", lanes.shapes[..., 0], x[:, :, 0])
        d, k = (np.einsum("egn,enkc->egkc", lanes.shapes[..., i], x[:, :, 1:]) for i in (1, 2))
        return f, d, k

    ends = [at_points(x) for x in (start, end)]
    strains = [strains_of(lanes.strain, *x) for x in ends]
    mean = 0.5 * (strains[0] + strains[1]) - lanes.reference
    (f, d, k), (fw, dw, kw) = (tuple(0.5 * (a + b) for a, b in zip(*ends)), at_points(rates))
    if lanes.strain != "simo_reissner":
        # quadratic forms themselves
        return mean, strains_of(lanes.strain, f + 1j * TINY * fw, d + 1j * TINY * dw, k + 1j * TINY * kw).imag / TINY
    forms = [_forms(*x) for x in ends]
    shear2, shear3, *twists, c = (0.5 * (a + b) for a, b in zip(*forms))
    stretch = 0.5 * (strains[0][..., 0] + strains[1][..., 0])
    by = [x.imag / TINY for x in _forms(f + 1j * TINY * fw, d + 1j * TINY * dw, k + 1j * TINY * kw)]
    along = (np.einsum("...c,...c->...", f, fw) - shear2 * by[0] - shear3 * by[1]) / stretch
    return mean, np.stack((along, by[0], by[1], *(c * x + y * by[5] for x, y in zip(by[2:5], twists))), axis=-1)


def _forms(f: Array, d: Array, k: Array) -> list[Array]:
    """Shears, K_1 to K_3 and c of (2.2)."""
    def dot(a: Array, b: Array) -> Array:
        return np.einsum("...c,...c->...", a, b)

    d1, d2, d3 = (d[..., i, :] for i in range(3))
    k1, k2, k3 = (k[..., i, :] for i in range(3))
    return [dot(f, d2), dot(f, d3), 0.5 * (dot(k2, d3) - dot(k3, d2)), 0.5 * (dot(k3, d1) - dot(k1, d3)),
            0.5 * (dot(k1, d2) - dot(k2, d1)), 1.75 - 0.25 * (dot(d1, d1) + dot(d2, d2) + dot(d3, d3))]
