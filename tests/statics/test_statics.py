"""Statics: what has no equilibrium is refused or reported, what has one is found."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.loop import NOT_CONVERGED, OK
from fastbeam.statics.equilibrium import StaticSolver

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import SECTION, cantilever, straight  # noqa: E402


def solve(scene: fb.Scene, **arguments: Any) -> fb.Result:
    return fb.solve_static(fb.compile_scene(scene), **arguments)


def beam() -> fb.Beam:
    return straight("beam", (0, 0, 0), (3, 0, 0))


# ------------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(("arguments", "message"), [
    ({"load_step": 0.0}, "load_step: must be a finite number > 0 and <= 1, got 0.0"),
    ({"load_step": 2.0}, "load_step: must be a finite number > 0 and <= 1, got 2.0"),
    ({"load_step": np.nan}, "load_step: must be a finite number > 0 and <= 1, got nan"),
    ({"load_step": "small"}, "load_step: must be a finite number > 0 and <= 1, got 'small'"),
    ({"load_step": None}, "load_step: must be a finite number > 0 and <= 1, got None"),
    ({"smallest_step": [0.1]}, r"smallest_step: must be a finite number > 0 and <= 1, got \[0.1\]"),
    ({"smallest_step": True}, "smallest_step: must be a finite number > 0 and <= 1, got True"),
    ({"at_time": "later"}, "at_time: must be a finite number, got 'later'"),
    ({"at_time": np.inf}, "at_time: must be a finite number, got inf"),
    ({"smallest_step": 0.5}, "needs 0 < smallest_step <= load_step <= 1, got 0.5 and 0.25"),
    ({"levels": (0.5, 0.25)}, r"levels: must be increasing load factors in \(0, 1\], got \(0.5, 0.25\)"),
    ({"levels": (0.0, 1.0)}, "levels: must be increasing load factors"), ({"levels": (0.5, 1.5)}, "levels: must be increasing"),
    ({"levels": ()}, "levels: must be increasing load factors"), ({"levels": "all"}, "levels: must be increasing load factors"),
    ({"levels": 0.5}, "levels: must be increasing"),
    ({"largest_load_step": 0.0}, "largest_load_step: must be a finite number > 0"),
    ({"observe": ("enrgy",)}, "observe: 'enrgy' does not exist"),
    ({"points": {"tip": 3}}, "point 'tip': must be a node of a beam"),
    ({"backend": "mumps"}, "backend 'mumps' does not exist: choose 'auto', 'pardiso' or 'superlu'"),
    ({"max_iterations": 0}, "max_iterations: must be a whole number >= 1, got 0"),
    ({"max_iterations": 2.5}, "max_iterations: must be a whole number >= 1, got 2.5"),
    ({"max_iterations": "20"}, "max_iterations: must be a whole number >= 1, got '20'"),
    ({"max_iterations": True}, "max_iterations: must be a whole number >= 1, got True"),
    ({"start": fb.compile_scene(fb.Scene(straight("short", (0, 0, 0), (1, 0, 0), elements=1))).state()},
     r"start: q has shape \(36,\), scene 'cantilever' needs \(84,\)")])
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        solve(cantilever(), **arguments)


@pytest.mark.parametrize(("what", "shown"), [(cantilever(), "scene 'cantilever'"), (None, "None")])
def test_what_is_not_compiled_is_refused(what: Any, shown: str) -> None:
    message = rf"solve_static: needs a model, got {shown}.*; compile it first: model = fb.compile_scene\(scene\)"
    with pytest.raises(fb.SceneError, match=message):
        fb.solve_static(what)


def test_time_functions_need_a_time() -> None:
    b = beam()
    scene = fb.Scene(b, fb.Clamp(b.start), fb.Load("tip", b.end, force=(0, 0, 40), time=lambda t: t))
    with pytest.raises(fb.SceneError, match="loads have time functions, so a time is needed; give the time with at_time"):
        solve(scene)
    np.testing.assert_allclose(solve(scene, at_time=0.5).state.q, solve(cantilever(20.0)).state.q, rtol=0.0, atol=1e-12)


# -------------------------------------------------------------------------------------------------------------- supports
def held_by(*supports: Any) -> fb.Scene:
    b = beam()
    return fb.Scene(b, *(support(getattr(b, end)) for support, end in supports))


@pytest.mark.parametrize(("scene", "message"), [
    (held_by(), "beam 'beam': it is not supported in statics, .*6 of 6 rigid motions are free"),
    (held_by((fb.Pin, "start")), "beam 'beam': it is not supported in statics, it can turn about .*3 of 6 rigid motions are "
                                 "free"),
    (held_by((fb.Pin, "start"), (fb.Pin, "end")), r"can turn about \(1, 0, 0\) \(1 of 6 rigid motions are free\); add a Clamp")])
def test_beam_that_nothing_holds_is_refused(scene: fb.Scene, message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.solve_static(fb.compile_scene(scene, planar=False))


def test_three_pins_off_one_line_hold_a_bent_beam() -> None:
    arc = fb.Beam.arc("arc", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=2.0, angle=1.5, section=SECTION, elements=4, degree=2)
    scene = fb.Scene(arc, fb.Pin(arc.start), fb.Pin(arc.node(4)), fb.Pin(arc.end), gravity=(0, 0, -9.81))
    result = solve(scene)
    q = result.state.q.reshape(-1, 12)
    np.testing.assert_allclose(q[[0, 4, 8], :3], fb.compile_scene(scene).q0.reshape(-1, 12)[[0, 4, 8], :3], atol=1e-15)
    assert np.min(q[:, 2]) < -1e-3


def test_what_hangs_on_one_pin_is_sent_to_relax() -> None:
    rope = fb.Beam.straight("rope", (0, 0, 0), (0, 0, -2), section=fb.Section.circle(radius=0.01, E=1e8, rho=1e3), elements=2)
    with pytest.raises(fb.SceneError, match="can turn about .*add a Clamp or Pins .relax finds the shape in which it hangs"):
        fb.solve_static(fb.compile_scene(fb.Scene(rope, fb.Pin(rope.start), gravity=(0, 0, -9.81))))


def test_loose_mass_and_loose_body_are_refused() -> None:
    b = beam()
    mass = fb.PointMass("ball", mass=1.0, position=(1, 1, 1))
    body = fb.RigidBody("block", mass=1.0, inertia=(1, 1, 1), position=(1, 1, 1))
    with pytest.raises(fb.SceneError, match="point mass 'ball': it is not supported in statics"):
        solve(fb.Scene(b, fb.Clamp(b.start), mass))
    with pytest.raises(fb.SceneError, match="body 'block': it is not supported in statics"):
        solve(fb.Scene(b, fb.Clamp(b.start), body))
    fixed = solve(fb.Scene(b, fb.Clamp(b.start), mass, fb.Pin(mass.center), gravity=(0, 0, -9.81)))
    np.testing.assert_array_equal(fixed.state.q[-12:-9], [1, 1, 1])


def test_second_beam_beside_a_held_one_is_named() -> None:
    b, other = beam(), straight("other", (0, 1, 0), (3, 1, 0))
    with pytest.raises(fb.SceneError, match="beam 'other': it is not supported in statics"):
        solve(fb.Scene(b, other, fb.Clamp(b.start)))
    joined = solve(fb.Scene(b, other, fb.Clamp(b.start), fb.RigidConnection(b.end, other.end), gravity=(0, 0, -1)))
    assert joined.t[-1] == 1.0


# ------------------------------------------------------------------------------------------------------------- behaviour
def test_no_load_leaves_a_curved_beam_free_of_stress() -> None:
    helix = fb.Beam.helix("spring", radius=1.0, pitch=0.5, turns=1.0, section=SECTION, elements=4, degree=2)
    model = fb.compile_scene(fb.Scene(helix, fb.Clamp(helix.start)))
    result = fb.solve_static(model)
    np.testing.assert_allclose(result.state.q, model.q0, rtol=0.0, atol=1e-13)
    assert result.series["strain"][-1] <= 1e-20


def test_answer_does_not_depend_on_the_load_steps() -> None:
    fine, coarse = solve(cantilever(200.0), load_step=0.1), solve(cantilever(200.0), load_step=1.0)
    assert fine.info["steps"] > coarse.info["steps"]
    assert fine.state.q[-10] > 1.0
    np.testing.assert_allclose(fine.state.q, coarse.state.q, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize(("strain", "range_"), [("simo_reissner", (1e1, 1e3, 1e5)), ("green_lagrange", (1e3, 1e4, 1e5))])
@pytest.mark.parametrize("planar", ["auto", False])
def test_slenderness_costs_no_iterations(planar: str | bool, strain: str, range_: tuple[float, ...]) -> None:
    # rolled up to a circle; with the stresses of every trial shape in the tangent: 76 at 10, 765 at 1e5; theory.md (4.6)
    found = []
    for slenderness in range_:
        radius = 2.0 / slenderness
        section = fb.Section.circle(radius=radius, E=1.0 / radius**4, rho=1.0)
        rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section, elements=10, degree=3, strain=strain)
        roll = fb.Load("roll", rod.end, moment=(0, 2.0 * np.pi * section.EI2, 0))
        result = fb.solve_static(fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), roll), planar=planar))
        assert np.max(np.abs(result.state.q[-12:-9])) < 1e-4  # the end meets the start
        found.append((result.info["steps"], result.info["iterations"]))
    assert max(steps for steps, _ in found) <= 4
    assert max(iterations for _, iterations in found) <= 30


def test_rows_are_load_steps_from_zero_to_one() -> None:
    scene = cantilever()
    result = solve(scene, points={"tip": scene.beams[0].end})
    assert result.t[0] == 0.0 and result.t[-1] == 1.0 and np.all(np.diff(result.t) > 0.0)
    assert np.all(np.diff(result.point("tip")[:, 2]) > 0.0)
    assert len(result.t_snap) == len(result.t)
    assert result.info["method"] == "static"


def test_equilibrium_makes_the_energy_stationary() -> None:
    # total potential in the neighbourhood of the answer, reached by solving for slightly different loads
    scenes = {f: solve(cantilever(f)) for f in (19.9, 20.0, 20.1)}

    def potential_at_20(result: fb.Result) -> float:
        return float(result.series["strain"][-1] - 20.0 * result.state.q[-10])

    low, middle, high = (potential_at_20(scenes[f]) for f in (19.9, 20.0, 20.1))
    curvature = low + high - 2.0 * middle
    assert curvature > 0.0
    # slope: zero up to the third order in the change of load
    assert abs(high - low) < 0.02 * curvature


def test_failed_load_step_carries_the_last_equilibrium() -> None:
    with pytest.raises(fb.ConvergenceError, match="load factor .*; a limit or buckling point may lie there") as caught:
        solve(cantilever(500.0), max_iterations=2, smallest_step=0.05)
    error = caught.value
    assert 0.0 <= error.time < 1.0
    assert error.worst.startswith("beam 'beam' node ")
    assert error.result.t[-1] == error.time
    np.testing.assert_array_equal(error.state.q, error.result.state.q)
    # what it carries is an equilibrium to go on from
    again = solve(cantilever(500.0), start=error.state)
    assert again.t[-1] == 1.0


def test_load_steps_have_a_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, last = StaticSolver.equilibrium, 0.0

    def short(solver: StaticSolver, factors: np.ndarray) -> tuple[int, list[float]]:
        nonlocal last
        # steps beyond 1/600 fail
        if factors[0] - last > 1.0 / 600.0:
            return NOT_CONVERGED, []
        found = whole(solver, factors)
        last = float(factors[0]) if found[0] == OK else last
        return found

    monkeypatch.setattr(StaticSolver, "equilibrium", short)
    with pytest.raises(fb.ConvergenceError, match="200 load steps were tried, .*fb.relax") as caught:
        solve(cantilever())
    rows = caught.value.result
    assert 50 < len(rows.t) <= 200
    assert rows.t[-1] == caught.value.time < 0.5
    # who asks for small steps gets as many as these are
    last = 0.0
    assert solve(cantilever(), load_step=1.0 / 601.0, largest_load_step=1.0 / 601.0).t[-1] == 1.0


def test_start_changes_the_way_and_not_the_answer() -> None:
    cold = solve(cantilever())
    model = fb.compile_scene(cantilever())
    warm = fb.solve_static(model, start=cold.state, load_step=1.0)
    np.testing.assert_allclose(warm.state.q, cold.state.q, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(model.q0, fb.compile_scene(cantilever()).q0)


def test_beam_hanging_from_a_ball_joint_turns_into_the_load() -> None:
    post, rope = straight("post", (0, 0, 0), (3, 0, 0)), straight("rope", (3, 0, 0), (3, 0, -2))
    scene = fb.Scene(post, rope, fb.Clamp(post.start), fb.BallJoint(post.end, rope.start), fb.Pin(rope.end),
                     fb.Load("side", rope.node(3), force=(0, 5, 0)))
    result = solve(scene)
    q, q0 = result.state.q.reshape(-1, 12), fb.compile_scene(scene).q0.reshape(-1, 12)
    np.testing.assert_allclose(q[6, :3], q[7, :3], atol=1e-14)
    np.testing.assert_allclose(q[13, :3], q0[13, :3], atol=1e-15)
    assert q[10, 1] > 1e-3


@pytest.mark.parametrize("degree", [3, 4])
def test_distributed_moment_on_a_spline_converges_with_its_degree(degree: int) -> None:
    # the moment works on the spin of the directors; lumped with the basis of the positions the order is 2
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.0, rhoI3=0.0)

    def tip(**family: object) -> np.ndarray:
        beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, **family)
        load = fb.DistributedLoad("twist", beam, moment=lambda s: np.stack((0 * s, 0 * s, 3 * np.cos(3 * s)), axis=1))
        model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), load))
        return fb.solve_static(model, points={"tip": beam.end}).point("tip")[-1]

    exact = tip(elements=8, degree=6)
    assert np.linalg.norm(exact - (1, 0, 0)) > 0.1
    coarse, fine = (float(np.linalg.norm(tip(elements=n, degree=degree, interpolation="bspline") - exact)) for n in (16, 32))
    assert np.log2(coarse / fine) > degree
