"""Load factors between which friction holds a slider or a joint in place (theory.md 8)."""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.arguments import Anything, Count, Name, Number, Numbers, Word, checked, shown
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.synonyms import its_sliders
from fastbeam.kernels.loop import OK
from fastbeam.kernels.state import State
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.contact.sleeve_twist import twist_label
from fastbeam.model.forces.loads import load_path, which_times
from fastbeam.model.model import Model, check_model
from fastbeam.model.start import check_start
from fastbeam.model.supports import check_supports
from fastbeam.statics.moving_supports import SupportPath, coordinates_of
from fastbeam.statics.slider_friction import share_left
from fastbeam.statics.sliding import SlidingSolver
from fastbeam.statics.static_analysis import START, held_sliders, which_sliders

Array = np.ndarray
# first increment of a load factor, with 1 added to its size, and the smallest
FIRST, LEAST = 0.05, 1e-6
# load factors are found to so much of their size, or as far as the share of friction that is left is round-off
EXACT, ROUND_OFF = 1e-12, 1e-12
MOST_ROUNDS = 60


class StickInterval(NamedTuple):
    """Load factors between which friction holds a slider or a joint, and the equilibria there."""

    low: float       # -inf: everywhere below; NaN: there is no equilibrium before friction gives way
    high: float      # inf: everywhere above; NaN as for `low`
    at_low: State
    at_high: State


@checked(model=Anything(), slider=Name(), load_factor=Number(), within=Numbers((2,), "two load factors, the smaller one first"),
         at_time=which_times, start=START, held=which_sliders, max_iterations=Count(most=10_000), backend=Word())
