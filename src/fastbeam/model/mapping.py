"""States of compiled scenes in space, outside of a step: slave nodes and contacts of sliders, and the map of a state of one model
to another."""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import legendre

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.curves import FIRST_NODE, MOST_NODES, NODES_OF_CURVE, TERMS, Curves, Paths
from fastbeam.kernels.contact.moving_places import is_on_node, on_mesh, place_of
from fastbeam.kernels.contact.slider import NODE, NUMBER
from fastbeam.kernels.contact.slider_forces import CAME_BY, HELD, HISTORY, OFF, OFFSET, STICKS, TURNS
from fastbeam.kernels.joints.coordinates import MOTION, VALUE
from fastbeam.kernels.layout import ARM, POSITION, TRIAD

if TYPE_CHECKING:
    from fastbeam.kernels.state import State
    from fastbeam.model.contact.moving_meshes import Moving
    from fastbeam.model.model import Model

Array = np.ndarray
# largest prescribed turn from one evaluation to the next, rad: beyond half a turn its direction is not known
HALF_TURN = np.pi * (1.0 - 1e-3)


def follow(model: Model, x: Array) -> Array:
    """Return coordinates, or their rates, [N, 4, 3], with those of slave nodes and of welded ends from their master nodes."""
    out = x.copy()
    root = model.pattern.first_on_row
    welded = np.flatnonzero(root != np.arange(len(x)))
    if welded.size:
        # the triads of welded ends turn alike
        d = model.q0.reshape(-1, 4, 3)[:, 1:]
        turn = d[welded] @ d[root[welded]].transpose(0, 2, 1)
        out[welded, 0], out[welded, 1:] = x[root[welded], 0], turn @ x[root[welded], 1:]
    ties = model.ties
    if ties is None:
        return out
    owner = np.repeat(np.arange(len(x)), np.diff(ties.start))
    out[ties.slave, 0] = 0.0
    place, arm, triad = (np.flatnonzero(ties.kind == kind) for kind in (POSITION, ARM, TRIAD))
    # master nodes are never slave nodes themselves
    np.add.at(out[:, 0], owner[place], x[ties.target[place], 0])
    np.add.at(out[:, 0], owner[arm], (ties.offset.reshape(-1, 1, 3)[arm] @ x[ties.target[arm], 1:])[:, 0])
    turns = triad[ties.target[triad] != owner[triad]]
    out[owner[turns], 1:] = ties.rotation.reshape(-1, 3, 3)[turns] @ x[ties.target[turns], 1:]
    return out


def turned(triads: Array, spins: Array) -> Array:
    """Return triads [N, 3, 3] turned by Cayley vectors [N, 3]."""
    w = spins[:, None, :]
    d = np.cross(w, triads)
    return triads + (d + 0.5 * np.cross(w, d)) / (1.0 + 0.25 * np.sum(w**2, axis=2, keepdims=True))


def nodes_of_curve(curves: Curves | Paths, c: int) -> Array:
    """Return the numbers [n] of the nodes of curve c, along it."""
    first, n = int(curves.meta[c, FIRST_NODE]), int(curves.shape[c, NODES_OF_CURVE])
    return np.asarray(curves.node[first:first + n]) if isinstance(curves, Paths) else first + np.arange(n)


def within_round(curves: Curves | Paths, c: int, s: float) -> float:
    """Return the arc length s of curve c; on a closed path that of the first round."""
    period = float(curves.period[c]) if isinstance(curves, Paths) else 0.0
    return s - period * np.floor(s / period) if period else s


def each_once(curves: Curves | Paths, c: int, local: Array, values: Array) -> tuple[Array, Array]:
    """Return the nodes under a contact, counted along curve c, as numbers in the scene, and their values [..., n]. On a short
    closed path the values of a node that occurs twice are summed."""
    nodes = nodes_of_curve(curves, c)
    if not isinstance(curves, Paths) or not curves.period[c]:
        return nodes[local], values
    local, which = np.unique(local % nodes.size, return_inverse=True)
    out = np.zeros((*values.shape[:-1], local.size))
    np.add.at(out, (..., which), values)
    return nodes[local], out


