"""Events where elements do not resolve the shape of a beam (theory.md 3.3)."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.results.observe.resolution import Resolution, mesh_events

WIRE = fb.Section.circle(radius=0.008, E=1e10, rho=5000.0)
ROD = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)


def coarse(result: fb.Result) -> list[str]:
    return [event["text"] for event in result.events if event["kind"] == "coarse"]


def swing(support: type, elements: int) -> fb.Result:
    """A load of 1000 kg on 6 m of rope, pushed with 1 m/s."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (0, 0, -6), section=WIRE, elements=elements)
    load = fb.PointMass("load", mass=1000.0, position=(0, 0, -6), velocity=(1.0, 0, 0))
    scene = fb.Scene(rope, load, support(rope.start), fb.BallJoint(load, rope.end), gravity=(0, 0, -9.81),
                     project_velocities=True)
    return fb.simulate(fb.compile_scene(scene), t_end=1.0, step=2e-3, progress=False)


def test_a_clamp_that_turns_a_rope_within_less_than_an_element_is_named() -> None:
    (text,) = coarse(swing(fb.Clamp, 6))
    assert text.startswith("beam 'rope', s = 0 to 1 m: it is taut") and "elements instead of 6" in text
    assert coarse(swing(fb.Clamp, 60)) == []


def test_a_pin_turns_freely_and_needs_no_such_elements() -> None:
    assert coarse(swing(fb.Pin, 6)) == []


def roll(degree: int, elements: int, angle: float, **curve: object) -> fb.Result:
    """A cantilever bent to a part of a circle."""
    beam = fb.Beam.straight("strip", (0, 0, 0), (1, 0, 0), section=ROD, elements=elements, degree=degree)
    return fb.solve_static(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("m", beam.end, moment=(0, 0, angle)))))


@pytest.mark.parametrize(("degree", "angle", "few", "enough"), [(1, 2.7, 6, 20), (2, 6.28, 3, 6), (3, 2.4, 1, 2)])
def test_elements_that_bend_too_much_are_named(degree: int, angle: float, few: int, enough: int) -> None:
    (text,) = coarse(roll(degree, few, angle))
    assert "bends or twists too much for one element" in text and f"degree {degree}" in text
    assert coarse(roll(degree, enough, angle)) == []
    # what is named does it
    assert coarse(roll(degree, int(text.split("; use ")[1].split()[0]), angle)) == []


def test_an_equilibrium_that_is_not_found_tells_elements_that_are_too_coarse() -> None:
    with pytest.raises(fb.ConvergenceError, match="bends or twists too much for one element of degree 1") as failed:
        roll(1, 4, 6.28)
    assert len(coarse(failed.value.result)) == 1


def test_neighbouring_nodes_beyond_a_right_angle_are_named() -> None:
    # a wheel at the end of a shaft that is soft in torsion
    body = fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=ROD, elements=1, degree=1)
    model = fb.compile_scene(fb.Scene(beam, body, fb.Clamp(beam.start), fb.RigidConnection(body, beam.end),
                                      fb.Load("turn", body, moment=(2.0, 0, 0))))
    result = fb.simulate(model, t_end=1.6, step=1e-2, progress=False)
    assert any("more than a right angle" in text for text in coarse(result))


def test_folded_shapes() -> None:
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=ROD, elements=2, degree=2)
    model = fb.compile_scene(fb.Scene(beam))
    resolution, half_turn = Resolution(model), np.diag((-1.0, 1.0, -1.0))
    assert not resolution.is_folded(model.q0)
    turned, reversed_axis = model.q0.reshape(-1, 4, 3).copy(), model.q0.reshape(-1, 4, 3).copy()
    turned[-1, 1:] = turned[-1, 1:] @ half_turn
    reversed_axis[:, 1:] = reversed_axis[:, 1:] @ half_turn
    assert resolution.is_folded(turned.reshape(-1)) and resolution.is_folded(reversed_axis.reshape(-1))


def test_a_curved_reference_is_no_bending() -> None:
    # one linear element over a quarter of a circle: coarse, but what is not strained is not wrong
    arc = fb.Beam.arc("arc", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=1.2, section=ROD, elements=1, degree=1)
    scene = fb.Scene(arc, fb.RigidMotion(velocity=(1.0, 0, 0)))
    assert coarse(fb.simulate(fb.compile_scene(scene), t_end=0.1, step=1e-2, progress=False)) == []


