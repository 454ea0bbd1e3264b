"""The second stage of the compiler: elements, bodies, loads and the initial state as arrays, before anything is packed."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .connections import Connections
from .added import Added, added_of
from .dissipation import Dragged, dragged_of
from .initial import initial_state
from .multipliers import KeptLink
from .kernels.work import State
from .numbered import Numbered
from .numbering import NodeList
from .prescribed import PrescribedMotions, prescribed_of
from .scene import DistributedLoad, RigidBody, Scene
from .tables import Elements, elements_of

Array = np.ndarray


class Loads(NamedTuple):
    """Loads on the rows of the nodes, that of a node that shares a row at the node that has it."""

    vectors: Array     # float64 [K, N, 6], N and N m
    times: list[Any]   # factor of every vector; None: constant
    names: list[str]   # what each time function belongs to
    weight: Array      # float64 [N], kg
    constant: Array    # float64 [N, 3]: forces without time functions, N


@dataclass(frozen=True)
class Unpacked:
    """A scene as arrays.

    Attributes
    ----------
    numbered : Numbered
    elements : list of Elements
        Of every beam, then of every net.
    bodies : int64 [B]
        Nodes of rigid bodies and masses.
    inertia : float64 [B, 4, 4]
        Of (v, rates of the directors) of these.
    loads : Loads
    gravity : float64 [3]
        m/s^2.
    kept : list of KeptLink
        Joints with multipliers.
    state : State
        At t = 0, in space.
    projected : str
        What a projection of the initial velocities changed; empty where there was none.
    prescribed : PrescribedMotions or None
        Supports that move.
    dragged : Dragged or None
        Nodes with drag.
    added : Added or None
        Nodes with added mass.
    """

    numbered: Numbered
    elements: list[Elements]
    bodies: Array
    inertia: Array
    loads: Loads
    gravity: Array
    kept: list[KeptLink]
    state: State
    projected: str
    prescribed: PrescribedMotions | None
    dragged: Dragged | None
    added: Added | None

    @property
    def nodes(self) -> NodeList:
        """Of the scene."""
        return self.numbered.nodes

    @property
    def joints(self) -> Connections:
        """Of the scene."""
        return self.numbered.joints


def unpack(scene: Scene, numbered: Numbered, known: State | None = None) -> Unpacked:
    """Arrays of a scene whose nodes have numbers; known: its initial state, where that is not what the scene says.

    Raises
    ------
    SceneError
        Initial velocities that a connection, a support or a slider does not allow.
    """
    nodes, joints, kept = numbered.nodes, numbered.joints, numbered.links.kept
    elements = [elements_of(part, nodes.start(part), nodes.phi, nodes.directors) for part in [*scene.beams, *scene.nets]
                if all(part is not mesh.beam for mesh in scene.moving)]
    loads = _loads(scene, nodes, elements, joints.row_root)
    state, projected = (known, "") if known is not None else initial_state(scene, nodes, numbered.joints_at_start, elements, kept)
    # positions and triads of the node list are views of q: the same numbers, stored once
    coordinates = state.q.reshape(-1, 4, 3)
    nodes.phi, nodes.directors = coordinates[:, 0], coordinates[:, 1:]
    return Unpacked(numbered, elements, *_bodies(scene, nodes), loads, np.array(scene.gravity), kept, state, projected,
                    prescribed_of(scene, nodes, joints, numbered.length), dragged_of(scene, nodes, elements),
                    added_of(scene, nodes, elements))


def _with_mass(scene: Scene) -> list[Any]:
    """Bodies and masses, without the places of moving meshes."""
    places = {place for mesh in scene.moving for place in mesh.places}
    return [part for part in [*scene.bodies, *scene.masses] if part not in places]


def _bodies(scene: Scene, nodes: NodeList) -> tuple[Array, Array]:
    """Nodes [B] of bodies and masses, and their inertia [B, 4, 4]."""
    parts = _with_mass(scene)
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
    """All loads; row_root: int [N], the node whose row a node shares."""
    n = len(nodes)
    groups: list[tuple[Any, Array]] = []

    def group(time: Any) -> Array:
        for known, vector in groups:
            if known is time:
                return vector
        groups.append((time, np.zeros((n, 6))))
        return groups[-1][1]

    at = [part.nodes.reshape(-1) for part in elements]
    share = [(part.inertia[part.section, :1] * part.mass_phi.sum(axis=2)).reshape(-1) for part in elements]
    weight = np.bincount(np.concatenate(at), np.concatenate(share), minlength=n) if at else np.zeros(n)
    for body in _with_mass(scene):
        weight[nodes.start(body)] += body.mass
    for net in scene.nets:
        if net.masses is not None:
            weight[nodes.start(net) + net.junction] += net.masses
    if np.any(scene.gravity):
        vector = group(scene.gravity_time)
        vector[:, :3] += weight[:, None] * scene.gravity
        for mesh in scene.moving:
            # on a coordinate that is held: where kernels/moving_mesh.py finds the factor of gravity
            vector[nodes.start(mesh.places[0]), 1] = 1.0
    constant = np.zeros((n, 3))
    for net in scene.nets:
        if net.loads is not None:
            at = nodes.start(net) + net.junction
            group(net.time)[at, :3] += net.loads
            if net.time is None:
                constant[at] += net.loads
    for load in scene.loads:
        k = nodes.number(load.at)
        vector = group(load.time)
        vector[k, :3] += load.force
        vector[k, 3:] += load.moment
        if load.time is None:
            constant[k] += load.force
    for load in scene.distributed:
        vector = group(load.time)
        for columns, target in distributed(load, nodes):
            vector[:, columns] += target
            if load.time is None and columns.start == 0:
                constant += target
    vectors = np.zeros((len(groups), n, 6))
    for k, (_, vector) in enumerate(groups):
        for c in range(6):
            # nodes may share a row
            vectors[k, :, c] = np.bincount(row_root, vector[:, c], minlength=n)
    times = [time for time, _ in groups]
    return Loads(vectors, times, [_timed_by(scene, time) for time in times], weight, constant)


def distributed(load: DistributedLoad, nodes: NodeList) -> list[tuple[slice, Array]]:
    """Forces and moments of a distributed load on all nodes, with their columns: [N, 3] each."""
    at, out = nodes.start(load.beam) + load.beam.basis.element_nodes, []
    for columns, nodal in of_elements(load):
        target = np.zeros((len(nodes), 3))
        np.add.at(target, at, nodal)
        out.append((columns, target))
    return out


def of_elements(load: DistributedLoad) -> list[tuple[slice, Array]]:
    """Its forces and moments on the nodes of every element of the beam, with their columns: [E, n, 3] each."""
    basis, out = load.beam.basis, []
    # forces work on positions, moments on the spins of the directors: each with its own basis
    for field, s, weight_s, shape, columns in (
            (load.force_at, basis.mass_point_s, basis.mass_weight, basis.mass_phi_values, slice(0, 3)),
            (load.moment_at, basis.point_s, basis.weight, basis.dir, slice(3, 6))):
        values = field(s.reshape(-1)).reshape(*s.shape, 3)
        out.append((columns, np.einsum("eg,egn,egc->enc", weight_s, shape, values)))
    return out


def _timed_by(scene: Scene, time: Any) -> str:
    """What has this time function, for messages."""
    names = ["gravity"] * (scene.gravity_time is time)
    names += [f"{load.kind} {load.name!r}" for load in [*scene.loads, *scene.distributed] if load.time is time]
    names += [f"the loads of {net.label}" for net in scene.nets if net.loads is not None and net.time is time]
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
