"""Derivatives of natural frequencies by parameters, equilibrium and its stresses changing along (theory.md (13.7))."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.kernels.state import State
from fastbeam.linalg.eigen import SingularError, lowest
from fastbeam.model.model import Model
from fastbeam.vibration.linearised import Linearisation
from fastbeam.vibration.resting_sliders import resting_sliders

Array = np.ndarray
# frequencies that differ by less are the same one, of several modes
SAME = 1e-7
LEAST = 12


class FrequencySlopes(NamedTuple):
    """Natural frequencies, lowest first, and their derivatives.

    Attributes
    ----------
    frequencies : float64 [n]
        Hz; 0 of motions that are free or grow.
    squared : float64 [n]
        w^2, rad^2/s^2.
    by : dict of str to float64 [n]
        Derivatives of the frequencies by every parameter, Hz per unit; NaN where the frequency is 0.
    squared_by : dict of str to float64 [n]
        Derivatives of w^2.
    multiplicity : int64 [n]
        Number of modes that share this frequency. Their derivatives are those of the frequencies into which a change of this
        parameter alone parts them, in ascending order.
    """

    frequencies: Array
    squared: Array
    by: dict[str, Array]
    squared_by: dict[str, Array]
    multiplicity: Array


class Linearised:
    """The lowest modes about an equilibrium.

    model, state, sliding, factors, flat: see `Linearisation`.
    at: (float, float), time, s, and load factor of drives of sliders and of moving air.
    Raises SceneError: the stiffness is not symmetric.
    Raises ConvergenceError: no eigenvalues were found.
    """

    def __init__(self, model: Model, state: State, sliding: Array, factors: Array, flat: bool, n: int, backend: str,
                 at: tuple[float, float] = (0.0, 1.0)) -> None:
        self._stays, self._at = ~sliding, at
        self.about = self._linearised(model, state, factors, flat)
        if not np.any(self.about.mass.diagonal() > 0.0):
            raise SceneError("frequencies: no part that can move has mass; give sections rhoA, or add bodies")
        pencil, _ = self.about.assembled()
        if not pencil.is_symmetric:
            raise SceneError("frequencies: derivatives need a symmetric stiffness, but moments or moving air make that of this "
                             "equilibrium unsymmetric; use fb.modes at two values")
        try:
            found = lowest(pencil, max(n, LEAST), backend)
        except SingularError:
            raise ConvergenceError("frequencies: the modes were not found, because stiffness and mass matrices are singular in a "
                                   "common direction",
                                   state=state) from None
        self.k = self.about.free.size
        self.values = found.values
        self.vectors = found.vectors

    def _linearised(self, model: Model, state: State, factors: Array, flat: bool) -> Linearisation:
        resting = resting_sliders("frequencies", model, state, self._stays, *self._at)
        found = Linearisation(model, state, ~self._stays, factors, flat, resting=resting)
        found.stepper.load_at(*self._at)
        return found

    def forms(self, model: Model, state: State, factors: Array) -> tuple[Array, Array]:
        """Return stiffness and mass of another scene of the family, projected on the modes of this one, [m, m] and [k, k]."""
        other = self._linearised(model, state, factors, self.about.size == 3)
        pencil, _ = other.assembled()
        x = self.vectors
        return x.T @ (pencil.stiffness @ x), x[:self.k].T @ (pencil.mass @ x[:self.k])


def frequency_slopes(modes: Linearised, n: int, around: Mapping[str, Callable[[], Iterable[tuple[Model, State, Array]]]],
                     slope: Callable[[str, Array], Array]) -> FrequencySlopes:
    """Differentiate the n lowest frequencies.

    around: maps names of parameters to functions that give models, equilibria and load factors around.
    slope: derivative by a parameter of what was evaluated there.
    """
    values = np.real(modes.values)
    size = np.maximum(np.abs(values), 1e-300)
    # a cluster that is cut off by the number of modes is not known whole
    groups = np.split(np.arange(values.size), np.flatnonzero(np.diff(values) > SAME * size[1:]) + 1)
    n = min(n, values.size)
    multiplicity = np.ones(values.size, np.int64)
    for group in groups:
        multiplicity[group] = group.size
    squared_by = {}
    for name, others in around.items():
        forms = [modes.forms(*other) for other in others()]
        stiff, mass = (slope(name, np.array(x)) for x in zip(*forms))
        found = np.zeros(values.size)
        for group in groups:
            at = np.ix_(group, group)
            own = stiff[at] - float(np.mean(values[group])) * mass[at]
            found[group] = np.linalg.eigvalsh(0.5 * (own + own.T))
        squared_by[name] = found[:n]
    root = np.sqrt(np.maximum(values[:n], 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        by = {name: np.where(root > 0.0, x / (4.0 * np.pi * root), np.nan) for name, x in squared_by.items()}
    return FrequencySlopes(root / (2.0 * np.pi), values[:n], by, squared_by, multiplicity[:n])
