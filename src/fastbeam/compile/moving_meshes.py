"""Scenes with beams whose elements move with contacts: rewriting for the compiler, and the feature (theory.md 5.12)."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.initial import tied_velocities
from fastbeam.compile.moving_contacts import along_of, joints_of, moment_of
from fastbeam.compile.numbered import Numbered, number
from fastbeam.compile.unpack import Unpacked, unpack
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.moving_beam import MovingBeam, momentum_sums, motion_of
from fastbeam.kernels.state import State, aligned
from fastbeam.model.analyses import AT_REST, Analysis, Lack, without_adjoint
from fastbeam.model.contact.moving_tables import Mesh, element_lengths, mass_matrix, masses, momenta, of_rates
from fastbeam.model.feature import Feature, OfRun
from fastbeam.model.maps import spins
from fastbeam.scene import (
    BallJoint,
    Beam,
    Bushing,
    Clamp,
    CylindricalJoint,
    Damper,
    DistanceJoint,
    InitialVelocity,
    Load,
    MovingMesh,
    Pin,
    PlanarJoint,
    PointMass,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    RigidConnection,
    RigidMotion,
    Scene,
    Sleeve,
    Slider,
    SphericalJoint,
    Spring,
    UniversalJoint,
)
from fastbeam.scene.moving_mesh import LineOfPlaces

Array = np.ndarray
JOINTS = (RevoluteJoint, PrismaticJoint, CylindricalJoint, PlanarJoint, UniversalJoint, SphericalJoint)
TAKEN = (Beam, PointMass, RigidBody, BallJoint, RigidConnection, DistanceJoint, *JOINTS, Clamp, Pin, Load, Slider, Spring, Damper,
         Bushing, InitialVelocity, RigidMotion, MovingMesh)

# reason why scenes with moving meshes have no tables of a plane
IN_SPACE = "moving meshes are available in space only"


@dataclass(frozen=True)
class Moving(Feature):
    """Moving meshes of a model."""

    key, title, order, is_told_first = "moving", "moving elements (MovingMesh)", 100, True
    lacks = (
        Lack((Analysis.PLANAR,), "moving elements", IN_SPACE, "use planar='auto'", lambda moving, asked: moving.names),
        Lack((Analysis.COMPARED,), "moving elements", "moving mesh with slider {name!r}: {who} does not support moving "
                                                         "elements",
             "compile the scene without MovingMesh", lambda moving, asked: moving.names),
        Lack((*AT_REST, Analysis.TRAVEL), "moving elements",
             "moving mesh with slider {name!r}: equilibria and modes do not support moving elements",
             "compile the scene without MovingMesh; solve_static(contacts='exact') has no mesh error at contacts either",
             lambda moving, asked: moving.names),
        Lack((Analysis.FILTERED,), "rho_inf: moving mesh with slider {name!r}: strains of moving elements are not filtered",
             "rho_inf: moving mesh with slider {name!r}: strains of moving elements are not filtered",
             "leave rho_inf out, or compile the scene without MovingMesh", lambda moving, asked: moving.names),
        Lack((Analysis.POINT_INSIDE,), "points inside",
             "point {who!r}: the elements of {name} move, so no node stays at a material point inside",
             "observe its start or end, or a point that slides on it",
             lambda moving, asked: [asked.part.label] * moving.has(asked.model.numbers.first.get(asked.part))),
        without_adjoint("moving elements"))

    tables: tuple[Any, ...]  # the terms
    names: list[str]  # names of the contacts
    # places, contacts, points, int64 [S]: nodes of their places, of the beams there, and of the sliding points
    places: Array
    contacts: Array
    points: Array
    # moments, along: joints that carry their moments, and that act along the beam, empty where there are none
    moments: list[str]
    along: list[str]
    line: Array  # int64 [*]: the point where the line of places begins, if forces act along a beam

    @property
    def history_size(self) -> int:
        """Number of history variables: momenta of every beam, and the work of its weight."""
        return sum(_size(table) for table in self.tables)

    @property
    def mass(self) -> float:
        """Mass of all beams, kg."""
        return sum(float(table.rho[0] * table.length[0]) for table in self.tables)

    def describe(self) -> list[tuple[str, str, list[str]]]:
        """Return the line of `print(model)`: contacts at which elements end."""
        contacts, beams = len(self.names), len(self.tables)
        where = f"{contacts} contact{'s' * (contacts > 1)} on {beams} beam{'s' * (beams > 1)}"
        return [("moving elements", f"end at {where}: ", self.names)]

    def has(self, first: int | None) -> bool:
        """Return whether elements of the beam whose first node this is move."""
        return any(first == int(table.place[1]) for table in self.tables)

    def table_of(self, k: int) -> Any:
        """Return the term of the beam of contact k."""
        return next(table for table in self.tables if self.places[k] in table.places)

    def gaps(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the distances between neighbouring contacts and ends of beams at coordinates [12 N], the smallest allowed, and
        the lengths of the beams, m."""
        found = [np.diff(np.concatenate(([0.0], q[12 * table.places], table.length[:1]))) for table in self.tables]
        lengths, least = np.repeat([table.length[:2] for table in self.tables], [x.size for x in found], axis=0).T
        return np.concatenate(found), least, lengths

    def at_end(self, gap: int, q: Array) -> dict[str, Any]:
        """Return the event of a contact at the end of its range, by the number of the gap."""
        first = 0
        for table in self.tables:
            n = table.places.size
            if gap <= n:
                break
            gap, first = gap - n - 1, first + n
        k = min(gap, n - 1)
        name, s = self.names[first + k], float(q[12 * table.places[k]])
        if gap in (0, n):
            end = "start" if gap == 0 else "end"
            near = float(table.length[1])
            return {"slider": name, "end": end, "s": s, "text": f"slider {name!r} came nearer than {near:.3g} m to the {end} of "
                                                                "its beam, where the length of a moving element vanishes"}
        other = self.names[first + gap - 1]
        return {"slider": name, "end": other, "s": s, "text": f"sliders {other!r} and {name!r} met, so the length of the moving "
                                                              "elements between them vanishes"}

    def add_motion(self, model: Any, state: State, out: Array) -> None:
        """Add the kinetic energy and the momenta of all moving beams."""
        p = np.zeros_like(state.q)
        for table in self.tables:
            out[0] += motion_of(table, state.q, state.history, p)
        momentum_sums(state.q, p, out)

    def link_of_run(self, table: Any, run: OfRun) -> Any:
        """Return the table of a beam with work arrays of the run; other tables unchanged."""
        if not isinstance(table, MovingBeam):
            return table
        tab = aligned(table.tables.tab.size)
        tab[:] = table.tables.tab
        return table._replace(scratch=aligned(table.scratch.size), tables=table.tables._replace(tab=tab))

    @property
    def exchanges(self) -> bool:
        """True if friction or drives act along the beams."""
        return any(self.along)

    def start_momenta(self, own: Array, q: Array, v: Array) -> None:
        """Put the momenta of coordinates and rates [12 N] into the history variables."""
        for table in self.tables:
            first = self._first(table)
            own[first:first + _size(table) - 1] = momenta(table, q.reshape(-1, 4, 3), v.reshape(-1, 4, 3)).reshape(-1)

    def _first(self, table: Any) -> int:
        """Return the offset of the variables of a beam among those of all beams."""
        return int(table.place[0]) - int(self.tables[0].place[0])

    def misfit(self, own: Array, q: Array, v: Array) -> float:
        """Return the largest difference between velocities and those of the momenta in the history, with spins times the length
        of the beam, m/s; q, v [12 N]."""
        q, v, worst = q.reshape(-1, 4, 3), v.reshape(-1, 4, 3), 0.0
        for table in self.tables:
            first, of_rates = self._first(table), momenta(table, q, v)
            off = own[first:first + of_rates.size].reshape(of_rates.shape) - of_rates
            off[:, :, 1:] *= table.length[0]
            off /= element_lengths(table, q)[:, None, None, None]
            worst = max(worst, float(np.max(np.linalg.norm(off, axis=3))))
        return worst

    @property
    def nodes(self) -> Array:
        """All nodes of the beams, and of places, int64 [*]."""
        return np.unique(np.concatenate((self.places, *(table.node.reshape(-1) for table in self.tables))))

    def in_space(self, n: int) -> Array:
        """Return the numbers of those of n nodes that have a position in space, int64 [*]."""
        return np.setdiff1d(np.arange(n), np.concatenate((self.places, self.line)))

    def inertia(self, q: Array) -> Any:
        """Assemble the mass matrix of all moving beams at coordinates [12 N], sparse [12 N, 12 N]."""
        return sum(mass_matrix(table, q.reshape(-1, 4, 3)) for table in self.tables)

    def momentum(self, history: Array, q: Array) -> Array:
        """Return the momenta in a history as generalised momenta of all coordinates, with the energy (5.20), [12 N]."""
        out = np.zeros(q.size)
        for table in self.tables:
            first, of = int(table.place[0]), list(of_rates(table, q.reshape(-1, 4, 3)))
            own = history[first:first + _size(table) - 1].reshape(len(of), -1, 4, 3)
            for one, m in zip(of, own):
                np.add.at(out, one.columns, np.einsum("gk,gkc,gkci->i", masses(table) / one.length, m, one.matrix))
        return out

    def put_blow(self, history: Array, q: Array, by: Array) -> None:
        """Update the momenta in a history for a jump of the rates by `by`, both at coordinates [12 N]."""
        for table in self.tables:
            first, jump = int(table.place[0]), momenta(table, q.reshape(-1, 4, 3), by.reshape(-1, 4, 3))
            history[first:first + jump.size] += jump.reshape(-1)

    def work_of_weight(self, history: Array) -> float:
        """Return the work of gravity on all moving beams since the start, J."""
        return sum(float(history[int(table.place[0]) + _size(table) - 1]) for table in self.tables)


