"""Second stage of the compiler: elements, bodies, loads and the initial state as arrays, before anything is packed."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.initial import initial_rates, state_without_velocities
from fastbeam.compile.numbered import Numbered, number
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.state import State
from fastbeam.model.connections import Connections
from fastbeam.model.contact.moving_tables import Mesh
from fastbeam.model.forces.added_mass import Added, added_of
from fastbeam.model.forces.damping_and_drag import Dragged, dragged_of
from fastbeam.model.forces.nonlinear_sections import NonlinearSections, nonlinear_of
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.model.model import Model
from fastbeam.model.moving_supports import PrescribedMotions, prescribed_of
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import Elements, elements_of
from fastbeam.scene import DistributedLoad, RigidBody, Scene
from fastbeam.scene.interpolation.shapes import gll_nodes

Array = np.ndarray
# initial pieces of an element, and of a beam, for a load by a function; largest error as a share of its largest value; shortest
# piece as a share of an element; largest number of pieces of a beam at one time
PIECES, LEAST_PIECES, ALIKE, SHORTEST, MOST_PIECES = 4, 64, 1e-12, 1e-13, 2**16


class Loads(NamedTuple):
    """Loads on the rows of the nodes; loads of nodes that share a row stand at the node that has it."""

    first: Array       # float64 [N, 6]: the first of K vectors, N and N m
    vector: Array      # int64 [M]: numbers of the others, which follow each other,
    node: Array        # int64 [M]: nodes that they act on, in their order,
    value: Array       # float64 [M, 6]: and what they do there
    times: list[Any]   # factor of every vector; None: constant
    names: list[str]   # names of the loads of each time function
    weight: Array      # float64 [N], kg
    constant: Array    # float64 [N, 3]: forces without time functions, N

    def each(self, row_root: Array) -> list[tuple[Array, Array | None]]:
        """Return every vector on its nodes [*, 6], and these nodes, the first of those that share a row (row_root, as of
        `_loads`); None: all nodes."""
        if not self.times:
            return []
        roots, first = np.unique(row_root, return_index=True)
        node = first[np.searchsorted(roots, self.node)]
        ends = np.searchsorted(self.vector, np.arange(1, len(self.times) + 1))
        return [(self.first[row_root], None), *((self.value[a:b], node[a:b]) for a, b in zip(ends, ends[1:]))]


@dataclass(frozen=True)
class Unpacked:
    """Scene as arrays."""

    numbered: Numbered
    elements: list[Elements]  # elements of every beam, then of every net
    bodies: Array  # int64 [B]: nodes of rigid bodies and masses
    inertia: Array  # float64 [B, 4, 4]: their inertia for (v, rates of the directors)
    loads: Loads
    gravity: Array  # float64 [3]: gravity, m/s^2
    kept: list[ConstrainedJoint]  # joints with multipliers
    state: State  # state at t = 0, in space
    notes: tuple[tuple[str, str], ...]  # events of the initial velocities: kinds and texts
    prescribed: PrescribedMotions | None  # supports that move
    dragged: Dragged | None  # nodes with drag
    nonlinear: NonlinearSections | None  # sections with laws
    added: Added | None  # nodes with added mass
    moving: list[Elements]  # elements that move with contacts, as they are at t = 0

    @property
    def nodes(self) -> NodeList:
        """Nodes of the scene."""
        return self.numbered.nodes

    @property
    def joints(self) -> Connections:
        """Connections of the scene."""
        return self.numbered.joints


def unpack(scene: Scene, numbered: Numbered, pack: Callable[[Scene, Unpacked], Model], meshes: Sequence[Mesh] = ()) -> Unpacked:
    """Return the arrays of a scene whose nodes have numbers; pack: makes a model of them, on which velocities are projected;
    meshes: those that move with contacts, whose elements are left out, but for the initial state. Raises SceneError: initial
    velocities that a connection, a support or a slider does not allow."""
    nodes, joints, kept = numbered.nodes, numbered.joints, numbered.links.kept
    elements, moving = ([elements_of(part, nodes.start(part), nodes.phi, nodes.directors) for part in [*scene.beams, *scene.nets]
                         if any(part is mesh.beam for mesh in meshes) == of_moving] for of_moving in (False, True))
    loads = _loads(scene, nodes, elements, joints.row_root)
    standing = unpack(scene, number(scene, nodes.moved), pack) if meshes else None
    state = state_without_velocities(scene, nodes, kept) if standing is None else standing.state
    # positions and triads of the node list are views of q: the same numbers, stored once
    coordinates = state.q.reshape(-1, 4, 3)
    nodes.phi, nodes.directors = coordinates[:, 0], coordinates[:, 1:]
    found = Unpacked(numbered, elements, *_bodies(scene, nodes), loads, np.array(scene.gravity), kept, state, (),
                     prescribed_of(scene, nodes, joints, numbered.length), dragged_of(scene, nodes, elements),
                     nonlinear_of(scene), added_of(scene, nodes, elements), moving)
    if standing is not None:
        return replace(found, notes=standing.notes)
    v, notes = initial_rates(scene, nodes, numbered.joints_at_start, elements, kept, lambda: pack(scene, found))
    return replace(found, state=state._replace(v=v), notes=notes)


def _bodies(scene: Scene, nodes: NodeList) -> tuple[Array, Array]:
    """Return the nodes [B] of bodies and masses, and their inertia [B, 4, 4]."""
    parts = [*scene.bodies, *scene.masses]
    number = [np.array([nodes.start(p) for p in parts], np.int64)]
    inertia = [np.zeros((len(parts), 4, 4))]
    for k, part in enumerate(parts):
        inertia[0][k, 0, 0] = part.mass
        if isinstance(part, RigidBody):
            # Euler tensor: T = 1/2 sum E_ij v_i . v_j with E = 1/2 tr(J) I - J
            inertia[0][k, 1:, 1:] = 0.5 * np.trace(part.inertia) * np.eye(3) - part.inertia
    for net in scene.nets:
        if net.masses is not None:
            loaded = np.flatnonzero(net.masses)
            number.append(nodes.start(net) + net.junction[loaded])
            inertia.append(np.zeros((loaded.size, 4, 4)))
            inertia[-1][:, 0, 0] = net.masses[loaded]
    return np.concatenate(number), np.concatenate(inertia)


def _loads(scene: Scene, nodes: NodeList, elements: list[Elements], row_root: Array) -> Loads:
    """Collect all loads; row_root: int [N], the node whose row a node shares."""
    n = len(nodes)
    times: list[Any] = []
    first, others = np.zeros((n, 6)), _Entries([], [], [])

    def add(time: Any, at: Array, forces: Array, columns: slice = slice(3)) -> None:
        """Add forces at nodes, each of them once, with a factor in time."""
        k = next((k for k, known in enumerate(times) if known is time), len(times))
        if k == len(times):
            times.append(time)
        if k == 0:
            first[at, columns] += forces
        else:
            others.add(k, at, forces, columns)

    at = [part.nodes.reshape(-1) for part in elements]
    share = [(part.inertia[part.section, :1] * part.mass_phi.sum(axis=2)).reshape(-1) for part in elements]
    weight = np.bincount(np.concatenate(at), np.concatenate(share), minlength=n) if at else np.zeros(n)
    for body in [*scene.bodies, *scene.masses]:
        weight[nodes.start(body)] += body.mass
    for net in scene.nets:
        if net.masses is not None:
            weight[nodes.start(net) + net.junction] += net.masses
    if np.any(scene.gravity):
        add(scene.gravity_time, np.arange(n), weight[:, None] * scene.gravity)
    constant = np.zeros((n, 3))
    for net in scene.nets:
        if net.loads is not None:
            at = nodes.start(net) + net.junction
            add(net.time, at, net.loads)
            if net.time is None:
                constant[at] += net.loads
    for load in scene.loads:
        node = np.array([nodes.number(load.at)])
        add(load.time, node, np.concatenate((load.force, load.moment))[None], slice(6))
        if load.time is None:
            constant[node] += load.force
    for load in scene.distributed:
        span = nodes.start(load.beam) + np.arange(load.beam.basis.n_nodes)
        for columns, target in distributed(load):
            add(load.time, span, target, columns)
            if load.time is None and columns.start == 0:
                constant[span] += target
    # nodes may share a row
    shared = np.stack([np.bincount(row_root, column, minlength=n) for column in first.T], axis=1)
    return Loads(shared, *others.on(row_root), times, _timed_by(scene, times), weight, constant)


class _Entries(NamedTuple):
    """Entries of load vectors in the order of the loads."""

    vector: list[Array]
    node: list[Array]
    value: list[Array]

    def add(self, k: int, at: Array, forces: Array, columns: slice) -> None:
        """Add forces at nodes to vector k."""
        self.vector.append(np.full(at.size, k))
        self.node.append(at)
        self.value.append(np.zeros((at.size, 6)))
        self.value[-1][:, columns] = forces

    def on(self, row_root: Array) -> tuple[Array, Array, Array]:
        """Return numbers of vectors, nodes and values, at nodes that have a row of their own."""
        if not self.vector:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 6))
        n, value = row_root.size, np.concatenate(self.value)
        key = np.concatenate(self.vector) * n + np.concatenate(self.node)
        # of every node first, then of those that share a row
        for root in (np.arange(n), row_root):
            key, place = np.unique(key // n * n + root[key % n], return_inverse=True)
            value = np.stack([np.bincount(place, column) for column in value.T], axis=1)
        return key // n, key % n, value


def distributed(load: DistributedLoad) -> list[tuple[slice, Array]]:
    """Return forces and moments of a distributed load on the nodes of its beam, with their columns: [n, 3] each."""
    out = []
    for columns, nodal in of_elements(load):
        target = np.zeros((load.beam.basis.n_nodes, 3))
        np.add.at(target, load.beam.basis.element_nodes, nodal)
        out.append((columns, target))
    return out


def of_elements(load: DistributedLoad) -> list[tuple[slice, Array]]:
    """Return the forces and moments of a distributed load on the nodes of every element of the beam, with their columns:
    [E, n, 3] each."""
    basis, out = load.beam.basis, []
    # forces do work on positions, moments on the spins of the directors: each with its own basis
    for which, (given, s, weight, shape) in enumerate((
            (load.force, basis.mass_point_s, basis.mass_weight, basis.mass_phi_values),
            (load.moment, basis.point_s, basis.weight, basis.dir))):
        columns = slice(3 * which, 3 * which + 3)
        if not callable(given):
            values = np.broadcast_to(np.zeros(3) if given is None else given, (*s.shape, 3))
            out.append((columns, np.einsum("eg,egn,egc->enc", weight, shape, values)))
            continue
        on = points_of(load, which, basis.element_ends)
        nodal = np.zeros((*basis.element_nodes.shape, 3))
        np.add.at(nodal, on.element, np.einsum("pg,pgn,pgc->pnc", on.weight, basis.shapes(on.element, on.s)[which], on.values))
        out.append((columns, nodal))
    return out


class Points(NamedTuple):
    """Quadrature points of P pieces of elements, g in each."""

    element: Array   # int64 [P]
    s: Array         # float64 [P, g], m
    weight: Array    # float64 [P, g], m
    values: Array    # float64 [P, g, 3]: of the load there, per length


def points_of(load: DistributedLoad, which: int, ends: Array) -> Points:
    """Return points that integrate the force (0) or moment (1) of a load, a function of s, over elements with these ends [E + 1]:
    pieces are halved until halves make no difference, so that jumps and kinks may lie anywhere. Raises SceneError: the function
    jumps too often."""
    # points at both ends, so that a jump near an end is found
    last = load.beam.degree + 2
    at = gll_nodes(last)
    share = 2.0 / (last * (last + 1) * np.polynomial.legendre.legval(at, np.eye(last + 1)[last])**2)
    field = load.moment_at if which else load.force_at

    def look(a: Array, b: Array) -> list[Array]:
        half = 0.5 * (b - a)[:, None]
        s = 0.5 * (a + b)[:, None] + half * at
        return [s, half * share, field(s.reshape(-1)).reshape(*s.shape, 3)]

    def sums(s: Array, weight: Array, values: Array) -> tuple[Array, Array]:
        # integrals with a linear weight check the moment of the forces, too
        lever = (s - middle[:, None]) / (b - a)[:, None]
        return np.einsum("pg,pgc->pc", weight, values), np.einsum("pg,pgc->pc", weight * lever, values)

    sizes = np.diff(ends)
    pieces = max(PIECES, -(-LEAST_PIECES // sizes.size))
    cuts = ends[:-1, None] + sizes[:, None] * np.linspace(0.0, 1.0, pieces + 1)
    cuts[:, -1] = ends[1:]
    element, a, b = np.repeat(np.arange(sizes.size), pieces), cuts[:, :-1].reshape(-1), cuts[:, 1:].reshape(-1)
    whole, largest = look(a, b), 0.0
    found: list[list[Array]] = []
    while a.size:
        if a.size > MOST_PIECES:
            raise SceneError(f"{load.kind} {load.name!r}: {('force', 'moment')[which]}(s) changes too often along "
                             f"{load.beam.label} to be integrated. It must return the same numbers at the same s, and be smooth "
                             "except for a few jumps and kinks")
        middle = 0.5 * (a + b)
        left, right = look(a, middle), look(middle, b)
        halves = [np.concatenate(x, axis=1) for x in zip(left, right)]
        largest = max(largest, float(np.max(np.abs(halves[2]))))
        off = np.max(np.abs(np.array(sums(*whole)) - np.array(sums(*halves))), axis=(0, 2))
        good = (off <= ALIKE * largest * sizes[element]) | (b - a <= SHORTEST * sizes[element])
        found.append([element[good], *(x[good] for x in halves)])
        more = ~good
        whole = [np.concatenate((x[more], y[more])) for x, y in zip(left, right)]
        element = np.tile(element[more], 2)
        a, b = np.concatenate((a[more], middle[more])), np.concatenate((middle[more], b[more]))
    return Points(*(np.concatenate(x) for x in zip(*found)))


def _timed_by(scene: Scene, times: list[Any]) -> list[str]:
    """Return the names of the loads with these time functions, for messages."""
    names = [["gravity"] * (scene.gravity_time is time) for time in times]
    named = [(load.time, f"{load.kind} {load.name!r}") for load in [*scene.loads, *scene.distributed]]
    named += [(net.time, f"the loads of {net.label}") for net in scene.nets if net.loads is not None]
    for time, name in named:
        next(x for x, known in zip(names, times) if known is time).append(name)
    return [", ".join(x[:3]) + (", ..." if len(x) > 3 else "") for x in names]
