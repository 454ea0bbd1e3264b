"""Running a model: arguments that are refused, events, step control, failures, and what the run leaves behind."""
from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from counted import peak_bytes

import fastbeam as fb
from fastbeam import Result
from fastbeam.stepping import stepper as newton

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bead, cantilever, drifts, free_beam, straight  # noqa: E402

ROUND_OFF = 1e-12  # relative drift of an invariant over a few hundred steps
MODEL = fb.compile_scene(free_beam())


def run(model: fb.Model = MODEL, **changes: Any) -> Result:
    return fb.simulate(model, **{"t_end": 0.1, "step": 0.01, **changes})


# ------------------------------------------------------------------------------------------------------------- bad input
STATE = MODEL.state()


@pytest.mark.parametrize(("arguments", "message"), [
    ({"t_end": "soon"}, "t_end: must be a finite number, got 'soon'"),
    ({"t_end": "0.1"}, "t_end: must be a finite number, got '0.1'"),
    ({"t_end": True}, "t_end: must be a finite number, got True"),
    ({"t_end": [0.1]}, r"t_end: must be a finite number, got \[0.1\]"),
    ({"t_end": np.inf}, "t_end: must be a finite number, got inf"),
    ({"t_end": 0.0}, "t_end: must be greater than the time of the start, 0 s, got 0"),
    ({"start": fb.Start(time=0.2)}, "t_end: must be greater than the time of the start, 0.2 s, got 0.1"),
    ({"step": 0.0}, "step: must be a finite number > 0 s, got 0"),
    ({"step": -0.1}, "step: must be a finite number > 0 s, got -0.1"),
    ({"step": None}, "step: must be a finite number > 0 s, got None"),
    ({"order": 3}, "order: must be 2 or 4, got 3"),
    ({"order": [4]}, r"order: must be a whole number >= 1, got \[4\]"),
    ({"observe": ("enrgy",)}, "observe: 'enrgy' does not exist: choose 'energy', 'momentum', 'slider', 'joint', 'spring'"),
    ({"observe": "energy"}, r"observe: must be a sequence of kinds, as in \('energy',\), got 'energy'"),
    ({"points": {"tip": 3}}, r"point 'tip': must be a node of a beam, a body or a point of one, a mass, or \(beam, s\), got 3"),
    ({"points": {"tip": straight("other", (0, 0, 0), (1, 0, 0)).end}}, "point 'tip': beam 'other' is not in scene 'free beam'"),
    ({"points": ["tip"]}, "points: must map names to nodes"),
    ({"every": 0}, "every: must be a whole number >= 1, got 0"),
    ({"every": 2.5}, "every: must be a whole number >= 1, got 2.5"),
    ({"solver": "mumps"}, "backend 'mumps' does not exist: choose 'auto', 'pardiso' or 'superlu'"),
    ({"solver": 3}, "solver: must be a text, got 3; or an object of Solver"),
    ({"output": 3}, "output: must be the path of a file, a text or a pathlib.Path, got 3; or an object of Output"),
    ({"callback": 3}, r"callback: must be a function of \(t, state\), got 3"),
    ({"tolerance": 0.0}, "tolerance: must be a finite number > 0, got 0"),
    ({"tolerance": "fine"}, "tolerance: must be a finite number > 0, got 'fine'"),
    ({"tolerance": fb.StepControl(1e-3, min_step=0.2, max_step=0.1)}, "need 0 < min_step <= max_step, got 0.2 and 0.1 s"),
    ({"start": 3}, r"start: must be a State \(result.state, model.state\(\)\) or Checkpoint, got 3"),
    ({"start": STATE._replace(q=STATE.q[:24])}, r"start: q has shape \(24,\), scene 'free beam' needs \(84,\)"),
    ({"start": STATE._replace(s=np.zeros(1))}, r"start: s has shape \(1,\), scene 'free beam' needs \(0,\)"),
    ({"start": STATE._replace(v=STATE.v * np.nan)}, "start: v has values that are not finite")])
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        run(**arguments)


@pytest.mark.parametrize(("group", "arguments", "message"), [
    (fb.Start, {"time": np.nan}, "Start: time must be a finite number, got nan"),
    (fb.Start, {"velocities": "mine"}, "Start: velocities 'mine' does not exist: choose 'start' or 'scene'"),
    (fb.Output, {"snapshots": -1}, "Output: snapshots must be a whole number >= 0, got -1"),
    (fb.Output, {"snapshots": True}, "Output: snapshots must be a whole number >= 0, got True"),
    (fb.Solver, {"max_iterations": 0}, "Solver: max_iterations must be a whole number >= 1, got 0"),
    (fb.Solver, {"max_iterations": "many"}, "Solver: max_iterations must be a whole number >= 1, got 'many'"),
    (fb.StepControl, {"min_step": 1e-3}, "StepControl: tolerance missing; it takes tolerance, min_step, max_step"),
    (fb.StepControl, {"tolerance": 1e-3, "min_step": -1.0}, "StepControl: min_step must be a finite number > 0 s, got -1")])
