"""Text of `print(model)`: the work that runs, and what was left out and why."""
from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fastbeam.compile.pieces import pieces
from fastbeam.compile.tracks import contact_curve_of
from fastbeam.model.workspace import border_is_slow
from fastbeam.scene import Path, Scene, Switch

if TYPE_CHECKING:
    from fastbeam.model.model import Model

# what is told of, and what is said of it
Line = tuple[str, str]


def _plural(n: int, noun: str) -> str:
    return f"{n} {noun}" + ("" if n == 1 else "s")


def describe(scene: Scene, model: Model) -> str:
    """Return the text of a model."""
    said = [*_beams(scene, model), *_reduced(model), *_joined(scene, model), *_loads(scene, model), *_sliders(scene, model),
            *_together(scene, model), _solver(model), ("left out", ", ".join(_left_out(scene, model)))]
    head = f"model of {scene.label}: {_plural(model.n_nodes, 'node')}, {model.n_unknowns} unknowns"
    return "\n".join([head, *(f"  {what:18} {text}" for what, text in said)])


def _beams(scene: Scene, model: Model) -> Iterator[Line]:
    """Yield lines on the elements of nets and beams."""
    for net in scene.nets:
        ball = int(net.ball.sum())
        joints = [_plural(k, word) for k, word in ((len(net.ball) - ball, "welded node"), (ball, "ball joint")) if k]
        coupled = ", coupled section" if any(not s.is_diagonal for s in net.sections) else ""
        yield "conserving step", (f"{net.label}: {_plural(len(net.edges), 'beam')}, {int(net.elements.sum())} elements x "
                                  f"{net.degree} points, {' and '.join(joints)}, lagrange {net.degree}, {net.strain}{coupled}")
    kinds = Counter((b.basis.n_elements, b.basis.phi_s.shape[1], b.interpolation, b.degree,
                     b.directors if b.interpolation == "bspline" else "", b.strain, not b.section.is_diagonal)
                    for b in scene.beams)
    for (ne, nq, family, degree, directors, strain, coupled), count in kinds.items():
        what = (f"{family} {degree}" + (f" ({directors})" if directors else "") + f", {strain}"
                + (", coupled section" if coupled else ""))
        yield "conserving step", (f"{_plural(count, 'beam')} of {ne} elements x {nq} points, {what}, "
                                  f"{'spatial' if model.plane is None else 'planar'}, 8 lanes, serial")


def _reduced(model: Model) -> Iterator[Line]:
    """Tell which unknowns of beams are not solved for together."""
    if model.plane is not None:
        yield "planar", f"{model.plane.label}: 3 unknowns a node instead of 6"
    if model.inner is not None:
        yield "inner nodes", f"{model.inner.element.size} of {model.n_nodes} nodes eliminated within their elements"
    if model.substructures is not None:
        carriers = 0 if model.carriers is None else model.carriers.group.size
        yield "condensed beams", (f"{model.substructures.beam.size - carriers} beams or pieces of them condensed to their ends, "
                                  "eight at a time, on several threads")
        if carriers:
            yield "carriers", f"{_plural(carriers, 'beam')} with sliders eliminated to their ends with them"


def _joined(scene: Scene, model: Model) -> Iterator[Line]:
    """Tell bodies, connections and supports."""
    if model.bodies is not None:
        masses = model.bodies.node.size - len(scene.bodies)
        yield "point inertia", (f"{_plural(len(scene.bodies), 'rigid body').replace('bodys', 'bodies')}, "
                                f"{_plural(masses, 'point mass').replace('masss', 'masses')}")
    loops = sum(link.law.is_vector for link in model.kept) - sum(getattr(link, "is_pinned", False) for link in scene.links)
    if loops:
        yield "closed loops", f"{_plural(loops, 'ball joint')} with Lagrange multipliers"
    for noun, count in Counter(type(link).kind for link in scene.links).items():
        yield noun + "s", f"{_plural(count, noun)} between two points"
    if model.n_rows < model.n_nodes:
        yield "shared rows", f"{_plural(model.n_nodes - model.n_rows, 'beam end')} of nets share the unknowns of another"
    if model.ties is not None:
        yield "ties", f"{_plural(model.ties.slave.size, 'node')} eliminated by rigid or ball connections"
    run = _solved(model)
    if run.held is not None:
        yield "supports", f"{_plural(run.n_fixed, 'unknown')} fixed, eliminated"


def _loads(scene: Scene, model: Model) -> Iterator[Line]:
    """Tell loads, features, and what was done to the start."""
    if model.load_times:
        timed = sum(t is not None for t in model.load_times)
        what = " and ".join(["gravity"] * bool(np.any(scene.gravity)) + ["dead loads"] * _has_loads(scene))
        yield "loads", (f"{what}: {_plural(len(model.load_times), 'constant vector')}"
                        + (f", {timed} with a time function" if timed else ""))
    own = [line for feature in model.features for line in feature.describe()]
    for what, how, names in (("energy taken", "", model.losses), *own):
        if names:
            yield what, f"{how}{_some(names)}"
    for _, text in model.notes:
        yield "start", text


