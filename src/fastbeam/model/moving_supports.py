"""Supports that move as functions of time: increments of every step, and tables; supports that let go."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.moving_supports import MovedRows, Prescribed, PrescribedSchedule
from fastbeam.kernels.empty_arrays import empty
from fastbeam.model.analyses import Analysis, Lack, always, unknown_to_methods
from fastbeam.model.connections import Connections, fixed_axes, fixed_in_plane
from fastbeam.model.feature import Feature, OfRun, Span, Stand
from fastbeam.model.mapping import HALF_TURN
from fastbeam.model.numbering import NodeList
from fastbeam.model.released_supports import Released
from fastbeam.scene import PrescribedMotion, Scene
from fastbeam.scene.prescribed_motion import axial

Array = np.ndarray
# largest distance of position(0) from its node, as a share of the size of the scene
AT_START = 1e-9
# largest motion out of the plane of the scene, as a share of the motion
OUT_OF_PLANE = 1e-12
# times at which directions of motions are evaluated
LOOKS = np.concatenate(([0.0], np.geomspace(1e-4, 1e3, 71)))


class PrescribedMotions(Feature):
    """Prescribed motions of a scene, of which there is one at least. Raises SceneError: a node follows another, moves twice, or
    begins elsewhere."""

    key, title, order = "prescribed", "supports that move", 60
    lacks = (
        unknown_to_methods("supports that move"),
        Lack((Analysis.AT_TIME,), "supports with since=", "{who}(at_time=): {name} engages in a run (since=)",
             "leave since out, or leave the motion out",
             lambda of, asked: [motion.label for motion in of.motions if motion.since is not None]),
        Lack((Analysis.SENSITIVITY,), "supports that move",
             "{who}: derivatives by places of moving supports are not available",
             "replace it by a Clamp or Pin, at a place that build computes", always("supports that move")))

    def __init__(self, motions: list[PrescribedMotion], nodes: NodeList, joints: Connections) -> None:
        self.motions = motions
        self.own = np.array([nodes.number(motion.at) for motion in motions])
        root = joints.row_root[self.own]
        for k, motion in enumerate(motions):
            leads = [nodes.labels[i] for i in joints.targets(int(root[k])) if i != root[k]]
            leads += [nodes.labels[joints.spin_root[root[k]]]] * bool(motion.mask == 63 and joints.spin_root[root[k]] != root[k])
            if leads:
                raise SceneError(f"{motion.label}: joints make {motion.at} follow {' and '.join(leads[:3])}; move that node "
                                 "instead")
            for j in np.flatnonzero(root[:k] == root[k]).tolist():
                if motions[j].mask & motion.mask:
                    raise SceneError(f"{motion.label}: {motions[j].label} moves the same node"
                                     + (" along the same axis" if motion.axes != motions[j].axes else ""))
        shares = joints.row_root[None] == root[:, None]
        self.motion_of_node, self.nodes = map(np.ascontiguousarray, np.nonzero(shares))
        self._root = root
        self.turning = [k for k, motion in enumerate(motions) if motion.rotation is not None]

    @property
    def works(self) -> tuple[str, ...]:
        """Names of their works in the energy balance."""
        return tuple(f"motion of {motion.at.label} ({motion.name!r})" for motion in self.motions)

    def describe(self) -> list[tuple[str, str, tuple[str, ...]]]:
        """Return the line of `print(model)`."""
        return [("supports that move", "", self.works)]

    @property
    def masks(self) -> Array:
        """Unknowns of the node that each motion prescribes, one bit for each of the six, int64 [M]."""
        return np.array([motion.mask for motion in self.motions], np.int64)

    def work(self, model: Any, plane: Any, static: bool) -> Prescribed | None:
        """Return the tables with the arrays of a run in time."""
        if static:
            return None
        row_of, place = model.pattern.row_of, model.works_place
        m, size = len(self.motions), 6 if plane is None else 3
        # supports with since= do not hold yet
        masks = np.where([motion.since is None for motion in self.motions], self.masks, 0)
        masks = masks if plane is None else fixed_in_plane(masks, plane.axes)
        return Prescribed(self.nodes, self.motion_of_node, masks, row_of[self._root].astype(np.int64), place + np.arange(m),
                          empty((m, size)), empty((m, size)), np.zeros(1, np.int64), empty(4))

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the terms of moving supports and of their reactions."""
        own = run.own.get(self.key)
        return [] if own is None else [(Stand.SUPPORTS, own), (Stand.REACTIONS, MovedRows(own))]

    def schedules(self, span: Span) -> list[tuple[Stand, Any]]:
        """Tabulate the increments of supports for the steps of a span."""
        # a substep ends, to the last bit, at the time at which the next begins
        times, own = np.append(span.starts, span.end), span.own[self.key]
        return [(Stand.SUPPORTS, PrescribedSchedule(own, self.schedule(times, own, span.plane)))]

    def schedule(self, times: Array, tables: Prescribed, plane: Any = None) -> Array:
        """Return the increments of all steps between these times [n + 1]: position, m, and Cayley vector of the turn, [n, M, 6];
        tables: those of the run, where masks of supports that have let go are 0; plane: that of the scene, whose increments are
        [n, M, 3], or None. Raises SceneError: a function fails, a step turns by half a turn, or a motion leaves the plane."""
        axes = None if plane is None else plane.axes
        out = np.zeros((len(times) - 1, len(self.motions), 6))
        for k, motion in enumerate(self.motions):
            if not tables.mask[k]:
                continue
            out[:, k, :3] = np.diff([motion.place(t) for t in times.tolist()], axis=0)
            if motion.rotation is not None:
                turn = turns_between(motion, times.tolist())
                out[:, k, 3:] = 2.0 * axial(turn) / (1.0 + np.trace(turn, axis1=1, axis2=2))[:, None]
            if axes is not None:
                self._check_plane(motion, out[:, k], axes[2], times)
        if axes is None:
            return out
        return np.concatenate((out[:, :, :3] @ axes[:2].T, (out[:, :, 3:] @ axes[2])[:, :, None]), axis=2)

    @property
    def turning_labels(self) -> list[str]:
        """Labels of the motions that turn."""
        return [self.works[k] for k in self.turning]

    @property
    def history_size(self) -> int:
        """Number of history variables: a rotation vector of each motion that turns."""
        return 3 * len(self.turning)

    def vectors(self, t: float) -> Array:
        """Return the rotation vectors at time t less those at t = 0, rad, [3 K]; 0 where rotations are given as matrices."""
        pairs = [(self.motions[k].turning(t)[1], self.motions[k].turning(0.0)[1]) for k in self.turning]
        return np.array([np.zeros(3) if now is None or first is None else now - first for now, first in pairs]).reshape(-1)

    def more_turns(self, counted: Array, t: float) -> dict[str, float]:
        """Return motions whose counted turn [3 K] differs by over half a turn from that at time t, by name, with the difference,
        rad."""
        off = np.linalg.norm((counted - self.vectors(t)).reshape(-1, 3), axis=1)
        return {self.motions[k].name: float(x) for k, x in zip(self.turning, off) if x > np.pi}

    @staticmethod
    def _check_plane(motion: PrescribedMotion, given: Array, normal: Array, times: Array) -> None:
        across = given[:, 3:] - (given[:, 3:] @ normal)[:, None] * normal
        off = np.abs(given[:, :3] @ normal) + np.linalg.norm(across, axis=1)
        extent = float(np.max(np.linalg.norm(given[:, :3], axis=1) + np.linalg.norm(given[:, 3:], axis=1), initial=0.0))
        if np.any(off > OUT_OF_PLANE * extent + 1e-15):
            raise SceneError(f"{motion.label}: it moves out of the plane of the scene in the step from t = "
                             f"{times[int(np.argmax(off))]:.6g} s; compile the scene with planar=False")

    def directions(self, n: int) -> list[tuple[Array, Array]]:
        """Return directions in which supports move and axes about which they turn at some times, up to three of each motion:
        [n, 3] each, n nodes."""
        found = [(np.zeros((n, 3)), np.zeros((n, 3))) for _ in range(3 * int(np.bincount(self.own).max()))]
        for k, motion in enumerate(self.motions):
            first = 3 * int(np.sum(self.own[:k] == self.own[k]))
            places, turns = [], []
            for t in LOOKS.tolist():
                try:
                    place, turn = motion.place(t), motion.turn(t)
                except SceneError:
                    # a table may end
                    continue
                places.append(place)
                turns.append(axial(turn))
            for which, x in enumerate((np.array(places) - places[0], np.array(turns) - turns[0])):
                _, size, axes = np.linalg.svd(x, full_matrices=False)
                for i in np.flatnonzero(size > OUT_OF_PLANE * max(float(size[0]), 1e-300)).tolist():
                    found[first + i][which][self.own[k]] = size[i] * axes[i]
        return [pair for pair in found if np.any(pair[0]) or np.any(pair[1])]