@pytest.mark.parametrize("observe", [(), ("slider",), ("momentum",), ("energy",)])
def test_it_is_looked_at_whatever_is_observed(observe: tuple[str, ...]) -> None:
    rope = fb.Beam.straight("rope", (0, 0, 0), (0, 0, -6), section=WIRE, elements=6)
    load = fb.PointMass("load", mass=1000.0, position=(0, 0, -6), velocity=(1.0, 0, 0))
    scene = fb.Scene(rope, load, fb.Clamp(rope.start), fb.BallJoint(load, rope.end), gravity=(0, 0, -9.81),
                     project_velocities=True)
    result = fb.simulate(fb.compile_scene(scene), t_end=0.6, step=2e-3, progress=False, observe=observe)
    assert any("beam 'rope'" in text for text in coarse(result))


def test_a_turn_beyond_a_right_angle_is_seen_however_long_the_run() -> None:
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1e-3, rhoI2=1e-6, rhoI3=1e-6)
    bar = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=section, elements=1, degree=1)
    wheel = fb.RigidBody("wheel", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0), spin=(1.65, 0, 0))
    model = fb.compile_scene(fb.Scene(bar, wheel, fb.Clamp(bar.start), fb.RigidConnection(wheel, bar.end),
                                      project_velocities=True))
    # some twenty periods, at whose turning points one linear element is twisted by more than 1.6 rad
    result = fb.simulate(model, t_end=125.0, step=0.02, progress=False)
    assert any("more than a right angle" in text for text in coarse(result)), coarse(result)


def test_nets_name_the_place_by_nodes() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    net = fb.Net("net", x, np.array([[0, 1], [1, 2]]), section=ROD, elements=1, degree=1, joints="rigid")
    scene = fb.Scene(net, fb.Clamp(net.node(0)), fb.Load("m", net.node(2), moment=(0, 0, 0.4)))
    found = coarse(fb.solve_static(fb.compile_scene(scene)))
    assert found and all("between" in text and "node" in text for text in found)


