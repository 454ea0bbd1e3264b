"""The initial state: positions, triads and velocities that agree with all connections, supports and sliders."""
from __future__ import annotations

from typing import Any

import numpy as np

from .connections import ARM, POSITION, TRIAD, Connections
from .errors import SceneError
from .kernels.work import State
from .numbering import NodeList
from .scene import PointMass, RigidBody, Scene
from .tables import Elements

Array = np.ndarray


def initial_state(scene: Scene, nodes: NodeList, joints: Connections, elements: list[Elements]) -> State:
    """State at t = 0.

    Raises
    ------
    SceneError
        A slider's point off the discrete curve, or velocities that a connection, a support or a slider does not allow, unless
        the scene asks for their projection.
    """
    n = len(nodes)
    lines = _contact_lines(scene, nodes)
    for slider, line in zip(scene.sliders, lines):
        _place(scene, nodes, slider, line)
    v, omega = _given_velocities(scene, nodes)
    _follow_sliders(scene, nodes, v, lines)
    tied = joints.tied
    masses = [nodes.start(mass) for mass in scene.masses if mass.velocity is None and tied[nodes.start(mass)]]
    v[masses], omega[masses] = (x[masses] for x in _tied_velocities(nodes, joints, v, omega))
    wrong = _mismatch(scene, nodes, joints, v, omega, lines)
    if wrong:
        scale = max(float(np.max(np.linalg.norm(v, axis=1))), float(np.max(np.linalg.norm(omega, axis=1))) * _size(nodes))
        size, text = max(wrong)
        if size > 1e-10 * scale:
            if not scene.project_velocities:
                raise SceneError(f"{text}: the initial velocities violate it by {size:.6g} m/s; make them consistent, or have "
                                 "them projected (smallest change in the mass norm) with Scene(..., project_velocities=True)")
            v, omega = _project(scene, nodes, joints, elements, v, omega, lines)
    # what is held stands still exactly, also after a projection: no step would correct it
    v[~tied & (joints.held & 7 != 0)] = 0.0
    omega[(joints.spin_root == np.arange(n)) & (joints.held & 56 != 0)] = 0.0
    follows = _tied_velocities(nodes, joints, v, omega)
    v[tied], omega[tied] = (x[tied] for x in follows)
    q = np.zeros((n, 4, 3))
    q[:, 0], q[:, 1:] = nodes.phi, nodes.directors
    # zeros that nothing writes to take no memory
    rates = np.zeros((n, 4, 3))
    if v.any():
        rates[:, 0] = v
    if omega.any():
        rates[:, 1:] = np.cross(omega[:, None, :], nodes.directors)
    s = np.array([slider.at for slider in scene.sliders], dtype=float)
    return State(q.reshape(-1), rates.reshape(-1), s, np.zeros(3 * s.size))


def _size(nodes: NodeList) -> float:
    return float(np.max(np.ptp(nodes.phi, axis=0))) or 1.0


def _contact_lines(scene: Scene, nodes: NodeList) -> list[tuple[Array, Array, Array, int]]:
    """Nodes under every slider, their shape functions and slopes, and the node that slides."""
    out = []
    for slider in scene.sliders:
        first, values, slopes = slider.beam.basis.curve(slider.curve).evaluate(slider.at)
        keep = np.flatnonzero((values[0] != 0.0) | (slopes[0] != 0.0))
        number = nodes.start(slider.beam) + int(first[0]) + keep
        out.append((number, values[0, keep], slopes[0, keep], nodes.number(slider.point)))
    return out


def _place(scene: Scene, nodes: NodeList, slider: Any, line: tuple[Array, Array, Array, int]) -> None:
    """Point masses move onto the discrete curve; anything else has to lie on it."""
    number, values, _, point = line
    curve = values @ nodes.phi[number]
    gap = float(np.linalg.norm(nodes.phi[point] - curve))
    if isinstance(slider.point.owner, PointMass) and slider.point.owner.position is None:
        nodes.phi[point] = curve
    elif gap > 1e-9 * slider.beam.length:
        raise SceneError(f"slider {slider.name!r}: {slider.point} lies {gap:.3g} m off the discrete curve of "
                         f"{slider.beam.label} at={slider.at:.6g}: the interpolation of a curved beam meets its shape at the "
                         "nodes only; start at a node, use more elements or a higher degree, or slide a PointMass without "
                         "position")


