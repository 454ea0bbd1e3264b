"""Unstressed lengths of beams as unknowns of an equilibrium, one for every condition on it (theory.md 12)."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.loop import NOT_CONVERGED, OK
from fastbeam.kernels.state import State
from fastbeam.linalg.factors import factoriser_for, solver_name
from fastbeam.linalg.saddle import Saddle
from fastbeam.model.model import Model
from fastbeam.model.tables import elements_of
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.results.observe.points import PointSeries
from fastbeam.results.observe.resolution import Resolution
from fastbeam.results.observe.resultants import Sections, span_of
from fastbeam.scene import Beam
from fastbeam.scene.checks import Place
from fastbeam.statics.equilibrium import LEAST_STRAY, STRAY
from fastbeam.statics.linear_response import Response
from fastbeam.statics.path_stops import AXES, MOMENTS, Wanted
from fastbeam.stepping.iteration import newton_loop

Array = np.ndarray
# of a prestrain, from its least to its largest value
LEAST, MOST = -10.0, 0.99
# longest increment, in sizes of the scene and rad
LONGEST = 1.0
# steps of coordinates, in distances of nodes and as they are, for derivatives of section forces, and differences of order 6
NEARBY, OFFSETS, WEIGHTS = 2.0**-8, (-3, -2, -1, 1, 2, 3), (-1 / 60, 9 / 60, -45 / 60, 45 / 60, -9 / 60, 1 / 60)
# round-off of the influence of lengths on conditions, relative to their influence on the scene; smallest singular value of the
# influences, rows and columns scaled to 1, relative to the largest
UNMOVED, DEPENDENT = 1e-9, 1e-9
# share of conditions and loads that is round-off where the matrix is singular
UNBALANCED = 1e-9


class Lengths:
    """Prestrains of beams, each by itself, counted from those of the scene, and a model with the weights that go with them;
    per_length: whether their weights go with their unstressed lengths."""

    def __init__(self, model: Model, beams: list[Beam], per_length: bool) -> None:
        self.beams, self.first = beams, np.array([beam.start_strain[0] for beam in beams])
        self.strains = ReferenceStrains([(span_of("find_lengths, lengths", model, beam), 1.0) for beam in beams])
        self.model = model = self.strains.own(model)
        self.weighs = per_length and bool(np.any(model.gravity))
        # arrays of loads and of weights, what they are at first, and their change with the prestrain of every beam
        self._weights: list[tuple[Array, Array, list[tuple[Array, Array]]]] = []
        self._change = np.zeros(len(beams))
        if self.weighs:
            # nodes of every beam, one element after the other, and how their masses change with its prestrain, kg
            self._shares = [_shares(model, beam, first) for beam, first in zip(beams, self.first.tolist())]
            given, axes = model.uneliminated, np.eye(3) if model.plane is None else model.plane.axes
            assert given is not None
            self._form = cache(lambda planar: self._own(given(planar=planar), axes))
            self.model = self._own(model, axes)

    def _own(self, model: Model, axes: Array) -> Model:
        """Return the model with loads and weights of its own; axes: of its plane."""
        # gravity is in the first vector of all loads
        loads, weight = model.loads._replace(first=model.loads.first.copy()), model.gravity_weight.copy()
        rows, row_of, pull = loads.first.reshape(-1, 8), model.pattern.row_of, np.zeros(8)
        pull[:model.dim] = model.gravity @ (np.eye(3) if model.dim == 3 else axes[:2].T)
        self._weights.append((rows, rows.copy(), [(row_of[at], share[:, None] * pull) for at, share in self._shares]))
        self._weights.append((weight, weight.copy(), self._shares))
        for table in () if model.moving is None else model.moving.tables:
            per_strain = [np.where(int(table.place[1]) == model.numbers.start(beam), -table.weighs / (1.0 - first), 0.0)
                          for beam, first in zip(self.beams, self.first.tolist())]
            self._weights.append((table.weighs, table.weighs.copy(), [(np.arange(x.size), x) for x in per_strain]))
        self.put(self._change)
        plane = None if model.plane is None else replace(model.plane, model=self._own(model.plane.model, axes))
        return replace(model.with_loading(loads=loads, gravity_weight=weight), plane=plane, uneliminated=self._form)

    def put(self, change: Array) -> None:
        """Set these changes of the prestrains of the beams [m], and their weights."""
        self._change = change.copy()
        self.strains.put(change)
        for array, first, changes in self._weights:
            array[:] = first
            for (at, share), by in zip(changes, change):
                np.add.at(array, at, by * share)

    @property
    def lengths(self) -> Array:
        """Lengths of the beams as they are drawn [m]."""
        return np.array([beam.length for beam in self.beams])


def _shares(model: Model, beam: Beam, first: float) -> tuple[Array, Array]:
    """Return the nodes of a beam and how their masses, kg, change with its prestrain, which is `first` with the mass of the
    scene; none where elements move, whose weight is theirs."""
    if model.moving is not None and model.moving.has(model.numbers.start(beam)):
        return np.zeros(0, np.int64), np.zeros(0)
    q = model.q0.reshape(-1, 4, 3)
    part = elements_of(beam, model.numbers.start(beam), q[:, 0], q[:, 1:])
    mass = part.inertia[part.section, :1] * part.mass_phi.sum(axis=2)
    return part.nodes.reshape(-1), -mass.reshape(-1) / (1.0 - first)


class Condition(NamedTuple):
    """Quantity with a wanted value."""

    wanted: Wanted
    size: float                      # of the quantity
    at: PointSeries | None           # of a place alone
    axis: int                        # of the place
    slider: int                      # of an arc length; else -1
    part: str                        # of a section force

    def slope(self, model: Model, state: State) -> Any:
        """Return the derivatives by all coordinates and places of sliders, sparse [1, 12 N + S]."""
        n = state.q.size
        if self.at is not None:
            return self.at.slopes(state)[[self.axis]]
        out = sparse.lil_matrix((1, n + state.s.size))
        if self.slider >= 0:
            out[0, n + self.slider] = 1.0
            return out
        section = self.wanted.section
        if model.moving is not None and model.moving.has(section.first):
            section = Sections(model, section.beam, section.s, state.s)
            for k in model.moving.sliders.tolist():
                step = NEARBY * float(np.min(np.diff(section.beam.basis.element_ends)))
                moved = [state._replace(s=state.s + x * step * (np.arange(state.s.size) == k)) for x in OFFSETS]
                out[0, n + k] = sum(w * self.wanted.of(x) for w, x in zip(WEIGHTS, moved)) / step
        at, values = self._of_section(section, state)
        out[0, at] = values
        return out

    def _of_section(self, section: Sections, state: State) -> tuple[Array, Array]:
        """Return numbers of coordinates of nodes, and the derivatives of a section force by these."""
        q = state.q.reshape(-1, 12)[section.span]
        nodes = np.unique(np.concatenate((section.nodes.reshape(-1), section.at_nodes.reshape(-1))))
        steps = np.full((nodes.size, 12), NEARBY)
        steps[:, :3] *= np.max(np.linalg.norm(np.diff(q[nodes, :3], axis=0), axis=1))
        n = steps.size
        # node, coordinate, one after the other; from each of them six steps away
        moved = np.broadcast_to(q, (n, len(OFFSETS), *q.shape)).copy()
        each = np.arange(n)
        moved[each[:, None], np.arange(len(OFFSETS)), np.repeat(nodes, 12)[:, None], each[:, None] % 12] += (
            np.array(OFFSETS) * steps.reshape(-1, 1))
        shapes = moved.reshape(-1, section.count, 4, 3)
        values = getattr(section.at(np.zeros(len(shapes)), shapes[:, :, 0], shapes[:, :, 1:]), self.part)[:, 0]
        slope = values.reshape(n, -1) @ np.array(WEIGHTS) / steps.reshape(-1)
        return (12 * (section.first + nodes[:, None]) + np.arange(12)).reshape(-1), slope


def conditions_of(model: Model, wanted: list[Wanted], conditions: Mapping[Any, float], points: Mapping[str, Place] | None,
                  stays: Array) -> list[Condition]:
    """Return conditions for quantities of `path_stops.wanted_of`, each as it was asked for. Raises SceneError: one of them has no
    derivative, or is the arc length of a slider that stays."""
    out = []
    for what, one in zip(conditions, wanted):
        at, axis, slider, size, part = None, -1, -1, model.length, ""
        if isinstance(what, str):
            slider = model.names["sliders"].index(what)
            if stays[slider]:
                raise SceneError(f"find_lengths, conditions: slider {what!r} is locked, so its arc length cannot change; unlock "
                                 "it")
        elif callable(what):
            raise SceneError(f"find_lengths, conditions: {one.label} is a function, whose derivative is not known; use "
                             "coordinates, section forces or arc lengths of sliders")
        elif what[1] in AXES:
            at, axis = PointSeries(model, (), {what[0]: (points or {})[what[0]]}), AXES.index(what[1])
        else:
            part = what[1]
            size = float(one.section.stiffness[0, 0]) * (model.length if part in MOMENTS else 1.0)
        out.append(Condition(one, size, at, axis, slider, part))
    return out


class LengthSolver(Response):
    """Solver for equilibria with conditions, on all unknowns and prestrains of beams; `move_to` leads the conditions from their
    values at the start to the wanted ones.

    start: an equilibrium with the lengths of the scene.
    max_iterations, held, backend, at_time, factors: as `Response`.
    conditions: as many as beams.
    """

    def __init__(self, unknown: Lengths, start: State, max_iterations: int, held: Array, backend: str, at_time: float,
                 factors: Array, conditions: list[Condition]) -> None:
        plane = unknown.model.plane
        self.unknown, self.conditions = unknown, conditions
        self.change = np.zeros(len(unknown.beams))
        unknown.strains.watch([condition.wanted.section for condition in conditions])
        super().__init__(unknown.model, start, held, plane is not None and plane.holds(start), backend, at_time, factors, 1.0,
                         unknown.strains)
        # conditions are at the start
        self.part, self.may_leap = 0.0, False
        self.max_iterations = max_iterations
        self._of_lengths = factoriser_for(backend, threads=1)
        self.begun = self.values()
        self.asked = np.array([condition.wanted.value for condition in conditions])

    @property
    def name(self) -> str:
        """Linear solver and its number of factorisations, for the result."""
        return solver_name(self._of_lengths, "nodes and lengths")

    @property
    def prestrains(self) -> Array:
        """Present prestrains of the beams [m]."""
        return self.unknown.first + self.change

    def values(self) -> Array:
        """Return the values of the quantities of all conditions [m]."""
        state = self.state
        return np.array([condition.wanted.of(state) for condition in self.conditions])

    def move_to(self, share: float) -> None:
        """Set the part of their path that conditions have gone at the next equilibrium. Supports and prescribed joints stay."""
        super().move_to(1.0)
        self.part = share

    def _put(self, change: Array) -> None:
        """Set these changes of the prestrains of beams [m], and the weights that depend on them."""
        self.unknown.put(change)
        if self.unknown.weighs:
            self._load(self.factors)
            self._loads[:] = self.work.f_ext

    def bordered(self) -> tuple[Saddle, Array, Array, Any, Array]:
        """Assemble the tangent [n, n], the residual [n], its derivatives by the prestrains [n, m], and those of the conditions by
        the unknowns [m, n] and by the prestrains [m, m]."""
        saddle, right = self.linearised()
        m = self.change.size
        state, outer = self.state, self.work.f_ext - self._loads
        values = self.values()
        push, direct = np.zeros((right.size, m)), np.zeros((m, m))
        in_sections = [j for j, condition in enumerate(self.conditions) if condition.wanted.section is not None]
        for k in range(m):
            push[:, k] = self._push(k, right, outer)
            for j in in_sections:
                direct[j, k] = self.conditions[j].wanted.of(state) - values[j]
        self._put(self.change)
        by = sparse.vstack([condition.slope(self.unknown.model, state) for condition in self.conditions]) @ self.lift()
        by.sort_indices()
        slopes = sparse.hstack((by, sparse.csr_matrix((m, right.size - by.shape[1]))), format="csr")
        return saddle, right, push, slopes, direct

    def _push(self, k: int, right: Array, outer: Array) -> Array:
        """Return the derivative of the residual [n] by prestrain k, which is then 1 larger; right: the residual; outer: forces on
        nodes besides loads."""
        found, ends = np.zeros(right.size), []
        # equations of nodes are linear in prestrains and weights, sliding equations of moving elements quadratic
        for by in (-1.0, 1.0)[not self.unknown.strains.of_moving:]:
            more = self.change.copy()
            more[k] += by
            self._put(more)
            if self.unknown.strains.of_moving:
                ends.append(self.unbalanced())
                continue
            self.work.f_ext[:] = self._loads + outer
            self.stepper.parts.assemble(0.0)
            after = self.core.rows_in(self.work.r).reshape(-1)
            found[:after.size] = -right[:after.size] - after
        return 0.5 * (ends[1] - ends[0]) if ends else found

    def influence(self) -> tuple[Array, Array] | None:
        """Return derivatives of all conditions by all prestrains at the present equilibrium, each in sizes of its quantity [m,
        m], and how much the scene moves with every prestrain [m]; None where the tangent is singular without conditions, and
        prestrains push along motions without stiffness."""
        saddle, _, push, slopes, direct = self.bordered()
        columns = []
        for k in range(push.shape[1]):
            x = saddle.solve(push[:, k])
            # beams may spin
            if x is None or saddle.unbalanced > UNBALANCED * np.linalg.norm(saddle.row * push[:, k]):
                return None
            columns.append(x)
        found = direct + slopes @ np.stack(columns, axis=1)
        size = np.array([condition.size for condition in self.conditions])
        return np.asarray(found / size[:, None]), np.array([self.size_of(x) for x in columns])

    def equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        before, change = self._saved(), self.change.copy()
        self.stepper.forget_failures()
        status, sizes = NOT_CONVERGED, list[float]()
        try:
            status, sizes = self._find()
        finally:
            if status != OK:
                self._restore(before)
                self.change = change
                self._put(change)
        self.longest = len(sizes)
        return status, sizes

    def _find(self) -> tuple[int, list[float]]:
        """Iterate by Newton's method for the conditions of the present share of their way."""
        self.runaway = self.stuck = -1
        wanted = self.begun + self.part * (self.asked - self.begun) if self.part < 1.0 else self.asked
        ways: list[Array] = []

        def increment() -> tuple[int, float | None]:
            x = self._solved(wanted - self.values())
            if x is None:
                return self.no_increment, None
            change = self.change + x[self.unknowns:]
            prestrains = self.unknown.first + change
            if self._size(x[:self.nodes]) > LONGEST or np.any((prestrains < LEAST) | (prestrains > MOST)):
                return NOT_CONVERGED, None
            if self.beyond_ends(self.stepper.core_state.s + x[self.places]):
                return NOT_CONVERGED, None
            ways.append(x)
            self.change = change
            self._put(change)
            moved = self.move(x[:self.unknowns])
            return OK, moved + float(np.max(np.abs(x[self.unknowns:])))

        status, sizes = newton_loop(increment, self.max_iterations, self.interrupted)
        if status != OK:
            return status, sizes
        # further off than conditions that are nearly linear lead: another equilibrium
        gone = np.sum(ways, axis=0)
        if self._extent(gone - ways[0]) > max(STRAY * self._extent(ways[0]), LEAST_STRAY):
            if not self.may_leap or Resolution(self.unknown.model).is_folded(self.state.q):
                return NOT_CONVERGED, sizes
            self.leaps.append((self.part, self._extent(gone)))
        return OK, sizes

    def _extent(self, x: Array) -> float:
        """Return the largest motion, in sizes of the scene and rad, and change of a prestrain among all unknowns [n + m]."""
        return self.size_of(x) + float(np.max(np.abs(x[self.unknowns:])))

    def _solved(self, off: Array) -> Array | None:
        """Solve for increments of all unknowns and prestrains [n + m], conditions being off by so much [m]; None where there are
        none."""
        saddle, right, push, slopes, direct = self.bordered()
        m = off.size
        whole = Saddle(sparse.bmat([[saddle.matrix, sparse.csr_matrix(-push)], [slopes, sparse.csr_matrix(direct)]]).tocsr(),
                       np.append(saddle.multiplier, np.ones(m, bool)), self._of_lengths)
        x = whole.solve(np.append(right, off))
        if x is None or not np.isfinite(x).all():
            return None
        if whole.unbalanced:
            noise = np.zeros(x.size)
            noise[:self.nodes] = self._round_off(saddle)
            noise[-m:] = [UNBALANCED * condition.size for condition in self.conditions]
            if whole.unbalanced > np.linalg.norm(whole.row * noise):
                return None
        return x
