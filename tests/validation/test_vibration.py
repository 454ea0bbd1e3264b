"""Natural vibrations against exact frequencies of the same model, published limits, and runs in time."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense
from scipy.optimize import brentq

import fastbeam as fb
from fastbeam.results.mode_shapes import Modes

sys.path.insert(0, str(Path(__file__).parents[1]))
import spectral  # noqa: E402

Array = np.ndarray
G = 9.81
L, EI, GA, EA, RHO_A, RHO_I = 10.0, 1e3, 1e5, 2e5, 1.0, 0.05
THICK = fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1e3, EI2=EI, EI3=EI, rhoA=RHO_A, rhoI2=RHO_I, rhoI3=RHO_I)
SUPPORTS = {"c": fb.Clamp, "p": fb.Pin}


def nearest(found: Modes, exact: float) -> float:
    """Relative distance of the nearest frequency."""
    return float(np.min(np.abs(found.angular - exact))) / exact


# --- beams ----------------------------------------------------------------------------------------------------------------
def determinant(w: float, ends: str) -> float:
    """Zero at the natural frequencies of a Timoshenko beam, by the matrix exponential of its four first-order equations."""
    a = np.array([[0, 1, 0, 1 / GA], [0, 0, 1 / EI, 0], [0, -RHO_I * w * w, 0, -1], [-RHO_A * w * w, 0, 0, 0]])
    held = {"c": [0, 1], "p": [0, 2], "f": [2, 3]}
    free = [i for i in range(4) if i not in held[ends[0]]]
    return float(np.linalg.det(dense.expm(a * L)[np.ix_(held[ends[1]], free)]))


def exact_beam(ends: str, n: int) -> list[float]:
    w = np.linspace(0.05, 40.0, 1000)
    values = np.array([determinant(x, ends) for x in w])
    cuts = np.flatnonzero(values[1:] * values[:-1] < 0.0)[:n]
    return [brentq(determinant, w[k], w[k + 1], args=(ends,), xtol=1e-14, rtol=1e-14) for k in cuts]


def beam_modes(ends: str, elements: int, degree: int = 3) -> Modes:
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=THICK, elements=elements, degree=degree)
    held = [SUPPORTS[end](node) for end, node in zip(ends, (beam.start, beam.end)) if end != "f"]
    return fb.modes(fb.compile_scene(fb.Scene(beam, *held)))


@pytest.mark.parametrize(("ends", "free"), [("cf", 0), ("cc", 0), ("cp", 0), ("pp", 1), ("ff", 6)])
def test_timoshenko_beams_of_all_supports_converge_with_order_six(ends: str, free: int) -> None:
    exact = exact_beam(ends, 3)
    meshes = [beam_modes(ends, n) for n in (4, 8, 16)]
    errors = np.array([[nearest(found, w) for w in exact] for found in meshes])
    found = meshes[-1]
    # pairs in both planes; rigid motions, and the spin of a pinned beam about its axis, are zeros
    assert int(np.sum(found.squared == 0.0)) == free and found.is_complete and found.unstable == 0
    assert np.max(found.residuals[free:]) < 1e-11
    rates = np.log2(errors[:-1, 1:] / errors[1:, 1:])
    assert np.all(rates[-1] > 5.8), rates
    assert errors[-1, 0] < 2e-8
    fine = beam_modes(ends, 16, 5)
    assert max(nearest(fine, w) for w in exact) < 2e-9


def test_ring_of_two_lobes_and_three_converges_with_order_six() -> None:
    """Free ring with shear and extension: u_r = A cos, u_t = B sin, turn C sin of n phi."""
    radius = 1.0
    lagging = []
    for n in (2, 3):
        strain = np.array([[1 / radius, n / radius, 0], [-n / radius, -1 / radius, 1], [0, 0, n / radius]])
        stiffness = strain.T @ np.diag([EA, GA, EI]) @ strain
        lagging.append(np.sqrt(dense.eigh(stiffness, np.diag([RHO_A, RHO_A, RHO_I]), eigvals_only=True)[0]))
    errors = []
    for elements in (16, 32, 96):
        ring = fb.Beam.arc("ring", (radius, 0, 0), (0, 1, 0), (-1, 0, 0), radius=radius, angle=2 * np.pi, section=THICK,
                           elements=elements, degree=3)
        found = fb.modes(fb.compile_scene(fb.Scene(ring, fb.RigidConnection(ring.start, ring.end))), n=24)
        assert int(np.sum(found.squared == 0.0)) == 6
        errors.append([np.sort(np.abs(found.angular / w - 1.0))[:2] for w in lagging])
    first, second, third = np.array(errors)
    assert np.all(np.abs(second[:, 0] - second[:, 1]) < 1e-8), "each twice"
    assert np.all(np.log2(first / second) > 5.8) and np.max(second[0]) < 3e-7
    assert np.max(third) < 1e-8


# --- strings, cables and chains -------------------------------------------------------------------------------------------
def stretched(strain: float, elements: int, degree: int, section: fb.Section = THICK) -> tuple[Modes, fb.Result]:
    """A beam between two pins that stand apart by its length and a strain."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=section, elements=elements, degree=degree)
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end)))
    start = model.state()
    start.q.reshape(-1, 4, 3)[:, 0] *= 1.0 + strain
    result = fb.solve_static(model, start=start)
    return fb.modes(model, state=result.state, n=12), result


