"""Orders in the mesh of position, s and contact force of the study's sliding scenes (c), (d), (e), and of (d) with a sleeve, with
elements that move with the contact, from their sudden start and from a smooth one; the error of the step beside them, drift of
energy and momenta, and the cost of an iteration beside that of a mesh that stands still. `driven`: the force that drives a sleeve
along a bent rod, in time, at 20 places inside an element of a mesh of 10 cubic elements.

    python perf/cases/moving_mesh.py [scene ...] [--half]
    python perf/cases/moving_mesh.py mass_on_cable --quick      without costs and sudden starts
    python perf/cases/moving_mesh.py driven
    python perf/cases/moving_mesh.py --friction         with Coulomb friction at every contact, from smooth starts

Exits with 1 where from a smooth start the order of position or s, from the first mesh to the third, is less than 3.8, or that of
the force less than 2, or where the driving force is off by more than 1e-5 of it. Sudden starts have no bar.

Sudden, as in the study: weight that is there at once, velocities that bend free ends. Waves whose fronts are kinks run along the
beams, which no mesh resolves with its order. Smooth: the same beams, bodies and places of contacts; (c) at rest under a weight
that grows with six continuous derivatives, on the cable aslant so that it swings sideways; (d), (e) with the same sliding
velocity along a rail at rest that a force on its end, which grows in the same way, pushes and turns.
"""
from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import fastbeam as fb
from fastbeam.stepping.stepper import Stepper

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "examples" / "study"), str(ROOT)]

from perf.printing import Bar, judged  # noqa: E402

# least orders in the mesh from smooth starts
ORDERS = {"s": 3.8, "position": 3.8, "force": 2.0}
# scene: end and step, s; the last mesh is the reference
RUNS = {"mass_on_cable": (0.5, 2.5e-3), "mass_on_cantilever": (2.0, 1e-2), "body_on_beam": (1.0, 1.25e-3),
        "beam_on_beam": (1.0, 1.25e-3), "body_in_sleeve": (1.0, 1.25e-3)}
