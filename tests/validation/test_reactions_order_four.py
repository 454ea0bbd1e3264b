"""Reactions with order 4, of two runs that are extrapolated: against exact motions, sums of forces, what is refused."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb

Array = np.ndarray
G = 9.81


def exact(rates: Any, start: tuple[float, float], t: Array) -> Array:
    """Angle and its rate [2, n] by the embedded method of order 8 of Dormand and Prince."""
    found = solve_ivp(rates, (0.0, t[-1]), start, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=t)
    return np.array(found.y)


def fourth(model: fb.Model, t_end: float, n: int, every: int, **options: Any) -> fb.Result:
    run = fb.simulate(model, t_end=t_end, step=t_end / n, every=every, order=4, progress=False, **options)
    assert run.events == [] and run.info["order"] == 4
    return run


def rates_of(errors: list[float]) -> Array:
    return np.log2(np.array(errors[:-1]) / errors[1:])


def pendulum() -> fb.Model:
    """A mass on a rod without mass, let go at 1.2 rad."""
    top = fb.PointMass("top", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.5, position=(0.7 * np.sin(1.2), 0, -0.7 * np.cos(1.2)))
    return fb.compile_scene(fb.Scene(top, bob, fb.Clamp(top, name="hanger"), fb.DistanceJoint(top, bob, name="rod"),
                                     gravity=(0, 0, -G)))


def test_the_pull_of_a_pendulum_is_of_fourth_order() -> None:
    """m (g cos a + L a'^2) along the rod; the hanger carries it and the weight of what it holds, in every row."""
    model, errors, ends = pendulum(), [], []
    for n in (60, 120, 240):
        run = fourth(model, 1.2, n, n // 12, observe=("energy", "reaction"))
        angle, rate = exact(lambda t, y: (y[1], -G / 0.7 * np.sin(y[0])), (1.2, 0.0), run.t)
        pull = 2.5 * (G * np.cos(angle) + 0.7 * rate**2)
        of_rod = run.reaction("rod")["force"]
        off = np.linalg.norm(of_rod - pull[:, None] * np.stack((-np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1), axis=1)
        errors.append(float(np.max(off[1:-1])))
        ends.append(float(off[-1]))
        assert np.max(np.abs(run.reaction("hanger")["force"] - of_rod - (0.0, 0.0, G))) < 1e-12
        assert run.drift("total") < 1e-14
    assert np.all(np.abs(rates_of(errors) - 4.0) < 0.1) and errors[-1] < 1e-6, errors
    # three short steps back tell those of the last row
    assert np.all(rates_of(ends) > 2.8), ends


def test_an_arm_on_a_shaken_base_needs_the_exact_forces() -> None:
    """J a'' = m c (x'' sin a - g cos a): the hinge moves the mass of the arm, the support that of the base besides."""
    arm = fb.RigidBody("arm", mass=1.5, inertia=np.diag([0.02, 0.05, 0.04]), position=(0.4, 0, 0))
    base = fb.RigidBody("base", mass=2.0, inertia=np.eye(3) * 0.1, position=(0, 0, 0))
    hinge = fb.RevoluteJoint(base, arm.point((-0.4, 0, 0)), name="hinge", axis=(0, 0, 1))
    shaker = fb.PrescribedMotion("shaker", base, displacement=lambda t: (0.02 * (1.0 - np.cos(12.0 * t)), 0.0, 0.0),
                                 rotation=lambda t: np.zeros(3))
    model = fb.compile_scene(fb.Scene(arm, base, hinge, shaker, gravity=(0, -G, 0)))

    def shaken(t: Any) -> Any:
        return 0.02 * 144.0 * np.cos(12.0 * t)

    def rates(t: Any, y: Any) -> tuple[Any, Any]:
        return y[1], 0.6 * (shaken(t) * np.sin(y[0]) - G * np.cos(y[0])) / (0.04 + 1.5 * 0.16)

    errors = []
    for n in (40, 80, 160):
        run = fourth(model, 1.0, n, n // 20, observe=("energy", "reaction"))
        angle, rate = exact(rates, (0.0, 0.0), run.t)
        spin_up = rates(run.t, (angle, rate))[1]
        x = shaken(run.t) - 0.4 * (spin_up * np.sin(angle) + rate**2 * np.cos(angle))
        y = 0.4 * (spin_up * np.cos(angle) - rate**2 * np.sin(angle))
        of_hinge = 1.5 * np.stack((x, y + G), axis=1)
        of_base = of_hinge + 2.0 * np.stack((shaken(run.t), G + 0.0 * run.t), axis=1)
        off = [np.abs(run.reaction(name)["force"][1:-1, :2] - f[1:-1])
               for name, f in (("hinge", of_hinge), ("shaker", of_base))]
        errors.append(float(np.max(off)))
        assert run.drift("balance") < 1e-14 and np.max(np.abs(run.reaction("shaker")["moment"])) < 1e-12
    assert np.all(np.abs(rates_of(errors) - 4.0) < 0.1) and errors[-1] < 1e-5, errors


def mast() -> tuple[fb.Beam, fb.Model]:
    """A soft mast on two supports that sways under a load which grows and fades smoothly."""
    soft = fb.Section(EA=1e3, GA2=400.0, GA3=400.0, GJ=0.7, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)
    beam = fb.Beam.straight("mast", (0, 0, 0), (2, 0, 0), section=soft, elements=4, degree=2)
    push = fb.Load("push", beam.node(4), force=(0.0, 0.6, 0.4), time=lambda t: np.sin(2.0 * t)**4)
    return beam, fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start, name="left"), fb.Pin(beam.end, axes="yz", name="right"),
                                           fb.Pin(beam.node(1), axes="z", name="prop"), push))


def test_reactions_of_all_supports_and_loads_make_up_the_change_of_momentum() -> None:
    """The derivative of the momentum of rows by differences of order 6."""
    beam, model = mast()
    errors = []
    for n in (40, 80, 160):
        run = fourth(model, 1.0, n, 1, observe=("energy", "momentum", "reaction"))
        p, load = run.series["lin_mom"], np.sin(2.0 * run.t)[:, None]**4 * (0.0, 0.6, 0.4)
        change = n * sum(c * (p[3 + k:len(p) - 3 + k] - p[3 - k:len(p) - 3 - k])
                         for k, c in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0)))
        total = sum(run.reaction(name)["force"] for name in ("left", "right", "prop")) + load
        errors.append(float(np.max(np.abs(total[3:-3] - change))))
    assert np.all(rates_of(errors) > (3.0, 3.6)), errors
    assert errors[-1] < 1e-7


