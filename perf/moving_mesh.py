"""Orders in the mesh of position, s and contact force of the study's sliding scenes (c), (d), (e) with elements that move
with the contact, from their sudden start and from a smooth one; the error of the step beside them, drift of energy and momenta,
and the cost of an iteration beside that of a mesh that stands still.

    python perf/moving_mesh.py [scene ...] [--half]
    python perf/moving_mesh.py mass_on_cable --quick      without costs and sudden starts

Exits with 1 where from a smooth start the order of position or s, from 6 to 24 elements, is less than 3.8, or that of the force
less than 2. Sudden starts have no bar.

Sudden, as in the study: weight that is there at once, velocities that bend free ends. Waves whose fronts are kinks run along the
beams, which no mesh resolves with its order. Smooth: the same beams, bodies and places of contacts; (c) at rest under a weight
that grows with six continuous derivatives, on the cable aslant so that it swings sideways; (d), (e) with the same sliding
velocity along a rail at rest that a force on its end, which grows in the same way, pushes and turns.
"""
from __future__ import annotations

import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import fastbeam as fb

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT / "examples" / "study"), str(ROOT / "perf")]

from printing import Bar, judged  # noqa: E402

# least orders in the mesh from smooth starts
ORDERS = {"s": 3.8, "position": 3.8, "force": 2.0}
# scene: end and step, s; the last mesh is the reference
RUNS = {"mass_on_cable": (0.5, 2.5e-3), "mass_on_cantilever": (2.0, 1e-2), "body_on_beam": (1.0, 1.25e-3),
        "beam_on_beam": (1.0, 1.25e-3)}
# the weight is whole at, s; its direction on the cable
GROWS = {"mass_on_cable": 0.4, "mass_on_cantilever": 1.5}
ASLANT = (0.0, 4.0, -9.81)
# force on the end of the rail, N, and the time in which it grows, s
PUSH, GROWN = (0.0, 20.0, -15.0), 0.8
MESHES = (6, 12, 24, 48)
OBSERVE = ("energy", "momentum", "slider", "reaction")


def grown(t: float) -> float:
    """From 0 to 1 for t from 0 to 1, with six continuous derivatives."""
    x = min(max(t, 0.0), 1.0)
    return x**7 * (1716.0 - 9009.0 * x + 20020.0 * x**2 - 24024.0 * x**3 + 16380.0 * x**4 - 6006.0 * x**5 + 924.0 * x**6)


def scene_of(name: str, elements: int, smooth: bool) -> fb.Scene:
    """A scene of the study with cubic elements that move, from its own start or from a smooth one."""
    import scenes
    scene = getattr(scenes, name)(elements=elements, degree=3).scene
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
    step = RUNS[name][1]
    found, drifts = zip(*(run(name, n, smooth, step) for n in MESHES))
    off = np.array([differences(x, found[-1]) for x in found[:-1]])
    rates = np.log2(off[:-1] / off[1:])
    print(f"{name}, {'smooth' if smooth else 'sudden'} start, to {RUNS[name][0]:g} s, h = {step:g}: drift {max(drifts):.1e}; "
          f"orders from 6 to 24: {', '.join(f'{x:.1f}' for x in np.log2(off[0] / off[2]) / 2.0)}", flush=True)
    for k, n in enumerate(MESHES[:-1]):
        order = "" if k == 0 else f"   orders {rates[k - 1, 0]:.1f}, {rates[k - 1, 1]:.1f}, {rates[k - 1, 2]:.1f}"
        print(f"  {n:3d} elements: s {off[k, 0]:.1e} m, position {off[k, 1]:.1e} m, force {off[k, 2]:.1e}{order}", flush=True)
    if halved:
        fine = [run(name, n, smooth, 0.5 * step)[0] for n in (12, 24, 48)]
        print("  with half the step, of 12 and 24 elements:", "; ".join(
            f"{x[0]:.1e} m, {x[1]:.1e} m, {x[2]:.1e}" for x in (differences(x, fine[-1]) for x in fine[:-1])), flush=True)
    found = zip(ORDERS.items(), off[2] / off[0]) if smooth else ()
    return [(f"{name}, error of {what}, 24 elements over 6", 4.0**-least, ratio,
             f"order {-np.log2(ratio) / 2.0:.1f}, at least {least:g}") for (what, least), ratio in found]


def cost(name: str, elements: int, step: float) -> None:
    """Print the time of an iteration, moving over standing."""
    import scenes
    scene = getattr(scenes, name)(elements=elements, degree=3).scene
    times: list[float] = []
    for one, options in ((scene, {"planar": False}), (fb.with_moving_meshes(scene), {})):
        model = fb.compile_scene(one, **options)
        best = np.inf
        for _ in range(4):
            begin = perf_counter()
            result: Any = fb.simulate(model, t_end=40 * step, step=step, observe=("energy",), progress=False)
            best = min(best, (perf_counter() - begin) / float(result.series["iterations"].sum()))
        times.append(best)
    print(f"{name}, {elements} elements: {1e6 * times[0]:.0f} us an iteration standing, {1e6 * times[1]:.0f} us moving: "
          f"{times[1] / times[0]:.2f}", flush=True)


def main() -> int:
    """Print all."""
    names = [x for x in sys.argv[1:] if not x.startswith("-")] or list(RUNS)
    quick, found = "--quick" in sys.argv, list[Bar]()
    for name in names:
        for smooth in (True,) if quick else (False, True):
            found += orders(name, smooth, "--half" in sys.argv)
        if not quick:
            cost(name, 24, RUNS[name][1])
    return int(judged(found) > 0)


if __name__ == "__main__":
    sys.exit(main())
