"""Equilibria and modes of scenes whose elements move with contacts (theory.md 5.12): against beams that end at the contact, meshes
with an element end there, and runs."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb

ROPE = fb.Section.circle(radius=0.01, E=1e8, rho=2000.0)
ROD = fb.Section.circle(radius=0.01, E=2e9, rho=2000.0)


def meshed(length: float, places: tuple[float, ...], each: int) -> np.ndarray:
    """Element ends of a beam with as many elements between all contacts."""
    fixed = (0.0, *places, length)
    return np.concatenate([np.linspace(a, b, each + 1)[:-1] for a, b in zip(fixed[:-1], fixed[1:])] + [[length]])


def on_a_rope(each: int, places: tuple[float, ...], masses: tuple[float, ...], moves: bool = True, spring: bool = False,
              friction: float | None = None) -> fb.Scene:
    """Rings on a heavy rope of 2 m between two clamps."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (2, 0, 0), section=ROPE, elements=meshed(2.0, places, each), degree=3)
    rings = [fb.PointMass(f"ring {k}", mass=mass) for k, mass in enumerate(masses)]
    sliders = [fb.Slider(f"run {k}", ring, rope, at=at, friction=friction) for k, (ring, at) in enumerate(zip(rings, places))]
    more = [fb.Spring(*rings, name="spring", stiffness=20.0, length=0.5)] if spring else []
    mesh = [fb.MovingMesh(rope, sliders)] if moves else []
    return fb.Scene(rope, *rings, fb.Clamp(rope.start), fb.Clamp(rope.end), *sliders, *more, *mesh, gravity=(0, 0, -9.81))


def test_a_ring_rests_in_the_middle_and_swings_there_as_on_fine_meshes() -> None:
    """A mesh that stands is off by 3e-4 m and by 2 % of the frequency on 24 elements."""
    found = []
    for each in (4, 8, 12):
        model = fb.compile_scene(on_a_rope(each, (0.9,), (0.2,)))
        rest = fb.solve_static(model)
        assert rest.slider("run 0")["s"][-1] == pytest.approx(1.0, abs=1e-10) and not rest.events
        np.testing.assert_allclose(rest.slider("run 0")["force"][-1], (0, 0, 0.2 * 9.81), atol=1e-9)
        found.append(fb.modes(model, state=rest.state, n=4).frequencies)
    off = np.abs(np.array(found[:2]) / found[2] - 1.0).max(axis=1)
    print(f"frequencies of 8 and 16 elements off by {off}")
    assert off[0] < 3e-5 and off[1] < 3e-6


def test_a_run_has_the_frequency_of_the_modes() -> None:
    model = fb.compile_scene(on_a_rope(6, (0.9,), (0.2,)))
    rest = fb.solve_static(model)
    modes = fb.modes(model, state=rest.state, n=1)
    run = fb.simulate(model, start=modes.state(0, 0.01), t_end=9.0, step=0.01, progress=False)
    s = run.slider("run 0")["s"] - 1.0
    k = np.flatnonzero(s[:-1] * s[1:] < 0.0)
    passes = run.t[k] - s[k] * np.diff(run.t)[k] / np.diff(s)[k]
    print(f"half a period {np.diff(passes)}, of the mode {0.5 / modes.frequencies[0]}; drift {run.drift('total'):.1e}")
    np.testing.assert_allclose(np.diff(passes), 0.5 / modes.frequencies[0], rtol=5e-5)
    assert run.drift("total") < 1e-12 and not run.events


def test_several_rings_rest_where_contacts_on_element_ends_have_them() -> None:
    """`contacts="exact"` compiles the scene anew with element ends at the contacts."""
    exact = fb.solve_static(fb.compile_scene(on_a_rope(12, (0.6, 1.3), (0.2, 0.1), moves=False, spring=True)), contacts="exact")
    wanted = [exact.slider(f"run {k}")["s"][-1] for k in (0, 1)]
    off = []
    for each in (3, 6):
        rest = fb.solve_static(fb.compile_scene(on_a_rope(each, (0.6, 1.3), (0.2, 0.1), spring=True)))
        off.append(max(abs(rest.slider(f"run {k}")["s"][-1] - wanted[k]) for k in (0, 1)))
    print(f"9 and 18 elements: places off by {off} m")
    assert off[0] < 1e-5 and off[1] < 1e-6


