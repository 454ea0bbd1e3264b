"""Friction, drives and stops of contacts that elements move with (theory.md 5.12)."""
from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "study"))

STIFF = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=1e7, EI2=1e7, EI3=1e7, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
# so heavy that blows of the mass hardly move it; its energy has the round-off of places times its mass
HEAVY = replace(STIFF, rhoA=1e5, rhoI2=100.0, rhoI3=100.0)
MASS, START, RATE, END = 0.5, 0.8, 0.6, 0.5


def on_a_rail(gravity: tuple[float, float, float] = (0, 0, 0), axis: tuple[float, float, float] = (1, 0, 0), rate: float = RATE,
              section: fb.Section = STIFF, planar: str | bool = "auto", **acting: Any) -> fb.Model:
    """A mass on a rail that hardly bends, both ends clamped."""
    rail = fb.Beam.straight("rail", (0, 0, 0), 2.0 * np.asarray(axis), section=section, elements=4)
    mass = fb.PointMass("mass", mass=MASS)
    scene = fb.Scene(rail, mass, fb.Clamp(rail.start), fb.Clamp(rail.end), gravity=gravity)
    given = acting.get("drive")
    start = {} if given is not None and given.is_prescribed else {"rate": rate}
    scene.add(fb.Slider("run", mass, rail, at=START, **start, **acting))
    return fb.compile_scene(fb.with_moving_meshes(scene), planar=planar)


def run_of(model: fb.Model, step: float, t_end: float = END, **options: Any) -> fb.Result:
    result = fb.simulate(model, t_end=t_end, step=step, progress=False, **options)
    # on heavy rails waves take the momentum at once, which is told of
    assert not [x for x in result.events if x["kind"] in ("unresolved", "drift") and "hits a rigid stop" not in x["text"]]
    return result


C, K, D = 1.3, 40.0, 2.0
DECAY = D / (2.0 * MASS)
TURNS = np.sqrt(K / MASS - DECAY**2)
PUSH = 1.7


def damped(t: np.ndarray) -> np.ndarray:
    """About 1 m, from START with RATE."""
    x0 = START - 1.0
    return 1.0 + np.exp(-DECAY * t) * (x0 * np.cos(TURNS * t) + (RATE + DECAY * x0) / TURNS * np.sin(TURNS * t))


CASES = {
    "viscous": ({"friction": fb.Friction(viscous=C)}, lambda t: START + RATE * MASS / C * (1.0 - np.exp(-C * t / MASS))),
    "force": ({"drive": fb.Drive(force=lambda t: PUSH * np.sin(9.0 * t))},
              lambda t: START + RATE * t + PUSH / MASS * (t / 9.0 - np.sin(9.0 * t) / 81.0)),
    "law": ({"drive": fb.Drive(force=lambda t, s, rate: -K * (s - 1.0) - D * rate)}, damped),
    "controller": ({"drive": fb.Drive(position=1.0, speed=0.0, stiffness=K, damping=D)}, damped),
    "speed": ({"drive": fb.Drive(speed=lambda t: RATE + 2.0 * t)}, lambda t: START + RATE * t + t * t),
    "place": ({"drive": fb.Drive(position=lambda t: START + 0.2 * np.sin(3.0 * t)**2)},
              lambda t: START + 0.2 * np.sin(3.0 * t)**2),
}


@pytest.mark.parametrize("case", CASES)
def test_against_motions_of_one_coordinate(case: str) -> None:
    acting, exact = CASES[case]
    model = on_a_rail(**acting)
    off = []
    for step in (0.01, 0.005):
        result = run_of(model, step)
        run = result.slider("run")
        off.append(np.max(np.abs(run["s"] - exact(result.t))))
        assert result.drift("balance") < 1e-12
        # what moves it
        force = run["force_along"][1:-1]
        wanted = MASS * (run["s"][2:] - 2.0 * run["s"][1:-1] + run["s"][:-2]) / step**2
        late = slice(1, -1)
        assert np.max(np.abs(force - wanted)[late]) < 40.0 * step * max(1.0, np.max(np.abs(wanted)))
    print(f"{case}: off by {off}")
    assert off[0] < 2e-3 and (off[1] < 0.3 * off[0] or off[0] < 1e-11)


