"""Functions of the user's own that give no number on the way: the message names whose they are, and when."""
from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.stepping.stepper import Stepper

SECTION = fb.Section.circle(radius=0.02, E=1e9, rho=1000.0)
H = 1e-3


def rod() -> fb.Beam:
    return fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SECTION, elements=2)


def root_of_time(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = math.sqrt(0.0035 - t) if t < 0.0035 else math.nan


def root_of_place(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = -50.0 * np.sqrt(1e-4 + x[2])


def along(t, length, rate, p):  # type: ignore[no-untyped-def]
    return np.sqrt(0.0035 - t)


def between(t, x, rotation, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[0] = np.log(0.0035 - t)


def fine(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = 1.0


def failing(*parts: Any, **options: Any) -> str:
    beam = rod()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), *(part(beam) for part in parts), gravity=(0, 0, -9.81)),
                             planar=False)
    with pytest.raises((fb.ConvergenceError, fb.SceneError)) as caught:
        fb.simulate(model, t_end=0.1, step=H, progress=False, **options)
    return str(caught.value)


@pytest.mark.parametrize(("make", "says"), [
    (lambda b: fb.UserForce("gust", b.end, root_of_time), r"user force 'gust': its law returns \(0, 0, nan, 0, 0, 0\), which is "
                                                          r"not a "
                                                          r"finite force, at t = 0.0035 s, beam 'rod' node 6"),
    (lambda b: fb.UserForce("gust", b, root_of_time), r"user force 'gust': its law returns \(0, 0, nan"),
    (lambda b: fb.UserForce("soil", b.end, root_of_place), r"user force 'soil': its law returns \(0, 0, nan"),
    (lambda b: fb.LineForce(b.end, fb.GROUND.point((2, 0, 5)), "rope", law=along), "line force 'rope': its law returns"),
    (lambda b: fb.ForceElement(b.end, fb.GROUND.point((2, 0, 5)), "pad", law=between), "force element 'pad': its law returns"),
], ids=["node", "beam", "place", "line", "element"])
def test_a_law_that_becomes_no_number_is_named(make: Any, says: str) -> None:
    import re
    # beside one that does nothing wrong
    assert re.search(says, found := failing(lambda b: fb.UserForce("wind", b.end, fine), make)), found
    assert "compressed to zero length" not in found and "It must return finite numbers there" in found


def test_which_load_a_time_function_belongs_to_is_said() -> None:
    def broken(t: float) -> float:
        return 1.0 if t < 0.003 else math.nan

    says = failing(lambda b: fb.Load("steady", b.end, force=(0, 0, 1), time=lambda t: 1.0 + t),
                   lambda b: fb.Load("push", b.end, force=(0, 0, 1), time=broken))
    assert "time function of load 'push': must return a finite number, got nan at t = 0.00" in says
    says = failing(lambda b: fb.DistributedLoad("snow", b, force=(0, 0, 1), time=broken))
    assert "time function of distributed load 'snow': must" in says
    # one function of two loads
    says = failing(*(lambda b, name=name: fb.Load(name, b.end, force=(0, 0, 1), time=broken) for name in ("one", "two")))
    assert "time function of load 'one', load 'two': must" in says
    beam = rod()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81), gravity_time=broken))
    with pytest.raises(fb.SceneError, match="time function of gravity: must return a finite number, got nan"):
        fb.simulate(model, t_end=0.01, step=H, progress=False)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("push", beam.end, force=(0, 0, 1), time=broken)))
    with pytest.raises(fb.SceneError, match="time function of load 'push': must return a finite number, got nan at t = 1 s"):
        fb.solve_static(model, at_time=1.0)


def test_functions_of_time_are_asked_at_three_points_of_a_step() -> None:
    asked: list[float] = []

    def shared(t: float) -> float:
        asked.append(t)
        return 1.0 + t

    beam = rod()
    loads = [fb.Load(name, beam.end, force=(0, 0, 1), time=shared) for name in ("one", "two")]
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), *loads,
                                      fb.Load("three", beam.end, force=(0, 0, 1), time=lambda t: 2)))
    asked.clear()
    fb.simulate(model, t_end=4 * H, step=H, progress=False)
    points = 0.5 + 0.5 * np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
    np.testing.assert_allclose(asked, (H * (np.arange(4)[:, None] + points)).reshape(-1), rtol=1e-12)


