"""Joints with axes as tables: the axes that both nodes carry, their conditions as NumPy sees them, and the same in a plane."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels.joints.conditions import JointConditions
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.plane import TOLERANCE, NotPlanar, Plane, numbers_of

Array = np.ndarray
Pairs = tuple[tuple[int, int], ...]


class Frame:
    """Directions that both nodes of a joint carry, and coordinates of the nodes at t = 0.

    turn: float64 [2, 3, 3], R with D_i = sum_k R_ik d_k of both nodes.
    reference: float64 [2, 4, 3], coordinates at t = 0.
    axes: float64 [2, 3, 3], the directions of both at t = 0.
    """

    def __init__(self, turn: Array, reference: Array) -> None:
        self.turn, self.reference = turn, reference
        self.axes = np.einsum("sik,skc->sic", turn, reference[:, 1:])


class Conditions:
    """Constraints of a joint by products, theory.md (4.13): D_i . D_j of directions of a and b, or r . D_i with r = x_b - x_a.

    pairs: tuple of (i, j), j = -1 for r . D_i.
    turn: float64 [2, 3, 3], R with D_i = sum_k R_ik d_k of both nodes.
    x: float64 [2, 4, 3], reference coordinates.
    """

    is_vector, holds, rate = False, True, 0.0

    def __init__(self, pairs: Pairs, turn: Array, x: Array) -> None:
        self.pairs, self.turn, self.reference = pairs, turn, x
        self.is_angle = pairs[0][1] >= 0
        self.axes = np.einsum("sik,skc->sic", turn, x[:, 1:])
        self.value = np.array([(x[1, 0] - x[0, 0]) @ self.axes[0, i] if j < 0 else 0.0 for i, j in pairs])

    def forces(self, dim: int) -> int:
        """Return the number of conditions, one multiplier each."""
        return len(self.pairs)

    def lead(self, x: Array) -> Array:
        """Return the derivative [m, 2, 4, 3] of the products by the coordinates x [2, 4, 3]."""
        (a, b), r = np.einsum("sik,skc->sic", self.turn, x[:, 1:]), x[1, 0] - x[0, 0]
        out = np.zeros((len(self.pairs), 2, 4, 3))
        for p, (i, j) in enumerate(self.pairs):
            out[p, 0, 1:] = np.outer(self.turn[0, i], r if j < 0 else b[j])
            if j < 0:
                out[p, 1, 0], out[p, 0, 0] = a[i], -a[i]
            else:
                out[p, 1, 1:] = np.outer(self.turn[1, j], a[i])
        return out

    def left_in_plane(self, normal: Array) -> Array:
        """Return the numbers of the conditions that do not hold by themselves in the plane with this normal.

        Raises NotPlanar: a direction lies neither in the plane nor along its normal.
        """
        keep = []
        first, second = np.abs(self.axes @ normal).tolist()
        for p, (i, j) in enumerate(self.pairs):
            up = first[i], 0.0 if j < 0 else second[j]
            if any(TOLERANCE < x < 1.0 - TOLERANCE for x in up):
                raise NotPlanar
            if max(up) < 0.5:
                keep.append(p)
        return np.array(keep, np.int64)

    def within(self, axes: Array) -> Array:
        """Select the conditions that are left in a plane of these axes [3, 3]: [m in the plane, m]."""
        return np.eye(len(self.pairs))[self.left_in_plane(axes[2])]


def frames_of(parts: list[Any], nodes: Array, phi: Array, directors: Array) -> list[Frame]:
    """Return the directions of joints: D_1 is the axis, the others are at a right angle to it; nodes int64 [L, 2]."""
    if not parts:
        return []
    triads = directors[nodes]
    x = np.concatenate((phi[nodes][:, :, None], triads), axis=2)
    # directions of the nodes come first: in a plane one of them is its normal
    hints = np.concatenate((triads.reshape(-1, 6, 3), np.broadcast_to(np.eye(3), (len(parts), 3, 3))), axis=1)
    axes = [part.axes for part in parts]
    axis = np.array([one for one, _ in axes])
    across = np.array([other if not np.array_equal(one, other) else _across(one, near) if part.across is None else part.across
                       for part, (one, other), near in zip(parts, axes, hints)])
    frame = np.stack((axis, across, np.cross(axis, across)), axis=1)
    return [Frame(turn, at) for turn, at in zip(frame[:, None] @ triads.transpose(0, 1, 3, 2), x)]


def conditions_of(part: Any, frame: Frame) -> list[tuple[str, Conditions]]:
    """Return the sets of conditions of a joint, each with a word for its kind."""
    return [(" (directions)" if pairs[0][1] >= 0 else " (place)", Conditions(pairs, frame.turn, frame.reference))
            for pairs in part.conditions]


def _across(axis: Array, hints: Array) -> Array:
    """Return a direction at a right angle to the axis, the first of the hints that is one."""
    off = np.abs(hints @ axis)
    k = int(np.argmax(off < 1e-9)) if np.any(off < 1e-9) else int(np.argmin(off))
    across = hints[k] - off[k] * np.sign(hints[k] @ axis) * axis
    return across / np.linalg.norm(across)


def bearing_nodes(node: Array, turns: Array, spin_root: Array) -> Array:
    """Return the nodes [L, 2] whose rows and blocks take forces between nodes [L, 2]: spin roots where only directions matter,
    turns bool [L]; spin_root int [N]."""
    return np.where(turns[:, None], spin_root[node], node)


def joint_conditions(ends: Any) -> JointConditions:
    """Build the table in space; ends: `links.Ends` with the laws."""
    laws = ends.laws
    pairs = np.array([pair for law in laws for pair in law.pairs], np.int64).reshape(-1, 2)
    start = np.concatenate(([0], np.cumsum([len(law.pairs) for law in laws]))).astype(np.int64)
    value = np.concatenate([law.value for law in laws])
    axes = np.concatenate([law.turn.reshape(-1) for law in laws])
    return JointConditions(ends.node, ends.row, ends.spin_row, ends.block, start, pairs, value, axes, ends.first, ends.ties)


def left_in_plane(name: str, law: Any, normal: Array) -> Any:
    """Return the conditions of a law that are left in the plane with this normal.

    Raises NotPlanar: a direction of it is oblique to the plane.
    """
    try:
        return law.is_left_in_plane(normal) if isinstance(law, Coordinate) else law.left_in_plane(normal)
    except NotPlanar:
        raise NotPlanar(f"the axis of {name} is oblique to the plane") from None


def constraints_in_plane(kept: list[ConstrainedJoint], normal: Array) -> tuple[list[ConstrainedJoint], Array]:
    """Return the joints with the conditions that are left in a plane, and the numbers of the remaining multipliers among all
    scalar ones.

    Raises NotPlanar: the axis of a joint is oblique to the plane.
    """
    out, singles, at = [], [np.zeros(0, np.int64)], 0
    for link in kept:
        own = [one for _, one in link.shares if isinstance(one.law, Coordinate)]
        if not all(left_in_plane(one.name, one.law, normal) for one in own):
            if link.law.holds:
                raise NotPlanar(f"{link.name} leads out of the plane")
            # a coordinate that cannot move has no friction
            at += 1
            continue
        if not isinstance(link.law, Conditions):
            out.append(link)
            if not link.law.is_vector:
                singles.append(np.array([at]))
                at += 1
            continue
        keep = left_in_plane(link.name, link.law, normal)
        singles.append(at + keep)
        at += len(link.law.pairs)
        if keep.size:
            law = link.law
            out.append(link._replace(law=Conditions(tuple(law.pairs[k] for k in keep), law.turn, law.reference)))
    return out, np.concatenate(singles)


def conditions_in_plane(table: JointConditions, kept: list[ConstrainedJoint], plane: Plane) -> JointConditions | None:
    """Build the table for nodes with 3 unknowns; kept: joints of the scene in space. None where nothing is left."""
    mine = [link.law for link in kept if isinstance(link.law, Conditions)]
    keep = [law.left_in_plane(plane.axes[2]) for law in mine]
    rows = np.array([k for k, left in enumerate(keep) if left.size], np.int64)
    if not rows.size:
        return None
    every = np.concatenate([table.start[k] + keep[k] for k in rows])
    turn = table.axes.reshape(-1, 2, 3, 3)[rows]
    axes = np.einsum("jsik,jsk->jsi", turn, plane.factor[table.node[rows]])
    size = np.abs(axes)
    axes = np.where(size > 0.5, axes / np.where(size > 0.5, size, 1.0), 0.0)
    start = np.concatenate(([0], np.cumsum([keep[k].size for k in rows]))).astype(np.int64)
    some = {name: np.ascontiguousarray(getattr(table, name)[rows]) for name in ("node", "row", "spin_row", "block")}
    return table._replace(**some, start=start, pair=np.ascontiguousarray(table.pair[every]), value=table.value[every],
                          axes=numbers_of(axes))