def test_books_of_what_acts() -> None:
    viscous = run_of(on_a_rail(friction=fb.Friction(viscous=C)), 0.005)
    run, balance = viscous.slider("run"), viscous.balance()
    lost = 0.5 * MASS * RATE**2 * (1.0 - np.exp(-2.0 * C * END / MASS))
    assert run["friction_loss"][-1] == pytest.approx(lost, rel=1e-4)
    assert "friction of slider 'run'" in balance and not [x for x in balance if "joint" in x]
    np.testing.assert_allclose(balance["sum"], balance["sum"][0], atol=1e-13)
    driven = run_of(on_a_rail(drive=fb.Drive(force=PUSH)), 0.005)
    run, balance = driven.slider("run"), driven.balance()
    assert run["drive_work"][-1] == pytest.approx(PUSH * (run["s"][-1] - START), rel=1e-12)
    np.testing.assert_allclose(run["drive_force"], PUSH, rtol=1e-12)
    np.testing.assert_allclose(balance["drive of slider 'run'"], -run["drive_work"], atol=1e-15)
    assert "drive of slider 'run'" in driven.table()


def test_an_elastic_stop_throws_it_back() -> None:
    stiffness = 500.0
    model = on_a_rail(stops=fb.Stops(end=1.0, stiffness=stiffness))
    contact = np.pi * np.sqrt(MASS / stiffness)
    reached = (1.0 - START) / RATE
    off = []
    for step in (0.004, 0.002):
        result = run_of(model, step, t_end=0.9)
        run = result.slider("run")
        back = result.t > reached + contact + step
        off.append(np.max(np.abs(run["s"][back] - (1.0 - RATE * (result.t[back] - reached - contact)))))
        assert result.drift("total") < 1e-12 and "stops" in result.balance()
        assert np.max(run["stop_energy"]) == pytest.approx(0.5 * MASS * RATE**2, rel=0.02)
        assert np.min(run["stop_force"]) == pytest.approx(-RATE * np.sqrt(stiffness * MASS), rel=0.02)
    print(f"off by {off}")
    assert off[0] < 2e-3 and off[1] < 0.5 * off[0]


@pytest.mark.parametrize("restitution", [0.0, 0.6, 1.0])
def test_a_rigid_stop(restitution: float) -> None:
    """It meets the stop at 1 m, and comes back as fast as the restitution says."""
    result = run_of(on_a_rail(section=HEAVY, planar=False, stops=fb.Stops(end=1.0, restitution=restitution)), 0.004, t_end=0.6)
    run, reached = result.slider("run"), (1.0 - START) / RATE
    wanted = np.minimum(START + RATE * result.t, 1.0) - restitution * RATE * np.maximum(result.t - reached, 0.0)
    lost = 0.5 * MASS * RATE**2 * (1.0 - restitution**2)
    print(f"off by {np.max(np.abs(run['s'] - wanted)):.1e}, lost {run['stop_loss'][-1]:.6g} of {lost:.6g} J")
    # a node of the rail has ten thousand times its mass, and energies of that much round-off
    assert np.max(np.abs(run["s"] - wanted)) < 1e-4 and result.drift("balance") < 2e-10
    assert run["stop_loss"][-1] == pytest.approx(lost, rel=2e-4, abs=1e-9)
    events = [x for x in result.events if x["kind"] == "impact"]
    assert [x["slider"] for x in events] == ["run"] and events[0]["time"] == pytest.approx(reached, abs=2e-5)


def test_what_waves_along_the_beam_take_is_told_of() -> None:
    """A body on a light rail that meets a stop on it: a wave takes its momentum within a step."""
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=STIFF, elements=4)
    body = fb.RigidBody("body", mass=MASS, inertia=(1, 1, 1), position=(START, 0, 0), velocity=(RATE, 0, 0))
    slider = fb.Slider("run", body, rail, at=START, rate=RATE, stops=fb.Stops(end=1.0))
    model = fb.compile_scene(fb.with_moving_meshes(fb.Scene(rail, body, fb.Clamp(rail.start), slider)))
    events = fb.simulate(model, t_end=0.4, step=0.004, progress=False).events
    assert [x for x in events if x["kind"] == "unresolved" and "= 1.6e-05 s" in x["text"]]


def test_what_pushes_against_a_rigid_stop_rests_there() -> None:
    model = on_a_rail(section=HEAVY, stops=fb.Stops(end=1.0), drive=fb.Drive(force=lambda t: 2.0 if t < 0.4 else -2.0))
    result = run_of(model, 0.004, t_end=0.6)
    run = result.slider("run")
    rests = (result.t > 0.32) & (result.t < 0.39)
    assert np.allclose(run["s"][rests], 1.0, rtol=0, atol=1e-8) and np.allclose(run["stop_force"][rests], -2.0, atol=1e-2)
    # the step in which the push turns has half of it
    assert run["s"][-1] == pytest.approx(1.0 - 0.5 * 2.0 / MASS * 0.04, rel=1e-2) and result.drift("balance") < 1e-10


