"""Sleeves: the compiled step against its slow twin, what it conserves, exact motions and exact equilibria."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.mapping import contact
from perf.validation.rows import reference

sys.path.insert(0, str(Path(__file__).parents[1]))
from exchange import balanced  # noqa: E402
from naive_sleeve import CurveFrameTwin, Sleeve, State  # noqa: E402

Array = np.ndarray
EXACT = reference("sliding_exact")
SOFT = fb.Section(EA=2e3, GA2=1e3, GA3=1.2e3, GJ=80.0, EI2=100.0, EI3=120.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
TUBE = fb.Section(EA=3e3, GA2=2e3, GA3=2e3, GJ=300.0, EI2=200.0, EI3=200.0, rhoA=1.5, rhoI2=0.1, rhoI3=0.1)
SLENDER = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
H = 0.02


def run(model: Any, t_end: float, step: float = H, **settings: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **settings)


def scene(kind: str, **sleeve: Any) -> fb.Scene:
    """A rod that bends, twists and slides through a sleeve: on a tumbling body, in the end of a flying tube, or fixed."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SOFT, elements=3, degree=2)
    common = dict(name=kind, project_velocities=True)
    if kind == "body":
        body = fb.RigidBody("body", mass=0.8, inertia=[[0.2, 0.01, 0], [0.01, 0.3, 0.02], [0, 0.02, 0.25]], position=(0.8, 0, 0),
                            velocity=(2.5, 0.3, -0.2), spin=(1.5, 0.4, -0.6))
        bend = fb.InitialVelocity(rod, velocity=lambda s: np.stack((0.1 + 0 * s, np.sin(s), np.cos(2 * s)), axis=1),
                                  spin=lambda s: np.stack((1.0 * s, 2 * np.sin(2 * s), np.cos(s)), axis=1))
        return fb.Scene(rod, body, bend, fb.Sleeve("sleeve", body, rod, at=0.8, **sleeve), **common)
    if kind == "telescope":
        tube = fb.Beam.straight("tube", (-2, 0, 0), (0.7, 0, 0), section=TUBE, elements=2, degree=2, d2=(0, 0, 1))
        pull = fb.InitialVelocity(rod, velocity=lambda s: np.stack((-2.5 + 0 * s, 0 * s, 0 * s), axis=1))
        return fb.Scene(tube, rod, pull, fb.RigidMotion(spin=(0.5, 0.3, 0.9), velocity=(0.1, 0.2, 0.3)),
                        fb.Sleeve("sleeve", tube.end, rod, at=0.7, **sleeve), **common)
    body = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=(1.7, 0, 0))
    push = fb.RigidMotion(rod, velocity=(-2.0, 0, 0), spin=(0.7 if sleeve.get("keyed") is False else 0.0, 0, 0))
    return fb.Scene(rod, body, push, fb.Clamp(body), fb.Sleeve("sleeve", body, rod, at=1.7, **sleeve),
                    gravity=(0.0, 1.0, -2.0), **common)


KINDS = ["body", "telescope", "held"]


