"""Derivatives of equilibria by parameters of their scene: by the tangent, and by the adjoint for many (theory.md 13)."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.dynamics.options import START
from fastbeam.gradients.frequencies import FrequencySlopes, Linearised, frequency_slopes
from fastbeam.gradients.objective import Linear, Objective
from fastbeam.gradients.parameters import CHANGES, Build, Family, numbers_of, which_build
from fastbeam.gradients.section_gradient import SectionGradient, section_gradients
from fastbeam.interface.arguments import Count, Flag, Listing, Names, Number, Word, checked, shown
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import Doubts, warns
from fastbeam.interface.synonyms import known
from fastbeam.kernels.state import State
from fastbeam.linalg.factors import factoriser_for
from fastbeam.linalg.linear_system import check_backend
from fastbeam.linalg.saddle import Saddle
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import factor_at, load_factors_at
from fastbeam.model.maps import spins
from fastbeam.model.model import Model
from fastbeam.model.start import check_start
from fastbeam.model.supports import check_supports
from fastbeam.results.observe.observer import Observer
from fastbeam.results.observe.resolution import mesh_events
from fastbeam.results.result import Result
from fastbeam.scene.checks import Place
from fastbeam.statics.linear_response import OutOfPlane, Response, at_shape, place_events
from fastbeam.statics.reactions import reactions_of
from fastbeam.statics.static_analysis import held_sliders, solve_static, which_sliders

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray
OBSERVED = ("energy", "section", "reaction")
# increment of nodes below which a state is an equilibrium, in sizes of the scene and rad
AT_REST = 1e-8
# estimated relative error from which on derivatives are rejected
WORST = 1e-2


class Slopes(NamedTuple):
    """Derivatives by one parameter."""

    unbalanced: Array       # float64 [n]: explicit, in scenes moved with their reference
    explicit: dict[str, Array]   # of every series there
    way: Array              # float64 [n]: of all unknowns, beside the motion with the reference
    rows: dict[str, Array]  # of every series, all in all
    accuracy: float         # what is unbalanced along the way, as a share of it


class Gradient(NamedTuple):
    """Derivatives of one number by everything, from one solution with the transposed tangent.

    Attributes
    ----------
    by : dict of str to float
        Derivatives by the parameters of `sensitivity`.
    sections : dict of str to SectionGradient
        Derivatives by the sections of all beams and of the beams of all nets.
    forces, moments : float64 [N, 3]
        Derivatives by dead forces and moments on the nodes, per N and N m; 0 where a support holds.
    """

    by: dict[str, float]
    sections: dict[str, SectionGradient]
    forces: Array
    moments: Array


class Sensitivity(Doubts):
    """An equilibrium and its derivatives by parameters; made by `sensitivity`.

    Attributes
    ----------
    values : dict of str to float
        Parameters.
    model : Model
        Model of the scene at the values.
    result : Result or None
        Result of `solve_static`, where it was called.
    state : State
        The equilibrium.
    accuracy : dict of str to float
        Residual of the equilibria along the derivatives by every parameter, as a share of the derivatives; an estimate of
        their error from above.
    factorisations : int
        Number of factorisations of the tangent and its transpose until now.
    events : list of dict
        Events where the equilibrium is not to be trusted, as in a `Result`.
    """

    def __init__(self, family: Family, base: Response, solver: Saddle, observe: tuple[str, ...], result: Result | None,
                 factors: Callable[[Model], Array], backend: str) -> None:
        self._backend = backend
        self._family, self._base, self._solver, self._observe = family, base, solver, observe
        self._factors = factors
        self.values, self.model, self.result = dict(family.values), family.model, result
        self.state = State(*(x.copy() for x in base.state))
        self._linear = Linear(base, family.base(base.stepper.plane is not None).points)
        self._slopes = {name: self._by(name) for name in family.values}
        self.accuracy = {name: x.accuracy for name, x in self._slopes.items()}
        self.events = mesh_events(self.model, self.state) + place_events(base, self.model)

    @property
    def factorisations(self) -> int:
        return self._solver.factorisations

    # --- by the tangent ---------------------------------------------------------------------------------------------------
    def _by(self, name: str) -> Slopes:
        base, family = self._base, self._family
        flat = base.stepper.plane is not None
        six = self._six(name, np.zeros(base.unknowns))
        left = [x.unbalanced() for x in six]
        row = self._solver.row
        family.check_smooth(name, left, row, float(np.linalg.norm(row * base.noise())))
        unbalanced, explicit = family.slope(name, left), self._slopes_of(name, six, flat)
        way = self._solved(unbalanced)
        around = self._six(name, way)
        # nothing is unbalanced along the way: what the differences find there is their error, on another path than above
        deviation = self._solved(family.slope(name, [x.unbalanced() for x in around]))
        size, error = (float(np.linalg.norm(base.weighed(x))) for x in (way, deviation))
        if error > WORST * size > 0.0 and base.size_of(deviation) * family.steps[name] > AT_REST:
            raise ConvergenceError(f"sensitivity: derivatives by parameter {name!r} have a relative error of {error / size:.2g}, "
                                   "because the scene reacts too strongly to differences of this size; give a smaller "
                                   "scale={...}", state=self.state)
        rows = self._slopes_of(name, around, flat)
        rows |= {key: explicit[key] + x for key, x in self._linear.along(way).items() if key in explicit}
        return Slopes(unbalanced, explicit, way, rows, error / size if size else 0.0)

    def _solved(self, right: Array) -> Array:
        x = self._solver.solve(right)
        if x is None or self._solver.is_singular:
            raise ConvergenceError("sensitivity: the tangent of the equilibrium is singular, so derivatives do not exist. It is "
                                   "a limit or bifurcation point, or a part can move freely; fb.modes(model, state=...) shows "
                                   "which", state=self.state)
        return x

    def _six(self, name: str, way: Array) -> list[Response]:
        return [self._at(name, j, way) for j in range(len(CHANGES))]

    def _at(self, name: str, j: int, way: Array) -> Response:
        model = self._family.around(name, self._base.stepper.plane is not None)[j].model
        return at_shape(self._base, model, self._factors(model), way, CHANGES[j] * self._family.steps[name])

    def _slopes_of(self, name: str, six: list[Response], flat: bool) -> dict[str, Array]:
        built = self._family.around(name, flat)
        rows = [self._row(x, b.points) for x, b in zip(six, built)]
        return {key: self._family.slope(name, [row[key] for row in rows]) for key in rows[0]}

    def _row(self, at: Response, points: Mapping[str, Place]) -> dict[str, Array]:
        """Return the observed quantities in a scene around the equilibrium."""
        observer = Observer(at.stepper.model, ("slider", *self._observe), points)
        t, factor = (float(x) for x in at.stepper.law_work[:2])
        row = observer.row(t, at.state)
        if observer.needs_forces:
            asked = reactions_of(at, observer)
            reactions = np.zeros(0) if asked is None else asked.at(at.factors, at.state)
            observer.add_forces(row, np.concatenate((at.state.force, reactions)), factor)
        return {key: np.asarray(x) for key, x in row.items()}

    def _series(self, key: str, which: int | None = None) -> dict[str, Array]:
        """Return derivatives of one series, or one of its columns, by all parameters."""
        if self._slopes and key not in next(iter(self._slopes.values())).rows:
            raise SceneError(f"sensitivity: {key!r} was not observed; give observe=(...) from {', '.join(map(repr, OBSERVED))}, "
                             "and let build return points")
        return {name: x.rows[key] if which is None else x.rows[key][which] for name, x in self._slopes.items()}

    def _index(self, noun: str, names: Sequence[str], label: str) -> int:
        if label not in list(names):
            raise SceneError(f"sensitivity: there is no {noun} {shown(label)}; there are {known(names, label)}")
        return list(names).index(label)

    @checked(name=Word())
    def point(self, name: str) -> dict[str, Array]:
        """Return derivatives of the position of an observed point, by every parameter [3], m per unit.

        Raises
        ------
        SceneError
            build returned no such point.
        """
        return self._series("points", self._index("point", list(self._family.points), name))

    @checked(name=Word())
    def slider(self, name: str) -> dict[str, Array]:
        """Return derivatives of the arc length of a slider, by every parameter, m per unit.

        Raises
        ------
        SceneError
            There is no such slider.
        """
        return self._series("s_slide", self._index("slider", self.model.names["sliders"], name))

    @checked(name=Word())
    def contact_force(self, name: str) -> dict[str, Array]:
        """Return derivatives of the contact force of a slider on its point, by every parameter [3], N per unit.

        Raises
        ------
        SceneError
            There is no such slider.
        """
        return self._series("contact_force", self._index("slider", self.model.names["sliders"], name))

    @checked(name=Word())
    def reaction(self, name: str) -> dict[str, Array]:
        """Return derivatives of the force and the moment of a support or joint, by every parameter [2, 3], N and N m per unit;
        needs `observe=("reaction", ...)`.

        Raises
        ------
        SceneError
            There is no such support, or reactions were not observed.
        """
        return self._series("reaction", self._index("support or joint", self.model.reaction_names, name))

    @checked(name=Word())
    def section(self, name: str) -> dict[str, Array]:
        """Return derivatives of N, Q2, Q3 (N) and T, M2, M3 (N m) at an observed point of a beam, by every parameter [6]; needs
        `observe=("section", ...)`.

        Raises
        ------
        SceneError
            There is no such point, or section forces were not observed.
        """
        k = self._index("point", list(self._family.points), name)
        force, moment = (self._series(key, k) for key in ("section_force", "section_moment"))
        return {name: np.concatenate((force[name], moment[name])) for name in force}

    @checked(kind=Word(("strain", "gravity", "potential")))
    def energy(self, kind: str = "strain") -> dict[str, Array]:
        """Return derivatives of the energy of strains, of gravity, or of both and constant loads, by every parameter, J per unit;
        needs `observe=("energy", ...)`, the default."""
        return self._series(kind)

    # --- by the adjoint -----------------------------------------------------------------------------------------------------
    @checked(points=Names("must map names of points to weights (3,)"), sliders=Names("must map names of sliders to weights"),
             contact_forces=Names("must map names of sliders to weights (3,)"), strain_energy=Number())
    def gradient(self, *, points: Mapping[str, ArrayLike] | None = None, sliders: Mapping[str, float] | None = None,
                 contact_forces: Mapping[str, ArrayLike] | None = None, strain_energy: float = 0.0) -> Gradient:
        """Return derivatives of a weighed sum of positions, arc lengths, contact forces and strain energy by all parameters, all
        sections and all loads, for one solution with the transposed tangent.

        Parameters
        ----------
        points : mapping of str to (3,)
            Weights of the positions of observed points. Of a function of positions: its derivatives by them.
        sliders : mapping of str to float
            Weights of the arc lengths of sliders.
        contact_forces : mapping of str to (3,)
            Weights of contact forces.
        strain_energy : float
            Weight of the energy of all strains.

        Raises
        ------
        SceneError
            No weights, or something that was not observed.
        ConvergenceError
            The tangent is singular.
        """
        objective = Objective(self._linear, points, sliders, contact_forces, strain_energy)
        adjoint = self._solver.solve(objective.slope(), transposed=True)
        if adjoint is None or self._solver.is_singular:
            raise ConvergenceError("sensitivity: the tangent of the equilibrium is singular, so derivatives do not exist",
                                   state=self.state)
        by = {name: float(objective.explicit(x.explicit) + adjoint @ x.unbalanced) for name, x in self._slopes.items()}
        base = self._base
        rates = np.asarray(base.lift() @ adjoint[:base.places.stop])
        own = base.stepper.model
        factor = float(base.stepper.law_work[1]) * (1.0 if own.gravity_time is None else factor_at(
            own.gravity_time, float(base.stepper.law_work[0])))
        sections = section_gradients(own, base.state, rates, strain_energy, factor * own.gravity)
        q, of_nodes = base.own_rates(adjoint)
        return Gradient(by, sections, of_nodes[:, 0], spins(q, of_nodes))

    # --- vibration -----------------------------------------------------------------------------------------------------------
    @checked(n=Count(most=10_000), planar=Flag())
    def frequencies(self, n: int = 6, *, planar: bool | None = None) -> FrequencySlopes:
        """Return the n lowest natural frequencies about the equilibrium, as `modes` finds them, and their derivatives.

        Parameters
        ----------
        n : int
        planar : bool, optional
            As in `modes`.

        Raises
        ------
        SceneError
            Moments act, so that the stiffness is not symmetric; or as `modes`.
        ConvergenceError
            The eigenvalues were not found.
        """
        base, family = self._base, self._family
        flat = self.model.asked_for_plane if planar is None else planar
        if flat and base.stepper.plane is None:
            raise SceneError(f"planar=True: scene {self.model.scene_name!r} does not stay in a plane, or a parameter moves it "
                             "out of the plane")
        found = Linearised(base.stepper.model, base.state, base.sliding, base.factors, flat, n, self._backend,
                           (float(base.stepper.law_work[0]), float(base.stepper.law_work[1])))

        def around(name: str) -> Callable[[], Iterable[tuple[Model, State, Array]]]:
            def others() -> Iterable[tuple[Model, State, Array]]:
                for j in range(len(CHANGES)):
                    at = self._at(name, j, self._slopes[name].way)
                    yield at.stepper.model, at.state, at.factors
            return others

        return frequency_slopes(found, n, {name: around(name) for name in self.values}, family.slope)

    def __str__(self) -> str:
        lines = [f"sensitivity of scene {self.model.scene_name!r} by {len(self.values)} parameters"]
        lines += [f"  {name} = {value:g}: accuracy {self.accuracy[name]:.1e}" for name, value in self.values.items()]
        return "\n".join([*lines, *self._doubts()])


def family_of(who: str, build: Build, values: Mapping[str, Any], scale: Mapping[str, Any] | None,
              held: bool | str | Sequence[str], backend: str) -> tuple[Family, Array]:
    """Return the scenes of a function of parameters, and which of their sliders stay, bool [S]; who: the function that was
    called. Raises SceneError: a value is no number, there is no such backend, or the scene has something whose derivatives by
    parameters are not known."""
    given = numbers_of(who, values, scale)
    check_backend(backend)
    family = Family(build, *given)
    model, stays = family.model, held_sliders(family.model, held)
    require(Analysis.SENSITIVITY, model, who, stays)
    return family, stays


@warns
@checked(build=which_build, values=Names("must map names of parameters to numbers"),
         scale=Names("must map names of parameters to sizes"), state=START,
         observe=Listing(Word(OBSERVED), "a sequence of kinds, as in ('energy', 'reaction')"), load_factor=Number(),
         at_time=Number(unit="s"), held=which_sliders, backend=Word())
def sensitivity(build: Build, values: Mapping[str, float], *, scale: Mapping[str, float] | None = None,
                state: State | None = None, observe: Sequence[str] = ("energy",), load_factor: float = 1.0,
                at_time: float | None = None, held: bool | str | Sequence[str] = False, backend: str = "auto") -> Sensitivity:
    """Compute an equilibrium and its derivatives by parameters, exact to round-off: of positions, sliders, contact forces,
    reactions, section forces, energies and natural frequencies, by anything that the scene depends on smoothly (theory.md 13).

    Parameters
    ----------
    build : callable
        `build(**values)` makes the scene and returns it, or returns it with a mapping of names to points to observe (as `points`
        of `simulate`). Called twice, and six times for each parameter with values that differ by up to 1.2 percent; it has to
        return the same parts with the same elements.
    values : mapping of str to float
        Parameters. Empty: for `Sensitivity.gradient` by all sections and loads alone.
    scale : mapping of str to float, optional
        Sizes of parameters whose value is zero, or says nothing of how much they matter, in their units.
    state : State, optional
        The equilibrium, where it is known, such as `solve_path(...).state`; default: that of `solve_static`.
    observe : sequence of {'energy', 'section', 'reaction'}
        Quantities with derivatives besides points and sliders.
    load_factor : float
        Factor of all loads and gravity; other than 1 with a state.
    at_time : float
        Where time functions of loads are evaluated, s.
    held : bool, str or sequence of str
        Sliders that stay where they are, as in `solve_static`.
    backend : {'auto', 'pardiso', 'superlu'}

    Returns
    -------
    Sensitivity
        `.point(name)`, `.slider(name)`, `.contact_force(name)`, `.reaction(name)`, `.section(name)`, `.energy()`: derivatives by
        every parameter; `.gradient(points={...})`: of one number by everything; `.frequencies(n)`.

    Raises
    ------
    SceneError
        build returns no scene, or other parts for other values; the scene depends on a parameter in steps; the state is no
        equilibrium; Coulomb friction, prescribed motions, rigid stops, locks, one-sided contact or user forces.
    ConvergenceError
        There is no equilibrium, or its tangent is singular: it has no derivatives.
    """
    family, stays = family_of("sensitivity", build, values, scale, held, backend)
    model = family.model
    result = None
    if state is None:
        if load_factor != 1.0:
            raise SceneError("sensitivity: load_factor needs the state that belongs to it; give state=..., or scale the loads in "
                             "build")
        result = solve_static(model, at_time=at_time, held=held, backend=backend, points=family.points)
        state = result.state
    else:
        state, _ = check_start(model, state, 1.0, at_rest=True)
        if at_time is None:
            require(Analysis.TIMELESS_SHAPES, model, "sensitivity", stays)

    def factors(of: Model) -> Array:
        return load_factor * load_factors_at("sensitivity", of, at_time)

    flat = model.plane is not None and bool(model.plane.holds(state))
    kinds = tuple(dict.fromkeys(("energy", *observe)))
    for plane in ((True, False) if flat else (False,)):
        check_supports(model, plane)
        base = _at_rest(Response(family.base(plane).model, state, stays, plane, backend, at_time or 0.0, factors(model),
                                 load_factor))
        try:
            tangent = base.linearised()[0]
            # on all threads
            solver = Saddle(tangent.matrix, tangent.multiplier, factoriser_for(backend))
            return Sensitivity(family, base, solver, kinds, result, factors, backend)
        except OutOfPlane:
            continue
    raise SceneError("sensitivity: the scene leaves its plane")


def _at_rest(base: Response) -> Response:
    """Improve the equilibrium by one step of Newton's method. Raises SceneError: the state is no equilibrium."""
    for last in (False, True):
        saddle, right = base.linearised()
        x = saddle.solve(right)
        if x is None:
            raise ConvergenceError("sensitivity: the tangent of the equilibrium is singular and cannot be "
                                   "solved", state=base.state)
        size = base.size_of(x)
        if not size <= AT_REST:
            worst = int(np.argmax(np.abs(right[:base.nodes])))
            raise SceneError(f"sensitivity: the state is not an equilibrium: unbalanced forces would move nodes by {size:.2g} of "
                             f"the size of the scene, and {base.label(worst)} has an unbalanced force of "
                             f"{abs(right[worst]):.3g}. Find the equilibrium with fb.solve_static(model), and give its "
                             "load_factor and at_time")
        if not last:
            base.move(x)
    return base
