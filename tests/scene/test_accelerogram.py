"""Signals from accelerations: the displacement of closed forms, corrections of the baseline, and a base that they move."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import fastbeam as fb

Array = np.ndarray
T = np.linspace(0.0, 2.0, 401)


def slope(signal: fb.Signal, t: float, h: float = 1e-3) -> Any:
    """By differences of order 4."""
    a, b, c, d = (np.asarray(signal(t + k * h)) for k in (-2, -1, 1, 2))
    return (a - 8.0 * b + 8.0 * c - d) / (12.0 * h)


def test_a_sine_pulse_has_its_exact_displacement() -> None:
    """a = A sin(w t) from rest: v = A/w (1 - cos w t), x = A/w (t - sin(w t)/w); behind it x goes on with the final velocity."""
    size, w = 3.0, 0.5 * np.pi
    errors = []
    for n in (41, 81, 161):
        t = np.linspace(0.0, 2.0, n)
        pulse = fb.Signal.from_acceleration(t, size * np.sin(w * t))
        at = np.linspace(0.0, 2.0, 97)
        errors.append(np.max(np.abs([pulse(x) for x in at] - size / w * (at - np.sin(w * at) / w))))
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3.8) and errors[-1] < 1e-9, errors
    assert pulse(3.0) == pytest.approx(pulse(2.0) + 2.0 * size / w, abs=1e-8) and pulse(-5.0) == 0.0
    assert repr(pulse) == "<signal: 161 numbers, 0 to 2 s, from accelerations>"


def test_a_cubic_is_integrated_to_round_off() -> None:
    """From given initial values; the spline through a cubic is the cubic, at uneven times, too."""
    t = np.cumsum(0.02 + 0.05 * np.random.default_rng(1).random(60)) - 1.0
    push = fb.Signal.from_acceleration(t, 6.0 * t - 4.0 + 12.0 * t**2 - 20.0 * t**3, velocity=0.3, displacement=-2.0)

    def place(x: Array) -> Array:
        return x**3 - 2.0 * x**2 + x**4 - x**5

    def rate(x: float) -> float:
        return 3.0 * x**2 - 4.0 * x + 4.0 * x**3 - 5.0 * x**4

    at = np.linspace(t[0], t[-1], 200)
    exact = -2.0 + place(at) - place(t[0]) + (0.3 - rate(t[0])) * (at - t[0])
    np.testing.assert_allclose([push(x) for x in at], exact, rtol=0, atol=1e-12)
    assert np.array_equal(push.values, [push(x) for x in t])
    # before it the initial velocity, behind it the final one, without a jump
    assert push(t[0] - 1.0) == pytest.approx(-2.3, abs=1e-14)
    assert push(t[-1] + 1.0) - push(t[-1]) == pytest.approx(0.3 + rate(t[-1]) - rate(t[0]), abs=1e-12)


def test_vectors_and_directions() -> None:
    a = np.stack((np.sin(T), 0.0 * T, np.cos(3.0 * T)), axis=1)
    both = fb.Signal.from_acceleration(T, a, velocity=(1.0, 0.0, 2.0), displacement=(0.0, 5.0, 0.0), baseline=1)
    for k, (v, x) in enumerate(((1.0, 0.0), (0.0, 5.0), (2.0, 0.0))):
        one = fb.Signal.from_acceleration(T, a[:, k], velocity=v, displacement=x, baseline=1)
        np.testing.assert_allclose(both(1.234)[k], one(1.234), rtol=1e-13)
    along = fb.Signal.from_acceleration(T, a[:, 2], direction=(0, 2, 0), velocity=2.0, baseline=1)
    np.testing.assert_allclose(along(0.7), (0.0, 2.0 * one(0.7), 0.0), rtol=1e-12)
    assert both.values.shape == (401, 3) and not both.values.flags.writeable


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_corrected_record_stands_still_behind_its_end(degree: int) -> None:
    noise = np.random.default_rng(7).normal(size=T.size) + 0.3 + 0.2 * T
    quake = fb.Signal.from_acceleration(T, noise, velocity=0.1, baseline=degree)
    assert abs(slope(quake, 2.0 - 2.1e-3)) < 0.02
    assert quake(9.0) == quake(2.0) and abs(quake(2.0 - 1e-6) - quake(2.0)) < 1e-10
    # what was added is a polynomial of this degree
    h = 0.05
    bare = fb.Signal.from_acceleration(T, noise, velocity=0.1)
    added = [quake(x) - bare(x) for x in np.arange(0.1, 1.9, h)]
    assert np.max(np.abs(np.diff(added, degree + 3))) < 1e-13
    if degree < 3:
        assert np.max(np.abs(np.diff(added, degree + 2))) > 1e-8


def test_the_correction_takes_a_polynomial_error_away() -> None:
    """A record that ends at rest, off by a parabola: the correction finds most of it, and all where there is nothing else."""
    def ripple(t: Array) -> Array:
        return 2.0 * (2.0 * np.pi)**2 * np.cos(2.0 * np.pi * t) * 0.01

    clean = fb.Signal.from_acceleration(T, ripple(T))
    off = fb.Signal.from_acceleration(T, ripple(T) + 0.8 - 0.5 * T + 0.1 * T**2)
    mended = fb.Signal.from_acceleration(T, ripple(T) + 0.8 - 0.5 * T + 0.1 * T**2, baseline=2)
    assert abs(off(2.0) - clean(2.0)) > 0.1
    assert max(abs(mended(x) - clean(x)) for x in T) < 0.01
    still = fb.Signal.from_acceleration(T, 0.3 - 0.5 * T + 0.1 * T**2 + 0.7 * T**3, baseline=3)
    assert max(abs(still(x)) for x in T) < 1e-14


def test_the_correction_has_the_least_velocities() -> None:
    """Of all polynomials of degree 2 with the final velocity 0; by adaptive quadrature."""
    a = np.exp(-T) * np.sin(9.0 * T) + 0.2
    quake = fb.Signal.from_acceleration(T, a, baseline=2)

    def square(more: tuple[float, float]) -> float:
        def v(t: float) -> float:
            s = 0.5 * t
            return float(slope(quake, min(max(t, 2e-3), 2.0 - 2e-3))) + more[0] * (s**2 - s) + more[1] * (s**3 - s)
        return quad(lambda t: v(t)**2, 2e-3, 2.0 - 2e-3, limit=200)[0]

    least = square((0.0, 0.0))
    for step in ((1e-2, 0.0), (-1e-2, 0.0), (0.0, 1e-2), (0.0, -1e-2), (1e-2, -1e-2)):
        assert square(step) > least


def test_a_base_moves_an_oscillator_as_the_exact_answer() -> None:
    """x'' + w^2 x = w^2 u, u'' = A sin(p t) from rest, on a spring of no length: x = u - y, y'' + w^2 y = A sin(p t), so
    y = A (w sin(p t) - p sin(w t))/(w (w^2 - p^2))."""
    size, p, k, m = 2.0, 3.0, 80.0, 0.8
    w = np.sqrt(k / m)
    t = np.linspace(0.0, 2.0, 201)
    quake = fb.Signal.from_acceleration(t, size * np.sin(p * t), direction=(1, 0, 0))
    base, bob = fb.PointMass("base", mass=1.0, position=(0, 0, 0)), fb.PointMass("bob", mass=m, position=(0, 0, 0))
    shake = fb.PrescribedMotion("quake", base, displacement=quake)
    spring = fb.Spring(base, bob, "spring", stiffness=k, length=0.0)
    model = fb.compile_scene(fb.Scene(base, bob, shake, spring))
    errors = []
    for n in (100, 200):
        run = fb.simulate(model, t_end=2.0, step=2.0 / n, points={"bob": bob}, progress=False)
        u = size / p * (run.t - np.sin(p * run.t) / p)
        exact = u - size * (w * np.sin(p * run.t) - p * np.sin(w * run.t)) / (w * (w**2 - p**2))
        errors.append(float(np.max(np.abs(run.point("bob")[:, 0] - exact))))
        assert run.drift("balance") < 1e-13
    assert 1.9 < np.log2(errors[0] / errors[1]) < 2.1 and errors[1] < 2e-3, errors


@pytest.mark.parametrize(("given", "text"), [
    (dict(times=T[:3], acceleration=T[:3]), "times must increase, and be at least 4"),
    (dict(times=T[::-1], acceleration=T), "times must increase"),
    (dict(times=T, acceleration=T[:-1]), "accelerations must be as many as times, got 400 and 401"),
    (dict(times=T, acceleration=np.zeros((401, 3)), direction=(1, 0, 0)), "these are vectors already"),
    (dict(times=T, acceleration=T, velocity=(1, 0, 0)), "velocity must be a number"),
    (dict(times=T, acceleration=np.zeros((401, 3)), displacement=1.0), r"displacement must be \(3,\)"),
    (dict(times=T, acceleration=T, baseline=4), "from 0 to 3"),
    (dict(times=T, acceleration=T, baseline=-1), "whole number >= 0"),
    (dict(times=T, acceleration=T * np.nan), "must be finite numbers"),
    (dict(times=T, acceleration=T, velocity="fast"), "velocity"),
    (dict(times=1.0 + 1e-16 * np.arange(4.0), acceleration=T[:4]), "times must increase")])
def test_bad_records(given: dict[str, Any], text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        fb.Signal.from_acceleration(**given)
