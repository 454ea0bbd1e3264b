"""Gradients of runs by parameters of a function that builds the scene: positions, lengths, offsets, sections, against differences
of runs."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.mapping import follow

Array = np.ndarray
SIXTH = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
AWAY = (-3, -2, -1, 1, 2, 3)
STEPS, STEP = 15, 0.01
VALUES: dict[str, float] = dict(x=2.0, y=0.4, EA=1e4, rho=1.0, offset=0.2, mass=0.7, vz=1.0, foot=0.3)


def swing(x: float, y: float, EA: float, rho: float, offset: float, mass: float, vz: float, foot: float) -> Any:  # noqa: N803
    """Two beams at an angle, a body with an offset at their end, a bob on a spring to the ground."""
    one = fb.Section(EA=EA, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=rho, rhoI2=0.02, rhoI3=0.03)
    a = fb.Beam.straight("a", (0, 0, foot), (x, y, 0), section=one, elements=3, degree=2)
    b = fb.Beam.straight("b", (x, y, 0), (x, 1 + y, 0.3), section=one, elements=2, degree=3)
    body = fb.RigidBody("body", mass=mass, inertia=(0.02, 0.03, 0.04), position=(x, 1 + y + offset, 0.3))
    bob = fb.PointMass("bob", mass=0.3, position=(1, 0, -1), velocity=(0.1, 0, vz))
    scene = fb.Scene(a, b, body, bob, fb.Clamp(a.start), fb.RigidConnection(a.end, b.start),
                     fb.RigidConnection(b.end, body), fb.Spring(bob, b.end, stiffness=30.0, length=1.1),
                     fb.Spring(bob, fb.GROUND.point((1, foot, -2)), "anchor", stiffness=20.0), gravity=(0, 0, -9.81)).add(
        fb.Load("pull", b.end, force=(0, 3.0, 1.5), time=lambda t: 1 + t))
    return scene, {"tip": b.end, "body": body.point((0.1, offset, 0.1)), "bob": bob, "middle": (a, 1.03)}


def ring(x: float, mass: float, at: float, arm: float) -> Any:
    """A bead on a beam, a loop of rigid parts with a hinge, a rod that keeps its length, a spring in the hinge."""
    one = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    a = fb.Beam.straight("a", (0, 0, 0), (x, 0, 0), section=one, elements=4, degree=2)
    bead = fb.PointMass("bead", mass=mass)
    body = fb.RigidBody("body", mass=0.7, inertia=(0.02, 0.03, 0.04), position=(x, 1.2, 0.3))
    other = fb.RigidBody("arm", mass=0.4, inertia=(0.02, 0.03, 0.04), position=(x, 1.6 + arm, 0.3))
    scene = fb.Scene(a, bead, body, other, fb.Clamp(a.start), fb.Slider("ring", bead, a, at=at, rate=1.0),
                     fb.BallJoint(a.end, body.point((0, -1.2, -0.3))),
                     fb.RevoluteJoint(body.point((0, 0.4, 0)), other.point((0, -arm, 0)), "hinge", axis=(0, 0.6, 0.8),
                                      stiffness=2.0),
                     fb.DistanceJoint(other, fb.GROUND.point((x + arm, 2.5, 0.5)), "rod"), gravity=(0, 0, -9.81),
                     project_velocities=True)
    return scene, {"bead": bead, "arm": other, "tip": a.end}


def machine(way: float, y: float, damping: float, radius: float, force: float, reach: float) -> Any:
    """In a plane: a beam whose support moves, a carriage that a spring drives along it on a rail, a bead pushed by a drive."""
    one = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03, damping=damping)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, y), section=one, elements=4, degree=2)
    moved = fb.PrescribedMotion("shake", a.start, displacement=lambda t: (0, 0, way * np.sin(20.0 * t) ** 2),
                                rotation=lambda t: (0, way * np.sin(9.0 * t) ** 2, 0))
    carriage = fb.RigidBody("carriage", mass=0.7, inertia=(0.02, 0.03, 0.04), position=(2, 0, y - radius))
    bead = fb.PointMass("bead", mass=0.4)
    scene = fb.Scene(a, carriage, bead, moved, fb.PrismaticJoint(a.end, carriage.point((0, 0, radius)), "rail", axis=(1, 0, 0.2),
                                                                 stiffness=30.0, damping=0.5, rest=reach),
                     fb.Slider("drive", bead, a, at=0.6, drive=fb.Drive(force=lambda t: force * (1.0 + t))),
                     fb.Drag("air", a, normal=0.8, tangential=0.3), gravity=(0, 0, -9.81), project_velocities=True)
    return scene, {"bead": bead, "carriage": carriage, "tip": a.node(6)}


def check(build: Callable[..., Any], values: dict[str, float], share: float = 2e-3) -> None:
    draw = np.random.default_rng(0)
    names = list(build(**values)[1])
    places = {name: draw.standard_normal((STEPS + 1, 3)) for name in names}
    rates = {name: draw.standard_normal((STEPS + 1, 3)) for name in names[:2]}

    def run(values: dict[str, float]) -> Any:
        scene, points = build(**values)
        return fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points=points)

    def number(of: Any) -> float:
        return sum(float(np.sum(w * of.point(name))) for name, w in places.items()) + sum(
            float(np.sum(w * of.velocity(name))) for name, w in rates.items())

    by = run(values).gradient(points=places, velocities=rates, build=build, values=values).by
    assert by.keys() == values.keys()
    for name, value in values.items():
        e = share * value
        exact = float(SIXTH @ [number(run({**values, name: value + k * e})) for k in AWAY]) / e
        assert by[name] == pytest.approx(exact, rel=1e-7), name


def test_positions_lengths_offsets_and_sections() -> None:
    check(swing, VALUES)


def test_with_sliders_hinges_and_rods() -> None:
    check(ring, dict(x=2.0, mass=0.5, at=0.6, arm=0.3))


def crossing(L: float, mass: float, rate: float = 1.0, at: float = 0.525) -> Any:  # noqa: N803
    """A ring that passes an end of an element in the middle of a step; the end moves with the length of the beam."""
    one = fb.Section(EA=2e3, GA2=1e3, GA3=1.1e3, GJ=2.0, EI2=1.5, EI3=2.2, rhoA=1.0, rhoI2=2e-3, rhoI3=3e-3)
    rod = fb.Beam.straight("rod", (0, 0, 0), (L, 0, 0.1), section=one, elements=4)
    bead = fb.PointMass("bead", mass=mass)
    return fb.Scene(rod, fb.Clamp(rod.start), bead, fb.Slider("ring", bead, rod, at=at, rate=rate), gravity=(0, -1.5, -9.81),
                    project_velocities=True), {"bead": bead, "tip": rod.end}


def test_sliders_that_pass_ends_of_elements() -> None:
    check(lambda L: crossing(L, 0.4), {"L": 1.1}, share=2e-4)
    check(lambda mass: crossing(1.1, mass), {"mass": 0.4})
    # where it is and how fast it goes at the start, away from ends
    check(lambda **given: crossing(L=1.1, mass=0.4, **given), dict(at=0.35, rate=0.3))


def slipping(mu: float, viscous: float, m: float, height: float) -> Any:
    rod = fb.Beam.straight("rod", (0, 0, 0), (1.1, 0, height), elements=4, section=fb.Section(
        EA=2e3, GA2=1e3, GA3=1.1e3, GJ=2.0, EI2=1.5, EI3=2.2, rhoA=1.0, rhoI2=2e-3, rhoI3=3e-3))
    bead = fb.PointMass("bead", mass=m)
    scene = fb.Scene(rod, fb.Clamp(rod.start), fb.Clamp(rod.end), bead,
                     fb.Slider("ring", bead, rod, at=0.3, rate=2.0, friction=fb.Friction(mu, viscous=viscous)),
                     fb.Spring(bead, fb.GROUND.point((0.5, 0, -1)), "pull", stiffness=50.0, length=0.5), project_velocities=True)
    return scene, {"bead": bead}


def test_sliders_that_slip() -> None:
    check(slipping, dict(mu=0.2, viscous=0.3, m=0.4, height=0.1))


def test_in_a_plane_with_supports_that_move_drives_drag_and_damping() -> None:
    check(machine, dict(way=0.05, y=0.3, damping=2e-3, radius=0.2, force=2.0, reach=0.05))


def test_of_a_start_that_goes_along_with_the_reference() -> None:
    """A run from the end of another: displaced and turned from the reference as there, with the velocities of there."""
    def both(x: float) -> Any:
        return swing(**{**VALUES, "x": x})

    def run(x: float, state: Any, q0: Array) -> Any:
        scene, points = both(x)
        model = fb.compile_scene(scene)
        start = model.state()
        # all nodes keep the turn from their reference, and no triad of it changes with x but those of the beams
        q, v, known = (y.reshape(-1, 4, 3).copy() for y in (state.q, state.v, q0))
        new = model.q0.reshape(-1, 4, 3)
        mix = np.einsum("nik,njk->nij", new[:, 1:], known[:, 1:])
        q[:, 0] += new[:, 0] - known[:, 0]
        q[:, 1:], v[:, 1:] = (np.einsum("nij,njc->nic", mix, y[:, 1:]) for y in (q, v))
        start.q[:], start.v[:] = follow(model, q).reshape(-1), follow(model, v).reshape(-1)
        return fb.adjoint_run(model, t_end=STEPS * STEP, step=STEP, points=points, start=start)

    scene, _ = both(2.0)
    model = fb.compile_scene(scene)
    state = fb.simulate(model, t_end=0.1, step=STEP, progress=False).state
    weights = {"tip": (1.0, 0.5, -0.3), "bob": (0.2, 0.1, 1.0)}
    base = run(2.0, state, model.q0)
    by = base.gradient(points=weights, build=both, values={"x": 2.0}).by["x"]
    e = 4e-3
    exact = float(SIXTH @ [sum(np.dot(w, other.point(name)[-1]) for name, w in weights.items()) for other in (
        run(2.0 + k * e, state, model.q0) for k in AWAY)]) / e
    assert by == pytest.approx(exact, rel=1e-7)


def test_what_is_refused() -> None:
    build, values = swing, VALUES
    scene, points = build(**values)
    model = fb.compile_scene(scene)
    run = fb.adjoint_run(model, t_end=0.05, step=STEP, points=points)
    weights = {"tip": (0, 0, 1.0)}

    def refused(message: str, of: Any = run, **given: Any) -> None:
        with pytest.raises(fb.SceneError, match=message):
            of.gradient(points=weights, **given)

    refused("need both build=..., a function that builds the scene, and values=", build=build)
    refused("need both build=", values=values)
    refused("build must be a function", build=3, values=values)
    refused("with these values it returns another scene than that of the run", build=build, values={**values, "x": 2.5})
    refused("must return the points too", build=lambda **given: build(**given)[0], values=values)
    refused("parameter 'step' is 0, so the size of a small change of it is unknown", build=lambda step, **given: build(**given),
            values={**values, "step": 0.0})
    refused("does not depend smoothly on parameter 'x'", build=lambda **given: build(**{**given, "x": round(given["x"], 2)}),
            values=values)
    says = "parameter 'foot' changes the parts, nodes, supports, joints or points of the scene"
    refused(says, values=values, build=lambda **given: (
        lambda found: (found[0].add(fb.PointMass("more", mass=1.0, position=(0, 0, 1))) if given["foot"] != 0.3 else found[0],
                       found[1]))(build(**given)))
    refused("need the states of all steps; leave keep_every out", fb.adjoint_run(model, t_end=0.05, step=STEP, points=points,
                                                                              keep_every=2), build=build, values=values)


def test_sliders_that_friction_holds_are_refused() -> None:
    def build(x: float) -> Any:
        rail = fb.Beam.straight("rail", (0, 0, 0), (x, 0, 0.1), elements=3, section=fb.Section(
            EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03))
        bead = fb.PointMass("bead", mass=0.4)
        return fb.Scene(rail, bead, fb.Clamp(rail.start), fb.Clamp(rail.end), fb.Slider("ring", bead, rail, at=0.6, rate=0.02,
                                                                                     friction=0.5), gravity=(0, 0, -9.81),
                        project_velocities=True), {"bead": bead}

    scene, points = build(2.0)
    run = fb.adjoint_run(fb.compile_scene(scene), t_end=0.2, step=STEP, points=points)
    with pytest.raises(fb.SceneError, match="friction holds slider 'ring' in some steps"):
        run.gradient(points={"bead": (1, 0, 0)}, build=build, values={"x": 2.0})
