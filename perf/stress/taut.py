"""Taut thin ropes with few elements: stability, frequencies, and machines whose answers are known without fastbeam.

Invariants say nothing here: a rope whose elements lose their shape keeps energy and momenta to round-off and lets its load fall.
"""
from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from scipy.linalg import eigh

import fastbeam as fb
from perf.stress.matrices import matrices
from perf.stress.table import Row

Array = np.ndarray
G = 9.81
FAMILIES = {**{f"lagrange {p}": {"degree": p} for p in range(1, 9)},
            **{f"bspline {p}": {"degree": p, "interpolation": "bspline"} for p in range(2, 6)}}
# of a quick run
FEW, FEW_COUNTS = ("lagrange 1", "lagrange 3", "lagrange 8", "bspline 3"), (3, 8)
TENSIONS = 10.0**np.arange(-2, 9)
QUIET: dict[str, Any] = {"progress": False, "output": fb.Output(snapshots=0)}


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


def bent(elements: Sequence[int], degree: int, **family: Any) -> list[str]:
    """Ropes under loads sideways of 0.1 % to 30 % of the tension that are called unstable, fail, or whose end is not in the
    direction of the load, as far as the clamp lets it."""
    out = []
    for n, share, count in itertools.product(TENSIONS[2:], (1e-3, 1e-2, 0.1, 0.3), elements):
        try:
            result = stretched(n, count, share * n, degree=degree, **family)[1]
        except fb.ConvergenceError as error:
            out.append(f"{count} elements, N = {n:g}, {share:g} N sideways: failed at {error.time:.3g}")
            continue
        x, y, _ = result.state.q.reshape(-1, 4, 3)[-1, 0]
        # a clamp keeps the rope straight over its bending length
        off = abs(np.arctan2(y, x) - np.arctan(share)) > 0.1 * np.arctan(share) + np.arctan(share) / np.sqrt(n)
        if result.info["unstable_directions"] or off:
            out.append(f"{count} elements, N = {n:g}, {share:g} N sideways: unstable {result.info['unstable_directions']}, "
                       f"end at {x:.4f}, {y:.4f}")
    return out


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


def atwood(t: float, radius: float = 1.0, leg: float = 6.0, heavy: float = 1000.0, light: float = 900.0) -> float:
    """How far the car has gone down after t seconds, were the rope inextensible: its weight and inertia, and the force
    EI/radius^2 of bending what enters the sheave and straightening what leaves it."""
    section = fb.Section.circle(radius=0.008, E=1e10, rho=5000.0)
    rope = section.rhoA * (2.0 * leg + np.pi * radius)
    # the difference of the legs grows by 2 x
    a = ((heavy - light) * G - section.EI2 / radius**2) / (heavy + light + rope)
    b = 2.0 * section.rhoA * G / (heavy + light + rope)
    return float(a / b * (np.cosh(np.sqrt(b) * t) - 1.0))


def crane(rope_elements: int = 6, rope_length: float = 6.0) -> fb.Scene:
    """A load of 500 kg on a rope of 16 mm hangs from a trolley that runs on a stiff boom."""
    boom_section = fb.Section.tube(radius=0.15, thickness=0.01, E=210e9, rho=7850.0)
    wire = fb.Section.circle(radius=0.008, E=1e10, rho=5000.0)
    boom = fb.Beam.straight("boom", (0, 0, 0), (8, 0, 0), section=boom_section, elements=8)
    rope = fb.Beam.straight("rope", (2, 0, 0), (2, 0, -rope_length), section=wire, elements=rope_elements)
    trolley = fb.PointMass("trolley", mass=100.0, position=(2, 0, 0))
    load = fb.PointMass("load", mass=500.0, position=(2, 0, -rope_length))
    return fb.Scene(boom, rope, trolley, load, fb.Clamp(boom.start), fb.Slider("trolley on boom", rope.start, boom, at=2.0),
                    fb.BallJoint(rope.start, trolley), fb.BallJoint(load, rope.end),
                    fb.RigidMotion((rope, trolley, load), velocity=(0.5, 0, 0)),
                    fb.RigidMotion((rope, load), spin=(0.15, 0, 0), about=(2, 0, 0)), gravity=(0, 0, -G), name="crane")


# ------------------------------------------------------------------------------------------------------------------------ rows
def ropes(names: Iterable[str], counts: Sequence[int]) -> Iterator[Row]:
    """Straight ropes in statics, bent ones of so many elements, and their frequencies, of these families."""
    for name in names:
        family = FAMILIES[name]
        spline = name.startswith("bspline")
        found = unstable_directions(8 if spline else 4, **family)
        yield Row(f"{name}: unstable directions, N = 1e-2 to 1e8 EI/L^2", "none", str(max(found)), max(found) == 0)
        if not spline or family["degree"] == 2:
            wrong = bent(counts, **family)
            yield Row(f"{name}: loads sideways to 30 % of the tension, {', '.join(map(str, counts))} elements",
                      "stable, in the direction of the load", wrong[0] if wrong else "all", not wrong)
        # where bending counts, splines of degree 4 are too stiff with 8, docs/limits.md
        elements = 24 if family["degree"] == 1 else 16 if name == "bspline 4" else 8
        off = [float(np.abs(frequency_errors(n, elements, **family)).max()) for n in TENSIONS]
        yield Row(f"{name}: three frequencies, {elements} elements", "1 % where EI is negligible, 2 % elsewhere",
                  f"{max(off[6:]):.1e}; {max(off[:6]):.1e}", max(off[6:]) <= 0.01 and max(off[:6]) <= 0.02)


