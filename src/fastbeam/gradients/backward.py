"""The adjoint recursion over the steps of a run: kernels where block elimination solves, PARDISO or SuperLU around them elsewhere
(theory.md (13.9) to (13.15))."""
from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.planar import strain_maps
from fastbeam.gradients.section_gradient import beam_numbers, moduli_of
from fastbeam.gradients.transposed import TransposedSolver
from fastbeam.kernels.adjoint import adjoint as kernels
from fastbeam.kernels.adjoint.adjoint import Adjoint, Found, Steps, Wanted
from fastbeam.kernels.adjoint.adjoint_border import Border, NoBorder
from fastbeam.kernels.adjoint.adjoint_sliders import Sliders, TakenAlong
from fastbeam.kernels.adjoint.section_gradients import SectionSums
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.kernels.contact.slider_forces import Along
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.kernels.layout import LIST
from fastbeam.kernels.state import aligned
from fastbeam.kernels.terms import Loads, NoTies
from fastbeam.model.forces.loads import load_factors, mean_factors
from fastbeam.model.maps import vector_masses
from fastbeam.model.model import Model
from fastbeam.model.workspace import contact_of, entries_of
from fastbeam.stepping.stepper import AUGMENTATION, Stepper

Array = np.ndarray
# s; compiled calls last about as long, so that Ctrl-C is seen between them
CALL_TIME = 0.1


class Stretch(NamedTuple):
    """Steps of a run that follow each other, from row `first` on; in the plane of the scene where the run was."""

    first: int
    # q, v, float64 [n + 1, 12 N], in a plane [n + 1, 4 N]
    q: Array
    v: Array
    # dphi, theta, float64 [n, 3 N], in a plane [n, 2 N] and [n, N]
    dphi: Array
    theta: Array
    s: Array  # float64 [n + 1, S]: places of sliders
    force: Array  # float64 [n, F]: forces of constraints
    # sign, rest, int64, float64 [n, S]: branches that Coulomb friction of sliders took; S = 0 where nothing acts along beams
    sign: Array
    rest: Array
    values: Array  # float64 [n + 1, C]: coordinates of joints, counted over turns

    def in_space(self, plane: Any) -> Stretch:
        """Return the same steps with coordinates in space."""
        n = len(self.dphi)
        dphi = self.dphi.reshape(n, -1, 2) @ plane.axes[:2]
        return Stretch(self.first, *plane.rows(self.q, self.v), dphi.reshape(n, -1),
                       (self.theta[:, :, None] * plane.axes[2]).reshape(n, -1), self.s,
                       np.array([plane.forces(x) for x in self.force]) if self.force.size else self.force, self.sign, self.rest,
                       self.values)


class Weights(NamedTuple):
    """Weights of an observed point: its nodes [m], shares of their vectors [m, 4], weights of rows [n + 1, 3], whether of
    velocities."""

    nodes: Array
    shares: Array
    rows: Array
    is_rate: bool


class Sums(NamedTuple):
    """Derivatives from a backward pass, in space."""

    # stiffness, viscosity, prestrain, inertia, float64 [beams, 6, 6], [beams, 6, 6], [beams, 6], [beams, 3]
    stiffness: Array
    viscosity: Array
    prestrain: Array
    inertia: Array
    bodies: Array  # float64 [B]
    # forces, moments, velocities, spins, positions, turns, float64 [N, 3]
    forces: Array
    moments: Array
    velocities: Array
    spins: Array
    positions: Array
    turns: Array
    gravity: Array  # float64 [3]
    factors: Array  # float64 [n, K]: derivatives by the mean factors of load vectors in every step
    pushes: Array  # float64 [n, P, 3]: derivatives by forces on observed points in every step
    sliders: Sliders