@pytest.mark.parametrize("friction", [None, 0.2])
def test_rigid_stops_in_flight(friction: float | None) -> None:
    """Blows between what flies change no momentum, and the balance has what they take."""
    import scenes
    given = scenes.body_on_beam(elements=6, degree=3).scene
    slider = given.sliders[0]
    what = {"stops": fb.Stops(slider.at - 0.1, slider.at + 0.2, restitution=0.5), "friction": friction}
    parts = [replace(x, **what) if x is slider else x for x in given.parts]
    scene = fb.with_moving_meshes(fb.Scene(*parts, project_velocities=given.project_velocities))
    result = run_of(fb.compile_scene(scene), 0.01)
    drift = {x: result.drift(x) for x in ("balance", "lin_mom", "ang_mom")}
    s, hits = result.slider(slider.name)["s"], sum(x["kind"] == "impact" for x in result.events)
    print(f"{drift}, {hits} impacts, s to {s.max():.12g} of {slider.at + 0.2}")
    assert hits > 0 and s.max() <= slider.at + 0.2 + 1e-9 and s.max() > slider.at + 0.2 - 1e-6
    assert set(drift) <= set(result.info["conserved"]) and max(drift.values()) < 1e-12


@pytest.mark.parametrize("restitution", [1.0, 0.0])
def test_a_stop_on_a_beam_that_waves_in_flight_gives_no_energy(restitution: float) -> None:
    """Coarse steps, in which velocities are far from those of the momenta: with e = 1 nothing is lost, with e = 0 the contact is
    at rest behind the blow, too."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=fb.Section.circle(radius=0.02, E=1e6, rho=1000.0), elements=6,
                            interpolation="lagrange")
    bead = fb.PointMass("bead", mass=0.3, position=(1, 0, 0), velocity=(0.8, 0.2, 0.3))
    stops = fb.Stops(0.8, 1.15, restitution=restitution)
    scene = fb.Scene(beam, bead, fb.Slider("run", bead, beam, at=1.0, rate=0.8, stops=stops),
                     fb.InitialVelocity(beam, spin=(0, 0.5, 0.7)), project_velocities=True)
    result = run_of(fb.compile_scene(fb.with_moving_meshes(scene)), 2e-3, t_end=2.0, every=1)
    hits = [x["time"] for x in result.events if x["kind"] == "impact"]
    run, size = result.slider("run"), result.series["kinetic"][0]
    losses = np.diff(run["stop_loss"])
    assert len(hits) > (2 if restitution else 0) and result.drift("balance") < 1e-11
    assert np.min(losses) > -1e-14 * size
    if restitution:
        assert np.max(losses) < 1e-14 * size
    else:
        behind = (result.t > hits[0] - 1e-12) & (np.abs(run["s"] - 1.15) < 1e-12)
        assert run["stop_loss"][-1] > 1e-3 * size and behind.sum() > 3
        assert np.max(np.abs(run["slide_rate"][behind])) < 1e-12


@pytest.mark.parametrize(("restitution", "what"), [(0.5, "bead"), (0.0, "bead"), (0.5, "body"), (0.5, "friction"),
                                                   (0.0, "sleeve")])
def test_a_run_goes_on_behind_a_rigid_stop(restitution: float, what: str, tmp_path: Any) -> None:
    """Velocities of what is tied to a node of the mesh stay those of the node, which a start is tested for."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=fb.Section.circle(radius=0.02, E=1e6, rho=1000.0), elements=6,
                            interpolation="lagrange")
    motion: dict[str, Any] = dict(mass=0.3, position=(1, 0, 0), velocity=(0.8, 0.2, 0.3))
    bead = fb.PointMass("bead", **motion) if what == "bead" else fb.RigidBody("body", inertia=(0.01, 0.02, 0.03), **motion)
    contact: dict[str, Any] = dict(at=1.0, rate=0.8, stops=fb.Stops(0.8, 1.15, restitution=restitution),
                                   friction=0.2 if what == "friction" else None)
    slider = fb.Sleeve("run", bead, beam, **contact) if what == "sleeve" else fb.Slider("run", bead, beam, **contact)
    scene = fb.Scene(beam, bead, slider, fb.InitialVelocity(beam, spin=(0, 0.5, 0.7)), project_velocities=True)
    model = fb.compile_scene(fb.with_moving_meshes(scene))
    settings: dict[str, Any] = dict(t_end=0.3, step=2e-3, every=1, progress=False)
    whole = fb.simulate(model, **settings)
    hits = [int(np.argmin(np.abs(whole.t - x["time"]))) for x in whole.events if x["kind"] == "impact"]
    assert hits and whole.drift("balance") < 1e-11
    for n in (hits[0], hits[-1] + 5):
        assert_goes_on(model, whole, n, tmp_path / "c", settings)
    fb.simulate(model, start=whole.state, t_end=0.01, step=2e-3, progress=False)


