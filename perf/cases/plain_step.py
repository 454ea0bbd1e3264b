"""The conserving step as one would write it with NumPy, SciPy and PARDISO: what the compiled step is measured against.

One free beam with the strains (2.2) of docs/theory.md, same unknowns, same equations, same stopping rule. All elements at once by
batched matrix products, assembly from triplets to CSR, `pypardiso.spsolve` (SciPy's `spsolve` where it is missing).
"""
from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix

import fastbeam as fb

try:
    from pypardiso import spsolve
except ImportError:
    from scipy.sparse.linalg import spsolve

Array = np.ndarray
# the quadratic forms (2.4) are 1/2 z^T A_i z over the vectors z = (phi', d1, d2, d3, d1', d2', d3'), the last but for 7/4
PAIRS = (((0, 0, 0.5),), ((0, 2, 1.0),), ((0, 3, 1.0),), ((5, 3, 0.5), (6, 2, -0.5)), ((6, 1, 0.5), (4, 3, -0.5)),
         ((4, 2, 0.5), (5, 1, -0.5)), ((1, 1, -0.25), (2, 2, -0.25), (3, 3, -0.25)))


def quadratic_forms() -> Array:
    """A [7, 7, 7], symmetric."""
    a = np.zeros((7, 7, 7))
    for i, pairs in enumerate(PAIRS):
        for x, y, c in pairs:
            a[i, x, y] += c
            a[i, y, x] += c
    return a


def skew(x: Array) -> Array:
    """x cross, [..., 3] -> [..., 3, 3]."""
    o = np.zeros(x.shape[:-1])
    return np.stack((np.stack((o, -x[..., 2], x[..., 1]), -1), np.stack((x[..., 2], o, -x[..., 0]), -1),
                     np.stack((-x[..., 1], x[..., 0], o), -1)), -2)


def stretch(q: Array) -> Array:
    """sqrt(phi'.phi' - Gamma_2^2 - Gamma_3^2) from the forms; (2.2)."""
    return np.sqrt(2.0 * q[..., 0] - q[..., 1]**2 - q[..., 2]**2)


def strains(q: Array) -> Array:
    """The strains (2.2) [..., 6] but for the constant 1 from the forms [..., 7]."""
    return np.concatenate((stretch(q)[..., None], q[..., 1:3], (1.75 + q[..., 6:]) * q[..., 3:6]), axis=-1)


def strain_changes(q: Array, r: Array) -> Array:
    """Derivatives of the strains by the forms [..., 6, 7], with the stretch r [...]; (4.7)."""
    m = np.zeros((*q.shape[:-1], 6, 7))
    m[..., 0, 0], m[..., 0, 1], m[..., 0, 2] = 1.0 / r, -q[..., 1] / r, -q[..., 2] / r
    m[..., 1, 1] = m[..., 2, 2] = 1.0
    for i in (3, 4, 5):
        m[..., i, i], m[..., i, 6] = 1.75 + q[..., 6], q[..., i]
    return m