def test_an_axis_that_was_compressed_through_nothing_is_named() -> None:
    # EA = 1e3 N: at -1 of strain the axis has no length any more
    soft = fb.Section(EA=1e3, GA2=1e3, GA3=1e3, GJ=1.0, EI2=1e3, EI3=1e3, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
    strut = fb.Beam.straight("strut", (0, 0, 0), (1, 0, 0), section=soft, elements=4)
    scene = fb.Scene(strut, fb.Clamp(strut.start), fb.Load("push", strut.end, force=(-1500.0, 0, 0)))
    try:
        events = fb.solve_static(fb.compile_scene(scene)).events
    except fb.ConvergenceError as failed:
        events = failed.result.events
        assert "compressed to zero length" in str(failed) or events
    assert any(event["kind"] == "reversed" for event in events)


def hoisted(elements: int, rounding: float, height: float = 6.0) -> list[str]:
    """A rope over a pulley, whose curve runs to a point or around it."""
    def curve(t: float) -> tuple[float, float, float]:
        return 0.05 * float(np.tanh(60.0 * (t - 0.5))), 0.0, -float(np.hypot(height * (1.0 - 2.0 * t), rounding))

    rope = fb.Beam.from_curve("rope", curve, section=WIRE, elements=elements)
    eye, car, weight = (fb.PointMass(name, mass=m) for name, m in (("pulley", 1.0), ("car", 1000.0), ("weight", 900.0)))
    model = fb.compile_scene(fb.Scene(rope, eye, car, weight, fb.Pin(eye), fb.Slider("sheave", eye, rope, at=rope.length / 2),
                                      fb.BallJoint(car, rope.end), fb.BallJoint(weight, rope.start), gravity=(0, 0, -9.81)))
    return [event["text"] for event in mesh_events(model, model.state())]


@pytest.mark.parametrize("elements", [12, 36, 37, 144])
def test_a_kink_of_the_curve_is_named_and_no_number_of_elements(elements: int) -> None:
    # its slopes are 12 down and 3 across on both sides
    (text,) = hoisted(elements, 0.0)
    assert text.startswith("beam 'rope', s = ") and "more than a right angle" in text and "; use " not in text
    found, at = (float(text.split(before)[1].split()[0]) for before in ("a kink of ", "rad at s = "))
    assert abs(found - 2.0 * np.arctan2(12.0, 3.0)) < 0.06 and abs(at - 6.003) < 2e-3


def test_a_bend_however_tight_is_none() -> None:
    (text,) = hoisted(37, 0.002)
    assert "kink" not in text and "; use " in text


def of_moving(result: fb.Result | list[dict[str, object]]) -> list[str]:
    events = result.events if isinstance(result, fb.Result) else result
    return [event["text"] for event in events if "moving elements" in event["text"]]


def on_a_helix(elements: int | np.ndarray) -> fb.Scene:
    """A bead on 4 turns of a steel wire, 5.17 m, whose curvature is 4.7 rad/m."""
    wire = fb.Beam.helix("wire", radius=0.2, pitch=-0.3, turns=4, elements=elements,
                         section=fb.Section.circle(radius=0.006, E=2.1e11, rho=7850.0))
    bead = fb.PointMass("bead", mass=0.05)
    return fb.Scene(wire, bead, fb.Clamp(wire.start), fb.Clamp(wire.end), fb.Slider("run", bead, wire, at=0.1),
                    gravity=(0, 0, -9.81))


def test_moving_elements_along_which_the_beam_turns_too_much_are_named() -> None:
    # 24 elements of 0.22 m, 1.0 rad, ahead of the bead: it went 0.39 m in 1.2 s, on 12 and 24 elements 2.98 m; 1.763 m is right
    # (24 and 48)
    model = fb.compile_scene(fb.with_moving_meshes(on_a_helix(48)))
    (text,) = of_moving(mesh_events(model, model.state()))
    length = float(model.moving.tables[0].length[0])
    turn, most = float(text.split("bends or twists by ")[1].split()[0]), float(text.split("shorter than ")[1].split()[0])
    # curvature and torsion of a helix of radius R and climb c: R/(R^2 + c^2), c/(R^2 + c^2)
    c = 0.3 / (2.0 * np.pi)
    rate = np.hypot(0.2, c) / (0.2**2 + c**2)
    # two digits are told
    assert turn == pytest.approx(rate * (length - 0.1) / 24, abs=0.05)
    assert most == pytest.approx(0.05**(1.0 / 6.0) / rate, abs=0.005)
    scene = on_a_helix(np.r_[np.linspace(0.0, 0.1, 25), np.linspace(0.1, length, 49)[1:]])
    model = fb.compile_scene(scene.add(fb.MovingMesh(scene.beams[0], scene.sliders)) or scene)
    assert of_moving(mesh_events(model, model.state())) == []
    # where the contact comes to: 24 elements of 0.14 m behind it
    state = model.state()
    state.s[0] = 3.5
    assert len(of_moving(mesh_events(model, state))) == 1


def test_moving_elements_that_a_contact_leaves_behind_are_named() -> None:
    def run(at: float, rate: float) -> fb.Result:
        """A ring on a level rope of 4 m with 20 elements, of one length at the start."""
        section = fb.Section(EA=2e5, GA2=8e4, GA3=8e4, GJ=0.02, EI2=0.02, EI3=0.02, rhoA=0.05, rhoI2=1e-8, rhoI3=1e-8)
        rope = fb.Beam.straight("rope", (0, 0, 0), (4, 0, 0), section=section, elements=20, prestress=200.0)
        ring = fb.PointMass("ring", mass=0.5)
        slider = fb.Slider("on", ring, rope, at=at, rate=rate)
        scene = fb.Scene(rope, ring, fb.Pin(rope.start), fb.Pin(rope.end), slider, fb.MovingMesh(rope, slider),
                         gravity=(0, 0, -9.81))
        return fb.simulate(fb.compile_scene(scene), t_end=0.5, step=5e-3, progress=False)
    (text,) = of_moving(run(0.2, 4.0))
    assert text.startswith("beam 'rope'") and "do not resolve the shape" in text
    # in the middle of its way, with as many elements on both sides
    assert of_moving(run(1.4, 2.4)) == []
