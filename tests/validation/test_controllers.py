"""Digital controllers: exact against the motion under forces that are held, restarts to the last bit, control of joints."""
from __future__ import annotations

from pathlib import Path
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


@pytest.mark.parametrize("kind", ["itself", "within a function", "as a default"])
def test_a_controller_comes_into_the_scene_with_what_takes_it(kind: str) -> None:
    cart = fb.PointMass("cart", mass=MASS, position=(0.3, 0, 0), velocity=(0.0, 1.0, 0.0))
    hand = fb.Controller("hand", lambda now, memory: 3.0, period=PERIOD, memory=(0.0,), points={"cart": cart})
    times = {"itself": hand, "within a function": lambda t: 1.0 * hand(t), "as a default": lambda t, one=hand: 1.0 * one(t)}
    model = fb.compile_scene(fb.Scene(cart, fb.Load("push", cart, force=(1, 0, 0), time=times[kind])))
    assert model.controllers == (hand,)
    assert run(model, cart, 1.0, PERIOD).point("cart")[-1][0] == pytest.approx(0.3 + 0.5 * 3.0 / MASS, abs=1e-13)


def test_controllers_of_drives_joints_and_winches_come_into_the_scene() -> None:
    hand = fb.Controller("hand", lambda now, memory: 3.0, period=PERIOD)
    body = fb.RigidBody("q", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
    for part in (fb.RevoluteJoint(fb.GROUND, body, "hinge", axis=(0, 0, 1), torque=hand),
                 fb.PrismaticJoint(fb.GROUND, body, "rail", axis=(0, 0, 1), drive=fb.Drive(force=hand)),
                 fb.Winch("winch", fb.GROUND.point((0, 0, 2)), body, stiffness=1e5, mass_per_length=0.1, length=2.0,
                          tension=hand),
                 fb.Load("push", body, force=(1, 0, 0), time=hand)):
        assert fb.Scene(body, part).controllers == [hand] == fb.Scene(body, hand, part).controllers
    scene = fb.Scene(body, fb.Load("hand", body, force=(1, 0, 0), time=hand))
    with pytest.raises(fb.SceneError, match="the name 'hand' is used twice, by a load and a controller"):
        scene.check()


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
    with pytest.raises(fb.SceneError, match="whole number of steps"):
        run(model, cart, 1.0, 0.013)
    with pytest.raises(fb.SceneError, match="step control"):
        run(model, cart, 1.0, PERIOD, tolerance=1e-6)
    model, cart = cart_on_control(lambda now, memory: now.point("wagon")[0])
    with pytest.raises(fb.SceneError, match="no point 'wagon'; there are 'cart'"):
        run(model, cart, 1.0, PERIOD)
    model, cart = cart_on_control(lambda now, memory: np.nan)
    with pytest.raises(fb.SceneError, match="its law at t = 0 s"):
        run(model, cart, 1.0, PERIOD)


def recipe(page_name: str, title: str) -> dict[str, Any]:
    """What the program of a section of a how-to page leaves behind."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / f"{page_name}.md").read_text(encoding="utf-8")
    body = page.split(f"## {title}\n")[1].split("\n## ")[0]
    code = "\n".join(line[4:] for line in body.split("\n- ")[0].splitlines() if line.startswith("    ") or not line)
    found: dict[str, Any] = {"fb": fb, "np": np}
    exec(code, found)
    return found


def test_the_recipe_of_controllers_works() -> None:
    found = recipe("loads", "Controllers")
    assert abs(found["moved"].point("cart")[-1, 0] - 0.2) < 0.02


@pytest.mark.slow
def test_the_recipe_of_winches_works() -> None:
    found = recipe("joints", "Winches")
    assert abs(found["rope"]["length"][-1] - (49.978 - 0.125)) < 1e-9 and found["lifted"].drift("balance") < 1e-12
    assert np.all(np.abs(found["pull"][1:-1] - 5500.0) < 800.0)


@pytest.mark.slow
def test_a_controller_turns_a_hinge_and_reads_its_angle() -> None:
    arm = fb.RigidBody("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.5, 0, 0))

    def servo(now: Any, memory: np.ndarray) -> float:
        angle, spin = now.joint("pivot")
        return 20.0 * (0.4 - angle) - 5.0 * spin

    hand = fb.Controller("hand", servo, period=0.01)
    pivot = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "pivot", axis=(0, 0, 1), torque=hand)
    result = fb.simulate(fb.compile_scene(fb.Scene(arm, hand, pivot)), t_end=4.0, step=0.01, progress=False)
    assert abs(result.joint("pivot")["angle"][-1] - 0.4) < 1e-3 and abs(result.drift("balance")) < 1e-12


@pytest.mark.slow
def test_a_controller_drives_a_slider_and_reads_its_place() -> None:
    section = fb.Section.circle(radius=0.02, E=1e9, rho=1000.0)
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=section, elements=2, degree=3)
    cart = fb.PointMass("cart", mass=1.0)
    seen = [0.4]

    def servo(now: Any, memory: np.ndarray) -> float:
        s, last = now.slider("run"), memory[0]
        memory[0] = s
        seen.append(s)
        return 20.0 * (1.2 - s) - 8.0 * (s - last) / 0.01

    hand = fb.Controller("hand", servo, period=0.01, memory=(0.4,))
    ends = fb.Clamp(rail.start), fb.Clamp(rail.end)
    run_on = fb.Slider("run", cart, rail, at=0.4, drive=fb.Drive(force=hand))
    result = fb.simulate(fb.compile_scene(fb.Scene(rail, cart, *ends, hand, run_on)), t_end=4.0, step=0.005, progress=False)
    assert abs(result.slider("run")["s"][-1] - 1.2) < 1e-2 and abs(result.drift("balance")) < 1e-11
    assert len(seen) == 401


@pytest.mark.slow
def test_a_controller_holds_a_load_on_a_rope() -> None:
    crate = fb.PointMass("crate", mass=50.0, position=(0, 0, -10.0))

    def hold(now: Any, memory: np.ndarray) -> float:
        length, speed = now.winch("rope")
        return 50.0 * 9.81 + 400.0 * (length - 9.0) + 300.0 * speed

    hand = fb.Controller("hand", hold, period=0.01, start=490.5)
    rope = fb.Winch("rope", fb.GROUND.point((0, 0, 0)), crate, stiffness=1e6, mass_per_length=1e-6, length=9.99, segments=1,
                    tension=hand, inertia=5.0)
    model = fb.compile_scene(fb.Scene(crate, hand, rope, gravity=(0, 0, -9.81)))
    result = fb.simulate(model, t_end=6.0, step=0.005, progress=False, observe=("energy", "spring"))
    assert abs(result.winch("rope")["length"][-1] - 9.0) < 1e-2 and abs(result.drift("balance")) < 1e-11