def stick_interval(model: Model, slider: str, *, load_factor: float = 1.0, within: tuple[float, float] = (0.0, 10.0),
                   at_time: float | tuple[float, float] | None = None, start: State | None = None,
                   held: bool | str | tuple[str, ...] = False, max_iterations: int = 20, backend: str = "auto") -> StickInterval:
    """Find the interval of load factors in which friction holds a slider, or a joint, where it rests at one of them.

    From an equilibrium the loads grow, and shrink, slowly, until friction is all that it can be. Others with friction
    stick or slip as this history asks for, so that the last of several rings of a capstan to slip tells when its cable moves.

    Parameters
    ----------
    model : Model
    slider : str
        One with Coulomb friction, or a joint with friction= or coefficient=; of a joint with several such coordinates one of them
        as `solve_static` names it in `info["friction"]`, "distance of cylindrical joint 'c'"; the twist of a beam in the sleeve
        "s" with friction by `radius=` is "s: twist". Where the loads of `load_factor` make it slip, it comes to rest first, which
        leaves it at the end of its interval.
    load_factor : float
        Load factor of the equilibrium in the interval.
    within : (float, float)
        The smallest and largest load factor that is looked at; they enclose `load_factor`.
    at_time : float or (float, float), optional
        As in `solve_path`: when time functions of loads are evaluated, s; of two times load factor 0 stands for the loads of
        the first and 1 for those of the second, so that loads without a time function stay. Prescribed places of sliders are
        those of that time, or of the second one, supports stay; drives by force grow with the load factor of all loads, and
        with two times act in full.
    start : State, optional
        Equilibrium of `load_factor`, as of `solve_static`; default: found from the reference, all loads raised together.
    held, max_iterations, backend
        As in `solve_static`.

    Returns
    -------
    StickInterval
        `low, high, at_low, at_high`: load factors and equilibria.

    Raises
    ------
    SceneError
        There is no such slider or joint, nothing that could hold it, an argument is out of range.
    ConvergenceError
        There is no equilibrium at `load_factor`; carries the last one.
    """
    check_model("stick_interval", model)
    stays = held_sliders(model, held)
    require(Analysis.STICK, model, held=stays)
    kind, k = _number_of(model, slider, stays)
    # nothing twists in a plane
    flat = False if kind is _LockedJoint and slider in _twists(model) else None
    if flat is False and model.asked_for_plane:
        raise SceneError(f"stick_interval: {slider!r}: beams do not twist in a plane; compile the scene without planar=True")
    check_backend(backend)
    if not within[0] <= load_factor <= within[1]:
        raise SceneError(f"within: {shown(within)} must enclose load_factor={load_factor:.6g}")
    base, change = load_path("stick_interval", model, at_time)
    if at_time is None:
        require(Analysis.TIMELESS, model, "stick_interval", stays)
    if start is not None:
        start, _ = check_start(model, start, 1.0, at_rest=True)
    t = at_time[1] if isinstance(at_time, tuple) else at_time or 0.0

    def solver_of(state: State | None, held: Array) -> SlidingSolver:
        solver = SlidingSolver(model, state, max_iterations, held, flat, backend, t)
        solver.move_to(1.0)
        return solver

    def load(solver: SlidingSolver, factor: float, share: float = 1.0) -> bool:
        solver.set_time(t, share * (1.0 if isinstance(at_time, tuple) else factor))
        return bool(solver.equilibrium(share * (base + factor * change))[0] == OK)

    solver = solver_of(start, stays)
    check_supports(model, solver.stepper.plane is not None)
    if model.prescribed is not None and at_time is not None:
        stand = SupportPath(model, solver.state, True, (t, t), "stick_interval")
        stand.check_stands("stick_interval", 1.0, coordinates_of(solver.stepper, stand.own))
    shares = [1.0] if start is not None else np.linspace(0.0, 1.0, 5)[1:].tolist()
    for share in shares:
        if not load(solver, load_factor, share):
            text = f"stick_interval: no equilibrium was found at load factor {load_factor:.6g}"
            error = ConvergenceError(f"{text}; find one with solve_static, and give it as start=", step=0, time=0.0,
                                     state=solver.stepper.copy_state())
            raise solver.stepper.blamed(error, text, "The last equilibrium is in .state")
    ends = []
    for end in within:
        still = stays | (np.arange(stays.size) == k) if kind is _LockedSlider else stays
        mine = kind(solver_of(solver.stepper.copy_state(), still), k, t)
        ends.append(_end_of(mine, load, load_factor, float(end)))
    return StickInterval(ends[0][0], ends[1][0], ends[0][1], ends[1][1])


def _number_of(model: Model, slider: str, stays: Array) -> tuple[type[_Locked], int]:
    """Return the number of a slider that friction can hold, or of a coordinate of a joint. Raises SceneError: there is none of
    that name, or nothing that could hold it."""
    names = model.names["sliders"]
    if slider in _twists(model) and slider not in names:
        of_joints = 0 if model.motions is None else model.motions.holds.rubs.size
        return _LockedJoint, of_joints + _twists(model).index(slider)
    if slider not in names and model.motions is not None:
        holds = model.motions.holds
        rubs = [holds.parts[k] for k in holds.rubs]
        found = [i for i, x in enumerate(rubs) if x.has_friction and slider in (x.name, x.label)]
        if len(found) == 1:
            return _LockedJoint, found[0]
        if found:
            raise SceneError(f"stick_interval: joint {slider!r} has friction on {len(found)} coordinates; name one of them, "
                             f"{' or '.join(repr(rubs[i].label) for i in found)}")
        if any(slider in (x.name, x.label) for x in holds.parts):
            raise SceneError(f"stick_interval: joint {slider!r} has no friction; name one with friction= or coefficient=")
    if slider not in names:
        raise SceneError(f"stick_interval: scene {model.scene_name!r} has no slider {slider!r}; "
                         f"{its_sliders(names, slider)}")
    k = names.index(slider)
    if model.slider_forces is None or not (model.slider_forces.hold_by_friction & ~stays)[k]:
        raise SceneError(f"stick_interval: slider {slider!r} has no Coulomb friction, or is locked or driven by a prescribed "
                         "motion; name one with friction=")
    return _LockedSlider, k


