"""Equations of constraints in statics, read from the compiled rows of a step with both ends equal, against their naive twin."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import Calls
from fastbeam.kernels.state import State
from fastbeam.model.gap_rows import ConstraintGaps, is_constraint
from fastbeam.model.mapping import contact, follow, turned
from fastbeam.model.maps import RowMap, velocity_map
from fastbeam.model.model import Model
from fastbeam.statics.slider_friction import turned_with_sleeves, with_friction
from fastbeam.stepping.assembled import Constraints, Equations, SaddleMatrix, entries_of_matrix
from fastbeam.stepping.stepper import Stepper

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_constraints import StaticContacts, gaps_and_rates  # noqa: E402

Array = np.ndarray
SOFT = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=5.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def body(name: str, x: float, z: float = 0.0) -> fb.RigidBody:
    return fb.RigidBody(name, mass=1.0, inertia=(0.02, 0.03, 0.04), position=(x, 0, z))


def sliders() -> fb.Scene:
    """A mass on a curved beam; points of a body at arms, and the end of another beam, on a straight one."""
    bow = fb.Beam.arc("bow", (0, 0, 0), (1, 0, 0), (0, 0, 1), radius=2.0, angle=1.0, section=SOFT, elements=4)
    rail = fb.Beam.straight("rail", (0, 0, -1), (2, 0, -1), section=SOFT, elements=3)
    hanger = fb.Beam.straight("hanger", (0.9, 0, -1), (0.9, 0, -2), section=SOFT, elements=2)
    ring, box = fb.PointMass("ring", mass=1.0), body("box", 1.6, -1.2)
    return fb.Scene(bow, rail, hanger, ring, box, fb.Clamp(bow.start), fb.Clamp(rail.start), fb.Slider("run", ring, bow, at=0.3),
                    fb.Slider("arm", box.point((-0.2, 0, 0.2)), rail, at=1.4), fb.Slider("hook", hanger.start, rail, at=0.9))


def sleeves() -> fb.Scene:
    """One that is keyed and has a bore, one without."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SOFT, elements=3, degree=2)
    a, b = body("a", 0.5), body("b", 1.4)
    return fb.Scene(rod, a, b, fb.Clamp(rod.start), fb.Sleeve("keyed", a, rod, at=0.5, length=0.3, friction=0.3, key_radius=0.02),
                    fb.Sleeve("loose", b, rod, at=1.4, keyed=False))


def joints() -> fb.Scene:
    """A loop of bodies, with joints of several kinds and coordinates that are given and that rub."""
    a, b, c, d = (body(name, x) for name, x in zip("abcd", (0.0, 1.0, 2.0, 3.0)))
    rod = fb.Beam.straight("rod", (3.5, 0, 0), (4.5, 0, 0), section=SOFT, elements=2)
    half = (0.5, 0, 0), (-0.5, 0, 0)
    return fb.Scene(a, b, c, d, rod, fb.Clamp(rod.end),
                    fb.RevoluteJoint(a.point(half[0]), b.point(half[1]), "hinge", axis=(0, 1, 0), angle=lambda t: t * t),
                    fb.UniversalJoint(b.point(half[0]), c.point(half[1]), "cross", axis_a=(0, 1, 0), axis_b=(0, 0, 1)),
                    fb.CylindricalJoint(c.point(half[0]), d.point(half[1]), "tube", axis=(1, 0, 0), friction=(0.1, 0.1)),
                    fb.RevoluteJoint(d.point(half[0]), rod.start, "last", axis=(0, 1, 0), friction=0.1),
                    fb.BallJoint(a.point((0, 0, 0.5)), d.point((-3, 0, 0.5))))


def path() -> fb.Scene:
    """A ring near a node, and one on the second beam of a path."""
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=SOFT, elements=2)
    b = fb.Beam.straight("b", (1, 0, 0), (2, 0, 0), section=SOFT, elements=2)
    run = fb.Path("run", [a, b])
    rings = [fb.PointMass(name, mass=1.0) for name in ("at a node", "far")]
    return fb.Scene(a, b, *rings, fb.RigidConnection(a.end, b.start), fb.Clamp(a.start), fb.Slider("1", rings[0], run, at=0.5),
                    fb.Slider("2", rings[1], run, at=1.3))


def strut() -> fb.Scene:
    """A pendulum of two bodies, rods between them."""
    a, b = body("a", 0.0), body("b", 1.0)
    return fb.Scene(a, b, fb.Pin(a),
                    fb.BallJoint(a.point((0, 0, 0.2)), b.point((-1, 0, 0.2))),
                    fb.DistanceJoint(a.point((0.1, 0, 0)), b.point((0, 0.2, 0)), "rod"),
                    fb.DistanceJoint(b.point((0, -0.2, 0)), a.point((0, 0.1, 0)), "other"))


def disturbed(model: Model, planar: bool) -> State:
    """A state with moved nodes, open gaps and forces of any size."""
    rng, state = np.random.default_rng(0), model.state()
    step = 0.05 * rng.standard_normal((model.n_nodes, 6))
    if planar:
        axes = model.plane.axes
        step = np.concatenate((step[:, :2] @ axes[:2], step[:, 3:4] * axes[2]), axis=1)
    step[(model.fixed_mask[:, None] >> np.arange(6)) & 1 == 1] = 0.0
    step = step[model.pattern.first_on_row]
    q = state.q.reshape(-1, 4, 3).copy()
    q[:, 0] += step[:, :3]
    q[:, 1:] = turned(q[:, 1:], step[:, 3:])
    force = rng.standard_normal(state.force.size)
    if planar:
        force = model.plane.forces(rng.standard_normal(model.plane.model.n_forces))
    for o, (_, c) in enumerate(model.sleeve_pairs.tolist()):
        force[model.first_force[c] + 2] *= model.sleeves.keyed[o]
    return state._replace(q=follow(model, q).reshape(-1), force=force)


