"""Machines against exact answers: a spinning top, a rotating beam, a flexible slider-crank.

Linkages of rigid bodies (double pendulum, four-bar, slider-crank, gyroscope, Bricard), law of Cardan: test_axis_joints.py."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

Array = np.ndarray
G = 9.81
pytestmark = pytest.mark.slow


def run(model: fb.Model, t_end: float, step: float, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, **options)


def smooth(x: float) -> float:
    """From 0 to 1, with three derivatives that are zero at both ends."""
    x = min(max(x, 0.0), 1.0)
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def test_a_heavy_top_precesses_regularly() -> None:
    """I1 cos(theta) psi'^2 - I3 w3 psi' + m g l = 0; both momenta that gravity leaves stay."""
    mass, lever, own, axial, w3, theta = 2.0, 0.3, 0.05, 0.02, 200.0, 0.7
    about = own + mass * lever**2
    slow = float(np.roots([about * np.cos(theta), -axial * w3, mass * G * lever]).min())
    e3 = np.array([np.sin(theta), 0.0, np.cos(theta)])
    spin = slow * np.array([0, 0, 1.0]) + (w3 - slow * np.cos(theta)) * e3
    triad = np.stack(([np.cos(theta), 0, -np.sin(theta)], [0, 1.0, 0], e3))
    top = fb.RigidBody("top", mass=mass, inertia=(own, own, axial), position=lever * e3, directors=triad, spin=spin,
                       velocity=np.cross(spin, lever * e3))
    stand = fb.PointMass("stand", mass=1.0, position=(0, 0, 0))
    held = fb.Pin(stand), fb.BallJoint(top.point((0, 0, -lever)), stand)
    model = fb.compile_scene(fb.Scene(top, stand, *held, gravity=(0, 0, -G)))
    turn = 2.0 * np.pi / slow
    errors = {}
    for order, parts in ((2, 4000), (2, 8000), (4, 2000), (4, 4000)):
        result = run(model, turn, turn / parts, order=order, points={"top": top})
        assert result.drift("total") < 1e-12
        errors[order, parts] = float(np.linalg.norm(result.point("top")[-1] - lever * e3)) / lever
        assert np.max(np.abs(result.point("top")[:, 2] / lever - np.cos(theta))) < 10.0 * errors[order, parts] + 1e-9
    assert np.log2(errors[2, 4000] / errors[2, 8000]) > 1.9 and np.log2(errors[4, 2000] / errors[4, 4000]) > 3.7
    assert errors[4, 4000] < 1e-6 and errors[2, 8000] < 1e-2


def blade(angle: Any, E: float = 1e8, damping: float = 0.0) -> tuple[fb.Model, fb.Beam]:
    """A beam on a hinge that is turned."""
    section = fb.Section.circle(radius=0.02, E=E, rho=1000.0)
    beam = fb.Beam.straight("blade", (0, 0, 0), (1, 0, 0), section=section, elements=4)
    scene = fb.Scene(beam, fb.RevoluteJoint(fb.GROUND, beam.start, "root", axis=(0, 1, 0), angle=angle), project_velocities=True)
    return fb.compile_scene(scene), beam


def test_a_beam_that_turns_steadily_is_as_long_as_the_exact_one() -> None:
    """(EA r')' + rho A w^2 r = 0: r(L) = tan(k L)/k, k = w sqrt(rho/E), after a run-up of several seconds."""
    E, w, ramp = 3e6, 6.0, 40.0

    def angle(t: float) -> float:
        # the integral of w smooth(t/ramp)
        x = min(t / ramp, 1.0)
        return w * (ramp * x**5 * (7.0 - 14.0 * x + 10.0 * x**2 - 2.5 * x**3) + max(t - ramp, 0.0))

    model, beam = blade(angle, E)
    k, lengths = w * np.sqrt(1000.0 / E), []
    for step in (0.02, 0.01):
        result = run(model, ramp + 1.0, step, every=10, points={"tip": beam.end})
        lengths.append(np.mean(np.linalg.norm(result.point("tip")[result.t > ramp], axis=1)))
        assert result.drift("balance") < 1e-12
    # a step in which it turns by w h stretches it by (w h)^2/6 more
    first, second = (x - np.tan(k) / k for x in lengths)
    assert np.tan(k) / k - 1.0 > 3e-3 and 3.8 < first / second < 4.2
    assert abs((4.0 * second - first) / 3.0) < 1e-6


def test_order_four_with_a_given_angle_is_of_order_four_where_its_start_is_smooth() -> None:
    """A sine that starts at once begins with a jump of the acceleration of all nodes: waves that no such step resolves."""
    errors = {}
    for name, angle in (("smooth", lambda t: 0.5 * np.sin(3.0 * t)**4), ("at once", lambda t: 0.5 * np.sin(3.0 * t))):
        model, _ = blade(angle)
        ends = [run(model, 0.5, step, order=4).state.q for step in (0.005, 0.0025, 0.00125, 0.000625)]
        errors[name] = [float(np.max(np.abs(q - ends[-1]))) for q in ends[:-1]]
    first, _, last = errors["smooth"]
    assert 0.5 * np.log2(first / last) > 3.6 and last < 1e-8
    assert errors["at once"][-1] > 1e2 * last


def test_a_bushing_beside_a_universal_joint_is_a_spring_of_both_its_angles() -> None:
    """Periods about both arms of the cross, at small angles."""
    stiffness, amplitude = (3.0, 5.0, 1.0), 1e-3
    for k, inertia in ((0, 0.02), (1, 0.03)):
        spin = np.eye(3)[k] * amplitude * np.sqrt(stiffness[k] / inertia)
        part = fb.RigidBody("part", mass=1.0, inertia=(0.02, 0.03, 0.04), position=(0, 0, 0), spin=spin)
        cross = fb.UniversalJoint(fb.GROUND, part.center, "cross", axis_a=(1, 0, 0), axis_b=(0, 1, 0))
        spring = fb.Bushing(fb.GROUND.point((0, 0, 0)), part.center, stiffness=(0, 0, 0, *stiffness))
        model = fb.compile_scene(fb.Scene(part, cross, spring), planar=False)
        result = run(model, 0.5, 1e-3, points={"arm": part.point((0, 0, 1.0))})
        off = result.point("arm")[:, 1 - k] * (-1.0 if k == 0 else 1.0)
        exact = amplitude * np.sin(np.sqrt(stiffness[k] / inertia) * result.t)
        np.testing.assert_allclose(off, exact, rtol=0.0, atol=2e-3 * amplitude)
        assert result.drift("total") < 1e-12


def crank(E: float, angle: Any) -> tuple[fb.Model, Any]:
    """A rod between a crank in balance and a piston."""
    r, length = 0.15, 0.6
    x = np.sqrt(length**2 - r**2)
    section = fb.Section.rectangle(height=0.01, width=0.02, E=E, rho=1500.0)
    rod = fb.Beam.straight("rod", (0, 0, r), (x, 0, 0), section=section, elements=4)
    piston = fb.RigidBody("piston", mass=0.3, inertia=(0.02, 0.03, 0.04), position=(x, 0, 0))
    wheel = fb.RigidBody("crank", mass=1.0, inertia=(1e-4, 1e-4, 1e-4), position=(0, 0, 0))
    scene = fb.Scene(rod, piston, wheel, fb.RevoluteJoint(rod.end, piston, "pin", axis=(0, 1, 0)),
                     fb.PrismaticJoint(fb.GROUND, piston, "guide", axis=(1, 0, 0)),
                     fb.RevoluteJoint(fb.GROUND, wheel, "shaft", axis=(0, 1, 0), angle=angle),
                     fb.RevoluteJoint(wheel.point((0, 0, r)), rod.start, "crank pin", axis=(0, 1, 0)))
    return fb.compile_scene(scene), piston


def test_a_slider_crank_with_a_stiff_rod_follows_kinematics_and_a_flexible_one_converges() -> None:
    r, length, t_end = 0.15, 0.6, 0.8

    def angle(t: float) -> float:
        return 2.0 * np.pi * smooth(t)

    model, piston = crank(2e11, angle)
    found = run(model, t_end, 0.002, points={"piston": piston}).point("piston")[-1, 0]
    a = angle(t_end)
    place = r * np.sin(a) + np.sqrt(length**2 - (r * np.cos(a))**2)
    assert found == pytest.approx(place, abs=1e-6)
    # bent by its inertia: both orders lead to the same motion
    model, piston = crank(1e8, angle)
    runs = {(order, n): run(model, t_end, t_end / n, order=order).state.q.reshape(-1, 4, 3)[:, 0]
            for order, n in ((2, 800), (2, 1600), (4, 800), (4, 1600))}
    extrapolated = (4.0 * runs[2, 1600] - runs[2, 800]) / 3.0
    np.testing.assert_allclose(runs[4, 800], runs[4, 1600], rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(extrapolated, runs[4, 1600], rtol=0.0, atol=1e-6)
    assert np.max(np.abs(runs[2, 800] - runs[4, 1600])) > 1e-6
    middle = 0.5 * (runs[4, 1600][0] + runs[4, 1600][12])
    assert np.max(np.linalg.norm(runs[4, 1600][4:9] - middle, axis=1)) > 1e-3
