"""Free flight with sliding contact: energy, momenta and gap over 1000 steps, method.md 4.3 and 5.1."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Array, Row

LENGTH, ELEMENTS = 10.0, 16
# 1000 steps in which the contact crosses nine elements or more
STEP, STEPS = 0.004, 1000
DRIFT, GAP = 1e-11, 1e-12
NAMES = {"total": "energy", "lin_mom": "linear momentum", "ang_mom": "angular momentum"}
OFFSET = np.array((0.1, -0.2, 0.3))


def section() -> fb.Section:
    """Section of the flying beams: bends by more than its length within the run."""
    return fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=500.0, rhoA=1.0, rhoI2=10.0, rhoI3=10.0)


def velocity(s: Array) -> Array:
    """Initial velocity [n, 3] of the flying beam, m/s."""
    return np.stack((0.0 * s, np.sin(0.6 * s), 0.5 * np.cos(0.4 * s)), axis=1)


def spin(s: Array) -> Array:
    """Initial angular velocity [n, 3] of the flying beam, rad/s."""
    return np.stack((0.0 * s + 0.2, 0.2 * np.sin(0.4 * s), 0.6 * np.cos(0.6 * s)), axis=1)


def rail(**family: Any) -> tuple[fb.Beam, fb.InitialVelocity]:
    """The beam that is slid on, with its initial velocity."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (LENGTH, 0, 0), section=section(), elements=ELEMENTS, **family)
    return beam, fb.InitialVelocity(beam, velocity=velocity, spin=spin)


def mass_scene(curve: str = "own", **family: Any) -> fb.Scene:
    """A point mass slides along the flying beam."""
    beam, start = rail(**family)
    mass = fb.PointMass("mass", mass=3.0)
    return fb.Scene(beam, start, mass, fb.Slider("contact", mass, beam, at=2.0, rate=1.5, curve=curve))


def body_scene(curve: str = "own", **family: Any) -> fb.Scene:
    """A rigid body slides with a point off its centre."""
    beam, start = rail(**family)
    turn = np.array((0.3, -0.4, 0.5))
    move = np.array((1.5, 0.0, 0.0)) + velocity(np.array([2.0]))[0] - np.cross(turn, OFFSET)
    body = fb.RigidBody("body", mass=3.0, inertia=(0.3, 0.4, 0.5), position=np.array((2.0, 0.0, 0.0)) - OFFSET, velocity=move,
                        spin=turn)
    # the interpolated velocity field misses its own values between nodes by a little
    return fb.Scene(beam, start, body, fb.Slider("contact", body.point(OFFSET), beam, at=2.0, rate=1.5, curve=curve),
                    project_velocities=True)


def beam_scene(curve: str = "own", **family: Any) -> fb.Scene:
    """The end node of a second beam slides along the flying beam."""
    beam, start = rail(**family)
    pole = fb.Beam.straight("pole", (2, 0, 0), (2, 0, 3), section=section(), elements=4, **family)
    move = np.array((1.5, 0.0, 0.0)) + velocity(np.array([2.0]))[0]
    return fb.Scene(beam, start, pole, fb.RigidMotion(pole, velocity=move),
                    fb.Slider("contact", pole.start, beam, at=2.0, rate=1.5, curve=curve), project_velocities=True)


def fly(scene: fb.Scene, order: int, steps: int = STEPS) -> tuple[fb.Result, int]:
    """Run the flight; also the number of elements the contact passed."""
    result = fb.simulate(fb.compile_scene(scene), t_end=steps * STEP, step=STEP, order=order, every=5,
                         output=fb.Output(snapshots=0),
                         progress=False)
    s = result.slider("contact")["s"]
    first, last = (int(np.floor(x * ELEMENTS / LENGTH)) for x in (s.min(), s.max()))
    return result, last - first


def _check(what: str, make: Callable[..., fb.Scene], quick: bool) -> list[Row]:
    """Worst drift over interpolations, strain sets and curves, for each order."""
    cases: list[dict[str, Any]] = [{"interpolation": i, "degree": 3, "strain": strain}
                                   for i in ("lagrange", "bspline") for strain in ("simo_reissner", "green_lagrange")]
    if not quick:
        cases += [{"interpolation": "lagrange", "degree": 2, "strain": "simo_reissner", "curve": "c1"},
                  {"interpolation": "bspline", "degree": 2, "directors": "control", "strain": "green_lagrange"}]
    rows = []
    for order in (2, 4):
        runs = [fly(make(**case), order, 250 if quick else STEPS) for case in cases]
        rows += [Row(f"{what}, order {order}: drift of {NAMES[key]}, worst of {len(runs)} discretisations",
                     max(result.drift(key) for result, _ in runs), at_most=DRIFT) for key in NAMES]
        gap = max(float(np.max(np.abs(result.series["gap"]))) for result, _ in runs) / LENGTH
        rows.append(Row(f"{what}, order {order}: gap / L", gap, at_most=GAP))
        if not quick:
            rows.append(Row(f"{what}, order {order}: elements passed, fewest", min(passed for _, passed in runs), at_least=8))
            rows.append(Row(f"{what}, order {order}: steps, fewest", min(result.info["steps"] for result, _ in runs),
                            at_least=STEPS))
    return rows


def check_mass_slider(quick: bool = False) -> list[Row]:
    """A point mass slides on a free beam."""
    return _check("point mass on a free beam", mass_scene, quick)


def check_body_slider(quick: bool = False) -> list[Row]:
    """A rigid body slides with a point off its centre."""
    return _check("rigid body on a free beam", body_scene, quick)


def check_beam_slider(quick: bool = False) -> list[Row]:
    """A node of one beam slides on another."""
    return _check("beam node on a free beam", beam_scene, quick)