def shapes_at(model: Model, k: int, s: float, derivatives: int = 2) -> tuple[Array, Array]:
    """Return the nodes [n] under the contact of slider k at s; their shape functions, and so many derivatives of these by s,
    [1 to 3, n]."""
    curves, sliders = model.curves, model.sliders
    assert curves is not None and sliders is not None
    c, (f, at) = int(sliders.curve[k]), sliders.following.at[k, [NUMBER, NODE]].tolist()
    if f < 0:
        return shapes_on(curves, c, s, derivatives)
    if is_on_node(sliders.following, f, s):
        # the contact is a node, which moves with it
        return nodes_of_curve(curves, c)[at:at + 1], np.eye(derivatives + 1, 1)
    u = on_mesh(sliders.following, f, s, s)
    nodes, (value, *more) = shapes_on(curves, c, u.end, derivatives)
    by_s = [u.slope * x for x in more[:1]] + [u.slope**2 * x + 2.0 * u.bend * more[0] for x in more[1:]]
    return nodes, np.array([value, *by_s])


def shapes_on(curves: Curves | Paths, c: int, s: float, derivatives: int) -> tuple[Array, Array]:
    """Return `shapes_at` for a place s of curve c."""
    _, n, o, p, co = (int(i) for i in curves.meta[c])
    ends = curves.ends[o:o + n + 1]
    s = within_round(curves, c, s)
    e = int(np.clip(np.searchsorted(ends, s, side="right") - 1, 0, n - 1))
    count, size = int(curves.count[p + e]), curves.shape[c, [MOST_NODES, TERMS]]
    coef = curves.coef[co + e * size[0] * size[1]:][:size[0] * size[1]].reshape(size)[:count].T
    scale = 2.0 / (ends[e + 1] - ends[e])
    xi = scale * (s - ends[e]) - 1.0
    values = [legendre.legval(xi, coef)]
    values += [scale**m * legendre.legval(xi, legendre.legder(coef, m)) for m in range(1, derivatives + 1)]
    return each_once(curves, c, int(curves.first[p + e]) + np.arange(count), np.array(values))


def nodes_passed(curves: Curves | Paths, c: int, s0: float, s1: float) -> Array:
    """Return the nodes that are under a contact on curve c anywhere between two arc lengths, counted along the curve [n]."""
    _, n, o, p, _ = (int(i) for i in curves.meta[c])
    at = [within_round(curves, c, s) for s in (s0, s1)]
    low, high = np.sort(np.clip(np.searchsorted(curves.ends[o:o + n + 1], at, side="right") - 1, 0, n - 1)).tolist()
    # on a closed path, the shorter way around it
    across = isinstance(curves, Paths) and curves.period[c] > 0.0 and high - low > n // 2
    elements = [*range(high, n), *range(low + 1)] if across else range(low, high + 1)
    local = np.concatenate([int(curves.first[p + e]) + np.arange(int(curves.count[p + e])) for e in elements])
    return np.unique(local % int(curves.shape[c, NODES_OF_CURVE]))


def curve_at(model: Model, k: int, s: float) -> tuple[Array, Array, Array]:
    """Return the nodes [n] under the contact of slider k at s, their shape functions and slopes [n]."""
    nodes, (values, slopes, _) = shapes_at(model, k, s)
    return nodes, values, slopes


