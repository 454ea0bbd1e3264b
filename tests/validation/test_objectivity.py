"""A rigid motion of a whole scene changes no strain: both strain sets, statics, and every method in time, with sliders."""
from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive import Twin, beam_strains  # noqa: E402

Array = np.ndarray
# of the largest strain, 0.14 at least: the last place of positions 2 to 4 m off the origin, 4e-16, times slopes over elements
# of 0.6 m, which add up to 20 per m, makes 6e-14; measured up to 9e-14
SAME = 3e-13
H = 0.02
# the contact force of the trapezoidal rule swings undamped and amplifies round-off: 8e-14 after 8 steps, 4e-13 after 15
STEPS = {"energy_momentum": 15, "midpoint": 15, "trapezoidal": 8, "generalized_alpha": 15}
METHODS: dict[str, dict[str, Any]] = {
    "energy_momentum": {}, "midpoint": {"method": "midpoint"}, "trapezoidal": {"method": "trapezoidal"},
    "generalized_alpha": {"method": fb.Method("generalized_alpha", rho_inf=0.7)}}


# ------------------------------------------------------------------------------------------------------------ moved scenes
@dataclass(frozen=True)
class MovedCurve:
    """A reference curve, turned and shifted."""

    curve: Any
    frame: Frame

    @property
    def length(self) -> float:
        """Arc length, m."""
        return float(self.curve.length)

    def reference(self, s: Array) -> tuple[Array, Array]:
        """Positions and triads."""
        phi, d = self.curve.reference(s)
        return self.frame.point(phi), self.frame.vector(d)


@dataclass(frozen=True)
class Frame:
    """Where a scene is placed: x -> turn x + shift, moving with `velocity`."""

    turn: Array
    shift: Array
    velocity: Array

    def vector(self, x: Any) -> Array:
        """Forces, velocities, spins, directors."""
        return np.asarray(x) @ self.turn.T

    def point(self, x: Any) -> Array:
        """Positions."""
        return self.vector(x) + self.shift

    def beam(self, beam: fb.Beam) -> fb.Beam:
        """The same beam elsewhere."""
        return replace(beam, curve=MovedCurve(beam.curve, self))


HOME = Frame(np.eye(3), np.zeros(3), np.zeros(3))


def away(seed: int) -> Frame:
    """A random rotation, a translation by about the size of the scenes and a velocity of a few of those of the scenes."""
    rng = np.random.default_rng(seed)
    return Frame(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-2.0, 2.0, 3), rng.uniform(-2.0, 2.0, 3))


def coupled() -> fb.Section:
    """Every strain pulls every stress."""
    a = np.random.default_rng(7).standard_normal((6, 6))
    return fb.Section.from_matrix(20.0 * (a @ a.T + 4.0 * np.eye(6)), rhoA=1.0, rhoI2=0.3, rhoI3=0.5)


SECTION = fb.Section(EA=200.0, GA2=150.0, GA3=130.0, GJ=50.0, EI2=60.0, EI3=70.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
SHAPES: dict[str, Callable[..., fb.Beam]] = {
    "straight": lambda **common: fb.Beam.straight("beam", (0, 0, 0), (2, 1, 0.5), twist=0.4, **common),
    "helix": lambda **common: fb.Beam.helix("beam", radius=1.0, pitch=0.5, turns=0.4, **common)}
FAMILIES: dict[str, dict[str, Any]] = {"lagrange": {"degree": 3}, "bspline": {"degree": 3, "interpolation": "bspline"}}


def mass_on_helix(frame: Frame) -> fb.Scene:
    """A mass runs along a helix that carries a straight rod, and the rod a body on a ball joint; all tumble."""
    helix = fb.Beam.helix("rail", radius=1.0, pitch=0.5, turns=0.4, section=coupled(), elements=4, degree=3)
    end = helix.reference(helix.length)[0][0]
    rail = frame.beam(helix)
    rod = frame.beam(fb.Beam.straight("rod", end, end + (0, 1, 1), section=SECTION, elements=2, degree=2, strain="green_lagrange",
                                      interpolation="bspline"))
    return _assembled(frame, rail, rod, end + (0, 1, 1), 0.4, "c1")


def mass_on_straight_rail(frame: Frame) -> fb.Scene:
    """The same with a straight rail of the other strain set, slid on its own curve, and a curved rod."""
    rail = frame.beam(fb.Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=SECTION, elements=5, degree=2,
                                       strain="green_lagrange"))
    arc = fb.Beam.arc("rod", (3, 0, 0), (0, 1, 0), (1, 0, 0), radius=0.8, angle=1.2, section=coupled(), elements=2, degree=3,
                      interpolation="bspline", directors="control")
    return _assembled(frame, rail, frame.beam(arc), arc.reference(arc.length)[0][0], 0.5, "own")


