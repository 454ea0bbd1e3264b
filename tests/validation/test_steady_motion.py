"""Equilibria and modes of steady motion against exact whirl, rotating blades, moving strings and beams, rings, runs in time."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense
from scipy.optimize import brentq, newton

import fastbeam as fb
from fastbeam.results.mode_shapes import SteadyModes

sys.path.insert(0, str(Path(__file__).parents[1]))
import spectral  # noqa: E402

Array = np.ndarray
L, EI, GA, EA, RHO_A, RHO_I = 10.0, 1e3, 1e5, 2e5, 1.0, 0.05
THICK = dict(EA=EA, GA2=GA, GA3=GA, GJ=1e3, EI2=EI, EI3=EI, rhoA=RHO_A, rhoI2=RHO_I, rhoI3=RHO_I)


def nearest(found: Array, exact: float) -> float:
    return float(np.nanmin(np.abs(found - exact))) / abs(exact)


def straight(length: float, elements: int, degree: int = 3, **section: float) -> fb.Beam:
    return fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=fb.Section(**(THICK | section)), elements=elements,
                            degree=degree)


def modes_of(model: Any, steady: Any, n: int, start: Any = None, **options: Any) -> SteadyModes:
    rest = fb.solve_static(model, steady=steady, start=start)
    return fb.modes(model, state=rest.state, steady=steady, n=n, **options)


# --- spin -----------------------------------------------------------------------------------------------------------------
def whirls(n: int, rate: float) -> Array:
    """Of a shaft on two pins, rad/s in space, forward positive: w = W sin k x, turn = C cos k x times e^(i w t), in complex
    numbers across the axis, with the gyroscopic moment 2 rho I rate of the sections."""
    k = n * np.pi / L
    p = np.polymul([-RHO_A, 0.0, GA * k * k], [-RHO_I, 2.0 * RHO_I * rate, EI * k * k + GA])
    roots = np.roots(np.polysub(p, [(GA * k)**2]))
    return np.sort(np.real(roots))[1:3]


@pytest.mark.parametrize(("rate", "confirmed"), [(0.5, True), (3.0, True), (30.0, False)])
def test_a_shaft_whirls_forward_and_backward(rate: float, confirmed: bool) -> None:
    """Beyond critical speeds, too, where nothing but the spin keeps the shaft."""
    errors = []
    for elements in (8, 16):
        beam = straight(L, elements)
        model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end)))
        found = modes_of(model, fb.Spin(rate, axis=(1, 0, 0)), 10)
        errors.append([nearest(2.0 * np.pi * found.in_space, exact) for n in (1, 2, 3) for exact in whirls(n, rate)])
    first, second = np.array(errors)
    assert np.all(np.log2(first[2:] / second[2:]) > 5.7) and np.all(second < 1e-6) and np.all(second[:2] < 2e-9)
    circling = np.abs(found.whirl) > 0.5
    np.testing.assert_allclose(found.whirl[circling], np.sign(found.in_space[circling]), atol=1e-9)
    assert np.all(found.whirl[~circling] == pytest.approx(0.0, abs=1e-9)) and np.all(np.isnan(found.in_space[~circling]))
    assert found.unstable == 0 and np.max(found.residuals) < 1e-11 and found.is_complete == confirmed
    assert found.rates[0] == 0.0 and (found.info["unstable_at_rest"] > 0) == (not confirmed)


def blade(mu: float, eta: float) -> float:
    """Zero at the frequencies of a rotating cantilever, w'''' - eta^2/2 ((1 - x^2) w')' = mu^2 w, by its power series."""
    out = []
    for first in ((1.0, 0.0), (0.0, 1.0)):
        a = np.zeros(124)
        a[2:4] = first
        for k in range(120):
            a[k + 4] = (0.5 * eta**2 * ((k + 2) * (k + 1) * a[k + 2] - k * (k + 1) * a[k]) + mu**2 * a[k]) / (
                (k + 4) * (k + 3) * (k + 2) * (k + 1))
        n = np.arange(124)
        out.append((float(np.sum(n * (n - 1) * a)), float(np.sum(n * (n - 1) * (n - 2) * a))))
    return out[0][0] * out[1][1] - out[0][1] * out[1][0]


def test_a_rotating_blade_in_the_limit_of_a_stiff_thin_beam() -> None:
    """Out of its plane of rotation as published (A. Wright et al., J. Appl. Mech. 49, 1982, 4.1373 and 22.6149 for eta = 2), in
    it w^2 less by eta^2."""
    eta = 2.0
    exact = [brentq(blade, *ends, args=(eta,), xtol=1e-13) for ends in ((4.0, 4.3), (22.0, 23.0))]
    np.testing.assert_allclose(exact, [4.1373, 22.6149], atol=6e-5)
    rows = []
    for stiff in (1e4, 2e4, 4e4):
        beam = straight(1.0, 16, 3, EA=stiff, GA2=stiff, GA3=stiff, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-9, rhoI3=1e-9)
        found = modes_of(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start))), fb.Spin(eta), 4)
        assert found.is_complete
        rows.append(found.angular)
    table = np.array(rows)
    for k in (1, 2):
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    lag = np.sqrt(np.square(exact) - eta**2)
    np.testing.assert_allclose(table[0], [lag[0], exact[0], lag[1], exact[1]], rtol=1e-6)


def test_a_rotating_blade_converges_with_order_six() -> None:
    """With stretch, shear and the inertia of sections, across the plane of rotation (flap) and in it (lag), by Chebyshev
    polynomials: nothing is a limit."""
    eta, stiff, inertia = 2.0, 1e3, 1e-6
    exact = []
    for pull, more in (((eta**2, 0.0), dict(turned=eta**2)), ((eta**2, eta**2), dict(gyro=eta))):
        rod = spectral.Rod(1.0, stiff, stiff, 1.0, 1.0, inertia, (spectral.CLAMP, spectral.FREE), pull=pull, **more)
        y = rod.equilibrium(spectral.guess(rod, lambda s: s, np.zeros_like, lambda s: 0.5 * eta**2 * (1.0 - s * s)))
        exact += rod.angular(y)[:2].tolist()
    assert exact[:2] == pytest.approx([4.1373, 22.6149], rel=0.02)
    errors = []
    for elements in (4, 8, 16):
        beam = straight(1.0, elements, 3, EA=stiff, GA2=stiff, GA3=stiff, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=inertia,
                        rhoI3=inertia)
        found = modes_of(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start))), fb.Spin(eta), 8)
        errors.append([nearest(found.angular, w) for w in exact])
    first, second, third = np.array(errors)
    assert np.all(np.log2(first / second) > 5.7) and np.all(np.log2(second / third)[[1, 3]] > 5.9) and np.all(third < 1e-8)


def test_friction_inside_a_shaft_makes_it_whirl_beyond_its_critical_speed() -> None:
    """Forward whirl grows where the shaft turns faster than it whirls, and only there."""
    beam = straight(L, 8, damping=1e-3)
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end)))
    for rate, grows in ((2.9, 0), (3.3, 1), (20.0, 2)):
        found = modes_of(model, fb.Spin(rate, axis=(1, 0, 0)), 9)
        assert found.unstable == grows and not found.is_complete
        assert np.all(found.whirl[found.decay < 0.0] > 0.999)


def test_a_whirl_is_seen_in_time() -> None:
    """Free in space, sent off by a mode: what it turns by in a step, extrapolated to steps of zero."""
    rate = 3.0
    beam = straight(L, 16)
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end)))
    found = modes_of(model, fb.Spin(rate, axis=(1, 0, 0)), 5)
    middle = beam.at(0.5 * L)
    for k in (1, 2):
        seen = []
        for h in (0.02, 0.01, 0.005):
            run = fb.simulate(model, start=found.state(k, 1e-6), t_end=1.2, step=h, every=1, points={"p": middle},
                              output=fb.Output(snapshots=0),
                              progress=False)
            z = run.point("p")[:, 1] + 1j * run.point("p")[:, 2]
            seen.append(float(np.angle(z[1:] / z[:-1]).mean()) / h)
        first, second = (4.0 * np.array(seen[1:]) - seen[:-1]) / 3.0
        assert (16.0 * second - first) / 15.0 == pytest.approx(2.0 * np.pi * found.in_space[k], rel=1e-6)


def harmonic(y: Array, h: float, near: float) -> float:
    """Angular frequency in a series, of ten in all (matrix pencil, Y. Hua, T. Sarkar, 1990)."""
    half = y.size // 2
    hankel = np.array([y[k:k + half] for k in range(y.size - half)])
    v = np.linalg.svd(hankel, full_matrices=False)[2][:10].T
    w = np.abs(np.angle(np.linalg.eigvals(np.linalg.lstsq(v[:-1], v[1:], rcond=None)[0]))) / h
    return float(w[np.argmin(np.abs(w - near))])


@pytest.mark.slow
def test_a_blade_on_a_hub_that_turns_is_seen_in_time() -> None:
    """The hub turns as prescribed, in a run; half the difference of two runs from opposite amplitudes."""
    rate, radius = 2.0, 0.2
    beam = fb.Beam.straight("blade", (radius, 0, 0), (1.2, 0, 0), elements=6, section=fb.Section(
        EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=2.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3))
    hub = fb.PrescribedMotion("hub", beam.start, rotation=lambda t: (0, 0, rate * t), position=lambda t: (
        radius * np.cos(rate * t), radius * np.sin(rate * t), 0.0))
    model = fb.compile_scene(fb.Scene(beam, hub))
    found = modes_of(model, fb.Spin(rate), 2)
    for k in (0,):
        seen = []
        for refine in (1, 2, 4):
            ways = []
            for amplitude in (1e-6, -1e-6):
                run = fb.simulate(model, start=found.state(k, amplitude), t_end=6.0, step=0.01 / refine, every=refine,
                                  points={"p": beam.end}, output=fb.Output(snapshots=0), progress=False)
                ways.append(run.point("p"))
            way, angle = 0.5 * (ways[0] - ways[1]), rate * run.t
            across = np.stack((way[:, 2], np.cos(angle) * way[:, 1] - np.sin(angle) * way[:, 0]))
            y = across[np.argmax(np.abs(across).max(axis=1))]
            seen.append(harmonic(y, 0.01, float(found.angular[k])))
        first, second = (4.0 * np.array(seen[1:]) - seen[:-1]) / 3.0
        assert (16.0 * second - first) / 15.0 == pytest.approx(found.angular[k], rel=1e-6)


# --- travel ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("share", [0.3, 0.95, pytest.param(1.05, marks=pytest.mark.slow)])
def test_a_string_that_moves_along_itself(share: float) -> None:
    """f_n = n c/(2 L) |1 - v^2/c^2|, c of the unstressed length: shear alone carries the string, see `test_vibration.py`."""
    strain = 0.01
    shear = EA * strain / (1.0 + strain)
    beam = straight(L, 16, GA2=shear, GA3=shear)
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end)))
    start = model.state()
    start.q.reshape(-1, 4, 3)[:, 0] *= 1.0 + strain
    c = np.sqrt(shear / RHO_A)
    found = modes_of(model, fb.Travel({beam: share * c}), 12, start)
    for n in (1, 2):
        exact = n * np.pi / L * c * abs(1.0 - share**2)
        assert nearest(found.angular, exact) < 3e-6
    assert found.unstable == 0 and np.all(found.whirl == 0.0)
    with pytest.raises(fb.SceneError, match="nodes are fixed while material moves through them"):
        found.state(1, 0.1)


def moving(w: complex, v: float) -> complex:
    """Zero at the frequencies of a Timoshenko beam that runs through two clamps: Q' = rhoA D D w, M' + Q = rhoI D D turn with
    D = i w + v d/ds, by the matrix exponential of the four first-order equations."""
    a = np.zeros((4, 4), complex)
    a[0, 1], a[0, 2], a[1, 3] = 1.0, 1.0 / GA, 1.0 / EI
    a[2] = np.array([-w * w, 2j * w * v, 2j * w * v / GA, v * v / EI]) * RHO_A / (1.0 - RHO_A * v * v / GA)
    a[3] = np.array([0.0, -RHO_I * w * w, -1.0, 2j * RHO_I * w * v / EI]) / (1.0 - RHO_I * v * v / EI)
    return complex(np.linalg.det(dense.expm(a * L)[:2, 2:]))


def test_a_beam_runs_through_two_clamps_until_it_bends_aside() -> None:
    """Divergence where rho v^2 is its buckling load 4 pi^2 EI/L^2, with shear and rotary inertia from the same equations."""
    beam = straight(L, 16)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Clamp(beam.end)))
    v = 12.0
    found = modes_of(model, fb.Travel({beam: v}), 6)
    assert found.is_complete and found.unstable == 0
    twist = np.sqrt(THICK["GJ"] / (2.0 * RHO_I))
    assert nearest(found.angular, np.pi / L * twist * (1.0 - v**2 / twist**2)) < 1e-8
    for k in (0, 2):
        w = found.angular[k]
        exact = newton(lambda x: moving(x, v), w * (1.0 + 1e-5), x1=w, tol=1e-13, maxiter=60)
        assert abs(exact - w) < 1e-6 * w
        assert k or abs(exact - w) < 1e-7 * w
        assert found.angular[k + 1] == pytest.approx(w, rel=1e-9)
    # where one of these equations has a root at w = 0
    speeds = np.linspace(15.0, 22.0, 200)
    values = [moving(0.0, x).real for x in speeds]
    at = next(x for x, a, b in zip(speeds, values, values[1:]) if a * b < 0.0)
    critical = brentq(lambda x: moving(0.0, x).real, at, at + speeds[1] - speeds[0], xtol=1e-12)
    assert critical == pytest.approx(2.0 * np.pi / L * np.sqrt(EI / RHO_A), rel=0.05)
    assert modes_of(model, fb.Travel({beam: 0.9999 * critical}), 6).unstable == 0
    assert modes_of(model, fb.Travel({beam: 1.0001 * critical}), 6).unstable == 2


def test_a_ring_that_spins_is_a_loop_that_travels() -> None:
    """Seen from its own frame and from space: waves of n lobes differ by n times the rate of the spin."""
    radius, rate = 1.0, 1.5
    section = fb.Section(**(THICK | dict(EI2=60.0, EI3=100.0, EA=2e4)))
    ring = fb.Beam.arc("ring", (radius, 0, 0), (0, 1, 0), (-1, 0, 0), radius=radius, angle=2.0 * np.pi, section=section,
                       elements=16, degree=3)
    model = fb.compile_scene(fb.Scene(ring, fb.RigidConnection(ring.start, ring.end)))
    spin, travel = fb.Spin(rate), fb.Travel({ring: rate * radius})
    rest = fb.solve_static(model, steady=spin)
    same = fb.solve_static(model, steady=travel)
    size = [np.linalg.norm(x.state.q.reshape(-1, 4, 3)[:, 0], axis=1) for x in (rest, same)]
    np.testing.assert_allclose(*size, rtol=1e-9)
    assert size[0].mean() == pytest.approx(radius * (1.0 + RHO_A * rate**2 * radius**2 / 2e4), rel=1e-6)
    turning = fb.modes(model, state=rest.state, steady=spin, n=14)
    standing = fb.modes(model, state=same.state, steady=travel, n=14)
    lobes = turning.angular[turning.angular > 3.0 * rate]
    pairs = 0
    for w in lobes:
        shifted = [x for n in (2, 3) for x in (w + n * rate, abs(w - n * rate))]
        pairs += min(nearest(standing.angular, x) for x in shifted) < 1e-7
    assert pairs >= 4


# --- what is refused ------------------------------------------------------------------------------------------------------
def test_what_is_not_steady_is_refused() -> None:
    beam = straight(L, 4)
    other = straight(L, 4)
    falls = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -1)))
    for call in (fb.solve_static, fb.modes):
        with pytest.raises(fb.SceneError, match="loads or gravity act across the axis"):
            call(falls, steady=fb.Spin(1.0, axis=(1, 0, 0)))
    assert fb.solve_static(falls, steady=fb.Spin(1.0)).info["unstable_directions"] is None
    with pytest.raises(fb.SceneError, match="nothing fixes the position of"):
        fb.solve_static(falls, steady=fb.Travel({beam: 1.0}))
    with pytest.raises(fb.SceneError, match="is not in scene"):
        fb.solve_static(falls, steady=fb.Travel({other: 1.0}))
    with pytest.raises(fb.SceneError, match="the state is not an equilibrium"):
        fb.modes(falls, load_factor=0.0, steady=fb.Spin(1.0))
    mass = fb.PointMass("mass", mass=1.0, position=(0, 0, 1))
    dragged = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), mass, fb.Drag("air", mass, normal=1.0)))
    with pytest.raises(fb.SceneError, match="would brake the steady motion itself"):
        fb.modes(dragged, steady=fb.Spin(1.0))
    with pytest.raises(fb.SceneError, match="axis must not be zero"):
        fb.Spin(1.0, axis=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="speeds must be a mapping"):
        fb.Travel({beam: "fast"})  # type: ignore[dict-item]
    spline = fb.Beam.straight("spline", (0, 0, 0), (1, 0, 0), section=fb.Section(**THICK), elements=4, interpolation="bspline")
    with pytest.raises(fb.SceneError, match="need 'lagrange'"):
        fb.Travel({spline: 1.0})
