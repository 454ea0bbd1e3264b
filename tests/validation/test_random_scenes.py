"""Random scenes keep their invariants, and block elimination and the sparse solver agree."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fastbeam as fb

STEPS = 15


def random_section(rng: np.random.Generator) -> fb.Section:
    """Stiffnesses over three decades, inertias over two; coupled in three of ten."""
    inertia = dict(rhoA=10**rng.uniform(-1, 1), rhoI2=10**rng.uniform(-3, 0), rhoI3=10**rng.uniform(-3, 0))
    if rng.random() < 0.3:
        a = rng.standard_normal((6, 6))
        return fb.Section.from_matrix((a @ a.T + 6 * np.eye(6)) * 10**rng.uniform(1, 3), **inertia)
    return fb.Section(**{name: 10**rng.uniform(1, 4) for name in ("EA", "GA2", "GA3", "GJ", "EI2", "EI3")}, **inertia)


def random_beam(rng: np.random.Generator, name: str) -> fb.Beam:
    """Straight and twisted, a helix, or through points; any family, degree and strain set."""
    family = str(rng.choice(["lagrange", "bspline"]))
    common = dict(section=random_section(rng), elements=int(rng.integers(2, 9)), interpolation=family,
                  degree=int(rng.integers(1, 6) if family == "lagrange" else rng.integers(2, 5)),
                  strain=str(rng.choice(["simo_reissner", "green_lagrange"])))
    if family == "bspline":
        common["directors"] = str(rng.choice(["greville", "control"]))
    start = rng.standard_normal(3)
    kind = rng.integers(0, 3)
    if kind == 0:
        return fb.Beam.straight(name, start, 3 * rng.standard_normal(3) + (4, 0, 0), twist=rng.uniform(-2, 2), **common)
    if kind == 1:
        return fb.Beam.helix(name, radius=rng.uniform(0.5, 2), pitch=rng.uniform(0.2, 2), turns=rng.uniform(0.2, 1), center=start,
                             **common)
    return fb.Beam.through_points(name, np.cumsum(np.abs(rng.standard_normal((4, 3))) + 0.2, axis=0) + start, **common)


def random_scene(seed: int) -> tuple[fb.Scene, float]:
    """One to three beams, perhaps a body and joints, up to three sliding masses, all in motion; and a step size."""
    rng = np.random.default_rng(seed)
    beams = [random_beam(rng, f"beam {k}") for k in range(rng.integers(1, 4))]
    parts: list[object] = list(beams)
    if rng.random() < 0.6:
        tip = beams[0].reference(beams[0].length)[0][0]
        body = fb.RigidBody("body", mass=10**rng.uniform(-1, 1), inertia=(1, 1.3, 1.6),
                            position=tip + 0.3 * rng.standard_normal(3))
        parts += [body, fb.RigidConnection(beams[0].end, body)]
        if len(beams) > 1 and rng.random() < 0.5:
            parts.append(fb.BallJoint(beams[1].start, body.point(beams[1].reference(0.0)[0][0] - body.position)))
    if len(beams) > 2 and rng.random() < 0.5:
        parts.append(fb.RigidConnection(beams[1].end, beams[2].start))
    for k in range(rng.integers(0, 4)):
        beam = beams[rng.integers(0, len(beams))]
        mass = fb.PointMass(f"mass {k}", mass=10**rng.uniform(-2, 1))
        parts += [mass, fb.Slider(f"slider {k}", mass, beam, at=beam.length * rng.uniform(0.25, 0.75), rate=rng.uniform(-1, 1),
                                  curve=str(rng.choice(["own", "c1"])))]
    parts.append(fb.RigidMotion(velocity=0.5 * rng.standard_normal(3), spin=0.7 * rng.standard_normal(3)))
    return fb.Scene(*parts, project_velocities=True), float(10**rng.uniform(-2.5, -1.3))


def check(seed: int) -> None:
    """Drifts at round-off with both solvers, and the same state."""
    scene, step = random_scene(seed)
    results = [fb.simulate(fb.compile_scene(scene, solver=solver), t_end=STEPS * step, step=step, every=5)
               for solver in ("auto", "sparse")]
    for result in results:
        assert result.info["steps"] == STEPS
        assert result.info["fallbacks"] == 0
        for name in ("total", "lin_mom", "ang_mom"):
            assert result.drift(name) < 1e-12, name
        if "gap" in result.series:
            assert result.drift("gap") < 1e-14
    # 15 steps amplify round-off of two solvers; measured up to 1e-13
    np.testing.assert_allclose(results[0].state.q, results[1].state.q, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("seed", [2, 5, 11])
def test_random_scene_conserves_with_both_solvers(seed: int) -> None:
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 120))
def test_many_random_scenes_conserve_with_both_solvers(seed: int) -> None:
    check(seed)


def with_forces(scene: fb.Scene, rng: np.random.Generator) -> fb.Scene:
    """The scene with friction, drives and stops on its sliders."""
    def forces(length: float) -> dict[str, object]:
        out: dict[str, object] = {}
        kind = rng.integers(0, 6)
        if kind < 4 and rng.random() < 0.8:
            out["friction"] = float(rng.uniform(0, 0.8))
        if kind == 1:
            out["drive"] = fb.Drive(force=float(rng.normal()))
        elif kind == 2:
            out["drive"] = fb.Drive(force=lambda t, s, rate: np.sin(30.0 * t) - 0.5 * rate)
        elif kind == 3:
            out["stops"] = fb.Stops(0.2 * length, 0.8 * length, stiffness=10**rng.uniform(1, 4))
        elif kind == 4:
            out["drive"] = fb.Drive(speed=float(rng.uniform(-1, 1)))
            out["rate"] = None
        elif kind == 5:
            out["stops"] = fb.Stops(0.2 * length, 0.8 * length, restitution=float(rng.uniform(0, 1)))
        return out

    parts = [replace(part, **forces(part.beam.length)) if isinstance(part, fb.Slider) else part for part in scene.parts]
    return fb.Scene(*parts, project_velocities=True)


def check_forces(seed: int) -> None:
    """The balance of energies and the momenta, and friction that takes energy only."""
    scene, step = random_scene(seed)
    if not scene.sliders:
        return
    model = fb.compile_scene(with_forces(scene, np.random.default_rng(seed)))
    result = fb.simulate(model, t_end=STEPS * step, step=step, every=1)
    assert result.info["fallbacks"] == 0
    if "balance" not in result.series:
        # no slider has drawn any
        return
    for name in ("balance", "lin_mom", "ang_mom"):
        assert result.drift(name) < 1e-11, name
    assert result.drift("gap") < 1e-14
    loss = result.series["friction_loss"]
    # a drive that prescribes the motion is no friction, one of (t, s, rate) has an account of its own
    assert np.all(np.diff(loss, axis=0) >= -1e-12 * max(1.0, float(np.max(np.abs(loss)))))


@pytest.mark.parametrize("seed", [2, 5, 11])
def test_random_scene_with_forces_along_its_beams_keeps_the_balance(seed: int) -> None:
    check_forces(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 116))
def test_many_random_scenes_with_forces_along_their_beams(seed: int) -> None:
    check_forces(seed)


def with_events(scene: fb.Scene, rng: np.random.Generator, t_end: float) -> fb.Scene:
    """The scene with sliders that are locked, let go, leave their beams, lift off and come back."""
    def events(length: float) -> dict[str, object]:
        out: dict[str, object] = {}
        times = np.sort(rng.uniform(0.0, t_end, 2))
        kind = rng.integers(0, 7)
        if rng.random() < 0.4:
            out["friction"] = float(rng.uniform(0, 0.8))
        if kind == 0:
            out["lock"], out["rate"] = fb.Lock(until=times[0]), None
        elif kind == 1:
            out["lock"] = [fb.Lock(times[0], until=times[1]), fb.Lock(lambda t, s, rate: abs(rate) > 0.01)]
        elif kind == 2:
            out["stops"] = fb.Stops(0.2 * length, 0.8 * length, restitution=float(rng.uniform(0, 1)))
            out["lock"] = fb.Lock("stop")
        elif kind == 3:
            limit = float(rng.uniform(0.1, 0.9)) * t_end
            out["lock"] = fb.Lock(lambda t, s, rate: t**2 - limit**2 + 1e-3 * np.sin(s))
        elif kind == 4:
            out["release"] = fb.Release(times[1])
        elif kind > 4:
            out["one_sided"] = fb.OneSided(rng.standard_normal(3), restitution=float(rng.uniform(0, 1)))
        return out

    parts = [replace(part, **events(part.beam.length)) if isinstance(part, fb.Slider) else part for part in scene.parts]
    return fb.Scene(*parts, project_velocities=True)


def check_events(seed: int, draw: int, solvers: tuple[str, ...] = ("auto",)) -> int:
    """Balance and momenta through all events of one draw; how many there were."""
    scene, step = random_scene(seed)
    if not scene.sliders:
        return 0
    results = []
    for solver in solvers:
        model = fb.compile_scene(with_events(scene, np.random.default_rng([seed, draw]), STEPS * step), solver=solver)
        result = fb.simulate(model, t_end=STEPS * step, step=step, every=1)
        assert result.info["fallbacks"] == 0 and result.t[-1] > (STEPS - 1) * step
        if "balance" not in result.series:
            return 0
        for name in ("balance", "lin_mom", "ang_mom"):
            assert result.drift(name) < 1e-11, name
        results.append(result)
    for result in results[1:]:
        np.testing.assert_allclose(result.state.q, results[0].state.q, rtol=0.0, atol=1e-8)
    return len(results[0].events)


def test_random_scenes_with_locks_releases_and_one_sided_contact_keep_the_balance() -> None:
    assert sum(check_events(2, draw) for draw in range(8)) > 8


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 105))
def test_many_random_scenes_with_locks_releases_and_one_sided_contact(seed: int) -> None:
    for draw in range(4):
        check_events(seed, draw, ("auto", "sparse"))


def with_sleeves(scene: fb.Scene, rng: np.random.Generator) -> fb.Scene:
    """The scene with sleeves of bodies, turned at random, in the place of its sliding masses."""
    parts: list[object] = []
    for part in scene.parts:
        if isinstance(part, fb.Slider):
            place = part.beam.reference(part.at)[0][0]
            turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
            body = fb.RigidBody(f"holder of {part.name}", mass=10**rng.uniform(-1, 1), inertia=0.1 * rng.uniform(0.6, 1.0, 3),
                                position=place, directors=turn * np.sign(np.linalg.det(turn)))
            bore = [None, 0.0, float(rng.uniform(0.03, 0.3)) * part.beam.length][rng.integers(0, 3)]
            parts += [body, fb.Sleeve(part.name, body, part.beam, at=part.at, rate=part.rate, curve=part.curve, length=bore,
                                      keyed=bool(rng.integers(0, 2)))]
        elif not isinstance(part, fb.PointMass):
            parts.append(part)
    return fb.Scene(*parts, project_velocities=True)


def check_sleeves(seed: int) -> None:
    """As `check`, with sleeves; and there and back."""
    scene, step = random_scene(seed)
    if not scene.sliders:
        return
    scene = with_sleeves(scene, np.random.default_rng(seed))
    model = fb.compile_scene(scene)
    result = fb.simulate(model, t_end=STEPS * step, step=step, every=5)
    assert result.info["steps"] == STEPS and result.info["fallbacks"] == 0
    for name in ("total", "lin_mom", "ang_mom"):
        assert result.drift(name) < 1e-12, name
    assert result.drift("gap") < 1e-14
    back = fb.simulate(model, t_end=STEPS * step, step=step, every=5, start=result.state._replace(v=-result.state.v))
    np.testing.assert_allclose(back.state.q, model.q0, rtol=0.0, atol=1e-9)
    other = fb.simulate(fb.compile_scene(scene, solver="sparse"), t_end=STEPS * step, step=step, every=5)
    np.testing.assert_allclose(result.state.q, other.state.q, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("seed", [5, 11])
def test_random_scene_with_sleeves_conserves_with_both_solvers(seed: int) -> None:
    check_sleeves(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 116))
def test_many_random_scenes_with_sleeves(seed: int) -> None:
    check_sleeves(seed)
