"""Steady motions: a scene that spins about an axis, beams that travel along themselves; their forces of inertia in statics and
vibrations (theory.md 17).

The mass matrix of positions and directors is constant, so that with the rate of a coordinate q' + A q, A the steady motion, the
forces of inertia are exactly M q'' + 2 M A q' + M A A q (spin), or the same once integrated by parts (travel).
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fastbeam.interface.arguments import LARGEST, Anything, Number, Vector, checked, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.layout import layout_of
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.maps import RowMap, mass_map, velocity_map
from fastbeam.model.model import Model
from fastbeam.scene import Beam

Array = np.ndarray
# part of loads across the axis of a spin that is round-off
ACROSS = 1e-12


@checked(rate=Number(unit="rad/s"), axis=Vector, point=Vector)
class Spin:
    """A steady spin of the whole scene, with its supports, about an axis that stays in space.

    Parameters
    ----------
    rate : float
        rad/s.
    axis : array_like (3,)
        Direction, of any length.
    point : array_like (3,)
        On the axis, m.

    Raises
    ------
    SceneError
        The axis is zero.

    Examples
    --------
    >>> import fastbeam as fb
    >>> fb.Spin(10.0, axis=(0, 0, 2))
    Spin(10 rad/s about (0, 0, 1) through (0, 0, 0))
    """

    def __init__(self, rate: float, axis: ArrayLike = (0.0, 0.0, 1.0), point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        size = float(np.linalg.norm(np.asarray(axis)))
        if size == 0.0:
            raise SceneError(f"Spin: axis must not be zero, got {shown(axis)}")
        self.rate, self.axis, self.point = rate, np.asarray(axis) / size, np.asarray(point)

    def __repr__(self) -> str:
        return f"Spin({self.rate:g} rad/s about {shown(tuple(self.axis))} through {shown(tuple(self.point))})"


@checked(speeds=Anything())
class Travel:
    """Beams whose material runs along them, through the places where their nodes are held.

    Supports, sliders and whatever holds a beam stand in space, and its material passes: a belt over pulleys, a rope through
    eyes. Positions at both ends of a beam that travels are held, or the ends are joined to beams that travel as well (a loop).
    The flow of rotary inertia through a held end that turns is left out: it is none at clamped ends and in loops.

    Parameters
    ----------
    speeds : mapping
        {beam: speed}: unstressed length that passes, from start to end, m/s; negative: from end to start. Beams have
        interpolation "lagrange".

    Raises
    ------
    SceneError
        No beams, or a speed that is no number.
    """

    def __init__(self, speeds: Mapping[Beam, float]) -> None:
        if not isinstance(speeds, Mapping) or not speeds:
            raise SceneError(f"Travel: speeds must be a mapping {{beam: speed in m/s}}, got {shown(speeds)}")
        self.speeds: dict[Beam, float] = {}
        for beam, speed in speeds.items():
            value = real(speed)
            if not isinstance(beam, Beam) or value is None or not abs(value) <= LARGEST:
                raise SceneError(f"Travel: speeds must be a mapping {{beam: speed in m/s}}, got {shown(beam)}: {shown(speed)}")
            if beam.basis.interpolation != "lagrange":
                raise SceneError(f"Travel: {beam.label} has interpolation {beam.basis.interpolation!r}; beams that travel need "
                                 "'lagrange'")
            self.speeds[beam] = value

    def __repr__(self) -> str:
        return f"Travel({', '.join(f'{beam.name} {speed:g} m/s' for beam, speed in self.speeds.items())})"


def which_steady_motion(value: Any) -> Spin | Travel:
    """Check that an argument is a steady motion. Raises Refusal."""
    from fastbeam.interface.arguments import Instance
    motion: Spin | Travel = Instance((Spin, Travel), "an fb.Spin(rate, axis=...) or fb.Travel({beam: speed})")(value)
    return motion


class Field(NamedTuple):
    """Matrices of a steady motion, on the 12 N coordinates of all nodes of a model in space."""

    pull: Any        # sparse, symmetric: forces of inertia on the shape q are pull @ (q - origin)
    origin: Array    # [12 N]
    coriolis: Any    # sparse, skew: forces against rates of the coordinates


def check_steady(who: str, model: Model, motion: Spin | Travel, factors: Array) -> None:
    """Refuse scenes that are not steady in such a motion, under load factors [K]. Raises SceneError."""
    require(Analysis.STEADY, model, who)
    if isinstance(motion, Spin):
        loads = model.loads
        for k, factor in enumerate(factors.tolist()):
            of_row = (loads.value.reshape(-1, 8)[loads.vector == k] if k else loads.first.reshape(-1, 8))
            vectors = of_row[:, :6].reshape(-1, 3)
            across = vectors - np.outer(vectors @ motion.axis, motion.axis)
            if factor and np.max(np.abs(across), initial=0.0) > ACROSS * np.max(np.abs(vectors), initial=0.0):
                raise SceneError(f"{who}: loads or gravity act across the axis of {motion!r}. They do not rotate with the spin, "
                                 "so no steady motion exists. Leave them out, load_factor=0, or let them act along the axis")
    else:
        fixed, first = model.fixed_mask, np.unique(model.pattern.row_of, return_index=True)[1]
        alone = np.zeros(model.n_nodes, bool)
        alone[first] = np.bincount(model.pattern.row_of)[model.pattern.row_of[first]] == 1
        tied = np.zeros(model.n_nodes, bool)
        if model.ties is not None:
            tied[model.ties.slave] = tied[model.ties.target] = True
        for beam in motion.speeds:
            begin, count = _nodes(who, model, beam)
            for node in (begin, begin + count - 1):
                if fixed[node] & 7 != 7 and alone[node] and not tied[node]:
                    raise SceneError(f"{who}: {beam.label} travels, but nothing fixes the position of {model.node_label(node)}; "
                                     "fix both ends, or join them to beams that travel")


def _nodes(who: str, model: Model, beam: Beam) -> tuple[int, int]:
    """Return the first node of a beam and the number of its nodes. Raises SceneError: it is not in the scene."""
    try:
        return model.numbers.start(beam), beam.basis.n_nodes
    except KeyError:
        raise SceneError(f"{who}: {beam.label} is not in scene {model.scene_name!r}") from None


def field_of(who: str, model: Model, motion: Spin | Travel) -> Field:
    """Form the matrices of a steady motion of a model in space. Raises SceneError: a beam is not in the scene."""
    n = model.n_nodes
    if isinstance(motion, Travel):
        once, twice = (sparse.kron(x, sparse.eye(3), format="csr") for x in _along(who, model, motion))
        return Field(twice, np.zeros(12 * n), (once - once.T).tocsr())
    mass = mass_map(model)
    turn = motion.rate * np.cross(motion.axis, np.eye(3)).T
    each = sparse.eye(4 * n)
    origin = np.zeros((n, 4, 3))
    origin[:, 0] = motion.point
    return Field((mass @ sparse.kron(each, -turn @ turn, format="csr")).tocsr(), origin.reshape(-1),
                 (2.0 * mass @ sparse.kron(each, turn, format="csr")).tocsr())


def _along(who: str, model: Model, motion: Travel) -> tuple[Any, Any]:
    """Form int v m N N' ds and int v^2 m N' N' ds of beams that travel with speed v, m the inertia of positions and directors,
    sparse [4 N, 4 N] each."""
    n = model.n_nodes
    speed = np.zeros(n)
    inside = np.full(n, -1)
    for k, (beam, v) in enumerate(motion.speeds.items()):
        begin, count = _nodes(who, model, beam)
        speed[begin:begin + count], inside[begin:begin + count] = v, k
    rows, columns, once, twice = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)], [np.zeros(0)]
    for tables in (model.simo, model.green):
        for nn, nq, co, no, *_ in () if tables is None else tables.meta.tolist():
            at = tables.nodes[no:no + 8 * nn].reshape(nn, 8)
            live = np.flatnonzero((tables.rows[no:no + 8] != n) & (inside[at[0]] >= 0) & (inside[at[0]] == inside[at[-1]]))
            if not live.size:
                continue
            at = at[:, live]
            place = layout_of(SPACE, nn, nq)
            rho, j2, j3 = tables.tab[co + place.inertia:co + place.masses].reshape(3, 8)[:, live]
            point = tables.tab[co + place.point:co + place.inertia].reshape(nq, -1, 8)[:, :, live]
            # basis of positions and directors, the same in Lagrange elements
            weight, shape, slope = point[:, 0], point[:, 2:2 + 3 * nn:3], point[:, 3:3 + 3 * nn:3]
            v = speed[at[0]]
            first = np.einsum("gl,gal,gbl->abl", weight, shape, slope) * v
            second = np.einsum("gl,gal,gbl->abl", weight, slope, slope) * v * v
            a, b = np.broadcast_arrays(at[:, None], at[None])
            for k, inertia in ((0, rho), (2, j2), (3, j3)):
                rows.append((4 * a + k).reshape(-1))
                columns.append((4 * b + k).reshape(-1))
                once.append((inertia * first).reshape(-1))
                twice.append((inertia * second).reshape(-1))
    where = np.concatenate(rows), np.concatenate(columns)
    return tuple(sparse.csr_matrix((np.concatenate(x), where), shape=(4 * n, 4 * n)) for x in (once, twice))  # type: ignore


class SteadyForces:
    """Forces of inertia of a steady motion on the unknowns of the rows of a model, and their stiffness.

    who: the function that was called.
    model: Model in space.
    of: map of the rows of the same model.
    size: unknowns a row.
    share: share of the forces that acts.
    """

    def __init__(self, who: str, model: Model, motion: Spin | Travel, of: RowMap, size: int) -> None:
        self.motion, self.share = motion, 1.0
        self.field = field_of(who, model, motion)
        self._map, self._size, self._n = of, size, model.n_nodes

    def loads(self, q: Array) -> Array:
        """Return forces of inertia at coordinates q [12 N] on the rows, flat as `Work.f_ext` [8 (N + 1)]."""
        of = self._map
        lead = of.ties @ velocity_map(q.reshape(-1, 4, 3)) @ of.every
        out = np.zeros((self._n + 1, 8))
        of_rows = (lead.T @ self._force(q)).reshape(-1, self._size)
        out[:len(of_rows), :self._size] = of_rows
        return out.reshape(-1)

    def _force(self, q: Array) -> Array:
        """Return forces of inertia on all coordinates [12 N]."""
        return np.asarray(self.share * (self.field.pull @ (q.reshape(-1) - self.field.origin)))

    def rates(self, q: Array) -> Array | None:
        """Return second rates in time of the coordinates q [N, 4, 3] in space, as far as they act; None of beams that travel,
        whose inertia is not that of a motion of the nodes."""
        if isinstance(self.motion, Travel):
            return None
        turn = self.motion.rate * np.cross(self.motion.axis, np.eye(3)).T
        return np.asarray(self.share * (q - self.field.origin.reshape(q.shape)) @ (turn @ turn).T)

    def stiffness(self, q: Array) -> Any:
        """Return minus the derivative of these forces by the unknowns of the rows, sparse [m, m]."""
        force = self._force(q)
        lead = self._map.rates(q)
        return (turning_stiffness(self._map, q, force) - self.share * (lead.T @ (self.field.pull @ lead))).tocsr()


def turning_stiffness(of: RowMap, q: Array, force: Array) -> Any:
    """Return minus the derivative, by the unknowns of the rows, of moments of constant forces on all coordinates q [12 N], whose
    directors turn, sparse [m, m]. It is symmetric once the moments of all forces are in equilibrium, as in the tangent of
    beams."""
    d = q.reshape(-1, 4, 3)[:, 1:]
    # a force on a director turns with it: of the moment d x f by a spin
    own = (of.ties.T @ force.reshape(-1)).reshape(-1, 4, 3)[:, 1:]
    n = len(d)
    blocks = np.zeros((n, 6, 6))
    blocks[:, 3:, 3:] = (np.einsum("nic,nic->n", own, d)[:, None, None] * np.eye(3) - np.einsum("nic,nie->nce", d, own))
    turned = sparse.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(6 * n, 6 * n))
    return of.rows.T @ turned @ of.rows
