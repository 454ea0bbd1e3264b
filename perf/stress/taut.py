"""Taut thin ropes with few elements: stability, frequencies, and machines whose answers are known without fastbeam.

Invariants say nothing here: a rope whose elements lose their shape keeps energy and momenta to round-off and lets its load fall.
"""
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import eigh

import fastbeam as fb
from matrices import matrices
from table import Row

Array = np.ndarray
G = 9.81
FAMILIES = {**{f"lagrange {p}": {"degree": p} for p in range(1, 9)},
            **{f"bspline {p}": {"degree": p, "interpolation": "bspline"} for p in range(2, 6)}}
TENSIONS = 10.0**np.arange(-2, 9)
QUIET: dict[str, Any] = {"progress": False, "snapshots": 0}


def wire(tension: float, EI: float = 1.0) -> fb.Section:
    """A section of unit mass per length, stretched by at most 1e-4, without noticeable rotary inertia."""
    EA = max(1e6, 1e4 * tension)
    return fb.Section(EA=EA, GA2=EA / 2.6, GA3=EA / 2.6, GJ=0.77 * EI, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=1e-9, rhoI3=1e-9)


def stretched(tension: float, elements: int, sideways: float = 0.0, **family: Any) -> tuple[fb.Model, fb.Result]:
    """A rope of length 1 along x, EI = 1, clamped at its start, under `tension` and a force sideways at its end."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (1, 0, 0), section=wire(tension), elements=elements, **family)
    scene = fb.Scene(rope, fb.Clamp(rope.start), fb.Load("pull", rope.end, force=(tension, sideways, 0)))
    model = fb.compile_scene(scene, solver="sparse", eliminate_inner=False, planar=False)
    return model, fb.solve_static(model)


def unstable_directions(elements: int, **family: Any) -> list[int]:
    """Negative eigenvalues of the tangent of a straight and of a slightly bent rope, all TENSIONS: there are none."""
    return [int(stretched(n, elements, sideways, **family)[1].info["unstable_directions"])
            for n in TENSIONS for sideways in (0.0, 1e-3 * n)]


def frequency_errors(tension: float, elements: int, count: int = 3, **family: Any) -> Array:
    """First frequencies of a rope between pins, relative to sqrt((N k^2/r + EI k^4)/rhoA), k = n pi/L, r the stretch."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (1, 0, 0), section=wire(tension), elements=elements, **family)
    pinned = fb.compile_scene(fb.Scene(rope, fb.Pin(rope.start), fb.Pin(rope.end)), solver="sparse", eliminate_inner=False,
                              planar=False)
    stiffness, mass, component = matrices(pinned, stretched(tension, elements, **family)[1].state)
    plane = np.flatnonzero((component == 1) | (component == 5))
    squares = eigh(stiffness[np.ix_(plane, plane)], mass[np.ix_(plane, plane)], eigvals_only=True)[:count]
    k = np.pi * np.arange(1, count + 1)
    return np.sqrt(np.maximum(squares, 0.0) / (tension * k**2 / (1.0 + tension / wire(tension).EA) + k**4)) - 1.0


def final(scene: fb.Scene, t_end: float, step: float, points: dict[str, Any], **options: Any) -> tuple[fb.Result, str]:
    """Of a run, or of what it reached before it failed, with the message."""
    try:
        return fb.simulate(fb.compile_scene(scene), t_end=t_end, step=step, points=points, **{**QUIET, **options}), ""
    except fb.ConvergenceError as failed:
        return failed.result, str(failed)


# ------------------------------------------------------------------------------------------------------------------- machines
def hanging_load(elements: int = 6, mass: float = 1000.0, radius: float = 0.008, E: float = 1e10, push: float = 0.01,
                 **family: Any) -> fb.Scene:
    """A load on a rope of 6 m, let go where the rope is slack and pushed sideways (m/s)."""
    section = fb.Section.circle(radius=radius, E=E, rho=5000.0)
    rope = fb.Beam.straight("rope", (0, 0, 0), (0, 0, -6), section=section, elements=elements, **family)
    load = fb.PointMass("load", mass=mass, position=(0, 0, -6), velocity=(push, 0, 0))
    return fb.Scene(rope, load, fb.Pin(rope.start), fb.BallJoint(load, rope.end), gravity=(0, 0, -G), name="hanging load",
                    project_velocities=True)


