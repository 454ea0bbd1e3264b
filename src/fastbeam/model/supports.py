"""Supports of a scene in statics: check of every connected part against the rigid motions of space or of its plane."""
from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from fastbeam.interface.arguments import shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.inner_nodes import ROWS
from fastbeam.kernels.layout import LIST
from fastbeam.kernels.linalg.substructures import ELEMENTS, FIRST_GROUP, NODES_EACH
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.connections import components, fixed_axes
from fastbeam.model.mapping import curve_at
from fastbeam.model.model import Model
from fastbeam.scene import Clamp, NodeRef, Pin, PointMass, PrescribedMotion, RigidBody

Array = np.ndarray
# rigid motions of a part of which supports feel less are free
UNFELT = 1e-9


def check_supports(model: Model, flat: bool = False, may_turn: bool = False) -> bool:
    """Check that supports prevent all six rigid motions of every connected part; flat: the three in the plane of the scene;
    may_turn: one held point suffices, about which the part may turn. Sliders and joints connect parts. Returns True if motions
    out of the plane count: all six are prevented, or a straight part can only turn about its own line.

    Raises SceneError: names the part and the motion that nothing prevents.
    """
    return not _known(model, flat, may_turn)


def free_aside(model: Model) -> str:
    """Describe a part of a scene held in its plane that can leave the plane, and its motion; empty without any. Straight parts
    that can only turn about their own line do not count. Raises SceneError."""
    return _known(model, True, False) or ""


# results of checks of models that passed
_HELD: WeakKeyDictionary[Model, dict[tuple[bool, bool], str | None]] = WeakKeyDictionary()


def _known(model: Model, flat: bool, may_turn: bool) -> str | None:
    """Return None where all six rigid motions of all parts are prevented, else the text of `free_aside`; cached."""
    known = _HELD.setdefault(model, {})
    if (flat, may_turn) not in known:
        known[flat, may_turn] = _checked(model, flat, may_turn)
    return known[flat, may_turn]


def _checked(model: Model, flat: bool, may_turn: bool) -> str | None:
    """Check the supports of a model; returns the result of `_known`."""
    mask = model.fixed_mask
    if model.ties is not None:
        mask[model.ties.slave] = 0
    point = model.numbers.rank == 9
    within = np.eye(6)
    if flat:
        axes = model.plane.axes
        within = np.zeros((6, 3))
        within[:3, 0], within[:3, 1], within[3:, 2] = axes
    aside: str | None = None
    for nodes in connected_parts(model):
        held = mask[nodes]
        if np.all(point[nodes]) and np.all(held & 7 == 7):
            continue
        arms = _arms(model, nodes)
        felt = _felt(arms, held, bool(np.any((held & 56 != 0) & ~point[nodes])))
        values, motions = _free_motions(felt, np.eye(6))
        if values[5] > UNFELT:
            continue
        what = model.labels[nodes[0]].split(" node ")[0]
        if flat and not aside:
            moved = (motion for motion in motions[values <= UNFELT]
                     if np.max(np.linalg.norm(motion[:3] + np.cross(motion[3:], arms), axis=1)) > UNFELT)
            aside = next((f"{what} can {_how(motion)}" for motion in moved), "")
        aside = aside or ""
        if may_turn and np.any(held & 7 != 0):
            continue
        if flat:
            values, motions = _free_motions(felt, within)
            if values[2] > UNFELT:
                continue
        how = _how(motions[-1])
        kind = "3 rigid motions in its plane" if flat else "6 rigid motions"
        hangs = (" (relax finds the shape in which it "
                 "hangs)") if how.startswith("turn") and np.any(held) and np.any(model.gravity) else ""
        raise SceneError(f"{what}: it is not supported in statics, it can {how} ({np.sum(values <= UNFELT)} of {kind} are free); "
                         f"{('add a Clamp or Pins' if flat else 'add a Clamp, or Pins that do not lie on one line')}{hangs}"
                         + ("" if flat else _planar_hint(model, motions[-1])))
    return aside