def turns_between(motion: PrescribedMotion, times: list[float]) -> Array:
    """Return the rotations of a motion from each of these times to the next, [n, 3, 3]. Raises SceneError: a rotation is half a
    turn or more."""
    turns, vectors = zip(*(motion.turning(t) for t in times))
    out = np.array([after @ before.T for before, after in zip(turns[:-1], turns[1:])])
    for k, (turn, before, after) in enumerate(zip(out, vectors[:-1], vectors[1:])):
        told = before is not None and after is not None
        angle = np.linalg.norm(after - before) if told else np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))
        if angle > HALF_TURN:
            raise SceneError(f"{motion.label}: rotation(t) turns by {angle:.6g} rad from t = {times[k]:.9g} s to "
                             f"{times[k + 1]:.9g} s, but must turn by less than half a turn. Use smaller steps, and let a "
                             "rotation vector grow beyond a full turn instead of jumping back by one")
    return out


def prescribed_of(scene: Scene, nodes: NodeList, joints: Connections, length: float) -> PrescribedMotions | None:
    """Build the feature of moving supports; None where no support moves. Raises SceneError: a node follows another, moves twice,
    or begins elsewhere; a position does not begin at its node."""
    if not scene.prescribed:
        return None
    found = PrescribedMotions(scene.prescribed, nodes, joints)
    for motion, node in zip(found.motions, found.own.tolist()):
        if motion.position is not None:
            gap = float(np.linalg.norm((motion.place(0.0) - nodes.phi[node])[fixed_axes(np.array([motion.mask]))[0]]))
            if gap > AT_START * length:
                raise SceneError(f"{motion.label}: position(0) lies {gap:.6g} m from {motion.at} at t = 0; let it begin there, "
                                 "or give displacement")
    return found


