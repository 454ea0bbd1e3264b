"""Frequency responses, damped modes and relaxation as users ask for them: recipes, arguments, pictures."""
from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sparse

import fastbeam as fb
from fastbeam.model.forces.damping_matrix import material_map
from fastbeam.model.tables import strain_gradient, strains_of

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import SECTION, cantilever, straight  # noqa: E402

F = np.linspace(0.5, 8.0, 16)


@cache
def model() -> Any:
    return fb.compile_scene(cantilever())


def response(**changes: Any) -> Any:
    return fb.frequency_response(model(), **dict(frequencies=F, load_factor=0.0, base=(0, 0, 1e-3)) | changes)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"frequencies": [-1.0]}, "frequencies: must be 1 to 1000000 numbers >= 0 Hz"),
    ({"frequencies": []}, "frequencies: must be 1 to"),
    ({"base": None}, "nothing excites the scene"),
    ({"base": {}}, "base= is an empty mapping"),
    ({"base": (1, 2)}, "base= must be 3 finite numbers"),
    ({"base": ("a", 0, 0)}, "base= must be a finite number, which may be complex"),
    ({"base": {"clamp": (1, 0, 0)}}, "base= must map supports"),
    ({"base": {fb.PointMass("m", mass=1.0, position=(0, 0, 0)): (1, 0, 0)}}, "is not in scene 'cantilever'"),
    ({"loads": "wind"}, "has no load 'wind'; its loads: 'tip'"),
    ({"loads": 3.0}, "loads: must be a Load"),
    ({"loads": [3.0]}, "loads: must be a Load"),
    ({"loads": {"tip": "much"}}, "the factor of load 'tip' must be a finite number"),
    ({"loads": fb.Load("x", straight("other", (0, 0, 0), (1, 0, 0)).end, force=(1, 0, 0))}, "acts on a part that is not in "
                                                                                            "scene"),
    ({"loss_factor": -1.0}, "loss_factor: must be a finite number >= 0"),
    ({"load_factor": 1.0}, "frequency_response: the state is not an equilibrium")])
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        response(**arguments)


def test_what_a_response_says_and_draws() -> None:
    pytest.importorskip("matplotlib")
    scene = cantilever()
    compiled = fb.compile_scene(scene)
    beam = scene.beams[0]
    found = fb.frequency_response(compiled, F, load_factor=0.0, loads="tip", loss_factor=0.02, shapes=True,
                                  points={"tip": beam.end, "inside": (beam, 1.3)})
    assert str(found).startswith("response to load 'tip': 16 frequencies, 0.5 to 8 Hz") and "tip: at most" in str(found)
    assert "<pre" in found._repr_html_() and len(found) == 16
    np.testing.assert_array_equal(found.shape(3)[-1], found.point("tip")[3])
    assert np.isnan(found.spin("inside")).all() and np.isfinite(found.spin("tip")).all()
    assert np.max(found.residuals) < 1e-10 and np.max(found.uncertainty) < 1e-10
    peaks = found.peaks("tip")
    assert peaks and peaks[0][1] == max(np.linalg.norm(found.point("tip"), axis=1))
    assert len(fb.plot_response(found).axes) == 1 and len(fb.plot_response(found, component="z", log=False).axes) == 2
    with pytest.raises(fb.SceneError, match="there is no point 'top'; points: 'tip', 'inside'"):
        found.point("top")
    with pytest.raises(fb.SceneError, match="frequency 16 does not exist"):
        found.shape(16)
    with pytest.raises(fb.SceneError, match=r"use frequency_response\(shapes=True\)"):
        response().shape(0)
    with pytest.raises(fb.SceneError, match="the response has no points"):
        fb.plot_response(response())
    by_superlu = fb.frequency_response(compiled, F, load_factor=0.0, loads="tip", loss_factor=0.02, backend="superlu",
                                       points={"tip": beam.end})
    np.testing.assert_allclose(by_superlu.point("tip"), found.point("tip"), rtol=1e-9, atol=1e-15)
    assert by_superlu.info["solver"] == "SuperLU"


def test_undamped_resonance_and_free_motion_are_no_answers() -> None:
    with pytest.raises(fb.ConvergenceError, match="is the frequency of an undamped mode"):
        response(frequencies=fb.modes(model(), load_factor=0.0, n=1).frequencies)


def test_free_scenes_are_pushed_by_what_vibrates() -> None:
    """In flight: m w^2 at any frequency but zero."""
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    compiled = fb.compile_scene(fb.Scene(beam))
    push = fb.DistributedLoad("push", beam, force=(2.0, 0, 0))
    found = fb.frequency_response(compiled, [0.001], loads=push, points={"tip": beam.end})
    assert found.point("tip")[0, 0] == pytest.approx(-2.0 / (2e-3 * np.pi)**2, rel=1e-6)
    with pytest.raises(fb.SceneError, match="at frequency 0 the scene has no static equilibrium under the loads"):
        fb.frequency_response(compiled, [0.0], loads=push)
    with pytest.raises(fb.SceneError, match="but none in scene .* fixes a position"):
        fb.frequency_response(compiled, [1.0], base=(1, 0, 0))


