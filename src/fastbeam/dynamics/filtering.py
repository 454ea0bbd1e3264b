"""Steps that dissipate high frequencies by one number, the spectral radius at infinity (theory.md (6.2))."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.beams.section_laws import Filtered
from fastbeam.kernels.beams.strain_filter import StrainFilter, changes_of
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.kernels.layout import LIST, POINTS, REFERENCE
from fastbeam.kernels.loop import SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.maps import spins
from fastbeam.model.model import Model
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# turn of the fastest node by which rates of strains are differenced, rad
TURN = 1e-5


def filter_factors(rho_inf: float) -> tuple[float, float, float]:
    """Return a, b, kappa of theory.md (6.2)."""
    chi = (1.0 - rho_inf) / (1.0 + rho_inf)
    return 4.0 * chi**2 / (3.0 * (1.0 + 3.0 * chi)), chi**2 / 12.0, 2.0 / (1.0 + 3.0 * chi)


def check_filtered(order: int, model: Model, observe: Any) -> None:
    """Refuse options that filters do not support. Raises SceneError."""
    if order != 2:
        raise SceneError("rho_inf: filters limit the order to 2, because the dissipated energy has odd powers of the step; use "
                         "order=2, or leave rho_inf out")
    require(Analysis.FILTERED, model)
    if model.simo is None and model.green is None:
        raise SceneError("rho_inf: it filters strains of beams, and the scene has no beams; leave it out")
    if "reaction" in observe:
        raise SceneError("rho_inf: reactions are available for steps without filters only; leave 'reaction' out of observe, or "
                         "leave rho_inf out")


def filter_of(model: Model, beams: Beams, factors: tuple[float, float, float], strains: Array, lost: Array) -> StrainFilter:
    """Return the filters of the beams with one strain set; strains: reference strains of the run, without their stress."""
    meta = beams.tables.meta
    begin, n = int(meta[:, REFERENCE].min()), 8 * len(model.dofs) * int(meta[:, POINTS].sum())
    # idle lanes repeat an element and have the row behind the last
    live = beams.tables.rows[meta[:, LIST, None] + np.arange(8)] < model.n_nodes
    return StrainFilter(beams.strains._replace(law=Filtered(2.0 * factors[0] + 4.0 * factors[1])), beams.tables,
                        np.array([begin]), live.astype(float).reshape(-1), np.array(factors), strains[begin:begin + n],
                        np.zeros(n), np.zeros(n), empty(2 * n + 2), empty(n), empty(n), lost)


class FilteringStepper(Stepper):
    """Stepper for conserving steps with filters; rates and states of filters belong to the memory of a run; lost: float64 [2],
    energies dissipated since the start and stored in the filters, J."""

    def __init__(self, model: Model, weights: Array, state: State | None, max_iterations: int, backend: str, method: Any,
                 t: float, memory: Array | None, augmentation: float, threads: int | None) -> None:
        if model.substructures is not None and model.uncondensed is not None:
            model = model.uncondensed()
        self.lost = np.zeros(2)
        self.filters: tuple[StrainFilter, ...] = ()
        super().__init__(model, weights, state, max_iterations, backend, method, t, None, augmentation, threads)
        factors, strains = filter_factors(method.rho_inf), self.work.reference_strains
        terms: list[Any] = []
        filters = []
        for term in self.terms:
            if isinstance(term, Beams):
                filters.append(filter_of(self.core, term, factors, strains, self.lost))
                term = term._replace(strains=filters[-1].strains)
            terms.append(term)
        # those with the stress of filters, which every step writes at its begin; no energy is stored in it
        self.work = self.work._replace(reference_strains=aligned_empty(strains.size))
        self.filters = tuple(filters)
        self.terms = (*terms, *self.filters)
        if memory is None:
            self.start_filters()
        else:
            if state is not None and self.plane is None:
                # the state of a continued run already has what a first step changes
                for mine, other in zip(self.core_state, state):
                    mine[:] = other
            self.memory = memory

    @property
    def pivots_everywhere(self) -> bool:
        """Always True: no fallback solver exists, because it would need other tables of filters."""
        return True

    @property
    def _remembered(self) -> tuple[Array, ...]:
        return (*super()._remembered, *(x for term in self.filters for x in (term.smooth, term.rate)), self.lost)

    def set_state(self, state: State) -> None:
        """Set the state, see `Stepper.set_state`; rates of strains become those of its velocities."""
        super().set_state(state)
        self.start_filters()

    def start_filters(self) -> None:
        """Set rates of all strains from velocities, by central differences of the strains that they lead to."""
        state, work, core = self.core_state, self.work, self.core
        kept = [x.copy() for x in (work.dphi, work.theta)]
        if len(core.dofs) == 6:
            q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
            spin = spins(q, v)
        else:
            q, v = state.q.reshape(-1, 2, 2), state.v.reshape(-1, 2, 2)
            spin = q[:, 1, 0] * v[:, 1, 1] - q[:, 1, 1] * v[:, 1, 0]
        fastest = max(float(np.max(np.abs(spin), initial=0.0)), float(np.max(np.abs(v[:, 0]), initial=0.0)) / core.length)
        h = TURN / fastest if fastest > 0.0 else 1.0
        found = []
        for signed_step in (h, -h):
            work.dphi[:], work.theta[:] = signed_step * v[:, 0].reshape(-1), signed_step * spin.reshape(-1)
            changes_of(self.filters, self.records[1].typed, h)
            found.append([term.change.copy() for term in self.filters])
        for term, ahead, back in zip(self.filters, *found):
            term.rate[:] = term.smooth[:] = (ahead - back) / (2.0 * h)
        work.dphi[:], work.theta[:] = kept

    def _run(self, t: float, h: float, n: int, done: int) -> Outcome:
        result = super()._run(t, h, n, done)
        if result.status == SLIDER_END:
            # the step that was taken back had told the filters
            for term in self.filters:
                term.smooth[:], term.rate[:] = np.split(term.kept[:-2], 2)
                self.lost[:] = term.kept[-2:]
        return result
