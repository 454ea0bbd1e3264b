"""Stiffness and mass of a scene without sliders at a state, taken from the matrices of two steps."""
from __future__ import annotations

import numpy as np

import fastbeam as fb
from fastbeam.kernels.state import State
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


def matrices(model: fb.Model, state: State | None = None) -> tuple[Array, Array, Array]:
    """Symmetric stiffness (N/m, N, N m) and mass, dense, at `state` (default: the initial one), over the positions and spins
    that are free, and which of the six components of its node each of these is. The model has to be compiled with
    solver="sparse", eliminate_inner=False, planar=False."""
    n = model.pattern.n

    def matrix(h: float) -> Array:
        stepper = Stepper(model, np.ones(1), state, backend="superlu")
        stepper.state.v[:] = 0.0
        work = stepper.work
        stepper.parts.start(h)
        stepper.parts.assemble(h)
        blocks = work.blocks[:48 * model.pattern.keys.size].reshape(-1, 6, 8)
        return stepper.linear.superlu.matrix(blocks).toarray()

    # A(h) = 2 M/h^2 + K/2
    a, b = matrix(1e-3), matrix(2e-3)
    mass = (a - b) / (2e6 - 0.5e6)
    stiffness = 2.0 * (a - 2e6 * mass)
    # held unknowns and spins of point masses have neither
    row = model.pattern.row_of
    free = np.ones((n, 6), bool)
    free[row[model.numbers.rank == 9], 3:] = False
    np.logical_and.at(free, row, (model.fixed_mask[:, None] >> np.arange(6)) & 1 == 0)
    keep = np.flatnonzero(free)
    stiffness, mass = (0.5 * (x + x.T)[np.ix_(keep, keep)] for x in (stiffness, mass))
    return stiffness, mass, keep % 6
