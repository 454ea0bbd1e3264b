"""Moving meshes of a scene as a feature (theory.md 5.12): terms of a step, history, energies, limits of analyses."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.contact.moving_beam import MovingGravity, MovingRows, energy_of_moving, height_of, momentum_sums, motion_of
from fastbeam.kernels.contact.moving_places import ALLOWED, MAY_WAIT, is_on_node
from fastbeam.kernels.contact.slider import RATE, UNKNOWN, Following
from fastbeam.kernels.energies import STRAIN
from fastbeam.kernels.layout import FACTORS
from fastbeam.kernels.state import State, aligned
from fastbeam.model.analyses import Analysis, Lack, without_adjoint
from fastbeam.model.contact.material_points import MaterialPoints
from fastbeam.model.contact.moving_tables import (
    element_ends,
    element_lengths,
    mass_matrix,
    masses,
    material_stiffness,
    momenta,
    node_places,
    of_rates,
    places_of,
    table_in_plane,
    ways_of,
)
from fastbeam.model.feature import Feature, OfRun, Span, Stand
from fastbeam.model.forces.loads import mean_factors
from fastbeam.model.mapping import contact
from fastbeam.model.maps import velocity_map
from fastbeam.scene import Beam
from fastbeam.scene.checks import nearest_triads

Array = np.ndarray
AWAY = "compile the scene without moving meshes"


@dataclass(frozen=True)
class Moving(Feature):
    """Moving meshes of a model."""

    key, title, order, is_told_first = "moving", "moving elements (MovingMesh)", 100, True
    lacks = (
        Lack((Analysis.COMPARED, Analysis.STEADY), "moving elements",
             "moving mesh with slider {name!r}: {who} does not support moving elements", AWAY,
             lambda moving, asked: moving.names),
        Lack((Analysis.EXACT,), "moving elements",
             "moving mesh with slider {name!r}: {who} is not needed, because its contact is an element end already",
             "leave contacts= out", lambda moving, asked: moving.names),
        Lack((Analysis.FILTERED,), "rho_inf: moving mesh with slider {name!r}: strains of moving elements are not filtered",
             "rho_inf: moving mesh with slider {name!r}: strains of moving elements are not filtered",
             f"leave rho_inf out, or {AWAY}", lambda moving, asked: moving.names),
        Lack((Analysis.INNER,), "moving elements", "observe: 'inner' does not support moving elements (slider {name!r})",
             f"leave it out, or {AWAY}", lambda moving, asked: moving.names),
        without_adjoint("moving elements"))

    tables: tuple[Any, ...]  # the terms
    names: list[str]  # names of the sliders, by their numbers among the contacts
    following: Following  # constants
    # sliders, contacts: int64 [F], numbers of the sliders, and nodes of their contacts
    sliders: Array
    contacts: Array
    pairs: Array  # int64 [P, 2]: sliders at neighbouring contacts
    rates: Array  # float64 [F]: ds/dt at the start, m/s
    beams: tuple[Beam, ...]  # as the user gave them: results have rows for material points at their nodes
    gravity_time: Callable[[float], float] | None
    strained: Array  # float64 [beams]: changes of axial reference strains in a run
    # in a plane that, and the feature in space
    plane: Any = None
    in_space: Moving | None = None

    @property
    def history_size(self) -> int:
        """Number of history variables: of every beam momenta, rates of the places of contacts, and the work of its weight."""
        return sum(_size(table) for table in self.tables)

    @property
    def mass(self) -> float:
        """Mass of all beams, kg."""
        return sum(float(table.rho[0] * table.length[0]) for table in self.tables)

    @property
    def constants(self) -> list[Array]:
        """Arrays by which checkpoints recognise their model."""
        tables = [(x.slot, x.share, x.length, x.stiffness, x.rho, x.weighs, x.rest, x.rest_slope) for x in self.tables]
        return [*(x for table in tables for x in table), self.following.reach]

    def describe(self) -> list[tuple[str, str, list[str]]]:
        """Return the line of `print(model)`: contacts at which elements end."""
        contacts, beams = len(self.names), len(self.tables)
        where = f"{contacts} contact{'s' * (contacts > 1)} on {beams} beam{'s' * (beams > 1)}"
        return [("moving elements", f"end at {where}: ", self.names)]

    # --- in a run -----------------------------------------------------------------------------------------------------
    def work(self, model: Any, plane: Any, static: bool) -> Following:
        """Allocate the numbers of contacts that terms of one run share."""
        of, at = self.following, self.following.at.copy()
        at[self.sliders, UNKNOWN] = (np.cumsum(model.unknowns) - model.unknowns)[self.sliders] + model.dim
        empty = {key: np.zeros_like(getattr(of, key)) for key in ("border", "pull", "cross", "tangent", "slope", "way", "shift")}
        condensed = np.zeros_like(of.condensed)
        condensed[:, ALLOWED] = self._is_condensed(model)
        return of._replace(at=at, condensed=condensed, gravity=np.ones(1), **empty)

    def _is_condensed(self, model: Any) -> bool:
        """Return whether inner nodes of all moving elements are eliminated from the border. The normal force of friction has
        derivatives by inner nodes, which follow after that."""
        rubs = model.slider_forces is not None and bool(np.any(model.slider_forces.tables.friction[self.sliders] > 0.0))
        return model.by_rows and not rubs and all(bool(np.all(table.tables.meta[:, FACTORS] >= 0)) for table in self.tables)

    @property
    def alone(self) -> Following:
        """Contacts without their beams, for conditions outside of a step."""
        return self.following._replace(nodes=np.full_like(self.following.nodes, -1))

    def terms(self, run: OfRun) -> Iterable[tuple[Stand, Any]]:
        """Return the tables of beams with work arrays of the run."""
        following = run.own.get("moving") or self.work(run.model, None, run.static)
        following.condensed[:, MAY_WAIT] = run.inner is not None
        for table in self.tables:
            tab = aligned(table.tables.tab.size)
            tab[:] = table.tables.tab
            beam = table._replace(scratch=aligned(table.scratch.size), carried=aligned(table.carried.size),
                                  tables=table.tables._replace(tab=tab), inner=run.inner or table.inner, following=following)
            yield Stand.MOVING, beam
            if run.inner is not None:
                yield Stand.INNER, MovingRows(beam)

    def schedules(self, span: Span) -> Iterable[tuple[Stand, Any]]:
        """Return the factors of gravity in the steps of a span."""
        if self.gravity_time is None:
            return
        factors = mean_factors(self.gravity_time, span.starts, span.lengths)
        yield Stand.MOVING, MovingGravity(span.own["moving"].gravity, factors)

    def in_plane(self, plane: Any, model: Any, constraints: int) -> Moving:
        """Return the feature with tables of a plane; histories have momenta of vectors in space."""
        return replace(self, tables=tuple(table_in_plane(table, plane) for table in self.tables), plane=plane, in_space=self)

    def put_gravity(self, following: Following, times: list[Any], factors: Array) -> None:
        """Set the factor of gravity of an equilibrium; factors [K] of the loads with these time functions."""
        following.gravity[0] = self._factor(times, factors)

    def _factor(self, times: list[Any], factors: Array) -> float:
        return next((float(x) for time, x in zip(times, factors) if time is self.gravity_time), 0.0)

    def in_constant_gravity(self, times: list[Any], factors: Array) -> Moving:
        """Return the feature for runs in which loads with these time functions have had these factors [K], and are constant."""
        factor = self._factor(times, factors)
        return replace(self, gravity_time=None, tables=tuple(x._replace(weighs=factor * x.weighs) for x in self.tables))

    def with_own_strains(self) -> Moving:
        """Return the feature with arrays of its own for reference strains and weights."""
        own = tuple(x._replace(rest=x.rest.copy(), rest_slope=x.rest_slope.copy(), weighs=x.weighs.copy()) for x in self.tables)
        in_space = None if self.in_space is None else self.in_space.with_own_strains()
        return replace(self, tables=own, strained=self.strained.copy(), in_space=in_space)

    def axial_strains(self, first: int) -> list[tuple[Array, Any]]:
        """Return arrays, and where in them the axial reference strain of the beam with this first node stands; none for beams
        whose elements do not move."""
        found = [] if self.in_space is None else self.in_space.axial_strains(first)
        for k, x in enumerate(self.tables):
            if first == int(x.place[1]):
                found += [(x.rest, (1, slice(None), 0)), (x.rest_slope, (slice(None), 0)), (self.strained, slice(k, k + 1))]
        return found

    def strain_change(self, first: int) -> float:
        """Return the change in this run of the axial reference strain of the beam with this first node."""
        return next(float(x) for x, table in zip(self.strained, self.tables) if first == int(table.place[1]))

    # --- shapes -------------------------------------------------------------------------------------------------------
    def has(self, first: int | None) -> bool:
        """Return whether elements of the beam whose first node this is move."""
        return any(first == int(table.place[1]) for table in self.tables)

    def _table_from(self, first: int) -> Any:
        """Return the term of the beam with this first node."""
        return next(table for table in self.tables if first == int(table.place[1]))

    def element_ends(self, first: int, s: Array) -> Array:
        """Return the ends of the elements of the beam with this first node, m, with the places of all sliders."""
        return element_ends(self._table_from(first), s)

    def table_of(self, k: int) -> Any:
        """Return the term of the beam of slider k."""
        return next(table for table in self.tables if k in table.slider)

    def gaps(self, s: Array) -> tuple[Array, Array, Array]:
        """Return the distances between element ends at neighbouring contacts with the places of all sliders, the smallest
        allowed, and the lengths of the beams, m."""
        found = [np.diff(places_of(table, s)) for table in self.tables]
        lengths, least = np.repeat([table.length[:2] for table in self.tables], [x.size for x in found], axis=0).T
        return np.concatenate(found), least, lengths

    def at_end(self, gap: int, s: Array) -> dict[str, Any]:
        """Return the event of two contacts that have met, by the number of the pair."""
        pairs = [(int(a), int(b)) for table in self.tables for a, b in zip(table.slider[:-1], table.slider[1:])]
        names = dict(zip(self.sliders.tolist(), self.names))
        other, name = (names[k] for k in pairs[gap])
        return {"slider": name, "end": other, "s": float(s[pairs[gap][1]]),
                "text": f"sliders {other!r} and {name!r} met, so the length of the moving elements between them vanishes"}

    def ways(self, q: Array, s: Array) -> Any:
        """Return the motion of the nodes along their beams, (v, spin) of all nodes for ds/dt of the contacts, sparse [6 N, F], at
        coordinates [12 N] and places of sliders: a mesh that moves does not move the material."""
        n = q.size // 12
        return sparse.hstack([ways_of(table, q.reshape(-1, 4, 3), s, n) for table in self.tables], format="csr")

    def tangents(self, model: Any, q: Array, s: Array) -> Array:
        """Return the tangents of beams at the contacts [F, 3], at element ends means of both sides, at coordinates [12 N] and
        places of sliders."""
        x = q.reshape(-1, 4, 3)
        out = self.tangents_at_ends(x, s)
        for f in np.flatnonzero(np.isnan(out[:, 0])).tolist():
            k = int(self.sliders[f])
            out[f] = contact(model, k, float(s[k]), x, x)[1]
        return out

    def tangents_at_ends(self, x: Array, s: Array) -> Array:
        """Return means of the tangents on both sides of contacts on element ends [F, d], NaN for others, at coordinates [N, *, d]
        in space, or in its plane, and places of sliders."""
        out, f = np.full((self.sliders.size, x.shape[2]), np.nan), 0
        for table in self.tables:
            h, e = element_lengths(table, s), np.searchsorted(table.node[:, 0], self.contacts[f:f + table.slider.size])
            for k, ahead in zip(table.slider.tolist(), e.tolist()):
                if is_on_node(self.following, f, s[k]):
                    out[f] = 0.5 * sum(table.edge[side] @ x[table.node[i], 0] / h[i] for side, i in ((0, ahead), (1, ahead - 1)))
                f += 1
        return out

    def curvatures(self, q: Array, s: Array) -> dict[int, Array]:
        """Return the turn of sections by the arc length [3], 1/m, at contacts on element ends, means of both sides, by numbers of
        sliders; at coordinates [12 N] and places of sliders."""
        ways = self.ways(q, s)
        return {k: ways[6 * node + 3:6 * node + 6, [f]].toarray()[:, 0]
                for f, (k, node) in enumerate(zip(self.sliders.tolist(), self.contacts.tolist()))
                if is_on_node(self.following, f, s[k])}

    def with_mesh(self, model: Any, q: Array, s: Array, v: Array) -> tuple[Array, Array]:
        """Return the rates of all nodes [12 N] whose material has the rates v [12 N], and ds/dt of the contacts [F], at
        coordinates [12 N] and places of sliders."""
        of_nodes, along = v.reshape(-1, 4, 3), self.tangents(model, q, s)
        relative = np.array([contact(model, k, float(s[k]), q.reshape(-1, 4, 3), of_nodes)[2] for k in self.sliders.tolist()])
        rates = np.sum(relative * along, axis=1) / np.sum(along**2, axis=1)
        out = v + velocity_map(q.reshape(-1, 4, 3)) @ (self.ways(q, s) @ rates)
        # to the last bit
        met = [is_on_node(self.following, f, s[k]) for f, k in enumerate(self.sliders.tolist())]
        out.reshape(-1, 4, 3)[self.contacts[met], 0] = of_nodes[model.sliders.point[self.sliders[met]], 0]
        return out, rates

    def written(self, model: Any, state: State) -> State:
        """Return the state with momenta and rates of nodes and of places of contacts for velocities of the material that were
        written into it: those at its nodes, without their motion along the beam by the history."""
        along = velocity_map(state.q.reshape(-1, 4, 3)) @ (self.ways(state.q, state.s) @ self.places_in(state.history))
        v, rates = self.with_mesh(model, state.q, state.s, state.v - along)
        found = State(state.q, v, state.s, state.force, state.history.copy())
        self.put_places(found.history, rates)
        model.start_momenta(found.history, found.q, found.v, found.s)
        return found

    def reversed(self, history: Array) -> Array:
        """Return a history with opposite momenta and rates of places, of a motion that goes back."""
        out = history.copy()
        for table in self.tables:
            first = int(table.place[0])
            out[first:first + _size(table) - 1] *= -1.0
        return out

    @property
    def nodes(self) -> Array:
        """All nodes of the beams, int64 [*]."""
        return np.unique(np.concatenate([table.node.reshape(-1) for table in self.tables]))

    def own_shape(self, state: State) -> tuple[Array, Array]:
        """Return the coordinates and rates [N, 4, 3] of all nodes where those of these beams are material points at their own arc
        lengths, with orthonormal triads."""
        q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
        every, rates = q.copy(), v.copy()
        places = self.places_in(state.history)
        for table, beam in zip(self.tables, self.beams):
            first, of, nodes = int(table.first[0]), MaterialPoints(table, beam.node_s, state.s), _span(table)
            own = of.of(q)
            own[:, 1:] = nearest_triads(own[:, 1:])
            for given, found in ((every, own), (rates, of.rates(q, v, places[first:first + table.slider.size]))):
                # without the round-off of shape functions
                found[[0, -1]] = given[nodes][[0, -1]]
                given[nodes] = found
        return every, rates

    def lay_out(self, state: State) -> None:
        """Move the nodes of moving beams in a state, where they have material points at the arc lengths of the beams, to where
        they belong with the places of the sliders, with the rates of the material there."""
        for table, beam in zip(self.tables, self.beams):
            first, values, _ = beam.basis.curve("own").evaluate(node_places(table, state.s))
            at = first[:, None] + np.arange(values.shape[1])
            q, v = (x.reshape(-1, 4, 3)[_span(table)] for x in (state.q, state.v))
            own, rates = (np.einsum("mn,mnkc->mkc", values, x[at]) for x in (q, v))
            own[:, 1:] = nearest_triads(own[:, 1:])
            # rates of directors keep these orthonormal
            rates[:, 1:] = np.cross(0.5 * np.cross(own[:, 1:], rates[:, 1:]).sum(axis=1)[:, None], own[:, 1:])
            q[1:-1], v[1:-1] = own[1:-1], rates[1:-1]

    def same_meshes(self, other: Moving) -> list[tuple[slice, slice]] | None:
        """Return the nodes of all beams here and of their namesakes on the moving meshes of another model, None where some have
        no namesake or its elements lie otherwise between its contacts."""
        theirs = {beam.name: table for table, beam in zip(other.tables, other.beams)}
        out = []
        for table, beam in zip(self.tables, self.beams):
            there = theirs.get(beam.name)
            if there is None or not (np.array_equal(there.slot, table.slot) and np.array_equal(there.share, table.share)):
                return None
            out.append((_span(table), _span(there)))
        return out

    def nodes_at(self, first: int, at: float, s: Array) -> tuple[Array, Array]:
        """Return the nodes [n] around the material point at this arc length of the beam with this first node, and weights [n, 4]
        of their positions, and of no directors, in its position; with the places of all sliders."""
        of = MaterialPoints(self._table_from(first), np.array([at]), s)
        return of.nodes[0], of.values[0][:, None] * (1.0, 0.0, 0.0, 0.0)

    def own_motion(self, q: Array, s: Array, displacements: Array, spins: Array) -> tuple[Array, Array]:
        """Return small displacements and spins [m, N, 3] of all nodes where those of these beams are material points at the arc
        lengths of their nodes, from those of the material at all nodes, at coordinates [N, 4, 3] and places of all sliders."""
        displacements, spins = displacements.copy(), spins.copy()
        for table, beam in zip(self.tables, self.beams):
            of, nodes = MaterialPoints(table, beam.node_s, s), _span(table)
            rates = np.cross(spins[:, of.nodes][:, :, :, None], q[of.nodes, 1:])
            rates = np.einsum("an,manic->maic", of.values, rates)
            d = nearest_triads(of.of(q)[:, 1:])
            inside = slice(nodes.start + 1, nodes.stop - 1)
            displacements[:, inside] = np.einsum("an,manc->mac", of.values, displacements[:, of.nodes])[:, 1:-1]
            spins[:, inside] = 0.5 * np.cross(d, rates).sum(axis=2)[:, 1:-1]
        return displacements, spins

    def point_slope(self, first: int, at: float, state: State) -> tuple[Array, Array, Array]:
        """Return the nodes [n] around the material point at this arc length of the beam with this first node, weights [n] of
        their displacements in its own, and its derivatives by the places of all sliders while nodes stay, [S, 3]."""
        table = self._table_from(first)
        of, by_places = MaterialPoints(table, np.array([at]), state.s), np.zeros((state.s.size, 3))
        by_places[table.slider] = -np.outer(of.mesh()[0], of.tangents(state.q.reshape(-1, 4, 3))[0, 0])
        return of.nodes[0], of.values[0], by_places

    def point(self, first: int, at: float, state: State) -> tuple[Array, Array]:
        """Return the coordinates and rates [4, 3] of the material point at this arc length of the beam with this first node."""
        table = self._table_from(first)
        q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
        of, begin = MaterialPoints(table, np.array([at]), state.s), int(table.first[0])
        places = self.places_in(state.history)[begin:begin + table.slider.size]
        return of.of(q)[0], of.rates(q, v, places)[0]

    # --- energies -----------------------------------------------------------------------------------------------------
    def add_motion(self, model: Any, state: State, out: Array) -> None:
        """Add the energies and the momenta of all moving beams."""
        p = np.zeros_like(state.q)
        for table in self.tables:
            out[0] += motion_of(table, state.s, state.history, p)
            out[STRAIN] += energy_of_moving(table, state.q, state.s)
        momentum_sums(state.q, p, out)

    def weight_of(self, state: State) -> float:
        """Return the energy of all moving beams in the full gravity of the scene, J."""
        return -sum(height_of(table, state.q, state.s, SPACE) for table in self.tables)

    def work_of_weight(self, history: Array) -> float:
        """Return the work of gravity on all moving beams since the start, J."""
        return sum(float(history[int(table.place[0]) + _size(table) - 1]) for table in self.tables)

    # --- rates and momenta --------------------------------------------------------------------------------------------
    def places_in(self, history: Array) -> Array:
        """Return ds/dt of the contacts in a history [F]."""
        return np.asarray(history[self.following.at[self.sliders, RATE]])

    def put_places(self, history: Array, rates: Array) -> None:
        """Put ds/dt of the contacts [F] into a history."""
        history[self.following.at[self.sliders, RATE]] = rates

    def start_history(self, own: Array, q: Array, v: Array) -> None:
        """Put ds/dt of the contacts at the start into the history variables."""
        own[self._own_places()] = self.rates

    def start_momenta(self, own: Array, q: Array, v: Array, s: Array) -> None:
        """Put the momenta of coordinates and places, and of their rates, into the history variables."""
        if self.in_space is not None:
            (q,), (v,) = self.plane.rows(q[None], v[None])
            self.in_space.start_momenta(own, q, v, s)
            return
        for table in self.tables:
            first = self._first(table)
            own[first:first + count_of_momenta(table)] = self._momenta(table, own, q, v, s).reshape(-1)

    def misfit(self, own: Array, q: Array, v: Array, s: Array) -> float:
        """Return the difference between velocities and those of the momenta in the history, m/s: of a beam the root of its mean
        square by the kinetic energy; q, v [12 N]."""
        worst = 0.0
        for table in self.tables:
            first, of_rates = self._first(table), self._momenta(table, own, q, v, s)
            off = own[first:first + of_rates.size].reshape(of_rates.shape) - of_rates
            twice = np.einsum("e,gk,egkc->", 1.0 / element_lengths(table, s), masses(table), off**2)
            worst = max(worst, float(np.sqrt(twice / (table.rho[0] * table.length[0]))))
        return worst

    def _momenta(self, table: Any, own: Array, q: Array, v: Array, s: Array) -> Array:
        return momenta(table, q.reshape(-1, 4, 3), s, np.concatenate((v, own[self._own_places()])))

    def _first(self, table: Any) -> int:
        """Return the offset of the variables of a beam among those of all beams."""
        return int(table.place[0]) - int(self.tables[0].place[0])

    def _own_places(self) -> Array:
        """Return the offsets of ds/dt among the variables of all beams, int64 [F]."""
        return np.asarray(self.following.at[self.sliders, RATE] - int(self.tables[0].place[0]))

    def inertia(self, q: Array, s: Array) -> Any:
        """Assemble the mass matrix of all moving beams at coordinates [12 N] and places of sliders, for rates of coordinates and
        of places of contacts, sparse [12 N + F, 12 N + F]."""
        size = q.size + self.sliders.size
        return sum(mass_matrix(table, q.reshape(-1, 4, 3), s, size) for table in self.tables)

    def material(self, q: Array, s: Array) -> Any:
        """Assemble the stiffness of the material of all moving beams, without that by its stresses, at coordinates [N, 4, 3] and
        places of sliders, sparse [12 N, 12 N]."""
        return sum(material_stiffness(table, q, s) for table in self.tables)

    def momentum(self, history: Array, q: Array, s: Array) -> Array:
        """Return the momenta in a history as generalised momenta of all coordinates and places of contacts, with the energy
        (5.20), [12 N + F]."""
        out = np.zeros(q.size + self.sliders.size)
        for table in self.tables:
            first, of = int(table.place[0]), list(of_rates(table, q.reshape(-1, 4, 3), s))
            own = history[first:first + count_of_momenta(table)].reshape(len(of), -1, 4, 3)
            for one, m in zip(of, own):
                np.add.at(out, one.columns, np.einsum("gk,gkc,gkci->i", masses(table) / one.length, m, one.matrix))
        return out

    def put_blow(self, history: Array, q: Array, s: Array, by: Array) -> None:
        """Update the momenta in a history for a jump of the rates by `by` [12 N + F], both at coordinates [12 N]."""
        for table in self.tables:
            first, jump = int(table.place[0]), momenta(table, q.reshape(-1, 4, 3), s, by)
            history[first:first + jump.size] += jump.reshape(-1)


def count_of_momenta(table: Any) -> int:
    """Return the number of momenta of a beam in the history."""
    return 12 * len(table.node) * table.mass_point.shape[1]


def _span(table: Any) -> slice:
    """Return the nodes of a beam."""
    return slice(int(table.place[1]), int(table.place[1] + table.place[2]))


def _size(table: Any) -> int:
    """Return the number of history variables of a beam."""
    return count_of_momenta(table) + table.slider.size + 1