def rod_in_a_sleeve(at: float, force: float, **options: object) -> fb.Scene:
    """A rod of 1 m in a sleeve of no length that stands, with a force across at its end."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=ROD, elements=meshed(1.0, (at,), 5), degree=3)
    holder = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=(at, 0, 0))
    sleeve = fb.Sleeve("sleeve", holder, rod, at=at, length=0.0, keyed=True)
    return fb.Scene(rod, holder, fb.Clamp(holder), sleeve, fb.Load("push", rod.end, force=(0, 0, force)),
                    fb.MovingMesh(rod, sleeve))


def cantilever(length: float, force: float) -> fb.Scene:
    rod = fb.Beam.straight("rod", (0, 0, 0), (length, 0, 0), section=ROD, elements=12, degree=3)
    return fb.Scene(rod, fb.Clamp(rod.start), fb.Load("push", rod.end, force=(0, 0, force)))


@pytest.mark.parametrize("at", [0.05, 0.303, 0.45, 0.62])
def test_a_rod_beyond_a_sleeve_is_a_cantilever(at: float) -> None:
    """Tip and frequency; with the default bore the tip is off by 22 to 4 %."""
    model, alone = (fb.compile_scene(x) for x in (rod_in_a_sleeve(at, 1.0), cantilever(1.0 - at, 1.0)))
    tip, wanted = (fb.solve_static(x, **options).state.q.reshape(-1, 12)[x.names["beams"][0]["count"] - 1, 2]
                   for x, options in ((model, {"held": True}), (alone, {})))
    model, alone = (fb.compile_scene(x) for x in (rod_in_a_sleeve(at, 0.0), cantilever(1.0 - at, 0.0)))
    found, lowest = fb.modes(model, held=True, n=12).frequencies, fb.modes(alone, n=1).frequencies[0]
    off = abs(tip / wanted - 1.0), float(np.min(np.abs(found / lowest - 1.0)))
    print(f"{1.0 - at:.3g} m are free: tip and frequency off by {off}")
    assert max(off) < 1e-5
    # it may slide
    assert fb.modes(model, n=1).frequencies[0] < 1e-3


def on_an_incline(angle: float, coefficient: float) -> fb.Scene:
    axis = np.array((np.cos(angle), 0.0, np.sin(angle)))
    rail = fb.Beam.straight("rail", (0, 0, 0), 2.0 * axis, section=fb.Section.circle(radius=0.05, E=2e11, rho=7800.0), elements=8,
                            degree=3)
    mass = fb.PointMass("mass", mass=1.0)
    slider = fb.Slider("run", mass, rail, at=1.0, friction=coefficient)
    return fb.Scene(rail, mass, fb.Clamp(rail.start), fb.Clamp(rail.end), slider, fb.MovingMesh(rail, slider),
                    gravity=(0, 0, -9.81))


def test_friction_holds_up_to_its_angle() -> None:
    coefficient, angle = 0.3, np.arctan(0.3)
    model = fb.compile_scene(on_an_incline(0.999 * angle, coefficient))
    rest = fb.solve_static(model)
    found = rest.info["friction"]["run"]
    # the rail sags by 2e-4 rad
    assert found["sticks"] and found["force"] == pytest.approx(9.81 * np.sin(0.999 * angle), rel=2e-3)
    assert found["cone"] == pytest.approx(coefficient * 9.81 * np.cos(0.999 * angle), rel=1e-3)
    run = fb.simulate(model, start=rest.state, t_end=0.2, step=0.01, progress=False)
    assert np.ptp(run.slider("run")["s"]) < 1e-12
    with pytest.raises(fb.ConvergenceError, match="slider 'run' leaves its beam"):
        fb.solve_static(fb.compile_scene(on_an_incline(1.01 * angle, coefficient)))


def test_rings_with_friction_rest_where_meshes_with_an_element_end_have_them() -> None:
    """A ring that slips comes to rest on the rope before the lowest point."""
    places = []
    for moves in (True, False):
        scene = on_a_rope(12, (0.7,), (0.2,), moves, friction=0.01)
        places.append(fb.solve_static(fb.compile_scene(scene), **({} if moves else {"contacts": "exact"})).slider("run 0")["s"][-1])
    print(f"at rest at {places}")
    assert abs(places[0] - places[1]) < 1e-6 and 0.75 < places[0] < 0.999


def test_an_equilibrium_at_half_of_the_weight() -> None:
    """The weight of moving elements has the load factor."""
    model = fb.compile_scene(on_a_rope(6, (0.9,), (0.2,)))
    half = fb.solve_static(model, load_step=0.5)
    light = fb.Scene(*on_a_rope(6, (0.9,), (0.2,)).parts, gravity=(0, 0, -0.5 * 9.81))
    alone = fb.solve_static(fb.compile_scene(light))
    k = int(np.argmin(np.abs(half.t - 0.5)))
    assert half.t[k] == pytest.approx(0.5)
    assert half.slider("run 0")["position"][k, 2] == pytest.approx(alone.slider("run 0")["position"][-1, 2], abs=1e-9)