class Backward:
    """The adjoint of a run in steps of one size.

    model: without elimination; in a plane where its own tables are to be used.
    flat: whether tables of the plane are used.
    t, h, n: start, step and number of steps of the run.
    wanted: weights of the number that is differentiated.
    observed: sequence of (nodes, shares), points on which forces may act.
    """

    def __init__(self, model: Model, flat: bool, t: float, h: float, n: int, wanted: Sequence[Weights],
                 observed: Sequence[tuple[Array, Array]]) -> None:
        self.stepper = stepper = Stepper(model, np.ones(1), backend="superlu")
        self.whole, self.core, self.plane = model, stepper.core, stepper.plane
        assert (self.plane is not None) == flat
        self.h, self.times = h, t + h * np.arange(n)
        self.axes = np.eye(3) if self.plane is None else self.plane.axes
        self.within = self.axes[:self.core.dim]
        if stepper.contact is not None:
            stepper.contact = contact_of(self.core, entries_of(self.core, bounded=False))
        self.terms, self.system = tuple(_as_taken(x) for x in stepper.terms), stepper.system
        self.timed = any(x is not None for x in model.load_times)
        self.wanted, self.adjoint = self._wanted(wanted), self._adjoint()
        self.found = self._found(n, observed)
        self.sections = self._sections()
        factor = np.ones(n) if model.gravity_time is None else mean_factors(model.gravity_time, self.times, np.full(n, h))
        self.gravity_factor, self.gravity = factor, factor[:, None] * (self.within @ model.gravity)
        self.solver = TransposedSolver(stepper)
        self.outside = 0
        # adjoint solutions of all steps, where they are kept
        self.solutions: tuple[Array, Array] | None = None

    # --- tables ---------------------------------------------------------------------------------------------------------
    def _shares(self, nodes: Array, shares: Array) -> list[tuple[Array, Array]]:
        """Return shares of the vectors of nodes in a point; in a plane those of the position and of u, then those of J u."""
        if self.plane is None:
            return [(nodes, shares)]
        turned = np.sum(shares[:, 1:] * self.plane.factor[nodes], axis=1)
        out = [np.stack((shares[:, 0], turned.real), axis=1), np.stack((np.zeros(nodes.size), turned.imag), axis=1)]
        return [(nodes, x) for x in out]

    def _wanted(self, given: Sequence[Weights]) -> Wanted:
        parts, series = [], []
        for of in given:
            rows = of.rows @ self.within.T
            for (nodes, shares), turned in zip(self._shares(of.nodes, of.shares), (rows, rows[:, ::-1] * (1.0, -1.0)
                                                                                   if self.plane is not None else rows)):
                parts.append((nodes, shares, np.full(nodes.size, len(series)), np.full(nodes.size, int(of.is_rate))))
                series.append(turned)
        node, share, number, rate = (np.concatenate(x) for x in zip(*parts))
        return Wanted(node.astype(np.int64), np.ascontiguousarray(share), number, rate, np.array(series))

    def _adjoint(self) -> Adjoint:
        core, pattern = self.core, self.core.pattern
        mass = vector_masses(core)
        rows = 8 * (core.n_nodes + 1)
        size = core.q0.size
        return Adjoint(NoTies() if core.ties is None else core.ties, self._border(), mass.indptr.astype(np.int64),
                       mass.indices.astype(np.int64), mass.data, core.gravity_weight,
                       core.pattern.row_of[core.spin_root].astype(np.int64), core.loads, pattern.rows.astype(np.int64),
                       pattern.columns.astype(np.int64),
                       aligned_empty(8 * len(core.dofs) * (core.n_blocks + 1) * (pattern.plan is not None)),
                       aligned(rows), np.zeros(size), *(aligned_empty(rows) for _ in range(4)), *(empty(size) for _ in range(4)))

    def _border(self) -> Border | NoBorder:
        core = self.core
        if not core.n_constraints:
            return NoBorder()
        m = core.border * core.n_constraints
        return Border(np.zeros(core.n_sliders), *(empty(m) for _ in range(3)), empty((m, 8 * (core.n_nodes + 1))),
                      *(empty((m, m)) for _ in range(2)), empty(m), core.softness / AUGMENTATION)

    def _found(self, n: int, observed: Sequence[tuple[Array, Array]]) -> Found:
        core, d = self.core, self.core.dim
        parts = [(nodes, shares, k + second * len(observed)) for k, (nodes_of, shares_of) in enumerate(observed)
                 for second, (nodes, shares) in enumerate(self._shares(nodes_of, shares_of))]
        node = np.concatenate([x[0] for x in parts]).astype(np.int64) if parts else np.zeros(0, np.int64)
        share = np.concatenate([x[1] for x in parts]) if parts else np.zeros((0, core.q0.size // core.n_nodes // d))
        of = np.concatenate([np.full(x[0].size, x[2]) for x in parts]) if parts else np.zeros(0, np.int64)
        body = np.zeros(0, np.int64) if core.bodies is None else core.bodies.node
        count = len(observed) * (1 if self.plane is None else 2)
        return Found(np.zeros(d * core.n_nodes), aligned(8 * (core.n_nodes + 1)), np.zeros((n, len(core.load_times))),
                     np.zeros((n, d)), np.zeros((n, count, d)), node, np.ascontiguousarray(share), of, body, np.zeros(body.size),
                     Sliders(*np.zeros((2, n, core.n_sliders)), *np.zeros((2, core.n_sliders))))

    def _sections(self) -> tuple[SectionSums, ...]:
        core = self.core
        strains, inertias = (6, 3) if self.plane is None else (3, 2)
        out = []
        for tables, kind in core.sets_of_elements():
            groups = len(tables.meta)
            viscous = core.damped is not None and _name(kind) in core.damped.strains
            out.append(SectionSums(kind, tables, aligned(groups * strains**2 * 8), aligned(groups * strains**2 * 8 * viscous),
                                   aligned(groups * strains * 8), aligned(groups * inertias * 8)))
        return tuple(out)

    # --- the recursion ----------------------------------------------------------------------------------------------------
    def start(self, q: Array) -> None:
        """Begin the recursion at the last row, with coordinates q."""
        kernels.begin_at_end(self.terms, self.system, self.adjoint, self.wanted, q, self.times.size)

    def through(self, part: Stretch) -> None:
        """Go backward through some steps, the last ones that are left."""
        first, n = part.first, len(part.dphi)
        stretch = slice(first, first + n)
        terms, steps = self._terms_and_steps(part)
        of_sliders = self.found.sliders
        found = self.found._replace(
            load=self.found.load[stretch], weight=self.found.weight[stretch], place=self.found.place[stretch],
            sliders=of_sliders._replace(along=of_sliders.along[stretch], place=of_sliders.place[stretch]))
        if self.core.pattern.plan is None:
            for k in range(n - 1, -1, -1):
                self._one(terms, steps, found, k, first)
                self._keep(first + k)
            return
        left, burst = n, 1
        while left > 0:
            begin = time.perf_counter()
            to = max(0, left - burst)
            left = kernels.go_back(terms, self.system, self.core.pattern.plan, self.sections, self.adjoint, steps, self.wanted,
                                   found, self.h, left, to, first)
            if left > to:
                # a pivot vanished inside a block
                left -= 1
                self.outside += 1
                self._one(terms, steps, found, left, first)
            if self.solutions is not None:
                # one step a call
                self._keep(first + left)
            elif time.perf_counter() - begin < 0.5 * CALL_TIME:
                burst *= 2

    def _terms_and_steps(self, part: Stretch) -> tuple[tuple[Any, ...], Steps]:
        """Return the terms and arrays of some steps that kernels take."""
        first, n = part.first, len(part.dphi)
        motions, stretch = self.core.motions, slice(first, first + n)
        values = part.values if motions is None else np.ascontiguousarray(part.values[:, motions.rows])
        steps = Steps(part.q, part.v, part.dphi, part.theta, part.s, part.force, self.gravity[stretch], part.sign, part.rest,
                      values)
        terms = (*self.stepper._schedules(float(self.times[0]), self.h, n, first), *self.terms)
        if self.timed:
            terms = (Loads(self.core.loads, load_factors(self.whole, self.times[stretch], np.full(n, self.h))), *terms)
        return terms, steps

    def keep_solutions(self) -> None:
        """Keep the adjoint solutions of all steps from now on: of rows [n, 8 (rows + 1)], of equations of constraints [n, m]."""
        border, n = self.adjoint.border, self.times.size
        self.solutions = empty((n, self.adjoint.x.size)), empty((n, border.y.size if isinstance(border, Border) else 0))

    def _keep(self, k: int) -> None:
        if self.solutions is not None:
            self.solutions[0][k] = self.adjoint.x
            if self.solutions[1].size:
                self.solutions[1][k] = self.adjoint.border.y

    def unbalanced(self, part: Stretch, x: Array, y: Array) -> Array:
        """Return the residuals in steps of a run of another scene, times its adjoint solutions x, y, of every step [n]."""
        out = np.zeros(len(part.dphi))
        terms, steps = self._terms_and_steps(part)
        kernels.sum_unbalanced(terms, self.system, self.adjoint, steps, self.h, x, y, out)
        return out

    def _one(self, terms: tuple[Any, ...], steps: Steps, found: Found, k: int, first: int) -> None:
        """Take one step backward around a solver outside. Raises ArithmeticError: its tangent is singular; the argument is the
        number of the step."""
        def half(is_solved: bool) -> None:
            kernels.half_step_back(terms, self.system, self.sections, self.adjoint, steps, self.wanted, found, self.h, k, first,
                                   is_solved)

        half(False)
        n, rows, border = len(self.core.dofs), self.core.pattern.n, self.adjoint.border
        right = self.adjoint.right.reshape(-1, 8)[:rows, :n].reshape(-1)
        bordered = isinstance(border, Border)
        x = self.solver.solve(self.system.work.blocks, np.concatenate((right, border.right)) if bordered else right, terms,
                              self.system)
        if x is None:
            raise ArithmeticError(first + k)
        self.adjoint.x.reshape(-1, 8)[:rows, :n] = x[:right.size].reshape(rows, n)
        if bordered:
            border.y[:] = x[right.size:]
        half(True)

    # --- what was found ---------------------------------------------------------------------------------------------------
    def sums(self, q: Array, v: Array) -> Sums:
        """Return the derivatives after the first step, from coordinates q and velocities v."""
        core, found, n = self.core, self.found, self.core.n_nodes
        spins = found.turn.reshape(-1, 8)[core.pattern.row_of, core.dim:len(core.dofs)]
        rate, rows = self.adjoint.rate.copy(), aligned(8 * (n + 1))
        kernels.pull_ties(self.adjoint.ties, rate)
        kernels.lower(core.dofs, core.pattern.row_of, q, rate, rows)
        if core.held is not None:
            kernels.drop_held(core.held, core.dofs, rows)
        start = rows.reshape(-1, 8)[core.pattern.row_of]
        shape = (self.adjoint.shapes + self._turned_with(q, v, rate)).reshape(-1, 8)[core.pattern.row_of]
        about = self.axes if self.plane is None else self.axes[2:]
        pushes = found.place
        if self.plane is not None:
            own, turned = np.split(pushes, 2, axis=1)
            pushes = own + turned[:, :, ::-1] * (-1.0, 1.0)
        return Sums(*self._of_beams(), found.body, found.force.reshape(n, -1) @ self.within, spins @ about,
                    *(x for rows_of in (start, shape) for x in (rows_of[:, :core.dim] @ self.within,
                                                                rows_of[:, core.dim:len(core.dofs)] @ about)),
                    (self.gravity_factor @ found.weight) @ self.within, found.load, pushes @ self.within, found.sliders)

    def _turned_with(self, q: Array, v: Array, rate: Array) -> Array:
        """Return the additions to rows of `Adjoint.shapes` because rates of directors turn with them, so that spins stay; rate:
        adjoint of velocities, of nodes that are not tied."""
        core, n = self.core, self.core.n_nodes
        d, u, b = (x.reshape(n, -1, core.dim)[:, 1:] for x in (q, v, rate))
        if self.plane is None:
            spin = 0.5 * np.cross(d, u).sum(axis=1)
            turning = np.cross(d, np.cross(b, spin[:, None])).sum(axis=1)
        else:
            spin = d[:, :, 0] * u[:, :, 1] - d[:, :, 1] * u[:, :, 0]
            turning = -(spin * (b * d).sum(axis=2)).sum(axis=1, keepdims=True)
        rows = aligned(8 * (n + 1))
        np.add.at(rows.reshape(-1, 8)[:, core.dim:len(core.dofs)], core.pattern.row_of, turning)
        if core.held is not None:
            kernels.drop_held(core.held, core.dofs, rows)
        return rows

    def _of_beams(self) -> tuple[Array, Array, Array, Array]:
        """Return sums of elements, by beams and in space: by C, D, prestrains and inertias."""
        of, parts = beam_numbers(self.whole)
        count = max((x.stop for x in parts.values()), default=0)
        out = np.zeros((count, 6, 6)), np.zeros((count, 6, 6)), np.zeros((count, 6)), np.zeros((count, 3))
        size = 6 if self.plane is None else 3
        for sums in self.sections:
            meta, tables = sums.tables.meta, sums.tables
            lanes = meta[:, LIST, None] + np.arange(8)
            node, live = tables.nodes[lanes].reshape(-1), (tables.rows[lanes] != self.core.n_nodes).reshape(-1)
            beam, node = of[node[live]], node[live]
            stiffness, viscosity, change, inertia = (
                x.reshape(len(meta), -1, 8).transpose(0, 2, 1).reshape(8 * len(meta), -1)[live]
                for x in (sums.stiffness, sums.viscosity, sums.change, sums.inertia))
            prestrain = -np.einsum("eij,ej->ei", moduli_of(tables, size)[live], change)
            within = None if self.plane is None else self._within(node)
            for to, x in zip(out, (stiffness, viscosity)):
                if x.size:
                    x = x.reshape(-1, size, size)
                    x = 0.5 * (x + x.transpose(0, 2, 1))
                    np.add.at(to, beam, x if within is None else np.einsum("eia,eab,ejb->eij", within, x, within))
            np.add.at(out[2], beam, prestrain if within is None else np.einsum("eia,ea->ei", within, prestrain))
            if self.plane is not None:
                c, s = self._angle(node)
                inertia = np.stack((inertia[:, 0], c * c * inertia[:, 1], s * s * inertia[:, 1]), axis=1)
            np.add.at(out[3], beam, inertia)
        return out

    def _angle(self, node: Array) -> tuple[Array, Array]:
        """Return c and s of d2 = c J u + s n of the sections at nodes."""
        return self.plane.factor[node, 1].imag, self.plane.normal[node, 1]

    def _within(self, node: Array) -> Array:
        """Return the map to strains in space from those in the plane [*, 6, 3], at nodes."""
        return strain_maps(*self._angle(node))[0]


def _as_taken(term: Any) -> Any:
    """Return a term of a run for the backward pass: forces along beams in the branches that steps took."""
    if isinstance(term, Sliding) and isinstance(term.along, Along):
        return term._replace(along=TakenAlong(*term.along))
    return term


def _name(strains: Any) -> str:
    return {"SimoReissner": "simo_reissner", "GreenLagrange": "green_lagrange"}[type(strains).__name__]