def _size(table: Any) -> int:
    """Return the number of history variables of a beam."""
    return 12 * len(table.node) * table.mass_point.shape[1] + 1


class Rewritten(NamedTuple):
    """Scene that is compiled, its moving meshes, and the given scene with fixed meshes."""

    scene: Scene
    meshes: list[Mesh]
    given: Scene


def rewrite(scene: Scene) -> Rewritten | None:
    """Return a scene in which contacts of moving meshes are joints; None without moving meshes. Raises SceneError: names a part
    that moving meshes do not know."""
    parts = [part for part in scene.parts if isinstance(part, MovingMesh)]
    if not parts:
        return None
    _refuse(scene, parts)
    fields = [InitialVelocity(part.beam, velocity=part.velocity or (0, 0, 0), spin=part.spin or (0, 0, 0)) for part in parts
              if part.velocity is not None or part.spin is not None]
    given = Scene(*(part for part in scene.parts if not isinstance(part, MovingMesh)), *fields, name=scene.name,
                  gravity=scene.gravity, gravity_time=scene.gravity_time, project_velocities=scene.project_velocities)
    given.check()
    meshes = [Mesh(part.beam, list(part.sliders)) for part in parts]
    contacts = [joint for mesh in meshes for k in range(len(mesh.sliders)) for joint in joints_of(mesh, k)]
    same = [part for part in given.parts if not isinstance(part, (Slider, InitialVelocity, RigidMotion))]
    out = Scene(*same, *contacts, *(place for mesh in meshes for place in mesh.places), name=scene.name, gravity=scene.gravity,
                gravity_time=scene.gravity_time, project_velocities=True)
    out.moving = tuple(meshes)
    return Rewritten(out, meshes, given)


