"""Small vibrations of scenes whose sliders have friction, drives and stops, against closed forms and runs in time."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.contact.slider_forces import AGAINST, HELD, HISTORY, LOCKED, STICKS

sys.path.insert(0, str(Path(__file__).parent))
from test_slider_forces import STIFF, G, rigid_rail  # noqa: E402

Array = np.ndarray
MASS = 0.01
STRING = fb.Section(EA=2e4, GA2=2e4, GA3=2e4, GJ=0.1, EI2=0.05, EI3=0.05, rhoA=0.05, rhoI2=1e-5, rhoI3=1e-5)


def pair(mass: float, damping: float, stiffness: float) -> complex:
    """The root of m r^2 + c r + k with positive imaginary part, or the smaller one."""
    found = np.roots([mass, damping, stiffness])
    return complex(found[np.argmax(found.imag)] if np.any(found.imag) else found[np.argmin(np.abs(found))])


def rail_with_sleeve(**forces: Any) -> fb.Model:
    """A body whose sleeve slides on a rail of 4 m, all nodes of which are clamped, along an incline in space."""
    along = np.array([2.0, 1.0, 2.0]) / 3.0
    rail = fb.Beam.straight("rail", (0, 0, 0), tuple(4.0 * along), section=STIFF, elements=4)
    body = fb.RigidBody("body", mass=MASS, inertia=(1e-5, 2e-5, 3e-5), position=tuple(along))
    clamps = [fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)]
    sleeve = fb.Sleeve("s", body, rail, at=1.0, keyed=True, length=0.1, **forces)
    return fb.compile_scene(fb.Scene(rail, body, *clamps, sleeve, gravity=(0, 0, -G)))


# --- closed forms -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("damping", [0.0, 0.03, 0.5])
@pytest.mark.parametrize("where", ["plane", "space", "sleeve"])
def test_a_controller_is_a_spring_and_a_damper(where: str, damping: float) -> None:
    drive = fb.Drive(position=2.0, stiffness=0.5, damping=damping)
    model = rail_with_sleeve(drive=drive) if where == "sleeve" else rigid_rail(30.0, 1.0, where == "plane", drive=drive)
    rest = fb.solve_static(model)
    found = fb.modes(model, state=rest.state, n=1)
    assert found.angular[0] == pytest.approx(np.sqrt(0.5 / MASS), rel=1e-11) and found.is_complete
    assert found.info["held_sliders"] == [] and abs(found.slides[0, 0]) == pytest.approx(1.0, rel=1e-11)
    rates = fb.modes(model, state=rest.state, n=1, damped=True).rates
    assert np.min(np.abs(rates - pair(MASS, damping, 0.5))) < 1e-10 * abs(rates[0])
    assert len(rates) == (2 if damping > 2.0 * np.sqrt(MASS * 0.5) else 1)


def test_a_driven_bead_responds_as_an_oscillator() -> None:
    a, stiff, damping, viscous = np.radians(30.0), 0.5, 0.02, 0.01
    rail = fb.Beam.straight("rail", (0, 0, 0), (4 * np.cos(a), 0, 4 * np.sin(a)), section=STIFF, elements=4)
    bead = fb.PointMass("bead", mass=MASS)
    clamps = [fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)]
    drive = fb.Drive(position=2.0, stiffness=stiff, damping=damping)
    model = fb.compile_scene(fb.Scene(rail, bead, *clamps, fb.Slider(
        "s", bead, rail, at=1.0, drive=drive, friction=fb.Friction(viscous=viscous)), gravity=(0, 0, -G)))
    rest, f = fb.solve_static(model), np.array([0.0, 0.4, 1.1, 1.3, 5.0])
    w = 2.0 * np.pi * f
    z = stiff + 1j * w * (damping + viscous)
    along = np.array([np.cos(a), 0.0, np.sin(a)])
    push = fb.Load("push", bead, force=tuple(2.0 * along + np.array([0.3 * along[2], 0.0, -0.3 * along[0]])))
    found = fb.frequency_response(model, f, state=rest.state, loads=push, points={"bead": bead})
    np.testing.assert_allclose(found.slide("s"), 2.0 / (z - MASS * w**2), rtol=1e-10)
    np.testing.assert_allclose(found.point("bead") @ along, found.slide("s"), rtol=1e-10)
    # a base that moves takes it along: m (u + s)'' = -(k s + c s'); the rail, all nodes of which move, is rigid
    moved = fb.frequency_response(model, f, state=rest.state, base=tuple(1e-3 * along), points={"bead": bead})
    np.testing.assert_allclose(moved.slide("s"), 1e-3 * MASS * w**2 / (z - MASS * w**2), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(moved.point("bead") @ along, 1e-3 * z / (z - MASS * w**2), rtol=1e-9)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_drive_pulls_on_the_bar_that_it_acts_on(planar: Any) -> None:
    """m r^2 (1 + Z/Y) + Z = 0: Z = k + c r between bead and bar, Y = EA q (coth q a + coth q b), q = r sqrt(rhoA/EA), of the bar
    at the place of the bead."""
    mass, stiff, damping, viscous, at, length = 0.4, 800.0, 6.0, 3.0, 0.8, 2.0
    beam = fb.Beam.straight("bar", (0, 0, 0), (length, 0, 0), section=STRING, elements=10, degree=5, prestress=50.0)
    bead = fb.PointMass("bead", mass=mass)
    model = fb.compile_scene(fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Slider(
        "s", bead, beam, at=at, drive=fb.Drive(position=at, stiffness=stiff, damping=damping),
        friction=fb.Friction(viscous=viscous))), planar=planar)

    def off(r: complex) -> complex:
        z, q = stiff + (damping + viscous) * r, r * np.sqrt(STRING.rhoA / STRING.EA)
        return mass * r**2 * (1.0 + z / (STRING.EA * q * (1.0 / np.tanh(q * at) + 1.0 / np.tanh(q * (length - at))))) + z

    exact, before = pair(mass, damping + viscous, stiff), 1.01 * pair(mass, damping + viscous, stiff)
    for _ in range(30):
        if exact != before:
            exact, before = exact - off(exact) * (exact - before) / (off(exact) - off(before)), exact
    rates = fb.modes(model, n=8, damped=True).rates
    assert abs(exact - pair(mass, damping + viscous, stiff)) > 1e-3 * abs(exact)
    assert np.min(np.abs(rates - exact)) < 1e-9 * abs(exact)


def test_laws_of_place_and_rate_give_their_derivatives() -> None:
    def law(t: float, s: float, rate: float) -> float:
        return -0.5 * np.sin(3.0 * (s - 2.0)) - 0.03 * rate * (1.0 + s) + 0.2 * rate**3

    model = rigid_rail(30.0, 1.8, drive=fb.Drive(force=law))
    rest = fb.solve_static(model)
    s = rest.state.s[0]
    stiffness = 1.5 * np.cos(3.0 * (s - 2.0))
    assert fb.modes(model, state=rest.state).squared[0] == pytest.approx(stiffness / MASS, rel=1e-10)
    rates = fb.modes(model, state=rest.state, damped=True).rates
    assert abs(rates[0] - pair(MASS, 0.03 * (1.0 + s), stiffness)) < 1e-10 * abs(rates[0])
    # they grow with the load factor, as in statics
    half = fb.solve_static(model, levels=(0.5,))
    level = rigid_rail(0.0, 2.0, drive=fb.Drive(force=law))
    assert half.info["unstable_directions"] == 0
    assert fb.modes(level, load_factor=0.5).squared[0] == pytest.approx(0.75 / MASS, rel=1e-10)


def test_laws_with_a_kink_at_rest_are_refused_and_flat_ones_are_not() -> None:
    def on_one_side(t: float, s: float, rate: float) -> float:
        return -0.5 * (s - 1.0 if s > 1.0 else 0.0)

    def dry(t: float, s: float, rate: float) -> float:
        return -0.5 * (s - 1.0) - 0.1 * np.sign(rate)

    def square(t: float, s: float, rate: float) -> float:
        return -0.5 * (s - 1.0) - 0.1 * rate * abs(rate)

    for law, by in ((on_one_side, "s at s = 1"), (dry, "rate at rate = 0")):
        with pytest.raises(fb.SceneError, match=f"slider 's': force.* has no derivative by {by}, .*held="):
            fb.modes(rigid_rail(0.0, 1.0, drive=fb.Drive(force=law)), damped=True)
    undamped = fb.modes(rigid_rail(0.0, 1.0, drive=fb.Drive(force=dry))).angular[0]
    assert undamped == pytest.approx(np.sqrt(0.5 / MASS), rel=1e-10)
    rate = fb.modes(rigid_rail(0.0, 1.0, drive=fb.Drive(force=square)), damped=True).rates[0]
    assert abs(rate - 1j * np.sqrt(0.5 / MASS)) < 1e-7


def test_friction_that_is_linear_at_rest_lets_a_free_bead_decay() -> None:
    viscous = fb.modes(rigid_rail(0.0, 1.0, friction=fb.Friction(viscous=0.1)), damped=True).rates
    np.testing.assert_allclose(sorted(viscous.real), (-10.0, 0.0), rtol=1e-10)
    smooth = fb.modes(rigid_rail(0.0, 1.0, friction=fb.Friction(0.2, smoothing=0.1)), damped=True).rates
    np.testing.assert_allclose(sorted(smooth.real), (-0.2 * G / 0.1, 0.0), rtol=1e-10)
    # on a sleeve moments press on the edges too
    incline = rail_with_sleeve(friction=fb.Friction(0.2, smoothing=0.1), drive=fb.Drive(position=2.0, stiffness=5.0))
    rest = fb.solve_static(incline)
    across = MASS * G * np.sqrt(1.0 - 4.0 / 9.0)
    rates = fb.modes(incline, state=rest.state, damped=True).rates
    assert abs(rates[0] - pair(MASS, 0.2 * across / 0.1, 5.0)) < 1e-9 * abs(rates[0])


# --- stops --------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", ["auto", False])
def test_stops(planar: Any) -> None:
    elastic = rigid_rail(30.0, 1.0, planar, stops=fb.Stops(0.5, 3.0, stiffness=100.0))
    rest = fb.solve_static(elastic)
    assert rest.state.s[0] < 0.5
    assert fb.modes(elastic, state=rest.state).angular[0] == pytest.approx(np.sqrt(100.0 / MASS), rel=1e-10)
    # a saturated controller pushes it against the other one, without stiffness and damping of its own
    limited = fb.Drive(position=4.0, stiffness=1.0, damping=2.0, limit=0.5)
    pushed = rigid_rail(30.0, 1.0, planar, stops=fb.Stops(0.5, 3.0, stiffness=100.0), drive=limited)
    rest = fb.solve_static(pushed)
    assert rest.state.s[0] > 3.0
    assert abs(fb.modes(pushed, state=rest.state, damped=True).rates[0] - 1j * np.sqrt(100.0 / MASS)) < 1e-8
    rigid = rigid_rail(30.0, 1.0, planar, stops=fb.Stops(0.5, 3.0))
    held = fb.modes(rigid, state=fb.solve_static(rigid).state)
    assert len(held) == 0 and held.info["held_sliders"] == ["s"]
    # one that only touches its stop is free
    level = rigid_rail(0.0, 0.5, planar, stops=fb.Stops(0.5, 3.0), drive=fb.Drive(position=0.5, stiffness=2.0))
    free = fb.modes(level)
    assert free.info["held_sliders"] == [] and free.angular[0] == pytest.approx(np.sqrt(2.0 / MASS), rel=1e-10)
    with pytest.raises(fb.SceneError, match="a force of 0.04905 N pushes slider 's' along its beam, but its stop acts in the "
                                            "other"):
        fb.modes(rigid_rail(-30.0, 0.5, planar, stops=fb.Stops(0.5, 3.0)))


# --- what holds ---------------------------------------------------------------------------------------------------------
def sagging(planar: bool, sleeve: bool = False, at: float = 0.6, **forces: Any) -> tuple[fb.Model, Any]:
    """A bead, or a body in a sleeve, on a soft beam between clamps that sags, in its plane or in space."""
    section = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=3.0, EI2=4.0, EI3=4.0, rhoA=0.5, rhoI2=1e-3, rhoI3=1e-3)
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0.4, 0), section=section, elements=4)
    place = tuple(beam.reference(at)[0][0])
    thing: Any = fb.RigidBody("thing", mass=0.3, inertia=(1e-3, 2e-3, 2e-3), position=place,
                              directors=beam.reference(at)[1][0]) if sleeve else fb.PointMass("thing", mass=0.3)
    slider = (fb.Sleeve if sleeve else fb.Slider)("s", thing, beam, at=at, **forces,
                                                     **({"keyed": True, "length": 0.05} if sleeve else {}))
    scene = fb.Scene(beam, thing, fb.Clamp(beam.start), fb.Clamp(beam.end), slider, gravity=(0, 0, -G))
    return fb.compile_scene(scene, planar="auto" if planar else False), beam


@pytest.mark.parametrize(("planar", "sleeve"), [(True, False), (False, False), (False, True)])
def test_what_friction_holds_vibrates_as_what_is_held(planar: bool, sleeve: bool) -> None:
    model, _ = sagging(planar, sleeve, friction=0.8)
    rest = fb.solve_static(model)
    assert rest.info["friction"]["s"]["sticks"]
    found = fb.modes(model, state=rest.state, n=6)
    other, _ = sagging(planar, sleeve)
    held = fb.modes(other, state=fb.solve_static(other, held=True).state, n=6, held=("s",))
    np.testing.assert_allclose(found.angular, held.angular, rtol=1e-10)
    assert not found.slides.any() and found.info["held_sliders"] == ["s"]
    locked, _ = sagging(planar, sleeve, lock=fb.Lock())
    np.testing.assert_allclose(found.angular, fb.modes(locked, state=fb.solve_static(locked).state, n=6).angular, rtol=1e-10)
    given, _ = sagging(planar, sleeve, drive=fb.Drive(position=lambda t: 0.6))
    rest_given = fb.solve_static(given, at_time=0.0)
    np.testing.assert_allclose(found.angular, fb.modes(given, state=rest_given.state, n=6).angular, rtol=1e-10)
    # free sliders are softer
    valley = fb.solve_static(other)
    assert fb.modes(other, state=valley.state, n=1).angular[0] < 0.95 * found.angular[0]
    # states of a vibration remember that it sticks
    own = found.state(0, 1e-5).history[:HISTORY].reshape(-1, HISTORY)
    assert own[0, STICKS] == 1.0 and own[0, AGAINST] == 0.0
    needed = float(rest.info["friction"]["s"]["force"] / rest.info["friction"]["s"]["cone"] * 0.8)
    less, _ = sagging(planar, sleeve, friction=0.9 * abs(needed))
    with pytest.raises(fb.SceneError, match="the state is not an equilibrium: a force of .* pushes slider 's' along .* its "
                                            "friction is at most"):
        fb.modes(less, state=rest.state, n=1)


def test_what_a_lock_has_caught_in_a_run_is_held() -> None:
    model = rigid_rail(0.0, 1.0, rate=1.0, stops=fb.Stops(end=2.0), lock=fb.Lock("end"),
                       drive=fb.Drive(position=1.0, stiffness=1e-3))
    with pytest.raises(fb.SceneError, match="slider 's' has a lock or may leave its beam, which equilibria do not support"):
        fb.modes(model)
    run = fb.simulate(model, t_end=1.5, step=0.01, progress=False)
    found = fb.modes(model, state=run.state)
    assert len(found) == 0 and found.info["held_sliders"] == ["s"]
    two, beam = sagging(True, lock=fb.Lock())
    caught = fb.modes(two, state=fb.solve_static(two).state, n=1).state(0, 1e-4)
    assert caught.history[HELD] == LOCKED


# --- what is refused ----------------------------------------------------------------------------------------------------
def test_what_is_no_equilibrium_or_unknown_is_refused() -> None:
    with pytest.raises(fb.SceneError, match="slider 's' has an unbalanced force of 0.1 N along its beam"):
        fb.modes(rigid_rail(0.0, 1.0, gravity=0.0, drive=fb.Drive(force=0.1)))
    with pytest.raises(fb.SceneError, match="point mass 'bead' has an unbalanced force of 0.0981 N"):
        fb.modes(rigid_rail(16.0, 1.0, friction=fb.Friction(viscous=0.1)))
    # an equilibrium of held sliders is none of free ones
    incline = rigid_rail(16.0, 1.0)
    with pytest.raises(fb.SceneError, match="slider 's' has an unbalanced force of 0.027.* N along its beam"):
        fb.modes(incline, state=fb.solve_static(incline, held=True).state)
    timed = rigid_rail(0.0, 1.0, drive=fb.Drive(position=lambda t: 1.0, stiffness=2.0))
    with pytest.raises(fb.SceneError, match="modes: drives have time functions, so a time is needed; give one time with "
                                            "at_time="):
        fb.modes(timed)
    assert fb.modes(timed, at_time=0.0).angular[0] == pytest.approx(np.sqrt(2.0 / MASS), rel=1e-11)


# --- against runs in time -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("planar", "sleeve"), [(True, False), (False, False), (False, True)])
def test_damped_modes_decay_in_runs_as_they_say(planar: bool, sleeve: bool) -> None:
    """A drive, viscous friction and an elastic stop that is pressed on a sagging beam: in a step a run takes the factor of the
    rate."""
    h, n, size = 0.01, 60, 1e-6
    model, beam = sagging(planar, sleeve, friction=fb.Friction(viscous=0.4), stops=fb.Stops(0.7, stiffness=30.0),
                          drive=fb.Drive(position=0.3, stiffness=20.0, damping=0.3), at=0.9)
    rest = fb.solve_static(model)
    assert rest.state.s[0] < 0.7
    found = fb.modes(model, state=rest.state, n=3, damped=True)
    assert np.max(found.residuals) < 1e-9 and np.sum(found.decay > 1e-3) >= 2
    middle = beam.node(6)
    for k in range(3):
        rate = found.rates[k]
        run = fb.simulate(model, start=found.state(k, size), t_end=n * h, step=h, every=1, progress=False,
                          points={"middle": middle})
        factor = ((1.0 + 0.5 * rate * h) / (1.0 - 0.5 * rate * h))**np.arange(n + 1)
        slid = run.slider("s")["s"] - rest.state.s[0]
        moved = run.point("middle") - rest.state.q.reshape(-1, 4, 3)[model.numbers.number(middle), 0]
        shape = found.displacements[k, model.numbers.number(middle)]
        assert np.max(np.abs(slid - size * np.real(factor * found.slides[k, 0]))) < 5e-6 * size, k
        assert np.max(np.abs(moved - size * np.real(factor[:, None] * shape))) < 3e-5 * size, k


def test_a_run_that_has_settled_swings_as_the_response_says() -> None:
    """As steps of size h answer the mean of F cos w t over a step: at 2/h tan(w h/2)."""
    h, w, n, size = 0.02, 5.0, 400, 1e-4
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=STIFF, elements=4)
    bead = fb.PointMass("bead", mass=MASS)
    push = fb.Load("push", bead, force=(size, 0, 0), time=lambda t: float(np.cos(w * t)))
    clamps = [fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)]
    model = fb.compile_scene(fb.Scene(rail, bead, *clamps, push, fb.Slider(
        "s", bead, rail, at=1.1, drive=fb.Drive(position=1.1, stiffness=0.5, damping=0.04),
        friction=fb.Friction(viscous=0.03)), gravity=(0, 0, -G)))
    found = fb.frequency_response(model, [2.0 / h * np.tan(0.5 * w * h) / (2.0 * np.pi)], at_time=0.5 * np.pi / w, loads="push")
    run = fb.simulate(model, t_end=n * h, step=h, every=1, progress=False)
    late = run.t > n * h - 1.5
    expected = np.real(np.exp(1j * w * run.t) * found.slide("s")[0] * np.sinc(0.5 * w * h / np.pi) / np.cos(0.5 * w * h))
    slid = run.slider("s")["s"] - 1.1
    assert np.max(np.abs(slid - expected)[late]) < 1e-7 * np.max(np.abs(expected))


def test_a_bead_that_sticks_stays_in_a_run_from_a_mode() -> None:
    h, n, size = 0.01, 60, 1e-6
    model, beam = sagging(True, friction=0.3)
    rest = fb.solve_static(model)
    found = fb.modes(model, state=rest.state, n=2, planar=True)
    node = beam.node(6)
    run = fb.simulate(model, start=found.state(0, size), t_end=n * h, step=h, every=1, progress=False, points={"node": node})
    assert np.array_equal(run.slider("s")["s"], np.full(n + 1, rest.state.s[0]))
    number = model.numbers.number(node)
    moved = run.point("node") - rest.state.q.reshape(-1, 4, 3)[number, 0]
    turn = 2.0 * np.arctan(0.5 * found.angular[0] * h) * np.arange(n + 1)
    off = np.abs(moved - size * np.cos(turn)[:, None] * found.displacements[0, number])
    assert np.max(off) < 2e-5 * size


# --- derivatives ----------------------------------------------------------------------------------------------------------
def pull(t: float, s: float, rate: float) -> float:
    return -25.0 * np.sinh(s - 2.0) - 0.1 * rate


def driven(L: float, m: float, k: float, x: float) -> Any:  # noqa: N803
    """Two rings on a cable: on a controller towards x and a weak law, and on a stop of stiffness k that it is pushed against."""
    cable = fb.Beam.straight("cable", (0, 0, 0), (L, 0, 0), section=fb.Section(
        EA=5e3, GA2=5e3, GA3=5e3, GJ=1.0, EI2=2.0, EI3=2.0, rhoA=0.3, rhoI2=1e-3, rhoI3=1e-3), elements=6)
    one, two = fb.PointMass("first", mass=m), fb.PointMass("second", mass=0.7)
    return (fb.Scene(cable, fb.Clamp(cable.start), fb.Clamp(cable.end), one, two,
                     fb.Slider("one", one, cable, at=0.4 * L, drive=fb.Drive(position=x, stiffness=k, damping=0.2),
                               friction=fb.Friction(viscous=0.3)),
                     fb.Slider("two", two, cable, at=0.7 * L, drive=fb.Drive(force=pull),
                               stops=fb.Stops(end=0.72 * L, stiffness=k)), gravity=(0, 0.3, -9.81)),
            {"one": one, "middle": (cable, 0.5 * L)})


DRIVEN = dict(L=2.0, m=0.8, k=60.0, x=0.7)


def test_derivatives_of_equilibria_and_frequencies_with_drives_and_elastic_stops() -> None:
    found = fb.sensitivity(driven, DRIVEN, observe=("energy",))
    assert found.state.s[1] > 0.72 * DRIVEN["L"] and max(found.accuracy.values()) < 1e-8
    slopes = found.frequencies(3)
    modes = fb.modes(found.model, state=found.state, n=3)
    np.testing.assert_allclose(slopes.frequencies, modes.frequencies, rtol=1e-9)
    gradient = found.gradient(sliders={"one": 1.0, "two": 2.0}).by
    for name in ("L", "k"):
        def at(v: float, name: str = name) -> Array:
            model = fb.compile_scene(driven(**DRIVEN | {name: v})[0])
            rest = fb.solve_static(model)
            potential = rest.series["strain"][-1] + rest.series["potential"][-1]
            return np.concatenate((rest.state.s, [potential],
                                   fb.modes(model, state=rest.state, n=3).frequencies))

        h = 2e-3 * DRIVEN[name]
        sides = [at(DRIVEN[name] + j * h) - at(DRIVEN[name] - j * h) for j in (1, 2, 3)]
        exact = (45.0 * sides[0] - 9.0 * sides[1] + sides[2]) / (60.0 * h)
        ours = np.array([found.slider("one")[name], found.slider("two")[name]])
        energy = found.energy("strain")[name] + found.energy("potential")[name]
        for mine, other, to in ((ours, exact[:2], 1e-10), (energy, exact[2], 1e-9), (slopes.by[name], exact[3:], 5e-9)):
            assert np.linalg.norm(mine - other) < to * np.linalg.norm(other), (name, mine, other)
        assert gradient[name] == pytest.approx(ours @ (1.0, 2.0), rel=1e-9)
    with pytest.raises(fb.SceneError, match="slider 'one' has Coulomb friction, a prescribed motion, rigid stops, a lock"):
        fb.sensitivity(_rough, {"m": 1.0})


def _rough(m: float) -> fb.Scene:
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=STIFF, elements=2)
    one = fb.PointMass("first", mass=m)
    return fb.Scene(rail, fb.Clamp(rail.start), fb.Clamp(rail.end), one, fb.Slider("one", one, rail, at=1.0, friction=0.2),
                    gravity=(0, 0, -G))


# --- paths ------------------------------------------------------------------------------------------------------------------
def toggle(planar: Any, **forces: Any) -> fb.Model:
    """A bead on a rail of 4 m along x, with a spring of 20 N/m, 1 m long, to a point 0.6 m above x = 2: it snaps through."""
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=STIFF, elements=4)
    bead = fb.PointMass("bead", mass=MASS)
    spring = fb.Spring(bead, fb.GROUND.point((2.0, 0.0, 0.6)), stiffness=20.0, length=1.0)
    clamps = [fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)]
    return fb.compile_scene(fb.Scene(rail, bead, *clamps, spring, fb.Slider("s", bead, rail, at=1.2, **forces)), planar=planar)


def resisted(s: Any) -> Any:
    """Force of that spring along the rail."""
    return 20.0 * (1.0 - 1.0 / np.hypot(2.0 - s, 0.6)) * (2.0 - s)


@pytest.mark.parametrize("planar", ["auto", False])
def test_paths_of_what_drives_push(planar: Any) -> None:
    model = toggle(planar, drive=fb.Drive(force=10.0), stops=fb.Stops(end=3.2, stiffness=50.0))
    path = fb.solve_path(model, to=1.0)
    factor, s = path.series["load_factor"], path.slider("s")["s"]
    stop = 50.0 * np.maximum(s - 3.2, 0.0)
    assert np.max(np.abs(10.0 * factor + resisted(s) - stop)) < 1e-9 and stop[-1] > 1.0
    np.testing.assert_allclose(path.slider("s")["drive_force"], 10.0 * factor, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(path.slider("s")["stop_force"], -stop, rtol=1e-9, atol=1e-12)
    # d/ds of (1 - 1/l)(2 - s) vanishes where l^3 = 0.6^2
    limits = [x for x in path.info["critical_points"] if x["kind"] == "limit"]
    away = np.sqrt(0.6**(4.0 / 3.0) - 0.36)
    for found, at in zip(limits, (2.0 - away, 2.0 + away), strict=True):
        assert found["load_factor"] == pytest.approx(-resisted(at) / 10.0, rel=1e-9)
    between = (s > 2.0 - away + 1e-3) & (s < 2.0 + away - 1e-3)
    unstable = path.series["unstable_directions"]
    assert np.all(unstable[between] == 1) and np.all(unstable[s < 2.0 - away - 1e-3] == 0) and unstable[-1] == 0


def test_paths_with_a_controller_whose_stiffness_grows() -> None:
    model = toggle("auto", drive=fb.Drive(position=lambda t: 1.2 + 2.0 * t, stiffness=8.0, damping=1.0))
    with pytest.raises(fb.SceneError, match="solve_path: drives have time functions, so a time is needed; give one time with "
                                            "at_time="):
        fb.solve_path(model)
    path = fb.solve_path(model, at_time=1.0)
    factor, s = path.series["load_factor"], path.slider("s")["s"]
    assert np.max(np.abs(8.0 * factor * (3.2 - s) + resisted(s))) < 1e-9
    np.testing.assert_allclose(path.slider("s")["drive_force"], 8.0 * factor * (3.2 - s), rtol=1e-8, atol=1e-9)
    assert s[-1] == pytest.approx(fb.solve_static(model, at_time=1.0, start=path.state, load_step=1.0,
                                                  raise_loads=False).state.s[0], rel=1e-10)
    with pytest.raises(fb.SceneError, match="solve_path: slider 's' has Coulomb friction, .*, which equilibria do not support"):
        fb.solve_path(toggle("auto", drive=fb.Drive(force=10.0), friction=0.1))
