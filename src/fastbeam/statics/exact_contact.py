"""Equilibria whose contacts are element ends, because the shape inside an element cannot have a kink (theory.md 8).

The equilibrium on the mesh as it is comes first. Then the beams are cut at their contacts, with everything held where it is; the
force along the beam is the derivative of the energy by the place of that element end, and contacts that are free go with Newton's
method to where it vanishes.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.compile import Variant, compile_scene
from fastbeam.compile.cut_beams import Acting, Along, Cut, energy_along
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.contact.slider_forces import INCREMENT, POSITION
from fastbeam.kernels.loop import NOT_CONVERGED, OK, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.model.mapping import follow
from fastbeam.model.model import Model
from fastbeam.results.observe.observer import Observer
from fastbeam.statics.equilibrium import Counts
from fastbeam.statics.reactions import reactions_of
from fastbeam.statics.slider_friction import ALONG_ONLY
from fastbeam.statics.sliding import ROUNDS, TO_END, SlidingSolver
from fastbeam.stepping.assembled import Equations

Array = np.ndarray
# Newton's method on the places ends with increments below this share of a beam; the next one would be its square
CLOSE = 1e-7
# most increments, and smallest share to which an increment is shortened, before the method gives up
MOST, LEAST_SHARE = 60, 1e-6
# a contact moves by this share of its beam at once
REACH = 0.1
# eigenvalues of the second derivatives by the places that are round-off, next to the largest
FLAT = 1e-9
# step of differences by the place of a contact, as a share of the shorter element beside it
BEND_STEP = 5e-5
# share of the largest contact force that is round-off along a beam
NOISE = 1e-13


class Observed(NamedTuple):
    """Quantities and points that rows hold."""

    kinds: tuple[str, ...]
    points: Mapping[str, Any]


class Found(NamedTuple):
    """An equilibrium with cut beams."""

    cut: Cut
    solver: SlidingSolver
    slope: Array  # float64 [S], N: derivatives of the energy by s; NaN where it has none
    bend: Array   # float64 [F, F], N/m: second ones with all nodes in equilibrium, by the s of the contacts that are free
    ahead: list[Array]      # increments with which nodes and forces follow the s of each of these
    stretch: Array  # float64 [S]: length of the derivative of the axis by s, mean of both sides; NaN where there is no slope


class ExactSolver(SlidingSolver):
    """Solver for equilibria with beams cut at their contacts. `state` is the equilibrium on the given mesh with all sliders held
    exactly where they are, from which a run can start; `found` has the exact one. Raises SceneError: a slider has a type that is
    not supported."""

    def __init__(self, model: Model, start: State | None, max_iterations: int, held: Array, backend: str = "auto",
                 at_time: float = 0.0) -> None:
        super().__init__(model, start, max_iterations, held, backend=backend, at_time=at_time)
        assert isinstance(model.uneliminated, Variant)
        self.scene, self.backend, self.at_time = model.uneliminated.scene, backend, at_time
        self.found: Found | None = None
        self.why_stuck = ""

    # --- the equilibrium ----------------------------------------------------------------------------------------------
    def _equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        status, sizes = super()._equilibrium(factors)
        if status != OK:
            return status, sizes
        status, more = self._sharpened(factors)
        sizes += more
        if status != OK:
            return status, sizes
        # on the given mesh, held where the contacts are
        assert self.found is not None
        self._take(self.shown)
        if self.along is not None:
            self.along.remember(self.stepper.core_state.history)
        status, more = self._newton(np.zeros(self.held.size, bool))
        self.longest = max(self.longest, len(more))
        return status, sizes + more

    def _sharpened(self, factors: Array) -> tuple[int, list[float]]:
        """Find the equilibrium with cut beams, and which contacts stick, slip and rest at stops in it."""
        at = self.state
        cut = self.found.cut if self.found is not None and np.array_equal(at.s, self.found.cut.s) else Cut(self.scene, at.s)
        solver = self._open(cut, at)
        status, sizes = solver.equilibrium(factors)
        if status != OK:
            return status, sizes
        found = self._looked_at(cut, solver, factors, np.flatnonzero(self.sliding))
        if found is None:
            return NOT_CONVERGED, sizes
        for _ in range(ROUNDS * (self.held.size + 1)):
            status, found = self._slid(found, factors)
            if status != OK or self.along is None:
                break
            changed, s = self.along.judge(self._exact_equations(found), found.cut.s)
            if self.along.in_circles:
                return NOT_CONVERGED, sizes
            if not changed:
                break
            free = np.flatnonzero(self.sliding)
            way = s - found.cut.s
            moved = self._moved(found._replace(ahead=[]), s, np.zeros(0), factors, free) if np.any(way) else (
                self._looked_at(found.cut, found.solver, factors, free))
            if moved is None:
                return NOT_CONVERGED, sizes
            found = moved
        else:
            return NOT_CONVERGED, sizes
        if status == OK:
            self.found = found
        return status, sizes

    def _slid(self, found: Found, factors: Array) -> tuple[int, Found]:
        """Move free contacts by Newton's method until nothing pushes them along their beams beyond their full friction; return a
        status and the equilibrium."""
        free, cut, share = np.flatnonzero(self.sliding), found.cut, 1.0
        for _ in range(MOST):
            if not free.size:
                return OK, found
            self.interrupts.serve()
            push = self._push(found, free)
            if np.isnan(push).any():
                return self._no_slope(cut, free), found
            way = self._way(found, free, push)
            if way is None:
                return SLIDER_END, found
            close = float(np.max(np.abs(way) / self.lengths[free])) < CLOSE
            s, met = cut.s.copy(), np.zeros(cut.s.size, np.int64)
            s[free] += share * way
            if self.along is not None:
                every = s - cut.s
                met = self.along.meets(cut.s, every, every)
            after = self._moved(found, s, share * way, factors, free)
            if after is not None and (close or self._push(after, free) @ way <= 0.9 * abs(push @ way)):
                found, share = after, min(1.0, 2.0 * share)
                cut = found.cut
                if met.any():
                    assert self.along is not None
                    self.along.meet(met, cut.s)
                    free = np.flatnonzero(self.sliding)
                    looked = self._looked_at(cut, found.solver, factors, free)
                    if looked is None:
                        return NOT_CONVERGED, found
                    found = looked
                    continue
                if close:
                    return OK, found
                continue
            share *= 0.25
            if share < LEAST_SHARE:
                return NOT_CONVERGED, found
        return NOT_CONVERGED, found

    # --- friction -----------------------------------------------------------------------------------------------------
    def _normal(self, found: Found) -> tuple[Array, Array]:
        """Return the normal forces of contacts times the length of the derivative of the axis, N [S], and the contact forces, [S,
        d]. The part along the beam drives the contact: the axis has a kink there, and no tangent."""
        core = found.solver.core
        force = found.solver.stepper.core_state.force[:core.dim * self.held.size].reshape(-1, core.dim)
        size = found.stretch * np.linalg.norm(force, axis=1)
        return np.sqrt(np.maximum(size**2 - found.slope**2, (ALONG_ONLY * size)**2)), force

    def _exact_equations(self, found: Found) -> Equations:
        """Return the equations that friction and stops are compared with; those of the elements where a contact has no slope."""
        assert self.along is not None
        own, normal = found.solver._of_constraints(rubs=False), self._normal(found)[0]
        known, has = self.along.known(found.cut.s)[0], np.isfinite(found.slope)
        # in the cut scene all are held: drives and stops are in none of its equations
        push = own.sliding + found.solver.along.known(found.cut.s)[0] - known  # type: ignore[union-attr]
        return own._replace(sliding=np.where(has, found.slope - known, push), normal=np.where(has, normal, own.normal))

    def _no_slope(self, cut: Cut, free: Array) -> int:
        """Note why a contact has no slope: it came to a node that other parts refer to, to another contact or to an end. Return
        SLIDER_END."""
        names = self.stepper.model.names["sliders"]
        for k in free.tolist():
            slot = next(x for x in cut.slots[cut.places[k].beam] if k in x.contacts)
            if slot.stays or len(slot.contacts) > 1:
                self.stuck, self.last_s = k, cut.s.copy()
                other = [names[j] for j in slot.contacts if j != k]
                what = f"slider {other[0]!r}" if other else "an end of its beam, or a node that other parts refer to"
                self.why_stuck = (f"slider {names[k]!r} is at the same place as {what}, at s = {cut.s[k]:.6g} m, where the force "
                                  f"along the beam is not uniquely defined. Lock it (held=({names[k]!r},)), or use "
                                  "contacts='mesh'")
        return SLIDER_END

    def _push(self, found: Found, free: Array) -> Array:
        """Return the forces that move contacts back along their beams, N: slopes of the energy less drives, elastic stops and
        friction."""
        push = found.slope[free]
        if self.along is None:
            return push
        slip = self.along.slip[free]
        rub = np.where(slip != 0.0, slip * self._normal(found)[0][free], 0.0)
        return np.asarray(push - self.along.known(found.cut.s)[0][free] + rub)

    def _newton_increments(self, found: Found, free: Array, push: Array, bend: Array) -> Array:
        """Return Newton's increments of the free s [F] where some slip with friction; bend: without it."""
        assert self.along is not None
        slip, (normal, force) = self.along.slip[free], self._normal(found)
        first = found.solver.places.stop
        ahead = np.array([x[first:first + force.size].reshape(force.shape)[free] for x in found.ahead])
        change = found.stretch[free, None]**2 * np.einsum("fd,jfd->fj", force[free], ahead) - found.slope[free, None] * found.bend
        return np.linalg.solve(bend + slip[:, None] * change / normal[free, None], -push)

    def _way(self, found: Found, free: Array, push: Array) -> Array | None:
        """Return increments of the free s [F], downhill; None where a contact runs off its beam."""
        bend = found.bend if self.along is None else found.bend - np.diag(self.along.known(found.cut.s)[1][free])
        size, axes = np.linalg.eigh(bend)
        along = axes.T @ push
        # contacts stay where only round-off pushes; on a ridge they go downhill
        force = float(np.max(np.abs(found.solver.state.force), initial=0.0))
        least = max(FLAT * float(np.max(np.abs(size))), NOISE * force / float(np.max(self.lengths)), 1e-300)
        way = -axes @ np.where(np.abs(along) <= NOISE * force, 0.0, along / np.maximum(np.abs(size), least))
        rigid = np.zeros(free.size, bool)
        if self.along is not None:
            if np.any(self.along.slip[free] != 0.0):
                way = self._newton_increments(found, free, push, bend)
            every = np.zeros(self.held.size)
            every[free] = way
            rigid = self.along.is_rigid(every)[free]
        s, ends = found.cut.s[free], self.ends[free]
        to_end = np.where(way > 0.0, ends[:, 1] - s, s - ends[:, 0])
        if np.any((to_end <= CLOSE * self.lengths[free]) & (np.abs(way) > to_end) & ~rigid):
            self.runaway = int(free[np.argmax(np.where(rigid, -np.inf, np.abs(way) - to_end))])
            return None
        most = np.minimum(REACH * self.lengths[free], np.where(rigid, 1.0, TO_END) * to_end)
        return np.asarray(way * min(1.0, float(np.min(most / np.maximum(np.abs(way), 1e-300)))))

    def _moved(self, found: Found, s: Array, way: Array, factors: Array, free: Array) -> Found | None:
        """Find the equilibrium with contacts at s [S]; None where there is none near."""
        cut = Cut(self.scene, s, found.cut)
        before = found.solver
        if cut.same_mesh and way.size:
            # nodes go with the contacts
            saved = before._saved()
            before.move(np.asarray(sum(w * x for w, x in zip(way, found.ahead))))
            at = before.stepper.copy_state()
            before._restore(saved)
        else:
            at = self._given(found)
        at.s[:] = s
        solver = self._open(cut, at, cut.same_mesh and way.size > 0)
        try:
            status, _ = solver.equilibrium(factors)
        except FloatingPointError:
            return None
        return self._looked_at(cut, solver, factors, free) if status == OK else None

    def _open(self, cut: Cut, at: State, on_cut: bool = False) -> SlidingSolver:
        """Make a solver with everything held where it is; at: a state of the given mesh, or of the cut one."""
        flat = self.stepper.plane is not None
        model = self._compiled(cut, flat)
        start = model.state()
        q = start.q.reshape(-1, 4, 3)
        if on_cut:
            q[:] = at.q.reshape(-1, 4, 3)
        else:
            cut.carry(at.q.reshape(-1, 4, 3), self.stepper.model.numbers, model.numbers, q)
            q[:] = follow(model, q)
        start.v[:], start.s[:], start.force[:] = 0.0, cut.s, at.force
        solver = SlidingSolver(model, start, self.max_iterations, np.ones(self.held.size, bool), flat, self.backend, self.at_time)
        solver.interrupts = self.interrupts
        t, factor = (float(x) for x in self.stepper.law_work[:2])
        solver.set_time(t, factor)
        solver.move_to(1.0)
        solver.constraints.given = self.constraints.given
        return solver

    def _compiled(self, cut: Cut, flat: bool) -> Model:
        if cut.model is None:
            cut.model = compile_scene(cut.scene, planar=flat, solver="sparse", eliminate_inner=False, condense=False)
            assert isinstance(cut.model.uneliminated, Variant)
            cut.model.uneliminated.know(cut.model, planar=flat)
        return cut.model

    def _looked_at(self, cut: Cut, solver: SlidingSolver, factors: Array, free: Array) -> Found | None:
        """Evaluate slopes at an equilibrium, and second derivatives by the free contacts; None where its tangent is singular."""
        model, q = solver.stepper.model, solver.state.q
        acting = self._acting(cut, factors)
        along = energy_along(cut, model.numbers, acting, q.reshape(-1, 4, 3))
        self._less_contact_forces(solver, along)
        stretch = np.where(np.isfinite(along.slope), np.linalg.norm(along.way[:, 0], axis=1), np.nan)
        if not free.size:
            return Found(cut, solver, along.slope, np.zeros((0, 0)), [], stretch)
        saddle, right = solver._assembled(np.zeros(self.held.size, bool))
        # derivatives of the forces on the unknowns of the rows by the free s, [F, m]
        by = (sparse.csr_matrix(along.forces[free]) @ solver.map.rates(solver.state.q)).toarray()
        bend, ahead = along.bend[np.ix_(free, free)], []
        for row in by:
            right[:] = 0.0
            right[:solver.nodes] = -row
            x = saddle.solve(right)
            if x is None or not np.isfinite(x).all():
                return None
            x[solver.places] = 0.0
            ahead.append(x)
        bend = bend + by @ np.array([x[:solver.nodes] for x in ahead]).T
        for i, k in enumerate(free):
            if along.node[k] >= 0:
                bend[i, i] = self._bend(cut, solver, acting, int(k), ahead[i])
        return Found(cut, solver, along.slope, 0.5 * (bend + bend.T), ahead, stretch)

    def _bend(self, cut: Cut, solver: SlidingSolver, acting: dict[Any, Acting], k: int, ahead: Array) -> float:
        """Return the derivative of the slope of contact k by its place, with all nodes in equilibrium: a difference along the way
        that they take, because in the sum of derivatives that of the normal force of a stiff beam is left as round-off."""
        step, saved, slope = BEND_STEP * cut.length_at(k), solver._saved(), []
        for way in (step, -step):
            solver.move(way * ahead)
            there = energy_along(cut.shifted(k, way), solver.stepper.model.numbers, acting, solver.state.q.reshape(-1, 4, 3), k)
            self._less_contact_forces(solver, there)
            slope.append(float(there.slope[k]))
            solver._restore(saved)
        return (slope[0] - slope[1]) / (2.0 * step)

    def _less_contact_forces(self, solver: SlidingSolver, along: Along) -> None:
        """Take the work of the contact forces on the nodes of the contacts from the slopes."""
        axes, loads = solver.map.axes, solver.constraints.at().loads.reshape(-1, 8)
        for k in np.flatnonzero(along.node >= 0):
            row = loads[solver.core.pattern.row_of[along.node[k]]]
            way = along.way[k].reshape(-1)
            if axes is not None:
                way = np.concatenate((axes[:2] @ way[:3], axes[2:] @ way[3:]))
            along.slope[k] -= float(row[:way.size] @ way)

    def _acting(self, cut: Cut, factors: Array) -> dict[Any, Acting]:
        """Return weights and distributed loads of the beams with contacts at load factors [K]."""
        model, scene = self.stepper.model, self.scene

        def factor(time: Any) -> float:
            return next((float(x) for x, known in zip(factors, model.load_times) if known is time), 0.0)

        weight = factor(scene.gravity_time) * np.asarray(scene.gravity) if np.any(scene.gravity) else np.zeros(3)
        return {beam: Acting(beam.section.inertia[0] * weight, tuple((load, factor(load.time)) for load in scene.distributed
                                                                  if load.beam is beam)) for beam in cut.slots}

    # --- on the given mesh --------------------------------------------------------------------------------------------
    @property
    def shown(self) -> State:
        """The exact equilibrium at the nodes of the given mesh."""
        assert self.found is not None
        return self._given(self.found)

    def _given(self, found: Found) -> State:
        model, other = self.stepper.model, found.solver
        out = self.stepper.copy_state()
        q = out.q.reshape(-1, 4, 3)
        found.cut.bring_back(other.state.q.reshape(-1, 4, 3), other.stepper.model.numbers, model.numbers, q)
        q[:] = follow(model, q)
        out.s[:], out.force[:] = found.cut.s, other.state.force
        return out

    def _take(self, state: State) -> None:
        """Go on from a state in space."""
        plane, own = self.stepper.plane, self.stepper.core_state
        for mine, x in zip(own, state if plane is None else plane.reduce(state)):
            mine[:] = x

    # --- what a result has --------------------------------------------------------------------------------------------
    def signs(self, factors: Array, in_plane: bool) -> Counts | None:
        found = self.found
        assert found is not None
        counted = found.solver.signs(factors, in_plane)
        if counted is None or not found.bend.size:
            return counted
        bend = found.bend
        if self.along is not None:
            # where friction holds a contact, it stays
            moves = self._unhindered[self.sliding]
            bend = (bend - np.diag(self.along.known(found.cut.s)[1][self.sliding]))[np.ix_(moves, moves)]
            if not bend.size:
                return counted
        size = np.linalg.eigvalsh(bend)
        least = FLAT * float(np.max(np.abs(size)))
        return counted._replace(unstable=counted.unstable + int(np.sum(size < -least)),
                                free=counted.free + int(np.sum(np.abs(size) <= least)))

    def row(self, observed: Observed, t: float, factors: Array, share: float) -> dict[str, Any]:
        """Return the row of the result at time t, s, under load factors [K]; share: the load factor."""
        found = self.found
        assert found is not None
        solver, model = found.solver, found.solver.stepper.model
        observer = Observer(model, observed.kinds, {name: found.cut.point(what) for name, what in observed.points.items()})
        row = observer.row(t, solver.state)
        if observer.needs_forces:
            asked = reactions_of(solver, observer)
            reactions = () if asked is None else asked.at(factors, solver.state)
            observer.add_forces(row, np.concatenate((solver.state.force, reactions)), share)
        if "force_along" in row:
            # the curve has a kink at the contact
            table = self.stepper.model.slider_forces.tables
            more = np.where(np.isnan(found.slope), 0.0, found.slope - row["force_along"])
            row["force_along"] = row["force_along"] + more
            given = np.isin(table.drive, (POSITION, INCREMENT))
            row["drive_force"] = row["drive_force"] + np.where(given, more, 0.0)
            row["lock_force"] = row["lock_force"] + np.where(given, 0.0, np.where(self.held, more, 0.0))
            if self.along is not None:
                self._share_out(row, found)
        return row

    def _share_out(self, row: dict[str, Any], found: Found) -> None:
        """Split the force along the beam that drives and elastic stops leave into friction and force of rigid stops."""
        assert self.along is not None
        at_stop, exact = self.along.modes.at_stop != 0, self._exact_equations(found)
        most = self.along.friction * exact.normal
        friction = np.where(at_stop, np.clip(exact.sliding, -most, most), exact.sliding)
        row["friction_force"] = np.where(self.along.rubs, friction, row["friction_force"])
        stop = exact.sliding - np.where(self.along.rubs, friction, 0.0)
        row["stop_force"] = np.where(at_stop, stop, row["stop_force"])

    def _without_friction(self) -> Equations:
        assert self.found is not None
        return self._exact_equations(self.found)

    def _stick_interval(self, k: int, factors: Array) -> tuple[float, float]:
        accepted, on_mesh = self.found, super()._stick_interval(k, factors)
        assert accepted is not None

        def slide(sign: int) -> tuple[int, float]:
            end = on_mesh[int(sign < 0)]
            if not np.isfinite(end) or end == self.ends[k, int(sign < 0)]:
                # it does not slip before the end of its beam
                return OK, end
            s, free = accepted.cut.s.copy(), np.flatnonzero(self.sliding)
            s[k] = end
            looked = self._moved(accepted._replace(ahead=[]), s, np.zeros(0), factors, free)
            if looked is None:
                looked = self._looked_at(accepted.cut, accepted.solver, factors, free)
            status, found = (NOT_CONVERGED, accepted) if looked is None else self._slid(looked, factors)
            return status, float(found.cut.s[k])

        return self._where_slip_ends(k, slide)

    def forces_along(self) -> dict[str, float]:
        """Return the forces that hold sliders in their places along their beams, N, by name."""
        assert self.found is not None
        return {name: float(x) for name, x in zip(self.stepper.model.names["sliders"], self.found.slope)}