# --- the twin -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("length", [None, 0.0], ids=["bore", "point"])
@pytest.mark.parametrize("keyed", [True, False], ids=["keyed", "twist free"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_compiled_step_is_that_of_the_twin(kind: str, keyed: bool, length: float | None) -> None:
    described = scene(kind, keyed=keyed, length=length)
    model = fb.compile_scene(described, planar=False)
    sleeve = described.sleeves[0]
    turn = model.sleeves.axes.reshape(3, 3)
    own = Sleeve(sleeve.point.owner if kind != "telescope" else sleeve.point, sleeve.beam, sleeve.at, keyed, bore=sleeve.length,
                 turn=turn)
    alone = fb.Scene(*[part for part in described.parts if part is not sleeve], gravity=described.gravity)
    twin = CurveFrameTwin(alone, fb.compile_scene(alone, planar=False), own)
    first = model.state()
    state = State(first.q.reshape(-1, 4, 3), first.v.reshape(-1, 4, 3), first.s, np.zeros(twin.rows[-1]))
    for n in range(1, 4):
        state, _ = twin.advance(state, H)
        found = run(model, n * H).state
        assert np.abs(found.q - state.q.reshape(-1)).max() < 1e-11
        assert abs(found.s[0] - state.s[0]) < 1e-11
        np.testing.assert_allclose(found.force[:len(state.m)], state.m, rtol=1e-6, atol=1e-8)


# --- what stays ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("length", [None, 0.0], ids=["bore", "point"])
@pytest.mark.parametrize("keyed", [True, False], ids=["keyed", "twist free"])
@pytest.mark.parametrize("kind", KINDS)
def test_energy_momenta_and_conditions_stay_and_the_way_back_is_the_same(kind: str, keyed: bool, length: float | None,
                                                                       order: int) -> None:
    model = fb.compile_scene(scene(kind, keyed=keyed, length=length), planar=False)
    result = run(model, 0.4, order=order)
    assert result.drift("total") < 1e-12 and result.drift("gap") < 1e-12
    assert abs(result.slider("sleeve")["s"][-1] - result.slider("sleeve")["s"][0]) > 0.5
    if kind != "held":
        assert result.drift("lin_mom") < 1e-12 and result.drift("ang_mom") < 1e-12
    back = run(model, 0.4, order=order, start=result.state._replace(v=-result.state.v))
    off = np.abs(back.state.q - model.q0).max(), np.abs(back.state.s - model.s0).max()
    print(f"there and back: {off[0]:.1e} m, s {off[1]:.1e} m")
    assert max(off) < 1e-12


@pytest.mark.parametrize("keyed", [True, False], ids=["keyed", "twist free"])
def test_directions_stay_to_the_last_digit(keyed: bool) -> None:
    from fastbeam.model.contact.sleeve_conditions import sections
    model = fb.compile_scene(scene("body", keyed=keyed), planar=False)
    state = run(model, 0.4).state
    found = sections(model, state.s, state.q.reshape(-1, 4, 3))[0]
    assert np.abs(found.values()).max() < 1e-14
    # the twist of a rod that is free to turn does so
    whole = found._replace(pairs=3)
    assert (abs(whole.values()[2]) < 1e-14) == keyed


def flat(**sleeve: Any) -> fb.Scene:
    """A telescope that flies, turns and bends in a plane; the sections of both parts stand differently."""
    tube = fb.Beam.straight("tube", (-2, 0, 0), (0.7, 0, 0), section=TUBE, elements=2, degree=3, d2=(0, 0, 1))
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=TUBE, elements=3, degree=3, d2=(0, 1, 0))
    return fb.Scene(tube, rod, fb.RigidMotion(rod, velocity=(-2.5, 0, 0)),
                    fb.RigidMotion(spin=(0, 0, 0.9), velocity=(0.1, 0.2, 0)),
                    fb.Sleeve("sleeve", tube.end, rod, at=0.7, **sleeve))


@pytest.mark.parametrize("keyed", [True, False], ids=["keyed", "twist free"])
def test_in_a_plane_it_is_the_same(keyed: bool) -> None:
    results = []
    for planar in (True, False):
        results.append(run(fb.compile_scene(flat(keyed=keyed), planar=planar), 0.4))
    a, b = results
    assert np.abs(a.state.q - b.state.q).max() < 1e-13 and abs(a.state.s[0] - b.state.s[0]) < 1e-14
    for name in ("contact_force", "contact_moment"):
        size = np.abs(b.series[name]).max()
        np.testing.assert_allclose(a.series[name][2:-2], b.series[name][2:-2], atol=1e-9 * size)
    assert a.drift("total") < 1e-13 and a.drift("ang_mom") < 1e-13


@pytest.mark.parametrize("solver", ["sparse", "condensed"])
def test_other_solvers_find_the_same(solver: str) -> None:
    options: dict[str, Any] = {"solver": "sparse"} if solver == "sparse" else {"condense": True}
    results = [run(fb.compile_scene(flat(), planar=False, **more), 0.2) for more in ({}, options)]
    assert np.abs(results[0].state.q - results[1].state.q).max() < 1e-12
    assert results[1].drift("total") < 1e-12


# --- directions of a round beam ---------------------------------------------------------------------------------------------
def bent(angle: float, d2: tuple[float, float, float] = (0.0, 1.0, 0.0), twisted: float = 0.0) -> fb.Scene:
    """A round cantilever with a keyed sleeve that is fixed in space inside one of its elements, bent in a plane that is turned by
    `angle` about it, and twisted by a moment."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=fb.Section(
        EA=1e5, GA2=4e4, GA3=4e4, GJ=4.0, EI2=5.0, EI3=5.0, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5), elements=4, d2=d2)
    holder = fb.RigidBody("holder", mass=0.2, inertia=(1e-3, 1e-3, 1e-3), position=(0.37, 0, 0))
    across = np.array((0.0, np.cos(angle), np.sin(angle)))
    return fb.Scene(rod, holder, fb.Sleeve("sleeve", holder, rod, at=0.37), fb.Clamp(holder), fb.Clamp(rod.start),
                    fb.Load("end", rod.end, force=3.0 * across, moment=3.0 * np.cross((1, 0, 0), across) + (twisted, 0, 0)))


def test_a_keyed_sleeve_does_not_know_how_a_round_beam_stands_about_its_axis() -> None:
    first, *others = [fb.solve_static(fb.compile_scene(bent(angle), planar=planar))
                      for angle in (0.0, 0.3, 0.9) for planar in (True, False)]
    tip = first.state.q.reshape(-1, 4, 3)[:, 0]
    for found, angle in zip(others, (0.0, 0.3, 0.3, 0.9, 0.9)):
        turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
        # 2e-16 in each; 6e-11 where d_2 and d_3 are held in different ways
        assert np.abs(found.state.q.reshape(-1, 4, 3)[:, 0] - tip @ turn.T).max() < 2e-14
        assert abs(found.state.s[0] - first.state.s[0]) < 2e-14
    # not in a plane, with d_2 elsewhere in the same beam
    twisted = [fb.solve_static(fb.compile_scene(bent(0.4, d2, 1.5))).state.q.reshape(-1, 4, 3)[:, :2]
               for d2 in ((0, 1, 0), (0, 0.6, 0.8), (0, -0.8, 0.6))]
    assert max(np.abs(x - twisted[0]).max() for x in twisted[1:]) < 1e-13


def test_equilibria_with_sleeves_are_those_of_every_analysis() -> None:
    found = [fb.solve_static(fb.compile_scene(bent(0.9), planar=planar)).state for planar in (True, False)]
    for planar in (True, False):
        model = fb.compile_scene(bent(0.9), planar=planar)
        frequencies = []
        for state in found:
            rest = run(model, 0.002, 1e-3, start=state)
            assert np.abs(rest.state.q - state.q).max() < 1e-12
            frequencies.append(fb.modes(model, state=state, n=3).frequencies)
        np.testing.assert_allclose(frequencies[1], frequencies[0], rtol=1e-9)


def test_a_body_centred_in_its_sleeve_has_damped_modes() -> None:
    """Its spin meets the moments of the sleeve alone, which are round-off: no moment is fixed in space. A wire that is held there
    by a spring of 30 N/m, and rubs by 0.1 N s/m: m x'' + c x' + k x = 0 along the beam."""
    rod = bent(0.0).beams[0]
    body = fb.RigidBody("body", mass=0.2, inertia=(1e-3, 1e-3, 1e-3), position=(0.37, 0, 0))
    post = fb.PointMass("post", mass=1.0, position=(0.5, 0, 0))
    ring = fb.Sleeve("ring", body, rod, at=0.37, keyed=False, friction=fb.Friction(viscous=0.1))
    model = fb.compile_scene(fb.Scene(rod, body, post, ring, fb.Pin(post), fb.Clamp(rod.start),
                                      fb.Spring(body, post, stiffness=30.0)), planar=False)
    found = fb.modes(model, n=3, damped=True).rates
    expected = -0.25 + 1j * np.sqrt(30.0 / 0.2 - 0.25**2)
    # 9e-8: friction stretches the wire, by c w 0.37 m/EA of the way of the body, times c/(2 m w)
    assert np.abs(found - expected).min() < 3e-7 * abs(expected)


# --- exact motions ------------------------------------------------------------------------------------------------------
def rigid_rod(begin: float, length: float, mass: float, inertia: float) -> tuple[fb.Beam, fb.RigidConnection]:
    """A straight rod along x of a given moment of inertia about its centre, made rigid by a connection of its two nodes."""
    rotary = (inertia - mass * length**2 / 12.0) / length
    section = fb.Section(EA=1.0, GA2=1.0, GA3=1.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=mass / length, rhoI2=rotary, rhoI3=1e-3)
    rod = fb.Beam.straight("rod", (begin, 0, 0), (begin + length, 0, 0), section=section, elements=1, degree=1, d2=(0, 1, 0))
    return rod, fb.RigidConnection(rod.start, rod.end)


def rotor(kind: str, planar: bool) -> tuple[fb.Model, int]:
    """A body of 1 kg on a rod that turns about its pinned end, or a rod in a sleeve that turns freely about its centre; most of
    the mass of the second one in a body at the middle of the rod. With the number of the body that moves outwards."""
    if kind == "pivoted":
        rod, stays = rigid_rod(0.0, 1.5, 0.6, 0.5 - 0.6 * 0.75**2)
        body = fb.RigidBody("body", mass=1.0, inertia=(0.2, 0.3, 0.5), position=(0.1, 0, 0))
        parts, at, moves = [fb.Pin(rod.start)], 0.1, body
    else:
        rod, stays = rigid_rod(-1.4, 3.0, 0.3, 0.23)
        body = fb.RigidBody("body", mass=1.0, inertia=(0.5, 0.5, 0.5), position=(0, 0, 0))
        most = fb.RigidBody("most", mass=0.7, inertia=(0.06, 0.06, 1.0 / 3.0 - 0.23), position=(0.1, 0, 0))
        parts, at, moves = [fb.Pin(body), most, fb.RigidConnection(rod.start, most)], 1.4, most
    model = fb.compile_scene(fb.Scene(rod, body, stays, *parts, fb.RigidMotion(spin=(0, 0, 2.0)),
                                      fb.Sleeve("sleeve", body, rod, at=at, length=0.0)), planar=planar)
    return model, model.numbers.number(moves.center)


ROTORS = [("pivoted", row) for row in EXACT["pivoted_rod"][1:3]] + [("turning", row) for row in EXACT["turning_sleeve"]]


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize(("kind", "row"), ROTORS, ids=[f"{kind} {row['r']:g}" for kind, row in ROTORS])
def test_rigid_rotors_meet_their_exact_motion(kind: str, row: dict[str, float], planar: bool) -> None:
    """Distance from the axis and its rate, from 0.1 m at rest, by two extrapolations in the step of an order 2."""
    model, moves = rotor(kind, planar)
    errors = []
    for n in (20, 40, 80, 160):
        state = run(model, row["t"], row["t"] / n).state
        place, velocity = (x.reshape(-1, 4, 3)[moves, 0] for x in (state.q, state.v))
        out = float(np.linalg.norm(place))
        assert abs(out - 0.1 - abs(state.s[0] - model.s0[0])) < 1e-13
        errors.append((out - row["r"], velocity @ place / out - row["rdot"]))
    off = np.array(errors)
    assert np.all(np.abs(off[:-1] / off[1:] - 4.0) < 0.05)
    once = (4.0 * off[1:] - off[:-1]) / 3.0
    twice = (16.0 * once[1:] - once[:-1]) / 15.0
    print(f"{kind} {row['r']}: errors {off[-1]}, extrapolated {twice[-1]}, ratios {off[:-1] / off[1:]}")
    assert np.all(np.abs(twice[-1]) < 1e-9)


def test_a_bent_rod_is_driven_out_alike_wherever_an_element_begins() -> None:
    """M^2/2EI does not depend on the place inside an element. Of a point on the own curve a rod whose element ends there hardly
    moves."""
    def way(start: float, length: float | None) -> float:
        rod = fb.Beam.straight("rod", (start - 0.5, 0, 0), (start + 0.5, 0, 0), section=SLENDER, elements=20)
        body = fb.RigidBody("holder", mass=1, inertia=(1, 1, 1), position=(0, 0, 0))

        def ramp(t: float) -> float:
            x = min(2.0 * t, 1.0)
            return x * x * (3.0 - 2.0 * x)

        tip = fb.Load("tip", rod.end, force=(0, -1.0, 0), time=ramp)
        other = fb.Load("other", rod.start, force=(0, -0.2, 0), time=ramp)
        model = fb.compile_scene(fb.Scene(rod, body, fb.Clamp(body), tip, other,
                                          fb.Sleeve("sleeve", body, rod, at=0.5 - start, length=length, curve="own")))
        result = run(model, 1.0, 1e-3)
        assert result.drift("balance") < 1e-12
        return float(model.s0[0] - result.state.s[0])

    # places from an element end to the next; the free length changes by less than 2 % in between
    bore = np.array([way(x, None) for x in np.linspace(0.0, 0.04, 5)])
    trend = np.polyval(np.polyfit(np.arange(5), bore, 1), np.arange(5))
    assert np.all(bore > 0.005) and np.abs(bore / trend - 1.0).max() < 0.02
    point = np.array([way(x, 0.0) for x in np.linspace(0.0, 0.04, 5)])
    trend = np.polyval(np.polyfit(np.arange(5), point, 1), np.arange(5))
    assert np.abs(point / trend - 1.0).max() > 0.1


# --- equilibria ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("length", [None, 0.0], ids=["bore", "point"])
def test_a_sleeve_carries_the_moment_of_a_load(length: float | None, planar: bool) -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SLENDER, elements=8)
    body = fb.RigidBody("holder", mass=1, inertia=(1, 1, 1), position=(1, 0, 0))
    model = fb.compile_scene(fb.Scene(rod, body, fb.Clamp(body), fb.Load("tip", rod.end, force=(0, -0.1, 0)),
                                      fb.Sleeve("sleeve", body, rod, at=1.0, length=length)), planar=planar)
    result = fb.solve_static(model, held=("sleeve",))
    tip = result.state.q.reshape(-1, 4, 3)[model.numbers.number(rod.end), 0]
    np.testing.assert_allclose(result.series["contact_force"][-1], [[0.0, -0.1, 0.0]], atol=1e-12)
    np.testing.assert_allclose(result.series["contact_moment"][-1], [[0.0, 0.0, -0.1 * (tip[0] - 1.0)]], atol=1e-6)
    # and stays there in time, with the same force and moment
    moved = run(model, 0.05, 1e-3, start=result.state)
    np.testing.assert_allclose(moved.series["contact_moment"][1], result.series["contact_moment"][-1], rtol=0.02)