def exact_stretched(strain: float, n: int) -> float:
    """Of w = W sin k s, turn = C cos k s on a stretched beam with shear and rotary inertia; for stiff thin beams
    w^2 = (n pi/L)^4 EI/rhoA + (n pi/L)^2 T/rhoA."""
    k, tension = n * np.pi / L, EA * strain
    c = (1 + strain) * GA - tension
    stiffness = np.array([[GA * k * k, -c * k], [-c * k, EI * k * k + c * (1 + strain)]])
    return float(dense.eigh(stiffness, np.diag([RHO_A, RHO_I]), eigvals_only=True)[0])


def test_tensioned_beam() -> None:
    strain = 1e-3
    found, _ = stretched(strain, 8, 5)
    for n in (1, 2, 3):
        exact = exact_stretched(strain, n)
        assert nearest(found, np.sqrt(exact)) < 1e-9
    k = np.pi / L
    assert exact_stretched(strain, 1) == pytest.approx(k**4 * EI / RHO_A + k**2 * EA * strain / RHO_A, rel=0.03)


def test_beam_pressed_beyond_its_euler_load_grows_in_both_planes() -> None:
    strain = -1.2 * EI * (np.pi / L)**2 / EA
    found, result = stretched(strain, 8, 5)
    assert result.info["counted_in"] == "space" and result.info["unstable_directions"] == found.unstable == 2
    assert found.squared[2] == 0.0 < found.squared[3]
    exact = exact_stretched(strain, 1)
    np.testing.assert_allclose(found.squared[:2], exact, rtol=1e-8)
    np.testing.assert_allclose(found.growth[:2], np.sqrt(-exact), rtol=1e-8)
    assert np.all(found.frequencies[:2] == 0.0)


def hanging(elements: int, stiffness: float) -> Modes:
    rope = fb.Section(EA=stiffness, GA2=stiffness, GA3=stiffness, GJ=1.0, EI2=1e-9, EI3=1e-9, rhoA=1.0, rhoI2=1e-10,
                      rhoI3=1e-10)
    chain = fb.Beam.straight("chain", (0, 0, 0), (0, 0, -1), section=rope, elements=elements, degree=4)
    held = fb.solve_static(fb.compile_scene(fb.Scene(chain, fb.Clamp(chain.start), gravity=(0, 0, -G))))
    model = fb.compile_scene(fb.Scene(chain, fb.Pin(chain.start), gravity=(0, 0, -G)))
    return fb.modes(model, state=held.state_for(model), n=6)


def test_hanging_chain() -> None:
    """In the limit of an inextensible chain, w sqrt(L/g) = j/2 with the zeros j of J0."""
    exact = np.array([1.20241277884789, 2.76003905514316])
    rows = []
    for stiffness in (1e3, 2e3, 4e3, 8e3):
        w = hanging(16, stiffness).angular * np.sqrt(1.0 / G)
        rows.append([w[np.argmin(np.abs(w - x))] for x in exact])
    table = np.array(rows)
    for k in (1, 2, 3):
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    np.testing.assert_allclose(table[0], exact, rtol=1e-8)


