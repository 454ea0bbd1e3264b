"""Connected components of a scene, and points that coincide without a joint."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.model.connections import components
from fastbeam.model.numbering import NodeList
from fastbeam.scene import Scene

Array = np.ndarray
# nodes closer than this share of the size of the scene lie at the same place
TOUCHING = 1e-9
# a free end closer to another node than this share of its beam is probably meant to be there, as with typed coordinates (0.866)
NEARLY = 1e-3
# largest number of pairs whose distances are computed one by one, without a tree
FEW = 10**6
# direction along which nodes of a regular grid have different coordinates
DIRECTION = np.array([0.5377431, 0.7218043, 0.4356827])


def pieces(scene: Scene, nodes: NodeList, held: Array, length: float
           ) -> tuple[int, list[list[int]], list[tuple[int, int, float]]]:
    """Count the pieces that joints, links, nets and sliders connect, and find the nodes of every place where a free end of a beam
    touches another node without a joint, and free ends that almost touch one: both nodes, and their distance, m.

    held: int [N], masks of fixed unknowns: ends that stand on supports side by side are not meant to be joined.
    length: size of the scene, m.
    """
    n = len(nodes)
    joints = [nodes.ends([*scene.rigid, *scene.balls]),
              np.array(nodes.arm_owner, np.int64).reshape(-1, 2),
              *(nodes.start(net) + pairs for net in scene.nets for pairs in net.pairs())]
    ends = [np.array([(nodes.start(b), nodes.start(b) + b.n_nodes - 1) for b in scene.beams], np.int64).reshape(-1, 2),
            *(nodes.start(net) + net.end_node for net in scene.nets)]
    first_and_last = np.concatenate(ends)
    # a beam is a chain of its nodes
    goes_on = np.zeros(n, bool)
    for first, last in ([nodes.start(part), nodes.start(part) + part.n_nodes] for part in [*scene.beams, *scene.nets]):
        goes_on[first:last] = True
    goes_on[first_and_last[:, 1]] = False
    chain = np.flatnonzero(goes_on)
    contacts = np.array([(nodes.number(s.point), nodes.start(s.beams[0])) for s in scene.sliders], np.int64).reshape(-1, 2)
    linked = nodes.ends(scene.links)
    for winch in scene.winches:
        points = [nodes.start(x) for x in (winch.coil, *winch.points)]
        rope = [nodes.number(winch.drum), *points, nodes.number(winch.load)]
        joints.append(np.stack((rope[:-1], rope[1:]), axis=1))
    # a link joins points at the same place; across a distance it does not
    distance = np.linalg.norm(nodes.phi[linked[:, 0]] - nodes.phi[linked[:, 1]], axis=1)
    joined = components(n, np.concatenate((*joints, linked[distance <= TOUCHING * length])))
    count = int(components(n, np.concatenate((*joints, np.stack((chain, chain + 1), axis=1), contacts, linked))).max()) + 1
    # here links join across a distance, too
    across = components(n, np.concatenate((*joints, linked)))
    alone = np.bincount(joined, minlength=n)[joined] == 1
    alone[contacts[:, 0]] = False
    free = np.zeros(n, bool)
    free[first_and_last] = True
    places = _touching(scene, nodes, joined, free & alone, held, length)
    reach = np.full(n, np.inf)
    lengths = np.concatenate(([b.length for b in scene.beams], *(net.lengths for net in scene.nets)))
    reach[first_and_last] = NEARLY * lengths[:, None]
    own = np.concatenate(([0], np.cumsum(~goes_on[:-1])))
    return count, places, _nearly(scene, nodes, _Ends(across, free & alone, free, own, reach, held), places)


class _Ends(NamedTuple):
    """Data of every node [N]: component that joints and links connect, True for an end without a joint, True for an end, number
    of its beam, distance within which it counts as near, m, and mask of fixed unknowns."""

    joined: Array
    loose: Array
    end: Array
    beam: Array
    reach: Array
    held: Array


def _nearly(scene: Scene, nodes: NodeList, ends: _Ends, places: list[list[int]]) -> list[tuple[int, int, float]]:
    """Find for every free end the nearest other node within reach, not of its own beam between the ends."""
    loose = ends.loose.copy()
    loose[[k for place in places for k in place]] = False
    own, at = np.flatnonzero(loose), np.flatnonzero(_on_beams(scene, nodes))
    if not own.size:
        return []
    x = nodes.phi
    if own.size * at.size <= FEW:
        square = sum((x[own, None, c] - x[None, at, c])**2 for c in range(3))
        k, i = np.nonzero(square <= ends.reach[own, None]**2)
        one, other = own[k], at[i]
    else:
        from scipy.spatial import cKDTree
        found = cKDTree(x[at]).query_ball_point(x[own], ends.reach[own])
        one = np.repeat(own, np.fromiter(map(len, found), np.int64, len(found)))
        other = at[np.concatenate(found).astype(np.int64)]
    distance = np.linalg.norm(x[one] - x[other], axis=1)
    keep = (ends.joined[one] != ends.joined[other]) & (distance <= ends.reach[other]) & (distance > 0.0)
    keep &= (ends.beam[one] != ends.beam[other]) | ends.end[other]
    keep &= (ends.held[one] & 7 == 0) | (ends.held[other] & 7 == 0)
    pairs = _without_sliders(scene, nodes, np.stack((one, other), axis=1)[keep])
    nearest: dict[int, tuple[int, int, float]] = {}
    for i, j in pairs.tolist():
        d = float(np.linalg.norm(x[i] - x[j]))
        # a pair of ends is found from both sides
        if d < nearest.get(i, (i, j, np.inf))[2] and nearest.get(j, (j, -1, 0.0))[1] != i:
            nearest[i] = i, j, d
    return sorted(nearest.values())


def _on_beams(scene: Scene, nodes: NodeList) -> Array:
    """Return which nodes lie on their part, bool [N]: control points of splines do not lie on their beam."""
    out = np.ones(len(nodes), bool)
    for beam in scene.beams:
        if beam.interpolation == "bspline":
            out[nodes.start(beam) + 1:nodes.start(beam) + beam.n_nodes - 1] = False
    return out


def _without_sliders(scene: Scene, nodes: NodeList, pairs: Array) -> Array:
    """Remove pairs of a slider and a node of its beam: a slider may start at an end of it."""
    for slider in scene.sliders:
        for beam in slider.beams:
            point, span = nodes.number(slider.point), nodes.span(beam)
            other = pairs.sum(axis=1) - point
            pairs = pairs[~((pairs == point).any(axis=1) & (other >= span.start) & (other < span.stop))]
    return pairs


def _touching(scene: Scene, nodes: NodeList, joined: Array, free: Array, held: Array, length: float) -> list[list[int]]:
    """Return the nodes at the same place as a free end, place by place."""
    phi = nodes.phi
    tolerance = TOUCHING * length + 16.0 * float(np.finfo(float).eps * np.max(np.abs(phi)))
    at = np.flatnonzero(_on_beams(scene, nodes))
    # nodes at one place are neighbours along any direction
    height = phi[at] @ DIRECTION
    order = np.argsort(height, kind="stable")
    at, height = at[order], height[order]
    begin = np.flatnonzero(np.concatenate(([True], np.diff(height) > tolerance)))
    some = np.logical_or.reduceat(free[at], begin)
    some &= np.maximum.reduceat(joined[at], begin) != np.minimum.reduceat(joined[at], begin)
    if not some.any():
        return []
    from scipy.spatial import cKDTree
    near = at[np.repeat(some, np.diff(np.concatenate((begin, [at.size]))))]
    pairs = near[cKDTree(phi[near]).query_pairs(tolerance, output_type="ndarray")].reshape(-1, 2)
    one, other = pairs.T
    pairs = pairs[(free[one] | free[other]) & (joined[one] != joined[other]) & ~((held[one] & 7 != 0) & (held[other] & 7 != 0))]
    pairs = _without_sliders(scene, nodes, pairs)
    places: dict[int, list[int]] = {}
    of = components(len(nodes), pairs)
    for k in np.unique(pairs).tolist():
        places.setdefault(int(of[k]), []).append(k)
    return sorted(places.values())