def test_files_rows_and_names_are_as_of_other_runs(tmp_path: Path) -> None:
    model = pendulum()
    run = fourth(model, 0.4, 40, 10, observe=("energy", "reaction"), output=tmp_path / "run.h5")
    again = fb.load_result(tmp_path / "run.h5")
    assert np.array_equal(again.reaction("hanger")["force"], run.reaction("hanger")["force"])
    assert run.names["reactions"] == ["hanger", "rod"] and "two runs extrapolated" in run.info["method"]
    # without reactions the run is composed of substeps as before
    assert "extrapolated" not in fourth(model, 0.4, 40, 10).info["method"]
    two = fb.simulate(model, t_end=0.4, step=0.01, every=10, observe=("reaction",), progress=False)
    assert 1e-5 < np.max(np.abs(two.reaction("rod")["force"] - run.reaction("rod")["force"])) < 0.1


@pytest.mark.parametrize(("name", "options"), [
    ("tolerance", {"tolerance": 1e-6}), ("callback", {"callback": lambda t, state: None}),
    ("checkpoint", {"output": fb.Output(checkpoint="run.check")})])
def test_what_needs_one_state_on_the_way_is_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(fb.SceneError, match=f"{name}: order=4 with .* or with 'reaction' observed"):
        fb.simulate(pendulum(), t_end=0.1, step=0.01, order=4, observe=("reaction",), progress=False, **options)


def test_what_has_kinks_in_time_is_refused() -> None:
    arm = fb.RigidBody("arm", mass=1.0, inertia=(0.02, 0.03, 0.04), position=(0.5, 0, 0))
    for options in ({"friction": 0.3}, {"stops": fb.Stops(start=-0.5, restitution=0.5)}):
        pivot = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), **options)
        with pytest.raises(fb.SceneError, match="order=4"):
            fb.simulate(fb.compile_scene(fb.Scene(arm, pivot)), t_end=0.1, step=0.01, order=4, observe=("reaction",))
    with pytest.raises(fb.SceneError, match="reactions are available for the conserving step only; leave out method"):
        fb.simulate(pendulum(), t_end=0.1, step=0.01, order=4, method="midpoint", observe=("reaction",))