def jumps(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = -1e9 if v[2] > 0.0 else 1e9


def breeze(t, x, p, velocity):  # type: ignore[no-untyped-def]
    velocity[0] = 1.0


def snaps(t, length, rate, p):  # type: ignore[no-untyped-def]
    return 1e9 if length > 5.0 else -1e9


def test_a_law_that_jumps_is_named_where_the_residual_is_largest() -> None:
    """Not where it does not act."""
    says = failing(lambda b: fb.UserForce("wind", b.end, fine), lambda b: fb.UserForce("kick", b.end, jumps))
    assert "node 6, where the laws of user force 'wind' and user force 'kick' act (residual" in says
    says = failing(lambda b: fb.UserForce("wind", b.start, fine),
                   lambda b: fb.LineForce(b.end, fb.GROUND.point((2, 0, 5)), "rope", law=snaps))
    assert "node 6, where the law of line force 'rope' acts (residual" in says


@pytest.mark.parametrize("planar", [True, False])
def test_whose_laws_act_on_a_node(planar: bool) -> None:
    """On one that is welded to a body they enter the equations of the body. Loads that follow are no laws."""
    beam = rod()
    body = fb.RigidBody("head", mass=1.0, inertia=(1, 1, 1), position=(2, 0, 0))
    pad = fb.Drag("pad", body, linear=1.0, wind=breeze) if not planar else fb.Drag("pad", body, linear=1.0)
    kick = fb.LineForce(beam.end, fb.GROUND.point((2, 0, 5)), "rope", law=snaps)
    push = fb.Load("push", beam.end, force=(0, 0, 1), follower=True)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), body, fb.RigidConnection(beam.end, body), kick, pad, push),
                             planar=planar)
    stepper = Stepper(model, np.ones(1))
    acts = "the law of line force 'rope' acts" if planar else "the laws of drag 'pad' and line force 'rope' act"
    head = int(model.numbers.number(body.center))
    assert stepper.label_of(head) == f"body 'head', where {acts}"
    assert stepper.label_of(1) == "beam 'rod' node 1"


def test_a_collapse_is_still_one() -> None:
    beam = rod()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.UserForce("wind", beam.end, fine),
                                      fb.Load("push", beam.end, force=(0, 0, 1e9))), planar=False)
    with pytest.raises(fb.ConvergenceError) as caught:
        fb.simulate(model, t_end=1.0, step=1e-2, progress=False)
    assert "its law" not in str(caught.value)


# --- laws that fail in the middle of a run ------------------------------------------------------------------------------
LATE = 0.05