def test_sagging_cable_of_irvine() -> None:
    """Symmetric modes in the plane for lambda^2 = 10: tan x = x - 4 x^3/lambda^2, in the limit of a small sag."""
    exact = 1.34512451139044
    rows = []
    for sag in (0.02, 0.01, 0.005):
        stiffness = 10.0 / (64.0 * sag**2)
        rope = fb.Section(EA=stiffness, GA2=stiffness, GA3=stiffness, GJ=1e-3, EI2=1e-9, EI3=1e-9, rhoA=1.0, rhoI2=1e-9,
                          rhoI3=1e-9)
        cable = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0), section=rope, elements=24, degree=4)
        scene = fb.Scene(cable, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -8.0 * sag))
        model = fb.compile_scene(scene, planar=True)
        start = model.state()
        x = start.q.reshape(-1, 4, 3)[:, 0]
        s = x[:, 0].copy()
        x[:, 0], x[:, 2] = s * (1.0 + 1.0 / stiffness - 8.0 / 3.0 * sag**2), -4.0 * sag * s * (1.0 - s)
        found = fb.modes(model, state=fb.solve_static(model, start=start).state, n=6)
        assert found.info["moves_in"] == "plane"
        ratio = found.angular / np.pi
        rows.append(ratio[np.argmin(np.abs(ratio - exact))])
    table = np.array(rows)
    for k in (2, 4):
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    assert table[0] == pytest.approx(exact, rel=1e-6)


def sagging(sag: float, bending: float, points: int, inertia: float = 1e-6) -> tuple[spectral.Rod, Array]:
    """A cable of lambda^2 = 10 and its equilibrium, by Chebyshev polynomials."""
    stiffness = 10.0 / (64.0 * sag**2)
    end = 1.0 + 1.0 / stiffness - 8.0 / 3.0 * sag**2
    rod = spectral.Rod(1.0, stiffness, stiffness, bending, 1.0, inertia, (spectral.PIN, spectral.PIN), points=points,
                       values=((0.0,) * 3, (end, 0.0, 0.0)), load=(0.0, -8.0 * sag))
    return rod, rod.equilibrium(spectral.guess(rod, lambda s: s, lambda s: -4.0 * sag * s * (1.0 - s), np.ones_like))


def test_chebyshev_polynomials_find_exact_beams_and_the_cable_of_irvine() -> None:
    """The reference of the next tests itself."""
    for ends, held in (("cf", (spectral.CLAMP, spectral.FREE)), ("cp", (spectral.CLAMP, spectral.PIN))):
        rod = spectral.Rod(L, EA, GA, EI, RHO_A, RHO_I, held, ((0.0,) * 3, (L if ends == "cp" else 0.0, 0.0, 0.0)))
        y = np.zeros((6, rod.points))
        y[spectral.X] = rod.s
        found = rod.angular(rod.equilibrium(y))
        assert max(np.min(np.abs(found / w - 1.0)) for w in exact_beam(ends, 3)) < 1e-9
    table = []
    for sag in (0.04, 0.02, 0.01, 0.005):
        # bending stiffens by its share of k^2, and by what the ends add
        bending = np.array([4e-5, 2e-5, 1e-5])
        found = [rod.angular(y)[0] / np.pi for rod, y in (sagging(sag, x, 80, 1e-10) for x in bending)]
        table.append(np.linalg.solve(np.stack((np.ones(3), bending, bending**1.5), axis=1), found)[0])
    for k in (2, 4, 6):
        table = [(2**k * b - a) / (2**k - 1) for a, b in zip(table, table[1:])]
    assert table[0] == pytest.approx(1.34512451139044, rel=1e-6)


