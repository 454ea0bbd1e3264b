"""Orders in the mesh of position, s and contact force of the study's sliding scenes (c), (d), (e) with elements that move
with the contact, drift of energy and momenta, and the cost of an iteration beside that of a mesh that stands still.

    python perf/moving_mesh.py [scene ...] [--long]
"""
from __future__ import annotations

import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import fastbeam as fb

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT / "examples" / "study")]
# scene, end, step, elements; the last mesh is the reference
RUNS = {"mass_on_cable": (0.5, 2.5e-3), "mass_on_cantilever": (2.0, 1e-2), "body_on_beam": (1.0, 1.25e-3),
        "beam_on_beam": (1.0, 1.25e-3)}
MESHES = (6, 12, 24, 48)
OBSERVE = ("energy", "momentum", "slider", "reaction")


def run(name: str, elements: int, t_end: float, step: float) -> tuple[fb.Result, str, list[float]]:
    """The scene with a moving mesh, its slider, and the drift of what it keeps."""
    import scenes
    scene = fb.with_moving_meshes(getattr(scenes, name)(elements=elements, degree=3).scene)
    result = fb.simulate(fb.compile_scene(scene), t_end=t_end, step=step, observe=OBSERVE, progress=False)
    keeps = ["total", "lin_mom", "ang_mom"] if not np.any(scene.gravity) else ["total"]
    return result, scene.sliders[0].name, [result.drift(x) for x in keeps]


def orders(name: str, t_end: float, step: float) -> None:
    """Print differences to the finest mesh, at the row before the last, and their orders."""
    found, drifts = [], []
    for n in MESHES:
        result, slider, drift = run(name, n, t_end + step, step)
        x = result.slider(slider)
        found.append((x["s"][-2], x["position"][-2], x["force"][-2]))
        drifts.append(max(drift))
    *coarse, exact = found
    off = np.array([[abs(s - exact[0]), np.linalg.norm(x - exact[1]), np.linalg.norm(f - exact[2]) / np.linalg.norm(exact[2])]
                    for s, x, f in coarse])
    rates = np.log2(off[:-1] / off[1:])
    print(f"{name}, to {t_end:g} s, h = {step:g}: drift {max(drifts):.1e}", flush=True)
    for k, n in enumerate(MESHES[:-1]):
        order = "" if k == 0 else f"   orders {rates[k - 1, 0]:.1f}, {rates[k - 1, 1]:.1f}, {rates[k - 1, 2]:.1f}"
        print(f"  {n:3d} elements: s {off[k, 0]:.1e} m, position {off[k, 1]:.1e} m, force {off[k, 2]:.1e}{order}", flush=True)


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


def main() -> None:
    """Print all."""
    names = [x for x in sys.argv[1:] if not x.startswith("-")] or list(RUNS)
    for name in names:
        orders(name, *RUNS[name])
        cost(name, 24, RUNS[name][1])


if __name__ == "__main__":
    main()