def support_rates(scene: Scene, nodes: NodeList, joints: Connections) -> tuple[Array, Array]:
    """Return the velocities and spins of supports at t = 0, [N, 3] each: zero where they stand still."""
    v, omega = np.zeros((len(nodes), 3)), np.zeros((len(nodes), 3))
    for motion in (x for x in scene.prescribed if x.since is None):
        at = joints.row_root[nodes.number(motion.at)]
        velocity, spin = motion.rates()
        v[at] += velocity
        omega[at] += spin
    return v, omega


def released_of(scene: Scene, nodes: NodeList, joints: Connections, row_of: Array, always: Array) -> Released | None:
    """Build the feature of supports that let go or take hold, or None; always: unknowns that the other supports fix, int64 [N].
    Raises SceneError: the node of such a support follows another, or two supports hold one rigid part."""
    every = [*scene.pins, *scene.clamps, *scene.prescribed]
    some = [(k, x) for k, x in enumerate(every) if x.until is not None or x.since is not None]
    if not some:
        return None

    moving = list(scene.prescribed)
    own = nodes.held(x for _, x in some)
    root = joints.row_root[own]
    others = nodes.held(every)
    for (k, support), node, top in zip(some, own.tolist(), root.tolist()):
        leads = [nodes.labels[i] for i in joints.targets(top) if i != top]
        if leads:
            what = "until" if support.since is None else "since"
            raise SceneError(f"{support.name}: {what}: joints make {support.at} follow {' and '.join(leads[:3])}; support that "
                             "node instead")
        for j, other in enumerate(others.tolist()):
            if j != k and other != top and joints.spin_root[other] == top and joints.row_root[other] != top:
                what = "until" if support.since is None else "since"
                raise SceneError(f"{support.name}: {what}: {every[j].name} supports the same rigid part, so the support that "
                                 "remains is not determined; support the part at one node only")
    rows = row_of[root]
    base = np.zeros(row_of.size, np.int64)
    np.bitwise_or.at(base, row_of[joints.row_root], always)
    return Released(tuple(str(x.name) if not isinstance(x, PrescribedMotion) else x.label for _, x in some),
                    tuple(x.until for _, x in some), tuple(x.since for _, x in some), own, rows.astype(np.int64),
                    np.array([x.mask for _, x in some], np.int64), base[rows],
                    np.array([moving.index(x) if x in moving else -1 for _, x in some], np.int64),
                    np.array([k for k, _ in some], np.int64))
