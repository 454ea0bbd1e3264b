"""Forces and moments of supports and joints: the residual of the equations of the nodes without them (theory.md 4.2)."""
from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import ADDED, ASSEMBLY, Calls, SystemRecord, system_record
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.kernels.empty_arrays import aligned_empty
from fastbeam.kernels.forces.drag import Drag
from fastbeam.kernels.joints.conditions import JointConditions
from fastbeam.kernels.joints.coordinates import JointMotion
from fastbeam.kernels.loop import OK
from fastbeam.kernels.state import State
from fastbeam.kernels.terms import Conserving, Equilibrium, System
from fastbeam.linalg.factors import LU, lu
from fastbeam.model.connections import fixed_axes
from fastbeam.model.contact.sleeve_twist import with_known_twist
from fastbeam.model.feature import OfRun
from fastbeam.model.forces.damping_and_drag import COEFFICIENTS
from fastbeam.model.forces.loads import load_factors
from fastbeam.model.forces.user_forces import ON_NODES
from fastbeam.model.joints.constraints import ConstrainedJoint, Distance
from fastbeam.model.released_supports import OwnSupports
from fastbeam.results.observe.resultants import Sections
from fastbeam.results.observe.section_balance import FreeBodies
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper
from fastbeam.stepping.terms import system_of, terms_of

Array = np.ndarray