# the weight is whole at, s; its direction on the cable
GROWS = {"mass_on_cable": 0.4, "mass_on_cantilever": 1.5}
ASLANT = (0.0, 4.0, -9.81)
# force on the end of the rail, N, and the time in which it grows, s
PUSH, GROWN = (0.0, 20.0, -15.0), 0.8
MESHES = (6, 12, 24, 48)
# a sleeve makes shear that dies away within sqrt(EI/GA), a quarter of an element of 12
FINER = {"body_in_sleeve": (6, 12, 36, 72)}
# coefficient of friction, and the length of a sleeve on whose ends its moments press, m
RUBS, BORE = 0.2, 0.2
OBSERVE = ("energy", "momentum", "slider", "reaction")
# of the driving force of a sleeve: elements, places inside one, bar of the relative error; moment (N m) and force (N) on the end
# of the rod, the time in which they grow and that after it, s, and the step
PIECES, PLACES, DRIVEN = 10, 20, 1e-5
WRENCH, SIDEWAYS, RAMP, AFTER, PACE = 12.0, 2.0, 8.0, 0.5, 0.02
ROD = fb.Section(EA=4e3, GA2=1.5e3, GA3=1.5e3, GJ=20.0, EI2=20.0, EI3=20.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def grown(t: float) -> float:
    """From 0 to 1 for t from 0 to 1, with six continuous derivatives."""
    x = min(max(t, 0.0), 1.0)
    return x**7 * (1716.0 - 9009.0 * x + 20020.0 * x**2 - 24024.0 * x**3 + 16380.0 * x**4 - 6006.0 * x**5 + 924.0 * x**6)


def given(name: str, elements: int) -> fb.Scene:
    """A scene of the study with cubic elements; body_in_sleeve: its body on a beam, held by a sleeve."""
    import scenes
    if name != "body_in_sleeve":
        return getattr(scenes, name)(elements=elements, degree=3).scene  # type: ignore[no-any-return]
    scene = scenes.body_on_beam(elements=elements, degree=3).scene
    parts = [fb.Sleeve(x.name, x.point, x.beam, at=x.at, rate=x.rate, length=0.0) if isinstance(x, fb.Slider) else x
             for x in scene.parts]
    return fb.Scene(*parts, name=name, project_velocities=True)


def driven(at: float, moves: bool, force: float, **sleeve: Any) -> tuple[float, float]:
    """Force along a rod of 2 m on a sleeve at `at` that a heavy body holds, and the exact one, N, after a moment and a force
    across have grown on the end of the rod. It is clamped at its start, straight up to the sleeve and bent behind it.
    N + N^2/(2 EA) before the sleeve, N the force of the rod, is the sum of that, M^2/(2 EI) and Q^2/(2 GA) behind it."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=ROD, elements=PIECES)
    body = fb.RigidBody("body", mass=1e9, inertia=(1e9, 1e9, 1e9), position=(at, 0, 0))
    scene = fb.Scene(rod, body, fb.Clamp(rod.start), fb.Sleeve("sleeve", body, rod, at=at, **sleeve),
                     fb.Load("wrench", rod.end, moment=(0, 0, WRENCH), force=(0, force, 0), time=lambda t: grown(t / RAMP)))
    scene = fb.with_moving_meshes(scene) if moves else scene
    result = fb.simulate(fb.compile_scene(scene, planar=False), t_end=RAMP + AFTER, step=PACE, observe=("slider", "reaction"),
                         points={"end": scene.beams[0].end}, progress=False)
    late = result.t > RAMP
    found = float(np.mean(result.slider("sleeve")["force"][late, 0]))
    moment = WRENCH + force * float(np.mean(result.point("end")[late, 0]) - at)
    w = moment**2 / (2.0 * ROD.EI3) + force**2 / (2.0 * ROD.GA2)
    return abs(found), w / (0.5 + np.sqrt(0.25 + 0.5 * w / ROD.EA))


def places() -> list[Bar]:
    """Print errors of driving forces at places inside an element, with elements that move and that stand; bars of the former."""
    out: list[Bar] = []
    width = 2.0 / PIECES
    for force, what in ((0.0, "moment"), (SIDEWAYS, "moment and force")):
        for moves, sleeve in ((True, {}), (False, {"length": 0.0}), (False, {})):
            some = 1.0 + width * np.arange(PLACES) / PLACES
            found = np.array([driven(float(at), moves, force, **sleeve) for at in some[::1 if moves else 4]])
            worst = float(np.max(np.abs(found[:, 0] / found[:, 1] - 1.0)))
            kind = "move" if moves else "stand, a point" if sleeve else "stand, the bore of an element"
            print(f"driving force under a {what}, {len(found)} places, elements that {kind}: off by {worst:.1e}", flush=True)
            if moves:
                out.append((f"driving force in time under a {what}, {PLACES} places", DRIVEN, worst, ""))
    return out


def rubbing(scene: fb.Scene) -> fb.Scene:
    """The scene with friction at every contact."""
    parts: list[Any] = [replace(x, friction=RUBS) if isinstance(x, fb.Slider) and not isinstance(x, fb.Sleeve) else
                        replace(x, friction=RUBS, length=BORE) if isinstance(x, fb.Sleeve) else x for x in scene.parts]
    return fb.Scene(*parts, name=scene.name, gravity=scene.gravity, project_velocities=scene.project_velocities)


def scene_of(name: str, elements: int, smooth: bool) -> fb.Scene:
    """A scene of the study with cubic elements that move, from its own start or from a smooth one."""
    scene = given(name, elements)
    if "--friction" in sys.argv:
        scene = rubbing(scene)
    if not smooth:
        return fb.with_moving_meshes(scene)
    parts: list[Any] = [part for part in scene.parts if not isinstance(part, (fb.RigidMotion, fb.InitialVelocity))]
    options: dict[str, Any] = {"name": scene.name, "project_velocities": True}
    if name in GROWS:
        gravity = ASLANT if name == "mass_on_cable" else scene.gravity
        options |= {"gravity": gravity, "gravity_time": lambda t: grown(t / GROWS[name])}
    else:
        rail, *others = scene.beams
        parts.append(fb.Load("push", rail.end, force=PUSH, time=lambda t: grown(t / GROWN)))
        parts += [fb.InitialVelocity(beam, velocity=(1.2, 0, 0)) for beam in others]
    return fb.with_moving_meshes(fb.Scene(*parts, **options))


def run(name: str, elements: int, smooth: bool, step: float) -> tuple[tuple[Any, Any, Any], float]:
    """s, position and force of the contact at the end, the row before the last, and the largest drift of what the scene keeps."""
    scene = scene_of(name, elements, smooth)
    t_end = RUNS[name][0]
    result = fb.simulate(fb.compile_scene(scene), t_end=t_end + step, step=step, observe=OBSERVE, progress=False)
    x = result.slider(scene.sliders[0].name)
    keeps = [x for x in ("total", "balance", "lin_mom", "ang_mom") if x in result.series and result.is_conserved(x)]
    return (x["s"][-2], x["position"][-2], x["force"][-2]), max(result.drift(x) for x in keeps)


def differences(found: tuple[Any, Any, Any], exact: tuple[Any, Any, Any]) -> np.ndarray:
    """Of s and position in m, of the force relative."""
    return np.array([abs(found[0] - exact[0]), np.linalg.norm(found[1] - exact[1]),
                     np.linalg.norm(found[2] - exact[2]) / np.linalg.norm(exact[2])])


def orders(name: str, smooth: bool, halved: bool) -> list[Bar]:
    """Print differences to the finest mesh, their orders, and how they are with half the step where that is asked for; bars of a
    smooth start: what errors may be of those of a mesh four times as coarse."""
    step, meshes = RUNS[name][1], np.array(FINER.get(name, MESHES))
    found, drifts = zip(*(run(name, int(n), smooth, step) for n in meshes))
    off = np.array([differences(x, found[-1]) for x in found[:-1]])
    rates = np.log(off[:-1] / off[1:]) / np.log(meshes[1:-1] / meshes[:-2])[:, None]
    finer = meshes[2] / meshes[0]
    whole = np.log(off[0] / off[2]) / np.log(finer)
    print(f"{name}, {'smooth' if smooth else 'sudden'} start, to {RUNS[name][0]:g} s, h = {step:g}: drift {max(drifts):.1e}; "
          f"orders from {meshes[0]} to {meshes[2]}: {', '.join(f'{x:.1f}' for x in whole)}", flush=True)
    for k, n in enumerate(meshes[:-1]):
        order = "" if k == 0 else f"   orders {rates[k - 1, 0]:.1f}, {rates[k - 1, 1]:.1f}, {rates[k - 1, 2]:.1f}"
        print(f"  {n:3d} elements: s {off[k, 0]:.1e} m, position {off[k, 1]:.1e} m, force {off[k, 2]:.1e}{order}", flush=True)
    if halved:
        fine = [run(name, int(n), smooth, 0.5 * step)[0] for n in meshes[1:]]
        print(f"  with half the step, of {meshes[1]} and {meshes[2]} elements:", "; ".join(
            f"{x[0]:.1e} m, {x[1]:.1e} m, {x[2]:.1e}" for x in (differences(x, fine[-1]) for x in fine[:-1])), flush=True)
    found = zip(ORDERS.items(), off[2] / off[0], whole) if smooth else ()
    return [(f"{name}, error of {what}, {meshes[2]} elements over {meshes[0]}", finer**-least, ratio,
             f"order {order:.1f}, at least {least:g}") for (what, least), ratio, order in found]


def cost(name: str, elements: int, step: float) -> None:
    """Print the time of an iteration, moving over standing, in space and in the plane of a scene that has one."""
    scene = given(name, elements)
    for where, planar in (("in space", False), ("in a plane", True)):
        if planar and fb.compile_scene(scene).plane is None:
            return
        times: list[float] = []
        for one in (scene, fb.with_moving_meshes(scene)):
            model = fb.compile_scene(one, planar=planar)
            best = np.inf
            for _ in range(5):
                stepper = Stepper(model, np.ones(1))
                stepper.advance(0.0, step, 2)
                begin = perf_counter()
                outcome = stepper.advance(0.0, step, 100)
                best = min(best, (perf_counter() - begin) / outcome.iterations)
            times.append(best)
        print(f"{name}, {elements} elements {where}: {1e6 * times[0]:.0f} us an iteration standing, "
              f"{1e6 * times[1]:.0f} us moving: {times[1] / times[0]:.2f}", flush=True)


def main() -> int:
    """Print all."""
    names = [x for x in sys.argv[1:] if not x.startswith("-")] or [*RUNS, *(["driven"] if "--friction" not in sys.argv else [])]
    quick, found = "--quick" in sys.argv or "--friction" in sys.argv, list[Bar]()
    for name in names:
        if name == "driven":
            found += places()
            continue
        for smooth in (True,) if quick else (False, True):
            found += orders(name, smooth, "--half" in sys.argv)
        if not quick:
            cost(name, 24, 0.2 * RUNS[name][1])
    return int(judged(found) > 0)


if __name__ == "__main__":
    sys.exit(main())