def test_bad_arguments_of_groups_are_refused(group: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        group(**arguments)


@pytest.mark.parametrize(("old", "new", "says"), [
    ({"t_start": 0.2, "t_end": 0.3}, {"start": fb.Start(time=0.2), "t_end": 0.3},
     r"instead of t_start write start=Start\(time=...\)"),
    ({"start": STATE, "t_start": 0.05}, {"start": fb.Start(STATE, time=0.05)}, r"start=Start\(state=..., time=...\)"),
    ({"rho_inf": 0.5}, {"method": fb.Method(rho_inf=0.5)}, r"method=Method\(rho_inf=...\)"),
    ({"snapshots": 3, "max_iterations": 9}, {"output": fb.Output(snapshots=3), "solver": fb.Solver(max_iterations=9)},
     r"instead of snapshots, max_iterations write output=Output\(snapshots=...\), solver=Solver\(max_iterations=...\)"),
    ({"tolerance": 1e-6, "max_step": 0.02}, {"tolerance": fb.StepControl(1e-6, max_step=0.02)},
     r"tolerance=StepControl\(tolerance=..., max_step=...\)")])
def test_arguments_that_went_into_groups_work_for_two_versions(old: dict[str, Any], new: dict[str, Any], says: str) -> None:
    with pytest.warns(FutureWarning,
                      match=rf"simulate: arguments went into groups; .*{says}; the old name works until 0.4") as said:
        before = fb.simulate(MODEL, **{"t_end": 0.1, "step": 0.01, **old})
    assert said[0].filename == __file__
    after = run(**new)
    np.testing.assert_array_equal(before.state.q, after.state.q)
    assert before.info["method"] == after.info["method"] and len(before.t_snap) == len(after.t_snap)
    with pytest.raises(TypeError, match="snapshots is snapshots of Output now; give it there alone"):
        run(output=fb.Output(), snapshots=3)


@pytest.mark.parametrize(("what", "shown"), [(free_beam(), "<scene 'free beam': 1 beam"), (None, "None"), ("mine", "'mine'")])
def test_what_is_not_compiled_is_refused(what: Any, shown: str) -> None:
    message = rf"simulate: needs a model, got {shown}.*; compile it first: model = fb.compile_scene\(scene\)"
    with pytest.raises(fb.SceneError, match=message):
        run(what)


@pytest.mark.parametrize(("what", "message"), [
    (straight("beam", (0, 0, 0), (1, 0, 0)), "compile_scene: needs a Scene, got .*; put the parts into one: model = fb."),
    (None, "compile_scene: needs a Scene, got None"),
    (MODEL, "compile_scene: scene 'free beam' is compiled already; pass the model on to simulate or solve_static")])
def test_only_scenes_are_compiled(what: Any, message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.compile_scene(what)


@pytest.mark.parametrize("number", [np.float64(0.1), np.float32(0.125), np.array(0.1), 1])
def test_numbers_of_every_kind_are_taken(number: Any) -> None:
    assert run(t_end=number, step=float(number) / 4).t[-1] == float(number)


@pytest.mark.parametrize("s", [-0.1, 3.1, "end"])
def test_observed_point_must_lie_on_the_beam(s: Any) -> None:
    scene = free_beam()
    with pytest.raises(fb.SceneError, match=rf"point 'tip': s={s!r} lies outside beam 'beam' \(0 to 3 m\)"):
        run(fb.compile_scene(scene), points={"tip": (scene.beams[0], s)})


def test_file_that_exists_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_text("precious")
    with pytest.raises(fb.ResultFileError, match="run.h5': exists already; pass overwrite=True"):
        run(output=path)
    assert path.read_text() == "precious"
    run(output=fb.Output(file=path, overwrite=True))
    assert len(fb.load_result(path).t) == 11


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(fb.ResultFileError, match="folder '.*nowhere' does not exist"):
        run(output=tmp_path / "nowhere" / "run.h5")


def test_file_that_is_no_result_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_text("no result")
    with pytest.raises(fb.ResultFileError, match="run.h5': not an HDF5 file"):
        fb.load_result(path)


# ------------------------------------------------------------------------------------------------------------ scene input
def test_slider_outside_its_beam_is_refused() -> None:
    with pytest.raises(fb.SceneError, match=r"slider 'run': at=3.5 lies outside beam 'rail' \(0 to 3 m\)"):
        fb.compile_scene(bead(at=3.5))


def test_names_used_twice_are_refused() -> None:
    a, b = straight("arm", (0, 0, 0), (1, 0, 0)), fb.PointMass("arm", mass=1.0, position=(1, 1, 1))
    with pytest.raises(fb.SceneError, match="the name 'arm' is used twice, by a beam and a point mass"):
        fb.compile_scene(fb.Scene(a, b))


def test_load_on_a_node_that_does_not_exist_is_refused() -> None:
    beam = straight("beam", (0, 0, 0), (1, 0, 0))
    with pytest.raises(fb.SceneError, match="beam 'beam': node 7 does not exist, nodes run from 0 to 6"):
        fb.Load("pull", beam.node(7), force=(1, 0, 0))
    with pytest.raises(fb.SceneError, match="load 'pull': beam 'beam' is not in scene 'scene'; add it to the scene"):
        fb.compile_scene(fb.Scene(straight("other", (0, 0, 0), (1, 0, 0)), fb.Load("pull", beam.end, force=(1, 0, 0))))


@pytest.mark.parametrize(("changes", "message"), [
    ({"degree": 9}, "degree=9 lies outside 1 to 8 of interpolation 'lagrange'"),
    ({"degree": 0}, "degree=0 lies outside 1 to 8 of interpolation 'lagrange'"),
    ({"degree": 1, "interpolation": "bspline"}, "degree=1 lies outside 2 to 5 of interpolation 'bspline'"),
    ({"degree": 2.5}, "degree=2.5 lies outside 1 to 8"),
    ({"interpolation": "hermite"}, "interpolation 'hermite' does not exist: choose 'lagrange'"),
    ({"elements": 0}, "beam 'beam': elements")])
def test_interpolation_that_does_not_exist_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        straight("beam", (0, 0, 0), (1, 0, 0), **changes)


# ---------------------------------------------------------------------------------------------------------------- events
@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize(("at", "rate", "end"), [(2.0, 1.5, "end"), (1.0, -1.5, "start")])
def test_slider_at_the_end_of_its_beam_ends_the_run(order: int, at: float, rate: float, end: str) -> None:
    result = run(fb.compile_scene(bead(at, rate)), t_end=5.0, step=0.03, order=order, every=1)
    (event,) = result.events
    assert (event["kind"], event["slider"], event["end"]) == ("slider_end", "run", end)
    assert event["time"] == result.t[-1] < 1.5
    assert 0.0 < result.series["step_size"][-1] < 0.03
    goal = 3.0 if end == "end" else 0.0
    assert result.state.s[0] == result.series["s_slide"][-1, 0]
    assert abs(result.state.s[0] - goal) <= 1e-9 * 3.0
    assert 0.0 <= result.state.s[0] <= 3.0
    assert max(drifts(result).values()) <= ROUND_OFF


@pytest.mark.parametrize("every", [1, 7])
def test_end_of_the_beam_does_not_depend_on_the_rows(every: int) -> None:
    model = fb.compile_scene(bead(2.0, 1.5))
    result, other = run(model, t_end=5.0, step=0.03, every=every), run(model, t_end=5.0, step=0.03, observe=())
    np.testing.assert_array_equal(result.state.q, other.state.q)
    assert result.t[-1] == other.t[-1]


@pytest.mark.parametrize(("at", "rate"), [(3.0, 1.0), (0.0, -1.0)])
def test_slider_that_starts_outwards_at_the_end_goes_nowhere(at: float, rate: float) -> None:
    result = run(fb.compile_scene(bead(at, rate)))
    assert [event["kind"] for event in result.events] == ["slider_end"]
    assert result.t.tolist() == [0.0]


@pytest.mark.parametrize(("at", "rate"), [(0.0, 1.0), (3.0, -1.0)])
def test_slider_that_starts_inwards_at_the_end_runs(at: float, rate: float) -> None:
    result = run(fb.compile_scene(bead(at, rate)))
    assert result.events == []
    assert abs(result.state.s[0] - at) > 0.05
    assert max(drifts(result).values()) <= ROUND_OFF


def test_end_of_the_beam_under_step_control() -> None:
    result = run(fb.compile_scene(bead(2.0, 1.5)), t_end=5.0, step=0.03, tolerance=1e-4)
    assert [event["kind"] for event in result.events] == ["slider_end"]
    assert abs(result.state.s[0] - 3.0) <= 1e-9 * 3.0
    assert max(drifts(result).values()) <= ROUND_OFF


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize(("s_a", "s_b", "first"), [(2.6, 2.7, "B"), (2.7, 2.6, "A"), (0.0, 2.7, "B")])
def test_first_of_several_sliders_ends_the_run(s_a: float, s_b: float, first: str, order: int) -> None:
    # one step would carry both beyond the end; a slider that leaves its start inwards is in nobody's way
    rail, a, b = straight("rail", (0, 0, 0), (3, 0, 0)), fb.PointMass("a", mass=0.5), fb.PointMass("b", mass=0.5)
    scene = fb.Scene(rail, a, b, fb.Slider("A", a, rail, at=s_a, rate=2.0), fb.Slider("B", b, rail, at=s_b, rate=2.0))
    result = run(fb.compile_scene(scene), t_end=2.0, step=0.25, order=order)
    (event,) = result.events
    assert (event["slider"], event["end"]) == (first, "end")
    # the rail is straight and at rest: s = s0 + 2 t
    assert event["time"] == pytest.approx(0.15, abs=1e-9)
    np.testing.assert_allclose(result.state.s, [s_a + 0.3, s_b + 0.3], rtol=0.0, atol=1e-8)
    assert abs(event["s"] - 3.0) <= 1e-9 * 3.0


def test_callback_sees_every_row_and_ends_the_run() -> None:
    seen: list[float] = []

    def stop(t: float, state: Any) -> bool:
        seen.append(t)
        assert state.q.shape == MODEL.q0.shape
        return t > 0.055

    result = run(callback=stop, every=2)
    np.testing.assert_allclose(seen, [0.02, 0.04, 0.06], rtol=1e-14)
    assert result.t.tolist() == [0.0, *seen]
    assert [event["kind"] for event in result.events] == ["stopped"]
    assert result.info["steps"] == 6


@pytest.mark.parametrize("planar", ["auto", False])
def test_callbacks_see_a_copy_that_cannot_be_written_to(planar: bool | str) -> None:
    scene = fb.Scene(straight("rod", (0, 0, 0), (2, 0, 0)), fb.RigidMotion(spin=(0, 0, 2)))
    model = fb.compile_scene(scene, planar=planar)
    kept: list[Any] = []
    result = fb.simulate(model, t_end=0.05, step=0.01, every=1, callback=lambda t, state: kept.append(state))
    # what is kept stays as it was, in a plane and in space
    assert len({state.q.tobytes() for state in kept}) == 5
    np.testing.assert_array_equal(kept[-1].q, result.state.q)
    for name in ("q", "v", "s", "force"):
        def write(t: float, state: Any, name: str = name) -> None:
            getattr(state, name)[...] = 0.0

        with pytest.raises(ValueError, match="read-only"):
            fb.simulate(model, t_end=0.05, step=0.01, every=1, callback=write)
    # and is a start like any other
    again = fb.simulate(model, start=fb.Start(kept[2], time=0.03), t_end=0.05, step=0.01)
    np.testing.assert_allclose(again.state.q, result.state.q, atol=1e-13)


def lagging(**options: Any) -> fb.Result:
    """A spring of the user's own: a load whose size a callback sets."""
    force = [0.0]
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("spring", beam.end, force=(0, 0, 1), time=lambda t: force[0]),
                     fb.Load("pull", beam.end, force=(0, 1, 0), time=np.cos), gravity=(0, 0, -1))

    def pull(t: float, state: Any) -> None:
        force[0] = -50.0 * state.q.reshape(-1, 12)[-1, 2]

    return fb.simulate(fb.compile_scene(scene), t_end=0.1, step=0.01, every=1, callback=pull, **options)


def test_a_load_that_a_callback_sets_is_told_and_refused_by_step_control() -> None:
    says = (r"the callback at t = 0\.\d+ s changed load 'spring': its time function returned .* at t = .* s before the call, and "
            r".* aft")
    (event,) = lagging().events
    assert event["kind"] == "lagging load" and re.match(says, event["text"]) and "halve the step" in event["text"]
    with pytest.raises(fb.ConvergenceError, match=says + ".*step control cannot see; use a fixed step") as caught:
        lagging(tolerance=1e-6)
    assert caught.value.result.state is not None and len(caught.value.result.t) >= 2


def driven_by_a_callback(**options: Any) -> tuple[fb.Result, str]:
    """A body on a hinge, a bead with a drive, a drag and a support, one of which a callback sets."""
    name, = options.pop("of")
    value = [0.0]

    def at(t: float, which: str) -> float:
        return value[0] if which == name else 0.0

    rod = straight("rod", (0, 0, 0), (2, 0, 0))
    arm = fb.RigidBody("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 3, 0))
    bead = fb.PointMass("bead", mass=0.2)
    scene = fb.Scene(rod, arm, bead, fb.Clamp(rod.start), fb.Slider("run", bead, rod, at=1.0,
                                                                   drive=fb.Drive(force=lambda t: at(t, "drive"))),
                     fb.PrescribedMotion("lift", rod.end, displacement=lambda t: (0, 0, at(t, "lift"))),
                     fb.RevoluteJoint(fb.GROUND.point((0, 3, 0)), arm, "hinge", axis=(0, 0, 1), torque=lambda t: at(t, "torque")),
                     fb.Drag("air", rod, normal=0.1, air=(1.0, 0, 0), time=lambda t: 1.0 + at(t, "air")))

    def change(t: float, state: Any) -> None:
        value[0] = 1e-3 * t

    return fb.simulate(fb.compile_scene(scene, planar=False), t_end=0.02, step=2e-3, every=1, progress=False, callback=change,
                       **options), name


@pytest.mark.parametrize(("of", "says"), [
    ("torque", "the prescribed value of revolute joint 'hinge'"), ("drive", r"the drive of slider 'run' \(force\)"),
    ("lift", r"prescribed motion 'lift' \(displacement\)"), ("air", "the air of drag 'air' on beam 'rod'")])
def test_whatever_a_callback_sets_is_told_and_refused_by_step_control(of: str, says: str) -> None:
    result, _ = driven_by_a_callback(of=[of])
    event, = (x for x in result.events if x["kind"] == "lagging load")
    assert re.search(f"changed {says}: its time function returned", event["text"]), event["text"]
    with pytest.raises(fb.ConvergenceError, match=f"changed {says}.*step control cannot see"):
        driven_by_a_callback(of=[of], tolerance=1e-4)


def test_step_control_sees_what_only_turns() -> None:
    """A tumbling body, whose centre rests: local errors at the radius of gyration."""
    top = fb.RigidBody("top", mass=1.0, inertia=(1, 2, 3), position=(0, 0, 0), spin=(0.2, 5.0, 0.2))
    model = fb.compile_scene(fb.Scene(top))

    def end(**options: Any) -> tuple[Any, int]:
        result = fb.simulate(model, t_end=2.0, step=1e-3, output=fb.Output(snapshots=0), progress=False, every=10**6, **options)
        return result.state.q.reshape(4, 3)[1:], result.info["steps"]

    exact = end(order=4)[0]
    off, steps = zip(*((np.linalg.norm(d - exact), n) for d, n in (end(tolerance=x) for x in (1e-4, 1e-6))))
    print(f"turned wrong by {off[0]:.1e} and {off[1]:.1e} in {steps[0]} and {steps[1]} steps")
    # local errors are of third order: for a hundredth of the tolerance 4.6 times as many steps, and an error 21 times smaller
    assert off[0] < 2e-2 and off[1] < 1e-3 and 15.0 < off[0] / off[1] < 30.0
    assert 4.0 < steps[1] / steps[0] < 5.0


def test_callbacks_that_leave_loads_alone_are_left_alone() -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    times: list[float] = []
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("pull", beam.end, force=(0, 1, 0), time=np.cos), gravity=(0, 0, -1),
                     gravity_time=lambda t: float("nan") if t > 9.0 else 1.0)
    result = fb.simulate(fb.compile_scene(scene), t_end=0.1, step=0.01, callback=lambda t, state: times.append(t), tolerance=1e-4)
    assert times and not result.events


def test_a_load_that_is_no_function_of_time_is_told() -> None:
    beam, rng = straight("beam", (0, 0, 0), (3, 0, 0)), np.random.default_rng(1)
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("wind", beam.end, force=(0, 0, 1), time=lambda t: rng.random()))
    result = fb.simulate(fb.compile_scene(scene), t_end=0.02, step=0.01, callback=lambda t, state: None)
    assert "load 'wind': its time function returns different values at the same time" in result.events[0]["text"]