@pytest.mark.parametrize("bending", [1e-3, 1e-6])
def test_a_sagging_cable_converges_with_order_six(bending: float) -> None:
    """With sag, stretch, shear and bending: nothing is a limit."""
    sag = 0.05
    rod, y = sagging(sag, bending, 40 if bending > 1e-4 else 160)
    exact = rod.angular(y)[:3]
    errors = []
    for elements in (8, 16, 32):
        rope = fb.Section(EA=rod.EA, GA2=rod.GA, GA3=rod.GA, GJ=1e-3, EI2=bending, EI3=bending, rhoA=1.0, rhoI2=1e-6, rhoI3=1e-6)
        cable = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0), section=rope, elements=elements, degree=3)
        model = fb.compile_scene(fb.Scene(cable, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -8.0 * sag)), planar=True)
        start = model.state()
        x = start.q.reshape(-1, 4, 3)[:, 0]
        s = x[:, 0].copy()
        x[:, 0], x[:, 2] = s * rod.values[1][0], -4.0 * sag * s * (1.0 - s)
        found = fb.modes(model, state=fb.solve_static(model, start=start).state, n=6)
        errors.append([nearest(found, w) for w in exact])
    first, second, third = np.array(errors)
    assert np.all(np.log2(second / third)[1:] > 5.8) and np.all(third < 1e-8)


def test_a_hanging_chain_with_bending_converges_with_order_eight() -> None:
    """Its lower end, without tension, bends most."""
    bending, stiffness = 1e-2, 1e3
    rod = spectral.Rod(1.0, stiffness, stiffness, bending, 1.0, 1e-6, (spectral.PIN, spectral.FREE), load=(G, 0.0))
    y = rod.equilibrium(spectral.guess(rod, lambda s: s, np.zeros_like, lambda s: G * (1.0 - s)))
    exact = rod.angular(y)[:3]
    assert exact[0] == pytest.approx(1.20241277884789 * np.sqrt(G), rel=0.01)
    rope = fb.Section(EA=stiffness, GA2=stiffness, GA3=stiffness, GJ=1.0, EI2=bending, EI3=bending, rhoA=1.0, rhoI2=1e-6,
                      rhoI3=1e-6)
    errors = []
    for elements in (8, 16):
        chain = fb.Beam.straight("chain", (0, 0, 0), (0, 0, -1), section=rope, elements=elements, degree=4)
        held = fb.solve_static(fb.compile_scene(fb.Scene(chain, fb.Clamp(chain.start), gravity=(0, 0, -G))))
        model = fb.compile_scene(fb.Scene(chain, fb.Pin(chain.start), gravity=(0, 0, -G)), planar=True)
        found = fb.modes(model, state=held.state_for(model), n=6)
        errors.append([nearest(found, w) for w in exact])
    first, second = np.array(errors)
    assert np.all(np.log2(first / second)[1:] > 7.6) and np.all(second < 1e-8)


# --- sliders --------------------------------------------------------------------------------------------------------------
STRING = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1e-3, EI3=1e-3, rhoA=0.1, rhoI2=1e-6, rhoI3=1e-6)


def bead_on_string(at: float, gravity: float, elements: int = 15, section: fb.Section = STRING,
                   curve: str = "c1") -> tuple[Any, fb.PointMass, Any]:
    string = fb.Beam.straight("string", (0, 0, 0), (2, 0, 0), section=section, elements=elements, degree=3)
    bead = fb.PointMass("bead", mass=0.3)
    slider = fb.Slider("ride", bead, string, at=at, curve=curve)
    pins = fb.Pin(string.start), fb.Pin(string.end)
    model = fb.compile_scene(fb.Scene(string, bead, *pins, slider, gravity=(0, 0, -gravity)))
    start = model.state()
    start.q.reshape(-1, 4, 3)[:, 0, 0] *= 1.01
    return model, bead, fb.solve_static(model, start=start, held=gravity == 0.0).state


def test_bead_on_a_string_converges_with_order_six() -> None:
    """Across: sqrt(T rho) (cot(k a) + cot(k (L - a))) = m w; along the string it is free. Where GA (1 + e) is the tension, turns
    of the sections do not take part (`exact_stretched`), so that the string may have the kink that it has under the bead."""
    shear, rho, mass = 1e4 * 0.01 / 1.01, 0.1, 0.3
    string = fb.Section(EA=1e4, GA2=shear, GA3=shear, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=rho, rhoI2=1e-4, rhoI3=1e-4)

    def misfit(w: float) -> float:
        x = w / np.sqrt(shear / rho)
        return float(np.sqrt(shear * rho) * (1.0 / np.tan(0.8 * x) + 1.0 / np.tan(1.2 * x)) - mass * w)

    exact = brentq(misfit, 1.0, 40.0, xtol=1e-13), brentq(misfit, 83.0, 90.0, xtol=1e-13)
    errors = []
    for elements in (5, 10, 20):
        model, _, state = bead_on_string(0.8, 0.0, elements, string, "own")
        found = fb.modes(model, state=state, n=30)
        errors.append([nearest(found, w) for w in exact])
        # the other free motions are turns of all sections
        assert np.all(np.abs(found.squared[:5]) < [1e-6, 1e-6, 1e-6, 1e-6, 1e3]) and found.squared[4] > 100.0
        assert np.max(np.abs(found.slides[:4])) == pytest.approx(1.0 / 1.01, rel=1e-6)
        assert found.effective_mass[:4, 0].sum() == pytest.approx(0.3, rel=1e-9)
    table = np.array(errors)
    assert np.all(np.log2(table[:-1, 1] / table[1:, 1]) > 5.8) and table[-1, 0] < 1e-9 and table[-1, 1] < 1e-8