def _twists(model: Model) -> list[str]:
    """Return names of the twists of beams in sleeves with friction, as in `info["friction"]`."""
    return [twist_label(model.names["sliders"][k]) for k in model.sleeve_pairs[model.twisting, 0]] if model.twisting.size else []


class _Locked(ABC):
    """Equilibria of a scene with one part held by whatever force that needs; k: its number; t: time of its drive."""

    def __init__(self, solver: SlidingSolver, k: int, t: float) -> None:
        self.solver, self.k, self.t = solver, k, t

    @abstractmethod
    def margin(self) -> float:
        """Return the share of its friction that is left."""

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Return to what `SlidingSolver.kept` returned."""
        self.solver.take_back(kept)
        self.solver.hold_joints()

    @property
    def state(self) -> State:
        """Copy of the present state."""
        return self.solver.stepper.copy_state()


class _LockedJoint(_Locked):
    """Equilibria with a coordinate of a joint held."""

    def __init__(self, solver: SlidingSolver, k: int, t: float) -> None:
        super().__init__(solver, k, t)
        assert solver.joints is not None
        solver.joints.kept[k] = True

    def margin(self) -> float:
        assert self.solver.joints is not None
        return self.solver.joints.margin(self.k)


class _LockedSlider(_Locked):
    """Equilibria with a slider held."""

    def margin(self) -> float:
        solver, k = self.solver, self.k
        assert solver.along is not None
        forces, here = solver.along.forces, solver._of_constraints(rubs=False)
        needed, s = float(here.sliding[k]), float(solver.stepper.core_state.s[k])
        if forces.tables.drive[k]:
            needed -= forces.at_rest(k, self.t, s, solver.along.factor, solver.along.offset[k])
        return share_left(needed, float(forces.tables.friction[k] * here.normal[k]))


def _end_of(held: _Locked, load: Callable[..., bool], start: float, end: float) -> tuple[float, State]:
    """Find the load factor between `start` and `end` where friction gives way, and the equilibrium there."""
    if not load(held.solver, start):
        return np.nan, held.state
    a, left = start, held.margin()
    if left <= 0.0:
        # it has slipped, and rests at the end of its interval
        return start, held.state
    saved, step = held.solver.kept(), FIRST * (1.0 + abs(start)) * (1.0 if end > start else -1.0)
    while True:
        if a == end:
            return (np.inf if end > start else -np.inf), held.state
        b = a + step if abs(step) < abs(end - a) else end
        if not load(held.solver, b):
            held.restore(saved)
            step *= 0.25
            if abs(step) < LEAST * (1.0 + abs(a)):
                return np.nan, held.state
            continue
        beyond = held.margin()
        if beyond < 0.0:
            return _root(held, load, saved, (a, left), (b, beyond))
        a, left, saved = b, beyond, held.solver.kept()
        step *= 2.0


def _root(held: _Locked, load: Callable[..., bool], saved: tuple[Any, ...], low: tuple[float, float],
          high: tuple[float, float]) -> tuple[float, State]:
    """Find the load factor between two, with friction left and without, where there is none left (regula falsi, with the halved
    ordinate of the Illinois method); every equilibrium is found from the last one with some left."""
    (a, left), (b, beyond), side = low, high, 0
    for _ in range(MOST_ROUNDS):
        x = a + (b - a) * left / (left - beyond)
        held.restore(saved)
        if not load(held.solver, x):
            return np.nan, held.state
        margin = held.margin()
        if abs(margin) <= ROUND_OFF or abs(b - a) <= EXACT * (1.0 + abs(a)):
            return x, held.state
        if margin > 0.0:
            a, left, saved = x, margin, held.solver.kept()
            beyond *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            b, beyond = x, margin
            left *= 0.5 if side < 0 else 1.0
            side = -1
    return a, held.state