def test_error_in_a_callback_reaches_the_caller_and_closes_the_file(tmp_path: Path) -> None:
    def fail(t: float, state: Any) -> None:
        if t > 0.035:
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        run(callback=fail, output=tmp_path / "run.h5", every=1)
    np.testing.assert_allclose(fb.load_result(tmp_path / "run.h5").t, [0.0, 0.01, 0.02, 0.03, 0.04])


# ------------------------------------------------------------------------------------------------------------ time, steps
@pytest.mark.parametrize("every", [1, 2, 100])
@pytest.mark.parametrize(("t_start", "t_end"), [(0.0, 0.1), (-1.0, -0.9), (1e3, 1e3 + 0.1)])
def test_last_step_is_shortened_to_meet_the_end(every: int, t_start: float, t_end: float) -> None:
    result = run(start=fb.Start(time=t_start), t_end=t_end, step=0.03, every=every)
    assert result.t[0] == t_start and result.t[-1] == t_end
    assert result.info["steps"] == 4
    assert result.series["step_size"][-1] == pytest.approx(0.01, rel=1e-9)
    assert max(drifts(result).values()) <= ROUND_OFF


@pytest.mark.parametrize("n", [3, 7, 49, 1000])
def test_whole_numbers_of_steps_leave_no_splinter(n: int) -> None:
    result = run(t_end=n * 0.001, step=0.001, every=10, observe=())
    assert result.info["steps"] == n
    assert set(result.series["step_size"].tolist()) == {0.0, 0.001}