def test_joints_with_rigid_stops_beside_a_moving_mesh() -> None:
    """A door that swings against its stop, while a bead slides on a cable."""
    door = fb.RigidBody("door", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.5, 3, 0), velocity=(0, 1.0, 0), spin=(0, 0, 2.0))
    stops = fb.Stops(end=0.3, restitution=0.5)
    hinge = fb.RevoluteJoint(fb.GROUND, door.point((-0.5, 0, 0)), "hinge", axis=(0, 0, 1), stops=stops)
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=STIFF, elements=4)
    mass = fb.PointMass("mass", mass=MASS)
    slider = fb.Slider("run", mass, rail, at=START, rate=RATE)
    scene = fb.Scene(door, hinge, rail, mass, fb.Clamp(rail.start), fb.Clamp(rail.end), slider)
    result = run_of(fb.compile_scene(fb.with_moving_meshes(scene)), 0.01)
    angle = result.joint("hinge")["angle"]
    wanted = np.where(2.0 * result.t < 0.3, 2.0 * result.t, 0.3 - (result.t - 0.15))
    # an angle turns by 2 atan(h w/2) in a step
    assert np.max(np.abs(angle - wanted)) < 2e-5 and result.drift("balance") < 1e-12
    assert np.max(np.abs(result.slider("run")["s"] - START - RATE * result.t)) < 1e-9


MU, GRAVITY = 0.3, 9.81


def test_friction_stops_it_where_it_should() -> None:
    off = []
    for step in (0.01, 0.005, 0.0025):
        result = run_of(on_a_rail((0, 0, -GRAVITY), friction=MU), step, t_end=0.4)
        run = result.slider("run")
        off.append(abs(run["s"][-1] - START - RATE**2 / (2.0 * MU * GRAVITY)))
        assert result.drift("balance") < 1e-12 and np.ptp(run["s"][-20:]) < 1e-13
        assert run["friction_loss"][-1] == pytest.approx(0.5 * MASS * RATE**2, rel=1e-3)
    print(f"where it stops off by {off}")
    assert off[2] < 1e-4


def test_smoothed_friction() -> None:
    """m dv/dt = -mu m g tanh(v/c): sinh(v/c) = sinh(v0/c) exp(-mu g t/c)."""
    smooth, off = 0.2, []
    for step in (0.01, 0.005):
        model = on_a_rail((0, 0, -GRAVITY), friction=fb.Friction(MU, smoothing=smooth))
        result = run_of(model, step, t_end=0.3)
        run = result.slider("run")
        wanted = smooth * np.arcsinh(np.sinh(RATE / smooth) * np.exp(-MU * GRAVITY * result.t / smooth))
        off.append(np.max(np.abs(run["slide_rate"] - wanted)))
        assert result.drift("balance") < 1e-12 and not [x for x in result.events if x["kind"] == "unresolved"]
    print(f"rates off by {off}")
    # the rail, which the weight comes upon at once, swings
    assert max(off) < 5e-4


def test_friction_where_a_drive_prescribes_the_motion() -> None:
    """The drive takes the friction besides what accelerates the mass; there and back."""
    model = on_a_rail((0, 0, -GRAVITY), friction=MU, drive=fb.Drive(position=lambda t: START + 0.2 * np.sin(3.0 * t)**2))
    result = run_of(model, 0.005, t_end=1.5)
    run, way = result.slider("run"), 0.2 * np.sin(3.0 * result.t)**2
    np.testing.assert_allclose(run["s"], START + way, atol=1e-12)
    lost = MU * MASS * GRAVITY * np.sum(np.abs(np.diff(way)))
    assert run["friction_loss"][-1] == pytest.approx(lost, rel=1e-3)
    kinetic = 0.5 * MASS * run["slide_rate"][-1]**2
    assert run["drive_work"][-1] == pytest.approx(run["friction_loss"][-1] + kinetic, rel=1e-3)
    assert result.drift("balance") < 1e-12
    total = run["friction_force"] + run["drive_force"]
    np.testing.assert_allclose(run["force_along"], total, atol=1e-12)


