"""Compiles the kernels of common scenes ahead of their first use: `python -m fastbeam warmup`.

Kernels are compiled for the parts that a scene has, so each scene below is small and has one combination of them.
"""
from __future__ import annotations

import time
from collections.abc import Callable

from fastbeam.compile.compile import compile_scene
from fastbeam.dynamics.time_loop import simulate
from fastbeam.scene import (
    BallJoint,
    Beam,
    Clamp,
    Load,
    PointMass,
    RigidBody,
    RigidConnection,
    RigidMotion,
    Scene,
    Section,
    Slider,
)
from fastbeam.statics.static_analysis import solve_static

SECTION = Section.circle(radius=0.01, E=1e8, rho=1000.0)
DOWN = (0.0, 0.0, -9.81)
OBLIQUE = (0.3, 0.2, -9.81)


def _rail() -> Beam:
    return Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=SECTION, elements=4)


def _free_beam() -> None:
    beam = _rail()
    _step(Scene(beam, RigidMotion(spin=(0.1, 0.2, 0.3))))


def _bead(gravity: tuple[float, float, float]) -> None:
    rail, bead = _rail(), PointMass("bead", mass=0.1)
    _step(Scene(rail, bead, Clamp(rail.start), Slider("run", bead, rail, at=0.3), gravity=gravity))


def _mechanism(gravity: tuple[float, float, float]) -> None:
    rail, load = _rail(), RigidBody("load", mass=0.1, inertia=(1e-4, 1e-4, 1e-4), position=(1, 0, 0))
    rope, bead = Beam.straight("rope", (1, 0, 0), (1, 0, -1), section=SECTION, elements=4), PointMass("bead", mass=0.1)
    _step(Scene(rail, load, rope, bead, Clamp(rail.start), RigidConnection(rail.end, load), BallJoint(load, rope.start),
                Slider("run", bead, rail, at=0.3), gravity=gravity))


def _statics(force: tuple[float, float, float]) -> None:
    beam = _rail()
    solve_static(compile_scene(Scene(beam, Clamp(beam.start), Load("tip", beam.end, force=force))))


def _step(scene: Scene) -> None:
    simulate(compile_scene(scene), t_end=1e-3, step=1e-3, progress=False)


KINDS: dict[str, tuple[str, Callable[[], None]]] = {
    "beam": ("a free beam in space", _free_beam),
    "slider": ("a mass that slides on a clamped beam under gravity, in space", lambda: _bead(OBLIQUE)),
    "planar-slider": ("the same in a plane", lambda: _bead(DOWN)),
    "mechanism": ("beams, a body, joints and a sliding mass, in space", lambda: _mechanism(OBLIQUE)),
    "planar-mechanism": ("the same in a plane", lambda: _mechanism(DOWN)),
    "statics": ("a clamped beam at rest under a load, in space", lambda: _statics((0.01, 0.02, 0.03))),
    "planar-statics": ("the same in a plane", lambda: _statics((0.0, 0.0, 0.03)))}


def warm_up(kinds: list[str], say: Callable[[str], None]) -> None:
    """Compile the kernels of the named kinds of scenes; what is compiled already costs nothing.

    kinds: keys of `KINDS`.
    say: called with a line before and after each.
    """
    for k, name in enumerate(kinds, 1):
        text, run = KINDS[name]
        begin = time.perf_counter()
        say(f"{k}/{len(kinds)} {name}: {text} ...")
        run()
        say(f"    {time.perf_counter() - begin:.1f} s")