def test_step_larger_than_the_run_is_one_short_step() -> None:
    result = run(step=1.0)
    assert result.info["steps"] == 1 and result.series["step_size"].tolist() == [0.0, 0.1]


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("short", [1e-3, 1e-6, -1e-6, 1e-8])
def test_step_that_almost_divides_the_run_leaves_no_sliver(short: float, order: int) -> None:
    # a step of 1e-8 of the others would record round-off of the coordinates times mass over its square as a contact force
    model = fb.compile_scene(bead(rate=0.2))
    step = 0.01 * (1.0 - 0.1 * short)
    result = run(model, step=step, every=1, order=order)
    assert result.info["steps"] == 10 and result.t[-1] == 0.1
    assert result.series["step_size"][1:-1].tolist() == [step] * 9
    assert result.series["step_size"][-1] == pytest.approx(0.1 - 9 * step, rel=1e-9)
    np.testing.assert_array_equal(result.t[:-1], step * np.arange(10))
    even = run(model, every=1, order=order).slider("run")["force"]
    assert np.max(np.abs(result.slider("run")["force"] - even)) <= 30 * abs(short) * np.max(np.abs(even)) + 1e-9
    rest = run(model, start=fb.simulate(model, t_end=0.05, step=step, every=1, order=order, callback=lambda t, s: t > 0.035)
               .checkpoint, step=step, every=1, order=order)
    np.testing.assert_array_equal(rest.state.q, result.state.q)


