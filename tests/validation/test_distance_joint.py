"""Distance joints: exact motions, conservation, what they are attached to, equilibria, every method and solver."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb

Array = np.ndarray
BAR = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)


def position(result: fb.Result, node: int) -> Array:
    return result.state.q.reshape(-1, 4, 3)[node, 0]


# --------------------------------------------------------------------------------------------------------- exact motions
def pendulum(velocity: tuple[float, float, float] = (0.0, 0.4, 0.0)) -> fb.Scene:
    anchor = fb.PointMass("anchor", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.0, position=(1, 0, 0), velocity=velocity)
    return fb.Scene(anchor, bob, fb.Clamp(anchor), fb.DistanceJoint(anchor, bob, "rod"), gravity=(0, 0, -9.81))


def exact_end(t: float) -> Array:
    def rates(_: float, y: Array) -> Array:
        x, v, g = y[:3], y[3:], np.array([0.0, 0.0, -9.81])
        return np.concatenate((v, g - (x @ g + v @ v) / (x @ x) * x))

    return solve_ivp(rates, (0.0, t), [1, 0, 0, 0, 0.4, 0], rtol=1e-11, atol=1e-12).y[:3, -1]


@pytest.mark.parametrize(("order", "steps"), [(2, (0.01, 0.005)), (4, (0.02, 0.01))])
def test_spherical_pendulum(order: int, steps: tuple[float, float]) -> None:
    model = fb.compile_scene(pendulum())
    runs = [fb.simulate(model, t_end=1.0, step=step, order=order, progress=False) for step in steps]
    errors = [float(np.linalg.norm(position(run, 1) - exact_end(1.0))) for run in runs]
    assert errors[1] < (2e-3 if order == 2 else 2e-4)
    assert np.log2(errors[0] / errors[1]) > order - 0.5
    for run in runs:
        assert np.ptp(run.series["total"]) < 1e-12
        assert abs(np.linalg.norm(position(run, 1)) - 1.0) < 1e-14
        assert run.info["fallbacks"] == 0


def test_the_push_is_the_force_in_the_rod() -> None:
    # at rest below: the weight hangs on it, a tension
    anchor = fb.PointMass("anchor", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.0, position=(0, 0, -1))
    model = fb.compile_scene(fb.Scene(anchor, bob, fb.Clamp(anchor), fb.DistanceJoint(anchor, bob), gravity=(0, 0, -9.81)))
    run = fb.simulate(model, t_end=0.1, step=0.01, progress=False)
    assert run.state.force[0] == pytest.approx(-2.0 * 9.81, rel=1e-11)
    assert np.linalg.norm(position(run, 1) - [0, 0, -1]) < 1e-14


@pytest.mark.parametrize("method", ["midpoint", "trapezoidal", "generalized_alpha"])
def test_other_methods_find_the_same_motion(method: str) -> None:
    model = fb.compile_scene(pendulum())
    runs = [fb.simulate(model, t_end=0.5, step=step, method=method, progress=False) for step in (0.01, 0.005)]
    errors = [float(np.linalg.norm(position(run, 1) - exact_end(0.5))) for run in runs]
    assert errors[1] < 1e-3 and np.log2(errors[0] / errors[1]) > 1.6


# ------------------------------------------------------------------------------------------- what a joint is attached to
def assembly(flat: bool = False) -> fb.Scene:
    """Two beams, a body and a mass, joints between inner nodes, ends, a point of the body off its centre, all moving."""
    z = 0.0 if flat else 0.3
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=BAR, elements=4, degree=3)
    b = fb.Beam.straight("b", (0, 1, 0), (1, 1, z), section=BAR, elements=4, degree=3)
    body = fb.RigidBody("body", mass=0.3, inertia=(0.01, 0.02, 0.015), position=(0.5, 2, 0))
    tip = fb.PointMass("tip", mass=0.1, position=(1.0, 0, 0))
    point = body.point((0.1, 0.2, 0.0 if flat else -0.1))
    push = fb.Load("push", body, force=(3.0, 1.0, 0.0 if flat else 2.0), time=lambda t: float(t < 0.1))
    return fb.Scene(a, b, body, tip, push, fb.DistanceJoint(a.node(4), b.node(7)), fb.DistanceJoint(b.end, point, "arm"),
                    fb.BallJoint(a.end, tip), fb.DistanceJoint(tip, body, "long"))


@pytest.mark.parametrize("flat", [False, True], ids=["space", "plane"])
def test_energy_and_momenta_are_kept(flat: bool) -> None:
    model = fb.compile_scene(assembly(flat))
    assert (model.plane is not None) == flat
    run = fb.simulate(model, t_end=0.5, step=0.005, observe=("energy", "momentum"), progress=False)
    assert run.info["fallbacks"] == 0
    free = run.t > 0.105
    scale = np.max(run.series["kinetic"])
    assert scale > 0.01
    assert np.ptp(run.series["total"][free]) < 1e-11 * scale
    for name in ("lin_mom", "ang_mom"):
        x = run.series[name][free]
        assert np.abs(x - x[0]).max() < 1e-11 * np.sqrt(scale)


def test_plane_and_space_agree() -> None:
    runs = [fb.simulate(fb.compile_scene(assembly(True), planar=planar), t_end=0.3, step=0.005, progress=False)
            for planar in (True, False)]
    np.testing.assert_allclose(runs[0].state.q, runs[1].state.q, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("options", [{"solver": "sparse"}, {"eliminate_inner": False}], ids=["sparse", "all nodes"])
def test_solvers_agree(options: dict[str, Any]) -> None:
    whole = fb.simulate(fb.compile_scene(assembly()), t_end=0.2, step=0.005, progress=False)
    other = fb.simulate(fb.compile_scene(assembly(), **options), t_end=0.2, step=0.005, progress=False)
    np.testing.assert_allclose(other.state.q, whole.state.q, rtol=0.0, atol=1e-10)


def test_a_run_goes_on_bit_for_bit() -> None:
    model = fb.compile_scene(assembly())
    whole = fb.simulate(model, t_end=0.4, step=0.005, progress=False)
    half = fb.simulate(model, t_end=0.2, step=0.005, progress=False)
    rest = fb.simulate(model, t_end=0.4, step=0.005, start=half.checkpoint, progress=False)
    assert all(np.array_equal(x, y) for x, y in zip(whole.state, rest.state))


def test_a_chain_of_rods_beside_a_slider() -> None:
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=BAR, elements=8)
    cart = fb.PointMass("cart", mass=0.2)
    links = [fb.PointMass(f"m{k}", mass=0.1, position=(0.5, 0.0, -0.2 * (k + 1))) for k in range(4)]
    rods = [fb.DistanceJoint(a, b) for a, b in zip([cart, *links], links)]
    scene = fb.Scene(rail, cart, *links, *rods, fb.Clamp(rail.start), fb.Clamp(rail.end), fb.Slider("s", cart, rail, at=0.5),
                     fb.RigidMotion([links[-1]], velocity=(0.6, 0.0, 0.0)), gravity=(0, 0, -9.81))
    run = fb.simulate(fb.compile_scene(scene), t_end=0.3, step=0.002, progress=False)
    assert run.info["fallbacks"] == 0
    assert np.ptp(run.series["total"]) < 1e-11 * np.max(np.abs(run.series["gravity"]))
    x = run.state.q.reshape(-1, 4, 3)[-5:, 0]
    assert np.abs(np.linalg.norm(np.diff(x, axis=0), axis=1) - 0.2).max() < 1e-13


# ------------------------------------------------------------------------------------------------------- starts, statics
def test_velocities_that_stretch_a_rod_are_refused_or_projected() -> None:
    with pytest.raises(fb.SceneError, match="distance joint 'rod': the initial velocities violate it by 0.5 m/s"):
        fb.compile_scene(pendulum((0.5, 0.4, 0.0)))
    scene = pendulum((0.5, 0.4, 0.0))
    scene.project_velocities = True
    model = fb.compile_scene(scene)
    np.testing.assert_allclose(model.v0.reshape(-1, 4, 3)[1, 0], [0, 0.4, 0], atol=1e-12)


def test_a_start_that_stretches_a_rod_is_refused_or_mended() -> None:
    model = fb.compile_scene(pendulum((0, 0, 0)))
    state = model.state()
    state.q.reshape(-1, 4, 3)[1, 0] = 1.001, 0, 0
    with pytest.raises(fb.SceneError, match="start: distance joint 'rod': its points lie 0.001 m off"):
        fb.simulate(model, t_end=0.1, step=0.01, start=state, progress=False)
    run = fb.simulate(model, t_end=0.1, step=0.01, start=fb.Start(state, mend=True), progress=False)
    assert abs(np.linalg.norm(position(run, 1)) - 1.0) < 1e-12


@pytest.mark.parametrize("planar", [True, False])
def test_a_mass_on_two_rods_in_equilibrium(planar: bool) -> None:
    # a stay: the tip of a cantilever hangs on a rod
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=BAR, elements=8)
    mast = fb.PointMass("mast", mass=1.0, position=(0, 1, 0))
    force = 1e-3
    scene = fb.Scene(beam, mast, fb.Clamp(beam.start), fb.Clamp(mast), fb.DistanceJoint(beam.end, mast, "stay"),
                     fb.Load("f", beam.end, force=(0, -force, 0)))
    result = fb.solve_static(fb.compile_scene(scene, planar=planar))
    # the rod of 45 degrees takes the force nearly alone; the beam is compressed by it
    assert result.state.force[0] == pytest.approx(-np.sqrt(2.0) * force, rel=2e-3)
    assert np.linalg.norm(position(result, beam.n_nodes - 1) - [0, 1, 0]) == pytest.approx(np.sqrt(2.0), rel=1e-13)
    assert result.info["unstable_directions"] == 0
    run = fb.simulate(fb.compile_scene(scene, planar=planar), t_end=0.1, step=0.01, start=result.state, progress=False)
    assert np.abs(run.state.q - result.state.q).max() < 1e-11


# ------------------------------------------------------------------------------------------------------------------ words
def test_what_a_distance_joint_refuses() -> None:
    mass, other = fb.PointMass("m", mass=1.0, position=(0, 0, 0)), fb.PointMass("n", mass=1.0, position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="both sides are point mass 'm'"):
        fb.DistanceJoint(mass, mass)
    with pytest.raises(fb.SceneError, match="lie at the same place; use BallJoint"):
        fb.compile_scene(fb.Scene(mass, other, fb.Clamp(mass), fb.DistanceJoint(mass, other, "rod")))


def test_print_model_names_distance_joints() -> None:
    assert "distance joints    1 distance joint between two points" in str(fb.compile_scene(pendulum()))
