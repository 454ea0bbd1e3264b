"""Digital controllers: exact against the motion under forces that are held, restarts to the last bit, control of joints."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

PERIOD, MASS = 0.02, 2.0


def pid(now: Any, memory: np.ndarray) -> float:
    error = 0.1 * np.sin(2.0 * now.t) - now.point("cart")[0]
    memory[0] += PERIOD * error
    return 80.0 * error + 30.0 * memory[0] - 20.0 * now.velocity("cart")[0]


def cart_on_control(law: Any = pid, **more: Any) -> tuple[Any, Any]:
    cart = fb.PointMass("cart", mass=MASS, position=(0.3, 0, 0), velocity=(0.0, 1.0, 0.0))
    given = {"period": PERIOD, "memory": (0.0,), "points": {"cart": cart}} | more
    hand = fb.Controller("hand", law, **given)
    return fb.compile_scene(fb.Scene(cart, hand, fb.Load("push", cart, force=(1, 0, 0), time=hand))), cart


def run(model: Any, cart: Any, t_end: float, step: float, **more: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, points={"cart": cart}, observe=("energy", "velocity"),
                       **more)


@pytest.mark.parametrize("steps, order", [(1, 2), (4, 2), (2, 4)])
def test_a_cart_under_forces_that_are_held_is_exact(steps: int, order: int) -> None:
    model, cart = cart_on_control()
    result = run(model, cart, 3.0, PERIOD / steps, every=25, order=order)
    x, v, whole = 0.3, 0.0, 0.0
    exact = [x]
    for k in range(150):
        error = 0.1 * np.sin(2.0 * k * PERIOD) - x
        whole += PERIOD * error
        a = (80.0 * error + 30.0 * whole - 20.0 * v) / MASS
        x, v = x + PERIOD * v + 0.5 * a * PERIOD**2, v + a * PERIOD
        exact.append(x)
    # rows do not lie closer because of the controller
    assert len(result.t) == 1 + 150 * steps // 25
    found = np.interp(result.t, PERIOD * np.arange(151), exact)
    whole_periods = np.abs(result.t / PERIOD - np.round(result.t / PERIOD)) < 1e-9
    assert whole_periods.sum() > 5
    assert np.max(np.abs(result.point("cart")[:, 0] - found)[whole_periods]) < 1e-12
    assert abs(result.drift("balance")) < 1e-12


def test_a_run_from_a_checkpoint_is_the_same() -> None:
    model, cart = cart_on_control()
    at_once = run(model, cart, 2.0, PERIOD / 2, every=50)
    half = run(model, cart, 1.0, PERIOD / 2, every=50)
    # between two of its times, in another process in effect: a new model with a controller that holds its start
    other, own = cart_on_control()
    rest = run(other, own, 2.0, PERIOD / 2, every=50, start=half.checkpoint)
    assert np.array_equal(rest.state.q, at_once.state.q) and np.array_equal(rest.state.v, at_once.state.v)
    again = run(model, cart, 2.0, PERIOD / 2, every=50)
    assert np.array_equal(again.state.q, at_once.state.q)


def test_what_a_controller_cannot_do_is_said() -> None:
    model, cart = cart_on_control()
    with pytest.raises(fb.SceneError, match="whole number of them"):
        run(model, cart, 1.0, 0.013)
    with pytest.raises(fb.SceneError, match="step control"):
        run(model, cart, 1.0, PERIOD, tolerance=1e-6)
    model, cart = cart_on_control(lambda now, memory: now.point("wagon")[0])
    with pytest.raises(fb.SceneError, match="no point 'wagon'; there are 'cart'"):
        run(model, cart, 1.0, PERIOD)
    model, cart = cart_on_control(lambda now, memory: np.nan)
    with pytest.raises(fb.SceneError, match="its law at t = 0 s"):
        run(model, cart, 1.0, PERIOD)
