"""Sliding masses against independent programs: a heavy ring on a cable, a cantilever and a free beam, method.md 5."""
from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Array, Row, distance, orders, reference

QUIET = {"output": fb.Output(snapshots=0), "progress": False}
# elements, degree and step of the ring on a cable
FINE = (64, 3, 2.5e-4)
# (name, slider curve, interpolation, degree)
FAMILIES = [("lagrange 2, own curve", "own", "lagrange", 2), ("lagrange 2, C1 curve", "c1", "lagrange", 2),
            ("lagrange 3, own curve", "own", "lagrange", 3), ("lagrange 3, C1 curve", "c1", "lagrange", 3),
            ("bspline 3", "own", "bspline", 3)]


# ------------------------------------------------------------------------------------------------------- ring on a cable
def ring_on_cable(elements: int, degree: int, step: float, *, EA_factor: float = 1.0, GA_factor: float = 1.0,
                  inertia_factor: float = 1.0, curve: str = "c1") -> tuple[float, float]:
    """Largest deviation in s and in any coordinate of ring and tip, m, over the rows of the reference."""
    data = reference("ring_on_cable")
    h, w, length = data["height"], data["width"], data["length"]
    E, rho, area, second = data["E"], data["rho"], h * w, w * h**3 / 12.0
    G = E / (2.0 * (1.0 + data["nu"]))
    GA = GA_factor * data["shear_factor"] * G * area
    section = fb.Section(EA=EA_factor * E * area, GA2=GA, GA3=GA, GJ=E * second, EI2=E * second, EI3=E * second, rhoA=rho * area,
                         rhoI2=inertia_factor * rho * second, rhoI3=inertia_factor * rho * second)
    cable = fb.Beam.straight("cable", (0, 0, 0), (length, 0, 0), section=section, elements=elements, degree=degree)
    ring = fb.PointMass("ring", mass=data["mass"])
    model = fb.compile_scene(fb.Scene(cable, ring, fb.Clamp(cable.start),
                                      fb.Slider("contact", ring, cable, at=data["s0"], curve=curve), gravity=data["gravity"]))
    rows = data["rows"]
    result = fb.simulate(model, t_end=rows[-1, 0], step=step, every=round(rows[0, 0] / step),
                         points={"ring": ring, "tip": cable.end}, **QUIET)
    s = result.slider("contact")["s"]
    measured = np.column_stack((s, result.point("ring")[:, :2], result.point("tip")[:, :2]))[1:]
    off = np.abs(measured - rows[:, 1:])
    return float(off[:, 0].max()), float(off[:, 1:].max())


def check_ring_on_cable(quick: bool = False) -> list[Row]:
    """The reference has neither shear nor rotary inertia: `study_ring_models` shows what of the difference that makes."""
    bar = 2e-4
    if quick:
        in_s, in_x = ring_on_cable(32, 2, 1e-3)
        return [Row("ring on a cable, 32 elements of degree 2, step 1e-3 s: s (m)", in_s, at_most=bar),
                Row("ring on a cable, 32 elements of degree 2, step 1e-3 s: ring and tip (m)", in_x, at_most=bar)]
    return _rings([("32 elements of degree 2, step 1e-3 s", (32, 2, 1e-3), {}),
                   ("32 elements of degree 2, step 2.5e-4 s", (32, 2, 2.5e-4), {}),
                   ("64 elements of degree 3, step 2.5e-4 s, own curve", FINE, {"curve": "own"}),
                   ("64 elements of degree 3, step 2.5e-4 s", FINE, {})], bar)


def study_ring_models(quick: bool = False) -> list[Row]:
    """What shear and rotary inertia, which the reference does not have, make of the difference to it."""
    cases: list[tuple[str, tuple[int, int, float], dict[str, Any]]] = []
    if quick:
        return []
    for factor in (1e2, 1e4):
        cases.append((f"GA x {factor:.0e}", FINE, {"GA_factor": factor}))
        cases.append((f"GA and EA x {factor:.0e}", FINE, {"GA_factor": factor, "EA_factor": factor}))
    cases.append(("GA x 1e+04, rotary inertia / 100", FINE, {"GA_factor": 1e4, "inertia_factor": 0.01}))
    return _rings([(f"64 elements of degree 3, step 2.5e-4 s, {name}", *of) for name, *of in cases], None)


def _rings(cases: Sequence[tuple[str, tuple[int, int, float], dict[str, Any]]], limit: float | None) -> list[Row]:
    """Two rows of each case: mesh and step, and what differs."""
    rows = []
    for name, mesh, changes in cases:
        in_s, in_x = ring_on_cable(*mesh, **changes)
        rows += [Row(f"ring on a cable, {name}: s (m)", in_s, at_most=limit),
                 Row(f"ring on a cable, {name}: ring and tip (m)", in_x, at_most=limit)]
    return rows


# ------------------------------------------------------------------------------------------- particle on beams of a spectral code
def smoothstep(x: float) -> float:
    """Smoothstep of order 9 from 0 to 1."""
    x = min(max(x, 0.0), 1.0)
    return x**5 * (126.0 - 420.0 * x + 540.0 * x**2 - 315.0 * x**3 + 70.0 * x**4)