def test_what_sticks_on_an_incline_does_not_creep() -> None:
    angle = 0.95 * np.arctan(MU)
    along = np.cos(angle), 0.0, np.sin(angle)
    result = run_of(on_a_rail((0, 0, -GRAVITY), along, rate=0.0, friction=MU), 0.01, t_end=20.0, every=200)
    run = result.slider("run")
    # once the rail, which the weight comes upon at once, has come to rest against the friction
    assert np.ptp(run["s"]) < 1e-7 and np.ptp(run["s"][-5:]) < 1e-12
    steeper = np.arctan(2.0 * MU)
    along = np.cos(steeper), 0.0, np.sin(steeper)
    result = run_of(on_a_rail((0, 0, -GRAVITY), along, rate=0.0, friction=MU), 0.0025, t_end=0.4)
    pull = GRAVITY * (np.sin(steeper) - MU * np.cos(steeper))
    assert result.slider("run")["s"][-1] == pytest.approx(START - 0.5 * pull * 0.16, rel=2e-4)


@pytest.mark.parametrize("acting", ["viscous", "coulomb", "stops", "drive", "given"])
def test_momenta_in_flight(acting: str) -> None:
    """Nothing from outside: what acts along a beam is between it and what slides on it."""
    import scenes
    given = scenes.body_on_beam(elements=6, degree=3).scene
    slider = given.sliders[0]
    what = {"viscous": {"friction": fb.Friction(viscous=3.0)}, "coulomb": {"friction": 0.2},
            "stops": {"stops": fb.Stops(slider.at - 0.2, slider.at + 0.2, stiffness=2e3)},
            "drive": {"drive": fb.Drive(position=lambda t: slider.at + 0.1 * t, stiffness=300.0, damping=5.0)},
            "given": {"drive": fb.Drive(speed=lambda t: slider_rate(slider) * (1.0 + np.sin(2.0 * t)))}}[acting]
    parts = [replace(x, **what) if x is slider else x for x in given.parts]
    scene = fb.with_moving_meshes(fb.Scene(*parts, name=given.name, project_velocities=given.project_velocities))
    result = run_of(fb.compile_scene(scene), 0.01)
    kept = ("total" if acting == "stops" else "balance", "lin_mom", "ang_mom")
    drift = {x: result.drift(x) for x in kept}
    print(f"{acting}: {drift}, s from {slider.at} to {result.slider(slider.name)['s'][-1]:.4g}")
    assert set(kept) <= set(result.info["conserved"]) and max(drift.values()) < 1e-12


def slider_rate(slider: fb.Slider) -> float:
    return 0.4 if slider.rate is None else slider.rate


# a drive pushes against a stop
@pytest.mark.parametrize("acting", [{"friction": fb.Friction(0.2, viscous=0.5)},
                                    {"drive": fb.Drive(speed=-0.8, damping=4.0), "stops": fb.Stops(0.7, stiffness=300.0)}])
def test_meshes_that_stand_come_to_it(acting: dict[str, Any]) -> None:
    """A bead on a cantilever that bends under it."""
    section = fb.Section(EA=4e3, GA2=1.5e3, GA3=1.5e3, GJ=4, EI2=4, EI3=4, rhoA=1, rhoI2=0.01, rhoI3=0.01)

    def run(elements: int, moves: bool) -> np.ndarray:
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=section, elements=elements)
        bead = fb.PointMass("bead", mass=0.3)
        slider = fb.Slider("run", bead, beam, at=0.8, rate=0.5, **acting)
        scene = fb.Scene(beam, bead, fb.Clamp(beam.start), slider, gravity=(0, 0, -3.0), gravity_time=lambda t: np.sin(3 * t)**2)
        result = run_of(fb.compile_scene(fb.with_moving_meshes(scene) if moves else scene), 2e-3)
        assert result.drift("balance") < 1e-11
        found = result.slider("run")
        return np.array((found["s"][-1], *found["position"][-1]))

    wanted = run(16, True)
    near, off = np.abs(run(8, True) - wanted), np.abs(run(48, False) - wanted)
    print(f"{list(acting)}: 8 elements that move off by {near.max():.1e}, 48 that stand by {off.max():.1e}")
    assert abs(wanted[0] - 0.8) > 0.02
    assert near.max() < 2e-5 and off.max() < 2e-3


