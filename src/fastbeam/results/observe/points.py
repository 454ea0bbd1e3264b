"""Rows of observed points: positions, velocities, triads and spins from a state, section forces; accelerations and viscous
stresses from the steps around a row (theory.md (4.5))."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fastbeam.interface.arguments import real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.results.observe.resultants import Sections
from fastbeam.scene import Beam, NodeRef, PointMass, RigidBody
from fastbeam.scene.checks import Place, nearest_triads

Array = np.ndarray


class PointSeries:
    """Series of points by name.

    kinds: observed kinds, of which 'velocity', 'spin', 'orientation', 'acceleration' and 'section' concern points.
    points: mapping name -> NodeRef, RigidBody, PointMass or (beam, s).
    Raises SceneError: a point that is not in the scene.
    """

    def __init__(self, model: Model, kinds: Sequence[str], points: Mapping[str, Place] | None) -> None:
        given = points or {}
        self.places = {name: place_of(model, name, what) for name, what in given.items()}
        self.velocity, self.spin, self.orientation, self.acceleration = (
            kind in kinds and bool(given) for kind in ("velocity", "spin", "orientation", "acceleration"))
        self.sections = [_section(model, what) for what in given.values()] if "section" in kinds else []
        # those whose elements move with contacts
        self._moves = {k: x for k, x in enumerate(self.sections)
                       if x is not None and model.moving is not None and model.moving.has(x.first)}
        # those whose forces follow from balance: elements of beams with nodes that stay where they are
        self.balanced = [None if k in self._moves else x for k, x in enumerate(self.sections)]
        self._model = model
        # material points of beams whose elements move: first node of the beam, and arc length
        self._inside = {k: at for k, what in enumerate(given.values()) if (at := _on_moving(model, what)) is not None}
        # points on damped beams: number, and section
        self.damped = [(k, x) for k, x in enumerate(self.sections) if x is not None and x.viscosity is not None]
        # coordinates of these beams in the newest row
        self._kept: list[Array] = []

    def series(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of one row of every series."""
        n = len(self.places)
        given = {"points": n > 0, "point_velocity": self.velocity, "point_spin": self.spin,
                 "point_acceleration": self.acceleration, "section_force": bool(self.sections),
                 "section_moment": bool(self.sections)}
        triads = {"point_directors": (n, 3, 3)} if self.orientation else {}
        return {name: (n, 3) for name, there in given.items() if there} | triads

    def row(self, state: State) -> dict[str, Any]:
        """Return the series of points in a state; section forces without those of damping."""
        q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
        inside = self._inside_at(state)
        out: dict[str, Any] = {}
        if self.places:
            out["points"] = self._along(q, inside)
        if self.velocity:
            out["point_velocity"] = self._along(v, inside, 1)
        if self.spin:
            both = zip(self._triads(q, inside), self._triads(v, inside, 1))
            out["point_spin"] = np.array([_spin(*x) for x in both])
        if self.orientation:
            out["point_directors"] = np.array([nearest_triads(x) for x in self._triads(q, inside)])
        if self.sections:
            out |= {name: np.full((len(self.places), 3), np.nan) for name in ("section_force", "section_moment")}
            for k, section in enumerate(self.sections):
                if k in self._moves:
                    section = Sections(self._model, section.beam, section.s, state.s)
                if section is not None:
                    _put(out, k, section, q[section.span])
            self._kept = [q[section.span].copy() for _, section in self.damped]
        return out

    def slopes(self, state: State) -> Any:
        """Return derivatives of the positions of all points by coordinates and places of sliders in a state, sparse
        [3 P, 12 N + S]."""
        n = state.q.size
        out = sparse.lil_matrix((3 * len(self.places), n + state.s.size))
        for k, (nodes, weights) in enumerate(self.places.values()):
            if k in self._inside:
                nodes, values, by_places = self._model.moving.point_slope(*self._inside[k], state)
                weights = values[:, None] * (1.0, 0.0, 0.0, 0.0)
                out[3 * k:3 * k + 3, n:] = by_places.T
            for axis in range(3):
                out[3 * k + axis, (12 * nodes[:, None] + 3 * np.arange(4) + axis).reshape(-1)] = weights.reshape(-1)
        return out.tocsr()

    def _inside_at(self, state: State) -> dict[int, tuple[Array, Array]]:
        """Return coordinates and rates [4, 3] of points on beams whose elements move, by their numbers."""
        return {k: self._model.moving.point(*at, state) for k, at in self._inside.items()}

    def _along(self, x: Array, inside: dict[int, tuple[Array, Array]], rates: int = 0) -> Array:
        """Return positions or velocities [P, 3] from coordinates or their rates [N, 4, 3]; inside: of `_inside_at`."""
        out = np.array([np.einsum("ma,mac->c", weights, x[nodes]) for nodes, weights in self.places.values()])
        for k, of in inside.items():
            out[k] = of[rates][0]
        return out

    def _triads(self, x: Array, inside: dict[int, tuple[Array, Array]], rates: int = 0) -> Array:
        """Return directors, or their rates, [P, 3, 3]."""
        out = np.array([np.einsum("m,mkc->kc", weights[:, 0], x[nodes, 1:]) for nodes, weights in self.places.values()])
        for k, of in inside.items():
            out[k] = of[rates][1:]
        return out

    # --- what steps tell --------------------------------------------------------------------------------------------------
    @property
    def measured(self) -> int:
        """Number of values that a step gives for points."""
        rates = sum(section.through.size * 6 for _, section in self.damped)
        return (3 * len(self.places) if self.acceleration else 0) + rates

    def look(self, state: State) -> list[Array]:
        """Return copies of what `means` needs at an end of a step: velocities of points, coordinates and velocities of beams."""
        q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
        beams = [x[section.span].copy() for _, section in self.damped for x in (q, v)]
        return ([self._along(v, self._inside_at(state), 1)] if self.acceleration else []) + beams

    def means(self, before: list[Array], after: list[Array], h: float) -> Array:
        """Return accelerations and rates of strains, means over a step of size h between two looks, [measured]."""
        first = int(self.acceleration)
        middle = [0.5 * (a + b)[None] for a, b in zip(before[first:], after[first:])]
        rates = [section.strain_rates(q, v) for (_, section), q, v in zip(self.damped, middle[::2], middle[1::2])]
        return np.concatenate([x.reshape(-1) for x in [(b - a) / h for a, b in zip(before[:first], after[:first])] + rates])

    def add(self, row: dict[str, Any], found: Array) -> None:
        """Add means of steps at the time of the newest row to it, [measured]."""
        if self.acceleration:
            own, found = np.split(found, [3 * len(self.places)])
            row["point_acceleration"] = own.reshape(-1, 3)
        for (k, section), q in zip(self.damped, self._kept):
            shape = (1, *section.through.shape, 6)
            own, found = np.split(found, [section.through.size * 6])
            _put(row, k, section, q, own.reshape(shape))