def pulse(t: float) -> float:
    """sin^8(pi t / 2) until t = 2 s."""
    return math.sin(0.5 * math.pi * t) ** 8 if t < 2.0 else 0.0


def held_scene(elements: int, curve: str, **family: Any) -> tuple[fb.Scene, fb.PointMass]:
    """Particle on a cantilever under gravity that rises smoothly."""
    section = fb.Section(EA=2e4, GA2=1e4, GA3=1e4, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=1.0, rhoI2=0.5, rhoI3=0.5)
    beam = fb.Beam.straight("beam", (0, 0, 0), (10, 0, 0), section=section, elements=elements, **family)
    mass = fb.PointMass("particle", mass=2.0)
    return fb.Scene(beam, mass, fb.Clamp(beam.start), fb.Slider("contact", mass, beam, at=3.0, curve=curve), gravity=(0, -1, 0),
                    gravity_time=lambda t: smoothstep(0.5 * t)), mass


def free_scene(elements: int, curve: str, **family: Any) -> tuple[fb.Scene, fb.PointMass]:
    """Particle gliding on a free beam that is pushed at its end."""
    section = fb.Section(EA=2e3, GA2=1e3, GA3=1e3, GJ=1e2, EI2=1e2, EI3=1e2, rhoA=1.0, rhoI2=0.5, rhoI3=0.5)
    beam = fb.Beam.straight("beam", (0, 0, 0), (10, 0, 0), section=section, elements=elements, **family)
    mass = fb.PointMass("particle", mass=2.0)
    return fb.Scene(beam, mass, fb.Slider("contact", mass, beam, at=2.0, rate=1.5, curve=curve),
                    fb.Load("push", beam.end, force=(0, 6, 0), time=pulse)), mass


def path(make: Callable[..., tuple[fb.Scene, fb.PointMass]], data: Array, elements: int, curve: str, interpolation: str,
         degree: int, step: float, order: int) -> Array:
    """s, x, y [n, 3] of the particle at the times of the reference."""
    scene, mass = make(elements, curve, interpolation=interpolation, degree=degree)
    result = fb.simulate(fb.compile_scene(scene), t_end=data[-1, 0], step=step, order=order, every=round(data[1, 0] / step),
                         points={"particle": mass}, **QUIET)
    return np.column_stack((result.slider("contact")["s"], result.point("particle")[:, :2]))


def error(path_of_run: Array, data: Array) -> float:
    """Largest deviation in s and of the particle over the length of the beam."""
    return max(distance(path_of_run[:, :1], data[:, 1:2]), distance(path_of_run[:, 1:], data[:, 2:])) / 10.0


def _particle(name: str, make: Callable[..., tuple[fb.Scene, fb.PointMass]], file: str, quick: bool,
              inner: tuple[int, ...] = ()) -> list[Row]:
    """Errors at 10 to 80 elements, their rate, and the rate in the step; `inner`: meshes where the contact starts mid-element."""
    data = reference(file)["rows"]
    if quick:
        return [Row(f"{name}, {text}, 20 elements: s and particle / L",
                    error(path(make, data, 20, curve, kind, degree, 0.025, 4), data), at_most=1e-4)
                for text, curve, kind, degree in FAMILIES[1:4]]
    rows = []
    for text, curve, kind, degree in FAMILIES:
        what = f"{name}, {text}"
        meshes = {n: error(path(make, data, n, curve, kind, degree, 0.0125, 4), data) for n in (10, 20, 40, 80)}
        rows += [Row(f"{what}, {n} elements: s and particle / L", e, at_most=1e-4 if n == 40 else None)
                 for n, e in meshes.items()]
        # the contact force kinks the exact line inside an element: the rate in the mesh is that of the kink, method.md 5.2
        rows.append(Row(f"{what}: mean rate in the mesh, 10 to 40 elements", float(orders([meshes[10], meshes[40]], 4.0)[0]),
                        at_least=0.0))
        for n in inner:
            rows.append(Row(f"{what}, {n} elements, start mid-element: s and particle / L",
                            error(path(make, data, n, curve, kind, degree, 0.0125, 4), data), at_most=1e-4))
        steps = [path(make, data, 40, curve, kind, degree, h, 2) for h in (0.0125, 0.00625, 0.003125)]
        rows.append(Row(f"{what}: rate in the step, order 2, from three runs",
                        float(orders([distance(steps[0], steps[1]), distance(steps[1], steps[2])])[0]), at_least=1.7))
    return rows


def check_slide_cantilever(quick: bool = False) -> list[Row]:
    """Particle released on a cantilever: first at an element end (10, 20, 40, 80 elements) or mid-element (15, 25, 35)."""
    return _particle("particle on a cantilever", held_scene, "slide_cantilever", quick, (15, 25, 35))


def check_slide_isolated(quick: bool = False) -> list[Row]:
    """Particle gliding on a free beam; isolated after 2 s."""
    return _particle("particle on a free beam", free_scene, "slide_isolated", quick)