def _refuse(scene: Scene, parts: list[MovingMesh]) -> None:
    who = f"compile_scene: {parts[0].label}"
    beams = [part.beam for part in parts]
    if len(set(beams)) < len(beams):
        raise SceneError(f"{who}: a beam has two moving meshes; name all its sliders in one MovingMesh")
    for slider in scene.sliders:
        if sum(slider in part.sliders for part in parts) != 1:
            raise SceneError(f"{who}: slider {slider.name!r} belongs to no MovingMesh, or to several. In a scene with moving "
                             "meshes each slider needs exactly one: name it in a MovingMesh, or use with_moving_meshes(scene)")
    for part in parts:
        for slider in part.sliders:
            if slider not in scene.sliders:
                raise SceneError(f"{part.label}: slider {slider.name!r} is not in {scene.label}; add it to the scene")
            if any(slider.point.owner is beam for beam in beams) and not _is_end(slider.point):
                raise SceneError(f"{part.label}: slider {slider.name!r}: {slider.point} is an inner node of a beam with a moving "
                                 "mesh; slide its ends, or nodes of other beams")
    for x in scene.parts:
        if type(x) not in TAKEN and not isinstance(x, Sleeve):
            raise SceneError(f"{who}: scenes with moving meshes do not support {getattr(x, 'kind', type(x).__name__)} "
                             f"{getattr(x, 'name', '')!r}; leave it out, or leave the moving mesh out")
        if isinstance(x, Load) and x.follower:
            raise SceneError(f"{who}: scenes with moving meshes do not support follower load {x.name!r}; leave follower out")
        if isinstance(x, Pin | Clamp) and (x.until is not None or x.since is not None):
            raise SceneError(f"{who}: {x.name!r} is released or engages during the run, which scenes with moving meshes do not "
                             "support; leave until and since out")
        for node in _inner(x, beams):
            raise SceneError(f"{who}: {x.kind} {getattr(x, 'name', '')!r} is at {node}, which moves along the beam; only the "
                             "ends of this beam can be supported, joined and loaded")