def matrix_of(stepper: Stepper, equations: Equations) -> Array:
    core = stepper.core
    of = SaddleMatrix(core.pattern, len(core.dofs), core.n_sliders, core.n_forces)
    return of.of(stepper.work.blocks, equations, np.ones(core.n_sliders, bool), 0.0).toarray()


@pytest.mark.parametrize(("make", "planar"), [(sliders, False), (sliders, True), (sleeves, False), (sleeves, True),
                                              (joints, False), (path, False)])
def test_compiled_rows_of_a_step_with_equal_ends_are_the_static_equations(make: Any, planar: bool) -> None:
    model = fb.compile_scene(make(), planar=planar).uneliminated(planar=planar)
    stepper = Stepper(model, np.ones(1), disturbed(model, planar), backend="superlu", static=True)
    core, state, work = stepper.core, stepper.core_state, stepper.work
    twin, constraints = StaticContacts(model, stepper.plane.axes if planar else None), Constraints(stepper)
    if core.motions is not None and core.motions.holds.held.size:
        twin.given = constraints.given = np.linspace(0.1, 0.2, core.motions.holds.held.size)
    slip = np.linspace(-0.3, 0.4, core.n_sliders)
    weights = twin.weights(state.s)
    for rubs in (False, True) if core.n_sliders else (False,):
        border = twin.border(weights, stepper.state.q, state.force, slip if rubs else None)
        found = constraints.at()
        found = with_friction(constraints, found, slip) if rubs else found
        m, s, f = twin.rows.shape[1], core.n_sliders, core.n_forces
        for mine, other in ((found.gaps, border.gaps), (found.tangent, border.tangent), (found.sliding, border.sliding),
                            (found.bend, border.bend), (found.gradient.matrix(f, m).toarray(), border.gradient.toarray()),
                            (found.slide.matrix(s, m).toarray(), border.slide.toarray()),
                            (found.turns.matrix(f, s).toarray(), border.turns.toarray())):
            np.testing.assert_allclose(mine, other, rtol=1e-13, atol=1e-13)
        assert sorted(found.idle) == sorted(border.idle)
        if rubs:
            np.testing.assert_allclose(found.normal, border.normal, rtol=1e-13)
            np.testing.assert_allclose(found.rubbing.matrix(s, m).toarray(), border.rubbing.toarray(), atol=1e-13)
            np.testing.assert_allclose(found.by_force.matrix(s, f).toarray(), border.by_force.toarray(), atol=1e-13)
    # residual and tangent of the nodes: here with the forces of the constraints as loads
    if core.sleeves is not None:
        found = found._replace(bent=turned_with_sleeves(RowMap(model, twin.axes), {}, stepper.state))
    stepper.parts.assemble(0.0)
    r, matrix = work.r.copy(), matrix_of(stepper, found)
    others = Calls(tuple(term for term in stepper.terms if not is_constraint(term)))
    work.f_ext[:] = twin.loads(weights, stepper.state.q, state.force)
    kernels.assemble_all(*others.on(stepper.records[1]), 0.0)
    rows, n = core.pattern.n, len(core.dofs)
    np.testing.assert_allclose(*(x.reshape(-1, 8)[:rows, :n] for x in (r, work.r)), rtol=1e-12, atol=1e-11)
    as_loads = matrix_of(stepper, found._replace(bent=entries_of_matrix(border.bent)))
    np.testing.assert_allclose(matrix, as_loads, rtol=1e-12, atol=1e-12 * np.max(np.abs(matrix)))


@pytest.mark.parametrize("make", [sliders, sleeves, joints, path, strut])
def test_gaps_outside_of_a_step_and_their_rates_are_those_of_the_twin(make: Any) -> None:
    model = fb.compile_scene(make(), planar=False)
    state, rows = disturbed(model, False), ConstraintGaps(model)
    gaps, (values, rates) = rows.at(state.q, state.s), gaps_and_rates(model, state.q, state.s)
    assert gaps.values.size == model.n_forces and np.max(np.abs(values)) > 1e-3
    np.testing.assert_allclose(gaps.values, values, rtol=0.0, atol=1e-14)
    # along motions that leave triads at right angles
    motions = velocity_map(state.q.reshape(-1, 4, 3))
    np.testing.assert_allclose((gaps.rates @ motions).toarray(), rates @ motions, rtol=0.0, atol=1e-13)
    v = motions @ np.random.default_rng(1).standard_normal(6 * model.n_nodes)
    for k in range(model.n_sliders):
        _, tangent, relative = contact(model, k, float(state.s[k]), *(x.reshape(-1, 4, 3) for x in (state.q, v)))
        np.testing.assert_allclose(gaps.tangents[k], tangent, rtol=1e-13, atol=1e-13)
        assert gaps.along(k, v) == pytest.approx(float(relative @ tangent / (tangent @ tangent)), rel=1e-12)
    kept = np.concatenate((np.arange(3 * model.n_sliders), rows.others, rows.coordinates))
    assert np.unique(kept).size == kept.size and not np.any(np.delete(rates, kept, axis=0))