def test_last_step_of_a_hundredth_stays_and_a_run_may_go_on_for_less() -> None:
    assert run(t_end=0.1011, every=1).series["step_size"][-1] == pytest.approx(1.1e-3)
    first = run()
    rest = run(start=first.checkpoint, t_end=0.1 + 1e-5, every=1)
    assert rest.info["steps"] == 1 and rest.t.tolist() == [0.1, 0.1 + 1e-5]


@pytest.mark.parametrize("largest", [0.03, 1.0])
def test_step_control_leaves_no_sliver(largest: float) -> None:
    result = run(t_end=0.09 * (1.0 + 1e-7), step=0.03, tolerance=fb.StepControl(1.0, min_step=0.03, max_step=largest))
    sizes = result.series["step_size"][1:]
    assert result.t[-1] == 0.09 * (1.0 + 1e-7) and sizes.max() <= largest
    assert sizes.min() >= 0.4 * sizes.max()


@pytest.mark.parametrize(("t_start", "step", "n"), [(1.7e9, 1e-6, 1000), (1e8, 1e-7, 100), (-1.7e9, 1e-6, 999), (1e15, 0.5, 7)])
def test_run_far_from_zero_takes_all_its_steps(t_start: float, step: float, n: int) -> None:
    result = run(start=fb.Start(time=t_start), t_end=t_start + n * step, step=step, every=n // 3, output=fb.Output(snapshots=0))
    assert result.info["steps"] == n and result.t[-1] == t_start + n * step


@pytest.mark.parametrize(("arguments", "message"), [
    ({"start": fb.Start(time=1e16), "t_end": 1e16 + 100},
     r"step: must be at least 8 s, got 0.01, because floating-point times near 1e\+16 s are 2 s apart"),
    ({"t_end": 1e18}, "step: must be at least 512 s, got 0.01"),
    ({"t_end": 5e-324}, "t_end: lies 4.94e-324 s after the start at 0 s, which is negligible against a step of 0.01 s"),
    ({"start": fb.Start(time=1.7e9), "t_end": 1.7e9 + 1, "tolerance": fb.StepControl(1e-3, min_step=1e-9)},
     "min_step: must be at least 9.54e-07 s, got 1e-09"),
    ({"start": fb.Start(time=1e17), "t_end": 1e17 + 64, "step": 1.0}, "step: must be at least 64 s, got 1")])
def test_times_that_doubles_cannot_tell_apart_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        run(**arguments)


def test_step_control_far_from_zero_stays_above_the_resolution_of_time() -> None:
    result = run(start=fb.Start(time=1.7e9), t_end=1.7e9 + 0.1, step=1e-4, tolerance=1e-7)
    assert result.t[-1] == 1.7e9 + 0.1 and np.all(np.diff(result.t) > 0.0)


def test_more_shapes_than_rows_are_one_a_row() -> None:
    assert len(run(output=fb.Output(snapshots=10**6)).t_snap) == 11
    few, many = (peak_bytes(lambda n=n: run(output=fb.Output(snapshots=n))) for n in (11, 10**6))  # type: ignore[misc]
    assert many < 2 * few + 10**6
    for snapshots in (10**12, 10**400):
        with pytest.raises(fb.SceneError, match="Output: snapshots must be a whole number from 0 to 1e\\+06"):
            run(output=fb.Output(snapshots=snapshots))


def test_shapes_are_spread_over_the_run() -> None:
    np.testing.assert_allclose(run(output=fb.Output(snapshots=6), step=1e-3, every=1).t_snap, [0.0, 0.02, 0.04, 0.06, 0.08, 0.1])


def test_what_to_record_may_come_from_an_iterator() -> None:
    assert "total" in run(observe=(kind for kind in ("energy", "momentum"))).series
    for wrong in (None, 5):
        with pytest.raises(fb.SceneError, match="observe: must be a sequence of kinds, .* got"):
            run(observe=wrong)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("kind", ["free", "clamped", "loaded"])
@pytest.mark.parametrize("end", [(2, 0.3, 0.1), (2, 0, 0)])
def test_scene_at_rest_raises_no_alarm(kind: str, end: tuple[float, float, float], scale: float) -> None:
    section = fb.Section.circle(radius=0.02 * scale, E=1e6, rho=1000.0)
    rod = fb.Beam.straight("rod", (0, 0, 0), tuple(scale * x for x in end), section=section, elements=3)
    scene = fb.Scene(rod, *([] if kind == "free" else [fb.Clamp(rod.start)]))
    start = None
    if kind == "loaded":
        scene.add(fb.Load("pull", rod.end, force=(1e-2 * scale**2, 0, 0)))
        start = fb.solve_static(fb.compile_scene(scene)).state
    result = fb.simulate(fb.compile_scene(scene), t_end=0.2, step=1e-3, start=start)
    assert result.events == []
    assert max(result.drift(name) for name in result.info["conserved"] if name in result.series) < 1e-7


def test_scene_at_rest_that_is_given_energy_raises_the_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    # a velocity of 1e-4 m/s is no round-off
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section.circle(radius=0.02, E=1e6, rho=1000.0), elements=3)
    model = fb.compile_scene(fb.Scene(rod), planar=False)
    original = newton.Stepper.advance

    def kicked(self: Any, t: float, *arguments: Any) -> Any:
        self.core_state.v.reshape(-1, 12)[:, 1] = 1e-4
        return original(self, t, *arguments)

    monkeypatch.setattr(newton.Stepper, "advance", kicked)
    kinds = [event["text"].split()[0] for event in fb.simulate(model, t_end=0.02, step=1e-3, every=1).events]
    assert kinds == ["total", "lin_mom", "ang_mom"]