def swings(quick: bool) -> Iterator[Row]:
    """A load of 1000 kg on six default elements, all step sizes and degrees, against a fine mesh with small steps."""
    load = "load"
    scene = hanging_load(elements=24)
    fine, _ = final(scene, 2.0, 2.5e-4, {load: scene.masses[0]}, every=80)
    lowest = fine.point(load)[:, 2].min()
    steps = (1e-3, 5e-3, 2e-2) if quick else (1e-4, 2e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
    cases = [({}, h) for h in steps] + [({"degree": p, "elements": n}, 1e-3) for p, n in ((1, 6), (2, 6), (3, 1), (4, 6), (6, 3))]
    for family, h in cases:
        scene = hanging_load(**family)
        found, message = final(scene, 2.0, h, {load: scene.masses[0]}, every=max(1, round(2e-2 / h)))
        z, x = found.point(load)[:, 2], found.point(load)[:, 0]
        off = max(abs(z.min() - lowest), float(np.abs(x - np.interp(found.t, fine.t, fine.point(load)[:, 0])).max()))
        yield Row(f"load of 1000 kg, {family or 'default'}, step {h:g} s", "within 1 mm of the converged swing, energy kept",
                  f"{1e3 * off:.2f} mm, drift {found.drift('total'):.0e} {message[:40]}",
                  not message and off <= 1e-3 and found.drift("total") <= 1e-11)


def machines(quick: bool) -> Iterator[Row]:
    """Elevator, crane, contact wire."""
    t_end = 1.0 if quick else 2.0
    scene = elevator()
    found, message = final(scene, t_end, 2e-3, {"car": scene.masses[0]})
    way = -6.0 - found.point("car")[-1, 2]
    # the rope stretches by N L/EA = 0.04 m and bounces once as far
    yield Row(f"elevator: rope through 25 eyes, {t_end:g} s", f"Atwood: {atwood(t_end):.3f} m down, stretch up to 0.08 m",
              f"{way:.3f} m, drift {found.drift('total'):.0e} {message[:60]}",
              not message and -0.01 <= way - atwood(t_end) <= 0.09 and found.drift("total") <= 1e-11)
    paths = []
    for elements in (6, 24):
        scene = crane(elements)
        found, message = final(scene, t_end, 2e-3, {"load": scene.masses[1]})
        paths.append(found.point("load"))
        yield Row(f"crane: rope of {elements} elements", "runs to the end, energy kept",
                  f"drift {found.drift('total'):.0e} {message[:60]}", not message and found.drift("total") <= 1e-11)
    off = float(np.abs(paths[0] - paths[1]).max()) if paths[0].shape == paths[1].shape else np.inf
    yield Row("crane: load, 6 against 24 elements", "within 5 mm", f"{1e3 * off:.2f} mm", off <= 5e-3)
    for elements in (5, 20) if quick else (5, 20, 90):
        scene = contact_wire(elements=elements)
        model = fb.compile_scene(scene)
        result = fb.solve_static(model, points={"middle": (scene.beams[0], 90.0)})
        sag = 1.35 * G * 60.0**2 / (8.0 * 2e4)
        z = -result.point("middle")[-1, 2]
        # the hangers give by w L L_h / EA and the pull decreases a little behind each of them
        yield Row(f"contact wire, 20 kN, spans of 60 m, {elements} elements a span: sag",
                  f"{sag:.4f} m of the string within 2 %, stable",
                  f"{z:.4f} m, unstable {result.info['unstable_directions']}, free {result.info['free_directions']}",
                  abs(z / sag - 1.0) <= 0.02 and result.info["unstable_directions"] == 0)
        moved, message = final_from(model, result.state, 0.5, 1e-3, {"middle": (scene.beams[0], 90.0)})
        off = float(np.abs(moved.point("middle")[:, 2] + z).max())
        yield Row(f"contact wire, {elements} elements a span: at rest for 0.5 s", "stays, 1e-6 m", f"{off:.1e} m {message[:60]}",
                  not message and off <= 1e-6)


def final_from(model: fb.Model, state: Any, t_end: float, step: float, points: dict[str, Any]) -> tuple[fb.Result, str]:
    """The same from a state."""
    try:
        return fb.simulate(model, start=fb.Start(state, time=0.0), t_end=t_end, step=step, points=points, **QUIET), ""
    except fb.ConvergenceError as failed:
        return failed.result, str(failed)


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    yield from ropes(*((FEW, FEW_COUNTS) if quick else (FAMILIES, (2, 3, 4, 6, 8, 12))))
    yield from swings(quick)
    yield from machines(quick)
