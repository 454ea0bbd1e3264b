"""Groups of arguments of `simulate` that belong together: where a run begins, its method, step control, output and solver."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from typing import Any

from fastbeam.dynamics.checkpoint import Checkpoint
from fastbeam.interface.arguments import Count, FilePath, Flag, Instance, Number, Refusal, Word, checked
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.model.start import check_start
from fastbeam.stepping.stepper import AUGMENTATION

TIME, STEP = Number(unit="s"), Number(above=0.0, unit="s")
START = Instance(State, "a State (result.state, model.state())", "of a checkpoint: checkpoint.state")
BEGIN = Instance((State, Checkpoint), "a State (result.state, model.state()) or Checkpoint")


@checked(state=BEGIN, time=TIME, mend=Flag(), velocities=Word(("start", "scene")))
@dataclass(frozen=True, eq=False)
class Start:
    """Begin of a run: a state, its time, and what is done where the scene does not allow it.

    Attributes
    ----------
    state : State or Checkpoint
        Default: the initial state of the model.
    time : float
        Time of the state, s; default 0. A checkpoint knows its own.
    mend : bool
        Accept a state that joints, supports and sliders do not quite allow: parts up to a hundredth of the size of the scene
        apart are moved, those that meet at different velocities do so in an inelastic impact. Momenta stay, `Result.balance` has
        the energy.
    velocities : {'start', 'scene'}
        Take the velocities of the state, or those that the scene gives its parts, in the shape of the state: of an equilibrium,
        which has none.
    """

    state: State | Checkpoint | None = None
    time: float | None = None
    mend: bool = False
    velocities: str = "start"


@checked(name=Word(), rho_inf=Number())
@dataclass(frozen=True)
class Method:
    """Method of time integration.

    Attributes
    ----------
    name : {'energy_momentum', 'midpoint', 'trapezoidal', 'generalized_alpha'}
        All but the first are for comparison: same equations, sliders and solvers, but they conserve less. The last two have
        order 2 only and no step control.
    rho_inf : float in [0, 1]
        Spectral radius at infinity. Of 'energy_momentum' (default: none, as 1): high frequencies of beams are dissipated, momenta
        are kept, and what is lost is in `Result.balance` (theory.md (6.2)). Of 'generalized_alpha' (default 0.8).
    """

    name: str = "energy_momentum"
    rho_inf: float | None = None


@checked(tolerance=Number(above=0.0), min_step=STEP, max_step=STEP)
@dataclass(frozen=True)
class StepControl:
    """Control of the step size by its error.

    Attributes
    ----------
    tolerance : float
        Local error of a position per step, relative to the size of the scene; of what turns at its radius of gyration.
    min_step, max_step : float
        Bounds of the step size, s; default a millionth of the first step and a tenth of the run.
    """

    tolerance: float
    min_step: float | None = None
    max_step: float | None = None


@checked(file=FilePath(), overwrite=Flag(), snapshots=Count(0, 10**6), checkpoint=FilePath(),
         checkpoint_every=Number(least=0.0, unit="s"))
@dataclass(frozen=True)
class Output:
    """Files of a run, and how many whole shapes it keeps.

    Attributes
    ----------
    file : path
        Write the result to this HDF5 file as the run goes.
    overwrite : bool
        Replace the file if there is one.
    snapshots : int
        About how many whole shapes to keep, at rows; one a row at most. Default 50, in sweeps 0.
    checkpoint : path
        Renew a checkpoint in this file at the first row that `checkpoint_every` seconds after the last one, and at the end.
    checkpoint_every : float
        Seconds between checkpoints; 0: at every row.
    """

    file: str | PathLike[str] | None = None
    overwrite: bool = False
    snapshots: int | None = None
    checkpoint: str | PathLike[str] | None = None
    checkpoint_every: float = 60.0


@checked(backend=Word(), threads=Count(most=1024), max_iterations=Count(most=10_000), augmentation=Number())
@dataclass(frozen=True)
class Solver:
    """Solver of the equations of a step.

    Attributes
    ----------
    backend : {'auto', 'pardiso', 'superlu'}
        Sparse solver, where the scene needs one.
    threads : int
        Threads for large nets and long beams, which are condensed; default: FASTBEAM_THREADS, else all processors of this
        process, one for every 2000 elements. Results are the same for any number, to the last bit, where beams are condensed;
        elsewhere PARDISO rounds differently on another number from 5000 unknowns on.
    max_iterations : int
        Newton iterations a substep.
    augmentation : float
        Augmented Lagrangian of the sliders: stiffness of a contact over that of the parts it joins in a step, 1 to 1e12 or 0 for
        plain multipliers. The solution is the same; it keeps sliders that hold the same motion twice regular (theory.md 5.5).
    """

    backend: str = "auto"
    threads: int | None = None
    max_iterations: int = 25
    augmentation: float = AUGMENTATION


@dataclass(frozen=True)
class Group:
    """Kind of a group of arguments, or of its first one alone."""

    group: Callable[..., Any]
    first: Callable[[Any], Any]

    def __call__(self, value: Any) -> Any:
        if isinstance(value, self.group):  # type: ignore[arg-type]
            return value
        try:
            return self.group(self.first(value))
        except Refusal as refusal:
            raise Refusal(f"{refusal}; or an object of {self.group.__name__}") from None  # type: ignore[attr-defined]


def shape_of_start(analysis: str, model: Model, start: Any) -> tuple[State | None, list[tuple[str, str]]]:
    """Return the state that an equilibrium is sought from, mended where its `Start` says so, and events of it as (kind, text).
    Raises SceneError: the start has a time or velocities, is a checkpoint, or no state that the scene allows."""
    if isinstance(start.state, Checkpoint):
        raise SceneError(f"{analysis}, start: must be a State (result.state, model.state()), got a Checkpoint; of a checkpoint: "
                         "checkpoint.state")
    if start.time is not None or start.velocities != "start":
        raise SceneError(f"{analysis}, start: an equilibrium takes no time and no velocities from Start; at_time= is the time of "
                         "loads and supports")
    return (None, []) if start.state is None else check_start(model, start.state, 1.0, start.mend, at_rest=True)


def grouped(group: Callable[..., Any], value: Any) -> Any:
    """Return a group of arguments, or make it of its first one alone; without a value with its defaults."""
    if isinstance(value, group):  # type: ignore[arg-type]
        return value
    return group() if value is None else group(value)


def groups(method: Any, tolerance: Any, start: Any, output: Any, solver: Any) -> tuple[Method, StepControl | None, Start, Output,
                                                                                      Solver]:
    """Return the groups that `Group` made of arguments of `simulate`, and defaults where there are none."""
    return method, tolerance, grouped(Start, start), grouped(Output, output), solver


# old argument of solve_static and relax, of `simulate` -> (argument, its class, name there)
MENDED = {"mend_start": ("start", Start, "mend")}
OLD = {old: (name, group, new) for name, group, names in (
    ("start", Start, {"t_start": "time", "mend_start": "mend", "velocities": "velocities"}),
    ("method", Method, {"rho_inf": "rho_inf"}),
    ("tolerance", StepControl, {"min_step": "min_step", "max_step": "max_step"}),
    ("output", Output, {x: x for x in ("file", "overwrite", "snapshots", "checkpoint", "checkpoint_every")}),
    ("solver", Solver, {x: x for x in ("backend", "threads", "max_iterations", "augmentation")})) for old, new in names.items()}
