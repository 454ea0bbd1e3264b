"""Projection of velocities onto all connections: parts change their rigid motions first, and bend only where that is not
enough."""
from __future__ import annotations

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.model.gap_rows import ConstraintGaps, across_of
from fastbeam.model.maps import mass_map, velocity_map
from fastbeam.model.model import Model
from fastbeam.model.numbering import NodeList
from fastbeam.model.start import nearest_velocities, sparse_rows
from fastbeam.model.tables import Elements, strains_of
from fastbeam.scene import Scene

Array = np.ndarray
# share of the given velocities below which projected ones are round-off
NOTHING = 1e-11
Line = tuple[Array, Array, Array, int]


def project(model: Model, scene: Scene, v: Array, omega: Array, moving: tuple[Array, Array],
            ) -> tuple[Array, Array, tuple[float, float]]:
    """Return the velocities and spins [N, 3] that all connections, supports and sliders allow, and the kinetic energy before and
    after, J.

    Every beam, body and mass changes its rigid motion, with the least kinetic energy of the change. If that is not enough,
    velocities change in the norm of the masses: a beam begins to bend only where no rigid motions agree, or where supports would
    stop a part with a given velocity. Velocities without inertia change as little as possible.

    model: Model of the scene at rest.
    v, omega: float64 [N, 3], velocities and spins of the scene.
    moving: tuple of float64 [N, 3], velocities and spins of supports.
    """
    rows = ConstraintGaps(model)
    gaps = rows.at(model.q0, model.s0)
    matrix, right = [], []
    for k, slider in enumerate(scene.sliders):
        if not slider.starts_off:
            # without a rate any speed along the tangent is allowed
            lead = np.eye(3) if slider.rate is not None else across_of(gaps.tangents[k])
            matrix.append(sparse.csr_matrix(lead) @ gaps.rates[3 * k:3 * k + 3])
            right.append(lead @ gaps.tangents[k] * (slider.rate or 0.0))
    right += [link.rates() for link in model.kept if link.law.holds]
    given, supports = (np.concatenate(x, axis=1).reshape(-1) for x in ((v, omega), moving))
    x = nearest_velocities(model, model.state(), sparse_rows(*matrix, gaps.rates[rows.others]),
                           np.concatenate((np.zeros(0), *right)), supports, given)
    if np.max(np.abs(x)) < NOTHING * np.max(np.abs(given), initial=0.0):
        x[:] = 0.0
    found, to_rates, mass = x.reshape(-1, 6), velocity_map(model.q0.reshape(-1, 4, 3)), mass_map(model)
    energies = [0.5 * float(rates @ (mass @ rates)) for rates in (to_rates @ given, to_rates @ x)]
    return found[:, :3].copy(), found[:, 3:].copy(), (energies[0], energies[1])


def strain_rates(nodes: NodeList, elements: list[Elements], v: Array, omega: Array) -> tuple[float, int]:
    """Return the largest strain rate of beams, 1/s, for bending and torsion at the radius of gyration of the stiffness, and a
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
    """Return nodes [n + 1] and vectors [n + 1, 3] whose sum of products with velocities is the rate of a slider, m/s."""
    number, values, slopes, point = line
    tangent = slopes @ nodes.phi[number]
    along = tangent / (tangent @ tangent)
    return np.append(number, point), np.concatenate((-np.outer(values, along), along[None]))