def lowest_by_energy(mass: float = 1000.0, EA: float = 1e10 * np.pi * 0.008**2, rhoA: float = 5000.0 * np.pi * 0.008**2) -> float:
    """How deep the load falls below the end of the slack rope: a mass on a spring whose own mass counts a half in weight."""
    return 2.0 * G * (mass + 0.5 * rhoA * 6.0) * 6.0 / EA


def contact_wire(spans: int = 3, span: float = 60.0, elements: int = 20, tension: float = 2e4) -> fb.Scene:
    """The contact wire of a railway: 12 mm of copper, 1.35 kg/m, pulled by 20 kN, on vertical hangers of 1.2 m at the ends of its
    spans."""
    radius = 0.006
    rho = 1.35 / (np.pi * radius**2)
    section = fb.Section.circle(radius=radius, E=1.2e11, rho=rho)
    length = spans * span
    line = fb.Beam.straight("wire", (0, 0, 0), (length, 0, 0), section=section, elements=spans * elements)
    hangers = [fb.Beam.straight(f"hanger {k}", (k * span, 0, 1.2), (k * span, 0, 0), section=section, elements=1)
               for k in range(1, spans + 1)]
    return fb.Scene(line, *hangers, fb.Pin(line.start), *(fb.Clamp(x.start) for x in hangers),
                    *(fb.BallJoint(line.at(k * span), x.end) for k, x in enumerate(hangers, 1)),
                    fb.Load("weight at the end", line.end, force=(tension, 0, 0)), gravity=(0, 0, -G), name="contact wire")


def elevator(eyes: int = 25, radius: float = 1.0, leg: float = 6.0, elements: int = 40, heavy: float = 1000.0,
             light: float = 900.0) -> fb.Scene:
    """A car and its counterweight on a rope over a sheave, here a half circle of fixed eyes through which the rope slides. The
    stress in the rope that goes around costs nothing: its reference shape is the same everywhere but for the half circle."""
    section = fb.Section.circle(radius=0.008, E=1e10, rho=5000.0)
    length = 2.0 * leg + np.pi * radius

    def shape(t: float) -> tuple[float, float, float]:
        s = t * length
        if s < leg:
            return (-radius, 0.0, s - leg)
        if s > length - leg:
            return (radius, 0.0, length - leg - s)
        angle = np.pi - (s - leg) / radius
        return (radius * np.cos(angle), 0.0, radius * np.sin(angle))

    rope = fb.Beam.from_curve("rope", shape, section=section, elements=elements)
    car = fb.PointMass("car", mass=heavy, position=(radius, 0, -leg))
    other = fb.PointMass("counterweight", mass=light, position=(-radius, 0, -leg))
    at = leg + np.pi * radius * (np.arange(eyes) + 0.5) / eyes
    points = [fb.PointMass(f"eye {k}", mass=1.0) for k in range(eyes)]
    return fb.Scene(rope, car, other, *points, *(fb.Pin(x) for x in points),
                    *(fb.Slider(f"slides {k}", x, rope, at=float(s)) for k, (x, s) in enumerate(zip(points, at))),
                    fb.BallJoint(car, rope.end), fb.BallJoint(other, rope.start), gravity=(0, 0, -G), name="elevator")


def ropeway(elements: int = 12, span: float = 60.0, tension: float = 5e4, cabin: float = 200.0) -> tuple[fb.Scene, float]:
    """A cabin runs along a rope between two masts that was stretched by `tension`: the scene, and the sag at its middle."""
    section = fb.Section.circle(radius=0.012, E=1e11, rho=7850.0)
    slack = span / (1.0 + tension / section.EA)
    rope = fb.Beam.straight("rope", (0, 0, 0), (slack, 0, 0), section=section, elements=elements)
    return fb.Scene(rope, fb.Pin(rope.start), fb.Load("pull", rope.end, force=(tension, 0, 0)), name="ropeway"), slack
