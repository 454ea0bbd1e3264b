"""Registry of links between two points, springs and joints with multipliers: an entry makes the table of all links of a kind.

A new kind is a class in scene/, a file in kernels/ with its table and its contributions to a step, and an entry here. `register`
adds an entry from outside (docs/extending.md).
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.ties import Ties
from fastbeam.kernels.forces.bushing import Bushings
from fastbeam.kernels.forces.force_element import ForceElements
from fastbeam.kernels.forces.line_force import LineForces
from fastbeam.kernels.forces.spring import Springs
from fastbeam.kernels.forces.user_force import UserForces
from fastbeam.kernels.forces.winch import Winches
from fastbeam.kernels.jit.sources import is_outside
from fastbeam.kernels.joints.ball_joint import BallJoints
from fastbeam.kernels.joints.distance_joint import DistanceJoints
from fastbeam.kernels.terms import Conserving, NoTies, assemble
from fastbeam.model.connections import Connections
from fastbeam.model.feature import Feature
from fastbeam.model.forces.bushings import BushingRows, bushings
from fastbeam.model.forces.failed_laws import Lawful
from fastbeam.model.forces.link_forces import BushingForces, LinkForces, OutsideLinks
from fastbeam.model.forces.spring_laws import SpringRows, spring_laws
from fastbeam.model.forces.user_forces import Loaded, UserLaws, asked_of, force_elements, line_forces
from fastbeam.model.forces.winches import Hoists, Ropes, WinchRows
from fastbeam.model.joints.constraints import Distance, ConstrainedJoint, GapLaw, Law, Together
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.joints.couplings import Couplings, couplings_of
from fastbeam.model.joints.tables import bearing_nodes, conditions_of, frames_of, joint_conditions
from fastbeam.model.numbering import NodeList
from fastbeam.scene import BallJoint, Bushing, Damper, DistanceJoint, ForceElement, LineForce, Scene, Spring
from fastbeam.scene.axis_joint import AxisJoint
from fastbeam.scene.gear_coupling import relations_of
from fastbeam.scene.links import Link, label_of

if TYPE_CHECKING:
    from fastbeam.compile.order import Blocks

Array = np.ndarray
# largest way of the ends of a spring past each other in a step of step control, as a share of its length
SHORT_PASSAGE = 2e-3


class Ends:
    """Both ends of all links of one kind, as tables need them.

    Attributes
    ----------
    parts : list
        Parts of the scene, None for links without a part.
    node, row : int64 [L, 2]
        Nodes, and their rows of the residual.
    block : int64 [L, 4]
        Blocks a-a, a-b, b-a, b-b of the tangent; empty where the kind couples none.
    phi, directors : float64 [N, 3], [N, 3, 3]
        Positions and triads of all nodes at t = 0.
    distance : float64 [L]
        Distance of both ends at t = 0, m.
    place : int64 [L]
        Offset of the energy that a link dissipates in the history, -1: it dissipates none.
    first : int64 [1]
        Number of the first constraint among all.
    ties
        Slave nodes, or NoTies.
    spin_row : int64 [L, 2]
        Rows of the residual that have the spins of the nodes.
    laws : list of Law
        Laws of joints with multipliers.
    """

    def __init__(self, parts: list[Any], node: Array, nodes: NodeList, row_of: Array, blocks: Blocks | None, first: int,
                 ties: Any, spin_root: Array, laws: list[Any], losses_at: int) -> None:
        self.parts, self.node, self.ties, self.laws = parts, node, ties, laws
        self.phi, self.directors = nodes.phi, nodes.directors
        bearing = bearing_nodes(node, _are_of_angles(laws), spin_root)
        a, b = bearing.T
        takes = np.array([getattr(part, "is_damped", False) for part in parts], bool)
        self.place = np.where(takes, losses_at + np.cumsum(takes) - 1, -1)
        self.row, self.spin_row = row_of[bearing], row_of[spin_root[node]]
        self.block = np.zeros((0, 4), np.int64)
        if blocks is not None:
            self.block = np.stack([blocks.between(i, j) for i in (a, b) for j in (a, b)], axis=1)
        self.distance = np.linalg.norm(nodes.phi[b] - nodes.phi[a], axis=1)
        self.first = np.array([first])


# gap(part, x, start) -> [m]: gaps of a link at coordinates x [2, 4, 3], positions and directors of both nodes; start: those at
# t = 0
Gap = Callable[[Any, Array, Array], Any]


@dataclass(frozen=True)
class Entry:
    """Kind of link."""

    noun: type
    table: Callable[[Ends], Any]  # makes the table of all links of this kind from their `Ends`
    couples: bool = True  # true if it adds to the blocks between its nodes
    law: Law | None = None  # constraint of a joint with multipliers; for joints with axes it depends on the joint
    gap: Gap | None = None  # gaps of a joint with multipliers from outside
    needs_distance: bool = False  # true if it makes no sense between points at the same place
    takes: Callable[[Any], bool] | None = None  # returns whether a link belongs to this kind; default: links of the class `noun`

    def holds(self, part: Any) -> bool:
        """Return whether a link belongs to this kind."""
        return type(part) is self.noun if self.takes is None else self.takes(part)


def _springs(ends: Ends) -> Springs:
    length = np.array([d if x.length is None else x.length for x, d in zip(ends.parts, ends.distance)])
    return Springs(ends.node, ends.row, ends.block, np.array([x.stiffness for x in ends.parts]), length)


class Group(NamedTuple):
    """All links of one kind: entry, scene parts (None for links without a part), nodes [L, 2]; for joints with multipliers the
    law of each and a word for messages."""

    entry: Entry
    parts: list[Any]
    node: Array
    laws: list[Any]
    words: list[str]


# joints whose force is a vector come before those with scalar forces
REGISTRY = [
    Entry(Spring, _springs, takes=lambda x: type(x) is Spring and not x.has_law),
    Entry(Damper, spring_laws, takes=lambda x: type(x) in (Spring, Damper) and x.has_law),
    Entry(Bushing, bushings),
    Entry(ForceElement, force_elements),
    Entry(LineForce, line_forces),
    Entry(BallJoint, lambda x: BallJoints(x.node, x.row, x.first, x.ties), couples=False, law=Together()),
    Entry(DistanceJoint, lambda x: DistanceJoints(x.node, x.row, x.block, x.distance, x.first, x.ties), law=Distance(),
          needs_distance=True),
    Entry(AxisJoint, joint_conditions),
]


def register(noun: type[Link], table: Callable[[Ends], Any], gap: Gap | None = None) -> None:
    """Register a new kind of link between two points for scenes: one with a force law, or with gaps and a multiplier for each.

    Parameters
    ----------
    noun : type
        A class derived from `Link` with a text `kind` of its own; scenes take objects of it.
    table : callable
        The constants of all links of this kind from their `Ends`: a named tuple of C-contiguous arrays. Its class is the term for
        which `assemble` and `potential_energy` have implementations.
    gap : callable, optional
        gap(part, x, start) -> [m], m <= 6, of a constraint: the gaps that kernels close, in m, from the coordinates [2, 4, 3] of
        both nodes, positions and directors in rows, now and at t = 0; of sums, products and roots, which takes complex numbers.

    Raises
    ------
    TypeError
        `noun` is no class derived from `Link`, has no `kind`, or is registered already; `table` or `gap` cannot be called.
    """
    if not (isinstance(noun, type) and issubclass(noun, Link)) or noun is Link:
        raise TypeError(f"register_link: {noun!r} must be a class derived from Link")
    if not isinstance(noun.kind, str) or noun.kind == Link.kind:
        raise TypeError(f"register_link: {noun.__name__}.kind must be a text for messages, got {noun.kind!r}")
    if not callable(table):
        raise TypeError(f"register_link: the table of {noun.__name__} must be a function of Ends, got {table!r}")
    if gap is not None and not callable(gap):
        raise TypeError(f"register_link: the gap of {noun.__name__} must be a function of (part, x, start), got {gap!r}")
    if any(entry.noun is noun for entry in REGISTRY):
        raise TypeError(f"register_link: {noun.__name__} is registered already")
    REGISTRY.append(Entry(noun, table, gap=gap))


class Lines(NamedTuple):
    """Springs, dampers and line forces, whose force changes direction where both ends meet: names, nodes [L, 2], largest ways of
    one end past the other in a step, m [L]; line forces by their numbers; True for those with a force at rest where both ends
    meet, bool [L]."""

    names: list[str]
    node: Array
    most: Array
    forces: dict[int, LineForce]
    acts: Array

    def passed(self, before: Array, after: Array) -> Array:
        """Return the numbers of links whose ends pass each other on a longer way between coordinates before and after, [12 N]
        each."""
        a, b = self.node.T
        x, y = (q.reshape(-1, 12)[:, :3] for q in (before, after))
        x, y = x[b] - x[a], y[b] - y[a]
        beyond = np.einsum("lc,lc->l", x, y) < 0.0
        return np.flatnonzero(beyond & (np.linalg.norm(y - x, axis=1) > self.most)) if beyond.any() else np.zeros(0, np.int64)

    def swapped(self, before: Array, after: Array) -> list[int]:
        """Return the numbers of links whose ends pass each other from one equilibrium to another, and whose force turns
        around."""
        return [int(k) for k in self.passed(before, after) if self.acts[k]]

    def unseen(self, before: Array, after: Array, t: float, h: float, weight: Array) -> float:
        """Estimate the error of position, m, of steps of size h around time t that evaluate laws of line forces at the mean
        length only; weight [N]: masses of nodes, kg. 0 where a law cannot be evaluated."""
        worst, positions = 0.0, [q.reshape(-1, 12)[:, :3] for q in (before, after)]
        for k, force in self.forces.items():
            a, b = self.node[k]
            x, y = (p[b] - p[a] for p in positions)
            start, end, displacement = float(np.linalg.norm(x)), float(np.linalg.norm(y)), y - x
            square = float(displacement @ displacement)
            if square == 0.0:
                continue
            nearest = float(np.linalg.norm(x + min(max(-float(x @ displacement) / square, 0.0), 1.0) * displacement))
            lengths, rate = (start, 0.5 * (start + end), end, nearest), (end - start) / h
            try:
                with np.errstate(all="ignore"):
                    first, middle, last, near = (float(force.law(t, x, rate, force.parameters)) for x in lengths)
            except Exception:  # a step that evaluates the law reports the failure
                continue
            off = max(abs(first - 2.0 * middle + last), abs(near - middle) if nearest < min(start, end) else 0.0)
            masses = weight[[a, b]]
            mass = float(np.min(masses[masses > 0.0], initial=np.inf))
            size = off * h**2 / (12.0 * (mass if np.isfinite(mass) else float(weight.sum())))
            worst = max(worst, size) if np.isfinite(size) else worst
        return worst


class Passes:
    """Events of springs and line forces whose ends pass each other between consecutive equilibria; event: takes an event {'kind',
    'time', 'text'}."""

    def __init__(self, lines: Lines | None, event: Callable[[dict[str, Any]], None]) -> None:
        self._lines, self._event = lines, event
        self._last: tuple[Array, str] | None = None
        self._told: set[int] = set()

    def look(self, q: Array, time: float, where: str) -> None:
        """Check the equilibrium at coordinates [12 N], described by `where`, at the time of its row."""
        if self._lines is None:
            return
        for k in () if self._last is None else self._lines.swapped(self._last[0], q):
            if k not in self._told:
                self._told.add(k)
                self._event({"kind": "unresolved", "time": time,
                             "text": f"{self._lines.names[k]}: its ends pass each other between {self._last[1]} and {where}. "
                                     "From there on its force acts in the opposite direction, or vanishes if it acts in one "
                                     "direction only. Start from a shape on the right side (start=), make it stiffer or longer, "
                                     "or check with simulate whether it snaps through"})
        self._last = q.copy(), where


def _tested(entry: Entry, table: Any) -> Any:
    """Check the table of a kind from outside, which kernels use unchecked. Raises TypeError: the table is no named tuple of
    arrays, or has no `assemble`."""
    who = f"the table of {entry.noun.__name__}"
    if not (isinstance(table, tuple) and hasattr(table, "_fields")):
        raise TypeError(f"{who} must be a named tuple of arrays, got {type(table).__name__}")
    for name, x in zip(table._fields, table):
        if name == "ties" and isinstance(x, (NoTies, Ties)):
            continue
        if not isinstance(x, np.ndarray) or x.dtype not in (np.float64, np.int64) or not x.flags.c_contiguous:
            found = f"an array of {x.dtype}, shape {x.shape}" if isinstance(x, np.ndarray) else type(x).__name__
            raise TypeError(f"{who}: {name} must be a C-contiguous array of float64 or int64, got {found}")
    if not (assemble.covers(type(table)) or assemble.covers(type(table), Conserving)):
        raise TypeError(f"{who}: {type(table).__name__} has no assemble function; import the module with "
                        f"@assemble.register({type(table).__name__}), which serves all methods")
    return table


class Links:
    """All links of a scene.

    joints: connections; ball joints of its `loops` have multipliers.
    hinges: int [*, 2], ball joints of nets.
    Raises SceneError: a link that makes no sense where its ends are, as a distance joint between points at the same place.
    """

    def __init__(self, scene: Scene, nodes: NodeList, joints: Connections, hinges: Array) -> None:
        balls = [*scene.balls, *[None] * len(hinges)]
        pairs = np.concatenate((nodes.ends(scene.balls), hinges))
        self.nodes, self._root, self._spin_root = nodes, joints.row_root, joints.spin_root
        self.loaded, self.ropes = Loaded(scene, nodes), Ropes(scene, nodes)
        self.groups: list[Group] = []
        known = {entry.noun for entry in REGISTRY}
        for x in scene.links:
            if type(x) not in known and not isinstance(x, AxisJoint):
                raise SceneError(f"{label_of(x)}: {type(x).__name__} is not registered; call "
                                 f"fastbeam.extend.register_link({type(x).__name__}, ...) before it is added to a scene")
        with_axes = [x for x in scene.links if isinstance(x, AxisJoint)]
        # joints with axes, their nodes and directions
        ends = nodes.ends(with_axes)
        self.with_axes = list(zip(with_axes, ends.tolist(), frames_of(with_axes, ends, nodes.phi, nodes.directors)))
        for entry in REGISTRY:
            parts: list[Any] = [x for x in scene.links if entry.holds(x)]
            node = nodes.ends(parts)
            laws, words = [entry.law] * len(parts), [""] * len(parts)
            if entry.noun is BallJoint:
                # points of joints with axes are joined in the same way
                pinned = [x for x in with_axes if x.is_pinned]
                parts = [*(balls[j] for j in joints.loops), *pinned]
                node = np.concatenate((pairs[joints.loops], nodes.ends(pinned)))
                laws, words = [entry.law] * len(parts), [""] * len(parts)
            elif entry.noun is AxisJoint:
                sets = [(x, at, *found) for x, at, frame in self.with_axes for found in conditions_of(x, frame)]
                parts, laws, words = [x[0] for x in sets], [x[3] for x in sets], [x[2] for x in sets]
                node = np.array([x[1] for x in sets], np.int64).reshape(-1, 2)
            elif entry.gap is not None:
                laws = [GapLaw(part, entry.gap, nodes.coordinates(at)) for part, at in zip(parts, node.tolist())]
            if entry.needs_distance:
                _check_distances(parts, node, nodes.phi)
            if parts:
                self.groups.append(Group(entry, parts, node, laws, words))
        # coordinates that joints with axes leave free, with the nodes and directions of the joint
        self.freedoms = [(freedom, (a, b), frame) for x, (a, b), frame in self.with_axes for freedom in x.freedoms]
        # screws and gears, and their coordinates
        self.couplings, self.coupled = couplings_of(relations_of(scene.parts), self.freedoms)
        # whether something acts on them
        self.acting = np.isin(np.arange(len(self.freedoms)), self.coupled)
        self.acting |= np.array([freedom.acts for freedom, *_ in self.freedoms], bool)
        # coordinates with multipliers, prescribed ones first: their constraints are the last of all
        self.driven: list[ConstrainedJoint] = []
        for freedom, at, frame in self.freedoms:
            if freedom.is_given:
                law = Coordinate(freedom.shape, frame, freedom.given_rate, holds=True)
                self.driven.append(ConstrainedJoint(freedom.force_label("drive"), at, law))
        for freedom, at, frame in self.freedoms:
            if freedom.may_stick:
                law = Coordinate(freedom.shape, frame)
                self.driven.append(ConstrainedJoint(freedom.force_label("friction" if freedom.has_friction else "stops"), at,
                                                    law))

    @property
    def touched(self) -> Array:
        """All nodes that a link or a user force touches; they are not eliminated inside elements and beams."""
        own = [self.loaded.node, self.ropes.node.reshape(-1)]
        return np.unique(np.concatenate([*own, *(group.node.reshape(-1) for group in self.groups)]))

    @property
    def pairs(self) -> Array:
        """Pairs of nodes i, j that links couple, as i N + j."""
        n = len(self.nodes)
        out = [np.zeros(0, np.int64), *self.ropes.pairs(self._root)]
        # forces on the coordinates of joints couple their nodes, whatever conditions the joints have
        acting = [(at, x.shape.is_angle) for (x, at, _), acts in zip(self.freedoms, self.acting) if acts]
        links = [(group.node, _are_of_angles(group.laws)) for group in self.groups if group.entry.couples]
        links.append((np.array([at for at, _ in acting], np.int64).reshape(-1, 2),
                      np.array([turns for _, turns in acting], bool)))
        for node, turns in links:
            a, b = self._root[bearing_nodes(node, turns, self._spin_root)].T
            out += [a * n + a, a * n + b, b * n + a, b * n + b]
        return np.concatenate(out)

    @property
    def kept(self) -> list[ConstrainedJoint]:
        """Joints with multipliers, in the order of their constraints."""
        nodes = self.nodes
        out = []
        for group in self.groups:
            # joints of nets have no name
            out += [ConstrainedJoint(
                (label_of(part) if part else f"ball joint of {nodes.labels[a]} and {nodes.labels[b]}") + word, (a, b), law)
                    for part, (a, b), law, word in zip(group.parts, group.node.tolist(), group.laws, group.words)
                    if law is not None]
        return out + self.couplings + self.driven

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of the energies that springs, dampers and bushings dissipate, for the balance."""
        return tuple(f"{getattr(part, 'takes', 'damping of')} {label_of(part)}" for group in self.groups for part in group.parts
                     if getattr(part, "is_damped", False))

    def of(self, *nouns: type) -> tuple[list[Any], Array]:
        """Return all links of some classes, and their nodes [L, 2]."""
        found = [(part, node) for group in self.groups for part, node in zip(group.parts, group.node) if type(part) in nouns]
        return [part for part, _ in found], np.array([node for _, node in found], np.int64).reshape(-1, 2)

    @cached_property
    def features(self) -> list[Feature]:
        """Features of links, ropes and laws between two points."""
        lines = self.lines
        springs = self.of(Spring, Damper, Bushing)[0]
        outside = {type(group.parts[0]).__name__: group.entry.gap is not None for group in self.groups
                   if is_outside(group.entry.noun)}
        coupled = [self.freedoms[k][0].name for k in self.coupled.reshape(-1)]
        tells = self.losses or springs or lines or self.ropes.winches
        return [*([LinkForces(self.losses, partial(_evaluators_of, self), lines)] if tells else []),
                *([Hoists(self.ropes.winches)] if self.ropes.winches else []),
                *([Couplings(self.couplings, self.coupled, coupled)] if self.couplings else []),
                *([BushingForces()] if self.of(Bushing)[0] else []), *([OutsideLinks(outside)] if outside else []),
                *self._laws()]

    def _laws(self) -> list[UserLaws]:
        """Return the feature of user laws, with the laws that rows of tables call."""
        loaded, between, nodes = self.loaded, self.of(LineForce, ForceElement)[0], self.nodes
        out: dict[type, Lawful] = {UserForces: Lawful(loaded.forces, loaded.of, lambda k: nodes.labels[loaded.node[k]], asked_of)}
        for noun, table in ((LineForce, LineForces), (ForceElement, ForceElements)):
            parts, at = self.of(noun)
            out[table] = Lawful(parts, np.arange(len(parts)),
                                lambda k, at=at: " and ".join(nodes.labels[i] for i in at[k].tolist()), asked_of)
        return [UserLaws(loaded.forces, between, out)] if loaded.forces or between else []

    @property
    def lines(self) -> Lines | None:
        """Links whose ends may pass through a length of 0, except linear springs without length, whose force is smooth there."""
        parts, node = self.of(Spring, Damper, LineForce)
        x = self.nodes.phi[node]
        own = np.array([getattr(part, "length", None) or 0.0 for part in parts])
        reach = np.maximum(np.linalg.norm(x[:, 1] - x[:, 0], axis=1), own)
        vectorial = np.array([type(part) is Spring and not part.has_law and part.length == 0.0 for part in parts], bool)
        kept = np.flatnonzero((reach > 0.0) & ~vectorial)
        acts = np.array([type(part) is not Damper and not getattr(part, "tension_only", False) for part in parts], bool)
        return Lines([label_of(parts[k]) for k in kept.tolist()], node[kept], SHORT_PASSAGE * reach[kept],
                     {n: parts[k] for n, k in enumerate(kept.tolist()) if type(parts[k]) is LineForce},
                     acts[kept]) if kept.size else None

    def tables(self, blocks: Blocks, row_of: Array, sliders: int, ties: Any, loads_at: int,
               losses_at: int) -> tuple[Any, ...]:
        """Build the tables of all kinds of links that the scene has; sliders: number of constraints before theirs; loads_at,
        losses_at: offsets of the work of loads and of `losses` in the history."""
        out, first = [], sliders
        for entry, parts, node, laws, _ in self.groups:
            ends = Ends(parts, node, self.nodes, row_of, blocks if entry.couples else None, first, ties, self._spin_root, laws,
                        losses_at)
            losses_at += int(np.sum(ends.place >= 0))
            table = entry.table(ends)
            out.append(_tested(entry, table) if is_outside(entry.noun) else table)
            first += sum(law is not None for law in laws)
        if self.loaded.forces:
            q = np.concatenate((self.nodes.phi[:, None], self.nodes.directors), axis=1)
            out.append(self.loaded.table(row_of, blocks, q, loads_at))
        if self.ropes.winches:
            out.append(self.ropes.table(row_of, blocks, self.nodes.phi))
        return tuple(out)


def _evaluators_of(links: Links, tables: tuple[Any, ...]) -> list[Any]:
    """Return the evaluators of springs and dampers, winches and bushings at rows; tables: of the links."""
    parts, node = links.of(Spring, Damper)
    out: list[Any] = []
    if parts:
        out.append(SpringRows(parts, node, np.linalg.norm(np.diff(links.nodes.phi[node], axis=1)[:, 0], axis=1)))
    out += [WinchRows([winch.name for winch in links.ropes.winches], table) for table in tables if isinstance(table, Winches)]
    return out + [BushingRows(links.of(Bushing)[0], table) for table in tables if isinstance(table, Bushings)]


def _are_of_angles(laws: list[Any]) -> Array:
    """Return which laws of links, or None, constrain only directions, bool [L]."""
    return np.array([law is not None and law.is_angle for law in laws], bool)


def _check_distances(parts: list[Any], node: Array, phi: Array) -> None:
    round_off = 1e-12 * float(np.max(np.abs(phi)))
    for part, (a, b) in zip(parts, node.tolist()):
        if not np.linalg.norm(phi[b] - phi[a]) > round_off:
            raise SceneError(f"{label_of(part)}: {part.a} and {part.b} lie at the same place; use BallJoint, or move one of them")
