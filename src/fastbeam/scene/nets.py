"""Nets: many straight beams between nodes, described by arrays."""
from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Anything, Name, Word, checked, shown, whole
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import DEGREES, MOST_ELEMENTS, STRAINS, Beam, NodeRef, strained
from fastbeam.scene.checks import Array, Named, TimeFactor, as_factor
from fastbeam.scene.curves import StraightLine
from fastbeam.scene.interpolation.shapes import gll_nodes
from fastbeam.scene.sections import Section

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

JOINTS = ("rigid", "ball")
# arrays whose shapes belong together; the constructor compares them
TABLES = ("nodes", "edges", "section", "section_of", "elements", "degree", "d2", "joints", "pins", "clamps", "masses", "loads",
          "velocity", "spin", "prestrain", "prestress")


class NetBeam(Beam):
    """One beam of a net, made by `net.beam(k)`: the beam of a slider, load or point of observation."""

    net: Net
    index: int


@checked(name=Name(), strain=Word(STRAINS), time=as_factor, **dict.fromkeys(TABLES, Anything()))
class Net(Named):
    """Straight beams between nodes: frames with welded nodes, cable nets with ball joints, and mixtures.

    A net of any size is one part of a scene. Its beams have Lagrange elements of equal length. All arrays are copied.

    Parameters
    ----------
    name : str
        Unique in its scene.
    nodes : array_like [n, 3]
        Positions of the nodes, m.
    edges : array_like of int [m, 2]
        First and last node of every beam.
    section : Section or sequence of Section
    section_of : array_like of int [m]
        Number of the section of every beam; needed if there are several.
    elements : int or array_like of int [m]
        Elements of every beam.
    degree : int
        Polynomial degree, 1 to 8.
    strain : {'simo_reissner', 'green_lagrange'}
    d2 : array_like (3,) or [m, 3]
        Hint for the direction of d2, as in `Beam.straight`; None: the rule of `Beam.straight`.
    joints : {'rigid', 'ball'} or sequence of them [n]
        Connection of the beams at a node: their rotations are shared, or free.
    pins, clamps : array_like of int
        Nodes whose position is fixed; nodes where the rotations of all beam ends are fixed, too.
    masses : array_like [n]
        Point masses at the nodes, kg, >= 0.
    loads : array_like [n, 3]
        Dead forces on the nodes, N, times `time(t)` (None: constant).
    velocity : array_like (3,) or [n, 3]
        Initial velocity of the nodes, m/s; linear along the beams.
    prestrain, prestress : float or array_like [m]
        Axial strain of the beams as they are drawn, or their normal force, N; see `Beam`.
    spin : array_like (3,) or [n, 3]
        Initial angular velocity at the nodes, rad/s; linear along the beams. None: beams between ball joints only turn with the
        line between their ends, welded ones do not turn.

    Raises
    ------
    SceneError
        An array has the wrong shape or values out of range; the message names the first node or edge that is wrong.

    Examples
    --------
    >>> from fastbeam.scene import Net, Section
    >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
    >>> net = Net('tripod', [(0, 0, 1), (1, 0, 0), (-1, 1, 0), (-1, -1, 0)], [(0, 1), (0, 2), (0, 3)], section=bar, elements=2,
    ...           degree=2, clamps=[1, 2, 3])
    >>> net
    <net 'tripod': 3 beams, 6 elements, 4 nodes>
    >>> net.beam(0).length == 2**0.5, net.node(2).label
    (True, "beam 'tripod[1]' node 4")
    """

    kind: ClassVar[str] = "net"

    def __init__(self, name: str, nodes: ArrayLike, edges: ArrayLike, *, section: Section | Sequence[Section],
                 section_of: ArrayLike | None = None, elements: ArrayLike = 1, degree: int = 3, strain: str = "simo_reissner",
                 d2: ArrayLike | None = None, joints: str | Sequence[str] | Array = "rigid", pins: ArrayLike = (),
                 clamps: ArrayLike = (), masses: ArrayLike | None = None, loads: ArrayLike | None = None,
                 time: TimeFactor | None = None, velocity: ArrayLike | None = None, spin: ArrayLike | None = None,
                 prestrain: ArrayLike = 0.0, prestress: ArrayLike = 0.0) -> None:
        self.name = name
        who = self.label
        self.nodes = _table(who, "nodes", nodes, None, "m")
        n = len(self.nodes)
        self.edges = _integers(who, "edges", edges, (None, 2), n, f"node numbers from 0 to {n - 1}")
        m = len(self.edges)
        if m == 0:
            raise SceneError(f"{who}: edges must hold at least one pair of node numbers, got none")
        self.sections, self.section_of = _sections(who, section, section_of, m)
        same = whole(elements)
        if same is not None:
            # limit numbers that an array of integers cannot hold; the check below rejects them
            elements = np.full(m, min(max(same, 0), MOST_ELEMENTS + 1))
        self.elements = _integers(who, "elements", elements, (m,), MOST_ELEMENTS + 1,
                                  f"whole numbers >= 1 (at most {MOST_ELEMENTS:g})", least=1)
        low, high = DEGREES["lagrange"]
        if whole(degree) is None or not low <= degree <= high:
            raise SceneError(f"{who}: degree={shown(degree)} lies outside {low} to {high}")
        self.degree = int(degree)
        self.strain = strain
        self.lengths, self.triads = _lines(who, self.nodes, self.edges, d2)
        self.ball = _joints(who, joints, n)
        self.pins = _integers(who, "pins", pins, (None,), n, f"node numbers from 0 to {n - 1}")
        self.clamps = _integers(who, "clamps", clamps, (None,), n, f"node numbers from 0 to {n - 1}")
        self.masses = None if masses is None else _table(who, "masses", masses, n, "kg", columns=None)
        if self.masses is not None and np.any(self.masses < 0.0):
            i = int(np.argmax(self.masses < 0.0))
            raise SceneError(f"{who}: masses must be >= 0 kg, node {i} has {self.masses[i]:.6g}")
        self.loads = None if loads is None else _table(who, "loads", loads, n, "N")
        self.time = time
        self.velocity = None if velocity is None else _table(who, "velocity", _each(velocity, n), n, "m/s")
        self.spin = None if spin is None else _table(who, "spin", _each(spin, n), n, "rad/s")
        self.prestrain = _of_edges(who, "prestrain", prestrain, m, "")
        self.prestress = _of_edges(who, "prestress", prestress, m, " (N)")
        if self.is_strained:
            # the error names the first beam whose value is wrong
            for k in np.flatnonzero((self.prestrain != 0.0) | (self.prestress != 0.0)).tolist():
                if not -10.0 <= self.prestrain[k] <= 0.99:
                    raise SceneError(f"{who}: prestrain must be from -10 to 0.99, edge {k} has {self.prestrain[k]:.6g}")
                strained(f"{who}, edge {k}", self.sections[self.section_of[k]], float(self.prestrain[k]),
                float(self.prestress[k]))
        free = np.bincount(self.edges.reshape(-1), minlength=n) == 0
        if free.any():
            raise SceneError(f"{who}: node {int(np.argmax(free))} belongs to no edge ({int(free.sum())} of {n} nodes); leave it "
                             "out or join it by an edge")
        self._beams: dict[int, NetBeam] = {}

    # --- public calls -------------------------------------------------------------------------------------------------
    @property
    def is_strained(self) -> bool:
        """True if beams have stress in the reference."""
        return bool(np.any(self.prestrain) or np.any(self.prestress))

    @property
    def start_strains(self) -> Array:
        """Six strains of every beam in the reference [m, 6]."""
        out = np.zeros((len(self.edges), 6))
        out[:, 0] = self.prestrain
        unit = np.linalg.inv([section.C for section in self.sections])[:, :, 0]
        return np.where((self.prestress != 0.0)[:, None], unit[self.section_of] * self.prestress[:, None], out)

    @checked(k=Anything())
    def beam(self, k: int) -> NetBeam:
        """Return beam k, of edge k: for sliders, loads along it, and points of observation.

        Raises
        ------
        SceneError
            There is no such beam.
        """
        k = self._number("beam", k, len(self.edges))
        if k not in self._beams:
            line = StraightLine(self.nodes[self.edges[k, 0]], self.triads[k], float(self.lengths[k]))
            beam = NetBeam(f"{self.name}[{k}]", line, section=self.sections[self.section_of[k]], elements=int(self.elements[k]),
                           degree=self.degree, strain=self.strain, prestrain=float(self.prestrain[k]),
                           prestress=float(self.prestress[k]))
            checks.fill(beam, net=self, index=k)
            self._beams[k] = beam
        return self._beams[k]

    @checked(i=Anything())
    def node(self, i: int) -> NodeRef:
        """Return node i, as the end of the first beam there: for supports, joints, loads, sliders and points of observation.

        Raises
        ------
        SceneError
            There is no such node.
        """
        i = self._number("node", i, len(self.nodes))
        at = int(self.junction[i])
        k = self.beam_at(at)
        return NodeRef(self.beam(k), at - int(self.node_start[k]))

    def beam_at(self, at: int) -> int:
        """Return the beam of a node in the list of all beams' nodes."""
        return int(np.searchsorted(self.node_start, at, side="right")) - 1

    def _number(self, what: str, value: Any, n: int) -> int:
        k = whole(value)
        if k is None or not 0 <= k < n:
            raise SceneError(f"{self.label}: {what} {shown(value)} does not exist, they run from 0 to {n - 1}")
        return k

    # --- the list of the nodes of all beams, one beam after the other ---------------------------------------------------
    @property
    def n_nodes(self) -> int:
        """Number of nodes of all beams, ends included."""
        return int(self.node_start[-1])

    @cached_property
    def node_start(self) -> Array:
        """First node of every beam in the list, then their number, int [m + 1]."""
        return np.concatenate(([0], np.cumsum(self.elements * self.degree + 1)))

    @cached_property
    def end_node(self) -> Array:
        """Both end nodes of every beam, int [m, 2]."""
        return np.stack((self.node_start[:-1], self.node_start[1:] - 1), axis=1)

    @cached_property
    def junction(self) -> Array:
        """End of the first beam at every node of the net, which stands for the node, int [n]."""
        out = np.empty(len(self.nodes), np.int64)
        out[self.edges.reshape(-1)[::-1]] = self.end_node.reshape(-1)[::-1]
        return out

    @property
    def element_start(self) -> Array:
        """First node of every element, int [elements]."""
        step = np.arange(int(self.elements.sum())) - np.repeat(np.cumsum(self.elements) - self.elements, self.elements)
        return np.repeat(self.node_start[:-1], self.elements) + self.degree * step

    def along(self, ends: Array) -> Array:
        """Return values [nodes of all beams, k] that are linear along the beams, from those at their ends [m, 2, k]."""
        count = np.diff(self.node_start)
        at = np.arange(self.n_nodes) - np.repeat(self.node_start[:-1], count)
        xi = 0.5 * (1.0 + gll_nodes(self.degree)[:-1])
        part = ((at // self.degree + xi[at % self.degree]) / np.repeat(self.elements, count))[:, None]
        out = np.repeat(ends[:, 0], count, axis=0)
        out += part * np.repeat(ends[:, 1] - ends[:, 0], count, axis=0)
        out[self.end_node[:, 1]] = ends[:, 1]
        return out

    @property
    def positions(self) -> Array:
        """Reference positions of all beams' nodes [*, 3], m; exactly those of the net at the ends."""
        return self.along(self.nodes[self.edges])

    @property
    def directors(self) -> Array:
        """Reference triads of all beams' nodes [*, 3, 3]."""
        return np.repeat(self.triads, np.diff(self.node_start), axis=0)

    @property
    def motion(self) -> tuple[Array, Array]:
        """Initial velocity and spin of all beams' nodes, both [*, 3]."""
        m = len(self.edges)
        v = np.zeros((m, 2, 3)) if self.velocity is None else self.velocity[self.edges]
        if self.spin is not None:
            return self.along(v), self.along(self.spin[self.edges])
        # between ball joints: the line between the ends turns, d1 x (difference of the velocities) / length
        swings = self.ball[self.edges].all(axis=1) & (self.velocity is not None)
        turn = np.cross(self.triads[:, 0], v[:, 1] - v[:, 0]) / self.lengths[:, None] * swings[:, None]
        return self.along(v), np.repeat(turn, np.diff(self.node_start), axis=0)

    def pairs(self) -> tuple[Array, Array]:
        """Return beam ends that a weld joins to the first one at their node, and those that a ball joint does, int [*, 2]."""
        at, node = self.end_node.reshape(-1), self.edges.reshape(-1)
        other = at != self.junction[node]
        pairs = np.stack((self.junction[node[other]], at[other]), axis=1)
        ball = self.ball[node[other]]
        return pairs[~ball], pairs[ball]

    def held(self) -> Array:
        """Return masks of fixed unknowns of all beams' nodes (7: position, 56: rotation), int [*]."""
        out = np.zeros(self.n_nodes, np.int64)
        out[self.junction[self.pins]] |= 7
        out[self.junction[self.clamps]] |= 63
        # at ball joints the clamp fixes the rotation of each beam end
        clamped = np.zeros(len(self.nodes), bool)
        clamped[self.clamps] = True
        node = self.edges.reshape(-1)
        out[self.end_node.reshape(-1)[(clamped & self.ball)[node]]] |= 56
        return out

    def __repr__(self) -> str:
        return f"<{self.label}: {len(self.edges)} beams, {int(self.elements.sum())} elements, {len(self.nodes)} nodes>"


def _each(value: Any, n: int) -> Any:
    """Return one vector for every node if only one is given."""
    found = checks.numbers(value)
    return np.broadcast_to(found, (n, 3)) if found is not None and found.shape == (3,) else value


def _table(who: str, what: str, value: Any, n: int | None, unit: str, columns: int | None = 3) -> Array:
    """Return a constant copy [n, columns] or [n] of finite numbers."""
    tail = () if columns is None else (columns,)
    need = f"numbers of shape [{'n' if n is None else n}{''.join(f', {c}' for c in tail)}] ({unit})"
    clean = checks.numbers(value)
    if clean is None:
        raise SceneError(f"{who}: {what} must be {need}, got {shown(value)}")
    if clean.ndim != 1 + len(tail) or clean.shape[1:] != tail or len(clean) == 0 or n not in (None, len(clean)):
        raise SceneError(f"{who}: {what} must be {need}, got shape {list(clean.shape)}")
    bad = ~(np.abs(clean) <= checks.LARGEST).reshape(len(clean), -1).all(axis=1)
    if bad.any():
        i = int(np.argmax(bad))
        raise SceneError(f"{who}: {what} must be finite ({unit}), at most {checks.LARGEST:g} in size, node {i} "
                         f"has {shown(clean[i])}")
    return checks.constant(clean)


def _of_edges(who: str, what: str, value: Any, m: int, unit: str) -> Array:
    """Return a number for every edge."""
    found = checks.numbers(value)
    if found is not None and found.ndim == 0:
        found = np.full(m, float(found))
    if found is None or found.shape != (m,) or not np.all(np.abs(found) <= checks.LARGEST):
        raise SceneError(f"{who}: {what} must be a finite number{unit} or {m} of them, one for every edge, got {shown(value)}")
    return checks.constant(found)


def _integers(who: str, what: str, value: Any, shape: tuple[int | None, ...], below: int | None, need: str,
              least: int = 0) -> Array:
    """Return a constant copy of whole numbers from `least` up to, not including, `below`."""
    wanted = "[" + ", ".join("m" if s is None else str(s) for s in shape) + "]"
    floats = checks.numbers(value)
    if floats is None:
        raise SceneError(f"{who}: {what} must be {need}, shape {wanted}, got {shown(value)}")
    clean = np.asarray(value)
    if clean.size == 0 and len(shape) == clean.ndim == 1:
        clean = clean.astype(np.int64)
    if clean.dtype.kind not in "iu" or clean.ndim != len(shape) or any(s not in (None, t) for s, t in zip(shape, clean.shape)):
        raise SceneError(f"{who}: {what} must be {need}, shape {wanted}, got an array of {clean.dtype} with shape "
                         f"{list(clean.shape)}")
    wrong = clean < least if below is None else (clean < least) | (clean >= below)
    if wrong.any():
        at = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise SceneError(f"{who}: {what} must be {need}, entry {at[0]} has {clean[at]}")
    out = np.array(clean, dtype=np.int64)
    out.setflags(write=False)
    return out


def _sections(who: str, section: Any, section_of: Any, m: int) -> tuple[tuple[Section, ...], Array]:
    sections = (section,) if isinstance(section, Section) else tuple(section) if isinstance(section, (list, tuple)) else ()
    if not sections or not all(isinstance(s, Section) for s in sections):
        raise SceneError(f"{who}: section must be a Section or a list of them, got {shown(section)}; use Section.circle(...) for "
                         "instance")
    if section_of is None and len(sections) > 1:
        raise SceneError(f"{who}: has {len(sections)} sections; assign them to edges with section_of=[...]")
    section_of = np.zeros(m, np.int64) if section_of is None else section_of
    return sections, _integers(who, "section_of", section_of, (m,), len(sections), f"section numbers from 0 to "
                                                                                   f"{len(sections) - 1}")


def _joints(who: str, joints: Any, n: int) -> Array:
    """Return which nodes are ball joints, bool [n]."""
    words = np.asarray(joints if isinstance(joints, (str, list, tuple, np.ndarray)) and _is_flat(joints) else 0)
    if words.ndim > 1 or (words.ndim == 1 and words.size != n) or words.dtype.kind != "U" or not np.isin(words, JOINTS).all():
        raise SceneError(f"{who}: joints must be 'rigid', 'ball' or one of both words for each of the {n} nodes, "
                         f"got {shown(joints)}")
    return np.broadcast_to(words == "ball", (n,)).copy()


def _is_flat(words: Any) -> bool:
    """Return whether words are a text, an array or a list of texts only."""
    return isinstance(words, (str, np.ndarray)) or all(isinstance(word, str) for word in words)


def _lines(who: str, nodes: Array, edges: Array, d2: Any) -> tuple[Array, Array]:
    """Return lengths [m] and triads [m, 3, 3] of the beams, by the rules of `Beam.straight`."""
    x = nodes[edges]
    chord = x[:, 1] - x[:, 0]
    length = np.linalg.norm(chord, axis=1)
    short = length <= 1e-14 * np.abs(x).max(axis=(1, 2))
    if short.any():
        k = int(np.argmax(short))
        raise SceneError(f"{who}: edge {k} joins nodes {edges[k, 0]} and {edges[k, 1]}, which coincide at "
                         f"{checks.shown(x[k, 0])}; a beam needs a length > 0 m")
    d1 = chord / length[:, None]
    if d2 is None:
        hint = np.stack((-d1[:, 1], d1[:, 0], np.zeros(len(d1))), axis=1)
        hint[np.hypot(d1[:, 0], d1[:, 1]) < 1e-6] = (0.0, 1.0, 0.0)
    else:
        given = checks.numbers(d2)
        hint = np.broadcast_to(given, d1.shape) if given is not None and given.shape == (3,) else given
        if hint is None or hint.shape != d1.shape or not np.all(np.abs(hint) <= checks.LARGEST):
            raise SceneError(f"{who}: d2 must be 3 finite numbers or an array of them of shape [{len(d1)}, 3], got "
                             + (shown(d2) if hint is None else f"shape {list(hint.shape)}"))
    across = hint / np.maximum(np.linalg.norm(hint, axis=1), 1e-300)[:, None]
    for _ in range(2):
        across = across - np.einsum("kc,kc->k", across, d1)[:, None] * d1
        size = np.linalg.norm(across, axis=1)
        if np.any(size < 1e-6):
            k = int(np.argmax(size < 1e-6))
            raise SceneError(f"{who}: d2={checks.shown(hint[k])} of edge {k} is parallel to its axis {checks.shown(d1[k])}; give "
                             "a direction across it")
        across = across / size[:, None]
    return length, np.stack((d1, across, np.cross(d1, across)), axis=1) + 0.0
