"""Gradients of runs with sleeves, friction, drives and elastic stops of sliders (theory.md (13.13) to (13.15)): against exact
numbers and against differences of order 6 of runs."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.test_adjoint_run import AWAY, SIXTH  # noqa: E402

Array = np.ndarray
STEPS, STEP = 20, 0.01
# what acts along the beam, and the rate at the start
CASES: dict[str, dict[str, Any]] = {
    "free": dict(rate=1.0),
    "slips": dict(rate=1.0, mu=0.2, viscous=0.2),
    "comes to rest": dict(rate=0.3, mu=1.5, viscous=0.2),
    "smoothed": dict(rate=1.0, mu=0.3, viscous=0.2, smoothing=0.3),
    "law": dict(rate=1.0, drive=fb.Drive(force=lambda t, s, rate: 3.0 - 4.0 * (s - 0.6) - 0.5 * rate**3)),
    "stops": dict(rate=2.0, stops=fb.Stops(0.3, 0.66, stiffness=500.0)),
}


def bead(sleeve: bool = True, flat: bool = True, rate: float | None = None, mu: float = 0.0, viscous: float = 0.0,
         smoothing: float | None = None, drive: Any = None, stops: Any = None, keyed: bool = True, EI: float = 5.0,  # noqa: N803
         m: float = 0.5, way: float = 0.0, g: float = -9.81) -> Any:
    """A body that a sleeve, or a slider, leads along a cantilever with damping."""
    y = 0.0 if flat else 1.0
    one = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=EI, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=one, elements=4, degree=2)
    rubs = fb.Friction(mu, viscous=viscous, **({} if smoothing is None else dict(smoothing=smoothing))) if mu or viscous else None
    body = fb.RigidBody("body", mass=m, inertia=(0.01, 0.02, 0.03), position=(0.6, 0, 0), velocity=(rate or 0.0, 0, 0))
    along = dict(at=0.6, friction=rubs, drive=drive, stops=stops, **({} if rate is None else dict(rate=rate)))
    ring = fb.Sleeve("ring", body, a, length=0.1, keyed=keyed, **along) if sleeve else fb.Slider("ring", body, a, **along)
    scene = fb.Scene(a, body, fb.Clamp(a.start), ring, fb.Load("pull", a.end, force=(0, 0.9 * y, 3)),
                     fb.Load("way", body, force=(way, 0, 0)), gravity=(0, 0, g))
    return scene, {"tip": a.end, "body": body.point((0.1, 0, 0.2))}


def go(**values: Any) -> Any:
    scene, points = bead(**values)
    return fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points=points)


def weights(flat: bool) -> dict[str, Array]:
    draw = np.random.default_rng(4)
    return {name: draw.standard_normal((STEPS + 1, 3)) * (1, not flat, 1) for name in ("tip", "body")}


def number(run: Any, given: dict[str, Array]) -> float:
    return sum(float(np.sum(w * run.point(name))) for name, w in given.items())


def check(case: dict[str, Any], found: dict[str, float], given: dict[str, Array], share: float = 1e-3, build: Any = go) -> None:
    """Derivatives against differences of order 6 of runs on the same branch; 1e-8 of the derivative."""
    values = {**dict(EI=5.0, m=0.5, way=0.0, g=-9.81), **case}
    for name, by in found.items():
        # by a viscous coefficient the derivative is small next to round-off of runs over the increment, which is larger for it
        e = share * (values[name] or 1.0) * (20.0 if name == "viscous" else 1.0)
        exact = float(SIXTH @ [number(build(**{**case, name: values[name] + k * e}), given) for k in AWAY]) / e
        assert by == pytest.approx(exact, rel=1e-8), name


def usual(run: Any, by: Any) -> dict[str, float]:
    node = run._points["body"][0][0]
    return {"EI": by.sections["a"].stiffness[0, 4, 4], "m": by.masses["body"], "way": by.forces[node, 0], "g": by.gravity[2]}


@pytest.mark.parametrize("name", ["slips", "comes to rest", "smoothed", "stops", *(
    pytest.param(x, marks=pytest.mark.slow) for x in ("free", "law", "free, space", "slips, space", "comes to rest, space"))])
def test_a_body_in_a_sleeve(name: str) -> None:
    key, flat = name.split(",")[0], not name.endswith("space")
    case, given = dict(CASES[key], flat=flat), weights(flat)
    run = go(**case)
    by = run.gradient(points=given)
    assert run.outside == 0 and (run._stepper.plane is not None) == flat
    found = usual(run, by)
    if "mu" in case:
        found["mu"], found["viscous"] = by.sliders["ring"].friction, by.sliders["ring"].viscous
        signs, rests = run._stretch.sign[:, 0], run._stretch.rest[:, 0]
        assert key == "smoothed" or np.all(signs == 1) == (key == "slips")
        if key == "comes to rest":
            held = signs == 0
            assert np.any(rests[held] != 0.0) and np.any(rests[held] == 0.0)
            assert not by.sliders["ring"].forces[held].any()
    if key == "stops":
        assert np.any(run._stretch.s > 0.66)
        # a stop does not depend on what is varied; where it is met within a step is a kink of second order
        found.pop("m")
    check(case, found, given)


def test_a_body_on_a_straight_rail_by_friction_and_speed() -> None:
    """Steps with a constant force are exact: s = v t - a t^2/2 until the velocity at the end of a step would turn around, which
    takes h/2 of the velocity at its start instead; a = mu g. Of a force in step j, m/s: h^2/m (n - j - 1/2), and what it adds to
    the velocity at the end times h/2 in the last step."""
    mu, v, m, h, n = 0.25, 0.31, 0.5, 0.01, 20
    one = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=one, elements=4, degree=2)
    body = fb.RigidBody("body", mass=m, inertia=(0.01, 0.02, 0.03), position=(0.6, 0, 0), velocity=(v, 0, 0))
    scene = fb.Scene(rail, body, *(fb.Clamp(rail.node(k)) for k in range(rail.n_nodes)),
                     fb.Sleeve("ring", body, rail, at=0.6, length=0.1, rate=v, friction=fb.Friction(mu)), gravity=(0, 0, -9.81))
    run = fb.adjoint_run(fb.compile_scene(scene), t_end=n * h, step=h, points={"body": body})
    moving = int(np.floor(v / (mu * 9.81) / h))
    assert 0 < moving < n - 2
    t = moving * h
    assert run.point("body")[-1, 0] == pytest.approx(0.6 + v * t - mu * 9.81 * t**2 / 2 + h / 2 * (v - mu * 9.81 * t), rel=1e-13)
    by = run.gradient(points={"body": (1, 0, 0)})
    ring, node = by.sliders["ring"], run._points["body"][0][0]
    assert by.velocities[node, 0] == pytest.approx(t + h / 2, rel=1e-11)
    assert ring.friction == pytest.approx(-9.81 * (t**2 / 2 + h / 2 * t), rel=1e-11)
    assert by.gravity[2] == pytest.approx(mu * (t**2 / 2 + h / 2 * t), rel=1e-11)
    pushes = np.where(np.arange(n) < moving, h**2 / m * (moving - np.arange(n) - 0.5) + h**2 / (2 * m), 0.0)
    np.testing.assert_allclose(ring.forces, pushes, rtol=0, atol=1e-12 * pushes[0])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["force", "position", "speed", "controller", "speed, slider", "controller, space"])
def test_drives_that_change_in_time(kind: str) -> None:
    """By a factor of what a drive gives."""
    def drive(f: float) -> fb.Drive:
        if kind.startswith("force"):
            return fb.Drive(force=lambda t: f * (2.0 + np.cos(9.0 * t)))
        if kind.startswith("position"):
            return fb.Drive(position=lambda t: 0.6 + f * t * t)
        if kind.startswith("speed"):
            return fb.Drive(speed=lambda t: f * 2.0 * t)
        return fb.Drive(position=lambda t: 0.6 + f * t, stiffness=200.0, damping=5.0)

    def build(f: float = 1.0, **values: Any) -> Any:
        return go(**{**values, "drive": drive(f)})

    flat = not kind.endswith("space")
    case, given = dict(mu=0.2, viscous=0.2, sleeve="slider" not in kind, flat=flat), weights(flat)
    run = build(**case)
    by = run.gradient(points=given)
    ring, t, h = by.sliders["ring"], run.t[:-1], STEP
    found = usual(run, by)
    if kind.startswith("force"):
        found["f"] = ring.forces @ (2.0 + (np.sin(9 * (t + h)) - np.sin(9 * t)) / (9 * h))
    elif kind.startswith("position"):
        found["f"] = ring.places @ (t + h)**2
    elif kind.startswith("speed"):
        found["f"] = ring.places @ ((t + h)**2 - t**2)
    else:
        found["f"] = ring.forces @ (200.0 * (t + 0.5 * h) + 5.0)
    check({**case, "f": 1.0}, found, given, build=build)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["auto", "sparse"])
@pytest.mark.parametrize("kind", ["slips, slider", "comes to rest, slider", "free, space, twist free", "slips, space, slider"])
def test_sliders_and_sleeves_in_space(kind: str, solver: str) -> None:
    flat = "space" not in kind
    case = dict(CASES[kind.split(",")[0]], flat=flat, sleeve="slider" not in kind, keyed="twist free" not in kind)
    given = weights(flat)
    run = go(**case)
    if solver == "sparse":
        # the same equations as one sparse matrix
        known = run.model.uneliminated
        object.__setattr__(run.model, "uneliminated", lambda planar, solver: known(planar=planar))
    check(case, usual(run, run.gradient(points=given)), given)


@pytest.mark.slow
@pytest.mark.parametrize("keyed", [True, False])
def test_a_telescope_that_flies(keyed: bool) -> None:
    """The holder is the end of a beam; moments of the sleeve turn with it and with the rod. By what does not change the initial
    velocities, which are projected in the norm of the masses."""
    def build(EI: float = 100.0, EA: float = 2e3, way: float = 3.0) -> Any:  # noqa: N803
        soft = fb.Section(EA=EA, GA2=1e3, GA3=1.2e3, GJ=80.0, EI2=EI, EI3=120.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
        wide = fb.Section(EA=3e3, GA2=2e3, GA3=2e3, GJ=300.0, EI2=200.0, EI3=200.0, rhoA=1.5, rhoI2=0.1, rhoI3=0.1)
        rod = fb.Beam.straight("a", (0, 0, 0), (3, 0, 0), section=soft, elements=3, degree=2)
        tube = fb.Beam.straight("tube", (-2, 0, 0), (0.7, 0, 0), section=wide, elements=2, degree=2, d2=(0, 0, 1))
        bob = fb.PointMass("bob", mass=0.8, position=(3, 0, 0))
        pull = fb.InitialVelocity(rod, velocity=lambda s: np.stack((-2.5 + 0 * s, 0 * s, 0 * s), axis=1))
        scene = fb.Scene(tube, rod, bob, fb.RigidConnection(rod.end, bob), pull,
                         fb.RigidMotion(spin=(0.5, 0.3, 0.9), velocity=(0.1, 0.2, 0.3)), fb.Clamp(tube.start),
                         fb.Sleeve("sleeve", tube.end, rod, at=0.7, keyed=keyed), fb.Load("way", rod.end, force=(0, way, 0)),
                         project_velocities=True)
        return fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points={"tip": rod.end, "body": tube.end})

    given, run = weights(False), build()
    by = run.gradient(points=given)
    assert run.outside == 0
    node = run._points["tip"][0][0]
    of = by.sections["a"].stiffness[0]
    values = dict(EI=100.0, EA=2e3, way=3.0)
    for name, found in (("EI", of[4, 4]), ("EA", of[0, 0]), ("way", by.forces[node, 1])):
        e = 2e-3 * values[name]
        around = [number(build(**{**values, name: values[name] + k * e}), given) for k in AWAY]
        assert found == pytest.approx(float(SIXTH @ np.array(around)) / e, rel=1e-8), name


def test_what_has_no_adjoint_is_named() -> None:
    scene, _ = bead(sleeve=False)
    a = scene.beams[0]
    b = fb.Beam.straight("b", (1, -1, 0), (1, 1, 0), section=a.section, elements=2)
    more = (b, fb.Crossing("touch", a, b, at=(1.0, 1.0)), fb.Load("thrust", b.end, force=(1, 0, 0), follower=True))
    with pytest.raises(fb.SceneError, match="the adjoint does not support follower load 'thrust', crossings of beams"):
        fb.adjoint_run(fb.compile_scene(fb.Scene(*scene.parts, *more)), t_end=0.1, step=0.1)


def test_a_slider_that_comes_to_the_end_of_its_beam_is_named() -> None:
    """2 m at 10 m/s from 0.6 m: before 0.14 s, in steps of 0.01 s."""
    with pytest.raises(fb.ConvergenceError, match=r"slider 'ring' reaches the end of its beam in this step.*End before that"):
        go(rate=10.0, sleeve=False)
