"""Gradients of runs against differences of runs, with everything that steps with an adjoint know."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import fastbeam as fb
from fastbeam.model.mapping import follow

Array = np.ndarray
SIXTH = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
AWAY = (-3, -2, -1, 1, 2, 3)
STEPS, STEP = 20, 0.01


def swing(strain: str, ball: bool, EA: float = 1e4, EI: float = 5.0, rhoA: float = 1.0, rhoI: float = 0.02,  # noqa: N803
          m: float = 0.7, F: float = 3.0, M: float = 0.4, vz: float = 1.0, e: float = 0.0) -> Any:  # noqa: N803
    """Two beams at an angle, a body at their end, a mass on a spring, loads in time, a moment."""
    one = fb.Section(EA=EA, GA2=4e3, GA3=5e3, GJ=4.0, EI2=EI, EI3=6.0, rhoA=rhoA, rhoI2=rhoI, rhoI3=0.03)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=one, elements=3, degree=2, strain=strain, prestrain=e)
    b = fb.Beam.straight("b", (2, 0, 0), (2, 1, 0.3), section=one, elements=2, degree=3, strain=strain, prestrain=e)
    body = fb.RigidBody("body", mass=m, inertia=(0.02, 0.03, 0.04), position=(2, 1.2, 0.3))
    bob = fb.PointMass("bob", mass=0.3, position=(1, 0, -1), velocity=(0.1, 0, vz))
    at_end = fb.BallJoint(b.end, body.point((0, -0.2, 0))) if ball else fb.RigidConnection(b.end, body)
    scene = fb.Scene(a, b, body, bob, fb.Clamp(a.start), fb.RigidConnection(a.end, b.start), at_end,
                     fb.Spring(bob, b.end, stiffness=30.0, length=1.1), gravity=(0, 0, -9.81)).add(
        fb.Load("pull", b.end, force=(0, F, 0.5 * F), time=lambda t: 1 + t), fb.Load("turn", a.end, moment=(0, 0, M)))
    return scene, {"tip": b.end, "body": body, "bob": bob, "middle": (a, 1.03)}


def run(strain: str, ball: bool, values: dict[str, float]) -> Any:
    scene, points = swing(strain, ball, **values)
    return fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points=points)


@pytest.mark.parametrize(("strain", "ball"), [("simo_reissner", False), ("green_lagrange", True)])
def test_gradients_of_a_run_against_differences(strain: str, ball: bool) -> None:
    draw = np.random.default_rng(0)
    places = {name: draw.standard_normal((STEPS + 1, 3)) for name in ("tip", "body", "bob", "middle")}
    rates = {name: draw.standard_normal((STEPS + 1, 3)) for name in ("tip", "bob")}

    def number(of: Any) -> float:
        return sum(float(np.sum(w * of.point(name))) for name, w in places.items()) + sum(
            float(np.sum(w * of.velocity(name))) for name, w in rates.items())

    values = dict(EA=1e4, EI=5.0, rhoA=1.0, rhoI=0.02, m=0.7, M=0.4, vz=1.0, e=1e-3)
    base = run(strain, ball, values)
    plain = fb.simulate(fb.compile_scene(swing(strain, ball, **values)[0]), t_end=STEPS * STEP, step=STEP, progress=False)
    np.testing.assert_allclose(base.state.q, plain.state.q, atol=1e-12)
    by = base.gradient(points=places, velocities=rates)
    node = {entry["name"]: entry for kind in ("beams", "masses") for entry in base.model.names[kind]}
    found = {"EA": sum(x.stiffness[0, 0, 0] for x in by.sections.values()), "m": by.masses["body"],
             "EI": sum(x.stiffness[0, 4, 4] for x in by.sections.values()), "rhoA": sum(x.rhoA[0] for x in by.sections.values()),
             "e": sum(x.prestrain[0, 0] for x in by.sections.values()),
             "rhoI": sum(x.rhoI2[0] for x in by.sections.values()), "vz": by.velocities[node["bob"]["node"], 2],
             "M": by.moments[node["a"]["first"] + node["a"]["count"] - 1, 2]}
    assert found.keys() == values.keys()
    for name, value in values.items():
        e = 2e-3 * value
        exact = float(SIXTH @ np.array([number(run(strain, ball, {**values, name: value + k * e})) for k in AWAY])) / e
        assert found[name] == pytest.approx(exact, rel=1e-7), name
    # once more from the same run: nothing of it has changed
    assert base.gradient(points=places, velocities=rates).masses == by.masses


def test_a_mass_on_a_spring_by_its_mass_and_velocity() -> None:
    """In the limit of small steps x = v/w sin w t with w^2 = k/m, at second order."""
    k, m, v = 8.0, 0.5, 0.3
    w, t = np.sqrt(k / m), 0.7
    errors = []
    for steps in (70, 140):
        bob = fb.PointMass("bob", mass=m, position=(1, 0, 0), velocity=(v, 0, 0))
        model = fb.compile_scene(fb.Scene(bob, fb.Spring(bob, fb.GROUND.point((0, 0, 0)), stiffness=k, length=1.0)))
        by = fb.adjoint_run(model, t_end=t, step=t / steps, points={"bob": bob}).gradient(points={"bob": (1, 0, 0)})
        by_w = v * (t * np.cos(w * t) / w - np.sin(w * t) / w**2)
        node = model.names["masses"][0]["node"]
        errors.append([by.velocities[node, 0] - np.sin(w * t) / w, by.masses["bob"] + by_w * w / (2 * m)])
    rates = np.log2(np.abs(np.array(errors[0]) / errors[1]))
    assert np.all(np.abs(errors[1]) < 2e-3) and np.all(np.abs(rates - 2.0) < 0.02), (errors, rates)


def test_a_net_by_all_its_sections_and_loads() -> None:
    """A hundred numbers by one backward run: their sum along a direction against a difference of runs."""
    draw = np.random.default_rng(1)
    grid = np.arange(16).reshape(4, 4)
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    edges = np.concatenate([np.stack((a.ravel(), b.ravel()), 1) for a, b in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:]))])
    way, push = draw.standard_normal(len(edges)), draw.standard_normal((16, 3))

    def go(e: float) -> Any:
        factor = 1.0 + e * way
        sections = [fb.Section(EA=1e4 * f, GA2=4e3 * f, GA3=4e3 * f, GJ=4 * f, EI2=5 * f, EI3=5 * f, rhoA=0.5 * f, rhoI2=1e-3 * f,
                               rhoI3=1e-3 * f) for f in factor]
        net = fb.Net("net", np.stack((x, y, 0 * x), -1).reshape(-1, 3), edges, section=sections, section_of=np.arange(len(edges)),
                     elements=2, degree=2, clamps=[0, 3], loads=e * push)
        scene = fb.Scene(net, gravity=(0, 0, -9.81))
        return fb.adjoint_run(fb.compile_scene(scene), t_end=0.2, step=0.01, points={"far": net.node(15)})

    weights = np.array([0.3, -1.0, 2.0])
    base = go(0.0)
    by = base.gradient(points={"far": weights})
    own, net = by.sections["net"], base.model.names["nets"][0]
    C = np.diag([1e4, 4e3, 4e3, 4, 5, 5])  # noqa: N806
    junctions = net["first"] + np.array(net["junctions"])
    total = float(np.sum(way * own.by(C, 0.5, 1e-3, 1e-3)) + np.sum(push * by.forces[junctions]))
    e = 1e-3
    exact = float(SIXTH @ np.array([go(k * e).point("far")[-1] @ weights for k in AWAY])) / e
    assert own.rhoA.shape == (24,) and total == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize("flat", [False, True])
def test_by_the_shape_at_the_start(flat: bool) -> None:
    """Nodes of a beam and a spinning body are shifted and turned, their velocities and spins stay: against differences."""
    y = 0.0 if flat else 1.0
    one = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    arm = fb.Beam.straight("arm", (0, 0, 0), (2, 0, 0), section=one, elements=3, degree=2)
    body = fb.RigidBody("body", mass=0.7, inertia=(0.02, 0.03, 0.04), position=(2, 0.5 * y, 1.0), velocity=(1.0, y, 0.5),
                        spin=(2.0 * y, 3.0, -y))
    stay = fb.Spring(body.point((0.2, 0.1 * y, 0.3)), arm.end, stiffness=40.0, length=0.6)
    model = fb.compile_scene(fb.Scene(arm, body, fb.Clamp(arm.start), stay, gravity=(0, 0, -9.81)))
    tip, centre = (model.numbers.number(x) for x in (arm.end, body.center))
    draw = np.random.default_rng(3)
    weights = {name: draw.standard_normal((STEPS + 1, 3)) * (1.0, y, 1.0) for name in ("tip", "body")}

    def run(node: int = 0, shift: Array = np.zeros(3), turn: Array = np.zeros(3)) -> Any:
        state = model.state()
        q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
        q[node, 0] += shift
        for x in (q, v):
            x[node, 1:] = x[node, 1:] @ Rotation.from_rotvec(turn).as_matrix().T
        spin = 0.5 * np.cross(q[node, 1:], v[node, 1:]).sum(axis=0)
        known = model.state()
        before = 0.5 * np.cross(*(x.reshape(-1, 4, 3)[node, 1:] for x in (known.q, known.v))).sum(axis=0)
        v[node, 1:] += np.cross(before - spin, q[node, 1:])
        for x in (q, v):
            x[:] = follow(model, x)
        return fb.adjoint_run(model, t_end=STEPS * STEP, step=STEP, start=state,
                              points={"tip": arm.end, "body": body.point((0.1, 0, 0.2))})

    def number(of: Any) -> float:
        return sum(float(np.sum(w * of.point(name)) + np.sum(w[::-1] * of.velocity(name))) for name, w in weights.items())

    base = run()
    assert (base._stepper.plane is not None) == flat
    by = base.gradient(points=weights, velocities={name: w[::-1] for name, w in weights.items()})
    e = 1e-3
    for node in (tip, centre):
        for axis in np.eye(3)[[0, 2]] if flat else np.eye(3):
            exact = float(SIXTH @ [number(run(node, shift=k * e * axis)) for k in AWAY]) / e
            assert by.positions[node] @ axis == pytest.approx(exact, rel=1e-7), (node, axis)
        for axis in np.eye(3)[1:2] if flat else np.eye(3):
            exact = float(SIXTH @ [number(run(node, turn=k * e * axis)) for k in AWAY]) / e
            assert by.turns[node] @ axis == pytest.approx(exact, rel=1e-7), (node, axis)
    assert not by.positions[0].any() and not by.turns[0].any()