def connected_parts(model: Model) -> list[Array]:
    """List the nodes of every connected part, int [*] each. Sliders and joints connect."""
    part = components(model.n_nodes, np.stack([np.concatenate(x) for x in zip(*_coupled_rows(model))], axis=1))
    part = np.unique(part[model.pattern.row_of], return_inverse=True)[1]
    return np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])


def _coupled_rows(model: Model) -> Iterator[tuple[Array, Array]]:
    """Yield the rows of nodes that elements, ties, sliders and joints couple, int [*] each."""
    pattern, row_of = model.pattern, model.pattern.row_of
    yield pattern.rows, pattern.columns
    if model.inner is not None:
        # an eliminated node hangs on the first node of its element
        yield pattern.n + np.arange(model.inner.element.size), model.inner.rows[model.inner.where[model.inner.element, ROWS]]
    if model.substructures is not None:
        # a node of a condensed beam is connected to the start of the beam
        for tables, groups in zip((model.simo, model.green), model.groups_of_beams()):
            for count, nn in np.unique(groups[:, [ELEMENTS, NODES_EACH]], axis=0).tolist():
                first = groups[(groups[:, ELEMENTS] == count) & (groups[:, NODES_EACH] == nn), FIRST_GROUP]
                at = tables.meta[first[:, None] + np.arange(count), LIST]
                own = tables.rows[at[:, :, None, None] + np.arange(8 * nn).reshape(nn, 8)]
                yield own.reshape(-1), np.broadcast_to(own[:, :1, :1], own.shape).reshape(-1)
    if model.carriers is not None:
        # so is a node of a condensed beam with sliders
        for a, b in model.carriers.ends.tolist():
            yield row_of[a + 1:b + 1], np.broadcast_to(row_of[a], b - a)
    if model.ties is not None:
        # a tied node hangs on its targets
        yield np.repeat(row_of, np.diff(model.ties.start)), model.ties.target_row
    for k in range(model.n_sliders):
        # a sliding point is connected to its beam
        nodes = curve_at(model, k, float(model.s0[k]))[0]
        yield row_of[nodes], np.broadcast_to(row_of[model.sliders.point[k]], nodes.size)
    linked = row_of[np.array([(link.node[0], k) for link in model.kept for k in link.node[1:]], np.int64).reshape(-1, 2)]
    yield linked[:, 0], linked[:, 1]


def _arms(model: Model, nodes: Array) -> Array:
    """Form the arms of nodes about their centre, in the length of the longest, [n, 3]."""
    phi = model.q0.reshape(-1, 12)[:, :3][nodes]
    arms = phi - phi.mean(axis=0)
    return np.asarray(arms / (float(np.max(np.linalg.norm(arms, axis=1))) or 1.0))


def _felt(arms: Array, held: Array, turns_held: bool) -> Array:
    """Form what supports feel of rigid motions of a part, shifts and turns about its centre, [*, 6]. arms [n, 3], held [n]: of
    its nodes; turns_held: whether a support holds a triad."""
    some = held & 7 != 0
    turn = np.cross(np.eye(3)[:, None], arms[some][None]).transpose(1, 2, 0)
    felt = np.concatenate((np.broadcast_to(np.eye(3), turn.shape), turn), axis=2)[fixed_axes(held[some])]
    return np.concatenate((felt, np.eye(6)[3:])) if turns_held else felt


def supported(who: str, model: Model, what: Any, held: Array, axes: int = 7) -> int:
    """Return the number of a node whose position a support holds.

    who: the function and its argument, for messages.
    held: int64 [N], unknowns of every node that supports fix, bit by bit.
    axes: bits that have to be fixed.
    Raises SceneError.
    """
    at = what.at if isinstance(what, (Clamp, Pin, PrescribedMotion)) else what
    at = at.center if isinstance(at, (RigidBody, PointMass)) else at
    if not isinstance(at, NodeRef):
        raise SceneError(f"{who} must map supports (Clamp, Pin, PrescribedMotion) or their nodes to motions, got {shown(what)}")
    try:
        node = int(model.numbers.number(at))
    except KeyError:
        if isinstance(at.owner, RigidBody):
            raise SceneError(f"{who} of {at.label}: a support there fixes the whole body; name {at.owner.label}, whose centre of "
                             "mass is moved") from None
        raise SceneError(f"{who} of {at.label}: it is not in scene {model.scene_name!r}") from None
    same = np.flatnonzero((model.pattern.row_of == model.pattern.row_of[node]) & (held & axes == axes))
    if not same.size:
        own = " along these axes" if axes != 7 else ""
        raise SceneError(f"{who} of {at.label}: no support fixes its position{own}; name the node that is clamped or pinned")
    return int(same[0])