def _put(out: dict[str, Any], k: int, section: Sections, q: Array, rates: Array | None = None) -> None:
    """Put section forces of point k into a row; q: coordinates of the nodes of its beam [A, 4, 3]."""
    found = section.at(np.zeros(1), q[None, :, 0], q[None, :, 1:], rates)
    out["section_force"][k] = found.N[0, 0], found.Q2[0, 0], found.Q3[0, 0]
    out["section_moment"][k] = found.T[0, 0], found.M2[0, 0], found.M3[0, 0]


def _spin(d: Array, rates: Array) -> Array:
    """Return the angular velocity [3], rad/s, that fits the rates of three directors best; exact for rigid motions also where
    interpolated directors are no triad."""
    return np.linalg.solve(np.sum(d * d) * np.eye(3) - d.T @ d, np.cross(d, rates).sum(axis=0))


def _section(model: Model, what: Any) -> Sections | None:
    """Return the section of an observed point; None where it lies on no beam."""
    if isinstance(what, NodeRef) and isinstance(what.owner, Beam):
        what = what.owner, float(what.owner.basis.node_s[what.index])
    return Sections(model, *what) if isinstance(what, tuple) else None


def _on_moving(model: Model, what: Any) -> tuple[int, float] | None:
    """Return the first node of a beam and the arc length of an observed point that elements move along; None for others."""
    if isinstance(what, NodeRef) and isinstance(what.owner, Beam) and 0 < what.index < what.owner.n_nodes - 1:
        what = what.owner, float(what.owner.basis.node_s[what.index])
    if model.moving is None or not isinstance(what, tuple):
        return None
    first = model.numbers.start(what[0])  # type: ignore[union-attr]
    return (first, float(what[1])) if model.moving.has(first) else None


def place_of(model: Model, name: str, what: Any, places: Array | None = None) -> tuple[Array, Array]:
    """Return nodes [m] of an observed point, and weights [m, 4] of their positions and directors in it. places: those of all
    sliders [S], with which elements of moving meshes move; default: for beams whose elements do not move."""
    if isinstance(what, tuple) and len(what) == 2 and isinstance(what[0], Beam):
        owner, s = what[0], what[1]
        at = real(s)
        if at is None or not 0.0 <= at <= owner.length:
            raise SceneError(f"point {name!r}: s={shown(s)} lies outside {owner.label} (0 to {owner.length:.6g} m)")
        first, values, _ = owner.basis.curve("own").evaluate(at)
        local, weights = int(first[0]) + np.arange(values.shape[1]), np.zeros((values.shape[1], 4))
        weights[:, 0] = values[0]
    else:
        node = what.center if isinstance(what, (RigidBody, PointMass)) else what
        if not isinstance(node, NodeRef):
            raise SceneError(f"point {name!r}: must be a node of a beam, a body or a point of one, a mass, or (beam, s), "
                             f"got {shown(what)}")
        owner, local, weights = node.owner, np.array([node.index]), np.array([[1.0, *node.offset]])
    try:
        found = model.numbers.start(owner) + local, weights
    except KeyError:
        raise SceneError(f"point {name!r}: {owner.label} is not in scene {model.scene_name!r}; observe parts of the compiled "
                         "scene") from None
    inside = None if places is None else _on_moving(model, what)
    return found if inside is None else model.moving.nodes_at(*inside, places)  # type: ignore[union-attr]
