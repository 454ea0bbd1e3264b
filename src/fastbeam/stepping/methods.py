"""Methods of time integration: the conserving step and the ones it is compared with (theory.md 7)."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.interface.arguments import number
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.beams import generalized_alpha as kernels
from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.state import State
from fastbeam.linalg.factors import OF_STEP, Factors
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.gap_rows import ConstraintGaps, Gaps
from fastbeam.model.mapping import shapes_at
from fastbeam.model.maps import free_unknowns, mass_map, share_map, spin_map, tie_map, velocities_and_spins, velocity_map
from fastbeam.model.model import Model

Array = np.ndarray
METHODS = {"energy_momentum": "energy-momentum conserving", "midpoint": "implicit midpoint", "trapezoidal": "trapezoidal rule",
           "generalized_alpha": "generalized alpha"}
RHO_INF = 0.8


@dataclass(frozen=True)
class Scheme:
    """Scheme of time integration."""

    name: str = "energy_momentum"  # key of `METHODS`
    middle: int | None = None  # as in `kernels.step.assemble_step`
    # None or float64 [4]: alpha_m, alpha_f, beta, gamma where equilibrium holds at the end of a step
    parameters: Array | None = None
    rho_inf: float | None = None

    @property
    def label(self) -> str:
        """Label for messages."""
        return METHODS[self.name] + ("" if self.rho_inf is None else f", rho_inf = {self.rho_inf:g}")

    @property
    def filters(self) -> bool:
        """True where conserving steps dissipate high frequencies."""
        return self.name == "energy_momentum" and self.rho_inf is not None

    @property
    def is_compared(self) -> bool:
        """True of methods that the conserving step is compared with."""
        return self.middle is not None or self.parameters is not None

    @property
    def at_end(self) -> bool:
        """True where forces belong to the end of a step, not to its middle."""
        return self.parameters is not None


def choose_scheme(name: str, rho_inf: float | None, order: int, controlled: bool, model: Model) -> Scheme:
    """Return the scheme of a method of `simulate` with this order, with or without step control. Raises SceneError: an unknown
    method, or arguments that do not go with it."""
    if not isinstance(name, str) or name not in METHODS:
        raise SceneError(f"method: {name!r} does not exist: choose from {', '.join(map(repr, METHODS))}")
    if rho_inf is not None and name not in ("generalized_alpha", "energy_momentum"):
        raise SceneError(f"rho_inf: is for 'energy_momentum' and 'generalized_alpha', not for {name!r}; leave it out")
    rho = RHO_INF if rho_inf is None else number("rho_inf", rho_inf)
    if not 0.0 <= rho <= 1.0:
        raise SceneError(f"rho_inf: must lie in [0, 1] (1 damps nothing, 0 annihilates high frequencies), got {rho:g}")
    if name != "energy_momentum":
        require(Analysis.COMPARED, model, f"method {name!r}")
    if name in ("energy_momentum", "midpoint"):
        # 1 dissipates nothing: the step as it is
        return Scheme(name, 1 if name == "midpoint" else None, None, rho_inf if rho_inf is None or rho < 1.0 else None)
    if order != 2:
        raise SceneError(f"order: method {name!r} has order 2, got order={order!r}; order 4 is available for the symmetric steps "
                         "of 'energy_momentum' and 'midpoint'")
    if controlled:
        raise SceneError(f"tolerance: step control is available for 'energy_momentum' and 'midpoint', not for {name!r}; "
                         "leave tolerance out")
    if name == "trapezoidal":
        return Scheme(name, None, np.array([0.0, 0.0, 0.25, 0.5]))
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + af - am
    return Scheme(name, None, np.array([am, af, 0.25 * (gamma + 0.5)**2, gamma]), rho)


def empty_rates(method: Scheme, n_nodes: int) -> Alpha | None:
    """Allocate work arrays of a method, None where it needs none."""
    if method.parameters is None:
        return None
    return Alpha(method.parameters, empty(54 * n_nodes), empty(18 * n_nodes), empty(2), np.eye(3).reshape(-1))


def start_rates(model: Model, alpha: Alpha, state: State, residual: Any) -> None:
    """Compute consistent accelerations and contact forces of a state from the equations of motion with the second derivative of
    every gap (index 1), into alpha.rates and state.force.

    residual: function of q'' [12 N], rows [6 N] of the nodes' equations, in the order of the nodes, without contact forces.
    Raises ConvergenceError: inertia is missing: accelerations are not determined.
    """
    n, s = model.n_nodes, model.n_sliders
    rates = alpha.rates.reshape(9, n, 6)
    q, v = state.q.reshape(n, 4, 3), state.v.reshape(n, 4, 3)
    rates[:] = 0.0
    rates[0] = velocities_and_spins(q, v)
    spin = spin_map(model)
    rates[0, :, 3:] = (spin @ rates[0, :, 3:].reshape(-1)).reshape(n, 3)
    tie = tie_map(model)
    share = share_map(model)
    free = free_unknowns(model)
    lift = (tie @ velocity_map(q) @ share)[:, free]
    bias = np.zeros(12 * n)
    kernels.second_rates(alpha, 0, state.q, bias)
    bias = tie @ bias
    mass = (lift.T @ mass_map(model) @ lift).tocsc()
    right = -residual(bias).reshape(-1)[free]
    system: Any = mass
    forces = 0
    if model.n_constraints:
        rows = ConstraintGaps(model)
        gaps = rows.at(state.q, state.s)
        gap = gaps.rates @ lift
        forces = gap.shape[0]
        along = sparse.csr_matrix((gaps.tangents.reshape(-1), (np.arange(3 * s), np.repeat(np.arange(s), 3))),
                                  shape=(forces, s))
        # constraints that hold the same motion twice share its force, as in theory.md (5.5)
        with np.errstate(divide="ignore"):
            soft = sparse.diags(1e-12 * (gap.power(2) @ (1.0 / mass.diagonal())))
        system = sparse.bmat([[mass, -gap.T, None], [gap, soft, -along], [None, along.T, None]] if s else
                             [[mass, -gap.T], [gap, soft]]).tocsc()
        right = np.concatenate((right, _convective(model, rows, gaps, state) - gaps.rates @ bias, np.zeros(s)))
    x = Factors(system.tocsr(), limits=OF_STEP).solve(right)
    if x is None:
        raise ConvergenceError(
            "the accelerations at the start are not determined: generalized alpha and the trapezoidal rule need inertia of every "
            "unknown (section inertia, inertia of every body); use method='energy_momentum' or 'midpoint'",
            step=0, time=0.0, residuals=[], worst="start", state=State(*(y.copy() for y in state)))
    second = lift @ x[:free.size] + bias
    rates[1, :, :3] = second.reshape(n, 4, 3)[:, 0]
    turn = np.zeros(6 * n)
    turn[free] = x[:free.size]
    rates[1, :, 3:] = (spin @ (share @ turn).reshape(n, 6)[:, 3:].reshape(-1)).reshape(n, 3)
    rates[2] = rates[1]
    state.force[:] = x[free.size:free.size + forces]


def _convective(model: Model, rows: ConstraintGaps, gaps: Gaps, state: State) -> Array:
    """Evaluate minus the parts of the second derivatives of all gaps besides accelerations, [F]: of sliders 2 ds/dt N' phi' +
    (ds/dt)^2 N'' phi."""
    v = state.v
    # gaps are of second degree in the coordinates: their second difference is exact
    (ahead, turning), (back, _), (none, _) = (rows.values(x, state.s) for x in (v, -v, 0.0 * v))
    out = 2.0 * none - ahead - back
    for k in range(model.n_sliders):
        nodes, (_, _, second) = shapes_at(model, k, float(state.s[k]))
        rate = gaps.along(k, v)
        out[3 * k:3 * k + 3] = 2.0 * rate * turning[k] + rate**2 * (second @ state.q.reshape(-1, 12)[nodes, :3])
    return np.asarray(out)