def seen_in_time(model: Any, found: Modes, k: int, point: Any, amplitude: float = 1e-6) -> float:
    """Relative distance of a mode's frequency from that of a run: what a step of size h turns by is 2 atan(w h/2)."""
    h = 2.0 * np.pi / found.angular[k] / 60.0
    run = fb.simulate(model, start=found.state(k, amplitude), t_end=180 * h, step=h, every=1, points={"p": point},
                      output=fb.Output(snapshots=0),
                      progress=False)
    x = run.point("p") - run.point("p").mean(axis=0)
    y = x[:, np.argmax(np.abs(x).max(axis=0))]
    columns = np.stack((y[1:-1], np.ones(y.size - 2)), axis=1)
    turn = np.arccos(0.5 * np.linalg.lstsq(columns, y[2:] + y[:-2], rcond=None)[0][0])
    return abs(2.0 / h * np.tan(0.5 * turn) / found.angular[k] - 1.0)


def test_frequencies_of_a_bead_at_rest_are_seen_in_time() -> None:
    model, bead, state = bead_on_string(1.0, G)
    found = fb.modes(model, state=state, n=6)
    # swinging about the pins' line is free in this symmetric shape only for the string without weight
    swings = [k for k in range(4) if found.effective_mass[k].max() > 0.05 and found.angular[k] > 0.0]
    assert len(swings) >= 2
    assert any(abs(found.slides[k, 0]) > 0.9 for k in swings), "the bead rolls along"
    for k in swings:
        assert seen_in_time(model, found, k, bead) < 1e-6
    with pytest.raises(fb.SceneError, match="the state is not an equilibrium"):
        fb.modes(model, state=found.state(1, 0.01))
    clipped = fb.modes(model, state=state, held=True, n=6)
    assert np.all(clipped.slides == 0.0)


@pytest.mark.slow
def test_a_sleeve_is_seen_in_time() -> None:
    tube = fb.Beam.straight("tube", (0, 0, 0), (1, 0, 0), section=THICK, elements=3, degree=2)
    rod = fb.Beam.straight("rod", (0.5, 0, 0), (2, 0, 0), section=THICK, elements=4, degree=2)
    spring = fb.PointMass("end", mass=1.0, position=(4, 0, 0))
    scene = fb.Scene(tube, rod, spring, fb.Clamp(tube.start), fb.Clamp(spring), fb.Spring(rod.end, spring, stiffness=50.0),
                     fb.Sleeve("telescope", tube.end, rod, at=0.5))
    model = fb.compile_scene(scene)
    found = fb.modes(model, n=8)
    # the rod on its spring, along x, next to stiff bending
    k = int(np.argmax(np.abs(found.slides[:, 0])))
    assert found.angular[k] == pytest.approx(np.sqrt(50.0 / 1.5), rel=1e-2)
    assert seen_in_time(model, found, k, rod.end) < 1e-6
    assert seen_in_time(model, found, int(np.argmax(np.abs(found.displacements[:, -2, 2]))), rod.end) < 1e-5


# --- joints and bodies ----------------------------------------------------------------------------------------------------
def pendulum(gravity: tuple[float, float, float]) -> Any:
    pivot = fb.PointMass("pivot", mass=1.0, position=(0, 0, 0))
    body = fb.RigidBody("body", mass=2.0, inertia=(0.3, 0.5, 0.25), position=(0, 0, -1))
    joint = fb.BallJoint(pivot, body.point((0, 0, 1)))
    return fb.compile_scene(fb.Scene(pivot, body, fb.Clamp(pivot), joint, gravity=gravity))


