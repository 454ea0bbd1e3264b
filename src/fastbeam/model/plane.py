"""Plane of a scene: states in space and in the plane, and the model with 3 unknowns a node (theory.md 10)."""
from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.recorded import rows_in_space
from fastbeam.kernels.state import State

Array = np.ndarray
# components out of the plane that count as round-off, relative to the largest quantity of the same kind
TOLERANCE = 1e-12
AXES = "xyz"


class NotPlanar(Exception):
    """Reason why a scene has to be run in space."""


@dataclass(frozen=True)
class Plane:
    """The plane of a scene and its tables."""

    axes: Array  # float64 [3, 3]: two axes in the plane and its normal, by rows
    height: float  # height of all nodes along the normal, m
    factor: Array  # complex128 [N, 3]: director i of a node is factor_i u in the plane: a + i b stands for a u + b J u
    normal: Array  # float64 [N, 3]: constant component of the directors along the normal
    vectors: int  # number of constraint forces that are vectors; scalar multipliers follow
    singles: Array  # int64 [*]: numbers of the scalar multipliers that act in the plane
    single: int  # number of all scalar multipliers in space
    # float64 [O, 3]: three multipliers of every sleeve in space for a unit one in the plane. They come last
    moments: Array = field(default_factory=lambda: np.zeros((0, 3)))
    model: Any = None  # Model with 4 coordinates a node, x, y and u, and 3 unknowns

    @property
    def label(self) -> str:
        """Text for `print(model)`."""
        k = np.flatnonzero(self.axes[2] == 1.0)
        if k.size:
            return "plane normal to " + AXES[k[0]]
        return "plane with normal (" + ", ".join(f"{x:.3g}" for x in self.axes[2]) + ")"

    def reduce(self, state: State) -> State:
        """Return the state in the plane."""
        n = len(self.factor)
        flat = [to_plane(x.reshape(n, 4, 3), self.axes) for x in (state.q, state.v)]
        # u from the director that lies best in the plane
        k = np.argmax(np.abs(self.factor), axis=1)
        at = np.arange(n)
        q, v = (np.stack((z[:, 0], z[at, 1 + k] / self.factor[at, k]), axis=1) for z in flat)
        vectors, moments = 3 * self.vectors, state.force.size - self.moments.size
        force = to_plane(state.force[:vectors].reshape(-1, 3), self.axes)
        about = np.sum(self.moments * state.force[moments:].reshape(-1, 3), axis=1)
        return State(numbers_of(q), numbers_of(v), state.s.copy(),
                     np.concatenate((numbers_of(force), state.force[vectors:moments][self.singles], about)), state.history.copy())

    def expand(self, flat: State) -> State:
        """Return the state in space."""
        return State(*(x.reshape(-1) for x in self.rows(flat.q[None], flat.v[None])), flat.s.copy(), self.forces(flat.force),
                     flat.history.copy())

    def rows(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return coordinates in space and their rates, [m, 12 N], from rows of those in the plane [m, 4 N]."""
        places, rates = empty((2, len(q), 12 * len(self.factor)))
        rows_in_space(self._directions, 1.0, q, places)
        rows_in_space(self._directions, 0.0, v, rates)
        return places, rates

    def vectors_of(self, rows: Array, nodes: Array, is_place: bool) -> Array:
        """Return positions and directors in space of some nodes [m] from rows of coordinates [n, 4 N], or their rates:
        [n, m, 4, 3]."""
        z = np.ascontiguousarray(rows).view(complex).reshape(len(rows), -1, 2)[:, nodes]
        out = to_space(np.concatenate((z[:, :, :1], self.factor[nodes] * z[:, :, 1:]), axis=2), self.axes)
        return out + self._directions[2].reshape(-1, 4, 3)[nodes] if is_place else out

    @cached_property
    def _directions(self) -> Array:
        """Vectors of all coordinates along the axes of the plane, and their components along the normal, [3, 12 N]."""
        up = np.concatenate((np.full((len(self.factor), 1), self.height), self.normal), axis=1)
        turned = np.concatenate((np.ones((len(self.factor), 1)), self.factor), axis=1)
        return np.stack((*(to_space(x, self.axes).reshape(-1) for x in (turned, 1j * turned)),
                         (up[:, :, None] * self.axes[2]).reshape(-1)))

    def forces(self, force: Array) -> Array:
        """Return the forces of all constraints [*] in space."""
        if not self.single and not force.size:
            return force.copy()
        vectors, moments = 2 * self.vectors, force.size - len(self.moments)
        about = force[moments:, None] * self.moments
        single = np.zeros(self.single)
        single[self.singles] = force[vectors:moments]
        return np.concatenate((to_space(np.ascontiguousarray(force[:vectors]).view(complex), self.axes).reshape(-1),
                               single, about.reshape(-1)))

    def holds(self, state: State) -> bool:
        """Return whether a state lies in the plane."""
        try:
            check_state(state.q, state.v, self, self.model.length)
        except NotPlanar:
            return False
        force = state.force[:3 * self.vectors].reshape(-1, 3)
        # contact forces carry the round-off of the stiffest directions
        return bool(np.all(np.abs(force @ self.axes[2]) <= 10.0 * TOLERANCE * np.max(np.abs(force), initial=1e-300)))


def to_plane(x: Array, axes: Array) -> Array:
    """Map vectors [..., 3] in space to a + i b along the axes of the plane, complex128 [...]."""
    return x @ axes[0] + 1j * (x @ axes[1])


def numbers_of(z: Array) -> Array:
    """Flatten vectors of the plane, complex128 [...], one component after the other, float64 [*]."""
    return np.stack((z.real, z.imag), axis=-1).reshape(-1)


def to_space(z: Array, axes: Array) -> Array:
    """Map vectors of the plane, complex128 [...], to space [..., 3], without components along the normal."""
    # one product: products of four vectors a node take twice the time
    return (z.view(float).reshape(-1, 2) @ axes[:2]).reshape(*z.shape, 3)


def check_state(q: Array, v: Array, plane: Plane, length: float) -> None:
    """Check that coordinates [12 N] and their rates lie in a plane; length: size of the scene, m. Raises NotPlanar."""
    n = plane.axes[2]
    q, v = q.reshape(-1, 4, 3), v.reshape(-1, 4, 3)
    size = length + float(np.max(np.abs(q[:, 0]), initial=0.0))
    speed = float(np.max(np.abs(v), initial=0.0))
    if np.any(np.abs(q[:, 0] @ n - plane.height) > TOLERANCE * size) or np.any(np.abs(v @ n) > TOLERANCE * speed):
        raise NotPlanar("a node moves out of the plane")
    if np.any(np.abs(q[:, 1:] @ n - plane.normal) > TOLERANCE):
        raise NotPlanar("a triad is turned out of the plane")


def strain_maps(c: Array, s: Array) -> tuple[Array, Array]:
    """Return the maps from strains (stretch, shear, curvature) in the plane, and from strains beyond it, to the strains of space,
    for d2 = c J d1 + s n with the normal n: [..., 6, 3] each."""
    zero, one = np.zeros_like(c), np.ones_like(c)
    within = np.array([[one, zero, zero], [zero, c, zero], [zero, -s, zero], [zero, zero, zero], [zero, zero, s],
                       [zero, zero, c]])
    beyond = np.array([[zero, zero, zero], [s, zero, zero], [c, zero, zero], [zero, one, zero], [zero, zero, c],
                       [zero, zero, -s]])
    return np.moveaxis(within, (0, 1), (-2, -1)), np.moveaxis(beyond, (0, 1), (-2, -1))
