"""Functions of time from tables: what they are between rows, means over steps, and what a kink costs."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.contact.drive_laws import given_to
from fastbeam.model.forces.loads import mean_factors
from fastbeam.scene.prescribed_motion import largest_kink

JUMPS = np.array([0.0, 1.0, 1.01, 1.5, 1.51, 3.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
OFTEN = np.linspace(-0.5, 3.5, 2001)


def test_tables_are_read_along_straight_lines() -> None:
    signal = fb.Signal(*JUMPS)
    assert np.max(np.abs([signal(t) - np.interp(t, *JUMPS) for t in OFTEN])) < 1e-13
    assert fb.Signal([2.0, 4.0], [1.0, -1.0], direction=(0, 2, 0))(2.5).tolist() == [0.0, 1.0, 0.0]
    # the last row itself, where 0.1 + 0.2 is not 0.3
    assert fb.Signal([0.0, 0.3], [0.1, 0.3])(0.3) == 0.3 and fb.Signal([0.0, 0.3], [0.1, 0.3])(5.0) == 0.3


@pytest.mark.parametrize("rest", [True, False])
def test_smooth_tables(rest: bool) -> None:
    smooth = fb.Signal(*JUMPS, interpolation="pchip", rest=rest)
    values = np.array([smooth(t) for t in OFTEN[(OFTEN >= 0.0) & (OFTEN <= 3.0)]])
    assert values.min() >= 0.0 and values.max() <= 1.0 and largest_kink(smooth, -1.0, 9.0)[1] == 0.0
    # two rows: x^2 (3 - 2 x) from rest to rest, else the straight line
    for kind in ("cubic", "pchip"):
        ramp = fb.Signal([0, 2], [0, 1], interpolation=kind, rest=rest)
        assert ramp(0.5) == pytest.approx(0.15625 if rest else 0.25, abs=1e-15)
    sine = fb.Signal(np.linspace(0, 1, 101), np.sin(np.linspace(0, 1, 101)), interpolation="cubic", rest=False)
    assert abs(sine(0.12345) - np.sin(0.12345)) < 1e-9
    assert largest_kink(fb.Signal([0, 1, 3], [0, 2, 2]), -1.0, 9.0) == (0.0, 2.0)
    assert largest_kink(fb.Signal([0, 1, 3], [0, 2, 2]), 0.0, 9.0) == (1.0, 2.0)


@pytest.mark.parametrize("kind", ["linear", "cubic", "pchip", "acceleration"])
def test_the_compiled_form_and_the_means_are_those_of_the_table(kind: str) -> None:
    signal = (fb.Signal.from_acceleration(*JUMPS, velocity=1.0) if kind == "acceleration" else
              fb.Signal(*JUMPS, interpolation=kind))
    assert max(abs(signal.compilable(t) - signal(t)) for t in OFTEN) < 1e-12
    # steps that contain no row, several rows and all of the table, forward and backward; integrals of the pieces of the curve
    begins, sizes = np.array([0.2, 0.9, 0.0, 1.505, 1.6]), np.array([0.5, 0.7, 3.0, 0.01, -0.7])
    exact = [signal._curve.integrate(a, a + h) / h for a, h in zip(begins, sizes)]
    assert np.max(np.abs(mean_factors(signal, begins, sizes) - exact)) < 1e-14 * max(1.0, np.max(np.abs(exact)))


def test_a_drive_by_a_table_of_speeds_goes_the_way_under_it() -> None:
    speed = fb.Signal(*JUMPS)
    drives = fb.Drive(speed=speed), fb.Drive(force=speed)
    for t, h in ((0.0, 3.0), (0.97, 0.05), (1.505, 0.2), (0.2, 0.1)):
        exact = speed._curve.integrate(t, t + h)
        assert given_to(drives[0], "it", t, h)[0] == pytest.approx(exact, abs=1e-15)
        assert h * given_to(drives[1], "it", t, h)[0] == pytest.approx(exact, abs=1e-15)


def test_a_blow_shorter_than_a_step_has_its_impulse() -> None:
    """A hammer blow of 2 ms in steps of 50 ms: behind it the bead has the whole impulse."""
    bead = fb.PointMass("bead", mass=0.5, position=(0, 0, 0))
    blow = fb.Signal([0.0, 0.110, 0.111, 0.112, 1.0], [0.0, 0.0, 1.0, 0.0, 0.0])
    scene = fb.Scene(bead, fb.Load("blow", bead, force=(0, 0, 400.0), time=blow))
    run = fb.simulate(fb.compile_scene(scene), t_end=0.5, step=0.05, progress=False)
    assert run.state.v[2] == pytest.approx(400.0 * 1e-3 / 0.5, rel=1e-13)


def test_a_jump_is_two_rows_at_one_time() -> None:
    """Forces that come and go at once, as other programs write them: impulses and the motion between are exact."""
    rows = [0.0, 0.0, 0.113, 0.113, 0.4, 0.4], [0.0, 2.0, 2.0, -1.0, 3.0, 0.5]
    jumps = fb.Signal(*rows)
    assert [jumps(t) for t in (-1.0, 0.0, 0.1129, 0.113, 0.39999999, 0.4, 9.0)] == pytest.approx(
        [0.0, 2.0, 2.0, -1.0, 3.0, 0.5, 0.5], abs=2e-7)
    # steps with jumps inside, at their ends, both ways
    begins, sizes = np.array([-0.1, 0.05, 0.113, 0.3, 0.2, 0.113]), np.array([0.2, 0.2, 0.287, 0.3, -0.4, -0.1])

    def until(t: float) -> float:
        """Integral from 0."""
        ramp = min(max(t, 0.113), 0.4) - 0.113
        return 2.0 * min(max(t, 0.0), 0.113) - ramp + 2.0 / 0.287 * ramp**2 + 0.5 * max(t - 0.4, 0.0)
    exact = [(until(a + h) - until(a)) / h for a, h in zip(begins, sizes)]
    np.testing.assert_allclose(mean_factors(jumps, begins, sizes), exact, rtol=1e-14)
    bead = fb.PointMass("bead", mass=0.5, position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(bead, fb.Load("push", bead, force=(0, 0, 10.0), time=jumps)))
    for step, order in ((0.03, 2), (0.07, 4)):
        run = fb.simulate(model, t_end=0.63, step=step, order=order, progress=False)
        assert run.state.v[2] == pytest.approx(10.0 / 0.5 * until(0.63), rel=1e-13)


def test_jumps_are_refused_where_steps_do_not_integrate_them() -> None:
    step = fb.Signal([0.0, 0.5, 0.5, 1.0], [0.0, 0.0, 1.0, 1.0])
    bar = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=bar, elements=2)
    follower = fb.Load("thrust", beam.end, force=(0, 0, 1.0), time=step, follower=True)
    # a controller follows a place that jumps
    fb.Drive(position=step, stiffness=10.0)
    for call, message in (
            (lambda: fb.PrescribedMotion("shake", beam.start, displacement=step, axes="z"), "must not jump.* t = 0.5 s"),
            (lambda: fb.Drive(position=step), "drive: position must not jump"),
            (lambda: fb.Drive(speed=step), "drive: speed must not"),
            (lambda: fb.RevoluteJoint(fb.GROUND, beam.start, axis=(0, 1, 0), angle=step), "angle must not jump"),
            (lambda: fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), follower)), "load 'thrust': time .*not jump.* 0.5 s"),
            (lambda: fb.Signal([0, 1, 1], [0, 0, 1], interpolation="pchip"), "takes interpolation='linear'"),
            (lambda: fb.Signal([0, 1, 1, 1], [0, 0, 1, 2]), "two rows at one time, .* but more rows have t = 1 s"),
            (lambda: fb.Signal([1, 1], [0, 1]), "times must increase"),
            (lambda: fb.Signal([0, 2, 1], [0, 1, 1]), "times must incr")):
        with pytest.raises(fb.SceneError, match=message):
            call()
