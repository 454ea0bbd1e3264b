"""What one conserving step adds to gradients by sections and masses, from its adjoint rates (theory.md (13.11))."""
from __future__ import annotations

import numpy as np

from .model import Model
from .section_gradient import TINY, Lanes, beam_numbers, lanes_of
from .tables import strains_of

Array = np.ndarray
# points of elements in all steps that are taken together
BATCH = 4096


class SectionSums:
    """Sums over steps of derivatives by the sections of all beams.

    Parameters
    ----------
    model : Model
        In space, without condensed beams.

    Attributes
    ----------
    stiffness, inertia : float64 [beams, 6, 6], [beams, 3]
        By C, and by rhoA, rhoI2, rhoI3.
    """

    def __init__(self, model: Model) -> None:
        self.of, self.parts = beam_numbers(model)
        self.lanes = lanes_of(model)
        n = max((x.stop for x in self.parts.values()), default=0)
        # steps that wait, and the numbers of points of each
        self._waiting: list[tuple[Array, ...]] = []
        self._size = sum(x.weight.size for x in self.lanes)
        self.stiffness, self.inertia = np.zeros((n, 6, 6)), np.zeros((n, 3))

    def add(self, start: Array, end: Array, rates: Array, second: Array, gravity: Array) -> None:
        """One step from `start` to `end` [N, 4, 3] with adjoint rates of the coordinates in its middle, second rates u of (4.1),
        and gravity, m/s^2. Steps are taken together where they are small."""
        self._waiting.append((start, end, rates, second, gravity))
        if len(self._waiting) * self._size >= BATCH:
            self.finish()

    def finish(self) -> None:
        """Take the steps that wait."""
        if not self._waiting:
            return
        start, end, rates, second, gravity = (np.array(x) for x in zip(*self._waiting))
        self._waiting = []
        for lanes in self.lanes:
            at = lanes.nodes
            own = self.of[at[:, 0]]
            w, u = rates[:, at], second[:, at]
            strain, change = virtual(lanes, start[:, at], end[:, at], w)
            # all steps of a point in one product
            by_c = np.einsum("egti,egtj->eij", np.ascontiguousarray((lanes.weight[..., None] * change).transpose(1, 2, 0, 3)),
                             np.ascontiguousarray(strain.transpose(1, 2, 0, 3)), optimize=True)
            np.add.at(self.stiffness, own, -0.5 * (by_c + by_c.transpose(0, 2, 1)))
            pulled = u[:, :, :, 0] - gravity[:, None, None]
            of = (0, pulled, lanes.mass), (2, u[:, :, :, 2], lanes.turning), (3, u[:, :, :, 3], lanes.turning)
            by = [np.einsum("tenc,temc,enm->e", w[:, :, :, k], x, mass, optimize=True) for k, x, mass in of]
            np.add.at(self.inertia, own, -np.stack(by, axis=1))


def virtual(lanes: Lanes, start: Array, end: Array, rates: Array) -> tuple[Array, Array]:
    """Mean strains of a step less those of the reference, and the changes of strains that the mean stresses do work
    on, theory.md (4.7), along rates of the coordinates in its middle; coordinates [t, E, nn, 4, 3] of t steps,
    both results [t, E, nq, 6]."""
    def at_points(x: Array) -> tuple[Array, Array, Array]:
        f = np.einsum("egn,tenc->tegc", lanes.shapes[..., 0], x[:, :, :, 0], optimize=True)
        d, k = (np.einsum("egn,tenkc->tegkc", lanes.shapes[..., i], x[:, :, :, 1:], optimize=True) for i in (1, 2))
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