@pytest.mark.parametrize("keyed", [True, False])
def test_a_sleeve_that_rubs(keyed: bool) -> None:
    """Its moments press on the ends of its length; a body that hangs beside the rail."""
    arm, length = 0.4, 0.1

    def run(friction: float) -> fb.Result:
        rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=STIFF, elements=4)
        body = fb.RigidBody("body", mass=MASS, inertia=(0.01, 0.01, 0.01), position=(START + arm, 0, 0),
                            velocity=(RATE, 0, 0))
        scene = fb.Scene(rail, body, fb.Clamp(rail.start), fb.Clamp(rail.end), gravity=(0, 0, -GRAVITY))
        scene.add(fb.Sleeve("run", body.point((-arm, 0, 0)), rail, at=START, rate=RATE, friction=friction, length=length,
                            keyed=keyed))
        return run_of(fb.compile_scene(fb.with_moving_meshes(scene)), 0.002, t_end=0.1, observe=("energy", "slider", "reaction"))

    result = run(0.05)
    s = result.slider("run")
    # |F_n| = m g + 2 m g arm/length
    slows = 0.05 * GRAVITY * (1.0 + 2.0 * arm / length)
    off = np.max(np.abs(s["s"] - START - RATE * result.t + 0.5 * slows * result.t**2))
    print(f"keyed={keyed}: off by {off:.1e}")
    assert result.drift("balance") < 1e-12 and off < 1e-6
    assert np.abs(s["moment"][5:-5, 1]).mean() == pytest.approx(MASS * GRAVITY * arm, rel=1e-2)


def test_a_run_goes_on_from_a_checkpoint() -> None:
    model = on_a_rail((0, 0, -GRAVITY), friction=fb.Friction(0.1, viscous=0.2), stops=fb.Stops(end=0.9, stiffness=200.0))
    whole = run_of(model, 0.01)
    half = run_of(model, 0.01, t_end=0.25)
    rest = fb.simulate(model, start=half.checkpoint, t_end=END, step=0.01, progress=False)
    for name in ("q", "v", "history"):
        np.testing.assert_array_equal(getattr(rest.state, name), getattr(whole.state, name))


@pytest.mark.parametrize("acting, text", [
    ({"release": fb.Release(when=0.2)}, "has a release"),
    ({"one_sided": (0, 0, 1)}, "has one-sided contact")])
def test_what_elements_that_move_do_not_know(acting: dict[str, Any], text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        on_a_rail(rate=0.0, **acting)


def test_a_lock_takes_the_energy_and_gives_it_free() -> None:
    """It catches the mass at 1 m, and lets a force push it on after 0.5 s."""
    model = on_a_rail(section=HEAVY, lock=fb.Lock(at=1.0, until=0.5), drive=fb.Drive(force=lambda t: 2.0 if t > 0.4 else 0.0))
    result = run_of(model, 0.004, t_end=0.8)
    run = result.slider("run")
    held = (result.t > 0.335) & (result.t < 0.5)
    assert np.ptp(run["s"][held]) == 0.0 and run["s"][held][0] == pytest.approx(1.0, abs=1e-9)
    assert run["lock_loss"][-1] == pytest.approx(0.5 * MASS * RATE**2, rel=2e-4)
    assert run["s"][-1] == pytest.approx(1.0 + 0.5 * 2.0 / MASS * 0.3**2, abs=2e-4) and result.drift("balance") < 2e-10
    assert [x["kind"] for x in result.events] == ["locked", "unlocked"]


def test_a_bearing_that_rubs_brakes_the_spin() -> None:
    """A sleeve without key and with `radius=`, which meshes that stand have, too."""
    def run(moves: bool) -> fb.Result:
        ends = np.concatenate((np.linspace(0.0, 0.5, 9)[:-1], np.linspace(0.5, 2.0, 9))) if moves else 64
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=fb.Section.circle(radius=0.01, E=2e10, rho=2000.0),
                                elements=ends, degree=3)
        body = fb.RigidBody("body", mass=0.5, inertia=(1e-3, 1e-3, 1e-3), position=(0.5, 0, 0), velocity=(1.2, 0, 0),
                            spin=(10, 0, 0))
        sleeve = fb.Sleeve("run", body, beam, at=0.5, keyed=False, length=0.05, friction=0.2, radius=0.02, rate=1.2)
        mesh = [fb.MovingMesh(beam, sleeve)] if moves else []
        scene = fb.Scene(beam, body, fb.Clamp(beam.start), fb.Clamp(beam.end), sleeve, *mesh, gravity=(0, 0, -9.81))
        return fb.simulate(fb.compile_scene(scene), t_end=0.4, step=0.002, progress=False)

    one, other = run(True), run(False)
    assert one.drift("balance") < 1e-12 and one.slider("run")["twist"][-1] < -1.0
    for name, allowed in (("s", 2e-3), ("twist", 5e-3), ("friction_loss", 2e-3)):
        x, y = one.slider("run")[name], other.slider("run")[name]
        print(f"{name}: {x[-1]:.6g} and {y[-1]:.6g}")
        assert np.max(np.abs(x - y)) < allowed * np.max(np.abs(y))