def test_rigid_pendulum_and_its_unstable_twin() -> None:
    exact = 2.0 * G / np.array([2.5, 2.3])
    found = fb.modes(pendulum((0, 0, -G)))
    np.testing.assert_allclose(found.squared, [0.0, *exact], rtol=1e-12)
    assert found.unstable == 0 and len(found) == 3
    upside_down = fb.modes(pendulum((0, 0, G)))
    np.testing.assert_allclose(upside_down.growth, [*np.sqrt(exact[::-1]), 0.0], rtol=1e-12)
    with pytest.raises(fb.SceneError, match="body 'body' has an unbalanced force of 19.6 N m"):
        fb.modes(pendulum((G, 0, 0)))


def test_bob_on_a_massless_rod_finds_the_force_of_its_joint() -> None:
    pivot, bob = fb.PointMass("pivot", mass=1.0, position=(0, 0, 0)), fb.PointMass("bob", mass=2.0, position=(0, 0, -1.5))
    model = fb.compile_scene(fb.Scene(pivot, bob, fb.Clamp(pivot), fb.DistanceJoint(pivot, bob), gravity=(0, 0, -G)))
    found = fb.modes(model)
    np.testing.assert_allclose(found.angular, np.sqrt(G / 1.5), rtol=1e-12)
    np.testing.assert_allclose(found.effective_mass.sum(axis=0), [2.0, 2.0, 0.0], atol=1e-12)


def test_a_free_body_is_in_equilibrium_without_gravity_alone() -> None:
    body = fb.RigidBody("body", mass=2.0, inertia=(1, 1, 1), position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(body, gravity=(0, 0, -G)))
    with pytest.raises(fb.SceneError, match="no support balances the sum of the loads"):
        fb.modes(model)
    found = fb.modes(model, load_factor=0.0)
    assert len(found) == 6 and np.all(found.squared == 0.0) and found.is_complete
    np.testing.assert_allclose(found.effective_mass.sum(axis=0), 2.0, rtol=1e-12)


def test_beams_of_a_net_that_may_spin_are_left_out_exactly() -> None:
    """The same truss of beams, where those spins are zero modes."""
    section = fb.Section.circle(radius=0.01, E=2e9, rho=1000.0)
    nodes = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.4, 0.4, 0.8)]
    net = fb.Net("net", nodes, [(0, 3), (1, 3), (2, 3)], section=section, elements=2, degree=3, joints="ball", pins=[0, 1, 2])
    bars = [fb.Beam.straight(f"bar {i}", nodes[i], nodes[3], section=section, elements=2, degree=3) for i in range(3)]
    balls = [fb.BallJoint(bars[0].end, bar.end) for bar in bars[1:]]
    of_net = fb.modes(fb.compile_scene(fb.Scene(net)), n=12)
    of_bars = fb.modes(fb.compile_scene(fb.Scene(*bars, *map(lambda b: fb.Pin(b.start), bars), *balls)), n=15)
    assert of_net.left_out == 3 and np.all(of_bars.squared[:3] == 0.0) and of_bars.left_out == 0
    np.testing.assert_allclose(of_net.angular, of_bars.angular[3:], rtol=1e-10)
    assert of_net.is_complete and of_bars.is_complete


def test_a_moment_fixed_in_space_makes_a_cantilever_flutter() -> None:
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=600.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
    beam = fb.Beam.straight("beam", (0, 0, 0), (3, 0, 0), section=section, elements=3, degree=2)
    for moment, flutters in ((100.0, False), (600.0, True)):
        model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("moment", beam.end, moment=(0, moment, 0))))
        result = fb.solve_static(model)
        assert result.info["unstable_directions"] == 0
        found = fb.modes(model, state=result.state, n=6)
        both = (found.growth > 0.0) & (found.angular > 0.0)
        assert int(both.sum()) == (2 if flutters else 0)
        assert np.max(found.residuals) < 1e-10
        # in the plane the moment has a potential
        flat = fb.modes(model, state=result.state, n=2, planar=True)
        assert flat.unstable == 0
        assert min(nearest(found, w) for w in flat.angular) < 1e-9