def _assembled(frame: Frame, rail: fb.Beam, rod: fb.Beam, tip: Array, at: float, curve: str) -> fb.Scene:
    body = fb.RigidBody("body", mass=1.0, inertia=[[1, 0.1, 0], [0.1, 1.2, 0], [0, 0, 0.9]],
                        position=frame.point(tip + (0.1, 0.2, 0.3)), directors=frame.vector(np.eye(3)))
    mass = fb.PointMass("mass", mass=0.5)
    motion = fb.RigidMotion([rail, rod, body], velocity=frame.velocity)
    tumble = fb.RigidMotion([rail, rod, body], spin=frame.vector((0.5, 1.0, 2.0)), about=frame.point((0.5, 0, 0)))
    return fb.Scene(rail, rod, body, mass, motion, tumble, fb.RigidConnection(rail.end, rod.start),
                    fb.BallJoint(rod.end, body.point((-0.1, -0.2, -0.3))),
                    fb.Slider("run", mass, rail, at=at * rail.length, rate=1.0, curve=curve),
                    fb.Load("pull", rail.start, force=frame.vector((5, -8, 3)), moment=frame.vector((3, 2, -4)),
                            time=lambda t: 1.0 + np.sin(5.0 * t)),
                    fb.DistributedLoad("wind", rod, force=frame.vector((0, 6, -3))), gravity=frame.vector((0, 3, -9.81)))


SCENES = {"mass on helix": mass_on_helix, "mass on straight rail": mass_on_straight_rail}


# ----------------------------------------------------------------------------------------------------------------- strains
def strains(scene: fb.Scene, model: Any, q: Array) -> Array:
    """Strains [n, 6] at the quadrature points of all beams, less those of the reference, from positions and directors."""
    twin = Twin(scene, model)
    out = []
    for beam in scene.beams:
        at, nodes = twin.of_beam(beam), beam.basis.element_nodes
        now = beam_strains(beam, q.reshape(-1, 4, 3)[at][nodes])
        out.append((now - beam_strains(beam, twin.reference[beam.name][nodes])).reshape(-1, 6))
    return np.concatenate(out)


def difference(a: Array, b: Array) -> float:
    """Largest difference of strains, relative to the largest strain."""
    return float(np.max(np.abs(a - b)) / np.max(np.abs(a)))


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
@pytest.mark.parametrize("shape", SHAPES)
def test_strains_of_a_loaded_beam_do_not_know_where_it_is(shape: str, strain: str, family: str, seed: int) -> None:
    found = []
    for frame in (HOME, away(seed)):
        beam = frame.beam(SHAPES[shape](section=coupled(), elements=4, strain=strain, **FAMILIES[family]))
        scene = fb.Scene(beam, fb.Clamp(beam.start), gravity=frame.vector((0, 2, -9.81)))
        scene.add(fb.Load("tip", beam.end, force=frame.vector((4, -6, 12)), moment=frame.vector((2, 4, -2))))
        model = fb.compile_scene(scene)
        found.append(strains(scene, model, fb.solve_static(model).state.q))
    assert np.max(np.abs(found[0])) > 0.1
    assert difference(*found) <= SAME


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("place", SCENES)
def test_strains_of_a_motion_do_not_know_where_it_is_nor_how_fast_it_goes(place: str, name: str, seed: int) -> None:
    found, slid, force = [], [], []
    for frame in (HOME, away(seed)):
        scene = SCENES[place](frame)
        model = fb.compile_scene(scene)
        result = fb.simulate(model, t_end=STEPS[name] * H, step=H, progress=False, **METHODS[name])
        # long elements of a helix
        assert {event["kind"] for event in result.events} <= {"contact"}
        found.append(strains(scene, model, result.state.q))
        slid.append(result.slider("run")["s"][-1])
        force.append(frame.turn.T @ result.slider("run")["force"][-1])
    assert np.max(np.abs(found[0])) > 0.1 and abs(slid[0] - SCENES[place](HOME).sliders[0].at) > 0.1
    assert difference(*found) <= SAME
    assert abs(slid[1] - slid[0]) <= SAME
    # a force is a difference of velocities over a step
    np.testing.assert_allclose(force[1], force[0], rtol=0.0, atol=1e-9 * np.linalg.norm(force[0]))


def test_strains_of_a_rigid_motion_of_the_nodes_are_zero() -> None:
    for shape in SHAPES:
        for strain in ("simo_reissner", "green_lagrange"):
            for family in FAMILIES.values():
                beam = SHAPES[shape](section=SECTION, elements=4, strain=strain, **family)
                scene = fb.Scene(beam)
                model = fb.compile_scene(scene)
                frame, q = away(3), model.q0.reshape(-1, 4, 3)
                moved = np.concatenate((frame.point(q[:, :1]), frame.vector(q[:, 1:])), axis=1)
                assert np.max(np.abs(strains(scene, model, moved))) <= 1e-13
