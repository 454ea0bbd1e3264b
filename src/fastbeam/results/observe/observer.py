"""Observers that turn a state into one row of numbers; quantities that are not asked for are not computed."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface.arguments import Listing, Names, Word
from fastbeam.kernels import energies as kernels
from fastbeam.kernels.contact.slider import RATE
from fastbeam.kernels.contact.slider_forces import HELD, OFF
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.measures import slider_motion, slider_points
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.contact.sleeve_conditions import Section, sections
from fastbeam.model.contact.sleeve_twist import angles, push_of_twist
from fastbeam.model.forces.loads import factor_at
from fastbeam.model.joints.motion import Motions
from fastbeam.model.feature import Feature
from fastbeam.model.model import Model
from fastbeam.model.moving_supports import PrescribedMotions
from fastbeam.model.start import own_state
from fastbeam.model.workspace import ReferenceStrains, contact_of
from fastbeam.results.exchanged import AT_START
from fastbeam.results.observe.points import PointSeries
from fastbeam.results.observe.sums import ANGULAR, LINEAR, Sums
from fastbeam.results.readings import TWISTING
from fastbeam.results.result import ResultHeader
from fastbeam.scene.checks import Place

Array = np.ndarray
KINDS = ("energy", "momentum", "slider", "joint", "spring", "inner", "velocity", "spin", "orientation", "acceleration", "section",
         "reaction")
# series that a scene has without features, points and sliders
ALWAYS = {"iterations", "step_size", "kinetic", "strain", "gravity", "potential", "total", "lin_mom", "ang_mom"}
# a scene that moves less than round-off times this is at rest: it has no scale of its own
CALM = 1e7
EPSILON = float(np.finfo(float).eps)
# share of the size of the scene from which on a start counts as moved
MOVED = 1e-11
OBSERVED = Listing(Word(KINDS), "a sequence of kinds, as in ('energy',)")
POINTS = Names("must map names to nodes, as in points={'tip': beam.end}")


class Observer:
    """Rows of the chosen series.

    points: mapping name -> NodeRef, RigidBody, PointMass or (beam, s); or PointSeries of the same kinds, positions to record, and
        what `PointSeries` has where it is asked for.
    lost: float64 [2], energies that filters of strains have dissipated and store, J, as the stepper keeps them.
    strains: those of the run; default: of the model.
    plane: that of the run.
    Raises SceneError: an unknown kind, or a point that is not in the scene.
    """

    def __init__(self, model: Model, kinds: Sequence[str], points: Mapping[str, Place] | PointSeries | None,
                 lost: Array | None = None, strains: ReferenceStrains | None = None, plane: Any = None) -> None:
        self.model, self.lost, self.kinds = model, lost, frozenset(kinds)
        self._strains, self._plane = strains, plane
        self._sums = Sums(model, strains, plane)
        self.energy, self.momentum = "energy" in kinds, "momentum" in kinds
        self.inner = "inner" in kinds and float(np.sum(model.gravity_weight)) > 0.0
        if "inner" in kinds:
            require(Analysis.INNER, model)
        self.slider = "slider" in kinds and model.n_sliders > 0
        self.points = points if isinstance(points, PointSeries) else PointSeries(model, kinds, points)
        self.of_nodes = "velocity" in kinds
        self.reactions = model.reaction_names if "reaction" in kinds else []
        # points whose section is balanced with them
        self.cut = [k for k, x in enumerate(self.points.balanced) if x is not None] if "reaction" in kinds else []
        self._gap = empty(model.n_sliders)
        self._contact = contact_of(model) if self.slider else None
        self.forces = model.slider_forces if self.slider else None
        self.moments = self.slider and model.sleeves is not None
        self.springs = model.spring_rows if "spring" in kinds else []
        self.balance = self.energy and (model.balances or lost is not None)
        self.scale = {"total": 0.0, "balance": 0.0, "lin_mom": 0.0, "ang_mom": 0.0}
        # features with an answer to a question
        self._of = {name: [x for x in model.features if getattr(type(x), name) is not getattr(Feature, name)]
                    for name in ("read", "read_forces", "add_motion", "weight", "stored")}
        # those with series that are forces of constraints
        self._unknown = [x for x in self._of["read_forces"] if x.read_forces(self.kinds, model, np.zeros(model.n_forces))]
        # data of the newest row for `add_forces`
        self._moment: Any = None
        # energy of ropes of winches in the gravity of the scene
        self._weight = 0.0
        self._directions: list[Section] = []
        # turn of sections by s at contacts on element ends, by numbers of sliders
        self._curvatures: dict[int, Array] = {}
        self._angles = np.zeros(0)

    def series(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of one row of every series."""
        out: dict[str, tuple[int, ...]] = {"iterations": (), "step_size": ()}
        if self.energy:
            out |= dict.fromkeys(("kinetic", "strain", "gravity", "potential", "total"), ())
        if self.momentum:
            out |= {"lin_mom": (3,), "ang_mom": (3,)}
        if self.inner:
            out |= {"center": (3,), "inner_energy": (), "inner_spin": (3,)}
        if self.moments:
            out["contact_moment"] = (self.model.n_sliders, 3)
            out |= dict.fromkeys(TWISTING, (self.model.n_sliders,)) if self.model.twisting.size else {}
        if self.slider:
            s = self.model.n_sliders
            out |= {"gap": (s,), "s_slide": (s,), "contact_force": (s, 3), "slider_position": (s, 3)}
        for feature in self.model.features:
            out |= feature.series(self.kinds, self.model)
        if self.energy:
            out |= {name: (len(of),) for name, of in (("losses", self.model.losses), ("works", self.model.works)) if of}
        if self.energy and self.lost is not None:
            out["filter_loss"] = (2,)
        if self.balance:
            out |= {"balance": ()} | ({"external_work": ()} if self.model.accounts_loads else {})
        out |= self.points.series()
        if self.reactions:
            out["reaction"] = (len(self.reactions), 2, 3)
        if self.cut:
            out["section_balance"] = (len(self.points.places), 2, 3)
        return out

    @cached_property
    def _has_more(self) -> bool:
        """True where rows hold more than the energies and momenta of a scene without features."""
        return bool(self.series().keys() - ALWAYS)

    @property
    def needs_forces(self) -> bool:
        """True where rows hold forces that only steps determine."""
        return self.slider or bool(self.reactions or self.cut or self._unknown) or self.points.measured > 0

    def row(self, t: float, state: State, core: tuple[Array, Array] | None = None) -> dict[str, Any]:
        """Return the row of a state, except iterations, step size and contact force, which the run knows; core: its coordinates
        and rates in the plane of the run, where there is one."""
        model = self.model
        out: dict[str, Any] = {}
        for feature in self._of["read"]:
            out |= feature.read(self.kinds, model, t, state)
        if self.energy or self.momentum:
            sums = self._sums.of(*(x[None] for x in core or state[:2]))[0]
            for feature in self._of["add_motion"]:
                feature.add_motion(model, state, sums)
            self.scale["lin_mom"] = max(self.scale["lin_mom"], float(sums[kernels.LINEAR_SIZE]))
            self.scale["ang_mom"] = max(self.scale["ang_mom"], float(sums[kernels.ANGULAR_SIZE]))
        if self.momentum:
            out["lin_mom"], out["ang_mom"] = sums[LINEAR], sums[ANGULAR]
        if self.energy:
            out["kinetic"], out["strain"] = float(sums[kernels.KINETIC]), float(sums[kernels.STRAIN])
            if "joint_energy" in out:
                out["strain"] += float(np.sum(out["joint_energy"]))
            factor = 1.0 if model.gravity_time is None else factor_at(model.gravity_time, t)
            out["gravity"] = -factor * float(sums[kernels.GRAVITY])
            self._weight = 0.0
            for feature in self._of["weight"]:
                self._weight += feature.weight(model, state.q)
            out["gravity"] += self._weight + (0.0 if model.moving is None else factor * model.moving.weight_of(state))
            out["potential"] = out["strain"] + out["gravity"] - float(sums[kernels.LOADS])
            if self._of["stored"]:
                out["potential"] += self._stored(state)
            out["total"] = out["kinetic"] + out["potential"]
            # the drift of a total that starts at zero is measured by the largest of its parts
            self.scale["total"] = max(self.scale["total"], out["kinetic"], abs(out["potential"]))
        if self.inner:
            out |= self._inner(state)
        if self.slider:
            slider_points(model.curves, model.sliders, self._contact, state.q, state.s, self._gap)
            out["gap"], out["s_slide"] = self._gap.copy(), state.s.copy()
            out["slider_position"] = state.q.reshape(-1, 12)[model.sliders.point, :3]
        if self.moments:
            self._directions = sections(model, state.s, state.q.reshape(-1, 4, 3))
            if model.twisting.size:
                self._angles = angles(model, state.history)
                out["twist"] = np.zeros(model.n_sliders)
                out["twist"][model.sleeve_pairs[:, 0]] = self._angles
        if self.forces is not None:
            tangent, rate = empty((model.n_sliders, 3)), empty(model.n_sliders)
            slider_motion(model.curves, model.sliders, self._contact, state, tangent.reshape(-1), rate)
            if model.moving is not None:
                tangent[model.moving.sliders] = model.moving.tangents(model, state.q, state.s)
                if self.moments:
                    self._curvatures = model.moving.curvatures(state.q, state.s)
            history = model.along_of(state.history).copy()
            self._moment = t, state.s.copy(), rate, history, tangent
            out["slide_rate"] = np.where(history[:, HELD] == OFF, 0.0, rate)
        if self.balance:
            self._balance(out, state)
        return out | self.points.row(state)

    def rows(self, t: Array, q: Array, v: Array, states: Callable[[list[int]], list[State]]) -> dict[str, Array]:
        """Form the rows of many states of a scene without features; q, v [m, 12 N], in the plane of the run [m, 4 N]; states:
        gives some of them, in space."""
        if self._has_more:
            rows = [self.row(at, *states([k]), (q[k], v[k])) for k, at in enumerate(t.tolist())]
            return {name: np.array([row[name] for row in rows]) for name in rows[0]}
        out = dict[str, Array]()
        if not (self.energy or self.momentum):
            return out
        sums = self._sums.of(q, v)
        for k, name in ((kernels.LINEAR_SIZE, "lin_mom"), (kernels.ANGULAR_SIZE, "ang_mom")):
            self.scale[name] = max(self.scale[name], float(np.max(sums[:, k])))
        if self.momentum:
            out |= {"lin_mom": sums[:, LINEAR], "ang_mom": sums[:, ANGULAR]}
        if self.energy:
            kinetic, strain, gravity = sums[:, kernels.KINETIC], sums[:, kernels.STRAIN], 0.0 - sums[:, kernels.GRAVITY]
            potential = strain + gravity - sums[:, kernels.LOADS]
            out |= {"kinetic": kinetic, "strain": strain, "gravity": gravity, "potential": potential,
                    "total": kinetic + potential}
            self.scale["total"] = max(self.scale["total"], float(np.max(kinetic)), float(np.max(np.abs(potential))))
        return out

    def _balance(self, out: dict[str, Any], state: State) -> None:
        """Add the balance of energy to a row: stored and dissipated energy, less energy put in."""
        model = self.model
        stored, sizes = out["total"], [self.scale["total"]]
        lost, put_in = (state.history[begin:begin + len(of)].copy() for begin, of in (
            (model.loss_place, model.losses), (model.works_place, model.works)))
        out |= {name: x for name, x in (("losses", lost), ("works", put_in)) if x.size}
        sizes += [float(np.sum(np.abs(x))) for x in (lost, put_in)]
        if model.accounts_loads:
            out["external_work"] = float(model.own(state.history, "load_account")[0])
            if model.moving is not None:
                out["external_work"] += model.moving.work_of_weight(state.history)
            # their potential is in the total as if they were constant
            stored = out["kinetic"] + out["strain"] + self._weight - out["external_work"]
            sizes.append(abs(out["external_work"]))
        if model.accounts_loads:
            stored += self._stored(state)
        stored = self._booked(stored, sizes, out, state, opens=True)
        stored += float(np.sum(lost)) - float(np.sum(put_in))
        if self.lost is not None:
            out["filter_loss"] = self.lost.copy()
            stored += float(np.sum(self.lost))
            sizes.append(float(np.sum(np.abs(self.lost))))
        stored = self._booked(stored, sizes, out, state, opens=False)
        out["balance"] = stored
        self.scale["balance"] = max(self.scale["balance"], *sizes)

    def _stored(self, state: State) -> float:
        """Return the energy, besides strain energy, that features store, J."""
        out = 0.0
        for feature in self._of["stored"]:
            out += feature.stored(state)
        return out

    def _booked(self, stored: float, sizes: list[float], out: dict[str, Any], state: State, opens: bool) -> float:
        """Return the balance with energies that features took away and put in: features whose numbers open the history, or the
        others."""
        for feature in self.model.features:
            if feature.opens is opens:
                parts, own = feature.booked(self.model, state, out)
                # one after the other: `sum` rounds differently
                for part in parts:
                    stored += part
                sizes += own
        return stored

    def add_forces(self, row: dict[str, Any], force: Array, share: float | None = None) -> None:
        """Add forces to a row; force: of all constraints [F] at its time, then those of supports and joints where they are asked
        for, in time also the means of steps for points; share: load factor of an equilibrium."""
        of_supports = self.model.n_forces + 6 * len(self.reactions)
        own = of_supports + 6 * len(self.cut)
        if self.reactions:
            row["reaction"] = force[self.model.n_forces:of_supports].reshape(-1, 2, 3)
        if self.cut:
            row["section_balance"] = np.full((len(self.points.places), 2, 3), np.nan)
            row["section_balance"][self.cut] = force[of_supports:own].reshape(-1, 2, 3)
        if force.size > own:
            self.points.add(row, force[own:])
        if self.slider:
            self._add_contact_forces(row, force[:self.model.n_forces], share)
        for feature in self._unknown:
            row |= feature.read_forces(self.kinds, self.model, force)

    def _add_contact_forces(self, row: dict[str, Any], force: Array, share: float | None) -> None:
        """Add contact forces, moments of sleeves and forces along the beam to a row."""
        s = self.model.n_sliders
        row["contact_force"] = force[:3 * s].reshape(-1, 3)
        push, edges = np.zeros(s), np.zeros(s)
        if self.moments:
            row["contact_moment"] = np.zeros((s, 3))
            own = force[force.size - 3 * len(self._directions):].reshape(-1, 3)
            bores = self.model.sleeves.edges.reshape(-1, 2)
            for k, section, mu, bore in zip(self.model.sleeve_pairs[:, 0], self._directions, own, bores):
                row["contact_moment"][k] = section.moment(mu)
                push[k] = section.values(1) @ mu[:section.pairs]
                edges[k] = bore @ (np.hypot(mu[0], mu[1]), abs(mu[2]))
            if self.model.twisting.size:
                row["twist_moment"] = np.zeros(s)
            for o in self.model.twisting.tolist():
                k, section = self.model.sleeve_pairs[o, 0], self._directions[o]
                row["twist_moment"][k] = -own[o, 2]
                row["contact_moment"][k] += own[o, 2] * section.axes[0]
                push[k] += own[o, 2] * push_of_twist(section, self._angles[o])
            # conditions at an element end do not depend on s, but what the moments do as sections pass does
            for k, turn in self._curvatures.items():
                push[k] = -turn @ row["contact_moment"][k]
        if self.forces is not None:
            found = self.forces.at_row(*self._moment, row["contact_force"], push, edges, share)
            row |= {"force_along": found.along, "friction_force": found.friction, "drive_force": found.drive,
                    "stop_force": found.stop, "lock_force": found.lock}

    def scales(self, step: float) -> dict[str, float]:
        """Return sizes of the conserved series, by which their drift is measured: the largest that occurred, and for a scene at
        rest that of the least motion in steps of this size (s) that is no round-off."""
        model = self.model
        size = max(model.length, float(np.max(np.abs(model.q0.reshape(-1, 12)[:, :3]))))
        speed, mass = EPSILON * size / step, float(np.sum(model.gravity_weight))
        floors = {}
        if self.momentum:
            floors |= {"lin_mom": CALM * mass * speed, "ang_mom": CALM * mass * speed * size}
        if self.energy:
            # energies of round-off of the coordinates: of motion and strain, and of weight and loads, where it is of first order
            off = EPSILON * (1.0 - 2.0 * (np.arange(model.q0.size) * 2654435761 >> 16 & 1))  # signs without a pattern
            off.reshape(-1, 12)[:, :3] *= size
            load = mass * float(np.linalg.norm(model.gravity)) + float(np.sum(np.abs(model.constant_load)))
            # the strain energy of prestressed beams and springs has parts of first order, too
            own = self.strain_energy(model.q0)
            ahead, back = (self.strain_energy(model.q0 + sign * off) - own for sign in (1.0, -1.0))
            strain, pull = 0.5 * abs(ahead + back), 0.5 * abs(ahead - back)
            floors["total"] = floors["balance"] = CALM * (1e3 * (0.5 * mass * speed**2 + strain) + pull + EPSILON * size * load)
        return {name: x for name in self.scale if (x := max(self.scale[name], floors.get(name, 0.0))) > 0.0}

    @cached_property
    def _sums_in_space(self) -> Sums:
        return self._sums if self._plane is None else Sums(self.model, self._strains)

    def strain_energy(self, q: Array) -> float:
        """Return the energy stored in all beams and springs at coordinates [12 N], J."""
        return float(self._sums_in_space.of(q[None], np.zeros((1, q.size)))[0, kernels.STRAIN])

    def _inner(self, state: State) -> dict[str, Any]:
        """Compute mass centre, and energy and angular momentum of the motion relative to it. The common velocity is taken away
        before anything is squared, so that no digits are lost to it."""
        weight = self.model.gravity_weight / np.sum(self.model.gravity_weight)
        q, v = state.q.reshape(-1, 4, 3).copy(), state.v.reshape(-1, 4, 3).copy()
        # arms are taken from the first node: differences of large coordinates are exact
        first = q[0, 0].copy()
        q[:, 0] -= first
        arm = weight @ q[:, 0]
        q[:, 0] -= arm
        v[:, 0] -= v[0, 0].copy()
        v[:, 0] -= weight @ v[:, 0]
        sums = self._sums_in_space.of(q.reshape(1, -1), v.reshape(1, -1))[0]
        return {"center": first + arm, "inner_energy": float(sums[kernels.KINETIC] + sums[kernels.STRAIN]),
                "inner_spin": sums[ANGULAR]}

    def header(self, info: dict[str, Any], moving: bool = False) -> ResultHeader:
        """Form the header of the result; moving: of a run in time, whose shapes may have velocities."""
        model = self.model
        names = {**model.names, "points": list(self.points.places)}
        if self.reactions:
            names["reactions"] = self.reactions
        names |= {name: list(of) for name, of in (("losses", model.losses), ("works", model.works)) if of}
        for feature in model.features:
            names |= feature.named(self.kinds)
        names |= {springs.kind: springs.names for springs in self.springs}
        # layout of the history for `Result.state_for`
        if model.slider_forces is not None and model.slider_forces.lets_go:
            names["locks"] = [len(slider.lock or ()) for slider in model.slider_forces.sliders]
        if model.released is not None:
            names |= {"until": list(model.released.names), "since": model.released.waits.tolist(),
                      "history": [model.place("released")]}
        if model.prescribed is not None or model.motions is not None:
            names |= {"turning": [] if model.prescribed is None else model.prescribed.turning_labels,
                      "turns": [model.place_for(PrescribedMotions), model.place_for(Motions)]}
        if model.sliders is not None:
            names["slider_nodes"] = [int(k) for k in model.sliders.point]
        if model.moving is not None:
            names["slider_rates"] = model.moving.following.at[:, RATE].tolist()
        return ResultHeader(model_text=str(model), info=info, names=names, n_nodes=model.n_nodes, series=self.series(),
                            velocities=moving and self.of_nodes, spins=moving and self.of_nodes,
                            mesh=0 if model.moving is None else model.moving.nodes.size)


