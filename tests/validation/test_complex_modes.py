"""Complex modes of stiffness without symmetry: cross-coupled bearings, follower forces, flutter, against closed forms."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense
from scipy.optimize import newton

import fastbeam as fb

Array = np.ndarray


def bearing(t: float, position: Array, rotation: Array, velocity: Array, spin: Array, parameters: Array, force: Array,
            moment: Array) -> None:
    """k r and c dr/dt, and cross stiffness q across the axis z, that of an oil film; stiff along and about the axes."""
    k, q, c = parameters[0], parameters[1], parameters[2]
    force[0] = -k * position[0] - q * position[1] - c * velocity[0]
    force[1] = -k * position[1] + q * position[0] - c * velocity[1]
    force[2] = -1e3 * k * position[2]
    for i in range(3):
        moment[i] = -1e3 * k * (rotation[(i + 2) % 3, (i + 1) % 3] - rotation[(i + 1) % 3, (i + 2) % 3])


def rotor(m: float, k: float, q: float, c: float) -> Any:
    disc = fb.RigidBody("disc", mass=m, inertia=(0.1, 0.1, 0.2), position=(0, 0, 0))
    film = fb.ForceElement(fb.GROUND.point((0, 0, 0)), disc.center, "film", law=bearing, parameters=(k, q, c))
    return fb.compile_scene(fb.Scene(disc, film))


def forward_positive(rates: Array) -> Array:
    """Those with Im r > 0, by their size."""
    rates = rates[np.imag(rates) > 0.0]
    return rates[np.argsort(np.abs(rates))]


@pytest.mark.parametrize("q", [300.0, 400.0, 2000.0])
def test_a_rotor_in_cross_coupled_bearings(q: float) -> None:
    """With z = x + i y, m z'' + c z' + (k - i q) z = 0: whirl grows where q > c sqrt(k/m)."""
    m, k, c = 2.0, 1e4, 5.0
    found = fb.modes(rotor(m, k, q, c), damped=True, n=4)
    exact = forward_positive(np.concatenate([np.roots([m, c, k + sign * 1j * q]) for sign in (1.0, -1.0)]))
    np.testing.assert_allclose(found.rates[:2], exact, rtol=1e-9)
    assert np.max(found.residuals) < 1e-9
    grows = q > c * np.sqrt(k / m)
    assert found.unstable == int(grows) and np.any(found.decay[:2] < 0.0) == grows == ("motions grow" in found.table())
    # circles: y is a quarter of a turn beside x, the one that grows follows q
    for k_, rate in enumerate(found.rates[:2]):
        x, y = found.displacements[k_, 0, :2]
        assert abs(y / x) == pytest.approx(1.0, abs=1e-7)
        z = np.real(m * rate**2 + c * rate + k), np.imag(m * rate**2 + c * rate + k)
        assert complex(*z) == pytest.approx(-q * y / x, rel=1e-6)


def gyroscope(t: float, position: Array, rotation: Array, velocity: Array, spin: Array, parameters: Array, force: Array,
              moment: Array) -> None:
    """Stiffness k against tilts, and the moment of a disc with the angular momentum G along z."""
    force[:] = -1e4 * position
    for i in range(3):
        moment[i] = -0.5 * parameters[0] * (rotation[(i + 2) % 3, (i + 1) % 3] - rotation[(i + 1) % 3, (i + 2) % 3])
    moment[0] -= parameters[1] * spin[1]
    moment[1] += parameters[1] * spin[0]


