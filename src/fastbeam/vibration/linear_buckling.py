"""Linear buckling: load factors at which the tangent of an equilibrium is singular, once all internal forces have grown with the
loads (theory.md (12.5)).

The shape stays that of the equilibrium while forces grow: stresses of beams, forces of springs, joints and sliders, and loads
that depend on the shape, all by their rates of K u' = f. The tangent is linear in these, so that its derivative K' is one
difference of compiled tangents, exact but for round-off. Derivatives by displacements before buckling do not belong to it:
without their squares the stiff strains of slender beams would get an energy below zero.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fastbeam.dynamics.options import START
from fastbeam.interface.arguments import Anything, Count, Flag, Number, Word, checked
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import warns
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.call_tables import ADDED, Calls
from fastbeam.kernels.forces.spring import Springs
from fastbeam.kernels.forces.spring_laws import SpringLaws
from fastbeam.kernels.layout import REFERENCE, layout_of
from fastbeam.kernels.state import State
from fastbeam.linalg.arnoldi import nearest
from fastbeam.linalg.eigen import BLOCK, NOISE, SingularError, grown
from fastbeam.linalg.factors import factoriser_for
from fastbeam.linalg.saddle import Saddle
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.contact.moving_tables import Elements, by_elements, elements_at
from fastbeam.model.forces.loads import which_times
from fastbeam.model.maps import velocity_map
from fastbeam.model.model import Model, check_model
from fastbeam.model.tables import strain_gradient
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.results.mode_shapes import Motions, check_number
from fastbeam.scene import Beam
from fastbeam.statics.arc_length import PathSolver
from fastbeam.statics.paths.equilibrium_paths import Support, begin_path
from fastbeam.statics.static_analysis import which_sliders
from fastbeam.statics.steady_motion import turning_stiffness
from fastbeam.stepping.stepper import Stepper
from fastbeam.vibration.linearised import Linearisation
from fastbeam.vibration.resting_sliders import resting_sliders

Array = np.ndarray
# step of differences of laws, as a motion in sizes of the scene and rad
STEP = 0.01
# imaginary part of a real eigenvalue, and residual of a mode next to the sum of the sizes of its terms
REAL, GOOD = 1e-6, 1e-9
# more modes than are asked for, behind which those below are counted where their load factors differ by this share
MORE, DISTINCT = 2, 1e-6
# load factor, next to the lowest one, at which solutions are found where loads hold what moves freely without them; and one that
# is that of such a motion, next to this
SHIFT, FREE = 0.3, 1e-8
# imaginary step of derivatives that are exact but for round-off
TINY = 1e-30
# motion until buckling, in sizes of the scene and rad, from which on linear buckling is of little use
FAR = 0.05


class BucklingModes(Motions):
    """Load factors at which a scene buckles, and its shapes then, by linear buckling about an equilibrium (theory.md (12.5)).

    Attributes
    ----------
    load_factors : float64 [n]
        Load factors, as of `solve_path`, by their distance from that of the equilibrium.
    change : float64 [n]
        The same less the load factor of the equilibrium: what loads may grow by.
    displacements, spins : float64 [n, N, 3]
        Motion of all nodes. The largest displacement is 1 m, or, where nothing but triads turns, the largest spin 1 rad.
    slides : float64 [n, S]
        Motion of the sliding coordinates, m.
    residuals : float64 [n]
        Size of (K + c K') x, c the change of the load factor, relative to the sum of the sizes of its terms.
    uncertainty : float64 [n]
        Uncertainty of the load factors by round-off.
    motion_before : float64 [n]
        Motion from the equilibrium until the scene buckles, to first order, in sizes of the scene and rad. Linear buckling
        neglects it.
    is_complete : bool
        Whether the signs of K + c K' confirm that no load factor before the last one is missing; False where K is not symmetric,
        or not stable.
    info, names : dict
        Facts; names of parts as in a `Result`.
    events : list of dict
        Events: "unresolved" where linear buckling is not to be trusted, "nonconservative", "plane", as in `solve_path`.
    positions, directors : float64 [N, 3], [N, 3, 3]
        Shape of the equilibrium.
    """

    _title = "Buckling modes of {}"

    def __init__(self, load_factors: Array, change: Array, displacements: Array, spins: Array, slides: Array, residuals: Array,
                 uncertainty: Array, motion_before: Array, source: Any, info: dict[str, Any], names: Mapping[str, list[Any]],
                 positions: Array, directors: Array) -> None:
        super().__init__(displacements, spins, slides, residuals, source, info, names, positions, directors)
        self.load_factors, self.change, self.uncertainty, self.motion_before = load_factors, change, uncertainty, motion_before
        self.is_complete = bool(info["complete"])

    @checked(k=Count(0), amplitude=Number(unit="m"))
    def state(self, k: int, amplitude: float) -> State:
        """Return the equilibrium moved by amplitude times mode k, at rest: a start beside it, or the shape of an imperfection.

        Parameters
        ----------
        k : int
            From 0.
        amplitude : float
            Largest displacement of a node, m; of modes in which nothing but triads turns the largest angle, rad.

        Raises
        ------
        SceneError
            There is no such mode.
        """
        check_number(self, k)
        x, turn = (amplitude * of[k] for of in self._of_nodes)
        moved: State = self._source.moved(x, turn, amplitude * self.slides[k], 0.0 * x, 0.0 * turn)
        return moved

    def _words(self, k: int) -> tuple[str, bool]:
        return f"load factor {self.load_factors[k]:.5g}", False

    def table(self) -> str:
        """Return a text: load factor, its change from the equilibrium, uncertainty and residual of every mode."""
        rows = [f"{'mode':>4} {'load factor':>16} {'change':>16} {'uncertainty':>12} {'residual':>9} {'motion before':>14}"]
        for k in range(len(self)):
            rows.append(f"{k:4d} {self.load_factors[k]:16.9g} {self.change[k]:16.9g} {self.uncertainty[k]:12.1e} "
                        f"{self.residuals[k]:9.1e} {self.motion_before[k]:14.1e}")
        if not self.is_complete:
            rows.append("signs of the tangent could not confirm that no modes are missing between these")
        return "\n".join([*rows, *self._doubts()])


@warns
@checked(model=Anything(), state=START, load_factor=Number(), n=Count(most=1000), negative=Flag(), at_time=which_times,
         held=which_sliders, moves=Anything(), prestrains=Anything(), backend=Word())
def critical_loads(model: Model, *, state: State | None = None, load_factor: float = 0.0, n: int = 6, negative: bool = False,
                   at_time: float | tuple[float, float] | None = None, held: bool | str | Sequence[str] = False,
                   moves: Mapping[Support, ArrayLike] | None = None, prestrains: Mapping[Beam, float] | None = None,
                   backend: str = "auto") -> BucklingModes:
    """Find the n lowest load factors at which a scene buckles, by linear buckling about an equilibrium: (K + c K') x = 0 with K
    the tangent, c the change of the load factor and K' what the growing internal forces make of the tangent (theory.md (12.5)).

    What grows with the load factor of a path grows here: loads and gravity, follower loads and laws with grows=True, drives that
    push; or `moves`, or `prestrains`. Stresses of beams and forces of springs, joints and sliders grow in proportion, at the
    shape of the equilibrium. Linear buckling neglects how the shape changes before: it is exact for a column but for its
    shortening, and good as long as the scene hardly moves (`motion_before`). `solve_path` finds limit points, as of shallow
    arches, and paths behind critical points. About a state nearer to the critical load there is less to neglect.

    Parameters
    ----------
    model : Model
        Held as for `solve_static`. A planar scene buckles in space all the same, but for a model compiled with planar=True and a
        scene that only its plane holds (`info["counted_in"]` is "plane" then).
    state : State, optional
        An equilibrium, that of `load_factor`; default: the reference, without loads.
    load_factor : float
        Load factor of the state: 1 for that of `solve_static`.
    n : int
        Number of modes; fewer where there are no more.
    negative : bool
        Also load factors below that of the state, as of loads the other way round.
    at_time, held, moves, prestrains
        As in `solve_path`. Two times: the loads of the first stay, and their change until the second is scaled.
    backend : {'auto', 'pardiso', 'superlu'}

    Returns
    -------
    BucklingModes
        `.load_factors`, `.displacements`, ..., `.state(k, amplitude)`. Follower loads, laws and moments with fixed axes have no
        potential: load factors are then those at which another equilibrium exists nearby (divergence), and vibrations may grow
        at lower ones (flutter), which `modes` tells.

    Raises
    ------
    SceneError
        The state is no equilibrium, an argument is not usable, or something is held by nothing.
    ConvergenceError
        The tangent of the state is singular, or the load factors were not found.
    """
    check_model("critical_loads", model)
    require(Analysis.BUCKLING, model)
    begun = begin_path("critical_loads", model, state, load_factor, at_time, held, moves, prestrains, backend)
    solver = begun.solver.judge
    if not solver.balanced():
        raise SceneError(f"critical_loads: the state is not an equilibrium at load_factor={load_factor:g}; give the load factor "
                         "at which it was found, 1 for solve_static(model).state, and the same at_time=, moves= and prestrains=")
    tangent = _tangent(solver, backend)
    try:
        modes = _lowest(tangent, n, negative)
    except SingularError:
        raise ConvergenceError(f"critical_loads of scene {model.scene_name!r} were not found; ask for fewer",
                               state=state) from None
    result = _result(model, solver, tangent, modes, n, negative)
    notes = [*begun.notes, ("plane", begun.aside)] if begun.aside else begun.notes
    result.events = [*({"kind": kind, "text": text} for kind, text in notes), *_events(result)]
    return result


class _Tangent(NamedTuple):
    """Tangent of an equilibrium, and what growing internal forces add to it."""

    held: Saddle             # K + shift K', free motions fixed
    shift: float             # change of the load factor next to which solutions are found
    whole: Any               # K, symmetric where the loads have a potential
    growth: Any              # K', sparse [n, n]
    noise: Any               # round-off of the entries of K', sparse [n, n]
    reach: float             # largest motion in a unit of the load factor, in sizes of the scene and rad
    unstable: int | None     # negative directions of K
    is_symmetric: bool


class _Found(NamedTuple):
    """Modes, the best first."""

    change: Array      # [m]
    vectors: Array     # [n, m]
    residuals: Array   # [m]
    is_every: bool     # whether there are no more


def _tangent(solver: PathSolver, backend: str) -> _Tangent:
    """Assemble the tangent at the state of a solver, and what growing internal forces add to it.

    Raises
    ------
    ConvergenceError
        The tangent is singular.
    """
    matrix, multiplier = solver.equations()[0].matrix, solver.equations()[0].multiplier
    singular = ConvergenceError("critical_loads: the tangent of the state is singular: it is a critical point itself, or a part "
                                "that moves freely is pushed; begin at another load factor, or support that part",
                                state=solver.state)
    way = solver.direction(None)
    if way is None or way.factor == 0.0:
        raise singular
    rates = way.x / way.factor
    symmetric = not solver.is_unsymmetric

    def of(given: Any) -> Any:
        return (0.5 * (given + given.T)).tocsr() if symmetric else given.tocsr()

    whole = of(matrix)
    free = solver.hold_free(lambda: matrix)
    held = Saddle(whole, multiplier, factoriser_for(backend, threads=1)).holding(free)
    if held.solve(np.random.default_rng(0).standard_normal(multiplier.size)) is None or held.left.shape[1]:
        raise singular
    core = solver.core
    moves = rates[:solver.nodes].reshape(-1, len(core.dofs))
    shift, spin = (np.max(np.linalg.norm(x, axis=1), initial=0.0) for x in (moves[:, :core.dim], moves[:, core.dim:]))
    reach = float(max(shift / core.length, spin, np.max(np.abs(rates[solver.places]), initial=0.0) / core.length))
    # of supports that move, too
    of_rows, q = solver.map, solver.state.q.reshape(-1, 4, 3)
    motion = (of_rows.ties @ (velocity_map(q) @ (of_rows.every @ rates[:solver.nodes]))).reshape(-1, 4, 3)
    # forces grow by as much as strains of 1 would need
    by_strain, largest = _of_stresses(solver, motion)
    by_strain = by_strain + _of_moving(solver, motion)
    step = 1.0 / max(largest, *(abs(change) for _, change in solver.strains.beams), reach, 1e-300)
    growth = _of_forces(solver, rates, step) + grown(by_strain + _of_springs(solver, motion), multiplier.size)
    growth = growth + grown(_of_laws(solver, rates, STEP / max(reach, 1e-300)), multiplier.size)
    noise = NOISE * (abs(growth) + abs(whole) / step)
    found = _Tangent(held, 0.0, whole, of(growth), noise, reach, solver.unstable(), symmetric)
    return _held_by_loads(solver, found, backend) if free.size else found


def _held_by_loads(solver: PathSolver, tangent: _Tangent, backend: str) -> _Tangent:
    """Let solutions be found under a part of the loads, which may hold what moves freely without them, as a body that hangs."""
    # of the size of the lowest, if no more: what moves freely is fixed
    first = _lowest(tangent, 1, True, np.inf)
    if not first.change.size:
        return tangent
    shift = SHIFT * float(abs(first.change[0]))
    matrix = (tangent.whole + shift * tangent.growth).tocsr()
    held = Saddle(matrix, tangent.held.multiplier, factoriser_for(backend, threads=1))
    return tangent._replace(held=held.holding(solver.hold_free(lambda: matrix)), shift=shift)


def _of_forces(solver: PathSolver, rates: Array, step: float) -> Any:
    """Differentiate the tangent by forces of joints and sliders, prestrains, and loads, at one shape; rates [n]: of all unknowns
    by the load factor; step: of the load factor."""
    before, ends = solver.saved(), []
    for size in (step, -step):
        solver.restore((*before[:2], before[2] + size * rates[solver.places.stop:], before[3] + size))
        ends.append(solver.equations()[0].matrix)
    solver.restore(before)
    return (ends[0] - ends[1]) / (2.0 * step)


def _of_stresses(solver: PathSolver, motion: Array) -> tuple[Any, float]:
    """Differentiate the tangent of beams by stresses that strains at these rates of all coordinates [N, 4, 3] make, sparse [m, m]
    on the unknowns of nodes; return also the largest of the rates of strains."""
    from scipy import sparse
    model = solver.stepper.model
    assert model.uneliminated is not None
    own = model.uneliminated(planar=False)
    # an array of its own, of which no beam changes
    strains = ReferenceStrains([(slice(0, 0), 0.0)])
    stepper = Stepper(own, np.ones(1), solver.state, backend="superlu", static=True, strains=strains)
    reference = strains.of(own)
    growing, first, q = np.zeros_like(reference), reference.copy(), solver.state.q.reshape(-1, 4, 3)
    arm, largest = np.repeat((1.0, own.length), 3), 0.0
    for name, tables in (("simo_reissner", own.simo), ("green_lagrange", own.green)):
        for row in () if tables is None else tables.meta.tolist():
            rate = _strain_rates(name, tables, row, q, motion)
            growing[row[REFERENCE]:row[REFERENCE] + rate.size] = rate.transpose(1, 2, 0).reshape(-1)
            largest = max(largest, float(np.max(np.abs(rate * arm))))
    step, ends = 1.0 / max(largest, 1e-300), []
    for size in (step, -step):
        reference[:] = first - size * growing
        stepper.parts.start(0.0)
        stepper.assemble_anew()
        blocks = stepper.work.blocks[:48 * stepper.core.pattern.keys.size].reshape(-1, 6, 8)
        # half of the tangent
        ends.append(stepper.linear.superlu.by_rows(blocks))
    found = (ends[0] - ends[1]) / step
    axes = solver.map.axes
    if axes is not None:
        within = np.zeros((6, 3))
        within[:3, 0], within[:3, 1], within[3:, 2] = axes
        lift = sparse.kron(sparse.eye(stepper.core.pattern.n), within, format="csr")
        found = lift.T @ found @ lift
    return found, largest


def _of_moving(solver: PathSolver, motion: Array) -> Any:
    """Differentiate the tangent of beams whose elements move by stresses that strains at these rates of all coordinates [N, 4, 3]
    make, sparse [m, m]: of the material, the elements where they are."""
    from scipy import sparse
    moving, state, q = solver.stepper.model.moving, solver.state, solver.state.q.reshape(-1, 4, 3)
    if moving is None:
        return sparse.csr_matrix((solver.nodes, solver.nodes))
    own, pull = sparse.csr_matrix((q.size, q.size)), np.zeros(q.size)
    for table in moving.tables:
        of = elements_at(table, state.s)
        stiffness, force = _of_elements(of, q[table.node], motion[table.node])
        own = own + by_elements(stiffness, of.columns, q.size)
        np.add.at(pull, of.columns, -force)
    lift = solver.map.rates(q)
    return lift.T @ own @ lift + turning_stiffness(solver.map, q, pull.reshape(q.shape))


def _of_elements(of: Elements, q: Array, motion: Array) -> tuple[Array, Array]:
    """Return the derivatives of energies of elements by stresses that strains at these rates make: by their coordinates twice
    [E, 12 n, 12 n], and once [E, 12 n]; q, motion [E, n, 4, 3]."""
    rates = np.einsum("egij,ej->egi", of.strains_by(q), motion.reshape(len(q), -1))
    stress = of.weights[:, :, None] * (rates @ of.stiffness.T)
    columns = []
    for i in np.ndindex(q.shape[1:]):
        x = q.astype(complex)
        x[(slice(None), *i)] += 1j * TINY
        columns.append(np.einsum("egi,egij->ej", stress, of.strains_by(x)).imag / TINY)
    return np.stack(columns, axis=2), np.einsum("egi,egij->ej", stress, of.strains_by(q))


def _strain_rates(name: str, tables: Any, row: list[int], q: Array, motion: Array) -> Array:
    """Return rates of the strains at the points of a group of elements, [8, points, 6]; row: of its `ElementTables.meta`."""
    nn, nq, constants, nodes = row[:4]
    place, at = layout_of(SPACE, nn, nq), tables.nodes[nodes:nodes + 8 * nn].reshape(nn, 8).T
    point = tables.tab[constants + place.point:constants + place.inertia].reshape(nq, -1, 8)
    slopes, *shapes = (np.moveaxis(point[:, 1 + k::3], 2, 0) for k in range(3))

    def of(x: Array) -> tuple[Array, ...]:
        return (np.einsum("lga,lac->lgc", slopes, x[at, 0]), *(np.einsum("lga,laic->lgic", y, x[at, 1:]) for y in shapes))

    f, d, k = of(motion)
    return np.einsum("lgijc,lgjc->lgi", strain_gradient(name, *of(q)), np.concatenate((f[:, :, None], d, k), axis=2))


def _of_springs(solver: PathSolver, motion: Array) -> Any:
    """Differentiate the tangent of springs by their forces, which grow as coordinates have these rates [N, 4, 3], sparse
    [m, m]."""
    from scipy import sparse
    model, q = solver.stepper.model, solver.state.q.reshape(-1, 4, 3)
    rows, columns, values, pull = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)], np.zeros_like(q)
    for table in model.links:
        if not isinstance(table, (Springs, SpringLaws)):
            continue
        a, b = table.node.T
        edge = q[b, 0] - q[a, 0]
        length = np.linalg.norm(edge, axis=1)
        n = edge / np.where(length > 0.0, length, 1.0)[:, None]
        force = _slopes(table, length) * np.sum(n * (motion[b, 0] - motion[a, 0]), axis=1)
        np.add.at(pull[:, 0], a, force[:, None] * n)
        np.add.at(pull[:, 0], b, -force[:, None] * n)
        across = (force / np.where(length > 0.0, length, np.inf))[:, None, None] * (np.eye(3) - n[:, :, None] * n[:, None])
        for sign, one, other in ((1.0, a, a), (1.0, b, b), (-1.0, a, b), (-1.0, b, a)):
            here, there = 12 * one[:, None, None] + np.arange(3)[:, None], 12 * other[:, None, None] + np.arange(3)
            for out, x in zip((rows, columns), np.broadcast_arrays(here, there)):
                out.append(x.reshape(-1))
            values.append((sign * across).reshape(-1))
    lift = solver.map.rates(q)
    places = np.concatenate(rows), np.concatenate(columns)
    own = lift.T @ sparse.csr_matrix((np.concatenate(values), places), shape=(q.size, q.size)) @ lift
    return own + turning_stiffness(solver.map, q, pull)


def _slopes(table: Springs | SpringLaws, length: Array) -> Array:
    """Return stiffnesses of springs of these lengths, N/m."""
    if isinstance(table, Springs):
        return table.stiffness
    out = np.zeros(length.size)
    for k, e in enumerate((length - table.length).tolist()):
        first, last = table.first[k:k + 2].tolist()
        j = first + int(np.searchsorted(table.begin[first:last], e, "right")) - 1
        _, c1, c2, c3 = table.force[4 * j:4 * j + 4].tolist()
        x = e - float(table.origin[j])
        out[k] = c1 + x * (2.0 * c2 + x * 3.0 * c3)
    return out


def _of_laws(solver: PathSolver, rates: Array, step: float) -> Any:
    """Differentiate the tangent of bushings and laws by displacements at these rates [n], by central differences extrapolated to
    order 4, sparse [m, m]; step: of the load factor."""
    from scipy import sparse
    stepper, size = solver.stepper, len(solver.core.dofs)
    kinds = {type(x) for x in solver.core.links} - {Springs, SpringLaws}
    if not kinds:
        return sparse.csr_matrix((solver.nodes, solver.nodes))
    # forces on points of bodies have arms
    terms = tuple(term for term in stepper.terms if isinstance(term, (*kinds, type(solver.core.ties))))
    table, work, before = Calls(terms, ADDED).on(stepper.records[1]), stepper.work, solver.saved()
    there = rates.copy()
    there[solver.places.start:] = 0.0

    def tangent(change: float) -> Any:
        solver.restore(before)
        solver.move(change * there)
        work.q_mid[:] = work.q_end[:] = stepper.core_state.q
        work.blocks[:] = work.r[:] = 0.0
        kernels.assemble_some(*table, 0.0)
        blocks = work.blocks[:8 * size * solver.core.pattern.keys.size].reshape(-1, size, 8)
        # half of the tangent
        return 2.0 * stepper.linear.superlu.by_rows(blocks)

    coarse, fine = ((tangent(x) - tangent(-x)) / (2.0 * x) for x in (step, 0.5 * step))
    solver.restore(before)
    # rows of fixed unknowns are in no unit
    free = sparse.diags(solver.map.free)
    return free @ ((4.0 * fine - coarse) / 3.0) @ free


def _lowest(tangent: _Tangent, n: int, negative: bool, good: float = GOOD) -> _Found:
    """Find the n load factors next to that of the state, and some more, with residuals up to this one.

    Raises
    ------
    SingularError
        A solution was not accepted.
    """
    held, growth, size = tangent.held, tangent.growth, tangent.whole.shape[0]
    scale = held.column[:, None]
    if not growth.nnz or not np.any(growth.data):
        return _Found(np.zeros(0), np.zeros((size, 0)), np.zeros(0), True)

    def applied(z: Array) -> Array:
        x = held.solve(np.ascontiguousarray((growth @ (scale * z)).T))
        if x is None:
            raise SingularError
        return -x.T / scale

    def rank(values: Array) -> Array:
        counts = np.isfinite(values) & (np.abs(np.imag(values)) <= REAL * np.abs(values)) & (negative | (np.real(values) > 0.0))
        return np.where(counts & (np.abs(values) > FREE * tangent.shift), np.abs(values), np.inf)

    begin = applied(applied(np.random.default_rng(0).standard_normal((size, BLOCK))))
    found = nearest(applied, begin, tangent.shift, n + MORE, min(size, 12 * n + 240), rank)
    whole = found.basis @ found.parts
    # two of the same value may be a complex pair
    vectors = scale * np.where(np.imag(found.values) >= 0.0, np.real(whole), -np.imag(whole))
    change = np.real(found.values)
    stiff, geometric = tangent.whole @ vectors, growth @ vectors
    if tangent.is_symmetric:
        # squares the error of the vectors
        change = -np.sum(vectors * stiff, axis=0) / np.sum(vectors * geometric, axis=0)
    terms = abs(tangent.whole) @ np.abs(vectors) + np.abs(change) * (abs(growth) @ np.abs(vectors))
    row = held.row[:, None]
    residuals = np.linalg.norm(row * (stiff + change * geometric), axis=0) / np.linalg.norm(row * terms, axis=0)
    order = np.argsort(np.abs(change))
    order = order[residuals[order] <= good]
    return _Found(change[order], vectors[:, order], residuals[order], found.is_converged and change.size < n + MORE)


def _negative(solver: PathSolver, tangent: _Tangent, change: float) -> int | None:
    """Count negative directions of K + c K' at a change of the load factor; None where the number is not certain, or some are
    zero."""
    there = Saddle((tangent.held.matrix + (change - tangent.shift) * tangent.growth).tocsr(), tangent.held.multiplier)
    there.nodes = solver.free_motions.nodes
    signs = there.signs()
    return None if signs is None or signs[1] else signs[0]


def _is_complete(solver: PathSolver, tangent: _Tangent, found: _Found, n: int, negative: bool) -> bool:
    """Return whether as many directions have become unstable, at a load factor behind the n-th, as were found until there."""
    if found.is_every:
        return True
    size = np.abs(found.change)
    gaps = np.flatnonzero(np.diff(size) > DISTINCT * size[1:]) + 1
    if not tangent.is_symmetric or tangent.unstable != 0 or not gaps.size or gaps[-1] < n:
        return False
    last = int(gaps[-1])
    for sign in (1.0, -1.0)[:1 + negative]:
        change = sign * 0.5 * (size[last - 1] + size[last])
        if _negative(solver, tangent, change) != int(np.sum(sign * found.change[:last] > 0.0)):
            return False
    return True


def _result(model: Model, solver: PathSolver, tangent: _Tangent, found: _Found, n: int, negative: bool) -> BucklingModes:
    """Scale modes to shapes of unit size."""
    complete = _is_complete(solver, tangent, found, n, negative)
    change, x, residuals = found.change[:n], found.vectors[:, :n], found.residuals[:n]
    flat = solver.stepper.plane is not None
    drives = solver.drives_at
    resting = None if drives is None else resting_sliders("critical_loads", model, solver.state, solver.held, *drives)
    about = Linearisation(model, solver.state, solver.sliding, solver.load_factors, flat, resting=resting)
    moved, spins = about.spread(x[about.free])
    moves, turns = (np.linalg.norm(y, axis=2).max(axis=1, initial=0.0) for y in (moved, spins))
    size = np.where(moves > 1e-6 * turns * model.length, moves, turns)
    size[size == 0.0] = 1.0
    # the sign that makes the largest component positive
    flats = moved.reshape(len(size), 3 * model.n_nodes)
    peak = flats[np.arange(len(size)), np.argmax(np.abs(flats) > (1.0 - 1e-6) * np.abs(flats).max(axis=1)[:, None], axis=1)]
    size = np.where(peak < 0.0, -size, size)
    geometric = np.abs(np.sum(x * (tangent.growth @ x), axis=0))
    rough = (np.abs(change) * np.sum(np.abs(x) * (tangent.noise @ np.abs(x)), axis=0)
             + NOISE * np.sum(np.abs(x) * (abs(tangent.whole) @ np.abs(x)), axis=0))
    info = {"scene": model.scene_name, "method": "linear buckling", "load_factor": float(solver.factor), "complete": complete,
            "counted_in": "plane" if flat else "space", "unknowns": about.free.size, "held_sliders": about.held_sliders,
            "unstable_directions": tangent.unstable, "conservative": tangent.is_symmetric,
            "toppling": _toppling(solver, tangent, found), "solver": "none" if tangent.held.by is None else tangent.held.by.name}
    by = 1.0 / size[:, None, None]
    return BucklingModes(solver.factor + change, change, by * moved, by * spins,
                         x[solver.places].T / size[:, None] * solver.sliding, residuals,
                         rough / np.maximum(geometric, 1e-300), np.abs(change) * tangent.reach, about, info, model.names,
                         *about.own_shape())


def _toppling(solver: PathSolver, tangent: _Tangent, found: _Found) -> int:
    """Count motions that are free without the loads and grow under the smallest ones, as of a body above its joint."""
    if not tangent.shift or not tangent.is_symmetric or tangent.unstable is None:
        return 0
    count = _negative(solver, tangent, tangent.shift)
    below = int(np.sum((found.change > 0.0) & (found.change < tangent.shift)))
    return 0 if count is None else max(count - below - tangent.unstable, 0)


def _events(found: BucklingModes) -> list[dict[str, Any]]:
    """Return events where load factors are not to be trusted, or are not all that there is to stability."""
    out = []
    far = np.flatnonzero(found.motion_before > FAR)
    if far.size:
        k = int(far[0])
        out.append({"kind": "unresolved", "text": f"until load factor {found.load_factors[k]:.6g} (mode {k}) the scene moves by "
                    f"{found.motion_before[k]:.2g} of its size or rad, which linear buckling neglects; follow the path with "
                    "solve_path, or give a state nearer to it"})
    if found.info["toppling"]:
        out.append({"kind": "unresolved", "text": f"{found.info['toppling']} motions that are free without the loads grow under "
                    "the smallest ones, as of a body above its joint; support it, or find what is at rest with solve_static"})
    if not found.info["conservative"]:
        out.append({"kind": "nonconservative", "text": "follower loads, laws, moving air and moments with fixed axes have no "
                    "potential: these are load factors of divergence only; vibrations that grow (flutter) are found by fb.modes "
                    "at states of solve_path"})
    return out