def test_moving_air_and_moments_are_refused() -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    blown = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Drag("wind", beam, normal=1.0, air=(3, 0, 0))))
    for call in (lambda: fb.modes(blown, damped=True), lambda: fb.frequency_response(blown, [1.0], base=(1, 0, 0))):
        with pytest.raises(fb.SceneError, match="drag 'wind' on beam 'beam': its air moves"):
            call()
    turned = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("turn", beam.end, moment=(50.0, 20.0, 10.0))))
    rest = fb.solve_static(turned)
    undamped = fb.modes(turned, state=rest.state, n=3)
    found = fb.modes(turned, state=rest.state, damped=True, n=3)
    np.testing.assert_allclose(found.rates, 1j * undamped.angular + undamped.growth, rtol=1e-8)
    with pytest.raises(fb.SceneError, match="damping_ratio= needs a symmetric stiffness"):
        fb.frequency_response(turned, [1.0], state=rest.state, base=(1, 0, 0), damping_ratio=0.01)
    found = fb.frequency_response(turned, [1.0], state=rest.state, base=(0, 0, 1), loss_factor=0.01, points={"tip": beam.end})
    assert np.all(np.isfinite(found.point("tip")))


@pytest.mark.parametrize("name", ["simo_reissner", "green_lagrange"])
def test_derivatives_of_strains(name: str) -> None:
    """Against differences, at directors that interpolation has shortened."""
    draw = np.random.default_rng(4)
    x = np.concatenate(([[1.1, 0.05, -0.1]], np.eye(3) * 0.97 + 0.02 * draw.standard_normal((3, 3)),
                        0.3 * draw.standard_normal((3, 3))))

    def strains(y: Any) -> Any:
        return strains_of(name, y[0], y[1:4], y[4:])

    exact = strain_gradient(name, x[0], x[1:4], x[4:])
    for i in range(7):
        for c in range(3):
            step = np.zeros((7, 3))
            step[i, c] = 1e-6
            np.testing.assert_allclose(exact[:, i, c], (strains(x + step) - strains(x - step)) / 2e-6, atol=1e-9)


@pytest.mark.parametrize("name", ["simo_reissner", "green_lagrange"])
def test_stiffness_of_the_material_is_the_tangent_without_stress(name: str) -> None:
    """By another way than the kernels': in the reference there is nothing else."""
    from fastbeam.vibration.natural_modes import linearised_at
    arc = fb.Beam.arc("arc", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=2.0, angle=1.0, section=SECTION, elements=3, degree=3,
                      strain=name)
    about, _ = linearised_at("test", fb.compile_scene(fb.Scene(arc, fb.Clamp(arc.start))), None, 1.0, None, False, None, "auto")
    pencil, _ = about.assembled()
    assert abs(pencil.stiffness - about.material()).max() < 1e-12 * abs(pencil.stiffness).max()
    assert sparse.issparse(material_map(about.own, about.q))


def test_laws_of_forces_damp_by_their_derivative() -> None:
    def law(t: float, x: Any, d: Any, v: Any, spin: Any, p: Any, force: Any, moment: Any) -> None:
        for i in range(3):
            force[i] = -p[0] * x[i] - p[1] * v[i]
            moment[i] = -p[2] * spin[i]

    mass = fb.PointMass("mass", mass=0.5, position=(0, 0, 0))
    compiled = fb.compile_scene(fb.Scene(mass, fb.UserForce("spring", mass, law, parameters=(80.0, 3.0, 0.0))))
    found = fb.modes(compiled, damped=True, n=3)
    rates = np.roots([0.5, 3.0, 80.0])
    np.testing.assert_allclose(found.rates, rates[rates.imag > 0][0], rtol=1e-8)


def test_damped_modes_are_printed_and_drawn() -> None:
    pytest.importorskip("matplotlib")
    beam = fb.Beam.straight("beam", (0, 0, 0), (3, 0, 0), section=fb.Section(
        EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=600.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2, damping=0.05), elements=3,
        degree=2)
    found = fb.modes(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start))), n=4, damped=True)
    assert "damping ratio" in str(found) and "<pre" in found._repr_html_() and len(found) >= 4
    figure = fb.plot_modes(found, n=3)
    assert "ratio" in figure.axes[0].get_title()
    with pytest.raises(fb.SceneError, match="mode 99 does not exist"):
        found.state(99, 0.01)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"step": 0.0}, "step: must be a finite number > 0 s"), ({"backend": "mumps"}, "backend 'mumps' does not exist"),
    ({"observe": ("reaction",)}, "rows have no reactions"), ({"most_steps": 0}, "most_steps: must be a whole number >= 1")])
def test_what_relax_refuses(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.relax(model(), **arguments)
    rail, mass = straight("rail", (0, 0, 0), (3, 0, 0)), fb.PointMass("bead", mass=0.5)
    rubs = fb.Scene(rail, mass, fb.Slider("run", mass, rail, at=1.0, friction=0.2), fb.Clamp(rail.start))
    with pytest.raises(fb.SceneError, match="relax: slider 'run' has Coulomb friction"):
        fb.relax(fb.compile_scene(rubs))