def test_gyroscopic_moments_are_a_law() -> None:
    """I r^2 - i G r + k = 0 of the tilt x + i y."""
    inertia, k, G = 0.1, 50.0, 7.0
    disc = fb.RigidBody("disc", mass=100.0, inertia=(inertia, inertia, 0.2), position=(0, 0, 0))
    law = fb.ForceElement(fb.GROUND.point((0, 0, 0)), disc.center, "spin", law=gyroscope, parameters=(k, G))
    found = fb.modes(fb.compile_scene(fb.Scene(disc, law)), damped=True, n=6)
    for exact in np.abs(np.roots([inertia, -1j * G, k])):
        assert np.min(np.abs(found.rates - 1j * exact)) < 1e-9 * exact
    assert found.unstable == 0


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("thrust", [0.5, 1.3, 1.6, 2.0, 2.2, 4.0])
def test_the_double_pendulum_of_ziegler(thrust: float, damping: float) -> None:
    """Masses 2 m and m on bars of length l with springs k in both joints, under a force P that follows: flutter from (7/2 -
    sqrt 2) k/l on, with the same damping c in both joints from (41/28 + c^2/(2 k m l^2)) k/l on (H. Ziegler, 1952)."""
    m, l, k = 1.5, 0.8, 40.0
    c, P = damping * l * np.sqrt(k * m), thrust * k / l
    bars = [fb.RigidBody(name, mass=mass, inertia=(1e-9, 1e-9, 1e-9), position=(0, 0, z)) for name, mass, z in (
        ("lower", 2.0 * m, l), ("upper", m, 2.0 * l))]
    lower, upper = bars
    hinges = [fb.RevoluteJoint(a, b, name, axis=(0, 1, 0), stiffness=k, damping=c) for name, a, b in (
        ("foot", fb.GROUND.point((0, 0, 0)), lower.point((0, 0, -l))), ("knee", lower.point((0, 0, 0)), upper.point((0, 0, -l))))]
    model = fb.compile_scene(fb.Scene(*bars, *hinges, fb.Load("thrust", upper.center, force=(0, 0, -P), follower=True)))
    found = fb.modes(model, state=fb.solve_static(model).state, damped=True, n=4)
    mass, stiff = m * l * l * np.array([[3.0, 1.0], [1.0, 1.0]]), np.array([[2.0 * k - P * l, P * l - k], [-k, k]])
    damp = c * np.array([[2.0, -1.0], [-1.0, 1.0]])
    zero = np.zeros((2, 2))
    exact = dense.eigvals(np.block([[zero, np.eye(2)], [-stiff, -damp]]), np.block([[np.eye(2), zero], [zero, mass]]))
    wanted = exact[np.imag(exact) >= -1e-9 * np.abs(exact)]
    wanted = wanted[np.lexsort((np.real(wanted), np.round(np.abs(wanted), 9)))]
    near = np.array([np.min(np.abs(found.rates - r)) for r in wanted])
    assert np.all(near <= 1e-7 * np.abs(wanted)) and len(found) == len(wanted)
    limit = 41.0 / 28.0 + 0.5 * damping**2 if damping else 3.5 - np.sqrt(2.0)
    assert (found.unstable > 0) == (thrust > limit)


def test_the_column_of_beck_beyond_flutter() -> None:
    """The rate of growth and the frequency from the exact equation of a slender column, p^2 + 2 W (1 + cos a cosh b) + p sqrt(W)
    sin a sinh b = 0, W = w^2 complex."""
    def misfit(w: complex, p: float) -> complex:
        root = np.sqrt(0.25 * p * p + w * w + 0j)
        a, b = np.sqrt(root + 0.5 * p), np.sqrt(root - 0.5 * p)
        return complex(p * p + 2.0 * w * w * (1.0 + np.cos(a) * np.cosh(b)) + p * w * np.sin(a) * np.sinh(b))

    stiff, inertia = 1e8, 1e-9
    section = fb.Section(EA=stiff, GA2=stiff, GA3=stiff, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=inertia, rhoI3=inertia)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, elements=16)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("thrust", beam.end, force=(-1.0, 0, 0), follower=True)),
                             planar=True)
    for p in (19.0, 20.5, 30.0):
        state = model.state()
        # straight, and shorter
        state.q.reshape(-1, 4, 3)[:, 0, 0] *= 1.0 - p / stiff
        found = fb.modes(model, state=state, load_factor=p, damped=True, n=4)
        rate = found.rates[np.argmax(np.real(found.rates))] if p > 20.06 else found.rates[0]
        exact = newton(misfit, -1j * rate, args=(p,), tol=1e-13, maxiter=200)
        assert rate == pytest.approx(1j * exact, rel=1e-6)
        assert found.unstable == int(p > 20.05)


@pytest.mark.parametrize("rate", [0.5, 3.0, -3.0, 30.0])
def test_forward_is_the_sense_of_the_spin_at_every_speed(rate: float) -> None:
    """A small disc on a shaft that is a spring to all sides: w^2 = k/m whatever the speed, forward and backward."""
    m, k = 2.0, 200.0
    disc = fb.RigidBody("disc", mass=m, inertia=(1e-3, 1e-3, 2e-3), position=(0, 0, 0))
    shaft = fb.Bushing(fb.GROUND.point((0, 0, 0)), disc.center, stiffness=(k, k, 1e5, 1e5, 1e5, 1e5))
    model = fb.compile_scene(fb.Scene(disc, shaft))
    spin = fb.Spin(rate)
    found = fb.modes(model, state=fb.solve_static(model, steady=spin).state, steady=spin, n=2)
    w = np.sqrt(k / m)
    seen = 2.0 * np.pi * found.in_space
    np.testing.assert_allclose(np.sort(seen), [-w, w], rtol=1e-9)
    np.testing.assert_allclose(found.whirl, np.sign(seen), atol=1e-9)