class Reactions:
    """Forces [R, 3] and moments [R, 3] of all supports, eliminated joints and joints with multipliers, from the equations of the
    nodes as they stand without them, and of sections of beams (section_balance.py).

    Forces of supports act on what they hold, those of joints on side b, those of sections on the part before them. Moments are
    about the node of the support, for joints about that of side a, for sections about these, N and N m.

    stepper: stepper with the conserving step, or in statics; its state is left alone.
    """

    def __init__(self, stepper: Stepper, static: bool = False, sections: Sequence[Sections | None] = ()) -> None:
        self.stepper = stepper
        self.own = stepper if stepper.pivots_everywhere else stepper.fallback
        core = self.own.core
        self.holding = holding = stepper.model.holding
        held = core.static_held if static else core.held
        of = self.own if static else stepper
        # supports that move are not among the terms, because their forces are wanted
        arrays = {"slider_forces": of.along, "motions": self.own.motion, "moving": of.own.get("moving")}
        terms = terms_of(OfRun(core, static, None, arrays, of.law_work, known=True))
        running = {type(term): term for term in of.terms}
        known = with_known_twist(tuple(_as_running(term, running.get(type(term))) for term in terms), of.terms)
        known = tuple(term for term in known if term is not core.ties and term is not held)
        self.terms = Calls(tuple(_at_nodes(term, core.pattern.row_of) for term in known), ASSEMBLY)
        some = [x for x in sections if x is not None]
        self.bodies = FreeBodies(stepper.model, self.terms.terms, some, stepper.plane, core.pattern.n) if some else None
        self._sliding = Calls(tuple(term for term in self.terms.terms if isinstance(term, Sliding)), ADDED)
        self.ties = None if core.ties is None else Calls((core.ties,), ADDED)
        self._system: SystemRecord | None = None
        names = {name: k for k, name in enumerate(stepper.model.constrained_joint_names)}
        # forces of joints with multipliers between two nodes: joint, link, first multiplier, factor of these
        kept = stepper.model.kept
        begins = 3 * stepper.model.n_sliders + np.cumsum([0, *(link.forces(3) for link in kept)])
        self.links = [(names[one.joint], one, at, factor) for link, at in zip(kept, begins.tolist())
                      for factor, one in link.shares]
        self.rows = core.pattern.row_of
        self.count = len(stepper.model.reaction_names)
        n = len(holding.parent)
        hanging = np.flatnonzero(holding.parent >= 0)
        of_supports = holding.supports
        self._free = self._left_free(None)
        # supports of nodes that another holds already
        self._shared = np.zeros(of_supports.size, bool) if core.ties is None else np.diff(core.ties.start)[of_supports] > 0
        self._below: LU | None = None
        if hanging.size and len(holding.joints):
            # sum of a node = its own + sums of the nodes that hang on it
            children = sparse.coo_matrix((np.ones(hanging.size), (holding.parent[hanging], hanging)), shape=(n, n))
            self._below = lu(sparse.identity(n) - children, {"permc_spec": "NATURAL", "diag_pivot_thresh": 0.0})

    @property
    def size(self) -> int:
        """Number of values of one evaluation."""
        return 6 * (self.count + (0 if self.bodies is None else len(self.bodies.sections)))

    def _left_free(self, state: State | None) -> tuple[Array, Array]:
        """Return which supports turn freely, [S], and axes along which supports do not hold, [S, 3]; state: given where that
        changes in a run."""
        holding = self.holding
        masks = holding.masks.copy()
        turns_freely = self.stepper.model.fixed_in(state)[holding.supports] & 56 == 0
        if state is not None:
            # forces of supports that do not hold are round-off
            masks[self.own.core.released.reaction[self.own.supports.off(state)]] = 0
            turns_freely |= masks == 0
        return turns_freely, ~fixed_axes(masks)

    def of_step(self, before: State, middle: Array, second: Array, t: float, h: float) -> Array:
        """Return means over the step that the stepper has just taken, [6 (R + C)].

        before: state at the begin of the step, as the tables of the run have it.
        middle, second: float64 [N, 4, 3], coordinates in its middle, and their mean second rates.
        t, h: begin and size of the step, s.
        """
        own = self.own
        factors = np.ones(len(own.model.load_times))
        if any(time is not None for time in own.model.load_times):
            factors = load_factors(own.model, np.full(1, t), np.full(1, h))[0]
            kernels.external_forces(own.core.loads, factors, own.work.f_ext)
        if own.motion is not None:
            own.motion.follow(self.stepper.motion)
        state = before._replace(force=own.core_state.force)
        system = system_of(own.core, Conserving(), own.contact, None, state, own.work)
        return self._evaluate(system, middle, h, factors, second)

    def of_equilibrium(self, q: Array, factors: Array, second: Array | None = None) -> Array:
        """Return reactions [6 (R + C)] of the equilibrium at q [N, 4, 3] whose loads, with factors [K], are in `work.f_ext`;
        second: as in `FreeBodies.forces`."""
        return self._evaluate(self._at_rest, q, 0.0, factors, second)

    @cached_property
    def _at_rest(self) -> System:
        """Data that all terms share in equilibria."""
        own = self.own
        return system_of(own.core, Equilibrium(), own.contact, None, own.core_state, own.work)

    def _of_slider(self, k: int, system: Any) -> Array:
        """Return the forces that slider k exerts on nodes in the step, [N, 8]; nodes that share a row are kept apart."""
        n = len(self.rows)
        first = np.full_like(system.contact.first, -1)
        first[k] = self.own.contact.first[k]
        work = system.work._replace(r=aligned_empty(8 * (n + 1)))
        alone = system._replace(contact=system.contact._replace(first=first), work=work, row_of=np.arange(n))
        one = SystemRecord(alone, ADDED)
        kernels.assemble_some(*self._sliding.on(one), 0.0)
        return -work.r[:8 * n].reshape(-1, 8)

    def _evaluate(self, system: Any, q: Array, h: float, factors: Array, second: Array | None) -> Array:
        holding, x = self.holding, q[:, 0]
        self._system = system_record(system, self._system, ASSEMBLY)
        # nodes that share the spin of another turn like it
        theta = self.own.work.theta.reshape(len(x), -1)
        before = theta.copy()
        theta[:] = theta[self.own.model.spin_root]
        kernels.assemble_all(*self.terms.on(self._system), h)
        sections = np.zeros((0, 2, 3))
        if self.bodies is not None:
            sections = self.bodies.forces(system, q, h, factors, second, lambda k: self._of_slider(k, system))
        theta[:] = before
        force, moment = self._rows()
        out = np.full((self.count, 2, 3), np.nan)
        s = len(holding.supports)
        if len(holding.joints):
            out[s:s + len(holding.joints)] = self._joints(force, moment, x)
        if self.ties is not None:
            kernels.assemble_some(*self.ties.on(self._system), h)
            force, moment = self._rows()
        out[:s, 0], out[:s, 1] = force[holding.supports], moment[holding.supports]
        np.add.at(out[:s, 1], holding.turning[:, 0], moment[holding.turning[:, 1]])
        changes = isinstance(self.own.supports, OwnSupports)
        turns_freely, free_axes = self._left_free(self.own.core_state) if changes else self._free
        out[:s, 1][turns_freely] = 0.0
        # along axes that a support leaves free its force is what others at the node do
        out[:s, 0][free_axes] = 0.0
        # nothing tells the shares of what another support holds already
        out[:s][self._shared] = np.nan
        multipliers = self.stepper.state.force if self.links else np.zeros(0)
        kept = out[s + len(holding.joints):]
        kept[:] = 0.0
        for k, link, at, factor in self.links:
            own = factor * multipliers[at:at + link.forces(3)]
            _, (b, by_velocity, by_spin) = link.by_velocities(q[list(link.node)])
            push = by_velocity.T @ own
            if isinstance(link.law, Distance):
                # along the mean of both ends of a step, which is shorter than the joint where this turns (theory.md 4.1)
                push *= np.linalg.norm(x[b] - x[link.node[0]]) / self._length(link)
            kept[k, 0] += push
            kept[k, 1] += by_spin.T @ own + np.cross(x[b] - x[link.node[0]], push)
        return np.concatenate((out, sections)).reshape(-1)

    def _length(self, link: ConstrainedJoint) -> float:
        a, b = (self.stepper.model.q0.reshape(-1, 12)[k, :3] for k in link.node)
        return float(np.linalg.norm(b - a))

    def _rows(self) -> tuple[Array, Array]:
        """Return forces and moments [N, 3] that the equations of the nodes lack."""
        own, plane = self.own, self.stepper.plane
        n = len(self.rows)
        r = own.work.r[:8 * (n + 1)].reshape(-1, 8)[self.rows]
        if plane is None:
            return r[:, :3], r[:, 3:6]
        return r[:, :2] @ plane.axes[:2], r[:, 2:3] * plane.axes[2]

    def _joints(self, force: Array, moment: Array, x: Array) -> Array:
        """Return forces and moments of joints [J, 2, 3] on side b, about side a."""
        holding = self.holding
        a, b = holding.joints.T
        total = self._below.solve(np.concatenate((force, moment + np.cross(x, force)), axis=1).T).T
        outward = holding.parent[b] == a
        below = np.where(outward, b, a)
        sign = np.where(outward, 1.0, -1.0)[:, None]
        on_b = sign * total[below, :3]
        out = np.stack((on_b, sign * total[below, 3:] - np.cross(x[a], on_b)), axis=1)
        out[~(holding.determined[a] & (outward | (holding.parent[a] == b)))] = np.nan
        return out