def test_result_says_how_it_was_made() -> None:
    info = run().info
    assert (info["order"], info["step"], info["t_end"], info["scene"], info["steps"]) == (2, 0.01, 0.1, "free beam", 10)
    assert info["iterations"] >= 20 and info["fallbacks"] == 0
    assert info["conserved"] == ["gap", "total", "lin_mom", "ang_mom"]


# ----------------------------------------------------------------------------------------------------------- step control
def test_smaller_tolerance_gives_smaller_error_and_keeps_the_invariants() -> None:
    model = fb.compile_scene(bead())
    exact = run(model, t_end=0.5, step=0.5 / 800, order=4, observe=())
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        result = run(model, t_end=0.5, step=0.02, tolerance=tolerance)
        info = result.info
        assert info["tolerance"] == tolerance
        assert info["accepted"] == len(result.t) - 1
        assert max(drifts(result).values()) <= ROUND_OFF
        errors.append(float(np.max(np.abs(result.state.q - exact.state.q).reshape(-1, 12)[:, :3])))
    # local errors of order 3: a hundredth of the tolerance is 100^(-2/3) = 1/21 of the global error
    assert errors[1] < errors[0] / 8.0 and errors[2] < errors[1] / 8.0


def test_steps_that_are_too_large_are_rejected_and_counted() -> None:
    result = run(t_end=0.5, step=0.25, tolerance=fb.StepControl(1e-6, max_step=0.5))
    assert result.info["rejected"] >= 1
    assert result.series["step_size"][1] < 0.25
    assert result.t[-1] == 0.5


