"""Newton converges quadratically, as it does with the exact tangent alone; entry by entry: tests/kernels."""
from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

import fastbeam as fb
from fastbeam.stepping.stepper import Stepper

from .equilibria import plain
from .invariants import mass_scene
from .rows import Row

# increments below this hold round-off of the linear solve
FLOOR = 1e-13
# s; the contact crosses more than one element
HARD = 0.3


def step_increments(scene: fb.Scene, h: float) -> list[float]:
    """Sizes of the Newton increments of one step of size h."""
    outcome = Stepper(fb.compile_scene(scene), np.ones(1)).advance(0.0, h, 1)
    return [float(x) for x in outcome.sizes[:outcome.iterations]]


def static_increments(scene: fb.Scene) -> list[float]:
    """Sizes of the Newton increments under the full load at once; found by forbidding the last iteration."""
    model = fb.compile_scene(scene)
    needed = int(fb.solve_static(model, load_step=1.0, smallest_step=1.0, max_iterations=40).info["iterations"])
    try:
        fb.solve_static(model, load_step=1.0, smallest_step=1.0, max_iterations=needed - 1)
    except fb.ConvergenceError as error:
        return list(error.residuals)
    return []


def exponent(sizes: Sequence[float]) -> float:
    """Mean of the last two exponents log(e3/e2) / log(e2/e1) of increments above round-off; NaN for fewer than three increments.
    One exponent alone scatters with the constant of the convergence, which differs between positions, spins and s."""
    clean = [x for x in sizes if x > FLOOR]
    found = [math.log(c / b) / math.log(b / a) for a, b, c in zip(clean, clean[1:], clean[2:])]
    return sum(found[-2:]) / len(found[-2:]) if found else math.nan


def fast_scene(kind: str, curve: str = "own", **family: Any) -> fb.Scene:
    """A heavy slider rushes along a soft curved beam at rest: the coupling, not the flight of the beam, makes the step hard."""
    rail = fb.Beam.helix("rail", radius=2.0, pitch=1.0, turns=0.7, section=plain(400.0, 300.0, 40.0, 40.0), elements=8, **family)
    at = float(rail.node_s[7])
    phi, d = rail.reference([at])
    along = 8.0 * d[0, 0]
    if kind == "mass":
        point: Any = fb.PointMass("mass", mass=5.0)
        parts: list[Any] = [point]
    elif kind == "body":
        offset = np.array((0.2, -0.3, 0.4))
        spin = np.array((1.0, 2.0, -1.0))
        body = fb.RigidBody("body", mass=5.0, inertia=(1.0, 1.2, 1.5), position=phi[0] - offset,
                            velocity=along - np.cross(spin, offset), spin=spin)
        point, parts = body.point(offset), [body]
    else:
        pole = fb.Beam.straight("pole", phi[0], phi[0] + (0.0, 0.5, 2.0), section=plain(400.0, 300.0, 40.0, 40.0), elements=2,
                                **family)
        point, parts = pole.start, [pole, fb.RigidMotion(pole, velocity=along)]
    return fb.Scene(rail, *parts, fb.Slider("contact", point, rail, at=at, rate=8.0, curve=curve), project_velocities=True)


def cases(quick: bool) -> dict[str, list[float]]:
    """Increments of hard steps that together pass through every tangent: name -> sizes."""
    out: dict[str, list[float]] = {}
    for strain in ("simo_reissner", "green_lagrange"):
        out[f"flying beam, {strain}"] = step_increments(mass_scene(degree=3, strain=strain), 0.3)
        for kind in ("mass", "body", "beam node"):
            out[f"{kind} on curved beam, {strain}"] = step_increments(fast_scene(kind, degree=3, strain=strain), HARD)
    curves: dict[str, dict[str, Any]] = {"C1 curve": {"degree": 3, "curve": "c1"},
                                         "spline, directors at Greville points": {"interpolation": "bspline", "degree": 3},
                                         "spline, directors at control points": {"interpolation": "bspline", "degree": 2,
                                                                                 "directors": "control"}}
    for name, family in curves.items():
        out[f"mass on {name}"] = step_increments(fast_scene("mass", **family), HARD)
    if quick:
        return out
    for strain in ("simo_reissner", "green_lagrange"):
        beam = fb.Beam.arc("bend", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=10.0, angle=math.pi / 4,
                           section=plain(1e3, 5e2, 80.0, 80.0), elements=8, strain=strain)
        load = fb.Load("tip", beam.end, force=(0.0, 0.0, 1.0), moment=(2.0, 1.0, 3.0))
        out[f"statics with end moment, {strain}"] = static_increments(fb.Scene(beam, fb.Clamp(beam.start), load))
    return out


def check_newton(quick: bool = False) -> list[Row]:
    """One hard step of every kind: the exponent of the last increments, 2 for an exact tangent; the increments are shown."""
    rows = []
    for name, sizes in cases(quick).items():
        shown = " ".join(f"{x:.0e}" for x in sizes)
        rows.append(Row(f"Newton, {name}: exponent ({shown})", exponent(sizes), at_least=1.7))
    return rows