def _given_velocities(scene: Scene, nodes: NodeList) -> tuple[Array, Array]:
    """What the scene says, contribution by contribution: v [N, 3], spin [N, 3]."""
    n = len(nodes)
    v, omega = np.zeros((n, 3)), np.zeros((n, 3))
    for net in scene.nets:
        for mine, given in zip((v, omega), net.motion):
            mine[nodes.span(net)] += given
    for field in scene.velocities:
        at, s = nodes.span(field.beam), field.beam.node_s
        v[at] += field.beam.basis.fit_positions(field.velocity_at(s))
        omega[at] += field.spin_at(s)
    for part in [*scene.bodies, *scene.masses]:
        at = nodes.span(part)
        if part.velocity is not None:
            v[at] += part.velocity
        if isinstance(part, RigidBody):
            omega[at] += part.spin
    for motion in scene.motions:
        for part in motion.objects or [*scene.beams, *scene.nets, *scene.bodies, *scene.masses]:
            at = nodes.span(part)
            v[at] += motion.velocity + np.cross(motion.spin, nodes.phi[at] - motion.about)
            omega[at] += motion.spin
    for owner_node, arm in nodes.arm_owner:
        omega[arm] = omega[owner_node]
        v[arm] = v[owner_node] + np.cross(omega[owner_node], nodes.phi[arm] - nodes.phi[owner_node])
    return v, omega


def _follow_sliders(scene: Scene, nodes: NodeList, v: Array, lines: list[tuple[Array, Array, Array, int]]) -> None:
    """A point mass without a velocity of its own moves with its slider."""
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        mass = slider.point.owner
        if isinstance(mass, PointMass) and mass.velocity is None:
            moved = any(m.objects is None or mass in m.objects for m in scene.motions)
            along = (slopes @ nodes.phi[number]) * (slider.rate or 0.0)
            if slider.rate is not None or not moved:
                v[point] = values @ v[number] + along
            # with a rigid motion and no rate the mass keeps the motion it was given


def _tied_velocities(nodes: NodeList, joints: Connections, v: Array, omega: Array) -> tuple[Array, Array]:
    """Velocity and spin that the entries of tied nodes give them, both [N, 3]; zero and their own where there are none."""
    owner, kind, target = joints.owner, joints.kind, joints.target
    spin = omega.copy()
    share = v[target]
    arm = kind == ARM
    to = target[arm]
    share[arm] = np.cross(omega[to], (joints.offset[arm][:, None, :] @ nodes.directors[to])[:, 0])
    turns = kind == TRIAD
    velocity = np.stack([np.bincount(owner[~turns], share[~turns, c], minlength=len(v)) for c in range(3)], axis=1)
    spin[owner[turns]] = omega[target[turns]]
    return velocity, spin


def _mismatch(scene: Scene, nodes: NodeList, joints: Connections, v: Array, omega: Array,
              lines: list[tuple[Array, Array, Array, int]]) -> list[tuple[float, str]]:
    """(size in m/s, what) of what the velocities violate, the worst of every kind."""
    size = _size(nodes)
    tied, turning = joints.tied, nodes.rank != 9
    alone = joints.spin_root == np.arange(len(v))
    velocity, spin = _tied_velocities(nodes, joints, v, omega)
    out = []
    for what, error, where in (
            ("connection of {}", v - velocity, tied),
            ("connection of {} (rotation)", (omega - spin) * size, tied & turning),
            ("support of {}", v, ~tied & (joints.held & 7 != 0)),
            ("support of {} (rotation)", omega * size, alone & (joints.held & 56 != 0) & turning)):
        k = np.flatnonzero(where)
        if k.size:
            amount = np.linalg.norm(error[k], axis=1)
            worst = int(np.argmax(amount))
            out.append((float(amount[worst]), what.format(nodes.labels[k[worst]])))
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        relative = v[point] - values @ v[number]
        tangent = slopes @ nodes.phi[number]
        rate = float(relative @ tangent / (tangent @ tangent))
        out.append((float(np.linalg.norm(relative - rate * tangent)), f"slider {slider.name!r}"))
        if slider.rate is not None:
            out.append((abs(rate - slider.rate), f"slider {slider.name!r} (rate {slider.rate:g} m/s against {rate:g} m/s)"))
    return out