def test_a_telescope_hangs_from_its_tube() -> None:
    """A rod in the end of a clamped tube, both horizontal, a spring at its inner end."""
    tube = fb.Beam.straight("tube", (0, 0, 0), (1, 0, 0), section=TUBE, elements=4)
    rod = fb.Beam.straight("rod", (0.4, 0, 0), (1.9, 0, 0), section=TUBE, elements=6)
    model = fb.compile_scene(fb.Scene(tube, rod, fb.Clamp(tube.start), fb.Sleeve("end", tube.end, rod, at=0.6),
                                      fb.Slider("inner", rod.start, tube, at=0.4),
                                      fb.Spring(tube.node(3), rod.start, stiffness=1e3, length=0.2), gravity=(0, 0, -1.0)))
    result = fb.solve_static(model)
    # its bores are as long as elements
    assert {event["kind"] for event in result.events} <= {"contact"} and np.all(np.isfinite(result.series["contact_moment"]))
    q = result.state.q.reshape(-1, 4, 3)
    assert q[model.numbers.number(rod.end), 0, 2] < -1e-3
    assert result.info["unstable_directions"] == 0


# --- with all the rest ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", [True, False])
def test_friction_drives_and_stops_keep_the_books(planar: bool) -> None:
    for forces in (dict(friction=0.2, length=0.3), dict(drive=fb.Drive(speed=-0.5)),
                   dict(stops=fb.Stops(0.1, 1.4, restitution=0.5)), dict(stops=fb.Stops(0.1, 1.4, stiffness=500.0))):
        described = flat(**forces)
        if "drive" in forces:
            described.project_velocities = True
        result = run(fb.compile_scene(described, planar=planar), 0.6)
        assert balanced(result), forces
        assert result.drift("ang_mom") < 1e-12 and result.drift("lin_mom") < 1e-12


