"""Derivatives of runs by parameters of a function that builds their scene, from the adjoint solutions of all steps (theory.md
(13.16))."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fastbeam.compile.compile import compile_scene
from fastbeam.gradients.backward import Backward, Stretch, Weights
from fastbeam.gradients.parameters import CHANGES, Build, Family, numbers_of
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.adjoint.adjoint_border import Border
from fastbeam.kernels.contact.curves import Curves, Paths
from fastbeam.model.connections import fixed_axes
from fastbeam.model.mapping import follow, turned
from fastbeam.model.model import Model
from fastbeam.results.observe.observer import Observer
from fastbeam.scene.checks import Place

Array = np.ndarray
# largest difference of coordinates of the scene that build returns from those of the run, as a share of its size
SAME = 1e-9
# round-off of a sum over a step, next to the sizes of what it adds up
NOISE = 1e-10


class RunFamily:
    """Scenes around that of a run.

    model: Model of the run.
    names: points that the number is made of.
    build, values, scale: as in `sensitivity`.
    Raises SceneError: build does not return the scene of the run.
    """

    def __init__(self, model: Model, names: Any, build: Build, values: Mapping[str, float],
                 scale: Mapping[str, float] | None) -> None:
        self.values, sizes = numbers_of("gradient", values, scale)
        self._family = Family(build, self.values, sizes, "gradient")
        self.model, self._names = model, list(names)
        found = self._family.model
        same = self._family.is_alike(model, found) and found.q0.shape == model.q0.shape
        off = max((float(np.max(np.abs(x - y), initial=0.0)) for x, y in ((found.q0, model.q0), (found.s0, model.s0))),
                  default=0.0) if same else np.inf
        if not off <= SAME * model.length:
            raise SceneError("gradient, build: with these values it returns another scene than that of the run; give the values "
                             "of the run, and let build return the same parts")
        missing = [name for name in self._names if name not in self._family.points]
        if missing:
            raise SceneError(f"gradient, build: must return the points too, (scene, points); {missing[0]!r} is missing")

    def by(self, name: str, run: Backward, part: Stretch, wanted: Mapping[tuple[str, bool], Array], at_reference: bool) -> float:
        """Return the derivative by a parameter of a number of a run.

        run: backward pass that has been through all steps, and has kept their solutions.
        part: all steps, in space.
        wanted: mapping of (str, bool) to float64 [n + 1, 3], weights of points, and of their velocities (True).
        at_reference: the run began with the velocities of the scene.
        """
        assert run.solutions is not None
        rows = []
        for change in CHANGES:
            scene, points = self._family.called({name: self.values[name] + change * self._family.steps[name]})
            found = compile_scene(scene)
            self._family.check_alike(name, self._family.is_alike(self.model, found))
            assert found.uneliminated is not None
            rows.append(self._row(run, part, found.uneliminated(planar=False, solver="auto"), points, wanted, at_reference))
        noise = NOISE * float(np.max(np.abs(rows)))
        self._family.check_smooth(name, rows, np.ones(rows[0].size), noise)
        return float(np.sum(self._family.slope(name, rows)))

    def _row(self, run: Backward, part: Stretch, model: Model, points: Mapping[str, Place],
             wanted: Mapping[tuple[str, bool], Array], at_reference: bool) -> Array:
        """Evaluate a scene around that of the run, at the motion of the run as its reference takes it along: minus the residuals
        in all steps times the adjoint solutions, the number itself, and the addition of its start, [n + 2]."""
        assert run.solutions is not None
        places = Observer(model, (), {name: points[name] for name in self._names}).points.places
        weights = [Weights(*places[name], rows, is_rate) for (name, is_rate), rows in wanted.items()]
        own = Backward(model, False, float(run.times[0]), run.h, run.times.size, weights, [])
        if not np.array_equal(own.core.pattern.row_of, run.core.pattern.row_of):
            raise SceneError("gradient: build returns scenes with different connections between their parts")
        moved = along(run, own, part)
        out = -own.unbalanced(moved, *run.solutions)
        value = sum(float(np.einsum("ma,tmac,tc->", x.shares, (moved.v if x.is_rate else moved.q).reshape(
            len(moved.q), -1, 4, 3)[:, x.nodes], x.rows)) for x in weights)
        first = 0.0
        if at_reference:
            first = float(run.adjoint.rate @ (model.v0 - moved.v[0]))
            if isinstance(run.adjoint.border, Border):
                first += float(run.adjoint.border.slide @ (model.s0 - moved.s[0]))
        return np.concatenate((out, (value, first)))


def along(run: Backward, own: Backward, part: Stretch) -> Stretch:
    """Return the motion of a run in another scene: nodes are displaced from its reference, and turned, as they were from their
    own, and supports that move do so as they do there.

    run, own: backward passes of the run, and of the other scene.
    part: all steps, in space.
    """
    before, after = run.whole, own.whole
    one, other = (x.q0.reshape(-1, 4, 3) for x in (before, after))
    mix = np.einsum("nik,njk->nij", other[:, 1:], one[:, 1:])
    turns = np.flatnonzero(np.any(other[:, 1:] != one[:, 1:], axis=(1, 2)))
    q, v = (x.reshape(len(x), -1, 4, 3).copy() for x in (part.q, part.v))
    q[:, :, 0] += other[:, 0] - one[:, 0]
    for x in (q, v):
        x[:, turns, 1:] = np.einsum("nij,tnjc->tnic", mix[turns], x[:, turns, 1:])
    n = len(part.dphi)
    dphi, theta = (x.reshape(n, -1, 3).copy() for x in (part.dphi, part.theta))
    if after.prescribed is not None:
        _move_supports(run, own, q, v, dphi, theta)
    if after.ties is not None:
        for x in (q, v):
            x[:] = [follow(after, row) for row in x]
        tied = after.ties.slave
        dphi[:, tied] = np.diff(q[:, tied, 0], axis=0)
    values = part.values
    if after.motions is not None:
        values = np.array([after.motions.values(row, known) for row, known in zip(q, part.values)])
    return part._replace(q=q.reshape(n + 1, -1), v=v.reshape(n + 1, -1), dphi=dphi.reshape(n, -1), theta=theta.reshape(n, -1),
                         s=_places(before, after, part.s), values=values)


def _places(before: Model, after: Model, s: Array) -> Array:
    """Return arc lengths of sliders [n + 1, S] at the same places in the same elements of another scene: shape functions have
    kinks at the ends of elements."""
    if before.sliders is None or after.sliders is None:
        return s
    out = np.empty_like(s)
    for k, c in enumerate(before.sliders.curve.tolist()):
        (x, around), (y, whole) = (_ends(model.curves, c) for model in (before, after))
        rounds = np.floor(s[:, k] / around) if around else np.zeros(len(s))
        local = s[:, k] - rounds * around
        beyond = np.minimum(local - x[0], 0.0) + np.maximum(local - x[-1], 0.0)
        out[:, k] = np.interp(local, x, y) + beyond + rounds * whole
    return out


def _ends(curves: Curves | Paths, c: int) -> tuple[Array, float]:
    """Return arc lengths of the ends of elements of curve c, and its length where it is closed, else 0."""
    _, count, first, *_ = curves.meta[c].tolist()
    return curves.ends[first:first + count + 1], float(curves.period[c]) if isinstance(curves, Paths) else 0.0


def _move_supports(run: Backward, own: Backward, q: Array, v: Array, dphi: Array, theta: Array) -> None:
    """Let supports go as their functions say, from where they are in row 0; all by rows of steps, nodes."""
    model, n = own.whole, len(dphi)
    times = np.append(run.times, run.times[-1] + run.h)
    given, before = (x.core.prescribed.schedule(times, x.stepper.prescribed) for x in (own, run))
    masks = own.stepper.prescribed.mask
    fixed_components = fixed_axes(masks)
    v[0, model.prescribed.nodes] = model.v0.reshape(-1, 4, 3)[model.prescribed.nodes]
    for node, k in zip(model.prescribed.nodes, model.prescribed.motion_of_node):
        more = np.where(fixed_components[k], given[:, k, :3] - before[:, k, :3], 0.0)
        q[1:, node, 0] += np.cumsum(more, axis=0)
        dphi[:, node] += more
        if masks[k] & 56:
            theta[:, node] = given[:, k, 3:]
            for i in range(n):
                q[i + 1, node, 1:] = turned(q[i:i + 1, node, 1:], given[i:i + 1, k, 3:])[0]
        for i in range(n):
            v[i + 1, node] = 2.0 / run.h * (q[i + 1, node] - q[i, node]) - v[i, node]
