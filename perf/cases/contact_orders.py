"""Places and contact forces of the study's sliding scenes (c), (d), (e) on finer and finer meshes, and of the bead of
tests/naive_moving_mesh.py: docs/reports/contacts-ahead.md A.7.

    python perf/cases/contact_orders.py
"""
from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import fastbeam as fb

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "examples" / "study"), str(ROOT / "tests"), str(ROOT / "tests" / "validation")]
RUNS = (("mass_on_cable", 0.5, 2.5e-3), ("mass_on_cantilever", 2.0, 1e-2), ("body_on_beam", 1.0, 5e-3),
        ("beam_on_beam", 1.0, 5e-3))


def ends_at(name: str, elements: int, curve: str, t_end: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """s and force of the slider of a scene of the study at t_end."""
    import scenes
    scene = getattr(scenes, name)(elements=elements, degree=3).scene
    parts: list[Any] = [replace(part, curve=curve) if isinstance(part, fb.Slider) else part for part in scene.parts]
    again = fb.Scene(*parts, name=scene.name, gravity=scene.gravity, project_velocities=True)
    result = fb.simulate(fb.compile_scene(again), t_end=t_end, step=step, order=4, every=10**6, progress=False)
    run = result.slider(scene.sliders[0].name)
    return run["s"][-1], run["force"][-1]


def main() -> None:
    """Print both tables."""
    for name, t_end, step in RUNS:
        for curve in ("c1", "own"):
            *coarse, (s, force) = [ends_at(name, n, curve, t_end, step) for n in (6, 12, 24, 48, 96)]
            off = [f"{abs(a - s):.1e}, {np.linalg.norm(b - force) / np.linalg.norm(force):.1e}" for a, b in coarse]
            print(f"{name} {curve}: {' | '.join(off)}", flush=True)
    from naive_moving_mesh import MovingMesh
    from test_moving_mesh import END, RATE, START, errors, standing
    exact = MovingMesh(4, 6).run(START, RATE, END)
    for p in (2, 3, 4):
        for n in (2, 4, 8):
            print(f"moving, degree {p}, {2 * n} elements:", errors(MovingMesh(n, p).run(START, RATE, END), exact), flush=True)
    for curve in ("c1", "own"):
        for n in (4, 8, 16, 32, 64):
            print(f"standing, {curve}, {n} elements:", errors(standing(n, curve), exact), flush=True)


if __name__ == "__main__":
    main()