def books_of_start(model: Model, given: Any, state: State, t: float, notes: list[Any]) -> tuple[dict[str, Any], list[Any]]:
    """Return the energy that mending a given start dissipated, J, for `Result.info`, and the notes with a text about it. Where
    parts only met at different velocities, it is that of an inelastic impact; where they were moved, it contains also the change
    of energy with their places, of either sign. Empty where the start was taken as it is."""
    if not any(kind == "mended" for kind, _ in notes):
        return {}, notes
    given = own_state(model, given)
    kinetic, total = np.transpose([[row["kinetic"], row["balance" if model.balances else "total"]] for row in (
        Observer(model, ("energy",), None).row(t, x) for x in (given, state))])
    off = np.max(np.abs(np.concatenate((state.q - given.q, state.s - given.s))))
    what = "impact at the start" if off < MOVED * model.length else "mending of the start"
    said = (f"; the kinetic energy changes from {kinetic[0]:.6g} to {kinetic[1]:.6g} J, the total energy by "
            f"{total[1] - total[0]:.6g} J, {what!r} in balance()")
    return ({AT_START: {what: float(total[0] - total[1])}},
            [(kind, text + said if kind == "mended" else text) for kind, text in notes])


def conserved(model: Model, filtered: bool = False) -> list[str]:
    """List the invariants of the scene: constant dead loads keep the energy, nothing outside may act for the momenta."""
    out = [] if model.slider_forces is not None and model.slider_forces.leaves else ["gap"]
    if model.balances or filtered:
        out.append("balance")
    exchanging = any(x is not None and x.exchanges for x in (model.slider_forces, model.motions))
    if not (model.accounts_loads or model.losses or model.works or exchanging or filtered):
        out.append("total")
    free = np.zeros(0, np.int64) if model.ties is None else model.ties.row
    held = model.held is not None and bool(np.any((model.held.mask & 7 != 0) & ~np.isin(model.held.row, free)))
    if model.moving is not None and np.any(model.gravity):
        return out
    caught = model.released is not None and model.released.losses
    acted_on = len(model.load_times) or model.accounts_loads or held or caught or model.dragged is not None
    if not acted_on:
        out += ["lin_mom", "ang_mom"]
    return out
