"""Fifth stage of the compiler: which nodes the solver sees, in what order they are eliminated, and numbers of all blocks."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fastbeam.compile.condense import Condensed
from fastbeam.compile.numbered import Numbered
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.layout import FACTORS, NODES
from fastbeam.linalg.pattern import Pattern, ascending, build_pattern, widen
from fastbeam.model.connections import Connections
from fastbeam.model.tables import ElementPacker

Array = np.ndarray


@dataclass(frozen=True)
class Ordered:
    """Order of elimination and numbers of blocks."""

    blocks: Blocks
    store: int  # doubles that the elimination of inner nodes of elements keeps
    columns: bool  # true if right-hand sides follow the factors there
    n_panel: int  # rows of all nodes except those of condensed beams


def order(numbered: Numbered, condensed: Condensed, solver: str, eliminate_inner: bool, constraints: int, kept: int) -> Ordered:
    """Choose the order of elimination; constraints: number of constraints with multipliers that are not condensed with beams;
    kept: number of joints among them. Raises SceneError: solver='chain' where that would fill the matrix."""
    joints, links, n = numbered.joints, numbered.links, len(numbered.nodes)
    used, carriers, ends = condensed.used, condensed.carriers, condensed.ends
    size, columns = 0, constraints > 0
    if eliminate_inner:
        eligible = _inner_nodes(n, used, joints)
        eligible[numbered.touched] = False
        for packer in used:
            size = packer.eliminate(eligible, size, columns)
    root = joints.row_root[ends]
    pairs = np.concatenate([np.zeros(0, np.int64), *(p.pairs(joints.row_root) for p in used),
                            (root[:, [0, 0, 1, 1]] * n + root[:, [0, 1, 0, 1]]).reshape(-1),
                            links.pairs])
    width = [np.where(meta[:, FACTORS] >= 0, 1, meta[:, NODES] - 1).max() for p in used for meta, _ in p.lanes()]
    band = max([*(int(x) for x in width), len(ends) > 0])
    level = _levels(n, used)
    if carriers is not None:
        level[carriers.eliminated_nodes] = 2
    level[ends] = 0
    if eliminate_inner and kept == constraints > 0 and not len(ends):
        level[_points_of_joints(numbered, used)] = 3
    # nodes with terms on their diagonal blocks
    own = np.ones(n, bool)
    own[level == 3] = False
    own[np.concatenate((links.loaded.node, numbered.dragged))] = True
    # with condensed beams, joints are a border anyway
    blocks = Blocks(n, pairs, joints, band, solver, level, own, 0 if len(ends) else kept)
    return Ordered(blocks, size, columns, blocks.pattern.n + int(np.sum(level == 1)))


def _points_of_joints(numbered: Numbered, packers: list[ElementPacker]) -> Array:
    """Return points of bodies that follow them in position and spin and belong to no element, int [*]: the solver does not need
    them, since forces there go to the bodies."""
    joints = numbered.joints
    arms = np.array([arm for _, arm in numbered.nodes.arm_owner], np.int64)
    out = np.zeros(len(numbered.nodes), bool)
    out[arms[joints.tied[arms] & (joints.row_root[arms] == arms) & (joints.spin_root[arms] != arms)]] = True
    out[joints.target] = False
    out[numbered.supported] = False
    for packer in packers:
        for _, live in packer.lanes():
            out[live[live >= 0]] = False
    return np.flatnonzero(out)


def _inner_nodes(n: int, packers: list[ElementPacker], joints: Connections) -> Array:
    """Return which nodes may be eliminated within their element: no other element, no joint, no support; bool [N + 1], the last
    one for idle lanes."""
    nodes = [live.reshape(-1) for packer in packers for _, live in packer.lanes()]
    # -1 of idle lanes counts as the last
    eligible = np.roll(np.bincount(np.concatenate([np.zeros(0, np.int64), *nodes]) + 1, minlength=n + 1), -1) == 1
    eligible[:n] &= (joints.held == 0) & (joints.spin_root == np.arange(n)) & ~joints.tied
    eligible[joints.target] = False
    eligible[n] = True
    return eligible


def _levels(n: int, packers: list[ElementPacker]) -> Array:
    """Return the level of every node, [N]: 0 if the solver sees it, 1 if it is eliminated within its element, 2 if it belongs to
    a condensed beam."""
    level = np.zeros(n, np.int8)
    for packer in packers:
        for meta, live in packer.lanes():
            gone = live[meta[:, FACTORS] >= 0, 1:-1]
            level[gone[gone >= 0]] = 1
        for _, live in packer.condensed():
            level[live] = 2
    return level


class Blocks:
    """Numbers of all blocks: those of the pattern, then one for every pair with a slave node, then one idle block.

    n: number of nodes.
    pairs: int64 [*], coupled nodes as i N + j, or -1.
    band: largest number of rows between those that an element couples.
    solver: option of `compile_scene`.
    level: int8 [N], 0 for the nodes that the solver sees, others as in `_levels`; 3 for points of joints.
    own: bool [N], nodes to whose diagonal blocks other terms than those of `pairs` add.
    kept: number of joints with multipliers that a plan of the elimination would include.
    """

    def __init__(self, n: int, pairs: Array, joints: Connections, band: int, solver: str, level: Array, own: Array,
                 kept: int) -> None:
        self._own, end = own, level == 0
        leads = joints.row_root == np.arange(n)
        tied = joints.tied & leads
        live = pairs >= 0
        coupled = ascending(pairs[live])
        through = tied[coupled // n] | tied[coupled % n]
        slaves = np.flatnonzero(tied & own)
        # pairs with a slave node, ascending, and targets of their entries
        self.raw = ascending(np.concatenate((coupled[through], slaves * (n + 1))))
        self.moves = _moves(self.raw, joints, tied)
        diagonal = np.flatnonzero(leads) * (n + 1)
        final = np.concatenate((coupled[~through], diagonal, self.moves[:, 3] * n + self.moves[:, 4]))
        final = np.stack((final // n, final % n), axis=1)
        final = final[end[final].all(axis=1)]
        seen = end & leads
        number = np.cumsum(seen) - 1
        among_ends = build_pattern(int(seen.sum()), number[final], band, allow_elimination=solver != "sparse", joints=kept)
        del final
        self.pattern: Pattern = widen(among_ends, level, joints.row_root)
        if solver == "chain" and self.pattern.plan is None:
            raise SceneError("compile_scene: solver='chain' cannot solve this scene efficiently, because it is a net and its "
                             "matrix would fill; use solver='auto'")
        self.root = joints.row_root
        self.base = self.pattern.keys.size
        self.n_blocks = self.base + self.raw.size
        # block of every coupled pair, then of all pairs
        block = np.empty(coupled.size + 1, np.int64)
        block[:-1][~through] = self.pattern.block(coupled[~through] // n, coupled[~through] % n)
        block[:-1][through] = self.base + np.searchsorted(self.raw, coupled[through])
        block[-1] = self.n_blocks
        self.element = block[np.where(live, np.searchsorted(coupled, pairs), coupled.size)]

    def diagonal(self, nodes: Array) -> Array:
        """Return the blocks to which terms of single nodes are added."""
        return self.between(nodes, nodes)

    def between(self, a: Array, b: Array) -> Array:
        """Return the blocks to which terms of coupled nodes are added, int [n]."""
        a, b = self.root[a], self.root[b]
        key = a * self.pattern.row_of.size + b
        at = np.minimum(np.searchsorted(self.raw, key), max(self.raw.size - 1, 0))
        tied = self.raw[at] == key if self.raw.size else np.zeros(key.shape, bool)
        out = self.base + at
        assert np.all(tied | self._own[a] & self._own[b]), "a term adds to the blocks of a point that has none"
        out[~tied] = self.pattern.block(a[~tied], b[~tied])
        return out


def _moves(raw: Array, joints: Connections, tied: Array) -> Array:
    """Return the targets of all pairs with a slave node, i N + j: number of the pair, entry of its row or -1, entry of its column
    or -1, nodes that it moves to, int [*, 5]. Entries are numbered without those of shared rows."""
    n = tied.size
    unwelded = joints.without_welds()
    first, target = unwelded.start, unwelded.target
    count = np.maximum(np.diff(first), 1)
    i, j = raw // n, raw % n
    size = count[i] * count[j]
    pair = np.repeat(np.arange(raw.size), size)
    local = np.arange(pair.size) - np.repeat(np.cumsum(size) - size, size)
    out = [pair]
    nodes = []
    for side, step in ((i[pair], local // count[j[pair]]), (j[pair], local % count[j[pair]])):
        entry = np.where(tied[side], first[side] + step, -1)
        out.append(entry)
        nodes.append(np.where(tied[side], target[entry] if target.size else side, side))
    return np.stack((*out, *nodes), axis=1)