def test_bounds_of_the_step_hold_from_the_first_step_on() -> None:
    result = run(t_end=0.5, step=0.1, tolerance=fb.StepControl(1.0, max_step=0.02))
    assert result.series["step_size"].max() <= 0.02 * (1.0 + 1e-12)


def test_smallest_step_that_misses_the_tolerance_is_reported() -> None:
    message = "the local error .* exceeds the tolerance 1e-12 at the smallest step 0.01 s"
    with pytest.raises(fb.ConvergenceError, match=message) as caught:
        run(step=0.01, tolerance=fb.StepControl(1e-12, min_step=0.01, max_step=0.01))
    assert caught.value.time == 0.0
    np.testing.assert_array_equal(caught.value.state.q, MODEL.q0)
    assert len(caught.value.result.t) == 1


# ---------------------------------------------------------------------------------------------------------------- failures
def test_failed_step_carries_the_last_state_the_result_and_the_place(tmp_path: Path) -> None:
    # quiet until the load strikes at t = 0.05: two iterations do not reach round-off then
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    blow = fb.Load("blow", beam.end, force=(0, 0, 300.0), time=lambda t: float(t > 0.05))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), blow))
    message = "step 5 at t = 0.05 s: the Newton iteration did not converge; increments"
    with pytest.raises(fb.ConvergenceError, match=message) as caught:
        run(model, solver=fb.Solver(max_iterations=2), every=1, output=tmp_path / "run.h5")
    error = caught.value
    assert error.step == 5 and error.time == pytest.approx(0.05)
    assert len(error.residuals) == 2 and all(x > 0.0 for x in error.residuals)
    assert error.worst.startswith("beam 'beam' node ") and "(residual " in error.worst
    np.testing.assert_array_equal(error.state.q, model.q0)
    np.testing.assert_allclose(error.result.t, [0.0, 0.01, 0.02, 0.03, 0.04, 0.05])
    assert [event["kind"] for event in error.result.events] == ["failed"]
    stored = fb.load_result(tmp_path / "run.h5")
    np.testing.assert_array_equal(stored.t, error.result.t)
    assert stored.events == error.result.events
    # the state it carries is good to go on from
    again = run(model, start=fb.Start(error.state, time=error.time), t_end=0.1)
    assert again.t[-1] == 0.1 and again.state.q[-10] > 0.0


def test_step_far_too_large_fails_and_step_control_saves_it() -> None:
    model = fb.compile_scene(bead(1.5, 0.1))
    with pytest.raises(fb.ConvergenceError, match="Try a smaller step, or step control with tolerance") as caught:
        run(model, t_end=400.0, step=200.0)
    assert caught.value.step == 0 and "slider 'run' (gap " in caught.value.worst
    result = run(model, t_end=0.2, step=200.0, tolerance=fb.StepControl(1e-3, max_step=200.0))
    assert result.t[-1] == 0.2


# ------------------------------------------------------------------------------------------------------------------ output
def test_nothing_is_recorded_that_was_not_asked_for() -> None:
    assert set(run(observe=(), output=fb.Output(snapshots=0)).series) == {"iterations", "step_size"}
    assert len(run(observe=(), output=fb.Output(snapshots=0)).t_snap) == 0
    assert set(run(observe=("momentum",)).series) == {"iterations", "step_size", "lin_mom", "ang_mom"}


def test_observers_do_not_disturb_the_run() -> None:
    model = fb.compile_scene(bead())
    bare, full = run(model, observe=(), output=fb.Output(snapshots=0)), run(model, every=1, output=fb.Output(snapshots=5))
    for a, b in zip(bare.state, full.state):
        np.testing.assert_array_equal(a, b)