@pytest.mark.parametrize("planar", [True, False])
def test_friction_in_a_step_is_that_of_the_force_and_of_the_moments(planar: bool) -> None:
    model = fb.compile_scene(flat(friction=0.2, length=0.3), planar=planar)
    before = run(model, 0.2).state
    step = run(model, 0.2002, 2e-4, start=fb.Start(before, time=0.2))
    tangent = np.mean([contact(model, 0, x.s[0], *2 * (x.q.reshape(-1, 4, 3),))[1] for x in (before, step.state)], axis=0)
    long = np.linalg.norm(tangent)
    force, moments = step.state.force[:3], step.state.force[3:6]
    across, bending = np.linalg.norm(np.cross(force, tangent)) / long, np.hypot(*moments[:2])
    # both count
    assert 0.1 < 2.0 * bending / 0.3 / across < 100.0
    loss = step.slider("sleeve")["friction_loss"][-1] - step.slider("sleeve")["friction_loss"][0]
    way = abs(step.state.s[0] - before.s[0])
    assert way > 0.0 and loss / way == pytest.approx(0.2 * (across + 2.0 * bending / 0.3) * long, rel=1e-4)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("planar", [True, False])
def test_the_drive_of_a_sleeve_holds_a_bent_rod_against_what_pushes_it_out(planar: bool, moving: bool) -> None:
    """A rod with a load at one end, whose place is prescribed: the drive gives M^2/2EI + Q^2/2GA at the exit, less what the load
    pushes back along the rod there; so much that the energy of the equilibrium falls with s."""
    def held(at: float) -> tuple[float, float, fb.Result]:
        rod = fb.Beam.straight("rod", (-at, 0, 0), (2.0 - at, 0, 0), section=SLENDER, elements=16)
        body = fb.RigidBody("holder", mass=1, inertia=(1, 1, 1), position=(0, 0, 0))
        model = fb.compile_scene(fb.Scene(rod, body, fb.Clamp(body), fb.Load("tip", rod.end, force=(0, -0.3, 0)),
                                          fb.Sleeve("sleeve", body, rod, at=at, drive=fb.Drive(position=at))),
                                 planar=planar, moving=moving)
        still = fb.solve_static(model, held=("sleeve",))
        return float(still.series["potential"][-1]), float(still.series["drive_force"][-1, 0]), still

    step = 1e-4
    _, drive, _ = held(1.03)
    slope = (held(1.03 + step)[0] - held(1.03 - step)[0]) / (2.0 * step)
    # of moving elements, whose forces along the beam balance but for the error of the mesh
    assert drive == pytest.approx(slope, rel=2e-5 if moving else 1e-6)
    # a point sleeve needs M^2/2EI; the bore is an eighth of a metre long
    assert abs(drive) == pytest.approx(0.5 * (0.3 * 0.97)**2, rel=0.15)


@pytest.mark.parametrize("order", [2, 4])
def test_two_halves_are_the_whole_bit_for_bit(order: int) -> None:
    model = fb.compile_scene(flat())
    whole = run(model, 0.4, order=order)
    half = run(model, 0.2, order=order)
    rest = run(model, 0.4, order=order, start=half.checkpoint)
    for x, y in zip(rest.state, whole.state):
        np.testing.assert_array_equal(x, y)
    for name in ("contact_force", "contact_moment", "total"):
        np.testing.assert_array_equal(rest.series[name], whole.series[name][len(half.t) - 1:])
