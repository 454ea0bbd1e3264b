"""Small scenes that several tests share, so that few variants of the kernels are compiled."""
from __future__ import annotations

import numpy as np

import fastbeam as fb

Array = np.ndarray
SECTION = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=600.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)


def straight(name: str, start: tuple[float, float, float], end: tuple[float, float, float], **changes: object) -> fb.Beam:
    """A beam of three quadratic elements."""
    return fb.Beam.straight(name, start, end, **{"section": SECTION, "elements": 3, "degree": 2, **changes})


def bent(beam: fb.Beam) -> fb.InitialVelocity:
    """Velocities that bend, twist and move a beam; v and spin belong together only roughly, shear waves are welcome."""
    k = np.pi / beam.length

    def velocity(s: Array) -> Array:
        return np.stack((0.2 + 0 * s, np.sin(k * s), 0.5 * np.cos(k * s)), axis=1)

    def spin(s: Array) -> Array:
        return np.stack((0.3 + 0 * s, 0.5 * k * np.sin(k * s), k * np.cos(k * s)), axis=1)

    return fb.InitialVelocity(beam, velocity=velocity, spin=spin)


def free_beam() -> fb.Scene:
    """A beam that flies, bends and turns."""
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, bent(beam), name="free beam")


def bead(at: float = 1.0, rate: float = 1.5) -> fb.Scene:
    """The same with a mass that slides along."""
    beam, mass = straight("rail", (0, 0, 0), (3, 0, 0)), fb.PointMass("bead", mass=0.5)
    return fb.Scene(beam, mass, fb.Slider("run", mass, beam, at=at, rate=rate), bent(beam), name="bead")


def cantilever(force: float = 20.0) -> fb.Scene:
    """Clamped on the left, pulled up on the right."""
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, force)), name="cantilever")


def grid(n: int, layers: int = 1, **changes: object) -> fb.Scene:
    """n x n crossings in each layer, neighbours joined by short beams, all rigidly connected, spinning in free flight."""
    scene = fb.Scene(name=f"grid {n} x {n} x {layers}")
    ends: dict[tuple[int, int, int], list[fb.NodeRef]] = {}
    for a in np.ndindex(n, n, layers):
        for step in np.eye(3, dtype=int):
            b = tuple(int(x) for x in a + step)
            if b[0] < n and b[1] < n and b[2] < layers:
                beam = straight(f"{a} to {b}", a, b, **{"elements": 2, **changes})
                scene.add(beam)
                ends.setdefault(a, []).append(beam.start)
                ends.setdefault(b, []).append(beam.end)
    for first, *others in ends.values():
        scene.add(*(fb.RigidConnection(first, other) for other in others))
    return scene.add(fb.RigidMotion(velocity=(1, 0.5, 0), spin=(0.3, 0.4, 0.5), about=(0.5, 0.5, 0)))


def drifts(result: fb.Result) -> dict[str, float]:
    """Largest relative drift of every invariant that was recorded."""
    return {name: result.drift(name) for name in ("total", "lin_mom", "ang_mom", "gap") if name in result.series}