def _project(scene: Scene, nodes: NodeList, joints: Connections, elements: list[Elements], v: Array, omega: Array,
             lines: list[tuple[Array, Array, Array, int]]) -> tuple[Array, Array]:
    """The consistent velocities nearest to the given ones in the kinetic energy."""
    from scipy import sparse
    from scipy.sparse.linalg import splu
    n = len(nodes)
    mass = _mass_matrix(scene, nodes, elements)
    # rows of the constraints on (v, omega) of all nodes
    rows: list[Array] = []
    columns: list[Array] = []
    data: list[Array] = []
    right: list[float] = []

    def skew(x: Array) -> Array:
        return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])

    def add(parts: list[tuple[int, int, Array]], value: Array) -> None:
        """sum of matrices [m, 3] on (node, 0 = v or 1 = omega) equals value [m]."""
        m = len(value)
        for node, which, matrix in parts:
            i, j = np.nonzero(np.ones((m, 3)))
            rows.append(len(right) + i)
            columns.append(6 * node + 3 * which + j)
            data.append(matrix[i, j])
        right.extend(float(x) for x in value)

    eye = np.eye(3)
    for k, entries in joints.entries.items():
        parts = [(k, 0, -eye)]
        for kind, target, offset, _ in entries:
            if kind == POSITION:
                parts.append((target, 0, eye))
            elif kind == ARM:
                parts.append((target, 1, -skew(offset @ nodes.directors[target])))
            elif target != k:
                add([(k, 1, -eye), (target, 1, eye)], np.zeros(3))
        add(parts, np.zeros(3))
    for k in np.flatnonzero(joints.held).tolist():
        if joints.held[k] & 7 and k not in joints.entries:
            add([(k, 0, eye)], np.zeros(3))
        if joints.held[k] & 56 and joints.spin_root[k] == k:
            add([(k, 1, eye)], np.zeros(3))
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        tangent = slopes @ nodes.phi[number]
        if slider.rate is None:
            # any speed along the tangent: two rows across it
            _, _, across = np.linalg.svd(tangent[None] / np.linalg.norm(tangent))
            lead, value = across[1:], np.zeros(2)
        else:
            lead, value = eye, slider.rate * tangent
        add([(point, 0, lead), *((int(k), 0, -x * lead) for k, x in zip(number, values))], value)
    g = sparse.csr_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(len(right), 6 * n))
    given = np.concatenate((v, omega), axis=1).reshape(-1)
    # tiny weight on unknowns without mass, so that they keep their value
    weight = mass + sparse.eye(6 * n) * (1e-9 * mass.diagonal().max())
    system = sparse.bmat([[weight, g.T], [g, -1e-14 * sparse.eye(len(right)) / mass.diagonal().max()]]).tocsc()
    solution = splu(system).solve(np.concatenate((weight @ given, right)))[:6 * n].reshape(n, 6)
    return solution[:, :3].copy(), solution[:, 3:].copy()


def _mass_matrix(scene: Scene, nodes: NodeList, elements: list[Elements]) -> Any:
    """Reduced mass matrix on (v, omega) of all nodes, sparse [6 N, 6 N]."""
    from scipy import sparse
    n = len(nodes)
    d = nodes.directors

    def skew(x: Array) -> Array:
        """[..., 3] -> [..., 3, 3]"""
        o = np.zeros(x.shape[:-1])
        return np.stack((np.stack((o, -x[..., 2], x[..., 1]), -1), np.stack((x[..., 2], o, -x[..., 0]), -1),
                         np.stack((-x[..., 1], x[..., 0], o), -1)), -2)

    rows, columns, data = [], [], []
    for part in elements:
        a, b = np.broadcast_arrays(part.nodes[:, :, None], part.nodes[:, None, :])
        a, b = a.reshape(-1), b.reshape(-1)
        density = np.repeat(part.inertia[part.section], part.nodes.shape[1]**2, axis=0)
        block = np.zeros((a.size, 6, 6))
        block[:, :3, :3] = (density[:, 0] * part.mass_phi.reshape(-1))[:, None, None] * np.eye(3)
        for k in (1, 2):
            sa, sb = skew(d[a, k]), skew(d[b, k])
            block[:, 3:, 3:] += (density[:, k] * part.mass_dir.reshape(-1))[:, None, None] * np.einsum("mki,mkj->mij", sa, sb)
        i, j = np.nonzero(np.ones((6, 6)))
        rows.append((6 * a[:, None] + i).reshape(-1))
        columns.append((6 * b[:, None] + j).reshape(-1))
        data.append(block[:, i, j].reshape(-1))
    for part in [*scene.bodies, *scene.masses]:
        k = nodes.start(part)
        block = np.zeros((6, 6))
        block[:3, :3] = part.mass * np.eye(3)
        if isinstance(part, RigidBody):
            block[3:, 3:] = d[k].T @ part.inertia @ d[k]
        i, j = np.nonzero(np.ones((6, 6)))
        rows.append(6 * k + i)
        columns.append(6 * k + j)
        data.append(block[i, j])
    for net in scene.nets:
        if net.masses is not None:
            at = 6 * (nodes.start(net) + net.junction)[:, None] + np.arange(3)
            rows.append(at.reshape(-1))
            columns.append(at.reshape(-1))
            data.append(np.repeat(net.masses, 3))
    return sparse.csr_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(6 * n, 6 * n))