def raises(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    if t > LATE:
        raise ValueError("too late")
    force[2] = 1.0


def divides(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = 1.0 + 0 * (1 // (5 - int(100.0 * t)))


def reads_beyond(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = p[int(20.0 * t)]


def tension(t, length, rate, p):  # type: ignore[no-untyped-def]
    if t < LATE:
        return 1.0


def wind(t, x, p, velocity):  # type: ignore[no-untyped-def]
    velocity[2] = p[int(20.0 * t)]


def drive(t, s, rate):  # type: ignore[no-untyped-def]
    if t < LATE:
        return 1.0


def push(t: float) -> float:
    if t > LATE:
        raise ValueError("too late")
    return 1.0


TOP = fb.GROUND.point((0, 0, 1))


@pytest.mark.parametrize(("make", "says"), [
    (lambda q: fb.UserForce("hand", q, raises),
     "user force 'hand': its law fails, ValueError: too late, at t = 0.0505 s, body 'q', position = (0, 0, 0.001"),
    (lambda q: fb.UserForce("hand", q, divides), "its law fails, ZeroDivisionError: "),
    (lambda q: fb.UserForce("hand", q, reads_beyond, parameters=(1.0,)), "its law fails, IndexError: index 1 is out of bounds"),
    (lambda q: fb.LineForce(TOP, q, "rope", law=tension), "line force 'rope': its law returns nothing at t = 0.0505 s, ground at "
                                                          "(0, 0, 1) m and body 'q', length = 0.998725, rate = -0.05"),
    (lambda q: fb.ForceElement(TOP, q, "pad", law=raises),
     "force element 'pad': its law fails, ValueError: too late, at t = 0.0505"),
    (lambda q: fb.Drag("air", q, linear=1.0, wind=wind, parameters=(1.0,)), "drag 'air': its wind fails, IndexError: index 1 is"),
    (lambda q: fb.Load("push", q, force=(0, 0, 1), follower=True, time=push),
     "load 'push': its time function fails, ValueError: too late, at t = 0.0505 s"),
    (lambda q: fb.PrismaticJoint(fb.GROUND, q, "rail", axis=(0, 0, 1), drive=fb.Drive(force=drive)),
     "prismatic joint 'rail': force(t, s, rate) of its drive returns nothing at t = 0.0505 s, s = 0.001275, rate = 0.05"),
], ids=["raises", "divides", "reads beyond", "line", "element", "wind", "follower", "drive"])
def test_a_law_that_fails_late_ends_the_run_with_the_last_good_state(make: Any, says: str, capfd: Any) -> None:
    body = fb.RigidBody("q", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(body, make(body)), planar=False)
    with pytest.raises(fb.ConvergenceError) as caught:
        fb.simulate(model, t_end=0.1, step=H, every=1, points={"q": body}, progress=False)
    assert says in str(caught.value), caught.value
    assert "Exception ignored" not in capfd.readouterr().err
    result = caught.value.result
    assert result is not None and result.t[-1] == pytest.approx(LATE, abs=1e-12)
    assert [event["kind"] for event in result.events] == ["failed"]
    if "wind" not in says:
        # 1 N on 1 kg until then
        np.testing.assert_allclose(result.point("q")[-1], (0, 0, 0.5 * LATE**2), rtol=0, atol=1e-15)
    # lengths of 1 m over a way of 1.25 mm
    assert np.isfinite(result.state.history).all() and result.drift("balance") < 1e-12


def test_the_part_is_named_whose_law_it_is() -> None:
    bodies = [fb.RigidBody(name, mass=1.0, inertia=(0.1, 0.1, 0.1), position=(k, 0, 0)) for k, name in enumerate("qrs")]
    # one law for three, with other parameters
    model = fb.compile_scene(fb.Scene(*bodies, *(fb.UserForce(f"on {body.name}", body, reads_beyond, parameters=[1.0] * n)
                                                 for body, n in zip(bodies, (4, 2, 3)))), planar=False)
    says = "user force 'on r': its law fails, IndexError: index 2 .* at t = 0.1005 s, body 'r'"
    with pytest.raises(fb.ConvergenceError, match=says):
        fb.simulate(model, t_end=0.2, step=H, progress=False)


def stretches(t, length, rate, p):  # type: ignore[no-untyped-def]
    if length > 1.1:
        raise ValueError("torn")
    return p[0] * (length - 1.0)


def test_a_rope_that_tears_has_no_equilibrium_beyond() -> None:
    def hung(stiffness: float) -> fb.Model:
        mass = fb.RigidBody("q", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, -1.01))
        parts = [fb.LineForce(fb.GROUND.point((0, 0, 0)), mass, "rope", law=stretches, parameters=(stiffness,)),
                 fb.PrismaticJoint(fb.GROUND.point((0, 0, 0)), mass, "rail", axis=(0, 0, 1))]
        return fb.compile_scene(fb.Scene(mass, *parts, gravity=(0, 0, -10.0)), planar=False)

    found = fb.solve_static(hung(200.0)).state.q.reshape(-1, 4, 3)[:, 0, 2].min()
    assert found == pytest.approx(-1.05, abs=1e-12)
    with pytest.raises(fb.ConvergenceError, match="'rope': its law fails, ValueError: torn, at t = 0 s, .*length = 1.1"):
        fb.solve_static(hung(50.0))


@pytest.mark.parametrize(("make", "says"), [
    (lambda q: fb.UserForce("own", q, lambda t, x, d, v, w, p, f, m: -1.0 * v), "'own': its law returns something"),
    (lambda q: fb.ForceElement(TOP, q, "own", law=lambda t, x, d, v, w, p, f, moment: -1.0 * x), "its law returns something"),
    (lambda q: fb.Drag("own", q, linear=1.0, wind=lambda t, x, p, velocity: 1.0 * x), "its wind returns something"),
    (lambda q: fb.UserForce("own", q, fine, derivative=lambda t, x, d, v, w, p, out: 1.0), "its derivative returns something"),
    (lambda q: fb.LineForce(TOP, q, "own", law=lambda t, length, rate, p: None), "its law returns nothing; it must return"),
], ids=["force", "element", "wind", "derivative", "tension"])
def test_a_law_returns_what_it_has_to(make: Any, says: str) -> None:
    body = fb.RigidBody("q", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match=says):
        fb.compile_scene(fb.Scene(body, make(body)))