class PlainBeam:
    """Steps of one free beam; `q`, `v` [N, 4, 3] are the coordinates and their rates."""

    def __init__(self, beam: fb.Beam, q: Array, v: Array) -> None:
        basis = beam.basis
        self.q, self.v = q.copy(), v.copy()
        self.length = beam.length
        self.nodes = basis.element_nodes
        ne, nn = self.nodes.shape
        nq = basis.weight.shape[1]
        self.weight, self.C, self.A = basis.weight, beam.section.C, quadratic_forms()
        # z = sum_b G_b q_b, [ne, nq, 7, nn, 4]
        g = np.zeros((ne, nq, 7, nn, 4))
        g[:, :, 0, :, 0] = basis.phi_s
        for i in (1, 2, 3):
            g[:, :, i, :, i] = basis.dir
            g[:, :, 3 + i, :, i] = basis.dir_s
        self.G = g.reshape(ne, nq, 7, 4 * nn)
        self.G3 = np.einsum("egxk,cd->egxckd", self.G, np.eye(3)).reshape(ne, nq, 21, 12 * nn)
        self.e0 = strains(self.forms(self.points(q)))
        rho_a, rho_i2, rho_i3 = beam.section.inertia
        m = np.zeros((ne, nn, 4, nn, 4))
        m[:, :, 0, :, 0] = rho_a * basis.mass_phi
        m[:, :, 2, :, 2] = rho_i2 * basis.mass_dir
        m[:, :, 3, :, 3] = rho_i3 * basis.mass_dir
        self.M = m.reshape(ne, 4 * nn, 4 * nn)
        self.M3 = np.einsum("exy,cd->excyd", self.M, np.eye(3)).reshape(ne, 12 * nn, 12 * nn)
        dof = (6 * self.nodes[:, :, None] + np.arange(6)).reshape(ne, 6 * nn)
        self.rows = np.repeat(dof, 6 * nn, axis=1).reshape(-1)
        self.columns = np.tile(dof, (1, 6 * nn)).reshape(-1)
        self.dof = dof
        self.iterations = 0

    def points(self, q: Array) -> Array:
        """z [ne, nq, 7, 3] at the quadrature points."""
        ne, nn = self.nodes.shape
        return self.G @ q[self.nodes].reshape(ne, 1, 4 * nn, 3)

    def forms(self, z: Array) -> Array:
        """Quadratic forms [ne, nq, 7]; (2.4)."""
        return 0.5 * np.einsum("egxc,ixy,egyc->egi", z, self.A, z, optimize=True)

    def rows_of_forms(self, z: Array) -> Array:
        """A_i z over the coordinates of the element, [ne, nq, 7, 12 nn]."""
        ne, nq = z.shape[:2]
        t = np.tensordot(z, self.A, axes=((2,), (2,))).transpose(0, 1, 3, 4, 2)
        return t.reshape(ne, nq, 7, 21) @ self.G3

    def projection(self, d: Array) -> Array:
        """P [ne, nn, 12, 6] = [I, 0; 0, -skew(d_i)] of directors [ne, nn, 3, 3]; (4.2)."""
        p = np.zeros((*d.shape[:2], 12, 6))
        p[:, :, :3, :3] = np.eye(3)
        p[:, :, 3:, 3:] = -skew(d).reshape(*d.shape[:2], 9, 3)
        return p

    def system(self, dq: Array, h: float) -> tuple[Array, object]:
        """Residual [6 N] and tangent (CSR) at the increments dq [N, 4, 3] of a step; (4.1), (4.2)."""
        ne, nn = self.nodes.shape
        q_mid, q_end = self.q + 0.5 * dq, self.q + dq
        z_mid, z_end = self.points(q_mid), self.points(q_end)
        start, end = self.forms(2.0 * z_mid - z_end), self.forms(z_end)
        r = 0.5 * (stretch(start) + stretch(end))
        to_middle, to_end = strain_changes(0.5 * (start + end), r), strain_changes(end, stretch(end))
        mean = ((0.5 * (strains(start) + strains(end)) - self.e0) @ self.C) * self.weight[:, :, None]
        stress = (mean[:, :, None] @ to_middle)[:, :, 0]
        section = self.weight[:, :, None, None] * self.C
        axial = mean[:, :, 0] / r
        for i in range(3):
            section[:, :, i, i] -= axial
        section = 0.5 * to_middle.transpose(0, 1, 3, 2) @ section @ to_end
        for i in (3, 4, 5):
            section[:, :, i, 6] += 0.5 * mean[:, :, i]
            section[:, :, 6, i] += 0.5 * mean[:, :, i]
        b_mid, b_end = self.rows_of_forms(z_mid), self.rows_of_forms(z_end)
        u = (2.0 / h**2) * (dq - h * self.v)
        f = (stress[:, :, None] @ b_mid)[:, :, 0].sum(axis=1)
        f += (self.M @ u[self.nodes].reshape(ne, 4 * nn, 3)).reshape(ne, 12 * nn)
        # material, geometric and inertial part over the 12 coordinates of a node
        k = (b_mid.transpose(0, 1, 3, 2) @ (section @ b_end)).sum(axis=1)
        form = 0.5 * np.tensordot(stress, self.A, axes=1)
        shape = (self.G.transpose(0, 1, 3, 2) @ form @ self.G).sum(axis=1)
        k = k.reshape(ne, 4 * nn, 3, 4 * nn, 3)
        for c in range(3):
            k[:, :, c, :, c] += shape
        k = k.reshape(ne, 12 * nn, 12 * nn) + (2.0 / h**2) * self.M3
        # to six unknowns a node
        p_mid, p_end = self.projection(q_mid[self.nodes][:, :, 1:]), self.projection(q_end[self.nodes][:, :, 1:])
        forces = f.reshape(ne, nn, 12)
        r = np.einsum("enxi,enx->eni", p_mid, forces)
        k = k.reshape(ne, nn, 12, nn, 12).transpose(0, 1, 3, 2, 4)
        k = p_mid.transpose(0, 1, 3, 2)[:, :, None] @ k @ p_end[:, None]
        d, s = q_end[self.nodes][:, :, 1:], forces.reshape(ne, nn, 4, 3)[:, :, 1:]
        turn = 0.5 * (np.einsum("enic,enid->encd", d, s) - np.einsum("enic,enic->en", d, s)[..., None, None] * np.eye(3))
        a = np.arange(nn)
        k[:, a, a, 3:, 3:] += turn
        size = 6 * len(self.q)
        residual = np.bincount(self.dof.reshape(-1), weights=r.reshape(-1), minlength=size)
        values = k.transpose(0, 1, 3, 2, 4).reshape(-1)
        return residual, coo_matrix((values, (self.rows, self.columns)), shape=(size, size)).tocsr()

    def turned(self, theta: Array) -> Array:
        """Increments of the directors, cay(theta) d - d, [N, 3, 3]; (4.2)."""
        d = self.q[:, 1:]
        t = np.broadcast_to(theta[:, None], d.shape)
        x = np.cross(t, d)
        return (x + 0.5 * np.cross(t, x)) / (1.0 + 0.25 * np.sum(theta**2, axis=1))[:, None, None]

    def step(self, h: float) -> None:
        """One step of size h.

        Raises
        ------
        RuntimeError
            25 iterations do not reach round-off.
        """
        dq = np.empty_like(self.q)
        dq[:, 0] = h * self.v[:, 0]
        theta = 0.5 * h * np.cross(self.q[:, 1:], self.v[:, 1:]).sum(axis=1)
        dq[:, 1:] = self.turned(theta)
        before = np.inf
        for _ in range(25):
            r, k = self.system(dq, h)
            x = -spsolve(k, r).reshape(-1, 6)
            dq[:, 0] += x[:, :3]
            p = x[:, 3:]
            theta = theta + p - 0.5 * np.cross(theta, p) + 0.25 * np.sum(theta * p, axis=1)[:, None] * theta
            dq[:, 1:] = self.turned(theta)
            self.iterations += 1
            size = np.max(np.abs(x[:, :3])) / self.length + np.sqrt(np.max(np.sum(p**2, axis=1)))
            if size <= 1e-15 or (size < before < np.inf and size * (size / before) ** 2 <= 1e-20) or 0.1 * before < size <= 1e-9:
                self.q += dq
                self.v = (2.0 / h) * dq - self.v
                return
            before = size
        raise RuntimeError(f"the Newton iteration did not converge, last increment {size:.3g}; take a smaller step")