def _at_nodes(term: Any, row_of: Array) -> Any:
    """Return a term whose moments act on the nodes themselves, not on those that connections let their spins belong to:
    connections have to carry them."""
    if isinstance(term, Sliding):
        return term._replace(sliders=term.sliders._replace(spin_root=np.arange(term.sliders.spin_root.size)))
    if isinstance(term, JointConditions):
        return term._replace(row=row_of[term.node], spin_row=row_of[term.node])
    motion = getattr(term, "motion", None)
    if isinstance(motion, JointMotion):
        return term._replace(motion=motion._replace(row=row_of[motion.node]))
    return term


def _as_running(term: Any, run: Any) -> Any:
    """Return a term with the air, the curves of sliders, or the shares of loads by laws, of the run. Rows and blocks stay its
    own: those of the run are others where it eliminates inner nodes."""
    if isinstance(term, Drag):
        return term._replace(**{name: getattr(run, name) for name in (*COEFFICIENTS, "air", "wind")})
    if isinstance(term, Sliding):
        # over corners of switches sliders have other curves
        return term._replace(sliders=term.sliders._replace(curve=run.sliders.curve), limits=run.limits, sleeves=run.sleeves)
    return term._replace(share=run.share, work=run.work) if isinstance(term, ON_NODES) else term


class ReactingStepper(Stepper):
    """A stepper whose outcomes hold forces and moments of supports, joints and sections behind those of constraints."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        if self.method.name != "energy_momentum":
            raise SceneError("observe: reactions are available for the conserving step only; leave out method, or 'reaction'")
        if self.weights.size > 1:
            raise SceneError("observe: with order=4 reactions are extrapolated from two runs, which friction, rigid stops, force "
                             "limits of drives, switches, locks and released supports do not allow (theory.md 6); use order=2, "
                             "or leave out 'reaction'")
        self.reactions = Reactions(self)

    def cut(self, sections: Sequence[Sections | None]) -> None:
        """Set the sections whose forces are asked for, before the first step."""
        self.reactions = Reactions(self, sections=sections)

    @property
    def recorded(self) -> int:
        return super().recorded + self.reactions.size

    def advance(self, t: float, h: float, n: int, done: int = 0) -> Outcome:
        result = None
        for k in range(n):
            before, (q, v) = State(*(y.copy() for y in self.core_state)), self._coordinates_and_rates()
            one = super().advance(t, h, 1, done + k)
            found = np.zeros((2, self.reactions.size))
            if one.steps:
                end = self._coordinates_and_rates()
                found[:] = self.reactions.of_step(before, 0.5 * (q + end[0]), (end[1] - v) / h, t + h * (done + k), h)
            one.force = np.hstack((one.force, found))
            result = one if result is None else one.after(result)
            if not one.steps or one.status != OK or self.stop():
                break
        assert result is not None
        return result

    def _coordinates_and_rates(self) -> tuple[Array, Array]:
        """Return coordinates and their rates [N, 4, 3], as copies."""
        state = self.state
        return state.q.reshape(-1, 4, 3).copy(), state.v.reshape(-1, 4, 3).copy()
