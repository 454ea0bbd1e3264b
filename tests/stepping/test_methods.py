"""Every time integration method: the compiled run equals the slow twin of `tests/naive_methods.py`, step by step.

The scenes differ, but each holds every kind of part, so that a method compiles one variant of its kernels.
"""
from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import fastbeam as fb
from fastbeam.model.model import Model

sys.path.insert(0, str(Path(__file__).parents[1]))
import naive_methods as twins  # noqa: E402
from naive import Twin  # noqa: E402
from small_scenes import bead, bent, cantilever, free_beam  # noqa: E402

Array = np.ndarray
H, STEPS = 0.02, 3
TWIN = 1e-11  # of the largest entry; measured up to 1e-12
SECTION = fb.Section(EA=200.0, GA2=150.0, GA3=130.0, GJ=50.0, EI2=60.0, EI3=70.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
# name -> arguments of simulate
METHODS: dict[str, dict[str, Any]] = {
    "energy_momentum": {"method": "energy_momentum"}, "midpoint": {"method": "midpoint"},
    "trapezoidal": {"method": "trapezoidal"}, "generalized_alpha 0.7": {"method": fb.Method("generalized_alpha", rho_inf=0.7)},
    "generalized_alpha 0": {"method": fb.Method("generalized_alpha", rho_inf=0.0)}}
OTHERS = [name for name in METHODS if name != "energy_momentum"]
AT_END = [name for name in OTHERS if name != "midpoint"]


def coupled() -> fb.Section:
    """Every strain pulls every stress."""
    a = np.random.default_rng(7).standard_normal((6, 6))
    return fb.Section.from_matrix(20.0 * (a @ a.T + 4.0 * np.eye(6)), rhoA=1.0, rhoI2=0.3, rhoI3=0.5)


def gust(t: float) -> float:
    """A load that changes within a step."""
    return 1.0 + np.sin(20.0 * t)


def beam(name: str, start: Any, end: Any, strain: str, elements: int = 1, **changes: Any) -> fb.Beam:
    """A straight beam of quadratic elements."""
    common = {"section": SECTION, "strain": strain, "elements": elements, "degree": 2}
    return fb.Beam.straight(name, start, end, **common | changes)


# ---------------------------------------------------------------------------------------------------------------- scenes
def mass_on_own_curve() -> fb.Scene:
    """A mass on a clamped rail, the rail carries a rod and the rod a body on an arm."""
    rail, rod = beam("rail", (0, 0, 0), (3, 0, 0), "simo_reissner", 3), beam("rod", (3, 0, 0), (4, 1, 0), "green_lagrange")
    body = fb.RigidBody("body", mass=2.0, inertia=[[1, 0.1, 0], [0.1, 1.2, 0], [0, 0, 0.9]], position=(4.1, 1.2, 0.5))
    mass = fb.PointMass("mass", mass=0.4)
    return fb.Scene(rail, rod, body, mass, fb.Clamp(rail.start), fb.RigidConnection(rail.end, rod.start),
                    fb.BallJoint(rod.end, body.point((-0.1, -0.2, -0.5))),
                    fb.Slider("run", mass, rail, at=0.95, rate=2.0, curve="own"), fb.RigidMotion(body, spin=(1, 2, -1)),
                    fb.Load("tip", rod.end, force=(1, 2, -3), moment=(0.5, -1, 2), time=gust),
                    gravity=(1, 2, -9.81), project_velocities=True)


def body_on_tied_bspline() -> fb.Scene:
    """A point of a body slides on a spline that hangs on the arm of a hub."""
    rail = beam("rail", (0, 0, 0), (2, 1, 0.5), "green_lagrange", 4, section=coupled(), interpolation="bspline", twist=0.7)
    start, on_rail, end = rail.reference([0.0, 0.8, rail.length])[0]
    hub = fb.RigidBody("hub", mass=2.0, inertia=(1, 1.2, 0.9), position=start + (-0.2, 0.1, 0.3))
    rod = beam("rod", end, end + (1, 0, 0.3), "simo_reissner", section=coupled())
    hook = fb.RigidBody("hook", mass=0.7, inertia=(0.1, 0.12, 0.09), position=on_rail + (0.1, -0.2, 0.4), spin=(1, 2, 3),
                        velocity=(0.2, 0.4, -0.3))
    return fb.Scene(rail, hub, rod, hook, fb.RigidConnection(hub, rail.start), fb.BallJoint(rail.end, rod.start), fb.Pin(rod.end),
                    fb.Slider("hang", hook.point((-0.1, 0.2, -0.4)), rail, at=0.8), bent(rail),
                    fb.DistributedLoad("wind", rod, force=(0, 1, 2), moment=(0.3, 0.2, -0.1), time=gust), gravity=(0, 0, -9.81),
                    project_velocities=True)


def beam_and_mass_on_curved_rail() -> fb.Scene:
    """The node of a rod and a mass slide on the same rail, whose weight changes in time; a body ends the rod."""
    rail = fb.Beam.arc("rail", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=2.0, angle=1.2, section=SECTION, elements=2, degree=3)
    at = rail.reference(rail.node_s[2])[0][0]
    rod = beam("rod", at, at + (0.3, 0.2, -1.0), "green_lagrange")
    body = fb.RigidBody("body", mass=1.0, inertia=(0.5, 0.4, 0.3), position=at + (0.3, 0.2, -1.2))
    mass = fb.PointMass("mass", mass=0.3)
    return fb.Scene(rail, rod, body, mass, fb.RigidConnection(rod.end, body), fb.Pin(rail.end),
                    fb.Slider("hang", rod.start, rail, at=rail.node_s[2]), fb.Slider("run", mass, rail, at=1.15, rate=3.0),
                    bent(rail), fb.RigidMotion([rod, body], spin=(0.3, 0.2, 0.5)),
                    gravity=(1, 0, -9.81), gravity_time=gust, project_velocities=True)


def tied_point_on_tied_rail() -> fb.Scene:
    """Both ends of the rail hang on arms of bodies, the sliding mass is the tip of a rod."""
    hub = fb.RigidBody("hub", mass=2.0, inertia=(1, 1.2, 0.9), position=(-0.2, 0.1, 0.3))
    tail = fb.RigidBody("tail", mass=1.0, inertia=(0.5, 0.4, 0.3), position=(2.2, 0.1, -0.3))
    rail = beam("rail", (0, 0, 0), (2, 0, 0), "simo_reissner", 2, section=coupled())
    rod = beam("rod", (0.9, 1.0, 0.5), (0.9, 0, 0), "green_lagrange")
    mass = fb.PointMass("mass", mass=0.3)
    return fb.Scene(hub, tail, rail, rod, mass, fb.RigidConnection(hub, rail.start), fb.BallJoint(mass, rod.end),
                    fb.BallJoint(rail.end, tail.point((-0.2, -0.1, 0.3))), fb.Slider("run", mass, rail, at=0.9), bent(rail),
                    fb.Load("push", tail.point((0.3, 0, 0)), force=(1, 2, 3), moment=(3, 2, 1), time=gust),
                    project_velocities=True)


SCENES: dict[str, Callable[[], fb.Scene]] = {f.__name__.replace("_", " "): f for f in (
    mass_on_own_curve, body_on_tied_bspline, beam_and_mass_on_curved_rail, tied_point_on_tied_rail)}


@cache
def both_sides(name: str) -> tuple[Model, Twin]:
    """The model of a scene and its twin, made once."""
    scene = SCENES[name]()
    model = fb.compile_scene(scene)
    return model, Twin(scene, model)


def simulate(model: Model, name: str, steps: int = STEPS, h: float = H, **changes: Any) -> fb.Result:
    """A run of a few steps."""
    return fb.simulate(model, **{"t_end": steps * h, "step": h, "every": 1, "progress": False} | METHODS[name] | changes)


def assert_same_motion(a: Any, b: Any, tolerance: float) -> None:
    """q, v, s and force of two states, each relative to its largest entry."""
    for name, x, y in zip(("q", "v", "s", "force"), a, b):
        x, y = np.ravel(x), np.ravel(y)
        if y.size:
            assert np.max(np.abs(x - y)) <= tolerance * np.max(np.abs(y)), name


# --------------------------------------------------------------------------------------------------------------- the twin
CASES = [(scene, name) for scene in SCENES for name in ("midpoint", "trapezoidal", "generalized_alpha 0.7")]
CASES += [("mass on own curve", name) for name in ("energy_momentum", "generalized_alpha 0")]


@pytest.mark.parametrize(("scene", "name"), CASES)
def test_a_run_equals_the_twin(scene: str, name: str) -> None:
    model, twin = both_sides(scene)
    method = METHODS[name]["method"]
    method = method if isinstance(method, fb.Method) else fb.Method(method)
    m = twins.run(twin, method.name, (model.q0, model.v0, model.s0), H, STEPS, method.rho_inf)
    result = simulate(model, name)
    assert result.info["steps"] == STEPS and result.info["fallbacks"] == 0
    # the motion is large enough to show every term
    assert np.max(np.abs(result.state.q - model.q0)) > 0.02
    assert np.max(np.abs(result.state.s - model.s0)) > 5e-3
    assert_same_motion(result.state, (m.q, m.v, m.s, m.force), TWIN)


@pytest.mark.parametrize("scene", SCENES)
def test_the_first_contact_force_is_that_of_consistent_accelerations(scene: str) -> None:
    model, twin = both_sides(scene)
    q, v = (x.reshape(-1, 4, 3) for x in (model.q0, model.v0))
    _, force = twins.initial_accelerations(twin, 0.0, q, v, model.s0)
    found = simulate(model, "trapezoidal", steps=1).series["contact_force"][0]
    assert np.max(np.abs(found - force)) <= TWIN * np.max(np.abs(force))
    # and the row after a step has the force of its end
    result = simulate(model, "trapezoidal", steps=2)
    np.testing.assert_array_equal(result.series["contact_force"][2].reshape(-1), result.state.force)


# ------------------------------------------------------------------------------------------------------ one compiled method
@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("scene", SCENES)
def test_newton_converges_as_fast_as_for_the_conserving_step(scene: str, name: str) -> None:
    # a term that lacks in the tangent costs iterations and nothing else
    model, _ = both_sides(scene)
    ours, known = (simulate(model, key, steps=10).info["iterations"] for key in (name, "energy_momentum"))
    assert ours <= known + 10


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("scene", SCENES)
def test_gaps_stay_closed_and_triads_orthonormal(scene: str, name: str) -> None:
    model, _ = both_sides(scene)
    result = simulate(model, name, steps=10)
    assert result.drift("gap") <= 1e-14
    d = result.state.q.reshape(-1, 4, 3)[:, 1:]
    np.testing.assert_allclose(d @ d.transpose(0, 2, 1), np.broadcast_to(np.eye(3), d.shape), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("name", OTHERS)
def test_rows_do_not_change_the_run(name: str) -> None:
    model, _ = both_sides("mass on own curve")
    # powers of two, so that the loads are asked for at the same times
    often, seldom = (simulate(model, name, steps=9, h=1 / 64, every=n) for n in (1, 4))
    for x, y in zip(often.state, seldom.state):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(often.series["total"][[0, 4, 8, 9]], seldom.series["total"])
    if name in AT_END:
        # a force that belongs to a time does not depend on its neighbours
        np.testing.assert_array_equal(often.series["contact_force"][[0, 4, 8, 9]], seldom.series["contact_force"])


@pytest.mark.parametrize("name", ["midpoint", "trapezoidal"])
def test_superlu_gives_the_same_run(name: str) -> None:
    scene = SCENES["tied point on tied rail"]()
    chain, superlu = (simulate(fb.compile_scene(scene, solver=solver), name, **more)
                      for solver, more in (("chain", {}), ("sparse", {"solver": "superlu"})))
    assert_same_motion(superlu.state, chain.state, 1e-10)


@pytest.mark.parametrize("scene", SCENES)
def test_rho_inf_of_one_is_the_trapezoidal_rule(scene: str) -> None:
    model, _ = both_sides(scene)
    one = simulate(model, "generalized_alpha 0.7", steps=20, method=fb.Method("generalized_alpha", rho_inf=1.0))
    assert_same_motion(one.state, simulate(model, "trapezoidal", steps=20).state, 1e-10)
    assert np.max(np.abs(one.state.v - simulate(model, "generalized_alpha 0.7", steps=20).state.v)) > 1e-4


def test_rho_inf_is_0_8_where_nothing_is_said() -> None:
    model, _ = both_sides("mass on own curve")
    silent, said = (simulate(model, "generalized_alpha 0.7", method=fb.Method("generalized_alpha", rho_inf=rho))
                    for rho in (None, 0.8))
    np.testing.assert_array_equal(silent.state.q, said.state.q)
    assert "0.8" in silent.info["method"]


def test_the_conserving_step_is_the_default() -> None:
    model, _ = both_sides("mass on own curve")
    default = fb.simulate(model, t_end=STEPS * H, step=H, every=1, progress=False)
    np.testing.assert_array_equal(default.state.q, simulate(model, "energy_momentum").state.q)


# -------------------------------------------------------------------------------------------------------- restart and ends
def test_a_midpoint_run_cut_in_two_is_the_run() -> None:
    model, _ = both_sides("mass on own curve")
    whole, half = simulate(model, "midpoint", steps=8, h=1 / 64), simulate(model, "midpoint", steps=4, h=1 / 64)
    rest = simulate(model, "midpoint", steps=8, h=1 / 64, start=half.checkpoint)
    for x, y in zip(rest.state, whole.state):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("make", [free_beam, cantilever])
def test_a_trapezoidal_run_without_sliders_goes_on_from_its_state(make: Callable[[], fb.Scene]) -> None:
    # accelerations in balance are what the method carries: they can be found again from positions and velocities
    model = fb.compile_scene(make())
    whole, half = simulate(model, "trapezoidal", steps=20, h=0.01), simulate(model, "trapezoidal", steps=10, h=0.01)
    rest = simulate(model, "trapezoidal", steps=20, h=0.01, start=fb.Start(half.state, time=0.1))
    assert_same_motion(rest.state, whole.state, 1e-10)


@pytest.mark.parametrize("name", AT_END)
def test_loads_act_at_their_time(name: str) -> None:
    def pushed(late: float) -> fb.Scene:
        rod = beam("beam", (0, 0, 0), (3, 0, 0), "simo_reissner", 2)
        return fb.Scene(rod, fb.Clamp(rod.start), fb.Load("tip", rod.end, force=(0, 1, 20), time=lambda t: gust(t - late)))

    now = simulate(fb.compile_scene(pushed(0.0)), name, steps=10)
    later = simulate(fb.compile_scene(pushed(0.5)), name, start=fb.Start(time=0.5), t_end=0.5 + 10 * H)
    assert np.max(np.abs(now.state.v)) > 0.1
    # times differ by round-off, so do the loads
    assert_same_motion(later.state, now.state, 1e-10)


@pytest.mark.parametrize("name", AT_END)
def test_start_needs_nothing_that_new_versions_of_scipy_warn_of(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # from 1.18 on these make another kind of matrix of dense arrays some day
    def of_sparse(function: Any) -> Any:
        def warned(*arguments: Any, **options: Any) -> Any:
            parts = arguments[0] if isinstance(arguments[0], (list, tuple)) else arguments
            assert any(sparse.issparse(part) for part in parts)
            return function(*arguments, **options)
        return warned

    for noun in ("block_diag", "kron", "kronsum", "tril", "triu"):
        monkeypatch.setattr(sparse, noun, of_sparse(getattr(sparse, noun)))
    assert simulate(fb.compile_scene(bead()), name).info["steps"] == STEPS


@pytest.mark.parametrize("name", OTHERS)
def test_an_equilibrium_stays_where_it_is(name: str) -> None:
    model = fb.compile_scene(cantilever())
    rest = fb.solve_static(model)
    moved = simulate(model, name, steps=50, h=0.01, start=rest.state)
    assert np.max(np.abs(rest.state.q - model.q0)) > 0.1
    assert np.max(np.abs(moved.state.q - rest.state.q)) <= 1e-9


@pytest.mark.parametrize("name", OTHERS)
def test_a_run_ends_where_a_slider_leaves_its_beam(name: str) -> None:
    model = fb.compile_scene(bead(at=2.0, rate=5.0))
    result = simulate(model, name, steps=100, h=0.01)
    assert [event["kind"] for event in result.events] == ["slider_end"]
    assert result.events[0]["end"] == "end" and 0.15 < result.t[-1] < 0.3
    assert result.slider("run")["s"][-1] == pytest.approx(3.0, rel=1e-9)
    # a slider may rest at the end, round-off included
    assert result.slider("run")["s"][-1] <= 3.0 * (1.0 + 1e-12)
    # the last, shortened step starts from the state before the failed trials
    before = simulate(model, name, h=0.01, t_end=result.t[-2])
    np.testing.assert_array_equal(before.state.s, result.series["s_slide"][-2])


def test_step_control_and_order_four_go_with_the_midpoint_rule() -> None:
    model = fb.compile_scene(bead())
    fine = simulate(model, "midpoint", steps=800, h=0.2 / 800, order=4, every=100).state.q
    controlled = simulate(model, "midpoint", steps=20, h=0.01, tolerance=1e-7)
    assert controlled.info["accepted"] > 20
    assert np.max(np.abs(controlled.state.q - fine)) < 1e-3
    errors = [np.max(np.abs(simulate(model, "midpoint", steps=n, h=0.2 / n, order=order).state.q - fine))
              for order, n in ((2, 200), (4, 200))]
    assert errors[1] < 0.1 * errors[0]


# ---------------------------------------------------------------------------------------------------------------- refused
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"method": "leapfrog"}, "'leapfrog' does not exist.*'energy_momentum'.*'midpoint'.*'trapezoidal'.*'generalized_alpha'"),
    ({"method": None}, "method: must be a text, got None"),
    ({"method": ["midpoint"]}, r"method: must be a text, got \['midpoint'\]"),
    ({"method": fb.Method("generalized_alpha", rho_inf=1.2)}, r"rho_inf: .*\[0, 1\].*1\.2"),
    ({"method": fb.Method("generalized_alpha", rho_inf=-0.1)}, r"rho_inf: .*\[0, 1\].*-0\.1"),
    ({"method": fb.Method("midpoint", rho_inf=0.5)}, "rho_inf: .*generalized_alpha.*midpoint"),
    ({"method": fb.Method("trapezoidal", rho_inf=1.0)}, "rho_inf: .*generalized_alpha.*trapezoidal"),
    ({"method": "trapezoidal", "order": 4}, "order: .*'trapezoidal' has order 2.*'energy_momentum' and 'midpoint'"),
    ({"method": "generalized_alpha", "order": 4}, "order: .*'generalized_alpha' has order 2"),
    ({"method": "midpoint", "order": 3}, "order: must be 2 or 4"),
    ({"method": "trapezoidal", "tolerance": 1e-6}, "tolerance: .*'energy_momentum' and 'midpoint'.*'trapezoidal'"),
    ({"method": "generalized_alpha", "tolerance": 1e-6}, "tolerance: .*'generalized_alpha'"),
]


@pytest.mark.parametrize(("arguments", "text"), REFUSED, ids=lambda x: str(x) if isinstance(x, dict) else "")
def test_arguments_that_do_not_go_together_are_refused(arguments: dict[str, Any], text: str) -> None:
    model, _ = both_sides("mass on own curve")
    with pytest.raises(fb.SceneError, match=text):
        fb.simulate(model, t_end=0.1, step=0.01, **arguments)


@pytest.mark.parametrize("rho_inf", [float("nan"), "big"])
def test_a_spectral_radius_is_a_number(rho_inf: Any) -> None:
    with pytest.raises(fb.SceneError, match=f"Method 'generalized_alpha': rho_inf must be a finite number, got {rho_inf!r}"):
        fb.Method("generalized_alpha", rho_inf=rho_inf)


@pytest.mark.parametrize(("name", "label"), [("energy_momentum", "energy-momentum"), ("midpoint", "midpoint"),
                                             ("trapezoidal", "trapezoidal"), ("generalized_alpha 0.7", "alpha.*0.7")])
def test_a_result_names_its_method(name: str, label: str) -> None:
    model, _ = both_sides("mass on own curve")
    result = simulate(model, name, steps=1)
    assert re.search(label, result.info["method"])
