"""Events where a contact inside an element has a place of rest, a frequency, a force of the mesh (theory.md 3.3)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb
from fastbeam.results.observe import contact_ripples as ripples
from fastbeam.scene.interpolation.basis import build_basis

G = 9.81
# of a cable of 10 m between pins 9.5 m apart: w^2 of a rider at its lowest point, whose place is on an ellipse, and with EI = 10
# N m^2 1.0185^2 of that, from the force along the beam at places 1 cm beside it (solve_static(contacts="exact"))
SPAN, LENGTH, BENT = 9.5, 10.0, 1.0185**2
ELLIPSE = G * 0.5 * np.sqrt(LENGTH**2 - SPAN**2) / (0.5 * LENGTH)**2


def contact(result: object) -> list[str]:
    return [event["text"] for event in result.events if event["kind"] == "contact"]


def number(text: str, before: str) -> float:
    return float(text.split(before)[1].split()[0].rstrip(";,%"))


def rider(elements: int) -> fb.Model:
    half = brentq(lambda a: np.sin(a) / a - SPAN / LENGTH, 1e-3, 3)
    section = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=10.0, EI2=10.0, EI3=10.0, rhoA=1e-4, rhoI2=1e-9, rhoI3=1e-9)
    cable = fb.Beam.arc("cable", (0, 0, 0), (np.cos(half), 0, -np.sin(half)), (np.sin(half), 0, np.cos(half)),
                        radius=LENGTH / (2 * half), angle=2 * half, section=section, elements=elements)
    mass = fb.PointMass("rider", mass=10.0)
    return fb.compile_scene(fb.Scene(cable, mass, fb.Pin(cable.start), fb.Pin(cable.end),
                                     fb.Slider("trolley", mass, cable, at=0.5 * cable.length), gravity=(0, 0, -G)))


def test_the_compliance_of_a_taut_beam_is_that_of_a_fine_mesh_with_an_element_end_at_the_force() -> None:
    for GA, N, s in ((40.0, 0.3, 2.0), (1e4, 25.0, 2.5), (300.0, 1e-3, 1.0)):
        ends = np.concatenate((np.linspace(0.0, s, 21), np.linspace(s, 5.0, 21)[1:]))
        found = ripples.piece_of(build_basis("lagrange", 5, ends, 5.0), "own", np.array([s])).compliance(GA, N)
        # measured: 1e-9 and below, round-off of matrices with a condition of 1e7
        np.testing.assert_allclose(found, ripples._exact(5.0, GA, N, np.array([s])), rtol=1e-8)


@pytest.mark.parametrize("elements", [33, 129])
def test_modes_tell_how_much_of_a_frequency_is_of_the_mesh(elements: int) -> None:
    model = rider(elements)
    rest = fb.solve_static(model)
    found = fb.modes(model, state=rest.state, n=3, planar=True)
    error = found.squared[0] / (BENT * ELLIPSE) - 1.0
    assert -0.45 < error < -0.1
    (text,) = contact(found)
    # measured: 38 % told of 40 %, 13 of 13
    assert text.startswith("slider 'trolley': on beam 'cable'")
    assert abs(number(text, "mode 0 by about ") / 100 - error) < -0.2 * error
    (text,) = contact(rest)
    assert abs(number(text, "derivatives, by ") / 100 + error) < -0.2 * error
    assert len(contact(fb.modes(model, state=rest.state, n=3, planar=True, damped=True))) == 1
    # held sliders have no place of rest and no motion along the beam
    assert not contact(fb.modes(model, state=rest.state, n=3, planar=True, held=True))


def ring(elements: int, **how: str) -> fb.Result:
    """A ring on a level taut rope, which comes to rest in its middle, at 2 m."""
    section = fb.Section(EA=2e5, GA2=8e4, GA3=8e4, GJ=0.02, EI2=0.02, EI3=0.02, rhoA=0.05, rhoI2=1e-8, rhoI3=1e-8)
    rope = fb.Beam.straight("rope", (0, 0, 0), (4, 0, 0), section=section, elements=elements, prestress=200.0)
    mass = fb.PointMass("ring", mass=0.5)
    return fb.solve_static(fb.compile_scene(fb.Scene(rope, mass, fb.Pin(rope.start), fb.Pin(rope.end), fb.Slider(
        "on", mass, rope, at=1.1), gravity=(0, 0, -G))), **how)


def test_a_place_of_rest_that_the_mesh_decides_is_told_of_with_its_error() -> None:
    # of 80 elements several hold the ring, and round-off decides which: the middle is a node
    for elements, least in ((21, 0.03), (80, 0.0)):
        found = ring(elements)
        (text,) = contact(found)
        off = abs(found.slider("on")["s"][-1] - 2.0)
        assert least < off < number(text, "may be off by about ") < 0.25 and "contacts='exact'" in text
    found = ring(21, contacts="exact")
    assert abs(found.slider("on")["s"][-1] - 2.0) < 1e-6 and not contact(found)


def test_runs_tell_where_a_contact_has_little_motion_for_the_mesh() -> None:
    """Of +-5 cm, 0.0077 J; a run of 2 m/s has 20 J, and no event."""
    for elements, told in ((32, True), (128, False)):
        model = rider(elements)
        rest = fb.solve_static(model)
        start = fb.modes(model, state=rest.state, n=1, planar=True).state(0, 0.05)
        run = fb.simulate(model, t_end=4.0, step=0.02, start=start, progress=False)
        found = contact(run)
        assert len(found) == told
        if told:
            assert 0.003 < number(found[0], "kinetic energy along the beam is at most ") < 0.03 and "use about" in found[0]


def in_a_sleeve(elements: int, length: float | None, free: float = 0.4, force: float = 0.01, GA: float = 1e5, EI: float = 1.0,
                **mesh: Any) -> tuple[float, list[str]]:
    """How much too stiff a rod beyond a sleeve is, against a cantilever, and what is told."""
    section = fb.Section(EA=1e5, GA2=GA, GA3=GA, GJ=1.0, EI2=EI, EI3=EI, rhoA=0.1, rhoI2=1e-7, rhoI3=1e-7)
    rod = fb.Beam.straight("rod", (free - 1.2, 0, 0), (free, 0, 0), section=section, elements=elements, **mesh)
    body = fb.RigidBody("mouth", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    bore = {} if length is None else {"length": length}
    model = fb.compile_scene(fb.Scene(rod, body, fb.Clamp(body), fb.Sleeve("mouth sleeve", body, rod, at=1.2 - free, **bore),
                                      fb.Load("tip", rod.end, force=(0, 0, force))))
    found = fb.solve_static(model, held=True, points={"tip": rod.end})
    return 1.0 - float(found.point("tip")[-1, 2]) / (force * (free**3 / (3 * EI) + free / GA)), contact(found)


@pytest.mark.parametrize(("elements", "length", "more"), [
    (4, None, {}), (13, None, {}), (8, 0.0, {}), (12, 0.0, {"free": 0.35}), (12, 0.0, {"free": 0.37, "GA": 200.0}),
    (12, 0.0, {"free": 0.37, "EI": 100.0}), (9, None, {"free": 0.75}), (12, None, {"free": 0.35, "degree": 2}),
    (12, 0.0, {"free": 0.35, "degree": 1}), (12, 0.0, {"free": 0.35, "degree": 5}),
    (12, None, {"free": 0.35, "interpolation": "bspline"})])
def test_a_sleeve_on_a_coarse_mesh_is_told_of_with_its_error(elements: int, length: float | None, more: dict[str, Any]) -> None:
    """Between 2 and 26 %: of the mesh, the bore, both."""
    error, (text,) = in_a_sleeve(elements, length, **more)
    # told 20 for 22 %, 26 for 26 of splines, 11 for 12.3 of linear elements, which are stiffer all along; else within 4 %
    assert abs(number(text, "too stiff by about ") / 100 - error) < 0.12 * error
    assert ("its bore is one element long: give length=" in text) == (length is None)


def test_of_a_bore_that_is_given_the_mesh_alone_is_told_of() -> None:
    """A bore of 3 cm keeps 239/2520 of it from bending, which is no error; elements of 10 cm add to that."""
    error, (text,) = in_a_sleeve(12, 0.03, free=0.35)
    of_bore = 3.0 * 239.0 / 2520.0 * 0.03 / 0.35
    assert in_a_sleeve(120, 0.03, free=0.35)[0] == pytest.approx(of_bore, rel=0.05)
    assert number(text, "too stiff by about ") / 100 == pytest.approx(error - of_bore, rel=0.1)


def test_of_a_sleeve_the_estimate_holds_for_large_deflections() -> None:
    """The tip at 60 degrees: 8 and 96 elements, an end of one of these at the sleeve."""
    (coarse, (text,)), (fine, told) = (in_a_sleeve(n, 0.0, force=6.0) for n in (8, 96))
    error = 1.0 - (1.0 - coarse) / (1.0 - fine)
    assert not told and number(text, "too stiff by about ") / 100 == pytest.approx(error, rel=0.25)


def test_a_sleeve_at_an_element_end_is_not() -> None:
    error, told = in_a_sleeve(12, 0.0)
    assert abs(error) < 1e-3 and not told


def test_two_wheels_of_a_trolley_in_an_element_are_told_of() -> None:
    def run(elements: int) -> list[str]:
        section = fb.Section(EA=1e7, GA2=4e6, GA3=4e6, GJ=50.0, EI2=50.0, EI3=50.0, rhoA=1.0, rhoI2=5e-6, rhoI3=5e-6)
        cable = fb.Beam.straight("cable", (0, 0, 0), (20, 0, 0), section=section, elements=elements, prestress=2e5)
        cart = fb.RigidBody("cart", mass=300.0, inertia=(30, 30, 30), position=(6, 0, -0.5))
        wheels = [fb.Slider(name, cart.point((x, 0, 0.5)), cable, at=6.0 + x) for name, x in (("rear", -0.15), ("front", 0.15))]
        scene = fb.Scene(cable, cart, fb.Pin(cable.start), fb.Pin(cable.end), *wheels, gravity=(0, 0, -G))
        return contact(fb.simulate(fb.compile_scene(scene), t_end=0.05, step=0.01, progress=False))

    told = [text for text in run(10) if "'rear' and 'front' of body 'cart' are 0.3 m apart on beam 'cable'" in text]
    assert len(told) == 1 and "their sum is right" in told[0]
    assert not [text for text in run(80) if "their sum is right" in text]


@pytest.mark.parametrize("curve", ["c1", "own"])
def test_a_path_keeps_the_kink_of_a_hinge(curve: str) -> None:
    """Two bars of one element each, a hinge that is pulled down between them: they stay straight."""
    section = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=section, elements=1)
    b = fb.Beam.straight("b", (1, 0, 0), (2, 0, 0), section=section, elements=1)
    mass = fb.PointMass("m", mass=1e-6)
    scene = fb.Scene(a, b, fb.BallJoint(a.end, b.start), fb.Pin(a.start), fb.Pin(b.end), mass,
                     fb.Slider("s", mass, on=fb.Path("p", [a, b]), at=1.5, curve=curve),
                     fb.Load("down", b.start, force=(0, 0, -100.0)))
    found = fb.solve_static(fb.compile_scene(scene), held=True, points={"m": mass, "hinge": b.start})
    # rounded it was 0.46875 of it
    assert abs(found.point("m")[-1, 2] / found.point("hinge")[-1, 2] - 0.5) < 1e-12 and found.point("hinge")[-1, 2] < -0.03


@pytest.mark.parametrize(("elements", "curve", "told"), [(2, "c1", True), (2, "own", False), (64, "c1", False)])
def test_a_kink_of_the_mesh_that_a_curve_rounds_is_told_of(elements: int, curve: str, told: bool) -> None:
    rope = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=rope, elements=elements, degree=1)
    mass = fb.PointMass("m", mass=1e-6)
    scene = fb.Scene(a, fb.Pin(a.start), fb.Pin(a.end), mass, fb.Slider("s", mass, a, at=1.5, curve=curve),
                     fb.Load("down", a.node(elements // 2), force=(0, 0, -2000.0)))
    found = fb.solve_static(fb.compile_scene(scene), held=True, points={"m": mass, "mid": a.node(elements // 2)})
    text = [x for x in contact(found) if "curve 'c1' lies" in x]
    assert bool(text) == told
    if told:
        # two straight elements: it should hang at half of the middle
        off = abs(found.point("m")[-1, 2] - 0.5 * found.point("mid")[-1, 2])
        assert off > 0.01 and abs(number(text[0], "curve 'c1' lies ") - off) < 0.1 * off


def trolley(joint: type, h: float, every: int = 1, EI: float = 50.0) -> fb.Result:
    """It passes a tower between two spans of a taut rope, 40 m each."""
    section = fb.Section(EA=1e7, GA2=4e6, GA3=4e6, GJ=EI, EI2=EI, EI3=EI, rhoA=5.0, rhoI2=5e-6, rhoI3=5e-6)
    spans = [fb.Beam.straight(f"w{i}", (40.0 * i, 0, 0), (40.0 * (i + 1), 0, 0), section=section, elements=20, prestress=1e5)
             for i in range(2)]
    point = fb.PointMass("trolley", mass=200.0)
    scene = fb.Scene(*spans, joint(spans[0].end, spans[1].start), fb.Pin(spans[0].start), fb.Pin(spans[0].end),
                     fb.Pin(spans[1].end), point, fb.Slider("s", point, on=fb.Path("track", spans), at=30.0, rate=8.0),
                     gravity=(0, 0, -G))
    return fb.simulate(fb.compile_scene(scene), t_end=1.6, step=h, every=every, progress=False)


def blows(result: fb.Result) -> list[str]:
    return [event["text"] for event in result.events if event["kind"] == "unresolved" and "grows with 1/h" in event["text"]]


@pytest.mark.parametrize("joint", [fb.BallJoint, fb.RigidConnection])
def test_a_trolley_that_passes_a_tower_is_told_that_its_force_is_a_blow(joint: type) -> None:
    forces = []
    for h in (0.02, 0.01):
        run = trolley(joint, h)
        (text,) = blows(run)
        assert "slider 's' passes s = 40 m" in text and "a weld instead of a hinge" in text
        largest = float(np.nanmax(np.linalg.norm(run.slider("s")["force"], axis=1)))
        # rows have the mean of two steps
        assert largest / 3 < number(text, "Its force there, about ") < 3 * largest
        forces.append(largest)
    # measured: 12 and 25 kN at a hinge, 9 and 24 kN at a weld, whose bend of 0.02 m elements of 2 m do not show
    assert forces[1] > 1.5 * forces[0]


def test_a_hinge_is_told_of_where_rows_are_far_between_and_a_stiff_beam_has_no_kink() -> None:
    assert len(blows(trolley(fb.BallJoint, 0.01, every=8))) == 1
    assert not blows(trolley(fb.RigidConnection, 0.01, EI=1e8)) and not blows(trolley(fb.RigidConnection, 0.01, every=8, EI=1e8))


def test_derivatives_and_paths_tell_of_it_too() -> None:
    def build(mass: float) -> fb.Scene:
        section = fb.Section(EA=2e5, GA2=8e4, GA3=8e4, GJ=0.02, EI2=0.02, EI3=0.02, rhoA=0.05, rhoI2=1e-8, rhoI3=1e-8)
        rope = fb.Beam.straight("rope", (0, 0, 0), (4, 0, 0), section=section, elements=20, prestress=200.0)
        ring = fb.PointMass("ring", mass=mass)
        return fb.Scene(rope, ring, fb.Pin(rope.start), fb.Pin(rope.end), fb.Slider("on", ring, rope, at=2.0), gravity=(0, 0, -G))

    model = fb.compile_scene(build(0.5))
    rest = fb.solve_static(model)
    (text,) = contact(rest)
    # elements of 0.2 m make of a bend of 0.01 m one that holds the ring 12 times too stiffly
    assert number(text, "derivatives, by ") > 500
    with pytest.warns(fb.ResultWarning, match="sensitivity: unreliable result, contact: slider 'on'"):
        found = fb.sensitivity(build, {"mass": 0.5}, state=rest.state)
    assert contact(found) == [text]
    assert len(contact(fb.solve_path(model, start=rest.state, load_factor=1.0, to=1.1))) == 1
    assert len(contact(fb.relax(model))) == 1


@pytest.mark.parametrize(("mass", "step", "told"), [(0.1, 2e-3, False), (1e-3, 2e-3, False), (1e-4, 2e-3, True),
                                                    (1e-4, 5e-4, False)])
def test_masses_too_light_for_moving_elements(mass: float, step: float, told: bool) -> None:
    """A mass that slides on a beam that its weight lets vibrate: its speed against that on elements that stand."""
    def speed(moving: bool, elements: int, h: float) -> tuple[np.ndarray, np.ndarray, list[Any]]:
        section = fb.Section.circle(radius=0.01, E=2e9, rho=2e3)
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=section, elements=elements)
        rider = fb.PointMass("rider", mass=mass, position=(0.5, 0, 0))
        model = fb.compile_scene(fb.Scene(beam, rider, fb.Clamp(beam.start), fb.Clamp(beam.end),
                                          fb.Slider("run", rider, beam, at=0.5, rate=0.5), gravity=(0, 0, -9.81)), moving=moving)
        result = fb.simulate(model, t_end=0.2, step=h, progress=False)
        return result.t, np.gradient(result.slider("run")["s"], result.t), result.events

    (t, found, events), (at, wanted, _) = speed(True, 8, step), speed(False, 64, 5e-4)
    off = np.max(np.abs(found - np.interp(t, at, wanted))) / np.max(np.abs(found))
    texts = [x["text"] for x in events if x["kind"] == "contact"]
    assert (off > 0.02) == told == bool(texts)
    assert not told or "errors of its moving elements change the speed" in texts[0]