def _sliders(scene: Scene, model: Model) -> Iterator[Line]:
    if model.sliders is None:
        return
    ends = [] if model.moving is None else model.moving.sliders.tolist()
    c1 = sum(s.curve == "c1" and not getattr(s, "length", 0.0) for k, s in enumerate(scene.sliders) if k not in ends)
    bores = [s.length for s in scene.sleeves if s.length]
    held = f" ({_plural(len(scene.sleeves), 'sleeve')}" * bool(scene.sleeves)
    held += (f", bores from {min(bores):.3g} to {max(bores):.3g} m" if len(set(bores)) > 1 else
             f", bore {bores[0]:.3g} m" if bores else "") + ")" * bool(scene.sleeves)
    yield "sliding contact", (f"{_plural(model.n_sliders, 'slider')}{held}, discrete gradient"
                              + (f", {c1} on a C1 curve" if c1 else ""))
    yield from _paths(scene, model)


def _solver(model: Model) -> Line:
    """Tell which solver the equations go to."""
    pattern, run = model.pattern, _solved(model)
    if border_is_slow(model):
        constraints = _plural(run.n_constraints, "constraint")
        return "sparse solver", f"PARDISO, nodes and {constraints} in one matrix; SuperLU as fallback"
    if pattern.plan is None:
        return "sparse solver", (f"PARDISO, {pattern.keys.size} blocks of {len(run.dofs)} x {len(run.dofs)}, analysed once; "
                                 "SuperLU as fallback")
    cost = pattern.plan.target.size / max(pattern.n, 1)
    bordered = model.bordered_sliders
    form = f"a {'row' if model.by_rows else 'dense border'} of {run.border} unknowns" + " each" * (bordered > 1)
    sliders = f", {_plural(bordered, 'slider')} with {form}" if bordered else ""
    return "chain solver", f"block elimination of {pattern.n} rows, {cost:.1f} updates a row{sliders}, in the compiled loop"


def _solved(model: Model) -> Model:
    """Return the model whose equations are solved, that in its plane where there is one."""
    return model if model.plane is None else model.plane.model


def _some(names: Sequence[str]) -> str:
    """Join the first four names."""
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def _paths(scene: Scene, model: Model) -> Iterator[Line]:
    known = set()
    for slider in scene.sliders:
        path = slider.beam
        if isinstance(path, Path) and (path, slider.curve) not in known:
            known.add((path, slider.curve))
            track = contact_curve_of(scene, model.numbers, slider)
            count = sum(other.beam is path and other.curve == slider.curve for other in scene.sliders)
            across = f", one tangent across {track.smooth} of {_plural(track.joints, 'joint')}" if track.smooth else ""
            if isinstance(path, Switch):
                names = _some([f"{x.name!r} {x.length:.6g} m" for x in path.tracks])
                yield "switch", f"{path.name!r}: {_plural(len(path.tracks), 'track')}, {names}, {_plural(count, 'slider')}"
                continue
            yield "path", (f"{path.name!r}: {_plural(len(path.beams), 'beam')}, {path.length:.6g} m"
                           + (", closed" if path.closed else "") + f", {_plural(count, 'slider')}{across}"
                           + (", its beams not condensed" if model.substructures is not None else ""))


def _together(scene: Scene, model: Model) -> Iterator[Line]:
    """Yield the number of connected pieces, and the ends that touch something without a joint."""
    count, places, near = pieces(scene, model.numbers, model.fixed_mask, model.length)
    yield "together", _plural(count, "connected piece")
    for place in places[:4]:
        names = " and ".join(model.labels[k] for k in place[:3]) + (f" and {len(place) - 3} more" if len(place) > 3 else "")
        yield "NOT JOINED", f"{names} lie at the same place without a joint"
    if len(places) > 4:
        yield "NOT JOINED", f"nor are the nodes at {_plural(len(places) - 4, 'other place')}"
    for i, j, distance in near[:4]:
        yield "NOT JOINED", f"{model.labels[i]} and {model.labels[j]} lie {distance:.2g} m apart without a joint"
    if len(near) > 4:
        yield "NOT JOINED", f"nor are {_plural(len(near) - 4, 'other end')} that almost touch something"


def _has_loads(scene: Scene) -> bool:
    return bool(scene.loads or scene.distributed or any(net.loads is not None for net in scene.nets))


def _left_out(scene: Scene, model: Model) -> list[str]:
    every = ((f"planar form ({model.not_planar})", model.plane is None),
             ("gravity (none)", not np.any(scene.gravity)),
             ("dead loads (none)", not _has_loads(scene)),
             ("bodies and masses (none)", model.bodies is None),
             ("connections (none)", model.ties is None),
             ("supports (none)", model.held is None),
             ("sliders (none)", model.sliders is None),
             ("green_lagrange strains (no beam uses them)", model.green is None),
             ("simo_reissner strains (no beam uses them)", model.simo is None),
             ("sparse solver (chains only)", model.pattern.plan is not None),
             ("energies (unless observed)", True))
    return [what for what, is_left_out in every if is_left_out]