def test_points_follow_nodes_and_places_between_them() -> None:
    scene = free_beam()
    beam = scene.beams[0]
    result = run(fb.compile_scene(scene), points={"end": beam.end, "same": (beam, 3.0), "between": (beam, 0.7)})
    np.testing.assert_array_equal(result.point("end")[-1], result.state.q[-12:-9])
    np.testing.assert_allclose(result.point("same"), result.point("end"), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(result.point("between")[0], [0.7, 0, 0], atol=1e-14)


def test_file_holds_what_memory_holds(tmp_path: Path) -> None:
    result = run(fb.compile_scene(bead(2.5, 1.5)), t_end=1.0, every=1, output=tmp_path / "run.h5")
    stored = fb.load_result(tmp_path / "run.h5")
    assert stored.events == result.events and stored.events[0]["kind"] == "slider_end"
    assert stored.series.keys() == result.series.keys()
    for name, x in [*result.series.items(), ("t", result.t)]:
        np.testing.assert_array_equal(stored.series[name] if name != "t" else stored.t, x)
    np.testing.assert_array_equal(stored.phi, result.phi)
    np.testing.assert_array_equal(stored.directors, result.directors)
    assert stored.info == result.info and stored.model_text == result.model_text


def test_energy_balance_of_a_constant_load() -> None:
    result = run(fb.compile_scene(cantilever()), t_end=0.5, every=1)
    # the load has a potential: the total stays, momenta do not and are not expected to
    assert result.info["conserved"] == ["gap", "total"]
    assert np.ptp(result.series["total"]) <= 1e-12 * np.max(result.series["kinetic"])
    assert np.max(result.series["kinetic"]) > 1.0


# -------------------------------------------------------------------------------------------------------------- fallbacks
@pytest.mark.parametrize("order", [2, 4])
def test_steps_that_the_elimination_cannot_take_are_taken_by_superlu(order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    model = fb.compile_scene(bead())
    expected = run(model, order=order, every=4)
    real = newton.kernels.run

    def fails_at_every_third(*arguments: Any) -> None:
        names = real.py_func.__code__.co_varnames
        at = names.index("n_steps")
        if arguments[at] == 1:
            arguments[names.index("counts_out")][0] = newton.SINGULAR
            return
        real(*arguments[:at], min(arguments[at], 2), *arguments[at + 1:])
        if arguments[names.index("counts_out")][1] < arguments[at]:
            arguments[names.index("counts_out")][0] = newton.SINGULAR

    monkeypatch.setattr(newton.kernels, "run", fails_at_every_third)
    result = run(model, order=order, every=4)
    # rows every 4 steps: the third and, alone again, the fourth of each four, not of the last two; other first guesses fail too
    assert result.info["fallbacks"] == 4 and result.info["steps"] == expected.info["steps"] == 10
    np.testing.assert_array_equal(result.t, expected.t)
    np.testing.assert_allclose(result.state.q, expected.state.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(result.series["contact_force"], expected.series["contact_force"], rtol=0.0, atol=1e-8)


def test_run_in_which_every_step_falls_back_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def always_singular(*arguments: Any) -> None:
        counts = arguments[-3]
        counts[:] = newton.SINGULAR, 0, 0, -1, 0

    monkeypatch.setattr(newton.kernels, "run", always_singular)
    result = run(t_end=1.2, step=1e-3, every=1200, observe=("energy",))
    assert result.info["fallbacks"] == result.info["steps"] == 1200
    assert result.drift("total") <= ROUND_OFF


@pytest.mark.parametrize(("value", "shown"), [(np.nan, "nan"), (np.inf, "inf"), ("3", "'3'"), (1j, "1j"), (None, "None")])
@pytest.mark.parametrize("what", ["load", "gravity"])
def test_time_function_that_stops_giving_numbers_is_named(what: str, value: Any, shown: str) -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))

    def factor(t: float) -> Any:
        return 1.0 if t < 0.005 else value

    load = [fb.Load("pull", beam.end, force=(0, 0, 1), time=factor)] if what == "load" else []
    gravity = {"gravity": (0, 0, -1), "gravity_time": factor} if what == "gravity" else {}
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), *load, **gravity))
    with pytest.raises(fb.SceneError, match=f"must return a finite number, got {shown} at t = 0.005"):
        fb.simulate(model, t_end=0.01, step=1e-3, progress=False)
    with pytest.raises(fb.SceneError, match=f"must return a finite number, got {shown} at t = 1 s"):
        fb.solve_static(model, at_time=1.0)


def test_time_function_that_fails_on_the_way_is_told_with_the_time() -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    load = fb.Load("pull", beam.end, force=(0, 0, 1), time=lambda t: 1.0 if t < 0.005 else 1 / 0)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), load))
    with pytest.raises(fb.SceneError, match="must not fail, but raises ZeroDivisionError at t = 0.005"):
        fb.simulate(model, t_end=0.01, step=1e-3, progress=False)


@pytest.mark.parametrize("answer", [np.True_, True])
def test_callback_ends_the_run_with_a_true_answer_only(answer: Any) -> None:
    assert run(callback=lambda t, state: answer, every=1).events[-1]["kind"] == "stopped"
    assert run(callback=lambda t, state: None).t[-1] == 0.1
    with pytest.raises(fb.SceneError, match=r"callback: must return True to end the run, else .*, got \(1, 2\)"):
        run(callback=lambda t, state: np.array([1, 2]))


def test_observed_kinds_may_come_from_a_generator() -> None:
    assert "total" in run(observe=(kind for kind in ("energy",))).series