def contact(model: Model, k: int, s: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return the gap of slider k at s, the tangent of the curve, or d1 of a node that moves with the contact, and the velocity of
    the point relative to the curve, [3] each; q, v [N, 4, 3]."""
    assert model.sliders is not None
    nodes, values, slopes = curve_at(model, k, s)
    point = int(model.sliders.point[k])
    tangent = slopes @ q[nodes, 0] if model.sliders.following.at[k, NODE] < 0 else along_material(model, k, s, q)
    return q[point, 0] - values @ q[nodes, 0], tangent, v[point, 0] - values @ v[nodes, 0]


def along_material(model: Model, k: int, s: float, q: Array) -> Array:
    """Return d1 of the node at contact k of a moving mesh, or inside an element the tangent of the beam [3]; q [N, 4, 3]."""
    curves, following, c = model.curves, model.sliders.following, int(model.sliders.curve[k])
    f, at = following.at[k, [NUMBER, NODE]].tolist()
    if is_on_node(following, f, s):
        return np.asarray(q[nodes_of_curve(curves, c)[at], 1])
    length, _, _, node_at = following.reach[f].tolist()
    u, y = on_mesh(following, f, s, s).end, place_of(following, f, s)
    nodes, (_, slopes) = shapes_on(curves, c, u, 1)
    return np.asarray(slopes @ q[nodes, 0]) * (node_at / y if u < node_at else (length - node_at) / (length - y))


def state_for(model: Model, names: Mapping[str, list[Any]], state: State, moving: Moving | None = None) -> State:
    """Map a state of another model, with these names and moving meshes, to this model: parts of the same name and shape keep
    their coordinates and velocities, sliders of the same name their place. Parts that the other does not have take those of this
    model's initial state, moved with the parts that they are joined to or slide on.

    Raises SceneError: a part has other nodes than its namesake, or no part has a namesake.
    """
    fresh = model.state()
    own, given = ([x.reshape(-1, 4, 3) for x in (y.q, y.v)] for y in (fresh, state))
    if moving is not None:
        given = list(moving.own_shape(state))
    known = np.zeros(model.n_nodes, bool)
    for mine, other in _namesakes(model.names, names):
        known[mine] = True
        for x, y in zip(own, given):
            x[mine] = y[other]
    if not known.any():
        raise SceneError(f"state_for: no beam, net, body or mass of scene {model.scene_name!r} has a name that occurs in this "
                         "result; map between scenes with equal names")
    before = [x.reshape(-1, 4, 3) for x in (model.q0, model.v0)]
    _carry_along(model, own, known)
    for k, name in enumerate(model.names["sliders"]):
        if name in names.get("sliders", []):
            j = names["sliders"].index(name)
            fresh.s[k], fresh.force[3 * k:3 * k + 3] = state.s[j], state.force[3 * j:3 * j + 3]
        else:
            _put_on_curve(model, k, fresh.s[k], own, before, known)
    _carry_history(model, names, state, fresh)
    # violations of joints of this model are kept: the check at the start of a run measures them
    fresh.q[:], fresh.v[:] = (np.where(known[:, None, None], x, follow(model, x)).reshape(-1) for x in own)
    if model.moving is not None:
        _carry_meshes(model, names, state, fresh, moving)
    model.start_momenta(fresh.history, fresh.q, fresh.v, fresh.s)
    return fresh


def _carry_meshes(model: Model, names: Mapping[str, list[Any]], state: State, fresh: State, moving: Moving | None) -> None:
    """Copy nodes of moving meshes and ds/dt of their contacts from equal meshes; from others, whose material `fresh` has at the
    arc lengths of beams, let nodes lie on it and move with the contacts."""
    assert model.moving is not None
    theirs = dict(zip(names.get("sliders", []), names.get("slider_rates", [])))
    places = [theirs.get(model.names["sliders"][k], -1) for k in model.moving.sliders.tolist()]
    pairs = None if moving is None else model.moving.same_meshes(moving)
    if pairs is not None and min(places) >= 0:
        for mine, other in pairs:
            for x, y in zip((fresh.q, fresh.v), (state.q, state.v)):
                x.reshape(-1, 4, 3)[mine] = y.reshape(-1, 4, 3)[other]
        model.moving.put_places(fresh.history, state.history[places])
        return
    model.moving.lay_out(fresh)
    fresh.v[:], rates = model.moving.with_mesh(model, fresh.q, fresh.s, fresh.v)
    model.moving.put_places(fresh.history, rates)


def _carry_history(model: Model, names: Mapping[str, list[Any]], state: State, fresh: State) -> None:
    """Copy locks that have taken hold or let go, for sliders with the same number of locks; contacts that are open; supports that
    have let go; turns of supports and joints."""
    if model.slider_forces is not None:
        locks, theirs = names.get("locks", []), names.get("sliders", [])
        history = state.history[:HISTORY * len(locks)].reshape(-1, HISTORY)
        every = model.along_of(fresh.history)
        for k, (own, slider) in enumerate(zip(every, model.slider_forces.sliders)):
            if slider.name not in theirs:
                continue
            given = history[theirs.index(slider.name)] if locks else np.zeros(HISTORY)
            if k in model.spans:
                own[[OFFSET, CAME_BY]] = given[[OFFSET, CAME_BY]]
            leaves = slider.release is not None or slider.one_sided is not None
            if locks and locks[theirs.index(slider.name)] == len(slider.lock or ()) and (leaves or given[HELD] != OFF):
                own[[HELD, TURNS]] = given[[HELD, TURNS]]
            elif leaves and OFF in (own[HELD], given[HELD]):
                own[HELD] = given[HELD]
            if own[HELD] == OFF:
                # tells whether the point was beyond an end
                own[STICKS] = given[STICKS]
    if model.released is not None and "until" in names:
        place, = names["history"]
        theirs = list(zip(names["until"], names.get("since", [False] * len(names["until"]))))
        for k, named in enumerate(zip(model.released.names, model.released.waits.tolist())):
            if named in theirs:
                fresh.history[model.place("released") + k] = state.history[place + theirs.index(named)]
    _carry_turns(model, names, state.history, fresh.history)


def _carry_turns(model: Model, names: Mapping[str, list[Any]], history: Array, fresh: Array) -> None:
    """Copy the turns of supports, and the values of joints, which count turns, into a new history."""
    if "turns" not in names:
        return
    of_supports, of_joints = names["turns"]
    if model.prescribed is not None:
        for own, label in zip(model.turns_of(fresh).reshape(-1, 3), model.prescribed.turning_labels):
            if label in names["turning"]:
                own[:] = history[of_supports + 3 * names["turning"].index(label):][:3]
    if model.motions is not None:
        theirs = _numbered(zip(names.get("joints", []), names.get("coordinates", [])))
        values = history[of_joints:][:MOTION * len(theirs)].reshape(-1, MOTION)[:, VALUE]
        mine = _numbered(zip(model.motions.names, model.motions.what))
        for own, named in zip(model.motions.own(fresh, model.place("motions")), mine):
            if named in theirs:
                own[VALUE] = values[theirs.index(named)]


def _numbered(named: Iterable[Any]) -> list[Any]:
    """Return names with the number of equal ones before each."""
    seen: dict[Any, int] = {}
    out = []
    for name in named:
        seen[name] = seen.get(name, -1) + 1
        out.append((name, seen[name]))
    return out


def _namesakes(mine: Mapping[str, list[Any]], other: Mapping[str, list[Any]]) -> list[tuple[slice, slice]]:
    """Return the nodes of all parts that both models have."""
    out = []
    for kind, noun in (("beams", "beam"), ("nets", "net"), ("bodies", "body"), ("masses", "point mass")):
        there = {entry["name"]: entry for entry in other.get(kind, [])}
        for entry in mine.get(kind, []):
            found = there.get(entry["name"])
            if found is None:
                continue
            if kind in ("bodies", "masses"):
                spans = [slice(x["node"], x["node"] + 1) for x in (entry, found)]
            elif entry["count"] != found["count"]:
                raise SceneError(f"state_for: {noun} {entry['name']!r} has {found['count']} nodes in the result and "
                                 f"{entry['count']} in the model; give both the same elements and degree")
            else:
                key = "s" if kind == "beams" else "starts"
                here, theirs = (np.asarray(x[key], dtype=float) for x in (entry, found))
                if here.shape != theirs.shape or np.any(np.abs(here - theirs) > 1e-9 * np.max(np.abs(here), initial=0.0)):
                    raise SceneError(f"state_for: the nodes of {noun} {entry['name']!r} have other arc lengths in the result "
                                     "than in the model; give both the same length, elements, degree and interpolation")
                spans = [slice(x["first"], x["first"] + x["count"]) for x in (entry, found)]
            out.append((spans[0], spans[1]))
    return out


def _carry_along(model: Model, own: list[Array], known: Array) -> None:
    """Move bodies and masses that only this model has to known nodes that follow them."""
    ties = model.ties
    if ties is None:
        return
    for k in ties.slave[known[ties.slave]]:
        entries = range(int(ties.start[k]), int(ties.start[k + 1]))
        place = [e for e in entries if ties.kind[e] == POSITION]
        new = {int(ties.target[e]) for e in entries} - {int(k)}
        if len(place) != 1 or any(known[i] for i in new):
            continue
        root = int(ties.target[place[0]])
        turn = [e for e in entries if ties.kind[e] == TRIAD and int(ties.target[e]) == root]
        for x in own:
            if turn:
                x[root, 1:] = ties.rotation.reshape(-1, 3, 3)[turn[0]].T @ x[k, 1:]
            arms = [ties.offset.reshape(-1, 3)[e] @ x[int(ties.target[e]), 1:] for e in entries if ties.kind[e] == ARM]
            x[root, 0] = x[k, 0] - sum(arms, np.zeros(3))
        known[root] = True


def _put_on_curve(model: Model, k: int, s: float, own: list[Array], before: list[Array], known: Array) -> None:
    """Move a part that only this model has to its slider's place on a curve, with the rate of the initial state."""
    assert model.sliders is not None
    point = int(model.sliders.point[k])
    ties = model.ties
    tied = ties is not None and ties.start[point + 1] > ties.start[point]
    root = point
    if ties is not None and tied:
        targets = {int(i) for i in ties.target[ties.start[point]:ties.start[point + 1]]} - {point}
        if len(targets) != 1:
            return
        root = targets.pop()
    if known[root] or (known[point] and not tied):
        return
    placed = [follow(model, x) for x in own]
    gap, tangent, relative = contact(model, k, s, *placed)
    _, along, moving = contact(model, k, s, *before)
    rate = float(moving @ along / (along @ along))
    own[0][root, 0] -= gap
    own[1][root, 0] -= relative - rate * tangent
    known[root] = True