def check_turned(who: str, model: Model, node: int, held: Array) -> None:
    """Check that a support holds the triad of a node that is to be turned; who, held: as in `supported`. Raises SceneError."""
    if held[node] & 56 != 56:
        raise SceneError(f"{who} turns {model.labels[node]}, but no support fixes its rotation; give a displacement (3 numbers), "
                         "or clamp it")


def standing_supports(model: Model) -> Array:
    """Return the unknowns of every node that its own support fixes, bit by bit, int64 [N]: none for slave nodes."""
    held = model.fixed_mask
    held[model.pattern.first_on_row != np.arange(model.n_nodes)] = 0
    if model.ties is not None:
        held[model.ties.slave] = 0
    return held


def waiting(model: Model) -> dict[str, Any]:
    """Return tables of a model before supports with `since` take hold; the model has all supports. Raises SceneError: a part
    whose masses the impact does not know."""
    of, pattern, spinless = model.released, model.pattern, model.spinless.copy()
    require(Analysis.CATCHING, model, f"{of.names[int(np.argmax(of.waits))]}: since, whose impact")
    for row, mask in zip(*of.masks(of.waits)):
        spinless[pattern.row_of == row] = mask & of.spin == of.spin
    held = of.at_start(model.held, pattern)
    same = model.static_held is model.held
    return {"held": held, "spinless": spinless, "static_held": held if same else of.at_start(model.static_held, pattern)}


def _free_motions(matrix: Array, basis: Array) -> tuple[Array, Array]:
    """Return the singular values [k] of the constraints of supports on rigid motions basis [6, k], and the motions [k, 6], the
    freest last."""
    k = basis.shape[1]
    # the triangle of a QR has the same singular values
    triangle = np.linalg.qr(np.concatenate((matrix @ basis, np.zeros((k, k)))), mode="r")
    _, values, motions = np.linalg.svd(triangle)
    return values, motions @ basis.T


def _planar_hint(model: Model, motion: Array) -> str:
    """Return the hint that the scene is supported in its plane, for a message; empty where it is not."""
    plane = model.plane
    if plane is None:
        assert model.uneliminated is not None
        other = model.uneliminated(planar="auto")
        plane = other.plane
        if plane is None:
            told = model.not_planar == other.not_planar
            return f"; it is supported in a plane, but the scene is not planar: {model.not_planar}" if told else ""
    normal = plane.axes[2]
    shift, turn = motion[:3], motion[3:]
    inside = np.concatenate((shift - (shift @ normal) * normal, [turn @ normal]))
    if np.linalg.norm(inside) > 1e-6:
        return ""
    return ("; it is supported within its plane: compile the scene with "
            "planar=True") + (" and start in the plane" if model.plane else "")


def _how(motion: Array) -> str:
    """Describe a rigid motion [6]."""
    shift, turn = motion[:3], motion[3:]
    return "turn about " + _axis(turn) if np.linalg.norm(turn) > 0.5 else "move along " + _axis(shift)


def _axis(v: Array) -> str:
    """Format a direction as text, its largest component 1: the first of those that are equally large."""
    size = np.abs(v)
    v = v / (v[np.argmax(size > (1.0 - 1e-6) * np.max(size))] or 1.0)
    return "(" + ", ".join(f"{x:.3g}" for x in np.where(np.abs(v) < 1e-9, 0.0, v)) + ")"
