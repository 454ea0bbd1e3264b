"""Search for substructures that are condensed to their ends: beams of nets, and pieces of long beams, eight equal ones at a time
(theory.md 9)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.compile.carriers import Found
from fastbeam.model.connections import Connections
from fastbeam.model.numbering import NodeList
from fastbeam.scene import Net, Scene

Array = np.ndarray
# smallest numbers of condensable elements for which condensation pays: in nets, against a sparse solver, and in long beams,
# against block elimination
WORTH_IN_NETS, WORTH_IN_BEAMS = 1000, 8000
# elements of a piece: the data of eight pieces fit into the cache of a processor
PIECE = 32


class Chosen(NamedTuple):
    """Elements of a beam or net: those of no substructure, int [*]; groups of eight substructures, [groups, elements of each, 8]
    for every number of elements."""

    rest: Array
    groups: list[Array]


def substructures_of(scene: Scene, nodes: NodeList, joints: Connections, linked: Array, condense: bool | str,
                     carried: Found | None) -> tuple[dict[str, Chosen], Found | None]:
    """Find the substructures of every beam or net that has any, by its name, and the carriers, None where they do not pay. Only
    elements and loads may touch the nodes between the ends of a substructure, and no slider runs on it.

    linked: int [*], nodes that springs and joints with multipliers touch.
    condense: bool or 'auto', 'auto': where it pays.
    carried: beams that may be carriers.
    """
    if not condense:
        return {}, None
    free = _free_nodes(scene, nodes, joints, linked)
    nets = {net.name: _in_net(scene, net, free[nodes.span(net)]) for net in scene.nets}
    beams = {beam.name: _in_beam(free[nodes.span(beam)], beam.n_elements, beam.degree)
             for beam in scene.beams if beam.interpolation == "lagrange"}
    out: dict[str, Chosen] = {}
    more = carried.n_elements if carried is not None and nets else 0
    for found, worth, others in ((nets, WORTH_IN_NETS, more), (beams, WORTH_IN_BEAMS, 0)):
        found = {name: chosen for name, chosen in found.items() if chosen.groups}
        if condense is True or sum(x.size for chosen in found.values() for x in chosen.groups) + others >= worth:
            out |= found
    pays = out or (more and (condense is True or more >= WORTH_IN_NETS))
    return out, carried if pays else None


def _free_nodes(scene: Scene, nodes: NodeList, joints: Connections, linked: Array) -> Array:
    """Return which nodes only elements and loads touch, bool [N]."""
    n = np.arange(len(nodes))
    free = (joints.held == 0) & ~joints.tied & (joints.row_root == n) & (joints.spin_root == n)
    free[joints.row_root[joints.row_root != n]] = False
    free[joints.target] = False
    free[linked] = False
    free[joints.row_root[linked]] = False
    for slider in scene.sliders:
        free[nodes.number(slider.point)] = False
        for beam in slider.beams:
            free[nodes.span(beam)] = False
    return free


def _choose(n_elements: int, groups: list[Array]) -> Chosen:
    rest = np.ones(n_elements, bool)
    for some in groups:
        rest[some.reshape(-1)] = False
    return Chosen(np.flatnonzero(rest), groups)


def _in_net(scene: Scene, net: Net, free: Array) -> Chosen:
    """Choose whole beams of a net."""
    taken = np.concatenate(([0], np.cumsum(~free)))
    first, last = net.end_node.T
    whole = taken[last] == taken[first + 1]
    for slider in scene.sliders:
        for beam in slider.beams:
            if getattr(beam, "net", None) is net:
                whole[beam.index] = False
    element = np.cumsum(net.elements) - net.elements
    groups = []
    for count in np.unique(net.elements[whole]).tolist():
        equal = np.flatnonzero(whole & (net.elements == count))
        equal = equal[:equal.size // 8 * 8].reshape(-1, 1, 8)
        if equal.size:
            groups.append(element[equal] + np.arange(count)[:, None])
    return _choose(int(net.elements.sum()), groups)


def _in_beam(free: Array, n_elements: int, degree: int) -> Chosen:
    """Choose pieces of a beam between the nodes that other parts touch."""
    inside = free[1:-1].reshape(-1)
    inside = np.append(inside, False).reshape(n_elements, degree)
    usable = inside[:, :-1].all(axis=1)
    # stretches of usable elements: a new one begins behind a node that another part touches
    begins = np.flatnonzero(usable & ~np.concatenate(([False], usable[:-1] & inside[:-1, -1])))
    ends = np.flatnonzero(usable & ~np.concatenate((usable[1:] & inside[:-1, -1], [False]))) + 1
    found: dict[int, list[Array]] = {}
    for first, last in zip(begins.tolist(), ends.tolist()):
        while last - first >= 16:
            count = min(PIECE, (last - first) // 8)
            groups = (last - first) // (8 * count)
            pieces = first + count * np.arange(8 * groups).reshape(groups, 1, 8) + np.arange(count)[:, None]
            found.setdefault(count, []).append(pieces)
            first += 8 * groups * count
    return _choose(n_elements, [np.concatenate(found[count]) for count in sorted(found)])