def test_solvers_agree_on_straight_rails() -> None:
    """There a node that only multipliers hold moves along the rail with its place without changing anything."""
    ends = []
    for solver in ("auto", "sparse"):
        scene = fb.Scene(gravity=(0, 0, -1e-3))
        for y, name in ((0.0, "slider"), (1.0, "sleeve")):
            rail = fb.Beam.straight(f"rail of {name}", (0, y, 0), (2, y, 0), section=STIFF, elements=4)
            body = fb.RigidBody(f"body of {name}", mass=MASS, inertia=(0.01, 0.01, 0.01), position=(START, y, 0),
                                velocity=(RATE, 0, 0))
            options: dict[str, Any] = {"at": START, "rate": RATE, "friction": 0.3}
            slider = (fb.Slider(name, body, rail, **options) if name == "slider"
                      else fb.Sleeve(name, body, rail, length=0.1, **options))
            scene.add(rail, body, fb.Clamp(rail.start), fb.Clamp(rail.end), slider)
        result = run_of(fb.compile_scene(fb.with_moving_meshes(scene), solver=solver), 0.005)
        assert result.drift("balance") < 1e-12
        ends.append([result.slider(name)["s"] for name in ("slider", "sleeve")])
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-13)


@pytest.mark.parametrize("acting", [
    {"friction": 0.3}, {"friction": fb.Friction(0.3, smoothing=1e-2)}, {"friction": fb.Friction(viscous=2.0)},
    {"friction": 0.3, "drive": fb.Drive(speed=lambda t: RATE - t)}, {"friction": 0.3, "drive": fb.Drive(force=-2.0)}], ids=str)
def test_the_contact_force_is_what_the_mass_needs(acting: dict[str, Any]) -> None:
    """Friction and drives along the beam are a part of it, and count once."""
    model = on_a_rail(gravity=(0, 0, -9.81), **acting)
    result = run_of(model, 0.002, t_end=0.2, observe=("energy", "slider", "reaction"))
    run = result.slider("run")
    late = slice(5, -5)
    rate = np.gradient(run["slide_rate"], result.t)[late]
    assert np.max(np.abs(run["force"][late, 0] - MASS * rate)) < 0.02 and np.ptp(run["force"][late, 0]) + abs(rate[0]) > 0.3
    assert np.allclose(run["force"][late, 0], run["force_along"][late], rtol=0, atol=0.02)
    assert np.allclose(np.mean(run["force"][late, 2]), 9.81 * MASS, rtol=0.02)


def test_a_sleeve_that_rubs_comes_to_rest_as_prescribed() -> None:
    """Friction has no side where a given motion rests; the gap of the drive stays at round-off."""
    def way(t: float) -> float:
        x = min(max((t - 0.05) / 0.2, 0.0), 1.0)
        return 0.6 - 0.1 * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)

    section = fb.Section.circle(radius=0.012, E=70e9, rho=2700.0)
    tube = fb.Beam.straight("tube", (0, 0, 0), (1, 0, 0), section=section, elements=4)
    rod = fb.Beam.straight("rod", (0.4, 0, 0), (1.8, 0, 0), section=section, elements=8)
    sleeve = fb.Sleeve("in", tube.end, rod, at=0.6, length=0.1, friction=0.2, drive=fb.Drive(position=way))
    load = fb.Load("tip", rod.end, force=(0, 1.0, -2.0), time=lambda t: min(10.0 * t, 1.0))
    scene = fb.Scene(tube, rod, fb.Clamp(tube.start), sleeve, load, gravity=(0, 0, -9.81),
                     gravity_time=lambda t: min(10.0 * t, 1.0))
    for some in (fb.with_moving_meshes(scene), scene):
        result = run_of(fb.compile_scene(some), 0.002, t_end=0.35)
        run = result.slider("in")
        assert np.max(np.abs(run["s"] - [way(t) for t in result.t])) < 1e-14
        rests, moves = result.t > 0.252, (result.t > 0.06) & (result.t < 0.24)
        assert np.all(run["friction_force"][rests] == 0.0) and np.min(np.abs(run["friction_force"][moves])) > 0.1
        assert result.drift("balance") < 1e-12


