"""Gaps of constraints in space and their rates, from the compiled rows of a step with both ends at the present shape (theory.md
5.1), for use outside of a step: impacts, starts, initial velocities."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.call_tables import ADDED, Calls, SystemRecord
from fastbeam.kernels.contact.slider import NoForceAlong, Sliding
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.jit.calls import Unknown
from fastbeam.kernels.joints.conditions import JointConditions
from fastbeam.kernels.joints.coordinates import JointMotion
from fastbeam.kernels.state import State
from fastbeam.kernels.terms import Equilibrium, NoTies, SolverOutside, System, take_unknowns
from fastbeam.model.feature import OfRun
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.mapping import along_material
from fastbeam.model.maps import motion_map
from fastbeam.model.model import Model
from fastbeam.model.workspace import contact_of, work_of

Array = np.ndarray


def is_constraint(term: Any) -> bool:
    """Return whether a term has forces that are unknowns."""
    return take_unknowns.covers(type(term))


class Gaps(NamedTuple):
    """Gaps of all constraints at one shape: S sliders, F multipliers."""

    values: Array   # float64 [F], m and rad; 0 for coordinates of joints and free twists
    rates: Any      # sparse [F, 12 N + P]: derivatives by the rates of all coordinates, and of places of contacts on moving
    #                 meshes; other sliders follow their points along the beam
    tangents: Array  # float64 [S, 3]: derivative by s of the curves under the sliders
    met: Any        # sparse [P, 12 N + P]: rates of points along the beam, relative to the nodes of moving meshes at them
    place: Array    # int64 [S]: numbers of the rates of places of contacts on moving meshes, -1 of other sliders

    def along(self, k: int, v: Array) -> float:
        """Evaluate ds/dt of slider k at rates v [12 N + P] of all coordinates and places, m/s."""
        if self.place[k] >= 0:
            return float(v[self.place[k]])
        tangent = self.tangents[k]
        return float((self.rates[3 * k:3 * k + 3] @ v) @ tangent / (tangent @ tangent))


class ConstraintGaps:
    """Evaluator of the gaps of all constraints of a model.

    model: Model with tables in space.
    history: that of a state, next to whose values angles are counted; default: zeros.
    joints, coordinates, others: int64 [*], numbers of the gaps that joints always close, of the coordinates that friction and
        rigid stops may hold, and of all gaps that are always closed besides those of sliders: `joints`, then `moments`.
    given: bool [*], true for those of `joints` that are coordinates prescribed as functions of time.
    moments: list of int64 [2 or 3], numbers of the directions that every sleeve constrains.
    """

    def __init__(self, model: Model, history: Array | None = None) -> None:
        self._model = model
        s, ends = model.n_sliders, np.append(model.first_force, model.n_forces)
        of_link = [np.arange(*ends[k:k + 2]) for k in range(s, s + len(model.kept))]
        always = [link.law.holds for link in model.kept]
        none = np.zeros(0, np.int64)
        self.joints = np.concatenate([none, *(x for x, holds in zip(of_link, always) if holds)])
        self.coordinates = np.concatenate([none, *(x for x, holds in zip(of_link, always) if not holds)])
        is_coordinate = [isinstance(link.law, Coordinate) for link in model.kept]
        self._unknown = np.concatenate([none, *(x for x, one in zip(of_link, is_coordinate) if one)])
        self.given = np.isin(self.joints, self._unknown)
        keyed = [] if model.sleeves is None else model.sleeves.keyed.tolist()
        self.moments = [ends[c] + np.arange(3 if key else 2) for (_, c), key in zip(model.sleeve_pairs, keyed)]
        self.others = np.concatenate((self.joints, *self.moments))
        self._free = np.array([ends[c] + 2 for (_, c), key in zip(model.sleeve_pairs, keyed) if not key], np.int64)
        self._size = model.n_forces
        self._contact: Contact | None = None
        if model.n_constraints:
            self._begin(np.zeros(model.history_size) if history is None else history.copy())

    def _begin(self, history: Array) -> None:
        """Prepare the arguments of compiled code: all rows are those of the nodes themselves, without slave nodes."""
        model, nodes = self._model, np.arange(self._model.n_nodes)
        own = {} if model.motions is None else {"motions": model.motions.work(model, None, True)}
        run = OfRun(model, static=True, own=own)
        of_features = [x for feature in model.features if feature.constrains for _, x in feature.terms(run)]
        self._terms = Calls(tuple(_on_nodes(x, nodes) for x in (*of_features, *model.links) if is_constraint(x)), ADDED)
        contact = contact_of(model, at_rest=True)
        assert contact is not None
        # constraints that are condensed with their beams have rows, too
        self._contact = contact = contact._replace(first=np.arange(model.n_constraints))
        self._work = work_of(model, keep=False)
        self._state = State(model.q0.copy(), np.zeros(0), model.s0.copy(), np.zeros(self._size), history)
        self._system = SystemRecord(System(Unknown(0), nodes, model.spinless, self._state, model.width, model.length, self._work,
                                           SPACE, Equilibrium(), contact, SolverOutside()), ADDED)
        self._of_force = np.arange(8) < contact.forces[:, None]

    def values(self, q: Array, s: Array) -> tuple[Array, Array]:
        """Evaluate the gaps [F] and the tangents [S, 3] at coordinates q [12 N] and places s [S] of sliders."""
        if self._contact is None:
            return np.zeros(0), np.zeros((0, 3))
        contact, state, work = self._contact, self._state, self._work
        state.q[:] = work.q_mid[:] = work.q_end[:] = q
        state.s[:] = s
        kernels.assemble_some(*self._terms.on(self._system), 0.0)
        assert not contact.full[0]
        values = contact.residual[self._of_force]
        values[self._unknown] = values[self._free] = 0.0
        tangents = contact.corner[:s.size, 24:27].copy()
        if self._model.moving is not None:
            for k in self._model.moving.sliders.tolist():
                tangents[k] = along_material(self._model, k, float(s[k]), q.reshape(-1, 4, 3))
        return values, tangents

    def at(self, q: Array, s: Array) -> Gaps:
        """Evaluate the gaps and their rates at coordinates q [12 N] and places s [S] of sliders."""
        n, contact = q.size // 12, self._contact
        values, tangents = self.values(q, s)
        if contact is None:
            none = sparse.csr_matrix((0, q.size))
            return Gaps(values, none, tangents, none, np.zeros(0, np.int64))
        k, m = np.nonzero(np.arange(contact.row.shape[1]) < contact.entries[:, None])
        line = contact.line.reshape(*contact.row.shape, 6, 8)[k, m] * self._of_force[k][:, None]
        entry, unknown, gap = np.nonzero(line)
        node = contact.row[k, m]
        row, column = contact.first_force[k[entry]] + gap, 6 * node[entry] + unknown
        by_nodes = sparse.csr_matrix((line[entry, unknown, gap], (row, column)), shape=(self._size, 6 * n))
        follow = sparse.eye(self._size, format="lil")
        for o, (slider, c) in enumerate(self._model.sleeve_pairs):
            # the section in the sleeve changes along the beam
            tangent = tangents[slider]
            follow[contact.first_force[c] + np.arange(3)[:, None], 3 * slider + np.arange(3)] = np.outer(
                contact.cross[o, 1, :3], tangent / (tangent @ tangent))
        rates = follow.tocsr() @ by_nodes @ motion_map(q.reshape(-1, 4, 3), np.unique(node))
        if self._model.moving is None:
            return Gaps(values, rates, tangents, rates[:0], np.full(len(tangents), -1))
        return self._with_places(values, rates, tangents)

    def _with_places(self, values: Array, rates: Any, tangents: Array) -> Gaps:
        """Form the gaps of a model with moving meshes, where rates of points relative to beams are those relative to the nodes
        there, which meet them, and of places."""
        sliders = self._model.moving.sliders
        # by which points slide on the mesh, near the ends of beams
        own = self._contact.corner[sliders, 24:27]  # type: ignore[union-attr]
        row, column = 3 * sliders[:, None] + np.arange(3), np.broadcast_to(np.arange(sliders.size)[:, None], (sliders.size, 3))
        along, slides = (sparse.csr_matrix((x.reshape(-1), (row.reshape(-1), column.reshape(-1))),
                                           shape=(self._size, sliders.size)) for x in (tangents[sliders], own))
        place = np.full(len(tangents), -1)
        place[sliders] = rates.shape[1] + np.arange(sliders.size)
        return Gaps(values, sparse.hstack([rates, along - slides], format="csr"), tangents,
                    along.T @ sparse.hstack([rates, -slides], format="csr"), place)


def across_of(tangent: Array) -> Array:
    """Return two unit vectors [2, 3] across a tangent [3]."""
    return np.linalg.svd(tangent[None])[2][1:]


def _on_nodes(term: Any, nodes: Array) -> Any:
    """Return a term of constraints whose forces and moments act on the nodes themselves."""
    term = term._replace(ties=NoTies())
    if isinstance(term, Sliding):
        return term._replace(along=NoForceAlong(), sliders=term.sliders._replace(spin_root=nodes))
    motion = getattr(term, "motion", None)
    if isinstance(motion, JointMotion):
        return term._replace(motion=motion._replace(row=motion.node, spin_node=motion.node))
    term = term._replace(row=term.node)
    return term._replace(spin_row=term.node) if isinstance(term, JointConditions) else term
