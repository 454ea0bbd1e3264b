"""Carriers: beams with sliders in scenes with condensed beams, condensed to their ends together with what slides on them
(theory.md 9). This file finds them when a scene is compiled."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fastbeam.kernels.linalg.carriers import Carriers
from fastbeam.model.connections import HOLD_TRIAD, Connections
from fastbeam.model.numbering import NodeList
from fastbeam.scene import Beam, Path, Scene, Sleeve

Array = np.ndarray
# groups of carriers, each for one thread at a time: largest number of groups, smallest number of carriers in each
MOST_GROUPS, LEAST_CARRIERS = 16, 24


@dataclass
class Found:
    """Carriers of a scene; elements of every beam or net, by its name, that belong to each group."""

    carriers: Carriers
    elements: dict[str, list[tuple[int, Array]]] = field(default_factory=dict)

    def taken(self, name: str) -> Array:
        """Return all elements of a beam or net that belong to carriers."""
        return np.concatenate([np.zeros(0, np.int64), *(some for _, some in self.elements.get(name, ()))])

    @property
    def n_elements(self) -> int:
        """Number of elements of all carriers."""
        return sum(some.size for groups in self.elements.values() for _, some in groups)


def carriers_of(scene: Scene, nodes: NodeList, joints: Connections, linked: Array) -> Found | None:
    """Find all beams that may be carriers; None without any. Only elements, loads and sliders touch the nodes between the ends of
    such a beam. The point of each of its sliders is a mass, or belongs to a body, without supports and other joints, that slides
    on this beam alone, and not on one side only; a sleeve has no friction against twist.

    linked: int [*], nodes that springs and joints with multipliers touch.
    """
    sliders: dict[int, list[int]] = {}
    beams: dict[int, Any] = {}
    beam_of: dict[int, int] = {}
    refused: set[int] = set()
    points: list[int] = []
    for k, slider in enumerate(scene.sliders):
        under, owner = [nodes.start(beam) for beam in slider.beams], slider.point.owner
        first = under[0]
        beams[first] = slider.beam
        sliders.setdefault(first, []).append(k)
        rubs = isinstance(slider, Sleeve) and slider.radius is not None
        if isinstance(slider.beam, Path) or isinstance(owner, Beam) or slider.one_sided is not None or rubs:
            refused.update(under)
        if isinstance(owner, Beam):
            points.append(nodes.number(slider.point))
        elif beam_of.setdefault(nodes.start(owner), first) != first:
            refused.update((first, beam_of[nodes.start(owner)]))
    arms: dict[int, list[int]] = {body: [] for body in beam_of}
    for body, arm in nodes.arm_owner:
        if body in arms:
            arms[body].append(arm)
    own = np.arange(len(nodes))
    body_of = np.full(len(nodes), -1)
    for body, some in arms.items():
        body_of[[body, *some]] = body
    follows = joints.target != joints.owner
    # connections of a body beyond its own points, in both directions
    across = body_of[joints.target[follows]] != body_of[joints.owner[follows]]
    joined = joints.row_root != own
    joined[joints.row_root[joined]] = True
    joined[joints.target[follows][across]] = joined[joints.owner[follows][across]] = True
    for touched in (linked, points):
        joined[touched] = joined[joints.row_root[touched]] = True
    for body, some in arms.items():
        if joined[[body, *some]].any() or joints.held[body] & ~HOLD_TRIAD:
            refused.add(beam_of[body])
    free = ~joined & (joints.held == 0)
    refused.update(first for first, beam in beams.items() if first not in refused
                   and not free[first + 1:first + beam.n_nodes - 1].all())
    beams = {first: beam for first, beam in beams.items() if first not in refused}
    if not beams:
        return None
    return _packed(beams, sliders, {body: first for body, first in beam_of.items() if first in beams}, arms)


def _packed(beams: dict[int, Any], sliders: dict[int, list[int]], beam_of: dict[int, int],
            arms: dict[int, list[int]]) -> Found:
    first = sorted(beams)
    number = {node: l for l, node in enumerate(first)}
    ends = np.array([(node, node + beams[node].n_nodes - 1) for node in first])
    groups = max(1, min(MOST_GROUPS, len(first) // LEAST_CARRIERS))
    group = np.arange(len(first)) * groups // len(first)
    points: list[list[int]] = [[] for _ in first]
    for body, beam in beam_of.items():
        points[number[beam]] += [body, *arms[body]]

    def ranges(lists: list[list[int]]) -> tuple[Array, Array]:
        return np.cumsum([0, *map(len, lists)]), np.array([x for some in lists for x in some], np.int64)

    out = Found(Carriers(ends, group, *ranges([sliders[node] for node in first]), *ranges(points), np.zeros((0, 4), np.int64)))
    some: dict[tuple[str, int], list[Array]] = {}
    for l, node in enumerate(first):
        beam = beams[node]
        net = getattr(beam, "net", None)
        if net is None:
            name, elements = beam.name, np.arange(beam.n_elements)
        else:
            name = net.name
            elements = int(np.sum(net.elements[:beam.index])) + np.arange(int(net.elements[beam.index]))
        some.setdefault((name, int(group[l])), []).append(elements)
    for (name, g), parts in some.items():
        out.elements.setdefault(name, []).append((g, np.concatenate(parts)))
    return out
