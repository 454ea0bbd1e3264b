"""Curves of sliders: the curve of a beam, or the curves of several beams as one (theory.md 3.2, 5.7)."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from fastbeam.interface.errors import SceneError
from fastbeam.model.connections import components
from fastbeam.model.numbering import NodeList
from fastbeam.scene import Beam, NodeRef, Path, Scene, Slider, Switch
from fastbeam.scene.interpolation.basis import CurveBasis, end_bumps
from fastbeam.scene.switches import END

Array = np.ndarray
# largest angle between the references of two beams, rad, whose common curve gets one tangent
STRAIGHT = 1e-6
# smallest angle of a sharp corner between two tracks of a switch, rad, where no step ends
SHARP = 0.1


@dataclass(frozen=True, eq=False)
class Track:
    """Curve of a slider."""

    nodes: Array  # int [n]: numbers of its nodes in the scene, along it
    # basis of the curve; elements of a closed path may have nodes before the first and behind the last: -1 is the last, n the
    # first
    basis: CurveBasis
    node_s: Array  # float64 [n]: arc lengths of its nodes along it, m
    period: float = 0.0  # length of a closed path, m; 0 for a curve with ends
    # joints, smooth: places where beams of a path meet, and those of them where the curve has one tangent
    joints: int = 0
    smooth: int = 0

    def at(self, s: float) -> tuple[Array, Array, Array]:
        """Return the nodes under arc length s that count there, their shape functions and slopes."""
        if self.period:
            s -= self.period * np.floor(s / self.period)
        first, values, slopes = self.basis.evaluate(s)
        keep = np.flatnonzero((values[0] != 0.0) | (slopes[0] != 0.0))
        local = int(first[0]) + keep
        if not self.period:
            return self.nodes[local], values[0, keep], slopes[0, keep]
        local, which = np.unique(local % self.nodes.size, return_inverse=True)
        return self.nodes[local], np.bincount(which, values[0, keep]), np.bincount(which, slopes[0, keep])


def contact_curve_of(scene: Scene, nodes: NodeList, slider: Slider) -> Track:
    """Return the curve of a slider, made once for all sliders on it. Raises SceneError: beams of a path meet where nothing holds
    them together."""
    key = (slider.beam, slider.curve, getattr(slider, "length", 0.0))
    if key not in nodes.tracks:
        on = slider.beam
        if isinstance(on, Switch):
            nodes.tracks[key] = _of_switch(scene, nodes, on, slider.curve)
        elif isinstance(on, Path):
            nodes.tracks[key] = _of_path(scene, nodes, on, slider.curve)
        else:
            # elements that move are stretched unlike, so that means of slopes where they meet are none of the beam
            curve = on.basis.curve("own") if any(on is beam for beam in nodes.moved) else slider.contact_curve
            nodes.tracks[key] = Track(nodes.start(on) + np.arange(on.n_nodes), curve, on.basis.node_s)
    return nodes.tracks[key]


def _of_path(scene: Scene, nodes: NodeList, path: Path, kind: str) -> Track:
    parts = [_part(beam, direction, kind) for beam, direction in zip(path.beams, path.directions)]
    numbers = [nodes.start(beam) + np.arange(beam.n_nodes)[::direction] for beam, direction in zip(path.beams, path.directions)]
    tangents = nodes.directors[:, 0]
    joints = path.joints()
    smooth = np.zeros(len(joints), bool)
    turns = list(zip(path.directions, path.directions[1:] + path.directions[:1]))
    together = _Together(scene, nodes)
    for j, (a, b) in enumerate(together.numbers(path.label, joints)):
        # a hinge may turn at any time
        kink = turns[j][0] * tangents[a] - turns[j][1] * tangents[b]
        smooth[j] = kind == "c1" and together.turn_alike(a, b) and float(np.linalg.norm(kink)) < STRAIGHT
    places = [start + (beam.basis.node_s if direction > 0 else beam.length - beam.basis.node_s[::-1])
              for start, beam, direction in zip(path.starts, path.beams, path.directions)]
    return Track(np.concatenate(numbers), _joined(parts, smooth, path.closed), np.concatenate(places),
                 path.length if path.closed else 0.0, len(joints), int(smooth.sum()))


def corners_of(scene: Scene, nodes: NodeList, slider: Slider) -> dict[tuple[int, bool, int], tuple[Track | None, bool]]:
    """Return the corners where tracks of the switch of a slider meet: (number of the track that it leaves, True by its end,
    number of the next track) -> both as one curve, on which the first keeps its arc lengths on the switch, None for tracks that
    share nodes; True for a sharp corner."""
    switch: Switch = slider.beam
    tracks = _tracks_of(scene, nodes, switch, slider.curve)
    number = {x.name: k for k, x in enumerate(switch.tracks)}
    out: dict[tuple[int, bool, int], tuple[Track | None, bool]] = {}
    for k, (one, (begin, end)) in enumerate(zip(tracks, switch.spans.tolist())):
        for name in switch.options(switch.tracks[k], END):
            j, other = number[name], tracks[number[name]]
            a, b = (nodes.phi[x.at(s)[0]].T @ x.at(s)[2] for x, s in ((one, end - begin), (other, 0.0)))
            turn = float(np.linalg.norm(a / np.linalg.norm(a) - b / np.linalg.norm(b)))
            if turn > STRAIGHT:
                is_one = not np.isin(one.nodes, other.nodes).any()
                meet = float(switch.spans[j, 0])
                out[k, True, j] = (_end_to_end(one, other, begin, end) if is_one else None), turn > SHARP
                out[j, False, k] = (_end_to_end(one, other, meet - (end - begin), meet) if is_one else None), turn > SHARP
    return out


def _end_to_end(one: Track, other: Track, begin: float, meet: float) -> Track:
    """Join two tracks to one curve with a corner at arc length `meet`; the first begins at `begin`."""
    width, size = (max(x.basis.coef.shape[k] for x in (one, other)) for k in (1, 2))
    coef = [_padded(x.basis.coef, width, size) for x in (one, other)]
    ends = np.concatenate((begin + one.basis.element_ends, meet + other.basis.element_ends[1:]))
    ends[one.basis.element_ends.size - 1] = meet
    return Track(np.concatenate((one.nodes, other.nodes)), CurveBasis(
        ends, np.concatenate((one.basis.first_node, one.nodes.size + other.basis.first_node)),
        np.concatenate((one.basis.n_nodes_of, other.basis.n_nodes_of)), np.concatenate(coef)),
        np.concatenate((begin + one.node_s, meet + other.node_s)))


def _padded(coef: Array, width: int, size: int) -> Array:
    """Pad coefficients with room for more nodes and coefficients."""
    return np.pad(coef, ((0, 0), (0, width - coef.shape[1]), (0, size - coef.shape[2])))


def _tracks_of(scene: Scene, nodes: NodeList, switch: Switch, kind: str) -> list[Track]:
    return [_of_path(scene, nodes, on, kind) if isinstance(on, Path) else Track(
        nodes.start(on) + np.arange(on.n_nodes), on.basis.curve(kind), on.basis.node_s) for on in switch.tracks]


def _of_switch(scene: Scene, nodes: NodeList, switch: Switch, kind: str) -> Track:
    """Join all tracks one behind the other to one curve. Straight pieces between them serve iterations of a step beyond an end: a
    slider never stays there."""
    tracks = _tracks_of(scene, nodes, switch, kind)
    _Together(scene, nodes).numbers(switch.label, switch.joints())
    width, size = (max(track.basis.coef.shape[k] for track in tracks) for k in (1, 2))
    ends, first, count, coef = [np.zeros(1)], [], [], []
    node = 0
    for k, (track, (begin, end)) in enumerate(zip(tracks, switch.spans.tolist())):
        basis, last = track.basis, k == len(tracks) - 1
        own = _padded(basis.coef, width, size)
        arc = begin + basis.element_ends[1:]
        arc[-1] = end
        pieces = [(own, node + basis.first_node, basis.n_nodes_of, arc)]
        length = np.diff(basis.element_ends)
        if k:
            before = _straight_on(own[0], length[0], -switch.gap)
            pieces.insert(0, (before[None], node + basis.first_node[:1], basis.n_nodes_of[:1], np.array([begin])))
        if not last:
            behind = _straight_on(own[-1], length[-1], switch.gap)
            pieces.append((behind[None], node + basis.first_node[-1:], basis.n_nodes_of[-1:], np.array([end + switch.gap])))
        for target, parts in zip((coef, first, count, ends), zip(*pieces)):
            target.extend(parts)
        node += track.nodes.size
    return Track(np.concatenate([track.nodes for track in tracks]),
                 CurveBasis(np.concatenate(ends), np.concatenate(first), np.concatenate(count), np.concatenate(coef)),
                 np.concatenate([begin + track.node_s for track, (begin, _) in zip(tracks, switch.spans.tolist())]), 0.0,
                 sum(track.joints for track in tracks), sum(track.smooth for track in tracks))


def _straight_on(coef: Array, length: float, way: float) -> Array:
    """Return the coefficients [nodes, coefficients] of the tangent at the end of an element of this length, over the arc length
    `way` behind it, or before its start where that is negative."""
    k = np.arange(coef.shape[1])
    sign = 1.0 if way > 0.0 else -1.0
    values, slopes = coef @ sign**k, coef @ (sign**(k + 1) * k * (k + 1)) / length
    out = np.zeros_like(coef)
    out[:, 0], out[:, 1] = values + 0.5 * way * slopes, 0.5 * abs(way) * slopes
    return out


class Part(NamedTuple):
    """Beam of a path, in the direction of the path."""

    curve: CurveBasis   # curve of the sliders
    own: CurveBasis     # curve of the beam
    degree: int
    n_nodes: int


def _part(beam: Beam, direction: int, kind: str) -> Part:
    basis = beam.basis
    curves = [basis.curve(kind), basis.curve("own")]
    if direction < 0:
        curves = [_reversed(curve, beam.n_nodes) for curve in curves]
    return Part(curves[0], curves[1], beam.degree, beam.n_nodes)


def _reversed(curve: CurveBasis, n_nodes: int) -> CurveBasis:
    """Return the curve from its end to its start."""
    count, width = curve.n_nodes_of[::-1], curve.coef.shape[1]
    column = np.arange(width)
    take = np.where(column < count[:, None], count[:, None] - 1 - column, column)
    coef = np.take_along_axis(curve.coef[::-1], take[:, :, None], axis=1) * (-1.0)**np.arange(curve.coef.shape[2])
    ends = curve.element_ends
    return CurveBasis(ends[-1] - ends[::-1], (n_nodes - curve.first_node - curve.n_nodes_of)[::-1], count, coef)


def _joined(parts: list[Part], smooth: Array, closed: bool) -> CurveBasis:
    """Join the curves of beams end to end; smooth [joints]: where both sides get one tangent, as inside of `Basis.curve`."""
    n_elements = np.array([part.curve.first_node.size for part in parts])
    element = np.concatenate(([0], np.cumsum(n_elements)))
    node = np.concatenate(([0], np.cumsum([part.n_nodes for part in parts])))
    extra = max(part.degree for part in parts) + 1
    width = max(part.curve.coef.shape[1] for part in parts) + 2 * extra
    size = max(max(part.curve.coef.shape[2], part.degree + 3) for part in parts)
    ends, begin = [np.zeros(1)], 0.0
    # windows of nodes with room on both sides
    coef = np.zeros((element[-1], width, size))
    first, count = np.zeros(element[-1], np.int64), np.zeros(element[-1], np.int64)
    for k, part in enumerate(parts):
        some = slice(element[k], element[k + 1])
        curve = part.curve
        ends.append(begin + curve.element_ends[1:])
        begin = float(ends[-1][-1])
        coef[some, extra:extra + curve.coef.shape[1], :curve.coef.shape[2]] = curve.coef
        first[some], count[some] = node[k] + curve.first_node, curve.n_nodes_of
    low, high = first.copy(), first + count
    arc = np.concatenate(ends)
    for j in np.flatnonzero(smooth).tolist():
        k, other = j, (j + 1) % len(parts)
        left, right = int(element[k + 1]) - 1, int(element[other])
        p, q = parts[k].degree, parts[other].degree
        around = int(node[-1]) * (other <= k)
        nodes = np.concatenate((node[k + 1] - 1 - p + np.arange(p + 1), node[other] + around + np.arange(q + 1)))
        slope_left = legendre.legval(1.0, legendre.legder(parts[k].own.coef[-1, :p + 1].T, axis=0))
        slope_right = legendre.legval(-1.0, legendre.legder(parts[other].own.coef[0, :q + 1].T, axis=0))
        ratio = (arc[right + 1] - arc[right]) / (arc[left + 1] - arc[left])
        share = 1.0 / (1.0 + ratio**min(p, q))
        change = np.concatenate((-slope_left, slope_right / ratio))
        columns = nodes - first[left] + extra
        coef[left, columns, :p + 3] += share * change[:, None] * end_bumps(p)[1]
        low[left], high[left] = min(low[left], nodes[0]), max(high[left], nodes[-1] + 1)
        nodes = nodes - around
        change = np.concatenate((ratio * slope_left, -slope_right))
        columns = nodes - first[right] + extra
        coef[right, columns, :q + 3] += (1.0 - share) * change[:, None] * end_bumps(q)[0]
        low[right], high[right] = min(low[right], nodes[0]), max(high[right], nodes[-1] + 1)
        for e, at, degree in ((left, node[k + 1] - 1 - p, p), (right, node[other], q)):
            defect = coef[e].sum(axis=0)
            defect[0] -= 1.0
            coef[e, at + degree // 2 - first[e] + extra] -= defect
    # windows begin with their first node
    column = (low - first + extra)[:, None] + np.arange(int((high - low).max()))
    packed = np.take_along_axis(coef, np.minimum(column, width - 1)[:, :, None], axis=1)
    packed[np.arange(packed.shape[1]) >= (high - low)[:, None]] = 0.0
    used = int(np.flatnonzero(np.any(packed != 0.0, axis=(0, 1)))[-1]) + 1
    return CurveBasis(arc, low, high - low, np.ascontiguousarray(packed[:, :, :max(used, 2)]))


class _Together:
    """Nodes of a scene that stay together at one place."""

    def __init__(self, scene: Scene, nodes: NodeList) -> None:
        n = len(nodes)
        found = [nodes.start(net) + of for net in scene.nets for of in net.pairs()]
        rigid = np.concatenate((nodes.ends(scene.rigid), np.array(nodes.arm_owner, np.int64).reshape(-1, 2), *found[::2]))
        self.balls = np.concatenate((nodes.ends(scene.balls), *found[1::2]))
        self.set = components(n, rigid)
        self.still = np.zeros(n, bool)
        whole = [x for x in (*scene.clamps, *scene.pins) if x.mask & 7 == 7]
        clamped = [nodes.number(x.at) if x.at.is_center else nodes.start(x.at.owner) for x in whole if x.holds_triad]
        self.clamped = np.isin(self.set, self.set[np.array(clamped, np.int64)])
        self.still |= self.clamped
        self.still[np.array([nodes.number(x.at) for x in whole if not x.holds_triad], np.int64)] = True
        for net in scene.nets:
            self.still[nodes.span(net)] |= net.held() & 7 == 7
        self.nodes, self.phi = nodes, nodes.phi
        self.tolerance = 1e-9 * (float(np.max(np.ptp(self.phi, axis=0))) or 1.0) + 32.0 * float(
            np.finfo(float).eps * np.max(np.abs(self.phi)))

    def turn_alike(self, a: int, b: int) -> bool:
        """Return whether two nodes have the same rotation at all times: welded together, or both clamped."""
        return bool(self.set[a] == self.set[b] or self.clamped[a] and self.clamped[b])

    def joined(self, a: int, b: int) -> bool:
        """Return whether two nodes at one place stay together: through joints at that place, or because supports hold both."""
        here = np.max(np.abs(self.phi - self.phi[a]), axis=1) <= self.tolerance
        # pairs of rigid sets that meet at this place, -1 is the ground; then those of both nodes
        still = self.set[here & self.still]
        pairs = np.concatenate((self.set[self.balls[here[self.balls].all(axis=1)]],
                                np.stack((still, np.full_like(still, -1)), axis=1), self.set[[[a, b]]]))
        every, number = np.unique(pairs, return_inverse=True)
        number = number.reshape(-1, 2)
        one, other = components(every.size, number[:-1])[number[-1]]
        return bool(one == other)

    def numbers(self, who: str, joints: list[tuple[NodeRef, NodeRef]]) -> list[tuple[int, int]]:
        """Return the numbers of nodes at which parts of a track meet. Raises SceneError: nothing holds two of them together."""
        out = [(self.nodes.number(one), self.nodes.number(other)) for one, other in joints]
        for (one, other), (a, b) in zip(joints, out):
            if not self.joined(a, b):
                raise SceneError(f"{who}: {one} and {other} meet without a joint, so they would move apart; join them by a "
                                 "RigidConnection or a BallJoint, or use beams of a net that share a node")
        return out