def _inner(part: Any, beams: list[Beam]) -> list[Any]:
    """Return the nodes inside beams with moving meshes that a part refers to."""
    found = [getattr(part, name, None) for name in ("at", "a", "b")] if not isinstance(part, (Slider, Beam)) else []
    return [node for node in found if any(getattr(node, "owner", None) is beam for beam in beams) and not _is_end(node)]


def _is_end(node: Any) -> bool:
    """Return whether a node of a beam is one of its ends, which stay the same material points."""
    return bool(node.index in (0, node.owner.n_nodes - 1))


def initial(rewritten: Rewritten, numbered: Numbered, pack: Callable[[Scene, Unpacked], Any]) -> State:
    """Return the state at t = 0 of the nodes of the rewritten scene; nodes move over the beam as the contacts do. pack: as in
    `unpack`."""
    nodes, joints, given = numbered.nodes, numbered.joints, rewritten.given
    before = number(given)
    old = unpack(given, before, pack)
    n = len(nodes)
    v, spin = np.zeros((n, 3)), np.zeros((n, 3))
    q_old, v_old = (x.reshape(-1, 4, 3) for x in (old.state.q, old.state.v))
    for part in [*given.beams, *given.bodies, *given.masses]:
        here, there = nodes.span(part), before.nodes.span(part)
        nodes.phi[here] = q_old[there, 0]
        v[here] = v_old[there, 0]
        spin[here] = spins(q_old[there], v_old[there])
    for key, arm in nodes.arms.items():
        there = before.nodes.arms.get(key)
        if there is not None:
            nodes.phi[arm], v[arm] = q_old[there, 0], v_old[there, 0]
            spin[arm] = spins(q_old[there], v_old[there])
    for mesh in rewritten.meshes:
        span, d = nodes.span(mesh.beam), nodes.directors[nodes.span(mesh.beam)]
        rates = np.zeros(len(mesh.sliders))
        for k, slider in enumerate(mesh.sliders):
            at = nodes.number(mesh.contact(k))
            rates[k] = (v_old[before.nodes.number(slider.point), 0] - v[at]) @ nodes.directors[at, 0]
            v[nodes.start(mesh.places[k])] = rates[k], 0.0, 0.0
        along = mesh.way() @ rates
        v[span] += along[:, None] * np.einsum("i,nic->nc", mesh.reference[:3], d)
        spin[span] += along[:, None] * np.einsum("i,nic->nc", mesh.reference[3:], d)
    velocity, turned = tied_velocities(nodes, joints, v, spin)
    v[joints.tied], spin[joints.tied] = velocity[joints.tied], turned[joints.tied]
    q = np.concatenate((nodes.phi[:, None], nodes.directors), axis=1)
    rates = np.concatenate((v[:, None], np.cross(spin[:, None], nodes.directors)), axis=1)
    return State(q.reshape(-1), rates.reshape(-1), np.zeros(0), np.zeros(0))


def with_tables(model: Any, rewritten: Rewritten | None, blocks: Any) -> Any:
    """Return the model with the terms of its moving meshes and the momenta at the start."""
    if rewritten is None:
        return model
    numbers, tables, names, places, contacts = model.numbers, [], [], [], []
    at = model.place_for(Moving)
    for mesh in rewritten.meshes:
        table = mesh.table(numbers, blocks, model.pattern.row_of, model.gravity)
        table.place[0], table.place[3] = at, len(names) + len(tables)
        at += _size(table)
        tables.append(table)
        names += [slider.name for slider in mesh.sliders]
        places += table.places.tolist()
        contacts += [numbers.number(mesh.contact(k)) for k in range(len(mesh.sliders))]
    moments, acting = ([of(slider) for mesh in rewritten.meshes for slider in mesh.sliders] for of in (moment_of, along_of))
    points = [numbers.number(slider.point) for mesh in rewritten.meshes for slider in mesh.sliders]
    line = [node for (owner, _), node in numbers.arms.items() if isinstance(owner, LineOfPlaces)]
    moving = Moving(tuple(tables), names, np.array(places), np.array(contacts), np.array(points), moments, acting,
                    np.array(line, np.int64))
    return replace(model.with_features(moving), links=(*model.links, *tables))
