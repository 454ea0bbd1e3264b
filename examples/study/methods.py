"""The methods that are compared, and one run of one of them: what came out, or how it failed.

Every run has the same number of Newton iterations at its disposal and starts from the same state. A run that fails is a result
like any other: it says when, why, and what the residual was.
"""
from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import fastbeam as fb
from scenes import Case

Array = np.ndarray
MAX_ITERATIONS = 25
# energy this many times its scale counts as blown up
BLOWN_UP = 10.0
# an error of the energy up to this share of its scale is accepted by the strict criterion
STRICT = 0.1


@dataclass(frozen=True)
class Method:
    """A method of time integration.

    Attributes
    ----------
    key : str
        Short name in the data.
    label : str
        For people.
    arguments : dict
        Of `simulate`.
    """

    key: str
    label: str
    arguments: dict[str, Any] = field(default_factory=dict)


METHODS = {m.key: m for m in (
    Method("em2", "energy-momentum, order 2"),
    Method("em4", "energy-momentum, order 4", {"order": 4}),
    Method("midpoint", "implicit midpoint", {"method": "midpoint"}),
    Method("trapezoidal", "trapezoidal (Newmark)", {"method": "trapezoidal"}),
    Method("alpha09", "generalised-alpha, 0.9", {"method": fb.Method("generalized_alpha", rho_inf=0.9)}),
    Method("alpha05", "generalised-alpha, 0.5", {"method": fb.Method("generalized_alpha", rho_inf=0.5)}),
    Method("alpha00", "generalised-alpha, 0", {"method": fb.Method("generalized_alpha", rho_inf=0.0)}))}


@dataclass
class Attempt:
    """One run, finished or not.

    Attributes
    ----------
    status : {'done', 'newton', 'blow-up', 'left'}
        Finished; a step did not converge; the energy left every bound; a slider ran off its beam.
    time, step : float, int
        When and in which step it ended.
    reason : str
        In a few words, with the increments of the failed Newton iteration.
    energy_error : float
        Largest error of the total energy over the energy scale; infinite where it is not finite.
    result : Result
    """

    status: str
    time: float
    step: int
    reason: str
    energy_error: float
    result: fb.Result

    @property
    def survived(self) -> bool:
        """Completed, finite, energy within `BLOWN_UP` of its scale."""
        return self.status == "done"

    @property
    def strict(self) -> bool:
        """Completed with an energy error of at most `STRICT`."""
        return self.survived and self.energy_error <= STRICT


def run(case: Case, model: fb.Model, method: str, *, step: float, t_end: float | None = None, scale: float | None = None,
        **settings: Any) -> Attempt:
    """Run a case with one method; `scale`: energy that errors are divided by, J (default: that of the run)."""
    t_end = case.t_end if t_end is None else t_end
    settings = {"points": case.points, "output": fb.Output(snapshots=0), "progress": False,
                "solver": fb.Solver(max_iterations=MAX_ITERATIONS)} | settings
    status, reason = "done", ""
    with np.errstate(all="ignore"):
        try:
            result = fb.simulate(model, t_end=t_end, step=step, **METHODS[method].arguments, **settings)
            end, steps = float(result.t[-1]), int(result.info["steps"])
        except fb.ConvergenceError as failed:
            result, end, steps = failed.result, failed.time, failed.step
            status, reason = "newton", _short(failed)
            if result is None:
                raise
        left = [event for event in result.events if event["kind"] == "slider_end"]
        if left:
            status, reason, end = "left", f"slider at the {left[0]['end']} of its beam", float(left[0]["time"])
        error = 0.0
        if "total" in result.series:
            total = result.series["total"]
            scale = scale or float(result.info["scale"]["total"])
            off = np.abs(total - total[0]) / scale
            off[~np.isfinite(off)] = np.inf
            error = float(off.max())
            if error > BLOWN_UP:
                k = int(np.argmax(off > BLOWN_UP))
                status, end = "blow-up", float(result.t[k])
                then = f", then: {reason}" if reason else ""
                reason = f"energy exceeds {BLOWN_UP:g} times its scale at t = {end:.4g} s{then}"
    return Attempt(status, end, steps, reason, error, result)


def _short(failed: fb.ConvergenceError) -> str:
    """What failed and the last sizes of the Newton increments, without names and paths."""
    what = re.sub(r"^step \d+ at t = [^:]*: ", "", str(failed)).split(";")[0]
    sizes = failed.residuals
    tail = ", ".join(f"{x:.1e}" for x in sizes[-3:]) if sizes else "none"
    return f"{what} (last of {len(sizes)} increments: {tail})"


def newton_per_step(attempt: Attempt) -> float:
    """Mean number of Newton iterations of a step (of all its substeps)."""
    info = attempt.result.info
    return float(info["iterations"]) / max(int(info["steps"]), 1)


def drifts(case: Case, attempt: Attempt) -> dict[str, float]:
    """Largest relative deviation of every invariant of the case."""
    return {name: float(attempt.result.drift(name)) for name in case.conserved}


def energy_scale(case: Case, model: fb.Model) -> float:
    """Largest kinetic or potential energy of the conserving run with the usual step (many sliders: twice that), J."""
    step = case.step * (1 if len(case.sliders) < 2 else 2)
    result = fb.simulate(model, t_end=case.t_end, step=step, observe=("energy",), output=fb.Output(snapshots=0), progress=False)
    return float(result.info["scale"]["total"])