def test_a_run_goes_on_from_a_state_in_which_all_has_come_to_rest() -> None:
    slope = np.radians(10.0)
    model = on_a_rail(gravity=(-9.81 * np.sin(slope), 0, -9.81 * np.cos(slope)), friction=0.4)
    first = run_of(model, 0.002, t_end=0.6)
    there = first.slider("run")["s"][-1]
    assert abs(there - START) > 0.01 and first.slider("run")["slide_rate"][-1] == pytest.approx(0.0, abs=1e-9)
    later = run_of(model, 0.002, t_end=0.7, start=fb.Start(first.state, time=float(first.t[-1])))
    assert later.slider("run")["s"][-1] == pytest.approx(there, abs=1e-12) and not later.events


def test_a_point_mass_that_meets_a_stop_on_a_light_bar_is_told_of() -> None:
    model = on_a_rail(stops=fb.Stops(end=1.0))
    events = fb.simulate(model, t_end=0.4, step=0.004, progress=False).events
    assert [x for x in events if x["kind"] == "unresolved" and "= 1.6e-05 s" in x["text"]]


def test_balance_is_recorded_with_elastic_stops_alone() -> None:
    elastic = run_of(on_a_rail(stops=fb.Stops(end=1.0, stiffness=500.0)), 0.004, t_end=0.6)
    assert elastic.drift("balance") < 1e-12 and elastic.drift("total") < 1e-12


def test_what_elements_that_move_do_not_know_is_said_of_them_first() -> None:
    model = on_a_rail(gravity=(0, 0, -9.81), friction=0.2)
    for call in (lambda: fb.simulate(model, t_end=0.1, step=0.01, method=fb.Method(rho_inf=0.8)),
                 lambda: fb.simulate(model, t_end=0.1, step=0.01, method="generalized_alpha")):
        with pytest.raises(fb.SceneError, match="moving mesh with slider 'run'.*moving elements"):
            call()
    with pytest.raises(fb.SceneError, match="its drive begins at .* 0.7 m, but the slider at 0.8 m"):
        fb.simulate(on_a_rail(drive=fb.Drive(position=lambda t: 0.7)), t_end=0.1, step=0.01)


@pytest.mark.parametrize(("rate", "step"), [(0.6, 0.01), (3.0, 0.001), (8.0, 0.001), (-30.0, 0.0002)])
@pytest.mark.parametrize("friction", [None, 0.1])
def test_a_run_ends_at_the_end_of_the_beam(rate: float, step: float, friction: float | None) -> None:
    result = run_of(on_a_rail(rate=rate, friction=friction), step, t_end=3.0)
    event, end = result.events[-1], "end" if rate > 0.0 else "start"
    assert event["kind"] == "slider_end" and f"reached the {end} of its beam" in event["text"]
    assert result.slider("run")["s"][-1] == pytest.approx(2.0 if rate > 0.0 else 0.0, abs=1e-9)
    assert result.t[-1] == pytest.approx(((2.0 if rate > 0.0 else 0.0) - START) / rate, abs=0.01 * step)
    assert result.drift("balance" if friction else "total") < 1e-11


def test_a_run_from_an_equilibrium_on_a_mesh_that_stands_stays_at_rest() -> None:
    section = fb.Section.circle(radius=0.01, E=1e8, rho=2000.0)
    cable = fb.Beam.straight("cable", (0, 0, 0), (2, 0, 0), section=section, elements=np.array([0.0, 0.4, 0.8, 1.2, 1.6, 2.0]))
    ring = fb.PointMass("ring", mass=0.2)
    slider = fb.Slider("run", ring, cable, at=0.8, friction=0.8)
    parts = [cable, ring, fb.Clamp(cable.start), fb.Clamp(cable.end), slider]
    rest = fb.solve_static(fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -9.81))), held=True)
    model = fb.compile_scene(fb.Scene(*parts, fb.MovingMesh(cable, slider), gravity=(0, 0, -9.81)))
    result = fb.simulate(model, t_end=0.2, step=0.002, start=rest.state_for(model), progress=False)
    run = result.slider("run")
    print(f"rate {np.max(np.abs(run['slide_rate'])):.1e} m/s, kinetic {np.max(result.series['kinetic']):.1e} J")
    assert np.ptp(run["s"]) < 1e-9 and np.max(result.series["kinetic"]) < 1e-15 and not result.events
