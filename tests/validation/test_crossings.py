"""Two beams that slide on each other: what stays, the limit of a light mass, equilibria, friction, restarts, nets, paths."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from exchange import balanced

import fastbeam as fb

SECTION = fb.Section(EA=1e4, GA2=1e3, GA3=1e3, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
SPIN = {True: (0.0, 0.0, 2.0), False: (0.3, 1.0, 2.0)}
A, B = "x on a", "x on b"


def scene(planar: bool = False, mass: float | None = None, section: fb.Section = SECTION, **more: Any) -> fb.Scene:
    """Two free rods that cross at an angle of 73 degrees, one of which flies and turns; with a mass instead of a crossing where
    that is given."""
    along = np.array([0.3, 1.0, 0.0]) / np.hypot(0.3, 1.0)
    at = (0.83, 0.41)
    here = np.array([at[0], 0.0, 0.0])
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=section, elements=6)
    b = fb.Beam.straight("b", here - at[1] * along, here + (1.7 - at[1]) * along, section=section, elements=5)
    if mass is None:
        cross = fb.Crossing("x", a, b, at=at, **more)
        # in a plane nothing pushes two curves that cross, unless something pulls at the point
        ball = fb.PointMass("ball", mass=0.3, position=(0.83, -0.2, 0.0))
        parts: list[Any] = [cross, ball, fb.Spring(cross.point, ball, stiffness=200.0, length=0.1)] if planar else [cross]
    else:
        bead = fb.PointMass("m", mass=mass)
        parts = [bead, fb.Slider(A, bead, a, at=at[0]), fb.Slider(B, bead, b, at=at[1])]
    motion = fb.RigidMotion(velocity=(1.0, 0.5, 0.0), spin=SPIN[planar], objects=[a])
    return fb.Scene(a, b, *parts, motion, project_velocities=True)


def run(model: Any, t_end: float = 0.3, step: float = 0.005, **settings: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **settings)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("planar", [True, False])
def test_energy_and_momenta_stay(planar: bool, order: int) -> None:
    model = fb.compile_scene(scene(planar))
    assert (model.plane is not None) == planar
    result = run(model, order=order)
    assert abs(result.slider(A)["s"][-1] - 0.83) > 0.1
    for name in ("total", "lin_mom", "ang_mom", "gap"):
        assert result.drift(name) < 1e-12, name
    one, other = result.slider(A), result.slider(B)
    largest = np.max(np.abs(one["force"]))
    assert largest > 1.0
    if not planar:
        # what one beam gets the other gives
        np.testing.assert_allclose(one["force"], -other["force"], atol=1e-10 * largest)
    np.testing.assert_allclose(one["position"], other["position"], atol=1e-15)


def test_it_is_the_limit_of_a_light_mass() -> None:
    wanted = run(fb.compile_scene(scene()))
    off = []
    for mass in (1e-3, 1e-5):
        found = run(fb.compile_scene(scene(mass=mass)))
        off.append(max(abs(found.slider(x)["s"][-1] - wanted.slider(x)["s"][-1]) for x in (A, B)))
    assert off[0] < 1e-3 and off[1] < 1e-5
    assert 60.0 < off[0] / off[1] < 140.0


def test_the_mass_in_the_tangent_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    import fastbeam.compile.compile
    wanted = run(fb.compile_scene(scene()), t_end=0.1)
    monkeypatch.setattr(fastbeam.compile.compile, "KNOT_SHARE", 1e-3)
    found = run(fb.compile_scene(scene()), t_end=0.1)
    np.testing.assert_allclose(found.state.q, wanted.state.q, atol=1e-12)


def test_order_of_the_steps() -> None:
    slow = fb.Section(EA=1e3, GA2=1e2, GA3=1e2, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
    model = fb.compile_scene(scene(section=slow))
    # coarser steps do not resolve the waves of the start
    for order, size in ((2, 0.00125), (4, 0.000625)):
        ends = [run(model, 0.08, size / k, order=order).state.q for k in (1, 2, 4)]
        rate = np.log2(np.max(np.abs(ends[1] - ends[0])) / np.max(np.abs(ends[2] - ends[1])))
        assert order - 0.4 < rate < order + 0.4, (order, rate)


@pytest.mark.parametrize("stiffness", [1e6, 1e8])
def test_stiff_wires_take_no_more_iterations(stiffness: float) -> None:
    wire = fb.Section(EA=stiffness, GA2=stiffness / 10, GA3=stiffness / 10, GJ=1e-2, EI2=1e-2, EI3=1e-2, rhoA=1.0, rhoI2=1e-4,
                      rhoI3=1e-4)
    result = run(fb.compile_scene(scene(section=wire)), 0.06, 0.002)
    assert result.drift("total") < 1e-12 and result.drift("gap") < 1e-14
    assert np.mean(result.series["iterations"][1:]) < 4.5


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("planar", [True, False])
def test_there_and_back(planar: bool, order: int) -> None:
    model = fb.compile_scene(scene(planar))
    there = run(model, 0.2, order=order)
    back = there.state._replace(v=-there.state.v)
    again = run(model, 0.2, order=order, start=fb.Start(back, time=0.0))
    off = np.abs(again.state.q - model.q0).max(), np.abs(again.state.s - model.s0).max()
    print(f"there and back: {off[0]:.1e} m, s {off[1]:.1e} m")
    assert max(off) < 1e-12


def test_plane_and_space_agree() -> None:
    planar, full = (run(fb.compile_scene(scene(True), planar=x), 0.1) for x in ("auto", False))
    np.testing.assert_allclose(planar.state.q, full.state.q, atol=1e-11)
    np.testing.assert_allclose(planar.state.s, full.state.s, atol=1e-11)


def test_a_run_goes_on_bit_for_bit() -> None:
    model = fb.compile_scene(scene())
    whole, half = run(model, 0.1), run(model, 0.05)
    rest = run(model, 0.1, start=half.checkpoint)
    for one, other in zip(whole.state, rest.state):
        np.testing.assert_array_equal(one, other)


def test_friction_on_each_side() -> None:
    result = run(fb.compile_scene(scene(friction=(0.3, 0.1))), 0.4)
    assert result.drift("lin_mom") < 1e-12 and result.drift("ang_mom") < 1e-12
    assert balanced(result)
    for name, mu in ((A, 0.3), (B, 0.1)):
        x = result.slider(name)
        assert x["friction_loss"][-1] > 0.02
        across = np.sqrt(np.sum(x["force"]**2, axis=1) - x["force_along"]**2)
        slides = np.abs(x["slide_rate"]) > 0.1
        # forces of rows are means of two steps
        assert np.median(np.abs(np.abs(x["friction_force"]) / across - mu)[slides]) < 0.01 * mu
        assert np.all((x["friction_force"] * x["slide_rate"])[slides] < 0.0)


def cords(section: fb.Section, elements: int = 10, mass: float | None = None, shift: float = 0.0) -> fb.Scene:
    """Two pinned cords, 2 m and 1.6 m long, that cross in their middle under a weight of 30 N; shift: the weight pulls aside."""
    a = fb.Beam.straight("a", (0, 0, 0), (2.0, 0, 0), section=section, elements=elements)
    b = fb.Beam.straight("b", (1.0, -0.8, 0), (1.0, 0.8, 0), section=section, elements=elements)
    if mass is None:
        x = fb.Crossing("x", a, b, at=(1.0, 0.8))
        point, parts = x.point, [x]
    else:
        bead = fb.PointMass("m", mass=mass)
        point, parts = bead.center, [bead, fb.Slider(A, bead, a, at=1.0), fb.Slider(B, bead, b, at=0.8)]
    return fb.Scene(a, b, *parts, *(fb.Pin(end) for end in (a.start, a.end, b.start, b.end)),
                    fb.Load("weight", point, force=(shift, 0.6 * shift, -30.0)))


def test_taut_cords_against_the_exact_equilibrium() -> None:
    stiff = 1e3
    thin = fb.Section(EA=stiff, GA2=stiff / 3, GA3=stiff / 3, GJ=1e-6, EI2=1e-6, EI3=1e-6, rhoA=1.0, rhoI2=1e-6, rhoI3=1e-6)

    def share(depth: float, half: float) -> float:
        """Force of a cord of half this length that is pushed down in its middle, N."""
        long = np.hypot(half, depth)
        return 2.0 * stiff * (long / half - 1.0) * depth / long

    low, high = 0.0, 0.5
    for _ in range(80):
        depth = 0.5 * (low + high)
        low, high = (depth, high) if share(depth, 1.0) + share(depth, 0.8) < 30.0 else (low, depth)
    scene_of = cords(thin)
    result = fb.solve_static(fb.compile_scene(scene_of), points={"x": scene_of.sliders[0].point})
    np.testing.assert_allclose(result.point("x")[-1], (1.0, 0.0, -depth), atol=1e-4)
    for name, half in ((A, 1.0), (B, 0.8)):
        force = result.slider(name)["force"][-1]
        # the bending of the cords takes some of it
        np.testing.assert_allclose(force, (0.0, 0.0, share(depth, half)), atol=3e-4 * 30.0)


def test_equilibrium_is_that_of_a_light_mass() -> None:
    thick = fb.Section(EA=1e3, GA2=300, GA3=300, GJ=0.1, EI2=0.1, EI3=0.1, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
    found, wanted = (fb.solve_static(fb.compile_scene(cords(thick, 8, mass, shift=2.0))) for mass in (None, 1e-6))
    assert abs(found.slider(A)["s"][-1] - 1.0) > 1e-3
    for name in (A, B):
        np.testing.assert_allclose(found.slider(name)["s"][-1], wanted.slider(name)["s"][-1], atol=1e-9)
        np.testing.assert_allclose(found.slider(name)["force"][-1], wanted.slider(name)["force"][-1], atol=1e-6)
    # frequencies about it, too
    of_both = [fb.modes(fb.compile_scene(cords(thick, 8, mass, shift=2.0)), n=4, state=x.state).frequencies
               for mass, x in ((None, found), (1e-6, wanted))]
    np.testing.assert_allclose(of_both[0], of_both[1], rtol=1e-5, atol=1e-6)


def test_on_paths_and_in_nets() -> None:
    one = fb.Beam.straight("p1", (0, 0, 0), (1, 0, 0), section=SECTION, elements=3)
    two = fb.Beam.straight("p2", (1, 0, 0), (2, 0, 0), section=SECTION, elements=3)
    other = fb.Beam.straight("q", (0.9, -1, 0), (0.9, 1, 0), section=SECTION, elements=4)
    path = fb.Path("p", [one, two])
    flies = fb.Scene(one, two, other, fb.RigidConnection(*path.joints()[0]), fb.Crossing("x", path, other, at=(0.9, 1.0)),
                     fb.RigidMotion(velocity=(2, 0, 0), objects=[other]), project_velocities=True)
    result = run(fb.compile_scene(flies), 0.2)
    assert result.slider("x on p")["s"][-1] > 1.1
    assert max(result.drift(x) for x in ("total", "lin_mom", "ang_mom", "gap")) < 1e-12
    nodes = np.array([(0, 0, 0), (2, 0, 0), (0.83, -1, 0), (0.83, 1.2, 0), (4, 0, 0)], float)
    net = fb.Net("n", nodes, [(0, 1), (2, 3), (1, 4)], section=SECTION, elements=4, pins=[0, 2, 3])
    hangs = fb.Scene(net, fb.Crossing("x", net.beam(0), net.beam(1), at=(0.83, 1.0)), gravity=(0, 0, -9.81))
    ends = []
    for condense in (False, True):
        result = run(fb.compile_scene(hangs, condense=condense), 0.1)
        assert result.drift("total") < 1e-12 and result.drift("gap") < 1e-13
        ends.append(result.state.q)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


def test_what_is_refused() -> None:
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=SECTION, elements=4)
    b = fb.Beam.straight("b", (1, -1, 0), (1, 1, 0), section=SECTION, elements=4)
    c = fb.Beam.straight("c", (0, 0, 0), (2, 0, 0), section=SECTION, elements=4)
    with pytest.raises(fb.SceneError, match="both sides"):
        fb.Crossing("x", a, a, at=(0.5, 0.5))
    with pytest.raises(fb.SceneError, match="parallel"):
        fb.Crossing("x", a, c, at=(0.5, 0.5))
    with pytest.raises(fb.SceneError, match="apart"):
        fb.Scene(a, b, fb.Crossing("x", a, b, at=(1.0, 0.9))).check()
    with pytest.raises(fb.SceneError, match="is not in"):
        fb.Scene(a, fb.Crossing("x", a, b, at=(1.0, 1.0))).check()
    model = fb.compile_scene(fb.Scene(a, b, fb.Crossing("x", a, b, at=(1.0, 1.0))))
    for method in ("midpoint", "generalized_alpha"):
        with pytest.raises(fb.SceneError, match="crossings"):
            fb.simulate(model, t_end=0.1, step=0.01, method=method)
