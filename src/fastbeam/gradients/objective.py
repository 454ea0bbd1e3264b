"""A number that depends on an equilibrium, and its derivative by all unknowns (theory.md (13.4))."""
from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fastbeam.interface.arguments import LARGEST, numbers, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import known
from fastbeam.results.observe.observer import Observer
from fastbeam.scene.checks import Place
from fastbeam.statics.linear_response import Response

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray


class Linear:
    """Quantities that depend linearly on small changes of the unknowns: positions of points, arc lengths, contact forces.

    base: the equilibrium.
    named: points by names.
    """

    def __init__(self, base: Response, named: Mapping[str, Place]) -> None:
        self.base, self.names = base, list(named)
        # derivatives of points by unknowns of nodes and places of sliders
        self.points = Observer(base.stepper.model, (), named).points.slopes(base.state) @ base.lift()
        at = base.nodes + base.sliding.size
        self.of_s = slice(base.nodes, at)
        self.of_forces = slice(at, at + base.core.dim * base.sliding.size)

    def along(self, x: Array) -> dict[str, Array]:
        """Return the changes of these quantities with the unknowns [n]: points [P, 3], s_slide [S], contact_force [S, 3]."""
        points = np.asarray(self.points @ x[:self.of_s.stop])
        force, plane = x[self.of_forces].reshape(-1, self.base.core.dim), self.base.stepper.plane
        return {"points": points.reshape(-1, 3), "s_slide": x[self.of_s],
                "contact_force": force if plane is None else force @ plane.axes[:2]}

    def slope(self, points: Array, s: Array, forces: Array) -> Array:
        """Return the derivative of a sum with these weights [P, 3], [S], [S, 3] by the unknowns [n]: the transpose."""
        base, plane = self.base, self.base.stepper.plane
        out = np.zeros(base.unknowns)
        out[:self.of_s.stop] = self.points.T @ points.reshape(-1)
        out[self.of_s] += s
        out[self.of_forces] = (forces if plane is None else forces @ plane.axes[:2].T).reshape(-1)
        return out


class Objective:
    """A weighed sum of positions of points, arc lengths of sliders, contact forces and the strain energy.

    points, sliders, contact_forces: weights by names: (3,), a number, (3,).
    strain_energy: weight.
    Raises SceneError: there is no such point or slider, a weight is none, or there are none at all.
    """

    def __init__(self, linear: Linear, points: Mapping[str, ArrayLike] | None, sliders: Mapping[str, float] | None,
                 contact_forces: Mapping[str, ArrayLike] | None, strain_energy: float) -> None:
        self.linear, self.strain_energy = linear, strain_energy
        runs = linear.base.stepper.model.names["sliders"]
        self.points = _weights("point", linear.names, points, (3,))
        self.s = _weights("slider", runs, sliders, ())
        self.forces = _weights("slider", runs, contact_forces, (3,))
        if not (points or sliders or contact_forces or strain_energy):
            raise SceneError("gradient: needs weights of the quantity to differentiate, as in gradient(points={'tip': (0, 0, "
                             "1)})")

    def slope(self) -> Array:
        """Return the derivative by the unknowns [n]."""
        out = self.linear.slope(self.points, self.s, self.forces)
        if self.strain_energy:
            out[:self.linear.of_s.stop] += self.strain_energy * self.linear.base.inner_forces()
        return out

    def explicit(self, rows: Mapping[str, Array]) -> float:
        """Return the derivative of the number from those of rows."""
        out = self.strain_energy * float(rows["strain"])
        for key, weight in (("points", self.points), ("s_slide", self.s), ("contact_force", self.forces)):
            if np.any(weight):
                out += float(np.sum(weight * rows[key]))
        return out


def _weights(noun: str, names: list[str], given: Mapping[str, ArrayLike] | None, shape: tuple[int, ...]) -> Array:
    """Return weights in the order of the names, [names, ...]."""
    out = np.zeros((len(names), *shape))
    for name, value in (given or {}).items():
        if name not in names:
            raise SceneError(f"gradient: there is no {noun} {name!r}; there are {known(names, name)}")
        weight = real(value) if shape == () else numbers(value)
        if weight is None or np.shape(weight) != shape or not np.all(np.abs(weight) <= LARGEST):
            need = "a number" if shape == () else "weights (3,)"
            raise SceneError(f"gradient, {noun} {name!r}: needs {need}, got {shown(value)}")
        out[names.index(name)] = weight
    return out
