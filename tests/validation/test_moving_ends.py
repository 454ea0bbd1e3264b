"""Contacts that run up to the ends of beams whose elements move with them (theory.md (5.24))."""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on

import fastbeam as fb

LENGTH, EI, PUSH = 2.0, 20.0, 1e-2
SLENDER = fb.Section(EA=2e6, GA2=1e7, GA3=1e7, GJ=10.0, EI2=EI, EI3=EI, rhoA=0.6, rhoI2=1e-5, rhoI3=1e-5)
SOFT = fb.Section(EA=4e4, GA2=2e4, GA3=1e4, GJ=3.0, EI2=5.0, EI3=8.0, rhoA=1.0, rhoI2=2e-3, rhoI3=3e-3)


def rider(at: float, rate: float = 0.0, elements: int = 8, mass: float = 0.5, section: fb.Section = SLENDER,
          gravity: float = -9.81, **options: Any) -> fb.Scene:
    """A mass that slides along a clamped beam."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (LENGTH, 0, 0), section=section, elements=elements)
    bead = fb.PointMass("bead", mass=mass, position=(at, 0, 0))
    return fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end),
                    fb.Slider("run", bead, beam, at=at, **{} if "drive" in options else {"rate": rate}, **options),
                    gravity=(0, 0, gravity))


def moving(scene: fb.Scene, **options: Any) -> fb.Model:
    return fb.compile_scene(fb.with_moving_meshes(scene), **options)


def run(model: fb.Model, t_end: float = 0.3, step: float = 2e-3, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, **options)


@pytest.mark.parametrize(("at", "most"), [(0.01, 0.05), (0.03, 3e-4), (0.08, 5e-5), (0.13, 2e-6), (1.9, 1e-5), (1.985, 1e-3)])
def test_deflection_under_a_force(at: float, most: float) -> None:
    """P a^3 b^3/(3 EI L^3) for a clamped beam that hardly shears."""
    exact = -PUSH * (at * (LENGTH - at))**3 / (3.0 * EI * LENGTH**3)
    off = []
    for make in (moving, fb.compile_scene):
        scene = rider(at, gravity=0.0, section=replace(SLENDER, GA2=1e10, GA3=1e10))
        scene.add(fb.Load("push", scene.masses[0], force=(0, 0, -PUSH)))
        rest = fb.solve_static(make(scene), held=True)
        off.append(abs(rest.slider("run")["position"][-1, 2] / exact - 1.0))
    print(f"at {at} m: off by {off[0]:.1e}, on elements that stand {off[1]:.1e}")
    assert off[0] < most and off[0] < 0.01 * off[1]


@pytest.mark.parametrize(("at", "rate", "planar"), [(0.0, 1.2, True), (0.02, 1.2, False), (0.3, -1.0, True), (1.9, -1.2, False)])
def test_a_run_is_that_on_a_fine_mesh(at: float, rate: float, planar: bool) -> None:
    result = run(moving(rider(at, rate), planar=planar))
    fine = run(fb.compile_scene(rider(at, rate, elements=64), planar=planar), t_end=float(result.t[-1]))
    assert result.drift("total") < 1e-12
    here, there = result.slider("run"), fine.slider("run")
    assert np.ptp(here["s"]) > 0.25
    np.testing.assert_allclose(here["s"], there["s"], rtol=0, atol=1e-5)
    np.testing.assert_allclose(here["position"], there["position"], rtol=0, atol=1e-4)
    # three iterations, as away from the ends
    assert result.info["iterations"] < 3.2 * (len(result.t) - 1)


def test_friction_up_to_the_end() -> None:
    result = run(moving(rider(0.5, -1.4, friction=0.1)), t_end=0.4)
    fine = run(fb.compile_scene(rider(0.5, -1.4, elements=64, friction=0.1)), t_end=0.4)
    assert result.drift("balance") < 1e-12
    s = result.slider("run")["s"][-1]
    assert 0.0 < s < 0.06 and s == pytest.approx(fine.slider("run")["s"][-1], abs=1e-4)


def test_a_drive_from_one_end_to_the_other() -> None:
    result = run(moving(rider(0.0, drive=fb.Drive(position=lambda t: LENGTH * np.sin(np.pi * t / 0.8)**2))), t_end=0.8)
    s = result.slider("run")["s"]
    assert s[0] == 0.0 and s[200] == pytest.approx(LENGTH, abs=1e-12) and abs(s[-1]) < 1e-12
    assert result.drift("balance") < 1e-12


@pytest.mark.parametrize("at", [0.03, 1.9])
def test_momenta_of_free_flight(at: float) -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (LENGTH, 0, 0), d2=(0, 0, 1), section=SOFT, elements=8)
    bead = fb.PointMass("bead", mass=0.5, position=(at, 0, 0))
    scene = fb.Scene(rod, bead, fb.Slider("run", bead, rod, at=at, rate=0.8 if at < 1.0 else -0.8),
                     fb.RigidMotion(spin=(0.3, 1.0, 0.4)), project_velocities=True)
    result = run(moving(scene))
    assert np.ptp(result.slider("run")["s"]) > 0.1
    assert max(result.drift(x) for x in ("total", "lin_mom", "ang_mom")) < 1e-13


def test_a_sleeve_that_comes_off_at_the_end() -> None:
    def result_of(elements: int, moves: bool) -> fb.Result:
        rod = fb.Beam.straight("rod", (0, 0, 0), (LENGTH, 0, 0), d2=(0, 0, 1), section=SOFT, elements=elements)
        body = fb.RigidBody("body", mass=3.0, inertia=np.diag((0.3, 0.3, 0.4)), position=(0.06, 0, 0), spin=(0, 0, 1.5),
                            velocity=(0.3, 0, 0))
        scene = fb.Scene(rod, body, fb.Sleeve("run", body, rod, at=0.06, length=0.0, rate=0.3),
                         fb.RigidMotion(spin=(0, 0, 1.5)), project_velocities=True)
        return run((moving if moves else fb.compile_scene)(scene), t_end=0.6)

    result, fine = result_of(8, True), result_of(64, False)
    event = result.events[-1]
    assert event["kind"] == "slider_end" and event["end"] == "start"
    assert result.t[-1] == pytest.approx(fine.t[-1], rel=1e-5)
    assert max(result.drift(x) for x in ("total", "lin_mom", "ang_mom")) < 1e-13


def test_a_run_goes_on_beside_the_end_bit_for_bit(tmp_path: Path) -> None:
    model, settings = moving(rider(0.02, 1.2)), {"t_end": 0.06, "step": 2e-3, "progress": False}
    assert_goes_on(model, fb.simulate(model, **settings), 12, tmp_path / "half", settings)


@pytest.mark.parametrize(("at", "stiffness", "length"), [(1.9, 300.0, 0.05), (1.98, 5000.0, 0.015)])
def test_place_of_rest_and_frequencies_beside_the_end(at: float, stiffness: float, length: float) -> None:
    """A ring on an inclined beam that hangs on a spring from its upper end."""
    found = []
    for elements, moves in ((16, True), (256, False)):
        beam = fb.Beam.straight("rail", (0, 0, 0), (1.9, 0, 0.6), section=SLENDER, elements=elements)
        ring = fb.PointMass("ring", mass=2.0, position=tuple(at / beam.length * np.array((1.9, 0, 0.6))))
        scene = fb.Scene(beam, ring, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Slider("run", ring, beam, at=at),
                         fb.Spring(ring, beam.end, stiffness=stiffness, length=length), gravity=(0, 0, -9.81))
        model = (moving if moves else fb.compile_scene)(scene, planar=True)
        rest = fb.solve_static(model)
        found.append((rest.slider("run")["s"][-1], fb.modes(model, state=rest.state, n=3, planar=True).frequencies[:3]))
    (s, own), (fine, there) = found
    assert s > LENGTH - 0.3 * LENGTH / 8 or at < 1.95
    assert s == pytest.approx(fine, abs=3e-6)
    # elements that stand are off by some 1e-4 on any mesh, where a contact is inside one
    np.testing.assert_allclose(own, there, rtol=6e-4)


@pytest.mark.parametrize("kind", ["slider", "sleeve"])
def test_unequal_elements_up_to_the_end(kind: str) -> None:
    """On a stiff rail whose elements a user has distributed a body goes on as it began, and is where s says."""
    section = fb.Section.circle(radius=0.05, E=2e11, rho=2e3)
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=section, elements=[0, 0.5, 1, 2, 3, 4], degree=3)
    body = fb.RigidBody("body", mass=0.5, position=(1, 0, 0), inertia=(1, 1, 1))
    run = (fb.Slider("run", body, rail, at=1.0, rate=2.0) if kind == "slider" else
           fb.Sleeve("run", body, rail, at=1.0, rate=2.0, length=0.0))
    scene = fb.Scene(rail, body, fb.RigidMotion(body, velocity=(2, 0, 0)), fb.Clamp(rail.start), fb.Clamp(rail.end), run,
                     fb.MovingMesh(rail, run))
    result = fb.simulate(fb.compile_scene(scene), t_end=1.49, step=5e-3, progress=False)
    found = result.slider("run")
    np.testing.assert_allclose(found["s"], 1.0 + 2.0 * result.t, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found["position"][:, 0], found["s"], rtol=0.0, atol=1e-7)
