"""Velocities that agree with all connections, from given ones: parts change their rigid motions first, and bend only where that
is not enough."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.linalg.least_norm import nearest, rigid_change, rigid_motions
from fastbeam.model.connections import ARM, POSITION, Connections, held_axes
from fastbeam.model.contact.sleeve_conditions import Section
from fastbeam.model.joints.constraints import KeptLink
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import Elements, strains_of
from fastbeam.scene import RigidBody, Scene

Array = np.ndarray
# share of what was given, below which all velocities that are left are round-off
NOTHING = 1e-11
Line = tuple[Array, Array, Array, int]


def project(scene: Scene, nodes: NodeList, joints: Connections, elements: list[Elements], v: Array, omega: Array,
            lines: list[Line], kept: list[KeptLink], held: list[tuple[int, Section]], moving: tuple[Array, Array],
            ) -> tuple[Array, Array, tuple[float, float]]:
    """Velocities and spins [N, 3] that all connections, supports and sliders allow, and the kinetic energy before and after, J.

    Every beam, body and mass changes its rigid motion, with the least kinetic energy of the change; where connections miss more
    than that, velocities change in the norm of the masses: a beam begins to bend only where no rigid motions agree, or where
    supports would stop what was given a velocity. What has no inertia changes as little as it may. moving: velocities and spins
    of supports.
    """
    mass = mass_matrix(scene, nodes, elements)
    matrix, right = _constraints(scene, nodes, joints, lines, kept, held, moving)
    given = np.concatenate((v, omega), axis=1).reshape(-1)
    rigid = rigid_motions(nodes.phi, nodes.part)
    begin = given + rigid_change(mass, matrix, right, given, rigid)
    x = nearest(mass, matrix, right, begin, np.arange(given.size) % 6 >= 3)
    if np.max(np.abs(x)) < NOTHING * np.max(np.abs(given), initial=0.0):
        x[:] = 0.0
    found = x.reshape(-1, 6)
    energies = 0.5 * float(given @ (mass @ given)), 0.5 * float(x @ (mass @ x))
    return found[:, :3].copy(), found[:, 3:].copy(), energies


def _constraints(scene: Scene, nodes: NodeList, joints: Connections, lines: list[Line],
                 kept: list[KeptLink], held: list[tuple[int, Section]], moving: tuple[Array, Array]) -> tuple[Any, Array]:
    """Rows of all constraints on (v, omega) of all nodes, sparse [m, 6 N], and their right-hand sides [m]."""
    from scipy import sparse
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
    axes = held_axes(joints.held)
    for k in np.flatnonzero(joints.held).tolist():
        if joints.held[k] & 7 and k not in joints.entries:
            add([(k, 0, eye[axes[k]])], moving[0][k][axes[k]])
        if joints.held[k] & 56 and joints.spin_root[k] == k:
            add([(k, 1, eye)], moving[1][k])
    for link in kept:
        if link.law.holds:
            by_motion = link.by_motion(nodes.coordinates(link.node))
            add([(node, which, lead) for node, *both in by_motion for which, lead in enumerate(both)], link.rates())
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        if slider.starts_off:
            continue
        tangent = slopes @ nodes.phi[number]
        if slider.rate is None:
            # any speed along the tangent: two rows across it
            _, _, across = np.linalg.svd(tangent[None] / np.linalg.norm(tangent))
            lead, value = across[1:], np.zeros(2)
        else:
            lead, value = eye, slider.rate * tangent
        add([(point, 0, lead), *((int(k), 0, -x * lead) for k, x in zip(number, values))], value)
    for k, section in held:
        spins, of_holder = section.by_spins()
        parts = [(int(root), 1, spins[:, a]) for a, root in enumerate(section.roots[:-1])]
        parts.append((int(section.roots[-1]), 1, of_holder))
        # the section changes along the beam
        parts += [(int(node), 0, np.outer(section.values(1), x)) for node, x in zip(*along_curve(nodes, lines[k]))]
        add(parts, np.zeros(section.pairs))
    where = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_matrix((np.concatenate(data), where), shape=(len(right), 6 * len(nodes))), np.array(right)


def strain_rates(nodes: NodeList, elements: list[Elements], v: Array, omega: Array) -> tuple[float, int]:
    """The largest rate of a strain of beams, 1/s, those of bending and torsion at the radius of gyration of the stiffness, and a
    node of its element."""
    worst, where = 0.0, 0
    moving = np.any(v != 0.0, axis=1) | np.any(omega != 0.0, axis=1)
    for part in elements:
        some = np.flatnonzero(np.any(moving[part.nodes], axis=1))
        if not some.size:
            continue
        at = part.nodes[some]
        # derivative along the motion by a complex step
        x = nodes.phi[at] + 1e-30j * v[at]
        d = nodes.directors[at] + 1e-30j * np.cross(omega[at][:, :, None], nodes.directors[at])
        found = strains_of(part.strain, np.einsum("egn,enc->egc", part.phi_s[some], x),
                           *(np.einsum("egn,enkc->egkc", of[some], d) for of in (part.dir, part.dir_s)))
        stiff = part.stiffness[part.section[some]][:, np.arange(6), np.arange(6)]
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = np.nan_to_num(np.sqrt(stiff[:, 3:] / stiff[:, :1]))
        rates = np.abs(found.imag) * 1e30
        rates[..., 3:] *= radius[:, None]
        largest = rates.max(axis=(1, 2))
        e = int(np.argmax(largest))
        if largest[e] > worst:
            worst, where = float(largest[e]), int(at[e, 0])
    return worst, where


def along_curve(nodes: NodeList, line: Line) -> tuple[Array, Array]:
    """Nodes [n + 1] and vectors [n + 1, 3] whose sum of products with velocities is the rate of a slider, m/s."""
    number, values, slopes, point = line
    tangent = slopes @ nodes.phi[number]
    along = tangent / (tangent @ tangent)
    return np.append(number, point), np.concatenate((-np.outer(values, along), along[None]))


def mass_matrix(scene: Scene, nodes: NodeList, elements: list[Elements]) -> Any:
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
